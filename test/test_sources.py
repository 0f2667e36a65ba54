"""Whose joint_states are believed where two nodes publish those of one arm."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from ros_processes import (
    FRAMES,
    HOME,
    MODEL,
    STANDSTILL,
    UR5,
    Controlled,
    TorqueArm,
    assert_holds,
    pose,
    reference,
    values,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.messages.to_ros import stamp_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.ros.senders import LONG_LOOK, LOOK, QUIET, UNNUMBERED, Source

REAL = {**FRAMES, "use_sim_time": False}
NAMED = "came from two publishers, of /peer, /stranger; expected one"
CONTROLLERS = [*Controlled.ARMS]


class Stranger:
    """A second node that publishes states of the joints of an arm, 1.57 rad beside."""

    def __init__(self, arm: Any, offset: float = 1.57, name: str = "stranger") -> None:
        self.arm, self.offset = arm, offset
        self.node = arm.graph.peer.another_node(name)
        self.states = self.node.create_publisher(JointState, "joint_states", 10)

    def send(self) -> None:
        msg = self.arm.message(self.arm.q + self.offset)
        msg.header.stamp = stamp_to_ros(self.arm.t + 100_000)
        self.states.publish(msg)

    def end(self) -> None:
        self.node.destroy_node()


def an_arm(world: Any, executable: str) -> Any:
    """Return the arm of a controller, before that is started."""
    arm = Controlled.ARMS[executable](world, UR5)
    if arm.sensor is not None:
        arm.sensor.noise = 1e-12
    return arm


def go_on(arm: Any, seconds: float, *others: Callable[[], None], period: float = 0.004) -> None:
    """Let an arm publish for a time, and others beside it; nobody waits for an answer."""
    for _ in range(round(seconds / period)):
        arm.graph.advance(period)
        arm.t += round(period * 1e9)
        arm.send(arm.message())
        for other in others:
            other()


def told(node: Any, condition: Callable[[Any], Any], step: Callable[[], Any]) -> Any:
    """Step until a status of a node in real time meets a condition; return it."""
    heard = node.peer.listen(DiagnosticArray, "/diagnostics")
    for _ in range(3000):
        step()
        for status in (status for array in heard for status in array.status):
            if status.name == node.name and condition(status):
                return status
        heard.clear()
    raise AssertionError(f"it was not told\n{node.process.log}")


def says(node: Any, cause: str, mode: str, step: Callable[[], Any]) -> Any:
    """Return a status of a node in real time with this cause, in this mode."""

    def is_said(status: Any) -> bool:
        found = values(status)
        return (found["cause"], found["mode"]) == (cause, mode)

    return told(node, is_said, step)


class Started:
    """A controller beside an arm that is played by hand in real time."""

    def __init__(self, world: Any, executable: str, arm: Any, **parameters: Any) -> None:
        self.peer, self.name, self.arm = world.peer, executable, arm
        self.process = world.start(executable, {**REAL, **parameters})


# --- at activation ------------------------------------------------------------------------------
@pytest.mark.parametrize("executable", CONTROLLERS)
def test_nothing_is_commanded_while_two_publish_the_states_of_the_arm_then_it_is_held(
    world, executable
):
    arm = an_arm(world, executable)
    stranger = Stranger(arm)
    stranger.send()  # it is the first one that is heard
    node = Started(world, executable, arm)
    stranger.send()
    go_on(arm, 0.1, stranger.send)
    status = says(node, "two_publishers", "inactive", lambda: go_on(arm, 0.1, stranger.send))
    assert status.level == b"\x02"
    assert NAMED in status.message
    assert "end all but the driver" in values(status)["remedy"]
    assert not node.peer.change_state(f"/{executable}", "activate")
    assert not node.peer.trigger(f"/{executable}/resume").success
    go_on(arm, QUIET, stranger.send)
    assert arm.commands == []
    stranger.end()
    go_on(arm, QUIET / 2)
    assert arm.commands == []  # it may be back
    go_on(arm, QUIET)
    assert_holds(arm.commands[-1], HOME)


@pytest.mark.parametrize("rate", [100, 10, 2])
def test_a_stranger_that_is_heard_first_and_alone_is_not_believed_at_once(world, rate):
    arm = an_arm(world, "clik")
    stranger = Stranger(arm)
    Started(world, "clik", arm)
    for _ in range(max(1, round(0.2 * rate))):
        world.advance(min(1 / rate, 0.2))
        stranger.send()
    go_on(arm, 0.5)
    stranger.send()
    go_on(arm, 0.5, stranger.send)
    assert arm.commands == []


def test_one_publisher_alone_is_believed_after_a_look_and_with_an_idle_one_after_a_longer_one(
    world,
):
    for idle, expected in ((None, LOOK), ("idle", LONG_LOOK)):
        arm = an_arm(world, "clik")
        other = world.peer.another_node(idle) if idle else None
        if other is not None:
            other.create_publisher(JointState, "joint_states", 10)
        process = world.start("clik", REAL)
        start = world.now

        def answered(arm: Any = arm) -> bool:
            go_on(arm, 0.004)
            return bool(arm.commands)

        world.until(answered, "a command")
        assert world.now - start == pytest.approx(expected, abs=0.05)
        process.kill()


@pytest.mark.parametrize("apart", [1.57, 0.04])
def test_a_publisher_that_contradicts_itself_is_not_believed(world, apart):
    arm = an_arm(world, "clik")
    Started(world, "clik", arm)
    for k in range(500):
        arm.q = HOME + apart * (k % 2)
        go_on(arm, 0.004)
    assert arm.commands == []
    arm.q = HOME
    go_on(arm, 1.0)
    assert_holds(arm.commands[-1], HOME)


# --- later --------------------------------------------------------------------------------------
@pytest.fixture(params=CONTROLLERS)
def moving(world: Any, request: Any) -> Any:
    """A controller that moves its arm."""
    node = Controlled(world, request.param, REAL)
    p, R = pose(HOME)
    node.references.publish(reference(DesiredFrame(p + [0.0, 0.0, 0.1], R), times=(2.0,)))
    node.arm.ticks(200)
    return node


def test_a_defect_while_states_are_silent_is_logged(moving):
    process = moving.process
    moving.arm.graph.advance(1.0)
    try:
        raise ZeroDivisionError("planted in a silence")
    except ZeroDivisionError as error:
        process.node._on_defect(error)
    assert "planted in a silence" in process.log


@pytest.mark.parametrize("offset", [1.57, 0.0])
def test_a_second_publisher_that_appears_later_ends_the_commands_until_it_is_gone(moving, offset):
    node, arm = moving, moving.arm
    stranger = Stranger(arm, offset)
    stranger.send()
    go_on(arm, 0.004)
    count = len(arm.commands)
    go_on(arm, 0.2, stranger.send)
    status = says(node, "two_publishers", "distrusting", lambda: go_on(arm, 0.1, stranger.send))
    assert NAMED in status.message
    node.references.publish(reference(DesiredFrame(*pose(arm.q)), times=(0.5,)))
    assert "reference rejected: joint_states of the arm came from two" in node.process.log
    answer = node.peer.trigger(f"/{node.name}/resume")
    assert not answer.success
    assert NAMED in answer.message
    assert len(arm.commands) == count
    stranger.end()
    arm.dq = 0.0 * arm.dq  # the robot has braked
    arm.commands.clear()
    go_on(arm, QUIET + 0.1)
    assert arm.commands
    status = says(node, "two_publishers", "stopped", arm.tick)
    assert NAMED in status.message
    assert node.peer.trigger(f"/{node.name}/resume").success
    assert says(node, "", "holding", arm.tick)


def test_of_two_publishers_the_one_that_was_not_believed_before_is_not_believed_when_it_is_left(
    world,
):
    node = Controlled(world, "clik", REAL)
    arm = node.arm
    stranger = Stranger(arm)
    go_on(arm, 0.1, stranger.send)
    arm.commands.clear()

    def alone() -> None:
        world.advance(0.02)
        arm.t += 20_000_000
        stranger.send()

    for _ in range(round(2 * QUIET / 0.02)):
        alone()
    assert arm.commands == []
    status = says(node, "two_publishers", "distrusting", alone)
    assert "the one is left that was not believed before" in status.message
    assert node.peer.trigger("/clik/resume").success is False  # it is believed, and held first
    alone()
    assert_holds(arm.commands[-1], HOME + 1.57)


def test_a_driver_that_is_started_again_is_believed_after_its_silence(world):
    node = Controlled(world, "clik", REAL)
    arm = node.arm
    arm.ticks(100)
    again = Stranger(arm, 0.0, "peer")  # the one before stays in the graph for 20 s
    world.advance(1.0)
    arm.t += 1_000_000_000
    arm.commands.clear()
    arm.states = again.states
    go_on(arm, 0.9 * LONG_LOOK)
    assert arm.commands == []
    go_on(arm, 0.2 * LONG_LOOK)
    assert_holds(arm.commands[-1], arm.q)
    assert "two_publishers" not in node.process.log
    assert "came from two" not in node.process.log


@pytest.mark.parametrize(
    ("executable", "count"), [("clik", 3), ("dynamic_control", 3), ("dynamic_control", 6)]
)
def test_a_second_publisher_of_a_part_of_the_joints_or_without_speeds_is_one_too(
    world, executable, count
):
    """Nothing is made of its states, but those of the other may be a stranger's."""
    arm = an_arm(world, executable)
    stranger = Stranger(arm)
    node = Started(world, executable, arm)
    msg = JointState(name=list(UR5.joints[:count]), position=[1.0] * count)
    go_on(arm, 1.0, lambda: stranger.states.publish(msg))
    assert arm.commands == []
    assert NAMED in node.process.log


def test_without_numbers_states_that_contradict_each_other_are_those_of_two(world, monkeypatch):
    """As where the middleware does not number what it brings."""
    hear = Source.hear
    monkeypatch.setattr(Source, "hear", lambda self, _, now: hear(self, UNNUMBERED, now))
    node = Controlled(world, "clik", REAL)
    arm = node.arm
    arm.ticks(300)
    stranger = Stranger(arm)
    go_on(arm, 0.2, stranger.send)
    arm.commands.clear()
    go_on(arm, 2.0, stranger.send)
    assert arm.commands == []
    both = partial(go_on, arm, 0.1, stranger.send)
    assert NAMED in says(node, "two_publishers", "distrusting", both).message
    stranger.end()
    arm.dq = 0.0 * arm.dq
    go_on(arm, QUIET + 0.5)
    assert np.abs(np.array(arm.commands[-1].velocity)).max() < STANDSTILL
    assert says(node, "two_publishers", "stopped", arm.tick)


# --- the rule -----------------------------------------------------------------------------------
def heard(source: Source, number: int, now: float) -> bool:
    """Return whether a state of this number is taken, and believed."""
    try:
        source.hear(number, now)
    except InvalidMessageError:
        return False
    return source.look(now)


def a_source() -> Source:
    """Return a source of states whose publishers the graph does not show."""
    return Source(list, lambda _: None)


def test_a_single_publisher_is_never_doubted_whatever_is_lost_or_late():
    source, now, number = a_source(), 10.0, 700
    for _ in range(100):
        now, number = now + 0.01, number + 1
        believed = heard(source, number, now)
    assert believed
    for wait, lost in ((0.001, 0), (60.0, 0), (0.1, 90), (0.0, 0), (0.24, 900)):
        now, number = now + wait, number + 1 + lost
        assert heard(source, number, now)
    assert not heard(source, number + 500, now + 5.0)  # it may be another one: a second look
    assert not source.dispute.fault
    assert heard(source, number + 501, now + 5.0 + LOOK)


@pytest.mark.parametrize("rate", [1, 10, 50, 1000])
@pytest.mark.parametrize("ahead", [-500, 0, 3, 10_000])
def test_two_publishers_are_found_at_any_rates_and_numbers(rate, ahead):
    source, numbers = a_source(), [1000, 1000 + ahead]
    events = sorted((0.01 + k / r, who) for who, r in enumerate((250, rate)) for k in range(4 * r))
    believed = [False]
    for t, who in events:
        numbers[who] += 1
        believed.append(heard(source, numbers[who], t + 1e-4 * who))
    assert source.dispute.fault
    if rate > 1:
        assert not any(believed)
    else:
        assert not any(believed[-250:])


# --- the watchdog -------------------------------------------------------------------------------
class Watched:
    """A watchdog between an arm and what sends it constant efforts, in real time."""

    def __init__(self, world: Any) -> None:
        self.arm, self.peer, self.name = TorqueArm(world, UR5), world.peer, "watchdog"
        self.process = world.start("watchdog", FRAMES)
        self.driven = self.peer.listen(Float64MultiArray, "driver_effort")
        self._efforts = self.peer.publisher(JointState, "joint_effort")
        self.gravity = MODEL.dynamic_state(HOME, 0 * HOME).g
        self.passed = (self.gravity + 1.0).tolist()

    def send(self) -> None:
        self._efforts.publish(JointState(name=list(UR5.joints), effort=self.passed))

    def go_on(self, seconds: float, *others: Callable[[], None]) -> None:
        go_on(self.arm, seconds, self.send, *others)

    @property
    def last(self) -> list[float]:
        return list(self.driven[-1].data)


def test_the_watchdog_passes_nothing_while_it_is_not_known_whose_states_come(world):
    watched = Watched(world)
    stranger = Stranger(watched.arm)
    stranger.send()
    watched.go_on(1.0, stranger.send)
    both = partial(watched.go_on, 0.1, stranger.send)
    status = says(watched, "two_publishers", "waiting", both)
    assert NAMED in status.message
    assert watched.driven == []
    stranger.end()
    watched.go_on(QUIET + 0.1)
    assert watched.last == watched.passed


@pytest.mark.parametrize("offset", [1.57, 0.0])
def test_in_a_dispute_the_watchdog_leaves_gravity_where_the_arm_was_seen_last(world, offset):
    watched = Watched(world)
    watched.go_on(0.5)
    assert watched.last == watched.passed
    stranger = Stranger(watched.arm, offset)
    watched.go_on(0.5, stranger.send)
    both = partial(watched.go_on, 0.1, stranger.send)
    assert NAMED in says(watched, "two_publishers", "blind", both).message
    np.testing.assert_allclose(watched.last, watched.gravity, atol=1e-9)
    assert not watched.peer.trigger("/watchdog/resume").success
    stranger.end()
    watched.go_on(QUIET + 0.1)
    assert says(watched, "", "holding", lambda: watched.go_on(0.1))
    np.testing.assert_allclose(watched.last, watched.gravity, atol=1e-9)
    assert watched.peer.trigger("/watchdog/resume").success
    watched.go_on(0.1)
    assert watched.last == watched.passed
