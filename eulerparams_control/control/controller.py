"""The controller around a scheme: time, the desired motion, holding, refusing.

It is the same for all schemes and knows no ROS: a node or a simulation in one process
gives it measured states and references, and gets commands or nothing.
"""

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from eulerparams_control.control.admission import StateCheck
from eulerparams_control.control.command_limiter import CommandGuard
from eulerparams_control.control.runaway import AT_REST, Runaway
from eulerparams_control.control.speed_scaling import Pace
from eulerparams_control.errors import (
    FollowingError,
    InvalidMessageError,
    SingularityError,
    UnsafeCommandError,
    defect,
)
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.laws.scheme import JointCommand, Scheme, Tick
from eulerparams_control.messages.from_ros import FOLLOWING
from eulerparams_control.motion.desired_motion import DesiredMotion, SetPoint
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

_HOLDING = "holding the measured pose"
_LEFT_ALONE = "holding the last desired pose: the set-points have stopped"

# A reference may start this far ahead [s]: further, the two clocks are not the same.
_MAX_AHEAD = 3600.0

# After a fault a stream of set-points is followed again when it has paused this long [s]; one of
# motions that are shorter than that, when it has paused for the other time.
_PAUSE, _SHORT_PAUSE = 0.5, 0.2

# After a jump of the stamps an arm farther [rad or m] from where it was is another one, or a
# simulation that began anew: no command acts on it yet.
_SAME_ARM = 0.03

_AGAIN = "send the reference again"

REPORT_IT = "report it; deactivate and activate to begin anew"
"""What to do about a defect."""


@dataclass(frozen=True)
class ControllerOptions:
    """How a controller treats time and references.

    Attributes:
        state_timeout: [s] gap in the stamps of the state after which it starts anew.
        reference_timeout: [s] for which a single streamed frame holds its twist.
        max_jump_position: [m] by which a reference may be away from the desired frame.
        max_jump_rotation: [rad] the same for the rotation.
        require_reference: whether to be silent until the first reference.
        check_states: whether states that the robot cannot have reached are refused.
        slow_below: smallest singular value of J below which the motion slows down; 0 never.
        max_latency: [s] by which a state may come later than the best one did.
    """

    state_timeout: float = 0.1
    reference_timeout: float = 0.1
    max_jump_position: float = 0.05
    max_jump_rotation: float = 0.2
    require_reference: bool = False
    check_states: bool = False
    slow_below: float = 0.05
    max_latency: float = 0.05


class Controller:
    """Runs a scheme from measured state to command.

    Args:
        scheme: the control scheme.
        options: how it treats time and references.
        q: (n,) measured positions at activation; their pose is held at first.

    Attributes:
        tick_now: the last tick of the scheme; None before the first.
        saturated: how many ticks a limit has changed.
        doing: what it does, in words.
        fault: why the arm is held still instead of moved; "" if it is not.  It lasts until
            the next reference is followed.
        remedy: what is to be done then.
        pace: at which the motion is followed.
        guard: of the commands.
        resets: how often it started anew after a jump of the stamps.
    """

    def __init__(self, scheme: Scheme, options: ControllerOptions, q: Array) -> None:
        self.scheme = scheme
        self.options = options
        self.resets = 0
        self.tick_now: Tick | None = None
        self.saturated = 0
        self.fault = self.remedy = ""
        self.guard = CommandGuard(*scheme.bounds)
        self.pace = Pace(self.guard.limits, options.slow_below)
        self.doing = "waiting for a reference" if options.require_reference else _HOLDING
        self._waiting = options.require_reference
        self._t: int | None = None
        self._now: float | None = None  # when the stamp last went on, steady clock [s]
        self._check = StateCheck(
            scheme.robot, options.state_timeout, options.max_latency, options.check_states
        )
        self._has_let_go = False  # only the brakes act
        self._runaway = Runaway()
        self._left: tuple[int, float | None] | None = None  # when the last command left
        self._dt = 0.0
        self._q, self._dq = q, np.zeros_like(q)
        self._tick_last: Tick | None = None
        self._tick_before: Tick | None = None
        self._stopped = False
        self._stopped_at = 0.0  # [s]
        self._referred = -math.inf  # when a reference came last [s]
        self._is_defective = False
        self._trusted_from = -math.inf  # from when [s] on the steady clock states are believed
        self._command: JointCommand | None = None
        self._begin(q)

    def _begin(self, q: Array, *, acts: bool = False) -> None:
        """Start at the measured q with zero error, holding its pose.

        Args:
            q: (n,) measured.
            acts: whether the command before still acts, so that none may jump.
        """
        if acts:
            self.scheme.resume(q)
        else:
            self.scheme.reset(q)
            self.guard.forget()
        self.pace.forget()
        self._motion = DesiredMotion(self.scheme.start_frame())
        self._tick_last = self._tick_before = None

    def stop(self) -> JointCommand:
        """Return the command that holds still, and hold until the next reference."""
        command = self.scheme.hold(self._dt, self._q, self._dq)
        self.halt()
        return command

    def fail(self, fault: str, remedy: str = _AGAIN) -> None:
        """Hold from the next state on because of a fault, until the next reference."""
        self.fault, self.remedy = fault, remedy
        self.halt()

    def fail_for_good(self, error: Exception) -> None:
        """Hold from the next state on because of a defect; no reference is followed any more."""
        self._is_defective = True
        self.fail(defect(error), REPORT_IT)

    def halt(self) -> None:
        """Hold from the next state on, until the next reference; command nothing now."""
        if not self._stopped:
            self._stopped, self._stopped_at = True, self._time(self._now)
            self._motion.hold(self.scheme.start_frame())
            self._tick_last = None

    def last_command(self) -> JointCommand | None:
        """Return the command after which none will follow; None: the brakes act, or are to.

        Raises:
            UnsafeCommandError: if it is not finite.
        """
        if self._command is None or self._runaway.is_on:
            return None
        command = self.scheme.last_command(self._q, self._dq)
        return CommandGuard(self.guard.limits)(command, self._q, 0.0)

    @property
    def began(self) -> int | None:
        """Stamp [ns] at which the trajectory that is followed began; None if there is none."""
        return self._motion.began

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm was measured to stand still."""
        return bool((np.abs(self._dq) < AT_REST).all())

    def law_changed(self) -> None:
        """Forget the ticks of the law before, and take over what bounds the new one."""
        self.guard.limits, self.guard.effort_rate = self.scheme.bounds
        self.pace.limits = self.guard.limits
        self._tick_last = self._tick_before = None

    def lyapunov(self) -> tuple[float, float, float] | None:
        """Return V, its derivative by the paper, and as measured over the last tick.

        None if the representation has no Lyapunov function, or there are no two ticks yet.
        """
        now, before = self.tick_now, self._tick_before
        if now is None or before is None or self._dt == 0:
            return None
        if type(now.x_de) is not type(before.x_de):  # the representation was replaced
            return None
        V_now, V_before = self.scheme.lyapunov(now), self.scheme.lyapunov(before)
        if V_now is None or V_before is None:
            return None
        return V_now.V, V_now.dV, (V_now.V - V_before.V) / self._dt

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
        self._refuse_after_fault(motion, now)
        here = self.scheme.frame_at(self._q) if self._stopped else self._motion.last
        self._refuse_jump(motion, start, here)
        if self._stopped:  # only now: what is refused does not move what is held
            self.scheme.resume(self._q)
            self._motion.hold(here)
        self._motion.follow(motion, start)
        self._waiting = self._stopped = False
        self.doing, self.fault, self.remedy = FOLLOWING, "", ""

    def step(self, t: int, q: Array, dq: Array, now: float | None = None) -> JointCommand | None:
        """Return the command for the state q, dq (n,) stamped t [ns]; None is no command.

        A state seen before gets the same command again.  After a stamp that jumps back or
        too far ahead, or after a silence, nothing is integrated: the controller holds the pose
        measured then.

        Args:
            t: stamp [ns].
            q, dq: (n,) measured.
            now: when it came, steady clock [s]; None: ages go by the stamps alone.

        Raises:
            InvalidMessageError: if the state is older than the last one, or the robot cannot
                have reached it.
        """
        self._check.refuse(t, q, dq, now, patient=not self.guard.commands_efforts)
        if self._waiting:
            self._begin(q)  # others may move the arm until then
            return None
        silence = 0.0 if now is None or self._now is None else now - self._now
        if t == self._t:
            return self._answer_again(t, q, dq, silence, now)
        before, self._now = self._t, now
        self._dt = self._elapsed(t, q, silence)
        is_frozen = self._check.is_frozen(self._dt, q, dq)
        self._check.take(t, q)
        self._t, self._q, self._dq = t, q, dq
        if self._distrusts(now):
            self._command = None
            return None  # whose state it is, is not known: the robot has to brake itself
        acted = self._acted(before, silence, now)
        if is_frozen:
            self.fail(
                "joint_states reports speeds, but positions that stay the same to the bit",
                "see to the robot's driver or encoders, then send the reference again",
            )
            self._command = self._let_go(acted)  # there is nothing to control by
        else:
            if self._was_silent(t, now):
                self._begin(q)  # the robot has braked since
                self._say_held("a silence of its commands")
            self._command = self._respond(t, acted)
        if self._command is not None:
            self._left = t, now
        return self._command

    def _distrusts(self, now: float | None) -> bool:
        """Whether states have changed to those of another arm, or clock, just now.

        A simulation that began anew goes on steadily; a second publisher is back at once.
        """
        return now is not None and now < self._trusted_from

    def _say_held(self, after: str) -> None:
        """Say that the arm is held where it is, after something; a fault is still told."""
        self.doing = f"{_HOLDING}, after {after}"
        self.remedy = self.remedy if self.fault else _AGAIN

    def _was_silent(self, t: int, now: float | None) -> bool:
        """Whether states came, but no command has left for longer than the timeout."""
        if self._command is not None or self._left is None:
            return False
        stamp, left = self._left
        silence = (t - stamp) / 1e9 if now is None or left is None else now - left
        return not 0 <= silence <= self.options.state_timeout

    def _answer_again(
        self, t: int, q: Array, dq: Array, silence: float, now: float | None
    ) -> JointCommand | None:
        """Return the command of the state seen last, if it may act for longer."""
        if not (np.array_equal(q, self._q) and np.array_equal(dq, self._dq)):
            self.fail(f"joint_states moves, but its stamp stays at {t / 1e9:g} s")
        elif now is None or self._may_stay:
            return self._command
        elif silence <= self.options.state_timeout:
            return None  # it has its answer; efforts must not act for longer than states come
        else:
            self.fail(f"joint_states repeats itself: its stamp stays at {t / 1e9:g} s")
        self._command = None
        return None  # there is no time to control by: the robot has to brake itself

    @property
    def _may_stay(self) -> bool:
        """Whether the last command does no harm for as long as one likes: a position at rest."""
        command = self._command
        if command is None or command.effort is not None or command.dq is None:
            return False
        return self.is_at_rest and bool((np.abs(command.dq) < AT_REST).all())

    def _acted(self, before: int | None, silence: float, now: float | None) -> float:
        """Return the time [s] for which the command before has acted."""
        by_stamps = self._dt if before is not None else 0.0
        if now is None:
            return by_stamps
        return min(by_stamps, silence) if by_stamps > 0 else silence

    def _runs_away(self) -> bool:
        """Whether the arm is out of control, and must be left to its own brakes until it stands."""
        limits = self.guard.limits
        if limits is None or not (self.guard.commands_efforts or self._runaway.is_on):
            return False
        joint = self._runaway.update(self._dt, self._q, self._dq, limits.velocity, self._stopped)
        if joint is not None:
            self.fail(
                f"the arm runs away, {self.scheme.robot.joints[joint]} at {self._dq[joint]:.3g} "
                "rad/s: no commands until it stands",
                f"see to delays and to the model of the arm, or lower the gains; then {_AGAIN}",
            )
        return self._runaway.is_on

    def _let_go(self, elapsed: float) -> JointCommand | None:
        """Return efforts that bear the weight only, until they are reached; then none at all.

        The robot has to brake itself then, and no effort that was to move the arm acts meanwhile.
        In simulated time they go on: a robot in lock-step does not go on without them.
        """
        if not self.guard.commands_efforts or (self._has_let_go and self._now is not None):
            return None
        bounded = self.guard.bounded
        with suppress(Exception):
            command = self._guarded(self.scheme.last_command(self._q, self._dq), elapsed)
            self._has_let_go = self.guard.bounded == bounded
            return command
        return None

    def _respond(self, t: int, elapsed: float) -> JointCommand | None:
        """Return what the scheme commands, or what holds the arm, whatever went wrong."""
        if self._runs_away():
            return self._let_go(elapsed)
        try:
            command: JointCommand | None = self.stop() if self._stopped else self._tick(t)
        except Exception as error:  # a defect: nobody knows what the scheme is worth now
            self.fail_for_good(error)
            command = self._hold_after_defect()
        command = self._guarded(command, elapsed)
        if command is None:
            return self._let_go(elapsed)
        self._has_let_go = False
        return command

    def _hold_after_defect(self) -> JointCommand | None:
        """Return what holds the arm; None if the scheme cannot even say that."""
        with suppress(Exception):
            return self.scheme.hold(self._dt, self._q, self._dq)
        return None

    def _guarded(self, command: JointCommand | None, elapsed: float) -> JointCommand | None:
        """Return the command within all bounds; None, no command, if it is not finite."""
        try:
            return command and self.guard(command, self._q, elapsed)
        except UnsafeCommandError as error:
            self.fail(str(error), error.remedy)
            return None

    def _elapsed(self, t: int, q: Array, silence: float) -> float:
        """Return the time [s] since the state before; 0 where it starts anew, holding."""
        if self._t is None:
            if self._motion.is_holding:
                self._begin(q)  # the arm may have moved since activation
            elif self._jumps(self._motion.last, self.scheme.frame_at(q)):
                self._begin(q)
                self.fail("the arm moved before the reference began; send it again")
            return 0.0
        dt = (t - self._t) / 1e9
        timeout = self.options.state_timeout
        if 0 <= dt <= timeout and silence <= timeout:
            return dt
        self.resets += 1
        # by the stamps alone a silence and a clock that was set forward look the same
        is_heard = silence <= timeout and (dt < 0 or self._now is not None)
        moved = self.scheme.robot.limits.deviation(q, self._q)
        is_same = bool((moved <= _SAME_ARM).all())
        if self._now is not None and silence <= timeout and not is_same:
            self._trusted_from = self._now + timeout
        self._begin(q, acts=is_heard and is_same)
        what = f"a silence of joint_states of {silence:.3g} s"
        if not 0 <= dt <= timeout:
            what = f"a jump of the stamps by {dt:.3g} s"
        self._say_held(what)
        return 0.0

    def _tick(self, t: int) -> JointCommand:
        pace = 0.0 if self.scheme.is_frozen else self.pace.now
        if pace < 1:
            self._motion.wait(round((1 - pace) * self._dt * 1e9))
        desired = self._motion.sample(t)
        if self._motion.has_stopped(t):
            self.doing, self.remedy = _LEFT_ALONE, "see to the node that sends them"
        if pace > 0:
            desired = desired.at_pace(self.pace.now, self.pace.rate)
        try:
            tick = self.scheme.tick(self._dt, self._q, self._dq, desired)
        except SingularityError as error:
            self.fault, self.remedy = str(error), error.remedy
            return self.stop()
        except FollowingError as error:
            self.fault, self.remedy = str(error), error.remedy
            self.scheme.resume(self._q)
            return self.stop()
        self.pace.update(self._dt, tick.state.q, tick.state.dq, tick.state.J)
        self._tick_before, self._tick_last, self.tick_now = self._tick_last, tick, tick
        self.saturated += tick.saturated
        return tick.command

    def _time(self, now: float | None) -> float:
        """Return the time [s]: of the steady clock, or of the stamps where that is not known."""
        return (self._t or 0) / 1e9 if now is None else now

    def _refuse_after_fault(self, motion: Trajectory | SetPoint, now: float | None) -> None:
        """Raise InvalidMessageError while a fault is to be seen to before anything moves.

        References that come one after the other, set-points or short motions, have to pause: who
        sends them may not have noticed.
        """
        if self._is_defective or self._runaway.is_on:
            raise InvalidMessageError(f"the arm is held ({self.fault}); {self.remedy}")
        t = self._time(now)
        since, self._referred = t - self._referred, t
        if not (self._stopped and self.fault):
            return
        if isinstance(motion, SetPoint):
            paused, pause = min(since, t - self._stopped_at), _PAUSE
        elif motion.duration < _PAUSE:
            paused, pause = since, _SHORT_PAUSE
        else:
            return
        if paused < pause:
            raise InvalidMessageError(
                f"the arm is held ({self.fault}); references that come one after the other are "
                f"followed again when they have paused for {pause} s"
            )

    def _jumps(self, here: DesiredFrame, there: DesiredFrame) -> bool:
        distance, angle = _distance(here, there)
        options = self.options
        return not (distance <= options.max_jump_position and angle <= options.max_jump_rotation)

    def _refuse_leap(self, motion: SetPoint) -> None:
        """Raise InvalidMessageError if the twist of a set-point leads farther than it may jump."""
        frame, T = motion.frames[0], motion.lasting
        leads = [
            float(np.linalg.norm(v)) * T + float(np.linalg.norm(a)) * T**2 / 2
            for v, a in ((frame.dp_d, frame.ddp_d), (frame.omega_d, frame.domega_d))
        ]
        most = self.options.max_jump_position, self.options.max_jump_rotation
        if not (leads[0] <= most[0] and leads[1] <= most[1]):
            raise InvalidMessageError(
                f"the twist of the set-point leads {leads[0]:.3g} m and {leads[1]:.3g} rad away "
                f"within {T:g} s; at most {most[0]:g} m and {most[1]:g} rad (max_jump_position, "
                "max_jump_rotation) are followed without the next one"
            )

    def _refuse_jump(
        self, motion: Trajectory | SetPoint, start: int | None, here: DesiredFrame
    ) -> None:
        late = 0.0
        if start is not None and self._t is not None:
            late = (self._t - start) / 1e9
        if late < -_MAX_AHEAD:
            raise InvalidMessageError(
                f"the reference starts {-late:.0f} s after joint_states; are their clocks the same?"
            )
        try:
            there = _farthest(motion, here, max(0.0, late))
        except SingularityError as error:
            raise InvalidMessageError(f"the reference is no motion: {error}") from error
        if isinstance(motion, SetPoint):
            self._refuse_leap(motion)
        if self._jumps(here, there):
            distance, angle = _distance(here, there)
            options = self.options
            raise InvalidMessageError(
                f"the reference begins {distance:.3f} m and {math.degrees(angle):.1f} deg away "
                f"from the present desired frame; at most {options.max_jump_position} m and "
                f"{math.degrees(options.max_jump_rotation):.1f} deg are followed at once: give its "
                "first point a time_from_start > 0, or raise max_jump_position and "
                "max_jump_rotation"
            )


def _farthest(motion: Trajectory | SetPoint, here: DesiredFrame, late: float) -> DesiredFrame:
    """Return the frame of a motion that it may jump to: of a set-point, where its twist ends."""
    if isinstance(motion, Trajectory):
        return motion.from_frame(here).sample(late)
    return motion.sample(math.inf)


def _distance(a: DesiredFrame, b: DesiredFrame) -> tuple[float, float]:
    difference = a.p_d - b.p_d
    return math.sqrt(difference @ difference), angle_between(a.R_d, b.R_d)
