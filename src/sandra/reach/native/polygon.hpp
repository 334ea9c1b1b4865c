// Convex polygons in a position-velocity plane: the twin of reach/polygon.py, operation by operation.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <vector>

namespace sandra {

constexpr double EPS = 1e-9;
constexpr double PARALLEL = 1e-12;
constexpr std::size_t MAX_CORNERS = 16;
constexpr double INF = std::numeric_limits<double>::infinity();

struct Point {
    double x, y;
};

inline bool operator==(const Point &a, const Point &b) { return a.x == b.x && a.y == b.y; }

// A view of points that an arena holds.
struct Polygon {
    const Point *points = nullptr;
    std::size_t size = 0;

    bool empty() const { return size == 0; }
    const Point &operator[](std::size_t i) const { return points[i]; }
};

struct Range {
    double low, high;
};

// Points that stay where they are until the arena is cleared.
class Arena {
  public:
    Arena() = default;
    Arena(const Arena &) = delete;

    Point *take(std::size_t count) {
        while (block_ == blocks_.size() || used_ + count > blocks_[block_].size) {
            if (block_ < blocks_.size() && used_ == 0) {  // a block too small even when empty
                blocks_[block_] = Block(std::max(count, BLOCK));
            } else if (block_ < blocks_.size()) {
                ++block_;
                used_ = 0;
            } else {
                blocks_.emplace_back(std::max(count, BLOCK));
            }
        }
        Point *found = blocks_[block_].points.get() + used_;
        used_ += count;
        return found;
    }

    // Gives back the last `count` points of the last `take`.
    void give_back(std::size_t count) { used_ -= count; }

    Polygon keep(const Point *points, std::size_t size) {
        Point *mine = take(size);
        std::copy(points, points + size, mine);
        return {mine, size};
    }

    void clear() { block_ = used_ = 0; }

  private:
    static constexpr std::size_t BLOCK = 4096;
    struct Block {
        explicit Block(std::size_t n) : points(new Point[n]), size(n) {}
        std::unique_ptr<Point[]> points;
        std::size_t size;
    };
    std::vector<Block> blocks_;
    std::size_t block_ = 0, used_ = 0;
};

inline Range range_x(const Polygon &p) {
    Range r{p[0].x, p[0].x};
    for (std::size_t i = 1; i < p.size; ++i) {
        if (p[i].x < r.low) r.low = p[i].x;
        if (p[i].x > r.high) r.high = p[i].x;
    }
    return r;
}

inline Range range_y(const Polygon &p) {
    Range r{p[0].y, p[0].y};
    for (std::size_t i = 1; i < p.size; ++i) {
        if (p[i].y < r.low) r.low = p[i].y;
        if (p[i].y > r.high) r.high = p[i].y;
    }
    return r;
}

inline bool before(const Point &a, const Point &b) { return a.x < b.x || (a.x == b.x && a.y < b.y); }

// Appends the points, which are sorted, at which their chain turns left; returns where it ends.
template <typename Iterator>
inline Point *chain(Iterator begin, Iterator end, Point *out) {
    Point *last = out;
    for (Iterator p = begin; p != end; ++p) {
        if (last != out && *(last - 1) == *p) continue;
        while (last - out > 1) {
            const Point &a = *(last - 2), &b = *(last - 1);
            if ((b.x - a.x) * (p->y - a.y) - (b.y - a.y) * (p->x - a.x) > 0.0) break;
            --last;
        }
        *last++ = *p;
    }
    return last;
}

// The convex hull of `points`; `out` needs room for twice as many.
inline std::size_t hull(std::vector<Point> &points, Point *out) {
    std::sort(points.begin(), points.end(), before);
    points.erase(std::unique(points.begin(), points.end()), points.end());
    if (points.size() < 3) return std::copy(points.begin(), points.end(), out) - out;
    Point *middle = chain(points.begin(), points.end(), out) - 1;
    return static_cast<std::size_t>(chain(points.rbegin(), points.rend(), middle) - 1 - out);
}

// Runs of points, each of them sorted, that are merged into one.
template <bool UP>
class Runs {
  public:
    void clear() {
        points_.clear();
        ends_.clear();
        sorted_ = true;
    }

    // Points `from` to `to` of a ring.
    void add(const Polygon &p, std::size_t from, std::size_t to) {
        for (std::size_t i = from;; i = i + 1 < p.size ? i + 1 : 0) {
            sorted_ = sorted_ && (i == from || !less(p[i], points_.back()));
            points_.push_back(p[i]);
            if (i == to) break;
        }
        ends_.push_back(points_.size());
    }

    const std::vector<Point> &sorted() {
        if (!sorted_) {  // an edge across the way, off by a rounding
            std::sort(points_.begin(), points_.end(), less);
            return points_;
        }
        while (ends_.size() > 1) {
            other_.resize(points_.size());
            std::size_t kept = 0, begin = 0, i = 0;
            for (; i + 1 < ends_.size(); i += 2) {
                const auto at = [&](std::size_t n) { return points_.begin() + static_cast<std::ptrdiff_t>(n); };
                std::merge(at(begin), at(ends_[i]), at(ends_[i]), at(ends_[i + 1]),
                           other_.begin() + static_cast<std::ptrdiff_t>(begin), less);
                begin = ends_[kept++] = ends_[i + 1];
            }
            if (i < ends_.size()) {
                std::copy(points_.begin() + static_cast<std::ptrdiff_t>(begin), points_.end(),
                          other_.begin() + static_cast<std::ptrdiff_t>(begin));
                ends_[kept++] = ends_[i];
            }
            ends_.resize(kept);
            points_.swap(other_);
        }
        return points_;
    }

  private:
    static bool less(const Point &a, const Point &b) { return UP ? before(a, b) : before(b, a); }

    std::vector<Point> points_, other_;
    std::vector<std::size_t> ends_;
    bool sorted_ = true;
};

// The convex hull of convex polygons, from their lower and their upper chains apart.
class Joined {
  public:
    void clear() {
        lower_.clear();
        upper_.clear();
    }

    void add(const Polygon &p) {
        std::size_t first = 0, last = 0;
        for (std::size_t i = 1; i < p.size; ++i) {
            if (before(p[i], p[first])) first = i;
            if (before(p[last], p[i])) last = i;
        }
        lower_.add(p, first, last);
        upper_.add(p, last, first);
    }

    Polygon hull(Arena &arena) {
        const auto &lower = lower_.sorted(), &upper = upper_.sorted();
        const std::size_t most = lower.size() + upper.size();
        Point *out = arena.take(most);
        Point *middle = chain(lower.begin(), lower.end(), out) - 1;
        Point *end = chain(upper.begin(), upper.end(), middle) - 1;
        if (end == out) end = out + 1;  // all points are one
        const auto size = static_cast<std::size_t>(end - out);
        arena.give_back(most - size);
        return {out, size};
    }

  private:
    Runs<true> lower_;
    Runs<false> upper_;
};

// The part with a x + b y <= c (+ EPS).
inline Polygon cut(const Polygon &polygon, double a, double b, double c, Arena &arena) {
    c += EPS;
    double highest = -INF, lowest = INF;
    const std::size_t n = polygon.size;
    for (std::size_t i = 0; i < n; ++i) {
        const double side = a * polygon[i].x + b * polygon[i].y - c;
        highest = std::max(highest, side);
        lowest = std::min(lowest, side);
    }
    if (highest <= 0.0) return polygon;
    if (lowest > 0.0) return {};
    Point *out = arena.take(2 * n);
    std::size_t size = 0;
    const double first = a * polygon[0].x + b * polygon[0].y - c;
    double here = first;
    for (std::size_t i = 0; i < n; ++i) {
        const Point &p = polygon[i], &q = polygon[i + 1 < n ? i + 1 : 0];
        const double there = i + 1 < n ? a * q.x + b * q.y - c : first;
        if (here <= 0.0) out[size++] = p;
        if ((here < 0.0 && 0.0 < there) || (there < 0.0 && 0.0 < here)) {
            const double t = here / (here - there);
            out[size++] = {p.x + t * (q.x - p.x), p.y + t * (q.y - p.y)};
        }
        here = there;
    }
    arena.give_back(2 * n - size);
    if (n == 2 && size > 2) size = 2;
    return {out, size};
}

inline Polygon cut_x(Polygon polygon, double low, double high, Arena &arena) {
    if (!polygon.empty() && low > -INF) polygon = cut(polygon, -1.0, 0.0, -low, arena);
    if (!polygon.empty() && high < INF) polygon = cut(polygon, 1.0, 0.0, high, arena);
    return polygon;
}

// The same where the range of x is known: most cuts are then decided at a glance.
inline Polygon cut_x(Polygon polygon, const Range &x, double low, double high, Arena &arena) {
    if (-x.low - (-low + EPS) > 0.0) polygon = cut(polygon, -1.0, 0.0, -low, arena);
    if (!polygon.empty() && x.high - (high + EPS) > 0.0) polygon = cut(polygon, 1.0, 0.0, high, arena);
    return polygon;
}

inline Polygon cut_y(Polygon polygon, double low, double high, Arena &arena) {
    if (!polygon.empty() && low > -INF) polygon = cut(polygon, 0.0, -1.0, -low, arena);
    if (!polygon.empty() && high < INF) polygon = cut(polygon, 0.0, 1.0, high, arena);
    return polygon;
}

// Area added, and new corner, when edge q-r is replaced by extending p-q and t-r.
struct Extension {
    double gain;
    Point corner;
};

inline Extension extension(const Point &p, const Point &q, const Point &r, const Point &t) {
    const double ux = q.x - p.x, uy = q.y - p.y;
    const double wx = r.x - t.x, wy = r.y - t.y;
    const double cross = ux * wy - uy * wx;
    if (cross >= -1e-12) return {INF, q};
    const double lam = ((r.x - q.x) * wy - (r.y - q.y) * wx) / cross;
    if (lam < 0.0) return {INF, q};
    const double x = q.x + lam * ux, y = q.y + lam * uy;
    if (!(std::min(q.x, r.x) <= x && x <= std::max(q.x, r.x))) return {INF, q};
    if (!(std::min(q.y, r.y) <= y && y <= std::max(q.y, r.y))) return {INF, q};
    const double area = std::abs((r.x - q.x) * (y - q.y) - (r.y - q.y) * (x - q.x)) / 2;
    return {area, {x, y}};
}

// Scratch of `propagate`, reused from call to call.
struct Scratch {
    std::vector<Point> first, second, sort;
    std::vector<double> sides;
    std::vector<Extension> extensions;
};

inline void limit_corners(std::vector<Point> &ring, std::vector<Extension> &known) {
    if (ring.size() <= MAX_CORNERS) return;
    auto at = [&](std::size_t i) { return ring[i % ring.size()]; };
    auto measured = [&](std::size_t i) {
        const std::size_t n = ring.size();
        return extension(at(i + n - 1), at(i), at(i + 1), at(i + 2));
    };
    known.clear();
    for (std::size_t i = 0; i < ring.size(); ++i) known.push_back(measured(i));
    while (ring.size() > MAX_CORNERS) {
        double best = INF;
        std::size_t edge = ring.size();
        for (std::size_t i = 0; i < ring.size(); ++i) {
            if (known[i].gain < best) best = known[i].gain, edge = i;
        }
        if (edge == ring.size()) return;
        // The corner replaces both ends of the edge; the first comes first in the list.
        const Point corner = known[edge].corner;
        std::size_t place = edge;
        if (edge + 1 < ring.size()) {
            ring[edge] = corner;
            ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(edge) + 1);
            known.erase(known.begin() + static_cast<std::ptrdiff_t>(edge) + 1);
        } else {
            ring[0] = corner;
            ring.pop_back();
            known.pop_back();
            place = 0;
        }
        // Edges from two corners before to one after have changed.
        const std::size_t n = ring.size();
        for (std::size_t k = 0; k < 4; ++k) {
            const std::size_t i = (place + n - 2 + k) % n;
            known[i] = measured(i);
        }
    }
}

// The Minkowski sum with the segment from the origin to (x, y).
inline void swept(const std::vector<Point> &ring, double x, double y, std::vector<Point> &out,
                  Scratch &scratch) {
    const std::size_t n = ring.size();
    auto &sides = scratch.sides;
    sides.clear();
    std::size_t right = 0, left = 0;
    for (std::size_t i = 0; i < n; ++i) {
        sides.push_back(y * ring[i].x - x * ring[i].y);
        if (sides[i] > sides[right]) right = i;
        if (sides[i] < sides[left]) left = i;
    }
    out.clear();
    if (n < 3 || sides[right] - sides[left] <= 2 * PARALLEL) {
        scratch.sort.assign(ring.begin(), ring.end());
        for (const Point &p : ring) scratch.sort.push_back({p.x + x, p.y + y});
        out.resize(2 * scratch.sort.size());
        out.resize(hull(scratch.sort, out.data()));
        return;
    }
    auto first = [&](std::size_t at) {
        std::size_t i = at;
        while (std::abs(sides[i ? i - 1 : n - 1] - sides[at]) <= PARALLEL) i = i ? i - 1 : n - 1;
        return i;
    };
    auto last = [&](std::size_t at) {
        std::size_t i = at;
        while (std::abs(sides[i + 1 < n ? i + 1 : 0] - sides[at]) <= PARALLEL) i = i + 1 < n ? i + 1 : 0;
        return i;
    };
    auto run = [&](std::size_t from, std::size_t to, double dx, double dy, bool moved) {
        for (std::size_t i = from;; i = i + 1 < n ? i + 1 : 0) {
            out.push_back(moved ? Point{ring[i].x + dx, ring[i].y + dy} : ring[i]);
            if (i == to) break;
        }
    };
    run(last(left), first(right), 0.0, 0.0, false);
    run(last(right), first(left), x, y, true);
}

// Every (x, v) with v in `speeds` that a double integrator reaches after dt with inputs in [low, high].
inline Polygon propagate(const Polygon &polygon, double low, double high, double dt, const Range &speeds,
                         bool tight, Arena &arena, Scratch &scratch) {
    const double x0 = low * dt * dt / 2, v0 = low * dt;
    const double half = (high - low) * dt / 2;
    scratch.first.clear();
    for (std::size_t i = 0; i < polygon.size; ++i) {
        const Point &p = polygon[i];
        scratch.first.push_back({p.x + p.y * dt + x0, p.y + v0});
    }
    auto sweep = [&](double x, double v) {
        swept(scratch.first, x, v, scratch.second, scratch);
        scratch.first.swap(scratch.second);
    };
    if (tight) {
        sweep(half * dt / 2, half / 2);
        sweep(half * dt / 2, half);
        sweep(0.0, half / 2);
    } else {
        sweep(half * dt, half);
        sweep(0.0, half);
    }
    const Polygon whole{scratch.first.data(), scratch.first.size()};
    const Polygon kept = cut_y(whole, speeds.low, speeds.high, arena);
    if (kept.empty()) return kept;
    if (kept.points != whole.points) scratch.first.assign(kept.points, kept.points + kept.size);
    limit_corners(scratch.first, scratch.extensions);
    return arena.keep(scratch.first.data(), scratch.first.size());
}

}  // namespace sandra
