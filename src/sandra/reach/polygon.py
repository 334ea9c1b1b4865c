"""Convex polygons in a position-velocity plane, in plain Python.

A polygon is a list of (x, y) corners in counter-clockwise order; one corner is a point and two are
a segment. Every rounding goes outwards: a cut keeps what lies up to `EPS` beyond its line.
"""

from __future__ import annotations

from math import hypot, inf

Point = tuple[float, float]
Polygon = list[Point]

EPS = 1e-9
"""Outward tolerance of a cut [m or m/s]; far above rounding errors, far below any vehicle."""

PARALLEL = 1e-12
"""Corners whose distances to the side differ by no more lie on one line [m^2/s]."""

MAX_CORNERS = 16
"""Above this number of corners, edges are dropped outwards."""


def hull(points: list[Point]) -> Polygon:
    """The convex hull, by Andrew's monotone chain."""
    points = sorted(set(points))
    if len(points) < 3:
        return points
    lower = _chain(points)
    upper = _chain(points[::-1])
    return lower[:-1] + upper[:-1]


def joined(polygons: list[Polygon]) -> Polygon:
    """The convex hull of convex polygons, from their lower and their upper chains apart."""
    lower: list[Point] = []
    upper: list[Point] = []
    for polygon in polygons:
        first, last = polygon.index(min(polygon)), polygon.index(max(polygon))
        lower += _run(polygon, first, last)
        upper += _run(polygon, last, first)
    below, above = _chain(sorted(lower)), _chain(sorted(upper, reverse=True))
    return below[:-1] + above[:-1] or below


def _chain(points: list[Point]) -> Polygon:
    """The points, which are sorted, at which it turns left."""
    chain: Polygon = []
    for x, y in points:
        if chain and chain[-1] == (x, y):
            continue
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2], chain[-1]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                break
            chain.pop()
        chain.append((x, y))
    return chain


def cut(polygon: Polygon, a: float, b: float, c: float) -> Polygon:
    """The part with a x + b y <= c (+ EPS); empty if there is none."""
    c += EPS
    sides = [a * x + b * y - c for x, y in polygon]
    if max(sides) <= 0.0:
        return polygon
    if min(sides) > 0.0:
        return []
    kept: Polygon = []
    n = len(polygon)
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        here, there = sides[i], sides[j]
        if here <= 0.0:
            kept.append(polygon[i])
        if here < 0.0 < there or there < 0.0 < here:
            t = here / (here - there)
            (x, y), (u, w) = polygon[i], polygon[j]
            kept.append((x + t * (u - x), y + t * (w - y)))
    if n == 2:
        return kept[:2]
    return kept


def cut_x(polygon: Polygon, low: float, high: float) -> Polygon:
    """The part with low <= x <= high."""
    if polygon and low > -inf:
        polygon = cut(polygon, -1.0, 0.0, -low)
    if polygon and high < inf:
        polygon = cut(polygon, 1.0, 0.0, high)
    return polygon


def cut_y(polygon: Polygon, low: float, high: float) -> Polygon:
    """The part with low <= y <= high."""
    if polygon and low > -inf:
        polygon = cut(polygon, 0.0, -1.0, -low)
    if polygon and high < inf:
        polygon = cut(polygon, 0.0, 1.0, high)
    return polygon


def propagate(
    polygon: Polygon,
    low: float,
    high: float,
    dt: float,
    speeds: tuple[float, float] = (-inf, inf),
    tight: bool = False,
) -> Polygon:
    """Every (x, v) a double integrator reaches from `polygon` after dt with inputs in [low, high].

    Of these, those whose speed is then in `speeds`. They are cut to it before corners are dropped,
    which does not widen the range of x, and would do so with what is faster than that still there.

    The input may vary in any way within the step. Its response from rest is a lens between two
    parabolas; the parallelogram of the tangents at the lens' two tips encloses it, and its edges
    (dt, 1) and (0, 1) recur from step to step, so that a free set gains two edges per step. If
    `tight`, the hexagon of these tangents and of those half way between the tips, which costs more.
    Söntges & Althoff 2018, Sec. III.
    """
    x0, v0 = low * dt * dt / 2, low * dt
    half = (high - low) * dt / 2
    moved = [(x + v * dt + x0, v + v0) for x, v in polygon]
    edges = [(half * dt, half), (0.0, half)]
    if tight:
        edges = [(half * dt / 2, half / 2), (half * dt / 2, half), (0.0, half / 2)]
    for edge in edges:
        moved = swept(moved, *edge)
    return limit_corners(cut_y(moved, *speeds))


def swept(polygon: Polygon, x: float, y: float) -> Polygon:
    """The Minkowski sum of a polygon and the segment from the origin to (x, y).

    Between its two corners farthest to the sides one chain of edges stays, the other moves along;
    an edge that lies along the way is one corner farther, not parted.
    """
    sides = [y * p - x * q for p, q in polygon]
    right, left = sides.index(max(sides)), sides.index(min(sides))
    if len(polygon) < 3 or sides[right] - sides[left] <= 2 * PARALLEL:
        return hull([*polygon, *((p + x, q + y) for p, q in polygon)])
    on_right, on_left = _alike(sides, right), _alike(sides, left)
    stay = _run(polygon, on_left[1], on_right[0])
    move = _run(polygon, on_right[1], on_left[0])
    return stay + [(p + x, q + y) for p, q in move]


def _alike(values: list[float], at: int) -> tuple[int, int]:
    """First and last of the neighbours in the ring whose values are that of `at`."""
    first = last = at
    while abs(values[first - 1] - values[at]) <= PARALLEL:
        first = (first or len(values)) - 1
    while abs(values[(last + 1) % len(values)] - values[at]) <= PARALLEL:
        last = (last + 1) % len(values)
    return first, last


def _run(ring: Polygon, first: int, last: int) -> Polygon:
    """From one index to another, once around the end if need be."""
    return ring[first : last + 1] if first <= last else ring[first:] + ring[: last + 1]


def limit_corners(polygon: Polygon) -> Polygon:
    """At most `MAX_CORNERS` corners; an edge is dropped by extending its two neighbours outwards.

    The edge whose removal adds the least area goes first; none whose removal would widen the range
    of x or y: what is faster is farther out a step later.
    """
    while len(polygon) > MAX_CORNERS:
        best, at, corner = inf, -1, (0.0, 0.0)
        n = len(polygon)
        for i in range(n):
            gain, point = _extension(
                polygon[i - 1], polygon[i], polygon[(i + 1) % n], polygon[(i + 2) % n]
            )
            if gain < best:
                best, at, corner = gain, i, point
        if at < 0:
            return polygon
        if at + 1 < n:
            polygon = [*polygon[:at], corner, *polygon[at + 2 :]]
        else:
            polygon = [corner, *polygon[1:at]]
    return polygon


def _extension(p: Point, q: Point, r: Point, t: Point) -> tuple[float, Point]:
    """Area added, and new corner, when edge q-r is replaced by extending p-q and t-r."""
    ux, uy = q[0] - p[0], q[1] - p[1]
    wx, wy = r[0] - t[0], r[1] - t[1]
    cross = ux * wy - uy * wx
    # The extensions meet beyond the edge only if the two neighbours turn by less than pi.
    if cross >= -1e-12:
        return inf, q
    lam = ((r[0] - q[0]) * wy - (r[1] - q[1]) * wx) / cross
    if lam < 0.0:
        return inf, q
    x, y = q[0] + lam * ux, q[1] + lam * uy
    if not min(q[0], r[0]) <= x <= max(q[0], r[0]):
        return inf, q
    if not min(q[1], r[1]) <= y <= max(q[1], r[1]):
        return inf, q
    area = abs((r[0] - q[0]) * (y - q[1]) - (r[1] - q[1]) * (x - q[0])) / 2
    return area, (x, y)


def half_planes(polygon: Polygon) -> list[tuple[float, float, float]]:
    """(a, b, c) with a x + b y <= c for each edge; the bounding box for points and segments."""
    found = []
    n = len(polygon)
    if n < 3:
        (low, high), (down, up) = range_x(polygon), range_y(polygon)
        found += [(1.0, 0.0, high), (-1.0, 0.0, -low), (0.0, 1.0, up), (0.0, -1.0, -down)]
    for i in range(n):
        (x, y), (u, w) = polygon[i - 1], polygon[i]
        a, b = w - y, x - u
        size = hypot(a, b)
        if size > 1e-12:
            found.append((a / size, b / size, (a * x + b * y) / size))
            if n == 2:
                found.append((-a / size, -b / size, -(a * x + b * y) / size))
    return found


def intersection(polygon: Polygon, other: Polygon) -> Polygon:
    """The common part of two polygons (+ EPS)."""
    for a, b, c in half_planes(other):
        if not polygon:
            break
        polygon = cut(polygon, a, b, c)
    return polygon


def area(polygon: Polygon) -> float:
    """The enclosed area; 0 for points and segments."""
    return (
        sum(polygon[i - 1][0] * y - x * polygon[i - 1][1] for i, (x, y) in enumerate(polygon)) / 2
    )


def range_x(polygon: Polygon) -> tuple[float, float]:
    """(min x, max x)."""
    xs = [p[0] for p in polygon]
    return min(xs), max(xs)


def range_y(polygon: Polygon) -> tuple[float, float]:
    """(min y, max y)."""
    ys = [p[1] for p in polygon]
    return min(ys), max(ys)


def contains(polygon: Polygon, x: float, y: float, tolerance: float = 1e-6) -> bool:
    """Whether (x, y) lies in the polygon, up to `tolerance`."""
    if len(polygon) == 1:
        return abs(x - polygon[0][0]) <= tolerance and abs(y - polygon[0][1]) <= tolerance
    for i, (qx, qy) in enumerate(polygon):
        px, py = polygon[i - 1]
        ex, ey = qx - px, qy - py
        size = abs(ex) + abs(ey)
        if ex * (y - py) - ey * (x - px) < -tolerance * size:
            return False
    if len(polygon) == 2:
        low, high = range_x(polygon)
        down, up = range_y(polygon)
        return low - tolerance <= x <= high + tolerance and down - tolerance <= y <= up + tolerance
    return True
