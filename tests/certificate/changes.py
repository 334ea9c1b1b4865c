"""Certificates with one thing changed, by name, with the condition that then does not hold."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from certified import HORIZON, constant, drive, made, turning_scene
from sandra.actions import ActionPair
from sandra.certificate import Certificate
from sandra.certificate.types import LaneOf, Participant, Pavement
from sandra.logic import Vocabulary, specification
from sandra.planning.types import Trajectory
from sandra.scene.types import Region

Mutation = Callable[[Certificate], Certificate]
BASE = made()
BENT = made(turning_scene(0.02))
HARD = made(turning_scene(0.03), stop=constant(-5.0, 40))
"""Lateral acceleration 3 m/s^2."""


def witness(change: Callable[[np.ndarray, np.ndarray], None], **others: float) -> Mutation:
    """The witness's states and inputs changed in place."""
    return lambda c: replace(c, witness=_changed(c.witness, change, **others))


def fail_safe(change: Callable[[np.ndarray, np.ndarray], None], **others: float) -> Mutation:
    return lambda c: replace(c, fail_safe=_changed(c.fail_safe, change, **others))


def _changed(
    t: Trajectory, change: Callable[[np.ndarray, np.ndarray], None], **others: float
) -> Trajectory:
    states, inputs = t.states.copy(), t.inputs.copy()
    change(states, inputs)
    return replace(Trajectory(states, inputs, t.tau, t.start), **others)


def put(
    row: int | slice, column: int, value: float, add: bool = True
) -> Callable[[np.ndarray, np.ndarray], None]:
    def change(states: np.ndarray, inputs: np.ndarray) -> None:
        states[row, column] = states[row, column] + value if add else value

    return change


def nothing(states: np.ndarray, inputs: np.ndarray) -> None:
    pass


def without_step(t: Trajectory, i: int) -> Trajectory:
    return replace(t, states=np.delete(t.states, i, axis=0), inputs=np.delete(t.inputs, i, axis=0))


def twice_step(t: Trajectory, i: int) -> Trajectory:
    return replace(
        t,
        states=np.insert(t.states, i, t.states[i], axis=0),
        inputs=np.insert(t.inputs, i, t.inputs[i], axis=0),
    )


def repeated_state(states: np.ndarray, inputs: np.ndarray) -> None:
    states[11:] = states[10:-1].copy()


def settings(**changes: float | bool) -> Mutation:
    return lambda c: replace(c, settings=c.settings.replace(**changes))


def driven(inputs: np.ndarray, stop: np.ndarray, start: list[float] | None = None) -> Mutation:
    """Another witness and fail-safe, both true to the model."""

    def change(c: Certificate) -> Certificate:
        first = drive(start or c.initial.tolist(), inputs)
        return replace(
            c,
            initial=np.array(first.states[0]),
            witness=first,
            fail_safe=drive(first.states[2], stop, c.t_dec),
        )

    return change


def moved(obstacle: Participant, x: float, y: float) -> Participant:
    """An obstacle and all its regions elsewhere."""
    shift = np.array([x, y])

    def regions(steps: tuple[tuple[Region, ...], ...]) -> tuple[tuple[Region, ...], ...]:
        return tuple(tuple(Region(r.vertices + shift, r.radius) for r in s) for s in steps)

    states = obstacle.states + np.array([x, y, 0, 0, 0])
    return replace(
        obstacle,
        states=states,
        likely=regions(obstacle.likely),
        possible=regions(obstacle.possible),
    )


def other(index: int, change: Callable[[Participant], Participant]) -> Mutation:
    def mutate(c: Certificate) -> Certificate:
        several = list(c.obstacles)
        several[index] = change(several[index])
        return replace(c, obstacles=tuple(several))

    return mutate


def without_regions(kind: str, k: int) -> Callable[[Participant], Participant]:
    def change(o: Participant) -> Participant:
        steps = list(getattr(o, kind))
        steps[k] = ()
        return replace(o, **{kind: tuple(steps)})

    return change


def smaller(kind: str, factor: float) -> Callable[[Participant], Participant]:
    """Every region shrunk about its middle."""

    def change(o: Participant) -> Participant:
        def shrunk(r: Region) -> Region:
            middle = r.vertices.mean(axis=0)
            return Region(middle + factor * (r.vertices - middle), r.radius)

        steps = getattr(o, kind)
        return replace(o, **{kind: tuple(tuple(shrunk(r) for r in s) for s in steps)})

    return change


def on_ego(kind: str, k: int) -> Callable[[Participant], Participant]:
    """One more region in one interval, where the ego is."""

    def change(o: Participant) -> Participant:
        steps = list(getattr(o, kind))
        steps[k] = (*steps[k], Region(np.array([[10 * (k + 0.5) * 0.1 + 1.0, 0.0]]), 0.1))
        return replace(o, **{kind: tuple(steps)})

    return change


def lanelets(change: Callable[[Pavement], Pavement | None]) -> Mutation:
    def mutate(c: Certificate) -> Certificate:
        found = tuple(y for x in c.lanelets if (y := change(x)) is not None)
        known = {x.id for x in found}
        lanes = tuple(
            lane
            for x in c.lanes
            if (lane := LaneOf(x.relation, tuple(i for i in x.lanelets if i in known))).lanelets
        )
        return replace(c, lanelets=found, lanes=lanes)

    return mutate


def cut_at(x: float) -> Mutation:
    """The road ends at x."""

    def change(p: Pavement) -> Pavement:
        def until(line: np.ndarray) -> np.ndarray:
            return np.vstack([line[line[:, 0] < x], [x, line[0, 1]]])

        return replace(p, left=until(p.left), right=until(p.right))

    return lanelets(change)


def narrower(by: float) -> Mutation:
    return lanelets(lambda p: replace(p, right=p.right + np.array([0.0, by])))


def crossing(c: Certificate) -> Certificate:
    """A lane that crosses where the fail-safe stands, at x = 11."""
    left, right = np.array([[9.0, -20.0], [9.0, 20.0]]), np.array([[13.0, -20.0], [13.0, 20.0]])
    return replace(c, conflicts=(Pavement(500, left, right, None),))


def claim(pair: str | None = None, rules: tuple[str, ...] | None = None) -> Mutation:
    """Another pair or other rules, with their formula."""

    def change(c: Certificate) -> Certificate:
        asked = c.pair if pair is None else ActionPair.parse(pair)
        under = c.rules if rules is None else rules
        spec = specification(asked, under, c.settings, dt=c.dt)
        parts = tuple((p.name, p.text) for p in spec.parts)
        return replace(c, pair=asked, rules=under, formula=str(spec.formula), parts=parts)

    return change


def both(*mutations: Mutation) -> Mutation:
    def change(c: Certificate) -> Certificate:
        for mutation in mutations:
            c = mutation(c)
        return c

    return change


def nan(name: str) -> Mutation:
    def change(c: Certificate) -> Certificate:
        values = getattr(c, name).copy()
        values.flat[1] = math.nan
        return replace(c, **{name: values})

    return change


def loose_words(c: Certificate) -> Certificate:
    words = Vocabulary.default()
    return replace(
        c,
        vocabulary=MappingProxyType(
            {
                "actions": words.actions,
                "rules": MappingProxyType({**words.rules, "R_G1": "G(true)"}),
                "predicates": words.predicates,
            }
        ),
    )


STOP = constant(-5.0, 40)
KEEP = constant(0.0, 2 * HORIZON)

MUTATIONS: dict[str, tuple[str, Mutation]] = {
    # format
    "version": ("format", lambda c: replace(c, format="sandra-certificate/2")),
    "NaN in witness": ("format", witness(put(7, 1, math.nan))),
    "NaN input": ("format", witness(lambda s, u: u.__setitem__((3, 0), math.nan))),
    "inf in fail-safe": ("format", fail_safe(put(7, 3, math.inf))),
    "NaN in initial": ("format", nan("initial")),
    "NaN in reference": ("format", nan("reference")),
    "NaN in a lanelet": ("format", lanelets(lambda p: replace(p, left=p.left * math.nan))),
    "NaN in a region": ("format", other(0, smaller("possible", math.nan))),
    "inf in a region": ("format", other(0, smaller("likely", math.inf))),
    "state partly NaN": (
        "format",
        other(0, lambda o: replace(o, states=np.where(o.states == 10.0, math.nan, o.states))),
    ),
    "radius negative": (
        "format",
        other(0, lambda o: replace(o, outline=Region(o.outline.vertices, -1.0))),
    ),
    "dt NaN": ("format", lambda c: replace(c, dt=math.nan)),
    "tau NaN": ("format", witness(nothing, tau=math.nan)),
    "a state without input": ("format", witness(nothing, states=BASE.witness.states[:-1])),
    "states too short": ("format", other(0, lambda o: replace(o, states=o.states[:-1]))),
    "width zero": ("format", lambda c: replace(c, ego=replace(c.ego, width=0.0))),
    "assumption NaN": (
        "format",
        lambda c: replace(
            c,
            settings=replace(
                c.settings, assumptions=replace(c.settings.assumptions, max_acceleration=math.nan)
            ),
        ),
    ),
    "lane without lanelets": ("format", lambda c: replace(c, lanelets=())),
    "one obstacle twice": ("format", lambda c: replace(c, obstacles=c.obstacles * 2)),
    # grid
    "dt wrong": ("grid", lambda c: replace(c, dt=0.11)),
    "dt too long": ("grid", lambda c: replace(c, dt=20.0)),
    "dt double": ("grid", lambda c: replace(c, dt=0.2)),
    "tau wrong": ("grid", witness(nothing, tau=0.04)),
    "tau half": ("grid", witness(nothing, tau=0.025)),
    "tau of the fail-safe wrong": ("grid", fail_safe(nothing, tau=0.051)),
    "tau too long": ("grid", witness(nothing, tau=0.1)),
    "witness cut short": ("grid", lambda c: replace(c, witness=without_step(c.witness, -1))),
    "witness step dropped": ("grid", lambda c: replace(c, witness=without_step(c.witness, 9))),
    "witness step doubled": ("grid", lambda c: replace(c, witness=twice_step(c.witness, 9))),
    "witness late": ("grid", witness(nothing, start=0.05)),
    "t_dec at once": ("grid", lambda c: replace(c, t_dec=0.0)),
    "t_dec off the grid": ("grid", lambda c: replace(c, t_dec=0.13)),
    "t_dec beyond the witness": ("grid", lambda c: replace(c, t_dec=1.6)),
    "fail-safe late": ("grid", fail_safe(nothing, start=0.2)),
    "fail-safe early": ("grid", fail_safe(nothing, start=0.0)),
    # where trajectories begin
    "shifted at the start": ("initial-state", witness(put(slice(None), 1, 0.5))),
    "initial speed": (
        "initial-state",
        lambda c: replace(c, initial=c.initial + np.array([0, 0, 0, 0.1, 0])),
    ),
    "initial steering": (
        "initial-state",
        lambda c: replace(c, initial=c.initial + np.array([0, 0, 0, 0, 1e-3])),
    ),
    "fail-safe shifted": ("continuity", fail_safe(put(slice(None), 0, 0.5))),
    "fail-safe steered": ("continuity", fail_safe(put(slice(None), 4, 1e-3))),
    "fail-safe from a later state": (
        "continuity",
        lambda c: replace(c, fail_safe=drive(c.witness.states[4], STOP, c.t_dec)),
    ),
    # motion
    "shifted in the middle": ("motion", witness(put(slice(15, None), 1, 0.5))),
    "shifted by a millimetre": ("motion", witness(put(slice(15, None), 0, 1e-3))),
    "heading jump": ("motion", witness(put(slice(15, None), 2, 0.01))),
    "steering jump": ("motion", witness(put(slice(15, None), 4, 0.001))),
    "speed jump": ("motion", fail_safe(put(20, 3, 0.01))),
    "state repeated": ("motion", witness(repeated_state)),
    "fail-safe step dropped": (
        "motion",
        lambda c: replace(c, fail_safe=without_step(c.fail_safe, 9)),
    ),
    "fail-safe step doubled": (
        "motion",
        lambda c: replace(c, fail_safe=twice_step(c.fail_safe, 9)),
    ),
    "input changed": ("motion", witness(lambda s, u: u.__setitem__((5, 1), 0.1))),
    # bounds: beyond by 1 %
    "acceleration low": ("acceleration", settings(a_lon_min=-5.0 / 1.01)),
    "braking 1 % too hard": (
        "acceleration",
        driven(KEEP, np.vstack([constant(-6.06, 33), constant(-0.001 / 0.05, 1)])),
    ),
    "acceleration high": (
        "acceleration",
        both(settings(a_lon_max=1.0), driven(constant(1.01, 30), STOP)),
    ),
    "steering rate": (
        "steering-rate",
        driven(np.vstack([constant(0.0, 20), constant(0.0, 10, 0.404)]), STOP),
    ),
    "speed": ("speed", settings(v_max=10.0 / 1.01)),
    "speed negative": ("speed", driven(KEEP, constant(-5.0, 41))),
    # formula
    "formula swapped": ("formula", lambda c: replace(c, formula="G(true)")),
    "formula of another pair": (
        "formula",
        lambda c: replace(c, formula=claim("stop,follow-lane")(c).formula),
    ),
    "pair swapped": ("formula", lambda c: replace(c, pair=ActionPair.parse("stop,follow-lane"))),
    "a rule dropped": ("formula", lambda c: replace(c, rules=c.rules[:-1])),
    "a rule added": ("formula", lambda c: replace(c, rules=(*c.rules, "G(v <= 5)"))),
    "rule unknown": ("formula", lambda c: replace(c, rules=("R_G9",))),
    "part dropped": ("formula", lambda c: replace(c, parts=c.parts[:-1])),
    "threshold a_lim": ("formula", settings(a_lim=0.1)),
    "threshold a_abrupt": ("formula", settings(a_abrupt=-9.0)),
    "own words": ("formula", loose_words),
    # predictions
    "likely cut short": (
        "predictions",
        other(0, lambda o: replace(o, likely=o.likely[: HORIZON - 1])),
    ),
    "possible cut short": (
        "predictions",
        other(1, lambda o: replace(o, possible=o.possible[:20])),
    ),
    "no possible regions": ("predictions", other(1, lambda o: replace(o, possible=()))),
    "not set-based": ("predictions", lambda c: replace(c, set_based="most-likely")),
    "a likely region removed": ("occupancies", other(0, without_regions("likely", 4))),
    "a possible region removed": ("occupancies", other(0, without_regions("possible", 8))),
    "likely regions too small": ("occupancies", other(0, smaller("likely", 0.9))),
    "possible regions too small": ("occupancies", other(0, smaller("possible", 0.9))),
    "bound loosened": (
        "occupancies",
        lambda c: replace(
            c,
            settings=replace(
                c.settings, assumptions=replace(c.settings.assumptions, max_acceleration=14.0)
            ),
        ),
    ),
    "obstacle faster": (
        "occupancies",
        other(0, lambda o: replace(o, states=o.states + np.array([0, 0, 0, 5.0, 0]))),
    ),
    # collisions
    "obstacle moved into the way": ("witness-collision", other(0, lambda o: moved(o, -36.0, 0.0))),
    "obstacle beside": ("witness-collision", other(1, lambda o: moved(o, -20.0, -1.8))),
    "region in the way of the witness": ("witness-collision", other(0, on_ego("likely", 9))),
    "region in the way at once": ("set-based-collision", other(0, on_ego("possible", 0))),
    "region in the way of the fail-safe": (
        "set-based-collision",
        other(0, on_ego("possible", 6)),
    ),
    "obstacle near, braking": ("set-based-collision", other(0, lambda o: moved(o, -30.0, 0.0))),
    "fail-safe begins to brake too late": (
        "set-based-collision",
        lambda c: made(turning_scene(leader=18.0), stop=np.vstack([constant(0.0, 20), STOP])),
    ),
    # road
    "road cut away": ("road", cut_at(12.0)),
    "road too narrow": ("road", narrower(0.9)),
    "no road": ("road", lambda c: replace(c, lanelets=(), lanes=())),
    "off the road": ("road", driven(constant(0.0, 30), STOP, [0.0, -1.2, 0.0, 10.0, 0.0])),
    "steered off the road": (
        "road",
        driven(np.vstack([constant(0.0, 10, -0.1), constant(0.0, 20)]), STOP),
    ),
    "lane too short behind": (
        "road",
        lanelets(
            lambda p: replace(
                p, left=p.left[9:] + np.array([4.9, 0]), right=p.right[9:] + np.array([4.9, 0])
            )
        ),
    ),
    # where it ends
    "fail-safe cut short": ("standstill", lambda c: replace(c, fail_safe=_shorter(c.fail_safe, 1))),
    "fail-safe nearly empty": (
        "standstill",
        lambda c: replace(c, fail_safe=_shorter(c.fail_safe, 40)),
    ),
    "fail-safe does not brake": ("standstill", driven(KEEP, constant(0.0, 40))),
    "stands where another lane crosses": ("conflict-area", crossing),
    # trace
    "speed limit lowered": ("trace", lanelets(lambda p: replace(p, speed_limit=9.9))),
    "pair that is not driven": ("trace", claim("accelerate,follow-lane")),
    "lane that is not reached": ("trace", claim("keep,left-lane")),
    "no standstill": ("trace", claim("stop,follow-lane")),
    "rule that does not hold": ("trace", claim(rules=("G(v <= 9)",))),
    "lane removed": ("trace", lambda c: replace(c, lanes=c.lanes[1:])),
    "lane swapped": (
        "trace",
        lambda c: replace(c, lanes=(LaneOf("left", (100,)), LaneOf("current", (101,)))),
    ),
    "not at a safe distance": ("trace", settings(a_min=-1.2)),
    "reaction time": ("trace", settings(t_d=3.5)),
    "braking more than KEEP": (
        "trace",
        driven(np.vstack([constant(0.0, 10), constant(-0.21, 1), constant(0.0, 19)]), STOP),
    ),
}


def _shorter(t: Trajectory, by: int) -> Trajectory:
    return replace(t, states=t.states[:-by], inputs=t.inputs[:-by])
