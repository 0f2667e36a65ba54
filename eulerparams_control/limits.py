"""Joint limits, and how a velocity command is kept within them."""

from dataclasses import dataclass, replace

import numpy as np

from eulerparams_control.rotations import Array


@dataclass(frozen=True)
class JointLimits:
    """Limits of n joints; infinite where there is none.

    Attributes:
        lower, upper: (n,) positions [rad or m].
        velocity: (n,) speeds [rad/s or m/s].
        effort: (n,) efforts [Nm or N].
    """

    lower: Array
    upper: Array
    velocity: Array
    effort: Array

    def scaled(self, velocity_scale: float) -> "JointLimits":
        """Return the limits with the speeds times ``velocity_scale``."""
        return replace(self, velocity=velocity_scale * self.velocity)

    def deviation(self, q_c: Array, q: Array) -> Array:
        """Return |q_c - q| (n,) [rad or m]; modulo a turn where there are no position limits."""
        difference = q_c - q
        turns = 2 * np.pi * np.round(difference / (2 * np.pi))
        return np.abs(np.where(np.isinf(self.upper), difference - turns, difference))

    def contain(self, q: Array) -> bool:
        """Return whether the positions q (n,) are within the limits."""
        return bool((q <= self.upper).all() and (q >= self.lower).all())

    def limit_velocity(self, q: Array, dq: Array, dt: float) -> tuple[Array, bool]:
        """Return dq within the limits, and whether it had to change.

        Too fast a motion is slowed as a whole, so that its direction is kept.  A joint
        that would pass its position limit within dt stops there, the others go on.

        Args:
            q: (n,) positions now.
            dq: (n,) velocities wanted; finite.
            dt: time that dq will last [s]; positive.
        """
        speed = np.abs(dq)
        if (speed <= self.velocity).all() and self.contain(q + dt * dq):
            return dq, False
        excess = float((speed / self.velocity).max())
        slowed = dq / excess if excess > 1 else dq
        low = np.minimum((self.lower - q) / dt, 0.0)  # outside already: inwards is allowed
        high = np.maximum((self.upper - q) / dt, 0.0)
        limited = np.clip(slowed, low, high)
        return limited, bool((limited != dq).any())
