"""The spline against SciPy's, on random points."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from sandra.planning.spline import Spline


@pytest.mark.parametrize("n", [4, 5, 6, 11, 80])
def test_it_is_that_of_scipy(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        knots = np.cumsum(rng.uniform(0.3, 3.0, n)) - 5.0
        points = np.cumsum(rng.normal(size=(n, 2)), axis=0)
        ours, theirs = Spline.through(knots, points), CubicSpline(knots, points)
        u = np.concatenate([knots, rng.uniform(knots[0] - 2.0, knots[-1] + 2.0, 50)])
        for order in range(4):
            # At a knot the third derivative jumps; both take that of the piece that begins there.
            assert ours(u, order) == pytest.approx(theirs(u, order), rel=1e-9, abs=1e-9)
        assert ours(float(u[0]), 1).shape == (2,)


def test_a_cubic_is_its_own_spline() -> None:
    knots = np.array([0.0, 1.0, 1.5, 4.0, 5.0])
    cubic = np.stack([knots**3 - 2.0 * knots, 4.0 - knots**2], axis=1)
    u = np.linspace(-1.0, 6.0, 29)
    expected = np.stack([u**3 - 2.0 * u, 4.0 - u**2], axis=1)
    assert Spline.through(knots, cubic)(u) == pytest.approx(expected, abs=1e-10)
