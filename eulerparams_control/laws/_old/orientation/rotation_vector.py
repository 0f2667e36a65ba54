"""Rotation vector: theta r, the log map that current packages use (not in the paper)."""

import math
from typing import NamedTuple

from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Mat, Vec, VecLike, solve
from eulerparams_control.laws._old.orientation.base import Coordinates, Laws
from eulerparams_control.laws._old.orientation.relative_quaternion import (
    Elastic,
    RelativeQuaternionRepresentation,
    acceleration_along,
    relative_compliance,
    relative_spring,
    velocity_along,
)
from eulerparams_control.laws._old.orientation.sign import signed_mutual
from eulerparams_control.laws._old.rotations import (
    Array,
    EulerParameters,
    angle_between,
    opposite,
    right_jacobian,
    rotation_vector,
)


class RotationVectorDisplacement(NamedTuple):
    """The mutual quaternion and its rotation vector.

    Attributes:
        Q_de: {eta_de, eps_de_e} with the sign chosen, as for Euler parameters.
        rho_de: (3,) theta r [rad], base frame; theta exceeds pi while eta_de < 0.
    """

    Q_de: EulerParameters
    rho_de: VecLike

    @property
    def error(self) -> Array:
        """theta r (3,) [rad], base frame."""
        return self.rho_de


@formula
def displacement(
    R_d: Mat, R_e: Mat, previous: RotationVectorDisplacement, options: Coordinates
) -> RotationVectorDisplacement:
    """Return theta r of R_e' R_d, in the base frame."""
    Q_de = signed_mutual(R_e, R_d, previous.Q_de, options.sign)
    return RotationVectorDisplacement(Q_de, R_e @ rotation_vector(Q_de))


@formula
def velocity(
    x_de: RotationVectorDisplacement, omega_d: Vec, k_Po: float, options: Coordinates
) -> Vec:
    """Return the velocity of (28)."""
    return velocity_along(x_de.rho_de, omega_d, k_Po)


@formula
def acceleration(
    x_de: RotationVectorDisplacement,
    omega_d: Vec,
    domega_d: Vec,
    omega_e: Vec,
    k_Po: float,
    k_Vo: float,
    options: Coordinates,
) -> Vec:
    """Return the acceleration of (40)."""
    return acceleration_along(x_de.rho_de, omega_d, domega_d, omega_e, k_Po, k_Vo)


@formula
def elastic_moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return Omega' K_o o with o = theta r, do = Omega x; Omega is the inverse of J_r(-o)."""
    o = short_vector(Q_cd)
    return solve(right_jacobian(-o).T, K_o @ o)


@formula
def elastic_energy(Q_cd: EulerParameters, K_o: Mat) -> float:
    """Return o' K_o o / 2 with o = theta r."""
    o = short_vector(Q_cd)
    return o @ (K_o @ o) / 2.0


@formula
def short_vector(Q: EulerParameters) -> Vec:
    """Return theta r of the one of +-Q that turns by pi at most."""
    return rotation_vector(opposite(Q) if Q.eta < 0.0 else Q)


class RotationVectorRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is theta r; its law jumps where the sign of the quaternion flips."""

    name = "rotation_vector"
    symbol = "theta r"
    unit = "rad"
    laws = Laws(displacement, velocity, acceleration)
    elastic = Elastic(elastic_moment, elastic_energy)
    compliance = relative_compliance(name, elastic)
    spring = relative_spring(name, elastic)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 180 deg, where r is not unique."""
        return math.pi - angle_between(R_e, R_d)
