"""Interface of the representations of the orientation displacement, and their registry.

Each place where the paper's equations change with the representation is one method of
:class:`OrientationRepresentation`; the laws know nothing else of it.  A new one is one file with a
subclass, and a line in ``orientation/__init__.py``.

Notation: ``R_d``, ``R_e``, ``R_c`` (3, 3) desired, end-effector and compliant orientation in the
base frame, ``omega_d`` (3,) [rad/s] desired angular velocity, ``x_de`` the displacement, ``mu``
(3,) [Nm] contact moment, ``y`` state of the rotational impedance, ``u`` its input.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

from eulerparams_control.errors import SingularityError, UnknownNameError
from eulerparams_control.laws.impedance_matrices import Impedance, Matrices
from eulerparams_control.laws.jit import jit, matrix, new_matrix, new_vector, types, vector
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.orientation.sign import SignRule
from eulerparams_control.laws.rotations import Array, cross, product, turn


class Lyapunov(NamedTuple):
    """A Lyapunov function of the closed loop, and its time derivative [1/s] as the paper has it."""

    V: float
    dV: float


class RotationalSpring(NamedTuple):
    """What the stiffness K_o does to a frame that is turned off the desired one."""

    moment: Array  # (3,) [Nm] minus the gradient of the energy: no closed path makes energy
    energy: float  # [J]
    axes: Array  # (3, 3) A of the stiffness A K_o A' [Nm/rad] that small turns from there feel


@dataclass(frozen=True)
class OrientationOptions:
    """The sequence of Euler angles, and the rule for the sign of the mutual quaternion."""

    sequence: EulerSequence = field(default_factory=EulerSequence)
    sign: SignRule = field(default_factory=SignRule)


@dataclass(frozen=True)
class OrientationRepresentation(ABC):
    """One representation of the orientation displacement, as the laws use it."""

    options: OrientationOptions = field(default_factory=OrientationOptions)

    name: ClassVar[str]  # the value of the parameter ``orientation``
    symbol: ClassVar[str] = "orientation error"
    unit: ClassVar[str] = ""  # of the error: "rad" or ""
    slope: ClassVar[float] = 1.0  # [1/rad] of the error where the displacement is small
    registry: ClassVar[dict[str, type["OrientationRepresentation"]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "name" in cls.__dict__:  # else it is a base of some
            cls.registry[cls.name] = cls

    # --- the loop: sections III and IV --------------------------------------------------------

    @abstractmethod
    def displacement(self, R_d: Array, R_e: Array, previous: Any = None) -> Any:
        """Return the displacement x_de of R_d from R_e, eqs. (22), (27).

        Its ``error`` (3,) is what the gains act on.  What is not unique (a sign, an angle at the
        pole) follows from ``previous``, the displacement of the sample before, or None.
        """

    @abstractmethod
    def velocity(self, x_de: Any, omega_d: Array, k_Po: float) -> Array:
        """Return the angular velocity omega (3,) [rad/s] of CLIK with k_Po [1/s], eqs. (23), (28).

        Along it the error obeys its equation, (26), (29).  Raises SingularityError.
        """

    @abstractmethod
    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return the angular acceleration a_o (3,) [rad/s^2] of dynamic control, eqs. (38), (40).

        Along domega_e = a_o, eq. (35), the error obeys its equation of second order, (39), (41),
        with k_Po [1/s^2] and k_Vo [1/s].  Raises SingularityError.
        """

    @abstractmethod
    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return the angle [rad] to the nearest singularity of the law; inf if it has none."""

    @property
    def singularity(self) -> str:
        """What is singular, and what helps."""
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
        """Return V_2 of dynamic control, eqs. (42), (43), omega_de = omega_d - omega_e; or None."""
        return None

    # --- the rotational impedance: section V --------------------------------------------------

    @abstractmethod
    def relative_state(self, R_d: Array, omega_d: Array, R_c: Array, omega_c: Array) -> Array:
        """Return the state y, relative to the desired frame: the displacement and its rate."""

    def relative_input(self, R_d: Array, mu: Array, before: Array | None) -> Array:
        """Return u, interpolated between samples, after u of the sample before: mu^d = R_d' mu."""
        return R_d.T @ mu

    @abstractmethod
    def state_rate(self, y: Array, u: Array, Z: Matrices) -> Array:
        """Return dy, eqs. (55), (59), Z in the coordinates of :meth:`impedance`."""

    def normalised(self, y: Array) -> Array:
        """Return y after a step of integration, freed of its rounding."""
        return y

    @abstractmethod
    def compliant_rotation(
        self, y: Array, dy: Array, u: Array, R_d: Array, omega_d: Array, domega_d: Array
    ) -> tuple[Array, Array, Array]:
        """Return R_c (3, 3), omega_c and domega_c (3,), the inverse of :meth:`relative_state`."""

    @abstractmethod
    def spring(self, R_d: Array, R_e: Array, K_o: Array) -> RotationalSpring:
        """Return what K_o (3, 3) [Nm/rad] of :meth:`impedance` does between two frames."""

    def impedance(self, Z: Impedance) -> Impedance:
        """Return an impedance of small turns in the coordinates of ``y``, or ConfigurationError."""
        return Z

    def lyapunov_3(self, R_cd: Array, x: Array, Z: Impedance, mu_d: Array) -> Lyapunov | None:
        """Return V_3, eqs. (68), (69), of R_d' R_c and x = R_d' (omega_c - omega_d), or None."""
        return None

    def least_moment(self, K_o: Array) -> float:
        """Return the largest moment [Nm] that K_o balances about its weakest axis."""
        return math.inf


@jit(types.Tuple((new_matrix, new_vector, new_vector))(matrix, matrix, *4 * (vector,)))
def in_base(
    R_d: Array, R_cd: Array, omega_d: Array, domega_d: Array, x: Array, dx: Array
) -> tuple[Array, Array, Array]:
    """Return R_c, omega_c, domega_c of R_cd = R_d' R_c and x = R_d' (omega_c - omega_d).

    The last has omega_d x omega_c: x are components in a frame that turns (erratum of (59)).
    """
    omega_c = omega_d + turn(R_d, x)
    domega_c = domega_d + turn(R_d, dx) + cross(omega_d, omega_c)
    return product(R_d, R_cd), omega_c, domega_c


def representation(
    name: str, options: OrientationOptions | None = None
) -> OrientationRepresentation:
    """Return the representation of that name; raises UnknownNameError, which lists all names."""
    registry = OrientationRepresentation.registry
    if not isinstance(name, str) or name not in registry:
        raise UnknownNameError("orientation", str(name), registry)
    return registry[name](options or OrientationOptions())
