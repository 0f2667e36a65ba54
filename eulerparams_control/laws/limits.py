"""Joint limits, and how velocity, acceleration and effort commands are kept within them."""

from dataclasses import dataclass, replace

import numpy as np

from eulerparams_control.laws.rotations import Array

POSITION_RATE = 10.0
"""A joint approaches a position limit no faster than its distance times this [1/s]: without
overshoot, as long as a command does not last longer than the inverse."""

# The same for its speed limit, by the remaining speed.
_SPEED_RATE = 100.0


@dataclass(frozen=True)
class JointLimits:
    """Limits of n joints; infinite where there is no limit.

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

    def difference(self, q_c: Array, q: Array) -> Array:
        """Return q_c - q (n,) [rad or m]; modulo a turn where there are no position limits."""
        difference = q_c - q
        if np.isfinite(self.upper).all():
            return difference
        turns = 2 * np.pi * np.round(difference / (2 * np.pi))
        return np.where(np.isinf(self.upper), difference - turns, difference)

    def deviation(self, q_c: Array, q: Array) -> Array:
        """Return |q_c - q| (n,) [rad or m]; modulo a turn where there are no position limits."""
        return np.abs(self.difference(q_c, q))

    def contain(self, q: Array) -> bool:
        """Return whether the positions q (n,) are within the limits."""
        return bool((q <= self.upper).all() and (q >= self.lower).all())

    def limit_velocity(self, q: Array, dq: Array, dt: float) -> tuple[Array, bool]:
        """Return dq within the limits, and whether it had to change.

        Too fast a motion is slowed as a whole, so that its direction is kept.  A joint near its
        position limit is no faster than ``POSITION_RATE`` times the distance, the others go on.

        Args:
            q: (n,) positions now.
            dq: (n,) velocities wanted; finite.
            dt: time that dq will last [s]; positive.
        """
        speed, rate = np.abs(dq), min(POSITION_RATE, 1 / dt)
        low = rate * np.minimum(self.lower - q, 0.0)  # outside already: inwards is allowed
        high = rate * np.maximum(self.upper - q, 0.0)
        if (speed <= self.velocity).all() and (dq <= high).all() and (dq >= low).all():
            return dq, False
        excess = float((speed / self.velocity).max())
        slowed = dq / excess if excess > 1 else dq
        limited = np.clip(slowed, low, high)
        return limited, bool((limited != dq).any())

    def limit_acceleration(self, q: Array, dq: Array, ddq: Array, dt: float) -> tuple[Array, bool]:
        """Return ddq that keeps the limits of speed and position, and whether it had to change.

        Per joint.  From outside the position limits only the way back is open.

        Args:
            q, dq: (n,) positions and velocities now.
            ddq: (n,) accelerations wanted; finite.
            dt: time that ddq will last [s]; 0 if it is not known, but short.
        """
        fastest = 1 / dt if dt > 0 else np.inf
        position_rate, speed_rate = min(POSITION_RATE, fastest), min(_SPEED_RATE, fastest)
        high = np.minimum(self.velocity, position_rate * np.maximum(self.upper - q, 0.0))
        low = np.maximum(-self.velocity, position_rate * np.minimum(self.lower - q, 0.0))
        most, least = speed_rate * (high - dq), speed_rate * (low - dq)
        if (ddq <= most).all() and (ddq >= least).all():
            return ddq, False
        return np.minimum(np.maximum(ddq, least), most), True

    def limit_effort(self, effort: Array) -> tuple[Array, bool]:
        """Return the efforts (n,) cut to their limits, and whether one had to be cut."""
        if (np.abs(effort) <= self.effort).all():
            return effort, False
        return np.minimum(np.maximum(effort, -self.effort), self.effort), True
