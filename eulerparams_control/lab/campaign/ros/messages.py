"""From messages to what a record keeps of them, and from what a user sends to messages."""

from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.lab.campaign.record import Command, Said, State
from eulerparams_control.lab.campaign.streams import REFERENCE, TARGET_POSE, TARGET_TWIST, Sent
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.keys import CAUSE, MODE
from eulerparams_control.messages.to_ros import (
    error_to_ros,
    motion_to_ros,
    pose_to_ros,
    stamp_to_ros,
)
from eulerparams_control.robot.catalogue import RobotDescription

INPUTS = {
    REFERENCE: MultiDOFJointTrajectory,
    TARGET_POSE: PoseStamped,
    TARGET_TWIST: TwistStamped,
}
"""Topics by which an arm is led, and their types."""


def message_of(sent: Sent, robot: RobotDescription, beginning: int) -> Any:
    """Return what is sent as a message.

    Args:
        sent: what a user sends.
        robot: the arm.
        beginning: what the clock of the robot shows when the sequence begins [ns].
    """
    ns = 0 if sent.stamp is None else beginning + round(sent.stamp * 1e9)
    stamp, base = stamp_to_ros(max(0, ns)), robot.base_frame
    frame = sent.motion.frames[0]
    if sent.topic == TARGET_POSE:
        return pose_to_ros(frame.p_d, frame.R_d, stamp, base)
    if sent.topic == TARGET_TWIST:
        return error_to_ros(frame.dp_d, frame.omega_d, stamp, base)
    msg = motion_to_ros(sent.motion, base, robot.tip_frame)
    msg.header.stamp = stamp
    return msg


def command_of(t: float, life: int, msg: Any) -> Command:
    """Return a command published at t [s]."""
    values = (tuple(map(float, part)) for part in (msg.position, msg.velocity, msg.effort))
    return Command(t, life, ns_from_ros(msg.header.stamp) / 1e9, tuple(msg.name), *values)


def state_of(t: float, msg: Any, reader: JointStateReader) -> State:
    """Return the joint_states delivered at t [s]; without values where they cannot be read."""
    stamp = ns_from_ros(msg.header.stamp) / 1e9
    try:
        _, q, dq = reader.from_ros(msg)
    except InvalidMessageError:
        return State(t, stamp, (), ())
    return State(t, stamp, tuple(q.tolist()), tuple(dq.tolist()))


def said_of(t: float, status: Any) -> Said:
    """Return what a status says that was published at t [s]."""
    values = {pair.key: pair.value for pair in status.values}
    level = int.from_bytes(status.level, "little")
    return Said(t, level, status.message, values.get(MODE, ""), values.get(CAUSE, ""))
