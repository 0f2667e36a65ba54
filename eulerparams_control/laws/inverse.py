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
from eulerparams_control.laws._old.compiled import Array, Inputs, Row, Rows, entry, kernel

# Two vectors are orthogonal if their cosine is below this; turning all pairs of six so takes
# five to ten rounds.
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
        J_inverse = np.empty((J.shape[1], 6))
        invert(J, self.eps, self.lambda_max, self.length, J_inverse)
        return J_inverse


def smallest_singular_value(J: Array, length: float = 1.0) -> float:
    """Return sigma_min of J (6, n): the distance to the nearest kinematic singularity.

    Args:
        J: Jacobian, position first.
        length: by which the rows of the position are divided [m].
    """
    return sigma_min(J, length)


@kernel
def _unit(row: int, length: float) -> float:
    """Return the unit of a row of J."""
    return length if row < 3 else 1.0


@kernel
def _orthogonal(J: Inputs, length: float, A: Rows) -> float:
    """Turn the rows of J (6, n), without units, among each other until they are orthogonal.

    The columns for n < 6.  By Jacobi's rotations of pairs (Hestenes, 1958), which keep small
    singular values exact.  A (m, size) begins with them, m = min(6, n), and may have m columns
    more, from which then follows what they are of the rows of J: A = [W, Q], J = Q' W.  Return
    sigma_min, the length of the shortest.
    """
    m, n = len(A), J.shape[1]
    size = max(6, n)
    for row in range(6):
        for column in range(n):
            value = J[row, column] / _unit(row, length)
            if n < 6:
                A[column, row] = value
            else:
                A[row, column] = value
    for i in range(m):
        for j in range(size, A.shape[1]):
            A[i, j] = 1.0 if j == size + i else 0.0
    for _ in range(_ROUNDS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                a, b, c = 0.0, 0.0, 0.0
                for k in range(size):
                    a += A[i, k] * A[i, k]
                    b += A[j, k] * A[j, k]
                    c += A[i, k] * A[j, k]
                if abs(c) > _ORTHOGONAL * math.sqrt(a) * math.sqrt(b):
                    turned = True
                    slope = (b - a) / (2.0 * c)
                    t = math.copysign(1.0, slope) / (abs(slope) + math.sqrt(1.0 + slope * slope))
                    cosine = 1.0 / math.sqrt(1.0 + t * t)
                    for k in range(A.shape[1]):
                        x, y = A[i, k], A[j, k]
                        A[i, k], A[j, k] = cosine * (x - t * y), cosine * (t * x + y)
        if not turned:
            break
    least = _square(A, 0, size)
    for i in range(1, m):
        least = min(least, _square(A, i, size))
    return math.sqrt(least)


@kernel
def _square(A: Rows, i: int, size: int) -> float:
    """Return the square of the length of row i."""
    square = 0.0
    for k in range(size):
        square += A[i, k] * A[i, k]
    return square


@entry
def sigma_min(J: Inputs, length: float) -> float:
    """Return the smallest singular value of J (6, n)."""
    n = J.shape[1]
    return _orthogonal(J, length, np.empty((min(6, n), max(6, n))))


@kernel
def resolve(inverse: Rows, J: Inputs, v: Row, x_0: Row, x: Row) -> None:
    """Fill x (n,) with x_0 + J* (v - J x_0): what moves the tip by v (6,), the rest as x_0 (n,)."""
    n = len(x)
    left = np.empty(6)
    for i in range(6):
        left[i] = v[i]
        for k in range(n):
            left[i] -= J[i, k] * x_0[k]
    for k in range(n):
        x[k] = x_0[k]
        for i in range(6):
            x[k] += inverse[k, i] * left[i]


@kernel
def solve_rows(A: Rows) -> bool:
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


@kernel
def symmetric_modes(S: Rows, Y: Rows) -> None:
    """Turn S (m, m), symmetric, into its eigenvalues, and fill Y with its eigenvectors as columns.

    By Jacobi's rotations.
    """
    m, size = len(S), 0.0
    for i in range(m):
        for j in range(m):
            size += S[i, j] * S[i, j]
            Y[i, j] = 1.0 if i == j else 0.0
    for _ in range(_ROUNDS):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                if S[i, j] * S[i, j] > _ORTHOGONAL * _ORTHOGONAL * size:
                    turned = True
                    slope = (S[j, j] - S[i, i]) / (2.0 * S[i, j])
                    t = math.copysign(1.0, slope) / (abs(slope) + math.sqrt(1.0 + slope * slope))
                    cosine = 1.0 / math.sqrt(1.0 + t * t)
                    for k in range(m):
                        x, y = S[k, i], S[k, j]
                        S[k, i], S[k, j] = cosine * (x - t * y), cosine * (t * x + y)
                        x, y = Y[k, i], Y[k, j]
                        Y[k, i], Y[k, j] = cosine * (x - t * y), cosine * (t * x + y)
                    for k in range(m):
                        x, y = S[i, k], S[j, k]
                        S[i, k], S[j, k] = cosine * (x - t * y), cosine * (t * x + y)
        if not turned:
            break


@kernel
def _invert_regular(J: Inputs, X: Rows) -> bool:
    """Fill X (n, 6) with J^-1, or J' (J J')^-1 for n > 6; return whether there is one."""
    n = J.shape[1]
    if n < 6:
        return False
    A = np.zeros((6, 6 + n))  # of what is solved for the transpose
    for i in range(6):
        for j in range(6):
            if n == 6:
                A[i, j], A[i, 6 + j] = J[j, i], 1.0 if i == j else 0.0
            else:
                for k in range(n):
                    A[i, j] += J[i, k] * J[j, k]
        if n > 6:
            for k in range(n):
                A[i, 6 + k] = J[i, k]
    is_regular = solve_rows(A)
    for i in range(6):
        for k in range(n):
            X[k, i] = A[i, 6 + k]
    return is_regular


@entry
def invert(J: Inputs, eps: float, lambda_max: float, length: float, X: Rows) -> None:
    """Fill X (n, 6) with J* of J (6, n); see :class:`DampedInverse`."""
    n = J.shape[1]
    if _invert_regular(J, X):
        # 1 / |J^-1|_F is a lower bound of sigma_min: where it suffices, sigma_min is not needed
        bound = 0.0
        for i in range(n):
            for j in range(6):
                part = X[i, j] * _unit(j, length)
                bound += part * part
        if eps * math.sqrt(bound) < 1.0:
            return
    m, size = min(6, n), max(6, n)
    A = np.empty((m, size + m))
    sigma = _orthogonal(J, length, A)
    ratio = sigma / eps if eps > 0.0 else 1.0
    lambda_2 = (1.0 - ratio * ratio) * lambda_max * lambda_max if ratio < 1.0 else 0.0
    for i in range(n):
        for j in range(6):
            X[i, j] = 0.0
    for k in range(m):  # J* is the sum of w_k q_k' / (sigma_k^2 + lambda^2)
        square = _square(A, k, size) + lambda_2
        if square != 0.0:  # else this direction is lost, and not damped
            for i in range(n):
                for j in range(6):
                    w, q = (A[k, i], A[k, size + j]) if n >= 6 else (A[k, j], A[k, size + i])
                    X[i, j] += w * q / square / _unit(j, length)
