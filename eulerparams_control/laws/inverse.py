"""The inverse of the Jacobian: exact, damped near kinematic singularities, redundant.

J* = J' (J J' + lambda^2 I)^-1 with lambda^2 = (1 - (sigma_min / eps)^2) lambda_max^2
where the smallest singular value sigma_min of J is below eps, else 0.

For eps, J and lambda have no units: the rows of J for the position [m] are divided by a
characteristic length of the arm.  So an arm of half the size is damped at the same q.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.jit import (
    Array,
    b1,
    f8,
    i8,
    jit,
    matrix,
    new_matrix,
    types,
    vector,
    void,
)

# Two vectors are orthogonal if their cosine is below this; all pairs of six are so after five to
# ten rounds.
_ORTHOGONAL = 1e-15
_ROUNDS = 40

_strided = types.Array(f8, 1, "A")


@dataclass(frozen=True)
class DampedInverse:
    """Inverse of J (6, n) that stays bounded at kinematic singularities.

    Args:
        eps: singular value below which damping sets in; 0 never damps.
        lambda_max: damping at the singularity.
        length: characteristic length [m] of the arm.

    Raises:
        ConfigurationError: if one is negative or not finite.
    """

    eps: float = 0.05
    lambda_max: float = 0.05
    length: float = field(default=1.0, compare=False)

    def __post_init__(self) -> None:
        if not (0 <= self.eps < math.inf and 0 <= self.lambda_max < math.inf):
            raise ConfigurationError(
                f"damping eps {self.eps}, lambda_max {self.lambda_max}: expected >= 0"
            )

    def __call__(self, J: Array) -> Array:
        """Return J* (n, 6): J^-1 for a regular square J, the pseudo-inverse for n > 6."""
        return damped_inverse(J, self.eps, self.lambda_max, self.length)


@jit(f8(vector, vector))
def _product(x: Array, y: Array) -> float:
    total = 0.0
    for k in range(len(x)):
        total += x[k] * y[k]
    return total


@jit(void(_strided, _strided, f8, f8))
def _turn(x: Array, y: Array, cosine: float, t: float) -> None:
    """Turn two vectors in their plane."""
    for k in range(len(x)):
        x_k, y_k = x[k], y[k]
        x[k], y[k] = cosine * (x_k - t * y_k), cosine * (t * x_k + y_k)


@jit(f8(new_matrix, i8))
def _orthogonalize(A: Array, size: int) -> float:
    """Turn the rows of A = [W, Q] among each other until those of W (m, size) are orthogonal.

    By Jacobi's rotations of pairs (Hestenes, 1958), which keep small singular values exact.  For
    Q (m, m) Q' W stays what it was.  Return the length of the shortest row of W.
    """
    m = len(A)
    for _ in range(_ROUNDS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                x, y = A[i, :size], A[j, :size]
                a, b, c = _product(x, x), _product(y, y), _product(x, y)
                if abs(c) > _ORTHOGONAL * math.sqrt(a) * math.sqrt(b):
                    turned = True
                    slope = (b - a) / (2.0 * c)
                    t = math.copysign(1.0, slope) / (abs(slope) + math.sqrt(1.0 + slope * slope))
                    _turn(A[i], A[j], 1.0 / math.sqrt(1.0 + t * t), t)
        if not turned:
            break
    least = _product(A[0, :size], A[0, :size])
    for i in range(1, m):
        least = min(least, _product(A[i, :size], A[i, :size]))
    return math.sqrt(least)


@jit(void(matrix, f8, new_matrix))
def _without_units(J: Array, length: float, A: Array) -> None:
    """Begin A with J (6, n), its rows for the position over length; with J' for n < 6."""
    for i in range(6):
        for k in range(J.shape[1]):
            row, column = (i, k) if len(A) == 6 else (k, i)
            A[row, column] = J[i, k] / (length if i < 3 else 1.0)


@jit(f8(matrix, f8))
def sigma_min(J: Array, length: float) -> float:
    """Return the smallest singular value of J (6, n): the distance to the nearest singularity.

    The rows of J for the position are divided by ``length`` [m].
    """
    W = np.empty((min(6, J.shape[1]), max(6, J.shape[1])))
    _without_units(J, length, W)
    return _orthogonalize(W, W.shape[1])


@jit(void(new_matrix, new_matrix))
def symmetric_modes(S: Array, Y: Array) -> None:
    """Turn S (m, m), symmetric and not negative, into its eigenvalues, Y into its eigenvectors."""
    m = len(S)
    A = np.zeros((m, 2 * m))
    A[:, :m], A[:, m:] = S, np.eye(m)
    _orthogonalize(A, m)
    S[:] = 0.0
    for i in range(m):
        S[i, i], Y[:, i] = math.sqrt(_product(A[i, :m], A[i, :m])), A[i, m:]


@jit(b1(new_matrix))
def _solve_rows(A: Array) -> bool:
    """Turn A = [B, C] into [I, B^-1 C] by Gauss and Jordan; return whether there is a B^-1."""
    m, width = A.shape
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            pivot = i if abs(A[i, k]) > abs(A[pivot, k]) else pivot
        if A[pivot, k] == 0.0:
            return False
        for j in range(k, width):
            A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        factor = 1.0 / A[k, k]
        for j in range(k, width):
            A[k, j] *= factor
        for i in range(m):
            factor = A[i, k] if i != k else 0.0
            for j in range(k, width):
                A[i, j] -= factor * A[k, j]
    return True


@jit(b1(matrix, new_matrix))
def _invert_regular(J: Array, X: Array) -> bool:
    """Fill X (n, 6) with J^-1, or J' (J J')^-1 for n > 6; return whether there is one."""
    n = J.shape[1]
    if n < 6:
        return False
    A = np.empty((6, 6 + n))  # [J', I] or [J J', J], which is solved for the transpose
    if n == 6:
        A[:, :6], A[:, 6:] = J.T, np.eye(6)
    else:
        A[:, 6:] = J
        for i in range(6):
            for j in range(6):
                A[i, j] = _product(J[i], J[j])
    is_regular = _solve_rows(A)
    X[:] = A[:, 6:].T
    return is_regular


@jit(new_matrix(matrix, f8, f8, f8))
def damped_inverse(J: Array, eps: float, lambda_max: float, length: float) -> Array:
    """Return J* (n, 6) of J (6, n); see :class:`DampedInverse`."""
    n = J.shape[1]
    X = np.zeros((n, 6))
    if _invert_regular(J, X):
        # 1 / |J^-1|_F is a lower bound of sigma_min: where it suffices, sigma_min is not needed
        bound = 0.0
        for x in X:
            bound += length * length * _product(x[:3], x[:3]) + _product(x[3:], x[3:])
        if eps * math.sqrt(bound) < 1.0:
            return X
    m, size = min(6, n), max(6, n)
    A = np.empty((m, size + m))
    _without_units(J, length, A)
    A[:, size:] = np.eye(m)
    sigma = _orthogonalize(A, size)
    ratio = sigma / eps if eps > 0.0 else 1.0
    lambda_2 = (1.0 - ratio * ratio) * lambda_max * lambda_max if ratio < 1.0 else 0.0
    X[:] = 0.0
    for k in range(m):  # J* is the sum of w q' / (sigma_k^2 + lambda^2)
        W, Q = A[k, :size], A[k, size:]
        w, q = (W, Q) if n >= 6 else (Q, W)
        square = _product(W, W) + lambda_2
        if square != 0.0:  # else this direction is lost, and not damped
            for i in range(n):
                for j in range(6):
                    X[i, j] += w[i] * q[j] / square / (length if j < 3 else 1.0)
    return X


@jit(new_matrix(matrix, matrix))
def matrix_product(A: Array, B: Array) -> Array:
    """Return A B of matrices of any size."""
    C = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            for k in range(A.shape[1]):
                C[i, j] += A[i, k] * B[k, j]
    return C


@jit(new_matrix(matrix, matrix))
def solved(A: Array, B: Array) -> Array:
    """Return A^-1 B of A (n, n) and B (n, m); NaN where A is singular."""
    n = len(A)
    rows = np.empty((n, n + B.shape[1]))
    rows[:, :n], rows[:, n:] = A, B
    if not _solve_rows(rows):
        rows[:] = np.nan
    return rows[:, n:].copy()
