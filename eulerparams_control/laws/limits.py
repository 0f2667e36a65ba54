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

from eulerparams_control.laws._old.compiled import NONE, Array, Input, Row, Rows, entry, kernel

POSITION_RATE = 10.0
"""A joint approaches a position limit no faster than its distance times this [1/s]: without
overshoot, as long as a command does not last longer than the inverse."""

# The same for its speed limit, by the remaining speed.
_SPEED_RATE = 100.0

SHORTEST = 1e-3
"""Time [s] that a command is taken to last where that is not known."""

# Part of the acceleration limit by which efforts plan to brake: they follow late.
_PLANNED = 0.8

_FULL_EFFORT_TIME, _LEAST_EFFORT_RATE = 0.02, 2000.0

_TINY = 1e-300

UNLIMITED = np.empty((5, 0))
"""No limits, as formulas take them."""


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
    def rows(self) -> Array:
        """All limits (5, n) in the order of the attributes, as formulas take them."""
        return np.array([self.lower, self.upper, self.velocity, self.effort, self.acceleration])

    @property
    def effort_rate(self) -> Array:
        """(n,) [Nm/s] at which efforts may change, if nothing else is said.

        They get to their limits within 0.02 s, and no slower than at 2000 Nm/s.
        """
        rate: Array = np.maximum(self.effort / _FULL_EFFORT_TIME, _LEAST_EFFORT_RATE)
        return rate

    def scaled(self, velocity_scale: float) -> "JointLimits":
        """Return the limits with the speeds times ``velocity_scale``."""
        return replace(self, velocity=velocity_scale * self.velocity)

    def fallen(self, before: "JointLimits", fall: Array) -> "JointLimits":
        """Return these limits, of the speeds no less than ``fall`` (n,) below those before."""
        velocity = np.fmax(self.velocity, before.velocity - fall)
        return self if (velocity == self.velocity).all() else replace(self, velocity=velocity)

    def difference(self, q_c: Array, q: Array) -> Array:
        """Return q_c - q (n,) [rad or m]; modulo a turn where there are no position limits."""
        difference = np.empty(len(q))
        subtract(self.rows, q_c, q, difference)
        return difference

    def deviation(self, q_c: Array, q: Array) -> Array:
        """Return |q_c - q| (n,) [rad or m]; modulo a turn where there are no position limits."""
        return np.abs(self.difference(q_c, q))

    def integrated(self, q: Array, dq: Array, dt: float) -> Array:
        """Return q + dt dq (n,); motion outward beyond limits of positions is cut."""
        low, high = np.minimum(self.lower, q), np.maximum(self.upper, q)
        after: Array = np.minimum(np.maximum(q + dt * dq, low), high)
        return after

    def stop_time(self, dq: Array) -> float:
        """Return the time [s] in which joints stop together from dq (n,); efforts follow late."""
        return stop_time(self.rows, dq)

    def contain(self, q: Array) -> bool:
        """Return whether the positions q (n,) are within the limits."""
        return bool(((self.lower <= q) & (q <= self.upper)).all())

    def excess(self, dq: Array) -> float:
        """Return by how much the velocities (n,) are beyond their limits; 1 if they are not."""
        return excess(self.rows, dq)

    def excess_after(self, dq: Array, ddq: Array) -> float:
        """Return ``excess`` of the velocities to which ddq (n,) leads from dq (n,)."""
        return excess(self.rows, dq + ddq / _SPEED_RATE)

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
        limited = np.empty(len(dq))
        before = NONE if before is None else before
        changed = limit_velocity(self.rows, q, dq, dt, before, limited)
        return (limited, True) if changed else (dq, False)

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
        limited = np.empty(len(ddq))
        drift = drift if isinstance(drift, np.ndarray) else np.full(len(ddq), drift)
        changed = limit_acceleration(self.rows, q, dq, ddq, dt, drift, limited)
        return (limited, True) if changed else (ddq, False)

    def limit_effort(self, effort: Array) -> tuple[Array, bool]:
        """Return the efforts (n,) cut to their limits, and whether one had to be cut."""
        limited = np.empty(len(effort))
        changed = limit_effort(self.rows, effort, limited)
        return (limited, True) if changed else (effort, False)


def rows_of(limits: JointLimits | None) -> Array:
    """Return the rows of limits; UNLIMITED where there are none."""
    return UNLIMITED if limits is None else limits.rows


# --- of one joint ---------------------------------------------------------------------------


@kernel
def clip(value: float, low: float, high: float) -> float:
    """Return a value within bounds; NaN if one of the three is."""
    if math.isnan(low) or math.isnan(high):
        return math.nan
    return min(max(value, low), high)


@kernel
def difference(q_c: float, q: float, is_endless: bool) -> float:
    """Return q_c - q [rad or m]; modulo a turn where there is no position limit."""
    change = q_c - q
    if is_endless:
        change -= 2.0 * math.pi * np.rint(change / (2.0 * math.pi))
    return change


@kernel
def _rate(most: float, dt: float) -> float:
    """Return the rate [1/s] at which a limit is approached in steps of dt [s]."""
    return min(most, 1.0 / dt) if dt > 0.0 else most


@kernel
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


@kernel
def _braking(speed: float, room: float, dt: float) -> float:
    """Return the deceleration that stops a joint within ``room`` in steps of dt [s]."""
    return speed * (speed / max(2.0 * room + speed * dt, _TINY))


@kernel
def _fastest(room: float, before: float, a: float, dt: float) -> float:
    """Return how fast a joint may be towards a limit that is ``room`` away."""
    room = max(room, 0.0)
    needed = _braking(max(before, 0.0), room, dt)
    return max(_braking_speed(room, a, dt), before - max(a, needed) * dt)


@kernel
def _most(room: float, dq: float, high: float, a: float, most: float, dt: float) -> float:
    """Return the largest acceleration towards a limit that is ``room`` away, up to ``most``."""
    room = max(room, 0.0)
    high = min(high, _braking_speed(room, _PLANNED * a, dt))
    needed = _braking(max(dq, 0.0), room, dt)
    return min(max(_rate(_SPEED_RATE, dt) * (high - dq), -max(a, needed)), most)


# --- of n joints; ``limits`` (5, n) are JointLimits.rows --------------------------------------

_LOWER, _UPPER, _VELOCITY, _EFFORT, _ACCELERATION = range(5)


@entry
def subtract(limits: Rows, q_c: Input, q: Input, away: Row) -> None:
    """Fill ``away`` (n,) as :meth:`JointLimits.difference`."""
    for i in range(len(q)):
        is_endless = limits.shape[1] > 0 and math.isinf(limits[_UPPER, i])
        away[i] = difference(q_c[i], q[i], is_endless)


@entry
def is_finite(values: Input) -> bool:
    """Return whether all numbers of a row are finite."""
    for i in range(len(values)):  # noqa: SIM110  a generator is not compiled
        if not math.isfinite(values[i]):
            return False
    return True


@entry
def agree(limits: Rows, q_c: Input, q: Input, most: float) -> bool:
    """Return whether no joint deviates by more than ``most`` [rad or m]."""
    away = np.empty(len(q))
    subtract(limits, q_c, q, away)
    for i in range(len(q)):  # noqa: SIM110  a generator is not compiled
        if not abs(away[i]) <= most:
            return False
    return True


@entry
def integrate(limits: Rows, q: Input, dq: Input, dt: float, after: Row) -> None:
    """Fill ``after`` (n,) with q + dt dq; motion outward beyond limits of positions is cut."""
    for i in range(len(q)):
        after[i] = q[i] + dt * dq[i]
        if limits.shape[1] > 0 and not math.isnan(after[i]):
            low, high = min(limits[_LOWER, i], q[i]), max(limits[_UPPER, i], q[i])
            after[i] = clip(after[i], low, high)


@entry
def stop_time(limits: Rows, dq: Input) -> float:
    """Return :meth:`JointLimits.stop_time` [s]."""
    longest = 0.0
    for i in range(len(dq)):
        longest = max(longest, abs(dq[i]) / (_PLANNED * limits[_ACCELERATION, i]))
    return longest


@entry
def excess(limits: Rows, dq: Input) -> float:
    """Return by how much the velocities (n,) are beyond their limits; 1 if they are not."""
    most = 1.0
    for i in range(len(dq)):
        if math.isnan(dq[i]):
            return math.nan
        if abs(dq[i]) > limits[_VELOCITY, i]:
            most = max(most, abs(dq[i]) / limits[_VELOCITY, i])
    return most


@kernel
def excess_after(limits: Rows, dq: Input, ddq: Row) -> float:
    """Return ``excess`` of the velocities to which ddq (n,) leads from dq (n,)."""
    after = np.empty(len(dq))
    for i in range(len(dq)):
        after[i] = dq[i] + ddq[i] / _SPEED_RATE
    return excess(limits, after)


@kernel
def _span(limits: Rows, i: int, q: float, before: Input, dt: float) -> tuple[float, float]:
    """Return the least and the largest velocity of joint i."""
    a, up, down = limits[_ACCELERATION, i], -math.inf, -math.inf
    if len(before) > 0:
        up, down = before[i], -before[i]
    low = -_fastest(q - limits[_LOWER, i], down, a, dt)
    return low, _fastest(limits[_UPPER, i] - q, up, a, dt)


@entry
def limit_velocity(
    limits: Rows, q: Input, dq: Input, dt: float, before: Input, limited: Row
) -> bool:
    """Fill ``limited`` (n,) as :meth:`JointLimits.limit_velocity`; return if it changed.

    ``before`` (0,) does not bound the change.
    """
    slowed, shortened, changed = excess(limits, dq), 1.0, False
    for i in range(len(q)):
        low, high = _span(limits, i, q[i], before, dt)
        limited[i] = clip(dq[i] / slowed, low, high)
        if len(before) > 0:
            change = abs(limited[i] - before[i])
            shortened = max(shortened, change / (limits[_ACCELERATION, i] * dt))
    for i in range(len(q)):
        if shortened > 1.0:
            low, high = _span(limits, i, q[i], before, dt)
            limited[i] = clip(before[i] + (limited[i] - before[i]) / shortened, low, high)
        changed = changed or limited[i] != dq[i]
    return changed


@entry
def limit_acceleration(
    limits: Rows, q: Input, dq: Input, ddq: Input, dt: float, drift: Input, limited: Row
) -> bool:
    """Fill ``limited`` (n,) as :meth:`JointLimits.limit_acceleration`; return if it changed."""
    shortened, changed = 1.0, False
    for i in range(len(q)):
        a = limits[_ACCELERATION, i]
        up, down = a - min(drift[i], 0.0), a + max(drift[i], 0.0)
        shortened = max(shortened, ddq[i] / (up if ddq[i] > 0.0 else -down))
    for i in range(len(q)):
        a, high = limits[_ACCELERATION, i], limits[_VELOCITY, i]
        # the limits of speed and position are for what a contact leaves of the acceleration
        most = _most(limits[_UPPER, i] - q[i], dq[i], high, a, a, dt) - min(drift[i], 0.0)
        least = -_most(q[i] - limits[_LOWER, i], -dq[i], high, a, a, dt) - max(drift[i], 0.0)
        limited[i] = clip(ddq[i] / shortened, least, most)
        changed = changed or limited[i] != ddq[i]
    return changed


@kernel
def without_accelerations(limits: Rows) -> Rows:
    """Return the limits without those of the accelerations."""
    free = limits.copy()
    for i in range(limits.shape[1]):
        free[_ACCELERATION, i] = math.inf
    return free


@entry
def factor_within(base: Input, step: Input, most: Input) -> float:
    """Return the largest factor s from 0 to 1 with which |base + s step| <= most, all (n,).

    One factor for all keeps the direction of a step; joint by joint it would turn.  A joint that is
    beyond its bound already does not count, or it would stop all others: clip it afterwards.
    """
    factor = 1.0
    for i in range(len(step)):
        room = most[i] - base[i] if step[i] > 0.0 else most[i] + base[i]
        if room >= 0.0 and abs(step[i]) * factor > room:
            factor = room / abs(step[i])
    return factor


@entry
def limit_effort(limits: Rows, effort: Input, limited: Row) -> bool:
    """Fill ``limited`` (n,) as :meth:`JointLimits.limit_effort`; return if one changed."""
    changed = False
    for i in range(len(effort)):
        most = limits[_EFFORT, i]
        limited[i] = clip(effort[i], -most, most)
        changed = changed or limited[i] != effort[i]
    return changed
