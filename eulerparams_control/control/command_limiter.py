"""The last look at a command before it leaves: finite, within the limits, without a jump.

The laws keep the limits by themselves, in their own way; the limiter does not know them.  It
bounds whatever they, or a defect in them, ask for, also over a restart.

What a command has is rows of n floats; one that it has not is empty.
"""

import math

import numpy as np

from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws._old.compiled import NONE, Input, Rows, entry, kernel
from eulerparams_control.laws.limits import SHORTEST, JointLimits, clip, difference
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand

# A position that lags behind its command chases it at this rate [1/s].
_CHASE = 25.0

# A command may be this much [rad, m, rad/s, m/s, Nm] of rounding beyond what it may be.
_ROUNDING = 5e-13

# No acceleration is larger [rad/s^2 or m/s^2]; no time shorter [s].
_STEEP, _TINY = 1e9, 1e-300

# Rows of the joints: their limits, whether one is not where it is to be, how far its last step led
# it, and a command within its bounds.  Codes: what is changed of a command, and what is not finite.
_LOWER, _UPPER, _VELOCITY, _EFFORT, _ACCELERATION, _RATE, _LAGS, _LED, _SAFE = range(9)
_ROWS, _LIMITS, _KNOWN = _SAFE + 3, slice(_RATE), slice(_LAGS, _SAFE)
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
        self._joints = np.zeros((_ROWS, 0))
        self.bound(limits)
        self.forget()

    def bound(self, limits: JointLimits | None) -> None:
        """Bound commands by these limits, and by ``effort_rate``, from now on."""
        self.limits, known = limits, self._joints[_KNOWN]
        n = 0 if limits is None else len(limits.lower)
        self._joints = np.zeros((_ROWS, n))
        if limits is not None:
            self._joints[_LIMITS], self._joints[_RATE] = limits.rows, self.effort_rate
        if known.shape[1] == n:
            self._joints[_KNOWN] = known

    @property
    def runaway_limits(self) -> Array | float:
        """Limits (n,) of the speeds of an arm that may run away; infinity: it cannot."""
        limits = self.limits
        return math.inf if limits is None or not self.commands_efforts else limits.velocity

    def forget(self) -> None:
        """Start again: no command acts any more."""
        self._last: tuple[Array, Array, Array] = NONE, NONE, NONE
        self._joints[_KNOWN] = 0.0
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
        if frame is not None and not _is_finite(np.concatenate(frame, axis=None)):
            raise UnsafeCommandError("the command has a compliant frame that is not finite")
        (q_0, dq_0, effort_0), joints, code = self._last, self._joints, 0
        if effort is not None:
            code = _bounded_effort(effort, effort_0, joints, elapsed)
        if q_c is not None or dq is not None:
            code |= _bounded_motion(rows[0], rows[1], q_0, dq_0, q, joints, elapsed, dt)
        if code:
            for part, row, bit in zip(_PARTS, rows, _INFINITE, strict=True):
                if code & bit:
                    raise UnsafeCommandError(f"the command has a non-finite {part}: {row.tolist()}")
            self.bounded += 1
            safe = joints[_SAFE:]
            kept = [safe[k].copy() if code & 1 << k else row for k, row in enumerate(rows)]
            rows = kept[0], kept[1], kept[2]
            q_c, dq, effort = (row if len(row) else None for row in rows)
            command = JointCommand(q_c, dq, effort, frame)
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
    joints: Array, elapsed: float, lasted: float,
) -> float:  # fmt: skip
    """Return q_c of a joint, measured at q, where the motion until now can lead to.

    A joint that cannot be where it is to be goes on by its velocity, which chases; it gets there
    where that bends its motion, before and after, by no more than it may.
    """
    low, high = min(joints[_LOWER, i], q), max(joints[_UPPER, i], q)  # it may come back
    if len(q_0) == 0:
        return clip(q_c[i], low, high)
    fastest, led, leads = joints[_VELOCITY, i], 0.0, lasted * dq[i] if len(dq) else 0.0
    if len(dq_0):  # the limit of the speed may have been lowered since
        fastest, led = max(fastest, abs(dq_0[i])), lasted * dq_0[i]
    reach = fastest * elapsed if elapsed > 0 else 0.0
    bend = joints[_ACCELERATION, i] * (lasted * lasted) + _ROUNDING
    step = difference(q_c[i], q_0[i], math.isinf(joints[_UPPER, i]))
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
def _velocity(i: int, dq: float, before: float, lag: float, joints: Array, lasted: float) -> float:
    """Return dq of a joint where the velocity until now, ``before``, can have come to.

    It chases what its position lags behind.
    """
    most, a = joints[_VELOCITY, i], joints[_ACCELERATION, i]
    change = a * lasted
    if lag != 0.0:
        rate, way = min(_CHASE, 0.5 / lasted), abs(lag)
        dq += math.copysign(min(rate * way, math.sqrt(min(a, _STEEP) * way)), lag)
    elif abs(dq) <= most and abs(dq - before) <= change + _ROUNDING:
        return dq
    return clip(clip(dq, before - change, before + change), -most, most)


@entry
def _bounded_effort(effort: Input, effort_0: Input, joints: Rows, elapsed: float) -> int:
    """Fill the efforts within their bounds, and return what changed: see ``_bounded_motion``.

    Limits are kept joint by joint; then one factor shortens the change of all.
    """
    code, n, factor, time = 0, joints.shape[1], 1.0, max(elapsed, _TINY)
    for i in range(len(effort)):
        if not math.isfinite(effort[i]):
            return 32
    for i in range(n):
        most = joints[_EFFORT, i]
        if len(effort_0):  # the limit may have been lowered since
            most = max(most, abs(effort_0[i]) - joints[_RATE, i] * time)
        joints[_SAFE + 2, i] = clip(effort[i], -most, most)
    for i in range(n if len(effort_0) else 0):
        reach, step = joints[_RATE, i] * time, abs(joints[_SAFE + 2, i] - effort_0[i])
        if step > reach + _ROUNDING:
            factor = min(factor, reach / step)
    for i in range(n):
        safe = joints[_SAFE + 2, i]
        if factor < 1.0:
            joints[_SAFE + 2, i] = safe = effort_0[i] + factor * (safe - effort_0[i])
        code |= 4 if safe != effort[i] else 0
        code |= 0 if math.isfinite(safe) else 32
    return code


@entry
def _bounded_motion(
    q_c: Input, dq: Input, q_0: Input, dq_0: Input, q: Input, joints: Rows,
    elapsed: float, dt: float,
) -> int:  # fmt: skip
    """Fill the motion within its bounds, and return what changed, as a code.

    Args:
        q_c, dq: (n,) of the command; a part that it has not is empty.
        q_0, dq_0: (n,) of the one before.
        q: (n,) measured.
        joints: rows of the joints, of no joint where there are no limits.
        elapsed, dt: [s] as the limiter is given them.
    """
    code, lasted = 0, dt if dt > 0 else (elapsed if elapsed > 0 else SHORTEST)
    for i in range(max(len(q_c), len(dq))):
        code |= 8 if len(q_c) and not math.isfinite(q_c[i]) else 0
        code |= 16 if len(dq) and not math.isfinite(dq[i]) else 0
    for i in range(0 if code else joints.shape[1]):
        lag = 0.0
        if len(q_c):
            joints[_SAFE, i] = _position(i, q_c, dq, q_0, dq_0, q[i], joints, elapsed, lasted)
            if joints[_SAFE, i] != q_c[i]:
                code |= 1
                lag = difference(q_c[i], joints[_SAFE, i], math.isinf(joints[_UPPER, i]))
            code |= 0 if math.isfinite(joints[_SAFE, i]) else 8
        if len(dq):
            before = dq_0[i] if len(dq_0) else 0.0
            joints[_SAFE + 1, i] = _velocity(i, dq[i], before, lag, joints, lasted)
            code |= 2 if joints[_SAFE + 1, i] != dq[i] else 0
            code |= 0 if math.isfinite(joints[_SAFE + 1, i]) else 16
    return code
