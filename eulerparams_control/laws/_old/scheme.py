"""What the laws of formulas share: places in the row of a tick, and bounds of the tip."""

import math
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.chain import arm_width
from eulerparams_control.laws._old.compiled import Input, Inputs, entry, kernel, layout
from eulerparams_control.laws._old.frames import Frame, TipLimits, frame_of, limits_row
from eulerparams_control.laws._old.linear import Mat, Vec, mat, norm, vec
from eulerparams_control.laws._old.rotations import Array, angle_between
from eulerparams_control.motion.motion_limits import MotionLimits


class TipBounds(NamedTuple):
    """Errors of the tip at which the motion is stopped, and its limits, as formulas take them."""

    position: float
    rotation: float
    limits: TipLimits


read_bounds = layout(TipBounds).read

FAR, TURNED = -1, -2
"""Error of a tip beyond the bounds of its errors."""


@kernel
def too_far(desired: Frame, p_e: Vec, R_e: Mat, bounds: TipBounds) -> int:
    """Return FAR, TURNED, or 0 where the tip is within these errors of the desired frame."""
    if norm(desired.p_d - p_e) > bounds.position:
        return FAR
    return TURNED if angle_between(desired.R_d, R_e) > bounds.rotation else 0


@entry
def is_too_far(
    p_d: Input, R_d: Inputs, dp_d: Input, omega_d: Input, ddp_d: Input, domega_d: Input,
    p_e: Input, R_e: Inputs, bounds: Input,
) -> int:  # fmt: skip
    """Return what ``too_far`` does; ``bounds`` is :func:`bounds_row`."""
    desired = frame_of(p_d, R_d, dp_d, omega_d, ddp_d, domega_d)
    return too_far(desired, vec(p_e), mat(R_e), read_bounds(bounds, 0))


@kernel
def tick_places(n: int) -> tuple[int, int, int, int]:
    """Return what is where in the row of a tick, behind that of the arm.

    That is the excess, the two rows (n,) of the command, and x_de.
    """
    at = arm_width(n)
    return at, at + 1, at + 1 + n, at + 1 + 2 * n


def bounds_row(position: float, rotation: float, motion: MotionLimits | None) -> Array:
    """Return them with the limits of the tip, if there are any, as :class:`TipBounds`."""
    return np.array([position, rotation, *limits_row(motion)])


def check_gains(law: object, *names: str) -> None:
    """Raise ConfigurationError unless these gains of a law are finite and 0 or more."""
    for name in names:
        if not 0 <= getattr(law, name) < math.inf:
            raise ConfigurationError(f"{name} is {getattr(law, name)}; expected >= 0")
