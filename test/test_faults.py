"""Faults on purpose: what goes in, what comes out, exactly; the same for the same seed."""

import copy
import math
import re
import types
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from geometry_msgs.msg import Quaternion, Transform, Twist, Vector3, Wrench, WrenchStamped
from in_process import Running, World
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.lab.faults.base import Fault, MessageFault, parse_fault, parse_faults
from eulerparams_control.lab.faults.fields import numbers
from eulerparams_control.lab.faults.kinds import Kill, SecondPublisher, random_faults
from eulerparams_control.lab.faults.stream import FaultStream
from eulerparams_control.parameters.schemes import schemes

SECOND = 1_000_000_000
# A sum of two times of order 1.
ROUNDING = 1e-15
# Of 2000 messages hit with probability 0.3: six standard deviations of their number.
SIX_SIGMA = 6 * math.sqrt(2000 * 0.3 * 0.7)


def state(k: int, sec: int = 10) -> JointState:
    """Return the k-th state of two joints, stamped k ms after ``sec``."""
    msg = JointState(name=["a", "b"], position=[0.1 * k, 1.0], velocity=[2.0, 3.0])
    msg.header.stamp.sec, msg.header.stamp.nanosec = sec, k * 1_000_000
    return msg


def stamp(msg: Any) -> int:
    return int(msg.header.stamp.sec * SECOND + msg.header.stamp.nanosec)


def number(msg: JointState) -> int:
    return round((stamp(msg) % SECOND) / 1_000_000)


def reference() -> MultiDOFJointTrajectory:
    transform = Transform(
        translation=Vector3(x=1.0, y=2.0, z=3.0), rotation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    )
    point = MultiDOFJointTrajectoryPoint(transforms=[transform], velocities=[Twist()])
    return MultiDOFJointTrajectory(joint_names=["tool0"], points=[point])


def stream(*texts: str, seed: int = 1) -> FaultStream:
    return FaultStream([parse_fault(yaml.safe_load(text)) for text in texts], seed)


def on_states(content: str) -> FaultStream:
    return stream(f"{{topic: joint_states, {content}}}")


def passed(found: FaultStream, times: list[float], topic: str = "joint_states") -> list[Any]:
    """Return what comes out, one list a time, as the k-th state goes in at the k-th time."""
    return [
        [msg for _, msg in found.due(t)] + found.on_message(t, topic, state(k))
        for k, t in enumerate(times)
    ]


def which(groups: list[Any]) -> list[list[int]]:
    return [[number(msg) for msg in group] for group in groups]


# --- each kind --------------------------------------------------------------------------------
def test_where_no_fault_is_at_work_a_message_goes_through_as_it_is():
    found = stream("{fault: drop, topic: joint_states, at: 1, for: 1}")
    msg = state(0)
    assert found.on_message(0.999, "joint_states", msg)[0] is msg
    assert found.on_message(1.5, "wrench", msg)[0] is msg
    assert found.on_message(2.0, "joint_states", msg)[0] is msg
    assert not found.touches(0.999, "joint_states")
    assert found.touches(1.0, "joint_states")


@pytest.mark.parametrize(
    ("content", "times", "expected"),
    [
        ("fault: drop, at: 1, for: 0.2", [0.9, 1.0, 1.1, 1.2, 1.3], [[0], [], [], [3], [4]]),
        (
            "fault: delay, at: 1, for: 0.3, by: 0.25",
            [0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6],
            [[0], [], [], [], [1], [2], [3, 4, 5, 6], [7]],  # in order, at last in a burst
        ),
        ("fault: stuck, at: 0.5, for: 1", [0.0, 0.6, 0.7, 0.8, 1.5], [[0], [1], [1], [1], [4]]),
        ("fault: nan, at: 0, for: 1, field: effort", [0.5], [[0]]),  # it is empty
    ],
)
def test_messages_come_whole_when_they_should(content, times, expected):
    found = passed(on_states(content), times)
    assert found == [[state(k) for k in group] for group in expected]


def test_a_probability_hits_that_part_of_the_messages():
    found = stream("{fault: drop, topic: joint_states, at: 0, for: 100, probability: 0.3}")
    lost = sum(not found.on_message(0.01 * k, "joint_states", state(1)) for k in range(2000))
    assert abs(lost - 600) < SIX_SIGMA


def test_what_a_delay_holds_is_due_when_no_message_follows():
    found = stream("{fault: delay, topic: joint_states, at: 0, for: 1, by: 0.5}")
    assert found.next_due == math.inf
    assert found.on_message(0.2, "joint_states", state(7)) == []
    assert found.next_due == pytest.approx(0.7, abs=ROUNDING)
    assert found.due(0.69) == []
    ((topic, msg),) = found.due(0.7)
    assert topic == "joint_states"
    assert number(msg) == 7
    assert found.next_due == math.inf
    assert found.due(0.8) == []


def test_a_duplicate_comes_at_once_as_often_as_told():
    found = stream("{fault: duplicate, topic: joint_states, at: 0, for: 1, copies: 2}")
    (first, second, third), (late,) = passed(found, [0.5, 1.0])
    assert first == second == third == state(0)
    assert first is not second
    assert first.position is not second.position
    assert late == state(1)


def test_a_reorder_gives_each_group_in_another_order_and_loses_none():
    found = stream("{fault: reorder, topic: joint_states, at: 0, for: 1, depth: 3}")
    groups = which(passed(found, [0.01 * k for k in range(90)]))
    for k in range(0, 90, 3):
        assert groups[k] == groups[k + 1] == []
        assert sorted(groups[k + 2]) == [k, k + 1, k + 2]
        assert groups[k + 2] != [k, k + 1, k + 2]


def test_what_a_reorder_holds_at_its_end_comes_before_what_follows():
    content = "fault: reorder, at: 0, for: 0.35, depth: 10"
    found = on_states(content)
    groups = which([found.on_message(0.1 * k, "joint_states", state(k)) for k in range(6)])
    assert groups[:4] == [[], [], [], []]
    *held, last = groups[4]
    assert sorted(held) == [0, 1, 2, 3]
    assert (last, groups[5]) == (4, [5])
    found = on_states(content)
    passed(found, [0.1, 0.2])
    assert found.next_due == 0.35  # if nothing follows
    assert found.due(0.34) == []
    assert [number(msg) for _, msg in found.due(0.35)] == [1, 0]


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_a_nan_puts_its_value_in_one_number_of_its_field(value):
    found = on_states(f"fault: nan, at: 0, for: 1, field: velocity, value: {value}")
    hit = set()
    for k in range(40):
        (msg,) = found.on_message(0.01 * k, "joint_states", state(k))
        (bad,) = [n for n in numbers(msg) if not math.isfinite(n.value)]
        np.testing.assert_equal(bad.value, float(value))
        hit.add(bad.path)
        assert msg.position == state(k).position
    assert hit == {"velocity[0]", "velocity[1]"}


def test_a_nan_may_be_in_any_number_and_of_any_kind():
    found = stream("{fault: nan, topic: wrench, at: 0, for: 1, value: random}")
    hit = set()
    for k in range(300):
        (msg,) = found.on_message(0.001 * k, "wrench", WrenchStamped())
        (bad,) = [n for n in numbers(msg) if not math.isfinite(n.value)]
        hit.add((bad.path, str(bad.value)))
    paths = {f"wrench.{part}.{axis}" for part in ("force", "torque") for axis in "xyz"}
    assert hit == {(path, value) for path in paths for value in ("nan", "inf", "-inf")}


def test_under_a_freeze_the_values_repeat_and_the_stamps_go_on():
    found = stream("{fault: freeze, topic: joint_states, at: 0.5, for: 1}")
    out = [msg for group in passed(found, [0.0, 0.6, 0.7, 0.8, 1.5]) for msg in group]
    assert [number(msg) for msg in out] == [0, 1, 2, 3, 4]
    assert [list(msg.position) for msg in out] == [list(state(k).position) for k in (0, 1, 1, 1, 4)]


def test_noise_is_on_the_numbers_of_its_field_with_its_standard_deviation():
    found = on_states("fault: noise, at: 0, for: 100, std: 0.5, field: position")
    off = []
    for _ in range(2000):
        (msg,) = found.on_message(1.0, "joint_states", state(0))
        assert msg.velocity == state(0).velocity
        off += [x - y for x, y in zip(msg.position, state(0).position, strict=True)]
    assert abs(np.mean(off)) < 6 * 0.5 / math.sqrt(len(off))
    assert abs(np.std(off) - 0.5) < 6 * 0.5 / math.sqrt(2 * len(off))


@pytest.mark.parametrize(
    ("content", "times", "jumps"),
    [
        ("at: 1, by: -0.0015", [0.9, 1.0, 1000.0], [0, -1_500_000, -1_500_000]),
        ("at: 1, for: 1, by: 3.25", [0.9, 1.0, 2.0], [0, 3_250_000_000, 0]),
        ("at: 0, by: -12.75", [0.0], [-12_750_000_000]),  # to before the beginning of time
    ],
)
def test_a_clock_jump_moves_the_stamps_for_its_time_or_for_ever(content, times, jumps):
    found = on_states(f"fault: clock_jump, {content}")
    out = [msg for group in passed(found, times) for msg in group]
    assert [stamp(msg) - stamp(state(k)) for k, msg in enumerate(out)] == jumps
    assert all(0 <= msg.header.stamp.nanosec < SECOND for msg in out)
    assert found.faults[0].end == (2.0 if "for" in content else found.faults[0].at)


def test_topics_of_one_fault_are_hit_each_by_itself():
    found = stream("{fault: clock_jump, topic: robot, at: 0, by: 1.0, probability: 0.5}")
    hits = {
        topic: [stamp(found.on_message(0.01 * k, topic, state(0))[0]) for k in range(40)]
        for topic in ("joint_states", "wrench")
    }
    assert hits["joint_states"] != hits["wrench"]


def test_the_clock_of_the_robot_jumps_on_all_that_it_sends_and_nothing_else():
    found = stream("{fault: clock_jump, topic: robot, at: 0, by: 2.0}")
    for topic, jump in (("joint_states", 2), ("wrench", 2), ("reference", 0), ("joint_effort", 0)):
        (msg,) = found.on_message(0.5, topic, state(3))
        assert stamp(msg) - stamp(state(3)) == jump * SECOND


def test_a_second_publisher_sends_what_is_beside_the_true_message_but_for_rotations():
    (found,) = stream(
        "{fault: second_publisher, topic: reference, at: 0, for: 1, offset: 0.25}"
    ).faults
    assert isinstance(found, SecondPublisher)
    true = reference()
    other = found.message(true)
    moved = other.points[0].transforms[0].translation
    assert (moved.x, moved.y, moved.z) == (1.25, 2.25, 3.25)
    assert other.points[0].transforms[0].rotation == true.points[0].transforms[0].rotation
    assert other.points[0].velocities[0].linear.x == 0.25
    assert true == reference()


# --- together ---------------------------------------------------------------------------------
def test_faults_on_a_topic_are_at_work_one_after_the_other():
    found = stream(
        "{fault: delay, topic: joint_states, at: 0, for: 1, by: 0.2}",
        "{fault: clock_jump, topic: joint_states, at: 0, by: 1.0}",
        "{fault: duplicate, topic: joint_states, at: 0, for: 1}",
    )
    assert found.on_message(0.1, "joint_states", state(0)) == []
    late = [msg for _, msg in found.due(0.35)]
    assert late == [state(0, sec=11), state(0, sec=11)]


@pytest.mark.parametrize("kind", sorted(Fault.registry.keys() - {"kill", "second_publisher"}))
def test_no_message_is_changed_or_shared_with_what_comes_out(kind):
    options = {"nan": "value: inf", "delay": "by: 0.1", "clock_jump": "by: 1.0", "noise": "std: 1"}
    found = on_states(f"fault: {kind}, at: 0, for: 1, {options.get(kind, '')}")
    given = [state(k) for k in range(4)]
    out = [
        m for k, g in enumerate(given) for m in found.on_message(0.1 + 0.2 * k, "joint_states", g)
    ]
    out += [msg for _, msg in found.due(10.0)]
    assert given == [state(k) for k in range(4)]
    kept = copy.deepcopy(out)
    for msg in given:
        msg.position[0] = -1.0
        msg.header.stamp.sec = -1
    assert out == kept
    assert len({id(msg) for msg in out}) == len({id(msg.position) for msg in out}) == len(out)


def test_a_message_may_be_of_any_class_with_numbers():
    stamp = SimpleNamespace(sec=1, nanosec=0)
    msg = SimpleNamespace(header=SimpleNamespace(stamp=stamp), data=[1.0, 2.0], size=2)
    found = stream("{fault: nan, topic: wrench, at: 0, for: 1, field: data}")
    (out,) = found.on_message(0.0, "wrench", msg)
    assert sum(map(math.isnan, out.data)) == 1
    assert out.size == 2
    assert [n.path for n in numbers(msg)] == ["data[0]", "data[1]"]


def test_a_field_is_a_whole_name():
    msg = SimpleNamespace(force=1.0, force_sensor=SimpleNamespace(x=2.0))
    assert [n.path for n in numbers(msg, "force")] == ["force"]
    assert [n.path for n in numbers(msg, "force_sensor")] == ["force_sensor.x"]
    paths = [n.path for n in numbers(reference(), "points[0].transforms[0].translation")]
    assert paths == [f"points[0].transforms[0].translation.{axis}" for axis in "xyz"]


ALL = (
    "{fault: drop, topic: joint_states, at: 0.1, for: 0.4, probability: 0.5}",
    "{fault: reorder, topic: joint_states, at: 0.2, for: 0.5, depth: 4}",
    "{fault: nan, topic: joint_states, at: 0.3, for: 0.5, probability: 0.5, value: random}",
    "{fault: noise, topic: joint_states, at: 0, for: 1, std: 0.1}",
    "{fault: delay, topic: joint_states, at: 0.5, for: 0.3, by: 0.013, probability: 0.5}",
)


def said(seed: int, *texts: str) -> list[list[str]]:
    found = stream(*texts, seed=seed)
    return [[repr(msg) for msg in group] for group in passed(found, [0.01 * k for k in range(100)])]


def test_the_same_seed_gives_the_same_to_the_bit_and_another_does_not():
    assert said(1, *ALL) == said(1, *ALL)
    assert said(1, *ALL) != said(2, *ALL)


def test_what_is_random_on_one_topic_does_not_depend_on_another():
    def heard(others: bool) -> list[str]:
        found = stream("{fault: noise, topic: joint_states, at: 0, for: 9, std: 1}",
                       "{fault: noise, topic: wrench, at: 0, for: 9, std: 1}")  # fmt: skip
        out = []
        for k in range(10):
            if others:
                found.on_message(0.1 * k, "wrench", WrenchStamped(wrench=Wrench()))
            out += found.on_message(0.1 * k, "joint_states", state(k))
        return [repr(msg) for msg in out]

    assert heard(True) == heard(False)


# --- what a fault may say ---------------------------------------------------------------------
GOOD = {"fault": "drop", "topic": "wrench", "at": 1.0, "for": 0.3}


def changed(**changes: Any) -> dict[str, Any]:
    content = GOOD | {key.rstrip("_"): value for key, value in changes.items()}
    return {key: value for key, value in content.items() if value is not None}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("drop", "a fault needs the key 'fault', one of clock_jump, delay, drop, duplicate, freez"),
        (changed(fault="dorp"), "unknown fault 'dorp' (did you mean 'drop'?); known: clock_jump, "),
        (changed(topic="joint_state"), "(did you mean 'joint_states'?); known: joint_effort, "),
        (changed(topic="robot"), "unknown topic of the fault 'drop' 'robot'"),
        (changed(topic=3), "drop.topic is 3; expected a name"),
        (changed(topic=None), "drop.topic is missing; the fault 'drop' needs it"),
        (changed(at=-0.1), "is -0.1; expected a finite number from 0 to 1e+06, when it begins"),
        (changed(at=math.nan), "at is nan; expected a finite number"),
        (changed(at=True), "at is True; expected a finite number"),
        (changed(for_=-1), "for is -1; expected a finite number of 0 or more"),
        (changed(probability=1.1), "probability is 1.1; expected a finite number from 0 to 1"),
        (changed(propability=1), "'drop.propability' (did you mean 'drop.probability'?)"),
        (changed(fault="delay", by=-1), "is -1; expected a finite number from 0 to 60, how late"),
        (changed(fault="reorder", depth=1), "depth is 1; expected a whole number from 2 to 100"),
        (changed(fault="reorder", depth=2.5), "depth is 2.5; expected a whole number"),
        (changed(fault="duplicate", copies=0), "copies is 0; expected a whole number from 1"),
        (changed(fault="nan", value="zero"), "unknown value of nan.value: 'zero'"),
        (changed(fault="kill"), "unknown key of the fault 'kill' "),
        ({"fault": "kill", "at": 1.0}, "kill.node is missing; the fault 'kill' needs it"),
        ({"fault": "kill", "at": 1.0, "node": 3}, "node is 3; expected a name"),
        (changed(fault="second_publisher", rate=0), "rate is 0; expected a finite number from 0.1"),
    ],
)
def test_a_fault_that_means_nothing_is_refused_with_the_reason(content, words):
    with pytest.raises(ConfigurationError, match=re.escape(words)):
        parse_fault(content)


def test_a_kind_that_changes_no_message_is_refused_where_it_is_defined():
    with pytest.raises(TypeError, match="Idle changes no message: it needs a change"):
        types.new_class("Idle", (MessageFault,), {"name": "idle"})
    assert "idle" not in Fault.registry


def test_of_several_faults_the_wrong_one_is_named():
    with pytest.raises(ConfigurationError, match=r"here: entry 2: unknown fault 'dorp'"):
        parse_faults("here", [GOOD, changed(fault="dorp")])
    with pytest.raises(ConfigurationError, match=r"here: expected a list"):
        parse_faults("here", GOOD)
    assert [found.name for found in parse_faults("here", [GOOD, GOOD])] == ["drop", "drop"]


# --- random sequences -------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", schemes().values(), ids=lambda scheme: scheme.name)
def test_random_faults_are_of_all_kinds_on_all_topics_over_in_time_and_can_be_written(scheme):
    found = [random_faults(seed, scheme.name, 4.0) for seed in range(300)]
    for faults in found:
        assert 1 <= len(faults) <= 4
        assert list(faults) == sorted(faults, key=lambda one: one.at)
    every = [one for faults in found for one in faults]
    for one in every:
        assert one.at >= 0.4
        assert one.end <= 2.4
        assert parse_fault(yaml.safe_load(str(one))) == one
        if not isinstance(one, Kill) and math.isfinite(one.duration):
            assert 0.01 <= one.duration <= 0.5
    assert {one.name for one in every} == set(Fault.registry)
    assert {one.topic for one in every} - {"", "robot"} == set(scheme.topics)
    assert {one.node for one in every if isinstance(one, Kill)} == {scheme.name}


def test_random_faults_are_the_same_for_the_same_seed_only():
    found = [random_faults(seed, "clik", 4.0) for seed in range(50)]
    assert found == [random_faults(seed, "clik", 4.0) for seed in range(50)]
    assert len(set(map(str, found))) == 50
    with pytest.raises(UnknownNameError, match=r"unknown controller 'clikk'.*did you mean 'clik'"):
        random_faults(0, "clikk", 4.0)


# --- the node, over DDS ----------------------------------------------------------------------
ALWAYS = "at: 0.0, for: .inf"
TYPES = {"wrench": WrenchStamped, "reference": MultiDOFJointTrajectory}


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
        """Return what was relayed, once there are ``count`` messages."""
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
    assert (late.header.stamp.sec, late.header.stamp.nanosec) == (110, 502_000_000)
    assert late.position == state(2).position
    world.until_said(between.process, "the time of the faults begins")


def test_faults_are_done_to_their_topic_and_not_to_others(world):
    between = Between(
        world,
        f"{{fault: duplicate, topic: joint_effort, {ALWAYS}, copies: 2}}",
        f"{{fault: nan, topic: joint_states, {ALWAYS}, field: velocity, value: inf}}",
        f"{{fault: delay, topic: wrench, {ALWAYS}, by: 0.2}}",
    )
    for topic in ("joint_effort", "joint_states", "joint_reference", "wrench"):
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
    held = WrenchStamped(wrench=Wrench(force=Vector3(x=1.0)))
    between.send("wrench", held)
    assert between.got("wrench", 1) == [held]  # though nothing follows


def test_what_is_random_is_that_of_the_seed(world):
    noise = f"{{fault: noise, topic: joint_states, {ALWAYS}, std: 1.0}}"
    between = Between(world, noise, seed=2)
    between.join("joint_states")
    between.send("joint_states", state(1))
    expected = stream(noise, seed=2).on_message(0.0, "joint_states", state(1))
    assert between.got("joint_states", 1) == expected


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
