"""What is plotted over time: each quantity with its unit, its meaning and its equation."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from eulerparams_control.analysis.recording import Recording
from eulerparams_control.rotations import Array


class Quantity(NamedTuple):
    """A quantity of a run over time.

    Attributes:
        title: of the plot.
        label: of its axis, with the unit; {sequence} stands for the Euler angles.
        caption: what it means, and the equation it belongs to.
        unit: for single values.
        floor: values below are rounding, not motion; 0 never makes the axis logarithmic.
        of: returns instants [s] and values; both empty if nothing was recorded.
    """

    title: str
    label: str
    caption: str
    unit: str
    floor: float
    of: Callable[[Recording], tuple[Array, Array]]


def _orientation_error(recording: Recording) -> tuple[Array, Array]:
    return _known(recording, np.degrees(recording.leading.orientation_error))


def _position_error(recording: Recording) -> tuple[Array, Array]:
    return _known(recording, 1e3 * recording.leading.position_error)


def _joint_speed(recording: Recording) -> tuple[Array, Array]:
    return recording.leading.t, recording.leading.joint_speed


def _pole_distance(recording: Recording) -> tuple[Array, Array]:
    return recording.leading.t, np.degrees(recording.pole_distance)


def _smallest_singular_value(recording: Recording) -> tuple[Array, Array]:
    return recording.leading.t, recording.leading.smallest_singular_value


def _servo_lag(recording: Recording) -> tuple[Array, Array]:
    t, lag = recording.servo_lag
    return t, np.degrees(lag)


def _known(recording: Recording, error: Array) -> tuple[Array, Array]:
    """Return the error over time; empty if nothing was ever desired."""
    some = slice(None) if np.isfinite(error).any() else slice(0, 0)
    return recording.leading.t[some], error[some]


ORIENTATION_ERROR = Quantity(
    "Orientation error",
    "orientation error [deg]",
    "Angle of the mutual rotation between the desired frame and the tip: that of the mutual "
    "quaternion in (27), whatever representation the controller uses.",
    "deg",
    1e-6,
    _orientation_error,
)
JOINT_SPEED = Quantity(
    "Joint speed",
    "largest |dq| [rad/s]",
    "Speed of the fastest joint, what (23) and (28) ask for. Dashed: velocity limits of the "
    "URDF, where they are near.",
    "rad/s",
    1e-3,
    _joint_speed,
)
POLE_DISTANCE = Quantity(
    "Distance to the representation singularity",
    "angle to the pole of {sequence} [deg]",
    "Angle of the tip to the nearest pole of the Euler angles, where T of (3) is singular and "
    "(23) has no solution. (28) does not contain T.",
    "deg",
    0.0,
    _pole_distance,
)
SINGULAR_VALUE = Quantity(
    "Distance to the kinematic singularities",
    "smallest singular value of J",
    "Smallest singular value of the geometric Jacobian of (20): 0 where the arm itself is "
    "singular, for every representation.",
    "",
    0.0,
    _smallest_singular_value,
)
POSITION_ERROR = Quantity(
    "Position error",
    "position error [mm]",
    "Distance between the desired and the actual origin of the tip.",
    "mm",
    1e-6,
    _position_error,
)
SERVO_LAG = Quantity(
    "Servo",
    "command - measured [deg]",
    "Largest angle of a joint between joint_reference and joint_states of the same stamp: how "
    "well the robot does what it is told, with the noise of its sensors.",
    "deg",
    1e-6,
    _servo_lag,
)

QUANTITIES = (
    ORIENTATION_ERROR,
    JOINT_SPEED,
    POLE_DISTANCE,
    SINGULAR_VALUE,
    POSITION_ERROR,
    SERVO_LAG,
)
"""In the order of the page; the first is the picture that matters."""
