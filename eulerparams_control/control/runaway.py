"""Arms that run away under efforts."""

import numpy as np

from eulerparams_control.laws.rotations import Array

AT_REST = 0.01
"""Slower than this [rad/s or m/s] a joint stands still."""

# An arm that is so many times as fast as its limits under efforts runs away: what is measured is
# late, or the model is wrong, and only the brakes of the robot can stop it.
_RUNAWAY = 1.5

# So does one that is still this fast [of its limits] when it was to stop for so long [s]; but what
# is slower than this [rad/s or m/s] does not.
_SWINGING, _HALTED, _SLOW = 0.5, 0.5, 0.1

# It has to stand for so long [s], within so much [rad or m], until it gets efforts again: it may be
# at a turning point.  Its speed may be noisy.
_STANDS, _SAME_PLACE = 0.2, 2e-3


class Runaway:
    """Tells whether an arm runs away under efforts; then no more may be commanded.

    Attributes:
        is_on: whether it ran away, and did not come to rest yet.
    """

    def __init__(self) -> None:
        self.is_on = False
        self._halted = self._stood = 0.0  # for how long [s] it was to stop, and stood
        self._place: Array | None = None  # where

    def update(self, dt: float, q: Array, dq: Array, limits: Array, is_stopped: bool) -> int | None:
        """Take a measured state; return the joint that begins to run away, None if none does.

        Args:
            dt: [s] since the one before.
            q, dq: (n,) measured [rad or m], [rad/s or m/s].
            limits: (n,) of the speeds.
            is_stopped: whether the efforts are to hold the arm.
        """
        if self.is_on:
            if self._place is None or (np.abs(q - self._place) > _SAME_PLACE).any():
                self._place, self._stood = q, 0.0
            self._stood += dt
            self.is_on = self._stood <= _STANDS
            return None
        self._halted = self._halted + dt if is_stopped else 0.0
        most = _SWINGING if self._halted > _HALTED else _RUNAWAY
        excess = np.abs(dq) - np.maximum(most * limits, _SLOW)
        joint = int(excess.argmax())
        self.is_on, self._place = bool(excess[joint] > 0), None
        return joint if self.is_on else None
