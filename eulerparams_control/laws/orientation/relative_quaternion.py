"""Shared by the representations with a vector e of the mutual quaternion: (28), (40) and (59).

Their rotational impedance, in Euler parameters and relative angular velocity, eq. (59), differs
in the elastic moment only.  Its motion depends on the absolute orientation in no way.

Notation: ``y`` = (eta_cd, eps_cd_d, x) with {eta_cd, eps_cd_d} of R_cd = R_d' R_c and ``x`` (3,)
[rad/s] R_d' (omega_c - omega_d), all in the desired frame; ``u`` = mu^d (3,) [Nm]; ``o`` (3,) the
vector of R_cd scaled to theta r where that is small, the coordinate of the elastic energy o' K_o o
/ 2; with do = Omega x its elastic moment is mu_E = Omega' K_o o.
"""

import math
from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eulerparams_control.laws.impedance_matrices import Impedance, Matrices
from eulerparams_control.laws.jit import jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.base import (
    Lyapunov,
    OrientationRepresentation,
    RotationalSpring,
    in_base,
)
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    R_quaternion,
    angle_between,
    dot,
    mutual_R,
    propagation,
    quaternion,
    turn,
)


class QuaternionDisplacement(NamedTuple):
    """The mutual quaternion and its vector e."""

    Q_de: EulerParameters  # {eta_de, eps_de_e} of R_e' R_d, eps in the end-effector frame
    error: Array  # (3,) e in the base frame
    R_e: Array


class RelativeQuaternionRepresentation(OrientationRepresentation):
    """A representation whose impedance is (59) with an elastic moment of its own."""

    singular_errors: ClassVar[tuple[float, ...]]
    """Angles [rad] at which the law is singular, or its vector not unique."""

    @abstractmethod
    def e(self, Q: EulerParameters) -> Array:
        """Return e (3,) of a quaternion, in the same axes."""

    @abstractmethod
    def elastic_moment(self, eta: float, eps: Array, K_o: Array) -> Array:
        """Return mu_E (3,) [Nm] of {eta_cd, eps_cd_d}, in the desired frame, eqs. (62), (66)."""

    def displacement(
        self, R_d: Array, R_e: Array, previous: QuaternionDisplacement | None = None
    ) -> QuaternionDisplacement:
        """Return {eta_de, eps_de_e} and e = R_e e_e, eq. (27)."""
        Q_de = self.options.sign.mutual(R_e, R_d, previous and previous.Q_de)
        return QuaternionDisplacement(Q_de, R_e @ self.e(Q_de), R_e)

    def velocity(self, x_de: QuaternionDisplacement, omega_d: Array, k_Po: float) -> Array:
        """Return omega_d + k_Po e, eq. (28) with e for eps_de."""
        return self.finite(omega_d + k_Po * x_de.error)

    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return domega_d + k_Vo Delta omega_de + k_Po e, eq. (40) with e for eps_de."""
        return self.finite(domega_d + k_Vo * (omega_d - omega_e) + k_Po * x_de.error)

    def singularity_distance(self, R_d: Array, R_e: Array) -> float:
        """Return how far [rad] the angle of the error is from the nearest singular one."""
        theta = angle_between(R_e, R_d)
        return min((abs(theta - angle) for angle in self.singular_errors), default=math.inf)

    def relative_state(self, R_d: Array, omega_d: Array, R_c: Array, omega_c: Array) -> Array:
        """Return y of two frames."""
        eta, eps = mutual_R(R_d, R_c)
        return np.concatenate(((eta,), eps, R_d.T @ (omega_c - omega_d)))

    def state_rate(self, y: Array, mu_d: Array, Z: Matrices) -> Array:
        """Return dy of (16), (17) and (59), (60)."""
        mu_E = self.elastic_moment(y.item(0), y[1:4], Z.K)
        return _rate(y, mu_d, mu_E, Z.M_inverse, Z.D)

    def normalised(self, y: Array) -> Array:
        """Return y with a unit quaternion."""
        y[:4] /= math.sqrt(y[:4] @ y[:4])
        return y

    def compliant_rotation(
        self, y: Array, dy: Array, mu_d: Array, R_d: Array, omega_d: Array, domega_d: Array
    ) -> tuple[Array, Array, Array]:
        """Return the rotation of R_c = R_d R_cd and of x."""
        R_cd = R_quaternion(y.item(0), y[1:4])
        return in_base(R_d, R_cd, omega_d, domega_d, y[4:], dy[4:])

    def o(self, Q: EulerParameters) -> Array:
        """Return the vector (3,) of the one of +-Q that turns by pi at most, over its slope."""
        return self.e(-Q if Q.eta < 0.0 else Q) / self.slope

    def elastic_energy(self, Q_cd: EulerParameters, K_o: Array) -> float:
        """Return the energy [J] whose rate along x is mu_E' x: the second term of (68)."""
        o = self.o(Q_cd)
        return dot(o, turn(K_o, o)) / 2.0

    def spring(self, R_d: Array, R_e: Array, K_o: Array) -> RotationalSpring:
        """Return the spring of (62), (66) between a desired frame and another."""
        Q = mutual_R(R_d, R_e)
        moment = -(R_d @ self.elastic_moment(*Q, K_o))
        return RotationalSpring(moment, self.elastic_energy(Q, K_o), R_d)

    def least_moment(self, K_o: Array) -> float:
        """Return the largest elastic moment [Nm], of 180 angles, about the axis that has least."""
        largest = []
        for r in np.linalg.eigh(K_o)[1].T:
            turns = [EulerParameters.from_angle_axis(math.radians(deg), r) for deg in range(180)]
            largest.append(max(abs(float(r @ self.elastic_moment(*Q, K_o))) for Q in turns))
        return min(largest)

    def lyapunov_3(self, R_cd: Array, x: Array, Z: Impedance, mu_d: Array) -> Lyapunov:
        """Return V_3 = x' M_o x / 2 + energy, (68), and dV_3 = -x' D_o x + mu^d' x, (69)."""
        energy = self.elastic_energy(quaternion(R_cd), Z.K)
        return Lyapunov(float(x @ Z.M @ x) / 2 + energy, float(mu_d @ x - x @ Z.D @ x))


@jit(new_vector(vector, vector, vector, matrix, matrix))
def _rate(y: Array, mu_d: Array, mu_E: Array, M_inverse: Array, D: Array) -> Array:
    """Return dy; the last of M_o dx + D_o x + mu_E = mu^d, eqs. (59), (60)."""
    x, dy = y[4:], np.empty(7)
    dy[0], dy[1:4] = propagation(y[0], y[1:4], x)  # eqs. (16), (17)
    dy[4:] = turn(M_inverse, mu_d - turn(D, x) - mu_E)  # eq. (59)
    return dy
