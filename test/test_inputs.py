"""Inputs of a controller: states of the arm and of others, wrenches, targets."""

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from ros_processes import (
    FRAMES,
    HOME,
    MODEL,
    TICK,
    UR5,
    Arm,
    Controlled,
    assert_holds,
    pose,
    reference,
    values,
)
from samples import about
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from test_sources import REAL, Started, an_arm, go_on, says, told
from tolerances import RELATIVE, THROUGH_A_QUATERNION

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.errors import InvalidMessageError, RobotError
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.messages.from_ros import JointStateReader
from eulerparams_control.messages.to_ros import pose_to_ros, stamp_to_ros
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.qos import QOS_LATCHED
from eulerparams_control.ros.state_input import StateInput
from eulerparams_control.ros.wrench_input import WrenchInput

JOINTS = ("a", "b")
NAN = math.nan


def goal(z: float = 0.1) -> DesiredFrame:
    """Return a pose above home."""
    p, R = pose(HOME)
    return DesiredFrame(p + [0.0, 0.0, z], R)


# --- velocities ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("velocity", "needed", "words"),
    [
        ([NAN, NAN, 1.0], False, ""),  # of another's joint there is one
        ([NAN, NAN, NAN], False, ""),
        ([NAN, NAN, NAN], True, "joint_states has no velocities, all are NaN; efforts need the"),
        ([], True, "joint_states has no velocities; efforts need"),
        ([NAN, 0.1, 0.0], False, "joint_states has a non-finite velocity: {'a': nan"),
        ([0.1, NAN, 0.0], False, "joint_states has a non-finite velocity: {'a': 0.1"),
    ],
)
def test_velocities_that_are_all_nan_are_none(velocity, needed, words):
    msg = JointState(name=[*JOINTS, "finger"], position=[1.0, 2.0, 3.0], velocity=velocity)
    reader = JointStateReader(JOINTS, needed)
    if words:
        with pytest.raises(InvalidMessageError, match=words):
            reader.from_ros(msg)
    else:
        assert reader.from_ros(msg)[2].tolist() == [0.0, 0.0]
        assert not reader.has_velocity
    msg.velocity = [0.1, 0.2, NAN]
    assert reader.from_ros(msg)[2].tolist() == [0.1, 0.2]
    assert reader.has_velocity


def without_velocities(arm: Any) -> None:
    """Let an arm report NaN for its velocities, as joint_state_broadcaster does."""
    say = arm.message

    def message(q: Any = None) -> Any:
        msg = say(q)
        msg.velocity = [NAN] * 6
        return msg

    arm.message = message


# --- others' joints -----------------------------------------------------------------------------
def gripper(arm: Any) -> Any:
    """Return joint_states of a gripper, of now."""
    msg = JointState(name=["finger"], position=[0.01])
    msg.header.stamp = stamp_to_ros(arm.t + 500_000)
    return msg


@pytest.mark.parametrize("executable", ["clik", "dynamic_control", "impedance_control"])
def test_joint_states_of_others_are_ignored_in_silence(world, executable):
    node = Controlled(world, executable, FRAMES)
    rival = node.peer.another_node("gripper_driver")
    others = rival.create_publisher(JointState, "joint_states", 10)
    node.follow(reference(goal(), times=(1.0,)))
    for _ in range(300):
        for publisher in (others, others, node.arm.states):
            publisher.publish(gripper(node.arm))
        node.arm.tick()  # it is answered
    shown = values(node.status())
    assert "joint_states rejected" not in shown
    assert "states dropped, waiting for what belongs to them" not in shown
    assert shown["mode"] == "following"


def test_bytes_that_are_no_message_are_rejected_and_the_next_state_is_answered(world):
    node = Controlled(world, "impedance_control", FRAMES)
    for publisher in (node.arm.states, node.arm.sensor.wrenches):
        publisher.publish(b"\0\1\0\0\7")
    assert "joint_states rejected: 5 bytes are no JointState" in node.process.log
    assert "wrench rejected: 5 bytes are no WrenchStamped" in node.process.log
    assert_holds(node.arm.tick(), HOME)


@pytest.mark.parametrize("are_ours", [False, True])
def test_joint_states_of_others_or_that_are_refused_do_not_keep_those_of_the_arm_alive(
    world, are_ours
):
    node = Controlled(world, "clik", REAL)
    node.arm.tick()
    late = node.arm.message()
    node.arm.tick()

    def go_on() -> None:
        node.arm.t += 20_000_000
        node.arm.states.publish(late if are_ours else gripper(node.arm))

    status = node.peer.status("clik", lambda s: values(s)["cause"] == "no_states", go_on)
    assert status.level == b"\x02"
    assert ("joint_states rejected" in node.process.log) is are_ours


def test_that_no_joint_states_come_or_those_of_others_is_said_until_those_of_the_arm_do(world):
    process = world.start("clik", {**FRAMES, "robot_description": UR5.urdf})
    words = "nobody publishes /joint_states: is a robot there?"
    world.advance(4.0)
    assert words not in process.log  # it may not be known yet who does
    world.advance(3.0)
    world.until_said(process, words)
    states = world.peer.publisher(JointState, "joint_states")
    said = process.log.count(words)
    states.publish(JointState(name=["left_elbow_joint"], position=[0.0]))
    other = "joint_states of left_elbow_joint came, but none yet of shoulder_pan_joint, shoulder_"
    world.until_said(process, other)
    world.advance(10.0)
    assert process.log.count(words) == said
    assert "rejected" not in process.log


def test_a_fault_that_comes_again_is_logged_in_the_end_if_it_lasts(world):
    node, words = Controlled(world, "clik", FRAMES), "no valid joint_states within"
    node.arm.ticks(20)
    world.advance(1.0)
    world.until_said(node.process, words)
    node.arm.ticks(20)  # it was a hiccup
    node.status(lambda s: words not in s.message)
    world.advance(1.0)
    assert node.process.log.count(words) == 1
    world.advance(6.0)
    assert node.process.log.count(words) == 2


def test_a_controller_names_who_else_commands_its_arm(world):
    node = Controlled(world, "clik", FRAMES)
    words = "/clik, /rival publish /joint_reference"
    node.arm.ticks(1500)
    assert words not in node.process.log
    node.peer.another_node("rival").create_publisher(JointState, "joint_reference", 10)

    def is_said() -> bool:
        node.arm.tick()
        return words in node.process.log

    world.until(is_said, "the rival")


# --- rates --------------------------------------------------------------------------------------
def test_at_8_hz_the_arm_is_held_and_what_helps_is_said(world):
    node = Controlled(world, "clik", REAL)

    def step() -> None:
        world.advance(0.125 - TICK)
        node.arm.tick(dt=0.125)

    def is_rare(status: Any) -> bool:
        return values(status)["cause"] == "rate_too_low" and "state_timeout" in status.message

    status = told(node, is_rare, step)
    for _ in range(20):
        step()
        assert is_rare(told(node, bool, step))  # no silence is told between them
    assert status.level == b"\x02"
    assert "come every 0.125 s, but state_timeout is 0.1 s" in status.message
    assert "set state_timeout to 0.25 s" in values(status)["remedy"]


# --- the wrench ---------------------------------------------------------------------------------
def test_a_wrench_that_repeats_itself_while_the_arm_moves_is_not_believed(world):
    node = Controlled(world, "impedance_control", REAL)
    arm = node.arm
    node.references.publish(reference(goal(0.2), times=(3.0,)))
    arm.ticks(500)
    begin, arm.sensor.noise, arm.sensor.bias = arm.q, 0.0, np.full(6, 1e-3)
    status = told(node, lambda s: values(s)["cause"] == "wrench_stuck", arm.tick)
    assert "repeats its value to the bit while the arm moves" in status.message
    assert "see to the sensor" in values(status)["remedy"]
    arm.ticks(500)
    assert values(told(node, bool, arm.tick))["frozen"] == "1"
    assert 0.02 < np.abs(arm.q - begin).max() < 0.1  # it came to rest
    assert np.abs(arm.dq).max() < 1e-3
    arm.sensor.noise = 1e-12
    told(node, lambda s: values(s)["cause"] == "", arm.tick)
    arm.ticks(200)
    assert np.abs(arm.dq).max() > 0.01


class RealTime:
    """A node in real time, and its clock."""

    ros_time_is_active = False

    def get_clock(self) -> "RealTime":
        return self


class Sensed:
    """A sensor and its input, by an injected clock; ``offset`` [s] is that of its own clock."""

    def __init__(self, offset: float = 0.0) -> None:
        states = StateInput(RealTime(), timeout=0.1, on_dispute=lambda _: None)
        self.input = WrenchInput(states, ImpedanceParameters())
        self.now, self.offset, self.count = 50.0, offset, 0

    def send(self, delay: float = 0.0, *, step: float = 0.002, stamp: float | None = None) -> bool:
        """Let a wrench come so late [s]; return whether it was taken."""
        self.now, self.count = self.now + step, self.count + 1
        steady.go_by(lambda: self.now)
        stamp = self.now - delay if stamp is None else stamp
        msg = WrenchStamped()
        msg.header.stamp = stamp_to_ros(round(1e9 * (1000 + self.offset + stamp)))
        msg.wrench.force.x = float(self.count)
        try:
            self.input.take(msg, AT_ORIGIN)
        except InvalidMessageError:
            return False
        return True

    @property
    def is_believed(self) -> bool:
        """Whether a state of now has a wrench."""
        self.input.choose(0, HOME, MODEL.limits)
        return self.input.fresh is not None


@pytest.fixture
def sensed() -> Iterator[Callable[..., Sensed]]:
    yield Sensed
    steady.go_by()


@pytest.mark.parametrize("offset", [-900.0, 0.0, 5.0])
def test_a_wrench_counts_whatever_its_clock_says_unless_it_is_late(sensed, offset):
    sensor = sensed(offset)
    assert all(sensor.send(0.004) for _ in range(100))
    assert not sensor.send(stamp=sensor.now - 0.01)  # in another order
    assert not sensor.send(stamp=sensor.now - 0.004 - 2 * 0.002)  # again
    assert sensor.send(0.004)
    assert not any(sensor.send(0.05) for _ in range(70))  # late: what was felt before
    assert not sensor.is_believed
    assert sensor.send(0.01)
    assert sensor.is_believed


def test_a_wrench_whose_clock_was_set_counts_again_within_a_bounded_time(sensed):
    for step, longest in ((0.5, 0.01), (-0.5, 0.2), (-0.05, 11.0)):
        sensor = sensed()
        assert all(sensor.send() for _ in range(100))
        sensor.offset += step
        silence = next(k for k in range(10_000) if sensor.send()) * 0.002
        assert silence <= longest
        assert all(sensor.send() for _ in range(100))


@pytest.mark.parametrize("jump", [-0.0505, -0.5])
def test_a_wrench_counts_when_the_states_do_where_the_clock_of_both_was_set_back(world, jump):
    node = Controlled(world, "impedance_control", REAL)
    arm = node.arm
    arm.ticks(100)
    arm.t += round(jump * 1e9)
    for _ in range(60):
        world.advance(TICK)
        arm.send_next()
    arm.sensor.bias = np.array([7.0, 0, 0, 0, 0, 0])
    arm.tick()
    assert np.linalg.norm(arm.frame().ddp_d) > 0.1


# --- activation -----------------------------------------------------------------------------------
def moving(arm: Any, seconds: float, speed: float) -> None:
    """Let an arm be led by hand."""
    for _ in range(round(seconds / 0.01)):
        arm.t += 10_000_000
        arm.dq = np.full(6, speed)
        arm.q = arm.q + 0.01 * arm.dq  # as a hand leads it
        arm.graph.advance(0.01)
        arm.send(arm.message())


@pytest.mark.parametrize(
    ("executable", "has_velocities"),
    [("clik", True), ("clik", False), ("dynamic_control", True), ("impedance_control", True)],
)
def test_an_arm_that_moves_is_not_activated_until_it_is_at_rest(world, executable, has_velocities):
    arm = an_arm(world, executable)
    if not has_velocities:
        without_velocities(arm)
    node = Started(world, executable, arm)
    status = told(node, lambda s: "the arm moves" in s.message, lambda: moving(arm, 0.01, 0.06))
    words = "the arm moves, shoulder_pan_joint at 0.06 rad/s; expected at most 0.05: bring it to"
    assert words in status.message
    if not has_velocities:
        bad = arm.message()
        bad.velocity = [5.0, *bad.velocity[1:]]  # of a driver that starts up joint by joint
        arm.send(bad)
        assert "joint_states has a non-finite velocity" in node.process.log
    assert not world.peer.change_state(executable, "activate")
    assert arm.commands == []
    moving(arm, 0.2, 0.0)
    assert arm.commands


@pytest.mark.parametrize(("calm", "bears"), [(0.08, False), (0.12, True)])
def test_efforts_begin_at_those_that_the_robot_reports_unless_they_may_brake_it(world, calm, bears):
    arm, name = an_arm(world, "dynamic_control"), "dynamic_control"
    gravity, more, say = MODEL.dynamic_state(HOME, 0 * HOME).g, np.arange(1.0, 7.0), arm.message

    def message(q: Any = None) -> Any:
        msg = say(q)
        msg.effort = (gravity + more).tolist()
        return msg

    arm.message = message
    Started(world, name, arm, autostart=False, max_effort_rate=[100.0])
    assert world.peer.change_state(name, "configure"), world.logs()
    arm.dq = np.full(6, 0.06)
    go_on(arm, 0.5)
    arm.dq = np.zeros(6)
    go_on(arm, calm)
    refused = arm.message(NAN * HOME)  # whose efforts are those of other joints
    refused.name = refused.name[::-1]
    arm.states.publish(refused)
    assert world.peer.change_state(name, "activate")
    arm.send_next()
    begin = gravity + more if bears else gravity
    np.testing.assert_allclose(arm.commands[0].effort, begin, atol=0.2)


@pytest.mark.parametrize("believed", [True, False])
def test_an_arm_whose_efforts_are_not_those_of_its_model_is_not_activated(world, believed):
    arm, name = an_arm(world, "dynamic_control"), "dynamic_control"
    on_a_wall = Robot(UR5.urdf, "base_link", "tool0", gravity=(-9.81, 0.0, 0.0))
    efforts, say = on_a_wall.dynamic_state(HOME, 0 * HOME).g, arm.message

    def message(q: Any = None) -> Any:
        msg = say(q)
        msg.effort = efforts.tolist()
        return msg

    arm.message = message
    node = Started(world, name, arm, effort_feedback=believed)
    if not believed:
        go_on(arm, 0.5)
        assert arm.commands
        return
    status = says(node, "model_mismatch", "inactive", lambda: go_on(arm, 0.1))
    assert "hold its weight" in status.message
    assert "gravity" in values(status)["remedy"]
    assert arm.commands == []
    arm.message = say  # it is taken off the wall: nothing is known of its efforts now
    go_on(arm, 0.5)
    assert arm.commands


def test_whose_time_counts_is_known_also_after_it_was_changed(world):
    node = Controlled(world, "clik", REAL)
    for simulated, within in ((True, 0.5), (False, 0.1)):
        assert node.peer.set_parameters("clik", use_sim_time=simulated) == []
        node.arm.start_anew()
        status = node.peer.status("clik", lambda s: values(s)["cause"] == "no_states")
        assert f"no valid joint_states within {within} s" in status.message


# --- the robot ------------------------------------------------------------------------------------
def test_a_mimic_joint_in_the_chain_is_refused_with_what_helps():
    urdf = UR5.urdf.replace(
        '<joint name="wrist_2_joint" type="revolute">',
        '<joint name="wrist_2_joint" type="revolute"><mimic joint="wrist_1_joint"/>',
    )
    assert "<mimic" in urdf
    with pytest.raises(RobotError) as refusal:
        Robot(urdf, "base_link", "tool0").refuse_joints()
    text = str(refusal.value)
    assert "wrist_2_joint can move between base_link and tool0" in text
    assert "set tip_frame to wrist_1_link or a link before it" in text
    assert 'remove its <mimic>; else make it type="fixed" in the URDF' in text
    Robot(urdf, "base_link", "wrist_1_link").refuse_joints()
    with pytest.raises(RobotError, match=r"wrist_3_joint can move .* set joints"):
        Robot(UR5.urdf, "base_link", "tool0", UR5.joints[:5]).refuse_joints()


@pytest.mark.parametrize(
    ("description", "words"),
    [
        ("<robot", "not valid XML"),
        ("/opt/arm.urdf", "the robot description is a path, '/opt/arm.urdf'; expected the text"),
        ('<robot name="a"><xacro:ur prefix=""/></robot>', "has <xacro:ur>; expand it: xacro FILE"),
        (re.sub('lower="[^"]*" upper="[^"]*"', "", UR5.urdf), " cannot move: its limits are 0"),
    ],
)
@pytest.mark.parametrize("way", ["parameter", "topic"])
def test_a_robot_description_that_is_none_is_called_by_its_name(world, way, description, words):
    parameters = {"robot_description": description} if way == "parameter" else {}
    process = world.start("clik", {**FRAMES, **parameters})
    if way == "topic":
        latched = world.peer.node.create_publisher(String, "robot_description", QOS_LATCHED)
        latched.publish(String(data=description))
    else:
        process.node.trigger_configure()
    world.advance(0.1)
    assert "not configured: " in process.log
    assert words in process.log
    if way == "topic":
        Arm(world, UR5).connect()  # a good one is taken after it


# --- the inputs of a controller ----------------------------------------------------------------
class Asked(list[tuple[str, Any, Any]]):
    """What a controller was asked for: aim or jog, the target, and when."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        for name in ("aim", "jog"):
            ask = lambda _, target, now, n=name: self.append((n, target, now))  # noqa: E731
            monkeypatch.setattr(Controller, name, ask)


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
    for publisher, msg, words in (
        (poses, pose_to_ros(p * math.nan, R, Time(), ""), "the pose has a non-finite position"),
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


@pytest.mark.parametrize(
    ("executable", "topic"),
    [
        *((executable, "reference") for executable in Controlled.ARMS),
        ("impedance_control", "wrench"),
        ("clik", "target_pose"),
        ("clik", "target_twist"),
    ],
)
def test_two_publishers_of_an_input_are_refused_and_both_named_but_not_a_successor(
    world, executable, topic
):
    node = Controlled(world, executable, FRAMES)
    peer, arm, moved = node.peer, node.arm, goal(0.01)
    make = {
        "reference": lambda: reference(moved),
        "wrench": lambda: arm.sensor.message(arm, arm.message().header.stamp),
        "target_pose": lambda: pose_to_ros(moved.p_d, moved.R_d, Time(), ""),
        "target_twist": lambda: twist("", (0.1, 0.0, 0.0)),
    }[topic]
    kind = type(make())

    def sender(name: str) -> tuple[Any, Any]:
        another = peer.another_node(name)
        return another, another.create_publisher(kind, f"/{topic}", 10)

    own, (rival, other) = peer.publisher(kind, f"/{topic}"), sender("rival")
    for publisher in (own, other):
        publisher.publish(make())
    assert f"two publishers on '{topic}': /peer, /rival; expected one" in node.process.log
    assert peer.counter(node.name, f"{topic} rejected", 2) == 2
    rival.destroy_node()
    assert_holds(arm.tick(), HOME)
    _, successor = sender("peer")  # while the one before is still in the graph
    arm.t += 1_000_000
    successor.publish(make())
    mode = "holding" if topic == "wrench" else "following"
    shown = values(node.status(lambda s: values(s)["mode"] == mode))
    assert shown[f"{topic} rejected"] == "2"
