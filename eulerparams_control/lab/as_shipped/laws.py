"""Laws as other packages ship them, for comparison only: no node of a robot offers them.

Importing this registers them as representations whose names begin with ``as_shipped``.  Motions are
those of the representation that each is made of; what differs is the elastic moment, in the desired
frame:

| name | moment | where it was read |
| --- | --- | --- |
| ``as_shipped_eps`` | K_o 2 eps | docs/which_law.md |
| ``as_shipped_theta`` | K_o theta r | |
| ``as_shipped_sin`` | K_o sin(theta) r; the "intuitive" form of geometric impedance control | |
| ``as_shipped_geometric`` | R (K_R R - R' K_R)^vee, version 1 of arXiv 2211.07945, its (32) | |
| ``as_shipped_geometric_2`` | the same, in another impedance: version 2, its (47) | |

The first three have no energy: what they call one is e' K_o e / 2, of which their moment is not the
gradient.  The last two are given K_o and take K_R = tr(K_o) I / 2 - K_o, so that K_o = tr(K_R) I -
K_R.

``as_shipped_sliding`` differs in its acceleration: the quaternion sliding variable of arXiv
2412.18921.
"""

import math

import numpy as np

from eulerparams_control.laws.impedance_matrices import Matrices
from eulerparams_control.laws.orientation.angle_axis import AngleAxisRepresentation
from eulerparams_control.laws.orientation.euler_parameters import EulerParametersRepresentation
from eulerparams_control.laws.orientation.relative_quaternion import (
    QuaternionDisplacement,
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.orientation.rotation_vector import RotationVectorRepresentation
from eulerparams_control.laws.rotations import Array, EulerParameters, R_quaternion, propagation

PREFIX = "as_shipped"

LAMBDA = 0.01
"""Of version 2 [rad/s per Nm]: that of its authors' main_geo_discrete_v2.m."""


class StiffnessTimesVector(RelativeQuaternionRepresentation):
    """The moment is K_o o: what packages ship, without the Omega' of the gradient.

    Its ``elastic_energy`` o' K_o o / 2 is no energy of that moment unless K_o is a multiple of I.
    """

    def elastic_moment(self, eta: float, eps: Array, K_o: Array) -> Array:
        """Return K_o o."""
        return K_o @ self.o(EulerParameters(eta, eps))


class Eps(StiffnessTimesVector, EulerParametersRepresentation):
    """K_o 2 eps."""

    name = "as_shipped_eps"


class Theta(StiffnessTimesVector, RotationVectorRepresentation):
    """K_o theta r."""

    name = "as_shipped_theta"


class Sin(StiffnessTimesVector, AngleAxisRepresentation):
    """K_o sin(theta) r."""

    name = "as_shipped_sin"


def K_R_of(K_o: Array) -> Array:
    """Return the K_R (3, 3) with K_o = tr(K_R) I - K_R."""
    K_R: Array = np.trace(K_o) / 2 * np.eye(3) - K_o
    return K_R


def geometric_moment(R: Array, K_R: Array) -> Array:
    """Return (K_R R - R' K_R)^vee (3,), in the axes of the compliant frame."""
    A = K_R @ R - R.T @ K_R
    return np.array([A[2, 1], A[0, 2], A[1, 0]])


class Geometric(EulerParametersRepresentation):
    """Geometric impedance control, version 1."""

    name = "as_shipped_geometric"

    @staticmethod
    def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
        """Return R (K_R R - R' K_R)^vee in desired axes."""
        R = R_quaternion(eta, eps)
        return R @ geometric_moment(R, K_R_of(K_o))


class Geometric2(Geometric):
    """Geometric impedance control, version 2."""

    name = "as_shipped_geometric_2"

    def state_rate(self, y: Array, mu_d: Array, Z: Matrices) -> Array:
        """Return dy with M_o (dx + LAMBDA df) + D_o (x + LAMBDA f) + f = mu^d.

        f is the moment of version 1, df = R (tr(R' K_R) I - R' K_R) R' x.  Its axes are those of
        the tool: M_o and D_o are to be multiples of I.
        """
        dy = super().state_rate(y, mu_d, Z)
        Q, x = EulerParameters(y[0], y[1:4]), y[4:]
        R, f = Q.R, self.elastic_moment(*Q, Z.K)
        A = R.T @ K_R_of(Z.K)
        df = R @ ((np.trace(A) * np.eye(3) - A) @ (R.T @ x))
        dy[4:] = Z.M_inverse @ (mu_d - Z.D @ (x + LAMBDA * f) - f) - LAMBDA * df
        return dy


class Sliding(EulerParametersRepresentation):
    """The quaternion sliding variable."""

    name = "as_shipped_sliding"

    def acceleration(
        self,
        x_de: QuaternionDisplacement,
        omega_d: Array,
        domega_d: Array,
        omega_e: Array,
        k_Po: float,
        k_Vo: float,
    ) -> Array:
        """Return domega_d + l deps_de + k (Delta omega_de + l eps_de).

        With l k = k_Po and l / 2 + k = k_Vo: small errors then obey (41).

        Raises:
            SingularityError: if k_Vo^2 < 2 k_Po.
        """
        root = k_Vo * k_Vo - 2.0 * k_Po
        k = 0.5 * (k_Vo + math.sqrt(root)) if root >= 0.0 else math.nan
        l, eps, eta = 2.0 * (k_Vo - k), x_de.error, x_de.Q_de.eta
        turning = omega_d - R_quaternion(eta, eps) @ omega_e  # of R_d R_e'
        _, deps = propagation(eta, eps, turning)
        return self.finite(domega_d + l * deps + k * (omega_d - omega_e + l * eps))
