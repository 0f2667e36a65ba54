"""Shared by the representations with a vector of the mutual quaternion: (28), (40) and (59).

Their rotational impedance, in Euler parameters and relative angular velocity, eq. (59), differs
in the elastic moment only.  Its motion depends on the absolute orientation in no way.
"""

import math
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eulerparams_control.laws._old.compiled import Formula, formula, slot, template
from eulerparams_control.laws._old.linear import Mat, Vec, VecLike
from eulerparams_control.laws._old.matrices import Matrices
from eulerparams_control.laws._old.orientation.base import (
    Compliance,
    CompliantRotation,
    Coordinates,
    Lyapunov,
    OrientationRepresentation,
    RotationalSpring,
    moment_in_desired_axes,
)
from eulerparams_control.laws._old.rotations import (
    Array,
    EulerParameters,
    cross,
    inner,
    matrix,
    mutual_R,
    propagation,
    quaternion,
)
from eulerparams_control.laws.impedance_matrices import Impedance

# Number of angles, up to half a turn, that are tried for the largest moment.
_ANGLES = 181


class Elastic(NamedTuple):
    """What the stiffness K_o (3, 3) [Nm/rad] does at {eta_cd, eps_cd_d} of R_d' R_c.

    Attributes:
        moment: mu_E (Q_cd, K_o) (3,) [Nm] in the desired frame, eqs. (62), (66).
        energy: (Q_cd, K_o) [J], whose rate along x is mu_E' x: the second term of (68).
    """

    moment: Formula
    energy: Formula


@formula
def velocity_along(e: Vec, omega_d: Vec, k_Po: float) -> Vec:
    """Return omega_d + k_Po e, eq. (28): e is eps_de, or another vector along the same axis."""
    return omega_d + k_Po * e


@formula
def acceleration_along(
    e: Vec, omega_d: Vec, domega_d: Vec, omega_e: Vec, k_Po: float, k_Vo: float
) -> Vec:
    """Return domega_d + k_Vo Delta omega_de + k_Po e, eq. (40), e as in (28)."""
    return domega_d + k_Vo * (omega_d - omega_e) + k_Po * e


class RelativeTurn(NamedTuple):
    """The state y of the rotational impedance, all in the desired frame.

    Attributes:
        Q_cd: {eta_cd, eps_cd_d} of R_cd = R_d' R_c.
        x: (3,) [rad/s] R_d' (omega_c - omega_d).
    """

    Q_cd: EulerParameters
    x: VecLike


@formula
def begin(R_d: Mat, omega_d: Vec, R_c: Mat, omega_c: Vec, options: Coordinates) -> RelativeTurn:
    """Return y of two frames."""
    return RelativeTurn(mutual_R(R_d, R_c), R_d.T @ (omega_c - omega_d))


elastic_moment = elastic_energy = slot  # of a representation


def _rate(y: RelativeTurn, mu_d: Vec, Z: Matrices, options: Coordinates) -> RelativeTurn:
    """Return dy: (17) and dx = M_o^-1 (mu^d - D_o x - mu_E), eqs. (59), (60)."""
    Q, x = y
    dx = Z.M_inverse @ (mu_d - Z.D @ x - elastic_moment(Q, Z.K))  # eq. (59)
    return RelativeTurn(propagation(Q, x), dx)


def _spring(R_d: Mat, R_e: Mat, K_o: Mat, options: Coordinates) -> RotationalSpring:
    """Return the spring of (62), (66) between a desired frame and another."""
    Q = mutual_R(R_d, R_e)
    return RotationalSpring(-(R_d @ elastic_moment(Q, K_o)), elastic_energy(Q, K_o), R_d)


@formula
def normalised(y: RelativeTurn) -> RelativeTurn:
    """Return y with a unit quaternion."""
    size = math.sqrt(inner(y.Q_cd, y.Q_cd))
    return RelativeTurn(EulerParameters(y.Q_cd.eta / size, y.Q_cd.eps / size), y.x)


@formula
def end(
    y: RelativeTurn, dy: RelativeTurn, mu_d: Vec, R_d: Mat, omega_d: Vec, domega_d: Vec,
    options: Coordinates,
) -> CompliantRotation:  # fmt: skip
    """Return R_c = R_d R_cd, omega_c = omega_d + R_d x and domega_c.

    domega_c = domega_d + R_d dx + omega_d x omega_c: x are components in the desired frame,
    which turns (erratum of (59)).
    """
    omega_c = omega_d + R_d @ y.x
    domega_c = domega_d + R_d @ dy.x + cross(omega_d, omega_c)
    return CompliantRotation(R_d @ matrix(y.Q_cd), omega_c, domega_c)


def relative_compliance(name: str, elastic: Elastic) -> Compliance:
    """Return the formulas of (59) with the elastic moment of the representation ``name``."""
    rate = formula(template(_rate, f"{name}_rate", elastic_moment=elastic.moment))
    return Compliance(begin, moment_in_desired_axes, rate, normalised, end)


def relative_spring(name: str, elastic: Elastic) -> Formula:
    """Return the spring of the representation ``name``."""
    slots = {"elastic_moment": elastic.moment, "elastic_energy": elastic.energy}
    return formula(template(_spring, f"{name}_spring", **slots))


class RelativeQuaternionRepresentation(OrientationRepresentation):
    """A representation whose impedance is (59) with an elastic moment of its own."""

    elastic: ClassVar[Elastic]

    def prepare(self) -> None:
        """Compile what maps its formulas over N samples, now."""
        super().prepare()
        self.elastic.energy.prepare()

    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return mu_E (3,) [Nm]: see :class:`Elastic`."""
        return self.elastic.moment(Q_cd, K_o)

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return the elastic energy [J]: see :class:`Elastic`."""
        return self.elastic.energy(Q_cd, K_o)

    def least_moment(self, K_o: Array) -> float:
        """Return the largest elastic moment [Nm] about the axis of K_o that has the least."""
        halves = np.linspace(0.0, np.pi / 2, _ANGLES)[:-1]
        return min(
            max(abs(float(axis @ self.elastic_moment(_turned(half, axis), K_o))) for half in halves)
            for axis in np.linalg.eigh(K_o)[1].T
        )

    def lyapunov_3(self, R_cd: Array, x: Array, Z: Impedance, mu_d: Array) -> Lyapunov:
        """Return V_3 = x' M_o x / 2 + elastic energy and dV_3 = -x' D_o x + mu^d' x.

        Eqs. (68), (69), the latter with the power of the contact moment.
        """
        energy = self.elastic_energy(quaternion(R_cd), Z.K)
        kinetic: Any = np.sum(x * (x @ Z.M), axis=-1) / 2
        power: Any = np.sum(mu_d * x - x * (x @ Z.D), axis=-1)
        return Lyapunov(kinetic + energy, power)


def _turned(half: float, axis: Array) -> EulerParameters:
    """Return the Euler parameters of a turn by twice ``half`` [rad] about an axis (3,)."""
    return EulerParameters(np.cos(half), np.sin(half) * axis)
