"""The last look at a command before it leaves: finite, within the limits, without a jump.

The laws keep the limits by themselves, in their own way; the limiter does not know them.  It
bounds whatever they, or a defect in them, ask for, also over a restart.  Where efforts do not
control the arm any more, :class:`Runaway` says so.
"""

import math
from typing import Any

import numpy as np

from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand

# An arm that is so many times as fast as its limits under efforts runs away: what is measured is
# late, or the model is wrong, and only the brakes of the robot can stop it.
_RUNAWAY = 1.5

# So does one that is still this fast [of its limits] when it was to stop for so long [s]; but what
# is slower than this [rad/s or m/s] does not.
_SWINGING, _HALTED, _SLOW = 0.5, 0.5, 0.1

# A command may be this much [rad, m, Nm] of rounding beyond the step that the rates allow.
_ROUNDING = 5e-13


class CommandLimiter:
    """Bounds each command by the limits of the joints and by the command before.

    Args:
        limits: of the joints; None bounds nothing, but what is not finite is refused still.
        effort_rate: [Nm/s] of each effort.

    Attributes:
        bounded: how many commands had to be changed.
        commands_efforts: whether the command that acts is one of efforts.
    """

    def __init__(self, limits: JointLimits | None, effort_rate: float = math.inf) -> None:
        self.limits, self.effort_rate = limits, effort_rate
        self.bounded = 0
        self.forget()

    def forget(self) -> None:
        """Start again: no command acts any more."""
        self._last = JointCommand()
        self.commands_efforts = False

    def __call__(self, command: JointCommand, q: Array, elapsed: float) -> JointCommand:
        """Return the command within all bounds.

        Args:
            command: of the scheme.
            q: (n,) measured positions: where the arm is beyond its limits, it may come back.
            elapsed: [s] since the command before.

        Raises:
            UnsafeCommandError: if a value is not finite; the command before still counts then.
        """
        _refuse_infinite(command)
        if self.limits is not None:
            safe = self._bounded(command, q, elapsed, self.limits)
            self.bounded += safe is not command
            command = safe
        self._last, self.commands_efforts = command, command.effort is not None
        return command

    def _bounded(
        self, command: JointCommand, q: Array, elapsed: float, limits: JointLimits
    ) -> JointCommand:
        """Return the command within the limits, and within reach of the one before."""
        last = self._last
        changes: dict[str, Any] = {}
        step = limits.velocity * elapsed
        for name, values, low, high, reach in (
            ("q", command.q, limits.lower, limits.upper, step),
            ("dq", command.dq, -limits.velocity, limits.velocity, None),
            ("effort", command.effort, -limits.effort, limits.effort, self.effort_rate * elapsed),
        ):
            before = None if reach is None else getattr(last, name)
            if values is None or _is_within(values, low, high, before, reach):
                continue
            if name == "q":  # where the arm is beyond its limits it may be, and come back
                low, high = np.minimum(low, q), np.maximum(high, q)
            if before is not None:
                low, high = np.minimum(low, before), np.maximum(high, before)
                low, high = np.maximum(low, before - reach), np.minimum(high, before + reach)
            changes[name] = np.minimum(np.maximum(values, low), high)
        changed: dict[str, Any] = {
            name: values
            for name, values in changes.items()
            if not np.array_equal(values, getattr(command, name))
        }
        return command._replace(**changed) if changed else command


def _is_within(
    values: Array, low: Array, high: Array, before: Array | None, reach: Array | float | None
) -> bool:
    """Whether values (n,) are within limits, and within reach of those before."""
    if not ((values <= high).all() and (values >= low).all()):
        return False
    if before is None or reach is None:
        return True
    return bool((np.abs(values - before) <= reach + _ROUNDING).all())


def _refuse_infinite(command: JointCommand) -> None:
    """Raise UnsafeCommandError if a value of a command is not finite."""
    for name in ("q", "dq", "effort"):
        values = getattr(command, name)
        if values is not None and not np.isfinite(values).all():
            raise UnsafeCommandError(f"the command has a non-finite {name}: {values.tolist()}")
    frame = command.frame
    if frame is not None and not all(np.isfinite(part).all() for part in frame):
        raise UnsafeCommandError("the command has a compliant frame that is not finite")


class Runaway:
    """Tells whether an arm runs away under efforts; then no more may be commanded."""

    def __init__(self) -> None:
        self._halted = 0.0  # for how long [s] it was to stop

    def update(self, dt: float, dq: Array, limits: Array, is_stopped: bool) -> int | None:
        """Take measured speeds; return the joint that begins to run away, None if none does.

        Args:
            dt: [s] since the ones before.
            dq: (n,) measured [rad/s or m/s].
            limits: (n,) of the speeds.
            is_stopped: whether the efforts are to hold the arm.
        """
        self._halted = self._halted + dt if is_stopped else 0.0
        most = _SWINGING if self._halted > _HALTED else _RUNAWAY
        excess = np.abs(dq) - np.maximum(most * limits, _SLOW)
        joint = int(excess.argmax())
        return joint if excess[joint] > 0 else None
