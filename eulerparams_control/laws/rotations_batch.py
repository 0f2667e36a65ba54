"""The rotations of section II for many samples at once, with the same equations as for one.

What ``rotations.py`` does for one (3, 3) or (3,), these do for a stack (N, 3, 3) or (N, 3):
recorded runs have millions of samples.  Each is tested against its counterpart sample by sample.
"""

from typing import Any, cast

import numpy as np

from eulerparams_control.laws.rotations import (
    SMALL_ANGLE,
    SMALL_JACOBIAN_ANGLE,
    Array,
    EulerParameters,
)


def stack[T](samples: list[T]) -> T:
    """Return tuples of arrays as one tuple whose fields are stacked, at any depth."""
    first = samples[0]
    if isinstance(first, tuple):
        fields: T = type(first)(*map(stack, map(list, zip(*samples, strict=True))))
        return fields
    stacked: Any = np.array(samples)
    return cast("T", stacked)


def sample[T](stacked: T, index: int) -> T:
    """Return one sample of a tuple whose fields are stacked."""
    if isinstance(stacked, tuple):
        fields: T = type(stacked)(*(sample(entry, index) for entry in stacked))
        return fields
    return cast("T", cast("Any", stacked)[index])


def transposed(R: Array) -> Array:
    """Return R' (N, 3, 3)."""
    return R.swapaxes(-1, -2)


def turn(R: Array, v: Array) -> Array:
    """Return R v (N, 3) of R (N, 3, 3), v (N, 3)."""
    turned: Array = np.einsum("...ij,...j->...i", R, v)
    return turned


def turn_back(R: Array, v: Array) -> Array:
    """Return R' v (N, 3) of R (N, 3, 3), v (N, 3)."""
    turned: Array = np.einsum("...ji,...j->...i", R, v)
    return turned


def quaternions(R: Array) -> EulerParameters:
    """Return eta (N,) >= 0 and eps (N, 3) of R (N, 3, 3), by Shepperd's method; of one, too."""
    if R.ndim == 2:
        return EulerParameters.from_R(R)
    n = len(R)
    xx, yy, zz = R[:, 0, 0], R[:, 1, 1], R[:, 2, 2]
    trace = xx + yy + zz
    a = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]])
    b = np.stack([R[:, 1, 0] + R[:, 0, 1], R[:, 0, 2] + R[:, 2, 0], R[:, 2, 1] + R[:, 1, 2]])
    squares = np.stack([trace, xx, yy, zz])
    largest = np.argmax(np.where(np.isnan(squares), -np.inf, squares), axis=0)
    xyz = np.empty((4, n))
    columns = (
        (1 + trace, a[0], a[1], a[2]),
        (a[0], 1 + 2 * xx - trace, b[0], b[1]),
        (a[1], b[0], 1 + 2 * yy - trace, b[2]),
        (a[2], b[1], b[2], 1 + 2 * zz - trace),
    )
    for case, column in enumerate(columns):
        chosen = largest == case
        xyz[:, chosen] = np.stack(column)[:, chosen]
    xyz *= np.copysign(1 / np.sqrt((xyz**2).sum(axis=0)), xyz[0])
    return EulerParameters(xyz[0], xyz[1:].T)


def matrices(eta: Array, eps: Array) -> Array:
    """Return R (N, 3, 3) of unit quaternions, eq. (7) with its erratum."""
    x, y, z = eps.T
    d = eta * eta - (x * x + y * y + z * z)
    R = np.array(
        [
            [d + 2 * x * x, 2 * (x * y - eta * z), 2 * (x * z + eta * y)],
            [2 * (x * y + eta * z), d + 2 * y * y, 2 * (y * z - eta * x)],
            [2 * (x * z - eta * y), 2 * (y * z + eta * x), d + 2 * z * z],
        ]
    )
    return np.ascontiguousarray(np.moveaxis(R, -1, 0))


def exps(x: Array) -> Array:
    """Return R (N, 3, 3) of rotation vectors x (N, 3) [rad]."""
    theta = np.linalg.norm(x, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.where(theta > SMALL_ANGLE, np.sin(theta / 2) / theta, 0.5 - theta**2 / 48)
    return matrices(np.cos(theta / 2), half[:, None] * x)


def rotation_vectors(Q: EulerParameters) -> Array:
    """Return theta r (..., 3) [rad] of eta (...), eps (..., 3), theta in [0, 2 pi)."""
    eta = np.asarray(Q.eta)
    norm = np.sqrt(np.vecdot(Q.eps, Q.eps))
    with np.errstate(divide="ignore", invalid="ignore"):
        small = (2 / eta) * (1 - norm**2 / (3 * eta**2))
        factor = np.where(norm > 0, 2 * np.arctan2(norm, eta) / norm, 0.0)
    factor = np.where((norm < SMALL_ANGLE) & (eta > 0), small, factor)
    vectors: Array = factor[..., None] * Q.eps
    return vectors


def angles_between(R_1: Array, R_2: Array) -> Array:
    """Return the angles (N,) [rad] in [0, pi] of the rotations from R_1 to R_2 (N, 3, 3)."""
    eta, eps = quaternions(transposed(R_1) @ R_2)
    angles: Array = 2 * np.arctan2(np.linalg.norm(eps, axis=1), np.abs(eta))
    return angles


def body_rates_of(x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
    """Return J_r dx and J_r ddx + dJ_r dx (N, 3): see ``rotations.body_rates``."""
    a, b, da, db = (c[:, None] for c in _jacobian_coefficients(np.linalg.norm(x, axis=1)))
    theta_dtheta = np.vecdot(x, dx)[:, None]
    x_dx, x_ddx = np.cross(x, dx), np.cross(x, ddx)
    x_x_dx = np.cross(x, x_dx)
    omega = dx - a * x_dx + b * x_x_dx
    dJ_dx = b * np.cross(dx, x_dx) + theta_dtheta * (db * x_x_dx - da * x_dx)
    return omega, ddx - a * x_ddx + b * np.cross(x, x_ddx) + dJ_dx


def _jacobian_coefficients(theta: Array) -> tuple[Array, Array, Array, Array]:
    """Return a, b of J_r and a'(theta) / theta, b'(theta) / theta, each (N,)."""
    t2 = theta * theta
    sin, cos = np.sin(theta), np.cos(theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (1 - cos) / t2, (theta - sin) / (t2 * theta)
        da, db = (sin / theta - 2 * a) / t2, ((1 - cos) / t2 - 3 * b) / t2
    small = theta < SMALL_JACOBIAN_ANGLE
    return (
        np.where(small, 1 / 2 - t2 / 24 + t2**2 / 720 - t2**3 / 40320, a),
        np.where(small, 1 / 6 - t2 / 120 + t2**2 / 5040 - t2**3 / 362880, b),
        np.where(small, -1 / 12 + t2 / 180 - t2**2 / 6720 + t2**3 / 453600, da),
        np.where(small, -1 / 60 + t2 / 1260 - t2**2 / 60480 + t2**3 / 4989600, db),
    )
