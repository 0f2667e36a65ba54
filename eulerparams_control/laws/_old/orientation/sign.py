"""The sign of the mutual quaternion: +-(eta, eps) are the same orientation.

Both are the same rotation, but the laws (28), (40) and (51) pull along eps, so
the sign decides which way round the error is undone:

``shortest``    eta >= 0: always the short way; chatters at theta = pi under noise.
``hysteretic``  keeps its sign until eta < -delta: the short way, no chattering at pi.
``continuous``  never flips: what (44)-(47) analyse; may take the long way round.

The sign is chosen on the error, never on Q_d and Q_e apart: ``separate`` does that, to show
that a small error can then look like a turn of almost 360 deg.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws._old.compiled import formula
from eulerparams_control.laws._old.linear import Mat
from eulerparams_control.laws._old.rotations import (
    Array,
    EulerParameters,
    inner,
    mutual,
    mutual_R,
    opposite,
    quaternion,
)

SIGNS = ("shortest", "hysteretic", "continuous")
SEPARATE = "separate"
_RULES = (*SIGNS, SEPARATE)
_SHORTEST, _HYSTERETIC, _CONTINUOUS, _SEPARATE = range(4)


_NONE = EulerParameters(0.0, np.zeros(3))


class Sign(NamedTuple):
    """A rule for the sign in numbers: its place in the list, delta and the initial sign."""

    rule: int
    delta: float
    initial: float


@formula
def signed_mutual(R_e: Mat, R_d: Mat, previous: EulerParameters, sign: Sign) -> EulerParameters:
    """Return {eta_de, eps_de_e} of R_e' R_d with its sign, eqs. (11)-(13).

    Args:
        R_e, R_d: the two orientations.
        previous: what was returned for the sample before; zero at the first.
        sign: the rule.
    """
    if sign.rule == _SEPARATE:
        return mutual(quaternion(R_e), quaternion(R_d))
    return chosen(mutual_R(R_e, R_d), previous, sign)


@formula
def chosen(Q: EulerParameters, previous: EulerParameters, sign: Sign) -> EulerParameters:
    """Return Q or -Q, given what was returned for the sample before, zero at the first."""
    if sign.rule == _SHORTEST or inner(previous, previous) == 0.0:
        return opposite(Q) if Q.eta * sign.initial < 0.0 else Q
    if inner(Q, previous) < 0.0:
        Q = opposite(Q)
    return opposite(Q) if sign.rule == _HYSTERETIC and Q.eta < -sign.delta else Q


@dataclass(frozen=True)
class SignRule:
    """How the sign of the mutual quaternion follows from its predecessor.

    Args:
        name: one of ``SIGNS``, or ``SEPARATE``.
        delta: hysteresis in eta, in [0, 1); theta flips beyond 2 acos(-delta).
        initial: sign of eta at the first sample, 1; or -1, with ``continuous`` only.

    Raises:
        UnknownNameError: if there is no such rule.
        ConfigurationError: if delta or the initial sign is impossible.
    """

    name: str = "hysteretic"
    delta: float = 0.2
    initial: int = 1

    def __post_init__(self) -> None:
        if self.name not in _RULES:
            raise UnknownNameError("sign of the quaternion", self.name, SIGNS)
        if not 0 <= self.delta < 1:
            raise ConfigurationError(f"hysteresis is {self.delta}; expected in [0, 1)")
        if not (self.initial == 1 or (self.initial == -1 and self.name == "continuous")):
            raise ConfigurationError(
                f"the initial sign of eta is {self.initial}; expected 1, or -1 with continuous"
            )

    @cached_property
    def values(self) -> Sign:
        """The rule in numbers."""
        return Sign(_RULES.index(self.name), self.delta, self.initial)

    def mutual(self, R_e: Array, R_d: Array, previous: EulerParameters | None) -> EulerParameters:
        """Return {eta_de, eps_de_e} of R_e' R_d (3, 3): see :func:`signed_mutual`."""
        return signed_mutual(R_e, R_d, previous or _NONE, self.values)

    def choose(self, Q: EulerParameters, previous: EulerParameters | None) -> EulerParameters:
        """Return Q or -Q, given what was returned for the sample before (None: eta >= 0)."""
        return chosen(Q, previous or _NONE, self.values)
