"""Seeded samples of rotations, and frames that move; made without the code under test."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from hypothesis import HealthCheck, settings
from numpy.typing import NDArray
from tolerances import POLE_CLEARANCE, STEP

Array = NDArray[np.float64]

SEED = 1999
# Angles [rad] at which things go wrong: the identity, pi, and their neighbourhoods.
SPECIAL_ANGLES = (0.0, 1e-12, 1e-9, 1e-7, 1e-4, 0.1, math.pi - 1e-4, math.pi - 1e-7, math.pi - 1e-9)
# The non-diagonal stiffness K* of the experiments: its eigenvalues [Nm/rad] and axes, a rotation
# vector.
K_STAR, K_STAR_TURN = (20.0, 50.0, 100.0), (0.4, -0.7, 1.1)
# Distances [rad] to the pole of a sequence, on both sides of where extraction changes.
POLE_DISTANCES = (0.0, 1e-15, 1e-13, 3e-12, 1e-11, 1e-10, 1e-9, 1e-7, 1e-5, 1e-3, 0.1)


def examples(count: int) -> settings:
    """Return settings of so many examples; fewer where `make test` takes fewer."""
    part = settings.default.max_examples / settings.get_profile("repeatable").max_examples
    return settings(max_examples=math.ceil(part * count), suppress_health_check=list(HealthCheck))


def generator(*key: int) -> np.random.Generator:
    """Return a random generator that depends on the key alone."""
    return np.random.default_rng((SEED, *key))


def vectors(count: int, key: int = 0) -> list[Array]:
    """Return ``count`` random vectors (3,) with components of order 1."""
    return list(generator(1, key).normal(size=(count, 3)))


def unit_vectors(count: int, key: int = 0) -> list[Array]:
    """Return ``count`` unit vectors (3,), uniform on the sphere."""
    return [v / np.linalg.norm(v) for v in generator(2, key).normal(size=(count, 3))]


def rodrigues(theta: float, r: Array) -> Array:
    """Return the rotation (3, 3) by theta about r: I + sin(theta) K + 2 sin^2(theta/2) K^2."""
    x, y, z = r.tolist()
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(theta) * K + 2 * math.sin(theta / 2) ** 2 * (K @ K)


def about(axis: int, angle: float) -> Array:
    """Return the rotation (3, 3) by ``angle`` [rad] about x, y or z (0, 1, 2)."""
    return rodrigues(angle, np.eye(3)[axis])


def half_turn(r: Array) -> Array:
    """Return the rotation (3, 3) by exactly pi about r."""
    return 2 * np.outer(r, r) - np.eye(3)


@cache
def uniform(count: int, key: int = 0) -> list[Array]:
    """Return ``count`` rotations, uniform (Haar), by QR of Gaussian matrices."""
    rotations = []
    for matrix in generator(3, key).normal(size=(count, 3, 3)):
        Q, upper = np.linalg.qr(matrix)
        Q = Q * np.sign(np.diag(upper))
        rotations.append(Q * np.linalg.det(Q))
    return rotations


@cache
def half_turns() -> list[Array]:
    """Return rotations by exactly pi: about the axes, about diagonals, about any vector."""
    diagonals = [(1, 1, 0), (1, -1, 0), (0, 1, 1), (-1, 0, 1), (1, 1, 1), (-1, 1, -1)]
    axes = [*np.eye(3), *(np.array(d) / np.linalg.norm(d) for d in diagonals)]
    return [half_turn(r) for r in [*axes, *unit_vectors(30, key=1)]]


@cache
def special() -> list[Array]:
    """Return rotations by the special angles about random and about coordinate axes."""
    axes = [*np.eye(3), *-np.eye(3), *unit_vectors(20, key=2)]
    return [rodrigues(theta, r) for theta in SPECIAL_ANGLES for r in axes]


@cache
def all_rotations() -> list[Array]:
    """Return the identity, uniform, special rotations and half turns."""
    return [np.eye(3), *uniform(200), *special(), *half_turns()]


def axes_of(sequence: str) -> tuple[int, int, int]:
    """Return the axes of a sequence such as ``"XYZ"`` as 0, 1, 2."""
    i, j, k = ("XYZ".index(letter) for letter in sequence)
    return i, j, k


def poles(sequence: str) -> tuple[float, float]:
    """Return the two beta [rad] at which the first axis lies along the last."""
    return (0.0, math.pi) if sequence[0] == sequence[2] else (-math.pi / 2, math.pi / 2)


def by_angles(sequence: str, alpha: float, beta: float, gamma: float) -> Array:
    """Return R_i(alpha) R_j(beta) R_k(gamma) (3, 3)."""
    i, j, k = axes_of(sequence)
    return about(i, alpha) @ about(j, beta) @ about(k, gamma)


def skew(v: Array) -> Array:
    return np.cross(np.eye(3), v)


def axial(M: Array) -> Array:
    """Return the vector (3,) of the skew-symmetric part of M."""
    return np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]) / 2


def turn_of(R: Array) -> Array:
    """Return theta r (3,) of a rotation, for theta below 180 deg by some degrees."""
    v = axial(R)
    sin = float(np.linalg.norm(v))
    return math.atan2(sin, (np.trace(R) - 1) / 2) / sin * v if sin else v


def angle(R_1: Array, R_2: Array) -> float:
    """Return the angle [rad] between two rotations, exact for small and large ones."""
    R = R_1.T @ R_2
    return math.atan2(np.linalg.norm(axial(R)), (np.trace(R) - 1) / 2)


def T_of(sequence: str, phi: Array) -> Array:
    """Return T(phi), eq. (3), from the axes; phi may be complex."""
    i, j, k = axes_of(sequence)
    X = np.eye(3)

    def turned(axis: int, angle: float, v: Array) -> Array:
        n = X[axis]
        along = n * v[axis]
        return along + np.cos(angle) * (v - along) + np.sin(angle) * np.cross(n, v)

    t_2 = turned(i, phi[0], X[j])
    t_3 = turned(i, phi[0], turned(j, phi[1], X[k]))
    return np.stack([X[i] + 0 * t_2, t_2, t_3], axis=1)


def dT_of(sequence: str, phi: Array, dphi: Array) -> Array:
    """Return the derivative of T along dphi, by a complex step: exact, nothing is subtracted."""
    return T_of(sequence, phi + 1e-30j * dphi).imag / 1e-30


def angle_rates(sequence: str, phi: Array, omega: Array, domega: Array) -> tuple[Array, Array]:
    """Return dphi and ddphi of eq. (3) and its derivative, domega = T ddphi + dT dphi."""
    T = T_of(sequence, phi)
    dphi = np.linalg.solve(T, omega)
    return dphi, np.linalg.solve(T, domega - dT_of(sequence, phi, dphi) @ dphi)


@cache
def near_pole(sequence: str, pole: float, distance: float, count: int = 20) -> list[Array]:
    """Return rotations at that distance [rad] from a pole; at 0 the pole is met exactly."""
    i, j, k = axes_of(sequence)
    R_j = np.rint(about(j, pole)) @ (about(j, distance) if distance else np.eye(3))
    pairs = generator(4).uniform(-math.pi, math.pi, size=(count, 2))
    return [about(i, alpha) @ R_j @ about(k, gamma) for alpha, gamma in pairs]


def pole_clearance(sequence: str, R: Array) -> float:
    """Return the angle [rad] between the first and the last axis of rotation, from 0 to pi/2."""
    i, _, k = axes_of(sequence)
    return math.atan2(np.linalg.norm(np.cross(np.eye(3)[i], R[:, k])), abs(R[i, k]))


@cache
def clear_of_poles(sequence: str, count: int, key: int = 0) -> list[Array]:
    """Return uniform rotations that keep POLE_CLEARANCE from both poles."""
    candidates = uniform(4 * count, key)
    clear = [R for R in candidates if pole_clearance(sequence, R) > POLE_CLEARANCE]
    return clear[:count]


def pairs_apart(theta: float, count: int, key: int = 0) -> list[tuple[Array, Array]]:
    """Return pairs (R_d, R_e) of frames that are theta [rad] apart, about any axis."""
    turns = [rodrigues(theta, r) for r in unit_vectors(count, key)]
    return [(turn @ R_e, R_e) for turn, R_e in zip(turns, uniform(count, key), strict=True)]


def turning(R: Array, omega: Array) -> Callable[[float], Array]:
    """Return the frame t -> R(t) that turns at omega (3,) [rad/s] and is R at t = 0."""
    speed = float(np.linalg.norm(omega))
    axis = omega / speed if speed else omega
    return lambda t: rodrigues(speed * t, axis) @ R


def derivative(function: Callable[[float], Array]) -> Array:
    """Return the derivative of a function of time at t = 0, by central differences."""
    return (function(STEP) - function(-STEP)) / (2 * STEP)


def positive_definite(count: int, key: int = 0, least: float = 0.5, most: float = 5) -> list[Array]:
    """Return symmetric matrices (3, 3) with eigenvalues between two numbers, along any axes."""
    values = generator(5, key).uniform(least, most, size=(count, 3))
    return [(U * v) @ U.T for U, v in zip(uniform(count, 500 + key), values, strict=True)]


def k_star_axes() -> Array:
    """Return the axes u_1, u_2, u_3 (3, 3), columns, of the stiffness K*."""
    turn = np.array(K_STAR_TURN)
    theta = float(np.linalg.norm(turn))
    return rodrigues(theta, turn / theta)


Moving = tuple[Array, Array, Array, Array, Array, Array]


def moving(key: int = 0, R_0: Array | None = None) -> Callable[[float], Moving]:
    """Return a smooth motion t -> (p, R, dp, omega, ddp, domega) of a frame, base axes.

    R = exp(alpha n) R_0 exp(beta m) with alpha, beta (t) and fixed axes n, m, so that all
    derivatives are exact: omega = dalpha n + dbeta R m.
    """
    random = generator(6, key)
    n, m = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
    size, rate, phase = random.uniform(0.5, 1.5, size=(3, 5))  # of p, alpha, beta
    start = uniform(1, 600 + key)[0] if R_0 is None else R_0

    def at(t: float) -> Moving:
        value = size * np.sin(rate * t + phase)
        first = size * rate * np.cos(rate * t + phase)
        second = -(rate**2) * value
        R = rodrigues(value[3], n) @ start @ rodrigues(value[4], m)
        axis = R @ m
        omega = first[3] * n + first[4] * axis
        domega = second[3] * n + second[4] * axis + first[4] * np.cross(omega, axis)
        return value[:3], R, first[:3], omega, second[:3], domega

    return at
