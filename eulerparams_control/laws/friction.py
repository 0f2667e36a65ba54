"""Joint friction d(q, dq) of eq. (32): viscous and Coulomb."""

from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.jit import Array
from eulerparams_control.robot.urdf import COULOMB_SPEED


@dataclass(frozen=True)
class JointFriction:
    """Friction of n joints; raises ConfigurationError unless all are finite and 0 or more."""

    viscous: Array  # (n,) [Nm s/rad]
    coulomb: Array  # (n,) [Nm]

    def __post_init__(self) -> None:
        for name in ("viscous", "coulomb"):
            values = getattr(self, name)
            if not (np.isfinite(values).all() and (values >= 0).all()):
                raise ConfigurationError(
                    f"friction_{name} is {values.tolist()}; expected finite numbers of 0 or more"
                )

    @property
    def is_none(self) -> bool:
        """Whether there is no friction at all."""
        return not (self.viscous.any() or self.coulomb.any())

    def effort(self, dq: Array) -> Array:
        """Return d (n,) [Nm] at the velocities dq (n,); Coulomb friction fades around 0."""
        d: Array = self.viscous * dq + self.coulomb * np.tanh(dq / COULOMB_SPEED)
        return d
