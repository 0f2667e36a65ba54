"""Frames: where one is seen from another, and the desired frame with its derivatives.

Notation: ``p_d`` (3,) [m], ``R_d`` (3, 3), ``dp_d, omega_d`` [m/s, rad/s], ``ddp_d,
domega_d`` [m/s^2, rad/s^2], all in the base frame, of the tip.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError
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
from eulerparams_control.laws.rotations import (
    angle_between,
    cross,
    dot,
    exp,
    log,
    norm,
    product,
    turn,
)

_ZERO = np.zeros(3)
_ZERO.setflags(write=False)

# Deviation from its extrapolated motion [m, rad; m/s, rad/s] from which a desired frame has jumped.
_JUMP, _VELOCITY_JUMP = 1e-5, 1e-2


class Placement(NamedTuple):
    """Where a frame is, seen from another that carries it.

    Attributes:
        R: (3, 3) its orientation.
        p: (3,) [m] its origin.
    """

    R: Array
    p: Array

    @property
    def inverse(self) -> "Placement":
        """Where the other is, seen from this one."""
        if self is AT_ORIGIN:
            return self
        return Placement(self.R.T, -self.R.T @ self.p)


AT_ORIGIN = Placement(np.eye(3), np.zeros(3))
"""The placement of a frame in itself."""


class DesiredFrame(NamedTuple):
    """The desired frame at one instant, base frame; all are arrays of float64.

    Attributes:
        p_d: (3,) [m].
        R_d: (3, 3).
        dp_d, omega_d: (3,) [m/s], [rad/s].
        ddp_d, domega_d: (3,) [m/s^2], [rad/s^2].
    """

    p_d: Array
    R_d: Array
    dp_d: Array = _ZERO
    omega_d: Array = _ZERO
    ddp_d: Array = _ZERO
    domega_d: Array = _ZERO

    @property
    def moves(self) -> bool:
        """Whether it has a twist."""
        return bool(self.dp_d.any() or self.omega_d.any())

    @property
    def _is_still(self) -> bool:
        """Whether it is known to be at rest."""
        return self.dp_d is self.omega_d is self.ddp_d is self.domega_d is _ZERO

    def carrying(self, point: Placement) -> "DesiredFrame":
        """Return the frame that this one carries rigidly at ``point``, with its motion."""
        return self if point is AT_ORIGIN else DesiredFrame(*carried(*self, *point))

    def at_pace(self, s: float, ds: float) -> "DesiredFrame":
        """Return the frame of a motion whose time runs s times as fast, ds [1/s] the rate of s."""
        if (s == 1.0 and ds == 0.0) or self._is_still:
            return self
        ddp_d = s * s * self.ddp_d + ds * self.dp_d
        domega_d = s * s * self.domega_d + ds * self.omega_d
        return DesiredFrame(self.p_d, self.R_d, s * self.dp_d, s * self.omega_d, ddp_d, domega_d)

    def moved(self, dt: float) -> "DesiredFrame":
        """Return the frame dt [s] later, at constant acceleration.

        Raises:
            SingularityError: if its rotation is not finite.
        """
        return self if self._is_still else finite(DesiredFrame(*moved(*self, dt)))

    def at_rest(self) -> "DesiredFrame":
        """Return the same pose without velocity and acceleration."""
        return self if self._is_still else DesiredFrame(self.p_d, self.R_d)


six_arrays = types.Tuple((new_vector, new_matrix, *(new_vector,) * 4))
"""The parts of a frame, as a primitive returns them."""


@jit(six_arrays(vector, matrix, vector, vector, vector, vector, matrix, vector))
def carried(
    p: Array, R: Array, dp: Array, omega: Array, ddp: Array, domega: Array, R_c: Array, p_c: Array
) -> tuple[Array, ...]:
    """Return the frame that a frame carries rigidly at R_c, p_c, with its motion."""
    r = turn(R, p_c)
    v = cross(omega, r)
    a = cross(domega, r) + cross(omega, v)
    return p + r, product(R, R_c), dp + v, omega.copy(), ddp + a, domega.copy()


@jit(new_vector(vector))
def with_an_angle(x: Array) -> Array:
    """Return the rotation vector x (3,) [rad]; NaN if it has no angle."""
    return x.copy() if math.isfinite(dot(x, x)) else np.full(3, math.nan)


@jit(six_arrays(vector, matrix, vector, vector, vector, vector, f8))
def moved(
    p: Array, R: Array, dp: Array, omega: Array, ddp: Array, domega: Array, dt: float
) -> tuple[Array, ...]:
    """Return a frame dt [s] later, at constant acceleration."""
    dv, dw = dt * ddp, dt * domega
    R = product(exp(with_an_angle(dt * (omega + 0.5 * dw))), R)
    return p + dt * (dp + 0.5 * dv), R, dp + dv, omega + dw, ddp.copy(), domega.copy()


def finite(frame: DesiredFrame) -> DesiredFrame:
    """Return a frame whose rotation is finite.

    Raises:
        SingularityError: if it is not.
    """
    if math.isnan(frame.R_d[0, 0]):
        raise SingularityError("the rotation of the desired frame is not finite")
    return frame


def stacked(frames: Iterable[DesiredFrame]) -> DesiredFrame:
    """Return N frames as one, its fields stacked: (N, 3), and (N, 3, 3) of R_d."""
    return DesiredFrame(*(np.array(parts) for parts in zip(*frames, strict=True)))


def distance(here: DesiredFrame, there: DesiredFrame) -> tuple[float, float]:
    """Return how far [m] a frame is from another, and by which angle [rad] it is turned."""
    return norm(there.p_d - here.p_d), angle_between(there.R_d, here.R_d)


def apart(here: DesiredFrame, there: DesiredFrame) -> tuple[float, ...]:
    """Return how far two frames are apart: poses, rates, accelerations.

    Each of the point and of the turning: [m, rad], [m/s, rad/s], [m/s^2, rad/s^2].
    """
    rates = zip(here[2:], there[2:], strict=True)
    return *distance(here, there), *(norm(after - before) for before, after in rates)


@jit(types.UniTuple(f8, 2)(vector, vector, vector, vector, vector, f8))
def _mismatch(
    d: Array, v_0: Array, a_0: Array, v_1: Array, a_1: Array, dt: float
) -> tuple[float, float]:
    """Return by how much a way d (3,), and a change of velocity, are not those of the motion.

    That is by the trapezoidal rule with its first correction.
    """
    half, bend, way, change = dt / 2.0, dt * dt / 12.0, 0.0, 0.0
    for i in range(3):
        led = half * (v_0[i] + v_1[i]) - bend * (a_1[i] - a_0[i])
        way = max(way, abs(d[i] - led))
        change = max(change, abs(v_1[i] - v_0[i] - half * (a_0[i] + a_1[i])))
    return way, change


def jumped(before: DesiredFrame, now: DesiredFrame, dt: float) -> bool:
    """Return whether the desired frame is not where, or as fast as, its motion led."""
    p_0, R_0, dp_0, omega_0, ddp_0, domega_0 = before
    p_1, R_1, dp_1, omega_1, ddp_1, domega_1 = now
    way, dv = _mismatch(p_1 - p_0, dp_0, ddp_0, dp_1, ddp_1, dt)
    turn, domega = _mismatch(log(R_1 @ R_0.T), omega_0, domega_0, omega_1, domega_1, dt)
    return not (max(way, turn) <= _JUMP and max(dv, domega) <= _VELOCITY_JUMP)
