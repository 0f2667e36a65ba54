"""Geometry of the page: joints of a URDF, a stiffness, the turn of an arm through a pole."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.errors import EulerParamsError
from eulerparams_control.laws.impedance_matrices import symmetric_matrix
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.rotations import Array, R_angle_axis, log, quaternion
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.fields import from_mapping
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.robot.robot import Robot

MARGIN = math.radians(20)
"""Angle [rad] to the pole at which a passage begins and ends."""

_EXACT = 1e-5  # [m, rad] of a pose that is reached
_STEPS, _STEP, _DAMPING = 150, 0.15, 1e-4  # of the search, [rad] the longest


def wxyz(R: Array) -> Array:
    """Return R (3, 3) as (4,) eta, eps: the quaternions of viser have the scalar first, too."""
    eta, eps = quaternion(R)
    return np.array([eta, *eps])


def R_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation (3, 3) of the angles [rad] of a URDF."""
    return EulerSequence("ZYX").R(np.array([yaw, pitch, roll]))


def joint_motion(kind: str, axis: Array, value: float) -> Placement:
    """Return how a joint of a URDF has moved what it carries, by ``value`` [rad or m]."""
    along = np.asarray(axis) / np.linalg.norm(axis)
    if kind == "prismatic":
        return Placement(np.eye(3), value * along)
    return Placement(R_angle_axis(value, along), np.zeros(3))


def stiffness_of(scheme: SchemeInfo, values: Mapping[str, Any]) -> tuple[Array, str] | None:
    """Return K_p (3, 3) [N/m] of the parameters of a controller, and whose axes it has.

    None where there is none, or it is impossible.
    """
    if "K_p" not in values:
        return None
    try:
        p: Any = from_mapping(scheme.parameters, values)
        return symmetric_matrix("K_p", p.K_p, p.K_p_axes), p.translational_frame
    except EulerParamsError:
        return None


class Passage(NamedTuple):
    """A turn of the tool through a pole of the Euler angles, about one axis.

    Attributes:
        before, beyond: (3, 3) orientations ``MARGIN`` before and beyond the pole.
    """

    before: Array
    beyond: Array


def passage(robot: Robot, q: Array, axes: tuple[int, int, int]) -> Passage | None:
    """Return the shortest turn through a pole that the arm can make where its tip is.

    Args:
        robot: the arm.
        q: (n,) where it is.
        axes: i, j, k of the Euler angles as 0, 1, 2.

    Returns:
        None if it reaches both sides of neither pole.
    """
    state = robot.state(q, np.zeros(robot.n))
    i, _, k = axes
    tool, first = state.R_e[:, k], np.eye(3)[i]
    for pole in sorted((first, -first), key=lambda d: -float(d @ tool)):
        about = np.cross(tool, pole)
        sine = float(np.linalg.norm(about))
        if sine < 1e-6:  # any axis does that is perpendicular to the tool's
            about, sine = state.R_e[:, (k + 1) % 3], 1.0
        angle = math.acos(min(1.0, max(-1.0, float(tool @ pole))))
        before, beyond = (
            R_angle_axis(angle + side, about / sine) @ state.R_e for side in (-MARGIN, MARGIN)
        )
        there = _reach(robot, q, state.p_e, before)
        if there is not None and _reach(robot, there, state.p_e, beyond) is not None:
            return Passage(before, beyond)
    return None


def _reach(robot: Robot, q: Array, p: Array, R: Array) -> Array | None:
    """Return joint values (n,) within their limits for a pose; None if none are found from q."""
    for _ in range(_STEPS):
        arm = robot.state(q, np.zeros(robot.n))
        e = np.concatenate((p - arm.p_e, log(R @ arm.R_e.T)))
        if np.abs(e).max() < _EXACT:
            return q
        J = arm.J
        dq = J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), e)
        q = q + dq * (_STEP / max(_STEP, float(np.abs(dq).max())))
        q = np.clip(q, robot.limits.lower, robot.limits.upper)
    return None
