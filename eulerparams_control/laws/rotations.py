"""Rotations of section II: matrices, Euler parameters, angle and axis.

Notation: ``R`` (3, 3) rotation matrix, ``Q`` Euler parameters {eta, eps} with the scalar first,
``theta`` rotation angle [rad], ``r`` (3,) unit axis, ``x`` = theta r (3,) rotation vector [rad],
``omega`` (3,) angular velocity [rad/s].  Vectors are in the base frame unless a suffix says else.
"""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.jit import (
    Array,
    f8,
    jit,
    matrix,
    new_matrix,
    new_vector,
    types,
    vector,
)

__all__ = ["Array"]  # from jit; what is defined here besides

_quaternion = types.Tuple((f8, new_vector))

# Below this angle sin(x)/x and its kin are taken from their Taylor series, whose first
# omitted term is then below 1e-16.
SMALL_ANGLE = 1e-4

# The coefficients of the right Jacobian lose 1e-16 / theta^4 by cancellation; below this
# angle four terms of their series are exact to 1e-13.
SMALL_JACOBIAN_ANGLE = 0.1


class EulerParameters(NamedTuple):
    """The unit quaternion of eq. (5), eta = cos(theta / 2) and eps = sin(theta / 2) r (3,)."""

    eta: float
    eps: Array

    @classmethod
    def from_angle_axis(cls, theta: float, r: Array) -> "EulerParameters":
        """Return {cos(theta/2), sin(theta/2) r}, eq. (5)."""
        return cls(math.cos(theta / 2), math.sin(theta / 2) * r)

    @property
    def R(self) -> Array:
        """The rotation matrix (3, 3), eq. (7)."""
        return R_quaternion(self.eta, self.eps)

    @property
    def E(self) -> Array:
        """E(eta, eps) = eta I - S(eps) (3, 3), eq. (10)."""
        return self.eta * np.eye(3) - S(self.eps)

    def __neg__(self) -> "EulerParameters":
        """Return -(eta, eps), the same rotation."""
        return EulerParameters(-self.eta, -self.eps)


def quaternion(R: Array) -> EulerParameters:
    """Return {eta, eps} of R (3, 3) with eta >= 0."""
    return EulerParameters(*shepperd(R))


def mutual_R(R_1: Array, R_2: Array) -> EulerParameters:
    """Return {eta_21, eps_21} of R_1' R_2, eq. (11), with eta_21 >= 0.

    Two quaternions extracted apart can be of opposite sign: a turn of almost 360 deg.
    """
    return EulerParameters(*_mutual_R(R_1, R_2))


def mutual(Q_1: EulerParameters, Q_2: EulerParameters) -> EulerParameters:
    """Return {eta_21, eps_21} in frame 1, of frame 2 relative to frame 1, eqs. (12), (13)."""
    return EulerParameters(
        Q_1.eta * Q_2.eta + dot(Q_1.eps, Q_2.eps),  # eq. (12)
        Q_1.eta * Q_2.eps - Q_2.eta * Q_1.eps - cross(Q_1.eps, Q_2.eps),  # eq. (13)
    )


# --- products of vectors (3,) and matrices (3, 3) ---------------------------------------------


@jit(f8(vector, vector))
def dot(v: Array, w: Array) -> float:
    """Return v' w."""
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]


@jit(f8(vector))
def norm(v: Array) -> float:
    """Return |v|."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@jit(new_vector(vector, vector))
def cross(v: Array, w: Array) -> Array:
    """Return v x w."""
    u = np.empty(3)
    u[0] = v[1] * w[2] - v[2] * w[1]
    u[1] = v[2] * w[0] - v[0] * w[2]
    u[2] = v[0] * w[1] - v[1] * w[0]
    return u


@jit(new_matrix(vector))
def S(v: Array) -> Array:
    """Return the skew-symmetric matrix with S(v) w = v x w, as in eq. (1)."""
    A = np.zeros((3, 3))
    A[0, 1], A[0, 2], A[1, 2] = -v[2], v[1], -v[0]
    A[1, 0], A[2, 0], A[2, 1] = v[2], -v[1], v[0]
    return A


@jit(new_vector(matrix, vector))
def turn(R: Array, v: Array) -> Array:
    """Return R v."""
    u = np.empty(3)
    for i in range(3):
        u[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]
    return u


@jit(new_vector(matrix, vector))
def turn_back(R: Array, v: Array) -> Array:
    """Return R' v."""
    u = np.empty(3)
    for i in range(3):
        u[i] = R[0, i] * v[0] + R[1, i] * v[1] + R[2, i] * v[2]
    return u


@jit(new_matrix(matrix, matrix))
def product(A: Array, B: Array) -> Array:
    """Return A B."""
    C = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


@jit(new_vector(matrix, vector))
def solve(A: Array, b: Array) -> Array:
    """Return A^-1 b by Cramer's rule; NaN where A is singular."""
    a_1, a_2, a_3 = A[:, 0], A[:, 1], A[:, 2]
    a_23 = cross(a_2, a_3)
    det = dot(a_1, a_23)
    x = np.full(3, np.nan)
    if det != 0.0:
        x[0] = dot(b, a_23) / det
        x[1] = dot(b, cross(a_3, a_1)) / det
        x[2] = dot(b, cross(a_1, a_2)) / det
    return x


@jit(new_matrix(matrix))
def inverse(A: Array) -> Array:
    """Return A^-1; NaN where A is singular."""
    B, I = np.empty((3, 3)), np.eye(3)
    for j in range(3):
        B[:, j] = solve(A, I[j])
    return B


# --- rotations --------------------------------------------------------------------------------


@jit(new_matrix(f8, vector))
def R_angle_axis(theta: float, r: Array) -> Array:
    """Return R of a rotation by theta [rad] about the unit vector r, eq. (4).

    The printed eq. (4) has -sin(theta) S(r), which is R transposed (erratum).
    """
    c, s = math.cos(theta), math.sin(theta)
    R = c * np.eye(3) + s * S(r)
    for i in range(3):
        R[i] += (1.0 - c) * r[i] * r
    return R


@jit(_quaternion(matrix))
def shepperd(R: Array) -> tuple[float, Array]:
    """Return (eta, eps) of R with eta >= 0, by Shepperd's method, which is exact at every angle."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    largest = max(trace, R[0, 0], R[1, 1], R[2, 2])
    eps = np.empty(3)
    eps[0], eps[1], eps[2] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    eta = 1.0 + trace
    if largest != trace:
        i = 0 if largest == R[0, 0] else (1 if largest == R[1, 1] else 2)
        j, k = (i + 1) % 3, (i + 2) % 3
        eta = eps[i]
        eps[i] = 1.0 + 2.0 * R[i, i] - trace
        eps[j], eps[k] = R[i, j] + R[j, i], R[k, i] + R[i, k]
    scale = math.copysign(1.0 / math.sqrt(eta * eta + dot(eps, eps)), eta)
    return eta * scale, eps * scale


@jit(_quaternion(matrix, matrix))
def _mutual_R(R_1: Array, R_2: Array) -> tuple[float, Array]:
    return shepperd(product(R_1.T, R_2))


@jit(new_matrix(f8, vector))
def R_quaternion(eta: float, eps: Array) -> Array:
    """Return R = (eta^2 - eps' eps) I + 2 eps eps' + 2 eta S(eps), eq. (7).

    The printed eq. (7) has -2 eta S(eps), which is R transposed (erratum).
    """
    x, y, z = eps[0], eps[1], eps[2]
    d = eta * eta - (x * x + y * y + z * z)
    R = np.empty((3, 3))
    R[0, 0], R[1, 1], R[2, 2] = d + 2.0 * x * x, d + 2.0 * y * y, d + 2.0 * z * z
    R[0, 1], R[1, 0] = 2.0 * (x * y - eta * z), 2.0 * (x * y + eta * z)
    R[0, 2], R[2, 0] = 2.0 * (x * z + eta * y), 2.0 * (x * z - eta * y)
    R[1, 2], R[2, 1] = 2.0 * (y * z - eta * x), 2.0 * (y * z + eta * x)
    return R


@jit(_quaternion(f8, vector, vector))
def propagation(eta: float, eps: Array, omega: Array) -> tuple[float, Array]:
    """Return deta, deps for omega [rad/s], eqs. (8)-(10).

    Also eqs. (16), (17), with the mutual quaternion and the relative velocity in frame 1.
    """
    deta = -0.5 * dot(eps, omega)  # eq. (8)
    deps = 0.5 * (eta * omega - cross(eps, omega))  # eqs. (9), (10)
    return deta, deps


@jit(new_matrix(vector))
def exp(x: Array) -> Array:
    """Return R of the rotation vector x = theta r [rad]."""
    theta = norm(x)
    # sin(theta / 2) / theta
    half = math.sin(theta / 2.0) / theta if theta > SMALL_ANGLE else 0.5 - theta * theta / 48.0
    return R_quaternion(math.cos(theta / 2.0), half * x)


@jit(new_vector(f8, vector))
def rotation_vector(eta: float, eps: Array) -> Array:
    """Return theta r [rad], with theta in [0, 2 pi): that of the sign of the quaternion."""
    sine = norm(eps)
    if sine < SMALL_ANGLE and eta > 0.0:
        return (2.0 / eta) * (1.0 - sine * sine / (3.0 * eta * eta)) * eps
    if sine > 0.0:
        return (2.0 * math.atan2(sine, eta) / sine) * eps
    return 0.0 * eps


@jit(new_vector(matrix))
def log(R: Array) -> Array:
    """Return the rotation vector theta r [rad] of R, theta in [0, pi]."""
    eta, eps = shepperd(R)
    return rotation_vector(eta, eps)


@jit(f8(matrix, matrix))
def chord(R_1: Array, R_2: Array) -> float:
    """Return 2 sin(theta / 2) of the rotation from R_1 to R_2: its angle, where that is small."""
    trace = 0.0
    for i in range(3):
        trace += dot(R_1[:, i], R_2[:, i])
    return math.sqrt(max(3.0 - trace, 0.0))


@jit(f8(matrix, matrix))
def angle_between(R_1: Array, R_2: Array) -> float:
    """Return the angle [rad] in [0, pi] of the rotation from R_1 to R_2."""
    eta, eps = _mutual_R(R_1, R_2)
    return 2.0 * math.atan2(norm(eps), abs(eta))


@jit(types.UniTuple(f8, 4)(f8))
def jacobian_coefficients(theta: float) -> tuple[float, float, float, float]:
    """Return a, b of J_r and a'(theta) / theta, b'(theta) / theta."""
    t2 = theta * theta
    if theta < SMALL_JACOBIAN_ANGLE:
        t4 = t2 * t2
        t6 = t4 * t2
        return (
            1.0 / 2.0 - t2 / 24.0 + t4 / 720.0 - t6 / 40320.0,
            1.0 / 6.0 - t2 / 120.0 + t4 / 5040.0 - t6 / 362880.0,
            -1.0 / 12.0 + t2 / 180.0 - t4 / 6720.0 + t6 / 453600.0,
            -1.0 / 60.0 + t2 / 1260.0 - t4 / 60480.0 + t6 / 4989600.0,
        )
    sin, cos = math.sin(theta), math.cos(theta)
    a, b = (1.0 - cos) / t2, (theta - sin) / (t2 * theta)
    return a, b, (sin / theta - 2.0 * a) / t2, ((1.0 - cos) / t2 - 3.0 * b) / t2


@jit(new_matrix(vector))
def right_jacobian(x: Array) -> Array:
    """Return J_r(x): the angular velocity in the turned frame is J_r(x) dx.

    Of R = exp(x), x = theta r [rad]: J_r = I - a S(x) + b S(x)^2 with
    a = (1 - cos(theta)) / theta^2 and b = (theta - sin(theta)) / theta^3.
    """
    a, b, _, _ = jacobian_coefficients(norm(x))
    return np.eye(3) - a * S(x) + b * product(S(x), S(x))


@jit(types.UniTuple(new_vector, 2)(vector, vector, vector))
def body_rates(x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
    """Return omega = J_r dx and domega = J_r ddx + dJ_r dx of R = exp(x), in the turned frame."""
    a, b, da, db = jacobian_coefficients(norm(x))
    x_dx, x_ddx = cross(x, dx), cross(x, ddx)
    x_x_dx = cross(x, x_dx)
    dJ_dx = b * cross(dx, x_dx) + dot(x, dx) * (db * x_x_dx - da * x_dx)
    return dx - a * x_dx + b * x_x_dx, ddx - a * x_ddx + b * cross(x, x_ddx) + dJ_dx
