"""Commands as messages: each type says what the scheme commands, and no more."""

from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.messages.to_ros import duration_to_ros
from eulerparams_control.ros.commands import HORIZON, CommandPublisher
from eulerparams_control.ros.qos import QOS

JOINTS = ["shoulder", "elbow"]
STAMPS = st.builds(Time, sec=st.integers(-(2**31), 2**31 - 1), nanosec=st.integers(0, 2**32 - 1))


class Sent(list):
    """A node whose publishers keep what they send, as it arrives."""

    def create_publisher(self, kind: Any, *_: Any) -> Any:
        def publish(msg: Any) -> None:
            self.append(deserialize_message(serialize_message(msg), kind))

        return SimpleNamespace(publish=publish)


def expected(kind: str, stamp: Time, command: JointCommand) -> Any:
    """Return the message of a command; None where it has nothing for this type."""
    q, dq, effort = ([] if each is None else each.tolist() for each in command[:3])
    if kind == "joint_state":
        msg = JointState(name=JOINTS, position=q, velocity=dq, effort=effort)
        msg.header.stamp = stamp
        return msg if q or dq or effort else None
    if kind == "forward":
        return Float64MultiArray(data=effort or q) if q or effort else None
    if not (q and dq):
        return None
    point = JointTrajectoryPoint(time_from_start=duration_to_ros(HORIZON))
    point.positions = (command.q + HORIZON * command.dq).tolist()
    return JointTrajectory(joint_names=JOINTS, points=[point])


@pytest.mark.parametrize("kind", ["joint_state", "forward", "joint_trajectory"])
@given(drawn=st.data())
def test_a_message_says_the_parts_of_a_command_that_its_type_has(kind, drawn):
    sent = Sent()
    publisher = CommandPublisher(sent, "topic", kind, JOINTS, QOS)
    part = st.none() | arrays(float, 2, elements=st.floats(-1e300, 1e300))
    for _ in range(3):
        stamp, command = drawn.draw(STAMPS), JointCommand(*drawn.draw(st.tuples(part, part, part)))
        publisher.publish(stamp, command)
        assert [*sent] == [each for each in [expected(kind, stamp, command)] if each is not None]
        sent.clear()
