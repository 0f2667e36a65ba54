"""The inverse of the Jacobian: exact, damped near kinematic singularities, redundant.

J* = J' (J J' + lambda^2 I)^-1 with lambda^2 = (1 - (sigma_min / eps)^2) lambda_max^2
where the smallest singular value sigma_min of J is below eps, else 0.
"""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import Array


@dataclass(frozen=True)
class DampedInverse:
    """Inverse of J (6, n) that stays bounded at kinematic singularities.

    Args:
        eps: singular value below which damping sets in; 0 never damps.
        lambda_max: damping at the singularity.

    Raises:
        ConfigurationError: if one is negative or not finite.
    """

    eps: float = 0.05
    lambda_max: float = 0.05

    def __post_init__(self) -> None:
        if not (0 <= self.eps < math.inf and 0 <= self.lambda_max < math.inf):
            raise ConfigurationError(
                f"damping eps {self.eps}, lambda_max {self.lambda_max}: expected >= 0"
            )

    def __call__(self, J: Array) -> Array:
        """Return J* (n, 6): J^-1 for a regular square J, the pseudo-inverse for n > 6."""
        J_inverse = _regular_inverse(J)
        # 1 / |J^-1|_F is a lower bound of sigma_min: where it suffices, no SVD is needed
        if J_inverse is not None and self.eps * math.sqrt(np.vdot(J_inverse, J_inverse)) < 1:
            return J_inverse
        return self._damped(J)

    def _damped(self, J: Array) -> Array:
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        ratio = float(sigma[-1]) / self.eps if self.eps > 0 else 1.0
        lambda_2 = (1 - ratio**2) * self.lambda_max**2 if ratio < 1 else 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            gains = sigma / (sigma**2 + lambda_2)
        return (Vt.T * np.where(np.isfinite(gains), gains, 0.0)) @ U.T


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


def smallest_singular_value(J: Array) -> float:
    """Return sigma_min of J (6, n): the distance to the nearest kinematic singularity."""
    return float(np.linalg.svd(J, compute_uv=False)[-1])
