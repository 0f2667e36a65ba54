"""The node fault_injector through real DDS: what it gives on, and what it says of its faults."""

from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from in_process import Running, World, run_to_its_end
from ros_processes import ROOT
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory

ALWAYS = "at: 0.0, for: .inf"
TYPES = {"wrench": WrenchStamped, "reference": MultiDOFJointTrajectory}


def state(k: int) -> JointState:
    msg = JointState(name=["a", "b"], position=[0.1 * k, 1.0], velocity=[2.0, 3.0])
    msg.header.stamp.sec = 10 + k
    return msg


class Between:
    """A fault injector, and a node of the test at both of its ends."""

    def __init__(self, world: World, *faults: str, **parameters: Any) -> None:
        self.world = world
        given = parameters | ({"faults": list(faults)} if faults else {})
        self.process: Running = world.start("fault_injector", given)
        self._outs: dict[str, list[Any]] = {}
        self._publishers: dict[str, Any] = {}

    def join(self, topic: str) -> None:
        """Listen to what is given on of a topic, and wait until that is taken."""
        kind = TYPES.get(topic, JointState)
        self._publishers[topic] = self.world.peer.publisher(kind, topic)
        self._outs[topic] = self.world.peer.listen(kind, f"faulty/{topic}")
        taken = self._publishers[topic].get_subscription_count
        self.world.until(taken, f"a subscription of {topic}")

    def send(self, topic: str, msg: Any) -> None:
        self._publishers[topic].publish(msg)

    def got(self, topic: str, count: int) -> list[Any]:
        """Return what was given on, once there are so many."""
        out = self._outs[topic]
        self.world.until(lambda: len(out) >= count, f"{count} messages of faulty/{topic}")
        return out


def test_without_a_fault_all_topics_go_through_as_they_came(world):
    between = Between(world)
    force = Wrench(force=Vector3(x=1.0, y=2.0, z=3.0))
    given = {
        "joint_states": state(1),
        "wrench": WrenchStamped(wrench=force),
        "reference": MultiDOFJointTrajectory(joint_names=["tool0"]),
        "joint_reference": state(2),
        "joint_effort": state(3),
    }
    for topic, msg in given.items():
        between.join(topic)
        between.send(topic, msg)
        assert between.got(topic, 1) == [msg]


def test_a_topic_is_not_taken_before_somebody_listens_to_what_is_given_on(world):
    between = Between(world)
    between.join("joint_states")
    sender = world.peer.publisher(MultiDOFJointTrajectory, "reference")
    between.send("joint_states", state(1))  # what follows goes through: it is at work
    between.got("joint_states", 1)
    assert sender.get_subscription_count() == 0
    world.peer.listen(MultiDOFJointTrajectory, "faulty/reference")
    world.until(sender.get_subscription_count, "a subscription of reference")


def test_time_begins_with_the_first_message_of_the_topic_that_is_named(world):
    jump = "{fault: clock_jump, topic: joint_states, at: 0.0, by: 100.5}"
    between = Between(world, jump, start_on="reference")
    between.join("joint_states")
    between.join("reference")
    between.send("joint_states", state(1))
    assert between.got("joint_states", 1) == [state(1)]
    assert "the time of the faults begins" not in between.process.log
    between.send("reference", MultiDOFJointTrajectory())
    between.got("reference", 1)
    between.send("joint_states", state(2))
    late = between.got("joint_states", 2)[1]
    assert (late.header.stamp.sec, late.header.stamp.nanosec) == (112, 500_000_000)
    assert late.position == state(2).position
    world.until_said(between.process, "the time of the faults begins")


def test_faults_are_done_to_their_topic_and_not_to_others(world):
    between = Between(
        world,
        f"{{fault: duplicate, topic: joint_effort, {ALWAYS}, copies: 2}}",
        f"{{fault: nan, topic: joint_states, {ALWAYS}, field: velocity, value: inf}}",
    )
    for topic in ("joint_effort", "joint_states", "joint_reference"):
        between.join(topic)
    between.send("joint_effort", state(1))
    assert between.got("joint_effort", 3) == [state(1)] * 3
    between.send("joint_effort", state(1))
    name = "joint_effort at which a fault was at work"
    assert world.peer.counter("fault_injector", name, 2) == 2
    between.send("joint_states", state(2))
    (msg,) = between.got("joint_states", 1)
    assert sorted(msg.velocity)[1] == float("inf")
    assert msg.position == state(2).position
    between.send("joint_reference", state(3))
    assert between.got("joint_reference", 1) == [state(3)]


def test_what_was_held_is_given_on_though_nothing_follows(world):
    between = Between(world, f"{{fault: delay, topic: wrench, {ALWAYS}, by: 0.2}}")
    between.join("wrench")
    msg = WrenchStamped(wrench=Wrench(force=Vector3(x=1.0)))
    between.send("wrench", msg)
    assert between.got("wrench", 1) == [msg]


def test_what_is_random_is_that_of_the_seed(tmp_path):
    noise = f"{{fault: noise, topic: joint_states, {ALWAYS}, std: 1.0}}"

    def heard(seed: int, folder: str) -> list[Any]:
        with World(tmp_path / folder) as world:
            between = Between(world, noise, seed=seed)
            between.join("joint_states")
            between.send("joint_states", state(1))
            return [list(msg.position) for msg in between.got("joint_states", 1)]

    first = heard(1, "first")
    assert heard(1, "again") == first
    assert heard(2, "other") != first
    assert first != [list(state(1).position)]


def test_each_fault_that_begins_and_ends_is_said_in_the_log_and_on_diagnostics(world):
    drop = "{fault: drop, topic: wrench, at: 0.0, for: 0.5}"
    between = Between(world, drop, start_on="reference")
    between.join("reference")
    status = world.peer.status("fault_injector")
    assert (status.level, status.message) == (b"\x00", "1 faults to come")
    between.send("reference", MultiDOFJointTrajectory())
    status = world.peer.status("fault_injector", lambda found: found.level == b"\x01")
    assert status.message == "at work: drop on wrench"
    status = world.peer.status("fault_injector", lambda found: found.level == b"\x00")
    assert status.message == "no fault at work, 0 to come"
    told = "{fault: drop, topic: wrench, at: 0.0, for: 0.5, probability: 1.0}"
    world.until_said(between.process, f"ends: {told}")
    log = between.process.log
    assert log.count(f"begins: {told}") == log.count(f"ends: {told}") == 1


def test_a_second_publisher_is_a_node_of_its_own_that_comes_and_goes(world, monkeypatch):
    monkeypatch.setattr(rclpy, "create_node", world.create_node)
    second = "{fault: second_publisher, topic: joint_states, at: 0.0, for: 2.0, offset: 0.25}"
    between = Between(world, second, start_on="joint_states")
    between.join("joint_states")
    between.send("joint_states", state(1))
    other = between.got("joint_states", 2)[1]
    assert list(other.position) == [0.35, 1.25]
    assert list(other.velocity) == [2.25, 3.25]

    def publishers() -> set[str]:
        found = world.peer.node.get_publishers_info_by_topic("faulty/joint_states")
        return {info.node_name for info in found}

    world.until(lambda: publishers() == {"fault_injector", "intruder"}, "a second publisher")
    world.until(lambda: publishers() == {"fault_injector"}, "its end")
    assert between.process.stop() == 0


MISSPELT = "{fault: drop, topic: joint_state, at: 1, for: 1}"
JUMP = "{fault: clock_jump, topic: robot, at: 1, by: 1.0}"


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"faults": [MISSPELT]}, "parameter 'faults': '{fault: drop, topic: joint_state,"),
        ({"faults": [MISSPELT]}, "(did you mean 'joint_states'?)"),
        ({"faults": ["{fault: kill, node: clik, at: 1}"]}, "by the experiment that has started"),
        ({"faults": ["{fault: drop, topic"]}, "no YAML"),
        ({"topics": ["reference"], "faults": [JUMP]}, "none of joint_states, wrench is among 'top"),
        ({"topics": ["wrench"], "start_on": "reference"}, "start_on"),
    ],
)
def test_what_cannot_be_is_refused_at_the_start(tmp_path, parameters, words):
    process = run_to_its_end("fault_injector", tmp_path, parameters)
    assert process.exit_code == 1
    (line,) = process.stderr.splitlines()
    assert words in line
    assert "Traceback" not in process.stderr


def test_the_parameters_that_come_with_the_package_are_possible(world):
    process = world.start("fault_injector", files=(ROOT / "config/fault_injector.yaml",))
    world.until_said(process, "3 faults to come")
    assert process.stop() == 0
    assert "error" not in process.log.lower()
