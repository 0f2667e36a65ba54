"""The last look at a command before it leaves: finite, within the limits, without a jump.

The laws keep the limits by themselves, in their own way; the limiter does not know them.  It
bounds whatever they, or a defect in them, ask for, also over a restart.

A part that a command has not is an empty array for the primitives.
"""

import math

import numpy as np

from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.jit import (
    Array,
    b1,
    f8,
    i8,
    jit,
    new_matrix,
    new_vector,
    types,
    vector,
)
from eulerparams_control.laws.limits import NONE, SHORTEST, JointLimits, clip, difference
from eulerparams_control.laws.scheme import JointCommand

# A position that lags behind its command chases it at this rate [1/s].
_CHASE = 25.0

# A command may be this much [rad, m, rad/s, m/s, Nm] of rounding beyond what it may be.
_ROUNDING = 5e-13

# No acceleration is larger [rad/s^2 or m/s^2]; no time shorter [s].
_STEEP, _TINY = 1e9, 1e-300

# Rows of the joints: their limits, whether one is not where it is to be, and how far its last step
# led it.  Codes: what is changed of a command, and what is not finite.
_LOWER, _UPPER, _VELOCITY, _EFFORT, _ACCELERATION, _RATE, _LAGS, _LED = range(8)
_ROWS, _LIMITS, _KNOWN = _LED + 1, slice(_RATE), slice(_LAGS, _LED + 1)
_PARTS, _CHANGED, _INFINITE = ("q", "dq", "effort"), (1, 2, 4), (8, 16, 32)


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
        self._last: list[Array] = [NONE, NONE, NONE]  # q, dq and effort
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
        asked = [NONE if part is None else part for part in (q_c, dq, effort)]
        if frame is not None and not _is_finite(np.concatenate(frame, axis=None)):
            raise UnsafeCommandError("the command has a compliant frame that is not finite")
        (q_0, dq_0, effort_0), joints, code = self._last, self._joints, 0
        safe_q = safe_dq = safe_effort = NONE
        if effort is not None:
            safe_effort, code = _bounded_effort(effort, effort_0, joints, elapsed)
        if q_c is not None or dq is not None:
            safe_q, safe_dq, changes = _bounded_motion(
                asked[0], asked[1], q_0, dq_0, q, joints, elapsed, dt
            )
            code |= changes
        if code:
            for part, values, bit in zip(_PARTS, asked, _INFINITE, strict=True):
                if code & bit:
                    raise UnsafeCommandError(
                        f"the command has a non-finite {part}: {values.tolist()}"
                    )
            self.bounded += 1
            for k, safe in enumerate((safe_q, safe_dq, safe_effort)):
                if code & _CHANGED[k]:
                    asked[k] = safe
            q_c, dq, effort = (values if len(values) else None for values in asked)
            command = JointCommand(q_c, dq, effort, frame)
        self._last = asked
        self.commands_efforts = effort is not None
        return command


@jit(b1(vector))
def _is_finite(row: Array) -> bool:
    """Return whether all numbers of a row are finite."""
    total = 0.0
    for value in row:
        total += abs(value)
    return math.isfinite(total)


@jit(f8(i8, vector, vector, vector, vector, f8, new_matrix, f8, f8))
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


@jit(f8(i8, f8, f8, f8, new_matrix, f8))
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


@jit(types.Tuple((new_vector, i8))(vector, vector, new_matrix, f8))
def _bounded_effort(
    effort: Array, effort_0: Array, joints: Array, elapsed: float
) -> tuple[Array, int]:
    """Return the efforts within their bounds, and what changed: see ``_bounded_motion``.

    Limits are kept joint by joint; then one factor shortens the change of all.
    """
    code, n, factor, time = 0, joints.shape[1], 1.0, max(elapsed, _TINY)
    safe = np.empty(n)
    for i in range(len(effort)):
        if not math.isfinite(effort[i]):
            return safe, 32
    for i in range(n):
        most = joints[_EFFORT, i]
        if len(effort_0):  # the limit may have been lowered since
            most = max(most, abs(effort_0[i]) - joints[_RATE, i] * time)
        safe[i] = clip(effort[i], -most, most)
    for i in range(n if len(effort_0) else 0):
        reach, step = joints[_RATE, i] * time, abs(safe[i] - effort_0[i])
        if step > reach + _ROUNDING:
            factor = min(factor, reach / step)
    for i in range(n):
        if factor < 1.0:
            safe[i] = effort_0[i] + factor * (safe[i] - effort_0[i])
        code |= 4 if safe[i] != effort[i] else 0
        code |= 0 if math.isfinite(safe[i]) else 32
    return safe, code


@jit(
    types.Tuple((new_vector, new_vector, i8))(
        vector, vector, vector, vector, vector, new_matrix, f8, f8
    )
)
def _bounded_motion(
    q_c: Array, dq: Array, q_0: Array, dq_0: Array, q: Array, joints: Array,
    elapsed: float, dt: float,
) -> tuple[Array, Array, int]:  # fmt: skip
    """Return q and dq within their bounds, and what changed, as a code.

    Args:
        q_c, dq: (n,) of the command; a part that it has not is empty.
        q_0, dq_0: (n,) of the one before.
        q: (n,) measured.
        joints: rows of the joints, of no joint where there are no limits.
        elapsed, dt: [s] as the limiter is given them.
    """
    code, lasted = 0, dt if dt > 0 else (elapsed if elapsed > 0 else SHORTEST)
    safe_q, safe_dq = np.empty(joints.shape[1]), np.empty(joints.shape[1])
    for i in range(max(len(q_c), len(dq))):
        code |= 8 if len(q_c) and not math.isfinite(q_c[i]) else 0
        code |= 16 if len(dq) and not math.isfinite(dq[i]) else 0
    for i in range(0 if code else joints.shape[1]):
        lag = 0.0
        if len(q_c):
            safe_q[i] = _position(i, q_c, dq, q_0, dq_0, q[i], joints, elapsed, lasted)
            if safe_q[i] != q_c[i]:
                code |= 1
                lag = difference(q_c[i], safe_q[i], math.isinf(joints[_UPPER, i]))
            code |= 0 if math.isfinite(safe_q[i]) else 8
        if len(dq):
            before = dq_0[i] if len(dq_0) else 0.0
            safe_dq[i] = _velocity(i, dq[i], before, lag, joints, lasted)
            code |= 2 if safe_dq[i] != dq[i] else 0
            code |= 0 if math.isfinite(safe_dq[i]) else 16
    return safe_q, safe_dq, code
