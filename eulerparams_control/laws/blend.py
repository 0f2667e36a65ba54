"""Bumpless transfer of a command from one law to another."""

import math

import numpy as np

from eulerparams_control.laws.jit import Array

# Smallest step that is blended [rad/s, rad/s^2, N or Nm].
_NOTHING = 1e-12


class Blend:
    """The step between the last command and a new law, which decays at the rate 1 / time [1/s]."""

    def __init__(self, time: float) -> None:
        self._time = time
        self.reset()

    def reset(self) -> None:
        """Forget the step."""
        self._last: Array | None = None
        self._step: Array | None = None

    def replace(self, last: Array) -> None:
        """Begin at the command ``last`` (n,): the next one is of a new law."""
        self._last = last.copy()

    def __call__(self, dt: float, command: Array) -> Array:
        """Return a command (n,) with what is left of the step, dt [s] after the command before.

        The step begins without a jump.  It decays through further changes: laws that are replaced
        at each tick must act in the end.
        """
        if self._last is not None:
            step = self._last - command
        elif self._step is not None:
            step = self._step
        else:
            return command
        if self._step is not None:
            step = math.exp(-dt / self._time) * step
        self._last, self._step = None, step if (np.abs(step) > _NOTHING).any() else None
        return command + step
