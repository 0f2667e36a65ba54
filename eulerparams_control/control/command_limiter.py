"""The last look at a command before it leaves: finite, within the limits, without a jump.

The laws keep the limits by themselves, in their own way; the limiter does not know them.  It
bounds whatever they, or a defect in them, ask for, also over a restart.  Where efforts do not
control the arm any more, :class:`Runaway` says so.
"""

import math

import numpy as np

from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.limits import SHORTEST, JointLimits
from eulerparams_control.laws.rotations import Array, every
from eulerparams_control.laws.scheme import JointCommand

# An arm that is so many times as fast as its limits under efforts runs away: what is measured is
# late, or the model is wrong, and only the brakes of the robot can stop it.
_RUNAWAY = 1.5

# So does one that is still this fast [of its limits] when it was to stop for so long [s]; but what
# is slower than this [rad/s or m/s] does not.
_SWINGING, _HALTED, _SLOW = 0.5, 0.5, 0.1

# A position that lags behind its command chases it at this rate [1/s].
_CHASE = 25.0

# A command may be this much [rad, m, rad/s, m/s, Nm] of rounding beyond what it may be.
_ROUNDING = 5e-13

# No acceleration is larger [rad/s^2 or m/s^2]; no time shorter [s].
_STEEP, _TINY = 1e9, 1e-300


class CommandLimiter:
    """Bounds each command by the limits of the joints and by the command before.

    Args:
        limits: of the joints; None bounds nothing, but what is not finite is refused still.
        effort_rate: [Nm/s] of each effort, or (n,).

    Attributes:
        bounded: how many commands had to be changed.
        commands_efforts: whether the command that acts is one of efforts.
    """

    def __init__(self, limits: JointLimits | None, effort_rate: Array | float = math.inf) -> None:
        self.limits, self.effort_rate = limits, effort_rate
        self.bounded = 0
        self.forget()

    def forget(self) -> None:
        """Start again: no command acts any more."""
        self._last = JointCommand()
        self._lags = np.zeros(1, dtype=bool)  # (n,) the joints that are not where they are to be
        self._led = np.array(0.0)  # (n,) how far their last step led them
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
        if self.limits is not None and self._goes_on(command, elapsed, dt, self.limits):
            self._last, self.commands_efforts = command, False
            return command
        _refuse_infinite(command)
        if self.limits is not None:
            safe = self._bounded(command, q, elapsed, dt, self.limits)
            if safe is not command:
                _refuse_infinite(safe)
                self.bounded += 1
            command = safe
        self._last, self.commands_efforts = command, command.effort is not None
        return command

    def _goes_on(
        self, command: JointCommand, elapsed: float, dt: float, limits: JointLimits
    ) -> bool:
        """Whether positions and speeds simply go on from the command before, within all bounds."""
        (q, dq, effort, frame), last = command, self._last
        if q is None or dq is None or effort is not None or frame is not None or dt <= 0:
            return False
        if last.q is None or last.dq is None or True in self._lags.tolist():
            return False
        step, led, change = q - last.q, dt * last.dq, dt * limits.acceleration
        if not (
            every(np.abs(step) < math.pi)  # no turn is lost; nor is it infinite
            and math.isfinite(dq @ dq)
            and every(np.abs(step - led) <= dt * change)
            and every(np.abs(step) <= elapsed * limits.velocity)
            and every(np.abs(dq - last.dq) <= change)
            and every(np.abs(dq) <= limits.velocity)
            and limits.contain(q)
        ):
            return False
        self._led = led
        return True

    def _bounded(
        self, command: JointCommand, q: Array, elapsed: float, dt: float, limits: JointLimits
    ) -> JointCommand:
        """Return the command within the limits, and within reach of the one before."""
        q_c, dq, effort = command.q, command.dq, command.effort
        lasted = dt if dt > 0 else elapsed if elapsed > 0 else SHORTEST
        if q_c is not None:
            q_c = self._bounded_position(command, q, elapsed, lasted, limits)
        if dq is not None:
            chase = None
            if q_c is not None and command.q is not None and q_c is not command.q:
                chase = limits.difference(command.q, q_c)
            dq = self._bounded_velocity(dq, chase, lasted, limits)
        if effort is not None:
            effort = self._bounded_effort(effort, elapsed, limits)
        if q_c is command.q and dq is command.dq and effort is command.effort:
            return command
        return command._replace(q=q_c, dq=dq, effort=effort)

    def _bounded_position(
        self, command: JointCommand, q: Array, elapsed: float, lasted: float, limits: JointLimits
    ) -> Array:
        """Return q_c (n,) where the motion until now can lead to; the measured q is there.

        A joint that cannot be where it is to be goes on by its velocity, which chases; it gets
        there where that bends its motion, before and after, by no more than it may.
        """
        q_c, last, low, high = command.q, self._last, limits.lower, limits.upper
        assert q_c is not None
        if last.q is None:
            if _is_within(q_c, low, high):
                return q_c
            return _same(q_c, _clip(q_c, np.minimum(low, q), np.maximum(high, q)))
        fastest = limits.velocity
        if last.dq is not None:  # its limit may have been lowered since
            fastest = np.maximum(fastest, np.abs(last.dq))
        reach = fastest * elapsed if elapsed > 0 else np.zeros_like(q_c)
        bend = limits.acceleration * lasted**2 + _ROUNDING
        step = limits.difference(q_c, last.q)
        led = np.zeros_like(q_c) if last.dq is None else lasted * last.dq
        fits = (np.abs(step) <= reach + _ROUNDING) & (np.abs(step - led) <= bend)
        if self._lags.any():
            leads = 0.0 if command.dq is None else lasted * command.dq
            for other in (self._led, leads):
                fits &= ~self._lags | (np.abs(step - other) <= bend)
        self._lags, self._led = ~fits, led
        wanted = last.q + step
        if fits.all() and _is_within(q_c, low, high) and _is_within(q_c - wanted, 0, 0, _ROUNDING):
            return q_c
        if last.dq is None:
            led = _clip(step, -bend, bend)
        wanted = np.where(fits | np.isinf(bend), wanted, last.q + led)
        low, high = np.minimum(low, q), np.maximum(high, q)  # it may be beyond, and come back
        low = np.maximum(np.minimum(low, last.q), last.q - reach)
        high = np.minimum(np.maximum(high, last.q), last.q + reach)
        return _same(q_c, _clip(wanted, low, high))

    def _bounded_velocity(
        self, dq: Array, chase: Array | None, lasted: float, limits: JointLimits
    ) -> Array:
        """Return dq (n,) where the velocity until now can have come to.

        Args:
            dq: (n,) commanded.
            chase: (n,) by which the position lags behind its command; None: it does not.
            lasted: [s] since the velocity until now.
            limits: of the joints.
        """
        before = np.zeros_like(dq) if self._last.dq is None else self._last.dq
        change, wanted = limits.acceleration * lasted, dq
        most = limits.velocity
        if chase is not None:
            lag, a = np.abs(chase), np.minimum(limits.acceleration, _STEEP)
            rate = min(_CHASE, 0.5 / lasted)
            wanted = dq + np.copysign(np.minimum(rate * lag, np.sqrt(a * lag)), chase)
        elif _is_within(dq, -most, most) and _is_within(dq - before, -change, change, _ROUNDING):
            return dq
        return _same(dq, _clip(_clip(wanted, before - change, before + change), -most, most))

    def _bounded_effort(self, effort: Array, elapsed: float, limits: JointLimits) -> Array:
        """Return the efforts (n,) within their limits and rates."""
        low, high, last = -limits.effort, limits.effort, self._last.effort
        reach = self.effort_rate * max(elapsed, _TINY)
        if _is_within(effort, low, high) and (
            last is None or _is_within(effort - last, -reach, reach, _ROUNDING)
        ):
            return effort
        if last is not None:
            low = np.maximum(np.minimum(low, last), last - reach)
            high = np.minimum(np.maximum(high, last), last + reach)
        return _same(effort, _clip(effort, low, high))


def _clip(values: Array, low: Array, high: Array) -> Array:
    clipped: Array = np.minimum(np.maximum(values, low), high)
    return clipped


def _is_within(
    values: Array, low: Array | float, high: Array | float, rounding: float = 0.0
) -> bool:
    """Whether values (n,) are within bounds."""
    if rounding:
        high, low = high + rounding, low - rounding
    return every(values <= high) and every(values >= low)


def _same(values: Array, bounded: Array) -> Array:
    """Return ``values`` itself where nothing was bounded."""
    return values if np.array_equal(values, bounded) else bounded


def _refuse_infinite(command: JointCommand) -> None:
    """Raise UnsafeCommandError if a value of a command is not finite."""
    for name in ("q", "dq", "effort"):
        values = getattr(command, name)
        if values is not None and not every(np.isfinite(values)):
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
