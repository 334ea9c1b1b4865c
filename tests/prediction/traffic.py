"""Made-up roads, scenes, and thousands of vehicles that drive on them within the assumptions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sandra.scene.frame import Frame
from sandra.scene.types import Ego, Lane, Lanelet, Obstacle, Region, Scene, State

CAR = Region.rectangle(4.5, 1.8)
WIDTH = 3.5


def lanelet(
    identifier: int,
    right: np.ndarray,
    left: np.ndarray,
    *,
    successors: tuple[int, ...] = (),
    predecessors: tuple[int, ...] = (),
    adjacent_left: tuple[int, bool] | None = None,
    adjacent_right: tuple[int, bool] | None = None,
) -> Lanelet:
    return Lanelet(
        identifier,
        left,
        right,
        (),
        successors,
        predecessors,
        adjacent_left,
        adjacent_right,
        None,
    )


def line(y: float, start: float, end: float, step: float = 20.0) -> np.ndarray:
    x = np.linspace(start, end, max(2, int((end - start) / step) + 1))
    return np.column_stack([x, np.full_like(x, y)])


def arc(radius: float, start: float, end: float, centre: tuple[float, float]) -> np.ndarray:
    """A left-hand (radius > 0) or right-hand bend between two angles of travel."""
    angle = np.linspace(start, end, max(3, int(abs(radius * (end - start)) / 2.0)))
    return np.array(centre) + radius * np.column_stack([np.sin(angle), -np.cos(angle)])


def straight_road(
    lanes: int = 3, length: float = 400.0, oncoming: bool = False
) -> tuple[Lanelet, ...]:
    """Lanes 1, 2, ... from right to left, each of two lanelets (10 i + 1, 10 i + 2)."""
    half = length / 2
    found = []
    for i in range(1, lanes + 1):
        right, left = WIDTH * (i - 1), WIDTH * i
        for part, (start, end) in enumerate(((-half, 0.0), (0.0, half)), start=1):
            top = (10 * (i + 1) + part, True) if i < lanes else None
            if i == lanes and oncoming:
                top = (90 + part, False)
            found.append(
                lanelet(
                    10 * i + part,
                    line(right, start, end),
                    line(left, start, end),
                    successors=(10 * i + 2,) if part == 1 else (),
                    predecessors=(10 * i + 1,) if part == 2 else (),
                    adjacent_left=top,
                    adjacent_right=(10 * (i - 1) + part, True) if i > 1 else None,
                )
            )
    if oncoming:
        right, left = WIDTH * (lanes + 1), WIDTH * lanes
        for part, (start, end) in enumerate(((-half, 0.0), (0.0, half)), start=1):
            found.append(
                lanelet(
                    90 + part,
                    line(right, start, end)[::-1],
                    line(left, start, end)[::-1],
                    successors=(91,) if part == 2 else (),
                    predecessors=(92,) if part == 1 else (),
                    adjacent_left=(10 * lanes + part, False),
                )
            )
    return tuple(found)


def bend(radius: float = 60.0) -> tuple[Lanelet, ...]:
    """Two lanes (1 right, 2 left) in a left-hand bend of half a turn around (0, radius)."""
    centre = (0.0, radius)
    borders = [arc(r, -1.2, 2.0, centre) for r in (radius + WIDTH, radius, radius - WIDTH)]
    # Adjacent lanelets share their border; all have the same number of points.
    n = min(map(len, borders))
    borders = [
        np.array(centre) + r * np.column_stack([np.sin(t), -np.cos(t)])
        for r in (radius + WIDTH, radius, radius - WIDTH)
        for t in [np.linspace(-1.2, 2.0, n)]
    ]
    return (
        lanelet(1, borders[0], borders[1], adjacent_left=(2, True)),
        lanelet(2, borders[1], borders[2], adjacent_right=(1, True)),
    )


def fork(radius: float = 30.0) -> tuple[Lanelet, ...]:
    """One lane along +x up to x = 0, then straight on (2) or into a left-hand bend (3)."""
    half = WIDTH / 2
    centre = (0.0, radius)
    return (
        lanelet(1, line(-half, -150, 0), line(half, -150, 0), successors=(2, 3)),
        lanelet(2, line(-half, 0, 150), line(half, 0, 150), predecessors=(1,)),
        lanelet(
            3,
            np.array(centre)
            + (radius + half) * np.column_stack([np.sin(t := np.linspace(0, 2.5, 40)), -np.cos(t)]),
            np.array(centre) + (radius - half) * np.column_stack([np.sin(t), -np.cos(t)]),
            predecessors=(1,),
        ),
    )


def car(
    identifier: int,
    x: float,
    y: float,
    heading: float = 0.0,
    speed: float = 10.0,
    kind: str = "car",
    **more: object,
) -> Obstacle:
    return Obstacle(identifier, kind, CAR, State(x, y, heading, speed), **more)  # type: ignore[arg-type]


def scene(
    lanelets: tuple[Lanelet, ...],
    obstacles: tuple[Obstacle, ...],
    ego: State | None = None,
    current: tuple[int, ...] = (),
    dt: float = 0.1,
) -> Scene:
    lanes = ()
    if current:
        by_id = {each.id: each for each in lanelets}
        right = np.vstack([by_id[i].right for i in current])
        left = np.vstack([by_id[i].left for i in current])
        keep = np.concatenate([[True], np.abs(np.diff(right, axis=0)).max(axis=1) > 1e-9])
        right, left = right[keep], left[keep]
        centre = (right + left) / 2
        lanes = (
            Lane("current", current, left, right, centre, (None,) * len(current), Frame(centre)),
        )
    state = ego or State(-1000.0, 0.0, 0.0, 10.0)
    return Scene("made up", dt, Ego(0, state, 4.5, 1.8, 2.6), lanes, obstacles, lanelets, "unknown")


@dataclass(frozen=True)
class Course:
    """A road by its geometry: along +x up to x = 0, from there on a bend around (0, radius).

    `radius` inf: straight for ever; `always_bent`: the bend goes on to x < 0. The reference is the
    line through the origin; lateral offsets d within [low, high] are the carriageway.
    """

    low: float
    high: float
    radius: float = np.inf
    always_bent: bool = False

    def at(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Tangents (n, 2), normals (n, 2), offsets d (n,), curvatures (n,) at points (n, 2)."""
        straight = np.full(len(p), not self.always_bent) & (p[:, 0] < 0)
        if np.isinf(self.radius):
            straight[:] = True
        tangent = np.tile([1.0, 0.0], (len(p), 1))
        d, curvature = p[:, 1].copy(), np.zeros(len(p))
        bent = ~straight
        if bent.any():
            out = p[bent] - [0.0, self.radius]
            distance = np.linalg.norm(out, axis=1)
            out /= distance[:, None]
            tangent[bent] = np.column_stack([-out[:, 1], out[:, 0]])
            d[bent] = self.radius - distance
            curvature[bent] = 1.0 / distance
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        return tangent, normal, d, curvature


def drive(
    course: Course,
    start: State,
    steps: int,
    dt: float,
    count: int,
    seed: int,
    *,
    a_max: float = 12.0,
    braking: float = np.inf,
    driving: float = np.inf,
    lateral: float = 4.0,
    v_max: float = 50.0,
    overhang: float = 0.3,
    radius: float = 3.5,
    outline: Region = CAR,
    fine: int = 10,
) -> tuple[np.ndarray, np.ndarray]:
    """Random and bang-bang drives from one state.

    Returns:
        (steps * fine + 1, count, 3) poses x, y, heading at multiples of dt / fine, and (count,)
        the number of valid ones: from there on a drive breaks an assumption.
    """
    rng = np.random.default_rng(seed)
    step = dt / fine
    p = np.tile([start.x, start.y], (count, 1))
    v = np.tile(start.speed * np.array([np.cos(start.heading), np.sin(start.heading)]), (count, 1))
    psi = np.full(count, start.heading)
    way = np.zeros(count)
    valid = np.full(count, steps * fine + 1)
    poses = np.empty((steps * fine + 1, count, 3))
    poses[0] = np.column_stack([p, psi])
    every = rng.integers(1, steps * fine + 1, count)
    extreme = rng.random(count) < 0.7
    want = np.zeros((count, 2))
    swing = rng.choice([-1.0, 1.0], count) * rng.choice([0.0, 1.0, 1.0], count)
    for k in range(1, steps * fine + 1):
        tangent, normal, d, curvature = course.at(p)
        new = (k - 1) % every == 0
        angle = rng.uniform(0, 2 * np.pi, count)
        size = np.where(extreme, a_max, a_max * np.sqrt(rng.random(count)))
        # Half of the drives accelerate or brake straight ahead, to meet the longitudinal bounds.
        angle = np.where(rng.random(count) < 0.5, np.pi * rng.integers(0, 2, count), angle)
        want[new] = (size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))[new]
        v_t, v_n = (v * tangent).sum(axis=1), (v * normal).sum(axis=1)
        # Across the lane: make for one side no faster than allowed, and stop at the edge.
        goal = np.where(swing == 0, 0.0, swing * lateral)
        room = np.where(swing > 0, course.high - d, d - course.low) - 1.05
        goal = np.where(
            np.abs(swing) > 0, swing * np.clip(np.sqrt(np.maximum(room, 0) * 8), 0, lateral), 0.0
        )
        goal = np.clip(goal, -0.98 * lateral, 0.98 * lateral)
        a_n = np.clip((goal - v_n) / step, -0.6 * a_max, 0.6 * a_max)
        a_n = a_n + curvature * v_t**2
        rest = np.sqrt(np.maximum(a_max**2 - a_n**2, 0.0))
        a_t = np.clip(np.clip(want[:, 0], -braking, driving), -rest, rest)
        a = a_t[:, None] * tangent + a_n[:, None] * normal
        a *= np.minimum(1.0, a_max / np.maximum(np.linalg.norm(a, axis=1), 1e-9))[:, None]
        then = v + a * step
        # A vehicle that would begin to reverse stops, if it can within this fine step.
        back = (then * tangent).sum(axis=1) < 0
        stops = back & (np.linalg.norm(v, axis=1) <= min(a_max, braking) * step)
        then[stops] = 0.0
        p = p + (v + then) / 2 * step
        speed = np.linalg.norm(then, axis=1)
        way += np.linalg.norm(v + then, axis=1) / 2 * step
        gain = (speed - np.linalg.norm(v, axis=1)) / step
        v = then
        psi = np.where(speed > 1e-6, np.arctan2(v[:, 1], v[:, 0]), psi)
        tangent, normal, d, _ = course.at(p)
        turned = np.abs((psi - start.heading + np.pi) % (2 * np.pi) - np.pi)
        kept = (
            ((v * tangent).sum(axis=1) >= -1e-9)
            & (np.abs((v * normal).sum(axis=1)) <= lateral)
            & (speed <= v_max)
            & (gain >= -braking - 1e-9)
            & (gain <= driving + 1e-9)
            & (turned <= way / radius + 1e-9)
        )
        c, s = np.cos(psi), np.sin(psi)
        for x, y in outline.vertices:
            corner = p + np.column_stack([c * x - s * y, s * x + c * y])
            offset = course.at(corner)[2]
            kept &= (offset <= course.high + overhang) & (offset >= course.low - overhang)
        valid = np.where(~kept & (valid > k), k, valid)
        poses[k] = np.column_stack([p, psi])
    return poses, valid
