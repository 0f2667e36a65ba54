"""Interface between a control scheme and its controller."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, FollowingError
from eulerparams_control.laws._old.compiled import NONE, Input, Inputs, entry, kernel, layout
from eulerparams_control.laws._old.linear import Mat, Vec, mat, norm, vec
from eulerparams_control.laws._old.orientation import Lyapunov
from eulerparams_control.laws._old.rotations import Array, angle_between
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.motion.frames import DesiredFrame, frame_of
from eulerparams_control.motion.motion_limits import NO_LIMITS, MotionLimits, TipLimits
from eulerparams_control.robot.chain import arm_width
from eulerparams_control.robot.robot import Robot, RobotState


class JointCommand(NamedTuple):
    """Command of a scheme to the joints; None for what it does not command.

    Attributes:
        q: (n,) positions [rad or m].
        dq: (n,) velocities [rad/s or m/s].
        effort: (n,) efforts [Nm or N].
        frame_row: (24,) compliant frame of the tip.
    """

    q: Array | None = None
    dq: Array | None = None
    effort: Array | None = None
    frame_row: Array | None = None

    @property
    def frame(self) -> DesiredFrame | None:
        """The compliant frame of the tip."""
        return None if self.frame_row is None else DesiredFrame.of(self.frame_row)


class Bounds(NamedTuple):
    """Bounds on the commands of a scheme, whatever its law.

    Attributes:
        joints: limits of the joints; None if there are none.
        effort_rate: [Nm/s] of each effort, or (n,).
    """

    joints: JointLimits | None
    effort_rate: Array | float = math.inf


@dataclass(frozen=True)
class ErrorBounds:
    """Errors of the tip at which the motion is stopped.

    Attributes:
        position: [m] between the desired and the actual frame.
        rotation: [rad] between them; pi or more: none stops it.

    Raises:
        ConfigurationError: if one is not positive.
    """

    position: float = math.inf
    rotation: float = math.inf

    def __post_init__(self) -> None:
        for name in ("position", "rotation"):
            if not getattr(self, name) > 0:
                raise ConfigurationError(f"max_error_{name} is {getattr(self, name)}; expected > 0")

    def row(self, motion: MotionLimits | None) -> Array:
        """Return them with the limits of the tip, if there are any, as :class:`TipBounds`."""
        most = NO_LIMITS.row if motion is None else motion.row
        return np.array([self.position, self.rotation, *most])

    def error(self, found: int, desired: DesiredFrame, arm: RobotState) -> FollowingError:
        """Return what to say where the tip was found FAR from the desired frame, or TURNED."""
        if found == FAR:
            distance = np.linalg.norm(desired.p_d - arm.p_e)
            return FollowingError(
                f"the tip is {distance:.3f} m from the desired frame; at most {self.position} m is "
                "allowed: is the pose out of reach, or across a singularity? then send a nearer "
                "one; is the arm braked or blocked, or at a limit of its joints? then send the "
                "reference again; is the computer late? then lower the gains k_P and k_V; else "
                "raise max_error_position"
            )
        angle = angle_between(desired.R_d, arm.R_e)
        return FollowingError(
            f"the tip is turned by {math.degrees(angle):.1f} deg from the desired frame; "
            f"at most {math.degrees(self.rotation):.1f} deg is allowed: is the arm "
            "blocked, or the orientation singular? then send the reference again, else "
            "raise max_error_rotation"
        )


class TipBounds(NamedTuple):
    """Errors of the tip at which the motion is stopped, and its limits, as formulas take them."""

    position: float
    rotation: float
    limits: TipLimits


read_bounds = layout(TipBounds).read

FAR, TURNED = -1, -2
"""Error of a tip beyond the bounds of its errors."""


@kernel
def too_far(desired: DesiredFrame, p_e: Vec, R_e: Mat, bounds: TipBounds) -> int:
    """Return FAR, TURNED, or 0 where the tip is within these errors of the desired frame."""
    if norm(desired.p_d - p_e) > bounds.position:
        return FAR
    return TURNED if angle_between(desired.R_d, R_e) > bounds.rotation else 0


@entry
def is_too_far(
    p_d: Input, R_d: Inputs, dp_d: Input, omega_d: Input, ddp_d: Input, domega_d: Input,
    p_e: Input, R_e: Inputs, bounds: Input,
) -> int:  # fmt: skip
    """Return what ``too_far`` does; ``bounds`` is :meth:`ErrorBounds.row`."""
    desired = frame_of(p_d, R_d, dp_d, omega_d, ddp_d, domega_d)
    return too_far(desired, vec(p_e), mat(R_e), read_bounds(bounds, 0))


@kernel
def tick_places(n: int) -> tuple[int, int, int, int]:
    """Return what is where in the row of a tick, behind that of the arm.

    That is the excess, the two rows (n,) of the command, and x_de.
    """
    at = arm_width(n)
    return at, at + 1, at + 1 + n, at + 1 + 2 * n


class Tick(NamedTuple):
    """One tick of a scheme; what it has seen is made of its numbers where that is asked for.

    Attributes:
        command: for the joints.
        desired_row: (24,) the desired frame.
        arm: row of the arm of n joints on which the loop was closed.
        n: its joints.
        unpack: returns x_de of its row.
        saturated: whether a limit changed the command.
        excess: by how much what the law asks for is beyond its limits, joint speeds or how far a
            spring is stretched; >= 1.  Time waits for the arm then.
        wrench: (6,) [N, Nm] contact about the tip, base frame; None where none is measured.
        details: x_de, and what the law knows besides, as a row.
    """

    command: JointCommand
    desired_row: Array
    arm: Array
    n: int
    unpack: Callable[[Array], Any]
    saturated: bool
    excess: float = 1.0
    wrench: Array | None = None
    details: Array = NONE

    @property
    def desired(self) -> DesiredFrame:
        """The desired frame."""
        return DesiredFrame.of(self.desired_row)

    @property
    def state(self) -> RobotState:
        """Kinematics on which the loop was closed."""
        return RobotState.of(self.arm, self.n)

    @property
    def dp_de(self) -> Array:
        """Position error (3,) [m], eq. (21)."""
        error: Array = self.desired.p_d - self.state.p_e
        return error

    @property
    def x_de(self) -> Any:
        """Orientation displacement of the representation, eqs. (22), (27)."""
        return self.unpack(self.details)


class LoopGain(NamedTuple):
    """A gain, and how fast the loop is that it closes.

    Attributes:
        name: of the gain.
        value: of it.
        rate: [1/s] of the loop.
        order: the rate goes as the gain to the power of 1 / order.
    """

    name: str
    value: float
    rate: float
    order: int = 1

    def at(self, rate: float) -> float:
        """Return the gain with which the loop has another rate [1/s]."""
        return self.value * float((rate / self.rate) ** self.order)


def check_gains(law: object, *names: str) -> None:
    """Raise ConfigurationError unless these gains of a law are finite and 0 or more."""
    for name in names:
        if not 0 <= getattr(law, name) < math.inf:
            raise ConfigurationError(f"{name} is {getattr(law, name)}; expected >= 0")


class Scheme(ABC):
    """A control scheme of the paper, with its unavoidable state.

    Attributes:
        robot: the arm.
        is_frozen: whether the desired motion has to wait: what it needs is not known.
        loop_rate: [1/s] of the loop of the fastest gain; 0 if no loop is closed here.
    """

    robot: Robot
    is_frozen = False
    loop_rate = 0.0

    def frame_at(self, q: Array) -> DesiredFrame:
        """Return the frame of the tip at rest at the positions q (n,)."""
        arm = self.robot.state(q, np.zeros_like(q))
        return DesiredFrame(arm.p_e, arm.R_e)

    @property
    def bounds(self) -> Bounds:
        """Bounds on the commands: the limits of the robot, unless the scheme has others."""
        return Bounds(self.robot.limits)

    @property
    def is_pressing(self) -> bool:
        """Whether it exerts a force, or is to: see ``target_wrench``."""
        return False

    def bound(self, joints: JointLimits) -> None:  # noqa: B027  not all have limits
        """Keep to limits of the joints from the next tick on."""

    def start_from(self, effort: Array | None) -> None:  # noqa: B027  not all command efforts
        """Take the efforts (n,) that act until the first command; None: they are not known."""

    @abstractmethod
    def reset(self, q: Array) -> None:
        """Forget the past; begin at the measured positions q (n,)."""

    def resume(self, q: Array) -> None:
        """Restart at the measured q (n,) while the last command still acts."""
        self.reset(q)

    @abstractmethod
    def hold(self, dt: float, q: Array, dq: Array) -> JointCommand:
        """Return the command that holds the arm still, whatever became of the law.

        Args:
            dt: [s] since the command before.
            q, dq: (n,) measured now.
        """

    @property
    def fastest_gain(self) -> LoopGain | None:
        """The gain that asks for the most states a second; None if no loop is closed here."""
        return None

    @property
    def hold_rate(self) -> float:
        """The rate [1/s] of the loop by which :meth:`hold` holds the arm; 0 if there is none."""
        return 0.0

    def skip(self) -> None:  # noqa: B027  most schemes keep no rates
        """Forget rates of what is measured: more time has gone by than the next tick is told."""

    @property
    def stop_time(self) -> float:
        """The time constant [s] with which a frozen motion comes to rest; 0: none freezes."""
        return 0.0

    @abstractmethod
    def start_frame(self) -> DesiredFrame:
        """Return the frame at which the scheme has zero error after a reset, or while it holds."""

    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Return the command for the measured q, dq (n,), dt [s] after the tick before."""
        return self.step(dt, q, dq, desired.row)

    @abstractmethod
    def step(self, dt: float, q: Array, dq: Array, desired: Array) -> Tick:
        """Return the same for a desired frame in a row (24,); see :meth:`tick`."""

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the command that may stay for good, for an arm at rest at q, dq (n,)."""
        return self.hold(0.0, q, dq)

    @abstractmethod
    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return the Lyapunov function of a tick; None if the representation has none."""
