"""Shared by the library experiments: where moments balance each other."""

from collections.abc import Callable

import numpy as np

from eulerparams_control.laws.rotations import Array, exp

_STEP, _LONGEST, _TINY = 1e-6, 0.2, 1e-9  # [rad], [rad], [Nm]


def at_rest(moment: Callable[[Array], Array], R: Array) -> Array:
    """Return the orientation (3, 3), next to R, where a moment (3,) in fixed axes is zero.

    By Newton's method, with differences for the slope.
    """
    for _ in range(50):
        left = moment(R)
        if np.abs(left).max() < _TINY:
            break
        slope = np.array([(moment(exp(x) @ R) - left) / _STEP for x in _STEP * np.eye(3)]).T
        x = np.linalg.solve(slope, -left)
        R = exp(x * min(1.0, _LONGEST / float(np.linalg.norm(x)))) @ R
    return R
