"""Driving with the meta-actions of highway-env, as the paper does (its Tab. "General parameters").

A ranked pair becomes one meta-action, which drops half of it where the lane is changed. So a
verdict on the pair says little about what the ego then does. What it does is a pure function of
its state and of the meta-actions: a copy of it is driven, and its states at every tick are held
against the prediction. A pair is driven if it is REACHABLE (with its rules, if any) and this exact
response, braked by the fail-safe from the next decision on, meets nobody as far as the prediction
reaches; else the next pair is tried, and at last FAIL_SAFE is driven, of which nothing is proven.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.decision import Decision, decide
from sandra.errors import ScenarioError
from sandra.planning import Maneuver
from sandra.planning.validity import Occupied
from sandra.prediction import Prediction
from sandra.rankers import Ranker, as_ranker
from sandra.reach import Status
from sandra.scene.highway import Observer
from sandra.scene.types import Ego
from sandra.simulation.episode import Episode, Step
from sandra.simulation.highway import FAIL_SAFE, Environment
from sandra.simulation.recording import Recorder

Array = NDArray[np.float64]

META: dict[ActionPair, str] = {
    **{
        ActionPair(longitudinal, lateral): action
        for lateral, action in (
            (Lateral.LEFT_LANE, "LANE_LEFT"),
            (Lateral.RIGHT_LANE, "LANE_RIGHT"),
        )
        for longitudinal in (Longitudinal.KEEP, Longitudinal.DECELERATE, Longitudinal.ACCELERATE)
    },
    ActionPair(Longitudinal.KEEP, Lateral.FOLLOW_LANE): "IDLE",
    ActionPair(Longitudinal.ACCELERATE, Lateral.FOLLOW_LANE): "FASTER",
    ActionPair(Longitudinal.DECELERATE, Lateral.FOLLOW_LANE): "SLOWER",
}
"""The paper's mapping; pairs with `stop` have no meta-action and are passed over."""
STANDS = 0.1
"""A response ends where the ego is no faster [m/s]."""


class Meta(Enum):
    """By what the ego is driven."""

    VERIFIED = "verified"
    """A pair that is REACHABLE, and whose exact response meets nobody in the prediction."""
    FAIL_SAFE = "fail-safe"
    """Nothing is proven."""


def response(vehicle: Any, action: str, ticks: int, dt: float, most: int) -> Array:
    """(n + 1, 5) what the ego does: an action for one decision step, then FAIL_SAFE in each.

    Args:
        vehicle: an ego of the profile; it is left as it is.
        ticks: in a decision step. dt: one tick [s]. most: number of ticks that are looked at.

    Returns:
        x, y (to the left), heading, speed, acceleration until the next, at each tick until the ego
        stands.
    """
    twin = copy.copy(vehicle)
    twin.position = np.array(vehicle.position)
    for name in ("action", "route"):
        if getattr(twin, name, None) is not None:
            setattr(twin, name, copy.copy(getattr(twin, name)))
    rows = [_state(twin)]
    for tick in range(most):
        if tick % ticks == 0:
            twin.act(action if tick == 0 else FAIL_SAFE)
        twin.act()
        twin.step(dt)
        rows.append(_state(twin))
        if tick + 1 >= ticks and twin.speed <= STANDS:
            break
    states = np.array(rows)
    states[:-1, 4] = np.diff(states[:, 3]) / dt
    return states


def contact(states: Array, dt: float, prediction: Prediction, ego: Ego) -> tuple[int, float] | None:
    """Whom a response meets most deeply, and when [s]; None: it keeps clear.

    Between two ticks the bodies are within their hull: the simulation knows no states in between.
    """
    n = min(len(states) - 1, round(prediction.horizon * prediction.dt / dt))
    if n == 0 or not prediction.obstacles:
        return None
    poses = states[None, : n + 1].copy()
    # In the fifth column these searches look for a steering angle: at a straight one no body
    # bulges out of the hull.
    poses[..., 4] = 0.0
    inputs = np.zeros((1, n, 2))
    occupied = Occupied.of(prediction)
    if occupied.free(poses, inputs, dt, ego, clearance=0.0)[0]:
        return None
    nearest = occupied.nearest(poses, inputs, dt, ego)
    assert nearest is not None, "who touches somebody is near to it"
    return prediction.obstacles[nearest[0]].obstacle.id, nearest[1]


def drive_meta(
    world: Environment,
    seed: int,
    ranker: str | Ranker,
    command: str | None = None,
    *,
    name: str = "highway",
    steps: int = 30,
    on_step: Callable[[Step], None] = lambda step: None,
    **options: Any,
) -> Episode:
    """Drive one episode with meta-actions.

    Args:
        world: the simulation. seed: of its traffic. name: of the scenes. steps: of decisions.
        options: passed on to `sandra.decide`: prediction, rules, horizon, k, settings, ...
    """
    world.reset(seed)
    ego, ticks, tick = world.ego, world.traffic.ticks, world.traffic.dt
    observer = Observer.of(world.env, name, ticks * tick)
    recorder = Recorder(observer, world.env, observer.scene(ego), tick)
    asked = as_ranker(ranker)
    done: list[Step] = []
    past: list[ActionPair] = []
    ended = None
    for index in range(steps):
        try:
            scene = observer.scene(ego)
        except ScenarioError as error:
            ended = str(error)
            break
        cpu, wall = time.process_time(), time.perf_counter()
        decision = decide(scene, asked, command, accept="reachable", past=tuple(past), **options)
        decision, action = _chosen(decision, ego, ticks, tick)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        pair = decision.maneuver.pair
        if pair is not None:
            past.append(pair)
        world.act(action)
        breach = 0.0
        for k in range(ticks):
            world.tick()
            recorder.note()
            if not ego.crashed:
                foreseen = decision.maneuver.states[k + 1, :2]
                breach = max(breach, float(np.linalg.norm(_state(ego)[:2] - foreseen)))
        operation = Meta.FAIL_SAFE if pair is None else Meta.VERIFIED
        done.append(Step(index, decision, operation, breach, pair is not None, cpu, wall))
        on_step(done[-1])
        if ego.crashed:
            ended = f"step {index}: the ego has crashed"
            break
    return Episode(recorder.recording(), tuple(done), ticks, steps, ended)


def _chosen(decision: Decision, ego: Any, ticks: int, tick: float) -> tuple[Decision, str]:
    """The first ranked pair that holds and whose response keeps clear, else FAIL_SAFE."""
    scene, prediction = decision.scene, decision.ground.prediction
    most = round(prediction.horizon * prediction.dt / tick)
    why = []
    for pair in decision.ranking.pairs:
        verdict, action = decision.verdicts[pair], META.get(pair)
        if action is None:
            why.append(f"{pair} has no meta-action")
        elif verdict.status is Status.UNSAFE:
            why.append(f"{pair} is UNSAFE")
        else:
            states = response(ego, action, ticks, tick, most)
            met = contact(states, tick, prediction, scene.ego)
            if met is None:
                note = f"{action}; its response keeps clear for {tick * (len(states) - 1):.1f} s"
                return _with(decision, "reachable", pair, states, tick, note), action
            why.append(f"{action} of {pair} meets vehicle {met[0]}, at {met[1]:.1f} s")
    states = response(ego, FAIL_SAFE, ticks, tick, most)
    note = "; ".join(why) or "nothing was ranked"
    return _with(decision, "fail-safe", None, states, tick, note), FAIL_SAFE


def _with(
    decision: Decision, kind: str, pair: ActionPair | None, states: Array, tick: float, note: str
) -> Decision:
    return replace(decision, maneuver=Maneuver(kind, pair, states, tick, note))


def _state(vehicle: Any) -> Array:
    """x, y (to the left), heading, speed; the acceleration is filled in later."""
    x, y = map(float, vehicle.position)
    return np.array([x, -y, -float(vehicle.heading), float(vehicle.speed), 0.0])
