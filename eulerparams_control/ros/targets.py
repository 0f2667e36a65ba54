"""Targets of ``target_pose`` and ``target_twist``, in the base frame."""

import math
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import InvalidMessageError, RobotError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import ns_from_ros, pose_from_ros, twist_from_ros
from eulerparams_control.motion.frames import DesiredFrame, Placement
from eulerparams_control.robot.robot import Robot

# A target whose stamp goes back within this time [s] was overtaken on its way; later, a clock was
# set back.
_OVERTAKEN = 1.0

State = tuple[int, Array, Array]


class Targets:
    """Reads targets, which are stated in the frame of any link, where it is at receipt."""

    def __init__(self) -> None:
        self._newest: dict[type, tuple[int, float]] = {}  # stamp [ns] and receipt [s]

    def pose(self, msg: PoseStamped, robot: Robot, state: State | None) -> DesiredFrame:
        """Return the frame that a message aims at.

        Args:
            msg: the message.
            robot: the arm.
            state: of the arm as measured last: stamp [ns], q, dq (n,).

        Raises:
            InvalidMessageError: if a value is impossible, the frame unknown, or the stamp older
                than that of the message before.
        """
        goal = pose_from_ros(msg, _carrier(msg, robot, state))
        self._refuse_overtaken(msg)
        return goal

    def twist(self, msg: TwistStamped, robot: Robot, state: State | None) -> Array:
        """Return the twist (6,) [m/s, rad/s] of the tip that a message asks for; see ``pose``."""
        twist = twist_from_ros(msg, _carrier(msg, robot, state).R)
        self._refuse_overtaken(msg)
        return twist

    def _refuse_overtaken(self, msg: Any) -> None:
        stamp, now = ns_from_ros(msg.header.stamp), steady()
        newest, came = self._newest.get(type(msg), (0, -math.inf))
        if 0 < stamp < newest and now - came < _OVERTAKEN:
            raise InvalidMessageError(
                f"the stamp {stamp / 1e9:.3f} s comes after {newest / 1e9:.3f} s: overtaken, or "
                "are there two senders?"
            )
        self._newest[type(msg)] = stamp, now


def _carrier(msg: Any, robot: Robot, state: State | None) -> Placement:
    """Return where the frame of a message is now, seen from the base."""
    if state is None:
        raise InvalidMessageError("no valid joint_states yet")
    try:
        return robot.link_at(msg.header.frame_id, state[1])
    except RobotError as error:
        raise InvalidMessageError(str(error)) from error
