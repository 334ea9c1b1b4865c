// Which cells regions forbid, line by line: the twin of reach/windows.py.
#pragma once

#include "kernel.hpp"

namespace sandra {

// A line across the road, on which the corners of cells stand `spacing` apart.
struct Line {
    double start_x, start_y, along_x, along_y, spacing, reach;
};

// Cells `first` <= row < `last` of one column.
struct Run {
    int column, first, last;
};

class Forbidden {
  public:
    Forbidden(std::vector<Line> lines, int rows) : lines_(std::move(lines)), rows_(rows) {
        for (std::size_t begin = 0; begin < lines_.size(); begin += BLOCK) blocks_.push_back(block_of(begin));
    }

    // The columns in which a region forbids cells, ascending.
    std::vector<Run> runs(const Point *corners, std::size_t count, double radius) {
        std::vector<Run> found;
        const Disc disc = around(corners, count);
        Range before{INF, -INF};
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            const std::size_t begin = b * BLOCK, end = std::min(begin + BLOCK, lines_.size());
            if (!near(disc, radius, blocks_[b])) {
                before = {INF, -INF};
                continue;
            }
            for (std::size_t i = begin; i < end; ++i) {
                const Range here = interval(corners, count, radius, disc, lines_[i]);
                const double low = clipped(std::max(before.low, here.low));
                const double high = clipped(std::min(before.high, here.high));
                const int first = static_cast<int>(std::ceil(low)), last = static_cast<int>(std::floor(high));
                if (first < last) found.push_back({static_cast<int>(i) - 1, first, last});
                before = here;
            }
        }
        return found;
    }

  private:
    static constexpr std::size_t BLOCK = 16;

    struct Disc {
        double x, y, radius;
    };

    // Neighbouring lines: how far they reach to both sides of one of them.
    struct Block {
        Line middle;
        Range off;
        double reach;
    };

    static double off(double x, double y, const Line &line) {
        return (y - line.start_y) * line.along_x - (x - line.start_x) * line.along_y;
    }

    Block block_of(std::size_t begin) const {
        const std::size_t end = std::min(begin + BLOCK, lines_.size());
        Block block{lines_[(begin + end) / 2], {INF, -INF}, -INF};
        for (std::size_t i = begin; i < end; ++i) {
            const Line &line = lines_[i];
            for (const double way : {0.0, line.spacing * rows_}) {
                const double at = off(line.start_x + way * line.along_x, line.start_y + way * line.along_y, block.middle);
                block.off = {std::min(block.off.low, at), std::max(block.off.high, at)};
            }
            block.reach = std::max(block.reach, line.reach);
        }
        return block;
    }

    static bool near(const Disc &disc, double radius, const Block &block) {
        const double at = off(disc.x, disc.y, block.middle);
        const double most = disc.radius + std::max(radius + block.reach, 0.0) + 1e-6;
        return at >= block.off.low - most && at <= block.off.high + most;
    }

    static Disc around(const Point *corners, std::size_t count) {
        Range x{INF, -INF}, y{INF, -INF};
        for (std::size_t i = 0; i < count; ++i) {
            x = {std::min(x.low, corners[i].x), std::max(x.high, corners[i].x)};
            y = {std::min(y.low, corners[i].y), std::max(y.high, corners[i].y)};
        }
        const double dx = x.high - x.low, dy = y.high - y.low;
        return {(x.low + x.high) / 2, (y.low + y.high) / 2, std::sqrt(dx * dx + dy * dy) / 2};
    }

    double clipped(double at) const { return std::min(std::max(at, 0.0), static_cast<double>(rows_)); }

    // Where a line is within reach of a convex region, as numbers of corners; low > high: nowhere.
    Range interval(const Point *corners, std::size_t count, double radius, const Disc &disc, const Line &line) {
        const double reach = radius + line.reach;
        const double middle_x = disc.x - line.start_x, middle_y = disc.y - line.start_y;
        const double off = middle_y * line.along_x - middle_x * line.along_y;
        const double at = middle_x * line.along_x + middle_y * line.along_y;
        const double most = disc.radius + std::max(reach, 0.0) + 1e-6;
        Range found{INF, -INF};
        if (reach < 0.0 || std::abs(off) > most || at < -most || at > line.spacing * rows_ + most) return found;
        xs_.clear();
        ys_.clear();
        for (std::size_t i = 0; i < count; ++i) {
            const double away_x = corners[i].x - line.start_x, away_y = corners[i].y - line.start_y;
            const double x = away_x * line.along_x + away_y * line.along_y;
            const double y = away_y * line.along_x - away_x * line.along_y;
            xs_.push_back(x);
            ys_.push_back(y);
            const double squared = reach * reach - y * y;
            if (squared >= 0.0) {
                const double half = std::sqrt(squared);
                found = {std::min(found.low, x - half), std::max(found.high, x + half)};
            }
        }
        double area = 0.0;
        for (std::size_t i = 0; i < count; ++i) {
            const std::size_t j = i + 1 < count ? i + 1 : 0;
            area += xs_[i] * (ys_[j] - ys_[i]) - ys_[i] * (xs_[j] - xs_[i]);
        }
        for (std::size_t i = 0; i < count; ++i) {
            const std::size_t j = i + 1 < count ? i + 1 : 0;
            const double edge_x = xs_[j] - xs_[i], edge_y = ys_[j] - ys_[i];
            const double length = std::sqrt(edge_x * edge_x + edge_y * edge_y);
            const double outwards = (area < 0.0 ? -reach : reach) / std::max(length, 1e-9);
            const double share = (edge_x * outwards - ys_[i]) / edge_y;
            if (share >= 0.0 && share <= 1.0) {
                const double where = xs_[i] + edge_y * outwards + share * edge_x;
                found = {std::min(found.low, where), std::max(found.high, where)};
            }
        }
        return {found.low / line.spacing, found.high / line.spacing};
    }

    std::vector<Line> lines_;
    std::vector<Block> blocks_;
    int rows_;
    std::vector<double> xs_, ys_;
};

}  // namespace sandra
