"""The last look at a command before it leaves: finite, within the limits, without a jump.

The laws keep the limits by themselves, in their own way; the limiter does not know them.  It
bounds whatever they, or a defect in them, ask for, also over a restart.

What a command has is rows of n floats; one that it has not is empty.
"""

import math

import numpy as np

from eulerparams_control.control.judge import NONE, difference
from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.compiled import Input, Inputs, Rows, entry, kernel
from eulerparams_control.laws.limits import SHORTEST, JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand

# A position that lags behind its command chases it at this rate [1/s].
_CHASE = 25.0

# A command may be this much [rad, m, rad/s, m/s, Nm] of rounding beyond what it may be.
_ROUNDING = 5e-13

# No acceleration is larger [rad/s^2 or m/s^2]; no time shorter [s].
_STEEP, _TINY = 1e9, 1e-300

# Rows of the limits, of what is known of the joints (whether one is not where it is to be, how far
# its last step led it), and codes: what is changed; then, shifted, what is not finite.
_LOWER, _UPPER, _VELOCITY, _EFFORT, _ACCELERATION, _RATE = range(6)
_LAGS, _LED = range(2)
_NAMES = ("q", "dq", "effort")
_Q, _DQ, _TAU = (1 << bit for bit in range(3))
_INFINITE = 3


class CommandLimiter:
    """Bounds each command by the limits of the joints and by the command before.

    Args:
        limits: of the joints; None bounds nothing, but what is not finite is refused still.
        effort_rate: [Nm/s] of each effort, or (n,).

    Attributes:
        limits: in force; see :meth:`bound`.
        effort_rate: as given; in force from the next :meth:`bound` on.
        bounded: how many commands had to be changed.
        commands_efforts: whether the command that acts is one of efforts.
    """

    def __init__(self, limits: JointLimits | None, effort_rate: Array | float = math.inf) -> None:
        self.effort_rate, self.bounded = effort_rate, 0
        self._joints = self._safe = self._bounds = np.zeros((6, 0))
        self.bound(limits)
        self.forget()

    def bound(self, limits: JointLimits | None) -> None:
        """Bound commands by these limits, and by ``effort_rate``, from now on."""
        self.limits = limits
        if limits is None:
            self._bounds = np.zeros((6, 0))
            return
        n = len(limits.lower)
        self._bounds = np.vstack([limits.rows, np.broadcast_to(self.effort_rate, n)])
        if self._joints.shape[1] != n:
            self._joints, self._safe = np.zeros((2, n)), np.zeros((3, n))

    def forget(self) -> None:
        """Start again: no command acts any more."""
        self._last: tuple[Array, Array, Array] = NONE, NONE, NONE
        self._joints[:] = 0.0
        self.commands_efforts = False

    def __call__(
        self, command: JointCommand, q: Array, elapsed: float, dt: float = 0.0
    ) -> JointCommand:
        """Return the command within all bounds.

        Args:
            command: of the scheme.
            q: (n,) measured positions: where the arm is beyond its limits, it may come back.
            elapsed: [s] since the command before.
            dt: [s] over which its velocity was integrated; 0: over what has elapsed.

        Raises:
            UnsafeCommandError: if a value is not finite; the command before still counts then.
        """
        q_c, dq, effort, frame = command
        rows = (
            NONE if q_c is None else q_c,
            NONE if dq is None else dq,
            NONE if effort is None else effort,
        )
        bounds, joints, safe = self._bounds, self._joints, self._safe
        code = _bounded(*rows, *self._last, q, bounds, joints, safe, elapsed, dt)
        if frame is not None and not _is_finite(*frame):
            raise UnsafeCommandError("the command has a compliant frame that is not finite")
        if code:
            rows = self._changed(rows, code)
            q_c, dq, effort = (row if len(row) else None for row in rows)
            command = command._replace(q=q_c, dq=dq, effort=effort)
        self._last, self.commands_efforts = rows, effort is not None
        return command

    def _changed(self, rows: tuple[Array, ...], code: int) -> tuple[Array, Array, Array]:
        """Return rows where those of the code are bounded; raise UnsafeCommandError for others."""
        if code >> _INFINITE:
            at = next(k for k in range(len(rows)) if code >> _INFINITE + k & 1)
            values = self._safe[at] if code & (1 << at) else rows[at]
            name, shown = _NAMES[at], values.tolist()
            raise UnsafeCommandError(f"the command has a non-finite {name}: {shown}")
        self.bounded += 1
        q, dq, effort = (
            self._safe[k].copy() if code & (1 << k) else row for k, row in enumerate(rows)
        )
        return q, dq, effort


@entry
def _is_finite(p: Input, R: Inputs, dp: Input, omega: Input, ddp: Input, domega: Input) -> bool:
    """Return whether a frame is finite."""
    total = 0.0
    for i in range(3):
        total += 0.0 * (p[i] + R[i, 0] + R[i, 1] + R[i, 2])
        total += 0.0 * (dp[i] + omega[i] + ddp[i] + domega[i])
    return bool(total == 0.0)


@kernel
def _infinite(values: Array) -> int:
    """Return 1 if a value is not finite, else 0."""
    for value in values:
        if not math.isfinite(value):
            return 1
    return 0


@kernel
def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@kernel
def _bound_position(
    safe: Array, q_c: Array, dq: Array, q_0: Array, dq_0: Array, q: Array,
    bounds: Array, joints: Array, elapsed: float, lasted: float,
) -> bool:  # fmt: skip
    """Fill ``safe`` with q_c where the motion until now can lead to; return whether it changed.

    The measured q is there.  A joint that cannot be where it is to be goes on by its velocity,
    which chases; it gets there where that bends its motion, before and after, by no more than it
    may.
    """
    fits_all = True
    for i in range(len(q_c)):
        fits_all = fits_all and bounds[_LOWER, i] <= q_c[i] <= bounds[_UPPER, i]
        safe[i] = q_c[i]
        if len(q_0):
            reach, bend = _reach(i, dq_0, bounds, elapsed, lasted)
            step = difference(q_c[i], q_0[i], math.isinf(bounds[_UPPER, i]))
            led = lasted * dq_0[i] if len(dq_0) else 0.0
            fits = abs(step) <= reach + _ROUNDING and abs(step - led) <= bend
            if joints[_LAGS, i]:
                leads = lasted * dq[i] if len(dq) else 0.0
                fits = fits and abs(step - joints[_LED, i]) <= bend and abs(step - leads) <= bend
            joints[_LAGS, i], joints[_LED, i] = not fits, led
            fits_all = fits_all and fits and abs(q_c[i] - (q_0[i] + step)) <= _ROUNDING
            if not fits and not math.isinf(bend):
                step = led if len(dq_0) else _clip(step, -bend, bend)
            safe[i] = q_0[i] + step
    changes = False
    for i in range(len(q_c)):
        low, high = min(bounds[_LOWER, i], q[i]), max(bounds[_UPPER, i], q[i])  # it may come back
        if len(q_0):
            reach, _ = _reach(i, dq_0, bounds, elapsed, lasted)
            low = max(min(low, q_0[i]), q_0[i] - reach)
            high = min(max(high, q_0[i]), q_0[i] + reach)
        safe[i] = _clip(safe[i], low, high)
        changes = changes or safe[i] != q_c[i]
    return changes and not fits_all


@kernel
def _reach(
    i: int, dq_0: Array, bounds: Array, elapsed: float, lasted: float
) -> tuple[float, float]:
    """Return how far a joint may have come, and by how much its step may differ from the last."""
    fastest = bounds[_VELOCITY, i]
    if len(dq_0):  # its limit may have been lowered since
        fastest = max(fastest, abs(dq_0[i]))
    bend = bounds[_ACCELERATION, i] * (lasted * lasted) + _ROUNDING
    return (fastest * elapsed if elapsed > 0 else 0.0), bend


@kernel
def _bound_velocity(
    safe: Array, q_c: Array, q_safe: Array, dq: Array, dq_0: Array,
    bounds: Array, lasted: float, chases: bool,
) -> bool:  # fmt: skip
    """Fill ``safe`` with dq where the velocity until now can have come to; return if it changed.

    Where the position lags behind its command, ``q_safe`` behind ``q_c``, it chases that.
    """
    fits_all, changes = not chases, False
    for i in range(len(dq)):
        before = dq_0[i] if len(dq_0) else 0.0
        most, change, wanted = bounds[_VELOCITY, i], bounds[_ACCELERATION, i] * lasted, dq[i]
        fits = abs(wanted) <= most and abs(wanted - before) <= change + _ROUNDING
        fits_all = fits_all and fits
        if chases:
            chase = difference(q_c[i], q_safe[i], math.isinf(bounds[_UPPER, i]))
            lag, a = abs(chase), min(bounds[_ACCELERATION, i], _STEEP)
            speed = min(min(_CHASE, 0.5 / lasted) * lag, math.sqrt(a * lag))
            wanted += math.copysign(speed, chase)
        safe[i] = _clip(_clip(wanted, before - change, before + change), -most, most)
        changes = changes or safe[i] != dq[i]
    return changes and not fits_all


@kernel
def _bound_effort(
    safe: Array, effort: Array, effort_0: Array, bounds: Array, elapsed: float
) -> bool:
    """Fill ``safe`` with efforts within their limits and rates; return whether they changed."""
    fits_all, changes = True, False
    for i in range(len(effort)):
        most, reach = bounds[_EFFORT, i], bounds[_RATE, i] * max(elapsed, _TINY)
        low, high = -most, most
        fits_all = fits_all and abs(effort[i]) <= most
        if len(effort_0):
            fits_all = fits_all and abs(effort[i] - effort_0[i]) <= reach + _ROUNDING
            low = max(min(low, effort_0[i]), effort_0[i] - reach)
            high = min(max(high, effort_0[i]), effort_0[i] + reach)
        safe[i] = _clip(effort[i], low, high)
        changes = changes or safe[i] != effort[i]
    return changes and not fits_all


@entry
def _bounded(
    q_c: Input, dq: Input, effort: Input, q_0: Input, dq_0: Input, effort_0: Input,
    q: Input, bounds: Rows, joints: Rows, safe: Rows, elapsed: float, dt: float,
) -> int:  # fmt: skip
    """Fill ``safe`` (3, n) with what has to change of a command, and return which, as a code.

    Args:
        q_c, dq, effort: (n,) of the command.
        q_0, dq_0, effort_0: (n,) of the one before.
        q: (n,) measured.
        bounds, joints: rows of the limits, and of what is known of the joints.
        safe: (3, n).
        elapsed, dt: [s] as the limiter is given them.
    """
    code: int = _infinite(q_c) | _infinite(dq) << 1 | _infinite(effort) << 2
    if code or bounds.shape[1] == 0:
        return code << _INFINITE
    lasted = dt if dt > 0 else (elapsed if elapsed > 0 else SHORTEST)
    if _bound_position(safe[0], q_c, dq, q_0, dq_0, q, bounds, joints, elapsed, lasted):
        code |= _Q | _infinite(safe[0]) << _INFINITE
    if _bound_velocity(safe[1], q_c, safe[0], dq, dq_0, bounds, lasted, code != 0):
        code |= _DQ | _infinite(safe[1]) << _INFINITE + 1
    if _bound_effort(safe[2], effort, effort_0, bounds, elapsed):
        code |= _TAU | _infinite(safe[2]) << _INFINITE + 2
    return code
