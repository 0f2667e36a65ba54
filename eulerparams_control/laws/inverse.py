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
from eulerparams_control.laws.jit import Array, b1, f8, jit, matrix, new_matrix, types, vector

# Two vectors are orthogonal if their cosine is below this; turning all pairs of six so takes
# five to ten rounds.
_ORTHOGONAL = 1e-15
_ROUNDS = 40

_turned = types.Array(f8, 1, "A")


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


@jit(types.UniTuple(f8, 2)(f8, f8, f8))
def _jacobi(a: float, b: float, c: float) -> tuple[float, float]:
    """Return cosine and tangent of the rotation that makes [[a, c], [c, b]] diagonal."""
    slope = (b - a) / (2.0 * c)
    t = math.copysign(1.0, slope) / (abs(slope) + math.sqrt(1.0 + slope * slope))
    return 1.0 / math.sqrt(1.0 + t * t), t


@jit(types.void(_turned, _turned, f8, f8))
def _turn(x: Array, y: Array, cosine: float, t: float) -> None:
    """Turn two vectors in their plane."""
    for k in range(len(x)):
        x_k, y_k = x[k], y[k]
        x[k], y[k] = cosine * (x_k - t * y_k), cosine * (t * x_k + y_k)


@jit(f8(vector, vector))
def _product(x: Array, y: Array) -> float:
    total = 0.0
    for k in range(len(x)):
        total += x[k] * y[k]
    return total


@jit(f8(matrix, f8, new_matrix))
def _orthogonal(J: Array, length: float, A: Array) -> float:
    """Turn the rows of J (6, n), without units, among each other until they are orthogonal.

    The columns for n < 6.  By Jacobi's rotations of pairs (Hestenes, 1958), which keep small
    singular values exact.  A (m, size) begins with them, m = min(6, n), and may have m columns
    more, from which then follows what they are of the rows of J: A = [W, Q], J = Q' W.  Return
    sigma_min, the length of the shortest.
    """
    m, size = len(A), max(6, J.shape[1])
    for i in range(6):
        for k in range(J.shape[1]):
            row, column = (i, k) if m == 6 else (k, i)
            A[row, column] = J[i, k] / (length if i < 3 else 1.0)
    A[:, size:] = np.eye(m)[:, : A.shape[1] - size]
    for _ in range(_ROUNDS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                x, y = A[i, :size], A[j, :size]
                a, b, c = _product(x, x), _product(y, y), _product(x, y)
                if abs(c) > _ORTHOGONAL * math.sqrt(a) * math.sqrt(b):
                    turned = True
                    cosine, t = _jacobi(a, b, c)
                    _turn(A[i], A[j], cosine, t)
        if not turned:
            break
    least = _product(A[0, :size], A[0, :size])
    for i in range(1, m):
        least = min(least, _product(A[i, :size], A[i, :size]))
    return math.sqrt(least)


@jit(f8(matrix, f8))
def sigma_min(J: Array, length: float) -> float:
    """Return the smallest singular value of J (6, n): the distance to the nearest singularity.

    The rows of J for the position are divided by ``length`` [m].
    """
    return _orthogonal(J, length, np.empty((min(6, J.shape[1]), max(6, J.shape[1]))))


@jit(b1(new_matrix))
def _solve_rows(A: Array) -> bool:
    """Turn A = [B, C] into [I, B^-1 C] by Gauss and Jordan; return whether there is a B^-1."""
    m, width = A.shape
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if A[pivot, k] == 0.0:
            return False
        for j in range(k, width):
            A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        factor = 1.0 / A[k, k]
        for j in range(k, width):
            A[k, j] *= factor
        for i in range(m):
            if i != k:
                factor = A[i, k]
                for j in range(k, width):
                    A[i, j] -= factor * A[k, j]
    return True


@jit(types.void(new_matrix, new_matrix))
def symmetric_modes(S: Array, Y: Array) -> None:
    """Turn S (m, m), symmetric, into its eigenvalues, and fill Y with its eigenvectors as columns.

    By Jacobi's rotations.
    """
    m, size = len(S), 0.0
    for i in range(m):
        size += _product(S[i], S[i])
    Y[:] = np.eye(m)
    for _ in range(_ROUNDS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                if S[i, j] * S[i, j] > _ORTHOGONAL * _ORTHOGONAL * size:
                    turned = True
                    cosine, t = _jacobi(S[i, i], S[j, j], S[i, j])
                    _turn(S[:, i], S[:, j], cosine, t)
                    _turn(Y[:, i], Y[:, j], cosine, t)
                    _turn(S[i], S[j], cosine, t)
        if not turned:
            break


@jit(b1(matrix, new_matrix))
def _invert_regular(J: Array, X: Array) -> bool:
    """Fill X (n, 6) with J^-1, or J' (J J')^-1 for n > 6; return whether there is one."""
    n = J.shape[1]
    if n < 6:
        return False
    A = np.empty((6, 6 + n))  # of what is solved for the transpose
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
    n, unit = J.shape[1], np.ones(6)
    X, unit[:3] = np.empty((n, 6)), length
    if _invert_regular(J, X):
        # 1 / |J^-1|_F is a lower bound of sigma_min: where it suffices, sigma_min is not needed
        bound = 0.0
        for i in range(n):
            for j in range(6):
                part = X[i, j] * unit[j]
                bound += part * part
        if eps * math.sqrt(bound) < 1.0:
            return X
    m, size = min(6, n), max(6, n)
    A = np.empty((m, size + m))
    sigma = _orthogonal(J, length, A)
    ratio = sigma / eps if eps > 0.0 else 1.0
    lambda_2 = (1.0 - ratio * ratio) * lambda_max * lambda_max if ratio < 1.0 else 0.0
    X[:] = 0.0
    for k in range(m):  # J* is the sum of w_k q_k' / (sigma_k^2 + lambda^2)
        W, Q = A[k, :size], A[k, size:]
        w, q = (W, Q) if n >= 6 else (Q, W)
        square = _product(W, W) + lambda_2
        if square != 0.0:  # else this direction is lost, and not damped
            for i in range(n):
                for j in range(6):
                    X[i, j] += w[i] * q[j] / square / unit[j]
    return X
