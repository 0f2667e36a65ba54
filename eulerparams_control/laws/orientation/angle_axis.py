"""Angle/axis: sin(theta) r = 2 eta eps of the mutual rotation (refs. [9], [10])."""

import math
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.laws.jit import f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    S,
    angle_between,
    mutual_R,
    outer,
    solve,
    turn,
    turn_back,
)

_I = np.eye(3)


class AngleAxisDisplacement(NamedTuple):
    """The error sin(theta) r and the matrix of its derivative.

    Attributes:
        error: (3,) o_de = R_e 2 eta_de eps_de_e, base frame.
        Q: (3, 3) R_d R_e'.
        L: (3, 3) (tr(Q) I - Q') / 2; do_de = L' omega_d - L omega_e.
    """

    error: Array
    Q: Array
    L: Array


def L_of(Q: Array) -> Array:
    """Return (tr(Q) I - Q') / 2, linear in Q."""
    L: Array = 0.5 * ((Q[0, 0] + Q[1, 1] + Q[2, 2]) * _I - Q.T)
    return L


@jit(new_vector(f8, vector, matrix))
def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
    """Return Omega' K_o o with o = 2 eta eps, do = Omega x.

    Omega = eta^2 I - eps eps' - eta S(eps): that of f = sin(theta), without its 0 / 0.
    """
    Omega = eta * eta * np.eye(3) - outer(eps, eps) - eta * S(eps)
    return turn_back(Omega, turn(K_o, 2.0 * eta * eps))


class AngleAxisRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is sin(theta) r: zero at 180 deg too; L is singular at 90 deg."""

    name = "angle_axis"
    symbol = "sin(theta) r"

    def displacement(
        self, R_d: Array, R_e: Array, previous: AngleAxisDisplacement | None = None
    ) -> AngleAxisDisplacement:
        """Return o_de = 2 eta eps_de and L; neither depends on the sign of the quaternion."""
        Q_de = mutual_R(R_e, R_d)
        Q = R_d @ R_e.T
        return AngleAxisDisplacement((2.0 * Q_de.eta) * (R_e @ Q_de.eps), Q, L_of(Q))

    def velocity(self, x_de: AngleAxisDisplacement, omega_d: Array, k_Po: float) -> Array:
        """Return L^-1 (L' omega_d + k_Po o_de), which gives do_de = -k_Po o_de."""
        return self.finite(solve(x_de.L, x_de.L.T @ omega_d + k_Po * x_de.error))

    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return L^-1 (L' domega_d + dL' omega_d - dL omega_e + k_Vo do_de + k_Po o_de).

        do_de = L' omega_d - L omega_e; it gives ddo_de + k_Vo do_de + k_Po o_de = 0.
        """
        o_de, Q, L = x_de
        dQ = S(omega_d) @ Q - Q @ S(omega_e)
        dL = L_of(dQ)
        do_de = L.T @ omega_d - L @ omega_e
        bracket = L.T @ domega_d + dL.T @ omega_d - dL @ omega_e + k_Vo * do_de + k_Po * o_de
        return self.finite(solve(L, bracket))

    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return that of sin(theta) r, refs. [9], [10]."""
        return elastic_moment(Q_cd.eta, Q_cd.eps, K_o)

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return o' K_o o / 2 with o = 2 eta eps."""
        return 2.0 * Q_cd.eta**2 * float(Q_cd.eps @ K_o @ Q_cd.eps)

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return (
            "L of angle_axis is singular: the orientation error is 90 deg; use "
            "orientation: euler_parameters for errors that large"
        )

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 90 deg or 180 deg."""
        theta = angle_between(R_e, R_d)
        return min(abs(theta - math.pi / 2), math.pi - theta)
