"""Friction as the laws that are not yet open Python take it."""

import math

from eulerparams_control.laws._old.compiled import kernel
from eulerparams_control.robot.urdf import COULOMB_SPEED


@kernel
def friction_effort(viscous: float, coulomb: float, dq: float) -> float:
    """Return d [Nm] of a joint."""
    return viscous * dq + coulomb * math.tanh(dq / COULOMB_SPEED)
