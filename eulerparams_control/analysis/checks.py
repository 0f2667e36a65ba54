"""Checks of raw messages, for bags and for the sequences of a campaign."""

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array

_ROUNDING = 1e-9  # tolerance of a value that was cut to a limit: of it, or of 1 if that is more


def beyond_limits(
    field: str, values: Array, limits: JointLimits
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Return which numbers (..., n) are beyond the limits of the URDF, and these (n,), (n,).

    Args:
        field: of JointState: ``position``, ``velocity`` or ``effort``.
        values: of the joints; NaN is not beyond.
        limits: of the arm.
    """
    low, high = {
        "position": (limits.lower, limits.upper),
        "velocity": (-limits.velocity, limits.velocity),
        "effort": (-limits.effort, limits.effort),
    }[field]
    slack = _ROUNDING * np.maximum(1.0, np.minimum(np.abs(high), 1e6))
    return (values < low - slack) | (values > high + slack), low, high


def speed_of_limit(dq: Array, limits: JointLimits) -> Array:
    """Return the speeds (N, n) of joints over their velocity limits."""
    return np.abs(dq.reshape(-1, len(limits.velocity))) / limits.velocity
