"""Mass and centre of mass of a tool, and the bias of its sensor, from poses at rest.

At rest a force/torque sensor measures, in its own axes and about its origin, what gravity
exerts on the tool beyond it, and its bias b:

    f = m g_s + b_f,    mu = c x (m g_s) + b_mu = -S(g_s) (m c) + b_mu,    g_s = R_s' g.

This is linear in {m, m c, b_f, b_mu}: ten numbers, of which each pose gives six equations.
Poses differ by g_s alone, the gravity that the sensor sees: a turn about the vertical tells
nothing, and two directions leave m c unknown along the line that joins them.

Notation: ``g`` (3,) gravity [m/s^2] in the axes of the root link, ``R_s`` (3, 3) orientation
of the sensor frame in those axes, ``c`` (3,) centre of mass [m] in the sensor frame.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eulerparams_control.errors import IdentificationError
from eulerparams_control.laws.rotations import Array, S

GRAVITY = (0.0, 0.0, -9.81)
"""The default gravity [m/s^2], in the axes of the root link."""

LEAST_POSES = 3
"""Two directions of gravity leave one of the ten numbers open."""

LEAST_SPREAD = math.radians(10.0)
"""Poses whose :func:`spread` [rad] is less are refused."""

_LEAST_MASS = 1e-3  # [kg] a mass that is smaller is no tool
_CERTAIN = 3.0  # standard deviations that a mass has to be from zero


class Identification(NamedTuple):
    """What a few poses say about the tool; standard deviations are of what is named.

    They come from the residuals, with 3 N - 4 (force) and 3 N - 6 (torque) degrees of freedom
    for N poses: of few poses they are rough.

    Attributes:
        mass: [kg] of all that is beyond the sensor.
        com: (3,) [m] its centre of mass, sensor frame.
        bias: (6,) [N, Nm] of the sensor, sensor frame: measured = true + bias.
        mass_std: [kg].
        com_std: (3,) [m].
        bias_std: (6,) [N, Nm].
        residual_force: (N,) [N] the force that is left unexplained in each pose.
        residual_torque: (N,) [Nm] the torque that is.
        spread: [rad] conditioning: how different the poses are, see :func:`spread`.
    """

    mass: float
    com: Array
    bias: Array
    mass_std: float
    com_std: Array
    bias_std: Array
    residual_force: Array
    residual_torque: Array
    spread: float


def identify(
    orientations: Sequence[ArrayLike], wrenches: Sequence[ArrayLike], gravity: ArrayLike = GRAVITY
) -> Identification:
    """Return what N wrenches measured at rest say about the tool, by least squares.

    Args:
        orientations: N times R_s (3, 3).
        wrenches: N times force and torque (6,) [N, Nm] that the environment exerts on the
            tool, sensor frame.
        gravity: (3,) [m/s^2] in the axes of the root link.

    Raises:
        IdentificationError: if sizes or numbers are impossible, if there are too few poses or
            too similar ones, or if the mass is not positive.
    """
    R, h, g = _checked(orientations, wrenches, gravity)
    g_s = np.einsum("nji,j->ni", R, g)
    angle = _sufficient_spread(g_s)
    A = _regressor(g_s)
    x, *_ = np.linalg.lstsq(A, h.ravel(), rcond=None)
    residual = (h.ravel() - A @ x).reshape(-1, 6)
    std = _standard_deviations(A, residual)
    mass, mass_std = float(x[0]), float(std[0])
    _refuse_mass(mass, mass_std)
    com = x[1:4] / mass
    return Identification(
        mass,
        com,
        x[4:],
        mass_std,
        np.hypot(std[1:4], com * mass_std) / mass,  # of the quotient m c / m
        std[4:],
        np.linalg.norm(residual[:, :3], axis=1),
        np.linalg.norm(residual[:, 3:], axis=1),
        angle,
    )


def spread(directions: ArrayLike) -> float:
    """Return how much directions of gravity (N, 3) differ, as an angle [rad].

    Three directions that are this angle apart, each from the others, tell as much as three very
    different ones of these.  It is 0 if there are no more than two directions.
    """
    d = np.asarray(directions, dtype=float).reshape(-1, 3)
    if len(d) < LEAST_POSES:
        return 0.0
    d = d / np.linalg.norm(d, axis=1)[:, None]
    first = d[np.argmax(np.linalg.norm(d - d[0], axis=1))]
    second = d[np.argmax(np.linalg.norm(d - first, axis=1))]
    chord = max(_chord(np.array([first, second, third])) for third in d)
    return 2 * math.asin(min(1.0, chord / 2))


def _chord(triangle: Array) -> float:
    """Return the side of the equilateral triangle that is as wide as a triangle (3, 3)."""
    centred = triangle - triangle.mean(axis=0)
    _, across, _ = np.linalg.svd(centred, compute_uv=False)
    return math.sqrt(2) * float(across)


def _checked(
    orientations: Sequence[ArrayLike], wrenches: Sequence[ArrayLike], gravity: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return R (N, 3, 3), h (N, 6), g (3,); raises IdentificationError."""
    R, h, g = (np.array(values, dtype=float) for values in (orientations, wrenches, gravity))
    n = len(orientations)
    if n < LEAST_POSES:
        raise IdentificationError(
            f"too few poses, {n}; expected at least {LEAST_POSES} in which the sensor sees gravity "
            "in directions that differ by 20 deg or more"
        )
    if R.shape != (n, 3, 3) or h.shape != (n, 6) or g.shape != (3,):
        raise IdentificationError(
            f"orientations, wrenches and gravity have the shapes {R.shape}, {h.shape}, {g.shape}; "
            f"expected {(n, 3, 3)}, {(n, 6)}, (3,)"
        )
    if not (np.isfinite(R).all() and np.isfinite(h).all() and np.isfinite(g).all() and g.any()):
        raise IdentificationError(
            "orientations, wrenches and gravity must be finite numbers, and gravity not zero"
        )
    return R, h, g


def _sufficient_spread(g_s: Array) -> float:
    """Return the spread [rad] of g_s (N, 3); raises IdentificationError if it is too small."""
    angle = spread(g_s)
    if angle < LEAST_SPREAD:
        raise IdentificationError(
            f"the {len(g_s)} poses are too similar: the most different ones tell no more than "
            f"three directions of gravity that are {math.degrees(angle):.1f} deg apart; expected "
            f"{math.degrees(LEAST_SPREAD):.0f} deg at least. Tilt the sensor by 20 deg or more "
            "about two of its axes; turns about the vertical tell nothing"
        )
    return angle


def _regressor(g_s: Array) -> Array:
    """Return A (6 N, 10) with A (m, m c, b_f, b_mu) = (f, mu) of the N poses."""
    A = np.zeros((len(g_s), 6, 10))
    A[:, :3, 0] = g_s
    A[:, 3:, 1:4] = [-S(g_i) for g_i in g_s]
    A[:, :, 4:] = np.eye(6)
    return A.reshape(-1, 10)


def _standard_deviations(A: Array, residual: Array) -> Array:
    """Return those of the unknowns (10,), from the residuals (N, 6).

    Forces tell m and b_f alone, torques m c and b_mu: no unknown is in both, so that each has
    the noise of its own.
    """
    n = len(residual)
    force = math.sqrt(np.sum(residual[:, :3] ** 2) / (3 * n - 4))
    torque = math.sqrt(np.sum(residual[:, 3:] ** 2) / (3 * n - 6))
    noise = np.repeat([force, torque, force, torque], [1, 3, 3, 3])
    std: Array = noise * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    return std


def _refuse_mass(mass: float, std: float) -> None:
    """Raise IdentificationError unless a mass [kg] is that of a tool."""
    doubt = max(_CERTAIN * std, _LEAST_MASS)
    if mass < -doubt:
        raise IdentificationError(
            f"the mass comes out negative, {mass:.4g} kg: the sensor reports what the tool exerts "
            "on the environment; set wrench_sign: -1 (or back to 1)"
        )
    if mass <= doubt:
        raise IdentificationError(
            f"the mass comes out as {mass:.4g} +- {std:.2g} kg, which is no tool; expected a "
            "weight beyond the sensor: does its driver compensate the payload already, or does the "
            "tool touch something?"
        )
