"""The controller around a scheme: from measured states and references to commands, or none.

It is the same for all schemes and knows no ROS: a node or a simulation in one process
gives it measured states and references.  A step is four stages: admit the state, change the
mode, ask the mode for a command, limit it.
"""

from collections.abc import Sequence

import numpy as np

from eulerparams_control.control.admission import Accept, Admission
from eulerparams_control.control.clock import Instant, NominalPeriod
from eulerparams_control.control.command_limiter import CommandLimiter
from eulerparams_control.control.guidance import Guidance
from eulerparams_control.control.judge import AGAIN, AT_REST, SAME
from eulerparams_control.control.mode import (
    DEACTIVATED,
    HALTED,
    Cause,
    Mode,
    ModeEvent,
    Why,
    contested,
    stuck,
    why_of,
)
from eulerparams_control.control.modes import Release
from eulerparams_control.control.options import ControllerOptions
from eulerparams_control.control.short_way import ShortWay
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import Goal, Jog, SetPoint
from eulerparams_control.motion.trajectories import Trajectory

__all__ = ["Controller", "ControllerOptions"]


class Controller:
    """Runs a scheme from measured state to command.

    Args:
        scheme: the control scheme.
        options: how it treats time and references.
        q: (n,) measured positions at activation; their pose is held at first.
        effort: (n,) that act then, from which the commanded ones begin; None: not known.

    Attributes:
        guidance: the scheme on its desired motion.
        limiter: of the commands.
        supervisor: keeps the mode.
    """

    def __init__(
        self, scheme: Scheme, options: ControllerOptions, q: Array, effort: Array | None = None
    ) -> None:
        self.scheme, self.options = scheme, options
        self.limiter = CommandLimiter(*scheme.bounds)
        self._wanted = self.limiter.limits  # of the joints; those in force come to them
        self.guidance = Guidance(scheme, self.limiter.limits, options)
        self._admission = Admission(
            scheme.robot, options.state_timeout, options.max_latency, options.check_states, q
        )
        self.supervisor = Supervisor(self.guidance, self.limiter, self._admission, options)
        self._release = Release(self.limiter)
        self._q, self._dq = q, np.zeros_like(q)
        parts = self._admission, self.supervisor, self.guidance, self.limiter
        self._short_way = ShortWay(*parts)
        self._command: JointCommand | None = None
        self.supervisor.begin(q)
        scheme.start_from(effort)

    @property
    def mode(self) -> Mode:
        """What it does."""
        return self.supervisor.mode.mode

    @property
    def why(self) -> Why:
        """Why it does that."""
        return self.supervisor.mode.why

    @property
    def fault(self) -> str:
        """Why the arm is held still instead of moved; "" if it is not."""
        return self.why.fault

    @property
    def resets(self) -> int:
        """How often it started again after a jump of the stamps, or a silence."""
        return self.supervisor.resets

    @property
    def detours(self) -> int:
        """How many states went the long way, see :class:`ShortWay`."""
        return self._short_way.detours

    @property
    def set_backs(self) -> int:
        """How often the clock of the states was set back."""
        return self._admission.set_backs

    @property
    def period(self) -> NominalPeriod:
        """The usual time between two states."""
        return self._admission.period

    @property
    def is_contested(self) -> bool:
        """Whether states contradict each other again and again."""
        return self._admission.is_contested

    def contest(self, names: Sequence[str]) -> None:
        """Hold from the next state on, as nodes of these names publish states in turns."""
        if self.why.cause is not Cause.TWO_PUBLISHERS:
            self.supervisor.change(ModeEvent.FAULT, contested(names))

    @property
    def stop_time(self) -> float:
        """The time [s] in which the motion can come to rest from its present speed."""
        limits, now = self.options.motion, self.guidance.motion.last
        return 0.0 if limits is None else limits.stop_time(now.dp_d, now.omega_d)

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm was measured to be at rest, and is not told to move."""
        command = self._command
        told = 0.0 if command is None or command.dq is None else command.dq
        return bool((np.maximum(np.abs(self._dq), np.abs(told)) < AT_REST).all())

    def changed(self, options: ControllerOptions) -> None:
        """Forget the ticks of the law before, and take over what bounds the new one."""
        self.options = options
        self._short_way.forget()
        joints, self.limiter.effort_rate = self.scheme.bounds
        if joints is not self.limiter.limits:
            self._wanted = joints
        self.guidance.change(self._wanted, options)
        self._lower(0.0)

    def _lower(self, dt: float) -> None:
        """Let the joint speed limits in force come to those wanted in dt [s], as the arm can."""
        before, limits = self.limiter.limits, self._wanted
        if before is not None and limits is not None:
            limits = limits.fallen(before, self.guidance.most_fall(dt, before))
            self.scheme.bound(limits)
        self.limiter.bound(limits)

    def follow(
        self, motion: Trajectory | SetPoint, start: int | None, now: float | None = None
    ) -> None:
        """Follow a motion from the stamp ``start`` [ns], or from the next state if None.

        Args:
            motion: what to follow.
            start: stamp [ns].
            now: when it came, steady clock [s]; None: time goes by the stamps alone.

        Raises:
            InvalidMessageError: if it is too far from the present desired frame, not finite, one
                of a stream that went on through a fault, or if the arm must not move now.
        """
        self.supervisor.follow(motion, start, now, self._q)

    def aim(self, frame: DesiredFrame, now: float | None = None) -> None:
        """Go to a pose, as fast as the limits allow; a stream of poses is followed as it comes.

        Raises:
            InvalidMessageError: see :meth:`follow`.
        """
        self.supervisor.follow(Goal(frame), None, now, self._q)

    def jog(self, twist: Array, now: float | None = None) -> None:
        """Move with a twist (6,) [m/s, rad/s] of the tip, base frame, for ``target_timeout``.

        Raises:
            InvalidMessageError: see :meth:`follow`.
        """
        self.supervisor.follow(Jog(twist, self.options.target_timeout), None, now, self._q)

    def settle(self, why: Why) -> None:
        """Hold the pose measured last, in a contact as it is, while the last command acts."""
        self.supervisor.begin(self._q, acts=True)
        self.supervisor.change(ModeEvent.RESTART, why)

    def halt(self) -> None:
        """Hold from the next state on, until :meth:`resume`; command nothing now."""
        self.supervisor.change(ModeEvent.HALT, HALTED)

    def end(self) -> None:
        """Hold from the next state on, for good: after this nothing will be commanded."""
        self.supervisor.change(ModeEvent.END, DEACTIVATED)

    def resume(self) -> None:
        """Hold the measured pose from the next state on, ready to follow; if it was stopped.

        Raises:
            InvalidMessageError: after a defect, while the arm runs away, or while it moves.
        """
        self.supervisor.resume(self._q, is_at_rest=self.is_at_rest)

    def fail_for_good(self, error: Exception) -> None:
        """Hold from the next state on because of a defect; no reference is followed any more."""
        self.supervisor.fail_for_good(error)

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
        at = Instant(t, now)
        if taken := self._short_way.take(at, q, dq):
            q, dt, acted, desired = taken
            self._q, self._dq = q, dq
            command: JointCommand | None
            try:
                command = self.guidance.follow(t, dt, q, dq, desired)
            except Exception as error:
                command = self.supervisor.hold_after(error, dt, q, dq)
            return self._send(at, command, acted, dt)
        command = self._step(at, q, dq)
        if command is not None and self.limiter.limits is self._wanted:
            self._short_way.expect()
        return command

    def _step(self, at: Instant, q: Array, dq: Array) -> JointCommand | None:
        """Return the command for a state, whatever it may be."""
        supervisor, admission = self.supervisor, self._admission
        limiter, command = self.limiter, self._command
        limits, has_efforts = limiter.limits, limiter.commands_efforts
        told = None if command is None else command.q
        state = admission.admit(at, q, dq, told, limiter.runaway_limits, not has_efforts)
        if state.code & AGAIN:
            return self._answer_again(at, state)
        q = state.q
        if supervisor.mode.mode is Mode.WAITING:
            supervisor.begin(q)  # others may move the arm until then
            self.scheme.start_from(None)
            admission.take(None)
            return None
        if state.is_first or state.restart is not None:
            state = supervisor.begin_again(at, state)
        admission.take(at)  # only now: a restart that fails is one again
        self._q, self._dq = q, dq
        supervisor.observe(at, state, dq, is_acting=command is not None)
        # under positions the arm has stayed where it was told, under efforts it has gone on
        lost, dt = state.leapt if limiter.commands_efforts else state.lost, state.dt
        if lost:
            dt -= lost
            self.guidance.wait(lost)
        if limits is not self._wanted:
            self._lower(dt)
        return self._send(at, supervisor.ask(at.stamp, dt, q, dq), state.acted, dt)

    def _send(
        self, at: Instant, command: JointCommand | None, acted: float, dt: float
    ) -> JointCommand | None:
        """Keep, and return, the command within all bounds, or what follows where there is none."""
        supervisor, release = self.supervisor, self._release
        self._command = None
        if supervisor.mode.mode is Mode.DISTRUSTING:
            return None
        try:
            if command is not None:
                self._command = command = self.limiter(command, self._q, acted, dt)
                release.is_reached, supervisor.left = False, at
                return command
        except UnsafeCommandError as error:
            supervisor.change(ModeEvent.FAULT, why_of(error))
        try:
            is_simulated = self._admission.clock.is_simulated
            command = release.command(self.scheme, self._q, self._dq, acted, is_simulated)
        except UnsafeCommandError as error:
            supervisor.change(ModeEvent.FAULT, why_of(error))
            return None
        self._command = command
        if command is not None:
            supervisor.left = at
        return command

    def _answer_again(self, at: Instant, state: Accept) -> JointCommand | None:
        """Return the command of the state seen last, if it may act for longer."""
        stamp = f"its stamp stays at {at.stamp / 1e9:g} s"
        if not state.code & SAME:
            self.supervisor.change(ModeEvent.FAULT, stuck(f"joint_states moves, but {stamp}"))
        elif at.receipt is None or self._may_stay:
            return self._command
        elif state.acted <= self.options.state_timeout:
            return None  # it has its answer; efforts must not act for longer than states come
        else:
            self.supervisor.change(ModeEvent.FAULT, stuck(f"joint_states repeats itself: {stamp}"))
        self._command = None
        return None  # there is no time to control by: the robot has to brake itself

    @property
    def _may_stay(self) -> bool:
        """Whether the last command does no harm for as long as one likes: a position at rest."""
        command = self._command
        if command is None or command.effort is not None or command.dq is None:
            return False
        return self.is_at_rest

    def last_command(self) -> JointCommand | None:
        """Return the command after which none will follow; None: the brakes act, or are to.

        Raises:
            UnsafeCommandError: if it is not finite.
        """
        if self._command is None or self.supervisor.mode.is_runaway:
            return None
        command = self.scheme.last_command(self._q, self._dq)
        return CommandLimiter(self.limiter.limits)(command, self._q, 0.0)
