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

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.jit import Array
from eulerparams_control.laws.rotations import EulerParameters, dot, mutual, mutual_R, quaternion

SIGNS = ("shortest", "hysteretic", "continuous")
SEPARATE = "separate"


@dataclass(frozen=True)
class SignRule:
    """How the sign of the mutual quaternion follows from its predecessor."""

    name: str = "hysteretic"
    delta: float = 0.2  # hysteresis in eta, in [0, 1); theta flips beyond 2 acos(-delta)
    initial: int = 1  # sign of eta at the first sample

    def __post_init__(self) -> None:
        if self.name not in (*SIGNS, SEPARATE):
            raise UnknownNameError("sign of the quaternion", self.name, SIGNS)
        if not 0 <= self.delta < 1:
            raise ConfigurationError(f"hysteresis is {self.delta}; expected in [0, 1)")
        if not (self.initial == 1 or (self.initial == -1 and self.name == "continuous")):
            raise ConfigurationError(
                f"the initial sign of eta is {self.initial}; expected 1, or -1 with continuous"
            )

    def mutual(self, R_e: Array, R_d: Array, previous: EulerParameters | None) -> EulerParameters:
        """Return {eta_de, eps_de_e} of R_e' R_d with its sign, eqs. (11)-(13); see ``choose``."""
        if self.name == SEPARATE:
            return mutual(quaternion(R_e), quaternion(R_d))
        return self.choose(mutual_R(R_e, R_d), previous)

    def choose(self, Q: EulerParameters, previous: EulerParameters | None) -> EulerParameters:
        """Return Q or -Q, given what was returned for the sample before (None: the first)."""
        if self.name == "shortest" or previous is None:
            return -Q if Q.eta * self.initial < 0 else Q
        if Q.eta * previous.eta + dot(Q.eps, previous.eps) < 0:
            Q = -Q
        return -Q if self.name == "hysteretic" and Q.eta < -self.delta else Q
