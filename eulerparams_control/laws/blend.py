"""Bumpless transfer of a command from one law to another."""

import math

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import Array

# Smallest step that is blended [rad/s or rad/s^2].
_NOTHING = 1e-12


class Blend:
    """The step between the last command and a new law, decaying at the rate 1 / time.

    Args:
        time: [s] of the decay.

    Raises:
        ConfigurationError: if it is not positive.
    """

    def __init__(self, time: float) -> None:
        if not 0 < time < math.inf:
            raise ConfigurationError(f"blend_time is {time}; expected a positive time")
        self.time = time
        self.reset()

    def reset(self) -> None:
        """Forget the step."""
        self._offset: Array | None = None
        self._last: Array | None = None

    def replace(self, last: Array) -> None:
        """Begin at the command ``last`` (n,): the next one is of a new law."""
        self._last = last

    def blended(self, dt: float, command: Array) -> Array:
        """Return the command (n,) of the law, dt [s] after the last, with what is left."""
        offset = self.offset(dt, command)
        return command + offset if isinstance(offset, np.ndarray) else command

    def offset(self, dt: float, command: Array) -> Array | float:
        """Return what is to be added (n,) to the command of the law, dt [s] after the last."""
        decays = self._offset is not None  # else it begins: without a jump
        if self._last is not None:
            # it decays through further changes: laws replaced at each tick must act in the end
            self._offset, self._last = self._last - command, None
        if self._offset is None:
            return 0.0
        if decays:
            self._offset = self._offset * math.exp(-dt / self.time)
        if not np.any(np.abs(self._offset) > _NOTHING):
            self._offset = None
            return 0.0
        return self._offset
