"""Laws as other packages ship them, for comparison only: no node of a robot offers them.

Importing this registers them as representations whose names begin with ``as_shipped``.  Motions are
those of the representation that each is made of; what differs is the elastic moment, in the desired
frame:

| name | moment | where it was read |
| --- | --- | --- |
| ``as_shipped_eps`` | K_o 2 eps | docs/which_law.md |
| ``as_shipped_theta`` | K_o theta r | |
| ``as_shipped_sin`` | K_o sin(theta) r; the "intuitive" form of geometric impedance control | |
| ``as_shipped_geometric`` | R' (K_R R - R' K_R)^vee seen in the desired frame, arXiv 2211.07945 | |

The first three have no energy: what they call one is e' K_o e / 2, of which their moment is not the
gradient.  The last is given K_o and takes K_R = tr(K_o) I / 2 - K_o, so that K_o = tr(K_R) I - K_R.
"""

from eulerparams_control.laws.compiled import Formula, formula, slot, template
from eulerparams_control.laws.linear import Mat, Vec, identity
from eulerparams_control.laws.orientation.angle_axis import AngleAxisRepresentation
from eulerparams_control.laws.orientation.euler_parameters import (
    EulerParametersRepresentation,
    elastic_energy,
)
from eulerparams_control.laws.orientation.relative_quaternion import (
    Elastic,
    RelativeQuaternionRepresentation,
    relative_compliance,
    relative_spring,
)
from eulerparams_control.laws.orientation.rotation_vector import (
    RotationVectorRepresentation,
    short_vector,
)
from eulerparams_control.laws.rotations import EulerParameters, matrix

PREFIX = "as_shipped"

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
def geometric_moment(Q_cd: EulerParameters, K_o: Mat) -> Vec:
    """Return R (K_R R - R' K_R)^vee, the moment of geometric impedance control in desired axes."""
    R = matrix(Q_cd)
    K_R = identity(0.5 * (K_o.xx + K_o.yy + K_o.zz)) - K_o
    A = K_R @ R - R.T @ K_R
    return R @ Vec(A.zy, A.xz, A.yx)


def _ship(
    kind: type[RelativeQuaternionRepresentation], of: str, moment: Formula, energy: Formula
) -> None:
    """Register a representation like ``kind`` with another elastic moment."""
    name, elastic = f"{PREFIX}_{of}", Elastic(moment, energy)
    compliance, spring = relative_compliance(name, elastic), relative_spring(name, elastic)
    own = {"name": name, "elastic": elastic, "compliance": compliance, "spring": spring}
    own |= {"__doc__": kind.__doc__, "__module__": __name__}
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
_ship(EulerParametersRepresentation, "geometric", geometric_moment, elastic_energy)
