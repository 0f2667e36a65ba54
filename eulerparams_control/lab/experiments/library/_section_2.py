"""The residuals of (1)-(17): what is left of each equation for a random sample."""

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from eulerparams_control.lab.experiments.library._samples import (
    angle_axis,
    derivative,
    generator,
    rotations,
    size,
    turning,
    vectors,
)
from eulerparams_control.laws.orientation import SEQUENCES, EulerSequence
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    R_angle_axis,
    S,
    exp,
    mutual,
    mutual_R,
    propagation,
)

SAMPLES = 2000
_CLEAR = 0.3  # [rad] from the pole: derivatives of the angles grow like 1 / distance^3

Residuals = Iterator[tuple[str, float]]


def one_frame() -> Residuals:
    """Yield the residuals of (1), (4)-(10) for a frame that turns."""
    omegas, thetas = vectors(SAMPLES, 1), generator(2).uniform(0.5, 2.6, SAMPLES)
    for R, omega, theta in zip(rotations(SAMPLES, 0), omegas, thetas.tolist(), strict=True):
        R_of = turning(R, omega)
        yield "(1)", size(derivative(R_of) - S(omega) @ R)
        yield from _angle_axis(theta, omega / np.linalg.norm(omega))
        Q = EulerParameters.from_R(R)
        yield "(6)", size(Q.eta**2 + Q.eps @ Q.eps - 1)
        yield "(7)", size(Q.R - R)
        printed = (Q.eta**2 - Q.eps @ Q.eps) * np.eye(3) + 2 * np.outer(Q.eps, Q.eps)
        printed = printed - 2 * Q.eta * S(Q.eps)
        yield "(7) as printed", size(printed - R)
        yield "(7) as printed, from R'", size(printed - R.T)
        yield from _propagation(Q, R_of, omega, ("(8)", "(9)"))
        yield "(10)", size(Q.E - (Q.eta * np.eye(3) - S(Q.eps)))


def _angle_axis(theta: float, r: Array) -> Residuals:
    R = angle_axis(theta, r)
    yield "(4)", size(R_angle_axis(theta, r) - R)
    printed = math.cos(theta) * np.eye(3) + (1 - math.cos(theta)) * np.outer(r, r)
    printed = printed - math.sin(theta) * S(r)
    yield "(4) as printed", size(printed - R)
    yield "(4) as printed, from R'", size(printed - R.T)
    Q = EulerParameters.from_angle_axis(theta, r)
    there = Q.eta - math.cos(theta / 2), *(Q.eps - math.sin(theta / 2) * r)
    yield "(5)", max(size(Q.R - R), size(np.array(there)))


def _propagation(
    Q: EulerParameters, R_of: Callable[[float], Array], omega: Array, names: tuple[str, str]
) -> Residuals:
    """Yield the residuals of the rates of eta and eps of R_of(t), whose rate is S(omega) R."""

    def along(t: float) -> Array:
        """Return (eta, eps) at t, of the sign of Q."""
        there = EulerParameters.from_R(R_of(t))
        same = 1.0 if there.eta * Q.eta + there.eps @ Q.eps > 0 else -1.0
        return same * np.array([there.eta, *there.eps])

    rate = derivative(along)
    deta, deps = propagation(Q, omega)
    yield names[0], size(rate[0] - deta)
    yield names[1], size(rate[1:] - deps)


def angles() -> Residuals:
    """Yield the residuals of (2) and (3) for each of the 12 sequences."""
    for key, name in enumerate(SEQUENCES):
        sequence = EulerSequence(name)
        omegas = vectors(SAMPLES, 100 + key)
        for R, omega in zip(rotations(SAMPLES, 200 + key), omegas, strict=True):
            phi = sequence.extract(R)
            turns = phi[:, None] * np.eye(3)[list(sequence.axes)]
            product = exp(turns[0]) @ exp(turns[1]) @ exp(turns[2])
            yield "(2)", max(size(product - R), size(sequence.R(phi) - R))
            if sequence.pole_distance(R) > _CLEAR:
                dphi = derivative(partial(_angles, sequence, turning(R, omega), phi))
                yield "(3)", size(sequence.T(phi) @ dphi - omega)


def _angles(sequence: EulerSequence, R_of: Callable[[float], Array], phi: Array, t: float) -> Array:
    """Return the angles of a frame at t, moved by whole turns next to those at t = 0."""
    there = sequence.extract(R_of(t))
    return there - 2 * np.pi * np.round((there - phi) / (2 * np.pi))


def two_frames() -> Residuals:
    """Yield the residuals of (11)-(17) for two frames that turn."""
    moving = zip(vectors(SAMPLES, 3), vectors(SAMPLES, 4), strict=True)
    frames = zip(rotations(SAMPLES, 5), rotations(SAMPLES, 6), strict=True)
    for (R_1, R_2), (omega_1, omega_2) in zip(frames, moving, strict=True):
        Q_1, Q_2 = EulerParameters.from_R(R_1), EulerParameters.from_R(R_2)
        Q_21, R_21 = mutual(Q_1, Q_2), R_1.T @ R_2
        yield "(11)", size(mutual_R(R_1, R_2).R - R_21)
        sign = 1.0 if Q_21.eta * mutual_R(R_1, R_2).eta >= 0 else -1.0
        yield "(12)", size(sign * Q_21.eta - mutual_R(R_1, R_2).eta)
        yield "(13)", size(sign * Q_21.eps - mutual_R(R_1, R_2).eps)
        yield "(13) in both frames", size(Q_21.eps - R_21 @ Q_21.eps)
        relative = R_1.T @ (omega_2 - omega_1)
        R_of = partial(_mutual, turning(R_1, omega_1), turning(R_2, omega_2))
        yield "(14)", size(derivative(R_of) - S(relative) @ R_21)
        yield "(15)", size(R_1.T @ omega_2 - R_1.T @ omega_1 - relative)
        yield from _propagation(Q_21, R_of, relative, ("(16)", "(17)"))


def _mutual(one: Callable[[float], Array], two: Callable[[float], Array], t: float) -> Array:
    """Return R_21 (3, 3) of two frames that move, eq. (11)."""
    return one(t).T @ two(t)
