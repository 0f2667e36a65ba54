"""The supervision of a controller: all that changes the mode of an arm, or what it follows.

Events come from the states, from the motion, from operators and from references.  What a mode
commands is up to the :class:`Controller`.
"""

import math

import numpy as np

from eulerparams_control.control import mode as modes
from eulerparams_control.control.admission import AT_REST, FROZEN, Accept, Admission
from eulerparams_control.control.clock import Instant
from eulerparams_control.control.guidance import ControllerOptions, Guidance
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import Cause, Latch, Mode, ModeEvent, ModeState, Why
from eulerparams_control.errors import InvalidMessageError, defect
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import Goal, Jog
from eulerparams_control.motion.shaper import Reference
from eulerparams_control.motion.spline import Poses

# Speeds under efforts, as multiples of their limit, beyond which an arm runs away: one that moves,
# and one that was to stop for the time [s].  What is measured is late, or the model is wrong, and
# only the brakes of the robot can stop it.  A joint that is slower than this [rad/s or m/s] does
# not run away, nor one of a stopped arm, which may be pushed, that is slower than the last.
_RUNAWAY, _SWINGING, _HALTED, _SLOW, _PUSHED = 1.5, 0.5, 0.5, 0.1, 2.0

# After a fault references are followed again when they have paused this long [s].
_PAUSE = 0.5

# Causes for which the tip brakes along its path: the law still holds.
_ON_THE_PATH = frozenset(
    (Cause.HALT, Cause.DEACTIVATED, Cause.REFERENCE_LEAPS, Cause.NEVER_BEGINS, Cause.STAMP_JUMP)
)


class Supervisor:
    """Keeps the mode of an arm; ``q`` (n,) was measured at activation, its pose is held at first.

    Attributes:
        admission: of the states.
        rate: whether they come often enough.
        guidance: the desired motion.
        limiter: of the commands.
        state: the mode and what it keeps.
        command: the last one; None: none acts, or the brakes are to.
        q, dq: (n,) as measured last.
        resets: how often the states started again after a jump of the stamps, or a silence.
        stops: how often the arm was stopped, or stopped for another reason.
    """

    def __init__(self, scheme: Scheme, options: ControllerOptions, q: Array) -> None:
        self.scheme, self._options = scheme, options
        self.limiter = Limiter(*scheme.bounds)
        self.limiter.chase = options.chase(scheme.robot)
        self.guidance = Guidance(scheme, self.limiter.limits, options)
        self.admission = Admission(
            scheme.robot, options.state_timeout, options.max_latency, options.check_states, q
        )
        self.rate = self.admission.rate
        self.state = ModeState(Mode.WAITING if options.require_reference else Mode.HOLDING)
        self.resets = self.stops = 0
        self.command: JointCommand | None = None
        self.q, self.dq = q, np.zeros_like(q)
        self._left: float | None = None  # when the last command left [s], if it still may count
        self._halted = 0.0  # for how long [s] efforts were to stop the arm
        self._asked = -math.inf  # when something came last that is to move the arm [s]
        self._refused = -math.inf  # the same, of what came while the arm was held
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

    def _change(self, event: ModeEvent, why: Why = Why()) -> None:  # noqa: B008  it is frozen
        """Go over to the mode after an event, and let the motion rest where it stops the arm."""
        before, guidance = self.state, self.guidance
        why = why if why.at else why._replace(at=self.admission.now)
        self.state = before.after(event, why)
        if not self.state.is_halted:
            self._halted = 0.0
            return
        self.stops += not before.is_halted or self.why.cause is not before.why.cause
        if why.cause not in _ON_THE_PATH or self.mode is not Mode.STOPPED:
            if guidance.is_braking or not before.is_halted:
                guidance.halt()
        elif not before.is_halted:
            guidance.brake()

    # --- events of the states ----------------------------------------------------------------

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
        motion = self.guidance.motion
        if state.restart is None:
            if motion.is_holding:
                self._begin(state.q)  # the arm may have moved since activation
            elif self.guidance.is_far(motion.last, self.scheme.frame_at(state.q)):
                self._begin(state.q)
                self._change(ModeEvent.FAULT, modes.ARM_MOVED._replace(at=at.seconds))
            return state
        self.resets += 1
        self._change(ModeEvent.RESTART, state.restart)
        moves = state.acts and not self.guidance.motion.is_at_rest
        if moves and state.step > 0 and at.receipt is not None:  # else a simulation restarted
            self.guidance.brake(state.jump)
            return state._replace(dt=state.step, acted=min(state.acted, state.step))
        if state.is_another_arm:
            until = at.seconds + self._options.state_timeout
            self._change(ModeEvent.DISTRUST, Why(at=until))
        self._begin(state.q, acts=state.acts)
        return state

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
            self._change(ModeEvent.FROZEN, modes.FROZEN_ENCODER)  # there is nothing to control by
            return
        left, timeout = self._left, self._options.state_timeout
        if self.command is None and left is not None and not 0 <= at.seconds - left <= timeout:
            self._begin(state.q)  # the robot has braked since
            self._change(ModeEvent.RESTART, modes.COMMAND_SILENCE)
        mode = self.state
        if mode.mode is Mode.RELEASING:
            if not mode.is_runaway or mode.rests(state.dt, state.q):
                self._change(ModeEvent.RECOVERED)
            if mode.is_runaway:
                return
        if self.limiter.commands_efforts and self.limiter.limits is not None:
            self._halted += state.dt if mode.is_halted else 0.0
            self._see_runaway(self.limiter.limits.velocity)

    def _see_runaway(self, limits: Array) -> None:
        """Release an arm with a joint that efforts have made too fast for its limit (n,)."""
        most = _SWINGING if self._halted > _HALTED else _RUNAWAY
        fastest = most * limits
        if self.state.is_halted:  # what pushes it knows no limit of its motion
            robot = self.scheme.robot.limits.velocity
            fastest = np.minimum(np.maximum(fastest, _PUSHED), most * robot)
        excess = np.abs(self.dq) - np.maximum(fastest, _SLOW)
        i = int(excess.argmax())
        if excess[i] > 0:
            fast = f"{self.scheme.robot.joints[i]} at {self.dq[i]:.3g} rad/s"
            fault = f"the arm runs away, {fast}: it gets no more efforts"
            self._change(ModeEvent.RUNS_AWAY, modes.RUNAWAY._replace(fault=fault))

    def _is_rate_too_low(self) -> bool:
        """Hold an arm whose states come too seldom; return whether even that is not possible."""
        scheme, rate, why = self.scheme, self.rate, self.why
        rate.judge(scheme)
        if not rate.is_too_low:
            return False
        if scheme.hold_rate * rate.least > 1:
            self._change(ModeEvent.FROZEN, rate.why)  # there is no loop that could
            return True
        said_before = why.cause is Cause.RATE_TOO_LOW and why.fault != rate.why.fault
        if said_before or not self.state.is_halted:  # it was said before the rate was known
            self._change(ModeEvent.FAULT, rate.why)
        return False

    # --- events of the motion ------------------------------------------------------------------

    def _observe_motion(self, t: int) -> None:
        """Stop where a reference began that leaps, or where none of a stream begins, t [ns]."""
        motion = self.guidance.motion
        if self.mode is Mode.FOLLOWING and motion.has_stopped(t):
            self.state.why = modes.STREAM_ENDED
        if motion.leap is not None:
            way, angle = motion.leap
            motion.leap, far = None, f"{way:.3f} m and {math.degrees(angle):.1f} deg away"
            fault = f"the reference began {far} from the desired frame of then"
            self._change(ModeEvent.FAULT, modes.REFERENCE_LEAPS._replace(fault=fault))
        elif motion.is_stalled(t):
            self._change(ModeEvent.FAULT, modes.NEVER_BEGINS)

    # --- orders, from the next state on ----------------------------------------------------------

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
        self._change(ModeEvent.DEFECT, Why(Cause.DEFECT, defect(error), modes.REPORT_IT))

    def settle(self, why: Why) -> None:
        """Hold the pose measured last, in a contact as it is, while the last command acts."""
        self._begin(self.q, acts=True)
        self._change(ModeEvent.RESTART, why)

    def halt(self) -> None:
        """Hold until :meth:`resume`; the next state is answered by braking along the path."""
        self._change(ModeEvent.HALT, modes.HALTED)

    def end(self) -> None:
        """Hold for good: after this nothing will be commanded."""
        self._change(ModeEvent.END, modes.DEACTIVATED)

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

    # --- references, from the next state on ------------------------------------------------------

    def follow(self, motion: Reference, start: int | None, now: float | None = None) -> None:
        """Follow a motion from the stamp ``start`` [ns], or from the next state if None.

        ``now`` is when it came, steady clock [s]; None: time goes by the stamps alone.

        Raises:
            InvalidMessageError: if it is too far from the present desired frame, not finite, one
                of a stream that went on through a fault, or if the arm must not move now.
        """
        guidance, last, was_halted = self.guidance, self.admission.last, self.state.is_halted
        desired = guidance.motion
        self._refuse_after_fault(self.admission.now if now is None else now)
        if self.rate.is_too_low:
            raise InvalidMessageError(f"{self.rate.why.fault}; {self.rate.why.remedy}")
        if isinstance(motion, Poses) and not motion.is_timed and desired.limits is None:
            raise InvalidMessageError(
                "the reference has no times, and the tip has no limits that say how fast it goes; "
                "give each point a time_from_start"
            )
        here = self.scheme.frame_at(self.q) if was_halted else desired.expected
        if guidance.is_braking and was_halted:
            raise InvalidMessageError("the arm brakes; send it when it is at rest")
        late = 0.0 if start is None or last is None else (last.stamp - start) / 1e9
        guidance.refuse(motion, late, here)
        if was_halted:  # only now: what is refused does not move what is held
            self.scheme.resume(self.q)
            desired.hold(here)
        elif guidance.is_braking and last is not None:
            guidance.release(last.stamp)
        desired.follow(motion, start)
        self._change(ModeEvent.REFERENCE)

    def _refuse_after_fault(self, t: float) -> None:
        """Raise InvalidMessageError while a fault, or a halt, is to be seen to first.

        After a fault what moves the arm, and comes at t [s], has to pause, whatever its duration:
        who sends it may not have noticed.  After a halt only a resume leads on; what came while the
        arm was held has to pause after that, too.
        """
        since, self._asked = t - self._asked, t
        state, why, refusal = self.state, self.why, ""
        held = f"the arm is held ({why.fault or why.cause})"
        if state.latch is Latch.NONE:
            if t - self._refused < _PAUSE:
                refusal = f"the arm was resumed meanwhile; send nothing for {_PAUSE} s, then again"
        elif state.latch is not Latch.PAUSE:
            refusal = f"{held}; {state.remedy}"
        elif min(since, t - why.at) < _PAUSE:
            refusal = f"{held}; call ~/resume, or send nothing for {_PAUSE} s, then again"
        if refusal:
            self._refused = t
            raise InvalidMessageError(refusal)

    def aim(self, frame: DesiredFrame, now: float | None = None) -> None:
        """Go to a pose as fast as the limits allow, or follow a stream of them; see ``follow``."""
        self.follow(Goal(frame), None, now)

    def jog(self, twist: Array, now: float | None = None) -> None:
        """Move with a twist (6,) of the tip for ``target_timeout``, base frame; see ``follow``."""
        self.follow(Jog(twist, self._options.target_timeout), None, now)
