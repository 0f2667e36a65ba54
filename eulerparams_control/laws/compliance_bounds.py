"""Bounds on how far, and how fast, the compliant frame goes from the desired one.

Notation: ``x`` (3,) [m] p_c - p_d, or [rad] theta r of R_c R_d', ``v`` [m/s, rad/s] the velocity
of the compliant relative to the desired frame, both in the base frame.  Towards the bound X of
|x| the velocity is at most r (X - |x|): the bound is reached without overshoot, and v is
continuous.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Vec, VecLike, norm
from eulerparams_control.laws._old.rotations import exp, log
from eulerparams_control.laws.limits import POSITION_RATE
from eulerparams_control.motion.frames import DesiredFrame


class Most(NamedTuple):
    """The bounds as the formulas take them; infinite where there is none."""

    position: float
    rotation: float
    speed: float


class BoundedVelocity(NamedTuple):
    """A velocity v (3,) within its bounds, and whether it is less than was asked for."""

    v: VecLike
    is_less: bool


class Bounded(NamedTuple):
    """A compliant frame within the bounds, and whether it had to change."""

    frame: DesiredFrame
    has_changed: bool


@dataclass(frozen=True)
class ComplianceBounds:
    """Bounds on the compliant relative to the desired frame.

    Attributes:
        position: [m] of the displacement.
        rotation: [rad] of the displacement; pi or more: none.
        speed: [m/s], and [rad/s], of the one relative to the other.

    Raises:
        ConfigurationError: if one is not positive.
    """

    position: float = math.inf
    rotation: float = math.inf
    speed: float = math.inf

    def __post_init__(self) -> None:
        for name in ("position", "rotation", "speed"):
            if not getattr(self, name) > 0:
                raise ConfigurationError(f"{name} is {getattr(self, name)}; expected > 0")

    @property
    def values(self) -> Most:
        """The bounds as the formulas take them."""
        rotation = self.rotation if self.rotation < math.pi else math.inf
        return Most(self.position, rotation, self.speed)


@formula
def bounded(
    frame: DesiredFrame, desired: DesiredFrame, before: DesiredFrame, v_p: Vec, v_o: Vec,
    most: Most, dt: float,
) -> Bounded:  # fmt: skip
    """Return the compliant frame within the bounds.

    Args:
        frame: the compliant frame as the impedance has it now.
        desired: the desired frame now.
        before: the compliant frame dt ago.
        v_p, v_o: of the compliant relative to the desired frame, dt ago.
        most: the bounds.
        dt: positive [s].
    """
    p_c, R_c, dp_c, omega_c, ddp_c, domega_c = frame
    linear = kept(p_c - desired.p_d, dp_c - desired.dp_d, v_p, most.position, most.speed, dt)
    if linear.is_less:
        dp_c = desired.dp_d + linear.v
        p_c = before.p_d + (dt / 2.0) * (before.dp_d + dp_c)
        ddp_c = (dp_c - before.dp_d) / dt
    x = log(R_c @ desired.R_d.T)
    angular = kept(x, omega_c - desired.omega_d, v_o, most.rotation, most.speed, dt)
    if angular.is_less:
        omega_c = desired.omega_d + angular.v
        R_c = exp((dt / 2.0) * (before.omega_d + omega_c)) @ before.R_d
        domega_c = (omega_c - before.omega_d) / dt
    kept_frame = DesiredFrame(p_c, R_c, dp_c, omega_c, ddp_c, domega_c)
    return Bounded(kept_frame, linear.is_less or angular.is_less)


@formula
def kept(x: Vec, v: Vec, v_before: Vec, most: float, speed: float, dt: float) -> BoundedVelocity:
    """Return the velocity v within the bounds at the displacement x."""
    rate = min(POSITION_RATE, 1.0 / dt)
    slower = rate * speed * dt  # by no more, where a bound was lowered
    size, distance = norm(v), norm(x)
    fastest = max(speed, norm(v_before) - slower)
    is_less = size > fastest
    if is_less:
        v = (fastest / size) * v
    if distance > 0.0:
        away = x / distance
        allowed = max(rate * (most - distance), max(-speed, v_before @ away - slower))
        excess = v @ away - allowed
        if excess > 0.0:
            v, is_less = v - excess * away, True
    return BoundedVelocity(v, is_less)
