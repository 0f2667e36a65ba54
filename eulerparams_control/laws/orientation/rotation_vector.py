"""Rotation vector: theta r, the log map that current packages use (not in the paper)."""

import math

from eulerparams_control.laws.jit import f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    right_jacobian,
    rotation_vector,
    solve,
    turn,
)


class RotationVectorRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is theta r; its law jumps where the sign of the quaternion flips.

    theta exceeds pi while eta_de < 0.
    """

    name = "rotation_vector"
    symbol = "theta r"
    unit = "rad"
    singular_errors = (math.pi,)  # where r is not unique

    def e(self, Q: EulerParameters) -> Array:
        """Return theta r [rad], theta in [0, 2 pi)."""
        return rotation_vector(*Q)

    @staticmethod
    @jit(new_vector(f8, vector, matrix))
    def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
        """Return Omega' K_o o with o = theta r, Omega the inverse of J_r(-o), theta <= pi."""
        sign = -1.0 if eta < 0.0 else 1.0
        o = rotation_vector(sign * eta, sign * eps)
        return solve(right_jacobian(-o).T, turn(K_o, o))
