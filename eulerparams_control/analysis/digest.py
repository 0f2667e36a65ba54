"""Digest of a run for page, table and figures: small however long the run was.

A run of an hour at 1 kHz has millions of samples; its digest has some thousands of points, chosen
so that every peak survives.

    digest = Digest.of(load("out/demo/euler_parameters"))
    digest.curves["orientation_error"]     # [Curve(t, y)], one a component
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.quantities import EVERYTHING, NUMBERS, TableNumber, get_metric
from eulerparams_control.analysis.recording import RecordedRun, Recording
from eulerparams_control.analysis.reports import Report, shown
from eulerparams_control.analysis.series import Frames
from eulerparams_control.errors import BagError
from eulerparams_control.laws.rotations import Array

NEAR = math.radians(5)
"""Angle [rad] to the pole below which a plot is shaded."""

NEAR_SINGULAR = 0.05
"""Smallest singular value of J below which a plot is shaded, if no controller has its own."""

_MOST_INTERVALS = 50  # most intervals that are shaded: a noisy run may have very many

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
    return found[:_MOST_INTERVALS]


def _intervals(t: Array, inside: NDArray[np.bool_]) -> list[Interval]:
    steps = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])).astype(int)))
    ends = zip(steps[::2], steps[1::2], strict=True)
    return [(float(t[i]), float(t[j - 1])) for i, j in ends][:_MOST_INTERVALS]


def _computed(row: TableNumber, recording: Recording) -> float | None:
    """Return a number of the table; None if the run has none."""
    if row.needs and getattr(recording, row.needs) is None:
        return None
    try:
        return get_metric(row.metric).compute(recording, **row.options)
    except BagError:
        return None


BINS = 700
"""Bins of a curve: more than a screen has pixels."""

STEPS = 3000
"""Most instants of a track."""


class Curve(NamedTuple):
    """Points of a line: t (M,) [s], y (M,); NaN in y is a gap."""

    t: Array
    y: Array


class Track(NamedTuple):
    """Where everything was at M instants, for the replay.

    What was not recorded is NaN.

    Attributes:
        t: (M,) [s] from the beginning of the recording.
        q: (M, n) measured joint positions.
        p_e, R_e: (M, 3) [m], (M, 3, 3) the tip, base frame, of the measured motion.
        p_d, R_d: the desired frame.
        p_c, R_c: the compliant frame.
        f, mu: (M, 3) [N], [Nm] contact wrench at the tip, base axes.
    """

    t: Array
    q: Array
    p_e: Array
    R_e: Array
    p_d: Array
    R_d: Array
    p_c: Array
    R_c: Array
    f: Array
    mu: Array


@dataclass(frozen=True)
class Digest(RecordedRun):
    """A run, small.

    Attributes:
        why_no_wrench: why there is no contact wrench although one was recorded; "" if not so.
        start, end: [s] of what was analysed.
        approach: the closest to the pole of its Euler angles.
        near_pole: intervals [s] within 5 deg of it.
        near_singular: intervals [s] near a kinematic singularity.
        curves: of each quantity by its name, one a component; without those not recorded.
        highest: the largest finite |y| of each quantity by its name.
        numbers: of the table, by their place in it; None where not recorded.
        track: for the replay.
        reports: of its nodes; of a node with very many the first and the last.
        reports_left_out: how many are not among them.
    """

    why_no_wrench: str
    start: float
    end: float
    approach: Approach
    near_pole: Sequence[tuple[float, float]]
    near_singular: Sequence[tuple[float, float]]
    curves: Mapping[str, Sequence[Curve]] = field(repr=False)
    highest: Mapping[str, float] = field(repr=False)
    numbers: Sequence[float | None] = field(repr=False)
    track: Track = field(repr=False)
    reports: Sequence[Report] = ()
    reports_left_out: int = 0

    @classmethod
    def of(cls, recording: Recording) -> "Digest":
        """Return the digest of a run."""
        curves, highest = {}, {}
        for quantity in EVERYTHING:
            t, y = quantity.samples(recording)
            if len(t):
                columns = y.reshape(len(t), -1).T
                curves[quantity.name] = [Curve(*decimate(t, column, BINS)) for column in columns]
                highest[quantity.name] = float(np.abs(y[np.isfinite(y)]).max(initial=0.0))
        reports = shown(recording.reports)
        leading, measured = recording.leading, recording.measured
        return cls(
            **{entry.name: getattr(recording, entry.name) for entry in fields(RecordedRun)},
            why_no_wrench=recording.why_no_wrench if recording.sensed is not None else "",
            start=float(leading.t[0]),
            end=max(float(leading.t[-1]), float(measured.t[-1])),
            approach=approach(recording),
            near_pole=near_pole(recording),
            near_singular=near_singular(recording),
            curves=curves,
            highest=highest,
            numbers=[_computed(number, recording) for number in NUMBERS],
            track=_track(recording),
            reports=reports,
            reports_left_out=len(recording.reports) - len(reports),
        )


def _track(recording: Recording) -> Track:
    measured = recording.measured
    step = max(1, -(-len(measured.t) // STEPS))
    chosen = np.unique(np.append(np.arange(0, len(measured.t), step), len(measured.t) - 1))
    t = measured.t[chosen]
    wrench = recording.contact
    nothing = np.full((len(t), 3), np.nan)
    f, mu = wrench.at(t) if wrench is not None else (nothing, nothing)
    compliant = Frames.nowhere(len(measured.t))
    if recording.compliant is not None:
        compliant = recording.compliant.at(measured.t)
    return Track(
        t,
        measured.q[chosen],
        measured.p_e[chosen],
        measured.R_e[chosen],
        *_poses(measured.desired, chosen),
        *_poses(compliant, chosen),
        f,
        mu,
    )


def _poses(frames: Frames, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
    some = frames.take(chosen)
    return some.p, some.R
