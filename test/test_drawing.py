"""Drawings of a controller."""

import numpy as np
import pytest
from samples import uniform
from tolerances import ALGEBRAIC

from eulerparams_control.motion.drawing import ellipsoid


@pytest.mark.parametrize("values", [(200.0, 50.0, 100.0), (3.0, 3.0, 3.0)])
def test_an_ellipsoid_is_as_long_along_each_axis_as_the_stiffness(values):
    for U in uniform(20):
        shape = ellipsoid(U @ np.diag(values) @ U.T, 0.1)
        made = shape.R @ np.diag(shape.radii) @ shape.R.T
        expected = U @ np.diag(values) @ U.T * 0.1 / max(values)
        assert made == pytest.approx(expected, abs=ALGEBRAIC)
        assert np.linalg.det(shape.R) == pytest.approx(1.0)


def test_an_ellipsoid_without_stiffness_is_thin_and_not_nothing():
    assert (ellipsoid(np.zeros((3, 3)), 0.1).radii > 0).all()
    flat = ellipsoid(np.diag([0.0, 100.0, 100.0]), 0.1).radii
    assert 0 < flat[0] < 0.01 < flat[1]
