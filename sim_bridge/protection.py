"""The protective stop: what no joint may do, and what no brakes could stop."""

import math
from collections.abc import Sequence
from operator import le

import numpy as np

from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.robot.urdf import NO_LIMIT

POSITION_MARGIN = 1e-4
"""So far beyond a position limit is too far [rad or m].

A joint that leans on its stop with its full effort rests within 1e-9 of the limit; one that
runs into it at 3 rad/s is up to 3e-3 beyond it after a step of 1 ms, and stops there anyway.
"""

SPEED_FACTOR = 4.0
"""Factor of its speed limit beyond which a joint is too fast.

A controller that keeps to the limit exceeds it by a few per cent.  One whose speed limits are
lifted on purpose, so that the law alone is seen, reaches 2.9 times the limit where it turns by
almost half a turn or meets a stiff wall.  What is faster is out of control; a robot with people
beside it would choose less.
"""

UNSTOPPABLE = 10.0
"""Factor of that speed beyond which an arm turns wildly, and soon is at non-finite positions."""

# What is slower than this factor times that [rad/s or m/s] can be stopped.
_FAST = 1.0

STANDSTILL = 1e-3
"""Speed [rad/s or m/s] below which a joint is at rest; brakes leave 1e-7."""


class Protection:
    """Looks whether the joints are within their limits.

    Where a stop left a joint beyond its limit, it may rest and turn back, but go no further.

    Args:
        joints: their names.
        limits: of the joints.
        speed_factor: factor of its speed limit beyond which a joint is too fast.
    """

    def __init__(
        self, joints: Sequence[str], limits: JointLimits, speed_factor: float = SPEED_FACTOR
    ) -> None:
        self._joints = tuple(joints)
        self._limits = limits
        self._factor = speed_factor
        self._speed: list[float] = (speed_factor * limits.velocity).tolist()
        self._unstoppable: list[float] = [UNSTOPPABLE * max(_FAST, v) for v in self._speed]
        self._slow: float = min(*self._speed, *self._unstoppable, NO_LIMIT)
        self.reset()

    def reset(self) -> None:
        """Let no joint be beyond its limit."""
        self._lower: list[float] = (self._limits.lower - POSITION_MARGIN).tolist()
        self._upper: list[float] = (self._limits.upper + POSITION_MARGIN).tolist()

    def let_stand(self, q: Sequence[float]) -> None:
        """Let the joints be where they are, q (n), but no further beyond their limits."""
        self._lower = (np.minimum(self._limits.lower, q) - POSITION_MARGIN).tolist()
        self._upper = (np.maximum(self._limits.upper, q) + POSITION_MARGIN).tolist()

    def is_slow(self, dq: Sequence[float]) -> bool:
        """Return whether surely no joint is too fast for anything, at dq (n) [rad/s or m/s]."""
        return math.hypot(*dq) < self._slow

    def is_within(self, q: Sequence[float]) -> bool:
        """Return whether all joints are within their limits, at q (n) [rad or m]."""
        return all(map(le, q, self._upper)) and all(map(le, self._lower, q))

    def violation(self, q: Sequence[float], dq: Sequence[float]) -> str:
        """Return which joint is where, or as fast as, it must not be; "" if none is.

        Args:
            q: positions, n [rad or m].
            dq: velocities, n [rad/s or m/s].
        """
        return self._too_fast(dq) or self._too_far(q)

    def unstoppable(self, dq: Sequence[float]) -> str:
        """Return which joint no brakes could stop, at dq (n) [rad/s or m/s]; "" if none is so."""
        for name, speed, bound in zip(self._joints, dq, self._unstoppable, strict=True):
            if abs(speed) > bound:
                return f"joint '{name}' would move at {speed:.3g} rad/s, which no brakes could stop"
        return ""

    def _too_fast(self, dq: Sequence[float]) -> str:
        for name, speed, bound, limit in zip(
            self._joints, dq, self._speed, self._limits.velocity, strict=True
        ):
            if abs(speed) > bound:
                return (
                    f"joint '{name}' moves at {speed:.3g} rad/s, more than {self._factor:g} times "
                    f"its limit {limit:.3g}"
                )
        return ""

    def _too_far(self, q: Sequence[float]) -> str:
        limits = zip(self._lower, self._upper, self._limits.lower, self._limits.upper, strict=True)
        for name, position, bounds in zip(self._joints, q, limits, strict=True):
            low, high, lower, upper = bounds
            if not low <= position <= high:
                limit = lower if position < low else upper
                return (
                    f"joint '{name}' is at {position:.6g} rad, {abs(position - limit):.2g} beyond "
                    f"its limit {limit:.6g}"
                )
        return ""
