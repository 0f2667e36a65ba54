"""The bag recorder as its users run it: a process that records other processes over DDS."""

import contextlib
import json
import queue
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from ros_processes import DOMAINS, ROOT, environment
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from eulerparams_control.bags import Bag, recover
from eulerparams_control.events import ExitCode, events_of
from eulerparams_control.lab.experiments.domains import Domain

JAZZY = get_typestore(Stores.ROS2_JAZZY)
RECORDER = [sys.executable, "-m", "eulerparams_control.bags.recorder"]

# A guard against hanging, not a measure: what is waited for takes about a second.
PATIENCE = 200.0

# A node that does what it is told: one JSON string of Python a line, one answer each.
PUPPET = """
import json, sys, threading, time
import rclpy
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node(sys.argv[1], namespace=sys.argv[2])
threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
best_effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
sent = 0

def state(number):
    return JointState(name=["j"], position=[float(number)])

def wait_until(condition):
    while not condition():
        time.sleep(0.001)

for line in sys.stdin:
    code, answer = json.loads(line), None
    exec(code)
    print("answer", json.dumps(answer), flush=True)
"""

Start = Callable[..., "Process"]


class Process:
    """A child process whose output is waited for line by line."""

    def __init__(self, command: list[Any], environment: dict[str, str]) -> None:
        self.output: list[str] = []
        self.events: list[dict[str, Any]] = []
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._child = subprocess.Popen(
            [str(word) for word in command],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def expect(self, words: str) -> str:
        """Return the next line that contains ``words``."""
        deadline = time.monotonic() + PATIENCE
        with contextlib.suppress(queue.Empty):
            while line := self._lines.get(timeout=max(0, deadline - time.monotonic())):
                found = events_of(line)
                self.events += found
                self.output += [] if found else [line]
                if words in line:
                    return line
        raise AssertionError(f"no line with {words!r} in:\n{''.join(self.output)}")

    def do(self, code: str) -> Any:
        """Let a puppet run ``code``; return what that assigns to ``answer``."""
        assert self._child.stdin is not None
        self._child.stdin.write(json.dumps(code) + "\n")
        self._child.stdin.flush()
        return json.loads(self.expect("answer").removeprefix("answer "))

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Send a signal; return the exit code."""
        self._child.send_signal(number)
        return self.end()

    def end(self) -> int:
        """Wait for the end; return the exit code."""
        with contextlib.suppress(AssertionError):
            self.expect("\0 never printed")
        return self._child.wait(timeout=PATIENCE)

    def limit_files(self, size: int) -> None:
        """Let writes beyond ``size`` bytes of a file fail, as on a full disk."""
        resource.prlimit(self._child.pid, resource.RLIMIT_FSIZE, (size, size))

    def kill(self) -> None:
        self._child.kill()
        self._child.wait()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Start processes in a ROS domain of their own; none outlives the test."""
    domain = Domain(DOMAINS)
    surroundings = environment(tmp_path / "log", domain.number)
    processes: list[Process] = []

    def begin(*command: Any) -> Process:
        processes.append(Process(list(command), surroundings))
        return processes[-1]

    yield begin
    for process in processes:
        process.kill()
    domain.release()


@pytest.fixture
def robot(start: Start) -> Process:
    """A node /arm/robot that publishes joint_states and a latched robot_description."""
    puppet = start(sys.executable, "-c", PUPPET, "robot", "arm")
    puppet.do(
        "states = node.create_publisher(JointState, 'joint_states', QoSProfile(depth=1000))\n"
        "urdf = node.create_publisher(String, 'robot_description', latched)\n"
        "urdf.publish(String(data='<robot/>'))"
    )
    return puppet


def eventually(condition: Callable[[], bool]) -> None:
    """Return when the condition holds; fail if it never does."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def record(start: Start, bag: Path, *topics: str, extra: tuple[str, ...] = ()) -> Process:
    """Start a recorder in the namespace of the robot."""
    listed = ["-p", f"topics:=[{','.join(topics)}]"] if topics else []
    options = ["-r", "__ns:=/arm", "-p", f"output:={bag}", *listed, *extra]
    return start(*RECORDER, "--ros-args", *options)


def test_every_message_is_recorded_in_order_as_rosbags_and_mcap_read_it(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    recorder = record(start, tmp_path / "bag", "joint_states", "/arm/robot_description")
    assert f"recording 2 topics to {tmp_path / 'bag'}" in recorder.expect("recording")
    robot.do(
        "wait_until(states.get_subscription_count)\n"
        "for number in range(3000):\n"
        "    states.publish(state(number))\n"
        "    time.sleep(0.0005)\n"
        "states.wait_for_all_acked(rclpy.duration.Duration(seconds=60))"
    )
    assert recorder.stop() == 0
    assert "recorded 3001 messages on 2 topics" in recorder.output[-1]
    assert sum("recording" in line for line in recorder.output) == 1

    with AnyReader([tmp_path / "bag"]) as reader:
        topics = {connection.topic: connection for connection in reader.connections}
        for connection in topics.values():
            assert connection.digest == JAZZY.hash_rihs01(connection.msgtype)
        messages = [
            (connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
        ]
    states = [message.position[0] for topic, message in messages if "states" in topic]
    assert states == list(range(3000))
    assert [m.data for topic, m in messages if topic == "/arm/robot_description"] == ["<robot/>"]
    offered = {name: c.ext.offered_qos_profiles for name, c in topics.items()}
    assert [q.durability.name for q in offered["/arm/joint_states"]] == ["VOLATILE"]
    assert [q.durability.name for q in offered["/arm/robot_description"]] == ["TRANSIENT_LOCAL"]

    with open(tmp_path / "bag/bag_0.mcap", "rb") as file:
        decoder = DecoderFactory()
        found = make_reader(file, True, [decoder]).iter_decoded_messages("/arm/joint_states")
        positions, times = zip(
            *(
                (decoded.position[0], (message.publish_time, message.log_time))
                for _, _, message, decoded in found
            ),
            strict=True,
        )
    assert list(positions) == states
    assert all(0 < sent <= received for sent, received in times)
    assert [sent for sent, _ in times] == sorted({sent for sent, _ in times})


@pytest.mark.slow
def test_ten_topics_at_1_khz_lose_nothing(start: Start, robot: Process, tmp_path: Path) -> None:
    names = [f"t{number}" for number in range(10)]
    robot.do(
        f"pubs = [node.create_publisher(JointState, t, QoSProfile(depth=1000)) for t in {names}]"
    )
    recorder = record(start, tmp_path / "bag", *names)
    recorder.expect("recording 10 topics")
    robot.do(
        "wait_until(lambda: all(p.get_subscription_count() for p in pubs))\n"
        "begin = time.monotonic()\n"
        "for number in range(2000):\n"
        "    for pub in pubs:\n"
        "        pub.publish(state(number))\n"
        "    wait_until(lambda: time.monotonic() > begin + number / 1000)\n"
        "for pub in pubs:\n"
        "    pub.wait_for_all_acked(rclpy.duration.Duration(seconds=60))"
    )
    assert recorder.stop() == 0
    bag = Bag(tmp_path / "bag")
    for name in names:
        numbers = [m.message.position[0] for m in bag.messages([f"/arm/{name}"])]
        assert numbers == list(range(2000))


def test_what_has_arrived_is_stored_before_the_recorder_ends(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    options = ["-p", f"output:={tmp_path}/bag", "-p", "topics:=[/arm/joint_states]"]
    recorder = start(sys.executable, "-c", PUPPET, "idle", "arm", "--ros-args", *options)
    recorder.do(
        "from eulerparams_control.bags.ros.recorder_node import BagRecorder\n"
        "recorder = BagRecorder()  # no executor has it\n"
        "matched = lambda: any(s.get_publisher_count() for s in recorder._recorded.values())\n"
        "wait_until(lambda: recorder._tick() or matched())"
    )
    robot.do(
        "wait_until(states.get_subscription_count)\n"
        "for number in range(100):\n"
        "    states.publish(state(number))\n"
        "states.wait_for_all_acked(rclpy.duration.Duration(seconds=60))"
    )
    assert not Bag(tmp_path / "bag").topics
    recorder.do("recorder.close()")
    numbers = [message.message.position[0] for message in Bag(tmp_path / "bag").messages()]
    assert numbers == list(range(100))


def test_a_listed_topic_is_waited_for_and_named(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    recorder = record(start, tmp_path / "bag", "joint_states", "late")
    recorder.expect("waiting for a publisher of /arm/late")
    robot.do("states.publish(state(-1.0))")
    assert not Bag(tmp_path / "bag").topics
    robot.do("late = node.create_publisher(String, 'late', 10)")
    recorder.expect("recording 2 topics")
    assert recorder.stop(signal.SIGTERM) == 0


def test_without_a_list_all_topics_are_recorded_but_hidden_and_own_ones(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    robot.do("hidden = node.create_publisher(String, '_hidden/topic', 10)")
    recorder = record(start, tmp_path / "bag")
    recorder.expect("recording /arm/robot_description")
    robot.do("new = node.create_publisher(String, 'new', 10)")
    recorder.expect("recording /arm/new")
    robot.do("wait_until(new.get_subscription_count); new.publish(String(data='x'))")
    robot.do("new.wait_for_all_acked(rclpy.duration.Duration(seconds=60))")
    eventually(lambda: bool(Bag(tmp_path / "bag").parameters()))
    assert recorder.stop() == 0
    bag = Bag(tmp_path / "bag")
    assert bag.parameters().keys() == {"/arm/robot"}
    arm = {"/arm/joint_states", "/arm/robot_description", "/arm/new"}
    assert bag.topics.keys() == arm | {"/parameter_events"}
    assert bag.robot_description() == "<robot/>"
    assert [message.message.data for message in bag.messages(["/arm/new"])] == ["x"]


def test_hidden_topics_are_recorded_on_request(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    robot.do("hidden = node.create_publisher(String, '_hidden/topic', 10)")
    recorder = record(start, tmp_path / "bag", extra=("-p", "include_hidden:=true"))
    recorder.expect("recording /arm/_hidden/topic")
    assert recorder.stop() == 0
    assert {"/arm/_hidden/topic", "/rosout"} <= Bag(tmp_path / "bag").topics.keys()


def test_reliable_and_best_effort_publishers_of_a_topic_are_both_recorded(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    robot.do(
        "one = node.create_publisher(String, 'both', QoSProfile(depth=1000))\n"
        "other = node.create_publisher(String, 'both', best_effort)\n"
        "wait_until(lambda: node.count_publishers('/arm/both') == 2)"
    )
    recorder = record(start, tmp_path / "bag", "both")
    recorder.expect("recording 1 topics")
    robot.do(
        "wait_until(lambda: one.get_subscription_count() and other.get_subscription_count())\n"
        "for _ in range(100):\n"
        "    one.publish(String(data='one')); other.publish(String(data='other'))\n"
        "    time.sleep(0.01)"
    )
    assert recorder.stop() == 0
    bag = Bag(tmp_path / "bag")
    assert {message.message.data for message in bag.messages()} == {"one", "other"}
    with Reader(tmp_path / "bag") as reader:
        (connection,) = reader.connections
        profiles = connection.ext.offered_qos_profiles
    assert sorted(q.reliability.name for q in profiles) == ["BEST_EFFORT", "RELIABLE"]


def test_the_bag_holds_the_parameters_of_the_recorded_nodes(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    robot.do(
        "node.declare_parameter('gains.k_Pp', 100.0)\n"
        "node.declare_parameter('joints', ['a', 'b'])\n"
        "node.declare_parameter('mask', [b'\\1', b'\\2'])\n"
        "node.declare_parameter('robot_description', '<robot>' + 10000 * '-')"
    )
    start(sys.executable, "-c", PUPPET, "bystander", "arm").do("node.declare_parameter('x', 1)")
    hidden = start(sys.executable, "-c", PUPPET, "_hidden", "arm")
    hidden.do("tool = node.create_publisher(String, 'tool', 10)")
    recorder = record(start, tmp_path / "bag", "joint_states", "tool")
    recorder.expect("recording 2 topics")
    expected = {
        "/arm/robot": {
            "ros__parameters": {
                "gains": {"k_Pp": 100.0},
                "joints": ["a", "b"],
                "mask": [1, 2],
                "start_type_description_service": True,
                "use_sim_time": False,
            }
        }
    }
    eventually(lambda: Bag(tmp_path / "bag").parameters() == expected)
    robot.do("node.set_parameters([Parameter('gains.k_Pp', value=7.0)])")
    robot.do("time.sleep(0.5)")
    assert recorder.stop() == 0
    expected["/arm/robot"]["ros__parameters"]["gains"] = {"k_Pp": 7.0}
    assert Bag(tmp_path / "bag").parameters() == expected


@pytest.mark.slow
def test_a_killed_recorder_loses_no_more_than_a_chunk(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    recorder = record(start, tmp_path / "bag", "numbers", "robot_description")
    robot.do(
        "numbers = node.create_publisher(String, 'numbers', QoSProfile(depth=1000))\n"
        "def talk():\n"
        "    global sent\n"
        "    while True:\n"
        "        numbers.publish(String(data=str(sent)))\n"
        "        sent += 1\n"
        "        time.sleep(0.001)\n"
        "wait_until(numbers.get_subscription_count)\n"
        "threading.Thread(target=talk, daemon=True).start()"
    )
    recorder.expect("recording 2 topics")
    sent = robot.do("wait_until(lambda: sent > 500); answer = sent")
    recorder.kill()
    killed = Bag(tmp_path / "bag")
    assert killed.truncated
    assert not (tmp_path / "bag/metadata.yaml").exists()

    recovery = start(*RECORDER, "--recover", tmp_path / "bag")
    recovery.expect("recovered")
    assert recovery.end() == 0
    bag = Bag(tmp_path / "bag")
    numbers = [int(message.message.data) for message in bag.messages(["/arm/numbers"])]
    assert numbers == list(range(len(numbers)))
    assert sent - len(numbers) < 300  # 0.1 s of 1 kHz, and as much again on the way, twice
    assert bag.robot_description() == "<robot/>"
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == len(numbers) + 1


def test_messages_before_a_silence_are_not_lost_with_the_recorder(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    recorder = record(start, tmp_path / "bag", "joint_states")
    recorder.expect("recording 1 topics")
    robot.do("wait_until(states.get_subscription_count)")
    robot.do("for number in range(5): states.publish(state(number))")
    eventually(lambda: len(list(Bag(tmp_path / "bag").read_raw())) == 5)
    recorder.kill()
    assert recover(tmp_path / "bag").messages == 5


def test_an_existing_folder_is_refused_in_one_line(start: Start, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    recorder = record(start, tmp_path / "bag", "joint_states")
    assert recorder.end() == ExitCode.REFUSED
    text = f"{tmp_path / 'bag'} exists; nothing is overwritten: choose another folder or remove it"
    assert recorder.output == [f"error: {text}\n"]
    assert recorder.events == [{"event": "ended", "exit_code": ExitCode.REFUSED, "text": text}]


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("topicss:=[a]", "unknown parameter 'topicss' (did you mean 'topics'?)"),
        ("topics:=[a//b]", "parameter 'topics': 'a//b' is no topic name"),
    ],
)
def test_an_impossible_parameter_is_refused_before_anything_is_written(
    start: Start, tmp_path: Path, option: str, words: str
) -> None:
    recorder = record(start, tmp_path / "bag", extra=("-p", option))
    assert recorder.end() == 1
    assert words in recorder.output[-1]
    assert not (tmp_path / "bag").exists()


def test_two_types_on_a_topic_are_refused_with_both(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    # A node's topics are discovered in their order: with the last of both, all are there.
    other = start(sys.executable, "-c", PUPPET, "other", "arm")
    recorder = record(start, tmp_path / "bag", "joint_states", "robot_description", "last")
    recorder.expect("waiting for a publisher of /arm/last")
    other.do("wrong = node.create_publisher(String, 'joint_states', 10)")
    other.do("last = node.create_publisher(String, 'last', 10)")
    assert recorder.end() == 1
    assert recorder.output[-1] == (
        "error: /arm/joint_states has publishers of several types: "
        "sensor_msgs/msg/JointState, std_msgs/msg/String\n"
    )


@pytest.mark.parametrize(
    ("name", "pause"), [("j", 0.0002), pytest.param(5000 * "j", 0.001, marks=pytest.mark.slow)]
)
def test_a_full_disk_ends_the_recorder_with_one_line(
    start: Start, robot: Process, tmp_path: Path, name: str, pause: float
) -> None:
    recorder = record(start, tmp_path / "bag", "joint_states")
    recorder.expect("recording 1 topics")
    recorder.limit_files(200_000)
    robot.do(
        "wait_until(states.get_subscription_count)\n"
        "for number in range(3000):\n"
        f"    states.publish(JointState(name=[{name!r}], position=[float(number)]))\n"
        f"    time.sleep({pause})"
    )
    assert recorder.end() == 1
    assert "recording 1 topics" in recorder.output[-2]
    assert recorder.output[-1].startswith(f"error: cannot write {tmp_path}/bag/bag_0.mcap")
    numbers = [message.message.position[0] for message in Bag(tmp_path / "bag").messages()]
    assert 0 < len(numbers) == numbers[-1] + 1


def test_the_configuration_that_is_shipped_is_valid(
    start: Start, robot: Process, tmp_path: Path
) -> None:
    path = ROOT / "config/bag_recorder.yaml"
    settings = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
    assert settings.keys() == {"output", "include_hidden", "depth"}
    options = ["--params-file", path, "-p", f"output:={tmp_path}/bag"]
    recorder = start(*RECORDER, "--ros-args", *options)
    recorder.expect("recording /arm/joint_states")
    assert recorder.stop() == 0
    assert (tmp_path / "bag/metadata.yaml").exists()
