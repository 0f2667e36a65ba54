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
from eulerparams_control.laws.jit import Array, b1, f8, i8, jit, matrix, new_matrix, vector, void

# Two vectors are orthogonal if their cosine is below this; all pairs of six are so after five to
# ten rounds.
_ORTHOGONAL = 1e-15
_ROUNDS = 40


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


@jit(b1(new_matrix, new_matrix, i8, i8))
def _turn(W: Array, Q: Array, i: int, j: int) -> bool:
    """Make the rows i and j of W orthogonal by a rotation in their plane, if they are not."""
    a, b, c = _product(W[i], W[i]), _product(W[j], W[j]), _product(W[i], W[j])
    if not abs(c) > _ORTHOGONAL * math.sqrt(a) * math.sqrt(b):
        return False
    slope = (b - a) / (2.0 * c)
    t = math.copysign(1.0, slope) / (abs(slope) + math.sqrt(1.0 + slope * slope))
    cosine = 1.0 / math.sqrt(1.0 + t * t)
    for X in (W, Q):
        for k in range(X.shape[1]):
            x, y = X[i, k], X[j, k]
            X[i, k], X[j, k] = cosine * (x - t * y), cosine * (t * x + y)
    return True


@jit(f8(new_matrix, new_matrix))
def _orthogonalize(W: Array, Q: Array) -> float:
    """Turn the rows of W among each other until they are orthogonal; return the least length.

    By Jacobi's rotations of pairs (Hestenes, 1958), which keep small singular values exact.  The
    rows of Q turn with those of W, so that Q' W stays what it was.
    """
    m = len(W)
    for _ in range(_ROUNDS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                turned = _turn(W, Q, i, j) or turned
        if not turned:
            break
    return math.sqrt(np.min(np.sum(W * W, axis=1)))


@jit(new_matrix(matrix, f8))
def _without_units(J: Array, length: float) -> Array:
    """Return J (6, n), its rows for the position divided by ``length``; its transpose for n < 6."""
    W = np.empty(J.shape)
    W[:3], W[3:] = J[:3] / length, J[3:]
    return W if J.shape[1] >= 6 else np.ascontiguousarray(W.T)


@jit(f8(matrix, f8))
def sigma_min(J: Array, length: float) -> float:
    """Return the smallest singular value of J (6, n): the distance to the nearest singularity.

    The rows of J for the position are divided by ``length`` [m].
    """
    W = _without_units(J, length)
    return _orthogonalize(W, np.empty((len(W), 0)))


@jit(void(new_matrix, new_matrix))
def symmetric_modes(S: Array, Y: Array) -> None:
    """Turn S (m, m), symmetric and not negative, into its eigenvalues, Y into its eigenvectors."""
    Q = np.eye(len(S))
    _orthogonalize(S, Q)
    for i in range(len(S)):
        value, Y[:, i] = math.sqrt(_product(S[i], S[i])), Q[i]
        S[i] = 0.0
        S[i, i] = value


@jit(b1(new_matrix))
def _solve_rows(A: Array) -> bool:
    """Turn A = [B, C] into [I, B^-1 C] by Gauss and Jordan; return whether there is a B^-1."""
    m, width = A.shape
    for k in range(m):
        pivot = k + np.argmax(np.abs(A[k:, k]))
        if A[pivot, k] == 0.0:
            return False
        for j in range(k, width):
            A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        A[k] /= A[k, k]
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
        bound = length * length * np.sum(X[:, :3] * X[:, :3]) + np.sum(X[:, 3:] * X[:, 3:])
        if eps * math.sqrt(bound) < 1.0:
            return X
    W = _without_units(J, length)
    Q = np.eye(len(W))
    sigma = _orthogonalize(W, Q)
    ratio = sigma / eps if eps > 0.0 else 1.0
    lambda_2 = (1.0 - ratio * ratio) * lambda_max * lambda_max if ratio < 1.0 else 0.0
    X[:] = 0.0
    for k in range(len(W)):  # J* is the sum of w q' / (sigma_k^2 + lambda^2)
        w, q = (W[k], Q[k]) if n >= 6 else (Q[k], W[k])
        square = _product(W[k], W[k]) + lambda_2
        if square != 0.0:  # else this direction is lost, and not damped
            for i in range(n):
                X[i] += w[i] / square * q
    X[:, :3] /= length
    return X
