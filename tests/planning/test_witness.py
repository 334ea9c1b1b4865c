"""Every witness is checked by other code: shapely, dense instants, formulas from definitions."""

from math import hypot
from pathlib import Path

import numpy as np
import pytest
import shapely

import sandra
from reach_particles import rectangles
from reach_scenes import Course, prediction
from sandra.actions import ActionPair
from sandra.logic import evaluate
from sandra.planning import single_track
from sandra.planning.cost import Weights
from sandra.planning.types import Trajectory
from sandra.planning.witness import Miss, Surroundings, witness
from sandra.prediction import predict
from sandra.prediction.types import Prediction
from sandra.reach import Ground, Status, Verdict, ground, verify_pair
from sandra.scene.types import Scene
from sandra.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data" / "scenarios"
QUICK = [*sandra.examples().values(), *SHARED.glob("DEU_Goeppingen-37_1_T-4.xml")]
REST = sorted(set(SHARED.glob("*.xml")) - set(QUICK))
FILES = [*QUICK, *(pytest.param(path, marks=pytest.mark.slow) for path in REST)]
SETTINGS = Settings()


def bodies(ground: Ground, states: np.ndarray) -> np.ndarray:
    """(m,) polygons of the body for states (m, 5)."""
    ego = ground.scene.ego
    return rectangles(states[:, :2], states[:, 2], ego.length, ego.width)


def area(scene: Scene, ids: tuple[int, ...]) -> shapely.Geometry:
    return shapely.union_all(
        [
            shapely.Polygon(np.vstack([x.right, x.left[::-1]])).buffer(0)
            for x in scene.lanelets
            if x.id in ids
        ]
    )


def assert_valid(ground: Ground, pair: ActionPair, found: Trajectory) -> None:
    """Model, limits, collisions and road at dense instants, and the pair's own formula."""
    scene, h = ground.scene, ground.horizon
    ego, state = scene.ego, scene.ego.state
    settings = ground.settings
    per_step = round(scene.dt / found.tau)
    assert found.tau <= 0.05 + 1e-12
    assert found.states.shape == (h * per_step + 1, 5)
    start = [state.x, state.y, state.heading, state.speed, state.steering_angle]
    assert found.states[0].tolist() == start
    again = single_track.step(found.states[:-1], found.inputs, found.tau, ego.wheelbase)
    assert np.allclose(again, found.states[1:], rtol=0.0, atol=1e-9)
    road = area(scene, tuple(x.id for x in scene.lanelets)).buffer(0.05, join_style="mitre")
    road = road.buffer(-0.05, join_style="mitre")
    shapely.prepare(road)
    assert (found.inputs[:, 0] >= settings.a_lon_min).all()
    assert (found.inputs[:, 0] <= settings.a_lon_max).all()
    assert (np.abs(found.inputs[:, 1]) <= settings.steering_rate_max).all()
    step = np.arange(len(found.inputs)) // per_step
    regions = [
        (k, region)
        for obstacle in ground.prediction.obstacles
        for k in range(h)
        for region in obstacle.between[k]
    ]
    tree = shapely.STRtree([shapely.MultiPoint(r.vertices).convex_hull for _, r in regions])
    interval = np.array([k for k, _ in regions], dtype=int)
    radius = np.array([region.radius for _, region in regions])
    assert radius.max(initial=0.0) < 4.0
    for part in (0.0, 0.2, 0.5, 0.8, 1.0):
        tau = part * found.tau
        now = single_track.step(found.states[:-1], found.inputs, tau, ego.wheelbase)
        lateral = single_track.lateral_acceleration(now, ego.wheelbase)
        assert (np.abs(lateral) <= settings.a_lat_max).all()
        assert (np.abs(now[:, 4]) <= settings.steering_angle_max).all()
        assert ((now[:, 3] >= -1e-9) & (now[:, 3] <= settings.v_max)).all()
        shapes = bodies(ground, now)
        assert shapely.covers(road, shapes).all()
        one, other = tree.query(shapes, predicate="dwithin", distance=5.0)
        same = step[one] == interval[other]
        gap = shapely.distance(shapes[one], tree.geometries[other]) - radius[other]
        assert (gap[same] >= 0.02 - 1e-9).all()
    at = found.states[::per_step]
    shapes = bodies(ground, at)
    by_step = found.inputs[:, 0].reshape(h, per_step)
    lanes = {x.relation: area(scene, x.lanelets) for x in scene.lanes}
    match pair.longitudinal.value:
        case "keep":
            assert (np.abs(by_step) <= settings.a_lim).all()
        case "accelerate":
            assert (by_step > settings.a_lim).all()
        case "decelerate":
            assert (by_step < -settings.a_lim).all()
        case "stop":
            assert abs(at[-1, 3]) <= settings.v_err
    if pair.lateral.value == "follow-lane":
        assert shapely.intersects(lanes["current"], shapes).all()
    else:
        side = pair.lateral.value.removesuffix("-lane")
        assert lanes[side].intersects(shapes[-1])


def assert_in_set(ground: Ground, verdict: Verdict, found: Trajectory) -> float:
    """Positions lie in the reachable set; returns by how much (s, v_s) or (d, v_d) leave it.

    The set's model takes the input as s'' of a double integrator; the single-track model has it as
    the change of the speed along its path, so across a lane or in a bend v_s differs a little.
    """
    scene = ground.scene
    at = found.states[:: round(scene.dt / found.tau)]
    place = scene.frame.to_curvilinear(at[:, :2])
    beta = np.arctan(np.tan(at[:, 4]) / 2)
    relative = at[:, 2] + beta - scene.frame.heading(place[:, 0])
    stretch = 1.0 - scene.frame.curvature(place[:, 0]) * place[:, 1]
    v_s, v_d = at[:, 3] * np.cos(relative) / stretch, at[:, 3] * np.sin(relative)
    worst = 0.0
    for k, sets in enumerate(verdict.reachable_set.corridor().steps):
        s, d = place[k]
        best = np.inf
        for b in sets:
            low, high, right, left = b.rectangle
            if low - 1e-5 <= s <= high + 1e-5 and right - 1e-5 <= d <= left + 1e-5:
                lon = shapely.MultiPoint(b.lon).convex_hull.distance(shapely.Point(s, v_s[k]))
                lat = shapely.MultiPoint(b.lat).convex_hull.distance(shapely.Point(d, v_d[k]))
                best = min(best, max(lon, lat))
        assert np.isfinite(best), f"position outside of the corridor at step {k}"
        worst = max(worst, best)
    return worst


def search(
    scene: Scene,
    pair: str,
    predicted: Prediction | str = "most-likely",
    rules: tuple[str, ...] = (),
    horizon: int = 25,
) -> tuple[Ground, Verdict, Trajectory | Miss]:
    source = predict(scene, predicted, horizon, SETTINGS)
    base = ground(scene, source, SETTINGS.replace(horizon=horizon))
    verdict = verify_pair(base, ActionPair.parse(pair), rules, reasons=False)
    return base, verdict, witness(base, verdict.specification, verdict.reachable_set)


FOUND = {
    "DEU_HighwayDense-1_1_T-1": 9,
    "DEU_Intersection-1_1_T-1": 4,
    "DEU_Merge-1_1_T-1": 9,
    "DEU_Roadworks-1_1_T-1": 8,
    "DEU_RuralOncoming-1_1_T-1": 1,
    "DEU_UrbanParked-1_1_T-1": 4,
    "ZAM_NothingSafe-1_1_T-1": 0,
    "ZAM_RecordedEgo-1_1_T-1": 7,
    "DEU_AachenBendplatz-1_80_T-19": 0,
    "DEU_AachenHeckstrasse-1_30520_T-539": 3,
    "DEU_Gar-1_1_T-1": 2,
    "DEU_Goeppingen-37_1_T-4": 6,
    "DEU_Goeppingen-37_1_T-5": 8,
    "DEU_LocationALower-11_10_T-1": 0,
    "DEU_MONAEast-2_4316_T-4341": 6,
}
"""At least so many pairs have a witness (most likely prediction, no rules, h = 25)."""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_scenario(path: Path) -> None:
    scene = sandra.load(path)
    predicted = predict(scene, "most-likely", 25, SETTINGS)
    base = ground(scene, predicted, SETTINGS)
    around = Surroundings.of(base)
    found = 0
    for pair in sandra.ALL_PAIRS:
        verdict = verify_pair(base, pair, reasons=False)
        answer = witness(around, verdict.specification, verdict.reachable_set)
        if verdict.status is Status.UNSAFE:
            assert isinstance(answer, Miss)
            assert "empty at step" in answer.reason
        elif isinstance(answer, Miss):
            assert answer.reason
        else:
            found += 1
            assert_valid(base, pair, answer)
            assert assert_in_set(base, verdict, answer) < 0.3
    assert found >= FOUND.get(path.stem, 0)


def test_lane_changes_in_a_bend() -> None:
    scene = Course(kappa=0.01).scene(speed=12.0)
    for pair in ("keep,left-lane", "accelerate,right-lane", "stop,left-lane"):
        base, verdict, found = search(scene, pair)
        assert isinstance(found, Trajectory), found
        assert_valid(base, verdict.pair, found)
        assert_in_set(base, verdict, found)


def test_stop_from_15_m_per_s() -> None:
    scene = Course().scene(speed=15.0)
    base, verdict, found = search(scene, "stop,follow-lane", horizon=30)
    assert isinstance(found, Trajectory), found
    assert_valid(base, verdict.pair, found)
    assert found.states[-1, 3] <= 0.1


@pytest.mark.parametrize(
    "pair",
    ["keep,follow-lane", "accelerate,follow-lane", "stop,follow-lane", "accelerate,left-lane"],
)
def test_start_at_standstill(pair: str) -> None:
    scene = Course().scene(speed=0.0)
    base, verdict, found = search(scene, pair, horizon=30)
    assert isinstance(found, Trajectory), found
    assert_valid(base, verdict.pair, found)


def test_initial_offset_heading_and_steering() -> None:
    scene = Course(kappa=-0.005).scene(speed=12.0, d=0.4, angle=0.06)
    base, verdict, found = search(scene, "keep,follow-lane")
    assert isinstance(found, Trajectory), found
    assert_valid(base, verdict.pair, found)


@pytest.mark.parametrize(("gap", "there"), [(2.6, True), (1.7, False)])
def test_a_gap_between_two_parked_cars(gap: float, there: bool) -> None:
    # The disc of the set passes both gaps; the body, 1.8 m wide, only one.
    course = Course()
    cars = [course.car(7, 20.0, gap / 2 + 0.9), course.car(8, 20.0, -gap / 2 - 0.9)]
    scene = course.scene(obstacles=cars, speed=12.0)
    base, verdict, found = search(scene, "keep,follow-lane", prediction(scene, 25))
    if there:
        assert isinstance(found, Trajectory), found
        assert_valid(base, verdict.pair, found)
    else:
        assert isinstance(found, Miss)


def test_a_parked_car_is_passed_and_the_reason_names_it() -> None:
    course = Course()
    scene = course.scene(obstacles=[course.car(7, 28.0, -0.6)], speed=12.0)
    base, verdict, found = search(scene, "keep,follow-lane", prediction(scene, 25))
    assert isinstance(found, Trajectory), found
    assert_valid(base, verdict.pair, found)
    wall = [course.car(10 + i, 24.0, d) for i, d in enumerate((-4.4, -2.2, 0.0, 2.2, 4.4))]
    scene = course.scene(obstacles=wall, speed=12.0)
    base = ground(scene, prediction(scene, 25), SETTINGS)
    # what the set would be if nobody were there
    alone = ground(scene, prediction(course.scene(speed=12.0), 25), SETTINGS)
    verdict = verify_pair(alone, ActionPair.parse("keep,follow-lane"), reasons=False)
    missed = witness(base, verdict.specification, verdict.reachable_set)
    assert isinstance(missed, Miss)
    assert "collide" in missed.reason
    assert "to car 1" in missed.reason
    assert dict(missed.counts)["collision"] > 0


def test_rules_are_kept() -> None:
    course = Course()
    scene = course.scene(obstacles=[course.car(7, 30.0, 0.0, speed=10.0)], speed=14.0)
    paths = {7: course.drive(scene.obstacles[0], 30.0, 0.0, 25, 0.1)}
    base, verdict, found = search(
        scene, "decelerate,follow-lane", prediction(scene, 25, paths), ("R_G1", "R_G2", "R_G3")
    )
    assert isinstance(found, Trajectory), found
    assert_valid(base, verdict.pair, found)
    at = found.states[:: round(scene.dt / found.tau)]
    assert found.inputs[:, 0].min() >= SETTINGS.a_abrupt
    for k, (x, _, _, v, _) in enumerate(at):
        room = paths[7][k, 0] - 2.25 - (x + 2.25)
        touches = hypot(at[k, 1], 0.0) < 1.75 + 0.9
        assert not touches or room > v**2 / 12 - 10.0**2 / 24 + 0.4 * v


def test_formulas_of_the_users_own() -> None:
    scene = Course().scene(speed=10.0)
    rules = ("F[0,1.5s](d > 0.8)", "v <= 12 U v > 11", "F(a < -1)")
    base = ground(scene, predict(scene, "most-likely", 25, SETTINGS), SETTINGS)
    pair = ActionPair.parse("stop,follow-lane")
    for rule in rules:
        verdict = verify_pair(base, pair, (rule,), reasons=False)
        found = witness(base, verdict.specification, verdict.reachable_set)
        if isinstance(found, Trajectory):
            assert_valid(base, pair, found)
            at = found.states[::2]
            a = np.append(found.inputs[::2, 0], found.inputs[-1, 0])
            values = {"a": a, "v": at[:, 3], "s": at[:, 0], "d": at[:, 1]}
            part = next(p for p in verdict.specification.parts if p.name == rule)
            atoms = verdict.specification.dfa.atoms
            named = [x for x in atoms if hasattr(x, "variable")]
            trace = [{x: x.holds(values[x.variable][k]) for x in named} for k in range(26)]
            assert evaluate(part.formula, trace)


def test_accept_is_asked_and_named() -> None:
    scene = Course().scene(speed=10.0)
    base = ground(scene, predict(scene, "most-likely", 25, SETTINGS), SETTINGS)
    verdict = verify_pair(base, ActionPair.parse("keep,follow-lane"), reasons=False)
    shown: list[Trajectory] = []

    def second(found: Trajectory) -> str | None:
        shown.append(found)
        return None if len(shown) == 2 else "it is the first"

    found = witness(base, verdict.specification, verdict.reachable_set, accept=second)
    assert found is shown[1]
    assert not np.array_equal(shown[0].states, shown[1].states)
    missed = witness(
        base, verdict.specification, verdict.reachable_set, accept=lambda found: "no fail-safe"
    )
    assert isinstance(missed, Miss)
    assert "2 are valid, but no fail-safe" in missed.reason


def test_the_start_is_named() -> None:
    scene = Course().scene(Course().lanes(left=0, right=0), speed=10.0, d=1.0)
    _, verdict, found = search(scene, "keep,follow-lane")
    assert verdict.status is Status.REACHABLE
    assert isinstance(found, Miss)
    assert "not on the road" in found.reason


def test_the_command_moves_the_speed() -> None:
    scene = Course().scene(Course().lanes(limit=None), speed=10.0)
    base = ground(scene, predict(scene, "most-likely", 25, SETTINGS), SETTINGS)
    verdict = verify_pair(base, ActionPair.parse("accelerate,follow-lane"), reasons=False)

    def speed(text: str | None) -> float:
        found = witness(
            base,
            verdict.specification,
            verdict.reachable_set,
            weights=Weights.for_command(text),
        )
        assert isinstance(found, Trajectory)
        return float(found.states[-1, 3])

    assert speed("hurry up, drive faster") > speed(None)
    assert speed("slower please") <= speed(None)


def test_a_search_is_repeatable() -> None:
    scene = sandra.load(sandra.example("merge"))
    answers = [search(scene, "keep,left-lane")[2] for _ in range(2)]
    assert all(isinstance(x, Trajectory) for x in answers)
    assert np.array_equal(answers[0].states, answers[1].states)  # type: ignore[union-attr]
