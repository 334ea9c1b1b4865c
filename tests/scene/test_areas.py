"""Areas of lanelets: made once, all at once, each as if it were alone."""

from dataclasses import replace

import numpy as np
import shapely

from random_scenes import draw
from sandra.scene.types import Lanelet, areas


def test_each_is_the_area_between_the_borders() -> None:
    lanelets = [replace(x) for seed in range(10) for x in draw(seed).scene.lanelets]
    crossed = replace(
        lanelets[0],
        left=np.array([[0.0, 1.0], [10.0, -1.0], [20.0, -1.0]]),
        right=np.array([[0.0, -1.0], [10.0, 1.0], [20.0, 1.0]]),
    )
    several: list[Lanelet] = [*lanelets, crossed]
    alone = lanelets[1].area()
    found = areas(several)
    assert found[1] is alone, "it was known already"
    for lanelet, area in zip(several, found, strict=True):
        assert area.equals_exact(shapely.Polygon(lanelet.outline).buffer(0), 0.0)
        assert lanelet.area() is area
    assert areas([]) == []


def test_other_borders_have_another_area() -> None:
    lanelet = draw(0).scene.lanelets[0]
    before = lanelet.area()
    moved = replace(lanelet, left=lanelet.left + 1.0, right=lanelet.right + 1.0)
    assert not moved.area().equals(before)
    assert replace(lanelet).area().equals_exact(before, 0.0)
