"""The last look at a command before it leaves: finite, within the limits, without a jump.

The laws keep the limits by themselves, in their own way; the limiter does not know them.  It
bounds whatever they, or a defect in them, ask for, also over a restart.
"""

import math

import numpy as np

from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.jit import (
    Array,
    b1,
    f8,
    jit,
    matrix,
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

_LOWER, _UPPER, _VELOCITY, _, _ACCELERATION = range(5)  # rows of JointLimits.rows

# Rows of the joints: whether one is not where it is to be, and how far its last step led it.
_LAGS, _LED = range(2)

_motion = types.Tuple((new_vector, new_vector, b1))


class Limiter:
    """Bounds each command by the limits of the joints and by the command before.

    ``limits`` None bounds nothing, but what is not finite is refused still; ``effort_rate`` [Nm/s]
    is one, or (n,).  ``bounded`` counts the commands that had to be changed; ``chase`` [rad/s or
    m/s] is how fast a joint goes, at most, to where it is to be.
    """

    def __init__(self, limits: JointLimits | None, effort_rate: Array | float = math.inf) -> None:
        self.limits, self.effort_rate, self.bounded = limits, effort_rate, 0
        self.chase = math.inf
        self.forget()

    @property
    def commands_efforts(self) -> bool:
        """Whether the command that acts is one of efforts."""
        return self._last.effort is not None

    def forget(self) -> None:
        """Start again: no command acts any more."""
        self._last = JointCommand()
        self._lag = np.zeros((2, 0 if self.limits is None else len(self.limits.lower)))

    def __call__(
        self, command: JointCommand, q: Array, elapsed: float, dt: float = 0.0
    ) -> JointCommand:
        """Return a command of the scheme, ``elapsed`` [s] after the last one, within all bounds.

        Where the arm is beyond its limits, at the measured q (n,), it may come back.  dt [s] is
        what the velocities were integrated over; 0: what has elapsed.

        Raises:
            UnsafeCommandError: if a value is not finite; the command before still counts then.
        """
        _refuse_unsafe(command)
        limits, last, changed = self.limits, self._last, False
        q_c, dq, effort, frame = command
        if limits is not None and effort is not None:
            reach = np.full(len(effort), self.effort_rate) * max(elapsed, _TINY)
            effort = _bounded_effort(effort, last.effort, limits.effort, reach)
            changed = bool((effort != command.effort).any())
        if limits is not None and q_c is not None and dq is not None:
            q_0, dq_0 = (NONE if part is None else part for part in (last.q, last.dq))
            lasted = dt if dt > 0 else (elapsed if elapsed > 0 else SHORTEST)
            q_c, dq, is_bent = _bounded_motion(
                q_c, dq, q_0, dq_0, q, limits.rows, self._lag, elapsed, lasted, self.chase
            )
            changed = changed or is_bent
        if changed:
            command = JointCommand(q_c, dq, effort, frame)
            _refuse_unsafe(command)
            self.bounded += 1
        self._last = command
        return command


def _refuse_unsafe(command: JointCommand) -> None:
    """Raise UnsafeCommandError if a value is not finite, or half of a motion is missing."""
    q, dq, effort, frame = command
    if frame is not None and not np.isfinite(np.concatenate(frame, axis=None)).all():
        raise UnsafeCommandError("the command has a compliant frame that is not finite")
    for name, part in (("q", q), ("dq", dq), ("effort", effort)):
        if part is not None and not all(map(math.isfinite, part.tolist())):
            raise UnsafeCommandError(f"the command has a non-finite {name}: {part.tolist()}")
    if (q is None) is not (dq is None):
        raise UnsafeCommandError("the command has q or dq alone; expected both, or neither")


def _bounded_effort(effort: Array, before: Array | None, limit: Array, reach: Array) -> Array:
    """Return the efforts (n,) within their bounds, ``reach`` (n,) at most from those before.

    Limits are kept joint by joint; then one factor shortens the change of all.
    """
    if before is None:
        return np.minimum(np.maximum(effort, -limit), limit)
    most = np.maximum(limit, np.abs(before) - reach)  # the limit may have been lowered since
    safe: Array = np.minimum(np.maximum(effort, -most), most)
    step = np.abs(safe - before)
    is_too_far = step > reach + _ROUNDING
    if is_too_far.any():
        factor = (reach[is_too_far] / step[is_too_far]).min()
        safe = before + factor * (safe - before)
    return safe


@jit(_motion(vector, vector, vector, vector, vector, matrix, new_matrix, f8, f8, f8))
def _bounded_motion(
    q_c: Array, dq: Array, q_0: Array, dq_0: Array, q: Array, limits: Array, lag: Array,
    elapsed: float, lasted: float, chase: float,
) -> tuple[Array, Array, bool]:  # fmt: skip
    """Return q_c and dq (n,) within their bounds, and whether they had to be changed.

    A joint that cannot be where it is to be goes on by its velocity, which chases; it gets there
    where that bends its motion, before and after, by no more than it may.
    Velocities dq (n,) of the command were integrated over ``lasted`` [s].  q_0, dq_0 (n,) are those
    of the one before, ``elapsed`` [s] ago; none: there was none.  ``lag`` is brought up to date.
    """
    safe_q, safe_dq, changed = np.empty(len(q_c)), np.empty(len(q_c)), False
    for i in range(len(q_c)):
        most, a, upper = limits[_VELOCITY, i], limits[_ACCELERATION, i], limits[_UPPER, i]
        low, high = min(limits[_LOWER, i], q[i]), max(upper, q[i])  # it may come back
        place, speed, before = clip(q_c[i], low, high), dq[i], 0.0
        if len(q_0):
            before = dq_0[i]
            fastest = max(most, abs(before))  # the limit of the speed may have been lowered since
            reach = fastest * elapsed if elapsed > 0 else 0.0
            led, leads, bend = lasted * before, lasted * speed, a * (lasted * lasted) + _ROUNDING
            step = difference(q_c[i], q_0[i], math.isinf(upper))
            lags = abs(step) > reach + _ROUNDING or abs(step - led) > bend
            if lag[_LAGS, i]:
                lags = lags or abs(step - lag[_LED, i]) > bend or abs(step - leads) > bend
            lag[_LAGS, i], lag[_LED, i] = lags, led
            if lags and not math.isinf(bend):
                step = led
            if lags or place != q_c[i] or abs(q_0[i] + step - q_c[i]) > _ROUNDING:
                low, high = min(low, q_0[i]), max(high, q_0[i])
                place = clip(q_0[i] + step, max(low, q_0[i] - reach), min(high, q_0[i] + reach))
        behind, change = difference(q_c[i], place, math.isinf(upper)), a * lasted
        if behind != 0.0:
            rate, way = min(_CHASE, 0.5 / lasted), abs(behind)
            rate = min(rate * way, math.sqrt(min(a, _STEEP) * way))
            speed += math.copysign(min(rate, chase), behind)
        if behind != 0.0 or abs(speed) > most or abs(speed - before) > change + _ROUNDING:
            speed = clip(clip(speed, before - change, before + change), -most, most)
        changed = changed or place != q_c[i] or speed != dq[i]
        safe_q[i], safe_dq[i] = place, speed
    return safe_q, safe_dq, changed
