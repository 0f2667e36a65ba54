"""Messages to the core and back, as they travel: serialised; and what is refused of them."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PoseStamped, Quaternion, Transform, Twist, TwistStamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from samples import about, all_rotations, generator, uniform
from sensor_msgs.msg import JointState
from tolerances import NANOSECOND, RELATIVE, THROUGH_A_QUATERNION
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.messages import from_ros
from eulerparams_control.messages.to_ros import (
    duration_to_ros,
    error_to_ros,
    motion_to_ros,
    pose_to_ros,
    quaternion_to_ros,
    stamp_to_ros,
    wrench_to_ros,
)
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame, Placement
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import MAX_POINTS, Trajectory
from eulerparams_control.parameters.schemes import COMMANDS
from sim_bridge.commands import CommandInput

JOINTS = ("shoulder", "elbow", "wrist")
STAMP = Time(sec=3, nanosec=250_000_000)
POINT = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
possible = st.floats(-from_ros.LARGEST, from_ros.LARGEST)


def travelled(msg: Any) -> Any:
    """Return the message as its receiver gets it."""
    return deserialize_message(serialize_message(msg), type(msg))


def frames(count: int, key: int) -> list[DesiredFrame]:
    vectors = generator(20, key).normal(size=(count, 5, 3))
    return [
        DesiredFrame(p, R, dp, omega, ddp, domega)
        for R, (p, dp, omega, ddp, domega) in zip(uniform(count, key), vectors, strict=True)
    ]


def assert_same(found: DesiredFrame, expected: DesiredFrame) -> None:
    """Hold two desired frames to be the same, but for the rounding of a quaternion."""
    for name in ("p_d", "dp_d", "omega_d", "ddp_d", "domega_d"):
        assert getattr(found, name).tolist() == getattr(expected, name).tolist()
    assert angle_between(found.R_d, expected.R_d) < THROUGH_A_QUATERNION
    np.testing.assert_allclose(found.R_d, expected.R_d, atol=THROUGH_A_QUATERNION)


# --- there and back --------------------------------------------------------------------------
@given(st.integers(min_value=0, max_value=2**31 * 10**9 - 1))
def test_a_stamp_is_the_same_nanosecond_there_and_back(ns):
    assert from_ros.ns_from_ros(travelled(stamp_to_ros(ns))) == ns


@given(st.floats(min_value=0.0, max_value=1e6))
def test_a_duration_is_the_nearest_nanosecond_there_and_back(seconds):
    msg = travelled(duration_to_ros(seconds))
    assert isinstance(msg, Duration)
    assert 0 <= msg.nanosec < 10**9
    assert abs(from_ros.ns_from_ros(msg) / 1e9 - seconds) <= NANOSECOND


def test_a_rotation_is_the_same_there_and_back_at_every_angle():
    for R in all_rotations():
        Q = from_ros.quaternion_from_ros(travelled(quaternion_to_ros(R)))
        assert angle_between(Q.R, R) < THROUGH_A_QUATERNION


def test_a_quaternion_is_xyzw_in_messages_and_scalar_first_and_normalised_inside():
    half = math.sqrt(0.5)
    msg = quaternion_to_ros(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose([msg.x, msg.y, msg.z, msg.w], [0, 0, half, half], atol=RELATIVE)
    eta, eps = from_ros.quaternion_from_ros(Quaternion(x=0.6, y=0.0, z=0.0, w=0.8))
    assert eta == pytest.approx(0.8)
    np.testing.assert_allclose(eps, [0.6, 0.0, 0.0], atol=RELATIVE)
    single = (float(np.float32(v)) for v in np.array([1.0, 2.0, 3.0, 4.0]) / math.sqrt(30))
    Q = from_ros.quaternion_from_ros(Quaternion(**dict(zip("xyzw", single, strict=True))))
    assert Q.eta**2 + Q.eps @ Q.eps == pytest.approx(1.0, abs=RELATIVE)


def test_a_trajectory_is_the_same_there_and_back():
    expected = Trajectory([0.0, 0.5, 2.25], frames(3, key=1))
    msg = travelled(motion_to_ros(expected, "base_link", "tool0"))
    assert msg.header.frame_id == "base_link"
    assert list(msg.joint_names) == ["tool0"]
    motion, start = from_ros.motion_from_ros(msg, "base_link", "tool0", 0.1)
    assert start is None  # stamp 0: at receipt
    assert isinstance(motion, Trajectory)
    assert motion.times == [0.0, 0.5, 2.25]
    for found, frame in zip(motion.frames, expected.frames, strict=True):
        assert_same(found, frame)


def test_one_point_is_a_set_point_or_later_a_trajectory_and_rests_if_no_velocities_are_given():
    (frame,) = frames(1, key=2)
    msg = motion_to_ros(Trajectory([0.0], [frame]), "base_link", "tool0")
    msg.header.stamp = STAMP
    motion, start = from_ros.motion_from_ros(travelled(msg), "base_link", "tool0", 0.25)
    assert isinstance(motion, SetPoint)
    assert motion.lasting == 0.25
    assert start == 3_250_000_000
    assert_same(motion.frames[0], frame)
    msg = motion_to_ros(Trajectory([1.5], [frame]), "base_link", "tool0")
    motion, start = from_ros.motion_from_ros(travelled(msg), "base_link", "tool0", 0.25)
    assert isinstance(motion, Trajectory)
    assert motion.times == [1.5]
    assert start is None
    msg.points[0].velocities = msg.points[0].accelerations = []
    motion, _ = from_ros.motion_from_ros(travelled(msg), "base_link", "tool0", 0.25)
    assert_same(motion.frames[0], frame.at_rest())


def test_a_pose_is_the_same_there_and_back_and_an_error_a_twist_with_that_of_the_position_first():
    for frame in frames(20, key=4):
        msg = travelled(pose_to_ros(frame.p_d, frame.R_d, STAMP, "base_link"))
        assert isinstance(msg, PoseStamped)
        assert msg.header.stamp == STAMP
        assert_same(from_ros.pose_from_ros(msg, AT_ORIGIN), frame.at_rest())
    msg = travelled(error_to_ros(np.arange(3.0), np.arange(3.0, 6.0), STAMP, "base_link"))
    assert (msg.header.stamp, msg.header.frame_id) == (STAMP, "base_link")
    assert from_ros.vector_from_ros(msg.twist.linear).tolist() == [0.0, 1.0, 2.0]
    assert from_ros.vector_from_ros(msg.twist.angular).tolist() == [3.0, 4.0, 5.0]


def test_a_target_is_stated_in_the_frame_that_carries_it():
    carrier = Placement(about(2, math.pi / 2), np.array([1.0, 2.0, 3.0]))
    msg = pose_to_ros(np.array([0.5, 0.0, 0.0]), about(2, 0.3), STAMP, "camera")
    found = from_ros.pose_from_ros(msg, carrier)
    expected = DesiredFrame(np.array([1.0, 2.5, 3.0]), about(2, math.pi / 2 + 0.3))
    assert_same(found, expected)
    twist = TwistStamped()
    twist.twist.linear.x, twist.twist.angular.y = 0.1, 0.2  # of the tip, only the axes turn
    found_twist = from_ros.twist_from_ros(twist, carrier.R)
    np.testing.assert_allclose(found_twist, [0, 0.1, 0, -0.2, 0, 0], atol=RELATIVE)


@given(st.lists(possible, min_size=6, max_size=6))
def test_a_wrench_is_the_same_to_the_bit_there_and_back(values):
    msg = WrenchStamped()
    msg.header.frame_id = "tool0"
    wrench_to_ros(np.array(values), STAMP, msg)
    found = travelled(msg)
    assert found.header.stamp == STAMP
    assert [found.wrench.force.x, found.wrench.torque.z] == [values[0], values[5]]
    assert from_ros.wrench_from_ros(found, "tool0").tolist() == values


# --- joint_states and commands ---------------------------------------------------------------
@given(
    st.permutations(["finger", *JOINTS, "other_arm"]), st.lists(possible, min_size=10, max_size=10)
)
def test_joints_are_found_by_name_in_any_order_with_others_between(names, numbers):
    position = dict(zip(names, numbers[:5], strict=True))
    velocity = dict(zip(names, numbers[5:], strict=True))
    msg = JointState(name=names, position=numbers[:5], velocity=numbers[5:])
    msg.header.stamp = STAMP
    t, q, dq = from_ros.JointStateReader(JOINTS).from_ros(travelled(msg))
    assert t == 3_250_000_000
    assert q.tolist() == [position[joint] for joint in JOINTS]
    assert dq.tolist() == [velocity[joint] for joint in JOINTS]


def test_the_order_of_the_joints_may_change_from_message_to_message():
    reader = from_ros.JointStateReader(JOINTS)
    for names, position in (
        (["shoulder", "elbow", "wrist"], [1.0, 2.0, 3.0]),
        (["wrist", "elbow", "shoulder"], [3.0, 2.0, 1.0]),
        (["elbow", "finger", "wrist", "shoulder"], [2.0, math.nan, 3.0, 1.0]),  # not ours: as it is
        (["shoulder", "elbow", "wrist"], [1.0, 2.0, 3.0]),
    ):
        _, q, dq = reader.from_ros(travelled(JointState(name=names, position=position)))
        assert q.tolist() == [1.0, 2.0, 3.0]
        assert dq.tolist() == [0.0, 0.0, 0.0]  # no velocities are given
    with pytest.raises(InvalidMessageError, match="joint_states has no velocities"):
        from_ros.JointStateReader(JOINTS, True).from_ros(JointState(name=names, position=position))


def test_commands_are_read_by_name_and_refused_by_the_name_of_their_topic():
    position, effort = (CommandInput(JOINTS, control).from_ros for control in COMMANDS)
    names, q, dq = ["wrist", "shoulder", "elbow"], [3.0, 1.0, 2.0], [0.3, 0.1, 0.2]
    found = position(travelled(JointState(name=names, position=q, velocity=dq)))
    assert [part.tolist() for part in found] == [[1.0, 2.0, 3.0], [0.1, 0.2, 0.3]]
    found = position(JointState(name=names, position=q))
    assert [part.tolist() for part in found] == [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]
    (found,) = effort(travelled(JointState(name=names, effort=[30.0, 10.0, 20.0])))
    assert found.tolist() == [10.0, 20.0, 30.0]
    with pytest.raises(InvalidMessageError, match="joint_effort has 3 names but 2 values of effor"):
        effort(JointState(name=names, effort=[1.0] * 2))
    with pytest.raises(InvalidMessageError, match="joint_reference has a non-finite velocity"):
        position(JointState(name=names, position=q, velocity=[math.inf] * 3))


# --- what is refused of references, poses, wrenches -------------------------------------------
def put(msg: Any, path: str, value: Any) -> None:
    """Set the part of a message at a path such as "points.1.transforms"."""
    *steps, name = path.split(".")
    for step in steps:
        msg = msg[int(step)] if step.isdigit() else getattr(msg, step)
    setattr(msg, name, value)


NAMES = [*JOINTS, "finger"]
REFUSALS: dict[str, list[tuple[str, Any, str]]] = {
    "joint_states": [
        ("position", [1.0, math.nan, 3.0, 0.0], "a non-finite position: {'shoulder': 1.0, 'elbow"),
        ("velocity", [0.1, 0.2, -math.inf, 0.0], "a non-finite velocity: {'shoulder': 0.1, 'elbow"),
        ("position", [1.0, -1e10, 3.0, 0.0], "joint_states has a too large position"),
        ("position", [], "joint_states has 4 names but 0 values of position"),
        ("position", [1.0] * 5, "joint_states has 4 names but 5 values of position"),
        ("velocity", [1.0], "joint_states has 4 names but 1 values of velocity"),
        ("name", ["wrist", "elbo", "finger", "shoulder"], "joint_states lacks elbow; expected "
            "shoulder, elbow, wrist; found wrist, elbo, finger, shoulder"),
        ("name", [*JOINTS, "elbow"], "joint_states has elbow twice"),
        ("name", [], "lacks shoulder, elbow, wrist; expected shoulder, elbow, wrist; found no na"),
    ],
    "reference": [
        ("header.frame_id", "world", "in the frame 'world'; expected the base frame 'base_link'"),
        ("header.frame_id", "", "in the frame ''; expected the base frame 'base_link'"),
        ("joint_names", ["tool0", "x"], "is for ['tool0', 'x']; expected the tip frame ['tool0']"),
        ("joint_names", [], "is for []; expected the tip frame ['tool0']"),
        ("points", [], "the reference has no points; expected at least one"),
        ("points", [POINT] * (MAX_POINTS + 1), f"20001 points; expected at most {MAX_POINTS}"),
        ("points.0.time_from_start", Duration(sec=-1), "begins at time_from_start -1 s"),
        ("points.1.transforms", [], "point 1 of the reference has 0 transforms"),
        ("points.0.transforms", [Transform()] * 2, "point 0 of the reference has 2 transforms"),
        ("points.1.velocities", [Twist()] * 2, "point 1 of the reference has 2 velocities"),
        ("points.1.accelerations", [Twist()] * 2, "point 1 of the reference has 2 accelerations"),
        ("points.1.velocities", [], "has accelerations, and no velocities"),
        ("points.1.time_from_start", Duration(), "has a velocity, and no point has a time"),
        ("points.1.transforms.0.translation.y", math.nan, "point 1 of the reference has a non-fin"),
        ("points.0.velocities.0.angular.z", math.inf, "point 0 of the reference has a non-finite"),
        ("points.0.accelerations.0.linear.x", math.nan, "point 0 of the reference has a non-fini"),
        ("points.0.transforms.0.rotation", Quaternion(w=0.0), "w 0) has norm 0; expected 1"),
        ("points.0.transforms.0.rotation.x", math.nan, "has norm nan; expected 1"),
        ("points.0.transforms.0.rotation.w", 1e200, "has norm 1e+200; expected 1"),  # no square
        ("points.1.transforms.0.rotation", Quaternion(w=1.01), "w 1.01) has norm 1.01; expected 1"),
    ],
    "pose": [
        ("pose.position.y", math.inf, "non-finite position [0.0, inf, 0.0]"),
        ("pose.orientation.w", 0.5, "norm 0.5; expected 1"),
    ],
    "twist": [
        ("twist.angular.z", math.inf, "the twist has a non-finite value"),
        ("twist.angular.y", 1e10, "the twist has a too large value"),
    ],
    "wrench": [
        ("header.frame_id", "flange", "in the frame 'flange'; expected 'tool0'"),
        ("wrench.torque.z", math.nan, "the wrench has a non-finite value"),
        ("wrench.torque.x", 1e10, "has a too large value"),
    ],
}  # fmt: skip


def good(kind: str) -> tuple[Any, Callable[[Any], Any]]:
    """Return a good message, and what reads it."""
    if kind == "joint_states":
        numbers = {"position": [1.0, 2.0, 3.0, 4.0], "velocity": [0.1, 0.2, 0.3, 0.4]}
        reader = from_ros.JointStateReader(JOINTS)
        msg = JointState(name=NAMES, **numbers, effort=[10.0, 20.0, 30.0, 40.0])
        return msg, lambda msg: reader.from_ros(msg)[1:]
    if kind == "reference":
        msg = motion_to_ros(Trajectory([0.0, 1.0], frames(2, key=5)), "base_link", "tool0")
        return msg, lambda msg: from_ros.motion_from_ros(msg, "base_link", "tool0", 0.1)
    if kind == "pose":
        msg = pose_to_ros(np.zeros(3), np.eye(3), STAMP, "base_link")
        return msg, lambda msg: from_ros.pose_from_ros(msg, AT_ORIGIN)
    if kind == "twist":
        return TwistStamped(), lambda msg: from_ros.twist_from_ros(msg, np.eye(3))
    msg = WrenchStamped()
    msg.header.frame_id = "tool0"
    return msg, lambda msg: from_ros.wrench_from_ros(msg, "tool0")


@pytest.mark.parametrize(
    ("kind", "path", "value", "words"),
    [(kind, *refusal) for kind, refusals in REFUSALS.items() for refusal in refusals],
)
def test_what_means_nothing_is_refused_with_what_was_found(kind, path, value, words):
    msg, read = good(kind)
    read(msg)
    put(msg, path, value)
    for _ in range(2):  # nor is it taken after a good one
        with pytest.raises(InvalidMessageError, match=re.escape(words)):
            read(travelled(msg))
        read(good(kind)[0])  # the next one is good
