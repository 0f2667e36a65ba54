"""Bumpless transfer of a command from one law to another."""

import math

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import Array, Row, kernel

# Smallest step that is blended [rad/s or rad/s^2].
_NOTHING = 1e-12

# What is where in the row of a blend; behind it the last command of the law before, and the step.
_TIME, _IS_NEW, _IS_LEFT, _LAST = range(4)


class Blend:
    """The step between the last command and a new law, decaying at the rate 1 / time.

    Args:
        time: [s] of the decay.
        n: number of values of a command.

    Attributes:
        row: as :func:`blend` takes it.

    Raises:
        ConfigurationError: if the time is not positive.
    """

    def __init__(self, time: float, n: int) -> None:
        if not 0 < time < math.inf:
            raise ConfigurationError(f"blend_time is {time}; expected a positive time")
        self.row: Array = np.zeros(_LAST + 2 * n)
        self.row[_TIME], self._n = time, n

    def reset(self) -> None:
        """Forget the step."""
        self.row[_IS_NEW:] = 0.0

    def replace(self, last: Array) -> None:
        """Begin at the command ``last`` (n,): the next one is of a new law."""
        self.row[_IS_NEW], self.row[_LAST : _LAST + self._n] = 1.0, last


@kernel
def blend(row: Row, dt: float, command: Row) -> None:
    """Add to a command (n,) of a law what is left of its step, dt [s] after the command before.

    The step begins without a jump.  It decays through further changes: laws that are replaced at
    each tick must act in the end.  The next command is of the same law once this one is ``kept``.
    """
    n, largest = len(command), 0.0
    last, left = row[_LAST : _LAST + n], row[_LAST + n :]
    for i in range(n):
        largest = max(largest, abs(left[i]))
    is_left = row[_IS_LEFT] != 0.0 and largest > _NOTHING
    row[_IS_LEFT] = 1.0 if is_left or row[_IS_NEW] != 0.0 else 0.0
    if row[_IS_LEFT] == 0.0:
        return
    share = math.exp(-dt / row[_TIME]) if is_left else 1.0
    for i in range(n):
        left[i] = share * (last[i] - command[i] if row[_IS_NEW] != 0.0 else left[i])
        command[i] += left[i]


@kernel
def kept(row: Row) -> None:
    """Take the last command for one of the new law."""
    row[_IS_NEW] = 0.0
