"""Messages at their bytes say what rclpy finds in them, and what is written so, rclpy reads."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message, serialize_message
from samples import examples, uniform
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros, wrench_from_ros
from eulerparams_control.messages.to_ros import duration_to_ros, motion_to_ros
from eulerparams_control.messages.wire import Reader, Template, stamp_of
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.ros.commands import HORIZON, CommandPublisher, ComplianceCommands
from eulerparams_control.ros.qos import QOS

RMWError = rclpy_implementation.RMWError
JOINTS = ("shoulder", "elbow")
LETTERS = st.characters(exclude_categories=("Cs",), exclude_characters="\0")
NAMES = st.permutations(JOINTS) | st.permutations([*JOINTS, "finger"]) | st.lists(
    st.sampled_from([*JOINTS, "finger", ""]) | st.text(LETTERS, max_size=9), max_size=4
)  # fmt: skip
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
FRAME_IDS = st.sampled_from(["", "base", "tool0"]) | st.text(LETTERS, max_size=9)
FLOATS = st.floats(-3, 3) | st.floats()


def numbers(count: int) -> st.SearchStrategy[list[float]]:
    return st.lists(FLOATS, min_size=count, max_size=count)


@st.composite
def rows(draw: Any, kind: type[Any]) -> list[bytes]:
    """Draw messages of one layout, but for some that are cut, changed or of another."""
    found = []
    frame_id, names = draw(FRAME_IDS), draw(NAMES)
    n = len(names)
    counts = [draw(st.sampled_from([n, n, n, 0, n + 1])) for _ in range(3)]
    for _ in range(draw(st.integers(1, 6))):
        msg = kind()
        msg.header.stamp.sec, msg.header.stamp.nanosec = draw(STAMPS)
        msg.header.frame_id = draw(st.just(frame_id) | FRAME_IDS)
        if kind is WrenchStamped:
            force, torque = msg.wrench.force, msg.wrench.torque
            force.x, force.y, force.z, torque.x, torque.y, torque.z = draw(numbers(6))
        else:
            msg.name = draw(st.just(names) | st.permutations(names))
            msg.position, msg.velocity, msg.effort = (draw(numbers(count)) for count in counts)
        data = bytearray(serialize_message(msg))
        if draw(st.integers(0, 3)) == 0:  # also the order of the bytes, and what pads them
            data[draw(st.just(1) | st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
        end = draw(st.sampled_from([len(data)] * 3 + [len(data) - 1]) | st.integers(0, len(data)))
        found.append(bytes(data[:end]) + draw(st.binary(max_size=8)))
    return found


def said(read: Any, joints: JointStateReader, data: bytes) -> list[Any]:
    """Return all that a message says, or how it is refused."""
    found: list[Any] = []
    try:
        msg = read(data)
        found += [ns_from_ros(msg.header.stamp), msg.header.frame_id]
        if getattr(msg, "name", None) is None:
            return [*found, wrench_from_ros(msg, msg.header.frame_id).tolist()]
        found += [list(msg.name), joints.concerns(msg)]
        t, q, dq = joints.from_ros(msg)
        effort = joints.effort_from_ros(msg)
        found += [t, q.tolist(), dq.tolist(), joints.has_velocity]
        return [*found, effort if effort is None else effort.tolist()]
    except (InvalidMessageError, RMWError) as error:
        return [*found, type(error), str(error)]


@pytest.mark.parametrize("kind", [JointState, WrenchStamped])
@examples(600)
@given(drawn=st.data(), needs_velocity=st.booleans())
def test_bytes_say_what_rclpy_finds_in_them(kind, drawn, needs_velocity):
    def plain(data: bytes) -> Any:
        return deserialize_message(data, kind)

    read = Reader(kind.__name__, plain).read
    one, other = (JointStateReader(JOINTS, needs_velocity) for _ in range(2))
    for data in drawn.draw(rows(kind)):
        assert repr(said(read, one, data)) == repr(said(plain, other, data))


@examples(200)
@given(drawn=st.data(), names=st.permutations([*JOINTS, "finger"]), stamps=st.lists(
    STAMPS, min_size=9, max_size=9))  # fmt: skip
def test_steady_states_are_read_at_once_and_what_disturbs_them_as_rclpy_finds_it(
    drawn, names, stamps
):
    def plain(data: bytes) -> Any:
        return deserialize_message(data, JointState)

    read, one = Reader("JointState", plain).read, JointStateReader(JOINTS)
    values = drawn.draw(arrays(float, (len(stamps), 2, 3), elements=st.floats(-1e3, 1e3)))
    at_fault, place = drawn.draw(st.integers(3, 8)), drawn.draw(st.integers(0, 5))
    for k, ((sec, nanosec), (q, dq)) in enumerate(zip(stamps, values, strict=True)):
        msg = JointState(name=names, position=q.tolist(), velocity=dq.tolist())
        msg.header.stamp.sec, msg.header.stamp.nanosec = sec, nanosec
        if k == at_fault:
            numbers = msg.position if place < 3 else msg.velocity
            numbers[place % 3] = drawn.draw(st.sampled_from([math.nan, math.inf, -2e9]))
        data = serialize_message(msg)
        found = one.from_bytes(data)
        is_bad = k == at_fault and names[place % 3] in JOINTS
        assert (found is None) is (k < 2 or is_bad)  # of the first two the layout is learnt
        if found is None:
            said(read, one, data)
            continue
        other = JointStateReader(JOINTS).from_ros(plain(data))
        assert repr(found) == repr(other)
        assert stamp_of(data) == (sec, nanosec)


class Sent(list):
    """A node whose publishers keep what they send."""

    def create_publisher(self, kind: Any, *_: Any) -> Any:
        return SimpleNamespace(publish=lambda data: self.append(deserialize_message(data, kind)))


def expected(kind: str, joints: list[str], stamp: Any, command: JointCommand) -> Any:
    q, dq, effort = ([] if each is None else each.tolist() for each in command[:3])
    if kind == "joint_state":
        msg = JointState(name=joints, position=q, velocity=dq, effort=effort)
        msg.header.stamp.sec, msg.header.stamp.nanosec = stamp.sec, stamp.nanosec
        return msg
    if kind == "forward":
        return Float64MultiArray(data=effort or q)
    point = JointTrajectoryPoint(time_from_start=duration_to_ros(HORIZON))
    point.positions = (command.q + HORIZON * command.dq).tolist()
    return JointTrajectory(joint_names=joints, points=[point])


def test_what_was_in_memory_between_the_fields_and_behind_them_is_not_written():
    data = serialize_message(JointState(name=["a"], position=[1.0], velocity=[2.0]))
    clean, noisy = bytearray(data + b"\0\0\0"), bytearray(data + b"\1\2\3")
    noisy[17:20], noisy[30:32] = b"\4\5\6", b"\7\7"  # behind the frame_id, and behind the name
    stamp, values = SimpleNamespace(sec=1, nanosec=2), ([3.0], [4.0])
    written = [
        Template("JointState", bytes(each), ("position", "velocity")).filled(stamp, values)
        for each in (clean, noisy)
    ]
    assert written[0] == written[1]


@pytest.mark.parametrize("kind", ["joint_state", "forward", "joint_trajectory"])
@given(drawn=st.data(), joints=st.lists(st.text(LETTERS, max_size=9), min_size=1, max_size=8))
def test_rclpy_reads_the_commands_that_are_written(kind, drawn, joints):
    sent = Sent()
    publisher = CommandPublisher(sent, "topic", kind, joints, QOS)
    for _ in range(3):
        sec, nanosec = drawn.draw(STAMPS)
        q, dq, effort = drawn.draw(arrays(float, (3, len(joints))))
        both = JointCommand(q, dq), JointCommand(effort=effort)
        command = both[0 if kind == "joint_trajectory" else drawn.draw(st.integers(0, 1))]
        with np.errstate(all="ignore"):
            publisher.publish(SimpleNamespace(sec=sec, nanosec=nanosec), command)
            msg = expected(kind, joints, SimpleNamespace(sec=sec, nanosec=nanosec), command)
        assert repr(sent[-1]) == repr(msg)


@given(st.lists(STAMPS, min_size=2, max_size=2), FRAME_IDS, FRAME_IDS, arrays(
    float, (2, 5, 3), elements=st.floats(-1e300, 1e300)))  # fmt: skip
def test_rclpy_reads_the_compliant_frames_that_are_written(stamps, base, tip, vectors):
    sent = Sent()
    publisher = ComplianceCommands(sent, base, tip, None)
    for (sec, nanosec), R, row in zip(stamps, uniform(2), vectors, strict=True):
        frame = DesiredFrame(row[0], R, *row[1:])
        publisher.publish(SimpleNamespace(sec=sec, nanosec=nanosec), JointCommand(frame=frame))
        msg = motion_to_ros(Trajectory([0.0], [frame]), base, tip)
        msg.header.stamp.sec, msg.header.stamp.nanosec = sec, nanosec
        assert sent[-1] == msg
