"""``target_pose`` and ``target_twist`` of every controller: frames, checks, who leads."""

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TwistStamped
from ros_processes import FRAMES, HOME, UR5, Controlled, pose, reference, values
from samples import about, generator
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from tolerances import RELATIVE, SIMULATED_POSE, THROUGH_A_QUATERNION

from eulerparams_control.control.controller import Controller
from eulerparams_control.errors import RobotError
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.messages.to_ros import pose_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

MIXED = """
<robot name="mixed">
  <link name="ground"/> <link name="carriage"/> <link name="mast"/> <link name="wheel"/>
  <link name="hand"/> <link name="camera"/> <link name="finger"/>
  <joint name="rail" type="prismatic"> <parent link="ground"/> <child link="carriage"/>
    <origin xyz="0.1 0 0.3" rpy="0.2 0 0"/> <axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/> </joint>
  <joint name="foot" type="fixed"> <parent link="carriage"/> <child link="mast"/>
    <origin xyz="0 0 0.5" rpy="0 0.3 0"/> </joint>
  <joint name="turn" type="continuous"> <parent link="mast"/> <child link="wheel"/>
    <origin xyz="0 0.2 0"/> <axis xyz="0 0 1"/> <limit velocity="1" effort="1"/> </joint>
  <joint name="bend" type="revolute"> <parent link="wheel"/> <child link="hand"/>
    <origin xyz="0.4 0 0" rpy="0 0 0.7"/> <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/> </joint>
  <joint name="mount" type="fixed"> <parent link="hand"/> <child link="camera"/>
    <origin xyz="0 0 0.1" rpy="1 0 0"/> </joint>
  <joint name="grip" type="revolute"> <parent link="hand"/> <child link="finger"/>
    <axis xyz="0 0 1"/> <limit lower="0" upper="1" velocity="1" effort="1"/> </joint>
</robot>
"""


# --- where a link is -------------------------------------------------------------------------


@pytest.mark.parametrize("base", ["ground", "mast"])
def test_a_link_is_where_the_whole_urdf_says(base):
    robot = Robot(MIXED, base, "hand")
    model = pin.buildModelFromXML(MIXED)
    data = model.createData()
    for rail, turn, bend, _ in generator(900).uniform(-1, 1, size=(10, 4)):
        q = pin.neutral(model)
        at = {name: model.joints[model.getJointId(name)].idx_q for name in model.names[1:]}
        q[at["rail"]], q[at["bend"]] = rail if base == "ground" else 0.0, bend
        q[at["turn"] : at["turn"] + 2] = math.cos(turn), math.sin(turn)
        pin.framesForwardKinematics(model, data, q)
        place = {frame.name: data.oMf[i] for i, frame in enumerate(model.frames)}
        measured = np.array([rail, turn, bend] if base == "ground" else [turn, bend])
        links = ["mast", "wheel", "hand", "camera", "carriage"]
        for link in links + (["ground"] if base == "ground" else []):
            expected = place[base].actInv(place[link])
            found = robot.link_at(link, measured)
            np.testing.assert_allclose(found.p, expected.translation, atol=RELATIVE)
            np.testing.assert_allclose(found.R, expected.rotation, atol=RELATIVE)


@pytest.mark.parametrize(
    ("base", "frame", "words"),
    [
        ("ground", "finger", "where the frame 'finger' is depends on grip, which is not among"),
        ("mast", "ground", "where the frame 'ground' is depends on rail, which is not among"),
        ("ground", "hend", r"unknown frame 'hend' \(did you mean 'hand'\?\); known: camera, carr"),
        ("ground", "x" * 10**6, "unknown frame 'xxx"),
    ],
)
def test_a_frame_that_is_not_there_or_not_measured_is_refused(base, frame, words) -> None:  # type: ignore[no-untyped-def]
    robot = Robot(MIXED, base, "hand")
    with pytest.raises(RobotError, match=words) as refusal:
        robot.link_at(frame, np.zeros(robot.n))
    assert len(str(refusal.value)) < 2100


def test_the_base_frame_needs_no_name():
    robot = Robot(UR5.urdf, UR5.base_frame, UR5.tip_frame)
    for name in ("", UR5.base_frame):
        found = robot.link_at(name, HOME)
        assert (found.R.tolist(), found.p.tolist()) == (np.eye(3).tolist(), [0.0, 0.0, 0.0])


def test_a_finger_of_a_gripper_cannot_carry_a_target_but_its_hand_can():
    panda = load_robot("panda")
    robot = Robot(panda.urdf, panda.base_frame, panda.tip_frame)
    q = np.array(panda.home)
    state = robot.state(q, 0 * q)
    np.testing.assert_allclose(robot.link_at(panda.tip_frame, q).p, state.p_e, atol=RELATIVE)
    with pytest.raises(RobotError, match="depends on panda_finger_joint1"):
        robot.link_at("panda_leftfinger", q)


# --- the inputs of a controller ----------------------------------------------------------------


class Asked(list[tuple[str, Any, Any]]):
    """What a controller was asked for: aim or jog, the target, and when."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        for name in ("aim", "jog"):
            ask = lambda _, target, now, n=name: self.append((n, target, now))  # noqa: E731
            monkeypatch.setattr(Controller, name, ask, raising=False)


def stamped(seconds: float) -> Time:
    return Time(sec=int(seconds), nanosec=round(seconds % 1 * 1e9))


def twist(frame: str, linear: tuple[float, ...], stamp: float = 0.0) -> TwistStamped:
    msg = TwistStamped()
    msg.header.frame_id, msg.header.stamp = frame, stamped(stamp)
    msg.twist.linear.x, msg.twist.linear.y, msg.twist.linear.z = linear
    return msg


@pytest.mark.parametrize("executable", ["clik", "dynamic_control", "impedance_control"])
def test_targets_are_taken_in_the_frame_of_a_link_where_it_is_now(world, executable, monkeypatch):
    asked = Asked(monkeypatch)
    node = Controlled(world, executable, FRAMES)
    poses = node.peer.publisher(PoseStamped, "/target_pose")
    twists = node.peer.publisher(TwistStamped, "/target_twist")
    p, R = pose(node.arm.q)
    ahead = np.array([0.0, 0.0, 0.1])
    poses.publish(pose_to_ros(ahead, about(2, 0.3), Time(), "tool0"))
    poses.publish(pose_to_ros(p, R, Time(), ""))
    twists.publish(twist("tool0", (0.1, 0.0, 0.0)))
    twists.publish(twist("base_link", (0.1, 0.0, 0.0)))
    (a, goal, now), (_, here, _), (j, in_tip, _), (_, in_base, _) = asked
    assert (a, j, now) == ("aim", "jog", None)  # in simulated time the stamps count
    np.testing.assert_allclose(goal.p_d, p + R @ ahead, atol=RELATIVE)
    assert angle_between(goal.R_d, R @ about(2, 0.3)) < THROUGH_A_QUATERNION
    assert not goal.dp_d.any()
    np.testing.assert_allclose(here.p_d, p, atol=RELATIVE)
    np.testing.assert_allclose(in_tip[:3], R @ [0.1, 0.0, 0.0], atol=RELATIVE)
    np.testing.assert_allclose(in_base, [0.1, 0, 0, 0, 0, 0], atol=RELATIVE)


def test_targets_that_mean_nothing_are_refused_counted_and_said(world, monkeypatch):
    asked = Asked(monkeypatch)
    node = Controlled(world, "clik", FRAMES)
    poses = node.peer.publisher(PoseStamped, "/target_pose")
    twists = node.peer.publisher(TwistStamped, "/target_twist")
    p, R = pose(HOME)
    long = pose_to_ros(p, R, Time(), "")
    long.pose.orientation.w = 3.0
    for publisher, msg, words in (
        (poses, pose_to_ros(p * math.nan, R, Time(), ""), "the pose has a non-finite position"),
        (poses, long, "; expected 1"),
        (poses, pose_to_ros(p, R, Time(), "camera"), "unknown frame 'camera'; known: base, base_l"),
        (twists, twist("", (math.inf, 0.0, 0.0)), "the twist has a non-finite value"),
        (twists, twist("tool", (0.1, 0.0, 0.0)), "unknown frame 'tool' (did you mean 'tool0'?)"),
    ):
        publisher.publish(msg)
        assert words in node.process.log
    node.status(lambda s: {"target_pose rejected", "target_twist rejected"} <= values(s).keys())
    assert asked == []


def test_a_target_that_was_overtaken_is_refused_one_of_a_clock_set_back_is_not(world, monkeypatch):
    asked = Asked(monkeypatch)
    node = Controlled(world, "clik", FRAMES)
    twists = node.peer.publisher(TwistStamped, "/target_twist")
    for stamp in (5.0, 5.1, 5.05, 0.0):
        twists.publish(twist("", (stamp, 0.0, 0.0), stamp))
    assert [target[0] for _, target, _ in asked] == [5.0, 5.1, 0.0]
    assert "target_twist rejected: the stamp 5.050 s comes after 5.100 s" in node.process.log
    twists.publish(twist("", (5.2, 0.0, 0.0), 5.2))
    world.advance(1.5)
    twists.publish(twist("", (1.0, 0.0, 0.0), 1.0))
    assert [target[0] for _, target, _ in asked[3:]] == [5.2, 1.0]


@pytest.mark.parametrize("topic", ["target_pose", "target_twist"])
def test_two_publishers_of_targets_are_refused_and_both_named_but_not_a_successor(
    world, topic, monkeypatch
):
    asked = Asked(monkeypatch)
    node = Controlled(world, "clik", FRAMES)
    kind = {"target_pose": PoseStamped, "target_twist": TwistStamped}[topic]
    p, R = pose(HOME)
    msg = twist("", (0.1, 0.0, 0.0)) if topic == "target_twist" else pose_to_ros(p, R, Time(), "")

    def sender(name: str) -> tuple[Any, Any]:
        another = node.peer.another_node(name)
        return another, another.create_publisher(kind, f"/{topic}", 10)

    first, publisher = sender("first")
    publisher.publish(msg)
    assert len(asked) == 1
    second, other = sender("second")
    other.publish(msg)
    assert len(asked) == 1
    assert f"two publishers on '{topic}': /first, /second; expected one" in node.process.log
    second.destroy_node()
    publisher.publish(msg)
    assert len(asked) == 2
    _, successor = sender("first")  # while the one before is still in the graph
    successor.publish(msg)
    assert len(asked) == 3
    first.destroy_node()


def test_nothing_listens_to_targets_before_a_controller_is_active(world):
    world.start("clik", {**FRAMES, "autostart": False})
    for topic in ("target_pose", "target_twist"):
        assert world.peer.node.count_subscribers(f"/{topic}") == 0


# --- what becomes of them ----------------------------------------------------------------------


def test_a_robot_and_a_controller_together_reach_a_target_pose(world):
    slow = {"rate": 200.0, "servo_bandwidth": 100.0, "command_timeout": 1.0}
    nodes = [
        world.start("pybullet_bridge", slow, namespace="/left"),
        world.start("clik", FRAMES, namespace="/left"),
    ]
    states = world.peer.listen(JointState, "/left/joint_states")
    targets = world.peer.publisher(PoseStamped, "/left/target_pose")
    world.until_said(nodes[1], "holding the measured pose")
    p_0, R_0 = pose(HOME)
    p, R = p_0 + [0.0, 0.1, 0.05], about(1, 0.3) @ R_0
    targets.publish(pose_to_ros(p, R, Time(), "base_link"))

    def there() -> bool:
        found, turned = pose(states[-1].position[:6])
        near = np.linalg.norm(found - p) < SIMULATED_POSE
        return bool(near and angle_between(turned, R) < SIMULATED_POSE)

    world.until(there, "the arm at the target pose")
    assert [node.stop() for node in reversed(nodes)] == [0, 0]
    assert world.peer.node.count_publishers("/joint_reference") == 0  # all names are relative


def test_of_reference_target_pose_and_target_twist_the_newest_leads(world):
    node = Controlled(world, "clik", FRAMES)
    poses = node.peer.publisher(PoseStamped, "/target_pose")
    twists = node.peer.publisher(TwistStamped, "/target_twist")

    def moved(ticks: int) -> Any:
        before = pose(node.arm.q)[0]
        node.arm.ticks(ticks // 4, dt=0.004)
        return pose(node.arm.q)[0] - before

    p, R = pose(HOME)
    node.follow(reference(DesiredFrame(p + [0.0, 0.0, 0.2], R), times=(2.0,)))
    assert moved(500)[2] > 0.01
    p, R = pose(node.arm.q)
    poses.publish(pose_to_ros(p + [0.0, 0.1, 0.0], R, Time(), ""))
    moved(300)  # it turns away smoothly
    assert moved(1200)[1] > 0.01
    np.testing.assert_allclose(pose(node.arm.q)[0], p + [0.0, 0.1, 0.0], atol=1e-3)
    for _ in range(25):
        twists.publish(twist("", (0.0, 0.0, -0.1)))
        moved(20)
    assert moved(20)[2] == pytest.approx(-0.002, rel=0.1)
    moved(500)
    assert np.linalg.norm(moved(100)) < 1e-6  # its end is a stop
    p, R = pose(node.arm.q)
    poses.publish(pose_to_ros(p + [0.0, 0.1, 0.0], R, Time(), ""))
    moved(200)
    twists.publish(twist("", (0.0, 0.0, -0.1)))
    moved(1000)
    node.references.publish(reference(DesiredFrame(*pose(node.arm.q))))
    assert np.linalg.norm(moved(500)) < 1e-3


@pytest.mark.parametrize("executable", ["dynamic_control", "impedance_control"])
def test_an_arm_that_takes_efforts_goes_to_a_target_pose_and_jogs(world, executable):
    node = Controlled(world, executable, FRAMES)
    poses = node.peer.publisher(PoseStamped, "/target_pose")
    twists = node.peer.publisher(TwistStamped, "/target_twist")
    p, R = pose(HOME)
    poses.publish(pose_to_ros(np.array([0.0, 0.0, 0.05]), np.eye(3), Time(), "tool0"))
    node.arm.ticks(375, dt=0.004)
    goal = p + R @ [0.0, 0.0, 0.05]
    np.testing.assert_allclose(pose(node.arm.q)[0], goal, atol=1e-3)
    for _ in range(15):
        twists.publish(twist("tool0", (0.0, 0.0, -0.1)))
        node.arm.ticks(20)
    away = pose(node.arm.q)[0] - goal
    assert away @ (R @ [0.0, 0.0, -1.0]) > 0.01
    node.arm.ticks(150, dt=0.004)
    assert np.abs(node.arm.dq).max() < 1e-3


def test_a_halted_arm_is_not_jogged_and_its_fault_needs_a_pause(world):
    node = Controlled(world, "clik", FRAMES)
    twists = node.peer.publisher(TwistStamped, "/target_twist")
    node.peer.call(Trigger, "/clik/halt", Trigger.Request())
    for _ in range(50):
        twists.publish(twist("", (0.0, 0.0, 0.1)))
        node.arm.ticks(20)
    assert values(node.status())["target_twist rejected"] == "50"
    np.testing.assert_allclose(node.arm.q, HOME, atol=1e-9)
    node.peer.call(Trigger, "/clik/resume", Trigger.Request())
    twists.publish(twist("", (0.0, 0.0, 0.1)))
    node.arm.ticks(50)
    assert np.abs(node.arm.dq).max() > 1e-3
