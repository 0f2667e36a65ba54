"""Errors of position and orientation.

They are those of the tip from the ``desired`` frame, or with ``against: compliant`` from the
compliant frame: what the motion loop of an impedance leaves.
"""

import math
from functools import partial

import numpy as np

from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.quantities.base import (
    Quantity,
    Samples,
    TableNumber,
    compared,
    known,
    last,
    metric,
    quotient,
    reduced,
    series_of,
)
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError, UnknownNameError


def _frames(recording: Recording, series: Series, against: str) -> Frames:
    """Return the frames that a motion is compared with."""
    if against == "desired":
        return series.desired
    if against != "compliant":
        raise UnknownNameError("frame", against, ("desired", "compliant"))
    if recording.compliant is None:
        raise BagError(f"{recording.path} has no compliant_frame")
    return recording.compliant.at(series.t)


@reduced("orientation_error", "deg", "orientation error", "peak", "final", "rms")
def orientation_error(
    recording: Recording, of: str = "leading", against: str = "desired"
) -> Samples:
    """Return the angle [deg] of the tip from a frame."""
    series = series_of(recording, of)
    frames = _frames(recording, series, against)
    error = series.orientation_error if frames is series.desired else series.angle_to(frames)
    return compared(series.t, np.degrees(error))


@reduced("position_error", "mm", "position error", "peak", "final")
def position_error(recording: Recording, of: str = "leading", against: str = "desired") -> Samples:
    """Return the distance [mm] of the tip from the origin of a frame."""
    series = series_of(recording, of)
    frames = _frames(recording, series, against)
    error = series.position_error if frames is series.desired else series.distance_to(frames)
    return compared(series.t, 1e3 * error)


@reduced({"peak": "servo_lag"}, "deg", "angle of a joint between command and measurement")
def servo_lag(recording: Recording) -> Samples:
    """Return the largest angle [deg] of a joint between command and measurement."""
    t, lag = recording.servo_lag
    if not len(lag):
        raise BagError(f"{recording.path} has no joint_reference with a stamp of its joint_states")
    return t, np.degrees(lag)


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


def _measured(of: "partial[Samples]", recording: Recording) -> Samples:
    """Return a measured error; without a command it is the error itself."""
    series_of(recording, "command")
    return known(*of(recording), 0.0, math.inf)


ORIENTATION_ERROR = Quantity(
    "orientation_error",
    "Orientation error",
    "orientation error [deg]",
    "Angle of the mutual rotation between the desired frame and the tip: that of the mutual "
    "quaternion in (27), whatever representation the controller uses. In kinematic control that of "
    "the command, joint_reference; that of the arm itself is below.",
    "deg",
    1e-6,
    orientation_error,
)
POSITION_ERROR = Quantity(
    "position_error",
    "Position error",
    "position error [mm]",
    "Distance between the desired and the actual origin of the tip.",
    "mm",
    1e-6,
    position_error,
)
MEASURED_ERRORS = (
    Quantity(
        "measured_orientation_error",
        "Orientation error of the arm itself",
        "orientation error [deg]",
        "Angle between the desired frame and the tip as it was measured, joint_states.",
        "deg",
        1e-6,
        partial(_measured, partial(orientation_error, of="measured")),
    ),
    Quantity(
        "measured_position_error",
        "Position error of the arm itself",
        "position error [mm]",
        "Distance between the desired and the measured origin of the tip, joint_states.",
        "mm",
        1e-6,
        partial(_measured, partial(position_error, of="measured")),
    ),
)
"""Beside those of the command, where there is one."""

MOTION_LOOP = (
    Quantity(
        "motion_loop_position",
        "Position error of the motion loop",
        "|p_c - p_e| [mm]",
        "Distance between the compliant and the actual origin of the tip: what the inner motion "
        "loop (49) of Fig. 3 leaves. The position error above is that to the desired frame.",
        "mm",
        1e-6,
        partial(position_error, against="compliant"),
    ),
    Quantity(
        "motion_loop_orientation",
        "Orientation error of the motion loop",
        "angle of R_e' R_c [deg]",
        "Angle between the compliant and the actual frame: what the inner motion loop (50), (51) "
        "of Fig. 3 leaves. The orientation error above is that to the desired frame.",
        "deg",
        1e-6,
        partial(orientation_error, against="compliant"),
    ),
)

SERVO_LAG = Quantity(
    "servo_lag",
    "Servo",
    "command - measured [deg]",
    "Largest angle of a joint between joint_reference and joint_states of the same stamp: how "
    "well the robot does what it is told, with the noise of its sensors.",
    "deg",
    1e-6,
    servo_lag,
)

PLACES = {
    1: ORIENTATION_ERROR,
    6: MOTION_LOOP,
    11: POSITION_ERROR,
    13: MEASURED_ERRORS,
    14: SERVO_LAG,
}
_MEASURED, _COMPLIANT = {"of": "measured"}, {"against": "compliant"}
ROWS = {
    2: TableNumber("orientation error, peak", "peak_orientation_error"),
    3: TableNumber("orientation error, end", "final_orientation_error", of_parts=last),
    4: TableNumber("  measured, peak", "peak_orientation_error", _MEASURED, "command"),
    5: TableNumber("  measured, end", "final_orientation_error", _MEASURED, "command", last),
    6: TableNumber("position error, peak", "peak_position_error"),
    7: TableNumber("position error, end", "final_position_error", of_parts=last),
    8: TableNumber("  measured, peak", "peak_position_error", _MEASURED, "command"),
    9: TableNumber("  measured, end", "final_position_error", _MEASURED, "command", last),
    30: TableNumber("motion loop, peak", "peak_position_error", _COMPLIANT),
    31: TableNumber("motion loop, peak", "peak_orientation_error", _COMPLIANT),
    50: TableNumber("servo lag, largest", "servo_lag"),
}
