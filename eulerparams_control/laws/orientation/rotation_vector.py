"""Rotation vector: theta r, the log map that current packages use (not in the paper)."""

import math

from eulerparams_control.laws.jit import f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.euler_parameters import QuaternionDisplacement
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
    short,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    angle_between,
    right_jacobian,
    rotation_vector,
    solve,
    turn,
)


@jit(new_vector(f8, vector, matrix))
def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
    """Return Omega' K_o o with o = theta r, do = Omega x; Omega is the inverse of J_r(-o)."""
    o = rotation_vector(eta, eps)
    return solve(right_jacobian(-o).T, turn(K_o, o))


class RotationVectorRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is theta r; its law jumps where the sign of the quaternion flips."""

    name = "rotation_vector"
    symbol = "theta r"
    unit = "rad"

    def displacement(
        self, R_d: Array, R_e: Array, previous: QuaternionDisplacement | None = None
    ) -> QuaternionDisplacement:
        """Return {eta_de, eps_de_e} and theta r [rad] of R_e' R_d, the latter in the base frame.

        theta exceeds pi while eta_de < 0.
        """
        Q_de = self.options.sign.mutual(R_e, R_d, previous and previous.Q_de)
        return QuaternionDisplacement(Q_de, R_e @ rotation_vector(*Q_de))

    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return that of theta r, theta at most pi."""
        return elastic_moment(*short(Q_cd), K_o)

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return o' K_o o / 2 with o = theta r."""
        o = rotation_vector(*short(Q_cd))
        return float(o @ K_o @ o) / 2.0

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 180 deg, where r is not unique."""
        return math.pi - float(angle_between(R_e, R_d))
