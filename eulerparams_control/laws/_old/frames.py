"""Frames and limits of the tip as rows of floats and as values of formulas."""

import math
from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws._old.compiled import Array, Input, Inputs, kernel, layout
from eulerparams_control.laws._old.linear import MatLike, VecLike, mat, vec
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits


def row_of(frame: DesiredFrame) -> Array:
    """Return a frame as a row (24,)."""
    return np.concatenate(frame, axis=None)


def frame_of_row(row: Array) -> DesiredFrame:
    """Return the frame that lies in a row (24,).

    Raises:
        SingularityError: if its rotation is not finite.
    """
    if math.isnan(row[3]):
        raise SingularityError("the rotation of the desired frame is not finite")
    R_d = row[3:12].reshape(3, 3)
    return DesiredFrame(row[:3], R_d, row[12:15], row[15:18], row[18:21], row[21:])


class Frame(NamedTuple):
    """A desired frame as formulas take it."""

    p_d: VecLike
    R_d: MatLike
    dp_d: VecLike
    omega_d: VecLike
    ddp_d: VecLike
    domega_d: VecLike


read_frame = layout(Frame).read


@kernel
def frame_of(p: Input, R: Inputs, dp: Input, omega: Input, ddp: Input, domega: Input) -> Frame:
    """Return the frame of formulas whose parts are arrays."""
    return Frame(vec(p), mat(R), vec(dp), vec(omega), vec(ddp), vec(domega))


class TipLimits(NamedTuple):
    """Limits of the motion of the tip as formulas take them."""

    linear_speed: float
    angular_speed: float
    linear_acceleration: float
    angular_acceleration: float
    linear_jerk: float
    angular_jerk: float


UNBOUNDED = TipLimits(*astuple(MotionLimits()))


def limits_row(motion: MotionLimits | None) -> Array:
    """Return limits of the motion of the tip as a row, in the order of their attributes."""
    return np.array(astuple(motion or MotionLimits()))


@kernel
def approach(e: float, k: float, speed: float, a: float) -> float:
    """Return how fast to go to what is e away; see :meth:`MotionLimits.approach`."""
    return min(speed, math.sqrt(2.0 * a * e - a / k * (a / k))) if k * k * e > a else speed
