"""Set-based regions of those who stay far from the ego are discs; nobody else's change."""

import numpy as np
import pytest

from prediction.traffic import car, scene, straight_road
from random_scenes import draw
from sandra.errors import SettingsError
from sandra.prediction import Prediction, predict
from sandra.scene.types import Region, Scene, State

HORIZON = 4


def sets(now: Scene, near: np.ndarray | None = None) -> Prediction:
    return predict(now, "set-based", HORIZON, instants=False, near=near)


def is_disc(step: tuple[Region, ...]) -> bool:
    return len(step) == 1 and len(step[0].vertices) == 1


def test_who_may_come_near_is_predicted_as_before() -> None:
    rough = exact = both = 0
    for seed in range(120):
        now = draw(seed, most=6).scene
        near = np.sort(np.random.default_rng(seed).uniform(0.0, 20.0, HORIZON))
        ego = np.array([now.ego.state.x, now.ego.state.y])
        for a, b in zip(sets(now).obstacles, sets(now, near).obstacles, strict=True):
            kinds = [is_disc(step) for step in b.between]
            rough, exact = rough + sum(kinds), exact + kinds.count(False)
            both += len(set(kinds)) == 2
            assert kinds == sorted(kinds, reverse=True), "once near, never far again"
            if not all(kinds):
                assert a.assumptions == b.assumptions
            for k, (before, step) in enumerate(zip(a.between, b.between, strict=True)):
                if kinds[k]:
                    (disc,) = step
                    assert float(np.hypot(*(disc.vertices[0] - ego))) - disc.radius > near[k]
                    for region in before:
                        # Half-planes in 16 directions stick out of a circle by 2 %.
                        reach = np.hypot(*(region.vertices - disc.vertices[0]).T).max()
                        assert reach + region.radius <= 1.02 * disc.radius + 1.0
                    continue
                assert [r.radius for r in before] == [r.radius for r in step]
                for x, y in zip(before, step, strict=True):
                    # Up to rounding: they are computed in other batches.
                    assert x.vertices == pytest.approx(y.vertices, abs=1e-9)
    assert min(rough, exact, both) > 20


def test_distances_that_do_not_fit() -> None:
    now = draw(0).scene
    for near, instants in ((np.ones(3), False), (np.ones(HORIZON), True)):
        with pytest.raises(SettingsError, match="one distance for each of 4 steps"):
            predict(now, "set-based", HORIZON, instants=instants, near=near)


@pytest.mark.parametrize("speed", [0.0, 15.0, 49.0])
def test_a_disc_holds_the_hardest_driving_in_any_direction(speed: float) -> None:
    """12 m/s^2 up to 50 m/s, the body turned anyhow."""
    now = scene(straight_road(), (car(1, 500.0, 1.75, 0.0, speed),), State(0.0, 1.75, 0.0, 10.0))
    (found,) = sets(now, np.full(HORIZON, 20.0)).obstacles
    rng = np.random.default_rng(0)
    for k, (disc,) in enumerate(found.between):
        time = (k + 1) * now.dt
        angle = rng.uniform(-np.pi, np.pi, 500)
        steps = np.linspace(0.0, time, 51)
        pushed = 12.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None] * steps[:, None]
        velocity = pushed + np.array([speed, 0.0])
        size = np.hypot(velocity[..., 0], velocity[..., 1])[..., None]
        velocity *= np.minimum(1.0, 50.0 / np.maximum(size, 1e-9))
        moved = (velocity[:, :-1] + velocity[:, 1:]).sum(axis=1) / 2 * (time / 50)
        place = np.array([500.0, 1.75]) + moved
        away = np.hypot(*(place - disc.vertices[0]).T) + np.hypot(4.5, 1.8) / 2
        assert away.max() <= disc.radius
        # and no more than that: from the speed that it has, not from the highest one
        assert disc.radius <= speed * time + 6.0 * time**2 + np.hypot(4.5, 1.8) / 2 + 0.5


def test_a_disc_that_just_comes_near_is_none() -> None:
    """Farther away than the distance given, not as far: then it is predicted as before."""
    now = scene(straight_road(), (car(1, 500.0, 1.75, 0.0, 8.0),), State(0.0, 1.75, 0.0, 10.0))
    (found,) = sets(now, np.zeros(HORIZON)).obstacles
    near = 500.0 - np.array([disc.radius for (disc,) in found.between])
    near[:-1] -= 1.0
    assert near[-1] + found.between[-1][0].radius == 500.0
    (found,) = sets(now, near).obstacles
    assert [is_disc(step) for step in found.between] == [True, True, True, False]
    near[-1] = np.nextafter(near[-1], 0.0) - 1e-12
    (found,) = sets(now, near).obstacles
    assert all(is_disc(step) for step in found.between)
