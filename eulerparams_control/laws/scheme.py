"""Interface between a control scheme and its controller."""

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import Lyapunov
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import Robot, RobotState


class JointCommand(NamedTuple):
    """Command of a scheme to the joints; None for what it does not command.

    Attributes:
        q: (n,) positions [rad or m].
        dq: (n,) velocities [rad/s or m/s].
        effort: (n,) efforts [Nm or N].
        frame: compliant frame of the tip.
    """

    q: Array | None = None
    dq: Array | None = None
    effort: Array | None = None
    frame: DesiredFrame | None = None


class Bounds(NamedTuple):
    """Bounds on the commands of a scheme, whatever its law.

    Attributes:
        joints: limits of the joints; None if there are none.
        effort_rate: [Nm/s] of each effort.
    """

    joints: JointLimits | None
    effort_rate: float = math.inf


class Tick(NamedTuple):
    """One tick of a scheme.

    Attributes:
        command: for the joints.
        state: kinematics on which the loop was closed.
        desired: the desired frame.
        dp_de: (3,) [m] position error, eq. (21).
        x_de: orientation displacement of the representation, eqs. (22), (27).
        saturated: whether a limit changed the command.
        wrench: (6,) [N, Nm] contact about the tip, base frame; None where none is measured.
    """

    command: JointCommand
    state: RobotState
    desired: DesiredFrame
    dp_de: Array
    x_de: Any
    saturated: bool
    wrench: Array | None = None


def check_gains(law: object, *names: str) -> None:
    """Raise ConfigurationError unless these gains of a law are finite and 0 or more."""
    for name in names:
        if not 0 <= getattr(law, name) < math.inf:
            raise ConfigurationError(f"{name} is {getattr(law, name)}; expected >= 0")


class Scheme(ABC):
    """A control scheme of the paper, with its unavoidable state.

    Attributes:
        robot: the arm.
    """

    robot: Robot

    def frame_at(self, q: Array) -> DesiredFrame:
        """Return the frame of the tip at rest at the positions q (n,)."""
        arm = self.robot.state(q, np.zeros_like(q))
        return DesiredFrame(arm.p_e, arm.R_e)

    @property
    def bounds(self) -> Bounds:
        """Bounds on the commands: the limits of the robot, unless the scheme has others."""
        return Bounds(self.robot.limits)

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
    def is_frozen(self) -> bool:
        """Whether the desired motion has to wait: what it needs is not known."""
        return False

    @abstractmethod
    def start_frame(self) -> DesiredFrame:
        """Return the frame at which the scheme has zero error after a reset, or while it holds."""

    @abstractmethod
    def tick(self, dt: float, q: Array, dq: Array, desired: DesiredFrame) -> Tick:
        """Return the command for the measured q, dq (n,), dt [s] after the tick before."""

    def last_command(self, q: Array, dq: Array) -> JointCommand:
        """Return the command that may stay for good, for an arm at rest at q, dq (n,)."""
        return self.hold(0.0, q, dq)

    @abstractmethod
    def lyapunov(self, tick: Tick) -> Lyapunov | None:
        """Return the Lyapunov function of a tick; None if the representation has none."""
