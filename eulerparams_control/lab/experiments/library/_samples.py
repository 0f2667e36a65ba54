"""Seeded random rotations, and frames that move, for the checks of the equations."""

import math
from collections.abc import Callable

import numpy as np

from eulerparams_control.lab.experiments.library._arms import SEED
from eulerparams_control.laws.rotations import Array, EulerParameters, exp

STEP = 1e-6  # [s] of the central differences: their floor is about 1e-9

# Central differences of eighth order (Fornberg, 1988), of a function at 0, 1, ..., 4 steps.
# Rounding leaves about 1e-15 / step^2 of the second derivative, what is left out step^8; at 1 ms
# both are below 1e-8 for the angles here.
WIDE_STEP = 1e-3  # [s]
_FIRST = (0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280)
_SECOND = (-205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560)


def generator(key: int) -> np.random.Generator:
    """Return a random generator that depends on the key alone."""
    return np.random.default_rng((SEED, key))


def rotations(count: int, key: int) -> list[Array]:
    """Return uniform rotations (3, 3): unit quaternions of Gaussian numbers."""
    q = generator(key).normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    return [EulerParameters(float(eta), np.array(eps)).R for eta, *eps in q]


def vectors(count: int, key: int) -> list[Array]:
    """Return vectors (3,) with components of order 1."""
    return list(generator(key).normal(size=(count, 3)))


def turning(R: Array, omega: Array) -> Callable[[float], Array]:
    """Return the frame t -> R(t) that turns at omega (3,) [rad/s] and is R at t = 0."""
    return lambda t: exp(t * omega) @ R


def accelerated(R: Array, omega: Array, domega: Array) -> Callable[[float], Array]:
    """Return a frame t -> R(t) that is R, turns at omega and accelerates by domega at t = 0.

    Its angular velocity is omega + domega t + O(t^2), for the left Jacobian of exp at x is
    I + S(x) / 2 + O(x^2), and S(omega) omega = 0.
    """
    return lambda t: exp(t * omega + t**2 / 2 * domega) @ R


def derivative(function: Callable[[float], Array]) -> Array:
    """Return the derivative of a function of time at t = 0, by central differences."""
    rate: Array = (function(STEP) - function(-STEP)) / (2 * STEP)
    return rate


def derivatives(function: Callable[[float], Array]) -> tuple[Array, Array]:
    """Return the first and the second derivative of a function of time at t = 0."""
    points = [step * WIDE_STEP for step in range(1, len(_SECOND))]
    ahead, behind = (np.array([function(sign * t) for t in points]) for sign in (1, -1))
    first = np.tensordot(_FIRST[1:], ahead - behind, 1)
    second = _SECOND[0] * function(0.0) + np.tensordot(_SECOND[1:], ahead + behind, 1)
    return first / WIDE_STEP, second / WIDE_STEP**2


def size(value: Array | float) -> float:
    """Return the norm of a residual, of Frobenius for matrices."""
    return float(np.linalg.norm(value))


def angle_axis(theta: float, r: Array) -> Array:
    """Return the rotation (3, 3) by theta [rad] about r by Rodrigues' formula, written out."""
    x, y, z = r.tolist()
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R: Array = np.eye(3) + math.sin(theta) * K + (1 - math.cos(theta)) * (K @ K)
    return R
