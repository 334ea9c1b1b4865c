"""What vehicles broke in a part of a recording, of what was relied on for each.

Measured over the steps of the decisions, beginning at every tick, and speeds also from tick to
tick. A mean over an interval that exceeds a bound shows that the bound was exceeded within it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sandra.evaluation.conformance.measure import NEEDS, TOLERANCE, UNITS, allowed, amounts
from sandra.evaluation.conformance.recording import recording as as_arrays
from sandra.scene.types import Obstacle, Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

NOISE = 0.02
"""Granted to positions [m], as by `sandra conformance`."""
OBSERVED = ("max_speed", "max_lateral_speed", "max_overhang")
"""Bounds that give way to what was observed when the prediction was made."""


@dataclass(frozen=True, slots=True)
class Breach:
    """An assumption that another vehicle broke."""

    assumption: str
    vehicle: int
    time: float
    """Since the start, of the end of the interval in which it was first broken [s]."""
    value: float
    """The worst until the event, in `unit`."""
    allowed: float
    unit: str
    crashed: float | None = None
    """Since the start, when the vehicle crashed, if it had until the event [s]."""

    def __str__(self) -> str:
        crash = "" if self.crashed is None else f", which crashed at {self.crashed:.2f} s,"
        return (
            f"vehicle {self.vehicle}{crash} broke {self.assumption} by {self.time:.2f} s "
            f"({self.value:.2f} {self.unit}, assumed {self.allowed:.2f})"
        )


def breaches(
    scene: Scene, stride: int, since: int, until: int, relied: Mapping[int, Collection[str]],
    settings: Settings, crashed: Mapping[int, int] | None = None,
) -> tuple[Breach, ...]:  # fmt: skip
    """What vehicles broke in a part of a recording, by vehicle and assumption.

    Args:
        scene: a recording, a row for each tick. stride: ticks in a decision step.
        since, until: ticks; only intervals between them are looked at.
        relied: for each vehicle that is asked, the names of what was assumed of it.
        settings: with the bounds. crashed: the tick at which a vehicle crashed, to be told.
    """
    rows = scene.recorded_ego
    several = [o for o in scene.obstacles if o.id in relied and o.states is not None]
    if rows is None or not several or until <= since:
        return ()
    found: dict[tuple[int, str], Breach] = {}
    names = {o.id: _measured(relied[o.id]) for o in several}
    for offset in range(min(stride, until - since)):
        ticks = slice(since + offset, until + 1, stride)
        part = replace(
            scene,
            dt=scene.dt * stride,
            obstacles=tuple(replace(o, states=states_of(o)[ticks]) for o in several),
            recorded_ego=rows[ticks],
        )
        made = as_arrays(part)
        values, _ = amounts(made, settings, "ego", NOISE)
        for name, value in values.items():
            for row, number in enumerate(made.ids):
                if name in names.get(number, ()):
                    limit = allowed(name, settings.assumptions)
                    if name in OBSERVED:
                        limit = np.fmax(limit, value[row, 0])
                    ticks_of = since + offset + stride * np.arange(value.shape[1])
                    times = np.asarray(scene.dt * ticks_of, dtype=np.float64)
                    # The first row is the state that was observed.
                    _note(found, name, number, times[1:], value[row, 1:], float(limit))
    for o in several:
        _speeds(found, o, scene.dt, since, until, names[o.id], settings)
    for key, breach in found.items():
        tick = (crashed or {}).get(breach.vehicle)
        if tick is not None and tick <= until:
            found[key] = replace(breach, crashed=tick * scene.dt)
    return tuple(sorted(found.values(), key=lambda b: (b.vehicle, b.time)))


def _measured(relied: Collection[str]) -> frozenset[str]:
    """The names under which conformance measures what a prediction relied on."""
    parts = {
        name
        for name, switch in NEEDS.items()
        if switch in relied and name != "max_lateral_speed"  # told by its own name
    }
    return frozenset({*relied, *parts} & UNITS.keys())


def states_of(o: Obstacle) -> Array:
    """(n, 5) of a recorded vehicle."""
    assert o.states is not None, "a recorded vehicle"
    return np.asarray(o.states)


def _speeds(
    found: dict[tuple[int, str], Breach], o: Obstacle, dt: float, since: int, until: int,
    names: Collection[str], settings: Settings,
) -> None:  # fmt: skip
    """Change of speed from tick to tick."""
    gain = np.diff(np.abs(states_of(o)[since : until + 1, 3])) / dt
    times = np.asarray(dt * np.arange(since + 1, until + 1)[: len(gain)], dtype=np.float64)
    a = settings.assumptions
    for name, value in (
        ("max_acceleration", np.abs(gain)),
        ("max_braking", -gain),
        ("max_driving", gain),
    ):
        if name in names:
            _note(found, name, o.id, times, value, allowed(name, a))


def _note(
    found: dict[tuple[int, str], Breach], name: str, vehicle: int, times: Array, values: Array,
    limit: float,
) -> None:  # fmt: skip
    with np.errstate(invalid="ignore"):
        over = values > limit + TOLERANCE
    if not over.any():
        return
    first, worst = float(times[int(np.argmax(over))]), float(np.nanmax(values))
    known = found.get((vehicle, name))
    if known is not None:
        first = min(first, known.time)
    if name == "min_turning_radius":
        worst, limit = 1.0 / worst, 1.0 / limit
        worst = worst if known is None else min(worst, known.value)
    elif known is not None:
        worst = max(worst, known.value)
    found[vehicle, name] = Breach(name, vehicle, first, worst, limit, UNITS[name])
