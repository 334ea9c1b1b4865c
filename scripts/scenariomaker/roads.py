"""Roads: reference lines of straights and arcs, and the lanelets laid along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from commonroad.common.common_lanelet import LaneletType, LineMarking, RoadUser, StopLine
from commonroad.scenario.intersection import IncomingGroup, Intersection
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
from commonroad.scenario.traffic_light import (
    TrafficLight,
    TrafficLightCycle,
    TrafficLightCycleElement,
    TrafficLightDirection,
    TrafficLightState,
)
from commonroad.scenario.traffic_sign import (
    TrafficSign,
    TrafficSignElement,
    TrafficSignIDGermany,
    TrafficSignIDZamunda,
)
from numpy.typing import NDArray

Array = NDArray[np.float64]
LANE_WIDTH = 3.5


@dataclass(frozen=True)
class Line:
    """A smooth line: points (n, 2) [m], headings (n,) [rad], arc length s (n,) [m]."""

    points: Array
    headings: Array
    s: Array

    def offset(self, d: float | Array) -> Array:
        """The points moved by d to the left [m], (n, 2)."""
        normal = np.column_stack([-np.sin(self.headings), np.cos(self.headings)])
        shifted: Array = self.points + normal * np.broadcast_to(d, self.s.shape)[:, None]
        return shifted

    def part(self, start: float, end: float) -> Line:
        """The stretch start <= s <= end [m]; both must be among the points."""
        keep = (self.s >= start - 1e-6) & (self.s <= end + 1e-6)
        return Line(self.points[keep], self.headings[keep], self.s[keep])

    def end(self) -> tuple[float, float, float]:
        """(x, y, heading) of the last point."""
        return float(self.points[-1, 0]), float(self.points[-1, 1]), float(self.headings[-1])


def line(
    x: float,
    y: float,
    heading: float,
    pieces: Sequence[tuple[float, float]],
    step: float = 5.0,
    marks: Sequence[float] = (),
) -> Line:
    """A line from (x, y) of pieces (length [m], curvature [1/m]).

    Points lie at most `step` apart; every end of a piece and every s in `marks` is a point.
    """
    ends = np.cumsum([0.0, *(length for length, _ in pieces)])
    stops = np.unique(np.concatenate([ends, np.asarray(marks, dtype=float)]))
    s = np.concatenate(
        [
            np.linspace(a, b, max(1, int(np.ceil((b - a) / step - 1e-9))), endpoint=False)
            for a, b in pairwise(stops)
        ]
        + [stops[-1:]]
    )
    points, headings = np.empty((len(s), 2)), np.empty(len(s))
    for i, value in enumerate(s):
        points[i], headings[i] = _pose(x, y, heading, pieces, float(value))
    return Line(points, headings, s)


def _pose(
    x: float, y: float, heading: float, pieces: Sequence[tuple[float, float]], s: float
) -> tuple[Array, float]:
    position = np.array([x, y])
    for length, curvature in pieces:
        run = min(s, length)
        turn = curvature * run
        # Chord of an arc: the sinc keeps straights and arcs in one formula.
        chord = run * np.sinc(turn / 2 / np.pi)
        direction = heading + turn / 2
        position = position + chord * np.array([np.cos(direction), np.sin(direction)])
        heading += turn
        s -= run
    return position, heading


@dataclass
class Road:
    """A map under construction. Ids are given in the order of creation, from 1."""

    country: str
    network: LaneletNetwork = field(default_factory=LaneletNetwork)
    _lanelets: dict[int, dict[str, object]] = field(default_factory=dict)
    _last_id: int = 0

    def new_id(self) -> int:
        """The next free id."""
        self._last_id += 1
        return self._last_id

    def lanelet(self, left: Array, right: Array, *kinds: LaneletType) -> int:
        """Add a lanelet between two (n, 2) bounds in its direction of travel; return its id."""
        number = self.new_id()
        left, right = np.round(left, 3), np.round(right, 3)
        self._lanelets[number] = {
            "left_vertices": left,
            "right_vertices": right,
            "center_vertices": (left + right) / 2,
            "predecessor": [],
            "successor": [],
            "lanelet_type": set(kinds),
            "traffic_signs": set(),
            "traffic_lights": set(),
            "user_one_way": {RoadUser.VEHICLE},
            "line_marking_left_vertices": LineMarking.SOLID,
            "line_marking_right_vertices": LineMarking.SOLID,
        }
        return number

    def lane(self, along: Line, d: float, *kinds: LaneletType, width: float = LANE_WIDTH) -> int:
        """A lanelet whose centre runs d to the left of a line [m], in the line's direction."""
        return self.lanelet(along.offset(d + width / 2), along.offset(d - width / 2), *kinds)

    def reverse_lane(
        self, along: Line, d: float, *kinds: LaneletType, width: float = LANE_WIDTH
    ) -> int:
        """As `lane`, but driven against the line's direction."""
        left, right = along.offset(d - width / 2), along.offset(d + width / 2)
        return self.lanelet(left[::-1], right[::-1], *kinds)

    def follow(self, *ids: int) -> None:
        """Each lanelet continues into the next."""
        for before, after in pairwise(ids):
            _as_list(self._lanelets[before]["successor"]).append(after)
            _as_list(self._lanelets[after]["predecessor"]).append(before)

    def beside(self, *ids: int) -> None:
        """Lanelets of one direction side by side, from the left to the right."""
        for left, right in pairwise(ids):
            self._lanelets[left] |= {
                "adjacent_right": right,
                "adjacent_right_same_direction": True,
                "line_marking_right_vertices": LineMarking.DASHED,
            }
            self._lanelets[right] |= {
                "adjacent_left": left,
                "adjacent_left_same_direction": True,
                "line_marking_left_vertices": LineMarking.DASHED,
            }

    def facing(self, one: int, other: int, marking: LineMarking = LineMarking.DASHED) -> None:
        """Two lanelets of opposite directions, each on the other's left."""
        for a, b in ((one, other), (other, one)):
            self._lanelets[a] |= {
                "adjacent_left": b,
                "adjacent_left_same_direction": False,
                "line_marking_left_vertices": marking,
            }

    def sign(self, name: str, lanelets: Sequence[int], *values: float | str) -> int:
        """Put up a sign such as `MAX_SPEED` (value in m/s) at the start of some lanelets."""
        ids = TrafficSignIDGermany if self.country == "DEU" else TrafficSignIDZamunda
        number = self.new_id()
        element = TrafficSignElement(ids[name], [str(value) for value in values])
        at = _as_array(self._lanelets[lanelets[-1]]["right_vertices"])[0]
        self.network.add_traffic_sign(TrafficSign(number, [element], set(lanelets), at), set())
        for lanelet in lanelets:
            _as_set(self._lanelets[lanelet]["traffic_signs"]).add(number)
        return number

    def light(self, lanelets: Sequence[int], cycle: Sequence[tuple[str, int]], offset: int) -> int:
        """Put up a light with a stop line at the end of some lanelets.

        `cycle` holds (colour, number of steps); the cycle is entered `offset` steps late.
        """
        number = self.new_id()
        elements = [TrafficLightCycleElement(TrafficLightState(c), n) for c, n in cycle]
        at = _as_array(self._lanelets[lanelets[-1]]["right_vertices"])[-1]
        light = TrafficLight(
            number,
            at,
            TrafficLightCycle(elements, time_offset=offset),
            direction=TrafficLightDirection.ALL,
        )
        self.network.add_traffic_light(light, set())
        for lanelet in lanelets:
            data = self._lanelets[lanelet]
            _as_set(data["traffic_lights"]).add(number)
            data["stop_line"] = StopLine(
                _as_array(data["left_vertices"])[-1],
                _as_array(data["right_vertices"])[-1],
                LineMarking.SOLID,
                traffic_light_ref={number},
            )
        return number

    def intersection(self, arms: Sequence[tuple[set[int], set[int], set[int], set[int]]]) -> None:
        """Arms of (incoming lanelets, successors to the right, straight on, to the left)."""
        number = self.new_id()
        groups = [
            IncomingGroup(
                self.new_id(),
                incoming_lanelets=incoming,
                outgoing_right=right,
                outgoing_straight=straight,
                outgoing_left=left,
            )
            for incoming, right, straight, left in arms
        ]
        self.network.add_intersection(Intersection(number, groups))

    def build(self) -> LaneletNetwork:
        """The finished map."""
        for number, data in self._lanelets.items():
            self.network.add_lanelet(Lanelet(lanelet_id=number, **data))
        return self.network


def _as_list(value: object) -> list[int]:
    assert isinstance(value, list)
    return value


def _as_set(value: object) -> set[int]:
    assert isinstance(value, set)
    return value


def _as_array(value: object) -> Array:
    assert isinstance(value, np.ndarray)
    return value
