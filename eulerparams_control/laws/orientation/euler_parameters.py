"""Euler parameters: the vector part of the mutual unit quaternion, eqs. (27), (30), (42), (66)."""

from typing import Any

from eulerparams_control.laws.jit import f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.orientation.base import Lyapunov
from eulerparams_control.laws.orientation.relative_quaternion import (
    QuaternionDisplacement,
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.rotations import Array, EulerParameters, cross, turn


class EulerParametersRepresentation(RelativeQuaternionRepresentation):
    """The orientation error is eps_de = R_e eps_de_e, eq. (27); no orientation is singular."""

    name = "euler_parameters"
    symbol = "eps_de"
    slope = 0.5
    singular_errors = ()

    def e(self, Q: EulerParameters) -> Array:
        """Return eps = sin(theta / 2) r."""
        return Q.eps

    def velocity(self, x_de: QuaternionDisplacement, omega_d: Array, k_Po: float) -> Array:
        """Return the lower half of the bracket of (28)."""
        eps_de = x_de.error
        return omega_d + k_Po * eps_de  # (28)

    def acceleration(
        self, x_de: Any, omega_d: Array, domega_d: Array, omega_e: Array, k_Po: float, k_Vo: float
    ) -> Array:
        """Return the acceleration of (40)."""
        eps_de, omega_de = x_de.error, omega_d - omega_e
        return domega_d + k_Vo * omega_de + k_Po * eps_de  # (40)

    @staticmethod
    @jit(new_vector(f8, vector, matrix))
    def elastic_moment(eta: float, eps: Array, K_o: Array) -> Array:
        """Return K_o' eps = 2 E' K_o eps = 2 (eta K_o eps + S(eps) K_o eps), eqs. (60), (66)."""
        K_eps = turn(K_o, eps)
        return 2.0 * (eta * K_eps + cross(eps, K_eps))

    def lyapunov_1(self, x_de: QuaternionDisplacement, k_Po: float) -> Lyapunov:
        """Return V_1 = (eta - 1)^2 + eps' eps and dV_1 = -k_Po eps' eps, eqs. (30), (31)."""
        eta, eps = x_de.Q_de
        eps_2 = float(eps @ eps)
        return Lyapunov((eta - 1) ** 2 + eps_2, -k_Po * eps_2)

    def lyapunov_2(
        self, x_de: QuaternionDisplacement, omega_de: Array, k_Po: float, k_Vo: float
    ) -> Lyapunov:
        """Return V_2 = k_Po V_1 + omega_de' omega_de / 2 and its derivative, eqs. (42), (43)."""
        omega_2 = float(omega_de @ omega_de)
        return Lyapunov(k_Po * self.lyapunov_1(x_de, k_Po).V + omega_2 / 2, -k_Vo * omega_2)
