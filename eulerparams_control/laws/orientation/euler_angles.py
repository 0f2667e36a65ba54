"""Euler angles: the difference phi_d - phi_e of the operational space, eqs. (22)-(26)."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.compiled import formula
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.linear import Mat, Vec, VecLike
from eulerparams_control.laws.orientation.base import (
    CompliantRotation,
    Coordinates,
    Laws,
    OrientationRepresentation,
)
from eulerparams_control.laws.orientation.sequences import (
    T_of,
    accelerations,
    dT_of,
    extract,
    rates,
    wrap,
)
from eulerparams_control.laws.rotations import Array


class EulerAnglesDisplacement(NamedTuple):
    """The angles of both frames and their difference.

    Attributes:
        phi_d: (3,) [rad] of the desired frame.
        phi_e: (3,) [rad] of the end effector.
        dphi_de: (3,) [rad] phi_d - phi_e wrapped to (-pi, pi], eq. (22).
    """

    phi_d: VecLike
    phi_e: VecLike
    dphi_de: VecLike

    @property
    def error(self) -> Array:
        """phi_d - phi_e (3,) [rad]: angles of the sequence, not a vector of a frame."""
        return self.dphi_de


@formula
def displacement(
    R_d: Mat, R_e: Mat, previous: EulerAnglesDisplacement, options: Coordinates
) -> EulerAnglesDisplacement:
    """Return phi_d, phi_e and phi_d - phi_e, eq. (22)."""
    phi_d = extract(options.axes, R_d, previous.phi_d)
    phi_e = extract(options.axes, R_e, previous.phi_e)
    return EulerAnglesDisplacement(phi_d, phi_e, wrap(phi_d - phi_e))


@formula
def velocity(
    x_de: EulerAnglesDisplacement, omega_d: Vec, k_Po: float, options: Coordinates
) -> Vec:
    """Return T(phi_e) (dphi_d + k_Po (phi_d - phi_e)), eq. (23) by way of (24).

    J_A^-1 = J^-1 diag(I, T) exists where J_A does not, so the product is used and
    J_A is never built.
    """
    dphi_d = rates(options.axes, x_de.phi_d, omega_d)  # eq. (3)
    return T_of(options.axes, x_de.phi_e) @ (dphi_d + k_Po * x_de.dphi_de)


@formula
def acceleration(
    x_de: EulerAnglesDisplacement,
    omega_d: Vec,
    domega_d: Vec,
    omega_e: Vec,
    k_Po: float,
    k_Vo: float,
    options: Coordinates,
) -> Vec:
    """Return T (ddphi_d + k_Vo Delta dphi_de + k_Po Delta phi_de) + dT dphi_e, eq. (38).

    T and dT are those of phi_e.  The first term is the second derivative ddphi_d; the
    printed eq. (38) has dphi_d (erratum).
    """
    axes, phi_d, phi_e = options.axes, x_de.phi_d, x_de.phi_e
    dphi_d, dphi_e = rates(axes, phi_d, omega_d), rates(axes, phi_e, omega_e)  # eq. (3)
    ddphi_d = accelerations(axes, phi_d, dphi_d, domega_d)
    return (
        T_of(axes, phi_e) @ (ddphi_d + k_Vo * (dphi_d - dphi_e) + k_Po * x_de.dphi_de)
        + dT_of(axes, phi_e, dphi_e) @ dphi_e
    )


class EulerAnglesRepresentation(OrientationRepresentation):
    """The orientation error is phi_d - phi_e; singular where T(phi) is."""

    name = "euler_angles"
    symbol = "phi_d - phi_e"
    unit = "rad"
    laws = Laws(displacement, velocity, acceleration)

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return self.options.sequence.singularity

    def compliance_begin(self, R_d: Array, omega_d: Array, R_c: Array, omega_c: Array) -> Array:
        """Return y (6,) = (Delta phi_cd, Delta dphi_cd), phi_c - phi_d and its rate."""
        sequence = self.options.sequence
        phi_d, phi_c = sequence.extract(R_d), sequence.extract(R_c)
        dphi_cd = sequence.rates(phi_c, omega_c) - sequence.rates(phi_d, omega_d)
        return np.concatenate((wrap(phi_c - phi_d), dphi_cd))

    def compliance_input(self, R_d: Array, mu: Array, previous: Array | None) -> Array:
        """Return (phi_d, mu) (6,), phi_d without jumps by a turn."""
        phi_d = self.options.sequence.extract(R_d, None if previous is None else previous[:3])
        if previous is not None:
            phi_d = previous[:3] + wrap(phi_d - previous[:3])
        return np.concatenate((phi_d, mu))

    def compliance_rate(self, y: Array, u: Array, Z: Impedance) -> Array:
        """Return dy of M_o Delta ddphi_cd + D_o Delta dphi_cd + K_o Delta phi_cd = T' mu, eq. (55).

        T is that of phi_c = phi_d + Delta phi_cd.
        """
        phi_cd, dphi_cd = y[:3], y[3:]
        T = self.options.sequence.T(u[:3] + phi_cd)
        ddphi_cd = Z.M_inverse @ (T.T @ u[3:] - Z.D @ dphi_cd - Z.K @ phi_cd)
        return np.concatenate((dphi_cd, ddphi_cd))

    def compliance_end(
        self, y: Array, dy: Array, u: Array, R_d: Array, omega_d: Array, domega_d: Array
    ) -> CompliantRotation:
        """Return R(phi_c), T(phi_c) dphi_c and T(phi_c) ddphi_c + dT(phi_c) dphi_c, eq. (3)."""
        sequence, phi_d = self.options.sequence, u[:3]
        dphi_d = sequence.rates(phi_d, omega_d)
        phi_c, dphi_c = phi_d + y[:3], dphi_d + y[3:]
        ddphi_c = sequence.accelerations(phi_d, dphi_d, domega_d) + dy[3:]
        T, dT = sequence.T(phi_c), sequence.dT(phi_c, dphi_c)
        return CompliantRotation(sequence.R(phi_c), T @ dphi_c, T @ ddphi_c + dT @ dphi_c)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the smaller distance [rad] of the two frames to the pole of the sequence."""
        pole_distance = self.options.sequence.pole_distance
        return min(pole_distance(R_d), pole_distance(R_e))
