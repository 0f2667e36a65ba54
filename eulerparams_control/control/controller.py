"""The controller around a scheme: from measured states and references to commands, or none.

It is the same for all schemes and knows no ROS: a node or a simulation in one process
gives it measured states and references.  A step is four stages: admit the state, change the
mode, ask the mode for a command, limit it.
"""

from eulerparams_control.control.acting import Acting
from eulerparams_control.control.admission import AGAIN, Admission
from eulerparams_control.control.clock import Instant
from eulerparams_control.control.guidance import Guidance
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import Mode, ModeEvent, Why, why_of
from eulerparams_control.control.modes import Release
from eulerparams_control.control.options import ControllerOptions
from eulerparams_control.control.orders import Orders
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.errors import UnsafeCommandError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme

__all__ = ["Controller", "ControllerOptions"]


class Controller:
    """Runs a scheme from measured state to command.

    Args:
        scheme: the control scheme.
        options: how it treats time and references.
        q: (n,) measured positions at activation; their pose is held at first.
        effort: (n,) that act then, from which the commanded ones begin; None: not known.

    Attributes:
        orders: what is asked of it, by people and programs.
        admission: of the states.
        supervisor: keeps the mode.
        guidance: the scheme on its desired motion.
        limiter: of the commands.
        acting: the command that acts.
    """

    def __init__(
        self, scheme: Scheme, options: ControllerOptions, q: Array, effort: Array | None = None
    ) -> None:
        self.scheme = scheme
        self.limiter = Limiter(*scheme.bounds)
        self._wanted = self.limiter.limits  # of the joints; those in force come to them
        self.guidance = Guidance(scheme, self.limiter.limits, options)
        self.admission = Admission(
            scheme.robot, options.state_timeout, options.max_latency, options.check_states, q
        )
        self.supervisor = Supervisor(self.guidance, self.limiter, self.admission, options)
        self.acting = Acting(scheme, self.supervisor, options.state_timeout, q)
        self._release = Release(self.limiter)
        self.orders = Orders(
            self.admission, self.supervisor, self.guidance, self.acting, options.target_timeout
        )
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

    def changed(self, options: ControllerOptions) -> None:
        """Forget the ticks of the law before, and take over what bounds the new one."""
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
        self.limiter.limits = limits

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
        at, supervisor, admission = Instant(t, now), self.supervisor, self.admission
        limiter, command = self.limiter, self.acting.command
        limits, has_efforts = limiter.limits, limiter.commands_efforts
        told = None if command is None else command.q
        state = admission.admit(at, q, dq, told, limiter.runaway_limits, not has_efforts)
        if state.code & AGAIN:
            return self.acting.again(at, state)
        q = state.q
        if supervisor.mode.mode is Mode.WAITING:
            supervisor.begin(q)  # others may move the arm until then
            self.scheme.start_from(None)
            admission.take(None)
            return None
        if state.is_first or state.restart is not None:
            state = supervisor.begin_again(at, state)
        admission.take(at)  # only now: a restart that fails is one again
        self.acting.q, self.acting.dq = q, dq
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
        supervisor, acting, release = self.supervisor, self.acting, self._release
        acting.command = None
        if supervisor.mode.mode is Mode.DISTRUSTING:
            return None
        try:
            if command is not None:
                acting.command = command = self.limiter(command, acting.q, acted, dt)
                release.is_reached, supervisor.left = False, at
                return command
        except UnsafeCommandError as error:
            supervisor.change(ModeEvent.FAULT, why_of(error))
        try:
            is_simulated = self.admission.clock.is_simulated
            command = release.command(self.scheme, acting.q, acting.dq, acted, is_simulated)
        except UnsafeCommandError as error:
            supervisor.change(ModeEvent.FAULT, why_of(error))
            return None
        acting.command = command
        if command is not None:
            supervisor.left = at
        return command
