// Python's view of the native kernel; nothing is decided here.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <stdexcept>

#include "kernel.hpp"
#include "windows.hpp"

namespace nb = nanobind;
using namespace sandra;

namespace {

using Pair = std::pair<double, double>;
using Points = std::vector<Pair>;
using PieceIn = std::pair<std::tuple<double, double, double, double>,
                          std::vector<std::tuple<double, double, double>>>;
using RegionIn = std::vector<std::vector<PieceIn>>;
using BandIn = std::vector<std::tuple<double, double, double, double, double, double>>;
using LatticeIn = std::tuple<double, double, double, double, int, int>;
using LeaderIn = std::pair<double, std::vector<std::tuple<double, double, double>>>;
using MoveIn = std::tuple<int, std::vector<std::pair<int, bool>>, Pair>;

void fill(const RegionIn &in, OwnRegion &out) {
    out.region.clear();
    out.cuts.clear();
    for (const auto &several : in) {
        for (const auto &[box, cuts] : several) {
            const auto &[s_low, s_high, d_low, d_high] = box;
            auto mine = std::make_unique<Cut[]>(cuts.size());
            for (std::size_t i = 0; i < cuts.size(); ++i) {
                mine[i] = {std::get<0>(cuts[i]), std::get<1>(cuts[i]), std::get<2>(cuts[i])};
            }
            out.region.pieces.push_back({s_low, s_high, d_low, d_high, {mine.get(), cuts.size()}});
            out.cuts.push_back(std::move(mine));
        }
        out.region.close();
    }
}

OwnRegion own(const RegionIn &in) {
    OwnRegion out;
    fill(in, out);
    return out;
}

std::vector<Band> bands_of(const std::vector<BandIn> &in) {
    std::vector<Band> out;
    for (const auto &band : in) {
        out.emplace_back();
        for (const auto &[a, b, c, d, e, f] : band) out.back().push_back({a, b, c, d, e, f});
    }
    return out;
}

Lattice lattice_of(const LatticeIn &in) {
    const auto &[s0, d0, ds, dd, columns, rows] = in;
    if (columns < 1 || rows < 1) throw std::invalid_argument("a lattice has cells");
    return {s0, d0, ds, dd, columns, rows};
}

std::vector<Point> points_of(const Points &in) {
    std::vector<Point> out;
    for (const auto &[x, y] : in) out.push_back({x, y});
    return out;
}

nb::list list_of(const Polygon &polygon) {
    nb::list out;
    for (std::size_t i = 0; i < polygon.size; ++i) out.append(nb::make_tuple(polygon[i].x, polygon[i].y));
    return out;
}

// An answer that a user gives in Python.
class Custom : public Answer {
  public:
    explicit Custom(nb::callable function) : function_(std::move(function)) {}
    void tell(const Asked &asked, Region &region) const override {
        const nb::object found = function_(asked.truth, asked.k, list_of(asked.lon), list_of(asked.lat));
        fill(nb::cast<RegionIn>(found), last_);
        region = last_.region;
    }
    bool calls_python() const override { return true; }

  private:
    nb::callable function_;
    mutable OwnRegion last_;  // read until the next question, which only the lock's holder asks
};

using Packed = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, -1>, nb::c_contig, nb::device::cpu>;

// `packed`: (steps, rows, bytes), bit i of a row is column i.
Field field_of(const LatticeIn &lattice, const Packed &packed) {
    Field field{lattice_of(lattice), 0, {}};
    const std::size_t rows = packed.shape(1), bytes = packed.shape(2);
    if (rows != static_cast<std::size_t>(field.lattice.rows) ||
        bytes != (static_cast<std::size_t>(field.lattice.columns) + 7) / 8) {
        throw std::invalid_argument("the mask does not fit the lattice");
    }
    field.words = (bytes + 7) / 8;
    for (std::size_t k = 0; k < packed.shape(0); ++k) {
        auto &words = field.forbidden.emplace_back(rows * field.words, 0);
        const std::uint8_t *in = packed.data() + k * rows * bytes;
        for (std::size_t j = 0; j < rows; ++j) {
            for (std::size_t b = 0; b < bytes; ++b) {
                words[j * field.words + b / 8] |= static_cast<std::uint64_t>(in[j * bytes + b]) << (8 * (b % 8));
            }
        }
    }
    return field;
}

using Floats = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const double, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Ends = nb::ndarray<const std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

// Of each region.
struct RunsOf {
    std::vector<std::vector<Run>> regions;
};

// `lines`: (n, 6) as `Line`; `corners`: (N, 2) of all regions, those of region i before `ends[i]`.
RunsOf runs_of(const Rows &lines, int rows, const Rows &corners, const Ends &ends, const Floats &radii) {
    if (lines.shape(1) != 6 || corners.shape(1) != 2 || ends.shape(0) != radii.shape(0) || rows < 1) {
        throw std::invalid_argument("lines have six numbers, corners two, and each region a radius");
    }
    std::vector<Line> mine;
    for (std::size_t i = 0; i < lines.shape(0); ++i) {
        const double *x = lines.data() + 6 * i;
        mine.push_back({x[0], x[1], x[2], x[3], x[4], x[5]});
    }
    Forbidden forbidden(std::move(mine), rows);
    std::vector<Point> polygon;
    RunsOf out;
    std::int64_t begin = 0;
    for (std::size_t r = 0; r < ends.shape(0); ++r) {
        const std::int64_t end = ends.data()[r];
        if (end <= begin || end > static_cast<std::int64_t>(corners.shape(0))) {
            throw std::invalid_argument("each region has corners");
        }
        polygon.clear();
        for (std::int64_t i = begin; i < end; ++i) polygon.push_back({corners.data()[2 * i], corners.data()[2 * i + 1]});
        out.regions.push_back(forbidden.runs(polygon.data(), polygon.size(), radii.data()[r]));
        begin = end;
    }
    return out;
}

// The masks off the road and of the regions named for each step, as bits.
Field united(const LatticeIn &lattice, const Packed &off_road, const RunsOf &runs, const std::vector<std::vector<int>> &steps) {
    const Field road = field_of(lattice, off_road);
    if (road.forbidden.size() != 1) throw std::invalid_argument("the road has one mask");
    Field field{road.lattice, road.words, {}};
    for (const auto &regions : steps) {
        auto &mask = field.forbidden.emplace_back(road.forbidden[0]);
        for (const int region : regions) {
            for (const Run &run : runs.regions.at(static_cast<std::size_t>(region))) {
                if (run.column >= field.lattice.columns || run.last > field.lattice.rows) {
                    throw std::invalid_argument("the regions do not fit the lattice");
                }
                const auto word = static_cast<std::size_t>(run.column) / 64;
                const std::uint64_t bit = 1ULL << (run.column % 64);
                for (int j = run.first; j < run.last; ++j) mask[static_cast<std::size_t>(j) * field.words + word] |= bit;
            }
        }
    }
    return field;
}

nb::bytes mask_of(const Field &field, std::size_t k) {
    const auto &words = field.forbidden.at(k);
    return nb::bytes(reinterpret_cast<const char *>(words.data()), words.size() * 8);
}

// (column, first, last) of each run of a region.
nb::list runs(const RunsOf &all, std::size_t region) {
    nb::list out;
    for (const Run &run : all.regions.at(region)) out.append(nb::make_tuple(run.column, run.first, run.last));
    return out;
}

std::vector<std::vector<Move>> moves_of(const std::vector<std::vector<MoveIn>> &in) {
    std::vector<std::vector<Move>> out;
    for (const auto &row : in) {
        out.emplace_back();
        for (const auto &[target, literals, inputs] : row) {
            out.back().push_back({target, literals, {inputs.first, inputs.second}});
        }
    }
    return out;
}

// Everything that is used as an index is in range before anything is computed.
void check(const Problem &problem) {
    const auto steps = static_cast<std::size_t>(std::max(problem.horizon, 0)) + 1;
    bool ok = problem.horizon >= 0 && problem.field->forbidden.size() >= steps && !problem.tasks.empty() &&
              !problem.lon.empty() && !problem.lat.empty();
    for (const Task &task : problem.tasks) {
        const Moves &m = *task.moves;
        const auto classes = static_cast<int>(m.moves.size());
        ok = ok && classes == static_cast<int>(problem.tasks[0].moves->moves.size()) &&
             m.final.size() == m.moves.size() && m.initial >= 0 && m.initial < classes && m.live.size() >= steps;
        for (const auto *table : {&m.moves, &m.final}) {
            for (const auto &row : *table) {
                for (const Move &move : row) {
                    ok = ok && (table == &m.final || (move.target >= 0 && move.target < classes));
                    for (const auto &literal : move.literals) {
                        ok = ok && literal.first >= 0 && literal.first < static_cast<int>(task.answers.size());
                    }
                }
            }
        }
        for (const auto &row : m.live) ok = ok && static_cast<int>(row.size()) == classes;
        for (const Answer *answer : task.answers) ok = ok && answer->steps() >= steps;
    }
    if (!ok) throw std::invalid_argument("the parts of the problem do not fit together");
}

using TaskIn = std::pair<const Moves *, std::vector<const Answer *>>;

std::unique_ptr<Sets> reachable_sets(double dt, int horizon, const Points &lon, const Points &lat,
                                     Pair a_lat, Pair v_lon, Pair v_lat, bool tight, const Field &field,
                                     const std::vector<TaskIn> &tasks) {
    Problem problem{dt,
                    horizon,
                    points_of(lon),
                    points_of(lat),
                    {a_lat.first, a_lat.second},
                    {v_lon.first, v_lon.second},
                    {v_lat.first, v_lat.second},
                    tight,
                    &field,
                    {}};
    bool python = false;
    for (const auto &[moves, answers] : tasks) {
        problem.tasks.push_back({moves, answers});
        for (const Answer *answer : answers) python = python || answer->calls_python();
    }
    check(problem);
    auto sets = std::make_unique<Sets>();
    if (python) {
        Kernel(problem, *sets).run();
    } else {
        nb::gil_scoped_release others_go_on;
        Kernel(problem, *sets).run();
    }
    return sets;
}

// The base sets of step k of one task; none from where it is empty.
const std::vector<BaseSet> &step_of(const Sets &sets, std::size_t which, std::size_t k) {
    return k < sets.steps.size() ? sets.steps[k] : sets.last.at(which);
}

// (lon, lat, label, inputs, parents) of each base set of a step.
nb::list step(const Sets &sets, std::size_t which, std::size_t k) {
    nb::list out;
    for (const BaseSet &b : step_of(sets, which, k)) {
        nb::list parents;
        for (std::size_t p = 0; p < b.parent_count; ++p) parents.append(sets.parents[b.parents + p]);
        out.append(nb::make_tuple(list_of(b.lon), list_of(b.lat), b.label,
                                  nb::make_tuple(b.inputs.low, b.inputs.high), nb::tuple(parents)));
    }
    return out;
}

bool whole(const Sets &sets, std::size_t which) { return !sets.last.empty() && !sets.last.at(which).empty(); }

// How many base sets each step has, until it has none.
nb::list sizes(const Sets &sets, std::size_t which) {
    nb::list out;
    for (const auto &step : sets.steps) out.append(step.size());
    if (whole(sets, which)) out.append(sets.last[which].size());
    return out;
}

nb::object contested(const Sets &sets, std::size_t which) {
    if (whole(sets, which)) return nb::none();
    return nb::bytes(reinterpret_cast<const char *>(sets.contested.data()), sets.contested.size() * 8);
}

}  // namespace

NB_MODULE(_native, m) {
    nb::set_leak_warnings(false);  // moves are kept in a cache until the end
    m.attr("SOURCES") = SANDRA_SOURCES;
    m.doc() = "The native twin of sandra.reach.kernel.";
    nb::class_<Field>(m, "Field").def("__init__", [](Field *self, const LatticeIn &lattice, const Packed &packed) {
        new (self) Field(field_of(lattice, packed));
    }).def("mask", &mask_of);
    nb::class_<RunsOf>(m, "Runs").def("of", &runs);
    m.def("runs", &runs_of);
    m.def("united", &united);
    nb::class_<Moves>(m, "Moves").def(
        "__init__", [](Moves *self, int initial, const std::vector<std::vector<MoveIn>> &moves,
                       const std::vector<std::vector<MoveIn>> &final, const std::vector<std::vector<int>> &live) {
            new (self) Moves{initial, moves_of(moves), moves_of(final), {}};
            for (const auto &known : live) {
                auto &row = self->live.emplace_back(self->moves.size(), 0);
                for (const int label : known) row.at(static_cast<std::size_t>(label)) = 1;
            }
        });
    nb::class_<Answer>(m, "Answer");
    nb::class_<Fixed, Answer>(m, "Fixed").def("__init__", [](Fixed *self, const RegionIn &holds, const RegionIn &fails) {
        new (self) Fixed(own(holds), own(fails));
    });
    nb::class_<Touching, Answer>(m, "Touching")
        .def("__init__", [](Touching *self, const std::vector<BandIn> &bands, std::tuple<double, double, double, double> body,
                            const std::vector<double> &bend, const LatticeIn &lattice, const RegionIn &fails) {
            const auto &[length, width, grip, heading] = body;
            new (self) Touching(bands_of(bands), {length, width, grip, heading, bend, lattice_of(lattice)}, own(fails));
        });
    nb::class_<SafeDistance, Answer>(m, "SafeDistance")
        .def("__init__", [](SafeDistance *self, const std::vector<BandIn> &bands,
                            const std::vector<std::vector<std::vector<LeaderIn>>> &tables, double inner) {
            std::vector<Table> mine;
            for (const auto &lane : tables) {
                mine.emplace_back();
                for (const auto &leaders : lane) {
                    mine.back().emplace_back();
                    for (const auto &[end, cuts] : leaders) {
                        Leader &leader = mine.back().back().emplace_back(Leader{end, {}});
                        for (const auto &[a, b, c] : cuts) leader.cuts.push_back({a, b, c});
                    }
                }
            }
            if (mine.size() != bands.size()) throw std::invalid_argument("one table for each lane");
            new (self) SafeDistance(bands_of(bands), std::move(mine), inner);
        });
    nb::class_<Custom, Answer>(m, "Custom").def(nb::init<nb::callable>());
    nb::class_<Sets>(m, "Sets")
        .def("sizes", &sizes)
        .def("contested", &contested)
        .def("step", &step);
    m.def("reachable_sets", &reachable_sets);
}
