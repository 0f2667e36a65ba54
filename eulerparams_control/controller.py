"""The controller around a scheme: time, the desired motion, holding, refusing.

It is the same for all schemes and knows no ROS: a node or a simulation in one process
gives it measured states and references, and gets commands or nothing.
"""

import math
from dataclasses import dataclass

from eulerparams_control.errors import InvalidMessageError, SingularityError
from eulerparams_control.motion import DesiredFrame, DesiredMotion, SetPoint, Trajectory
from eulerparams_control.rotations import Array, angle_between
from eulerparams_control.schemes.base import JointCommand, Scheme, Tick


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
        fault: why the arm is held still instead of moved; "" if it is not.
        resets: how often it started anew after a jump of the stamps.
    """

    def __init__(self, scheme: Scheme, options: ControllerOptions, q: Array) -> None:
        self.scheme = scheme
        self.options = options
        self.resets = 0
        self.tick_now: Tick | None = None
        self.fault = ""
        self._waiting = options.require_reference
        self._t: int | None = None
        self._command: JointCommand | None = None
        self._begin(q)

    def _begin(self, q: Array) -> None:
        """Start at the measured q with zero error, holding its pose."""
        self.scheme.reset(q)
        self._motion = DesiredMotion(self.scheme.start_frame())

    def stop(self) -> JointCommand:
        """Return the command that holds still, and hold from now on."""
        command = self.scheme.hold()
        self._motion.hold(self.scheme.start_frame())
        return command

    def follow(self, motion: Trajectory | SetPoint, start: int | None) -> None:
        """Follow a motion from the stamp ``start`` [ns], or from the next state if None.

        Raises:
            InvalidMessageError: if it begins too far from the present desired frame.
        """
        self._refuse_jump(motion, start)
        self._motion.follow(motion, start)
        self._waiting = False

    def step(self, t: int, q: Array, dq: Array) -> JointCommand | None:
        """Return the command for the state q, dq (n,) stamped t [ns]; None is no command.

        A stamp seen before gets the same command again.  After a stamp that jumps back or
        too far ahead nothing is integrated: the controller holds the pose measured then.
        """
        if self._waiting:
            self._begin(q)  # others may move the arm until then
            return None
        if t == self._t:
            return self._command
        dt = 0.0 if self._t is None else (t - self._t) / 1e9
        if not 0 <= dt <= self.options.state_timeout:
            self.resets += 1
            self._begin(q)
            dt = 0.0
        self._t = t
        self._command = self._tick(t, dt, q, dq)
        return self._command

    def _tick(self, t: int, dt: float, q: Array, dq: Array) -> JointCommand:
        try:
            self.tick_now = self.scheme.tick(dt, q, dq, self._motion.sample(t))
            self.fault = ""
            return self.tick_now.command
        except SingularityError as error:
            self.fault = str(error)
            return self.stop()

    def _refuse_jump(self, motion: Trajectory | SetPoint, start: int | None) -> None:
        here, there = self._motion.last, motion.frames[0]
        if isinstance(motion, Trajectory):  # after its start, it does not begin at its first frame
            late = 0.0 if start is None or self._t is None else max(0.0, (self._t - start) / 1e9)
            try:
                there = motion.from_frame(here).sample(late)
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


def _distance(a: DesiredFrame, b: DesiredFrame) -> tuple[float, float]:
    difference = a.p_d - b.p_d
    return math.sqrt(difference @ difference), angle_between(a.R_d, b.R_d)
