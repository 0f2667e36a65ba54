"""Euler parameters: the vector part of the mutual unit quaternion, eqs. (27), (30), (42), (66)."""

import math
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Mat, Vec, VecLike
from eulerparams_control.laws._old.orientation.base import Coordinates, Laws, Lyapunov
from eulerparams_control.laws._old.orientation.relative_quaternion import (
    Elastic,
    RelativeQuaternionRepresentation,
    acceleration_along,
    relative_compliance,
    relative_spring,
    velocity_along,
)
from eulerparams_control.laws._old.orientation.sign import signed_mutual
from eulerparams_control.laws._old.rotations import Array, EulerParameters, cross


class QuaternionDisplacement(NamedTuple):
    """The mutual quaternion {eta_de, eps_de_e} and its vector part in the base frame.

    Attributes:
        Q_de: {eta_de, eps_de_e} with the sign chosen, eps in the end-effector frame.
        eps_de: (3,) in the base frame, eq. (27).
    """

    Q_de: EulerParameters
    eps_de: VecLike

    @property
    def error(self) -> Array:
        """eps_de (3,), base frame."""
        return self.eps_de


@formula
def displacement(
    R_d: Mat, R_e: Mat, previous: QuaternionDisplacement, options: Coordinates
) -> QuaternionDisplacement:
    """Return {eta_de, eps_de_e} of R_e' R_d and eps_de = R_e eps_de_e, eq. (27)."""
    Q_de = signed_mutual(R_e, R_d, previous.Q_de, options.sign)
    return QuaternionDisplacement(Q_de, R_e @ Q_de.eps)


@formula
def velocity(x_de: QuaternionDisplacement, omega_d: Vec, k_Po: float, options: Coordinates) -> Vec:
    """Return the velocity of (28)."""
    return velocity_along(x_de.eps_de, omega_d, k_Po)


@formula
def acceleration(
    x_de: QuaternionDisplacement,
    omega_d: Vec,
    domega_d: Vec,
    omega_e: Vec,
    k_Po: float,
    k_Vo: float,
    options: Coordinates,
) -> Vec:
    """Return the acceleration of (40)."""
    return acceleration_along(x_de.eps_de, omega_d, domega_d, omega_e, k_Po, k_Vo)


@formula
def elastic_moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return K_o' eps = 2 E' K_o eps = 2 (eta K_o eps + S(eps) K_o eps), eqs. (60), (66)."""
    K_eps = K_o @ Q_cd.eps
    return 2.0 * (Q_cd.eta * K_eps + cross(Q_cd.eps, K_eps))


@formula
def elastic_energy(Q_cd: EulerParameters, K_o: Mat) -> float:
    """Return 2 eps' K_o eps, of eq. (68)."""
    return 2.0 * (Q_cd.eps @ (K_o @ Q_cd.eps))


class EulerParametersRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is eps_de; no orientation is singular."""

    name = "euler_parameters"
    symbol = "eps_de"
    slope = 0.5
    laws = Laws(displacement, velocity, acceleration)
    elastic = Elastic(elastic_moment, elastic_energy)
    compliance = relative_compliance(name, elastic)
    spring = relative_spring(name, elastic)

    def lyapunov_1(self, x_de: QuaternionDisplacement, k_Po: float) -> Lyapunov:
        """Return V_1 = (eta - 1)^2 + eps' eps and dV_1 = -k_Po eps' eps, eqs. (30), (31)."""
        eps_2: Any = np.sum(x_de.eps_de**2, axis=-1)
        return Lyapunov((x_de.Q_de.eta - 1) ** 2 + eps_2, -k_Po * eps_2)

    def lyapunov_2(
        self, x_de: QuaternionDisplacement, omega_de: Array, k_Po: float, k_Vo: float
    ) -> Lyapunov:
        """Return V_2 and dV_2, eqs. (42), (43).

        V_2 = k_Po V_1 + omega_de' omega_de / 2 and dV_2 = -k_Vo omega_de' omega_de.
        """
        omega_2: Any = np.sum(omega_de**2, axis=-1)
        return Lyapunov(k_Po * self.lyapunov_1(x_de, k_Po).V + omega_2 / 2, -k_Vo * omega_2)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return inf: there is no singularity."""
        return math.inf
