"""Joint positions for a pose: the law (28) iterated from a start."""

import numpy as np

from eulerparams_control.errors import RobotError
from eulerparams_control.laws.clik import clik
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.rotations import Array, angle_between, norm
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import Robot

_STEPS = 500
_GAIN = 0.5  # of the error a step: damped Newton
_DISTANCE, _ANGLE = 1e-10, 1e-10  # [m], [rad] at which the pose is reached


def inverse_kinematics(robot: Robot, frame: DesiredFrame, q_start: Array) -> Array:
    """Return q (n,) whose pose is that of ``frame``, the solution to which q_start (n,) leads.

    Raises RobotError if the pose is not reached, or only outside the limits of the joints.
    """
    orientation, inverse = representation("rotation_vector"), DampedInverse()
    frame, q, still = frame.at_rest(), q_start.copy(), np.zeros_like(q_start)
    for _ in range(_STEPS):
        state = robot.state(q, still)
        distance, angle = norm(frame.p_d - state.p_e), angle_between(frame.R_d, state.R_e)
        if distance < _DISTANCE and angle < _ANGLE:
            break
        dq, _ = clik(state, frame, orientation, None, _GAIN, _GAIN, inverse, still)
        q = q + dq
    else:
        raise RobotError(
            f"no joint positions found for the tip at {frame.p_d.tolist()} m, turned by "
            f"{frame.R_d.tolist()}; is it within reach?"
        )
    if not ((robot.limits.lower <= q) & (q <= robot.limits.upper)).all():
        raise RobotError(f"the pose is reached only outside the joint limits, at {q.tolist()}")
    return q
