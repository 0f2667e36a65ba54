"""Euler parameters: the vector part of the mutual unit quaternion, eqs. (27)-(29)."""

import math
from typing import NamedTuple

from eulerparams_control.orientation.base import OrientationRepresentation
from eulerparams_control.rotations import Array, EulerParameters, mutual_R


class QuaternionDisplacement(NamedTuple):
    """The mutual quaternion {eta_de, eps_de_e} and its vector part in the base frame.

    Attributes:
        Q_de: {eta_de, eps_de_e} with the sign chosen, eps in the end-effector frame.
        eps_de: (3,) in the base frame, eq. (27).
    """

    Q_de: EulerParameters
    eps_de: Array

    @property
    def error(self) -> Array:
        """eps_de (3,), base frame."""
        return self.eps_de


class EulerParametersRepresentation(OrientationRepresentation):
    """The orientation error is eps_de; no orientation is singular."""

    name = "euler_parameters"

    def displacement(
        self, R_d: Array, R_e: Array, previous: QuaternionDisplacement | None = None
    ) -> QuaternionDisplacement:
        """Return {eta_de, eps_de_e} of R_e' R_d and eps_de = R_e eps_de_e, eq. (27)."""
        Q_de = self.options.sign.choose(mutual_R(R_e, R_d), previous and previous.Q_de)
        return QuaternionDisplacement(Q_de, R_e @ Q_de.eps)

    def resolved_velocity(
        self, x_de: QuaternionDisplacement, omega_d: Array, k_Po: float
    ) -> Array:
        """Return omega_d + k_Po eps_de, eq. (28)."""
        return omega_d + k_Po * x_de.eps_de

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return inf: there is no singularity."""
        return math.inf
