"""The bag recorder as its users run it: a process that records what the test sends over DDS."""

import resource
import signal
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from in_process import run_to_its_end
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_processes import PATIENCE, ROOT, Graph, Process, SpunPeer
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from eulerparams_control.bags import Bag, recover
from eulerparams_control.bags.ros.recorder_node import BagRecorder
from eulerparams_control.events import ExitCode, events_of

JAZZY = get_typestore(Stores.ROS2_JAZZY)

RELIABLE = QoSProfile(depth=1000)
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Bench:
    """A node /arm/robot of the test, and a recorder in its namespace."""

    recorder: Process

    def __init__(self, graph: Graph, path: Path) -> None:
        self.graph, self.path = graph, path
        self.node = self.another("robot")
        self.states = self.publisher("joint_states", JointState)
        self.description = self.publisher("robot_description", qos=LATCHED)
        self.description.publish(String(data="<robot/>"))

    def another(self, name: str) -> Any:
        """Return another node /arm/name."""
        peer = self.graph.peer.node
        node = rclpy.create_node(name, namespace="arm", context=peer.context)
        peer.executor.add_node(node)
        return node

    def publisher(self, topic: str, kind: Any = String, qos: QoSProfile = RELIABLE) -> Any:
        return self.node.create_publisher(kind, topic, qos)

    def record(
        self, *topics: str, said: str = "", files: tuple[Path, ...] = (), **more: Any
    ) -> Process:
        """Start the recorder, and wait until it has said some words."""
        parameters = {"output": str(self.path), **more}
        parameters |= {"topics": list(topics)} if topics else {}
        self.recorder = self.graph.start("bag_recorder", parameters, files=files, namespace="/arm")
        self.until_said(said)
        return self.recorder

    def until_said(self, words: str) -> None:
        self.graph.until_said(self.recorder, words)

    def send(self, publisher: Any, messages: Iterable[Any], pause: float = 0.0) -> None:
        """Publish messages; return when all who listen have them."""
        self.graph.until(publisher.get_subscription_count, "a subscriber")
        for message in messages:
            publisher.publish(message)
            time.sleep(pause)
        assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))

    @property
    def bag(self) -> Bag:
        return Bag(self.path)

    def numbers(self, *topics: str) -> list[float]:
        """Return the positions of the states in the bag."""
        return [found.message.position[0] for found in self.bag.messages(topics or None)]


@pytest.fixture
def bench(graph: Graph, tmp_path: Path) -> Bench:
    return Bench(graph, tmp_path / "bag")


def states(count: int, joint: str = "j") -> Iterator[JointState]:
    for number in range(count):
        yield JointState(name=[joint], position=[float(number)])


def test_every_message_is_recorded_in_order(bench):
    bench.record(
        "joint_states", "/arm/robot_description", said=f"recording 2 topics to {bench.path}"
    )
    bench.send(bench.states, states(1000), pause=0.0005)
    assert bench.recorder.stop() == 0
    assert "recorded 1001 messages on 2 topics" in bench.recorder.stderr.splitlines()[-1]
    assert bench.recorder.stderr.count("recording") == 1

    bag = bench.bag
    found = list(bag.messages(["/arm/joint_states"]))
    assert [message.message.position[0] for message in found] == list(range(1000))
    assert all(0 < message.publish_time < message.log_time for message in found)
    sent = [message.publish_time for message in found]
    assert sent == sorted(set(sent))
    assert bag.robot_description() == "<robot/>"
    with Reader(bench.path) as reader:
        for connection in reader.connections:
            assert connection.digest == JAZZY.hash_rihs01(connection.msgtype)
            (offered,) = connection.ext.offered_qos_profiles
            is_latched = connection.topic == "/arm/robot_description"
            assert offered.durability.name == ("TRANSIENT_LOCAL" if is_latched else "VOLATILE")


@pytest.mark.slow
def test_ten_topics_at_1_khz_lose_nothing(bench):
    publishers = [bench.publisher(f"t{number}", JointState) for number in range(10)]
    bench.record(*(f"t{number}" for number in range(10)), said="recording 10 topics")
    begin = time.monotonic()
    for number, state in enumerate(states(2000)):
        for publisher in publishers:
            publisher.publish(state)
        time.sleep(max(0.0, begin + number / 1000 - time.monotonic()))
    for publisher in publishers:
        bench.send(publisher, [])
    assert bench.recorder.stop() == 0
    for publisher in publishers:
        assert bench.numbers(publisher.topic_name) == list(range(2000))


def test_what_has_arrived_is_stored_before_the_recorder_ends(bench):
    options = ["-p", f"output:={bench.path}", "-p", "topics:=[/arm/joint_states]"]
    rclpy.init(args=["--ros-args", *options], domain_id=bench.graph.domain)
    try:
        recorder = BagRecorder()  # no executor has it

        def is_matched() -> bool:
            recorder._tick()
            return any(s.get_publisher_count() for s in recorder._recorded.values())

        bench.graph.until(is_matched, "a recorder that listens")
        bench.send(bench.states, states(100))
        assert not bench.bag.topics
        recorder.close()
        recorder.destroy_node()
    finally:
        rclpy.shutdown()
    assert bench.numbers() == list(range(100))


def test_a_listed_topic_is_waited_for_and_named(bench):
    bench.record("joint_states", "late", said="waiting for a publisher of /arm/late")
    bench.states.publish(JointState())
    assert not bench.bag.topics
    bench.publisher("late")
    bench.until_said("recording 2 topics")
    bench.recorder.signal(signal.SIGTERM)
    assert bench.recorder.end() == 0


def test_the_shipped_file_records_all_topics_but_hidden_and_own_ones(bench):
    path = ROOT / "config/bag_recorder.yaml"
    settings = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
    assert settings.keys() == {"output", "include_hidden", "depth"}
    bench.publisher("_hidden/topic")
    bench.record(files=(path,), said="recording /arm/robot_description")
    new = bench.publisher("new")
    bench.until_said("recording /arm/new")
    bench.send(new, [String(data="x")])
    nodes = {"/arm/robot", "/peer"}
    bench.graph.until(lambda: bench.bag.parameters().keys() == nodes, "the parameters")
    assert bench.recorder.stop() == 0
    bag = bench.bag
    assert bag.parameters().keys() == nodes
    arm = {"/arm/joint_states", "/arm/robot_description", "/arm/new"}
    assert bag.topics.keys() == arm | {"/parameter_events"}
    assert bag.robot_description() == "<robot/>"
    assert [message.message.data for message in bag.messages(["/arm/new"])] == ["x"]


def test_hidden_topics_are_recorded_on_request(bench):
    bench.publisher("_hidden/topic")
    bench.record(include_hidden=True, said="recording /arm/_hidden/topic")
    assert bench.recorder.stop() == 0
    assert {"/arm/_hidden/topic", "/rosout"} <= bench.bag.topics.keys()


def test_reliable_and_best_effort_publishers_of_a_topic_are_both_recorded(bench):
    one, other = bench.publisher("both"), bench.publisher("both", qos=BEST_EFFORT)
    bench.record("both", said="recording 1 topics")
    bench.graph.until(other.get_subscription_count, "a subscriber")
    bench.send(one, [String(data="one")] * 10)
    bench.send(other, [String(data="other")] * 100, pause=0.01)
    assert bench.recorder.stop() == 0
    bag = bench.bag
    assert {message.message.data for message in bag.messages()} == {"one", "other"}
    with Reader(bench.path) as reader:
        (connection,) = reader.connections
        profiles = connection.ext.offered_qos_profiles
    assert sorted(q.reliability.name for q in profiles) == ["BEST_EFFORT", "RELIABLE"]


def test_the_bag_holds_the_parameters_of_the_recorded_nodes(bench):
    declared = {"gains.k_Pp": 100.0, "joints": ["a", "b"], "mask": [b"\1", b"\2"]}
    for name, value in (declared | {"robot_description": "<robot>" + 10000 * "-"}).items():
        bench.node.declare_parameter(name, value)
    bench.another("bystander").declare_parameter("x", 1)
    bench.another("_hidden").create_publisher(String, "tool", RELIABLE)
    bench.record("joint_states", "tool", said="recording 2 topics")
    expected: dict[str, Any] = {
        "gains": {"k_Pp": 100.0},
        "joints": ["a", "b"],
        "mask": [1, 2],
        "start_type_description_service": True,
        "use_sim_time": False,
    }

    def is_known() -> bool:
        return bench.bag.parameters() == {"/arm/robot": {"ros__parameters": expected}}

    assert is_known()  # before it records: a run may be short
    bench.node.set_parameters([Parameter("gains.k_Pp", value=7.0)])
    expected["gains"] = {"k_Pp": 7.0}
    time.sleep(0.5)
    assert bench.recorder.stop() == 0
    assert is_known()


@pytest.mark.slow
def test_a_killed_recorder_loses_no_more_than_a_chunk(bench):
    bench.record("joint_states", "robot_description", said="recording 2 topics")
    bench.send(bench.states, states(500), pause=0.001)
    bench.recorder.kill()
    assert bench.bag.truncated
    assert not (bench.path / "metadata.yaml").exists()

    whole = recover(bench.path).bag
    assert whole != bench.path
    found = bench.numbers("/arm/joint_states")
    assert found == list(range(len(found)))
    assert 500 - len(found) < 300  # 0.1 s of 1 kHz, and as much again on the way, twice
    assert Bag(whole).robot_description() == "<robot/>"
    with Reader(whole) as reader:
        assert reader.message_count == len(found) + 1


def test_messages_before_a_silence_are_not_lost_with_the_recorder(bench):
    bench.record("joint_states", said="recording 1 topics")
    bench.send(bench.states, states(5))
    bench.graph.until(lambda: len(list(bench.bag.read_raw())) == 5, "five messages")
    bench.recorder.kill()
    assert recover(bench.path).messages == 5


def test_an_existing_folder_is_refused_in_one_line(tmp_path):
    recorder = run_to_its_end("bag_recorder", tmp_path, {"output": str(tmp_path)})
    assert recorder.exit_code == ExitCode.REFUSED
    text = f"{tmp_path} exists; nothing is overwritten: choose another folder or remove it"
    assert recorder.stderr == f"error: {text}\n"
    told = [{"event": "ended", "exit_code": ExitCode.REFUSED, "text": text}]
    assert events_of(recorder.stdout) == told


def test_an_impossible_topic_is_refused_before_anything_is_written(tmp_path):
    path = tmp_path / "bag"
    recorder = run_to_its_end("bag_recorder", tmp_path, {"output": str(path), "topics": ["a//b"]})
    assert recorder.exit_code == 1
    assert "parameter 'topics': 'a//b' is no topic name" in recorder.stderr
    assert not path.exists()


def test_two_types_on_a_topic_are_refused_with_both(bench):
    other = SpunPeer(bench.graph)
    # A node's topics are discovered in their order: with the last of both, all are there.
    for topic in ("/arm/joint_states", "/arm/last"):
        other.publisher(String, topic)
    assert bench.record("joint_states", "robot_description", "last").end() == 1
    other.close()
    assert bench.recorder.stderr.splitlines()[-1] == (
        "error: /arm/joint_states has publishers of several types: "
        "sensor_msgs/msg/JointState, std_msgs/msg/String"
    )


@pytest.mark.parametrize(
    ("name", "pause"), [("j", 0.0002), pytest.param(5000 * "j", 0.001, marks=pytest.mark.slow)]
)
def test_a_full_disk_ends_the_recorder_with_one_line(bench, name, pause):
    bench.record("joint_states", said="recording 1 topics")
    limit = (200_000, 200_000)  # writes beyond it fail, as on a full disk
    resource.prlimit(bench.recorder._child.pid, resource.RLIMIT_FSIZE, limit)
    bench.send(bench.states, states(3000, name), pause)
    assert bench.recorder.end() == 1
    before, last = bench.recorder.stderr.splitlines()[-2:]
    assert "recording 1 topics" in before
    assert last.startswith(f"error: cannot write {bench.path}/bag_0.mcap")
    found = bench.numbers()
    assert 0 < len(found) == found[-1] + 1
