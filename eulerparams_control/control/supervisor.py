"""The supervision of a controller: its mode, and what measured states and orders make of it."""

import math
from collections.abc import Sequence
from itertools import repeat

import numpy as np

from eulerparams_control.control.admission import (
    AT_REST,
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
from eulerparams_control.control.guidance import ControllerOptions, Guidance
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import (
    CALL_RESUME,
    DEACTIVATED,
    HALTED,
    REPORT_IT,
    SEND_AGAIN,
    Cause,
    Latch,
    Mode,
    ModeEvent,
    ModeState,
    Why,
)
from eulerparams_control.control.references import References
from eulerparams_control.errors import InvalidMessageError, defect
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme

# Time [s] in which efforts should have stopped an arm.
_HALTED = 0.5

# Causes for which the tip brakes along its path: the law still holds.
_ON_THE_PATH = frozenset(
    (Cause.HALT, Cause.DEACTIVATED, Cause.REFERENCE_LEAPS, Cause.NEVER_BEGINS, Cause.STAMP_JUMP)
)

_ARM_MOVED = Why(
    Cause.ARM_MOVED, "the arm moved before the reference began; send it again", SEND_AGAIN
)
_FROZEN_ENCODER = Why(
    Cause.FROZEN_ENCODER,
    "joint_states reports speeds, but positions that stay the same to the bit",
    f"see to the robot's driver or encoders, then {SEND_AGAIN}",
)
_SILENT = Why(Cause.COMMAND_SILENCE, remedy=SEND_AGAIN, note="a silence of its commands")


def runs_away(joints: Sequence[str], dq: Array, most: float, limits: Array) -> Why:
    """Return why the efforts of an arm are released whose joints are too fast, dq (n,)."""
    excess = [runaway(*each) for each in zip(dq, repeat(most), limits)]
    i = int(np.argmax(excess))
    return Why(
        Cause.RUNAWAY,
        f"the arm runs away, {joints[i]} at {dq[i]:.3g} rad/s: it gets no more efforts",
        f"see to delays and to the model of the arm, or lower the gains; then {CALL_RESUME}",
    )


class Supervisor:
    """Keeps the mode of an arm: what a controller is besides the path of a state to its command.

    Args:
        scheme: the control scheme.
        options: how it treats time and references.
        q: (n,) measured positions at activation; their pose is held at first.

    Attributes:
        admission: of the states.
        guidance: the scheme on its desired motion.
        limiter: of the commands.
        references: refuses those that lead where the arm must not go.
        state: the mode and what it keeps.
        rate: whether the states come often enough.
        command: the last one; None: none acts, or the brakes are to.
        q, dq: (n,) as measured last.
        resets: how often the states started again after a jump of the stamps, or a silence.
        stops: how often the arm was stopped, or stopped for another reason.
    """

    def __init__(self, scheme: Scheme, options: ControllerOptions, q: Array) -> None:
        self.scheme, self._options = scheme, options
        self.limiter = Limiter(*scheme.bounds)
        self.guidance = Guidance(scheme, self.limiter.limits, options)
        timeout = options.state_timeout
        self.admission = Admission(
            scheme.robot, timeout, options.max_latency, options.check_states, q
        )
        self.references = References(*options.max_jump, scheme.robot.reach)
        self.rate = RateCheck(timeout)
        self.state = ModeState(Mode.WAITING if options.require_reference else Mode.HOLDING)
        self.resets = self.stops = 0
        self.command: JointCommand | None = None
        self.q, self.dq = q, np.zeros_like(q)
        self._left: Instant | None = None  # when the last command left, if it still may count
        self._halted = 0.0  # for how long [s] efforts were to stop the arm
        self._begin(q)

    @property
    def mode(self) -> Mode:
        """What it does."""
        return self.state.mode

    @property
    def why(self) -> Why:
        """Why it does that."""
        return self.state.why

    @property
    def fault(self) -> str:
        """Why the arm is held still instead of moved; "" if it is not."""
        return self.state.why.fault

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm was measured to be at rest, and its command does not move it."""
        command = self.command
        dq_c = 0.0 if command is None or command.dq is None else command.dq
        return bool((np.maximum(np.abs(self.dq), np.abs(dq_c)) < AT_REST).all())

    def _begin(self, q: Array, *, acts: bool = False) -> None:
        """Hold the measured q (n,), whether or not the command before still acts."""
        self.guidance.begin(q, acts=acts)
        if not acts:
            self.limiter.forget()

    def _begin_again(self, at: Instant, state: Accept) -> Accept:
        """Begin where the state is the first, or follows a gap.

        An arm that moves brakes along its path where only the stamps jumped: the state that is
        returned has then the usual dt.
        """
        restart, motion = state.restart, self.guidance.motion
        if state.is_first and motion.is_holding:
            self._begin(state.q)  # the arm may have moved since activation
        elif state.is_first and self.references.jumps(motion.last, self.scheme.frame_at(state.q)):
            self._begin(state.q)
            self._change(ModeEvent.FAULT, _ARM_MOVED._replace(at=at.seconds))
        if restart is None:
            return state
        self.resets += 1
        self._change(ModeEvent.RESTART, restart.why)
        moves = restart.acts and not self.guidance.motion.is_at_rest
        if moves and restart.step > 0 and at.receipt is not None:  # else a simulation restarted
            self.guidance.brake(restart.jump)
            return state._replace(dt=restart.step, acted=min(state.acted, restart.step))
        if at.receipt is not None and not restart.is_same_arm and not restart.is_silence:
            until = at.receipt + self._options.state_timeout
            self._change(ModeEvent.DISTRUST, Why(at=until))
        self._begin(state.q, acts=restart.acts)
        return state

    def _change(self, event: ModeEvent, why: Why = Why()) -> None:  # noqa: B008  it is frozen
        """Go over to the mode after an event, and let the motion rest where it stops the arm."""
        before, guidance = self.state, self.guidance
        now = self.admission.clock.now()
        self.state = before.after(event, why if why.at else why._replace(at=now))
        if not self.state.is_halted:
            self._halted = 0.0
            return
        self.stops += not before.is_halted or self.why.cause is not before.why.cause
        if why.cause not in _ON_THE_PATH or self.mode is not Mode.STOPPED:
            if guidance.is_braking or not before.is_halted:
                guidance.halt()
        elif not before.is_halted:
            guidance.brake()

    def _observe(self, at: Instant, state: Accept) -> None:
        """Change the mode as a new state tells to."""
        if self.mode is Mode.DISTRUSTING:
            if at.receipt is not None and at.receipt < self.state.until:
                return
            self._change(ModeEvent.TRUST)
            self._begin(state.q)
        if self._options.check_states and self._is_rate_too_low():
            return  # else a simulation without limits may diverge
        if state.code & FROZEN:
            self._change(ModeEvent.FROZEN, _FROZEN_ENCODER)  # there is nothing to control by
            return
        left, timeout = self._left, self._options.state_timeout
        if self.command is None and left is not None and not 0 <= at.since(left) <= timeout:
            self._begin(state.q)  # the robot has braked since
            self._change(ModeEvent.RESTART, _SILENT)
        mode = self.state
        if mode.mode is Mode.RELEASING:
            if not mode.is_runaway or mode.rests(state.dt, state.q):
                self._change(ModeEvent.RECOVERED)
            if mode.is_runaway:
                return
        limits = self.limiter.limits
        if self.limiter.commands_efforts and limits is not None:
            self._halted += state.dt if mode.is_halted else 0.0
            swings = self._halted > _HALTED
            if state.code & (SWINGS if swings else RUNS):
                most = SWINGING if swings else RUNAWAY
                why = runs_away(self.scheme.robot.joints, self.dq, most, limits.velocity)
                self._change(ModeEvent.RUNS_AWAY, why)

    def _is_rate_too_low(self) -> bool:
        """Hold an arm whose states come too seldom; return whether even that is not possible."""
        scheme, rate, period = self.scheme, self.rate, self.admission.period
        rate.judge(period, scheme)
        if not rate.is_too_low:
            return False
        if scheme.hold_rate * period.least > 1:
            self._change(ModeEvent.FROZEN, rate.why)  # there is no loop that could
            return True
        why = self.why
        said_before = why.cause is Cause.RATE_TOO_LOW and why.fault != rate.why.fault
        if said_before or not self.state.is_halted:  # it was said before the rate was known
            self._change(ModeEvent.FAULT, rate.why)
        return False

    def distrust(self, why: Why) -> None:
        """Command nothing until :meth:`trust`: whose the states are is in dispute."""
        self._change(ModeEvent.FAULT, why)
        self._change(ModeEvent.DISTRUST, Why(at=math.inf))

    def trust(self) -> None:
        """Hold the pose of the next state, whose publisher is known again."""
        self.state.until = 0.0
        self.scheme.start_from(None)

    def fail_for_good(self, error: Exception) -> None:
        """Hold from now on because of a defect; no reference is followed any more."""
        self._change(ModeEvent.DEFECT, Why(Cause.DEFECT, defect(error), REPORT_IT))

    def settle(self, why: Why) -> None:
        """Hold the pose measured last, in a contact as it is, while the last command acts."""
        self._begin(self.q, acts=True)
        self._change(ModeEvent.RESTART, why)

    def halt(self) -> None:
        """Hold until :meth:`resume`; command nothing now."""
        self._change(ModeEvent.HALT, HALTED)

    def end(self) -> None:
        """Hold for good: after this nothing will be commanded."""
        self._change(ModeEvent.END, DEACTIVATED)

    def resume(self) -> None:
        """Hold the measured pose, ready to follow; if the arm was stopped.

        Raises:
            InvalidMessageError: after a defect, while the arm runs away, or while it moves.
        """
        if self.state.latch is Latch.NONE:
            return
        held = f"the arm is held ({self.fault or self.why.cause})"
        if self.state.latch is Latch.NEVER or self.mode not in (Mode.STOPPED, Mode.WAITING):
            raise InvalidMessageError(f"not resumed: {held}; {self.state.remedy}")
        if self.mode is Mode.STOPPED:
            if not self.is_at_rest:
                raise InvalidMessageError(f"not resumed: {held}, and moves; ask when it is at rest")
            acts = self.command is not None
            self._begin(self.q, acts=acts)
            if not acts:
                self.scheme.start_from(None)
                self._left = None  # the silence is over: what is sent now is followed
        self._change(ModeEvent.RESUME)
