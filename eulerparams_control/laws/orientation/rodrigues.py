"""Rodrigues (Gibbs) vector: 2 tan(theta / 2) r = 2 eps / eta (not in the paper)."""

import math

from eulerparams_control.laws.jit import f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import Array, EulerParameters, cross, dot, turn


class RodriguesRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is 2 tan(theta / 2) r: it grows without bound towards 180 deg."""

    name = "rodrigues"
    symbol = "2 tan(theta/2) r"
    singular_errors = (math.pi,)
    singularity = (
        "the vector of rodrigues is unbounded: the orientation error is 180 deg; use "
        "orientation: euler_parameters for errors that large"
    )

    def e(self, Q: EulerParameters) -> Array:
        """Return 2 g, g = eps / eta, which no sign of the quaternion changes; NaN at 180 deg."""
        return 2.0 / (Q.eta if Q.eta != 0.0 else math.nan) * Q.eps

    @staticmethod
    @jit(new_vector(f8, vector, matrix))
    def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
        """Return Omega' K_o o with o = 2 g, Omega = I - S(g) + g g'."""
        g = 1.0 / (eta if eta != 0.0 else math.nan) * eps
        K_o_o = turn(K_o, 2.0 * g)
        return K_o_o + cross(g, K_o_o) + dot(g, K_o_o) * g
