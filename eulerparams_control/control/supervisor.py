"""The mode of a controller, and its changes by the measured states."""

import math
from contextlib import suppress
from functools import partial

from eulerparams_control.control.admission import (
    FROZEN,
    RUNAWAY,
    RUNS,
    SWINGING,
    SWINGS,
    Accept,
    Admission,
    runaway,
)
from eulerparams_control.control.clock import Instant, RateCheck
from eulerparams_control.control.guidance import Guidance, LawError
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import (
    ARM_MOVED,
    FROZEN_ENCODER,
    NEVER_BEGINS,
    ON_THE_PATH,
    REPORT_IT,
    SILENT,
    STREAM_ENDED,
    Cause,
    Mode,
    ModeEvent,
    Why,
    leaps,
    runs_away,
    why_of,
)
from eulerparams_control.control.modes import ControlMode, Distrusting, Holding, Releasing, Waiting
from eulerparams_control.control.options import ControllerOptions
from eulerparams_control.control.references import References
from eulerparams_control.errors import FollowingError, defect
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand

# Time [s] in which efforts should have stopped an arm; codes of one that may run away.
_HALTED, _FAST = 0.5, SWINGS | RUNS


class Supervisor:
    """Keeps the mode of a controller.

    Args:
        guidance: the law on its desired motion.
        limiter: of the commands.
        admission: of the states.
        options: how time and references are treated.

    Attributes:
        limiter: of the commands.
        references: refuses those that must not be followed.
        mode: the present mode.
        resets: how often the states started again after a jump of the stamps, or a silence.
        stops: how often the arm was stopped, or stopped for another reason.
        left: when the last command left; None before the first, and after the resume of an arm that
            had none.
        rate: whether the states come often enough.
    """

    def __init__(
        self,
        guidance: Guidance,
        limiter: Limiter,
        admission: Admission,
        options: ControllerOptions,
    ) -> None:
        self._guidance, self.limiter, self._clock = guidance, limiter, admission.clock
        self._scheme, self._timeout = guidance.scheme, options.state_timeout
        self.references = References(*options.max_jump, guidance.scheme.robot.reach)
        self._halted = 0.0  # for how long [s] efforts were to stop the arm
        self._is_strict = options.check_states  # a simulation without limits may diverge
        self.mode: ControlMode = (Waiting if options.require_reference else Holding)(Why())
        self._admission = admission
        self.rate = RateCheck(options.state_timeout)
        self.resets = self.stops = 0
        self.left: Instant | None = None

    def begin(self, q: Array, *, acts: bool = False) -> None:
        """Start at the measured q (n,), whether or not the command before still acts."""
        self._guidance.begin(q, acts=acts)
        if not acts:
            self.limiter.forget()

    def change(self, event: ModeEvent, why: Why = Why()) -> None:  # noqa: B008  it is frozen
        """Go over to the mode after an event."""
        was_halted, guidance, cause = self.mode.is_halted, self._guidance, self.mode.why.cause
        self.mode = self.mode.after(event, why if why.at else why._replace(at=self._clock.now()))
        if not self.mode.is_halted:
            self._halted = 0.0
            return
        self.stops += not was_halted or self.mode.why.cause is not cause
        if why.cause not in ON_THE_PATH or self.mode.mode is not Mode.STOPPED:
            if guidance.is_braking or not was_halted:
                guidance.halt()
        elif not was_halted:
            guidance.brake()

    def begin_again(self, at: Instant, state: Accept) -> Accept:
        """Begin where the state is the first, or follows a gap.

        An arm that moves brakes along its path where only the stamps jumped: the state that is
        returned has then the usual dt.
        """
        q, restart, guidance = state.q, state.restart, self._guidance
        if state.is_first:
            self._see_first(at, q)
        if restart is None:
            return state
        self.resets += 1
        self.change(ModeEvent.RESTART, restart.why)
        moves = restart.acts and not guidance.motion.is_at_rest
        if moves and restart.step > 0 and at.receipt is not None:  # else a simulation restarted
            guidance.brake(restart.jump)
            return state._replace(dt=restart.step, acted=min(state.acted, restart.step))
        if at.receipt is not None and not restart.is_same_arm and not restart.is_silence:
            self.change(ModeEvent.DISTRUST, Why(at=at.receipt + self._timeout))
        self.begin(q, acts=restart.acts)
        return state

    def observe(self, at: Instant, state: Accept, dq: Array, *, is_acting: bool) -> None:
        """Change the mode as a new state with speeds dq (n,) tells to.

        ``is_acting``: whether the state before had a command.
        """
        if isinstance(self.mode, Distrusting):
            if at.receipt is not None and at.receipt < self.mode.until:
                return
            self.change(ModeEvent.TRUST)
            self.begin(state.q)
        if self._is_strict:
            self.rate.judge(self._admission.period, self._scheme)
            if self._is_rate_too_low():
                return
        if state.code & FROZEN:
            self.change(ModeEvent.FROZEN, FROZEN_ENCODER)  # there is nothing to control by
            return
        left = self.left
        if not is_acting and left is not None and not 0 <= at.since(left) <= self._timeout:
            self.begin(state.q)  # the robot has braked since
            self.change(ModeEvent.RESTART, SILENT)
        mode = self.mode
        if isinstance(mode, Releasing):
            if not mode.is_runaway or mode.rests(state.dt, state.q):
                self.change(ModeEvent.RECOVERED)
            if mode.is_runaway:
                return
        if self.limiter.commands_efforts and self.limiter.limits is not None:
            self._halted += state.dt if mode.is_halted else 0.0
            if state.code & _FAST:
                self._see_runaway(state, dq, self.limiter.limits.velocity)

    def _is_rate_too_low(self) -> bool:
        """Hold an arm whose states come too seldom; return whether even that is not possible."""
        scheme, rate = self._scheme, self.rate
        if not rate.is_too_low:
            return False
        if scheme.hold_rate * self._admission.period.least > 1:
            self.change(ModeEvent.FROZEN, rate.why)  # there is no loop that could
            return True
        why = self.mode.why
        said_before = why.cause is Cause.RATE_TOO_LOW and why.fault != rate.why.fault
        if said_before or not self.mode.is_halted:  # it was said before the rate was known
            self.change(ModeEvent.FAULT, rate.why)
        return False

    def _see_first(self, at: Instant, q: Array) -> None:
        motion = self._guidance.motion
        if motion.is_holding:
            self.begin(q)  # the arm may have moved since activation
        elif self.references.jumps(motion.last, self._scheme.frame_at(q)):
            self.begin(q)
            self.change(ModeEvent.FAULT, ARM_MOVED._replace(at=at.seconds))

    def _see_runaway(self, state: Accept, dq: Array, limits: Array) -> None:
        """Release an arm that runs away under efforts, measured at dq, of the limits (n,)."""
        swings = self._halted > _HALTED
        if state.code & (SWINGS if swings else RUNS):
            most = SWINGING if swings else RUNAWAY
            excess = list(map(runaway, dq, [most] * len(dq), limits))
            joint = excess.index(max(excess))
            why = runs_away(self._scheme.robot.joints[joint], dq[joint])
            self.change(ModeEvent.RUNS_AWAY, why)

    def _look_at_references(self, t: int) -> None:
        """Stop where a reference began that leaps, or where none of a stream begins, t [ns]."""
        motion = self._guidance.motion
        if self.mode.mode is Mode.FOLLOWING and motion.has_stopped(t):
            self.mode.why = STREAM_ENDED
        if motion.leap is not None:
            why, motion.leap = leaps(*motion.leap), None
            self.change(ModeEvent.FAULT, why)
        elif motion.is_stalled(t):
            self.change(ModeEvent.FAULT, NEVER_BEGINS)

    def distrust(self, why: Why) -> None:
        """Command nothing until :meth:`trust`: whose the states are is in dispute."""
        self.change(ModeEvent.FAULT, why)
        self.change(ModeEvent.DISTRUST, Why(at=math.inf))

    def trust(self) -> None:
        """Hold the pose of the next state, whose publisher is known again."""
        if isinstance(self.mode, Distrusting):
            self.mode.until = 0.0
        self._scheme.start_from(None)

    def fail_for_good(self, error: Exception) -> None:
        """Hold from now on because of a defect; no reference is followed any more."""
        self.change(ModeEvent.DEFECT, Why(Cause.DEFECT, defect(error), REPORT_IT))

    def ask(self, t: int, dt: float, q: Array, dq: Array) -> JointCommand | None:
        """Return what the mode commands for q, dq (n,) stamped t [ns], dt [s] after the last.

        Where that fails it is what holds the arm; None if the scheme cannot even say that.
        """
        try:
            mode, guidance = self.mode, self._guidance
            ask = guidance.tick if mode.is_led else partial(mode.command, guidance)
            command, motion = ask(t, dt, q, dq), guidance.motion
            if motion.waiting or motion.leap is not None or motion.ends is not None:
                self._look_at_references(t)
            return command
        except Exception as error:
            return self.hold_after(error, dt, q, dq)

    def hold_after(self, error: Exception, dt: float, q: Array, dq: Array) -> JointCommand | None:
        """Return what holds the arm where a law has no answer; None if there is nothing."""
        scheme = self._scheme
        try:
            if isinstance(error, LawError):
                if isinstance(error.error, FollowingError):
                    scheme.resume(q)
                command = scheme.hold(dt, q, dq)
                self.change(ModeEvent.FAULT, why_of(error.error))
                return command
        except Exception as another:
            error = another
        self.fail_for_good(error)  # a defect: nobody knows what the scheme is worth now
        with suppress(Exception):
            return scheme.hold(dt, q, dq)
        return None
