"""The way that the arm takes: speed, travel, distance to singularities, posture; its efforts."""

import math
from collections.abc import Sequence

import numpy as np

from eulerparams_control.analysis.quantities.base import (
    JOINTS,
    Axis,
    Samples,
    along,
    drawn,
    metric,
    needed,
    quotient,
    reduced,
    row,
    series_of,
    within,
)
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import comparable
from eulerparams_control.analysis.stacks import angles_between, over
from eulerparams_control.errors import BagError, UnknownNameError
from eulerparams_control.laws.orientation import EulerSequence
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.robot.robot import Robot

_ROUNDING = 1e-9  # relative tolerance of an effort that was cut to a limit


def _velocity_limits(robot: Robot) -> Array:
    return robot.limits.velocity


def _effort_limits(robot: Robot) -> Array:
    return robot.limits.effort


@drawn(
    8, "Effort", "largest |tau| [Nm]",
    "Largest commanded effort of a joint: (33), with the acceleration that (38) or (40) asks for. "
    "Dashed: effort limits of the URDF, where they are near.",
    unit="Nm", floor=1e-3, limits=_effort_limits,
)  # fmt: skip
@reduced("effort", "Nm", "commanded effort of a joint", "peak")
def effort(recording: Recording) -> Samples:
    """Return the largest commanded effort [Nm] of a joint."""
    efforts = needed(recording, "effort")
    return efforts.t, np.abs(efforts.tau).max(axis=1)


@drawn(
    7, "Joint speed", "largest |dq| [rad/s]",
    "Speed of the fastest joint: what (23), (28) ask for in kinematic control, what (38), (40) "
    "lead to in dynamic control. Dashed: velocity limits of the URDF, where they are near.",
    unit="rad/s", floor=1e-3, limits=_velocity_limits,
)  # fmt: skip
@reduced("joint_speed", "rad/s", "joint speed", "peak")
def joint_speed(recording: Recording, of: str = "leading") -> Samples:
    """Return the largest speed of a joint that turns [rad/s]; [m/s] if none does."""
    series = series_of(recording, of)
    return series.t, np.abs(series.dq[:, comparable(series.robot)]).max(axis=1)


@reduced("tip_speed", "m/s", "speed of the tip", "peak")
def tip_speed(recording: Recording, of: str = "leading") -> Samples:
    """Return the speed [m/s] of the tip."""
    series = series_of(recording, of)
    return series.t, np.linalg.norm(series.kinematics.dp_e, axis=1)


@reduced("turning", "rad/s", "angular speed of the tip", "peak")
def turning(recording: Recording, of: str = "leading") -> Samples:
    """Return the angular speed [rad/s] of the tip."""
    series = series_of(recording, of)
    return series.t, np.linalg.norm(series.omega_e, axis=1)


@metric("mm")
def tip_distance(
    recording: Recording, axis: Axis = (), before: float = math.inf, of: str = "leading"
) -> float:
    """Distance of the tip from its start at the end.

    With an axis, in the base frame, its component.
    """
    series = series_of(recording, of)
    p_e = series.p_e[within(series.t, 0.0, before)]
    return 1e3 * float(along(p_e[-1] - p_e[0], axis))


@metric("mm")
def off_line(recording: Recording, of: str = "leading") -> float:
    """Largest distance of the tip from the straight line between its ends."""
    p_e = series_of(recording, of).p_e
    x, way = p_e - p_e[0], p_e[-1] - p_e[0]
    return 1e3 * float(np.linalg.norm(np.cross(x, way), axis=1).max() / np.linalg.norm(way))


@reduced("speed_of_limit", "", "speed of a joint over its velocity limit", "peak")
def speed_of_limit(recording: Recording, of: str = "leading") -> Samples:
    """Return the largest speed of a joint over its velocity limit in the URDF."""
    series = series_of(recording, of)
    return series.t, (np.abs(series.dq) / recording.robot.limits.velocity).max(axis=1)


@drawn(
    9, "Distance to the representation singularity", "angle to the pole of {sequence} [deg]",
    "Angle of the tip to the nearest pole of the Euler angles, where T of (3) is singular and "
    "(23), (38) have no solution. (28), (40) do not contain T.",
    unit="deg",
)  # fmt: skip
@reduced({"least": "closest_approach"}, "deg", "angle to the pole of the Euler angles")
def pole_distance(recording: Recording, sequence: str = "", of: str = "leading") -> Samples:
    """Return the angle [deg] to the pole of a sequence, that of the parameters unless named."""
    series = series_of(recording, of)
    if not sequence and series is recording.leading:
        return series.t, np.degrees(recording.pole_distance)
    poles = EulerSequence(sequence) if sequence else recording.sequence
    return series.t, np.degrees(over(poles.pole_distance, series.R_e))


@drawn(
    10, "Distance to the kinematic singularities", "smallest singular value of J",
    "Smallest singular value of the geometric Jacobian of (20), its rows of the position over a "
    "length of the arm: 0 where the arm itself is singular, for every representation.",
)  # fmt: skip
@reduced({"least": "smallest_singular_value"}, "", "singular value of J on the way")
def singular_value(recording: Recording, of: str = "leading") -> Samples:
    """Return the smallest singular value of J."""
    series = series_of(recording, of)
    return series.t, series.smallest_singular_value


@metric("s")
def saturated_time(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Time with a commanded effort at its limit.

    The limits are those of the URDF.  A command counts until the next one.
    """
    effort = needed(recording, "effort")
    at_limit = np.abs(effort.tau) >= (1 - _ROUNDING) * recording.robot.limits.effort
    lasting = np.diff(effort.t, append=effort.t[-1])
    return float(lasting[at_limit.any(axis=1) & within(effort.t, after, before)].sum())


@metric("deg")
def orientation_travel(recording: Recording, of: str = "leading") -> float:
    """Angle through which the tip turns, all in all.

    The sum of the angles between its successive orientations.
    """
    R_e = series_of(recording, of).R_e
    return math.degrees(angles_between(R_e[:-1], R_e[1:]).sum())


@metric("")
def travel_ratio(recording: Recording, of: str = "leading") -> float:
    """Angle through which the tip turns over the shortest way between its ends.

    1 if it turns straight from its first to its last orientation.
    """
    series = series_of(recording, of)
    shortest = math.degrees(angle_between(series.R_e[0], series.R_e[-1]))
    return quotient(orientation_travel(recording, of), shortest)


@metric("rad^2")
def posture_cost(
    recording: Recording, posture: Sequence[float], at: str = "end", of: str = "leading"
) -> float:
    """Half the square of the distance of the joints from a posture.

    1/2 |q - posture|^2 at the ``start`` or at the ``end``; the posture in rad, one number a
    joint.
    """
    if at not in ("start", "end"):
        raise UnknownNameError("time of posture_cost", at, ("start", "end"))
    if len(posture) != recording.robot.n:
        raise BagError(
            f"{recording.path}: the posture has {len(posture)} values; expected one for each of "
            f"the {recording.robot.n} joints {', '.join(recording.robot.joints)}"
        )
    difference = series_of(recording, of).q[0 if at == "start" else -1] - np.array(posture)
    with np.errstate(over="ignore"):  # a run that diverged
        return float(difference @ difference) / 2


@drawn(
    30, "Speed of each joint", "|dq| [rad/s]",
    "Speed of each joint. Dashed: its velocity limit in the URDF, where it is near.",
    unit="rad/s", floor=1e-3, limits=_velocity_limits, components=JOINTS, group="Each joint",
)  # fmt: skip
def joint_speeds(recording: Recording) -> Samples:
    """Return the speed (N, n) [rad/s] of each joint."""
    return recording.leading.t, np.abs(recording.leading.dq)


@drawn(
    31, "Effort of each joint", "|tau| [Nm]",
    "Commanded effort of each joint. Dashed: its effort limit in the URDF, where it is near.",
    unit="Nm", floor=1e-3, limits=_effort_limits, components=JOINTS, group="Each joint",
)  # fmt: skip
def joint_efforts(recording: Recording) -> Samples:
    """Return the commanded effort (N, n) [Nm] of each joint."""
    efforts = needed(recording, "effort")
    return efforts.t, np.abs(efforts.tau)


row(40, "joint speed, peak", "peak_joint_speed")
row(41, "  measured, peak", "peak_joint_speed", "command", of="measured")
row(42, "effort, peak", "peak_effort")
row(43, "time at an effort limit", "saturated_time")
row(44, "closest to pole of", "closest_approach")
row(45, "smallest singular value of J", "smallest_singular_value")
