"""Positions and velocities of joints in the bytes of a JointState, read in one compiled call."""

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.laws._old.compiled import Bytes, Places, Row, entry

JointsAt = tuple[NDArray[np.uint8], NDArray[np.int64]]
"""Which bytes of a layout are fixed, with these behind them; and where its numbers begin."""

_STAMP = 4  # where it begins

NOT_READ = -(2**63)
"""Instead of a stamp."""


@entry
def read_joints(
    message: bytes, pattern: Bytes, places: Places, most: float, q: Row, dq: Row
) -> int:
    """Read positions and velocities from a JointState at its bytes; return its stamp [ns].

    NOT_READ, if it has another layout, or a value is not finite or larger than ``most``.

    Args:
        message: of the robot.
        pattern: see :data:`JointsAt`.
        places: (2, n) where the positions and the velocities begin.
        most: [rad, m, rad/s or m/s].
        q, dq: (n,) are filled.
    """
    data, end = np.frombuffer(message, np.uint8), len(pattern) // 2
    fixed, common = pattern[:end], pattern[end:]
    if len(data) < len(fixed):
        return NOT_READ
    for i in range(len(fixed)):
        if data[i] & fixed[i] != common[i]:
            return NOT_READ
    for i in range(len(q)):  # eight bytes are a number also where they are not aligned
        at, then = places[0, i], places[1, i]
        q[i] = data[at : at + 8].view(np.float64)[0]
        dq[i] = data[then : then + 8].view(np.float64)[0]
        if not (abs(q[i]) <= most and abs(dq[i]) <= most):
            return NOT_READ
    seconds = data[_STAMP : _STAMP + 4].view(np.int32)[0]
    return int(seconds) * 1_000_000_000 + int(data[_STAMP + 4 : _STAMP + 8].view(np.uint32)[0])
