"""Bumpless transfer of a command from one law to another."""

import math

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.compiled import NONE, Array, Input, Row, kernel

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
        self._left = self._last = NONE

    def replace(self, last: Array) -> None:
        """Begin at the command ``last`` (n,): the next one is of a new law."""
        self._last = last

    def step(self, dt: float) -> tuple[Array, Array, float]:
        """Return what :func:`add_left` takes, dt [s] after the last command."""
        last, left = self._last, self._left
        if left is not NONE and not np.any(np.abs(left) > _NOTHING):
            self._left = left = NONE
        if last is left is NONE:
            return NONE, NONE, 1.0
        if left is NONE:  # it begins: without a jump
            self._left = left = np.zeros_like(last)
            return last, left, 1.0
        # it decays through further changes: laws replaced at each tick must act in the end
        return last, left, math.exp(-dt / self.time)

    def kept(self) -> None:
        """Take the last command for one of the new law."""
        self._last = NONE

    def blended(self, dt: float, command: Array) -> Array:
        """Return the command (n,) of the law, dt [s] after the last, with what is left."""
        last, left, share = self.step(dt)
        if left is not NONE:
            command = command.copy()
            add_left(last, left, share, command)
        self.kept()
        return command


@kernel
def add_left(last: Input, left: Row, share: float, command: Row) -> None:
    """Add to a command (n,) of a law what is left of its step; ``left`` (0,) is nothing.

    Args:
        last: (n,) of the law before, where this is the first command of its follower; else (0,).
        left: (n,) of the step, which moves on.
        share: of it that stays.
        command: (n,) of the law.
    """
    for i in range(len(left)):
        left[i] = share * (last[i] - command[i] if len(last) > 0 else left[i])
        command[i] += left[i]
