"""Condition `occupancies`: the predictions are not smaller than they say.

A full proof that regions hold everything that the assumptions allow is the predictor's business.
Here a few behaviours that are allowed for sure are played, and each body must lie within the
regions: staying where it is (static objects), the most likely trajectory (in its own prediction),
and going straight on with the strongest braking, without, and with the strongest acceleration, for
as long as the body stays within the lanelet it is in (in the set-based prediction).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.certificate.geometry import Shapes, convex, outline
from sandra.certificate.report import Checked, Violation
from sandra.certificate.types import Certificate, Occupancies, Participant
from sandra.scene.types import Region
from sandra.settings import Assumptions

Array = NDArray[np.float64]

SLACK = 0.05
"""A body may stick out of its regions by so much [m]."""
TRAJECTORIES = ("recorded", "most-likely", "constant-velocity")
"""Kinds of prediction that are one trajectory each."""
VEHICLES = frozenset({"car", "truck", "bus", "taxi", "motorcycle", "priorityVehicle"})
"""Kinds that drive on lanes, as CommonRoad spells them."""
ALONG = math.radians(30.0)
"""A vehicle whose heading leaves its lanelet's by more is not played."""


def occupancies(c: Certificate) -> Checked | Violation:
    """No region is too small for behaviour that is allowed for sure."""
    lanelets = [(outline(x), _mean_heading(x.left)) for x in c.lanelets]
    played = [
        (obstacle.id, kind, k, regions[k], body)
        for obstacle in c.obstacles
        for kind, regions, k, body in _behaviours(c, obstacle, lanelets)
    ]
    held = _held([regions for *_, regions, _ in played], [body for *_, body in played])
    if not held.all():
        number, kind, k, _, _ = played[int(np.argmin(held))]
        return Violation(
            "occupancies",
            f"obstacle {number}: its region in the {kind} prediction, interval {k}, does not hold "
            "a body that its assumptions allow there",
            k,
            k * c.dt,
        )
    return Checked("occupancies", f"{len(played)} allowed places of others lie in their regions")


def _behaviours(
    c: Certificate, o: Participant, lanelets: list[tuple[Any, float]]
) -> Iterator[tuple[str, Occupancies, int, Region]]:
    """(kind of prediction, its regions, interval, body) of what must be held."""
    there = np.isfinite(o.states[:, 0])
    if c.prediction in TRAJECTORIES and "recorded occupancies" not in o.basis:
        for k in range(c.horizon):
            for row in (k, k + 1):
                if there[row]:
                    yield c.prediction, o.likely, k, o.outline.placed(*o.states[row, :3])
    if not there[0]:
        return
    if o.is_static:
        body = o.outline.placed(*o.states[0, :3])
        yield from ((c.set_based, o.possible, k, body) for k in _some(len(o.possible)))
    elif o.kind in VEHICLES and not {"no_rear_end", "legal_cut_in"} & set(o.assumptions):
        for k, body in _straight_on(o, c.dt, c.settings.assumptions, lanelets):
            yield c.set_based, o.possible, k, body


def _some(steps: int) -> list[int]:
    """Intervals 0, 1, 2, 4, 8, ... and the last."""
    powers = [0, *(1 << i for i in range(20))]
    return sorted({k for k in powers if k < steps} | ({steps - 1} if steps else set()))


def _straight_on(
    o: Participant, dt: float, a: Assumptions, lanelets: list[tuple[Any, float]]
) -> Iterator[tuple[int, Region]]:
    """(interval, body at its end) of a vehicle that goes straight on, while in its lanelet."""
    x, y, heading, speed = o.states[0, :4]
    body = o.outline.placed(x, y, heading)
    home = next(
        (
            area
            for area, course in lanelets
            if abs(math.remainder(course - heading, 2 * math.pi)) <= ALONG
            and shapely.covers(area, _shape(body))
        ),
        None,
    )
    if home is None or speed < 0.0:
        return
    for k in _some(len(o.possible)):
        time = (k + 1) * dt
        for acceleration in (-a.max_acceleration, 0.0, a.max_acceleration):
            way = _travelled(speed, acceleration, max(a.max_speed, speed), time)
            moved = o.outline.placed(
                x + way * math.cos(heading), y + way * math.sin(heading), heading
            )
            if shapely.covers(home, _shape(moved)):
                yield k, moved


def _travelled(speed: float, acceleration: float, top: float, time: float) -> float:
    """Way in `time` at constant acceleration until the speed is 0 or `top`, from there at that."""
    if acceleration == 0.0:
        return speed * time
    end = 0.0 if acceleration < 0.0 else top
    until = min(time, (end - speed) / acceleration)
    return speed * until + acceleration * until**2 / 2 + end * (time - until)


def _mean_heading(line: Array) -> float:
    dx, dy = line[-1] - line[0]
    return math.atan2(dy, dx)


def _shape(region: Region) -> Any:
    return _shapes([region])[0]


def _shapes(regions: list[Region]) -> Shapes:
    hulls, radii = convex(regions)
    return np.atleast_1d(np.where(radii > 0.0, shapely.buffer(hulls, radii), hulls))


def _held(regions: list[tuple[Region, ...]], bodies: list[Region]) -> NDArray[np.bool_]:
    """(n,) whether the union of regions i holds body i, but for `SLACK`."""
    shapes = _shapes(bodies)
    owner = np.repeat(np.arange(len(regions)), [len(x) for x in regions])
    hulls, radii = convex(region for several in regions for region in several)
    held = np.zeros(len(bodies), dtype=np.bool_)
    # Mostly one region holds the body as it is, and no shape has to be widened or united.
    np.logical_or.at(held, owner, shapely.covers(hulls, shapes[owner]))
    for i in np.flatnonzero(~held):
        mine = owner == i
        union = shapely.union_all(shapely.buffer(hulls[mine], radii[mine] + SLACK))
        held[i] = bool(shapely.covers(union, shapes[i]))
    return held
