"""Faults on purpose: what goes in, what comes out, exactly; the same for the same seed."""

import copy
import math
import re
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from in_process import World
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.fault_injector_node import TYPES
from eulerparams_control.lab.faults import RENAMED, FaultStream, parse_fault, parse_faults

SECOND = 1_000_000_000
# Of a mean and a standard deviation of n samples: six standard deviations, of 1 / sqrt(n) at most.
SIX_SIGMA = 6 / math.sqrt(2000)
# Of each fault on messages, where there is something to say besides its topic and times.
CHANGES = (
    *("fault: drop", "fault: drop, repeat: message", "fault: drop, repeat: values"),
    *("fault: delay, by: 0.25", "fault: delay, by: 0.1, jitter: 0.3", "fault: duplicate"),
    *("fault: duplicate, copies: 3", "fault: corrupt, value: random", "fault: corrupt, noise: 1.0"),
    "fault: corrupt, stamp_offset: -0.0015",
)


def state(k: int, stamp: int | None = None) -> JointState:
    """Return the k-th state of two joints, stamped 10 s and k ms, or as another one."""
    msg = JointState(name=["a", "b"], position=[0.1 * k, 1.0], velocity=[2.0, 3.0])
    msg.header.stamp.sec = 10
    msg.header.stamp.nanosec = (k if stamp is None else stamp) * 1_000_000
    return msg


def number(msg: JointState) -> int:
    return msg.header.stamp.nanosec // 1_000_000


def parsed(text: str) -> Any:
    return parse_fault(yaml.safe_load(text))


def stream(*changes: str, seed: int = 1) -> FaultStream:
    """Return faults from 1 to 2 s; each is read, written, and read again."""
    texts = [f"{{topic: joint_states, at: 1.0, for: 1.0, {change}}}" for change in changes]
    return FaultStream([parsed(str(parsed(text))) for text in texts], seed)


def passed(found: FaultStream, times: list[float]) -> list[Any]:
    """Return what comes out, one list a time, as the k-th state goes in at the k-th time."""
    return [found.on_message(t, "joint_states", state(k)) for k, t in enumerate(times)]


# --- what each kind does ----------------------------------------------------------------------
TIMES = [0.9, 1.0, 1.5, 1.75, 2.0, 2.25, 2.5]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("fault: drop", [[0], [], [], [], [4], [5], [6]]),
        ("fault: drop, repeat: message", [[0], [1], [1], [1], [4], [5], [6]]),
        ("fault: drop, repeat: values", [[0], [1], [(1, 2)], [(1, 3)], [4], [5], [6]]),
        ("fault: delay, by: 0.25", [[0], [], [1], [2], [3, 4], [5], [6]]),
        ("fault: delay, by: 0.5", [[0], [], [1], [], [2], [3, 4, 5], [6]]),  # a burst, in order
        ("fault: duplicate", [[0], [1, 1], [2, 2], [3, 3], [4], [5], [6]]),
        ("fault: duplicate, copies: 2", [[0], *([k] * 3 for k in (1, 2, 3)), [4], [5], [6]]),
        ("fault: duplicate, rate: 20.0", [[k] for k in range(7)]),  # another node sends it
        ("fault: corrupt, value: nan, field: effort", [[k] for k in range(7)]),  # it is empty
        ("fault: corrupt, value: nan, field: posit", [[k] for k in range(7)]),  # no whole name
    ],
)
def test_messages_come_whole_when_they_should(change, expected):
    found = passed(stream(change), TIMES)
    assert found == [[state(*np.atleast_1d(k).tolist()) for k in group] for group in expected]


def test_where_no_fault_is_at_work_a_message_goes_through_as_it_is():
    found, msg = stream("fault: drop"), state(0)
    for t, topic in ((0.999, "joint_states"), (1.5, "wrench"), (2.0, "joint_states")):
        assert not found.touches(t, topic)
        assert found.on_message(t, topic, msg)[0] is msg
    assert found.touches(1.0, "joint_states")


@pytest.mark.parametrize(("more", "end"), [("", 2.25), (", jitter: 0.5", 2.75)])
def test_a_delay_lasts_until_the_last_message_that_it_holds_has_come(more, end):
    fault = parsed(f"{{fault: delay, topic: wrench, at: 1.0, for: 1.0, by: 0.25{more}}}")
    found, last = FaultStream([fault]), math.nextafter(2.0, 0.0)
    assert found.on_message(last, "wrench", state(7)) == []
    assert not found.due(2.2)
    assert found.due(end) == [("wrench", state(7))]
    assert fault.end == end
    assert not found.touches(end, "wrench")


def test_with_jitter_messages_overtake_each_other_and_none_is_lost():
    times = [1.0 + 0.01 * k for k in range(100)]
    groups = passed(stream("fault: delay, by: 0.1, jitter: 0.05"), [*times, 3.0])
    came = {number(msg): t for group, t in zip(groups, [*times, 3.0], strict=True) for msg in group}
    assert sorted(came) == list(range(101))
    late = [came[k] - times[k] for k in range(80)]
    assert 0.1 <= min(late) < max(late) < 0.17  # it is looked at every 10 ms
    order = [number(msg) for group in groups[:-1] for msg in group]
    assert order != sorted(order)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "random"])
@pytest.mark.parametrize("field", ["", "wrench.force", "wrench.torque.y"])
def test_a_value_is_put_into_any_one_number_of_its_field(field, value):
    text = f"{{fault: corrupt, topic: wrench, at: 0, for: 1, field: {field!r}, value: {value}}}"
    found, hit = FaultStream([parsed(text)]), set()
    for _ in range(300):
        (msg,) = found.on_message(0.0, "wrench", WrenchStamped())
        parts = {f"wrench.{name}": getattr(msg.wrench, name) for name in ("force", "torque")}
        numbers = {f"{name}.{a}": getattr(part, a) for name, part in parts.items() for a in "xyz"}
        ((path, bad),) = [(path, x) for path, x in numbers.items() if not math.isfinite(x)]
        hit.add((path, str(bad)))
    values = ("nan", "inf", "-inf") if value == "random" else (value,)
    assert hit == {(path, v) for path in numbers for v in values if path.startswith(field)}


def test_noise_is_on_the_numbers_of_its_field_with_its_standard_deviation():
    found = stream("fault: corrupt, noise: 0.5, field: position")
    out = [found.on_message(1.0, "joint_states", state(0))[0] for _ in range(1000)]
    off = np.array([msg.position for msg in out]) - state(0).position
    assert abs(np.mean(off)) < 0.5 * SIX_SIGMA
    assert abs(np.std(off) - 0.5) < 0.5 * SIX_SIGMA
    assert all(msg.velocity == state(0).velocity for msg in out)


@pytest.mark.parametrize("offset", [-0.0015, 3.25, -12.75])  # the last: before 1970
def test_stamps_jump(offset):
    (msg,) = stream(f"fault: corrupt, stamp_offset: {offset}").on_message(
        1, "joint_states", state(3)
    )
    stamp, before = msg.header.stamp, state(3).header.stamp
    jump = (stamp.sec - before.sec) * SECOND + stamp.nanosec - before.nanosec
    assert jump == offset * SECOND
    assert (msg.position, msg.velocity) == (state(3).position, state(3).velocity)


# --- what all kinds have in common ------------------------------------------------------------
def test_faults_on_a_topic_are_at_work_one_after_the_other():
    found = stream("fault: delay, by: 0.2", "fault: corrupt, stamp_offset: 0.1", "fault: duplicate")
    assert found.on_message(1.1, "joint_states", state(0)) == []
    late = [msg for _, msg in found.due(1.35)]
    assert late == [state(0, stamp=100)] * 2


def test_what_one_fault_holds_comes_before_what_another_one_before_it_holds():
    found = stream("fault: delay, by: 0.5", "fault: delay, by: 0.25")
    assert passed(found, [1.0, 1.5, 1.7]) == [[], [], []]
    assert [msg for _, msg in found.due(2.5)] == [state(0), state(1), state(2)]


@pytest.mark.parametrize("change", CHANGES)
def test_a_probability_hits_that_part_of_the_messages(change):
    found, hit = stream(f"{change}, for: .inf, probability: 0.3"), 0
    for k in range(2000):
        msg = state(k % 1000)
        found.due(1.0 + k)
        hit += found.on_message(1.0 + k, "joint_states", msg) != [msg]
    assert abs(hit / 2000 - 0.3) < SIX_SIGMA * math.sqrt(0.3 * 0.7)


@pytest.mark.parametrize("change", CHANGES)
def test_no_message_is_changed_or_shared_with_what_comes_out(change):
    given = [state(k) for k in range(4)]
    found = stream(change)
    out = [m for k, g in enumerate(given) for m in found.on_message(1 + 0.2 * k, "joint_states", g)]
    out += [msg for _, msg in found.due(10.0)]
    assert given == [state(k) for k in range(4)]
    kept = copy.deepcopy(out)
    for msg in given:
        msg.position[0], msg.header.stamp.sec = -1.0, -1
    assert out == kept
    assert len({id(msg) for msg in out}) == len({id(msg.position) for msg in out}) == len(out)


@pytest.mark.parametrize("change", CHANGES)
def test_the_same_seed_gives_the_same_to_the_bit_and_another_does_not(change):
    def out(seed: int, *before: str) -> str:
        found = stream(*before, f"{change}, probability: 0.5", seed=seed)
        return repr(passed(found, [1.0 + 0.01 * k for k in range(100)]))

    assert out(1) == out(1)
    assert out(1) != out(2)


# --- what is refused --------------------------------------------------------------------------
GOOD = {"fault": "drop", "topic": "wrench", "at": 1.0, "for": 0.3}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fault": "dorp"}, "unknown fault 'dorp' (did you mean 'drop'?); known: corrupt, delay, "),
        ({"topic": "joint_state"}, "unknown value of drop.topic: 'joint_state' (did you mean "),
        ({"topic": None}, "drop.topic is missing; the fault 'drop' needs it"),
        ({"at": -0.1}, "is -0.1; expected a finite number from 0 to 1e+06, when it begins"),
        ({"at": True}, "at is True; expected a finite number"),
        ({"for": -1}, "for is -1; expected a finite number of 0 or more"),
        ({"probability": 1.1}, "probability is 1.1; expected a finite number from 0 to 1"),
        ({"propability": 1}, "'drop.propability' (did you mean 'drop.probability'?)"),
        ({"repeat": "values_"}, "unknown value of drop.repeat: 'values_' (did you mean 'values'?)"),
        ({"fault": "delay", "by": -1}, "is -1; expected a finite number from 0 to 60, how late"),
        ({"fault": "duplicate", "copies": 0}, "copies is 0; expected a whole number from 1"),
        ({"fault": "corrupt", "value": "zero"}, "unknown value of corrupt.value: 'zero'"),
        ({"fault": "corrupt", "field": 3, "noise": 1}, "corrupt.field is 3; expected a name"),
        ({"fault": "corrupt"}, "it changes nothing; expected value, noise or stamp_offset"),
        ({"fault": "kill"}, "unknown key of the fault 'kill' "),
        *(({"fault": name}, f"the fault '{name}' is now written '") for name in RENAMED),
    ],
)
def test_a_fault_that_means_nothing_is_refused_with_the_reason(changes, words):
    content = {key: value for key, value in (GOOD | changes).items() if value is not None}
    with pytest.raises(ConfigurationError, match=f"here: entry 2: .*{re.escape(words)}"):
        parse_faults("here", [GOOD, content])


def test_what_is_no_fault_or_no_list_of_them_is_refused():
    with pytest.raises(ConfigurationError, match="needs the key 'fault', one of drop, delay, dup"):
        parse_fault("drop")
    with pytest.raises(ConfigurationError, match="here: expected a list"):
        parse_faults("here", GOOD)


# --- the node, over DDS -----------------------------------------------------------------------
class Between:
    """A fault injector, and a node of the test at both of its ends."""

    def __init__(self, world: World, *faults: str, **parameters: Any) -> None:
        self.world, self._outs, self._publishers = world, {}, {}
        given = parameters | ({"faults": list(faults)} if faults else {})
        self.process = world.start("fault_injector", given)

    def join(self, *topics: str) -> None:
        """Listen to what is given on of topics, and wait until these are taken."""
        for topic in topics:
            self._publishers[topic] = self.world.peer.publisher(TYPES[topic], topic)
            self._outs[topic] = self.world.peer.listen(TYPES[topic], f"faulty/{topic}")
            taken = self._publishers[topic].get_subscription_count
            self.world.until(taken, f"a subscription of {topic}")

    def relayed(self, topic: str, msg: Any, count: int = 1) -> list[Any]:
        """Send a message; return what is relayed, once there is so much."""
        before = len(self._outs[topic])
        self._publishers[topic].publish(msg)
        more = f"{count} messages of faulty/{topic}"
        self.world.until(lambda: len(self._outs[topic]) >= before + count, more)
        return self._outs[topic][before:]


def test_without_a_fault_all_topics_go_through_as_they_came_once_somebody_listens(world):
    between = Between(world)
    for topic, kind in TYPES.items():
        early = world.peer.publisher(kind, topic)
        world.peer.status("fault_injector")
        assert early.get_subscription_count() == 0
        msg = kind() if topic == "reference" else kind(header=state(3).header)
        between.join(topic)
        assert between.relayed(topic, msg) == [msg]


def test_faults_are_done_to_their_topic_from_the_first_message_of_another_on(world):
    always = "at: 0.0, for: .inf"
    noise = f"{{fault: corrupt, topic: joint_states, {always}, noise: 1.0}}"
    between = Between(
        world,
        noise,
        f"{{fault: duplicate, topic: joint_effort, {always}, copies: 2}}",
        f"{{fault: delay, topic: wrench, {always}, by: 0.2}}",
        start_on="reference",
        seed=2,
    )
    between.join("joint_states", "joint_effort", "wrench", "joint_reference", "reference")
    assert between.relayed("joint_states", state(1)) == [state(1)]
    assert "the time of the faults begins" not in between.process.log
    between.relayed("reference", MultiDOFJointTrajectory())
    expected = FaultStream([parsed(noise)], 2).on_message(0.0, "joint_states", state(1))
    assert between.relayed("joint_states", state(1)) == expected
    assert between.relayed("joint_effort", state(2), 3) == [state(2)] * 3
    assert between.relayed("joint_reference", state(3)) == [state(3)]
    held = WrenchStamped(wrench=Wrench(force=Vector3(x=1.0)))
    assert between.relayed("wrench", held) == [held]  # though nothing follows
    name = "joint_effort at which a fault was at work"
    assert world.peer.counter("fault_injector", name, 1) == 1


def test_each_fault_that_begins_and_ends_is_said_in_the_log_and_on_diagnostics(world):
    late = "{fault: delay, topic: wrench, at: 0.0, for: 0.5, by: 0.75}"
    between = Between(world, late, start_on="reference")
    between.join("reference")
    assert world.peer.status("fault_injector").message == "1 faults to come"
    began = world.now
    between.relayed("reference", MultiDOFJointTrajectory())
    status = world.peer.status("fault_injector", lambda found: found.level == b"\x01")
    assert status.message == "at work: delay on wrench"
    status = world.peer.status("fault_injector", lambda found: found.level == b"\x00")
    assert status.message == "no fault at work, 0 to come"
    assert world.now - began >= 1.25  # when the last message that it held has come
    world.until_said(between.process, f"ends: {parsed(late)}")
    assert between.process.log.count(f"begins: {parsed(late)}") == 1


def test_a_second_publisher_is_a_node_of_its_own_that_comes_and_goes(world, monkeypatch):
    monkeypatch.setattr(rclpy, "create_node", world.create_node)
    twice = "{fault: duplicate, topic: joint_states, at: 0.0, for: 2.0, rate: 20.0}"
    between = Between(world, twice, start_on="joint_states")
    between.join("joint_states")
    assert between.relayed("joint_states", state(1), 3) == [state(1)] * 3

    def publishers() -> set[str]:
        found = world.peer.node.get_publishers_info_by_topic("faulty/joint_states")
        return {info.node_name for info in found}

    world.until(lambda: publishers() == {"fault_injector", "second_publisher"}, "another node")
    world.until(lambda: publishers() == {"fault_injector"}, "its end")
    assert between.process.stop() == 0
