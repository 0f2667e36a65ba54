"""The nodes that are no controllers, under messages with any content: reference and bridge."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from in_process import Running, World
from ros_processes import FRAMES, HOME, MODEL, UR5, pose
from samples import examples
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from test_fuzz_messages import TEXT, joint_states, poses, wrenches
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.messages.to_ros import pose_to_ros, stamp_to_ros

storms = examples(12)

# Joints pass a limit by what they go in a step, at most [of the limit].
STOPPING = 0.02


def assert_alive(process: Running) -> None:
    assert process.exit_code is None, process.log
    assert "Traceback" not in process.log
    assert "internal error" not in process.log


class Sender:
    """A node and what can be sent to it, by topic."""

    def __init__(self, world: World, process: Running, topics: dict[str, Any]) -> None:
        self.world, self.process = world, process
        self._publishers = {
            name: world.peer.publisher(kind, name, latched=name == "robot_description")
            for name, kind in topics.items()
        }

    def send(self, topic: str, msg: Any) -> None:
        self._publishers[topic].publish(msg)

    def until_connected(self) -> None:
        for publisher in self._publishers.values():
            self.world.until(publisher.get_subscription_count, "a subscriber")


# --- reference -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Sender, list[Any]]]:
    """The node ``reference``, and what it has sent."""
    with World(tmp_path_factory.mktemp("reference")) as world:
        heard = world.peer.listen(MultiDOFJointTrajectory, "reference")
        process = world.start("reference", FRAMES)
        kinds = {
            "robot_description": String,
            "joint_states": JointState,
            "target_pose": PoseStamped,
        }
        yield Sender(world, process, kinds), heard


def assert_finite(msg: MultiDOFJointTrajectory) -> None:
    for point in msg.points:
        (transform,) = point.transforms
        numbers = [transform.translation, transform.rotation]
        numbers += [
            v for t in (*point.velocities, *point.accelerations) for v in (t.linear, t.angular)
        ]
        for v in numbers:
            assert np.isfinite([getattr(v, axis) for axis in v.get_fields_and_field_types()]).all()
        assert point.time_from_start.sec >= 0


TO_REFERENCE = st.one_of(
    st.tuples(st.just("joint_states"), joint_states(UR5.joints)),
    st.tuples(st.just("target_pose"), poses(UR5.base_frame)),
    st.tuples(st.just("robot_description"), st.builds(String, data=TEXT)),
)


@storms
@given(messages=st.lists(TO_REFERENCE, min_size=5, max_size=25))
def test_the_reference_node_survives_any_messages_and_then_goes_where_it_is_told(
    messages: list[tuple[str, Any]], sent: tuple[Sender, list[Any]]
) -> None:
    sender, heard = sent
    sender.until_connected()
    for topic, msg in messages:
        sender.send(topic, msg)
    p, R = pose(HOME)
    goal = p + [0.0, 0.0, 0.05]

    def arrived() -> bool:
        sender.send("robot_description", String(data=UR5.urdf))
        state = JointState(name=list(UR5.joints), position=HOME.tolist(), velocity=[0.0] * 6)
        sender.send("joint_states", state)
        sender.send("target_pose", pose_to_ros(goal, R, stamp_to_ros(0), UR5.base_frame))
        ends = [msg.points[-1].transforms[0].translation for msg in heard]
        return any(np.allclose([v.x, v.y, v.z], goal, rtol=0, atol=1e-9) for v in ends)

    sender.world.until(arrived, "a reference to the goal")
    for msg in heard:
        assert_finite(msg)
    heard.clear()
    assert_alive(sender.process)


# --- pybullet_bridge ---------------------------------------------------------------------------


Bridge = tuple[Sender, list[Any], list[Any]]


@pytest.fixture(scope="module", params=["position", "torque"])
def bridge(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Bridge]:
    """The bridge in real time, and the joint_states and wrenches that it has sent."""
    with World(tmp_path_factory.mktemp("bridge")) as world:
        states = world.peer.listen(JointState, "joint_states")
        felt = world.peer.listen(WrenchStamped, "wrench")
        command = "joint_reference" if request.param == "position" else "joint_effort"
        process = world.start("pybullet_bridge", {"control": request.param, "rate": 200.0})
        sender = Sender(world, process, {command: JointState, "external_wrench": WrenchStamped})
        yield sender, states, felt


TO_BRIDGE = st.one_of(
    st.tuples(st.just("command"), joint_states(UR5.joints)),
    st.tuples(st.just("external_wrench"), wrenches(UR5.sensor_frame)),
)


@storms
@given(messages=st.lists(TO_BRIDGE, min_size=5, max_size=25))
def test_the_bridge_survives_any_commands_and_its_robot_stays_within_its_limits(
    messages: list[tuple[str, Any]], bridge: Bridge
) -> None:
    sender, states, felt = bridge
    sender.until_connected()
    command = next(name for name in sender._publishers if name != "external_wrench")
    for topic, msg in messages:
        sender.send(command if topic == "command" else topic, msg)
    states.clear()
    sender.send("external_wrench", WrenchStamped(header=_sensor_header()))
    sender.world.until(lambda: len(states) > 20 or sender.process.exit_code is not None, "states")
    assert_alive(sender.process)
    for state in states:
        assert np.isfinite([*state.position, *state.velocity, *state.effort]).all()
        assert (np.abs(state.effort) <= MODEL.limits.effort * (1 + STOPPING)).all()
    for wrench in felt[-100:]:
        force = wrench.wrench.force
        assert np.isfinite([force.x, force.y, force.z]).all()
    felt.clear()


def _sensor_header() -> Any:
    from std_msgs.msg import Header

    return Header(frame_id=UR5.sensor_frame)
