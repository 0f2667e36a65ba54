"""Joint friction d(q, dq) of eq. (32): viscous and Coulomb."""

from dataclasses import dataclass

import numpy as np

from eulerparams_control.rotations import Array
from eulerparams_control.urdf import COULOMB_SPEED


@dataclass(frozen=True)
class JointFriction:
    """Friction of n joints.

    Attributes:
        viscous: (n,) [Nm s/rad].
        coulomb: (n,) [Nm].
    """

    viscous: Array
    coulomb: Array

    @property
    def is_none(self) -> bool:
        """Whether there is no friction at all."""
        return not (self.viscous.any() or self.coulomb.any())

    def effort(self, dq: Array) -> Array:
        """Return d (n,) [Nm] at the velocities dq (n,); Coulomb friction fades around 0."""
        return self.viscous * dq + self.coulomb * np.tanh(dq / COULOMB_SPEED)
