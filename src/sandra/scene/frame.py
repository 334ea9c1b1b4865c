"""The curvilinear frame of a lane: s along its centre line, d to the left of it.

At each point of the centre line stands a normal: the bisector of its two segments, long enough to
be 1 across either of them (a mitre). On each segment the normals are interpolated, so the map
(s, d) -> (x, y) is continuous and bilinear there. Because of the mitres d is exactly the distance
across the segment, lines of constant d are parallels of the centre line, and the inverse, in
general a quadratic equation per segment, is a linear one. Beyond both ends the line goes straight
on.

The map is one to one up to the distance at which neighbouring normals meet (the radius of
curvature of the polyline). A jagged line makes that distance small; `smoothed` mends it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError

Array = NDArray[np.float64]

_SAME_POINT = 0.01
"""Neighbouring points closer than this are one point [m]; maps repeat points with some noise."""
_SHARPEST_COS = -0.9
"""A polyline that turns further than this cosine at one point (154 degrees) runs back on itself."""
_BLOCK = 8
"""Segments that share one bounding circle in the search for the foot point."""
_ROUNDING = 1e-9
"""Neighbouring segments overlap by this part, so that no point falls between them."""
_ROWS = 2048
"""Points treated at a time: bounds the memory, stays within the cache."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Frame:
    """A frame along a polyline; immutable, arrays are read-only.

    Args:
        line: (n, 2) points in the direction of travel [m], n >= 2; points less than 1 cm from
            the one before are dropped.

    Raises:
        ScenarioError: fewer than two distinct points, a NaN or infinite coordinate, or a line
            that runs back on itself.
    """

    line: Array
    """(n, 2) points at least 1 cm apart [m]."""
    stations: Array = field(init=False)
    """(n,) arc length s of each point [m]; starts with 0."""
    normals: Array = field(init=False)
    """(n, 2) mitre normals, to the left."""
    _tangents: Array = field(init=False)
    _lengths: Array = field(init=False)
    _skew: Array = field(init=False)
    _headings: Array = field(init=False)
    _curvatures: Array = field(init=False)
    _blocks: Array = field(init=False)
    """(blocks, 8, _BLOCK): per segment what the inverse map needs, see `_on_blocks`."""
    _circles: Array = field(init=False)
    """(3, blocks): centre relative to the first point, and radius, of a circle around a block."""

    def __post_init__(self) -> None:
        line = _clean(self.line)
        delta = np.diff(line, axis=0)
        lengths = np.hypot(delta[:, 0], delta[:, 1])
        tangents = delta / lengths[:, None]
        cosines = np.einsum("ij,ij->i", tangents[:-1], tangents[1:])
        if len(cosines) and cosines.min() < _SHARPEST_COS:
            x, y = line[1 + int(np.argmin(cosines))]
            raise ScenarioError(
                f"a centre line runs back on itself at ({x:.2f}, {y:.2f}): mend that lanelet"
            )
        across = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
        normals = np.empty_like(line)
        normals[0], normals[-1] = across[0], across[-1]
        normals[1:-1] = (across[:-1] + across[1:]) / (1.0 + cosines)[:, None]
        # How far each segment's normals lean along its tangent, at its start and at its end.
        skew = np.stack(
            [
                np.einsum("ij,ij->i", normals[:-1], tangents),
                np.einsum("ij,ij->i", normals[1:], tangents),
            ],
            axis=1,
        )
        course = np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))
        turns = np.diff(course)
        headings = np.concatenate([course[:1], course[:-1] + turns / 2, course[-1:]])
        curvatures = np.zeros(len(line))
        if len(turns):
            curvatures[1:-1] = 2 * turns / (lengths[:-1] + lengths[1:])
            curvatures[0], curvatures[-1] = curvatures[1], curvatures[-2]
        values = {
            "line": line,
            "stations": np.concatenate([[0.0], np.cumsum(lengths)]),
            "normals": normals,
            "_tangents": tangents,
            "_lengths": lengths,
            "_skew": skew,
            "_headings": headings,
            "_curvatures": curvatures,
            "_blocks": _blocks(line, tangents, lengths, skew),
            "_circles": _circles(line),
        }
        for name, value in values.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @property
    def length(self) -> float:
        """Arc length of the line [m]."""
        return float(self.stations[-1])

    @property
    def clearance(self) -> float:
        """The |d| [m] up to which the map is one to one everywhere (inf for a straight line).

        Nearer than that no two neighbouring normals meet; a line that winds back can still come
        close to itself.
        """
        spread = np.abs(self._skew[:, 1] - self._skew[:, 0])
        with np.errstate(divide="ignore"):
            return float((self._lengths / spread).min())

    def to_cartesian(self, points: Array) -> Array:
        """(m, 2) points (s, d) [m] -> (m, 2) points (x, y) [m]."""
        points = _points(points)
        foot, normal = self.across(points[:, 0])
        return np.asarray(foot + points[:, 1:] * normal)

    def across(self, s: Array) -> tuple[Array, Array]:
        """(m,) s [m] -> (m, 2) the point of the line at d = 0 [m], and (m, 2) its normal.

        The normal need not have length 1: (s, d) is the point plus d times it.
        """
        i = np.clip(np.searchsorted(self.stations, s, side="right") - 1, 0, len(self._lengths) - 1)
        along = s - self.stations[i]
        # Normals stay as they are beyond the ends, the foot point goes straight on.
        part = np.clip(along / self._lengths[i], 0.0, 1.0)[:, None]
        foot = self.line[i] + along[:, None] * self._tangents[i]
        return foot, (1.0 - part) * self.normals[i] + part * self.normals[i + 1]

    def to_curvilinear(self, points: Array) -> Array:
        """(m, 2) points (x, y) [m] -> (m, 2) points (s, d) [m]; the nearest foot point is taken.

        Exact (up to rounding) wherever |d| is below the radius of curvature. A point on which no
        normal stands gets the nearest point of the line and its signed distance; points with NaN
        coordinates give NaN.
        """
        points = _points(points)
        result = np.full((len(points), 2), np.nan)
        rows = np.nonzero(np.isfinite(points).all(axis=1))[0]
        for part in _chunks(rows, _ROWS):
            result[part] = self._feet(points[part])
        return result

    def heading(self, s: Array) -> Array:
        """(m,) direction of the line at s [rad]: interpolated, continuous (not wrapped)."""
        result: Array = np.interp(s, self.stations, self._headings)
        return result

    def curvature(self, s: Array) -> Array:
        """(m,) curvature at s [1/m], positive to the left; 0 beyond the ends."""
        result: Array = np.interp(s, self.stations, self._curvatures, left=0.0, right=0.0)
        return result

    def __repr__(self) -> str:
        return f"Frame({len(self.line)} points, {self.length:.1f} m)"

    def _feet(self, points: Array) -> Array:
        """Finite (x, y) -> (s, d), looking only at blocks of segments that can be nearest."""
        x, y = (points - self.line[0]).T
        middle_x, middle_y, radius = self._circles
        distance = np.sqrt((x[:, None] - middle_x) ** 2 + (y[:, None] - middle_y) ** 2)
        # The foot point along a mitre is at most the longest mitre times |d| away.
        reach = distance.min(axis=1) * np.sqrt((self.normals**2).sum(axis=1).max()) + _SAME_POINT
        row, block = np.nonzero(distance <= reach[:, None] + radius)
        s, d, cost = self._on_blocks(x[row], y[row], block)
        # Beyond the ends: a foot on the line itself is preferred to one on the extension, so the
        # distance to compare by is the one to the end point.
        for end, sign, at in ((0, -1.0, 0.0), (-1, 1.0, self.length)):
            tangent, origin = self._tangents[end], self.line[end] - self.line[0]
            over = (x - origin[0]) * tangent[0] + (y - origin[1]) * tangent[1]
            across = (y - origin[1]) * tangent[0] - (x - origin[0]) * tangent[1]
            beyond = np.nonzero(sign * over > 0)[0]
            row = np.concatenate([row, beyond])
            s = np.concatenate([s, at + over[beyond]])
            d = np.concatenate([d, across[beyond]])
            cost = np.concatenate([cost, np.hypot(over[beyond], across[beyond])])
        order = np.lexsort((cost, row))
        first = np.ones(len(order), dtype=bool)
        first[1:] = row[order[1:]] != row[order[:-1]]
        chosen = order[first]
        result = np.stack([s[chosen], d[chosen]], axis=1)
        lost = np.nonzero(~np.isfinite(cost[chosen]))[0]
        for part in _chunks(lost, max(1, _ROWS * _BLOCK // len(self._lengths))):
            result[part] = self._nearest(points[part])
        return result

    def _on_blocks(self, x: Array, y: Array, block: NDArray[np.int_]) -> tuple[Array, Array, Array]:
        """For each point the s, d and |d| on the nearest segment of one block.

        |d| is inf where no normal of the block stands on the point.
        """
        coefficients = self._blocks[block]
        tx, ty, t0, d0, length, start, spread, station = (coefficients[:, k] for k in range(8))
        x, y = x[:, None], y[:, None]
        d = y * tx - x * ty - d0
        # Along the segment t = part * length + d * (start + part * spread): solve for part.
        width = length + d * spread
        with np.errstate(divide="ignore", invalid="ignore"):
            part = (x * tx + y * ty - t0 - d * start) / width
        stands = (width > 0) & (part >= -_ROUNDING) & (part <= 1 + _ROUNDING)
        cost = np.where(stands, np.abs(d), np.inf)
        best = np.arange(len(block)), np.argmin(cost, axis=1)
        return (station + part * length)[best], d[best], cost[best]

    def _nearest(self, points: Array) -> Array:
        """The nearest point of the line and the signed distance, where no normal stands."""
        offset = points[:, None, :] - self.line[None, :-1]
        t = np.clip(np.einsum("mni,ni->mn", offset, self._tangents), 0.0, self._lengths)
        gap = offset - t[..., None] * self._tangents
        distance = np.hypot(gap[..., 0], gap[..., 1])
        i = np.argmin(distance, axis=1)
        pick = np.arange(len(points)), i
        tangent, away = self._tangents[i], gap[pick]
        left = away[:, 1] * tangent[:, 0] - away[:, 0] * tangent[:, 1] >= 0
        return np.stack(
            [self.stations[i] + t[pick], np.where(left, 1.0, -1.0) * distance[pick]], axis=1
        )


def _blocks(line: Array, tangents: Array, lengths: Array, skew: Array) -> Array:
    origin = line[:-1] - line[0]
    rows = np.stack(
        [
            tangents[:, 0],
            tangents[:, 1],
            origin[:, 0] * tangents[:, 0] + origin[:, 1] * tangents[:, 1],
            origin[:, 1] * tangents[:, 0] - origin[:, 0] * tangents[:, 1],
            lengths,
            skew[:, 0],
            skew[:, 1] - skew[:, 0],
            np.concatenate([[0.0], np.cumsum(lengths)[:-1]]),
        ]
    )
    # The last block is filled up with copies of the last segment.
    missing = -rows.shape[1] % _BLOCK
    rows = np.concatenate([rows, np.repeat(rows[:, -1:], missing, axis=1)], axis=1)
    return np.ascontiguousarray(rows.reshape(8, -1, _BLOCK).transpose(1, 0, 2))


def _circles(line: Array) -> Array:
    n = len(line) - 1
    first = np.arange(0, n, _BLOCK)
    members = line[np.minimum(first[:, None] + np.arange(_BLOCK + 1), n)] - line[0]
    middle = members[np.arange(len(first)), (np.minimum(first + _BLOCK, n) - first) // 2]
    radius = np.linalg.norm(members - middle[:, None], axis=2).max(axis=1)
    return np.stack([middle[:, 0], middle[:, 1], radius])


def smoothed(line: Array, *, step: float = 1.0, passes: int = 8) -> Array:
    """Resample a line to about `step` and round its kinks, so that its normals meet further off.

    Points closer than a quarter of `step` to the one before are dropped, the line is resampled at
    equal distances, then averaged `passes` times with weights 1/4, 1/2, 1/4; both ends stay. It
    moves towards the inside of a bend by about passes * step^2 / 4 times
    the curvature (2 cm at a radius of 100 m), by less than half a `step` at a single kink.

    Args:
        line: (n, 2) points [m]. step: distance of the new points [m]. passes: number of averages.

    Returns:
        (m, 2) points [m].
    """
    line = _clean(line, step / 4)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, s[-1], max(2, round(s[-1] / step) + 1))
    result = np.stack([np.interp(at, s, line[:, 0]), np.interp(at, s, line[:, 1])], axis=1)
    for _ in range(passes):
        result[1:-1] = 0.25 * result[:-2] + 0.5 * result[1:-1] + 0.25 * result[2:]
    return result


def _clean(line: Array, apart: float = _SAME_POINT) -> Array:
    """The same line without points closer than `apart` to the one before; the last one stays."""
    line = np.array(line, dtype=float)
    if line.ndim != 2 or line.shape[1] != 2:
        raise ScenarioError(f"a centre line needs (n, 2) points, got an array of {line.shape}")
    if not np.isfinite(line).all():
        raise ScenarioError("a centre line has a NaN or infinite coordinate: mend that lanelet")
    keep = [0] if len(line) else []
    for k in range(1, len(line)):
        if math.dist(line[k], line[keep[-1]]) >= apart:
            keep.append(k)
    last = len(line) - 1
    if len(keep) > 1:
        keep[-1] = last
    elif keep and math.dist(line[0], line[last]) >= _SAME_POINT:
        keep.append(last)
    if len(keep) < 2:
        raise ScenarioError("a centre line has fewer than two distinct points: mend that lanelet")
    return line[keep]


def _points(points: Array) -> Array:
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must be an (m, 2) array, got {points.shape}")
    return points


def _chunks(rows: NDArray[np.int_], size: int) -> Iterator[NDArray[np.int_]]:
    for k in range(0, len(rows), size):
        yield rows[k : k + size]
