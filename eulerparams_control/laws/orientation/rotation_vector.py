"""Rotation vector: theta r, the log map that current packages use (not in the paper)."""

import math
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    angle_between,
    right_jacobian,
    rotation_vector,
)
from eulerparams_control.laws.rotations_batch import rotation_vectors, turn


class RotationVectorDisplacement(NamedTuple):
    """The mutual quaternion and its rotation vector.

    Attributes:
        Q_de: {eta_de, eps_de_e} with the sign chosen, as for Euler parameters.
        rho_de: (3,) theta r [rad], base frame; theta exceeds pi while eta_de < 0.
    """

    Q_de: EulerParameters
    rho_de: Array

    @property
    def error(self) -> Array:
        """theta r (3,) [rad], base frame."""
        return self.rho_de


class RotationVectorRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is theta r; its law jumps where the sign of the quaternion flips."""

    name = "rotation_vector"
    symbol = "theta r"
    unit = "rad"

    def displacement(
        self, R_d: Array, R_e: Array, previous: RotationVectorDisplacement | None = None
    ) -> RotationVectorDisplacement:
        """Return theta r of R_e' R_d, in the base frame."""
        Q_de = self.options.sign.mutual(R_e, R_d, previous and previous.Q_de)
        return RotationVectorDisplacement(Q_de, R_e @ rotation_vector(Q_de))

    def displacements(
        self, R_d: Array, R_e: Array, previous: RotationVectorDisplacement | None = None
    ) -> RotationVectorDisplacement:
        """Return the quaternions and theta r (N, 3) of R_e' R_d, in the base frame."""
        Q_de = self.options.sign.mutuals(R_e, R_d, previous and previous.Q_de)
        return RotationVectorDisplacement(Q_de, turn(R_e, rotation_vectors(Q_de)))

    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return Omega' K_o o with o = theta r, do = Omega x; Omega is the inverse of J_r(-o)."""
        o = rotation_vector(_short(Q_cd))
        return np.linalg.solve(right_jacobian(-o).T, K_o @ o)

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return o' K_o o / 2 with o = theta r."""
        sign: Any = np.where(np.asarray(Q_cd.eta) < 0, -1.0, 1.0)
        o = rotation_vectors(EulerParameters(sign * Q_cd.eta, sign[..., None] * Q_cd.eps))
        energy: float = np.vecdot(o, o @ K_o) / 2
        return energy

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] by which the error is away from 180 deg, where r is not unique."""
        return math.pi - angle_between(R_e, R_d)


def _short(Q: EulerParameters) -> EulerParameters:
    """Return the one of +-Q that turns by pi at most."""
    return -Q if Q.eta < 0 else Q
