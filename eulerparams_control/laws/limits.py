"""Joint limits, and how velocity, acceleration and effort commands are kept within them.

Notation: ``d`` [rad or m] distance to a position limit, ``a`` [rad/s^2] acceleration limit, ``r``
[1/s] POSITION_RATE.  A joint that moves towards a limit at the speed v has to stop within d:

    v <= r d               close to it
    v <= sqrt(2 a d)       away from it

joined smoothly at v = a / r, so that no more than a is ever needed to keep to both.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eulerparams_control.laws.rotations import Array, every

POSITION_RATE = 10.0
"""A joint approaches a position limit no faster than its distance times this [1/s]: without
overshoot, as long as a command does not last longer than the inverse."""

# The same for its speed limit, by the remaining speed.
_SPEED_RATE = 100.0

SHORTEST = 1e-3
"""Time [s] that a command is taken to last where that is not known."""

# Part of the acceleration limit by which efforts plan to brake: they follow late.
_PLANNED = 0.8

_TINY = 1e-300

# Steps up to this [s] are short: how far a joint may need to stop is known for them beforehand.
_SHORT = 0.02

type Difference = Callable[[Array, Array], Array]
"""Returns q_c - q (n,), modulo a turn where a joint may turn on and on."""


@dataclass(frozen=True)
class JointLimits:
    """Limits of n joints; infinite where there is no limit.

    Attributes:
        lower, upper: (n,) positions [rad or m].
        velocity: (n,) speeds [rad/s or m/s].
        effort: (n,) efforts [Nm or N].
        acceleration: (n,) [rad/s^2 or m/s^2]; positive.
    """

    lower: Array
    upper: Array
    velocity: Array
    effort: Array
    acceleration: Array = field(default_factory=lambda: np.array(math.inf))

    def __post_init__(self) -> None:
        a = np.broadcast_to(self.acceleration, np.shape(self.velocity)).astype(float)
        object.__setattr__(self, "acceleration", a)

    @cached_property
    def _turns(self) -> bool:
        """Whether a joint may turn on and on."""
        return bool(np.isinf(self.upper).any())

    @cached_property
    def _clear(self) -> tuple[Array, Array]:
        """Positions (n,) between which each joint can stop in time, however fast it is."""
        v, a = self.velocity, _PLANNED * self.acceleration
        with np.errstate(invalid="ignore"):  # of infinite limits, from which nothing is clear
            step = np.where(np.isinf(a), 0.0, a) * _SHORT**2 / 8
            room = v / POSITION_RATE + v**2 / (2 * a) + v * _SHORT / 2 + step
        return self.lower + room, self.upper - room

    def _is_clear(self, q: Array, dt: float) -> bool:
        """Whether all joints are far from their position limits, for steps of dt [s]."""
        low, high = self._clear
        return dt <= _SHORT and every(q >= low) and every(q <= high)

    def scaled(self, velocity_scale: float) -> "JointLimits":
        """Return the limits with the speeds times ``velocity_scale``."""
        return replace(self, velocity=velocity_scale * self.velocity)

    def fallen(self, before: "JointLimits", fall: Array) -> "JointLimits":
        """Return these limits, of the speeds no less than ``fall`` (n,) below those before."""
        velocity = np.fmax(self.velocity, before.velocity - fall)
        return self if (velocity == self.velocity).all() else replace(self, velocity=velocity)

    def difference(self, q_c: Array, q: Array) -> Array:
        """Return q_c - q (n,) [rad or m]; modulo a turn where there are no position limits."""
        difference = q_c - q
        if not self._turns:
            return difference
        turns = 2 * np.pi * np.round(difference / (2 * np.pi))
        return np.where(np.isinf(self.upper), difference - turns, difference)

    def deviation(self, q_c: Array, q: Array) -> Array:
        """Return |q_c - q| (n,) [rad or m]; modulo a turn where there are no position limits."""
        return np.abs(self.difference(q_c, q))

    def stop_time(self, dq: Array) -> float:
        """Return the time [s] in which joints stop together from dq (n,); efforts follow late."""
        return float((np.abs(dq) / (_PLANNED * self.acceleration)).max())

    def contain(self, q: Array) -> bool:
        """Return whether the positions q (n,) are within the limits."""
        return every(q <= self.upper) and every(q >= self.lower)

    def excess(self, dq: Array) -> float:
        """Return by how much the velocities (n,) are beyond their limits; 1 if they are not."""
        speed = np.abs(dq)
        if every(speed <= self.velocity):
            return 1.0
        return float((speed / self.velocity).max())

    def excess_of_acceleration(self, dq: Array, ddq: Array) -> float:
        """Return ``excess`` of the velocities to which ddq (n,) leads from dq (n,)."""
        return self.excess(dq + ddq / _SPEED_RATE)

    def limit_velocity(
        self, q: Array, dq: Array, dt: float, before: Array | None = None
    ) -> tuple[Array, bool]:
        """Return dq within the limits, and whether it had to change.

        Too fast a motion is slowed as a whole, so that its direction is kept; too large a change
        is shortened as a whole, before + lambda (dq - before).  A joint near its position limit
        is no faster than it can brake, the others go on.  Only a joint that could not stop before
        its position limit otherwise brakes harder than its acceleration limit.

        Args:
            q: (n,) positions now.
            dq: (n,) velocities wanted; finite.
            dt: time that dq will last [s]; positive.
            before: (n,) velocities until now; None does not bound their change.
        """
        rate = min(POSITION_RATE, 1 / dt)
        if self._allow(q, dq, dt, rate, before):
            return dq, False
        high = self._fastest(self.upper - q, before, dt, rate)
        low = -self._fastest(q - self.lower, None if before is None else -before, dt, rate)
        limited = np.clip(dq / self.excess(dq), low, high)
        if before is not None:
            change = limited - before
            excess = float((np.abs(change) / (self.acceleration * dt)).max())
            if excess > 1:
                limited = np.clip(before + change / excess, low, high)
        return limited, bool((limited != dq).any())

    def _allow(self, q: Array, dq: Array, dt: float, rate: float, before: Array | None) -> bool:
        """Return whether dq (n,) keeps all limits as it is."""
        speed = np.abs(dq)
        if not every(speed <= self.velocity):
            return False
        if before is not None and not every(np.abs(dq - before) <= self.acceleration * dt):
            return False
        if self._is_clear(q, dt):
            return True
        room = np.maximum(np.where(dq > 0, self.upper - q, q - self.lower), 0.0)
        return bool((speed <= _braking_speed(room, self.acceleration, dt, rate)).all())

    def _fastest(self, room: Array, before: Array | None, dt: float, rate: float) -> Array:
        """Return how fast (n,) joints may be towards a limit that is ``room`` (n,) away."""
        room = np.maximum(room, 0.0)
        fastest = _braking_speed(room, self.acceleration, dt, rate)
        if before is None:
            return fastest
        speed = np.maximum(before, 0.0)
        needed = _braking(speed, room, dt)
        return np.maximum(fastest, before - np.maximum(self.acceleration, needed) * dt)

    def limit_acceleration(
        self, q: Array, dq: Array, ddq: Array, dt: float, drift: Array | float = 0.0
    ) -> tuple[Array, bool]:
        """Return ddq that keeps all limits, and whether it had to change.

        Too large an acceleration is shortened as a whole, so that its direction is kept; limits
        of speed and position are kept per joint.  From outside the position limits only the way
        back is open.  Only a joint that could not stop before its position limit otherwise brakes
        harder than its acceleration limit.

        Args:
            q, dq: (n,) positions and velocities now.
            ddq: (n,) accelerations wanted; finite.
            dt: time that ddq will last [s]; 0 if it is not known, but short.
            drift: (n,) by which the joints accelerate more than wanted, because of friction say;
                what is wanted against it does not count.
        """
        fastest = 1 / dt if dt > 0 else np.inf
        position_rate, speed_rate = min(POSITION_RATE, fastest), min(_SPEED_RATE, fastest)
        if (
            every(np.abs(ddq) <= self.acceleration)
            and every(np.abs(dq + ddq / speed_rate) <= self.velocity)
            and self._is_clear(q, dt)
        ):
            return ddq, False
        rates = dt, position_rate, speed_rate
        up = self.acceleration - np.minimum(drift, 0.0)
        down = self.acceleration + np.maximum(drift, 0.0)
        most = self._most(self.upper - q, dq, up, *rates)
        least = -self._most(q - self.lower, -dq, down, *rates)
        if every(ddq <= most) and every(ddq >= least):
            return ddq, False
        excess = max(1.0, float((ddq / np.where(ddq > 0, up, -down)).max()))
        return np.minimum(np.maximum(ddq / excess, least), most), True

    def _most(
        self,
        room: Array,
        dq: Array,
        most: Array,
        dt: float,
        position_rate: float,
        speed_rate: float,
    ) -> Array:
        """Return the largest accelerations (n,) towards a limit that is ``room`` (n,) away."""
        room, a = np.maximum(room, 0.0), self.acceleration
        high = np.minimum(
            self.velocity, _braking_speed(room, _PLANNED * a, dt, position_rate)
        )
        speed = np.maximum(dq, 0.0)
        needed = _braking(speed, room, dt)
        return np.minimum(np.maximum(speed_rate * (high - dq), -np.maximum(a, needed)), most)

    def limit_effort(self, effort: Array) -> tuple[Array, bool]:
        """Return the efforts (n,) cut to their limits, and whether one had to be cut."""
        if every(np.abs(effort) <= self.effort):
            return effort, False
        return np.minimum(np.maximum(effort, -self.effort), self.effort), True


def _braking_speed(room: Array, a: Array, dt: float, rate: float) -> Array:
    """Return the speed (n,) from which joints stop within ``room`` (n,) in steps of dt [s].

    It is rate * room up to v_0 = a / rate; a speed u beyond that needs the way
    (v_0 + u) / rate + u^2 / (2 a) + u dt / 2 + a dt^2 / 8: after a step it holds again.
    """
    linear = rate * room
    is_near = linear * rate <= a
    if is_near.all():
        return linear
    b = a * (1 / rate + dt / 2)
    with np.errstate(invalid="ignore"):  # of infinite limits, which are linear
        beyond = np.maximum(room - a / rate**2 - a * dt**2 / 8, 0.0)
        curved = a / rate - b + np.sqrt(b**2 + 2 * a * beyond)
    return np.where(is_near, linear, curved)


def _braking(speed: Array, room: Array, dt: float) -> Array:
    """Return the deceleration (n,) that stops joints within ``room`` (n,) in steps of dt [s]."""
    with np.errstate(over="ignore"):
        return speed * (speed / np.maximum(2 * room + speed * dt, _TINY))
