"""Interface between a control scheme and its controller."""

import math
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eulerparams_control.errors import EulerParamsError, FollowingError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import Lyapunov
from eulerparams_control.laws.rotations import Array, angle_between, norm
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import Robot, RobotState

if TYPE_CHECKING:
    from eulerparams_control.parameters.common import ControlParameters


# Directions in which a tip moves; an arm of more joints is redundant.
_DIRECTIONS = 6


class JointCommand(NamedTuple):
    """Command of a scheme to the joints; None for what it does not command."""

    q: Array | None = None  # (n,) [rad or m]
    dq: Array | None = None  # (n,) [rad/s or m/s]
    effort: Array | None = None  # (n,) [Nm or N]
    frame: DesiredFrame | None = None  # the compliant frame of the tip


class Bounds(NamedTuple):
    """Bounds on the commands of a scheme, whatever its law."""

    joints: JointLimits | None
    effort_rate: Array | float = math.inf  # [Nm/s] of each effort, or (n,)


class Tick(NamedTuple):
    """One tick of a scheme.

    Attributes:
        state: the kinematics on which the loop was closed.
        x_de: orientation displacement of the representation, eqs. (22), (27).
        saturated: whether a limit changed the command.
        excess: ratio, >= 1, of the joint speeds or the stretch of a spring that the law asks for to
            their limit.  Above 1 the time of the motion slows down.
        wrench: (6,) [N, Nm] contact about the tip, base frame; None where none is measured.
        effects: further results of the law, for its messages.
    """

    command: JointCommand
    desired: DesiredFrame
    state: RobotState
    x_de: Any
    saturated: bool = False
    excess: float = 1.0
    wrench: Array | None = None
    effects: Any = None

    @property
    def dp_de(self) -> Array:
        """Position error (3,) [m], eq. (21)."""
        return self.desired.p_d - self.state.p_e


class LoopGain(NamedTuple):
    """A gain, and how fast the loop is that it closes."""

    name: str
    value: float
    rate: float  # [1/s] of the loop
    order: int = 1  # the rate goes as the gain to the power of 1 / order

    def at(self, rate: float) -> float:
        """Return the gain with which the loop has another rate [1/s]."""
        return self.value * float((rate / self.rate) ** self.order)


def refuse_error(desired: DesiredFrame, arm: RobotState, bounds: "ControlParameters") -> None:
    """Raise FollowingError if the tip is farther from the desired frame than a bound allows."""
    position, rotation = bounds.max_error_position, bounds.max_error_rotation
    distance = norm(desired.p_d - arm.p_e)
    if distance > position:
        raise FollowingError(
            f"the tip is {distance:.3f} m from the desired frame; at most {position} m is "
            "allowed: is the pose out of reach, or across a singularity? then send a nearer "
            "one; is the arm braked or blocked, or at a limit of its joints? then send the "
            "reference again; is the computer late? then lower the gains k_P and k_V; else "
            "raise max_error_position"
        )
    angle = angle_between(desired.R_d, arm.R_e)
    if angle > rotation:
        raise FollowingError(
            f"the tip is turned by {math.degrees(angle):.1f} deg from the desired frame; "
            f"at most {math.degrees(rotation):.1f} deg is allowed: is the arm "
            "blocked, or the orientation singular? then send the reference again, else "
            "raise max_error_rotation"
        )


class Scheme(ABC):
    """A control scheme of the paper, with its unavoidable state.

    Attributes:
        is_frozen: whether the desired motion has to wait: what it needs is not known.
        behind: why the arm is behind a motion whose time slows down by ``excess``.
        loop_rate: [1/s] of the loop of the fastest gain; 0 if no loop is closed here.
        hold_rate: [1/s] of the loop by which :meth:`hold` holds the arm; 0 if there is none.
        release_rate: [1/s] of states at which a hand that lets go makes no tip too fast, see
            :func:`eulerparams_control.laws.hold.release_rate`; 0 if any will do.
    """

    robot: Robot
    parameters: Any  # ControlParameters
    is_frozen = False
    behind = "the law asks for more than the speeds of the joints"
    loop_rate = hold_rate = release_rate = 0.0
    _posture: Array | None  # (n,) that is asked for
    _home: Array  # (n,) where it began, or was stopped last
    _q: Array  # (n,) where the tip has no error after a reset, or while it holds

    def rehearse(self) -> None:
        """Make two ticks at zero, and hold: the first time is not while an arm moves."""
        zero = np.zeros(self.robot.n)
        with suppress(EulerParamsError):  # zero may be singular
            for _ in range(2):
                self.tick(1e-3, zero, zero, self.frame_at(zero))
        self.hold(1e-3, zero, zero)

    def frame_at(self, q: Array) -> DesiredFrame:
        """Return the frame of the tip at rest at the positions q (n,)."""
        arm = self.robot.state(q, np.zeros_like(q))
        return DesiredFrame(arm.p_e, arm.R_e)

    def way_to_posture(self, q: Array) -> Array | None:
        """Return the way (n,) from q to the posture of the arm; None if it has none.

        A redundant arm for which none is asked keeps that in which it began, or was stopped last.
        """
        posture = self._posture
        if posture is None and self.robot.n > _DIRECTIONS:
            posture = self._home
        return None if posture is None else self.robot.limits.difference(posture, q)

    def start_frame(self) -> DesiredFrame:
        """Return the frame at which the scheme has zero error after a reset, or while it holds."""
        return self.frame_at(self._q)

    @property
    @abstractmethod
    def bounds(self) -> Bounds:
        """The bounds on all commands."""

    @property
    def is_pressing(self) -> bool:
        """Whether it exerts a force, or is to: see ``target_wrench``."""
        return False

    @abstractmethod
    def bound(self, joints: JointLimits) -> None:
        """Keep to limits of the joints from the next tick on."""

    def start_from(self, effort: Array | None) -> None:  # noqa: B027  not all command efforts
        """Take the efforts (n,) that act until the first command; None: they are not known."""

    @abstractmethod
    def change(self, parameters: Any) -> None:
        """Go over to other parameters, without a jump of the command; raises ConfigurationError."""

    @abstractmethod
    def reset(self, q: Array) -> None:
        """Forget the past; begin at the measured positions q (n,)."""

    @abstractmethod
    def resume(self, q: Array) -> None:
        """Restart at the measured q (n,) while the last command still acts."""

    @abstractmethod
    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return the command that holds the arm still, also where the law has failed."""

    @property
    @abstractmethod
    def fastest_gain(self) -> LoopGain | None:
        """The gain that asks for the most states a second; None if no loop is closed here."""

    def skip(self) -> None:  # noqa: B027  most schemes keep no rates
        """Forget what rates are taken of: the next tick comes later than its dt says."""

    @property
    def stop_time(self) -> float:
        """The time constant [s] with which a frozen motion comes to rest; 0: none freezes."""
        return 0.0

    @abstractmethod
    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Return the command for the measured q, dq (n,), dt [s] after the tick before."""

    @abstractmethod
    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the command that may stay for good, for an arm at rest at q, dq (n,)."""

    def stiffness(self, tick: Tick) -> tuple[Array, Array] | None:
        """Return K_p (3, 3) [N/m] of a tick, and the point (3,) [m] where it acts, base frame.

        None: the scheme has none.
        """
        return None

    @abstractmethod
    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return the Lyapunov function of a tick; None if the representation has none."""
