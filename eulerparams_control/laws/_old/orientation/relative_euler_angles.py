"""Relative Euler angles: those of the mutual rotation R_e' R_d ("alternative", refs. [9], [10])."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Mat, MatLike, Vec, VecLike
from eulerparams_control.laws._old.matrices import Matrices
from eulerparams_control.laws._old.orientation.base import (
    Compliance,
    CompliantRotation,
    Coordinates,
    Laws,
    OrientationRepresentation,
    RotationalSpring,
    moment_in_desired_axes,
)
from eulerparams_control.laws._old.orientation.euler_angles import (
    CompliantAngles,
    angles_spring,
    moved_by,
    normalised,
)
from eulerparams_control.laws._old.orientation.sequences import R_of, T_of, dT_of, extract, rates
from eulerparams_control.laws._old.rotations import Array, cross
from eulerparams_control.laws.impedance_matrices import Impedance


class RelativeEulerAnglesDisplacement(NamedTuple):
    """The Euler angles of the mutual rotation.

    Attributes:
        phi_de: (3,) [rad] extracted from R_e' R_d.
        R_e: (3, 3) orientation of the end effector.
        T_e: (3, 3) R_e T(phi_de): relative angular velocity in the base frame by dphi_de.
    """

    phi_de: VecLike
    R_e: MatLike
    T_e: MatLike

    @property
    def error(self) -> Array:
        """phi_de (3,) [rad]: angles of the sequence, not a vector of a frame."""
        return self.phi_de


@formula
def displacement(
    R_d: Mat, R_e: Mat, previous: RelativeEulerAnglesDisplacement, options: Coordinates
) -> RelativeEulerAnglesDisplacement:
    """Return phi_de of R_e' R_d and T_e = R_e T(phi_de)."""
    phi_de = extract(options.axes, R_e.T @ R_d, previous.phi_de)
    return RelativeEulerAnglesDisplacement(phi_de, R_e, R_e @ T_of(options.axes, phi_de))


@formula
def velocity(
    x_de: RelativeEulerAnglesDisplacement, omega_d: Vec, k_Po: float, options: Coordinates
) -> Vec:
    """Return omega_d + k_Po T_e phi_de, which gives dphi_de = -k_Po phi_de."""
    return omega_d + k_Po * (x_de.T_e @ x_de.phi_de)


@formula
def acceleration(
    x_de: RelativeEulerAnglesDisplacement,
    omega_d: Vec,
    domega_d: Vec,
    omega_e: Vec,
    k_Po: float,
    k_Vo: float,
    options: Coordinates,
) -> Vec:
    """Return domega_d - dT_e dphi_de + T_e (k_Vo dphi_de + k_Po phi_de).

    dphi_de = T_e^-1 (omega_d - omega_e), dT_e = S(omega_e) T_e + R_e dT(phi_de, dphi_de);
    it gives ddphi_de + k_Vo dphi_de + k_Po phi_de = 0.
    """
    phi_de, R_e, omega_de = x_de.phi_de, x_de.R_e, omega_d - omega_e
    dphi_de = rates(options.axes, phi_de, R_e.T @ omega_de)
    dT = dT_of(options.axes, phi_de, dphi_de)
    dT_e_dphi_de = cross(omega_e, omega_de) + R_e @ (dT @ dphi_de)  # T_e dphi_de is omega_de
    return domega_d - dT_e_dphi_de + k_Vo * omega_de + k_Po * (x_de.T_e @ phi_de)


@formula
def begin(R_d: Mat, omega_d: Vec, R_c: Mat, omega_c: Vec, options: Coordinates) -> CompliantAngles:
    """Return phi_cd of R_d' R_c and dphi_cd."""
    phi_cd = extract(options.axes, R_d.T @ R_c, Vec(0.0, 0.0, 0.0))
    return CompliantAngles(phi_cd, rates(options.axes, phi_cd, R_d.T @ (omega_c - omega_d)))


@formula
def rate(y: CompliantAngles, mu_d: Vec, Z: Matrices, options: Coordinates) -> CompliantAngles:
    """Return dy of M_o ddphi_cd + D_o dphi_cd + K_o phi_cd = T'(phi_cd) mu^d."""
    return moved_by(T_of(options.axes, y.phi_cd).T @ mu_d, y, Z)


@formula
def end(
    y: CompliantAngles, dy: CompliantAngles, mu_d: Vec, R_d: Mat, omega_d: Vec, domega_d: Vec,
    options: Coordinates,
) -> CompliantRotation:  # fmt: skip
    """Return R_d R(phi_cd), omega_d + R_d x and domega_d + R_d dx + omega_d x omega_c.

    x = T dphi_cd, dx = T ddphi_cd + dT dphi_cd, in the desired frame, which turns.
    """
    axes, phi_cd, dphi_cd = options.axes, y.phi_cd, y.dphi_cd
    T = T_of(axes, phi_cd)
    dx = T @ dy.dphi_cd + dT_of(axes, phi_cd, dphi_cd) @ dphi_cd
    omega_c = omega_d + R_d @ (T @ dphi_cd)
    domega_c = domega_d + R_d @ dx + cross(omega_d, omega_c)
    return CompliantRotation(R_d @ R_of(axes, phi_cd), omega_c, domega_c)


@formula
def spring(R_d: Mat, R_e: Mat, K_o: Mat, options: Coordinates) -> RotationalSpring:
    """Return the spring of the angles of R_d' R_e."""
    phi = extract(options.axes, R_d.T @ R_e, Vec(0.0, 0.0, 0.0))
    return angles_spring(phi, R_d @ T_of(options.axes, phi), K_o)


class RelativeEulerAnglesRepresentation(OrientationRepresentation):
    """The orientation error is phi_de; singular for large errors only, with XYZ at 90 deg."""

    name = "relative_euler_angles"
    symbol = "phi_de of R_e' R_d"
    unit = "rad"
    laws = Laws(displacement, velocity, acceleration)
    compliance = Compliance(begin, moment_in_desired_axes, rate, normalised, end)
    spring = spring

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return self.options.sequence.singularity

    def impedance(self, Z: Impedance) -> Impedance:
        """Return T(0)' Z T(0): T(0) is I for XYZ only, else the stiffness would be turned.

        Raises:
            ConfigurationError: for sequences whose first and last axis are the same.
        """
        sequence = self.options.sequence
        if sequence.is_proper:
            raise ConfigurationError(
                f"relative_euler_angles of the sequence {sequence.name} are singular where the "
                "frames are aligned: they have no impedance; choose XYZ or another sequence of "
                "three axes"
            )
        return Z.transformed(sequence.T(np.zeros(3)))

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the distance [rad] of the mutual rotation to the pole of the sequence."""
        return self.options.sequence.pole_distance(R_e.T @ R_d)
