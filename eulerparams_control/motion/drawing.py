"""Geometry that views draw: the ellipsoid of a stiffness."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.jit import Array

# Semi-axes along which there is no stiffness are drawn this thin, of the longest.
_THIN = 0.02


class Ellipsoid(NamedTuple):
    """Semi-axes (3,) [m] along the columns of R (3, 3), about the origin of its frame."""

    R: Array
    radii: Array


def ellipsoid(K: Array, longest: float) -> Ellipsoid:
    """Return the ellipsoid of a stiffness K (3, 3), as long along each axis as K is stiff.

    Args:
        K: symmetric, positive semidefinite.
        longest: semi-axis [m] along which K is stiffest.
    """
    values, R = np.linalg.eigh(K)
    if np.linalg.det(R) < 0:
        R[:, 0] *= -1.0
    most = values[-1]
    shares = np.maximum(values / most, _THIN) if most > 0 else np.full(3, _THIN)
    return Ellipsoid(R, longest * shares)
