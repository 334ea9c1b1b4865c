"""Where the ego must not stand: the conflict areas of the intersections on its route.

A conflict area is a place on the ego's own lanes (current, left, right) that a lanelet of an
incoming lane (`Scene.incoming`: crosses or merges into the route) covers too. Where an incoming
lane has become the ego's own, after the merge, they share the lanelet: traffic there follows
another, and no conflict remains. Outside the own lanes an incoming lanelet is no conflict area
either; whether the ego may be there at all is decided by its road and collision checks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.scene.types import Scene

Array = NDArray[np.float64]

SLIVER = 0.2
"""Overlaps narrower than this are inaccuracies of the map, no conflict areas [m]."""


def conflict_areas(scene: Scene) -> list[Array]:
    """Polygons, (n, 2) each [m], in which the ego's body must not come to a standstill.

    Holes of an area are filled. Empty where no incoming lane meets the ego's lanes.
    """
    from shapely import union_all

    by_id = {lanelet.id: lanelet for lanelet in scene.lanelets}
    own = {
        i
        for lane in scene.lanes
        if lane.relation in ("current", "left", "right")
        for i in lane.lanelets
    }
    incoming = {i for lane in scene.incoming for i in lane.lanelets} - own
    if not incoming:
        return []
    own_areas = [by_id[i].area() for i in sorted(own)]
    pieces = []
    for i in sorted(incoming):
        area = by_id[i].area()
        pieces += [area.intersection(mine) for mine in own_areas]
    # Cut pieces of one overlap are joined before slivers are dropped.
    joined = union_all(pieces)
    opened = joined.buffer(-SLIVER / 2, join_style="mitre").buffer(
        SLIVER / 2, join_style="mitre", mitre_limit=2.0
    )
    parts = getattr(opened, "geoms", [opened])
    return [np.asarray(part.exterior.coords)[:-1] for part in parts if not part.is_empty]
