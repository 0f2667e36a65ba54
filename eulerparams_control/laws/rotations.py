"""Rotations of section II: matrices, Euler parameters, angle and axis.

Notation: ``R`` (3, 3) rotation matrix, ``Q`` Euler parameters (eta, eps) with the
scalar first, ``theta`` rotation angle [rad], ``r`` (3,) unit axis, ``omega`` (3,)
angular velocity [rad/s].  Vectors are in the base frame unless a suffix says else.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Below this angle sin(x)/x and its kin are taken from their Taylor series, whose first
# omitted term is then below 1e-16.
SMALL_ANGLE = 1e-4

# The coefficients of the right Jacobian lose 1e-16 / theta^4 by cancellation; below this
# angle four terms of their series are exact to 1e-13.
SMALL_JACOBIAN_ANGLE = 0.1


def S(v: Array) -> Array:
    """Return the skew-symmetric (3, 3) with S(v) w = v x w, as in eq. (1)."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(v: Array, w: Array) -> Array:
    """Return v x w (3,); np.cross is several times slower for one pair."""
    return np.array(_cross(v.tolist(), w.tolist()))


def _cross(v: list[float], w: list[float]) -> list[float]:
    a, b, c = v
    x, y, z = w
    return [b * z - c * y, c * x - a * z, a * y - b * x]


def R_axis(axis: int, angle: float) -> Array:
    """Return the elementary rotation (3, 3) by ``angle`` [rad] about x, y or z (0, 1, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[j, j] = R[k, k] = c
    R[k, j], R[j, k] = s, -s
    return R


def R_angle_axis(theta: float, r: Array) -> Array:
    """Return R (3, 3) of a rotation by theta [rad] about the unit vector r, eq. (4).

    The printed eq. (4) has -sin(theta) S(r), which is R transposed (erratum).
    """
    c, s = math.cos(theta), math.sin(theta)
    return c * np.eye(3) + (1 - c) * np.outer(r, r) + s * S(r)


def every(flags: NDArray[np.bool_]) -> bool:
    """Return whether all of a few flags are true: as ``all`` does, in a third of the time."""
    return False not in flags.tolist()


class EulerParameters(NamedTuple):
    """The unit quaternion {eta, eps} of eq. (5), scalar part first.

    Attributes:
        eta: cos(theta / 2).
        eps: (3,) sin(theta / 2) r.
    """

    eta: float
    eps: Array

    @classmethod
    def from_angle_axis(cls, theta: float, r: Array) -> "EulerParameters":
        """Return {cos(theta/2), sin(theta/2) r}, eq. (5)."""
        return cls(math.cos(theta / 2), math.sin(theta / 2) * r)

    @classmethod
    def from_R(cls, R: Array) -> "EulerParameters":
        """Extract them from R (3, 3) with eta >= 0, by Shepperd's method.

        The largest of the four is found first, so it works at every angle, theta = pi
        included, and keeps small angles.
        """
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.tolist()
        trace = xx + yy + zz
        largest = max(trace, xx, yy, zz)
        if largest == trace:
            q = (1 + trace, zy - yz, xz - zx, yx - xy)
        elif largest == xx:
            q = (zy - yz, 1 + 2 * xx - trace, xy + yx, xz + zx)
        elif largest == yy:
            q = (xz - zx, xy + yx, 1 + 2 * yy - trace, yz + zy)
        else:
            q = (yx - xy, xz + zx, yz + zy, 1 + 2 * zz - trace)
        eta, x, y, z = q
        scale = math.copysign(1 / math.sqrt(eta * eta + x * x + y * y + z * z), eta)
        return cls(eta * scale, np.array([x * scale, y * scale, z * scale]))

    @property
    def R(self) -> Array:
        """The rotation matrix (3, 3), eq. (7).

        The printed eq. (7) has -2 eta S(eps), which is R transposed (erratum).
        """
        eta, (x, y, z) = self.eta, self.eps.tolist()
        d = eta * eta - (x * x + y * y + z * z)  # (eta^2 - eps' eps) I + 2 eps eps' + 2 eta S(eps)
        return np.array(
            [
                [d + 2 * x * x, 2 * (x * y - eta * z), 2 * (x * z + eta * y)],
                [2 * (x * y + eta * z), d + 2 * y * y, 2 * (y * z - eta * x)],
                [2 * (x * z - eta * y), 2 * (y * z + eta * x), d + 2 * z * z],
            ]
        )

    @property
    def E(self) -> Array:
        """E(eta, eps) = eta I - S(eps) (3, 3), eq. (10)."""
        return self.eta * np.eye(3) - S(self.eps)

    @property
    def theta(self) -> float:
        """The rotation angle [rad] in [0, pi], whatever the sign of the quaternion."""
        return 2 * math.atan2(math.sqrt(self.eps @ self.eps), abs(self.eta))

    def __neg__(self) -> "EulerParameters":
        """Return -(eta, eps), the same rotation."""
        return EulerParameters(-self.eta, -self.eps)

    @property
    def conjugate(self) -> "EulerParameters":
        """{eta, -eps}: the inverse rotation."""
        return EulerParameters(self.eta, -self.eps)


def product(Q_1: EulerParameters, Q_2: EulerParameters) -> EulerParameters:
    """Return the quaternion product, the Euler parameters of R(Q_1) R(Q_2)."""
    return mutual(Q_1.conjugate, Q_2)


def mutual(Q_1: EulerParameters, Q_2: EulerParameters) -> EulerParameters:
    """Return {eta_21, eps_21} in frame 1, of frame 2 relative to frame 1, eqs. (12), (13)."""
    eta_1, eps_1 = Q_1
    eta_2, eps_2 = Q_2
    return EulerParameters(
        eta_1 * eta_2 + float(eps_1 @ eps_2),  # eq. (12)
        eta_1 * eps_2 - eta_2 * eps_1 - cross(eps_1, eps_2),  # eq. (13)
    )


def mutual_R(R_1: Array, R_2: Array) -> EulerParameters:
    """Return {eta_21, eps_21} of R_1' R_2, eq. (11), with eta_21 >= 0.

    It extracts from the mutual rotation; two quaternions extracted apart and composed
    can be of opposite sign, which makes a small error look like a turn of almost 360 deg.
    """
    return EulerParameters.from_R(R_1.T @ R_2)


def propagation(Q: EulerParameters, omega: Array) -> tuple[float, Array]:
    """Return (deta, deps) for the angular velocity omega (3,) [rad/s], eqs. (8), (9).

    Also eqs. (16), (17), with the mutual quaternion and the relative velocity in frame 1.
    """
    return -0.5 * float(Q.eps @ omega), 0.5 * Q.E @ omega


def exp(x: Array) -> Array:
    """Return R (3, 3) of the rotation vector x = theta r (3,) [rad]."""
    theta = math.sqrt(x @ x)
    # sin(theta / 2) / theta
    half = math.sin(theta / 2) / theta if theta > SMALL_ANGLE else 0.5 - theta**2 / 48
    return EulerParameters(math.cos(theta / 2), half * x).R


def log(R: Array) -> Array:
    """Return the rotation vector theta r (3,) [rad] of R (3, 3), theta in [0, pi]."""
    return rotation_vector(EulerParameters.from_R(R))


def rotation_vector(Q: EulerParameters) -> Array:
    """Return theta r (3,) [rad] of Q, with theta in [0, 2 pi): that of its sign."""
    norm = math.sqrt(Q.eps @ Q.eps)
    theta = 2 * math.atan2(norm, Q.eta)
    if norm < SMALL_ANGLE and Q.eta > 0:
        return (2 / Q.eta) * (1 - norm**2 / (3 * Q.eta**2)) * Q.eps
    return (theta / norm) * Q.eps if norm > 0 else np.zeros(3)


def right_jacobian(x: Array) -> Array:
    """Return J_r(x) (3, 3): the angular velocity in the turned frame is J_r(x) dx.

    Of R = exp(x), x = theta r (3,) [rad]: J_r = I - a S(x) + b S(x)^2 with
    a = (1 - cos(theta)) / theta^2 and b = (theta - sin(theta)) / theta^3.
    """
    a, b, _, _ = _jacobian_coefficients(math.sqrt(x @ x))
    Sx = S(x)
    return np.eye(3) - a * Sx + b * (Sx @ Sx)


def body_rates(x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
    """Return angular velocity and acceleration of R = exp(x) in the turned frame.

    They are J_r dx and J_r ddx + dJ_r dx, with dJ_r the time derivative of J_r.

    Args:
        x, dx, ddx: (3,) rotation vector and its derivatives [rad, rad/s, rad/s^2].
    """
    a, b, da, db = _jacobian_coefficients(math.sqrt(x @ x))
    theta_dtheta = float(x @ dx)
    v, dv, d2v = x.tolist(), dx.tolist(), ddx.tolist()  # floats are faster than arrays of three
    x_dx, x_ddx = _cross(v, dv), _cross(v, d2v)
    x_x_dx, x_x_ddx, dx_x_dx = _cross(v, x_dx), _cross(v, x_ddx), _cross(dv, x_dx)
    omega = [dx - a * once + b * twice for dx, once, twice in zip(dv, x_dx, x_x_dx, strict=True)]
    domega = [
        ddx - a * x_ddx + b * x_x_ddx + (b * dx_x_dx + theta_dtheta * (db * twice - da * once))
        for ddx, x_ddx, x_x_ddx, dx_x_dx, twice, once in zip(
            d2v, x_ddx, x_x_ddx, dx_x_dx, x_x_dx, x_dx, strict=True
        )
    ]
    return np.array(omega), np.array(domega)


def _jacobian_coefficients(theta: float) -> tuple[float, float, float, float]:
    """Return a, b of J_r and a'(theta) / theta, b'(theta) / theta."""
    t2 = theta * theta
    if theta < SMALL_JACOBIAN_ANGLE:
        a = 1 / 2 - t2 / 24 + t2**2 / 720 - t2**3 / 40320
        b = 1 / 6 - t2 / 120 + t2**2 / 5040 - t2**3 / 362880
        da = -1 / 12 + t2 / 180 - t2**2 / 6720 + t2**3 / 453600
        db = -1 / 60 + t2 / 1260 - t2**2 / 60480 + t2**3 / 4989600
        return a, b, da, db
    sin, cos = math.sin(theta), math.cos(theta)
    a, b = (1 - cos) / t2, (theta - sin) / (t2 * theta)
    return a, b, (sin / theta - 2 * a) / t2, ((1 - cos) / t2 - 3 * b) / t2


def chord(R_1: Array, R_2: Array) -> float:
    """Return 2 sin(theta / 2) of the rotation from R_1 to R_2: its angle, where that is small."""
    return math.sqrt(max(3.0 - float(np.vdot(R_1, R_2)), 0.0))


def angle_between(R_1: Array, R_2: Array) -> float:
    """Return the angle [rad] in [0, pi] of the rotation from R_1 to R_2."""
    return mutual_R(R_1, R_2).theta
