"""Interface of the representations of the orientation displacement, and their registry.

Each place where the paper's equations change with the representation is one method of
:class:`OrientationRepresentation`; the laws know nothing else of it.  A new one is one file with a
subclass, and a line in ``orientation/__init__.py``.

Notation: ``R_d``, ``R_e``, ``R_c`` (3, 3) desired, end-effector and compliant orientation in the
base frame, ``omega_d`` (3,) [rad/s] desired angular velocity, ``x_de`` the displacement, ``mu``
(3,) [Nm] contact moment, ``y`` state of the rotational impedance, ``u`` what drives it.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

from eulerparams_control.errors import SingularityError, UnknownNameError
from eulerparams_control.laws.impedance_matrices import Impedance, Matrices
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.orientation.sign import SignRule
from eulerparams_control.laws.rotations import Array


class Lyapunov(NamedTuple):
    """A Lyapunov function of the orientation error along the closed loop.

    Attributes:
        V: its value.
        dV: its time derivative [1/s] as the paper gives it.
    """

    V: float
    dV: float


class CompliantRotation(NamedTuple):
    """The rotational motion of the compliant frame, base frame.

    Attributes:
        R_c: (3, 3).
        omega_c, domega_c: (3,) [rad/s], [rad/s^2].
    """

    R_c: Array
    omega_c: Array
    domega_c: Array


class RotationalSpring(NamedTuple):
    """What the stiffness K_o does to a frame that is turned off the desired one, base frame.

    Attributes:
        moment: (3,) [Nm] on it, minus the gradient of the energy: no closed path makes energy.
        energy: [J].
        axes: (3, 3) A of the stiffness A K_o A' [Nm/rad] that small turns from there feel.
    """

    moment: Array
    energy: float
    axes: Array


@dataclass(frozen=True)
class OrientationOptions:
    """Options of the representations; each uses those that concern it.

    Attributes:
        sequence: of Euler angles.
        sign: rule for the sign of the mutual quaternion.
    """

    sequence: EulerSequence = field(default_factory=EulerSequence)
    sign: SignRule = field(default_factory=SignRule)


class OrientationRepresentation(ABC):
    """One representation of the orientation displacement, as the laws use it.

    Attributes:
        name: the value of the parameter ``orientation``.
        symbol: of its orientation error, in words.
        unit: of that; "rad" or "".
        slope: [1/rad] of that where the displacement is small.
    """

    name: ClassVar[str]
    symbol: ClassVar[str] = "orientation error"
    unit: ClassVar[str] = ""
    slope: ClassVar[float] = 1.0
    registry: ClassVar[dict[str, type["OrientationRepresentation"]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "name" in cls.__dict__:  # else it is a base of some
            cls.registry[cls.name] = cls

    def __init__(self, options: OrientationOptions | None = None) -> None:
        self.options = options or OrientationOptions()

    def __eq__(self, other: object) -> bool:
        """Whether both give the same displacements."""
        if not isinstance(other, OrientationRepresentation):
            return NotImplemented
        return type(self) is type(other) and self.options == other.options

    def __hash__(self) -> int:
        return hash((type(self), self.options))

    # --- the loop: sections III and IV --------------------------------------------------------

    @abstractmethod
    def displacement(self, R_d: Array, R_e: Array, previous: Any = None) -> Any:
        """Return the displacement x_de of R_d from R_e, eqs. (22), (27).

        Its ``error`` (3,) is what the gains act on, zero where the frames are aligned.

        Args:
            R_d, R_e: (3, 3).
            previous: the displacement of the sample before, or None at the first; what
                is not unique (a sign, an angle at the pole) follows from it.
        """

    @abstractmethod
    def velocity(self, x_de: Any, omega_d: Array, k_Po: float) -> Array:
        """Return the angular velocity omega (3,) [rad/s] that CLIK asks for.

        The lower half of the bracket of (28), or of T times that of (23), in the base
        frame: along it the error obeys the representation's error equation, (26), (29).

        Args:
            x_de: from :meth:`displacement`.
            omega_d: desired angular velocity (3,) [rad/s], base frame.
            k_Po: gain [1/s].

        Raises:
            SingularityError: if there is no finite answer.
        """

    @abstractmethod
    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return the angular acceleration a_o (3,) [rad/s^2] of dynamic control, eqs. (38), (40).

        Along domega_e = a_o, eq. (35), the error obeys the representation's error equation of
        second order, (39), (41).

        Args:
            x_de: from :meth:`displacement`.
            omega_d, domega_d: desired angular velocity and acceleration (3,), base frame.
            omega_e: angular velocity (3,) [rad/s] of the end effector, base frame.
            k_Po: gain of the error [1/s^2].
            k_Vo: gain of its rate [1/s].

        Raises:
            SingularityError: if there is no finite answer.
        """

    @abstractmethod
    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] to the nearest singularity of the law; inf if it has none."""

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return f"the law of {self.name} is singular; use orientation: euler_parameters"

    def finite(self, v: Array) -> Array:
        """Return v (3,); raises SingularityError if it is not a number."""
        if math.isnan(v[0]):
            raise SingularityError(self.singularity)
        return v

    def lyapunov_1(self, x_de: Any, k_Po: float) -> Lyapunov | None:
        """Return V_1 of CLIK, eqs. (30), (31); None: the paper has none for it."""
        return None

    def lyapunov_2(self, x_de: Any, omega_de: Array, k_Po: float, k_Vo: float) -> Lyapunov | None:
        """Return V_2 of dynamic control, eqs. (42), (43); None: the paper has none for it.

        Args:
            x_de: from :meth:`displacement`.
            omega_de: omega_d - omega_e (3,) [rad/s], base frame.
            k_Po, k_Vo: gains of :meth:`acceleration`.
        """
        return None

    # --- the rotational impedance: section V --------------------------------------------------

    @abstractmethod
    def relative_state(self, R_d: Array, omega_d: Array, R_c: Array, omega_c: Array) -> Array:
        """Return the state y, relative to the desired frame: the displacement and its rate."""

    @abstractmethod
    def relative_input(self, R_d: Array, mu: Array, before: Array | None) -> Array:
        """Return u, what y is driven by, interpolated between samples.

        Args:
            R_d: (3, 3).
            mu: (3,) [Nm], base frame.
            before: u of the sample before; None at the first.
        """

    @abstractmethod
    def state_rate(self, y: Array, u: Array, Z: Matrices) -> Array:
        """Return dy, eqs. (55), (59), Z in the coordinates of :meth:`impedance`."""

    def normalised(self, y: Array) -> Array:
        """Return y after a step of integration, freed of its rounding."""
        return y

    @abstractmethod
    def compliant_rotation(
        self, y: Array, dy: Array, u: Array, R_d: Array, omega_d: Array, domega_d: Array
    ) -> CompliantRotation:
        """Return the rotation in the base frame, the inverse of :meth:`relative_state`."""

    @abstractmethod
    def spring(self, R_d: Array, R_e: Array, K_o: Array) -> RotationalSpring:
        """Return what K_o (3, 3) [Nm/rad] of :meth:`impedance` does between two frames."""

    def impedance(self, Z: Impedance) -> Impedance:
        """Return the rotational impedance in the coordinates of this representation.

        Args:
            Z: M_o, D_o, K_o for small turns of the compliant frame about the desired axes.

        Raises:
            ConfigurationError: if it has none in them.
        """
        return Z

    def lyapunov_3(self, R_cd: Array, x: Array, Z: Impedance, mu_d: Array) -> Lyapunov | None:
        """Return V_3 of the impedance, eqs. (68), (69); None if it has none.

        Args:
            R_cd: (3, 3) R_d' R_c.
            x: (3,) [rad/s] R_d' (omega_c - omega_d).
            Z: M_o, D_o, K_o.
            mu_d: (3,) [Nm] contact moment in the desired frame; its power is in dV_3.
        """
        return None

    def least_moment(self, K_o: Array) -> float:
        """Return the largest moment [Nm] that the elastic one balances about its weakest axis.

        inf: any.

        Args:
            K_o: (3, 3) stiffness [Nm/rad].
        """
        return math.inf


def representation(
    name: str, options: OrientationOptions | None = None
) -> OrientationRepresentation:
    """Return the representation of that name.

    Raises:
        UnknownNameError: if there is none; lists those that exist.
    """
    registry = OrientationRepresentation.registry
    if not isinstance(name, str) or name not in registry:
        raise UnknownNameError("orientation", str(name), registry)
    return registry[name](options)
