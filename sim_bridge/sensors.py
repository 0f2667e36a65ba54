"""The sensors of the robot: noise, counts of the encoders, turns."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.rotations import Array
from sim_bridge.encoders import Encoders
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.servo import wrapped


class SimulatorState(NamedTuple):
    """What the robot's drivers report.

    Attributes:
        step: number of steps since the reset.
        t: ``step / rate``, s.
        q: (n,) measured.
        dq: (n,) measured; NaN where the drivers report none.
        tau: (n,) effort of the motors during the last step.
        wrench: (6,) measured.
    """

    step: int
    t: float
    q: Array
    dq: Array
    tau: Array
    wrench: Array


class Sensors:
    """The sensors of the joints and of the wrench.

    Args:
        parameters: how they measure.
        turning: (n,) whether the position of a joint counts modulo a turn.
    """

    def __init__(self, parameters: SimulatorParameters, turning: Array) -> None:
        self._parameters, self._turning = parameters, turning
        self._wraps = bool(turning.any())
        self._noise = parameters.noise(len(turning))
        self._is_noisy = bool(np.any(self._noise))
        self._encoders = Encoders(
            parameters.encoder_resolution, parameters.velocity_cutoff, 1.0 / parameters.rate
        )
        self.reset()

    def reset(self) -> None:
        """Begin at a robot at rest; the noise restarts."""
        self._random = np.random.default_rng(self._parameters.seed)
        self._encoders.reset()

    def measure(self, q: Array, dq: Array, wrench: Array) -> tuple[Array, Array, Array]:
        """Return what is measured of q and dq, (n,) each, and of the wrench (6,)."""
        if self._is_noisy:
            noise, n = self._noise * self._random.standard_normal(len(self._noise)), len(q)
            q, dq, wrench = q + noise[:n], dq + noise[n : 2 * n], wrench + noise[2 * n :]
        if not self._encoders.are_exact:
            q, dq = self._encoders.measure(q, dq)
        if self._wraps:
            q = wrapped(q, self._turning)
        if not self._parameters.velocities:
            dq = np.full_like(dq, np.nan)
        return q, dq, wrench
