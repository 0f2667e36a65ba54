"""Modified Rodrigues parameters: 4 tan(theta / 4) r = 4 eps / (1 + eta) (not in the paper)."""

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
from eulerparams_control.laws._old.orientation.sign import signed_mutual
from eulerparams_control.laws._old.rotations import (
    Array,
    EulerParameters,
    S,
    angle_between,
    opposite,
)


class ModifiedRodriguesDisplacement(NamedTuple):
    """The mutual quaternion and its modified Rodrigues parameters.

    Attributes:
        Q_de: {eta_de, eps_de_e} with the sign chosen, as for Euler parameters; the other sign is
            that of the shadow set.
        s_de: (3,) 4 tan(theta / 4) r, base frame; theta exceeds pi while eta_de < 0.
    """

    Q_de: EulerParameters
    s_de: VecLike

    @property
    def error(self) -> Array:
        """4 tan(theta / 4) r (3,), base frame."""
        return self.s_de


@formula
def modified(Q: EulerParameters) -> Vec:
    """Return s = eps / (1 + eta) = tan(theta / 4) r, theta in [0, 2 pi); NaN at 360 deg."""
    if Q.eta == -1.0:
        return Vec(math.nan, math.nan, math.nan)
    return Q.eps / (1.0 + Q.eta)


@formula
def displacement(
    R_d: Mat, R_e: Mat, previous: ModifiedRodriguesDisplacement, options: Coordinates
) -> ModifiedRodriguesDisplacement:
    """Return 4 tan(theta / 4) r of R_e' R_d, in the base frame."""
    Q_de = signed_mutual(R_e, R_d, previous.Q_de, options.sign)
    return ModifiedRodriguesDisplacement(Q_de, 4.0 * (R_e @ modified(Q_de)))


@formula
def velocity(
    x_de: ModifiedRodriguesDisplacement, omega_d: Vec, k_Po: float, options: Coordinates
) -> Vec:
    """Return the velocity of (28)."""
    return velocity_along(x_de.s_de, omega_d, k_Po)


@formula
def acceleration(
    x_de: ModifiedRodriguesDisplacement,
    omega_d: Vec,
    domega_d: Vec,
    omega_e: Vec,
    k_Po: float,
    k_Vo: float,
    options: Coordinates,
) -> Vec:
    """Return the acceleration of (40)."""
    return acceleration_along(x_de.s_de, omega_d, domega_d, omega_e, k_Po, k_Vo)


@formula
def elastic_moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return Omega' K_o o with o = 4 s, do = Omega x, Omega = (1 - s's) I - 2 S(s) + 2 s s'."""
    s = short_set(Q_cd)
    Omega = identity(1.0 - s @ s) - 2.0 * S(s) + 2.0 * outer(s, s)
    return Omega.T @ (K_o @ (4.0 * s))


@formula
def elastic_energy(Q_cd: EulerParameters, K_o: Mat) -> float:
    """Return o' K_o o / 2 with o = 4 s."""
    s = short_set(Q_cd)
    return 8.0 * (s @ (K_o @ s))


@formula
def short_set(Q: EulerParameters) -> Vec:
    """Return s of the one of +-Q that turns by pi at most; the other is its shadow set."""
    return modified(opposite(Q) if Q.eta < 0.0 else Q)


class ModifiedRodriguesRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is 4 tan(theta / 4) r; its law jumps where the shadow set begins."""

    name = "modified_rodrigues"
    symbol = "4 tan(theta/4) r"
    laws = Laws(displacement, velocity, acceleration)
    elastic = Elastic(elastic_moment, elastic_energy)
    compliance = relative_compliance(name, elastic)
    spring = relative_spring(name, elastic)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 180 deg, where r is not unique."""
        return math.pi - angle_between(R_e, R_d)
