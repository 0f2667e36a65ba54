"""What the page, the table and the figures need of a run, small however long the run was.

A run of an hour at 1 kHz has millions of samples; its digest has some thousands of points, chosen
so that every peak survives.

    digest = Digest.of(Recording.load("out/demo/euler_parameters"))
    digest.curves["orientation_error"]     # [Curve(t, y)], one a component
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.contact_quantities import VECTORS
from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.poles import Approach, approach, near_pole
from eulerparams_control.analysis.quantities import JOINT_QUANTITIES, QUANTITIES
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.orientation import EulerSequence
from eulerparams_control.robot import Robot
from eulerparams_control.rotations import Array

BINS = 700
"""Of a curve: more than a screen has pixels for."""

STEPS = 3000
"""Of a track, at most."""


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
class Digest:
    """A run, small.

    Attributes:
        path: of the bag.
        robot: the arm.
        urdf: its text.
        parameters: of the recorded nodes, by node and name.
        warning: what is wrong with the bag; "" if nothing.
        why_no_wrench: why there is no contact wrench although one was recorded; "" if not so.
        diverged: [s] when the run left all numbers; None if it did not.
        start, end: [s] of what was analysed.
        sequence: of its Euler angles.
        approach: the closest to the pole of that sequence.
        near_pole: intervals [s] within 5 deg of it.
        near_singular: intervals [s] near a kinematic singularity.
        curves: of each quantity by its name, one a component; without those not recorded.
        highest: the largest finite |y| of each quantity by its name.
        numbers: of the table, by their place in it; None where not recorded.
        track: for the replay.
    """

    path: Path
    robot: Robot = field(repr=False)
    urdf: str = field(repr=False)
    parameters: Mapping[str, Mapping[str, Any]] = field(repr=False)
    warning: str
    why_no_wrench: str
    diverged: float | None
    start: float
    end: float
    sequence: EulerSequence
    approach: Approach
    near_pole: Sequence[tuple[float, float]]
    near_singular: Sequence[tuple[float, float]]
    curves: Mapping[str, Sequence[Curve]] = field(repr=False)
    highest: Mapping[str, float] = field(repr=False)
    numbers: Sequence[float | None] = field(repr=False)
    track: Track = field(repr=False)

    @property
    def name(self) -> str:
        """The name of the bag's folder."""
        return self.path.resolve().name

    @classmethod
    def of(cls, recording: Recording) -> "Digest":
        """Return the digest of a run that is in memory."""
        from eulerparams_control.analysis.table import values  # it knows the metrics

        t = recording.leading.t
        curves, highest = {}, {}
        for quantity in (*QUANTITIES, *VECTORS, *JOINT_QUANTITIES):
            t_y, y = quantity.of(recording)
            if len(t_y):
                columns = y.reshape(len(t_y), -1).T
                curves[quantity.name] = [Curve(*decimate(t_y, column, BINS)) for column in columns]
                highest[quantity.name] = float(np.abs(y[np.isfinite(y)]).max(initial=0.0))
        return cls(
            recording.path,
            recording.robot,
            recording.urdf,
            recording.parameters,
            recording.warning,
            recording.why_no_wrench if recording.sensed is not None else "",
            recording.diverged,
            float(t[0]),
            float(t[-1]),
            recording.sequence,
            approach(recording),
            near_pole([recording]),
            (),
            curves,
            highest,
            values(recording),
            _track(recording),
        )


def _track(recording: Recording) -> Track:
    measured = recording.measured
    step = max(1, -(-len(measured.t) // STEPS))
    chosen = np.unique(np.append(np.arange(0, len(measured.t), step), len(measured.t) - 1))
    t = measured.t[chosen]
    wrench = recording.contact
    nothing = np.full((len(t), 3), np.nan)
    f, mu = wrench.at(t) if wrench is not None else (nothing, nothing)
    compliant = recording.compliant_frames(measured)
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
