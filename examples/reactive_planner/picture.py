"""The picture of the example: the corridor, our witness, and what the planner drives in it."""

from pathlib import Path

import numpy as np

import sandra
from sandra.certify import Basis, Proven, certify
from sandra.view import legend, palette
from sandra.view.chart import TICKS, fit
from sandra.view.driven import Driven, Strip, others_at
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page
from sandra.view.profile import Curve, times_of
from sandra.view.scene import axes_in, draw_bodies, draw_map, draw_occupancies, draw_path, near
from sandra.view.sets import draw_sets
from sandra.view.shapes import View, bounds, grown
from sandra.view.table import pair_name

WIDTH = 11.0


def curves(verdicts: sandra.Verdicts, verdict: sandra.Verdict, states: list) -> list[Curve]:
    """Our witness, the planner's trajectory, and its fail-safe; those that there are."""
    dt = verdicts.ground.scene.dt
    found = []
    ours = certify(Basis.of(verdicts.ground), verdicts[0], verdicts.rules)
    if isinstance(ours.proof, Proven):
        rows = ours.proof.witness.every(dt)
        found.append(Curve("planned", times_of(rows, dt), rows))
    if isinstance(verdict.proof, Proven):
        rows = verdict.proof.witness.every(dt)
        found.append(Curve("given", times_of(rows, dt), rows))
        rest = verdict.proof.fail_safe.trajectory
        rows = rest.every(dt)
        found.append(Curve("fail-safe", rest.start + times_of(rows, dt), rows))
    else:
        rows = np.array(states)
        change = np.diff(rows[:, 3], append=rows[-1, 3]) / dt
        found.append(Curve("given", dt * np.arange(len(rows)), np.column_stack([rows, change])))
    return found


def draw(
    verdicts: sandra.Verdicts, verdict: sandra.Verdict, states: list, path: Path, dpi: int = 130
) -> Path:
    """Draw map, strips and profiles."""
    base = verdicts.ground
    view, colours = View.of(base.scene), palette.time_map()
    positions = view.positions(verdicts[0].reachable_set.corridor())
    lines = curves(verdicts, verdict, states)
    inner = WIDTH - 2 * MARGIN
    focus = bounds(positions)
    window, high = fit(grown(focus, 8.0, 4.0), inner - TICKS, (2.0, 3.6), least=50.0)
    names = {
        "planned": "our witness",
        "given": "commonroad-reactive-planner",
        "fail-safe": "fail-safe that continues it",
    }
    entries = [("ego", "ego"), ("other", "others now"), ("lane", "current lane")]
    entries += [(curve.kind, names[curve.kind]) for curve in lines]
    entries.append(("occupancy", "where others may be until the horizon"))
    strip = legend.height(inner - TICKS, entries, bar=True)
    strips = [
        Strip(
            curve,
            f"{names[curve.kind]}; the others as predicted for {curve.times[-1]:.1f} s",
            others_at(base, view, float(curve.times[-1])),
        )
        for curve in lines
        if curve.kind != "fail-safe"
    ]
    driven = Driven.of(view, strips, inner, lines)
    page = Page(WIDTH, 2 * MARGIN + 0.65 + high + 0.2 + strip + 0.2 + driven.height)
    left, top = MARGIN + TICKS, MARGIN
    title = f"{base.scene.name}: corridor of {pair_name(verdict)}, and two planners in it"
    page.text(MARGIN, top, title, size=12.0, bold=True)
    style = palette.STATUS[verdict.status]
    said = verdict.reason or "with a fail-safe continuation, accepted by the independent checker"
    line = f"{names['given']}: {style.symbol} {verdict.status.value}, {said}"
    page.text(MARGIN, top + 0.28, fitted(line, inner, 9.0), size=9.0, color=style.colour)
    top += 0.65
    ax = page.axes(left, top, inner - TICKS, high)
    axes_in(ax, window)
    draw_map(ax, view, window)
    draw_occupancies(ax, view, window, near(view, window, base.prediction))
    draw_sets(ax, positions, base.horizon, colours)
    draw_bodies(ax, view, window)
    for curve in lines:
        draw_path(ax, view.points(curve.states), curve.kind, 6.0)
    top += high + 0.2
    legend.draw(page, left, top, inner - TICKS, entries, base.horizon, colours)
    driven.draw(page, view, base, top + strip + 0.2)
    return page.save(path, dpi)
