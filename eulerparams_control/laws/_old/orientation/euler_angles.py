"""Euler angles: the difference phi_d - phi_e of the operational space, eqs. (22)-(26)."""

from typing import NamedTuple

from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Mat, Vec, VecLike, inverse
from eulerparams_control.laws._old.matrices import Matrices
from eulerparams_control.laws._old.orientation.base import (
    Compliance,
    CompliantRotation,
    Coordinates,
    Laws,
    OrientationRepresentation,
    RotationalSpring,
)
from eulerparams_control.laws._old.orientation.sequences import (
    R_of,
    T_of,
    accelerations,
    dT_of,
    extract,
    rates,
    wrap,
)
from eulerparams_control.laws._old.rotations import Array


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
def velocity(x_de: EulerAnglesDisplacement, omega_d: Vec, k_Po: float, options: Coordinates) -> Vec:
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


class CompliantAngles(NamedTuple):
    """The state y of a rotational impedance in angles.

    Attributes:
        phi_cd: (3,) [rad] phi_c - phi_d; or the angles of R_d' R_c.
        dphi_cd: (3,) [rad/s] their rates.
    """

    phi_cd: VecLike
    dphi_cd: VecLike


class AnglesInput(NamedTuple):
    """What drives (55).

    Attributes:
        phi_d: (3,) [rad] of the desired frame, without jumps by a turn.
        mu: (3,) [Nm] contact moment, base frame.
    """

    phi_d: VecLike
    mu: VecLike


@formula
def begin(R_d: Mat, omega_d: Vec, R_c: Mat, omega_c: Vec, options: Coordinates) -> CompliantAngles:
    """Return phi_c - phi_d and dphi_c - dphi_d."""
    axes, none = options.axes, Vec(0.0, 0.0, 0.0)
    phi_d, phi_c = extract(axes, R_d, none), extract(axes, R_c, none)
    dphi_cd = rates(axes, phi_c, omega_c) - rates(axes, phi_d, omega_d)
    return CompliantAngles(wrap(phi_c - phi_d), dphi_cd)


@formula
def drive(R_d: Mat, mu: Vec, previous: AnglesInput, options: Coordinates) -> AnglesInput:
    """Return phi_d next to the one before, and mu."""
    before = previous.phi_d
    return AnglesInput(before + wrap(extract(options.axes, R_d, before) - before), mu)


@formula
def moved_by(mu_T: Vec, y: CompliantAngles, Z: Matrices) -> CompliantAngles:
    """Return dy of M_o ddphi_cd + D_o dphi_cd + K_o phi_cd = T' mu."""
    return CompliantAngles(y.dphi_cd, Z.M_inverse @ (mu_T - Z.D @ y.dphi_cd - Z.K @ y.phi_cd))


@formula
def rate(y: CompliantAngles, u: AnglesInput, Z: Matrices, options: Coordinates) -> CompliantAngles:
    """Return dy of (55), with T of phi_c = phi_d + Delta phi_cd."""
    return moved_by(T_of(options.axes, u.phi_d + y.phi_cd).T @ u.mu, y, Z)


@formula
def normalised(y: CompliantAngles) -> CompliantAngles:
    """Return y: angles need no norm."""
    return y


@formula
def end(
    y: CompliantAngles, dy: CompliantAngles, u: AnglesInput, R_d: Mat, omega_d: Vec,
    domega_d: Vec, options: Coordinates,
) -> CompliantRotation:  # fmt: skip
    """Return R(phi_c), T(phi_c) dphi_c and T(phi_c) ddphi_c + dT(phi_c) dphi_c, eq. (3)."""
    axes, phi_d = options.axes, u.phi_d
    dphi_d = rates(axes, phi_d, omega_d)
    phi_c, dphi_c = phi_d + y.phi_cd, dphi_d + y.dphi_cd
    ddphi_c = accelerations(axes, phi_d, dphi_d, domega_d) + dy.dphi_cd
    T, dT = T_of(axes, phi_c), dT_of(axes, phi_c, dphi_c)
    return CompliantRotation(R_of(axes, phi_c), T @ dphi_c, T @ ddphi_c + dT @ dphi_c)


@formula
def angles_spring(phi: Vec, T: Mat, K_o: Mat) -> RotationalSpring:
    """Return the spring of the angles phi, rates of which turn by T dphi; (56): T^-T K_o phi."""
    axes, pull = inverse(T).T, K_o @ phi
    return RotationalSpring(-(axes @ pull), (phi @ pull) / 2.0, axes)


@formula
def spring(R_d: Mat, R_e: Mat, K_o: Mat, options: Coordinates) -> RotationalSpring:
    """Return the spring of phi_e - phi_d."""
    axes, none = options.axes, Vec(0.0, 0.0, 0.0)
    phi_d, phi_e = extract(axes, R_d, none), extract(axes, R_e, none)
    return angles_spring(wrap(phi_e - phi_d), T_of(axes, phi_e), K_o)


class EulerAnglesRepresentation(OrientationRepresentation):
    """The orientation error is phi_d - phi_e; singular where T(phi) is."""

    name = "euler_angles"
    symbol = "phi_d - phi_e"
    unit = "rad"
    laws = Laws(displacement, velocity, acceleration)
    compliance = Compliance(begin, drive, rate, normalised, end)
    spring = spring

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return self.options.sequence.singularity

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the smaller distance [rad] of the two frames to the pole of the sequence."""
        pole_distance = self.options.sequence.pole_distance
        return min(pole_distance(R_d), pole_distance(R_e))
