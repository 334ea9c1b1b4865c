"""A shield for anybody's policy: a Gymnasium wrapper whose actions are verified before they count.

    env = Shield(gymnasium.make("highway-v0", config={"policy_frequency": 5}))
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(policy(observation))

A meta-action becomes a pair (`sandra.simulation.proposal.TABLE`), put first in a ranking;
`sandra.decider.Decider` verifies the ranking, and what it certifies is driven: the action, what
replaces it, or a fail-safe. Spaces, observation, reward and the end of an episode stay those of the
environment, whose own `step` runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.action import DiscreteMetaAction
from highway_env.vehicle.controller import MDPVehicle

from sandra.actions import ALL_PAIRS, Lateral
from sandra.decider import Decider
from sandra.decision import Decision
from sandra.errors import ScenarioError, SettingsError
from sandra.planning import Weights
from sandra.rankers import Ranker, as_ranker
from sandra.scene.highway import Observer
from sandra.settings import Settings
from sandra.simulation.ego import PlannedVehicle
from sandra.simulation.highway import replace_ego
from sandra.simulation.proposal import Asked, Shielded, Table, meaning, table_with

_FOLLOW, _LEFT, _RIGHT = Lateral.FOLLOW_LANE, Lateral.LEFT_LANE, Lateral.RIGHT_LANE

STEP = 0.2
"""Scenes have the step nearest to this that divides the period [s]."""
SHORTEST, LONGEST = 0.1, 2.0
"""Periods that are supported [s]."""
LOOKS_AHEAD = {"set-based": 1.6}
"""Duration that is verified, by prediction (paper Tab. "General parameters", highway-env) [s]."""
ELSE_AHEAD = 4.0
"""For all other predictions [s]. Longer than a change of lane: one that is looked at again while it
is under way must still be possible within this time."""
WEIGHTS = Weights(jerk=0.05, lateral=1.0, speed=3.0, desired_speed=30.0)
"""What is preferred among trajectories that hold: brisk along the lane, calm across it."""


class ShieldedVehicle(PlannedVehicle, MDPVehicle):  # type: ignore[misc]
    """The ego: drives plans, and knows the target speeds that observations may ask for."""

    before_tick: Callable[[], None]

    def follow(self, plan: Any) -> None:
        super().follow(plan)
        self.speed_index = self.speed_to_index(self.target_speed)

    def act(self, action: Any = None) -> None:
        """What a tick begins with; a meta-action does nothing by itself."""
        if action is None:
            self.before_tick()


class Shield(gymnasium.Wrapper, gymnasium.utils.RecordConstructorArgs):  # type: ignore[misc]
    """Any policy drives; its actions are executed as certified, or replaced.

    `info` gains: `proposed` (`ActionPair`), `executed` (`ActionPair`; None for a fail-safe),
    `operation` (a value of `sandra.decider.Operation`), `verdict` of what was proposed (such as
    "UNSAFE"; None where not feasible) and `why`, `replaced` (bool); where several decisions are
    made in a step, those of the first that replaced the action, else of the first. `decisions`
    and `replacements` count them, `ended` says why an episode cannot be gone on with, else None.
    All of them are in `decided`; the last `sandra.Decision` is `decision`.

    Args:
        env: an environment of highway-env with discrete meta-actions and one ego.
        replacement: ranks what is tried where the action does not hold: as in `sandra.decide`;
            None: nothing is, the fail-safe is driven.
        table: which pairs count as which meta-action; what is left out is as in `TABLE`.
        period: time between decisions [s], a divisor of the environment's own step in whole
            ticks, 0.1 to 2 s. Default: the longest one up to 0.2 s, else the shortest. So the
            shield looks several times while a long action lasts, and certifies for less time.
        prediction, horizon, rules, settings, emergency_braking, options: as in `Decider`; the
            horizon is counted in steps of `dt`, by default 4 s (set-based: 1.6 s, within which no
            change of lane can be completed).

    Raises:
        SettingsError: for an environment, period or table that is not supported.
    """

    def __init__(
        self,
        env: Any,
        *,
        replacement: str | Ranker | None = "exhaustive",
        table: Table | None = None,
        period: float | None = None,
        prediction: Any = "most-likely",
        horizon: int | None = None,
        rules: Sequence[str] = (),
        settings: Settings | None = None,
        emergency_braking: float | None = 12.0,
        **options: Any,
    ) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(
            self,
            replacement=replacement,
            table=table,
            period=period,
            prediction=prediction,
            horizon=horizon,
            rules=rules,
            settings=settings,
            emergency_braking=emergency_braking,
            **options,
        )
        gymnasium.Wrapper.__init__(self, env)
        self.table = table_with(table or {})
        self._given = period
        self.period, self.dt = self._timing()
        if horizon is None:
            ahead = max(LOOKS_AHEAD.get(prediction, ELSE_AHEAD), self.period)
            horizon = round(ahead / self.dt)
        self.settings = (settings or Settings()).replace(horizon=horizon)
        self._asked = Asked(None if replacement is None else as_ranker(replacement))
        self._options = {
            "weights": WEIGHTS,
            "walk": "first",
            "k": len(ALL_PAIRS),
            **options,
            "prediction": prediction,
            "rules": rules,
            "settings": self.settings,
            "emergency_braking": emergency_braking,
        }
        self._decider = self._new_decider()
        self._ego: ShieldedVehicle | None = None
        self._ended: str | None = None
        self.decided: list[Shielded] = []
        self.decision: Decision | None = None

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """A new episode, and a new memory: see `gymnasium.Env.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)
        env = self.unwrapped
        if self._timing() != (self.period, self.dt):
            raise SettingsError(
                "the frequencies of the environment have changed: make a new Shield"
            )
        speeds = env.vehicle.target_speeds
        ego = ShieldedVehicle.create_from(env.vehicle)
        ego.target_speeds, ego.before_tick = speeds, self._before_tick
        ego.speed_index = ego.speed_to_index(ego.target_speed)
        replace_ego(env, ego)
        self._ego, self._ended = ego, None
        name = type(env).__name__ if env.spec is None else env.spec.id
        self._observer = Observer.of(env, name, self.dt)
        self._decider = self._new_decider()
        self.decided, self.decision = [], None
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Verify the action, drive what is certified: see `gymnasium.Env.step`.

        An episode that cannot be gone on with (the ego is off the road, or no trajectory was found
        at all) is truncated.
        """
        if self._ego is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        self._row = self.table[self.unwrapped.action_type.actions[int(action)]]
        self._lane = self._lane_wished(self._row[0].lateral if self._row else _FOLLOW)
        self.decided, self._tick = [], 0
        self._decide()
        observation, reward, terminated, truncated, info = self.env.step(action)
        truncated = truncated or self._ended is not None
        return observation, reward, terminated, truncated, {**info, **self._told()}

    def _told(self) -> dict[str, Any]:
        told: dict[str, Any] = {
            "decisions": len(self.decided),
            "replacements": sum(one.replaced for one in self.decided),
            "ended": self._ended,
        }
        if self.decided:
            one = next((one for one in self.decided if one.replaced), self.decided[0])
            told |= {
                "proposed": one.meant[0] if one.meant else None,
                "executed": one.executed,
                "operation": one.operation.value,
                "verdict": None if one.verdict is None else one.verdict.value,
                "why": one.why,
                "replaced": one.replaced,
            }
        return told

    def _before_tick(self) -> None:
        """Decide anew where an action lasts longer than the period."""
        if self._tick and self._tick % self._ticks == 0:
            self._decide()
        self._tick += 1

    def _decide(self) -> None:
        ego = self._ego
        if ego is None or ego.crashed or self._ended is not None:
            return
        try:
            scene = self._observer.scene(ego)
        except ScenarioError as error:
            ego.plan, self._ended = None, str(error)
            return
        change = self.settings.a_lim * self.settings.horizon * self.dt
        meant = self._asked.meant = meaning(
            self._row, self._side(), scene.ego.state.speed, change, self.settings.v_max
        )
        decision = self.decision = self._decider.decide(scene)
        verdict = (
            next((v for v in decision.verdicts if v.pair == meant[0]), None) if meant else None
        )
        self.decided.append(
            Shielded(
                meant,
                decision.maneuver.pair,
                self._decider.operation,
                None if verdict is None else verdict.status,
                "not feasible here" if verdict is None else verdict.reason or "",
            )
        )
        plan = decision.maneuver.trajectory
        if plan is None:
            ego.plan, self._ended = None, f"{decision.maneuver.note}: no trajectory to drive"
        else:
            ego.follow(plan)

    def _lane_wished(self, lateral: Lateral) -> Any:
        """Index of the lane beside the ego's, if it is there; else of the one it is heading for."""
        ego = self._ego
        assert ego is not None, "reset comes first"
        if lateral is not _FOLLOW:
            start, end, place = ego.lane_index
            beside = (start, end, place + (-1 if lateral is _LEFT else 1))
            if 0 <= beside[2] < len(ego.road.network.graph[start][end]):
                lane = ego.road.network.get_lane(beside)
                if lane.is_reachable_from(ego.position):
                    return beside
        return ego.target_lane_index

    def _side(self) -> Lateral:
        """Where the wished lane is, seen from the ego's centre (highway-env: > 0 is right)."""
        ego = self._ego
        assert ego is not None, "reset comes first"
        lane = ego.road.network.get_lane(self._lane)
        s, d = lane.local_coordinates(ego.position)
        if not abs(d) > lane.width_at(s) / 2 or lane.after_end(ego.position):
            return _FOLLOW
        return _LEFT if d > 0 else _RIGHT

    def _new_decider(self) -> Decider:
        return Decider(self._asked, period=self.period, **self._options)

    def _timing(self) -> tuple[float, float]:
        """(period, dt of the scenes) [s]; also checks the environment."""
        env = self.unwrapped
        if not isinstance(env, AbstractEnv) or not isinstance(env.action_type, DiscreteMetaAction):
            raise SettingsError(
                "env: the shield takes an environment of highway-env with one ego and the action "
                f"type DiscreteMetaAction, not {type(env).__name__} with {env.action_space}"
            )
        hz, policy_hz = env.config["simulation_frequency"], env.config["policy_frequency"]
        if hz % policy_hz:
            raise SettingsError(
                f"simulation_frequency {hz} is no multiple of policy_frequency {policy_hz}: "
                "choose one that is"
            )
        in_step = int(hz // policy_hz)
        ticks = _ticks(in_step, hz) if self._given is None else round(self._given * hz)
        period = ticks / hz
        if (
            not ticks
            or in_step % ticks
            or (self._given is not None and abs(period - self._given) > 1e-6)
        ):
            raise SettingsError(
                f"period = {self._given!r} s must divide the environment's step of "
                f"{in_step / hz:.3g} s, in whole ticks of {1 / hz:.3g} s"
            )
        if not SHORTEST - 1e-9 <= period <= LONGEST + 1e-9:
            raise SettingsError(
                f"a period of {period:.3g} s is not supported, {SHORTEST} to {LONGEST:g} s are: "
                "change policy_frequency, or give a period"
            )
        self._ticks = ticks
        return period, period / max(1, round(period / STEP))


def _ticks(in_step: int, hz: float) -> int:
    """The default period in ticks."""
    divisors = [n for n in range(1, in_step + 1) if in_step % n == 0 and n >= SHORTEST * hz - 1e-9]
    short = [n for n in divisors if n <= STEP * hz + 1e-9]
    return max(short) if short else min(divisors, default=in_step)
