"""Angle/axis: sin(theta) r = 2 eta eps of the mutual rotation (refs. [9], [10])."""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import Array, EulerParameters, S, angle_between, mutual_R
from eulerparams_control.laws.rotations_batch import quaternions, transposed, turn


class AngleAxisDisplacement(NamedTuple):
    """The error sin(theta) r and the matrix of its derivative.

    Attributes:
        o_de: (3,) R_e 2 eta_de eps_de_e, base frame.
        Q: (3, 3) R_d R_e'.
        L: (3, 3) (tr(Q) I - Q') / 2; do_de = L' omega_d - L omega_e.
    """

    o_de: Array
    Q: Array
    L: Array

    @property
    def error(self) -> Array:
        """sin(theta) r (3,), base frame."""
        return self.o_de


class AngleAxisRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is sin(theta) r: zero at 180 deg too; L is singular at 90 deg."""

    name = "angle_axis"
    symbol = "sin(theta) r"

    def displacement(
        self, R_d: Array, R_e: Array, previous: AngleAxisDisplacement | None = None
    ) -> AngleAxisDisplacement:
        """Return o_de = 2 eta eps_de and L; neither depends on the sign of the quaternion."""
        eta, eps = mutual_R(R_e, R_d)
        Q = R_d @ R_e.T
        return AngleAxisDisplacement(2 * eta * (R_e @ eps), Q, _L(Q))

    def displacements(
        self, R_d: Array, R_e: Array, previous: AngleAxisDisplacement | None = None
    ) -> AngleAxisDisplacement:
        """Return o_de (N, 3), Q and L (N, 3, 3)."""
        eta, eps = quaternions(transposed(R_e) @ R_d)
        Q = R_d @ transposed(R_e)
        return AngleAxisDisplacement(2 * np.expand_dims(eta, 1) * turn(R_e, eps), Q, _L(Q))

    def resolved_velocity(self, x_de: AngleAxisDisplacement, omega_d: Array, k_Po: float) -> Array:
        """Return L^-1 (L' omega_d + k_Po o_de), which gives do_de = -k_Po o_de.

        Raises:
            SingularityError: if L is exactly singular.
        """
        return _solve(x_de.L, x_de.L.T @ omega_d + k_Po * x_de.o_de)

    def resolved_acceleration(
        self,
        x_de: AngleAxisDisplacement,
        omega_d: Array,
        domega_d: Array,
        omega_e: Array,
        k_Po: float,
        k_Vo: float,
    ) -> Array:
        """Return L^-1 (L' domega_d + dL' omega_d - dL omega_e + k_Vo do_de + k_Po o_de).

        do_de = L' omega_d - L omega_e; it gives ddo_de + k_Vo do_de + k_Po o_de = 0.

        Raises:
            SingularityError: if L is exactly singular.
        """
        o_de, Q, L = x_de
        dL = _L(S(omega_d) @ Q - Q @ S(omega_e))  # dQ = S(omega_d) Q - Q S(omega_e)
        do_de = L.T @ omega_d - L @ omega_e
        return _solve(
            L, L.T @ domega_d + dL.T @ omega_d - dL @ omega_e + k_Vo * do_de + k_Po * o_de
        )

    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return Omega' K_o o with o = 2 eta eps, do = Omega x (refs. [9], [10]).

        Omega = eta^2 I - eps eps' - eta S(eps): that of f = sin(theta), without its 0 / 0.
        """
        eta, eps = Q_cd
        Omega = eta**2 * np.eye(3) - np.outer(eps, eps) - eta * S(eps)
        mu_E: Array = Omega.T @ (K_o @ (2 * eta * eps))
        return mu_E

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return o' K_o o / 2 with o = 2 eta eps."""
        energy: float = 2 * Q_cd.eta**2 * np.vecdot(Q_cd.eps, Q_cd.eps @ K_o)
        return energy

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 90 deg or 180 deg."""
        theta = angle_between(R_e, R_d)
        return min(abs(theta - math.pi / 2), math.pi - theta)


def _L(Q: Array) -> Array:
    """Return (tr(Q) I - Q') / 2 (..., 3, 3), linear in Q (..., 3, 3)."""
    trace = np.trace(Q, axis1=-2, axis2=-1)
    L: Array = (trace[..., None, None] * np.eye(3) - transposed(Q)) / 2
    return L


def _solve(L: Array, b: Array) -> Array:
    """Return L^-1 b (3,), or raise SingularityError."""
    try:
        x: Array = np.linalg.solve(L, b)
        return x
    except np.linalg.LinAlgError:
        raise SingularityError(
            "L of angle_axis is singular: the orientation error is 90 deg; use "
            "orientation: euler_parameters for errors that large"
        ) from None
