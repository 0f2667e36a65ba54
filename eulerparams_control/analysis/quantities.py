"""Quantities over time, each with its unit, its meaning and its equation."""

import numpy as np

from eulerparams_control.analysis.contact_quantities import (
    COMPLIANT_DISPLACEMENT,
    COMPLIANT_TURN,
    FORCE,
    MOMENT,
    MOTION_LOOP_ORIENTATION,
    MOTION_LOOP_POSITION,
    VECTORS,
)
from eulerparams_control.analysis.quantity import AnyQuantity, JointQuantity, Quantity
from eulerparams_control.analysis.real_time_quantities import PERCENTILES, ROUND_TRIP
from eulerparams_control.analysis.real_time_quantities import VECTORS as REAL_TIME_VECTORS
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.representation_quantities import (
    ERRORS,
    MEASURED_ERRORS,
    RATES,
    TIP,
)
from eulerparams_control.analysis.shaping_quantities import DASHED, SHAPING
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot

_EMPTY = np.zeros(0)


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


def _effort(recording: Recording) -> tuple[Array, Array]:
    effort = recording.effort
    return (_EMPTY, _EMPTY) if effort is None else (effort.t, effort.largest)


def _lyapunov(recording: Recording) -> tuple[Array, Array]:
    lyapunov = recording.lyapunov
    return (_EMPTY, _EMPTY) if lyapunov is None else (lyapunov.t, lyapunov.V)


def _joint_speeds(recording: Recording) -> tuple[Array, Array]:
    return recording.leading.t, np.abs(recording.leading.dq)


def _joint_efforts(recording: Recording) -> tuple[Array, Array]:
    effort = recording.effort
    return (_EMPTY, _EMPTY) if effort is None else (effort.t, np.abs(effort.tau))


def _velocity_limits(robot: Robot) -> Array:
    return robot.limits.velocity


def _effort_limits(robot: Robot) -> Array:
    return robot.limits.effort


def _servo_lag(recording: Recording) -> tuple[Array, Array]:
    t, lag = recording.servo_lag
    return t, np.degrees(lag)


def _known(recording: Recording, error: Array) -> tuple[Array, Array]:
    """Return the error over time; empty if nothing was ever desired."""
    some = slice(None) if np.isfinite(error).any() else slice(0, 0)
    return recording.leading.t[some], error[some]


ORIENTATION_ERROR = Quantity(
    "orientation_error",
    "Orientation error",
    "orientation error [deg]",
    "Angle of the mutual rotation between the desired frame and the tip: that of the mutual "
    "quaternion in (27), whatever representation the controller uses. In kinematic control that of "
    "the command, joint_reference; that of the arm itself is below.",
    "deg",
    1e-6,
    _orientation_error,
)
JOINT_SPEED = Quantity(
    "joint_speed",
    "Joint speed",
    "largest |dq| [rad/s]",
    "Speed of the fastest joint: what (23), (28) ask for in kinematic control, what (38), (40) "
    "lead to in dynamic control. Dashed: velocity limits of the URDF, where they are near.",
    "rad/s",
    1e-3,
    _joint_speed,
    _velocity_limits,
)
EFFORT = Quantity(
    "effort",
    "Effort",
    "largest |tau| [Nm]",
    "Largest commanded effort of a joint: (33), with the acceleration that (38) or (40) asks for. "
    "Dashed: effort limits of the URDF, where they are near.",
    "Nm",
    1e-3,
    _effort,
    _effort_limits,
)
LYAPUNOV = Quantity(
    "lyapunov",
    "Lyapunov function",
    "V",
    "V_1 of (30) in kinematic control, V_2 of (42) in dynamic control, with the sign that the "
    "controller gave the mutual quaternion, V_3 of (68) of the impedance; of Euler parameters "
    "only. By (31), (43), (69) it never increases from an error on without a contact moment; what "
    "sampling, noise and limits leave of one while moving comes on top.",
    "",
    1e-16,
    _lyapunov,
    logarithmic=True,
)
POLE_DISTANCE = Quantity(
    "pole_distance",
    "Distance to the representation singularity",
    "angle to the pole of {sequence} [deg]",
    "Angle of the tip to the nearest pole of the Euler angles, where T of (3) is singular and "
    "(23), (38) have no solution. (28), (40) do not contain T.",
    "deg",
    0.0,
    _pole_distance,
)
SINGULAR_VALUE = Quantity(
    "singular_value",
    "Distance to the kinematic singularities",
    "smallest singular value of J",
    "Smallest singular value of the geometric Jacobian of (20), its rows of the position over a "
    "length of the arm: 0 where the arm itself is singular, for every representation.",
    "",
    0.0,
    _smallest_singular_value,
)
POSITION_ERROR = Quantity(
    "position_error",
    "Position error",
    "position error [mm]",
    "Distance between the desired and the actual origin of the tip.",
    "mm",
    1e-6,
    _position_error,
)
SERVO_LAG = Quantity(
    "servo_lag",
    "Servo",
    "command - measured [deg]",
    "Largest angle of a joint between joint_reference and joint_states of the same stamp: how "
    "well the robot does what it is told, with the noise of its sensors.",
    "deg",
    1e-6,
    _servo_lag,
)

JOINT_SPEEDS = JointQuantity(
    "joint_speeds",
    "Speed of each joint",
    "|dq| [rad/s]",
    "Speed of each joint. Dashed: its velocity limit in the URDF, where it is near.",
    "rad/s",
    1e-3,
    _joint_speeds,
    _velocity_limits,
)
JOINT_EFFORTS = JointQuantity(
    "joint_efforts",
    "Effort of each joint",
    "|tau| [Nm]",
    "Commanded effort of each joint. Dashed: its effort limit in the URDF, where it is near.",
    "Nm",
    1e-3,
    _joint_efforts,
    _effort_limits,
)

QUANTITIES = (
    ORIENTATION_ERROR,
    FORCE,
    MOMENT,
    COMPLIANT_DISPLACEMENT,
    COMPLIANT_TURN,
    MOTION_LOOP_POSITION,
    MOTION_LOOP_ORIENTATION,
    JOINT_SPEED,
    EFFORT,
    POLE_DISTANCE,
    SINGULAR_VALUE,
    POSITION_ERROR,
    LYAPUNOV,
    *MEASURED_ERRORS,
    SERVO_LAG,
    ROUND_TRIP,
    *PERCENTILES,
    *SHAPING,
)
"""In the order of the page; the first is the picture that matters, unless another is named."""

VECTOR_QUANTITIES = (*VECTORS, *ERRORS, RATES, *TIP, *REAL_TIME_VECTORS)
"""In the order of the page."""

JOINT_QUANTITIES = (JOINT_SPEEDS, JOINT_EFFORTS)
"""In the order of the page."""

EVERYTHING: tuple[AnyQuantity, ...] = (
    *QUANTITIES,
    *VECTOR_QUANTITIES,
    *JOINT_QUANTITIES,
    *DASHED.values(),
)
"""In the order of the page; the last are drawn dashed with another one."""
