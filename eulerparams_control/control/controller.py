"""The controller around a scheme: from measured states and references to commands, or none.

It is the same for all schemes and knows no ROS: a node or a simulation in one process
gives it measured states, references and orders.  A step admits the state, keeps the mode, asks
the law on its motion for a command, and limits it.
"""

import math
from contextlib import suppress

from eulerparams_control.control.admission import AGAIN, SAME, Accept
from eulerparams_control.control.clock import Instant
from eulerparams_control.control.guidance import ControllerOptions, LawError
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import SEND_AGAIN, Cause, Latch, Mode, ModeEvent, Why, stuck
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.errors import (
    ContactError,
    EulerParamsError,
    FollowingError,
    InvalidMessageError,
    OverloadError,
    SingularityError,
    UnsafeCommandError,
)
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import Goal, Jog
from eulerparams_control.motion.shaper import Reference
from eulerparams_control.motion.spline import Poses

__all__ = ["Controller", "ControllerOptions"]

# After a fault references are followed again when they have paused this long [s].
_PAUSE = 0.5


_STREAM_ENDED = Why(Cause.STREAM_ENDED, remedy="see to the node that sends them")
_NEVER_BEGINS = Why(
    Cause.NEVER_BEGINS,
    "set-points come, but none begins: their stamps are more than a second ahead of joint_states",
    f"see to the clocks, or stamp them 0; then {SEND_AGAIN}",
)

_CAUSES = (
    (SingularityError, Cause.SINGULARITY),
    (ContactError, Cause.CONTACT_OSCILLATES),
    (OverloadError, Cause.CONTACT_TOO_LARGE),
    (FollowingError, Cause.NOT_FOLLOWING),
    (UnsafeCommandError, Cause.UNSAFE_COMMAND),
)


def why_of(error: EulerParamsError) -> Why:
    """Return why an arm is held after an error of its law, or of its command."""
    cause = next(cause for kind, cause in _CAUSES if isinstance(error, kind))
    return Why(cause, str(error), error.remedy)


def leaps(distance: float, angle: float) -> Why:
    """Return why an arm is held whose reference began far away [m, rad] from where it was."""
    return Why(
        Cause.REFERENCE_LEAPS,
        f"the reference began {distance:.3f} m and {math.degrees(angle):.1f} deg away from the "
        "desired frame of then",
        "begin where the arm is, or raise max_jump_position and max_jump_rotation",
    )


class Controller(Supervisor):
    """Runs a scheme from measured state to command, under supervision.

    Args:
        scheme, options, q: see :class:`Supervisor`.
        effort: (n,) that act at activation, from which the commanded ones begin; None: not known.
    """

    def __init__(
        self, scheme: Scheme, options: ControllerOptions, q: Array, effort: Array | None = None
    ) -> None:
        super().__init__(scheme, options, q)
        self._wanted = self.limiter.limits  # of the joints; those in force come to them
        self._asked = -math.inf  # when something came last that is to move the arm [s]
        self._is_weight = False  # whether efforts that were released came to the weight
        scheme.start_from(effort)

    # --- a step --------------------------------------------------------------------------

    def step(self, t: int, q: Array, dq: Array, now: float | None = None) -> JointCommand | None:
        """Return the command for the state q, dq (n,) stamped t [ns]; None is no command.

        A state seen before gets the same command again.  After a stamp that jumps back or
        too far ahead, or after a silence, nothing is integrated over it: the controller holds the
        pose measured then, after it has braked along its path if only the stamps jumped.

        Args:
            t: stamp [ns].
            q, dq: (n,) measured.
            now: when it came, steady clock [s]; None: ages go by the stamps alone.

        Raises:
            InvalidMessageError: if the state is older than the last one, or the robot cannot
                have reached it.
        """
        at, limiter, command = Instant(t, now), self.limiter, self.command
        has_efforts = limiter.commands_efforts
        q_c = None if command is None else command.q
        state = self.admission.admit(at, q, dq, q_c, limiter.runaway_limits, not has_efforts)
        if state.code & AGAIN:
            return self._again(at, state)
        q = state.q
        if self.mode is Mode.WAITING:
            self._begin(q)  # others may move the arm until then
            self.scheme.start_from(None)
            self.admission.take(None)
            return None
        if state.is_first or state.restart is not None:
            state = self._begin_again(at, state)
        self.admission.take(at)  # only now: a restart that fails is one again
        self.q, self.dq = q, dq
        self._observe(at, state)
        # under positions the arm has stayed at its command, under efforts it has gone on
        lost, dt = state.leapt if limiter.commands_efforts else state.lost, state.dt
        if lost:
            dt -= lost
            self.guidance.wait(lost)
        if limiter.limits is not self._wanted:
            self._lower(dt)
        return self._limited(at, self._ask(t, dt), state.acted, dt)

    def _again(self, at: Instant, state: Accept) -> JointCommand | None:
        """Return the command for the state seen last, which is seen again, if it may go on."""
        stamp, command = f"its stamp stays at {at.stamp / 1e9:g} s", self.command
        is_position = command is not None and command.effort is None and command.dq is not None
        if not state.code & SAME:
            self._change(ModeEvent.FAULT, stuck(f"joint_states moves, but {stamp}"))
        elif at.receipt is None or (is_position and self.is_at_rest):
            return command  # it does no harm for as long as one likes
        elif state.acted <= self._options.state_timeout:
            return None  # it has its answer; efforts must not act for longer than states come
        else:
            self._change(ModeEvent.FAULT, stuck(f"joint_states repeats itself: {stamp}"))
        self.command = None
        return None  # there is no time to control by: the robot has to brake itself

    def _lower(self, dt: float) -> None:
        """Let the joint speed limits in force come to those wanted in dt [s], as the arm can."""
        before, limits = self.limiter.limits, self._wanted
        if before is not None and limits is not None:
            limits = limits.fallen(before, self.guidance.most_fall(dt, before))
            self.scheme.bound(limits)
        self.limiter.limits = limits

    def _ask(self, t: int, dt: float) -> JointCommand | None:
        """Return what the mode commands for the state stamped t [ns], dt [s] after the last.

        Where that fails it is what holds the arm; None if the scheme cannot even say that.
        """
        guidance = self.guidance
        try:
            command = guidance.command(self.state, t, dt, self.q, self.dq)
            motion = guidance.motion
            if motion.waiting or motion.leap is not None or motion.ends is not None:
                self._look_at_references(t)
            return command
        except Exception as error:
            return self._hold_after(error, dt)

    def _look_at_references(self, t: int) -> None:
        """Stop where a reference began that leaps, or where none of a stream begins, t [ns]."""
        motion = self.guidance.motion
        if self.mode is Mode.FOLLOWING and motion.has_stopped(t):
            self.state.why = _STREAM_ENDED
        if motion.leap is not None:
            why, motion.leap = leaps(*motion.leap), None
            self._change(ModeEvent.FAULT, why)
        elif motion.is_stalled(t):
            self._change(ModeEvent.FAULT, _NEVER_BEGINS)

    def _hold_after(self, error: Exception, dt: float) -> JointCommand | None:
        """Return what holds the arm where a law has no answer; None if there is nothing."""
        scheme, q, dq = self.scheme, self.q, self.dq
        try:
            if isinstance(error, LawError):
                if isinstance(error.error, FollowingError):
                    scheme.resume(q)
                command = scheme.hold(dt, q, dq)
                self._change(ModeEvent.FAULT, why_of(error.error))
                return command
        except Exception as another:
            error = another
        self.fail_for_good(error)  # a defect: nobody knows what the scheme is worth now
        with suppress(Exception):
            return scheme.hold(dt, q, dq)
        return None

    def _limited(
        self, at: Instant, command: JointCommand | None, acted: float, dt: float
    ) -> JointCommand | None:
        """Keep, and return, the command within all bounds, or what follows where there is none."""
        self.command = None
        if self.mode is Mode.DISTRUSTING:
            return None
        try:
            if command is not None:
                self.command = command = self.limiter(command, self.q, acted, dt)
                self._is_weight, self._left = False, at
                return command
        except UnsafeCommandError as error:
            self._change(ModeEvent.FAULT, why_of(error))
        self.command = command = self._released(acted)
        if command is not None:
            self._left = at
        return command

    def _released(self, acted: float) -> JointCommand | None:
        """Return efforts that come to the weight of the arm; then none.

        The robot has to brake itself then, and no effort that was to move the arm acts meanwhile.
        In simulated time they go on: a robot in lock-step does not go on without them.
        """
        limiter, is_simulated = self.limiter, self.admission.clock.is_simulated
        if not limiter.commands_efforts or (self._is_weight and not is_simulated):
            return None
        bounded = limiter.bounded
        try:
            command = limiter(self.scheme.last_command(self.q, self.dq), self.q, acted)
        except UnsafeCommandError as error:
            self._is_weight = True  # what acts is the best there is
            self._change(ModeEvent.FAULT, why_of(error))
            return None
        except Exception:  # a law that has a defect: then there are none
            return None
        self._is_weight = limiter.bounded == bounded
        return command

    def last_command(self) -> JointCommand | None:
        """Return the command after which none will follow; None: the brakes act, or are to.

        Raises:
            UnsafeCommandError: if it is not finite.
        """
        if self.command is None or self.state.is_runaway:
            return None
        command = self.scheme.last_command(self.q, self.dq)
        return Limiter(self.limiter.limits)(command, self.q, 0.0)

    # --- orders, from the next state on ----------------------------------------------------

    def changed(self, options: ControllerOptions) -> None:
        """Forget the ticks of the law before, and take over what bounds the new one."""
        joints, self.limiter.effort_rate = self.scheme.bounds
        if joints is not self.limiter.limits:
            self._wanted = joints
        self.guidance.change(self._wanted, options)
        self._lower(0.0)

    def follow(self, motion: Reference, start: int | None, now: float | None = None) -> None:
        """Follow a motion from the stamp ``start`` [ns], or from the next state if None.

        Args:
            motion: what to follow.
            start: stamp [ns].
            now: when it came, steady clock [s]; None: time goes by the stamps alone.

        Raises:
            InvalidMessageError: if it is too far from the present desired frame, not finite, one
                of a stream that went on through a fault, or if the arm must not move now.
        """
        guidance, clock, q = self.guidance, self.admission.clock, self.q
        desired, references, was_halted = guidance.motion, self.references, self.state.is_halted
        self._refuse_after_fault(clock.time(now))
        if self.rate.is_too_low:
            raise InvalidMessageError(f"{self.rate.why.fault}; {self.rate.why.remedy}")
        if isinstance(motion, Poses) and not motion.is_timed and desired.limits is None:
            raise InvalidMessageError(
                "the reference has no times, and the tip has no limits that say how fast it goes; "
                "give each point a time_from_start"
            )
        here = self.scheme.frame_at(q) if was_halted else desired.expected
        if guidance.is_braking and was_halted:
            raise InvalidMessageError("the arm brakes; send it when it is at rest")
        if isinstance(motion, (Goal, Jog)):
            references.refuse_target(motion, here)
        else:
            references.refuse_jump(motion, clock.late(start), here)
        if was_halted:  # only now: what is refused does not move what is held
            self.scheme.resume(q)
            desired.hold(here)
        elif guidance.is_braking and clock.last is not None:
            guidance.release(clock.last.stamp)
        desired.follow(motion, start)
        self._change(ModeEvent.REFERENCE)

    def _refuse_after_fault(self, t: float) -> None:
        """Raise InvalidMessageError while a fault, or a halt, is to be seen to first.

        After a fault what moves the arm, and comes at t [s], has to pause, whatever its duration:
        who sends it may not have noticed.  After a halt only a resume leads on.
        """
        since, self._asked = t - self._asked, t
        state, why = self.state, self.why
        if state.latch is Latch.NONE:
            return
        held = f"the arm is held ({why.fault or why.cause})"
        if state.latch is not Latch.PAUSE or state.is_runaway:
            raise InvalidMessageError(f"{held}; {state.remedy}")
        if min(since, t - why.at) < _PAUSE:
            raise InvalidMessageError(
                f"{held}; call ~/resume, or send nothing for {_PAUSE} s, then again"
            )

    def aim(self, frame: DesiredFrame, now: float | None = None) -> None:
        """Go to a pose, as fast as the limits allow; a stream of poses is followed as it comes.

        Raises:
            InvalidMessageError: see :meth:`follow`.
        """
        self.follow(Goal(frame), None, now)

    def jog(self, twist: Array, now: float | None = None) -> None:
        """Move with a twist (6,) [m/s, rad/s] of the tip, base frame, for ``target_timeout``.

        Raises:
            InvalidMessageError: see :meth:`follow`.
        """
        self.follow(Jog(twist, self._options.target_timeout), None, now)
