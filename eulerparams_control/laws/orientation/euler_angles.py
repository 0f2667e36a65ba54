"""Euler angles: the difference phi_d - phi_e of the operational space, eqs. (22)-(26).

The state of their rotational impedance is ``y`` = (phi_cd, dphi_cd), phi_cd = phi_c - phi_d, its
input ``u`` = (phi_d, mu), phi_d without jumps by a turn.
"""

from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.laws.impedance_matrices import Matrices
from eulerparams_control.laws.orientation.base import OrientationRepresentation, RotationalSpring
from eulerparams_control.laws.orientation.sequences import wrap
from eulerparams_control.laws.rotations import Array, inverse


class EulerAnglesDisplacement(NamedTuple):
    """The angles (3,) [rad] of both frames, and phi_d - phi_e wrapped to (-pi, pi], eq. (22)."""

    phi_d: Array
    phi_e: Array
    error: Array


class EulerAnglesRepresentation(OrientationRepresentation):
    """The orientation error is phi_d - phi_e; singular where T(phi) is."""

    name = "euler_angles"
    symbol = "phi_d - phi_e"
    unit = "rad"

    def displacement(
        self, R_d: Array, R_e: Array, previous: EulerAnglesDisplacement | None = None
    ) -> EulerAnglesDisplacement:
        """Return phi_d, phi_e and phi_d - phi_e, eq. (22)."""
        sequence = self.options.sequence
        phi_d = sequence.extract(R_d, previous and previous.phi_d)
        phi_e = sequence.extract(R_e, previous and previous.phi_e)
        return EulerAnglesDisplacement(phi_d, phi_e, wrap(phi_d - phi_e))

    def velocity(self, x_de: EulerAnglesDisplacement, omega_d: Array, k_Po: float) -> Array:
        """Return T(phi_e) (dphi_d + k_Po (phi_d - phi_e)): J_A^-1 = J^-1 diag(I, T) in (23)."""
        sequence, (phi_d, phi_e, phi_de) = self.options.sequence, x_de
        dphi_d = sequence.rates(phi_d, omega_d)  # (3)
        return sequence.T(phi_e) @ (dphi_d + k_Po * phi_de)  # (23), (24)

    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return T (ddphi_d + k_Vo Delta dphi_de + k_Po Delta phi_de) + dT dphi_e, eq. (38).

        The printed eq. (38) has dphi_d for ddphi_d (erratum).
        """
        sequence, (phi_d, phi_e, phi_de) = self.options.sequence, x_de
        dphi_d, dphi_e = sequence.rates(phi_d, omega_d), sequence.rates(phi_e, omega_e)  # (3)
        ddphi_d = sequence.accelerations(phi_d, dphi_d, domega_d)  # derivative of (3)
        T, dT = sequence.T(phi_e), sequence.dT(phi_e, dphi_e)
        dphi_de = dphi_d - dphi_e
        return T @ (ddphi_d + k_Vo * dphi_de + k_Po * phi_de) + dT @ dphi_e  # (38)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the smaller distance [rad] of the two frames to the pole of the sequence."""
        return min(map(self.options.sequence.pole_distance, (R_d, R_e)))

    @property
    def singularity(self) -> str:
        """That of the sequence."""
        return self.options.sequence.singularity

    def relative_state(self, R_d: Array, omega_d: Array, R_c: Array, omega_c: Array) -> Array:
        """Return phi_c - phi_d and dphi_c - dphi_d."""
        sequence = self.options.sequence
        phi_d, phi_c = sequence.extract(R_d), sequence.extract(R_c)
        dphi_cd = sequence.rates(phi_c, omega_c) - sequence.rates(phi_d, omega_d)
        return np.concatenate((wrap(phi_c - phi_d), dphi_cd))

    def relative_input(self, R_d: Array, mu: Array, before: Array | None) -> Array:
        """Return phi_d next to the one before, and mu."""
        near = np.zeros(3) if before is None else before[:3]
        phi_d = self.options.sequence.extract(R_d, near)
        return np.concatenate((near + wrap(phi_d - near), mu))

    def state_rate(self, y: Array, u: Array, Z: Matrices) -> Array:
        """Return dy of (55), with T of phi_c = phi_d + Delta phi_cd."""
        phi_d, mu, phi_cd = u[:3], u[3:], y[:3]
        return angles_rate(self.options.sequence.T(phi_d + phi_cd), mu, y, Z)

    def compliant_rotation(
        self, y: Array, dy: Array, u: Array, R_d: Array, omega_d: Array, domega_d: Array
    ) -> tuple[Array, Array, Array]:
        """Return R(phi_c), T(phi_c) dphi_c and T(phi_c) ddphi_c + dT(phi_c) dphi_c, eq. (3)."""
        sequence, phi_d = self.options.sequence, u[:3]
        dphi_d = sequence.rates(phi_d, omega_d)
        phi_c, dphi_c = phi_d + y[:3], dphi_d + y[3:]
        ddphi_c = sequence.accelerations(phi_d, dphi_d, domega_d) + dy[3:]
        T, dT = sequence.T(phi_c), sequence.dT(phi_c, dphi_c)
        return sequence.R(phi_c), T @ dphi_c, T @ ddphi_c + dT @ dphi_c

    def spring(self, R_d: Array, R_e: Array, K_o: Array) -> RotationalSpring:
        """Return the spring of phi_e - phi_d."""
        sequence = self.options.sequence
        phi_d, phi_e = sequence.extract(R_d), sequence.extract(R_e)
        return angles_spring(wrap(phi_e - phi_d), sequence.T(phi_e), K_o)


def angles_rate(T: Array, mu: Array, y: Array, Z: Matrices) -> Array:
    """Return dy of M_o ddphi_cd + D_o dphi_cd + K_o phi_cd = T' mu, eq. (55)."""
    phi_cd, dphi_cd = y[:3], y[3:]
    ddphi_cd = Z.M_inverse @ (T.T @ mu - Z.D @ dphi_cd - Z.K @ phi_cd)  # (55)
    return np.concatenate((dphi_cd, ddphi_cd))


def angles_spring(phi: Array, T: Array, K_o: Array) -> RotationalSpring:
    """Return the spring of the angles phi, rates of which turn by T dphi; (56): T^-T K_o phi."""
    axes, pull = inverse(T).T, K_o @ phi
    return RotationalSpring(-(axes @ pull), float(phi @ pull) / 2.0, axes)
