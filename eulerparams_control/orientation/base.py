"""What a representation of the orientation displacement is, and where they are found.

Each place where the paper's equations change with the representation is one method of
:class:`OrientationRepresentation`; the schemes know nothing else of it.  A new one is
one file with a subclass, and a line in ``orientation/__init__.py``.

Notation: ``R_d``, ``R_e`` (3, 3) desired and end-effector orientation in the base
frame, ``omega_d`` (3,) [rad/s] desired angular velocity, ``x_de`` the displacement.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.orientation.sequences import EulerSequence
from eulerparams_control.orientation.sign import SignRule
from eulerparams_control.rotations import Array


class Displacement(Protocol):
    """An orientation displacement in the terms of its representation."""

    @property
    def error(self) -> Array:
        """The orientation error (3,) that the gains act on; zero where aligned."""


@dataclass(frozen=True)
class OrientationOptions:
    """What a user can choose about a representation; each takes what concerns it.

    Attributes:
        sequence: of Euler angles.
        sign: rule for the sign of the mutual quaternion.
    """

    sequence: EulerSequence = field(default_factory=EulerSequence)
    sign: SignRule = field(default_factory=SignRule)


class OrientationRepresentation(ABC):
    """One representation of the orientation displacement, as the laws use it."""

    name: ClassVar[str]
    registry: ClassVar[dict[str, type["OrientationRepresentation"]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.registry[cls.name] = cls

    def __init__(self, options: OrientationOptions | None = None) -> None:
        self.options = options or OrientationOptions()

    @abstractmethod
    def displacement(self, R_d: Array, R_e: Array, previous: Any = None) -> Any:
        """Return the displacement x_de of R_d from R_e, eqs. (22), (27).

        Args:
            R_d: desired orientation (3, 3).
            R_e: end-effector orientation (3, 3).
            previous: the displacement of the sample before, or None at the first; what
                is not unique (a sign, an angle at the pole) follows from it.
        """

    @abstractmethod
    def resolved_velocity(self, x_de: Any, omega_d: Array, k_Po: float) -> Array:
        """Return the angular velocity omega (3,) [rad/s] that CLIK asks for.

        The lower half of the bracket of (28), or of T times that of (23), in the base
        frame: along it the error obeys the representation's error equation, (26), (29).

        Args:
            x_de: from :meth:`displacement`.
            omega_d: desired angular velocity (3,) [rad/s], base frame.
            k_Po: gain [1/s].
        """

    @abstractmethod
    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] to the nearest singularity of the law; inf if it has none."""


def representation(
    name: str, options: OrientationOptions | None = None
) -> OrientationRepresentation:
    """Return the representation of that name.

    Raises:
        UnknownNameError: if there is none; lists those that exist.
    """
    registry = OrientationRepresentation.registry
    if name not in registry:
        raise UnknownNameError("orientation", name, registry)
    return registry[name](options)
