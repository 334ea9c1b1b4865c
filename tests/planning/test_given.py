"""A trajectory from outside: what is refused at which boundary, in which words, and what is driven.

The corridors are made by hand, so each refusal has one cause; tests/test_certify_trajectory.py
goes the whole way.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from corridors import base, corridor, wide
from reach_scenes import Course, prediction
from sandra.actions import ActionPair
from sandra.errors import SettingsError
from sandra.logic import Part, Specification, parse
from sandra.planning import single_track
from sandra.planning.given import (
    APART,
    AT_START,
    CREEPING,
    FAR,
    _away,
    _beyond,
    _outside,
    _reference,
    _times,
    driven,
)
from sandra.planning.limits import Limits
from sandra.planning.tracking import Reference
from sandra.planning.types import Trajectory
from sandra.planning.witness import Miss, Surroundings
from sandra.reach import ground
from sandra.reach.sets import ReachableSet
from sandra.scene.types import Obstacle, Scene
from sandra.settings import Settings

COURSE = Course(step=5.0)
PAIR = ActionPair.parse("keep,follow-lane")
H = 5
START = 40.0
"""s of the ego [m]."""


def around(scene: Scene | None = None, horizon: int = H) -> Surroundings:
    scene = COURSE.scene() if scene is None else scene
    return Surroundings.of(ground(scene, prediction(scene, horizon), Settings(horizon=horizon)))


AROUND = around()


def specification(**parts: str) -> Specification:
    """Formulas by name; `text` is what the user wrote, the name where it is left out."""
    found = [Part(name, text, parse(text)) for name, text in (parts or {"any": "true"}).items()]
    return Specification(PAIR, tuple(found))


def straight(speed: float = 10.0, a: float = 0.0, n: int = H, dt: float = 0.1) -> np.ndarray:
    t = dt * np.arange(n + 1)
    return np.column_stack([speed * t + a * t**2 / 2, 0 * t, 0 * t, speed + a * t])


def judged(
    states: object,
    on: Surroundings = AROUND,
    where: ReachableSet | None = None,
    spec: Specification | None = None,
    step: float | None = None,
) -> Trajectory | Miss:
    where = wide(on.ground.horizon) if where is None else where
    return driven(on, spec or specification(), where, states, step)  # type: ignore[arg-type]


def refused(states: object, **options: object) -> str:
    found = judged(states, **options)  # type: ignore[arg-type]
    assert isinstance(found, Miss), found
    return found.reason


def accepted(states: object, **options: object) -> Trajectory:
    found = judged(states, **options)  # type: ignore[arg-type]
    assert isinstance(found, Trajectory), found
    return found


def test_what_is_given_is_driven() -> None:
    found = accepted(straight(a=-1.0))
    assert found.tau == 0.05
    assert found.start == 0.0
    assert found.states.shape == (2 * H + 1, 5)
    assert found.states[::2, :4] == pytest.approx(straight(a=-1.0), abs=1e-3)
    again = single_track.step(found.states[:-1], found.inputs, 0.05, 2.6)
    assert again == pytest.approx(found.states[1:], abs=1e-9)
    assert found.inputs[:, 0] == pytest.approx(-1.0)


def test_a_bend_is_driven_with_the_direction_of_the_points() -> None:
    """Headings that are a little off do not matter at speed: the way is in the points."""
    course = Course(0.02, step=0.5)
    on = around(course.scene(speed=8.0))
    t = 0.1 * np.arange(H + 1)
    states = np.column_stack([course.at(8.0 * t, 0.0), 0.16 * t, np.full(H + 1, 8.0)])
    off = states + np.array([0.0, 0.0, 0.02, 0.0])
    driven_by = [accepted(x, on=on).states for x in (states, off)]
    assert driven_by[0] == pytest.approx(driven_by[1], abs=1e-12)
    assert driven_by[0][::2, :2] == pytest.approx(states[:, :2], abs=0.03)
    # Wound once around, a heading is still the same; near -pi it may jump to pi.
    assert accepted(states + np.array([0.0, 0.0, 2 * np.pi, 0.0]), on=on)
    back = Course(0.02, step=0.5, angle=np.pi - 0.02)
    turned = np.column_stack([back.at(0.8 * t, 0.0), np.pi - 0.02 + 0.016 * t, np.full(H + 1, 0.8)])
    turned[3:, 2] -= 2 * np.pi
    slow = accepted(turned, on=around(back.scene(speed=0.8)))
    assert np.ptp(slow.states[:, 2]) < 0.05


def test_creeping_goes_where_the_heading_points() -> None:
    """Below 1 m/s points may jitter by a few centimetres, as measured ones do."""
    on = around(COURSE.scene(speed=0.9))
    jitter = straight(0.9)
    jitter[1:, 1] = 0.03 * np.array([1, -1, 1, -1, 1])
    calm = accepted(jitter, on=on)
    assert np.abs(calm.states[:, 4]).max() < 0.02
    on = around(COURSE.scene(speed=1.1))
    jitter[:, [0, 3]] = straight(1.1)[:, [0, 3]]
    assert np.abs(accepted(jitter, on=on).states[:, 4]).max() > 0.015


def test_it_begins_with_the_egos_own_speed() -> None:
    states = straight()
    states[:, 3] += 0.04
    found = accepted(states)
    assert found.states[0].tolist() == [0.0, 0.0, 0.0, 10.0, 0.0]
    assert found.states[2:, 3] == pytest.approx(10.04)


@pytest.mark.parametrize(
    ("step", "rows"), [(None, 6), (0.1, 6), (0.05, 11), (0.02, 26), (0.1 + 1e-11, 6)]
)
def test_steps_that_divide_dt(step: float | None, rows: int) -> None:
    times = _times(0.1, 5, step)
    assert len(times) == rows
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(0.5)
    assert np.diff(times) == pytest.approx(step or 0.1)


@pytest.mark.parametrize("step", [0.0, -0.1, 0.2, 0.03, 0.06, np.inf, -np.inf, np.nan])
def test_steps_that_do_not(step: float) -> None:
    with pytest.raises(SettingsError, match="integer part"):
        _times(0.1, 5, step)


@pytest.mark.parametrize("step", [0.05, 0.02])
def test_finer_states_are_taken_at_their_times(step: float) -> None:
    states = straight(a=-2.0, n=round(0.5 / step), dt=step)
    found = accepted(states, step=step)
    assert found.states[::2, :4] == pytest.approx(straight(a=-2.0), abs=1e-3)


@pytest.mark.parametrize(
    "states", [None, "ab", [["x"] * 4] * 6, [[1.0], [2.0, 3.0]], 3.0, np.zeros(6), np.zeros((6, 3))]
)
def test_no_table(states: object) -> None:
    assert "no table" in refused(states)


def test_too_short_but_not_by_nothing() -> None:
    assert "too short: 5 states where 6 reach the horizon of 0.5 s" in refused(straight()[:-1])
    later = np.vstack([straight(), np.full((2, 4), np.nan)])
    accepted(later)  # what comes after the horizon is not looked at
    accepted(np.column_stack([straight(), np.full(H + 1, np.nan)]))  # nor are further columns


@pytest.mark.parametrize("row", [0, 3, 5])
@pytest.mark.parametrize("column", range(4))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_every_number_is_finite(row: int, column: int, value: float) -> None:
    states = straight()
    states[row, column] = value
    assert f"its state at {row / 10:.2f} s is not finite" in refused(states)


@pytest.mark.parametrize(("column", "name"), [(0, "x"), (1, "y"), (2, "heading"), (3, "speed")])
@pytest.mark.parametrize("sign", [1, -1])
def test_it_starts_with_the_ego(column: int, name: str, sign: int) -> None:
    scene = COURSE.scene()
    at = scene.ego.state
    scene = replace(scene, ego=replace(scene.ego, state=replace(at, speed=0.0)))
    on = around(scene)
    states = np.zeros((H + 1, 4))
    states[:, column] = sign * AT_START * 1.01
    assert f"it starts elsewhere: its {name} is 0.05" in refused(states, on=on)
    # Exactly so far is near enough; a speed below 0 is wrong for another reason.
    states[:, column] = sign * AT_START
    found = judged(states, on=on)
    if (name, sign) == ("speed", -1):
        assert isinstance(found, Miss)
        assert "backwards: -0.05 m/s at 0.00 s" in found.reason
    elif name != "speed":
        assert isinstance(found, Trajectory)


def test_the_unit_is_named() -> None:
    for column, unit in ((0, "m"), (2, "rad"), (3, "m/s")):
        states = straight()
        states[0, column] += 0.25
        assert f"is 0.25 {unit} from the ego's" in refused(states)


def test_standing_still_is_not_backwards() -> None:
    on = around(COURSE.scene(speed=0.0))
    assert accepted(np.zeros((H + 1, 4)), on=on).states[-1].tolist() == [0.0] * 5
    states = np.zeros((H + 1, 4))
    states[4, 3] = -0.01
    assert "it drives backwards: -0.01 m/s at 0.40 s" in refused(states, on=on)


LIMITS = Limits(-6.0, 5.0, 4.0, 30.0, 1.0, 0.4)


@pytest.mark.parametrize(
    ("speed", "acceleration", "words"),
    [
        ([10.0, 30.0, 30.0], [0.0, 0.0], None),
        ([10.0, 10.0, 0.0], [5.0, -6.0], None),
        ([10.0, 10.0, 10.0], [5.0 + 9e-7, -6.0 - 9e-7], None),
        ([10.0, 30.0 + 9e-7, -9e-7], [0.0, 0.0], None),
        ([10.0, 30.0 + 1e-6, 0.0 - 1e-6], [5.0 + 1e-6, -6.0 - 1e-6], None),
        ([10.0, 30.01, 31.0], [0.0, 0.0], "speed 30 m/s at 0.05 s, allowed is 30"),
        ([10.0, 30.0, 30.5], [0.0, 0.0], "speed 30.5 m/s at 0.10 s, allowed is 30"),
        ([10.0, 10.0, -0.5], [0.0, 0.0], "speed -0.5 m/s at 0.10 s, allowed is 0"),
        ([10.0, 10.0, 10.0], [5.5, 7.0], "acceleration 5.5 m/s^2 at 0.00 s, allowed is 5"),
        ([10.0, 10.0, 10.0], [5.0, 5.01], "acceleration 5.01 m/s^2 at 0.05 s, allowed is 5"),
        ([10.0, 10.0, 10.0], [0.0, -6.5], "acceleration -6.5 m/s^2 at 0.05 s, allowed is -6"),
    ],
)
def test_bounds_on_speed_and_acceleration(
    speed: list[float], acceleration: list[float], words: str | None
) -> None:
    track = Reference(np.zeros((1, 3, 2)), np.zeros((1, 3)), np.array([acceleration]))
    found = _beyond(track, np.array(speed), 0.05, LIMITS)
    assert found == (None if words is None else f"it breaks a limit: {words}")


def test_bounds_are_those_of_the_settings_without_a_margin() -> None:
    accepted(straight(a=-6.0))
    accepted(straight(a=6.0))
    assert "acceleration -6.01 m/s^2 at 0.00 s, allowed is -6" in refused(straight(a=-6.01))
    assert "acceleration 6.01 m/s^2 at 0.00 s, allowed is 6" in refused(straight(a=6.01))


@pytest.mark.parametrize(
    ("x", "y", "turn", "v", "words"),
    [
        (APART, 0.0, 0.0, 0.0, None),
        (0.0, -APART, 0.0, 0.0, None),
        (0.0, 0.0, APART - 1e-9, 0.0, None),
        (0.0, 0.0, 2 * np.pi, 0.0, None),
        (0.0, 0.0, 0.0, APART, None),
        (0.0, 0.0, 0.0, -APART, None),
        (0.101, 0.0, 0.0, 0.0, "0.10 m away, at 0.05 s"),
        (-0.3, 0.4, 0.0, 0.0, "0.50 m away, at 0.05 s"),
        (np.nan, 0.0, 0.0, 0.0, "nan m away, at 0.05 s"),
        (0.0, 0.0, 0.101, 0.0, "another heading: 0.10 rad off at 0.05 s"),
        (0.0, 0.0, -0.25, 0.0, "another heading: 0.25 rad off at 0.05 s"),
        (0.0, 0.0, np.nan, 0.0, "another heading: nan rad off at 0.05 s"),
        (0.0, 0.0, 0.0, 0.25, "another speed: 0.25 m/s off at 0.05 s"),
        (0.0, 0.0, 0.0, -0.25, "another speed: 0.25 m/s off at 0.05 s"),
    ],
)
def test_what_is_driven_is_near_what_was_meant(
    x: float, y: float, turn: float, v: float, words: str | None
) -> None:
    track = Reference(np.zeros((1, 3, 2)), np.zeros((1, 3)), np.zeros((1, 2)))
    followed = np.full((3, 5), 0.0)
    followed[1, :4] = x, y, turn, v
    found = _away(followed, track, np.zeros(3), np.zeros(3), 0.05)
    assert found is None if words is None else words in str(found)


@pytest.mark.parametrize("column", [0, 1])
def test_places_out_of_this_world(column: int) -> None:
    states = straight()
    states[3, column] = states[0, column] - FAR * 1.001
    assert refused(states) == "its place at 0.30 s is out of this world"
    states[3, column] = states[0, column] - FAR
    assert "cannot follow it" in refused(states)


def test_a_path_that_cannot_be_followed() -> None:
    states = straight()
    states[3, 1] = 0.5
    assert "the single-track model cannot follow it within its limits" in refused(states)


def test_an_initial_steering_angle_that_breaks_a_limit() -> None:
    """What is driven begins with 0.11 rad at 10 m/s: 4.2 m/s^2 across."""
    scene = COURSE.scene()
    state = replace(scene.ego.state, steering_angle=0.11)
    on = around(replace(scene, ego=replace(scene.ego, state=state)))
    t = 0.1 * np.arange(H + 1)
    states = straight()
    states[:, 1], states[:, 2] = 0.55 * t + 1.5 * t**2, 0.35 * t
    assert "breaks a limit when it follows it" in refused(states, on=on)


def test_an_empty_set_has_no_corridor() -> None:
    empty = ReachableSet(wide(H).steps[:3], H, wide(H).lattice)
    assert refused(straight(), where=empty) == "the reachable set is empty at step 3"


def test_distance_from_the_corridor() -> None:
    two = corridor([base(s=(0.0, 10.0), d=(-1.0, 1.0)), base(s=(20.0, 30.0), d=(1.0, 2.0))])
    for (s, d), away in (
        ((0.0, -1.0), 0.0),
        ((10.0, 1.0), 0.0),
        ((25.0, 1.5), 0.0),
        ((12.0, 0.0), 2.0),
        ((17.0, 1.5), 3.0),
        ((-3.0, 5.0), 5.0),
        ((33.0, 6.0), 5.0),
        ((5.0, -2.0), 1.0),
        ((25.0, 0.0), 1.0),
    ):
        assert _outside(two, 0, s, d) == pytest.approx(away)


def test_where_and_how_far_it_leaves_the_corridor() -> None:
    steps = [base() for _ in range(H + 1)]
    steps[3], steps[4] = base(s=(0.0, START + 2.75)), base(s=(0.0, START + 3.5))
    words = "it leaves the corridor from 0.30 s on, by up to 0.50 m"
    assert words in refused(straight(), where=corridor(*steps))
    steps[3], steps[4] = base(s=(0.0, START + 3.0)), base(s=(0.0, START + 4.0))
    accepted(straight(), where=corridor(*steps))
    steps[3] = base(s=(0.0, START + 3.0 - 3e-6))
    assert "from 0.30 s on" in refused(straight(), where=corridor(*steps))


def parked(s: float, d: float, number: int = 7, kind: str = "car") -> Obstacle:
    return COURSE.car(number, s, d, kind=kind)


def test_whom_it_collides_with_and_when() -> None:
    """Front at 2.25 + 10 t; the bus's rear at 4.76: in the step from 0.20 s."""
    scene = COURSE.scene(
        obstacles=[parked(0.0, 3.0, 6), parked(7.01, 0.0, 7, "bus"), parked(9.0, 0.0, 8)]
    )
    words = refused(straight(), on=around(scene))
    assert words == "its body collides with bus 7, or nearly so, from 0.20 s on"
    # 0.02 m and no more is the clearance beside: the bodies are 1.8 m wide.
    accepted(straight(), on=around(COURSE.scene(obstacles=[parked(3.0, 1.83)])))
    near = around(COURSE.scene(obstacles=[parked(5.0, 1.81)]))
    assert "collides with car 7" in refused(straight(), on=near)


def test_when_it_leaves_the_road() -> None:
    """The road ends at x = 4.75 + 1 cm of margin: the front is there after 0.25 s."""
    lane = COURSE.lane("current", 100, -1.75, 1.75, end=4.78)
    on = around(COURSE.scene([lane]))
    assert refused(straight(), on=on) == "a part of its body leaves the road from 0.25 s on"


def test_which_part_of_the_formula_is_broken() -> None:
    def words(**parts: str) -> str:
        return refused(straight(), spec=specification(**parts))

    assert words(fine="G(v > 9)", slow="G(v < 9)") == (
        "its trace does not satisfy 'slow' [G(v < 9)]"
    )
    assert words(slow="G(v < 9)", high="F(d > 1)") == (
        "its trace does not satisfy 'slow' [G(v < 9)] and 'high' [F(d > 1)]"
    )
    own = Specification(PAIR, (Part("F(d > 1)", "F(d > 1)", parse("F(d > 1)")),))
    assert refused(straight(), spec=own) == "its trace does not satisfy 'F(d > 1)'"


def test_all_that_is_wrong_is_said() -> None:
    scene = COURSE.scene([COURSE.lane("current", 100, -1.75, 1.75, end=4.78)], [parked(9.0, 0.0)])
    steps = [base()] * H + [base(s=(0.0, START + 4.0))]
    words = refused(
        straight(), on=around(scene), where=corridor(*steps), spec=specification(r="G(v < 9)")
    )
    assert [x.split(" from")[0] for x in words.split("; ")] == [
        "it leaves the corridor",
        "its body collides with car 7, or nearly so,",
        "a part of its body leaves the road",
        "its trace does not satisfy 'r' [G(v < 9)]",
    ]


def test_at_just_a_metre_per_second_the_heading_tells_the_direction() -> None:
    times = 0.25 * np.arange(H + 1)
    on = around(COURSE.scene(speed=1.0, dt=0.25))
    for speed, course in ((CREEPING, 0.5), (float(np.nextafter(CREEPING, 2.0)), 0.0)):
        states = np.column_stack([speed * times, 0 * times, 0 * times + 0.5, 0 * times + speed])
        track, _, driven_at = _reference(on, times, states)
        assert (driven_at[1:] == speed).all()
        assert track.course[0, 1:] == pytest.approx(course)
