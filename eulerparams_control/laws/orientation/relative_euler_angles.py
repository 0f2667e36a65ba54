"""Relative Euler angles: those of the mutual rotation R_e' R_d ("alternative", refs. [9], [10]).

The state of their rotational impedance is ``y`` = (phi_cd, dphi_cd) of R_d' R_c, its input
``u`` = mu^d.  ``T_e`` (3, 3) is R_e T(phi_de): omega_d - omega_e = T_e dphi_de.
"""

from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.impedance_matrices import Impedance, Matrices
from eulerparams_control.laws.orientation.base import (
    OrientationRepresentation,
    RotationalSpring,
    in_base,
)
from eulerparams_control.laws.orientation.euler_angles import angles_rate, angles_spring
from eulerparams_control.laws.rotations import Array, cross


class RelativeEulerAnglesDisplacement(NamedTuple):
    """The Euler angles phi_de (3,) [rad] of R_e' R_d, and R_e (3, 3)."""

    error: Array
    R_e: Array


class RelativeEulerAnglesRepresentation(OrientationRepresentation):
    """The orientation error is phi_de; singular for large errors only, with XYZ at 90 deg."""

    name = "relative_euler_angles"
    symbol = "phi_de of R_e' R_d"
    unit = "rad"

    def displacement(
        self, R_d: Array, R_e: Array, previous: RelativeEulerAnglesDisplacement | None = None
    ) -> RelativeEulerAnglesDisplacement:
        """Return phi_de of R_e' R_d."""
        phi_de = self.options.sequence.extract(R_e.T @ R_d, previous and previous.error)
        return RelativeEulerAnglesDisplacement(phi_de, R_e)

    def velocity(self, x_de: RelativeEulerAnglesDisplacement, omega_d: Array, k_Po: float) -> Array:
        """Return omega_d + k_Po T_e phi_de, which gives dphi_de = -k_Po phi_de."""
        phi_de, R_e = x_de
        return omega_d + k_Po * (R_e @ (self.options.sequence.T(phi_de) @ phi_de))

    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return domega_d - dT_e dphi_de + T_e (k_Vo dphi_de + k_Po phi_de).

        dphi_de = T_e^-1 (omega_d - omega_e), dT_e = S(omega_e) T_e + R_e dT(phi_de, dphi_de).
        """
        sequence, (phi_de, R_e) = self.options.sequence, x_de
        omega_de = omega_d - omega_e  # T_e dphi_de
        dphi_de = sequence.rates(phi_de, R_e.T @ omega_de)
        T, dT = sequence.T(phi_de), sequence.dT(phi_de, dphi_de)
        pull = R_e @ (k_Po * (T @ phi_de) - dT @ dphi_de)
        return domega_d - cross(omega_e, omega_de) + k_Vo * omega_de + pull

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the distance [rad] of the mutual rotation to the pole of the sequence."""
        return self.options.sequence.pole_distance(R_e.T @ R_d)

    @property
    def singularity(self) -> str:
        """That of the sequence."""
        return self.options.sequence.singularity

    def relative_state(self, R_d: Array, omega_d: Array, R_c: Array, omega_c: Array) -> Array:
        """Return phi_cd of R_d' R_c and dphi_cd."""
        sequence = self.options.sequence
        phi_cd = sequence.extract(R_d.T @ R_c)
        return np.concatenate((phi_cd, sequence.rates(phi_cd, R_d.T @ (omega_c - omega_d))))

    def state_rate(self, y: Array, mu_d: Array, Z: Matrices) -> Array:
        """Return dy of M_o ddphi_cd + D_o dphi_cd + K_o phi_cd = T'(phi_cd) mu^d."""
        return angles_rate(self.options.sequence.T(y[:3]), mu_d, y, Z)

    def compliant_rotation(
        self, y: Array, dy: Array, mu_d: Array, R_d: Array, omega_d: Array, domega_d: Array
    ) -> tuple[Array, Array, Array]:
        """Return the rotation of R(phi_cd), x = T dphi_cd and dx = T ddphi_cd + dT dphi_cd."""
        sequence, phi_cd, dphi_cd = self.options.sequence, y[:3], y[3:]
        R_cd, T = sequence.R(phi_cd), sequence.T(phi_cd)
        dx = T @ dy[3:] + sequence.dT(phi_cd, dphi_cd) @ dphi_cd
        return in_base(R_d, R_cd, omega_d, domega_d, T @ dphi_cd, dx)

    def spring(self, R_d: Array, R_e: Array, K_o: Array) -> RotationalSpring:
        """Return the spring of the angles of R_d' R_e."""
        phi = self.options.sequence.extract(R_d.T @ R_e)
        return angles_spring(phi, R_d @ self.options.sequence.T(phi), K_o)

    def impedance(self, Z: Impedance) -> Impedance:
        """Return T(0)' Z T(0): T(0) is I for XYZ only, else the stiffness would be turned."""
        sequence = self.options.sequence
        first, _, last = sequence.axes
        if first == last:
            raise ConfigurationError(
                f"relative_euler_angles of the sequence {sequence.name} are singular where the "
                "frames are aligned: they have no impedance; choose XYZ or another sequence of "
                "three axes"
            )
        return Z.transformed(sequence.T(np.zeros(3)))
