"""Angle/axis: sin(theta) r = 2 eta eps of the mutual rotation (refs. [9], [10])."""

import math
from typing import NamedTuple

from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Mat, MatLike, Vec, VecLike, identity, outer, solve
from eulerparams_control.laws._old.orientation.base import Coordinates, Laws
from eulerparams_control.laws._old.orientation.relative_quaternion import (
    Elastic,
    RelativeQuaternionRepresentation,
    relative_compliance,
    relative_spring,
)
from eulerparams_control.laws._old.rotations import (
    Array,
    EulerParameters,
    S,
    angle_between,
    mutual_R,
)


class AngleAxisDisplacement(NamedTuple):
    """The error sin(theta) r and the matrix of its derivative.

    Attributes:
        o_de: (3,) R_e 2 eta_de eps_de_e, base frame.
        Q: (3, 3) R_d R_e'.
        L: (3, 3) (tr(Q) I - Q') / 2; do_de = L' omega_d - L omega_e.
    """

    o_de: VecLike
    Q: MatLike
    L: MatLike

    @property
    def error(self) -> Array:
        """sin(theta) r (3,), base frame."""
        return self.o_de


@formula
def L_of(Q: Mat) -> Mat:
    """Return (tr(Q) I - Q') / 2, linear in Q."""
    return 0.5 * (identity(Q.xx + Q.yy + Q.zz) - Q.T)


@formula
def displacement(
    R_d: Mat, R_e: Mat, previous: AngleAxisDisplacement, options: Coordinates
) -> AngleAxisDisplacement:
    """Return o_de = 2 eta eps_de and L; neither depends on the sign of the quaternion."""
    Q_de = mutual_R(R_e, R_d)
    Q = R_d @ R_e.T
    return AngleAxisDisplacement((2.0 * Q_de.eta) * (R_e @ Q_de.eps), Q, L_of(Q))


@formula
def velocity(x_de: AngleAxisDisplacement, omega_d: Vec, k_Po: float, options: Coordinates) -> Vec:
    """Return L^-1 (L' omega_d + k_Po o_de), which gives do_de = -k_Po o_de."""
    return solve(x_de.L, x_de.L.T @ omega_d + k_Po * x_de.o_de)


@formula
def acceleration(
    x_de: AngleAxisDisplacement,
    omega_d: Vec,
    domega_d: Vec,
    omega_e: Vec,
    k_Po: float,
    k_Vo: float,
    options: Coordinates,
) -> Vec:
    """Return L^-1 (L' domega_d + dL' omega_d - dL omega_e + k_Vo do_de + k_Po o_de).

    do_de = L' omega_d - L omega_e; it gives ddo_de + k_Vo do_de + k_Po o_de = 0.
    """
    Q, L = x_de.Q, x_de.L
    dL = L_of(S(omega_d) @ Q - Q @ S(omega_e))  # dQ = S(omega_d) Q - Q S(omega_e)
    do_de = L.T @ omega_d - L @ omega_e
    wanted = L.T @ domega_d + dL.T @ omega_d - dL @ omega_e + k_Vo * do_de + k_Po * x_de.o_de
    return solve(L, wanted)


@formula
def elastic_moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return Omega' K_o o with o = 2 eta eps, do = Omega x (refs. [9], [10]).

    Omega = eta^2 I - eps eps' - eta S(eps): that of f = sin(theta), without its 0 / 0.
    """
    eta, eps = Q_cd.eta, Q_cd.eps
    Omega = identity(eta * eta) - outer(eps, eps) - eta * S(eps)
    return Omega.T @ (K_o @ ((2.0 * eta) * eps))


@formula
def elastic_energy(Q_cd: EulerParameters, K_o: Mat) -> float:
    """Return o' K_o o / 2 with o = 2 eta eps."""
    return 2.0 * Q_cd.eta * Q_cd.eta * (Q_cd.eps @ (K_o @ Q_cd.eps))


class AngleAxisRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is sin(theta) r: zero at 180 deg too; L is singular at 90 deg."""

    name = "angle_axis"
    symbol = "sin(theta) r"
    laws = Laws(displacement, velocity, acceleration)
    elastic = Elastic(elastic_moment, elastic_energy)
    compliance = relative_compliance(name, elastic)
    spring = relative_spring(name, elastic)

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
