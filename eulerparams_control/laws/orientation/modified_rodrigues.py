"""Modified Rodrigues parameters: 4 tan(theta / 4) r = 4 eps / (1 + eta) (not in the paper)."""

import math

from eulerparams_control.laws.jit import f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import Array, EulerParameters, cross, dot, turn


class ModifiedRodriguesRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is 4 tan(theta / 4) r; its law jumps where the shadow set begins.

    theta exceeds pi while eta_de < 0; the other sign is that of the shadow set.
    """

    name = "modified_rodrigues"
    symbol = "4 tan(theta/4) r"
    singular_errors = (math.pi,)  # where r is not unique

    def e(self, Q: EulerParameters) -> Array:
        """Return 4 s, s = eps / (1 + eta) = tan(theta / 4) r, theta in [0, 2 pi); NaN at 2 pi."""
        return 4.0 / (1.0 + Q.eta if Q.eta != -1.0 else math.nan) * Q.eps

    @staticmethod
    @jit(new_vector(f8, vector, matrix))
    def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
        """Return Omega' K_o o with o = 4 s, Omega = (1 - s's) I - 2 S(s) + 2 s s', theta <= pi."""
        sign = -1.0 if eta < 0.0 else 1.0
        s = sign / (1.0 + sign * eta) * eps
        K_o_o = turn(K_o, 4.0 * s)
        return (1.0 - dot(s, s)) * K_o_o + 2.0 * cross(s, K_o_o) + 2.0 * dot(s, K_o_o) * s
