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
from collections.abc import Callable

import numpy as np

from eulerparams_control.laws.impedance_matrices import Impedance

# The ratio of the stiffness at which the contact oscillates to the stiffest one.
_MARGIN = 2.0

# Where no value up to this will do, none does; halvings of the interval in which one lies.
_NEVER, _HALVINGS = 1e9, 100


def stiffest_contact(Z: Impedance, lag: float, delay: float) -> float:
    """Return the stiffness [N/m] of the stiffest contact that is stable, (CB2); inf: any is.

    Along each axis of the damping; those of M and K should be the same.  The delay T [s] has that
    of the sensor in it.
    """
    _, axes = np.linalg.eigh(Z.D)
    along = (tuple(float(u @ A @ u) for A in (Z.M, Z.D, Z.K)) for u in axes.T)
    return min(_along(M, D, K, lag, delay) for M, D, K in along) / _MARGIN


def _along(M: float, D: float, K: float, lag: float, delay: float) -> float:
    """Return the stiffness [N/m] at which the contact oscillates along an axis."""

    def is_late(w: float) -> bool:
        """Return whether the phase of P(i w), which falls with w, is -pi or less."""
        return w * delay + math.atan(w * lag) + math.atan2(D * w, K - M * w * w) >= math.pi

    w = _least(is_late)
    if math.isinf(w):
        return w
    s = 1j * w
    return abs((1.0 + s * lag) * (M * s * s + D * s + K) * cmath.exp(s * delay))


def damping_for(stiffness: float, M: float, lag: float, delay: float) -> float:
    """Return the damping [Ns/m] with which a contact of a stiffness [N/m] is stable, (CB2)."""
    return _least(lambda D: _along(M, D, 0.0, lag, delay) >= _MARGIN * stiffness)


def _least(will_do: Callable[[float], bool]) -> float:
    """Return the least value that will do, as all larger ones; inf if none does."""
    low, high = 0.0, 1.0
    while not will_do(high):
        high *= 2.0
        if high > _NEVER:
            return math.inf
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if will_do(middle) else (middle, high)
    return high
