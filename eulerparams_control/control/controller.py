"""The controller around a scheme: from measured states to commands, or none.

It is the same for all schemes and knows no ROS: a node or a simulation in one process
gives it measured states, references and orders.  A step admits the state, keeps the mode, asks
what the mode commands, and limits that.
"""

from contextlib import suppress

from eulerparams_control.control.admission import AGAIN, SAME, Accept
from eulerparams_control.control.clock import Instant
from eulerparams_control.control.guidance import ControllerOptions
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import Mode, ModeEvent, stuck, why_of
from eulerparams_control.control.supervisor import Supervisor
from eulerparams_control.errors import FollowingError, SingularityError, UnsafeCommandError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand, Scheme

# So many states in a row with the stamp of the last one, and other values, are a clock that stands.
_MOST_ASTRAY = 3

__all__ = ["Controller", "ControllerOptions"]


class Controller(Supervisor):
    """Runs a scheme from measured state to command; what changes its mode is the supervisor's.

    Args:
        scheme, options, q: see :class:`Supervisor`.
        effort: (n,) that act at activation, from which the commanded ones begin; None: not known.
    """

    def __init__(
        self, scheme: Scheme, options: ControllerOptions, q: Array, effort: Array | None = None
    ) -> None:
        super().__init__(scheme, options, q)
        self._wanted = self.limiter.limits  # of the joints; those in force come to them
        self._astray = 0  # states in a row that differ from the last one, but not in their stamp
        self._is_weight = False  # whether efforts that were released came to the weight
        scheme.start_from(effort)

    def step(self, t: int, q: Array, dq: Array, now: float | None = None) -> JointCommand | None:
        """Return the command for the state q, dq (n,) stamped t [ns]; None is no command.

        A state seen before gets the same command again.  After a stamp that jumps back or
        too far ahead, or after a silence, nothing is integrated over it: the controller holds the
        pose measured then, after it has braked along its path if only the stamps jumped.
        ``now`` is when the state came, steady clock [s]; None: ages go by the stamps alone.

        Raises:
            InvalidMessageError: if the state is older than the last one, or the robot cannot
                have reached it.
        """
        at, limiter = Instant(t, now), self.limiter
        q_c = None if self.command is None else self.command.q
        state = self.admission.admit(at, q, dq, q_c, patient=not limiter.commands_efforts)
        if state.code & AGAIN:
            return self._again(at, state)
        if self.mode is Mode.WAITING:
            self._begin(state.q)  # others may move the arm until then
            self.scheme.start_from(None)
            self.admission.take(None)
            return None
        if self.admission.last is None or state.restart is not None:
            state = self._begin_again(at, state)
        self._astray = 0
        self.admission.take(at)  # only now: a restart that fails is one again
        self.q, self.dq = state.q, dq
        self._observe(at, state)
        # under positions the arm has stayed at its command, under efforts it has gone on
        lost, dt = state.leapt if limiter.commands_efforts else state.lost, state.dt
        if lost:
            dt -= lost
            self.guidance.wait(lost)
        if limiter.limits is not self._wanted:
            self._lower(dt)
        return self._limited(at, self._commanded(t, dt), state.acted, dt)

    def _again(self, at: Instant, state: Accept) -> JointCommand | None:
        """Return the command for the state seen last, which is seen again, if it may go on."""
        stamp, command = f"its stamp stays at {at.stamp / 1e9:g} s", self.command
        is_position = command is not None and command.effort is None and command.dq is not None
        if not state.code & SAME:
            self._astray += 1
            if self._astray < _MOST_ASTRAY:
                return None  # one that was sent twice, or changed on the way
            self._change(ModeEvent.FAULT, stuck(f"joint_states moves, but {stamp}"))
        elif at.receipt is None or (is_position and self.is_at_rest):
            return command  # it does no harm for as long as one likes
        elif state.acted <= self._options.state_timeout:
            return None  # it has its answer; efforts must not act for longer than states come
        else:
            self._change(ModeEvent.FAULT, stuck(f"joint_states repeats itself: {stamp}"))
        self.command = None
        return None  # there is no time to control by: the robot has to brake itself

    # --- what the mode commands ------------------------------------------------------------

    def _commanded(self, t: int, dt: float) -> JointCommand | None:
        """Return what the mode commands for the state stamped t [ns], dt [s] after the last.

        After a defect it is what holds the arm; None if the scheme cannot even say that.
        """
        try:
            if self.state.is_led:
                return self._followed(t, dt)
            if self.mode is not Mode.STOPPED or self.state.ran_away:
                return None
            if self.guidance.is_braking:
                return self._followed(t, dt)
            return self.scheme.hold(dt, self.q, self.dq)
        except Exception as error:
            self.fail_for_good(error)  # nobody knows what the scheme is worth now
        with suppress(Exception):
            return self.scheme.hold(dt, self.q, self.dq)
        return None

    def _followed(self, t: int, dt: float) -> JointCommand:
        """Return what the law commands on its motion; what holds the arm where it has no answer."""
        scheme, q, dq = self.scheme, self.q, self.dq
        desired = self.guidance.desired(t, dt)
        try:
            tick = scheme.tick(dt, q, dq, desired)
        except (SingularityError, FollowingError) as error:
            if isinstance(error, FollowingError):
                scheme.resume(q)
            command = scheme.hold(dt, q, dq)
            self._change(ModeEvent.FAULT, why_of(error))
            return command
        self.guidance.update(tick, t, dt)
        self._observe_motion(t)
        return tick.command

    # --- what may leave ----------------------------------------------------------------------

    def _limited(
        self, at: Instant, command: JointCommand | None, acted: float, dt: float
    ) -> JointCommand | None:
        """Keep, and return, the command within all bounds, or what follows where there is none."""
        self.command = None
        if self.mode is Mode.DISTRUSTING:
            return None
        if command is not None:
            try:
                self.command = self.limiter(command, self.q, acted, dt)
                self._is_weight = False
            except UnsafeCommandError as error:
                self._change(ModeEvent.FAULT, why_of(error))
        self.command = self.command or self._released(at, acted)
        if self.command is not None:
            self._left = at.seconds
        return self.command

    def _released(self, at: Instant, acted: float) -> JointCommand | None:
        """Return efforts that come to the weight of the arm; then none.

        The robot has to brake itself then, and no effort that was to move the arm acts meanwhile.
        In simulated time they go on: a robot in lock-step does not go on without them.
        """
        limiter = self.limiter
        if not limiter.commands_efforts or (self._is_weight and at.receipt is not None):
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

    # --- limits that change ------------------------------------------------------------------

    def changed(self, options: ControllerOptions) -> None:
        """Take over what bounds the law after its parameters have changed."""
        joints, self.limiter.effort_rate = self.scheme.bounds
        if joints is not self.limiter.limits:
            self._wanted = joints
        self.limiter.chase = options.chase(self.scheme.robot)
        self.guidance.change(self._wanted, options)
        self._lower(0.0)

    def _lower(self, dt: float) -> None:
        """Let the joint speed limits in force come to those wanted in dt [s], as the arm can."""
        before, limits = self.limiter.limits, self._wanted
        if before is not None and limits is not None:
            limits = limits.fallen(before, self.guidance.most_fall(dt, before))
            self.scheme.bound(limits)
        self.limiter.limits = limits
