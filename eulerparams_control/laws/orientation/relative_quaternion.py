"""Shared by the representations with a vector e of the mutual quaternion: (28), (40) and (59).

Their rotational impedance, in Euler parameters and relative angular velocity, eq. (59), differs
in the elastic moment only.  Its motion depends on the absolute orientation in no way.

Notation: ``y`` = (eta_cd, eps_cd_d, x) with {eta_cd, eps_cd_d} of R_cd = R_d' R_c and ``x`` (3,)
[rad/s] R_d' (omega_c - omega_d), all in the desired frame; ``u`` = mu^d (3,) [Nm].
"""

import math
from abc import abstractmethod
from typing import Any

import numpy as np

from eulerparams_control.laws.impedance_matrices import Impedance, Matrices
from eulerparams_control.laws.jit import jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.base import (
    CompliantRotation,
    Lyapunov,
    OrientationRepresentation,
    RotationalSpring,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    cross,
    dot,
    mutual_R,
    quaternion,
    turn,
)
from eulerparams_control.laws.rotations import matrix as R_of

# Number of angles, up to half a turn, that are tried for the largest moment.
_ANGLES = 181


class RelativeQuaternionRepresentation(OrientationRepresentation):
    """A representation whose impedance is (59) with an elastic moment of its own."""

    @abstractmethod
    def elastic_moment(self, Q_cd: EulerParameters, K_o: Array) -> Array:
        """Return mu_E (3,) [Nm] in the desired frame, eqs. (62), (66).

        Args:
            Q_cd: {eta_cd, eps_cd_d} of R_d' R_c.
            K_o: (3, 3) stiffness [Nm/rad].
        """

    @abstractmethod
    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return the energy [J] whose rate along x is mu_E' x: the second term of (68)."""

    def velocity(self, x_de: Any, omega_d: Array, k_Po: float) -> Array:
        """Return omega_d + k_Po e, eq. (28): e is eps_de, or another vector along its axis."""
        return self.finite(omega_d + k_Po * x_de.error)

    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return domega_d + k_Vo Delta omega_de + k_Po e, eq. (40), e as in (28)."""
        return self.finite(domega_d + k_Vo * (omega_d - omega_e) + k_Po * x_de.error)

    def relative_state(self, R_d: Array, omega_d: Array, R_c: Array, omega_c: Array) -> Array:
        """Return y of two frames."""
        eta, eps = mutual_R(R_d, R_c)
        return np.concatenate(((eta,), eps, R_d.T @ (omega_c - omega_d)))

    def relative_input(self, R_d: Array, mu: Array, before: Array | None) -> Array:
        """Return mu^d = R_d' mu."""
        return R_d.T @ mu

    def state_rate(self, y: Array, mu_d: Array, Z: Matrices) -> Array:
        """Return dy: (17) and dx = M_o^-1 (mu^d - D_o x - mu_E), eqs. (59), (60)."""
        mu_E = self.elastic_moment(EulerParameters(y.item(0), y[1:4]), Z.K)
        return _rate(y, mu_d, mu_E, Z.M_inverse, Z.D)

    def normalised(self, y: Array) -> Array:
        """Return y with a unit quaternion."""
        y[:4] /= math.sqrt(y[:4] @ y[:4])
        return y

    def compliant_rotation(
        self, y: Array, dy: Array, mu_d: Array, R_d: Array, omega_d: Array, domega_d: Array
    ) -> CompliantRotation:
        """Return R_c = R_d R_cd, omega_c = omega_d + R_d x and domega_c.

        domega_c = domega_d + R_d dx + omega_d x omega_c: x are components in the desired frame,
        which turns (erratum of (59)).
        """
        omega_c = omega_d + R_d @ y[4:]
        domega_c = domega_d + R_d @ dy[4:] + cross(omega_d, omega_c)
        return CompliantRotation(R_d @ R_of(y[0], y[1:4]), omega_c, domega_c)

    def spring(self, R_d: Array, R_e: Array, K_o: Array) -> RotationalSpring:
        """Return the spring of (62), (66) between a desired frame and another."""
        Q = mutual_R(R_d, R_e)
        moment = -(R_d @ self.elastic_moment(Q, K_o))
        return RotationalSpring(moment, self.elastic_energy(Q, K_o), R_d)

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
        return Lyapunov(float(x @ Z.M @ x) / 2 + energy, float(mu_d @ x - x @ Z.D @ x))


@jit(new_vector(vector, vector, vector, matrix, matrix))
def _rate(y: Array, mu_d: Array, mu_E: Array, M_inverse: Array, D: Array) -> Array:
    eta, eps, x = y[0], y[1:4], y[4:]
    dy = np.empty(7)
    dy[0] = -0.5 * dot(eps, x)  # eq. (16)
    dy[1:4] = 0.5 * (eta * x - cross(eps, x))  # eq. (17)
    dy[4:] = turn(M_inverse, mu_d - turn(D, x) - mu_E)  # eq. (59)
    return dy


def short(Q: EulerParameters) -> EulerParameters:
    """Return the one of +-Q that turns by pi at most."""
    return -Q if Q.eta < 0.0 else Q


def _turned(half: float, axis: Array) -> EulerParameters:
    """Return the Euler parameters of a turn by twice ``half`` [rad] about an axis (3,)."""
    return EulerParameters(math.cos(half), math.sin(half) * axis)
