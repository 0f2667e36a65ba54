"""Intervals near a pole of the Euler angles, which the plots shade and mark."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.recording import Recording
from eulerparams_control.laws.rotations import Array

NEAR = math.radians(5)
"""Angle [rad] to the pole below which a plot is shaded."""

NEAR_SINGULAR = 0.05
"""Smallest singular value of J below which a plot is shaded, if no controller says its own."""

_MOST = 50  # most intervals that are shaded: a noisy run may have very many

type Interval = tuple[float, float]
"""From, to [s]."""


class Approach(NamedTuple):
    """Closest approach of a run to the pole of its Euler angles.

    Attributes:
        t: when [s].
        distance: how close [rad].
        sequence: of which Euler angles.
    """

    t: float
    distance: float
    sequence: str


def approach(recording: Recording) -> Approach:
    """Return the closest approach of a run."""
    index = int(recording.pole_distance.argmin())
    distance = float(recording.pole_distance[index])
    return Approach(float(recording.leading.t[index]), distance, recording.sequence.name)


def near_pole(recording: Recording) -> list[Interval]:
    """Return the intervals [s] in which a run is near a pole of its Euler angles."""
    return _intervals(recording.leading.t, recording.pole_distance < NEAR)


def near_singular(recording: Recording) -> list[Interval]:
    """Return the intervals [s] in which the arm is near a kinematic singularity.

    Where the damped inverse of the controller damps: below its damping_eps.
    """
    eps = float(recording.parameter("damping_eps", NEAR_SINGULAR))
    return _intervals(recording.leading.t, recording.leading.smallest_singular_value < eps)


def merged(intervals: Iterable[Interval]) -> list[Interval]:
    """Return the union of intervals, in order; at most some tens of them."""
    found: list[Interval] = []
    for start, end in sorted(intervals):
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        else:
            found.append((start, end))
    return found[:_MOST]


def _intervals(t: Array, inside: NDArray[np.bool_]) -> list[Interval]:
    steps = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])).astype(int)))
    return [(float(t[i]), float(t[j - 1])) for i, j in zip(steps[::2], steps[1::2], strict=True)]
