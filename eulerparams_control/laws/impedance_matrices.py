"""Mass, damping and stiffness of eqs. (52), (55), (59): three symmetric matrices (3, 3).

``M`` [kg or kg m^2], ``D`` [Ns/m or Nms/rad] and ``K`` [N/m or Nm/rad].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.jit import Array

type Numbers = Sequence[float]

_ROUNDING = 1e-9  # of an element that is zero, or has a symmetric one, over the largest element
_AXES_TOLERANCE = 1e-3  # of three axes printed with 4 digits
# No mass [kg], inertia [kg m^2] is smaller: its inverse would overflow.
_LEAST_MASS = 1e-100

_ROWS, _COLUMNS = np.triu_indices(3)  # xx, xy, xz, yy, yz, zz


class Matrices(NamedTuple):
    """An impedance as its motion needs it: ddx = M^-1 (force - D dx - K x)."""

    M_inverse: Array
    D: Array
    K: Array


@dataclass(frozen=True)
class Impedance:
    """M ddx + D dx + K x = force: one of the two equations of the impedance.

    Raises:
        ConfigurationError: unless M is symmetric and positive definite, D and K symmetric and
            positive semidefinite; K of 0 along an axis guides by hand.
    """

    M: Array
    D: Array
    K: Array

    def __post_init__(self) -> None:
        for name in ("M", "D", "K"):
            _check(name, getattr(self, name))
        if not self.least_mass > _LEAST_MASS:
            raise ConfigurationError(f"M is not positive definite: {self.M.tolist()}")

    @cached_property
    def values(self) -> Matrices:
        """M^-1, D, K."""
        return Matrices(np.linalg.inv(self.M), self.D, self.K)

    @cached_property
    def K_half(self) -> Array:
        """K^1/2."""
        return square_root(self.K)

    @cached_property
    def rate(self) -> float:
        """The largest magnitude [1/s] of the eigenvalues of its linear motion."""
        M_inverse, D, K = self.values
        companion = np.block([[np.zeros((3, 3)), np.eye(3)], [-M_inverse @ K, -M_inverse @ D]])
        return float(np.abs(np.linalg.eigvals(companion)).max())

    @property
    def least_mass(self) -> float:
        """The least eigenvalue of M."""
        return float(np.linalg.eigvalsh(self.M)[0])

    @property
    def greatest_mass(self) -> float:
        """The largest eigenvalue of M."""
        return float(np.linalg.eigvalsh(self.M)[-1])

    @property
    def least_damping(self) -> float:
        """The least eigenvalue [1/s] of M^-1 D."""
        return float(np.linalg.eigvals(self.values.M_inverse @ self.D).real.min())

    def transformed(self, T: Array) -> "Impedance":
        """Return the impedance in coordinates y of x = T y: T' M T, T' D T, T' K T."""
        return Impedance(T.T @ self.M @ T, T.T @ self.D @ T, T.T @ self.K @ T)


def symmetric_matrix(name: str, values: Numbers, axes: Numbers = ()) -> Array:
    """Return a symmetric matrix (3, 3): U diag(values) U', U = [u_1 u_2 u_3], eqs. (53), (63).

    The values are 3, along the axes, or xx, xy, xz, yy, yz, zz; the axes u_1, u_2, u_3 in a row,
    or () for x, y, z.  Raises ConfigurationError, with the name, for others.
    """
    if len(values) == 6 and not axes:
        matrix = np.zeros((3, 3))
        matrix[_ROWS, _COLUMNS] = matrix[_COLUMNS, _ROWS] = values
        return matrix
    if len(values) != 3:
        raise ConfigurationError(
            f"{name} has {len(values)} values; expected 3, of the diagonal or along its axes, or "
            "6: xx, xy, xz, yy, yz, zz, without axes"
        )
    if not axes:
        return np.diag(np.array(values, dtype=float))
    U = _orthonormal(name, axes)
    return U @ np.diag(values) @ U.T


def damping_of_ratio(M: Array, K: Array, ratio: float) -> Array:
    """Return D = 2 ratio M^1/2 (M^-1/2 K M^-1/2)^1/2 M^1/2: each mode has this damping ratio."""
    M_half = square_root(M)
    M_half_inverse = np.linalg.inv(M_half)
    D: Array = 2 * ratio * M_half @ square_root(M_half_inverse @ K @ M_half_inverse) @ M_half
    return (D + D.T) / 2


def square_root(A: Array) -> Array:
    """Return the root A^1/2 of a symmetric positive semidefinite A (3, 3)."""
    values, vectors = np.linalg.eigh(A)
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return (root + root.T) / 2.0  # symmetric to the bit


def _orthonormal(name: str, axes: Numbers) -> Array:
    """Return U = [u_1 u_2 u_3] of nine numbers, made exactly orthonormal."""
    if len(axes) != 9:
        raise ConfigurationError(
            f"{name}_axes has {len(axes)} values; expected 9: three unit vectors in a row"
        )
    U: Array = np.array(axes, dtype=float).reshape(3, 3).T
    if not np.abs(U.T @ U - np.eye(3)).max() <= _AXES_TOLERANCE:
        raise ConfigurationError(
            f"{name}_axes are {U.T.tolist()}; expected three unit vectors, orthogonal to each other"
        )
    left, _, right = np.linalg.svd(U)
    return left @ right


def _check(name: str, matrix: Array) -> None:
    """Raise ConfigurationError unless a matrix is finite, symmetric and not negative."""
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ConfigurationError(f"{name} is {matrix.tolist()}; expected 3 x 3 finite numbers")
    tolerance = _ROUNDING * float(np.abs(matrix).max())
    if np.abs(matrix - matrix.T).max() > tolerance:
        raise ConfigurationError(f"{name} is not symmetric: {matrix.tolist()}")
    least = float(np.linalg.eigvalsh(matrix)[0])
    if not least >= -tolerance:
        raise ConfigurationError(
            f"{name} has the negative eigenvalue {least:.3g}: {matrix.tolist()}"
        )
