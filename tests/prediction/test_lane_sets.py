"""All vehicles at once, against one after another in plain Python."""

from __future__ import annotations

import numpy as np
import pytest

from prediction.slow_lane_sets import Cells, follow_one
from prediction.traffic import bend, fork, straight_road
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_graph import CUT, OWN, LaneGraph, Rules
from sandra.prediction.lane_sets import follow
from sandra.prediction.lane_table import LaneTable
from sandra.scene.types import Lanelet

ROADS = {
    "three lanes": (straight_road(oncoming=True), frozenset({21, 22})),
    "bend": (bend(), frozenset({2})),
    "fork": (fork(), frozenset({1, 3})),
}
STEPS = 12


def vehicle(
    rng: np.random.Generator, table: LaneTable, first_segment: int
) -> tuple[Rules, list[Cells]]:
    """A vehicle somewhere, and in each of the rows the cells that it is said to touch."""
    strips = table.strips
    while True:
        strip = strips[int(rng.integers(len(strips)))]
        i = int(rng.integers(len(strip.s)))
        x, y = strip.centre[i] + rng.uniform(-1.5, 1.5) * strip.across[i]
        places = table.map.places(float(x), float(y), float(rng.uniform(-3, 3)), 0.05)
        if places:
            break
    lanelets = table.map.reachable([p.lanelet for p in places], bool(rng.random() < 0.5))
    rows: list[Cells] = []
    middle = {k: float(rng.uniform(0, len(table.map.strips[k].cells))) for k in lanelets}
    for row in range(2 * STEPS + 1):
        time = row if row <= STEPS else row - STEPS
        cells = {}
        for k in lanelets:
            count = len(table.map.strips[k].cells)
            reach = rng.uniform(0.0, 1.0) * count * (time + 2) / STEPS
            low, high = middle[k] - reach, middle[k] + reach
            cells[k] = (max(0, int(low)), min(count - 1, int(high)))
            if rng.random() < 0.1:
                cells[k] = (count, -1)
        rows.append(cells)
    reversing = bool(rng.random() < 0.4)
    brakes = not reversing and bool(rng.random() < 0.5)
    rules = Rules(
        tuple(places),
        float(rng.choice([np.inf, 4.0, 1.0])),
        reversing,
        bool(rng.random() < 0.5),
        {k: first_segment + n for n, k in enumerate(lanelets)},
        rng.uniform(0.0, 6.0, STEPS) if brakes else None,
    )
    return rules, rows


def gains_of(table: LaneTable, rules: Rules) -> dict[int, list[float]]:
    """Progress made at least in each step, by lanelet."""
    ways = np.zeros(STEPS) if rules.ways is None else rules.ways
    across = rules.lateral_speed if np.isfinite(rules.lateral_speed) else 0.0
    pace, drift = table.pace()
    return {
        strip.id: [max(pace[i] * way - drift[i] * across * 0.1, 0.0) for way in ways]
        if rules.ways is not None
        else [0.0] * STEPS
        for i, strip in enumerate(table.strips)
    }


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ROADS)
def test_together_is_as_one_by_one(name: str, seed: int) -> None:
    lanelets, ego_lane = ROADS[name]
    table = LaneTable.of(build_map(lanelets, 40.0))
    rng = np.random.default_rng(seed)
    rules: list[Rules] = []
    every: list[list[Cells]] = []
    for _ in range(12):
        one, rows = vehicle(rng, table, sum(len(x.segments) for x in rules))
        rules.append(one)
        every.append(rows)
    segments = sum(len(x.segments) for x in rules)
    first = np.full((2 * STEPS + 1, segments), 1 << 30)
    last = np.full((2 * STEPS + 1, segments), -1)
    for one, rows in zip(rules, every, strict=True):
        for row, cells in enumerate(rows):
            for k, (a, b) in cells.items():
                if a <= b:
                    start = table.cell[table.number[k]]
                    first[row, one.segments[k]], last[row, one.segments[k]] = start + a, start + b
    graph = LaneGraph.of(table, rules, ego_lane)
    found = follow(table, graph, first, last, 0.1)
    seen = set()
    for one, rows in zip(rules, every, strict=True):
        gains = gains_of(table, one)
        at, between = follow_one(
            table.map, one, ego_lane, rows[: STEPS + 1], rows[STEPS + 1 :], 0.1, gains
        )
        mine = np.flatnonzero(np.isin(graph.segment, list(one.segments.values())))
        for row, expected in enumerate([*at, *between]):
            here = [n for n in mine.tolist() if found.m[row, n] < np.inf]
            nodes = {(table.strips[graph.lanelet[n]].id, int(graph.how[n])): n for n in here}
            assert set(nodes) == set(expected)
            for node, n in nodes.items():
                got = found.m[row, n], found.low[row, n], found.high[row, n]
                assert got == pytest.approx(expected[node][:3], abs=1e-9)
            seen |= {how for _, how in nodes}
    if name == "three lanes":
        assert {OWN, CUT} & seen


def brute_narrowest(table: LaneTable, lanelet: int, first: int, last: int) -> float:
    start = int(table.cell[lanelet])
    return float(table.strips[lanelet].half[first - start : last - start + 2].min())


@pytest.mark.parametrize("name", ROADS)
def test_look_ups_by_progress_and_width(name: str) -> None:
    lanelets: tuple[Lanelet, ...] = ROADS[name][0]
    table = LaneTable.of(build_map(lanelets, 40.0))
    rng = np.random.default_rng(1)
    lanelet = rng.integers(len(table.strips), size=400)
    progress = rng.uniform(-60.0, 500.0, 400)
    progress[:3] = -np.inf, np.inf, 0.0
    found = table.at_progress(lanelet, progress)
    for number, m, cell in zip(lanelet.tolist(), progress.tolist(), found.tolist(), strict=True):
        strip, start = table.strips[number], int(table.cell[number])
        ahead = np.flatnonzero(strip.ahead >= m - 1e-6)
        assert cell - start == (ahead[0] if len(ahead) else len(strip.cells))
    first = table.cell[lanelet] + (rng.random(400) * np.diff(table.cell)[lanelet]).astype(int)
    last = first + (rng.random(400) * (table.cell[lanelet + 1] - first)).astype(int)
    expected = [brute_narrowest(table, *x) for x in zip(lanelet, first, last, strict=True)]
    assert table.narrowest(lanelet, first, last) == pytest.approx(expected)
