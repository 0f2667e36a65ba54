"""Commands beyond the limits of the robot: cut to them, and what had to be cut."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.rotations import Array

_UNITS = {"position": ("rad", "m"), "speed": ("rad/s", "m/s"), "effort": ("Nm", "N")}
QUANTITIES = tuple(_UNITS)
"""What a command may say of a joint."""


class Clipped(NamedTuple):
    """A command that was cut to a limit of a joint, the worst of its joints.

    Attributes:
        joint: its name.
        quantity: one of ``QUANTITIES``.
        asked, limit: rad, rad/s or Nm (m, m/s or N if prismatic).
        unit: of both.
    """

    joint: str
    quantity: str
    asked: float
    limit: float
    unit: str

    def __str__(self) -> str:
        return (
            f"joint '{self.joint}' was asked for the {self.quantity} {self.asked:.6g} {self.unit}; "
            f"its limit is {self.limit:.6g} {self.unit}"
        )


def clip(values: Array, lower: Array, upper: Array) -> Array:
    """Return np.clip(values, lower, upper), in less than half the time."""
    return np.minimum(np.maximum(values, lower), upper)


def are_same(a: Array, b: Array) -> bool:
    """Return whether two vectors are equal to the bit, in a tenth of the time of a == b."""
    return a.tobytes() == b.tobytes()


def find_clipped(
    joints: Sequence[str], prismatic: Sequence[bool], quantity: str, asked: Array, given: Array
) -> Clipped | None:
    """Return what was cut the most, None if nothing was.

    Args:
        joints: names of the n joints.
        prismatic: whether each of them slides.
        quantity: one of ``QUANTITIES``.
        asked, given: (n,) before and after.
    """
    excess = np.abs(asked - given)
    worst = int(excess.argmax())
    if excess[worst] == 0.0:  # -0.0 and 0.0
        return None
    unit = _UNITS[quantity][prismatic[worst]]
    return Clipped(joints[worst], quantity, float(asked[worst]), float(given[worst]), unit)
