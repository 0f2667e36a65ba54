"""Joint positions for a pose: the law (28) iterated from a start."""

import numpy as np

from eulerparams_control.errors import RobotError
from eulerparams_control.laws._old.orientation import representation
from eulerparams_control.laws._old.rotations import Array, angle_between
from eulerparams_control.laws.clik import ClikLaw
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import Robot

_STEPS = 500
_GAIN = 0.5  # of the error a step: damped Newton
_DISTANCE, _ANGLE = 1e-10, 1e-10  # [m], [rad] at which the pose is reached


def inverse_kinematics(robot: Robot, frame: DesiredFrame, q_start: Array) -> Array:
    """Return q (n,) whose pose is that of ``frame``, found from q_start (n,).

    Raises:
        RobotError: if the pose is not reached, or only outside the limits of the joints.
    """
    law = ClikLaw(representation("rotation_vector"), k_Pp=_GAIN, k_Po=_GAIN)
    frame, q, still = frame.at_rest(), q_start.copy(), np.zeros_like(q_start)
    for _ in range(_STEPS):
        state = robot.state(q, still)
        dq, dp_de, _ = law.velocity(state, frame, None)
        if np.linalg.norm(dp_de) < _DISTANCE and angle_between(frame.R_d, state.R_e) < _ANGLE:
            break
        q = q + dq
    else:
        raise RobotError(
            f"no joint positions found for the tip at {frame.p_d.tolist()} m, turned by "
            f"{frame.R_d.tolist()}; is it within reach?"
        )
    if not robot.limits.contain(q):
        raise RobotError(f"the pose is reached only outside the joint limits, at {q.tolist()}")
    return q
