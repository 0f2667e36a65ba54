"""From one impedance to another while it acts: smoothly, and with the energy of a tank.

Stiffness that grows under a displacement adds energy to the arm, and so does a mass that grows in
motion.  A tank has it: what the damping takes fills the tank, and the change waits where the tank
is empty (Ferraguti, Secchi and Fantuzzi, A tank-based approach to impedance control with variable
stiffness, 2013).  So all that the contact is ever given is what it gave, and one tank.

    s        = how far the change is, from 0 to 1; ds = (1 - s) / T                           (IC1)
    K(s)     = W^2, W = (1 - s) K_0^1/2 + s K_1^1/2                                           (IC2)
    M(s)     = (1 - s) M_0 + s M_1, D(s) = (1 - s) D_0 + s D_1                                (IC3)
    E(s)     = (dx' M dx + x' K x) / 2 + (dy' M_o dy) / 2 + U(K_o), at the displacement x, y  (IC4)
    dt_tank  = dx' D dx + dy' D_o dy - (dE/ds) ds, from 0 to the most                         (IC5)

With D = 2 zeta (M K)^1/2 at both ends the damping ratio zeta holds all the way (IC2, IC3), where M
stays and has the axes of K.  By (IC2), (IC3) the ratios v'Dv / v'Mv and v'Kv / v'Mv are on the way
no larger than at one of the ends, so that the rate is at most twice that of the faster one.

Notation: ``Z_0, Z_1`` (M, D, K) of before and after.
"""

import math

from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.jit import Array

_CHANGE_TIME = 0.05  # T [s]: a change is 95 % done after three times that
_DONE = 1e-6  # what is left of a change when it ends


def later(s: float, dt: float) -> float:
    """Return s, dt [s] later, (IC1)."""
    s = 1.0 - (1.0 - s) * math.exp(-dt / _CHANGE_TIME)
    return s if s < 1.0 - _DONE else 1.0


def between(s: float, Z_0: Impedance, Z_1: Impedance) -> tuple[Array, Array, Array]:
    """Return M, D, K (3, 3) on the way from one impedance to another."""
    W = (1.0 - s) * Z_0.K_half + s * Z_1.K_half
    M = (1.0 - s) * Z_0.M + s * Z_1.M  # (IC3)
    D = (1.0 - s) * Z_0.D + s * Z_1.D
    return M, D, W @ W  # (IC2)
