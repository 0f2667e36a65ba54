"""Errors of position and orientation.

They are those of the tip from the ``desired`` frame, or with ``against: compliant`` from the
compliant frame: what the motion loop of an impedance leaves.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from eulerparams_control.analysis.compliant import CompliantMotion
from eulerparams_control.analysis.quantities.base import (
    Samples,
    compared,
    drawn,
    known,
    metric,
    needed,
    quotient,
    reduced,
    row,
    series_of,
)
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import Frames, Series, comparable
from eulerparams_control.errors import BagError, UnknownNameError


def _frames(recording: Recording, series: Series, against: str) -> Frames:
    """Return the frames that a motion is compared with."""
    if against == "desired":
        return series.desired
    if against != "compliant":
        raise UnknownNameError("frame", against, ("desired", "compliant"))
    compliant: CompliantMotion = needed(recording, "compliant")
    return compliant.at(series.t)


@drawn(
    1, "Orientation error", "orientation error [deg]",
    "Angle of the mutual rotation between the desired frame and the tip: that of the mutual "
    "quaternion in (27), whatever representation the controller uses. In kinematic control that of "
    "the command, joint_reference; that of the arm itself has a plot of its own.",
    unit="deg", floor=1e-6,
)  # fmt: skip
@reduced("orientation_error", "deg", "orientation error", "peak", "final", "rms")
def orientation_error(
    recording: Recording, of: str = "leading", against: str = "desired"
) -> Samples:
    """Return the angle [deg] of the tip from a frame."""
    series = series_of(recording, of)
    frames = _frames(recording, series, against)
    error = series.orientation_error if frames is series.desired else series.angle_to(frames)
    return compared(series.t, np.degrees(error))


@drawn(
    11, "Position error", "position error [mm]",
    "Distance between the desired and the actual origin of the tip.",
    unit="mm", floor=1e-6,
)  # fmt: skip
@reduced("position_error", "mm", "position error", "peak", "final")
def position_error(recording: Recording, of: str = "leading", against: str = "desired") -> Samples:
    """Return the distance [mm] of the tip from the origin of a frame."""
    series = series_of(recording, of)
    frames = _frames(recording, series, against)
    error = series.position_error if frames is series.desired else series.distance_to(frames)
    return compared(series.t, 1e3 * error)


@drawn(
    14, "Servo", "command - measured [deg]",
    "Largest angle of a joint between joint_reference and joint_states of the same stamp: how "
    "well the robot follows its commands, with the noise of its sensors.",
    unit="deg", floor=1e-6,
)  # fmt: skip
@reduced({"peak": "servo_lag"}, "deg", "angle of a joint between command and measurement")
def servo_lag(recording: Recording) -> Samples:
    """Return the largest angle [deg] of a joint between command and measurement."""
    command, measured, joints = recording.command, recording.measured, comparable(recording.robot)
    own = np.zeros(0) if command is None else command.t
    t, i, j = np.intersect1d(own, measured.t, return_indices=True)
    if command is None or not len(t):
        raise BagError(f"{recording.path} has no joint_reference with a stamp of its joint_states")
    lag = np.abs(command.q[i] - measured.q[j])[:, joints]
    return t, np.degrees(lag.max(axis=1))


@metric("s")
def settling_time(recording: Recording, threshold: float = 1.0, of: str = "leading") -> float:
    """Last time at which the orientation error exceeds a threshold.

    The threshold is in deg.  Infinite if the error ends above it, or the run diverged.
    """
    t, error = known(*orientation_error(recording, of), 0.0, math.inf)
    if error[-1] > threshold or recording.diverged is not None:
        return math.inf
    return float(np.max(t[error > threshold], initial=0.0))


@metric("")
def period_growth(recording: Recording, period: float, of: str = "leading") -> float:
    """Largest orientation error of the last period over the first."""
    t, error = orientation_error(recording, of)
    end = math.floor(round(float(t[-1]) / period, 6)) * period
    first, last = (
        float(known(t, error, *window)[1].max()) for window in ((0.0, period), (end - period, end))
    )
    return quotient(last, first)


def _measured(of: Callable[..., Samples], recording: Recording) -> Samples:
    """Return a measured error; without a command it is the error itself."""
    series_of(recording, "command")
    return known(*of(recording, of="measured"), 0.0, math.inf)


drawn(
    13, "Orientation error of the arm itself", "orientation error [deg]",
    "Angle between the desired frame and the tip as it was measured, joint_states.",
    unit="deg", floor=1e-6, name="measured_orientation_error", otherwise="orientation_error",
)(partial(_measured, orientation_error))  # fmt: skip
drawn(
    13.5, "Position error of the arm itself", "position error [mm]",
    "Distance between the desired and the measured origin of the tip, joint_states.",
    unit="mm", floor=1e-6, name="measured_position_error", otherwise="position_error",
)(partial(_measured, position_error))  # fmt: skip
drawn(
    6, "Position error of the motion loop", "|p_c - p_e| [mm]",
    "Distance between the compliant and the actual origin of the tip: what the inner motion "
    "loop (49) of Fig. 3 leaves. It is not the error to the desired frame.",
    unit="mm", floor=1e-6, name="motion_loop_position",
)(partial(position_error, against="compliant"))  # fmt: skip
drawn(
    6.5, "Orientation error of the motion loop", "angle of R_e' R_c [deg]",
    "Angle between the compliant and the actual frame: what the inner motion loop (50), (51) "
    "of Fig. 3 leaves. It is not the error to the desired frame.",
    unit="deg", floor=1e-6, name="motion_loop_orientation",
)(partial(orientation_error, against="compliant"))  # fmt: skip

row(2, "orientation error, peak", "peak_orientation_error")
row(3, "orientation error, end", "final_orientation_error")
row(4, "  measured, peak", "peak_orientation_error", "command", of="measured")
row(5, "  measured, end", "final_orientation_error", "command", of="measured")
row(6, "position error, peak", "peak_position_error")
row(7, "position error, end", "final_position_error")
row(8, "  measured, peak", "peak_position_error", "command", of="measured")
row(9, "  measured, end", "final_position_error", "command", of="measured")
row(30, "motion loop, peak", "peak_position_error", against="compliant")
row(31, "motion loop, peak", "peak_orientation_error", against="compliant")
row(50, "servo lag, largest", "servo_lag")
