"""Pose laws as other packages ship them, for comparison only: one error for the whole pose.

Importing this registers ``as_shipped_log6`` and ``as_shipped_dual`` as representations, which the
node ``clik`` of this room takes for laws of the pose; k_Pp is the gain of both parts.  With
T_e^-1 T_d = {p, R}, in the axes of the tip:

| name | linear and angular velocity |
| --- | --- |
| ``as_shipped_log6`` | k log6, k log R: pink, mink |
| ``as_shipped_dual`` | 2 k times the vector parts of the unit dual quaternion x_e* x_d |
"""

from abc import abstractmethod
from typing import Any

import numpy as np

from eulerparams_control.laws.clik import Clik, held_gain
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.orientation.euler_parameters import EulerParametersRepresentation
from eulerparams_control.laws.orientation.rotation_vector import RotationVectorRepresentation
from eulerparams_control.laws.rotations import (
    Array,
    cross,
    log,
    quaternion,
    right_jacobian,
    solve,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import RobotState


class PoseLaw(OrientationRepresentation):
    """A representation that is of the whole pose."""

    @abstractmethod
    def twist(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Return linear and angular velocity (3,) for the gain 1 and {p, R}, axes of the tip."""


class Log6(PoseLaw, RotationVectorRepresentation):
    """log6 of the pose."""

    name = "as_shipped_log6"

    def twist(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Return log6 of {p, R}: along it the tip goes on a screw."""
        omega = log(R)
        return solve(right_jacobian(-omega), p), omega


class Dual(PoseLaw, EulerParametersRepresentation):
    """The unit dual quaternion."""

    name = "as_shipped_dual"

    def twist(self, p: Array, R: Array) -> tuple[Array, Array]:
        """Return twice the vector parts of Q + (unit) p Q / 2."""
        eta, eps = quaternion(R)
        return eta * p + cross(p, eps), 2.0 * eps


class PoseClik(Clik):
    """CLIK with a law of the pose, without limits of the tip."""

    def _velocity(self, dt: float, arm: RobotState, desired: DesiredFrame) -> tuple[Array, Any]:
        law = self.orientation
        if not isinstance(law, PoseLaw):
            return super()._velocity(dt, arm, desired)
        v, omega = law.twist(arm.R_e.T @ (desired.p_d - arm.p_e), arm.R_e.T @ desired.R_d)
        twist = held_gain(self.parameters.k_Pp, dt) * np.concatenate((arm.R_e @ v, arm.R_e @ omega))
        dq: Array = self._inverse(arm.J) @ twist
        return dq, law.displacement(desired.R_d, arm.R_e, self._x_de)
