"""Joint limits, and how velocity, acceleration and effort commands are kept within them.

Notation: ``d`` [rad or m] distance to a position limit, ``a`` [rad/s^2] acceleration limit, ``r``
[1/s] POSITION_RATE.  A joint that moves towards a limit at the speed v has to stop within d:

    v <= r d               close to it
    v <= sqrt(2 a d)       away from it

joined smoothly at v = a / r, so that no more than a is ever needed to keep to both.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eulerparams_control.laws.jit import Array, b1, f8, jit, matrix, new_vector, types, vector

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

NONE: Array = np.empty(0)
"""Stands for an array that there is not, where a primitive expects one."""

_limited = types.Tuple((new_vector, b1))


@dataclass(frozen=True)
class JointLimits:
    """Limits of n joints, each (n,); infinite where there is no limit."""

    lower: Array  # [rad or m]
    upper: Array
    velocity: Array  # [rad/s or m/s]
    effort: Array  # [Nm or N]
    acceleration: Array = field(default_factory=lambda: np.array(math.inf))

    def __post_init__(self) -> None:
        a = np.broadcast_to(self.acceleration, np.shape(self.velocity)).astype(float)
        object.__setattr__(self, "acceleration", a)

    @cached_property
    def rows(self) -> Array:
        """All limits (5, n) in their order, as the primitives take them."""
        return np.array([self.lower, self.upper, self.velocity, self.effort, self.acceleration])

    @cached_property
    def without_accelerations(self) -> "JointLimits":
        """The limits of positions, speeds and efforts alone."""
        return replace(self, acceleration=np.array(math.inf))

    @property
    def effort_rate(self) -> Array:
        """(n,) [Nm/s] of the efforts: to their limits within 0.02 s, 2000 Nm/s at least."""
        rate: Array = np.maximum(self.effort / 0.02, 2000.0)
        return rate

    def fallen(self, before: "JointLimits", fall: Array) -> "JointLimits":
        """Return these limits, of the speeds no less than ``fall`` (n,) below those before."""
        velocity = np.fmax(self.velocity, before.velocity - fall)
        return self if (velocity == self.velocity).all() else replace(self, velocity=velocity)

    def difference(self, q_c: Array, q: Array) -> Array:
        """Return q_c - q (n,) [rad or m]; modulo a turn where there are no position limits."""
        return _differences(self.rows, q_c, q)

    def integrated(self, q: Array, dq: Array, dt: float) -> Array:
        """Return q + dt dq (n,); motion outward beyond limits of positions is cut."""
        low, high = np.minimum(self.lower, q), np.maximum(self.upper, q)
        after: Array = np.minimum(np.maximum(q + dt * dq, low), high)
        return after

    def stop_time(self, dq: Array) -> float:
        """Return the time [s] in which joints stop together from dq (n,); efforts follow late."""
        return float((np.abs(dq) / (_PLANNED * self.acceleration)).max(initial=0.0))

    def excess(self, dq: Array) -> float:
        """Return the largest ratio, >= 1, of the velocities (n,) to their limits."""
        return _excess(self.rows, dq)

    def excess_after(self, dq: Array, ddq: Array) -> float:
        """Return ``excess`` of the velocities to which ddq (n,) leads from dq (n,)."""
        return _excess(self.rows, dq + ddq / _SPEED_RATE)

    def limit_velocity(self, q: Array, dq: Array, dt: float, before: Array) -> tuple[Array, bool]:
        """Return dq (n,) within the limits for dt [s] > 0, and whether it had to change.

        ``before`` (n,) is the velocity until now.  Too fast a motion is slowed as a whole, so that
        its direction is kept; too large a change is shortened as a whole, before + lambda
        (dq - before).  A joint near its position limit is no faster than it can brake, the others
        go on.  Only one that could not stop before its position limit otherwise brakes harder than
        its acceleration limit.
        """
        return _limit_velocity(self.rows, q, dq, dt, before)

    def limit_acceleration(
        self, q: Array, dq: Array, ddq: Array, dt: float, drift: Array | None = None
    ) -> tuple[Array, bool]:
        """Return ddq (n,) that keeps all limits for dt [s], and whether it had to change.

        Too large an acceleration is shortened as a whole, so that its direction is kept; limits
        of speed and position are kept per joint, as by ``limit_velocity``.  From outside the
        position limits only the way back is open.

        Args:
            q, dq, ddq: (n,) the state, and the wanted acceleration.
            dt: 0 if it is not known, but short.
            drift: (n,) by which the joints accelerate more than wanted, because of friction say;
                what is wanted against it does not count.
        """
        drift = np.zeros(len(ddq)) if drift is None else drift
        return _limit_acceleration(self.rows, q, dq, ddq, dt, drift)

    def limit_effort(self, effort: Array) -> tuple[Array, bool]:
        """Return the efforts (n,) cut to their limits, and whether one had to be cut."""
        limited: Array = np.minimum(np.maximum(effort, -self.effort), self.effort)
        return limited, bool((limited != effort).any())


@jit(f8(vector, vector, vector))
def factor_within(base: Array, step: Array, most: Array) -> float:
    """Return the largest factor s from 0 to 1 with which |base + s step| <= most, all (n,).

    A joint that is beyond its bound already does not count, or it would stop all others.
    """
    factor = 1.0
    for i in range(len(step)):
        room = most[i] - base[i] if step[i] > 0.0 else most[i] + base[i]
        if room >= 0.0 and abs(step[i]) * factor > room:
            factor = room / abs(step[i])
    return factor


# --- of one joint ---------------------------------------------------------------------------


@jit(f8(f8, f8, f8))
def clip(value: float, low: float, high: float) -> float:
    """Return a value within bounds; NaN where one of the three is."""
    if math.isnan(low) or math.isnan(high):
        return math.nan
    return min(max(value, low), high)


@jit(f8(f8, f8, b1))
def difference(q_c: float, q: float, is_endless: bool) -> float:
    """Return q_c - q [rad or m]; modulo a turn where there is no position limit."""
    change = q_c - q
    if is_endless:
        change -= 2.0 * math.pi * np.rint(change / (2.0 * math.pi))
    return change


@jit(f8(f8, f8))
def _rate(most: float, dt: float) -> float:
    """Return the rate [1/s] at which a limit is approached in steps of dt [s]."""
    return min(most, 1.0 / dt) if dt > 0.0 else most


@jit(f8(f8, f8, f8))
def _braking_speed(room: float, a: float, dt: float) -> float:
    """Return the speed from which a joint stops within ``room`` in steps of dt [s].

    It is rate * room up to v_0 = a / rate; a speed u beyond that needs the way
    (v_0 + u) / rate + u^2 / (2 a) + u dt / 2 + a dt^2 / 8: after a step it holds again.
    """
    rate = _rate(POSITION_RATE, dt)
    linear = rate * room
    if linear * rate <= a:
        return linear
    b = a * (1.0 / rate + dt / 2.0)
    beyond = max(room - a / (rate * rate) - a * (dt * dt) / 8.0, 0.0)
    return a / rate - b + math.sqrt(b * b + 2.0 * a * beyond)


@jit(f8(f8, f8, f8))
def _braking(speed: float, room: float, dt: float) -> float:
    """Return the deceleration that stops a joint within ``room`` in steps of dt [s]."""
    return speed * (speed / max(2.0 * room + speed * dt, _TINY))


@jit(f8(f8, f8, f8, f8))
def _fastest(room: float, before: float, a: float, dt: float) -> float:
    """Return how fast a joint may be towards a limit that is ``room`` away."""
    room = max(room, 0.0)
    needed = _braking(max(before, 0.0), room, dt)
    return max(_braking_speed(room, a, dt), before - max(a, needed) * dt)


@jit(f8(f8, f8, f8, f8, f8))
def _strongest(room: float, dq: float, high: float, a: float, dt: float) -> float:
    """Return the largest acceleration, up to a, towards a limit that is ``room`` away."""
    room = max(room, 0.0)
    high = min(high, _braking_speed(room, _PLANNED * a, dt))
    needed = _braking(max(dq, 0.0), room, dt)
    return min(max(_rate(_SPEED_RATE, dt) * (high - dq), -max(a, needed)), a)


# --- of n joints; ``limits`` are JointLimits.rows, see the methods that call these --------------

_LOWER, _UPPER, _VELOCITY, _, _ACCELERATION = range(5)


@jit(new_vector(matrix, vector, vector))
def _differences(limits: Array, q_c: Array, q: Array) -> Array:
    away = np.empty(len(q))
    for i in range(len(q)):
        away[i] = difference(q_c[i], q[i], math.isinf(limits[_UPPER, i]))
    return away


@jit(f8(matrix, vector))
def _excess(limits: Array, dq: Array) -> float:
    most = 1.0
    for i in range(len(dq)):
        if math.isnan(dq[i]):
            return math.nan
        if abs(dq[i]) > limits[_VELOCITY, i]:
            most = max(most, abs(dq[i]) / limits[_VELOCITY, i])
    return most


@jit(_limited(matrix, vector, vector, f8, vector))
def _limit_velocity(
    limits: Array, q: Array, dq: Array, dt: float, before: Array
) -> tuple[Array, bool]:
    slowed, shortened, changed = _excess(limits, dq), 1.0, False
    limited, low, high = np.empty(len(q)), np.empty(len(q)), np.empty(len(q))
    for i in range(len(q)):
        a = limits[_ACCELERATION, i]
        low[i] = -_fastest(q[i] - limits[_LOWER, i], -before[i], a, dt)
        high[i] = _fastest(limits[_UPPER, i] - q[i], before[i], a, dt)
        limited[i] = clip(dq[i] / slowed, low[i], high[i])
        shortened = max(shortened, abs(limited[i] - before[i]) / (a * dt))
    for i in range(len(q)):
        if shortened > 1.0:
            limited[i] = clip(before[i] + (limited[i] - before[i]) / shortened, low[i], high[i])
        changed = changed or limited[i] != dq[i]
    return limited, changed


@jit(_limited(matrix, vector, vector, vector, f8, vector))
def _limit_acceleration(
    limits: Array, q: Array, dq: Array, ddq: Array, dt: float, drift: Array
) -> tuple[Array, bool]:
    shortened, changed, limited = 1.0, False, np.empty(len(q))
    for i in range(len(q)):
        a = limits[_ACCELERATION, i]
        up, down = a - min(drift[i], 0.0), a + max(drift[i], 0.0)
        shortened = max(shortened, ddq[i] / (up if ddq[i] > 0.0 else -down))
    for i in range(len(q)):
        a, high = limits[_ACCELERATION, i], limits[_VELOCITY, i]
        # the limits of speed and position are for what a contact leaves of the acceleration
        most = _strongest(limits[_UPPER, i] - q[i], dq[i], high, a, dt) - min(drift[i], 0.0)
        least = -_strongest(q[i] - limits[_LOWER, i], -dq[i], high, a, dt) - max(drift[i], 0.0)
        limited[i] = clip(ddq[i] / shortened, least, most)
        changed = changed or limited[i] != ddq[i]
    return limited, changed
