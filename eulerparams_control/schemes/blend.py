"""How a command goes over from one law to another without a jump."""

import math

import numpy as np

from eulerparams_control.rotations import Array


class Blend:
    """The step between the last command and a new law, decaying at the rate 1 / time.

    Args:
        time: [s] of the decay.
    """

    def __init__(self, time: float) -> None:
        self.time = time
        self.reset()

    def reset(self) -> None:
        """Forget the step."""
        self._offset: Array | None = None
        self._last: Array | None = None

    def replace(self, last: Array) -> None:
        """Begin at the command ``last`` (n,): the next one is of a new law."""
        self._last = last

    def offset(self, dt: float, command: Array) -> Array | float:
        """Return what is to be added (n,) to the command of the law, dt [s] after the last."""
        if self._last is not None:
            self._offset, self._last = self._last - command, None
        elif self._offset is not None:
            self._offset = self._offset * math.exp(-dt / self.time)
            if not np.any(np.abs(self._offset) > 1e-12):
                self._offset = None
        return 0.0 if self._offset is None else self._offset
