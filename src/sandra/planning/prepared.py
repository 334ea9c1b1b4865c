"""Areas that are asked about many times, by several threads if need be."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]


class Prepared:
    """A shapely geometry, prepared for quick answers.

    GEOS lets one thread at a time use a prepared geometry (libgeos/geos issue 825), and shapely
    lets go of the interpreter's lock meanwhile: without a lock of our own two threads that share
    an area crash the process.
    """

    __slots__ = ("_geometry", "_lock")

    def __init__(self, geometry: Any) -> None:
        import shapely

        shapely.prepare(geometry)
        self._geometry = geometry
        self._lock = threading.Lock()

    def contains_xy(self, x: Any, y: Any) -> Bools:
        """Whether points lie inside."""
        import shapely

        with self._lock:
            return np.asarray(shapely.contains_xy(self._geometry, x, y))

    def covers(self, others: Any) -> Bools:
        """Whether geometries lie inside or on the border."""
        import shapely

        with self._lock:
            return np.asarray(shapely.covers(self._geometry, others))

    def intersects(self, others: Any) -> Bools:
        """Whether geometries touch it."""
        import shapely

        with self._lock:
            return np.asarray(shapely.intersects(self._geometry, others))
