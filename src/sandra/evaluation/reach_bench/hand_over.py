"""What the peer is given: the same problem as ours, as plain data."""

from __future__ import annotations

from math import cos, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.reach import Ground
from sandra.reach.lattice import Mask, boxes
from sandra.scene.types import Lanelet, Region

Array = NDArray[np.float64]
Rectangle = tuple[float, float, float, float]
"""(s_low, s_high, d_low, d_high) in the peer's frame [m]."""

BEYOND = 200.0
"""The reference line goes straight on at either end [m]: borders partly beyond its ends are dropped
by the peer."""
CORNERS = 32
"""A disc becomes a polygon with so many corners, half inside of it, half outside."""
FAR = 1e3
"""Boxes close what lies beyond the lattice up to so far from it [m]."""


def problem_of(base: Ground) -> dict[str, Any]:
    """The request that describes one problem to the peer's `Worker.scene`."""
    settings, ego = base.settings, base.scene.ego
    (s_low, s_high), (v_low, v_high) = _ranges(base.lon)
    (d_low, d_high), (w_low, w_high) = _ranges(base.lat)
    line, start = reference_line(base)
    return {
        "do": "scene",
        "dt": base.scene.dt,
        "horizon": base.horizon,
        "line": line.tolist(),
        "lanelets": [_lanelet(lanelet) for lanelet in base.scene.lanelets],
        "obstacles": _obstacles(base),
        "initial": {
            "state": [ego.state.x, ego.state.y, ego.state.heading, ego.state.speed],
            "position": [(s_low + s_high) / 2 - start, (d_low + d_high) / 2],
            "velocity": [(v_low + v_high) / 2, (w_low + w_high) / 2],
        },
        "uncertainty": (s_high - s_low) / 2,
        "bounds": {
            "v_lon_min": 0.0,
            "v_lon_max": settings.v_max,
            "v_lat_min": -settings.v_lat_max,
            "v_lat_max": settings.v_lat_max,
            "a_lon_min": settings.a_lon_min,
            "a_lon_max": settings.a_lon_max,
            "a_lat_min": -settings.a_lat_max,
            "a_lat_max": settings.a_lat_max,
        },
        "length": ego.length,
        "width": ego.width,
    }


def reference_line(base: Ground) -> tuple[Array, float]:
    """The part of our reference line under the lattice, straight on at both ends.

    The peer's coordinate system is nowhere wider than its sharpest bend allows, so bends that the
    set cannot reach are left away.

    Returns:
        (n, 2) points [m], and the s of its first point in our frame [m].
    """
    frame = base.scene.frame
    s = base.lattice.corners()[0]
    # One point more at either end, so that the normals under the lattice stay as they are.
    low = max(0, int(np.searchsorted(frame.stations, s[0], side="right")) - 2)
    high = int(np.searchsorted(frame.stations, s[-1])) + 2
    line = frame.line[low:high]
    first = line[0] + BEYOND * _direction(line[0] - line[1])
    last = line[-1] + BEYOND * _direction(line[-1] - line[-2])
    return np.array([first, *line, last]), float(frame.stations[low]) - BEYOND


def _direction(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def forbidden_boxes(base: Ground) -> list[list[Rectangle]]:
    """Exactly our forbidden cells of each step, as boxes."""
    return [_boxes(base, mask) for mask in base.forbidden]


def beyond_the_road(base: Ground) -> list[Rectangle]:
    """Boxes over all that lies off the road.

    To the peer the border of the road is a line as thick as the ego is wide. With long steps its
    set jumps over it, and then grows where nobody drives.
    """
    start = reference_line(base)[1]
    s, d = base.lattice.corners()
    s_low, s_high, d_low, d_high = s[0] - start, s[-1] - start, d[0], d[-1]
    around = [
        (s_low - FAR, s_high + FAR, d_high, d_high + FAR),
        (s_low - FAR, s_high + FAR, d_low - FAR, d_low),
        (s_low - FAR, s_low, d_low, d_high),
        (s_high, s_high + FAR, d_low, d_high),
    ]
    return [*_boxes(base, base.off_road), *around]


def in_our_frame(base: Ground, found: list[list[float]]) -> list[Rectangle]:
    """Boxes (s_low, d_low, s_high, d_high) in the peer's frame, as our rectangles."""
    start = reference_line(base)[1]
    return [(a + start, b + start, c, d) for a, c, b, d in found]


def _boxes(base: Ground, mask: Mask) -> list[Rectangle]:
    start = reference_line(base)[1]
    found = [base.lattice.bounds(box) for box in boxes(mask)]
    return [(a - start, b - start, c, d) for a, b, c, d in found]


def _ranges(polygon: list[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(min(values), max(values)) for values in zip(*polygon, strict=True)]


def _lanelet(lanelet: Lanelet) -> dict[str, Any]:
    return {
        "id": lanelet.id,
        "left": lanelet.left.tolist(),
        "right": lanelet.right.tolist(),
        "predecessors": list(lanelet.predecessors),
        "successors": list(lanelet.successors),
        "adjacent_left": lanelet.adjacent_left,
        "adjacent_right": lanelet.adjacent_right,
    }


def _obstacles(base: Ground) -> list[dict[str, Any]]:
    """Each predicted obstacle that is there at some step, with its regions as polygons."""
    first = max((lanelet.id for lanelet in base.scene.lanelets), default=0) + 1
    found = []
    for index, predicted in enumerate(base.prediction.obstacles):
        at = [[polygon(region).tolist() for region in regions] for regions in predicted.at]
        if any(at):
            static = all(step == at[0] for step in at)
            found.append({"id": first + index, "static": static, "at": at})
    return found


def polygon(region: Region) -> Array:
    """(n, 2) corners of a region; the disc that widens it is rounded to a polygon."""
    if region.radius == 0.0:
        return region.vertices
    import shapely

    angles = 2 * pi / CORNERS * np.arange(CORNERS)
    radius = region.radius * (1.0 + 1.0 / cos(pi / CORNERS)) / 2
    disc = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    points = (region.vertices[:, None] + disc).reshape(-1, 2)
    outline: Array = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(points)))
    return outline[:-1]
