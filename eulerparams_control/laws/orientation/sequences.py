"""The 12 sequences of Euler angles: R(phi), T(phi), its derivative, extraction.

A sequence (i, j, k) is intrinsic: R = R_i(alpha) R_j(beta) R_k(gamma), eq. (2).
Six have three different axes (XYZ, ...), six have the last equal to the first (ZYZ, ...).

Notation: ``phi`` (3,) angles [rad], ``i, j, k`` axes as 0, 1, 2, ``l`` the one that is neither i
nor j, ``s`` the sign of the permutation (i, j, l).
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eulerparams_control.errors import SingularityError, UnknownNameError
from eulerparams_control.laws.jit import f8, i8, jit, matrix, new_matrix, new_vector, types, vector
from eulerparams_control.laws.rotations import Array, cross, product, solve, turn

SEQUENCES = (
    *("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"),
    *("XYX", "XZX", "YXY", "YZY", "ZXZ", "ZYZ"),
)


def wrap(phi: Array) -> Array:
    """Return the angles phi [rad] wrapped to (-pi, pi]."""
    wrapped: Array = np.pi - (np.pi - phi) % (2.0 * np.pi)
    wrapped[wrapped <= -np.pi] = np.pi  # rounding may reach -pi
    return wrapped


@jit(new_matrix(i8, f8))
def R_axis(axis: int, angle: float) -> Array:
    """Return the elementary rotation by ``angle`` [rad] about x, y or z (0, 1, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((3, 3))
    R[axis, axis], R[j, j], R[k, k] = 1.0, c, c
    R[j, k], R[k, j] = -s, s
    return R


@jit(new_matrix(i8, i8, i8, vector))
def _R_of(i: int, j: int, k: int, phi: Array) -> Array:
    return product(product(R_axis(i, phi[0]), R_axis(j, phi[1])), R_axis(k, phi[2]))


@jit(new_matrix(i8, i8, i8, vector))
def _T_of(i: int, j: int, k: int, phi: Array) -> Array:
    R_i = R_axis(i, phi[0])
    T = np.zeros((3, 3))
    T[i, 0] = 1.0  # a_i
    T[:, 1] = R_i[:, j]  # R_i(alpha) a_j
    T[:, 2] = turn(R_i, R_axis(j, phi[1])[:, k])  # R_i(alpha) R_j(beta) a_k
    return T


@jit(new_matrix(i8, i8, i8, vector, vector))
def _dT_of(i: int, j: int, k: int, phi: Array, dphi: Array) -> Array:
    T, dT = _T_of(i, j, k, phi), np.zeros((3, 3))
    omega_2 = dphi[0] * T[:, 0]
    dT[:, 1] = cross(omega_2, T[:, 1])
    dT[:, 2] = cross(omega_2 + dphi[1] * T[:, 1], T[:, 2])
    return dT


@jit(types.UniTuple(f8, 3)(i8, i8, i8, matrix))
def _pole_angles(i: int, j: int, k: int, R: Array) -> tuple[float, float, float]:
    """Return alpha and beta [rad], and the sine of the distance to the pole."""
    s, l = 1.0 if (j - i) % 3 == 1 else -1.0, 3 - i - j
    if i == k:
        sine = math.hypot(R[i, j], R[i, l])
        return math.atan2(R[j, i], -s * R[l, i]), math.atan2(sine, R[i, i]), sine
    sine = math.hypot(R[i, i], R[i, j])
    return math.atan2(-s * R[j, k], R[k, k]), math.atan2(s * R[i, k], sine), sine


@jit(new_vector(i8, i8, i8, matrix, f8))
def _extract_of(i: int, j: int, k: int, R: Array, gamma: float) -> Array:
    """Return phi [rad] with R(phi) = R; at the pole, where alpha and gamma are not unique, gamma.

    Else gamma follows from R and alpha: next to the pole, entries of R are rounding noise alone.
    """
    s, l = 1.0 if (j - i) % 3 == 1 else -1.0, 3 - i - j
    alpha, beta, sine = _pole_angles(i, j, k, R)
    phi = np.empty(3)
    if sine > 0.0:
        v = math.cos(alpha) * R[j] + (s * math.sin(alpha)) * R[l]  # row j of R_i(alpha)' R
        gamma = math.atan2(-s * v[l] if i == k else s * v[i], v[j])
    else:
        R_i = product(R, product(R_axis(k, -gamma), R_axis(j, -beta)))
        a, b = (i + 1) % 3, (i + 2) % 3
        alpha = math.atan2(R_i[b, a], R_i[a, a])
    phi[0], phi[1], phi[2] = alpha, beta, gamma
    return phi


@dataclass(frozen=True)
class EulerSequence:
    """One of the 12 sequences of Euler angles; another name raises UnknownNameError."""

    name: str = "XYZ"

    def __post_init__(self) -> None:
        if self.name not in SEQUENCES:
            raise UnknownNameError("Euler sequence", self.name, SEQUENCES)

    @cached_property
    def axes(self) -> tuple[int, int, int]:
        """The axes i, j, k as 0, 1, 2."""
        i, j, k = ("XYZ".index(letter) for letter in self.name)
        return i, j, k

    def R(self, phi: Array) -> Array:
        """Return R(phi) (3, 3) of the angles phi (3,) [rad], eq. (2)."""
        return _R_of(*self.axes, phi)

    def T(self, phi: Array) -> Array:
        """Return T(phi) (3, 3) with omega = T dphi in the base frame, eq. (3)."""
        return _T_of(*self.axes, phi)

    def dT(self, phi: Array, dphi: Array) -> Array:
        """Return the derivative of T (3, 3) [1/s] along the rates dphi (3,) [rad/s]."""
        return _dT_of(*self.axes, phi, dphi)

    def rates(self, phi: Array, omega: Array) -> Array:
        """Return dphi = T(phi)^-1 omega (3,) [rad/s]; raises SingularityError at the pole."""
        dphi = solve(self.T(phi), omega)
        if math.isnan(dphi[0]):
            raise SingularityError(self.singularity)
        return dphi

    def accelerations(self, phi: Array, dphi: Array, domega: Array) -> Array:
        """Return ddphi = T^-1 (domega - dT dphi) (3,) [rad/s^2], the derivative of (3)."""
        return self.rates(phi, domega - self.dT(phi, dphi) @ dphi)

    @property
    def singularity(self) -> str:
        """What is singular where there are no rates, and what helps."""
        return (
            f"T(phi) of the Euler angles {self.name} is singular: at this orientation no "
            "rates of the angles give the desired angular velocity; choose another "
            "euler_sequence or orientation: euler_parameters"
        )

    def extract(self, R: Array, previous: Array | None = None) -> Array:
        """Return phi (3,) [rad] with R(phi) = R; at the pole gamma is the previous one, or 0."""
        return _extract_of(*self.axes, R, 0.0 if previous is None else previous[2])

    def pole_distance(self, R: Array) -> float:
        """Return the angle [rad] in [0, pi/2] from R (3, 3) to the nearest pole of T."""
        return math.asin(min(1.0, _pole_angles(*self.axes, R)[2]))
