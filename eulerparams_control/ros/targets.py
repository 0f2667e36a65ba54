"""Targets of ``target_pose``, ``target_twist`` and ``target_stiffness``."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import InvalidMessageError, RobotError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import ns_from_ros, pose_from_ros, shown, twist_from_ros
from eulerparams_control.motion.frames import DesiredFrame, Placement
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot

# A target whose stamp goes back within this time [s] was overtaken on its way; later, a clock was
# set back.
_OVERTAKEN = 1.0

State = tuple[int, Array, Array]


class Targets:
    """Reads targets, which are stated in the frame of any link, where it is at receipt."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[int, float]] = {}  # stamp [ns] and receipt [s] of a target

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
        self._refuse_overtaken("target_pose", msg)
        return goal

    def twist(self, msg: TwistStamped, robot: Robot, state: State | None) -> Array:
        """Return the twist (6,) [m/s, rad/s] of the tip that a message asks for; see ``pose``."""
        twist = twist_from_ros(msg, _carrier(msg, robot, state).R)
        self._refuse_overtaken("target_twist", msg)
        return twist

    def stiffness(self, msg: WrenchStamped, frame_id: str) -> tuple[Array, Array]:
        """Return the diagonals (3,) of K_p [N/m] and K_o [Nm/rad] that a message asks for.

        Args:
            msg: the message.
            frame_id: of the axes of K_p.

        Raises:
            InvalidMessageError: if the frame is another, a number is negative or not finite, or
                the stamp older than that of the message before.
        """
        if msg.header.frame_id not in ("", frame_id):
            raise InvalidMessageError(
                f"its frame_id is {shown(msg.header.frame_id)}; expected {frame_id}, whose axes "
                "K_p has (translational_frame), or none"
            )
        K_p, K_o = (
            np.array([part.x, part.y, part.z]) for part in (msg.wrench.force, msg.wrench.torque)
        )
        if not (np.isfinite([K_p, K_o]).all() and min(*K_p, *K_o) >= 0.0):
            raise InvalidMessageError(
                f"K_p is {K_p.tolist()} N/m, K_o {K_o.tolist()} Nm/rad; expected finite numbers "
                "of 0 or more"
            )
        self._refuse_overtaken("target_stiffness", msg)
        return K_p, K_o

    def _refuse_overtaken(self, topic: str, msg: Any) -> None:
        stamp, now = ns_from_ros(msg.header.stamp), steady.now()
        newest, came = self._newest.get(topic, (0, -math.inf))
        if 0 < stamp < newest and now - came < _OVERTAKEN:
            raise InvalidMessageError(
                f"the stamp {stamp / 1e9:.3f} s comes after {newest / 1e9:.3f} s: overtaken, or "
                "are there two senders?"
            )
        self._newest[topic] = stamp, now


class TargetStiffness(NamedTuple):
    """The stiffness that was asked for last, until K_p or K_o is set.

    Attributes:
        parameters: those of then.
        wanted: the same with that stiffness.
    """

    parameters: ImpedanceParameters
    wanted: ImpedanceParameters

    def kept(self, parameters: ImpedanceParameters) -> "TargetStiffness":
        """Return what stays when parameters were changed."""
        is_same = all(
            getattr(parameters, name) == getattr(self.parameters, name) for name in ("K_p", "K_o")
        )
        return self if is_same else TargetStiffness(parameters, parameters)

    def of(self, parameters: ImpedanceParameters) -> ImpedanceParameters:
        """Return parameters with that stiffness."""
        return replace(parameters, K_p=self.wanted.K_p, K_o=self.wanted.K_o)


def _carrier(msg: Any, robot: Robot, state: State | None) -> Placement:
    """Return where the frame of a message is now, seen from the base."""
    if state is None:
        raise InvalidMessageError("no valid joint_states yet")
    try:
        return robot.link_at(msg.header.frame_id, state[1])
    except RobotError as error:
        raise InvalidMessageError(str(error)) from error
