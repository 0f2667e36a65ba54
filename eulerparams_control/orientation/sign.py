"""Which of +-(eta, eps) stands for a mutual orientation.

Both stand for the same rotation, but the laws (28), (40) and (51) pull along eps, so
the sign decides which way round the error is undone:

``shortest``    eta >= 0: always the short way; chatters at theta = pi under noise.
``hysteretic``  keeps its sign until eta < -delta: the short way, no chattering at pi.
``continuous``  never flips: what (44)-(47) analyse; may take the long way round.

The sign is chosen on the error, never on Q_d and Q_e apart.
"""

from dataclasses import dataclass

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.rotations import EulerParameters

SIGNS = ("shortest", "hysteretic", "continuous")


@dataclass(frozen=True)
class SignRule:
    """How the sign of the mutual quaternion follows from its predecessor.

    Args:
        name: one of ``SIGNS``.
        delta: hysteresis in eta, in [0, 1); theta flips beyond 2 acos(-delta).

    Raises:
        UnknownNameError: if there is no such rule.
        ConfigurationError: if delta is out of bounds.
    """

    name: str = "hysteretic"
    delta: float = 0.2

    def __post_init__(self) -> None:
        if self.name not in SIGNS:
            raise UnknownNameError("sign of the quaternion", self.name, SIGNS)
        if not 0 <= self.delta < 1:
            raise ConfigurationError(f"hysteresis is {self.delta}; expected in [0, 1)")

    def choose(self, Q: EulerParameters, previous: EulerParameters | None) -> EulerParameters:
        """Return Q or -Q, given what was returned for the sample before (None: eta >= 0)."""
        if previous is None or self.name == "shortest":
            return -Q if Q.eta < 0 else Q
        if Q.eta * previous.eta + float(Q.eps @ previous.eps) < 0:
            Q = -Q
        if self.name == "hysteretic" and Q.eta < -self.delta:
            return -Q
        return Q
