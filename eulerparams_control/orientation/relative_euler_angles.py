"""Relative Euler angles: those of the mutual rotation R_e' R_d ("alternative", refs. [9], [10])."""

from typing import NamedTuple

from eulerparams_control.orientation.base import OrientationRepresentation
from eulerparams_control.rotations import Array, cross


class RelativeEulerAnglesDisplacement(NamedTuple):
    """The Euler angles of the mutual rotation.

    Attributes:
        phi_de: (3,) [rad] extracted from R_e' R_d.
        R_e: (3, 3) orientation of the end effector.
        T_e: (3, 3) R_e T(phi_de): relative angular velocity in the base frame by dphi_de.
    """

    phi_de: Array
    R_e: Array
    T_e: Array

    @property
    def error(self) -> Array:
        """phi_de (3,) [rad]: angles of the sequence, not a vector of a frame."""
        return self.phi_de


class RelativeEulerAnglesRepresentation(OrientationRepresentation):
    """The orientation error is phi_de; singular for large errors only, with XYZ at 90 deg."""

    name = "relative_euler_angles"

    def displacement(
        self, R_d: Array, R_e: Array, previous: RelativeEulerAnglesDisplacement | None = None
    ) -> RelativeEulerAnglesDisplacement:
        """Return phi_de of R_e' R_d and T_e = R_e T(phi_de)."""
        sequence = self.options.sequence
        phi_de = sequence.extract(R_e.T @ R_d, None if previous is None else previous.phi_de)
        return RelativeEulerAnglesDisplacement(phi_de, R_e, R_e @ sequence.T(phi_de))

    def resolved_velocity(
        self, x_de: RelativeEulerAnglesDisplacement, omega_d: Array, k_Po: float
    ) -> Array:
        """Return omega_d + k_Po T_e phi_de, which gives dphi_de = -k_Po phi_de."""
        return omega_d + k_Po * (x_de.T_e @ x_de.phi_de)

    def resolved_acceleration(
        self,
        x_de: RelativeEulerAnglesDisplacement,
        omega_d: Array,
        domega_d: Array,
        omega_e: Array,
        k_Po: float,
        k_Vo: float,
    ) -> Array:
        """Return domega_d - dT_e dphi_de + T_e (k_Vo dphi_de + k_Po phi_de).

        dphi_de = T_e^-1 (omega_d - omega_e), dT_e = S(omega_e) T_e + R_e dT(phi_de, dphi_de);
        it gives ddphi_de + k_Vo dphi_de + k_Po phi_de = 0.
        """
        sequence = self.options.sequence
        omega_de = omega_d - omega_e
        dphi_de = sequence.rates(x_de.phi_de, x_de.R_e.T @ omega_de)
        # T_e dphi_de is omega_de
        dT_e_dphi_de = cross(omega_e, omega_de) + x_de.R_e @ (
            sequence.dT(x_de.phi_de, dphi_de) @ dphi_de
        )
        return domega_d - dT_e_dphi_de + k_Vo * omega_de + k_Po * (x_de.T_e @ x_de.phi_de)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the distance [rad] of the mutual rotation to the pole of the sequence."""
        return self.options.sequence.pole_distance(R_e.T @ R_d)
