"""Bounds on how far, and how fast, the compliant frame goes from the desired one.

Notation: ``x`` (3,) [m] p_c - p_d, or [rad] theta r of R_c R_d', ``v`` [m/s, rad/s] the velocity
of the compliant relative to the desired frame, both in the base frame.  Towards the bound X of
|x| the velocity is at most r (X - |x|): the bound is reached without overshoot, and v is
continuous.
"""

import math

from eulerparams_control.laws.jit import b1, f8, jit, new_vector, vector
from eulerparams_control.laws.limits import POSITION_RATE
from eulerparams_control.laws.rotations import Array, dot, exp, log, norm
from eulerparams_control.motion.frames import DesiredFrame


def bounded(
    frame: DesiredFrame,
    desired: DesiredFrame,
    before: DesiredFrame,
    desired_before: DesiredFrame,
    dt: float,
    bounds: tuple[float, float, float],
) -> DesiredFrame:
    """Return the compliant frame within the bounds; itself where it is.

    Both frames were ``before`` dt > 0 [s] ago.  The bounds are X [m], X [rad], of pi or more for
    none, and the largest |v|.
    """
    p_c, R_c, dp_c, omega_c, ddp_c, domega_c = frame
    position, rotation, speed = bounds
    rotation = rotation if rotation < math.pi else math.inf
    x, v, v_0 = p_c - desired.p_d, dp_c - desired.dp_d, before.dp_d - desired_before.dp_d
    is_slower = _bound(x, v, v_0, position, speed, dt)
    if is_slower:
        dp_c = desired.dp_d + v
        p_c = before.p_d + (dt / 2.0) * (before.dp_d + dp_c)
        ddp_c = (dp_c - before.dp_d) / dt
    x, v = log(R_c @ desired.R_d.T), omega_c - desired.omega_d
    v_0 = before.omega_d - desired_before.omega_d
    turns_slower = _bound(x, v, v_0, rotation, speed, dt)
    if turns_slower:
        omega_c = desired.omega_d + v
        R_c = exp((dt / 2.0) * (before.omega_d + omega_c)) @ before.R_d
        domega_c = (omega_c - before.omega_d) / dt
    if not (is_slower or turns_slower):
        return frame
    return DesiredFrame(p_c, R_c, dp_c, omega_c, ddp_c, domega_c)


@jit(b1(vector, new_vector, vector, f8, f8, f8))
def _bound(x: Array, v: Array, v_before: Array, most: float, speed: float, dt: float) -> bool:
    """Bound the velocity v at the displacement x, in place; return whether it was beyond."""
    rate = min(POSITION_RATE, 1.0 / dt)
    slower = rate * speed * dt  # by no more, where a bound was lowered
    size, distance = norm(v), norm(x)
    fastest = max(speed, norm(v_before) - slower)
    is_beyond = size > fastest
    if is_beyond:
        v *= fastest / size
    if distance > 0.0:
        away = x / distance
        allowed = max(rate * (most - distance), max(-speed, dot(v_before, away) - slower))
        excess = dot(v, away) - allowed
        if excess > 0.0:
            v -= excess * away
            is_beyond = True
    return is_beyond
