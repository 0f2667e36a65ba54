"""Rotations of section II: matrices, Euler parameters, angle and axis.

Notation: ``R`` (3, 3) rotation matrix, ``Q`` Euler parameters (eta, eps) with the
scalar first, ``theta`` rotation angle [rad], ``r`` (3,) unit axis, ``omega`` (3,)
angular velocity [rad/s].  Vectors are in the base frame unless a suffix says else.

Each formula takes values, arrays of one sample, or arrays of N samples in a row.
"""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws._old.compiled import Array, formula
from eulerparams_control.laws._old.linear import (
    Mat,
    S,
    Vec,
    VecLike,
    cross,
    identity,
    norm,
    outer,
)

__all__ = ["Array", "EulerParameters", "S", "cross"]

# Below this angle sin(x)/x and its kin are taken from their Taylor series, whose first
# omitted term is then below 1e-16.
SMALL_ANGLE = 1e-4

# The coefficients of the right Jacobian lose 1e-16 / theta^4 by cancellation; below this
# angle four terms of their series are exact to 1e-13.
SMALL_JACOBIAN_ANGLE = 0.1


class EulerParameters(NamedTuple):
    """The unit quaternion {eta, eps} of eq. (5), scalar part first.

    Attributes:
        eta: cos(theta / 2).
        eps: (3,) sin(theta / 2) r.
    """

    eta: float
    eps: VecLike

    @classmethod
    def from_angle_axis(cls, theta: float, r: Array) -> "EulerParameters":
        """Return {cos(theta/2), sin(theta/2) r}, eq. (5)."""
        return cls(math.cos(theta / 2), math.sin(theta / 2) * r)

    @classmethod
    def from_R(cls, R: Array) -> "EulerParameters":
        """Extract them from R (3, 3) with eta >= 0: see :func:`quaternion`."""
        return quaternion(R)

    @property
    def R(self) -> Array:
        """The rotation matrix (3, 3), eq. (7)."""
        return matrix(self)

    @property
    def E(self) -> Array:
        """E(eta, eps) = eta I - S(eps) (3, 3), eq. (10)."""
        E: Array = self.eta * np.eye(3) - S(self.eps)
        return E

    @property
    def theta(self) -> float:
        """The rotation angle [rad] in [0, pi], whatever the sign of the quaternion."""
        return angle(self)

    def __neg__(self) -> "EulerParameters":
        """Return -(eta, eps), the same rotation."""
        return EulerParameters(-self.eta, -self.eps)

    @property
    def conjugate(self) -> "EulerParameters":
        """{eta, -eps}: the inverse rotation."""
        return EulerParameters(self.eta, -self.eps)


@formula
def R_axis(axis: int, angle: float) -> Mat:
    """Return the elementary rotation by ``angle`` [rad] about x, y or z (0, 1, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    if axis == 0:
        return Mat(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
    if axis == 1:
        return Mat(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c)
    return Mat(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


@formula
def R_angle_axis(theta: float, r: Vec) -> Mat:
    """Return R of a rotation by theta [rad] about the unit vector r, eq. (4).

    The printed eq. (4) has -sin(theta) S(r), which is R transposed (erratum).
    """
    c, s = math.cos(theta), math.sin(theta)
    return identity(c) + (1.0 - c) * outer(r, r) + s * S(r)


@formula
def quaternion(R: Mat) -> EulerParameters:
    """Return {eta, eps} of R with eta >= 0, by Shepperd's method.

    The largest of the four is found first, so it works at every angle, theta = pi
    included, and keeps small angles.
    """
    trace = R.xx + R.yy + R.zz
    largest = max(trace, max(R.xx, max(R.yy, R.zz)))
    x, y, z = R.zy - R.yz, R.xz - R.zx, R.yx - R.xy
    if largest == trace:
        eta = 1.0 + trace
    elif largest == R.xx:
        eta, x, y, z = x, 1.0 + 2.0 * R.xx - trace, R.xy + R.yx, R.xz + R.zx
    elif largest == R.yy:
        eta, x, y, z = y, R.xy + R.yx, 1.0 + 2.0 * R.yy - trace, R.yz + R.zy
    else:
        eta, x, y, z = z, R.xz + R.zx, R.yz + R.zy, 1.0 + 2.0 * R.zz - trace
    scale = math.copysign(1.0 / math.sqrt(eta * eta + x * x + y * y + z * z), eta)
    return EulerParameters(eta * scale, Vec(x * scale, y * scale, z * scale))


@formula
def matrix(Q: EulerParameters) -> Mat:
    """Return R = (eta^2 - eps' eps) I + 2 eps eps' + 2 eta S(eps), eq. (7).

    The printed eq. (7) has -2 eta S(eps), which is R transposed (erratum).
    """
    eta, x, y, z = Q.eta, Q.eps.x, Q.eps.y, Q.eps.z
    d = eta * eta - (x * x + y * y + z * z)
    return Mat(
        d + 2.0 * x * x, 2.0 * (x * y - eta * z), 2.0 * (x * z + eta * y),
        2.0 * (x * y + eta * z), d + 2.0 * y * y, 2.0 * (y * z - eta * x),
        2.0 * (x * z - eta * y), 2.0 * (y * z + eta * x), d + 2.0 * z * z,
    )  # fmt: skip


@formula
def angle(Q: EulerParameters) -> float:
    """Return the rotation angle [rad] in [0, pi], whatever the sign of the quaternion."""
    return 2.0 * math.atan2(norm(Q.eps), abs(Q.eta))


@formula
def opposite(Q: EulerParameters) -> EulerParameters:
    """Return -(eta, eps), the same rotation."""
    return EulerParameters(-Q.eta, -Q.eps)


@formula
def inner(Q_1: EulerParameters, Q_2: EulerParameters) -> float:
    """Return the inner product of two quaternions: < 0 where their signs are not the same."""
    return Q_1.eta * Q_2.eta + Q_1.eps @ Q_2.eps


@formula
def mutual(Q_1: EulerParameters, Q_2: EulerParameters) -> EulerParameters:
    """Return {eta_21, eps_21} in frame 1, of frame 2 relative to frame 1, eqs. (12), (13)."""
    return EulerParameters(
        Q_1.eta * Q_2.eta + Q_1.eps @ Q_2.eps,  # eq. (12)
        Q_1.eta * Q_2.eps - Q_2.eta * Q_1.eps - cross(Q_1.eps, Q_2.eps),  # eq. (13)
    )


def product(Q_1: EulerParameters, Q_2: EulerParameters) -> EulerParameters:
    """Return the quaternion product, the Euler parameters of R(Q_1) R(Q_2)."""
    return mutual(Q_1.conjugate, Q_2)


@formula
def mutual_R(R_1: Mat, R_2: Mat) -> EulerParameters:
    """Return {eta_21, eps_21} of R_1' R_2, eq. (11), with eta_21 >= 0.

    It extracts from the mutual rotation; two quaternions extracted apart and composed
    can be of opposite sign, which makes a small error look like a turn of almost 360 deg.
    """
    return quaternion(R_1.T @ R_2)


@formula
def propagation(Q: EulerParameters, omega: Vec) -> EulerParameters:
    """Return {deta, deps} for the angular velocity omega [rad/s], eqs. (8), (9).

    Also eqs. (16), (17), with the mutual quaternion and the relative velocity in frame 1.
    """
    return EulerParameters(
        -0.5 * (Q.eps @ omega),  # eq. (8)
        0.5 * (Q.eta * omega - cross(Q.eps, omega)),  # eqs. (9), (10)
    )


@formula
def exp(x: Vec) -> Mat:
    """Return R of the rotation vector x = theta r [rad]."""
    theta = norm(x)
    # sin(theta / 2) / theta
    half = math.sin(theta / 2.0) / theta if theta > SMALL_ANGLE else 0.5 - theta * theta / 48.0
    return matrix(EulerParameters(math.cos(theta / 2.0), half * x))


@formula
def log(R: Mat) -> Vec:
    """Return the rotation vector theta r [rad] of R, theta in [0, pi]."""
    return rotation_vector(quaternion(R))


@formula
def rotation_vector(Q: EulerParameters) -> Vec:
    """Return theta r [rad] of Q, with theta in [0, 2 pi): that of its sign."""
    sine = norm(Q.eps)
    if sine < SMALL_ANGLE and Q.eta > 0.0:
        return ((2.0 / Q.eta) * (1.0 - sine * sine / (3.0 * Q.eta * Q.eta))) * Q.eps
    if sine > 0.0:
        return (2.0 * math.atan2(sine, Q.eta) / sine) * Q.eps
    return 0.0 * Q.eps


class BodyRates(NamedTuple):
    """Angular velocity and acceleration (3,) of R = exp(x) in the turned frame."""

    omega: VecLike
    domega: VecLike


@formula
def body_rates(x: Vec, dx: Vec, ddx: Vec) -> BodyRates:
    """Return J_r dx and J_r ddx + dJ_r dx, with dJ_r the time derivative of J_r.

    Args:
        x, dx, ddx: (3,) rotation vector and its derivatives [rad, rad/s, rad/s^2].
    """
    a, b, da, db = jacobian_coefficients(norm(x))
    x_dx, x_ddx = cross(x, dx), cross(x, ddx)
    x_x_dx = cross(x, x_dx)
    dJ_dx = b * cross(dx, x_dx) + (x @ dx) * (db * x_x_dx - da * x_dx)
    return BodyRates(
        dx - a * x_dx + b * x_x_dx,
        ddx - a * x_ddx + b * cross(x, x_ddx) + dJ_dx,
    )


@formula
def right_jacobian(x: Vec) -> Mat:
    """Return J_r(x): the angular velocity in the turned frame is J_r(x) dx.

    Of R = exp(x), x = theta r [rad]: J_r = I - a S(x) + b S(x)^2 with
    a = (1 - cos(theta)) / theta^2 and b = (theta - sin(theta)) / theta^3.
    """
    a, b, _, _ = jacobian_coefficients(norm(x))
    return identity(1.0) - a * S(x) + b * (S(x) @ S(x))


@formula
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


@formula
def chord(R_1: Mat, R_2: Mat) -> float:
    """Return 2 sin(theta / 2) of the rotation from R_1 to R_2: its angle, where that is small."""
    Q = R_1.T @ R_2
    return math.sqrt(max(3.0 - (Q.xx + Q.yy + Q.zz), 0.0))


@formula
def angle_between(R_1: Mat, R_2: Mat) -> float:
    """Return the angle [rad] in [0, pi] of the rotation from R_1 to R_2."""
    return angle(mutual_R(R_1, R_2))
