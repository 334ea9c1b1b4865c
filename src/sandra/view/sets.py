"""Draw reachable sets and trajectories, coloured by time step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sandra.planning.types import Maneuver
from sandra.reach import Ground, Verdict
from sandra.view import palette
from sandra.view.profile import curves_of
from sandra.view.scene import draw_path, patch
from sandra.view.shapes import View

if TYPE_CHECKING:
    import shapely


def draw_sets(ax: Any, positions: list[shapely.Geometry], horizon: int, colours: Any) -> None:
    """The union of the positions at each step, early steps above late ones.

    So a place has the colour of the first step at which it is reached. The last set has an outline.
    """
    for k, shape in enumerate(positions):
        colour = colours(k / max(1, horizon))
        # The thin edge closes the seams that anti-aliasing leaves between neighbouring steps.
        patch(
            ax,
            shape,
            facecolor=colour,
            edgecolor=colour,
            linewidth=0.25,
            zorder=3.4 - 0.5 * k / max(1, horizon),
        )
    if positions:
        patch(ax, positions[-1], facecolor="none", edgecolor=palette.INK, linewidth=0.8, zorder=3.6)


def draw_trajectory(
    ax: Any, view: View, maneuver: Maneuver, horizon: int, colours: Any, *, every: int = 5
) -> None:
    """The planned path, and the fail-safe one; dots have the colour of their time step."""
    line = view.points(maneuver.states)
    for curve in curves_of(maneuver):
        path = view.points(curve.states)
        for kind, rows in curve.parts:
            draw_path(ax, path[rows], kind, 6.0)
    steps = np.arange(0, len(line), every)
    ax.scatter(
        line[steps, 0],
        line[steps, 1],
        s=13,
        c=[colours(min(1.0, k / max(1, horizon))) for k in steps],
        edgecolors=palette.INK,
        linewidths=0.6,
        zorder=6.1,
    )


def draw_blocking(ax: Any, view: View, verdict: Verdict, base: Ground) -> None:
    """At the first empty step: where the set would have been, and who is in the way there."""
    step = verdict.first_empty_step
    if step is None:
        return
    import shapely

    culprits = [base.prediction.obstacles[index] for index in blocking(verdict, base)]
    room = shapely.union_all([view.occupancy(obstacle, step) for obstacle in culprits])
    light = (*palette.faded(palette.BLOCKING, 0.2), 0.28)
    patch(ax, room, facecolor=light, edgecolor="none", zorder=3.8)
    patch(ax, room, facecolor="none", edgecolor=palette.BLOCKING, linewidth=1.1, zorder=5.3)
    patch(
        ax,
        view.contested(verdict.reachable_set),
        facecolor="none",
        edgecolor=palette.BLOCKING,
        linewidth=0.9,
        linestyle=(0, (1.5, 1.2)),
        zorder=5.4,
    )


def blocking(verdict: Verdict, base: Ground) -> list[int]:
    """Indices of the predicted obstacles that the verdict's reason blames; often none."""
    step, contested = verdict.first_empty_step, verdict.reachable_set.contested
    if step is None or contested is None or verdict.reason is None:
        return []
    there = base.obstacles_at(step, contested)
    named = [
        index
        for index in there
        if f"{base.prediction.obstacles[index].obstacle.id} " in verdict.reason
    ]
    if named:
        return named[:1]
    return there if "traffic" in verdict.reason else []
