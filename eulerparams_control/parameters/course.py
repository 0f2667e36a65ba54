"""Six numbers over time, as force and moment: straight from point to point, and a sine."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.rotations import Array

SIZE = 6
"""How many numbers a point has."""


@dataclass(frozen=True)
class Course:
    """Numbers over time; the first point counts before its time, the last one after it.

    Attributes:
        times: (N,) [s] of the points, increasing.
        points: (N, 6).
        swing: (6,) amplitudes of a sine that is added, from the first time to the last.
        frequency: [Hz] of the sine; it begins at 0.
    """

    times: Array
    points: Array
    swing: Array
    frequency: float

    def at(self, t: float) -> Array:
        """Return the numbers (6,) at a time [s]."""
        line = np.array([np.interp(t, self.times, column) for column in self.points.T])
        since = min(max(t, self.times[0]), self.times[-1]) - self.times[0]
        found: Array = line + self.swing * math.sin(2.0 * math.pi * self.frequency * since)
        return found


def parse_course(
    name: str,
    times: Sequence[float],
    values: Sequence[float],
    swing: Sequence[float] = (),
    frequency: float = 1.0,
) -> Course:
    """Return the course of N points.

    Args:
        name: what it is of, for people.
        times: N times [s].
        values: 6 N numbers, those of each point in a row.
        swing: 6 amplitudes of a sine; none is no sine.
        frequency: [Hz] of the sine.

    Raises:
        ConfigurationError: if the numbers of values do not fit, or one is impossible.
    """
    n = len(times)
    if n == 0 or len(values) != SIZE * n or len(swing) not in (0, SIZE):
        raise ConfigurationError(
            f"{name}: {n} times, {len(values)} values, {len(swing)} of a swing; expected N, 6 N, "
            "and 6 or none"
        )
    numbers = np.array([*times, *values, *swing], dtype=float)
    if not (np.isfinite(numbers).all() and np.all(np.diff(times) > 0) and times[0] >= 0):
        raise ConfigurationError(
            f"{name}: times {list(times)}, values {list(values)}, swing {list(swing)}; expected "
            "finite numbers, and times from 0 on that increase"
        )
    amplitudes = np.array(swing or (0.0,) * SIZE, dtype=float)
    points = np.reshape(np.array(values, dtype=float), (n, SIZE))
    return Course(np.array(times, dtype=float), points, amplitudes, frequency)
