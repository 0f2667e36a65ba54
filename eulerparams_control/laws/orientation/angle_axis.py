"""Angle/axis: sin(theta) r = 2 eta eps of the mutual rotation (refs. [9], [10]).

Notation: ``o_de`` (3,) the error, ``Q`` (3, 3) R_d R_e', ``L`` the matrix of do_de = L' omega_d -
L omega_e.
"""

import math
from typing import Any

import numpy as np

from eulerparams_control.laws.jit import f8, jit, matrix, new_matrix, new_vector, vector
from eulerparams_control.laws.orientation.relative_quaternion import (
    QuaternionDisplacement,
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    R_quaternion,
    S,
    product,
    solve,
    turn,
)


@jit(new_matrix(matrix))
def L_of(Q: Array) -> Array:
    """Return L = (tr(Q) I - Q') / 2, linear in Q."""
    return 0.5 * ((Q[0, 0] + Q[1, 1] + Q[2, 2]) * np.eye(3) - Q.T)


@jit(new_matrix(matrix, vector, vector))
def dL_of(Q: Array, omega_d: Array, omega_e: Array) -> Array:
    """Return the derivative of L [1/s]: that of Q is S(omega_d) Q - Q S(omega_e)."""
    return L_of(product(S(omega_d), Q) - product(Q, S(omega_e)))


class AngleAxisRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is sin(theta) r: zero at 180 deg too; L is singular at 90 deg."""

    name = "angle_axis"
    symbol = "sin(theta) r"
    singular_errors = (math.pi / 2, math.pi)
    singularity = (
        "L of angle_axis is singular: the orientation error is 90 deg; use "
        "orientation: euler_parameters for errors that large"
    )

    def e(self, Q: EulerParameters) -> Array:
        """Return 2 eta eps, which does not depend on the sign of the quaternion."""
        return (2.0 * Q.eta) * Q.eps

    def velocity(self, x_de: QuaternionDisplacement, omega_d: Array, k_Po: float) -> Array:
        """Return L^-1 (L' omega_d + k_Po o_de), which gives do_de = -k_Po o_de."""
        L = L_of(_Q(x_de))
        return self.finite(solve(L, L.T @ omega_d + k_Po * x_de.error))

    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return L^-1 (L' domega_d + dL' omega_d - dL omega_e + k_Vo do_de + k_Po o_de)."""
        o_de, Q = x_de.error, _Q(x_de)
        L, dL = L_of(Q), dL_of(Q, omega_d, omega_e)
        do_de = L.T @ omega_d - L @ omega_e
        bracket = L.T @ domega_d + dL.T @ omega_d - dL @ omega_e + k_Vo * do_de + k_Po * o_de
        return self.finite(solve(L, bracket))

    @staticmethod
    @jit(new_vector(f8, vector, matrix))
    def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
        """Return Omega' K_o o with o = 2 eta eps, refs. [9], [10]; Omega' is L of R_cd."""
        return turn(L_of(R_quaternion(eta, eps)), turn(K_o, 2.0 * eta * eps))


def _Q(x_de: QuaternionDisplacement) -> Array:
    """Return R_d R_e'."""
    return R_quaternion(x_de.Q_de.eta, x_de.R_e @ x_de.Q_de.eps)
