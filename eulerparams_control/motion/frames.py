"""Frames: where one is seen from another, and the desired frame with its derivatives.

Notation: ``p_d`` (3,) [m], ``R_d`` (3, 3), ``dp_d, omega_d`` [m/s, rad/s], ``ddp_d,
domega_d`` [m/s^2, rad/s^2], all in the base frame, of the tip.
"""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws._old.compiled import Array, Input, Inputs, formula, kernel, layout
from eulerparams_control.laws._old.linear import MatLike, Vec, VecLike, cross, mat, norm, vec
from eulerparams_control.laws._old.rotations import angle_between, exp

_ZERO = np.zeros(3)
_ZERO.setflags(write=False)


class Placement(NamedTuple):
    """Where a frame is, seen from another that carries it.

    Attributes:
        R: (3, 3) its orientation.
        p: (3,) [m] its origin.
    """

    R: MatLike
    p: VecLike

    @property
    def row(self) -> Array:
        """The placement as a row (12,)."""
        return np.concatenate(self, axis=None)

    @property
    def inverse(self) -> "Placement":
        """Where the other is, seen from this one."""
        if self is AT_ORIGIN:
            return self
        return Placement(self.R.T, -self.R.T @ self.p)


AT_ORIGIN = Placement(np.eye(3), np.zeros(3))
"""The placement of a frame in itself."""


class DesiredFrame(NamedTuple):
    """The desired frame at one instant, base frame.

    Attributes:
        p_d: (3,) [m].
        R_d: (3, 3).
        dp_d, omega_d: (3,) [m/s], [rad/s].
        ddp_d, domega_d: (3,) [m/s^2], [rad/s^2].
    """

    p_d: VecLike
    R_d: MatLike
    dp_d: VecLike = _ZERO
    omega_d: VecLike = _ZERO
    ddp_d: VecLike = _ZERO
    domega_d: VecLike = _ZERO

    @classmethod
    def of(cls, row: Array) -> "DesiredFrame":
        """Return the frame that lies in a row (24,).

        Raises:
            SingularityError: if its rotation is not finite.
        """
        if math.isnan(row[3]):
            raise SingularityError("the rotation of the desired frame is not finite")
        R_d = row[3:12].reshape(3, 3)
        return cls(row[:3], R_d, row[12:15], row[15:18], row[18:21], row[21:])

    @property
    def row(self) -> Array:
        """The frame as a row (24,)."""
        return np.concatenate(self, axis=None)

    @property
    def _is_still(self) -> bool:
        """Whether it is known to be at rest."""
        return self.dp_d is self.omega_d is self.ddp_d is self.domega_d is _ZERO

    def carrying(self, point: Placement) -> "DesiredFrame":
        """Return the frame that this one carries rigidly at ``point``, with its motion."""
        if point is AT_ORIGIN:
            return self
        return DesiredFrame.of(carried.row(*self, *point))

    def at_pace(self, s: float, ds: float) -> "DesiredFrame":
        """Return the frame of a motion whose time runs s times as fast, ds [1/s] the rate of s."""
        if (s == 1.0 and ds == 0.0) or self._is_still:
            return self
        return DesiredFrame.of(at_pace.row(*self, s, ds))

    def moved(self, dt: float) -> "DesiredFrame":
        """Return the frame dt [s] later, at constant acceleration.

        Raises:
            SingularityError: if its rotation is not finite.
        """
        return self if self._is_still else DesiredFrame.of(moved.row(*self, dt))

    def at_rest(self) -> "DesiredFrame":
        """Return the same pose without velocity and acceleration."""
        return self if self._is_still else DesiredFrame(self.p_d, self.R_d)


read_frame, put_frame = layout(DesiredFrame)[1:3]


@kernel
def frame_of(
    p: Input, R: Inputs, dp: Input, omega: Input, ddp: Input, domega: Input
) -> DesiredFrame:
    """Return the frame of formulas whose parts are arrays."""
    return DesiredFrame(vec(p), mat(R), vec(dp), vec(omega), vec(ddp), vec(domega))


@formula
def carried(frame: DesiredFrame, point: Placement) -> DesiredFrame:
    """Return the frame that a frame carries rigidly at a point, with its motion."""
    r = frame.R_d @ point.p
    turning = cross(frame.omega_d, r)
    return DesiredFrame(
        frame.p_d + r,
        frame.R_d @ point.R,
        frame.dp_d + turning,
        frame.omega_d,
        frame.ddp_d + cross(frame.domega_d, r) + cross(frame.omega_d, turning),
        frame.domega_d,
    )


@formula
def at_pace(frame: DesiredFrame, s: float, ds: float) -> DesiredFrame:
    """Return the frame of a motion whose time runs s times as fast, ds [1/s] the rate of s."""
    return DesiredFrame(
        frame.p_d,
        frame.R_d,
        s * frame.dp_d,
        s * frame.omega_d,
        s * s * frame.ddp_d + ds * frame.dp_d,
        s * s * frame.domega_d + ds * frame.omega_d,
    )


@formula
def moved(frame: DesiredFrame, dt: float) -> DesiredFrame:
    """Return the frame dt [s] later, at constant acceleration."""
    ddp_d, domega_d = dt * frame.ddp_d, dt * frame.domega_d
    return DesiredFrame(
        frame.p_d + dt * (frame.dp_d + 0.5 * ddp_d),
        exp(with_an_angle(dt * (frame.omega_d + 0.5 * domega_d))) @ frame.R_d,
        frame.dp_d + ddp_d,
        frame.omega_d + domega_d,
        frame.ddp_d,
        frame.domega_d,
    )


@formula
def with_an_angle(x: Vec) -> Vec:
    """Return the rotation vector x [rad]; NaN if it has no angle."""
    return x if math.isfinite(x @ x) else Vec(math.nan, math.nan, math.nan)


class Ways(NamedTuple):
    """How far two frames are apart, of the point and of the turning: [m, rad], rates and so on."""

    poses: tuple[float, float]
    rates: tuple[float, float]
    accelerations: tuple[float, float]


@formula
def apart(here: DesiredFrame, there: DesiredFrame) -> Ways:
    """Return how far two frames are apart."""
    return Ways(
        (norm(there.p_d - here.p_d), angle_between(there.R_d, here.R_d)),
        (norm(there.dp_d - here.dp_d), norm(there.omega_d - here.omega_d)),
        (norm(there.ddp_d - here.ddp_d), norm(there.domega_d - here.domega_d)),
    )


def carried_row(row: Array, point: Array) -> Array:
    """Return the frame (24,) that one in a row (24,) carries at a :attr:`Placement.row`."""
    return carried.rows(np.concatenate((row, point))[None])[0]


for _formula in (carried, at_pace, moved, apart):
    _formula.prepare()


def distance(here: DesiredFrame, there: DesiredFrame) -> tuple[float, float]:
    """Return how far [m] a frame is from another, and by which angle [rad] it is turned."""
    way, angle = apart.row(*here, *there)[:2].tolist()
    return way, angle
