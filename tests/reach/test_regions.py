"""Regions: a state of which a predicate is true (or false) by its definition is admitted."""

from dataclasses import replace

import numpy as np
import pytest

from reach_particles import World
from reach_scenes import Course, prediction
from sandra.errors import FormulaError
from sandra.logic import Atom, Predicate, parse
from sandra.logic.formula import Not
from sandra.reach import Ground, ground
from sandra.reach.answers import PIECE_MERGE, Body, not_touching, sure_band, touching
from sandra.reach.bands import Leader, Stretch
from sandra.reach.lattice import Lattice
from sandra.reach.polygon import Polygon
from sandra.reach.problem import Answer, Region
from sandra.reach.regions import answers_of, body_of, inner_reach
from sandra.scene.frame import Frame
from sandra.scene.types import Lane, State
from sandra.settings import Settings

TOLERANCE = 1e-9


def bent(kappa: float, step: float) -> Ground:
    course = Course(kappa, step)
    places = {2: (18.0, 0.2, 4.0), 3: (12.0, 3.0, 9.0), 4: (30.0, 0.4, 0.0), 5: (22.0, -3.5, 6.0)}
    cars = [course.car(i, s, d, v) for i, (s, d, v) in places.items()]
    own = [
        replace(x, speed_limits=(20.0,)) if x.relation == "left" else x
        for x in course.lanes(limit=13.0)
    ]
    lanes = (*own, course.lane("opposite", 120, 8.75, 5.25, limit=13.0))
    scene = course.scene(lanes, cars, angle=0.05)
    return ground(scene, prediction(scene, 20), Settings(horizon=20))


def admits(region: Region, state: np.ndarray) -> bool:
    s, v, d, _ = state
    return all(
        any(
            piece.box[0] - TOLERANCE <= s <= piece.box[1] + TOLERANCE
            and piece.box[2] - TOLERANCE <= d <= piece.box[3] + TOLERANCE
            and all(a * s + b * v <= c + TOLERANCE for a, b, c in piece.cuts)
            for piece in union
        )
        for union in region
    )


def states_of(base: Ground, n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [
            base.lon[0][0] + rng.uniform(-0.5, 30.0, n),
            rng.choice([0.0, 30.0, 0.5], n, p=[0.05, 0.05, 0.9])
            + rng.uniform(0.0, 14.0, n) * (rng.random(n) < 0.9),
            rng.uniform(-5.0, 7.5, n),
            rng.normal(0.0, 2.0, n),
        ]
    )


ATOMS = [
    "in_lane(current)",
    "in_lane(left)",
    "in_lane(right)",
    "in_lane(opposite)",
    "in_lanelet(101)",
    "keeps_safe_distance(preceding)",
    "keeps_lane_speed_limit",
    "v <= 7.5",
    "v < 7.5",
    "s <= 52",
    "d < -0.5",
]


def atom_of(text: str) -> Atom:
    found = parse(text)
    assert isinstance(found, Atom)
    return found


@pytest.mark.parametrize("text", ATOMS)
@pytest.mark.parametrize(("kappa", "step"), [(0.0, 10.0), (1 / 30, 2.0), (-1 / 20, 4.0)])
def test_true_and_false_states_are_admitted(text: str, kappa: float, step: float) -> None:
    base = bent(kappa, step)
    world = World(base)
    atom = atom_of(text)
    (answer,) = answers_of(base, (atom,))
    rng = np.random.default_rng(4)
    states = states_of(base, 1200, 3)
    states = states[states[:, 1] <= 30.0]
    for k in (1, 7):
        xy = world.positions(states)
        truth = world.truth(atom, states, xy, world.headings(states, k, rng), k)
        for state, holds in zip(states, truth, strict=True):
            lon, lat = [(state[0], state[1])], [(state[2], state[3])]
            assert admits(answer(bool(holds), k, lon, lat), state), (state, holds)
            # and as a part of a larger set
            wide_lon = [(state[0] - 1.0, state[1]), (state[0] + 1.0, state[1] + 1.0)]
            wide_lat = [(state[2] - 0.5, state[3] - 0.3), (state[2] + 0.5, state[3] + 0.2)]
            assert admits(answer(bool(holds), k, wide_lon, wide_lat), state), (state, holds)


@pytest.mark.parametrize("text", ATOMS)
def test_regions_tell_states_apart(text: str) -> None:
    """Most states for which an atom is false are outside the region in which it may be true."""
    base = bent(0.0, 10.0)
    world = World(base)
    atom = atom_of(text)
    (answer,) = answers_of(base, (atom,))
    rng = np.random.default_rng(4)
    states = states_of(base, 1500, 9)
    states[:, 1] = np.clip(states[:, 1], 4.0, 30.0)
    states[:, 3] *= 0.1
    truth = world.truth(atom, states, world.positions(states), world.headings(states, 7, rng), 7)
    kept = [admits(answer(True, 7, [tuple(x[:2])], [tuple(x[2:])]), x) for x in states]
    wrong = np.mean(np.array(kept)[~truth]) if (~truth).any() else 0.0
    # the loosest limit of all lanes counts, so limits tell least
    assert wrong < (0.6 if text == "keeps_lane_speed_limit" else 0.35), wrong
    if text.startswith("in_lane("):
        out = [admits(answer(False, 7, [tuple(x[:2])], [tuple(x[2:])]), x) for x in states]
        assert np.mean(np.array(out)[truth]) < 0.5


def test_a_leader_counts_as_soon_as_the_disc_touches_its_lane() -> None:
    """0.9 m: the inscribed disc's radius. The left lane begins at d = 1.75 m."""
    course = Course()
    scene = course.scene(obstacles=[course.car(2, 8.0, 3.5)])
    base = ground(scene, prediction(scene, 5), Settings(horizon=5))
    (answer,) = answers_of(base, (Predicate("keeps_safe_distance", "preceding"),))
    s, v = base.lon[0]
    for d, free in ((0.7, True), (0.95, False), (1.5, False), (3.5, False), (6.0, False)):
        region = answer(True, 2, [(s, v)], [(d, 0.0)])
        assert admits(region, np.array([s, v, d, 0.0])) == free, d


@pytest.mark.parametrize("text", ["in_lane(none)", "in_lanelet(999)", "no_such_thing", "in_lane"])
def test_unknown_atoms(text: str) -> None:
    name, _, rest = text.partition("(")
    atom = Predicate(name, rest.rstrip(")") or None)
    with pytest.raises(FormulaError):
        answers_of(bent(0.0, 10.0), (atom,))
    assert isinstance(~atom, Not)


def test_lanes_that_are_not_there() -> None:
    course = Course()
    scene = course.scene(course.lanes(left=0, right=0))
    base = ground(scene, prediction(scene, 5), Settings(horizon=5))
    (answer,) = answers_of(base, (Predicate("in_lane", "left"),))
    lon, lat = [(0.0, 10.0)], [(0.0, 0.0)]
    assert not admits(answer(True, 1, lon, lat), np.array([0.0, 10.0, 0.0, 0.0]))
    assert admits(answer(False, 1, lon, lat), np.array([0.0, 10.0, 0.0, 0.0]))


# ------------------------------------------------------------------ exactly on the boundary


def stretch(s_low: float, s_high: float, right: float = -2.0, left: float = 2.0) -> Stretch:
    """Borders that are known exactly."""
    return Stretch(s_low, s_high, right, right, left, left)


def open_stretch(s_low: float, s_high: float) -> Stretch:
    """The lane begins or ends here: no point is in it for sure."""
    return Stretch(s_low, s_high, -2.0, np.inf, -np.inf, 2.0)


def box(s: tuple[float, float], d: tuple[float, float]) -> tuple[Polygon, Polygon]:
    return [(s[0], 5.0), (s[1], 5.0)], [(d[0], 0.0), (d[1], 0.0)]


def test_pieces_that_a_base_set_touches() -> None:
    band = (stretch(0.0, 4.0), stretch(4.0, 8.0, -4.0, 1.0), stretch(8.0, 10.0))

    def pieces(s: tuple[float, float], d: tuple[float, float]) -> list:
        return [p.box for p in touching(band, 1.0, *box(s, d))]

    assert pieces((1.0, 3.0), (-9.0, 9.0)) == [(0.0, 4.0, -3.0, 3.0)]
    assert pieces((1.0, 9.0), (-9.0, 9.0)) == [
        (0.0, 4.0, -3.0, 3.0),
        (4.0, 8.0, -5.0, 2.0),
        (8.0, 10.0, -3.0, 3.0),
    ]
    # where stretches bound the base set alike they are one piece
    assert pieces((1.0, 9.0), (-2.0, 2.0)) == [(0.0, 10.0, -2.0, 2.0)]
    assert pieces((1.0, 9.0), (2.5, 3.5)) == [(0.0, 4.0, 2.5, 3.0), (8.0, 10.0, 2.5, 3.0)]
    # all bounds are closed
    assert pieces((10.0, 12.0), (0.0, 1.0)) == [(8.0, 10.0, 0.0, 1.0)]
    assert pieces((-2.0, 0.0), (0.0, 1.0)) == [(0.0, 4.0, 0.0, 1.0)]
    assert pieces((1.0, 2.0), (3.0, 4.0)) == [(0.0, 4.0, 3.0, 3.0)]
    assert pieces((1.0, 2.0), (-4.0, -3.0)) == [(0.0, 4.0, -3.0, -3.0)]
    assert pieces((10.25, 12.0), (0.0, 1.0)) == []
    assert pieces((-2.0, -0.25), (0.0, 1.0)) == []
    assert pieces((1.0, 2.0), (3.25, 4.0)) == []
    assert pieces((1.0, 2.0), (-4.0, -3.25)) == []


def test_pieces_are_merged_up_to_a_difference_and_take_the_looser_bounds() -> None:
    def pieces(*lefts: float, right: float = 0.0) -> list:
        """Stretches of 1 m with these left borders, or right borders of the opposite sign."""
        many = [stretch(i, i + 1.0, -9.0, left) for i, left in enumerate(lefts)]
        over = [p.box for p in touching(tuple(many), 0.0, *box((0.0, 9.0), (-5.0, 5.0)))]
        mirrored = [stretch(i, i + 1.0, -left, 9.0) for i, left in enumerate(lefts)]
        below = [p.box for p in touching(tuple(mirrored), 0.0, *box((0.0, 9.0), (-5.0, 5.0)))]
        assert below == [(a, b, -high, -low) for a, b, low, high in over]
        return [(a, b, high) for a, b, _, high in over]

    assert pieces(0.0, PIECE_MERGE) == [(0.0, 2.0, PIECE_MERGE)]
    assert pieces(PIECE_MERGE, 0.0) == [(0.0, 2.0, PIECE_MERGE)]
    assert pieces(0.0, 0.21) == [(0.0, 1.0, 0.0), (1.0, 2.0, 0.21)]
    # of all merged stretches, not of neighbours only
    assert pieces(0.0, 0.15, 0.3) == [(0.0, 2.0, 0.15), (2.0, 3.0, 0.3)]
    assert pieces(0.15, 0.0, 0.15, 0.2) == [(0.0, 4.0, 0.2)]
    assert pieces(0.0, 3.0, 0.0) == [(0.0, 1.0, 0.0), (1.0, 2.0, 3.0), (2.0, 3.0, 0.0)]


def test_pieces_do_not_bridge_a_gap() -> None:
    band = (stretch(0.0, 1.0), stretch(2.0, 3.0))
    found = touching(band, 0.0, *box((0.0, 3.0), (-1.0, 1.0)))
    assert [p.box for p in found] == [(0.0, 1.0, -1.0, 1.0), (2.0, 3.0, -1.0, 1.0)]


def test_where_the_disc_is_in_no_lane() -> None:
    def outside(band: tuple[Stretch, ...], s: float, d: float) -> bool:
        return any(
            p.box[0] <= s <= p.box[1] and p.box[2] <= d <= p.box[3] for p in not_touching(band, 0.5)
        )

    band = (stretch(0.0, 1.0), stretch(1.0, 2.0), stretch(3.0, 4.0, -1.0, 1.0))
    for s, d, free in (
        (-0.25, 0.0, True),
        (0.0, 0.0, True),
        (0.5, 0.0, False),
        (0.5, 2.5, True),
        (0.5, 2.25, False),
        (0.5, -2.5, True),
        (0.5, -2.25, False),
        # stretches that meet leave no gap, others do, with its ends
        (1.0, 0.0, False),
        (2.0, 0.0, True),
        (2.5, 0.0, True),
        (3.0, 0.0, True),
        (3.5, 0.0, False),
        (3.5, 1.5, True),
        (4.0, 0.0, True),
        (5.0, 0.0, True),
    ):
        assert outside(band, s, d) == free, (s, d)
    assert outside((), 0.5, 0.0)


def test_the_band_in_which_the_disc_touches_for_sure() -> None:
    nothing = (0.0, 0.0)
    two = [stretch(0.0, 1.0, -2.0, 2.0), stretch(1.0, 2.0, -1.5, 2.5)]
    assert sure_band(two, 0.0, 2.0, 0.5) == (-2.0, 2.5)
    assert sure_band(two[:1], 0.25, 0.5, 0.5) == (-2.5, 2.5)
    # a micrometre beyond its ends is rounding, more is not
    micro = 1e-6
    assert sure_band([stretch(micro, 1.0)], 0.0, 1.0, 0.5) == (-2.5, 2.5)
    assert sure_band([stretch(2 * micro, 1.0)], 0.0, 1.0, 0.5) == nothing
    assert sure_band([stretch(-1.0, -micro)], -1.0, 0.0, 0.5) == (-2.5, 2.5)
    assert sure_band([stretch(-1.0, -2 * micro)], -1.0, 0.0, 0.5) == nothing
    # there must be no gap
    assert sure_band([stretch(0.0, 1.0), stretch(1.25, 2.0)], 0.0, 2.0, 0.5) == nothing


def behind(lane: tuple[Stretch, ...], *vehicles: Leader) -> Answer:
    """keeps_safe_distance on one lane with given vehicles, rear ends relative to the ego's half
    length; 4.5 m long, 1.8 m wide, a_min -6, a_obs_min -12 m/s^2, t_d 0.4 s."""
    course = Course()
    scene = course.scene(course.lanes(left=0, right=0))
    base = ground(scene, prediction(scene, 1), Settings(horizon=1))
    told = tuple(Leader(x.rear + 2.25, x.speed) for x in vehicles)
    base = replace(base, bands=(("current", lane),), leaders=((told, told),))
    (answer,) = answers_of(base, (Predicate("keeps_safe_distance", "preceding"),))
    return answer


def keeps(answer: Answer, s: float, v: float, d: float = 0.0) -> bool:
    region = answer(True, 1, [(s, v)], [(d, 0.0)])
    return admits(region, np.array([s, v, d, 0.0]))


LONG = (stretch(0.0, 200.0),)


def test_the_safe_distance_is_that_of_the_rule() -> None:
    """At 10 m/s, 12.33 m behind one that stands, and 8.17 m behind one at 10 m/s."""
    settings = Settings(horizon=1)
    needed = 10.0**2 / (2 * abs(settings.a_min)) + 10.0 * settings.t_d
    for speed in (0.0, 10.0):
        least = needed - speed**2 / (2 * abs(settings.a_obs_min))
        answer = behind(LONG, Leader(100.0, speed))
        assert keeps(answer, 100.0 - least - 1e-3, 10.0)
        assert not keeps(answer, 100.0 - least + 1e-3, 10.0)
    # 9 and 11 m/s lie between tangents, which are at most 1 / 12 m beside the parabola
    for v in (9.0, 11.0):
        least = v**2 / 12 + 0.4 * v
        assert keeps(behind(LONG, Leader(100.0, 0.0)), 100.0 - least, v)
        assert not keeps(behind(LONG, Leader(100.0, 0.0)), 100.0 - least + 0.09, v)
    assert keeps(behind(LONG), 99.0, 30.0)
    # to one of infinite speed no distance is asked
    assert keeps(behind(LONG, Leader(100.0, np.inf)), 99.9, 30.0)


def test_the_highest_speed_has_a_tangent_of_its_own() -> None:
    least = 30.0**2 / 12 + 0.4 * 30.0
    assert keeps(behind(LONG, Leader(150.0, 0.0)), 150.0 - least - 1e-3, 30.0)
    assert not keeps(behind(LONG, Leader(150.0, 0.0)), 150.0 - least + 1e-3, 30.0)


def test_only_the_nearest_in_front_counts() -> None:
    answer = behind(LONG, Leader(100.0, 20.0), Leader(101.0, 0.0))
    assert keeps(answer, 95.0, 10.0)
    assert not keeps(answer, 100.5, 10.0)
    assert keeps(answer, 101.5, 10.0)
    # with the bumper exactly at a rear end it is the one or the other
    assert keeps(answer, 100.0, 10.0)
    away = behind(LONG, Leader(100.0, 0.0), Leader(150.0, 20.0))
    assert not keeps(away, 99.9, 10.0)
    assert keeps(away, 100.0, 10.0)
    assert keeps(behind(LONG, Leader(100.0, 0.0)), 100.0, 10.0)


def test_nothing_is_asked_where_the_disc_may_be_beside_the_lane() -> None:
    """Sure are 2 m of the lane and 0.9 m of the disc, with the border itself."""
    answer = behind(LONG, Leader(100.0, 0.0))
    for d, free in ((2.8, False), (2.9, True), (3.0, True), (-2.8, False), (-2.9, True)):
        assert keeps(answer, 99.0, 10.0, d) == free
    # a lane so narrow that nowhere the disc touches it for sure
    for gap in (0.9, 1.0):
        narrow = (Stretch(0.0, 200.0, -gap, gap, -gap, gap),)
        assert keeps(behind(narrow, Leader(100.0, 0.0)), 99.0, 10.0, 0.0)


def test_where_a_lane_begins_or_ends_nothing_is_asked() -> None:
    """At the very line between the part that is in it and the part that may not be, too."""
    begins = (open_stretch(90.0, 95.0), stretch(95.0, 200.0))
    ends = (stretch(0.0, 95.0), open_stretch(95.0, 100.0))
    ahead = Leader(96.0, 0.0)
    assert keeps(behind(begins, ahead), 95.0, 10.0)
    assert not keeps(behind(begins, ahead), 95.5, 10.0)
    assert keeps(behind(ends, ahead), 95.0, 10.0)
    assert not keeps(behind(ends, ahead), 94.5, 10.0)
    # a set that reaches over the end is not asked either
    for lane, s in ((begins, (94.0, 95.5)), (ends, (94.5, 96.0))):
        answer = behind(lane, ahead)
        region = answer(True, 1, [(s[0], 10.0), (s[1], 10.0)], [(0.0, 0.0)])
        assert all(admits(region, np.array([x, 10.0, 0.0, 0.0])) for x in s)


def test_the_limit_of_lanes_and_what_breaks_it() -> None:
    course = Course()
    scene = course.scene()
    base = ground(scene, prediction(scene, 1), Settings(horizon=1))
    limits = ((-np.inf, 10.0, None, None), (10.0, 20.0, 5.0, 8.0), (20.0, np.inf, 6.0, 6.0))
    base = replace(base, limits=limits)
    (answer,) = answers_of(base, (Predicate("keeps_lane_speed_limit"),))
    for s, v, kept, broken in (
        (5.0, 30.0, True, True),
        (15.0, 5.0, True, True),
        (15.0, 4.0, True, False),
        (15.0, 8.0, True, True),
        (15.0, 9.0, False, True),
        (25.0, 6.0, True, True),
        (25.0, 7.0, False, True),
        (25.0, 5.0, True, False),
        (20.0, 7.0, True, True),
    ):
        state = np.array([s, v, 0.0, 0.0])
        at = [(s, v)], [(0.0, 0.0)]
        assert admits(answer(True, 1, *at), state) == kept, (s, v)
        assert admits(answer(False, 1, *at), state) == broken, (s, v)


def test_predicates_with_other_arguments_are_unknown() -> None:
    base = bent(0.0, 10.0)
    for atom in (Predicate("keeps_safe_distance", "left"), Predicate("keeps_safe_distance")):
        with pytest.raises(FormulaError, match="unknown predicate"):
            answers_of(base, (atom,))
    with pytest.raises(FormulaError, match="unknown lane"):
        answers_of(base, (Predicate("in_lane", "next"),))
    with pytest.raises(FormulaError, match="no lanelet 7 in the map"):
        answers_of(base, (Predicate("in_lanelet", "7"),))


@pytest.mark.parametrize(
    ("v", "w", "angle"),
    [
        (20.0, 0.0, np.arcsin(1.3 * 4.0 / 400.0)),
        (10.0, 1.0, np.arctan2(1.0, 10.0) + np.arcsin(1.3 * 4.0 / 100.0)),
        (10.0, -1.0, np.arctan2(1.0, 10.0) + np.arcsin(1.3 * 4.0 / 100.0)),
        (2.0, 0.0, np.inf),
        (0.0, 0.0, np.inf),
    ],
)
def test_half_extent_of_the_body_on_a_straight_lane(v: float, w: float, angle: float) -> None:
    """Heading and slip angle turn it; more than half its diagonal it never has."""
    scene = Course().scene(angle=0.125)
    base = ground(scene, prediction(scene, 1), Settings(horizon=1))
    s, d = base.lon[0][0], 0.0
    turned = min(angle, np.arctan2(2.25, 0.9))
    expected = 2.25 * np.sin(turned) + 0.9 * np.cos(turned)
    assert body_of(base).half_extent(1, [(s, v)], [(d, w)]) == pytest.approx(expected)
    assert body_of(base).half_extent(0, [(s, v)], [(d, w)]) == pytest.approx(
        2.25 * np.sin(0.125) + 0.9 * np.cos(0.125)
    )
    # of a set its slowest and most lateral state counts
    wide = body_of(base).half_extent(1, [(s, v), (s + 1.0, v + 5.0)], [(d, w), (d + 1.0, w / 2)])
    assert wide == pytest.approx(expected)


def test_half_extent_in_a_bend() -> None:
    """The body bends out of the lane, and is slower over ground on the inside of the bend."""
    kappa = 0.02
    scene = Course(kappa).scene()
    base = ground(scene, prediction(scene, 1), Settings(horizon=1))
    s = base.lon[0][0]
    at = float(np.abs(np.concatenate(base.curvature)).max())
    assert at == pytest.approx(kappa, rel=0.02)
    for d in (-3.0, 0.0, 3.0):
        forward = 10.0 * (1.0 - at * abs(d))
        angle = np.arctan2(1.0, forward) + np.arcsin(1.3 * 4.0 / forward**2)
        expected = 2.25 * np.sin(angle) + 0.9 * np.cos(angle) + 2.25**2 * at / 2
        assert body_of(base).half_extent(1, [(s, 10.0)], [(d, 1.0)]) == pytest.approx(
            expected, rel=1e-3
        )


def test_half_extent_takes_the_sharpest_bend_of_all_columns_touched() -> None:
    """Before the lattice begins that of its first column, beyond its end none."""
    body = Body(4.0, 2.0, 5.0, 0.0, (0.25, 0.5, 0.125), Lattice(10.0, -2.0, 1.0, 0.5, 3, 8))

    def bends(low: float, high: float) -> float:
        return (body.half_extent(0, [(low, 5.0), (high, 5.0)], [(0.0, 0.0)]) - 1.0) / 2.0

    for low, high, bend in ((10.25, 10.5, 0.25), (10.5, 11.5, 0.5), (12.5, 14.0, 0.125)):
        assert bends(low, high) == bend
    assert bends(8.0, 9.0) == 0.25
    assert bends(14.0, 15.0) == 0.0


def test_in_a_lane_and_not_in_it_on_a_straight_road() -> None:
    """The lane goes to 1.75 m; a disc of 0.9 m lies in the body, a circle of 2.42 m around it."""
    base = bent(0.0, 10.0)
    s = base.lon[0][0]
    texts = ("in_lane(current)", "in_lane(left)", "in_lanelet(100)")
    answers = answers_of(base, tuple(atom_of(text) for text in texts))

    def admitted(index: int, truth: bool, d: float) -> bool:
        region = answers[index](truth, 3, [(s, 10.0)], [(d, 0.0)])
        return admits(region, np.array([s, 10.0, d, 0.0]))

    side = body_of(base).half_extent(3, [(s, 10.0)], [(0.0, 0.0)])
    for sign in (-1.0, 1.0):
        for index in (0, 2):
            assert admitted(index, True, sign * (1.75 + side))
            assert not admitted(index, True, sign * (1.75 + side + 0.05))
        assert admitted(0, False, sign * (1.75 + 0.9 + 0.02))
        assert not admitted(0, False, sign * (1.75 + 0.9 - 0.05))
        # of single lanelets nobody knows from where on the body is not in them
        assert admitted(2, False, 0.0)
    assert admitted(1, False, 1.75 - 0.9 - 0.02)
    assert not admitted(1, False, 1.75 - 0.9 + 0.05)
    assert admitted(1, False, 5.25 + 0.9 + 0.02)
    assert not admitted(1, False, 5.25 + 0.9 - 0.05)


@pytest.mark.parametrize(("start", "counts"), [(20.0, True), (45.0, True), (55.0, False)])
def test_at_a_kink_a_metre_of_disc_is_less_than_a_metre_of_d(start: float, counts: bool) -> None:
    """A line with a point every 10 m turns by 0.6 rad at s = 40 m: along its mitre a unit of d is
    1 / cos(0.3) m long, and normals lean towards it up to the next point. 20 steps from 10 m/s
    reach 32 m ahead, and a metre and a half behind."""
    along = np.arange(-40.0, 101.0, 10.0)
    ahead = np.maximum(along, 0.0)
    line = np.column_stack([np.minimum(along, 0.0) + ahead * np.cos(0.6), ahead * np.sin(0.6)])
    frame = Frame(line)
    left, right = line + 1.75 * frame.normals, line - 1.75 * frame.normals
    scene = Course().scene([Lane("current", (100,), left, right, line, (None,), frame)])
    x, y = frame.to_cartesian(np.array([(start, 0.0)]))[0].tolist()
    heading = 0.6 if start > 40.0 else 0.0
    scene = replace(scene, ego=replace(scene.ego, state=State(x, y, heading, 10.0)))
    base = ground(scene, prediction(scene, 20), Settings(horizon=20))
    assert inner_reach(base) == pytest.approx(0.9 * (np.cos(0.3) if counts else 1.0))
