"""The laws as shipped in formulas, for the laws that are not ported yet: see ``laws``."""

import math
from typing import Any

from eulerparams_control.laws._old.compiled import Formula, formula, slot, template
from eulerparams_control.laws._old.linear import Mat, Vec, cross, identity
from eulerparams_control.laws._old.matrices import Matrices
from eulerparams_control.laws._old.orientation.angle_axis import AngleAxisRepresentation
from eulerparams_control.laws._old.orientation.base import Coordinates
from eulerparams_control.laws._old.orientation.euler_parameters import (
    EulerParametersRepresentation,
    QuaternionDisplacement,
    elastic_energy,
)
from eulerparams_control.laws._old.orientation.relative_quaternion import (
    Elastic,
    RelativeQuaternionRepresentation,
    RelativeTurn,
    relative_compliance,
    relative_spring,
)
from eulerparams_control.laws._old.orientation.rotation_vector import (
    RotationVectorRepresentation,
    short_vector,
)
from eulerparams_control.laws._old.rotations import EulerParameters, matrix, propagation

PREFIX = "as_shipped"

LAMBDA = 0.01
"""Of version 2 [rad/s per Nm]: that of its authors' main_geo_discrete_v2.m."""

e = slot


@formula
def twice_eps(Q: EulerParameters) -> Vec:
    """Return 2 eps of the sign with eta >= 0."""
    return (-2.0 if Q.eta < 0.0 else 2.0) * Q.eps


@formula
def sin_r(Q: EulerParameters) -> Vec:
    """Return sin(theta) r = 2 eta eps."""
    return (2.0 * Q.eta) * Q.eps


def _moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return K_o e: what packages ship, without the Omega' of the gradient."""
    return K_o @ e(Q_cd)


def _energy(Q_cd: EulerParameters, K_o: Mat) -> float:
    """Return e' K_o e / 2, which is no energy of that moment unless K_o is a multiple of I."""
    return e(Q_cd) @ (K_o @ e(Q_cd)) / 2.0


@formula
def K_R_of(K_o: Mat) -> Mat:
    """Return the K_R with K_o = tr(K_R) I - K_R."""
    return identity(0.5 * (K_o.xx + K_o.yy + K_o.zz)) - K_o


@formula
def geometric_moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return R (K_R R - R' K_R)^vee, the moment of geometric impedance control in desired axes."""
    R, K_R = matrix(Q_cd), K_R_of(K_o)
    A = K_R @ R - R.T @ K_R
    return R @ Vec(A.zy, A.xz, A.yx)


@formula
def version_2(y: RelativeTurn, mu_d: Vec, Z: Matrices, options: Coordinates) -> RelativeTurn:
    """Return dy with M_o (dx + LAMBDA df) + D_o (x + LAMBDA f) + f = mu^d, f the moment above.

    df = R (tr(R' K_R) I - R' K_R) R' x.  Its axes are those of the tool: M_o and D_o are to be
    multiples of I.
    """
    Q, x = y
    R = matrix(Q)
    f, A = geometric_moment(Q, Z.K), R.T @ K_R_of(Z.K)
    df = R @ ((identity(A.xx + A.yy + A.zz) - A) @ (R.T @ x))
    dx = Z.M_inverse @ (mu_d - Z.D @ (x + LAMBDA * f) - f) - LAMBDA * df
    return RelativeTurn(propagation(Q, x), dx)


@formula
def sliding(
    x_de: QuaternionDisplacement, omega_d: Vec, domega_d: Vec, omega_e: Vec, k_Po: float,
    k_Vo: float, options: Coordinates,
) -> Vec:  # fmt: skip
    """Return domega_d + l deps_de + k (Delta omega_de + l eps_de).

    With l k = k_Po and l / 2 + k = k_Vo: small errors then obey (41).  NaN if k_Vo^2 < 2 k_Po.
    """
    if k_Vo * k_Vo < 2.0 * k_Po:
        return Vec(math.nan, math.nan, math.nan)
    k = 0.5 * (k_Vo + math.sqrt(k_Vo * k_Vo - 2.0 * k_Po))
    l, eps, eta = 2.0 * (k_Vo - k), x_de.eps_de, x_de.Q_de.eta
    turning = omega_d - matrix(EulerParameters(eta, eps)) @ omega_e  # of R_d R_e'
    deps = 0.5 * (eta * turning - cross(eps, turning))  # eq. (9)
    return domega_d + l * deps + k * (omega_d - omega_e + l * eps)


def _ship(
    kind: type[RelativeQuaternionRepresentation], of: str, moment: Formula, energy: Formula,
    rate: Formula | None = None, **own: Any,
) -> None:  # fmt: skip
    """Register a representation like ``kind`` with another elastic moment, or rate of (59)."""
    name, elastic = f"{PREFIX}_{of}", Elastic(moment, energy)
    compliance, spring = relative_compliance(name, elastic), relative_spring(name, elastic)
    own |= {"compliance": compliance._replace(rate=rate) if rate else compliance, "spring": spring}
    own |= {"name": name, "elastic": elastic, "__doc__": kind.__doc__, "__module__": __name__}
    type(f"AsShipped{of.title()}", (kind,), own)


def _plain(of: str, vector: Formula) -> tuple[Formula, Formula]:
    """Return the moment K_o e, and what passes for its energy."""
    return (
        formula(template(_moment, f"{PREFIX}_{of}_moment", e=vector)),
        formula(template(_energy, f"{PREFIX}_{of}_energy", e=vector)),
    )


_ship(EulerParametersRepresentation, "eps", *_plain("eps", twice_eps))
_ship(RotationVectorRepresentation, "theta", *_plain("theta", short_vector))
_ship(AngleAxisRepresentation, "sin", *_plain("sin", sin_r))
_of_eps = EulerParametersRepresentation
_ship(_of_eps, "geometric", geometric_moment, elastic_energy)
_ship(_of_eps, "geometric_2", geometric_moment, elastic_energy, version_2)
_ship(_of_eps, "sliding", *_of_eps.elastic, laws=_of_eps.laws._replace(acceleration=sliding))
