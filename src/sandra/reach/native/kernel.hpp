// The reachable set, step by step: the twin of reach/kernel.py, which says what is computed and why.
#pragma once

#include <bit>
#include <cstdint>
#include <utility>

#include "answers.hpp"

namespace sandra {

constexpr int COVER_TOLERANCE = 2;
constexpr int EXACT_BELOW = 40;

// Cells along s as bits, one row of words per row of cells; one such mask per step.
struct Field {
    Lattice lattice;
    std::size_t words;
    std::vector<std::vector<std::uint64_t>> forbidden;
};

struct Move {
    int target;
    std::vector<std::pair<int, bool>> literals;
    Range inputs;
};

struct Moves {
    int initial;
    std::vector<std::vector<Move>> moves, final;
    std::vector<std::vector<char>> live;
};

struct BaseSet {
    Polygon lon, lat;
    int label;
    Range inputs;
    std::size_t parents, parent_count;  // where they are in Sets::parents
};

// What is read: the automaton, and where its atoms may hold.
struct Task {
    const Moves *moves;
    std::vector<const Answer *> answers;
};

// Tasks that are alike until the last letter is read, which each reads for itself.
struct Problem {
    double dt;
    int horizon;
    std::vector<Point> lon, lat;
    Range a_lat, v_lon, v_lat;
    bool tight;
    const Field *field;
    std::vector<Task> tasks;
};

struct Sets {
    Sets() = default;
    Sets(const Sets &) = delete;
    Arena arena;
    std::vector<std::vector<BaseSet>> steps;  // those before the last
    std::vector<std::vector<BaseSet>> last;   // of each task, if the last step is reached
    std::vector<int> parents;
    std::vector<std::uint64_t> contested;  // of the step after all `steps`
};

class Kernel {
  public:
    Kernel(const Problem &problem, Sets &sets)
        : problem_(problem), field_(*problem.field), sets_(sets) {}

    void run() {
        const int horizon = problem_.horizon;
        const Task &task = problem_.tasks[0];
        start();
        for (int k = 0; k < horizon; ++k) {
            covered(k);
            step_.clear();
            for (const Candidate &candidate : candidates_) read(task, candidate, k);
            if (step_.empty()) {
                sets_.contested = contested_;
                return;
            }
            sets_.steps.push_back(step_);
            arena_.clear();
            lon_kept_ = lat_kept_ = {};
            propagated(k + 1);
        }
        covered(horizon);
        sets_.contested = contested_;
        for (const Task &each : problem_.tasks) {
            step_.clear();
            for (const Candidate &candidate : candidates_) read(each, candidate, horizon);
            sets_.last.push_back(step_);
        }
    }

  private:
    using Box = Lattice::Box;
    using Row = std::vector<std::pair<int, int>>;  // runs of cells

    struct Candidate {
        Polygon lon, lat;
        int label;
        Range came_with;
        std::size_t parents, parent_count;  // in parents_
        Box touched;
        Range s, d;
    };

    void start() {
        const Polygon lon{problem_.lon.data(), problem_.lon.size()};
        const Polygon lat{problem_.lat.data(), problem_.lat.size()};
        parents_.clear();
        parts_.clear();
        offer(cut_y(lon, problem_.v_lon.low, problem_.v_lon.high, arena_),
              cut_y(lat, problem_.v_lat.low, problem_.v_lat.high, arena_), problem_.tasks[0].moves->initial,
              {-INF, INF}, -1);
    }

    // What each base set of step k - 1 reaches at step k.
    void propagated(int k) {
        parts_.clear();
        parents_.clear();
        const auto &before = sets_.steps.back();
        const bool last = k == problem_.horizon;
        Polygon lat_of, lat_cut;
        for (std::size_t i = 0; i < before.size(); ++i) {
            const BaseSet &b = before[i];
            const Polygon lon = propagate(b.lon, b.inputs.low, b.inputs.high, problem_.dt, problem_.v_lon,
                                          problem_.tight, arena_, scratch_);
            if (lat_of.points != b.lat.points || lat_of.size != b.lat.size) {  // often shared
                lat_of = b.lat;
                lat_cut = propagate(b.lat, problem_.a_lat.low, problem_.a_lat.high, problem_.dt,
                                    problem_.v_lat, problem_.tight, arena_, scratch_);
            }
            offer(lon, lat_cut, b.label, last ? b.inputs : Range{-INF, INF}, static_cast<int>(i));
        }
    }

    void offer(Polygon lon, Polygon lat, int label, Range came_with, int parent) {
        if (lon.empty() || lat.empty()) return;
        const std::size_t at = parents_.size();
        if (parent >= 0) parents_.push_back(parent);
        const Range s = range_x(lon), d = range_x(lat);
        const Box touched = field_.lattice.touched(s.low, s.high, d.low, d.high);
        parts_.push_back({lon, lat, label, came_with, at, parents_.size() - at, touched, s, d});
    }

    // Unite parts of the same label, take the forbidden cells away, cover the rest by boxes.
    void covered(int k) {
        candidates_.clear();
        contested_.assign(field_.words * static_cast<std::size_t>(field_.lattice.rows), 0);
        std::vector<char> done(parts_.size(), 0);
        for (std::size_t first = 0; first < parts_.size(); ++first) {
            if (done[first]) continue;
            members_.clear();
            for (std::size_t i = first; i < parts_.size(); ++i) {
                const Candidate &a = parts_[i], &b = parts_[first];
                if (a.label == b.label && a.came_with.low == b.came_with.low &&
                    a.came_with.high == b.came_with.high) {
                    members_.push_back(&a);
                    done[i] = 1;
                }
            }
            cover_group(k);
        }
    }

    void cover_group(int k) {
        Box all{field_.lattice.columns, 0, field_.lattice.rows, 0};
        for (const Candidate *m : members_) {
            all.i0 = std::min(all.i0, m->touched.i0), all.i1 = std::max(all.i1, m->touched.i1);
            all.j0 = std::min(all.j0, m->touched.j0), all.j1 = std::max(all.j1, m->touched.j1);
        }
        if (all.i0 >= all.i1 || all.j0 >= all.j1) return;
        window_.assign(field_.words * static_cast<std::size_t>(all.j1 - all.j0), 0);
        for (const Candidate *m : members_) {
            for (int j = m->touched.j0; j < m->touched.j1; ++j) {
                set_bits(&window_[field_.words * static_cast<std::size_t>(j - all.j0)],
                         m->touched.i0, m->touched.i1);
            }
        }
        const auto &forbidden = field_.forbidden[static_cast<std::size_t>(k)];
        const std::size_t offset = field_.words * static_cast<std::size_t>(all.j0);
        for (std::size_t w = 0; w < window_.size(); ++w) {
            contested_[offset + w] |= window_[w];
            window_[w] &= ~forbidden[offset + w];
        }
        if (problem_.tight) {
            columns(all);
            tolerance_ = 0;
            boxes(all.i0, all.i1, false, [&](int i) { runs_ = columns_[static_cast<std::size_t>(i - all.i0)]; });
        } else {
            tolerance_ = std::min(COVER_TOLERANCE, (all.i1 - all.i0) / EXACT_BELOW);
            boxes(all.j0, all.j1, true, [&](int j) { runs(row(all, j)); });
        }
        for (const Box &box : boxes_) join(box);
    }

    static void set_bits(std::uint64_t *row, int low, int high) {
        for (int i = low; i < high;) {
            const int end = std::min(high, (i / 64 + 1) * 64);
            const std::uint64_t ones = end - i == 64 ? ~0ULL : ((1ULL << (end - i)) - 1);
            row[i / 64] |= ones << (i % 64);
            i = end;
        }
    }

    const std::uint64_t *row(const Box &all, int j) const {
        return &window_[field_.words * static_cast<std::size_t>(j - all.j0)];
    }

    // The runs of cells across the lane in each column of the window, into columns_.
    void columns(const Box &all) {
        const auto count = static_cast<std::size_t>(all.i1 - all.i0);
        if (columns_.size() < count) columns_.resize(count);
        for (std::size_t i = 0; i < count; ++i) columns_[i].clear();
        // Where a row differs from the one before, runs begin or end.
        for (int j = all.j0; j <= all.j1; ++j) {
            for (std::size_t w = 0; w < field_.words; ++w) {
                const std::uint64_t now = j < all.j1 ? row(all, j)[w] : 0;
                std::uint64_t change = now ^ (j > all.j0 ? row(all, j - 1)[w] : 0);
                for (; change; change &= change - 1) {
                    const int bit = std::countr_zero(change);
                    const int i = static_cast<int>(w) * 64 + bit;
                    Row &column = columns_[static_cast<std::size_t>(i - all.i0)];
                    if (now >> bit & 1) column.emplace_back(j, all.j1);
                    else column.back().second = j;
                }
            }
        }
    }

    // The window as boxes: neighbouring lines of cells with like runs become one.
    template <typename Read>
    void boxes(int first, int last, bool along_s, Read &&read) {
        boxes_.clear();
        std::size_t band = 0;  // lines in the band
        int start = 0;
        auto close = [&](int end) {
            if (!band) return;
            for (const auto &[low, high] : merged_) {
                if (low < high) boxes_.push_back(along_s ? Box{low, high, start, end} : Box{start, end, low, high});
            }
            band = 0;
        };
        for (int line = first; line < last; ++line) {
            read(line);
            if (!(band && like(first_) && like(last_))) {
                close(line);
                start = line;
                first_ = merged_ = runs_;
            } else {
                for (std::size_t r = 0; r < runs_.size(); ++r) {
                    merged_[r].first = std::min(merged_[r].first, runs_[r].first);
                    merged_[r].second = std::max(merged_[r].second, runs_[r].second);
                }
            }
            last_ = runs_;
            band = runs_.empty() ? 0 : band + 1;
        }
        close(last);
    }

    bool like(const Row &other) const {
        if (runs_.size() != other.size()) return false;
        for (std::size_t r = 0; r < runs_.size(); ++r) {
            if (std::abs(runs_[r].first - other[r].first) > tolerance_) return false;
            if (std::abs(runs_[r].second - other[r].second) > tolerance_) return false;
        }
        return true;
    }

    void runs(const std::uint64_t *row) {
        runs_.clear();
        int begin = -1;
        for (std::size_t w = 0; w < field_.words; ++w) {
            const int base = static_cast<int>(w) * 64;
            std::uint64_t bits = row[w];
            if (begin < 0 && bits == 0) continue;
            if (begin >= 0 && bits == ~0ULL) continue;
            int at = 0;
            while (at < 64) {
                const std::uint64_t rest = (begin < 0 ? bits : ~bits) >> at;
                if (rest == 0) break;
                at += std::countr_zero(rest);
                if (begin < 0) {
                    begin = base + at;
                } else {
                    runs_.emplace_back(begin, base + at);
                    begin = -1;
                }
            }
        }
        if (begin >= 0) runs_.emplace_back(begin, static_cast<int>(field_.words) * 64);
    }

    // The hull of all that lies in one box, and whose parents it has.
    void join(const Box &box) {
        const Lattice &l = field_.lattice;
        const Range s{l.s0 + box.i0 * l.ds, l.s0 + box.i1 * l.ds};
        const Range d{l.d0 + box.j0 * l.dd, l.d0 + box.j1 * l.dd};
        inside_.clear();
        const std::size_t at = parents_.size();
        for (const Candidate *m : members_) {
            const Box &t = m->touched;
            if (t.i0 >= box.i1 || t.i1 <= box.i0 || t.j0 >= box.j1 || t.j1 <= box.j0) continue;
            const Polygon lon = cut_x(m->lon, m->s, s.low, s.high, arena_);
            const Polygon lat = lon.empty() ? lon : cut_x(m->lat, m->d, d.low, d.high, arena_);
            if (lat.empty()) continue;
            inside_.emplace_back(lon, lat);
            for (std::size_t p = 0; p < m->parent_count; ++p) {
                const int parent = parents_[m->parents + p];
                parents_.push_back(parent);
            }
        }
        if (inside_.empty()) return;
        auto begin = parents_.begin() + static_cast<std::ptrdiff_t>(at);
        Polygon lon = inside_[0].first, lat = inside_[0].second;
        if (inside_.size() > 1) {
            std::sort(begin, parents_.end());
            parents_.erase(std::unique(begin, parents_.end()), parents_.end());
            lon = joined(&std::pair<Polygon, Polygon>::first);
            lat = joined(&std::pair<Polygon, Polygon>::second);
        }
        const Candidate &some = *members_[0];
        candidates_.push_back({lon, lat, some.label, some.came_with, at, parents_.size() - at, {}, {}, {}});
    }

    Polygon joined(Polygon std::pair<Polygon, Polygon>::*which) {
        joined_.clear();
        const Polygon *before = nullptr;
        for (const auto &both : inside_) {
            const Polygon &p = both.*which;
            if (before && before->points == p.points && before->size == p.size) continue;
            joined_.add(p);
            before = &p;
        }
        return joined_.hull(arena_);
    }

    // Read letter k: the parts in which a move of the automaton is possible.
    void read(const Task &task, const Candidate &candidate, int k) {
        const bool last = k == problem_.horizon;
        const Moves &m = *task.moves;
        const auto label = static_cast<std::size_t>(candidate.label);
        for (const Move &move : (last ? m.final : m.moves)[label]) {
            if (last) {
                const double low = std::max(move.inputs.low, candidate.came_with.low);
                if (low > std::min(move.inputs.high, candidate.came_with.high)) continue;
            } else if (!m.live[static_cast<std::size_t>(problem_.horizon - k)]
                              [static_cast<std::size_t>(move.target)]) {
                continue;
            }
            where(task, move, candidate, k);
            for (const auto &[lon, lat] : parts_now_) add(lon, lat, move, candidate);
        }
    }

    void add(const Polygon &lon, const Polygon &lat, const Move &move, const Candidate &candidate) {
        const std::size_t at = sets_.parents.size();
        for (std::size_t p = 0; p < candidate.parent_count; ++p) {
            sets_.parents.push_back(parents_[candidate.parents + p]);
        }
        step_.push_back({kept(lon, lon_kept_), kept(lat, lat_kept_), move.target, move.inputs, at,
                        candidate.parent_count});
    }

    struct Kept {
        Polygon source, copy;
    };

    // A copy that outlives the step; several base sets of one candidate share it.
    Polygon kept(const Polygon &p, Kept &last) {
        if (last.source.points != p.points || last.source.size != p.size) {
            last = {p, sets_.arena.keep(p.points, p.size)};
        }
        return last.copy;
    }

    // The parts of a candidate in which all literals of a move may hold, into parts_now_.
    void where(const Task &task, const Move &move, const Candidate &candidate, int k) {
        parts_now_.assign(1, {candidate.lon, candidate.lat});
        for (const auto &[atom, truth] : move.literals) {
            parts_all_.clear();
            for (const auto &[lon, lat] : parts_now_) {
                task.answers[static_cast<std::size_t>(atom)]->tell({truth, k, lon, lat}, region_);
                restricted(lon, lat);
                parts_all_.insert(parts_all_.end(), parts_here_.begin(), parts_here_.end());
            }
            parts_now_.swap(parts_all_);
        }
    }

    void restricted(const Polygon &lon, const Polygon &lat) {
        parts_here_.assign(1, {lon, lat});
        std::size_t begin = 0;
        for (const std::size_t end : region_.unions) {
            remaining_.clear();
            for (const auto &[lon_part, lat_part] : parts_here_) {
                for (std::size_t i = begin; i < end; ++i) {
                    const Piece &piece = region_.pieces[i];
                    const Polygon new_lat = cut_x(lat_part, piece.d_low, piece.d_high, arena_);
                    if (new_lat.empty()) continue;
                    Polygon new_lon = cut_x(lon_part, piece.s_low, piece.s_high, arena_);
                    for (std::size_t c = 0; c < piece.cuts.size && !new_lon.empty(); ++c) {
                        const Cut &cut_ = piece.cuts.begin[c];
                        new_lon = cut(new_lon, cut_.a, cut_.b, cut_.c, arena_);
                    }
                    if (!new_lon.empty()) remaining_.emplace_back(new_lon, new_lat);
                }
            }
            parts_here_.swap(remaining_);
            begin = end;
        }
    }

    const Problem &problem_;
    const Field &field_;
    Sets &sets_;
    Arena arena_;
    Scratch scratch_;
    Joined joined_;
    Kept lon_kept_, lat_kept_;
    Region region_;
    std::vector<Candidate> parts_, candidates_;
    std::vector<BaseSet> step_;
    std::vector<const Candidate *> members_;
    std::vector<int> parents_;
    std::vector<std::uint64_t> contested_, window_;
    std::vector<Box> boxes_;
    Row runs_, first_, last_, merged_;
    std::vector<Row> columns_;
    int tolerance_ = 0;
    using Parts = std::vector<std::pair<Polygon, Polygon>>;
    Parts inside_, parts_now_, parts_all_, parts_here_, remaining_;
};

}  // namespace sandra
