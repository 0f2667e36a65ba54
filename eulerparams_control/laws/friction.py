"""Joint friction d(q, dq) of eq. (32): viscous and Coulomb."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import Array, Input, Row, entry, kernel
from eulerparams_control.robot.urdf import COULOMB_SPEED


@dataclass(frozen=True)
class JointFriction:
    """Friction of n joints.

    Attributes:
        viscous: (n,) [Nm s/rad].
        coulomb: (n,) [Nm].

    Raises:
        ConfigurationError: if one is not a finite number of 0 or more.
    """

    viscous: Array
    coulomb: Array

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
        d = np.empty(len(dq))
        fill_friction(self.viscous, self.coulomb, dq, d)
        return d


@kernel
def friction_effort(viscous: float, coulomb: float, dq: float) -> float:
    """Return d [Nm] of a joint."""
    return viscous * dq + coulomb * math.tanh(dq / COULOMB_SPEED)


@entry
def fill_friction(viscous: Input, coulomb: Input, dq: Input, d: Row) -> None:
    """Fill d (n,): see :meth:`JointFriction.effort`."""
    for i in range(len(dq)):
        d[i] = friction_effort(viscous[i], coulomb[i], dq[i])
