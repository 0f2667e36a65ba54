"""Modified Rodrigues parameters: 4 tan(theta / 4) r = 4 eps / (1 + eta) (not in the paper)."""

import math

import numpy as np

from eulerparams_control.laws.jit import jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.euler_parameters import QuaternionDisplacement
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
    short,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    S,
    angle_between,
    dot,
    outer,
    turn,
    turn_back,
)


def modified(Q: EulerParameters) -> Array:
    """Return s = eps / (1 + eta) = tan(theta / 4) r, theta in [0, 2 pi); NaN at 360 deg."""
    return Q.eps / (1.0 + Q.eta) if Q.eta != -1.0 else np.full(3, np.nan)


@jit(new_vector(vector, matrix))
def elastic_moment(s: Array, K_o: Array) -> Array:
    """Return Omega' K_o o with o = 4 s, do = Omega x, Omega = (1 - s's) I - 2 S(s) + 2 s s'."""
    Omega = (1.0 - dot(s, s)) * np.eye(3) - 2.0 * S(s) + 2.0 * outer(s, s)
    return turn_back(Omega, turn(K_o, 4.0 * s))


class ModifiedRodriguesRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is 4 tan(theta / 4) r; its law jumps where the shadow set begins."""

    name = "modified_rodrigues"
    symbol = "4 tan(theta/4) r"

    def displacement(
        self, R_d: Array, R_e: Array, previous: QuaternionDisplacement | None = None
    ) -> QuaternionDisplacement:
        """Return {eta_de, eps_de_e} and 4 tan(theta / 4) r of R_e' R_d, the latter in base axes.

        theta exceeds pi while eta_de < 0; the other sign is that of the shadow set.
        """
        Q_de = self.options.sign.mutual(R_e, R_d, previous and previous.Q_de)
        return QuaternionDisplacement(Q_de, 4.0 * (R_e @ modified(Q_de)))

    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return that of 4 tan(theta / 4) r, theta at most pi."""
        return elastic_moment(modified(short(Q_cd)), K_o)

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return o' K_o o / 2 with o = 4 s."""
        s = modified(short(Q_cd))
        return 8.0 * float(s @ K_o @ s)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 180 deg, where r is not unique."""
        return math.pi - float(angle_between(R_e, R_d))
