"""Inverse dynamics, section IV: from the acceleration of the tip to the efforts of the joints."""

from dataclasses import dataclass, field, replace

import numpy as np

from eulerparams_control.errors import ConfigurationError, RobotError
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.limits import Difference
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import check_gains
from eulerparams_control.robot.robot import DynamicState, Robot

# Least eigenvalue of a valid joint inertia [kg m^2].
_LEAST_INERTIA = 1e-7


@dataclass(frozen=True)
class InverseDynamics:
    """The law (33): from the acceleration of the tip to the efforts of the joints.

    Attributes:
        inverse: of the Jacobian.
        gravity, coriolis: whether g and C dq are compensated here; some robots do it themselves.
        friction: that is compensated; None for no compensation.
        posture: (n,) [rad or m] to which a redundant arm tends, or None.
        k_posture: gain of that tendency [1/s^2].
        k_null: damping [1/s] of motions that do not move the tip.
        difference: of two positions of the joints.
    """

    inverse: DampedInverse = field(default_factory=DampedInverse)
    gravity: bool = True
    coriolis: bool = True
    friction: JointFriction | None = None
    posture: Array | None = None
    k_posture: float = 10.0
    k_null: float = 10.0
    difference: Difference = field(default=np.subtract, compare=False)

    def __post_init__(self) -> None:
        check_gains(self, "k_posture", "k_null")

    def acceleration(self, state: DynamicState, a: Array) -> Array:
        """Return ddq (n,) = J^-1 (a - dJ dq), eq. (33), refs. [16], [17].

        With damping and posture where J* leaves a choice:
        ddq = J* (a - dJ dq) + (I - J* J) (-k_null dq - k_posture (q - posture)).
        """
        q, dq, J = state.arm.q, state.arm.dq, state.arm.J
        J_inverse = self.inverse(J)
        ddq_0 = -self.k_null * dq
        if self.posture is not None:
            ddq_0 += self.k_posture * self.difference(self.posture, q)
        return ddq_0 + J_inverse @ (a - state.dJ_dq - J @ ddq_0)

    def effort(self, state: DynamicState, ddq: Array, h: Array | None = None) -> Array:
        """Return tau (n,) = B ddq + C dq + d + g + J' h, eqs. (33), (48).

        Of the terms that are compensated here; h (6,) [N, Nm] is what the end effector exerts
        on the environment, base frame, None is nothing.
        """
        tau: Array = state.B @ ddq
        if self.coriolis:
            tau += state.C_dq
        if self.friction is not None:
            tau += self.friction.effort(state.arm.dq)
        if self.gravity:
            tau += state.g
        if h is not None:
            tau += state.arm.J.T @ h  # eq. (48)
        return tau

    def added(self, state: DynamicState) -> Array | float:
        """Return the efforts (n,) that the robot adds by itself to those commanded."""
        added: Array | float = 0.0
        if not self.gravity:
            added = added + state.g
        if not self.coriolis:
            added = added + state.C_dq
        return added


def fitted(dynamics: InverseDynamics, robot: Robot) -> InverseDynamics:
    """Return the inverse dynamics of the robot, whose posture and friction fit it."""
    given = {"posture": dynamics.posture}
    if dynamics.friction is not None:
        given["friction_viscous"] = dynamics.friction.viscous
        given["friction_coulomb"] = dynamics.friction.coulomb
    for name, values in given.items():
        if values is not None and values.shape != (robot.n,):
            raise ConfigurationError(
                f"{name} has {values.size} values; expected one for each of the {robot.n} "
                f"joints {', '.join(robot.joints)}"
            )
    inverse = replace(dynamics.inverse, length=robot.length)
    return replace(dynamics, difference=robot.limits.difference, inverse=inverse)


def check_model(robot: Robot) -> None:
    """Raise RobotError unless the URDF has what inverse dynamics needs."""
    efforts = zip(robot.joints, robot.limits.effort, strict=True)
    weak = [joint for joint, most in efforts if not most > 0]
    if weak:
        raise RobotError(f"the URDF has an effort limit of 0 for {', '.join(weak)}")
    if robot.mount:
        raise RobotError(
            f"{', '.join(robot.mount)} can move between the root of the URDF and base_frame "
            f"{robot.base_frame}: the direction of gravity is not known"
        )
    zero = np.zeros(robot.n)
    B = robot.dynamic_state(zero, zero).B
    if not np.linalg.eigvalsh(B)[0] > _LEAST_INERTIA:
        raise RobotError(
            "the joint inertia is not positive definite: the URDF lacks <inertial> of some links "
            f"beyond {robot.joints[0]}; efforts cannot be computed without them"
        )
