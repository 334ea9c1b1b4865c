// Where an atom may hold: the twin of reach/answers.py.
#pragma once

#include <memory>
#include <numbers>
#include <vector>

#include "polygon.hpp"

namespace sandra {

struct Cut {
    double a, b, c;
};

struct Cuts {
    const Cut *begin = nullptr;
    std::size_t size = 0;
};

struct Piece {
    double s_low, s_high, d_low, d_high;
    Cuts cuts;
};

// An intersection of unions of pieces; `unions[i]` is where union i ends in `pieces`.
struct Region {
    std::vector<Piece> pieces;
    std::vector<std::size_t> unions;

    void clear() {
        pieces.clear();
        unions.clear();
    }
    void close() { unions.push_back(pieces.size()); }
};

struct Lattice {
    double s0, d0, ds, dd;
    int columns, rows;

    struct Box {
        int i0, i1, j0, j1;
    };

    // Every cell that the rectangle touches (rounded outwards), within the lattice.
    Box touched(double s_low, double s_high, double d_low, double d_high) const {
        auto within = [](double x, double most) {
            return static_cast<int>(std::min(std::max(x, -1.0), most + 1.0));
        };
        const int i0 = within(std::floor((s_low - s0) / ds - 1e-6), columns);
        const int i1 = within(std::floor((s_high - s0) / ds + 1e-6) + 1, columns);
        const int j0 = within(std::floor((d_low - d0) / dd - 1e-6), rows);
        const int j1 = within(std::floor((d_high - d0) / dd + 1e-6) + 1, rows);
        return {std::max(i0, 0), std::clamp(i1, 0, columns), std::max(j0, 0), std::clamp(j1, 0, rows)};
    }
};

// What an answer is asked about: a base set at a step.
struct Asked {
    bool truth;
    int k;
    Polygon lon, lat;
};

class Answer {
  public:
    Answer() = default;
    Answer(const Answer &) = delete;
    virtual ~Answer() = default;
    // Fills `region` with where the atom may have the truth asked for.
    virtual void tell(const Asked &asked, Region &region) const = 0;
    virtual bool calls_python() const { return false; }
    // How many steps it knows of.
    virtual std::size_t steps() const { return std::numeric_limits<std::size_t>::max(); }
};

// A region that owns its half-planes.
struct OwnRegion {
    OwnRegion() = default;
    OwnRegion(OwnRegion &&) = default;
    Region region;
    std::vector<std::unique_ptr<Cut[]>> cuts;
};

class Fixed : public Answer {
  public:
    Fixed(OwnRegion holds, OwnRegion fails) : holds_(std::move(holds)), fails_(std::move(fails)) {}
    void tell(const Asked &asked, Region &region) const override {
        region = asked.truth ? holds_.region : fails_.region;
    }

  private:
    OwnRegion holds_, fails_;
};

struct Stretch {
    double s_low, s_high, right_low, right_high, left_low, left_high;
};
using Band = std::vector<Stretch>;

struct Body {
    double length, width, grip, heading;
    std::vector<double> bend;
    Lattice lattice;

    double half_extent(const Asked &x) const {
        const Range s = range_x(x.lon), d = range_x(x.lat);
        const auto box = lattice.touched(s.low, s.high, 0.0, 0.0);
        double kappa = 0.0;
        const int last = std::min(std::max(box.i1, box.i0 + 1), static_cast<int>(bend.size()));
        for (int i = box.i0; i < last; ++i) kappa = std::max(kappa, bend[i]);
        double angle;
        if (x.k == 0) {
            angle = std::abs(heading);
        } else {
            const double widest = std::max(std::abs(d.low), std::abs(d.high));
            const double stretch = std::max(0.1, 1.0 - kappa * widest);
            const double forward = std::max(range_y(x.lon).low, 0.0) * stretch;
            const Range w = range_y(x.lat);
            angle = std::atan2(std::max(std::abs(w.low), std::abs(w.high)), forward);
            const double square = forward * forward;
            angle += square > grip ? std::asin(grip / square) : std::numbers::pi / 2;
        }
        const double a = length / 2, b = width / 2;
        angle = std::min(angle, std::atan2(a, b));
        return a * std::sin(angle) + b * std::cos(angle) + a * a * kappa / 2;
    }
};

class Touching : public Answer {
  public:
    static constexpr double PIECE_MERGE = 0.2;

    Touching(std::vector<Band> bands, Body body, OwnRegion fails)
        : bands_(std::move(bands)), body_(std::move(body)), fails_(std::move(fails)) {}

    void tell(const Asked &asked, Region &region) const override {
        if (!asked.truth) {
            region = fails_.region;
            return;
        }
        region.clear();
        const double side = body_.half_extent(asked);
        for (const Band &band : bands_) touching(band, side, asked, region);
        region.close();
    }

  private:
    static void touching(const Band &band, double side, const Asked &x, Region &region) {
        const Range s = range_x(x.lon), d = range_x(x.lat);
        bool open = false;
        Range lows{}, highs{};
        for (const Stretch &here : band) {
            if (here.s_high < s.low || here.s_low > s.high) continue;
            const double low = std::max(here.right_low - side, d.low);
            const double high = std::min(here.left_high + side, d.high);
            if (low > high) continue;
            if (open && region.pieces.back().s_high == here.s_low) {
                const Range l{std::min(lows.low, low), std::max(lows.high, low)};
                const Range h{std::min(highs.low, high), std::max(highs.high, high)};
                if (l.high - l.low <= PIECE_MERGE && h.high - h.low <= PIECE_MERGE) {
                    lows = l, highs = h;
                    Piece &piece = region.pieces.back();
                    piece.s_high = here.s_high, piece.d_low = l.low, piece.d_high = h.high;
                    continue;
                }
            }
            open = true;
            lows = {low, low}, highs = {high, high};
            region.pieces.push_back({here.s_low, here.s_high, low, high, {}});
        }
    }

    std::vector<Band> bands_;
    Body body_;
    OwnRegion fails_;
};

struct Leader {
    double end;
    std::vector<Cut> cuts;
};
using Table = std::vector<std::vector<Leader>>;

class SafeDistance : public Answer {
  public:
    SafeDistance(std::vector<Band> bands, std::vector<Table> tables, double inner)
        : bands_(std::move(bands)), tables_(std::move(tables)), inner_(inner) {}

    void tell(const Asked &x, Region &region) const override {
        region.clear();
        if (!x.truth) return;
        const Range s = range_x(x.lon), d = range_x(x.lat);
        for (std::size_t i = 0; i < bands_.size(); ++i) {
            const auto &step = tables_[i][static_cast<std::size_t>(x.k)];
            if (step.empty() || s.low > step.back().end) continue;
            const Range sure = sure_band(bands_[i], s);
            if (sure.low >= sure.high || d.high < sure.low || d.low > sure.high) continue;
            region.pieces.push_back({-INF, INF, -INF, sure.low, {}});
            region.pieces.push_back({-INF, INF, sure.high, INF, {}});
            double start = -INF;
            for (const Leader &leader : step) {
                if (leader.end >= s.low && start <= s.high) {
                    region.pieces.push_back({start, leader.end, sure.low, sure.high,
                                             {leader.cuts.data(), leader.cuts.size()}});
                }
                start = leader.end;
            }
            region.pieces.push_back({start, INF, sure.low, sure.high, {}});
            region.close();
        }
    }

    std::size_t steps() const override {
        std::size_t least = std::numeric_limits<std::size_t>::max();
        for (const Table &table : tables_) least = std::min(least, table.size());
        return least;
    }

  private:
    // Where the inscribed disc touches a lane for sure; low == high where it need not.
    Range sure_band(const Band &band, const Range &s) const {
        const Stretch *before = nullptr;
        double right = -INF, left = INF;
        for (const Stretch &x : band) {
            if (!(x.s_low <= s.high && x.s_high >= s.low)) continue;
            if (before ? x.s_low > before->s_high : x.s_low > s.low + 1e-6) return {0.0, 0.0};
            right = std::max(right, x.right_high), left = std::min(left, x.left_low);
            before = &x;
        }
        if (!before || before->s_high < s.high - 1e-6) return {0.0, 0.0};
        return {right - inner_, left + inner_};
    }

    std::vector<Band> bands_;
    std::vector<Table> tables_;
    double inner_;
};

}  // namespace sandra
