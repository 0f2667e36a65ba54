"""Rodrigues (Gibbs) vector: 2 tan(theta / 2) r = 2 eps / eta (not in the paper)."""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.jit import jit, matrix, new_vector, vector
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
    turn,
    turn_back,
)


class RodriguesDisplacement(NamedTuple):
    """The Rodrigues vector of the mutual rotation.

    Attributes:
        error: (3,) 2 tan(theta / 2) r, base frame; NaN at 180 deg.
    """

    error: Array


def gibbs(Q: EulerParameters) -> Array:
    """Return g = eps / eta = tan(theta / 2) r, which no sign of Q changes; NaN at 180 deg."""
    return Q.eps / Q.eta if Q.eta != 0.0 else np.full(3, np.nan)


@jit(new_vector(vector, matrix))
def elastic_moment(g: Array, K_o: Array) -> Array:
    """Return Omega' K_o o with o = 2 g, do = Omega x, Omega = I - S(g) + g g'."""
    Omega = np.eye(3) - S(g) + outer(g, g)
    return turn_back(Omega, turn(K_o, 2.0 * g))


class RodriguesRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is 2 tan(theta / 2) r: it grows without bound towards 180 deg."""

    name = "rodrigues"
    symbol = "2 tan(theta/2) r"

    def displacement(
        self, R_d: Array, R_e: Array, previous: RodriguesDisplacement | None = None
    ) -> RodriguesDisplacement:
        """Return 2 tan(theta / 2) r of R_e' R_d, in the base frame."""
        return RodriguesDisplacement(2.0 * (R_e @ gibbs(mutual_R(R_e, R_d))))

    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return that of 2 tan(theta / 2) r."""
        return elastic_moment(gibbs(Q_cd), K_o)

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return o' K_o o / 2 with o = 2 g."""
        g = gibbs(Q_cd)
        return 2.0 * float(g @ K_o @ g)

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return (
            "the vector of rodrigues is unbounded: the orientation error is 180 deg; use "
            "orientation: euler_parameters for errors that large"
        )

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 180 deg."""
        return math.pi - float(angle_between(R_e, R_d))
