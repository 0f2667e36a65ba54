"""The last look at a command before it leaves: finite, within the limits, without a jump.

The laws keep the limits by themselves, in their own way; the limiter does not know them.  It
bounds whatever they, or a defect in them, ask for, also over a restart.

What a command has is rows of n floats; one that it has not is empty.
"""

import math

import numpy as np

from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.compiled import NONE, Input, Rows, entry, kernel
from eulerparams_control.laws.limits import SHORTEST, JointLimits, clip, difference
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand

# A position that lags behind its command chases it at this rate [1/s].
_CHASE = 25.0

# A command may be this much [rad, m, rad/s, m/s, Nm] of rounding beyond what it may be.
_ROUNDING = 5e-13

# No acceleration is larger [rad/s^2 or m/s^2]; no time shorter [s].
_STEEP, _TINY = 1e9, 1e-300

# Rows of the limits, and of what is known of the joints: whether one is not where it is to be, and
# how far its last step led it.  Codes: what is changed of a command, and what is not finite.
_LOWER, _UPPER, _VELOCITY, _EFFORT, _ACCELERATION, _RATE = range(6)
_LAGS, _LED = range(2)
_PARTS, _INFINITE = ("q", "dq", "effort"), (8, 16, 32)


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

    @property
    def runaway_limits(self) -> Array:
        """Limits (n,) of the speeds of an arm that may run away; (0,): it cannot."""
        limits = self.limits
        return NONE if limits is None or not self.commands_efforts else limits.velocity

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
        q_c, dq, effort, frame_row = command
        rows = (
            NONE if q_c is None else q_c,
            NONE if dq is None else dq,
            NONE if effort is None else effort,
        )
        if frame_row is not None and not _is_finite(frame_row):
            raise UnsafeCommandError("the command has a compliant frame that is not finite")
        (q_0, dq_0, effort_0), bounds, safe, code = self._last, self._bounds, self._safe, 0
        if effort is not None:
            code = _bounded_effort(effort, effort_0, bounds, elapsed, safe)
        if q_c is not None or dq is not None:
            motion, joints = (*rows[:2], q_0, dq_0, q), self._joints
            code |= _bounded_motion(*motion, bounds, joints, elapsed, dt, safe)
        if code:
            for part, row, bit in zip(_PARTS, rows, _INFINITE, strict=True):
                if code & bit:
                    raise UnsafeCommandError(f"the command has a non-finite {part}: {row.tolist()}")
            self.bounded += 1
            kept = [safe[k].copy() if code & 1 << k else row for k, row in enumerate(rows)]
            rows = kept[0], kept[1], kept[2]
            q_c, dq, effort = (row if len(row) else None for row in rows)
            command = JointCommand(q_c, dq, effort, frame_row)
        self._last, self.commands_efforts = rows, effort is not None
        return command


@entry
def _is_finite(row: Input) -> bool:
    """Return whether all numbers of a row are finite."""
    total = 0.0
    for value in row:
        total += abs(value)
    return math.isfinite(total)


@kernel
def _position(
    i: int, q_c: Array, dq: Array, q_0: Array, dq_0: Array, q: float,
    bounds: Array, joints: Array, elapsed: float, lasted: float,
) -> float:  # fmt: skip
    """Return q_c of a joint, measured at q, where the motion until now can lead to.

    A joint that cannot be where it is to be goes on by its velocity, which chases; it gets there
    where that bends its motion, before and after, by no more than it may.
    """
    low, high = min(bounds[_LOWER, i], q), max(bounds[_UPPER, i], q)  # it may come back
    if len(q_0) == 0:
        return clip(q_c[i], low, high)
    fastest, led, leads = bounds[_VELOCITY, i], 0.0, lasted * dq[i] if len(dq) else 0.0
    if len(dq_0):  # the limit of the speed may have been lowered since
        fastest, led = max(fastest, abs(dq_0[i])), lasted * dq_0[i]
    reach = fastest * elapsed if elapsed > 0 else 0.0
    bend = bounds[_ACCELERATION, i] * (lasted * lasted) + _ROUNDING
    step = difference(q_c[i], q_0[i], math.isinf(bounds[_UPPER, i]))
    lags = abs(step) > reach + _ROUNDING or abs(step - led) > bend
    if joints[_LAGS, i]:
        lags = lags or abs(step - joints[_LED, i]) > bend or abs(step - leads) > bend
    joints[_LAGS, i], joints[_LED, i] = lags, led
    if lags and not math.isinf(bend):
        step = led if len(dq_0) else clip(step, -bend, bend)
    elif low <= q_c[i] <= high and not lags and abs(q_0[i] + step - q_c[i]) <= _ROUNDING:
        return q_c[i]
    low, high = max(min(low, q_0[i]), q_0[i] - reach), min(max(high, q_0[i]), q_0[i] + reach)
    return clip(q_0[i] + step, low, high)


@kernel
def _velocity(i: int, dq: float, before: float, lag: float, bounds: Array, lasted: float) -> float:
    """Return dq of a joint where the velocity until now, ``before``, can have come to.

    It chases what its position lags behind.
    """
    most, a = bounds[_VELOCITY, i], bounds[_ACCELERATION, i]
    change = a * lasted
    if lag != 0.0:
        rate, way = min(_CHASE, 0.5 / lasted), abs(lag)
        dq += math.copysign(min(rate * way, math.sqrt(min(a, _STEEP) * way)), lag)
    elif abs(dq) <= most and abs(dq - before) <= change + _ROUNDING:
        return dq
    return clip(clip(dq, before - change, before + change), -most, most)


@kernel
def _effort(i: int, effort: float, last: Array, bounds: Array, elapsed: float) -> float:
    """Return the effort of a joint within its limit and rate."""
    low, high = -bounds[_EFFORT, i], bounds[_EFFORT, i]
    if len(last):
        reach = bounds[_RATE, i] * max(elapsed, _TINY)
        if abs(effort) <= high and abs(effort - last[i]) <= reach + _ROUNDING:
            return effort
        low = max(min(low, last[i]), last[i] - reach)
        high = min(max(high, last[i]), last[i] + reach)
    return clip(effort, low, high)


@entry
def _bounded_effort(
    effort: Input, effort_0: Input, bounds: Rows, elapsed: float, safe: Rows
) -> int:
    """Fill the efforts of ``safe`` (3, n), and return what changed: see ``_bounded_motion``."""
    for i in range(len(effort)):
        if not math.isfinite(effort[i]):
            return 32
    code = 0
    for i in range(bounds.shape[1]):
        safe[2, i] = _effort(i, effort[i], effort_0, bounds, elapsed)
        code |= 4 if safe[2, i] != effort[i] else 0
        code |= 0 if math.isfinite(safe[2, i]) else 32
    return code


@entry
def _bounded_motion(
    q_c: Input, dq: Input, q_0: Input, dq_0: Input, q: Input, bounds: Rows, joints: Rows,
    elapsed: float, dt: float, safe: Rows,
) -> int:  # fmt: skip
    """Fill the motion of ``safe`` (3, n), and return what changed, as a code.

    Args:
        q_c, dq: (n,) of the command; a part that it has not is empty.
        q_0, dq_0: (n,) of the one before.
        q: (n,) measured.
        bounds, joints: rows of the limits, none if there are none, and of the joints.
        elapsed, dt: [s] as the limiter is given them.
        safe: is filled with the command within its bounds.
    """
    code, lasted = 0, dt if dt > 0 else (elapsed if elapsed > 0 else SHORTEST)
    for i in range(max(len(q_c), len(dq))):
        code |= 8 if len(q_c) and not math.isfinite(q_c[i]) else 0
        code |= 16 if len(dq) and not math.isfinite(dq[i]) else 0
    for i in range(0 if code else bounds.shape[1]):
        lag = 0.0
        if len(q_c):
            safe[0, i] = _position(i, q_c, dq, q_0, dq_0, q[i], bounds, joints, elapsed, lasted)
            if safe[0, i] != q_c[i]:
                code |= 1
                lag = difference(q_c[i], safe[0, i], math.isinf(bounds[_UPPER, i]))
            code |= 0 if math.isfinite(safe[0, i]) else 8
        if len(dq):
            before = dq_0[i] if len(dq_0) else 0.0
            safe[1, i] = _velocity(i, dq[i], before, lag, bounds, lasted)
            code |= 2 if safe[1, i] != dq[i] else 0
            code |= 0 if math.isfinite(safe[1, i]) else 16
    return code
