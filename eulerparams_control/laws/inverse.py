"""The inverse of the Jacobian: exact, damped near kinematic singularities, redundant.

J* = J' (J J' + lambda^2 I)^-1 with lambda^2 = (1 - (sigma_min / eps)^2) lambda_max^2
where the smallest singular value sigma_min of J is below eps, else 0.

For eps, J and lambda have no units: the rows of J for the position [m] are divided by a
characteristic length of the arm.  So an arm of half the size is damped at the same q.
"""

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import Array


@dataclass(frozen=True)
class DampedInverse:
    """Inverse of J (6, n) that stays bounded at kinematic singularities.

    Args:
        eps: singular value below which damping sets in; 0 never damps.
        lambda_max: damping at the singularity.
        length: characteristic length [m] of the arm.

    Raises:
        ConfigurationError: if one is negative or not finite.
    """

    eps: float = 0.05
    lambda_max: float = 0.05
    length: float = field(default=1.0, compare=False)

    def __post_init__(self) -> None:
        if not (0 <= self.eps < math.inf and 0 <= self.lambda_max < math.inf):
            raise ConfigurationError(
                f"damping eps {self.eps}, lambda_max {self.lambda_max}: expected >= 0"
            )

    def __call__(self, J: Array) -> Array:
        """Return J* (n, 6): J^-1 for a regular square J, the pseudo-inverse for n > 6."""
        J_inverse = _regular_inverse(J)
        # 1 / |J^-1|_F is a lower bound of sigma_min: where it suffices, no SVD is needed
        if J_inverse is not None:
            bound = J_inverse * _scale(self.length)
            if self.eps * math.sqrt(np.vdot(bound, bound)) < 1:
                return J_inverse
        return self._damped(J)

    def _damped(self, J: Array) -> Array:
        scale = _scale(self.length)
        U, sigma, Vt = np.linalg.svd(J / scale[:, None], full_matrices=False)
        ratio = float(sigma[-1]) / self.eps if self.eps > 0 else 1.0
        lambda_2 = (1 - ratio**2) * self.lambda_max**2 if ratio < 1 else 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            gains = sigma / (sigma**2 + lambda_2)
        J_inverse: Array = (Vt.T * np.where(np.isfinite(gains), gains, 0.0)) @ U.T
        return J_inverse / scale


def _regular_inverse(J: Array) -> Array | None:
    """Return J^-1, or J' (J J')^-1 for n > 6; None where there is none."""
    rows, columns = J.shape
    if columns < rows:
        return None
    try:
        if rows == columns:
            return np.linalg.inv(J)
        return J.T @ np.linalg.inv(J @ J.T)
    except np.linalg.LinAlgError:
        return None


def smallest_singular_value(J: Array, length: float = 1.0) -> float:
    """Return sigma_min of J (6, n): the distance to the nearest kinematic singularity.

    Args:
        J: Jacobian, position first.
        length: by which the rows of the position are divided [m].
    """
    return float(np.linalg.svd(J / _scale(length)[:, None], compute_uv=False)[-1])


@cache
def _scale(length: float) -> Array:
    """Return the units (6,) in which J is without units."""
    return np.array([length] * 3 + [1.0] * 3)
