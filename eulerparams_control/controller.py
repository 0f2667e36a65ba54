"""The controller around a scheme: time, the desired motion, holding, refusing.

It is the same for all schemes and knows no ROS: a node or a simulation in one process
gives it measured states and references, and gets commands or nothing.
"""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import FollowingError, InvalidMessageError, SingularityError
from eulerparams_control.motion import DesiredFrame, DesiredMotion, SetPoint, Trajectory
from eulerparams_control.rotations import Array, angle_between
from eulerparams_control.schemes.base import JointCommand, Scheme, Tick

_HOLDING = "holding the measured pose"

# A reference may start this far ahead [s]: further, the two clocks are not the same.
_MAX_AHEAD = 3600.0


@dataclass(frozen=True)
class ControllerOptions:
    """How a controller treats time and references.

    Attributes:
        state_timeout: [s] gap in the stamps of the state after which it starts anew.
        reference_timeout: [s] for which a single streamed frame holds its twist.
        max_jump_position: [m] by which a reference may be away from the desired frame.
        max_jump_rotation: [rad] the same for the rotation.
        require_reference: whether to be silent until the first reference.
    """

    state_timeout: float = 0.1
    reference_timeout: float = 0.1
    max_jump_position: float = 0.05
    max_jump_rotation: float = 0.2
    require_reference: bool = False


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
        resets: how often it started anew after a jump of the stamps.
    """

    def __init__(self, scheme: Scheme, options: ControllerOptions, q: Array) -> None:
        self.scheme = scheme
        self.options = options
        self.resets = 0
        self.tick_now: Tick | None = None
        self.saturated = 0
        self.fault = ""
        self.doing = "waiting for a reference" if options.require_reference else _HOLDING
        self._waiting = options.require_reference
        self._t: int | None = None
        self._dt = 0.0
        self._q, self._dq = q, np.zeros_like(q)
        self._tick_last: Tick | None = None
        self._tick_before: Tick | None = None
        self._stopped = False
        self._command: JointCommand | None = None
        self._begin(q)

    def _begin(self, q: Array) -> None:
        """Start at the measured q with zero error, holding its pose."""
        self.scheme.reset(q)
        self._motion = DesiredMotion(self.scheme.start_frame())
        self._tick_last = self._tick_before = None

    def stop(self) -> JointCommand:
        """Return the command that holds still, and hold until the next reference."""
        self._stopped = True
        command = self.scheme.hold(self._dt, self._q, self._dq)
        self._motion.hold(self.scheme.start_frame())
        return command

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

    def follow(self, motion: Trajectory | SetPoint, start: int | None) -> None:
        """Follow a motion from the stamp ``start`` [ns], or from the next state if None.

        Raises:
            InvalidMessageError: if it is too far from the present desired frame, or not finite.
        """
        if self._stopped:  # the arm may have moved meanwhile
            self.scheme.resume(self._q)
            self._motion.hold(self.scheme.start_frame())
        self._refuse_jump(motion, start)
        self._motion.follow(motion, start)
        self._waiting = self._stopped = False
        self.doing, self.fault = "following a reference", ""

    def step(self, t: int, q: Array, dq: Array) -> JointCommand | None:
        """Return the command for the state q, dq (n,) stamped t [ns]; None is no command.

        A stamp seen before gets the same command again.  After a stamp that jumps back or
        too far ahead nothing is integrated: the controller holds the pose measured then.
        """
        if self._waiting:
            self._begin(q)  # others may move the arm until then
            return None
        if t == self._t:
            if not np.array_equal(q, self._q):
                self.fault = f"joint_states moves, but its stamp stays at {t / 1e9:g} s"
            return self._command
        self._dt = self._elapsed(t, q)
        self._t, self._q, self._dq = t, q, dq
        self._command = self.stop() if self._stopped else self._tick(t)
        return self._command

    def _elapsed(self, t: int, q: Array) -> float:
        """Return the time [s] since the state before; 0 where it starts anew, holding."""
        if self._t is None:
            if self._motion.is_holding:
                self._begin(q)  # the arm may have moved since activation
            return 0.0
        dt = (t - self._t) / 1e9
        if 0 <= dt <= self.options.state_timeout:
            return dt
        self.resets += 1
        self._begin(q)
        self.doing = f"{_HOLDING}, after a jump of the stamps by {dt:.3g} s"
        return 0.0

    def _tick(self, t: int) -> JointCommand:
        try:
            tick = self.scheme.tick(self._dt, self._q, self._dq, self._motion.sample(t))
        except SingularityError as error:
            self.fault = str(error)
            return self.stop()
        except FollowingError as error:
            self.fault = str(error)
            self._begin(self._q)
            return self.stop()
        self._tick_before, self._tick_last, self.tick_now = self._tick_last, tick, tick
        self.saturated += tick.saturated
        return tick.command

    def _refuse_jump(self, motion: Trajectory | SetPoint, start: int | None) -> None:
        here, late = self._motion.last, 0.0
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
        distance, angle = _distance(here, there)
        options = self.options
        if not (distance <= options.max_jump_position and angle <= options.max_jump_rotation):
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
