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
from eulerparams_control.laws.jit import Array, f8, i8, jit, matrix, new_matrix, vector, void

# Two vectors are orthogonal if their cosine is below this; all pairs of six are so after five to
# ten rounds.
_ORTHOGONAL = 1e-15
_ROUNDS = 40


@dataclass(frozen=True)
class DampedInverse:
    """Inverse of J (6, n) that stays bounded at kinematic singularities."""

    eps: float = 0.05  # singular value below which damping sets in; 0 never damps
    lambda_max: float = 0.05  # damping at the singularity
    length: float = field(default=1.0, compare=False)  # [m] characteristic length of the arm

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
                    cosine = 1.0 / math.sqrt(1.0 + t * t)
                    for k in range(A.shape[1]):
                        x_k, y_k = A[i, k], A[j, k]
                        A[i, k], A[j, k] = cosine * (x_k - t * y_k), cosine * (t * x_k + y_k)
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
    """Return the smallest singular value of J (6, n), position rows over ``length`` [m]."""
    W = np.empty((min(6, J.shape[1]), max(6, J.shape[1])))
    _without_units(J, length, W)
    return _orthogonalize(W, W.shape[1])


@jit(void(new_matrix, new_matrix))
def symmetric_modes(S: Array, Y: Array) -> None:
    """Turn a positive semidefinite S (m, m) into its eigenvalues, Y into its eigenvectors."""
    m = len(S)
    A = np.zeros((m, 2 * m))
    A[:, :m], A[:, m:] = S, np.eye(m)
    _orthogonalize(A, m)
    S[:] = 0.0
    for i in range(m):
        S[i, i], Y[:, i] = math.sqrt(_product(A[i, :m], A[i, :m])), A[i, m:]


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
    """Return A^-1 B of A (n, n) and B (n, m), by Gauss and Jordan; NaN where A is singular."""
    n, width = len(A), len(A) + B.shape[1]
    rows = np.empty((n, width))  # [A, B], which becomes [I, A^-1 B]
    rows[:, :n], rows[:, n:] = A, B
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            pivot = i if abs(rows[i, k]) > abs(rows[pivot, k]) else pivot
        if rows[pivot, k] == 0.0:
            return np.full((n, B.shape[1]), np.nan)
        for j in range(k, width):
            rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
        factor = 1.0 / rows[k, k]
        for j in range(k, width):
            rows[k, j] *= factor
        for i in range(n):
            factor = rows[i, k] if i != k else 0.0
            for j in range(k, width):
                rows[i, j] -= factor * rows[k, j]
    return rows[:, n:].copy()


@jit(new_matrix(matrix))
def _undamped_inverse(J: Array) -> Array:
    if J.shape[1] == 6:
        return solved(J, np.eye(6))
    return solved(matrix_product(J, J.T), J).T.copy()  # J' (J J')^-1


@jit(new_matrix(matrix, f8, f8, f8))
def damped_inverse(J: Array, eps: float, lambda_max: float, length: float) -> Array:
    """Return J* (n, 6) of J (6, n); see :class:`DampedInverse`."""
    n = J.shape[1]
    if n >= 6:
        X = _undamped_inverse(J)
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
    X = np.zeros((n, 6))
    for k in range(m):  # J* is the sum of w q' / (sigma_k^2 + lambda^2)
        W, Q = A[k, :size], A[k, size:]
        w, q = (W, Q) if n >= 6 else (Q, W)
        square = _product(W, W) + lambda_2
        if square != 0.0:  # else this direction is lost, and not damped
            for i in range(n):
                for j in range(6):
                    X[i, j] += w[i] * q[j] / square / (length if j < 3 else 1.0)
    return X
