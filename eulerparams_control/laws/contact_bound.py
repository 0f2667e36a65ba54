"""How stiff a contact may be, where the arm follows its compliant frame late.

The arm that follows late feels late, too.  With the lag tau and the delay T of its servo, and the
stiffness K_e of a contact, (52) closes the loop

    M s^2 + D s + K + K_e e^(-s T) / (1 + s tau) = 0                                           (CB1)

along an axis.  The loop oscillates for ever where K_e is 1 / |P(i w)| with

    P(s) = e^(-s T) / ((1 + s tau) (M s^2 + D s + K)),  arg P(i w) = -pi                       (CB2)

and a contact is stable with a margin of 2 (6 dB) up to half of that (Nyquist).
"""

import cmath
import math

import numpy as np

from eulerparams_control.laws.impedance_matrices import Impedance

MARGIN = 2.0
"""The ratio of the stiffness at which the contact oscillates to the stiffest one."""

# Halvings of the interval in which the frequency lies.
_HALVINGS = 100


def stiffest_contact(Z: Impedance, lag: float, delay: float) -> float:
    """Return the stiffness [N/m] of the stiffest contact that is stable with the margin, (CB2).

    Along each axis of the damping; those of M and K should be the same.  inf: any.

    Args:
        Z: M_p, D_p, K_p.
        lag, delay: tau and T [s] with which the tip follows the compliant frame, the delay of the
            sensor in it.
    """
    _, axes = np.linalg.eigh(Z.D)
    along = (tuple(float(u @ A @ u) for A in (Z.M, Z.D, Z.K)) for u in axes.T)
    return min(_along(M, D, K, lag, delay) for M, D, K in along) / MARGIN


def _along(M: float, D: float, K: float, lag: float, delay: float) -> float:
    """Return the stiffness [N/m] at which the contact oscillates along an axis."""

    def late(w: float) -> float:
        """Return minus the phase [rad] of P(i w), which grows with w."""
        return w * delay + math.atan(w * lag) + math.atan2(D * w, K - M * w * w)

    low, high = 0.0, 1.0
    while late(high) < math.pi:
        high *= 2.0
        if high > 1e9:
            return math.inf  # it is not late
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if late(middle) < math.pi else (low, middle)
    s = 1j * high
    return abs((1.0 + s * lag) * (M * s * s + D * s + K) * cmath.exp(s * delay))


def damping_for(stiffness: float, M: float, lag: float, delay: float) -> float:
    """Return the damping [Ns/m] with which a contact of a stiffness [N/m] is stable, (CB2)."""
    low, high = 0.0, 1.0
    while _along(M, high, 0.0, lag, delay) < MARGIN * stiffness:
        high *= 2.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        stable = _along(M, middle, 0.0, lag, delay) >= MARGIN * stiffness
        low, high = (low, middle) if stable else (middle, high)
    return high
