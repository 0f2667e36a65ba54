"""Interface of the representations of the orientation displacement, and their registry.

Each place where the paper's equations change with the representation is one formula, or one
method of :class:`OrientationRepresentation`; the schemes know nothing else of it.  A new one is
one file with a subclass, and a line in ``orientation/__init__.py``.

Notation: ``R_d``, ``R_e`` (3, 3) desired and end-effector orientation in the base
frame, ``omega_d`` (3,) [rad/s] desired angular velocity, ``x_de`` the displacement.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eulerparams_control.errors import SingularityError, UnknownNameError
from eulerparams_control.laws._old.compiled import (
    Formula,
    Input,
    Inputs,
    Row,
    RowLayout,
    entry,
    formula,
    kernel,
    layout,
    slot,
    template,
    to_rows,
)
from eulerparams_control.laws._old.linear import Mat, MatLike, Vec, VecLike, mat
from eulerparams_control.laws._old.orientation.sequences import Axes, EulerSequence
from eulerparams_control.laws._old.orientation.sign import Sign, SignRule
from eulerparams_control.laws._old.rotations import Array
from eulerparams_control.laws.impedance_matrices import Impedance


class Lyapunov(NamedTuple):
    """A Lyapunov function of the orientation error along the closed loop.

    Attributes:
        V: its value; (N,) of N displacements at once.
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

    R_c: MatLike
    omega_c: VecLike
    domega_c: VecLike


class Coordinates(NamedTuple):
    """The options as the formulas take them."""

    axes: Axes
    sign: Sign


class Laws(NamedTuple):
    """The formulas of a representation for one sample.

    Attributes:
        displacement: x_de (R_d, R_e, previous, options), eqs. (22), (27); ``previous`` is that of
            the sample before, zeros at the first.
        velocity: omega (x_de, omega_d, k_Po, options) [rad/s] that CLIK asks for, eqs. (23), (28).
        acceleration: a_o (x_de, omega_d, domega_d, omega_e, k_Po, k_Vo, options) [rad/s^2] of
            dynamic control, eqs. (38), (40).
    """

    displacement: Formula
    velocity: Formula
    acceleration: Formula


class Compliance(NamedTuple):
    """The formulas of the rotational impedance of a representation for one sample.

    Attributes:
        begin: state y (R_d, omega_d, R_c, omega_c, options), relative to the desired frame: the
            displacement and its rate.
        drive: u (R_d, mu, previous, options), what it is driven by, interpolated between samples;
            ``previous`` is that of the sample before, zeros at the first.
        rate: dy (y, u, Z, options), eqs. (55), (59), Z in the coordinates of the representation.
        normalised: y (y) after a step of integration, freed of its rounding.
        end: the compliant rotation (y, dy, u, R_d, omega_d, domega_d, options) in the base frame,
            the inverse of the beginning.
    """

    begin: Formula
    drive: Formula
    rate: Formula
    normalised: Formula
    end: Formula


class RotationalSpring(NamedTuple):
    """What the stiffness K_o does to a frame that is turned off the desired one, base frame.

    Attributes:
        moment: (3,) [Nm] on it, minus the gradient of the energy: no closed path makes energy.
        energy: [J].
        axes: (3, 3) A of the stiffness A K_o A' [Nm/rad] that small turns from there feel.
    """

    moment: VecLike
    energy: float
    axes: MatLike


@formula
def moment_in_desired_axes(R_d: Mat, mu: Vec, previous: Vec, options: Coordinates) -> Vec:
    """Return mu^d = R_d' mu (3,): what relative displacements are driven by."""
    return R_d.T @ mu


@dataclass(frozen=True)
class OrientationOptions:
    """Options of the representations; each uses those that concern it.

    Attributes:
        sequence: of Euler angles.
        sign: rule for the sign of the mutual quaternion.
    """

    sequence: EulerSequence = field(default_factory=EulerSequence)
    sign: SignRule = field(default_factory=SignRule)

    @cached_property
    def values(self) -> Coordinates:
        """The options as the formulas take them."""
        return Coordinates(self.sequence.axes, self.sign.values)

    @cached_property
    def row(self) -> Array:
        """The options as a row."""
        return to_rows(Coordinates, self.values)


displacement = read = put = slot  # of a representation
_read_options = layout(Coordinates).read


def _displaced(R_d: Inputs, R_e: Inputs, previous: Input, options: Input, x_de: Row) -> None:
    before = read(previous, 0)
    put(x_de, 0, displacement(mat(R_d), mat(R_e), before, _read_options(options, 0)))


@cache
def law_of(
    call: Callable[..., int], law: Callable[..., Any], kind: type["OrientationRepresentation"]
) -> Callable[..., int]:
    """Return what Python calls of a law, compiled for a representation; there its name is ``law``.

    In the law the names of formulas are those of the representation, ``spring`` among them.
    """
    formulas = kind.laws._asdict() | {"spring": kind.spring}
    made = kernel(template(law, _name_of(law, kind), **formulas))
    return entry_of(call, kind, law=made)


@cache
def entry_of(
    call: Callable[..., Any], kind: type["OrientationRepresentation"], **slots: Any
) -> Callable[..., Any]:
    """Return what Python calls of displacements, compiled for a representation."""
    rows = layout(kind.laws.displacement.result)
    slots |= {"displacement": kind.laws.displacement, "read": rows.read, "put": rows.put}
    return entry(template(call, _name_of(call, kind), **slots))


def _name_of(function: Callable[..., Any], kind: type["OrientationRepresentation"]) -> str:
    return f"{function.__module__}_{function.__name__}_{kind.identifier()}".replace(".", "_")


class OrientationRepresentation(ABC):
    """One representation of the orientation displacement, as the laws use it.

    Attributes:
        name: the value of the parameter ``orientation``.
        symbol: of its orientation error, in words.
        unit: of that; "rad" or "".
        slope: [1/rad] of that where the displacement is small.
        laws: its formulas.
        compliance: those of its rotational impedance.
        spring: what a stiffness does (R_d, R_e, K_o, options), K_o in its coordinates.
    """

    name: ClassVar[str]
    symbol: ClassVar[str] = "orientation error"
    unit: ClassVar[str] = ""
    slope: ClassVar[float] = 1.0
    laws: ClassVar[Laws]
    compliance: ClassVar[Compliance]
    spring: ClassVar[Formula]
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

    @cached_property
    def _none(self) -> Any:
        """The value of the displacement before the first."""
        return self.rows.unpack(np.zeros(self.rows.width))

    def displacement(self, R_d: Array, R_e: Array, previous: Any = None) -> Any:
        """Return the displacement x_de of R_d from R_e, eqs. (22), (27).

        Its ``error`` (3,) is what the gains act on, zero where the frames are aligned.  That of N
        successive samples is one whose fields are stacked.

        Args:
            R_d: desired orientation (3, 3), or (N, 3, 3).
            R_e: end-effector orientation (3, 3), or (N, 3, 3).
            previous: the displacement of the sample before, or None at the first; what
                is not unique (a sign, an angle at the pole) follows from it.
        """
        if np.ndim(R_d) == 2 == np.ndim(R_e):
            return self.rows.unpack(self.displaced(R_d, R_e, self.row(previous)))
        before = self._none if previous is None else previous
        return self.laws.displacement(R_d, R_e, before, self.options.values)

    def displaced(self, R_d: Array, R_e: Array, previous: Array) -> Array:
        """Return the displacement of one sample as a row, from that before; see ``rows``."""
        x_de = np.empty(self.rows.width)
        entry_of(_displaced, type(self))(R_d, R_e, previous, self.options.row, x_de)
        return x_de

    def resolved_velocity(self, x_de: Any, omega_d: Array, k_Po: float) -> Array:
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
        return self._finite(self.laws.velocity(x_de, omega_d, k_Po, self.options.values))

    def resolved_acceleration(
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
        acceleration, options = self.laws.acceleration, self.options.values
        return self._finite(acceleration(x_de, omega_d, domega_d, omega_e, k_Po, k_Vo, options))

    def prepare(self) -> None:
        """Compile its displacement, now."""
        entry_of(_displaced, type(self))

    @classmethod
    def identifier(cls) -> str:
        """Return a name of its own for what is compiled of it."""
        return f"{cls.__module__}_{cls.__qualname__}".replace(".", "_")

    @cached_property
    def rows(self) -> RowLayout:
        """How a displacement lies in a row of floats."""
        return layout(self.laws.displacement.result)

    def row(self, x_de: Any) -> Array:
        """Return a displacement as a row of floats; None is that before the first."""
        return np.zeros(self.rows.width) if x_de is None else self.rows.pack(x_de)

    @property
    def singularity(self) -> str:
        """What is singular where the law has no answer, and what helps."""
        return f"the law of {self.name} is singular; use orientation: euler_parameters"

    def _finite(self, v: Array) -> Array:
        if np.isnan(v).any():
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
            k_Po, k_Vo: gains of :meth:`resolved_acceleration`.
        """
        return None

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
    if not isinstance(name, str) or name not in registry:
        raise UnknownNameError("orientation", str(name), registry)
    return registry[name](options)
