"""The 12 sequences of Euler angles: R(phi), T(phi), its derivative, extraction.

A sequence (i, j, k) is intrinsic: R = R_i(alpha) R_j(beta) R_k(gamma), eq. (2).
Six have three different axes (XYZ, ...), six have the last equal to the first
(ZYZ, ...).  The derivations for all 12 are in the errata of the paper's equations;
NOTATION.md lists them.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError, UnknownNameError
from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import (
    Mat,
    Vec,
    column,
    columns,
    cross,
    element,
    row,
    solve,
)
from eulerparams_control.laws._old.rotations import Array, R_axis

SEQUENCES = (
    *("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"),
    *("XYX", "XZX", "YXY", "YZY", "ZXZ", "ZYZ"),
)


class Axes(NamedTuple):
    """The axes of a sequence as 0, 1, 2."""

    i: int
    j: int
    k: int


class PoleAngles(NamedTuple):
    """alpha and beta [rad], and the sine of the distance to the pole."""

    alpha: float
    beta: float
    sine: float


@formula
def wrapped(angle: float) -> float:
    """Return an angle [rad] wrapped to (-pi, pi]."""
    angle = math.pi - (math.pi - angle) % (2.0 * math.pi)
    return math.pi if angle <= -math.pi else angle  # rounding may reach -pi


@formula
def wrap(phi: Vec) -> Vec:
    """Return the angles phi [rad] wrapped to (-pi, pi]."""
    return Vec(wrapped(phi.x), wrapped(phi.y), wrapped(phi.z))


@formula
def R_of(axes: Axes, phi: Vec) -> Mat:
    """Return R(phi) of the angles phi [rad], eq. (2)."""
    return R_axis(axes.i, phi.x) @ R_axis(axes.j, phi.y) @ R_axis(axes.k, phi.z)


@formula
def T_of(axes: Axes, phi: Vec) -> Mat:
    """Return T(phi) with omega = T dphi in the base frame, eq. (3)."""
    R_i = R_axis(axes.i, phi.x)
    return columns(
        column(R_axis(axes.i, 0.0), axes.i),  # t1 = a_i
        column(R_i, axes.j),  # t2 = R_i(alpha) a_j
        column(R_i @ R_axis(axes.j, phi.y), axes.k),  # t3 = R_i(alpha) R_j(beta) a_k
    )


@formula
def dT_of(axes: Axes, phi: Vec, dphi: Vec) -> Mat:
    """Return the derivative of T [1/s] along the rates dphi [rad/s]."""
    T = T_of(axes, phi)
    t1, t2, t3 = column(T, 0), column(T, 1), column(T, 2)
    omega_2 = dphi.x * t1
    return columns(0.0 * t1, cross(omega_2, t2), cross(omega_2 + dphi.y * t2, t3))


@formula
def rates(axes: Axes, phi: Vec, omega: Vec) -> Vec:
    """Return dphi = T(phi)^-1 omega [rad/s]; unbounded towards the pole, NaN at it."""
    return solve(T_of(axes, phi), omega)


@formula
def accelerations(axes: Axes, phi: Vec, dphi: Vec, domega: Vec) -> Vec:
    """Return ddphi = T^-1 (domega - dT dphi) [rad/s^2], the derivative of (3)."""
    return rates(axes, phi, domega - dT_of(axes, phi, dphi) @ dphi)


@formula
def pole_angles(axes: Axes, R: Mat) -> PoleAngles:
    """Return what gamma does not enter.

    Gamma does not come from its own entries: next to the pole these and those of
    alpha are rounding noise one by one, and R(phi) would not be R.
    """
    i, j, k = axes.i, axes.j, axes.k
    s, l = parity(axes), 3 - i - j
    r_i, r_j = row(R, i), row(R, j)
    if i == k:
        sine = math.hypot(element(r_i, j), element(r_i, l))
        alpha = math.atan2(element(r_j, i), -s * element(row(R, l), i))
        return PoleAngles(alpha, math.atan2(sine, element(r_i, i)), sine)
    sine = math.hypot(element(r_i, i), element(r_i, j))
    alpha = math.atan2(-s * element(r_j, k), element(row(R, k), k))
    return PoleAngles(alpha, math.atan2(s * element(r_i, k), sine), sine)


@formula
def parity(axes: Axes) -> float:
    """Return the sign s of the permutation (i, j, l), l the axis that is neither i nor j."""
    return 1.0 if (axes.j - axes.i) % 3 == 1 else -1.0


@formula
def extract(axes: Axes, R: Mat, previous: Vec) -> Vec:
    """Return phi [rad] with R(phi) = R.

    At the pole, where alpha and gamma are not unique, the previous gamma is kept.  Next to it the
    angles are those of R as it is, however little its last bits may mean.
    """
    i, j = axes.i, axes.j
    s, l = parity(axes), 3 - i - j
    alpha, beta, sine = pole_angles(axes, R)
    if sine > 0.0:
        # row j of R_i(alpha)' R
        v = math.cos(alpha) * row(R, j) + (s * math.sin(alpha)) * row(R, l)
        y = -s * element(v, l) if i == axes.k else s * element(v, i)
        return Vec(alpha, beta, math.atan2(y, element(v, j)))
    R_i = R @ R_axis(axes.k, previous.z).T @ R_axis(j, beta).T
    y_row, z_row = row(R_i, (i + 1) % 3), row(R_i, (i + 2) % 3)
    alpha = math.atan2(element(z_row, (i + 1) % 3), element(y_row, (i + 1) % 3))
    return Vec(alpha, beta, previous.z)


@formula
def pole_distance(axes: Axes, R: Mat) -> float:
    """Return the angle [rad] in [0, pi/2] from R to the nearest singularity of T."""
    return math.asin(min(1.0, pole_angles(axes, R).sine))


@dataclass(frozen=True)
class EulerSequence:
    """One of the 12 sequences of Euler angles.

    Args:
        name: three letters such as ``"XYZ"``.

    Raises:
        UnknownNameError: if it is none of the 12; lists them.
    """

    name: str = "XYZ"

    def __post_init__(self) -> None:
        if self.name not in SEQUENCES:
            raise UnknownNameError("Euler sequence", self.name, SEQUENCES)

    @cached_property
    def axes(self) -> Axes:
        """The axes i, j, k as 0, 1, 2."""
        return Axes(*("XYZ".index(letter) for letter in self.name))

    @cached_property
    def is_proper(self) -> bool:
        """Whether the last axis is the first (ZYZ and its kin)."""
        return self.axes[0] == self.axes[2]

    def R(self, phi: Array) -> Array:
        """Return R(phi) (..., 3, 3) of the angles phi (..., 3) [rad], eq. (2)."""
        return R_of(self.axes, phi)

    def T(self, phi: Array) -> Array:
        """Return T(phi) (..., 3, 3) with omega = T dphi in the base frame, eq. (3)."""
        return T_of(self.axes, phi)

    def dT(self, phi: Array, dphi: Array) -> Array:
        """Return the derivative of T (3, 3) [1/s] along the rates dphi (3,) [rad/s]."""
        return dT_of(self.axes, phi, dphi)

    def rates(self, phi: Array, omega: Array) -> Array:
        """Return dphi = T(phi)^-1 omega (3,) [rad/s]; unbounded towards the pole.

        Raises:
            SingularityError: if T is exactly singular.
        """
        return self._finite(rates(self.axes, phi, omega))

    @property
    def singularity(self) -> str:
        """What is singular where there are no rates, and what helps."""
        return (
            f"T(phi) of the Euler angles {self.name} is singular: at this orientation no "
            "rates of the angles give the desired angular velocity; choose another "
            "euler_sequence or orientation: euler_parameters"
        )

    def _finite(self, dphi: Array) -> Array:
        if np.isnan(dphi).any():
            raise SingularityError(self.singularity)
        return dphi

    def extract(self, R: Array, previous: Array | None = None) -> Array:
        """Return phi (3,) [rad] with R(phi) = R.

        Args:
            R: rotation matrix (3, 3), or N successive ones, for phi (N, 3).
            previous: the angles before, whose gamma is kept at the pole (else 0).
        """
        return extract(self.axes, R, np.zeros(3) if previous is None else previous)

    def pole_distance(self, R: Array) -> Any:
        """Return the angle [rad] in [0, pi/2] from R (..., 3, 3) to the nearest pole of T."""
        return pole_distance(self.axes, R)
