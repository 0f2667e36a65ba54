"""Bumpless transfer of a command from one law to another."""

import math

import numpy as np

from eulerparams_control.laws.jit import Array

# Smallest step that is blended [rad/s or rad/s^2].
_NOTHING = 1e-12


class Blend:
    """The step between the last command (n,) and a new law, decaying at the rate 1 / time [1/s]."""

    def __init__(self, time: float, n: int) -> None:
        self._time, self._step = time, np.zeros(n)
        self.reset()

    def reset(self) -> None:
        """Forget the step."""
        self._last: Array | None = None
        self._decays = False

    def replace(self, last: Array) -> None:
        """Begin at the command ``last`` (n,): the next one is of a new law."""
        self._last = last.copy()

    def __call__(self, dt: float, command: Array) -> Array:
        """Return a command (n,) with what is left of the step, dt [s] after the command before.

        The step begins without a jump.  It decays through further changes: laws that are replaced
        at each tick must act in the end.  The next command is of the same law after ``keep``.
        """
        self._decays = self._decays and bool((np.abs(self._step) > _NOTHING).any())
        if self._last is None and not self._decays:
            return command
        share = math.exp(-dt / self._time) if self._decays else 1.0
        self._step = share * (self._step if self._last is None else self._last - command)
        self._decays = True
        return command + self._step

    def keep(self) -> None:
        """Take the last command for one of the new law."""
        self._last = None
