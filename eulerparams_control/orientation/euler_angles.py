"""Euler angles: the difference phi_d - phi_e of the operational space, eqs. (22)-(26)."""

from typing import NamedTuple

from eulerparams_control.orientation.base import OrientationRepresentation
from eulerparams_control.orientation.sequences import wrap
from eulerparams_control.rotations import Array


class EulerAnglesDisplacement(NamedTuple):
    """The angles of both frames and their difference.

    Attributes:
        phi_d: (3,) [rad] of the desired frame.
        phi_e: (3,) [rad] of the end effector.
        dphi_de: (3,) [rad] phi_d - phi_e wrapped to (-pi, pi], eq. (22).
    """

    phi_d: Array
    phi_e: Array
    dphi_de: Array

    @property
    def error(self) -> Array:
        """phi_d - phi_e (3,) [rad]: angles of the sequence, not a vector of a frame."""
        return self.dphi_de


class EulerAnglesRepresentation(OrientationRepresentation):
    """The orientation error is phi_d - phi_e; singular where T(phi) is."""

    name = "euler_angles"

    def displacement(
        self, R_d: Array, R_e: Array, previous: EulerAnglesDisplacement | None = None
    ) -> EulerAnglesDisplacement:
        """Return phi_d, phi_e and phi_d - phi_e, eq. (22)."""
        extract = self.options.sequence.extract
        phi_d = extract(R_d, None if previous is None else previous.phi_d)
        phi_e = extract(R_e, None if previous is None else previous.phi_e)
        return EulerAnglesDisplacement(phi_d, phi_e, wrap(phi_d - phi_e))

    def resolved_velocity(
        self, x_de: EulerAnglesDisplacement, omega_d: Array, k_Po: float
    ) -> Array:
        """Return T(phi_e) (dphi_d + k_Po (phi_d - phi_e)), eq. (23) by way of (24).

        J_A^-1 = J^-1 diag(I, T) exists where J_A does not, so the product is used and
        J_A is never built.
        """
        sequence = self.options.sequence
        dphi_d = sequence.rates(x_de.phi_d, omega_d)  # eq. (3)
        return sequence.T(x_de.phi_e) @ (dphi_d + k_Po * x_de.dphi_de)

    def resolved_acceleration(
        self,
        x_de: EulerAnglesDisplacement,
        omega_d: Array,
        domega_d: Array,
        omega_e: Array,
        k_Po: float,
        k_Vo: float,
    ) -> Array:
        """Return T (ddphi_d + k_Vo Delta dphi_de + k_Po Delta phi_de) + dT dphi_e, eq. (38).

        T and dT are those of phi_e.  The first term is the second derivative ddphi_d; the
        printed eq. (38) has dphi_d (erratum).
        """
        sequence = self.options.sequence
        dphi_d = sequence.rates(x_de.phi_d, omega_d)  # eq. (3)
        dphi_e = sequence.rates(x_de.phi_e, omega_e)
        # ddphi_d = T^-1 (domega_d - dT dphi_d), the derivative of (3)
        ddphi_d = sequence.rates(x_de.phi_d, domega_d - sequence.dT(x_de.phi_d, dphi_d) @ dphi_d)
        return (
            sequence.T(x_de.phi_e)
            @ (ddphi_d + k_Vo * (dphi_d - dphi_e) + k_Po * x_de.dphi_de)
            + sequence.dT(x_de.phi_e, dphi_e) @ dphi_e
        )

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the smaller distance [rad] of the two frames to the pole of the sequence."""
        pole_distance = self.options.sequence.pole_distance
        return min(pole_distance(R_d), pole_distance(R_e))
