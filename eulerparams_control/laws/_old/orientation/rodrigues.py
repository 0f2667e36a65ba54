"""Rodrigues (Gibbs) vector: 2 tan(theta / 2) r = 2 eps / eta (not in the paper)."""

import math
from typing import NamedTuple

from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Mat, Vec, VecLike, identity, outer
from eulerparams_control.laws._old.orientation.base import Coordinates, Laws
from eulerparams_control.laws._old.orientation.relative_quaternion import (
    Elastic,
    RelativeQuaternionRepresentation,
    acceleration_along,
    relative_compliance,
    relative_spring,
    velocity_along,
)
from eulerparams_control.laws._old.rotations import (
    Array,
    EulerParameters,
    S,
    angle_between,
    mutual_R,
)


class RodriguesDisplacement(NamedTuple):
    """The Rodrigues vector of the mutual rotation.

    Attributes:
        g_de: (3,) 2 tan(theta / 2) r, base frame; NaN at 180 deg.
    """

    g_de: VecLike

    @property
    def error(self) -> Array:
        """2 tan(theta / 2) r (3,), base frame."""
        return self.g_de


@formula
def gibbs(Q: EulerParameters) -> Vec:
    """Return g = eps / eta = tan(theta / 2) r, which no sign of Q changes; NaN at 180 deg."""
    if Q.eta == 0.0:
        return Vec(math.nan, math.nan, math.nan)
    return Q.eps / Q.eta


@formula
def displacement(
    R_d: Mat, R_e: Mat, previous: RodriguesDisplacement, options: Coordinates
) -> RodriguesDisplacement:
    """Return 2 tan(theta / 2) r of R_e' R_d, in the base frame."""
    return RodriguesDisplacement(2.0 * (R_e @ gibbs(mutual_R(R_e, R_d))))


@formula
def velocity(x_de: RodriguesDisplacement, omega_d: Vec, k_Po: float, options: Coordinates) -> Vec:
    """Return the velocity of (28)."""
    return velocity_along(x_de.g_de, omega_d, k_Po)


@formula
def acceleration(
    x_de: RodriguesDisplacement,
    omega_d: Vec,
    domega_d: Vec,
    omega_e: Vec,
    k_Po: float,
    k_Vo: float,
    options: Coordinates,
) -> Vec:
    """Return the acceleration of (40)."""
    return acceleration_along(x_de.g_de, omega_d, domega_d, omega_e, k_Po, k_Vo)


@formula
def elastic_moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return Omega' K_o o with o = 2 g, do = Omega x, Omega = I - S(g) + g g'."""
    g = gibbs(Q_cd)
    Omega = identity(1.0) - S(g) + outer(g, g)
    return Omega.T @ (K_o @ (2.0 * g))


@formula
def elastic_energy(Q_cd: EulerParameters, K_o: Mat) -> float:
    """Return o' K_o o / 2 with o = 2 g."""
    g = gibbs(Q_cd)
    return 2.0 * (g @ (K_o @ g))


class RodriguesRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is 2 tan(theta / 2) r: it grows without bound towards 180 deg."""

    name = "rodrigues"
    symbol = "2 tan(theta/2) r"
    laws = Laws(displacement, velocity, acceleration)
    elastic = Elastic(elastic_moment, elastic_energy)
    compliance = relative_compliance(name, elastic)
    spring = relative_spring(name, elastic)

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return (
            "the vector of rodrigues is unbounded: the orientation error is 180 deg; use "
            "orientation: euler_parameters for errors that large"
        )

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 180 deg."""
        return math.pi - angle_between(R_e, R_d)
