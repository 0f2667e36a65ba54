"""Arms that run away under efforts."""

import numpy as np

from eulerparams_control.rotations import Array

AT_REST = 0.01
"""Slower than this [rad/s or m/s] a joint stands still."""

# An arm that is so many times as fast as its limits under efforts runs away: what is measured is
# late, or the model is wrong, and only the brakes of the robot can stop it.
_RUNAWAY = 1.5

# So does one that is still this fast [of its limits] when it was to stop for so long [s].
_SWINGING, _HALTED = 0.5, 0.5

# It has to stand for so long [s] until it gets efforts again: it may be at a turning point.
_STANDS = 0.2


class Runaway:
    """Tells whether an arm runs away under efforts; then no more may be commanded.

    Attributes:
        is_on: whether it ran away, and did not come to rest yet.
    """

    def __init__(self) -> None:
        self.is_on = False
        self._halted = self._stood = 0.0  # for how long [s] it was to stop, and stood

    def update(self, dt: float, dq: Array, limits: Array, is_stopped: bool) -> int | None:
        """Take a measured speed; return the joint that begins to run away, None if none does.

        Args:
            dt: [s] since the one before.
            dq: (n,) measured [rad/s or m/s].
            limits: (n,) of the speeds.
            is_stopped: whether the efforts are to hold the arm.
        """
        if self.is_on:
            self._stood = self._stood + dt if (np.abs(dq) < AT_REST).all() else 0.0
            self.is_on = self._stood <= _STANDS
            return None
        self._halted = self._halted + dt if is_stopped else 0.0
        most = _SWINGING if self._halted > _HALTED else _RUNAWAY
        speed = np.abs(dq) / limits
        joint = int(speed.argmax())
        self.is_on, self._stood = bool(speed[joint] > most), 0.0
        return joint if self.is_on else None
