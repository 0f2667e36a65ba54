"""The 12 sequences of Euler angles: R(phi), T(phi), its derivative, extraction.

A sequence (i, j, k) is intrinsic: R = R_i(alpha) R_j(beta) R_k(gamma), eq. (2).
Six have three different axes (XYZ, ...), six have the last equal to the first
(ZYZ, ...).  The derivations for all 12 are in the errata of the paper's equations;
NOTATION.md lists them.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eulerparams_control.errors import SingularityError, UnknownNameError
from eulerparams_control.laws.rotations import Array, R_axis, cross
from eulerparams_control.laws.rotations_batch import exps

SEQUENCES = (
    *("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"),
    *("XYX", "XZX", "YXY", "YZY", "ZXZ", "ZYZ"),
)


def wrap(phi: Array) -> Array:
    """Return the angles phi (any shape) [rad] wrapped to (-pi, pi]."""
    wrapped = np.pi - (np.pi - phi) % (2 * np.pi)
    return np.where(wrapped <= -np.pi, np.pi, wrapped)  # rounding may reach -pi


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
    def axes(self) -> tuple[int, int, int]:
        """The axes i, j, k as 0, 1, 2."""
        i, j, k = ("XYZ".index(letter) for letter in self.name)
        return i, j, k

    @cached_property
    def is_proper(self) -> bool:
        """Whether the last axis is the first (ZYZ and its kin)."""
        return self.axes[0] == self.axes[2]

    @cached_property
    def _s_and_l(self) -> tuple[int, int]:
        """Sign s of the permutation (i, j, l) and the axis l that is neither i nor j."""
        i, j, _ = self.axes
        return (1 if (j - i) % 3 == 1 else -1), 3 - i - j

    def R(self, phi: Array) -> Array:
        """Return R(phi) (3, 3) of the angles phi (3,) [rad], eq. (2)."""
        i, j, k = self.axes
        alpha, beta, gamma = phi.tolist()
        return R_axis(i, alpha) @ R_axis(j, beta) @ R_axis(k, gamma)

    def T(self, phi: Array) -> Array:
        """Return T(phi) (3, 3) with omega = T dphi in the base frame, eq. (3)."""
        i, j, k = self.axes
        alpha, beta, _ = phi.tolist()
        R_i = R_axis(i, alpha)
        T = np.zeros((3, 3))
        T[i, 0] = 1.0  # t1 = a_i
        T[:, 1] = R_i[:, j]  # t2 = R_i(alpha) a_j
        T[:, 2] = R_i @ R_axis(j, beta)[:, k]  # t3 = R_i(alpha) R_j(beta) a_k
        return T

    def dT(self, phi: Array, dphi: Array) -> Array:
        """Return the derivative of T (3, 3) [1/s] along the rates dphi (3,) [rad/s]."""
        t1, t2, t3 = self.T(phi).T
        omega_2 = t1 * dphi[0]
        dT = np.zeros((3, 3))
        dT[:, 1] = cross(omega_2, t2)
        dT[:, 2] = cross(omega_2 + t2 * dphi[1], t3)
        return dT

    def rates(self, phi: Array, omega: Array) -> Array:
        """Return dphi = T(phi)^-1 omega (3,) [rad/s]; unbounded towards the pole.

        Raises:
            SingularityError: if T is exactly singular.
        """
        try:
            return np.linalg.solve(self.T(phi), omega)
        except np.linalg.LinAlgError:
            raise SingularityError(
                f"T(phi) of the Euler angles {self.name} is singular: at this orientation no "
                "rates of the angles give the desired angular velocity; choose another "
                "euler_sequence or orientation: euler_parameters"
            ) from None

    def extract(self, R: Array, previous: Array | None = None) -> Array:
        """Return phi (3,) [rad] with R(phi) = R.

        At the pole, where alpha and gamma are not unique, gamma is kept.  Next to it the
        angles are those of R as it is, however little its last bits may mean.

        Args:
            R: rotation matrix (3, 3).
            previous: the angles before, whose gamma is kept at the pole (else 0).
        """
        i, j, k = self.axes
        s, l = self._s_and_l
        alpha, beta, sine = self._alpha_beta(R.tolist())
        if sine > 0:
            v = math.cos(alpha) * R[j] + s * math.sin(alpha) * R[l]  # row j of R_i(alpha)' R
            y = -s * v[l] if self.is_proper else s * v[i]
            return np.array([alpha, beta, math.atan2(y, v[j])])
        gamma = 0.0 if previous is None else float(previous[2])
        R_i = R @ R_axis(k, gamma).T @ R_axis(j, beta).T
        y, z = (i + 1) % 3, (i + 2) % 3
        return np.array([math.atan2(R_i[z, y], R_i[y, y]), beta, gamma])

    def _alpha_beta(self, R: list[list[float]]) -> tuple[float, float, float]:
        """Return alpha, beta and the sine of the distance to the pole.

        Gamma does not come from its own entries: next to the pole these and those of
        alpha are rounding noise one by one, and R(phi) would not be R.
        """
        i, j, k = self.axes
        s, l = self._s_and_l
        if self.is_proper:
            sine = math.hypot(R[i][j], R[i][l])
            return math.atan2(R[j][i], -s * R[l][i]), math.atan2(sine, R[i][i]), sine
        sine = math.hypot(R[i][i], R[i][j])
        return math.atan2(-s * R[j][k], R[k][k]), math.atan2(s * R[i][k], sine), sine

    def Ts(self, phi: Array) -> Array:
        """Return T(phi) (N, 3, 3) of N angles phi (N, 3), eq. (3)."""
        i, j, k = self.axes
        R_i = exps(np.outer(phi[:, 0], np.eye(3)[i]))
        T = np.zeros((len(phi), 3, 3))
        T[:, i, 0] = 1.0
        T[:, :, 1] = R_i[:, :, j]
        T[:, :, 2] = (R_i @ exps(np.outer(phi[:, 1], np.eye(3)[j])))[:, :, k]
        return T

    def extracts(self, R: Array, previous: Array | None = None) -> Array:
        """Return phi (N, 3) [rad] of N successive rotation matrices: see :meth:`extract`."""
        i, j, _ = self.axes
        s, l = self._s_and_l
        alpha, beta, sine = self._alpha_betas(R)
        v = np.cos(alpha)[:, None] * R[:, j] + s * np.sin(alpha)[:, None] * R[:, l]
        y = -s * v[:, l] if self.is_proper else s * v[:, i]
        phi = np.stack([alpha, beta, np.arctan2(y, v[:, j])], axis=1)
        for index in np.flatnonzero(sine == 0).tolist():  # at the pole gamma is kept
            phi[index] = self.extract(R[index], phi[index - 1] if index else previous)
        return phi

    def _alpha_betas(self, R: Array) -> tuple[Array, Array, Array]:
        """Return alpha, beta and the sine of the distance to the pole, each (N,)."""
        i, j, k = self.axes
        s, l = self._s_and_l
        if self.is_proper:
            sine = np.hypot(R[:, i, j], R[:, i, l])
            beta = np.arctan2(sine, R[:, i, i])
            return np.arctan2(R[:, j, i], -s * R[:, l, i]), beta, sine
        sine = np.hypot(R[:, i, i], R[:, i, j])
        return np.arctan2(-s * R[:, j, k], R[:, k, k]), np.arctan2(s * R[:, i, k], sine), sine

    def pole_distances(self, R: Array) -> Array:
        """Return the angle (N,) [rad] from R (N, 3, 3) to the nearest singularity of T."""
        distances: Array = np.arcsin(np.minimum(1.0, self._alpha_betas(R)[2]))
        return distances

    def pole_distance(self, R: Array) -> float:
        """Return the angle [rad] in [0, pi/2] from R (3, 3) to the nearest singularity of T."""
        return math.asin(min(1.0, self._alpha_beta(R.tolist())[2]))
