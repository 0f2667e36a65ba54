"""Frames: where one is seen from another, and the desired frame with its derivatives.

Notation: ``p_d`` (3,) [m], ``R_d`` (3, 3), ``dp_d, omega_d`` [m/s, rad/s], ``ddp_d,
domega_d`` [m/s^2, rad/s^2], all in the base frame, of the tip.
"""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws.compiled import Array, formula
from eulerparams_control.laws.linear import MatLike, VecLike
from eulerparams_control.laws.rotations import angle_between, cross, exp

_ZERO = np.zeros(3)
_ZERO.setflags(write=False)


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

    def carrying(self, point: Placement) -> "DesiredFrame":
        """Return the frame that this one carries rigidly at ``point``, with its motion."""
        if point is AT_ORIGIN:
            return self
        r = self.R_d @ point.p
        turning = cross(self.omega_d, r)
        return DesiredFrame(
            self.p_d + r,
            self.R_d @ point.R,
            self.dp_d + turning,
            self.omega_d,
            self.ddp_d + cross(self.domega_d, r) + cross(self.omega_d, turning),
            self.domega_d,
        )

    def at_pace(self, s: float, ds: float) -> "DesiredFrame":
        """Return the frame of a motion whose time runs s times as fast, ds [1/s] the rate of s."""
        if s == 1.0 and ds == 0.0:
            return self
        return self._replace(
            dp_d=s * self.dp_d,
            omega_d=s * self.omega_d,
            ddp_d=s**2 * self.ddp_d + ds * self.dp_d,
            domega_d=s**2 * self.domega_d + ds * self.omega_d,
        )

    def moved(self, dt: float) -> "DesiredFrame":
        """Return the frame dt [s] later, at constant acceleration.

        Raises:
            SingularityError: if its rotation is not finite.
        """
        ddp_d, domega_d = dt * self.ddp_d, dt * self.domega_d
        turn = dt * (self.omega_d + domega_d / 2)
        return self._replace(
            p_d=self.p_d + dt * (self.dp_d + ddp_d / 2),
            R_d=exp(with_an_angle(turn)) @ self.R_d,
            dp_d=self.dp_d + ddp_d,
            omega_d=self.omega_d + domega_d,
        )

    def at_rest(self) -> "DesiredFrame":
        """Return the same pose without velocity and acceleration."""
        return DesiredFrame(self.p_d, self.R_d)


@formula
def moved(frame: DesiredFrame, dt: float) -> DesiredFrame:
    """Return a frame dt [s] later, at constant acceleration."""
    p_d, R_d, dp_d, omega_d, ddp_d, domega_d = frame
    return DesiredFrame(
        p_d + dt * (dp_d + (dt / 2.0) * ddp_d),
        exp(dt * (omega_d + (dt / 2.0) * domega_d)) @ R_d,
        dp_d + dt * ddp_d,
        omega_d + dt * domega_d,
        ddp_d,
        domega_d,
    )


def with_an_angle(x: Array) -> Array:
    """Return the rotation vector x (3,) [rad], or raise SingularityError if it has no angle."""
    if not math.isfinite(x @ x):
        raise SingularityError(f"the rotation of the desired frame is not finite: {x.tolist()} rad")
    return x


def distance(here: DesiredFrame, there: DesiredFrame) -> tuple[float, float]:
    """Return how far [m] a frame is from another, and by which angle [rad] it is turned."""
    way = there.p_d - here.p_d
    return math.sqrt(way @ way), angle_between(there.R_d, here.R_d)
