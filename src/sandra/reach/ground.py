"""From a scene and a prediction to what the kernel reads: the ground on which all pairs stand.

Everything here is the same for all twelve pairs and computed once. Collisions are decided with
the disc inscribed in the ego's body, which lies within the body whatever its heading is.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.prediction.types import Prediction
from sandra.reach.bands import Band, Leader, Limit, band, leaders, limits
from sandra.reach.lattice import Lattice, Mask
from sandra.reach.polygon import Polygon
from sandra.scene.types import Region as Occupied
from sandra.scene.types import Scene
from sandra.settings import Settings

Array = NDArray[np.float64]
Window = tuple[int, int, int, int, Mask]
"""Cells i0 <= i < i1, j0 <= j < j1 and which of them are forbidden."""

LATERAL_REACH = 1.0
"""The lattice reaches so far beyond the outermost lane borders [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The lattice, the ego's initial set, and the forbidden cells by cause."""

    scene: Scene
    prediction: Prediction
    settings: Settings
    lattice: Lattice
    lon: Polygon
    lat: Polygon
    curvature: tuple[Array, Array]
    """Lowest and highest curvature of the reference line in each column [1/m]."""
    off_road: Mask
    by_obstacle: tuple[tuple[tuple[Window, ...], ...], ...]
    """For each predicted obstacle and each step, its forbidden windows."""
    forbidden: tuple[Mask, ...]
    """Union of all causes at each step."""
    bands: tuple[tuple[str, Band], ...]
    """(relation, band) of the lanes that rules and actions speak of."""
    leaders: tuple[tuple[tuple[Leader, ...], ...], ...]
    """For each band and each step, the vehicles in it."""
    limits: tuple[Limit, ...]
    """Signed speed limits along s."""

    @property
    def horizon(self) -> int:
        """Number of steps h."""
        return self.prediction.horizon

    def forbidden_without(self, obstacle: int | None, road: bool = True) -> tuple[Mask, ...]:
        """The union of all causes but one obstacle (its index) or, `road` False, the border."""
        kept = [w for i, w in enumerate(self.by_obstacle) if i != obstacle]
        return _union(self.off_road if road else np.zeros_like(self.off_road), kept, self.horizon)

    def obstacles_at(self, k: int, cells: Mask) -> list[int]:
        """Indices of the obstacles that forbid some of `cells` at step k, most cells first."""
        counts = []
        for index, steps in enumerate(self.by_obstacle):
            count = sum(
                int((mask & cells[i0:i1, j0:j1]).sum()) for i0, i1, j0, j1, mask in steps[k]
            )
            if count:
                counts.append((-count, index))
        return [index for _, index in sorted(counts)]


def ground(scene: Scene, prediction: Prediction, settings: Settings) -> Ground:
    """Prepare the reachability analysis of `scene` under `prediction`.

    Raises:
        SettingsError: if the prediction was made with another time increment.
    """
    if abs(prediction.dt - scene.dt) > 1e-9:
        raise SettingsError(
            f"the prediction has dt = {prediction.dt} s, the scene {scene.dt} s: predict again"
        )
    lon, lat = _initial(scene, settings)
    lattice = _lattice(scene, prediction.horizon, lon, lat, settings)
    s_lines, d_lines = lattice.corners()
    corners = _grid(scene, s_lines, d_lines)
    off_road = _off_road(scene, lattice)
    bulge = _bulge(scene, lattice)
    windows = _windows(scene, prediction, lattice, corners, scene.ego.width / 2 - bulge)
    samples = np.linspace(0.0, 1.0, 5)
    kappa = scene.frame.curvature((s_lines[:-1, None] + lattice.ds * samples).ravel())
    kappa = kappa.reshape(lattice.columns, samples.size)
    radius = hypot(scene.ego.length, scene.ego.width) / 2
    known = ("current", "left", "right", "opposite")
    lanes = tuple(lane for lane in scene.lanes if lane.relation in known)
    bands = tuple(
        (lane.relation, band(scene.frame, lattice, lane.left, lane.right, radius)) for lane in lanes
    )
    return Ground(
        scene,
        prediction,
        settings,
        lattice,
        lon,
        lat,
        (kappa.min(axis=1), kappa.max(axis=1)),
        off_road,
        windows,
        _union(off_road, windows, prediction.horizon),
        bands,
        leaders(scene, prediction, settings, lanes),
        limits(scene, tuple(x for x in (scene.current, scene.left, scene.right) if x)),
    )


def _initial(scene: Scene, settings: Settings) -> tuple[Polygon, Polygon]:
    """The initial state in the lane frame, widened by its measurement uncertainty."""
    s, d, heading, _ = scene.ego_curvilinear
    kappa = float(scene.frame.curvature(np.array([s]))[0])
    speed = scene.ego.state.speed
    v_s = speed * cos(heading) / (1.0 - kappa * d)
    v_d = speed * sin(heading)
    ds, dv = settings.s_uncertainty, settings.v_uncertainty
    return _box(s, v_s, ds, dv), _box(d, v_d, ds, dv)


def _box(x: float, v: float, dx: float, dv: float) -> Polygon:
    if dx == 0.0 and dv == 0.0:
        return [(x, v)]
    if dx == 0.0:
        return [(x, v - dv), (x, v + dv)]
    if dv == 0.0:
        return [(x - dx, v), (x + dx, v)]
    return [(x - dx, v - dv), (x + dx, v - dv), (x + dx, v + dv), (x - dx, v + dv)]


def _lattice(scene: Scene, horizon: int, lon: Polygon, lat: Polygon, settings: Settings) -> Lattice:
    """Cells over all that the free set can touch, laterally as far as the road goes."""
    duration = horizon * scene.dt
    farthest = max(
        s + min(v * duration + settings.a_lon_max * duration**2 / 2, settings.v_max * duration)
        if v <= settings.v_max
        else s + v * duration
        for s, v in lon
    )
    # Within a step the speed may leave its bounds and come back: by the end of it, a quarter of
    # a dt^2 further at most.
    swing = horizon * max(abs(settings.a_lon_min), abs(settings.a_lon_max)) * scene.dt**2 / 4
    s_range = (min(s for s, _ in lon) - swing - 1.0, farthest + swing + 1.0)
    reach = [
        d + sign * (abs(v) * duration + settings.a_lat_max * duration**2 / 2)
        for d, v in lat
        for sign in (-1.0, 1.0)
    ]
    low, high = min(reach), max(reach)
    near = _borders_between(scene, s_range, max(abs(low), abs(high)))
    if near.size:
        low = max(low, min(float(near.min()), min(d for d, _ in lat)) - LATERAL_REACH)
        high = min(high, max(float(near.max()), max(d for d, _ in lat)) + LATERAL_REACH)
    return Lattice.around(s_range, (low, high), settings.cell_s, settings.cell_d)


def _borders_between(scene: Scene, s_range: tuple[float, float], reach: float) -> Array:
    """d of points of all lanelets' borders, no more than 1 m apart, within a range of s."""
    ego = np.array([scene.ego.state.x, scene.ego.state.y])
    farthest = s_range[1] - s_range[0] + 2 * reach + abs(scene.ego_curvilinear[1])
    found = []
    for lanelet in scene.lanelets:
        for line in (lanelet.left, lanelet.right):
            lengths = np.hypot(*np.diff(line, axis=0).T)
            at = np.concatenate([[0.0], np.cumsum(lengths)])
            if np.hypot(*(line - ego).T).min() - lengths.max(initial=0.0) > farthest:
                continue
            dense = np.union1d(at, np.arange(0.0, at[-1], 1.0))
            found.append(np.column_stack([np.interp(dense, at, line[:, i]) for i in (0, 1)]))
    if not found:
        return np.zeros(0)
    every = np.vstack(found)
    points = scene.frame.to_curvilinear(every[np.hypot(*(every - ego).T) <= farthest])
    inside = (points[:, 0] >= s_range[0]) & (points[:, 0] <= s_range[1])
    return np.asarray(points[inside, 1])


def _grid(scene: Scene, s: Array, d: Array) -> Array:
    """(len(s), len(d), 2) Cartesian points of a grid in the lane frame."""
    mesh = np.stack(np.meshgrid(s, d, indexing="ij"), axis=-1)
    points: Array = scene.frame.to_cartesian(mesh.reshape(-1, 2)).reshape(mesh.shape)
    return points


def _bulge(scene: Scene, lattice: Lattice) -> Array:
    """(columns,) how far a cell's image can bulge beyond the hull of its corners [m].

    Lines of constant d are polylines with the corners of the reference line. One of length c that
    turns by phi leaves its chord by at most a quarter of c phi.
    """
    frame = scene.frame
    s, d = lattice.corners()
    course = np.diff(frame.line, axis=0)
    course = np.unwrap(np.arctan2(course[:, 1], course[:, 0]))
    turns = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(course)))])
    marks = frame.stations[1:-1]
    first = np.searchsorted(marks, s[:-1], side="left")
    last = np.searchsorted(marks, s[1:], side="right")
    turn = turns[last] - turns[first]
    # The reference line's curvature at its corners, where neighbouring segments are shortest.
    lengths = np.diff(frame.stations)
    shortest = np.minimum(lengths[:-1], lengths[1:])
    bend = np.abs(np.diff(course)) / shortest
    sharpest = np.array(
        [
            bend[max(0, a - 1) : b + 1].max(initial=0.0)
            for a, b in zip(first.tolist(), last.tolist(), strict=True)
        ]
    )
    widest = 1.0 + sharpest * float(np.abs(d).max())
    bulge: Array = lattice.ds * widest * turn / 4 + 1e-6
    return bulge


def _off_road(scene: Scene, lattice: Lattice) -> Mask:
    """Cells in which the inscribed disc crosses the border of the road, wherever its centre is."""
    import shapely

    polygons = [lanelet.area() for lanelet in scene.lanelets]
    # Neighbouring lanelets may leave slits between them that are no border.
    road = shapely.union_all(polygons).buffer(0.1).buffer(-0.1)
    s, d = lattice.centers()
    grid = _grid(scene, s, d)
    # Half a cell's diagonal, stretched by curvature, goes to the ego: only sure crossings count.
    stretch = 1.0 + float(np.abs(scene.frame.curvature(s)).max()) * float(np.abs(d).max())
    slack = np.hypot(lattice.ds * stretch, lattice.dd) / 2
    eroded = road.buffer(float(slack) - scene.ego.width / 2)
    shapely.prepare(eroded)
    return np.asarray(~shapely.contains_xy(eroded, grid[..., 0], grid[..., 1]))


def _windows(
    scene: Scene, prediction: Prediction, lattice: Lattice, corners: Array, inscribed: Array
) -> tuple[tuple[tuple[Window, ...], ...], ...]:
    """Forbidden cells of each obstacle at each step.

    A cell is forbidden if its four corners are within reach of one convex region: then, up to the
    bulge already subtracted from `inscribed` (one value per column), so is all of the cell.
    """
    entries = [
        (o, k, region)
        for o, obstacle in enumerate(prediction.obstacles)
        for k, regions in enumerate(obstacle.at)
        for region in regions
    ]
    found: list[list[list[Window]]] = [
        [[] for _ in range(prediction.horizon + 1)] for _ in prediction.obstacles
    ]
    if entries:
        sizes = [len(region.vertices) for _, _, region in entries]
        points = scene.frame.to_curvilinear(np.vstack([r.vertices for _, _, r in entries]))
        parts = np.split(points, np.cumsum(sizes)[:-1])
        for (o, k, region), part in zip(entries, parts, strict=True):
            window = _window(lattice, corners, region, part, inscribed)
            if window is not None:
                found[o][k].append(window)
    return tuple(tuple(tuple(step) for step in steps) for steps in found)


def _window(
    lattice: Lattice, corners: Array, region: Occupied, curvilinear: Array, inscribed: Array
) -> Window | None:
    reach = region.radius + inscribed
    farthest = float(reach.max()) + 1.0
    low, high = curvilinear.min(axis=0) - farthest, curvilinear.max(axis=0) + farthest
    i0, i1, j0, j1 = lattice.touched(low[0], high[0], low[1], high[1])
    if i0 >= i1 or j0 >= j1:
        return None
    away = distance(corners[i0 : i1 + 1, j0 : j1 + 1].reshape(-1, 2), region.vertices)
    away = away.reshape(i1 - i0 + 1, j1 - j0 + 1)
    away = np.maximum(away[:-1], away[1:])
    mask = np.maximum(away[:, :-1], away[:, 1:]) <= reach[i0:i1, None]
    return (i0, i1, j0, j1, mask) if mask.any() else None


def distance(points: Array, polygon: Array) -> Array:
    """(m,) distances from (m, 2) points to a convex polygon (n, 2), 0 inside [m]."""
    if len(polygon) == 1:
        return np.asarray(np.hypot(points[:, 0] - polygon[0, 0], points[:, 1] - polygon[0, 1]))
    edges = np.roll(polygon, -1, axis=0) - polygon
    offsets = points[:, None, :] - polygon[None, :, :]
    squared = np.maximum((edges**2).sum(axis=1), 1e-18)
    along = np.clip((offsets * edges).sum(axis=2) / squared, 0.0, 1.0)
    gaps = offsets - along[:, :, None] * edges
    shortest = np.sqrt((gaps**2).sum(axis=2).min(axis=1))
    if len(polygon) > 2:
        turned = edges[:, 0] * offsets[:, :, 1] - edges[:, 1] * offsets[:, :, 0]
        inside = (turned >= 0.0).all(axis=1) | (turned <= 0.0).all(axis=1)
        shortest[inside] = 0.0
    return np.asarray(shortest)


def _union(
    off_road: Mask,
    windows: tuple[tuple[tuple[Window, ...], ...], ...] | list[tuple[tuple[Window, ...], ...]],
    horizon: int,
) -> tuple[Mask, ...]:
    masks = [off_road.copy() for _ in range(horizon + 1)]
    for steps in windows:
        for mask, step in zip(masks, steps, strict=True):
            for i0, i1, j0, j1, cells in step:
                mask[i0:i1, j0:j1] |= cells
    for mask in masks:
        mask.setflags(write=False)
    return tuple(masks)
