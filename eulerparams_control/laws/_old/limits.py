"""Joint limits as the laws that are not yet open Python take them: as rows, and filled in place.

``limits`` (5, n) are JointLimits.rows, or UNLIMITED; see :class:`JointLimits`.
"""

import math

import numpy as np

from eulerparams_control.laws import limits as primitives
from eulerparams_control.laws._old.compiled import Input, Row, Rows, kernel
from eulerparams_control.laws.limits import excess

UNLIMITED = np.empty((5, 0))

_ACCELERATION = 4

_SPEED_RATE = primitives._SPEED_RATE
_subtract, _limit_acceleration = primitives.subtract, primitives.limit_acceleration


@kernel
def subtract(limits: Rows, q_c: Input, q: Input, away: Row) -> None:
    """Fill ``away`` (n,) with q_c - q."""
    if limits.shape[1] > 0:
        away[:] = _subtract(limits, q_c, q)
    else:
        for i in range(len(q)):
            away[i] = q_c[i] - q[i]


@kernel
def excess_after(limits: Rows, dq: Input, ddq: Row) -> float:
    """Return ``excess`` of the velocities to which ddq (n,) leads from dq (n,)."""
    after = np.empty(len(dq))
    for i in range(len(dq)):
        after[i] = dq[i] + ddq[i] / _SPEED_RATE
    return excess(limits, after)


@kernel
def limit_acceleration(
    limits: Rows, q: Input, dq: Input, ddq: Input, dt: float, drift: Input, limited: Row
) -> bool:
    """Fill ``limited`` (n,); return if it changed."""
    found, changed = _limit_acceleration(limits, q, dq, ddq, dt, drift)
    limited[:] = found
    return changed


@kernel
def without_accelerations(limits: Rows) -> Rows:
    """Return the limits without those of the accelerations."""
    free = limits.copy()
    for i in range(limits.shape[1]):
        free[_ACCELERATION, i] = math.inf
    return free
