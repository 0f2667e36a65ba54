"""joint_states at their bytes: what is read of them is what rclpy reads, or nothing is."""

import math
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from samples import examples
from sensor_msgs.msg import JointState

from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.joint_states import JointStateBytes
from eulerparams_control.ros.message_info import deserialized

JOINTS = ("shoulder", "elbow")
LETTERS = st.characters(exclude_categories=("Cs",), exclude_characters="\0")
TEXT = st.text(LETTERS, max_size=9)
OURS = st.permutations(JOINTS) | st.permutations([*JOINTS, "finger"])
NAMES = OURS | st.lists(st.sampled_from([*JOINTS, ""]) | TEXT, max_size=4)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
FINITE, ANY = st.floats(-1e3, 1e3), st.floats(-3, 3) | st.floats()


def state(draw: Any, names: Any, frame_id: str, counts: Any, numbers: Any = FINITE) -> JointState:
    """Draw a message with such numbers of position, velocity and effort."""
    msg = JointState(name=list(names))
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = draw(STAMPS)
    msg.position, msg.velocity, msg.effort = (
        draw(st.lists(numbers, min_size=count, max_size=count)) for count in counts
    )
    return msg


@st.composite
def pairs(draw: Any) -> tuple[JointState, bytes]:
    """Draw a good message, and the bytes of one like it, or of another, cut, or changed."""
    names, frame_id = draw(OURS), draw(TEXT)
    n = len(names)
    efforts = draw(st.sampled_from([0, n, n + 1]))
    good = state(draw, names, frame_id, (n, n, efforts))
    counts = draw(st.just((n, n, efforts)) | st.tuples(*[st.integers(0, n + 1)] * 3))
    drawn = draw(st.just(names) | NAMES), draw(st.just(frame_id) | TEXT)
    data = bytearray(serialize_message(state(draw, *drawn, counts, ANY)))
    if draw(st.booleans()):  # also the order of the bytes, and what pads them
        data[draw(st.just(1) | st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    end = draw(st.just(len(data)) | st.integers(0, len(data)))
    return good, bytes(data[:end]) + draw(st.binary(max_size=8))


@examples(1000)
@given(pair=pairs())
def test_what_is_read_at_the_bytes_is_what_rclpy_reads(pair):
    good, data = pair
    found = JointStateBytes(good, JOINTS).read(data)
    if found is not None:
        stamp, q, dq = found
        expected = JointStateReader(JOINTS).from_ros(deserialized(data, JointState))
        assert repr((ns_from_ros(stamp), q, dq)) == repr(expected)
        assert stamp == deserialized(data, JointState).header.stamp


@examples(200)
@given(drawn=st.data(), names=OURS, frame_id=TEXT, noise=st.binary(min_size=4, max_size=4))
def test_steady_states_are_read_at_the_bytes_whatever_pads_them(drawn, names, frame_id, noise):
    n = len(names)
    first, second = (state(drawn.draw, names, frame_id, (n, n, n)) for _ in range(2))
    if "finger" in names:
        second.position[names.index("finger")] = math.nan  # not ours
    data = bytearray(serialize_message(second))
    behind = 16 + len(frame_id.encode()) + 1  # of the frame_id
    padding = -behind % 4
    data[behind : behind + padding] = noise[:padding]
    found = JointStateBytes(first, JOINTS).read(bytes(data))
    assert found is not None
    assert repr(found[1:]) == repr(JointStateReader(JOINTS).from_ros(second)[1:])
