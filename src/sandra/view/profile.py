"""Speed and acceleration over time of what is driven, down to the standstill of the fail-safe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.planning.types import Maneuver
from sandra.view import palette
from sandra.view.lettering import FAMILY, fitted, width, write
from sandra.view.page import Page

Array = NDArray[np.float64]

AXIS = 0.42
"""Room left of the axes for tick labels and the name of the axis [inch]."""
BELOW = 0.3
"""Room below them for tick labels and the name of the axis [inch]."""
SIZE = 7.0
_BETWEEN = 0.1
_DOTS = (0, (1, 1.5))
_SHARE = 0.62
"""Of the height, for the speed."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One trajectory over time; `kind` is a key of `palette.LINES`.

    `times` (n,) [s]; `states` (n, 5) as in `Maneuver`. `until`: up to here it is driven, what
    follows is only planned [s].
    """

    kind: str
    times: Array
    states: Array
    until: float = np.inf

    @property
    def parts(self) -> list[tuple[str, slice]]:
        """(kind of line, rows): up to `until`, and beyond it."""
        split = int(np.searchsorted(self.times, self.until + 1e-9)) - 1
        if split >= len(self.times) - 1:
            return [(self.kind, slice(0, len(self.times)))]
        return [(self.kind, slice(0, split + 1)), (f"{self.kind} on", slice(split, None))]


def curves_of(maneuver: Maneuver) -> list[Curve]:
    """What is planned, and the fail-safe that follows it; either may be missing."""
    if maneuver.pair is None:
        return [Curve("fail-safe", times_of(maneuver.states, maneuver.dt), maneuver.states)]
    times = times_of(maneuver.states, maneuver.dt)
    if maneuver.fail_safe is None:
        return [Curve("planned", times, maneuver.states)]
    begin = maneuver.fail_safe_start
    return [
        Curve("planned", times, maneuver.states, begin),
        Curve("fail-safe", begin + times_of(maneuver.fail_safe, maneuver.dt), maneuver.fail_safe),
    ]


def times_of(states: Array, dt: float) -> Array:
    """(n,) times of the rows of a maneuver: every `dt`, but it may end between two steps [s]."""
    times = dt * np.arange(len(states))
    if len(states) > 1 and abs(states[-2, 4]) > 1e-6:
        last = (states[-1, 3] - states[-2, 3]) / states[-2, 4]
        if 0.0 < last < dt:
            times[-1] = times[-2] + last
    return np.asarray(times)


def draw_profile(
    page: Page,
    place: tuple[float, float, float, float],
    curves: list[Curve],
    bounds: tuple[float, float],
    limit: float | None,
) -> None:
    """Two plots below one another at `place` (left, top, width, height) [inch], labels included.

    `bounds` of the acceleration [m/s^2]; `limit`: the speed limit where the ego is [m/s].
    """
    left, top, wide, high = place
    left, wide, high = left + AXIS, wide - AXIS, high - BELOW - _BETWEEN
    upper = page.axes(left, top, wide, _SHARE * high)
    lower = page.axes(left, top + _SHARE * high + _BETWEEN, wide, (1.0 - _SHARE) * high)
    end = 1.04 * max(0.5, *(float(curve.times[-1]) for curve in curves))
    stands = [curve for curve in curves if curve.kind == "fail-safe"]
    for curve in stands:
        # The label right of where it stands has room.
        needed = min(width(_standing(curve), SIZE) + 0.15, 0.6 * wide)
        end = max(end, float(curve.times[-1]) / (1.0 - needed / wide))
    fastest = max(float(curve.states[:, 3].max()) for curve in curves)
    _axes(upper, end, (-0.04 * max(fastest, 1.0), 1.22 * max(fastest, 1.0)), 4)
    room = 0.18 * (bounds[1] - bounds[0])
    _axes(lower, end, (bounds[0] - room, bounds[1] + room), 3)
    upper.tick_params(labelbottom=False)
    for curve in curves:
        for kind, rows in curve.parts:
            style = {**palette.LINES[kind], "zorder": 4.0, "solid_capstyle": "butt"}
            upper.plot(curve.times[rows], curve.states[rows, 3], **style)
            # The acceleration of a row is applied until the next one.
            held = curve.states[rows, 4].copy()
            held[-1:] = held[-2:-1] if len(held) > 1 else held
            lower.plot(curve.times[rows], held, drawstyle="steps-post", **style)
    for bound in bounds:
        lower.axhline(bound, color=palette.FAINT_INK, linewidth=0.7, linestyle=_DOTS)
    if limit is not None:
        _mark_limit(upper, limit, end)
    for curve in stands:
        if curve.states[-1, 3] <= 0.01:
            _mark_end(upper, curve, end)
    _mark_decision((upper, lower), curves, end, fastest)
    for y, text in ((0.31, "speed [m/s]"), (0.81, "acc. [m/s²]")):
        page.text(
            left - AXIS + 0.02,
            top + y * (high + _BETWEEN),
            text,
            size=SIZE,
            color=palette.FAINT_INK,
            rotation=90,
            va="center",
        )
    name = fitted("time from now [s]; bounds are dotted", wide, SIZE)
    page.text(
        left + wide / 2,
        top + high + _BETWEEN + 0.16,
        name,
        size=SIZE,
        color=palette.FAINT_INK,
        ha="center",
    )


def _standing(curve: Curve) -> str:
    return f"stands at {curve.times[-1]:.1f} s" if curve.times[-1] > 0.0 else "stands"


def _mark_end(ax: Any, curve: Curve, end: float) -> None:
    """Where the fail-safe stands: a dot and its time."""
    time = float(curve.times[-1])
    ax.scatter([time], [0.0], s=18, color=palette.FAIL_SAFE, zorder=5.0, clip_on=False)
    _write(ax, time + 0.02 * end, 0.075 * ax.get_ylim()[1], _standing(curve), ha="left")


def _mark_limit(ax: Any, limit: float, end: float) -> None:
    """The speed limit, if it is within sight."""
    low, high = ax.get_ylim()
    if limit < high:
        ax.axhline(limit, color=palette.FAINT_INK, linewidth=0.7, linestyle=_DOTS)
        y = limit + 0.06 * (high - low)
        y = y if y < high - 0.05 * (high - low) else limit - 0.06 * (high - low)
        _write(ax, 0.995 * end, y, "speed limit", ha="right", color=palette.FAINT_INK)


def _mark_decision(axes: tuple[Any, Any], curves: list[Curve], end: float, fastest: float) -> None:
    """A line where the next decision is due."""
    for curve in curves:
        if not np.isfinite(curve.until):
            continue
        for ax in axes:
            ax.axvline(curve.until, color=palette.INK, linewidth=0.8, zorder=3.0)
        side = -1 if curve.until > 0.6 * end else 1
        _write(
            axes[0],
            curve.until + side * 0.012 * end,
            1.14 * max(fastest, 1.0),
            f"next decision due at {curve.until:g} s",
            ha="right" if side < 0 else "left",
        )


def _write(ax: Any, x: float, y: float, text: str, **options: Any) -> None:
    from matplotlib.patheffects import withStroke

    drawn = write(ax, x, y, text, size=SIZE, va="center", zorder=6.0, **options)
    drawn.set_path_effects([withStroke(linewidth=2.0, foreground=palette.PAPER)])


def _axes(ax: Any, end: float, span: tuple[float, float], count: int) -> None:
    from matplotlib.ticker import MaxNLocator

    ax.set_xlim(0.0, end)
    ax.set_ylim(*span)
    ax.set_facecolor(palette.PAPER)
    ax.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
    ax.yaxis.set_major_locator(MaxNLocator(count, steps=[1, 2, 3, 5, 6, 10]))
    ax.grid(color=palette.RULE, linewidth=0.4)
    ax.set_axisbelow(True)
    for name, spine in ax.spines.items():
        spine.set_visible(name in ("left", "bottom"))
        spine.set_color(palette.BORDER)
        spine.set_linewidth(0.6)
    ax.tick_params(
        labelsize=SIZE,
        labelfontfamily=FAMILY,
        labelcolor=palette.FAINT_INK,
        color=palette.BORDER,
        length=2,
        width=0.6,
        pad=2,
    )
