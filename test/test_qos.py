"""Publishers whose quality of service does not match: named with what mends it, and counted."""

from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_processes import FRAMES, HOME, UR5, Controlled, Peer, assert_holds, values
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import String
from test_sources import REAL, an_arm, go_on
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.messages.keys import UNHEARD

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def override(topic: str, policy: str, value: str) -> dict[str, str]:
    """Return the parameter that changes the QoS of a subscription."""
    return {f"qos_overrides.{topic}.subscription.{policy}": value}


@pytest.fixture
def arm_with_less(world: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Returns the arm of a controller that publishes a topic with less than is asked for."""
    plain = Peer.publisher

    def arm(executable: str, topic: str) -> Any:
        qos = QoSProfile(depth=1) if topic == "robot_description" else BEST_EFFORT

        def publisher(peer: Any, kind: Any, name: str, *, latched: bool = False) -> Any:
            if name.strip("/") == topic:
                return peer.node.create_publisher(kind, name, qos)
            return plain(peer, kind, name, latched=latched)

        monkeypatch.setattr(Peer, "publisher", publisher)
        return an_arm(world, executable)

    return arm


def policy_of(topic: str) -> tuple[str, str, str]:
    """Return the policy of a topic that does not match, what is offered, and what is asked for."""
    if topic == "robot_description":
        return "durability", "volatile", "transient_local"
    return "reliability", "best_effort", "reliable"


each_needed = pytest.mark.parametrize(
    ("executable", "topic"),
    [
        *((name, "joint_states") for name in ("clik", "dynamic_control")),
        *((name, "robot_description") for name in ("clik", "impedance_control")),
        ("impedance_control", "wrench"),
    ],
)


@each_needed
def test_what_is_needed_first_is_named_with_both_qos_and_the_parameter_that_mends_it(
    world, arm_with_less, executable, topic
):
    (policy, offered, asked), arm = policy_of(topic), arm_with_less(executable, topic)
    process = world.start(executable, REAL)
    heard = world.peer.listen(DiagnosticArray, "/diagnostics")
    go_on(arm, 7.0, period=0.02)
    status = heard[-1].status[0]
    shown = values(status)
    mode = "unconfigured" if topic == "robot_description" else "inactive"
    assert (shown["cause"], shown["mode"], status.level) == ("incompatible_qos", mode, b"\x02")
    words = f"/peer publishes /{topic} with the {policy} {offered}, but it is read with {asked}"
    assert words in status.message
    remedy = f"set the parameter qos_overrides./{topic}.subscription.{policy} to {offered}"
    assert remedy in shown["remedy"]
    assert words in shown[UNHEARD]
    assert "nobody publishes" not in process.log
    assert "is the force/torque sensor running" not in process.log
    assert arm.commands == []


@each_needed
def test_with_that_parameter_it_is_received(world, arm_with_less, executable, topic):
    (policy, offered, _), arm = policy_of(topic), arm_with_less(executable, topic)
    world.start(executable, REAL | override(f"/{topic}", policy, offered))
    if topic == "robot_description":  # nothing of it is kept for who comes later
        arm._description.publish(String(data=UR5.urdf))
    go_on(arm, 1.0)
    assert_holds(arm.commands[-1], HOME)
    assert world.running[-1].log.count("publishes /") == 0


def diagnosed(world: Any, name: str, meanwhile: Any = lambda: None) -> str:
    """Return what a node says of publishers that it cannot hear."""

    def is_said(status: Any) -> bool:
        return UNHEARD in values(status)

    return values(world.peer.status(name, is_said, meanwhile))[UNHEARD]


LEADING = {
    "reference": MultiDOFJointTrajectory,
    "target_pose": PoseStamped,
    "target_twist": TwistStamped,
    "target_wrench": WrenchStamped,
    "target_stiffness": WrenchStamped,
}


@pytest.mark.parametrize("topic", LEADING)
def test_whatever_leads_the_arm_is_named_too(world, topic):
    node = Controlled(world, "impedance_control", FRAMES)
    world.peer.node.create_publisher(LEADING[topic], topic, BEST_EFFORT)
    text = diagnosed(world, node.name, node.arm.tick)
    assert f"/peer publishes /{topic} with the reliability best_effort" in text
    assert f"qos_overrides./{topic}.subscription.reliability" in text


@pytest.mark.parametrize(
    ("executable", "topic", "kind", "parameters"),
    [
        ("watchdog", "joint_states", JointState, {**FRAMES, "robot_description": UR5.urdf}),
        ("watchdog", "joint_effort", JointState, {**FRAMES, "robot_description": UR5.urdf}),
        ("watchdog", "robot_description", String, FRAMES),
        ("teleop", "joy", Joy, {"device": "joy"}),
        ("pybullet_bridge", "external_wrench", WrenchStamped, {}),
        ("reference", "joint_states", JointState, {**FRAMES, "robot_description": UR5.urdf}),
        ("identify_tool", "wrench", WrenchStamped, {"tip_frame": "tool0"}),
    ],
)
def test_every_node_names_who_it_cannot_hear(world, executable, topic, kind, parameters):
    world.peer.node.create_publisher(kind, topic, BEST_EFFORT)
    process = world.start(executable, parameters)
    assert process.exit_code is None, process.log
    mends = f"qos_overrides./{topic}.subscription.{policy_of(topic)[0]}"
    assert mends in diagnosed(world, executable)
    assert process.node.has_parameter(mends)


def test_a_publisher_that_cannot_be_heard_is_one_of_two(world):
    node = Controlled(world, "impedance_control", FRAMES)
    other = world.peer.another_node("other")
    other.create_publisher(WrenchStamped, "wrench", BEST_EFFORT)
    node.arm.send_next()
    assert "two publishers on 'wrench': /other, /peer; expected one" in node.process.log


def test_no_state_is_believed_at_activation_beside_a_publisher_that_cannot_be_heard(world):
    """The other one may be the arm."""
    arm = an_arm(world, "clik")
    driver = world.peer.another_node("driver")
    driver.create_publisher(JointState, "joint_states", BEST_EFFORT)
    process = world.start("clik", REAL)
    go_on(arm, 3.0)
    assert arm.commands == []
    assert "not activated: /driver publishes /joint_states with the reliability" in process.log
    driver.destroy_node()
    go_on(arm, 1.5)
    assert_holds(arm.commands[-1], HOME)


def test_commands_are_kept_for_readers_that_lag_by_a_second(world):
    node = Controlled(world, "impedance_control", FRAMES).process.node
    depths = {each.topic_name: each.qos_profile.depth for each in node.publishers}
    topics = "/joint_effort", "/compliant_frame", "/impedance_control/impedance"
    assert [depths[topic] for topic in topics] == [1000] * 3


def test_the_qos_of_one_input_changes_that_of_no_other(world):
    qos = override("/joint_states", "reliability", "best_effort")
    for parameters, topics in ((qos, {"/joint_states"}), ({}, set())):
        process = world.start("clik", {**REAL, "robot_description": UR5.urdf, **parameters})
        best_effort = {
            subscription.topic_name
            for subscription in process.node.subscriptions
            if subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        }
        assert best_effort == topics
        process.kill()
