"""What the laws move in a map: a free frame, or the tip of a real arm without its servos.

A free frame has J = I: it has no workspace and no singularity of its own, so that what fails
is the representation.  The laws are those of the nodes: :class:`ClikLaw`,
:class:`ResolvedAcceleration`, :class:`InverseDynamics`.
"""

from typing import Any, Protocol

import numpy as np

from eulerparams_control.laws.clik import ClikLaw
from eulerparams_control.laws.dynamic_control import InverseDynamics, ResolvedAcceleration
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import Robot, RobotState

_NONE, _SIX = np.zeros(3), np.zeros(6)
_J = np.eye(6)


class Tip(Protocol):
    """A tip that can be moved."""

    @property
    def state(self) -> RobotState:
        """Its kinematics now."""

    def move(self, dq: Array, dt: float) -> None:
        """Move at a joint velocity for dt [s]."""

    def accelerate(self, a: Array, dt: float) -> None:
        """Move at an acceleration a (6,) [m/s^2, rad/s^2] of the tip for dt [s]."""


class FreeTip:
    """A free frame, which turns as it is told; its joint velocity is its twist.

    Args:
        R: (3, 3) where it is at first.
        omega: (3,) [rad/s] how it turns then.
    """

    def __init__(self, R: Array, omega: Array = _NONE) -> None:
        self._R, self._omega = R, omega

    @property
    def state(self) -> RobotState:
        """Its kinematics now."""
        return RobotState(_SIX, _SIX, _NONE, self._R, _NONE, self._omega, _J)

    def move(self, dq: Array, dt: float) -> None:
        """Turn at an angular velocity for dt [s]."""
        self._omega = dq[3:]
        self._R = exp(dt * self._omega) @ self._R

    def accelerate(self, a: Array, dt: float) -> None:
        """Turn at an angular acceleration for dt [s]."""
        before, self._omega = self._omega, self._omega + dt * a[3:]
        self._R = exp(dt / 2 * (before + self._omega)) @ self._R


class ArmTip:
    """The tip of an arm whose inverse dynamics (33) is exact.

    Args:
        robot: the arm.
        q: (n,) where it is at first, at rest.
    """

    def __init__(self, robot: Robot, q: Array) -> None:
        self._robot, self._dynamics = robot, InverseDynamics()
        self._q, self._dq = q, np.zeros_like(q)

    @property
    def state(self) -> RobotState:
        """Its kinematics now."""
        return self._robot.state(self._q, self._dq)

    def move(self, dq: Array, dt: float) -> None:
        """Move at a joint velocity for dt [s]."""
        self._q, self._dq = self._q + dt * dq, dq

    def accelerate(self, a: Array, dt: float) -> None:
        """Move at an acceleration of the tip for dt [s]."""
        state = self._robot.dynamic_state(self._q, self._dq)
        before, self._dq = self._dq, self._dq + dt * self._dynamics.acceleration(state, a)
        self._q = self._q + dt / 2 * (before + self._dq)


class DrivenTip:
    """A law of kinematic (23), (28) or dynamic control (38), (40) that moves a tip.

    Args:
        law: the law.
        tip: that it moves.
    """

    def __init__(self, law: ClikLaw | ResolvedAcceleration, tip: Tip) -> None:
        self.tip = tip
        self._law = law
        self._x_de: Any = None

    def step(self, measured: RobotState, desired: DesiredFrame, dt: float) -> None:
        """Move the tip for dt [s] as the law answers to what was measured.

        Raises:
            SingularityError: if the law has no finite answer.
        """
        if isinstance(self._law, ClikLaw):
            dq, _, self._x_de = self._law.velocity(measured, desired, self._x_de)
            self.tip.move(dq, dt)
        else:
            a, _, self._x_de = self._law.acceleration(measured, desired, self._x_de)
            self.tip.accelerate(a, dt)
