"""The simulated robot under bad controllers: it brakes, refuses, says why, and goes on."""

import signal
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from ros_processes import HOME, MODEL, UR5, Graph, Process, environment, values
from sensor_msgs.msg import JointState

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.events import ExitCode
from eulerparams_control.messages.from_ros import ns_from_ros
from sim_bridge.command_source import UNNUMBERED, Senders
from sim_bridge.command_statistics import Tally
from sim_bridge.conduct import Conduct
from sim_bridge.pushes import PushInput
from sim_bridge.stamp_filter import StampOrder

# A braked joint is slower [rad/s]; brakes leave 1e-7.
STANDS = 1e-3

# A braked arm stays where it is [rad]: what brakes leave, for some seconds.
STAYS = 1e-6

# The servo is this close to a goal that it has reached [rad].
REACHED = 1e-3

# A position that was left [rad]: much more than REACHED.
LEFT = 0.01

# A force that is felt or not [N]: the brakes leave 1e-3.
FELT = 0.1

NAME = "pybullet_bridge"
NAMES = list(UR5.joints)
MS = 1_000_000  # ns

# A controller: answers each state with the command to go to home + OFFSET.
SENDER = """
import sys
import rclpy
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
name, offset, home = sys.argv[1], float(sys.argv[2]), [float(x) for x in sys.argv[3].split()]
rclpy.init()
node = rclpy.create_node(name)
publisher = node.create_publisher(JointState, "joint_reference", 10)
goal = [q + offset for q in home]
def answer(state):
    msg = JointState(name=list(state.name)[:len(home)], position=goal, velocity=[0.0] * len(home))
    msg.header.stamp = state.header.stamp
    publisher.publish(msg)
node.create_subscription(JointState, "joint_states", answer, QoSProfile(depth=1000))
rclpy.spin(node)
"""


class Bench:
    """A robot process, what it publishes, and a publisher of commands."""

    def __init__(self, graph: Graph, **parameters: Any) -> None:
        self.graph, self.peer = graph, graph.peer
        torque = parameters.get("control") == "torque"
        self.states = self.peer.listen(JointState, "joint_states")
        self.wrenches = self.peer.listen(WrenchStamped, "wrench")
        topic = "joint_effort" if torque else "joint_reference"
        self.commands = self.peer.publisher(JointState, topic)
        self.process = graph.start(NAME, parameters)
        graph.until(lambda: self.states and self.commands.get_subscription_count(), "the robot")

    @property
    def q(self) -> Any:
        return np.array(self.states[-1].position[:6])

    @property
    def dq(self) -> Any:
        return np.array(self.states[-1].velocity[:6])

    @property
    def stamp(self) -> int:
        return ns_from_ros(self.states[-1].header.stamp)

    def go(self, q: Any, stamp: int = 0) -> None:
        self.send(stamp, position=np.array(q).tolist(), velocity=[0.0] * 6)

    def move(self, q: Any, stamp: Callable[[], int] = lambda: 0) -> None:
        """Command to go to q (n,) [rad] until the arm is there."""

        def there() -> bool:
            self.go(q, stamp())
            return bool(np.abs(self.q - q).max() < REACHED)

        self.graph.until(there, f"the arm at {q}")

    def send(self, stamp: int = 0, **fields: Any) -> None:
        self.commands.publish(message(stamp, **fields))

    def status(self, words: str, meanwhile: Callable[[], Any] = lambda: None) -> Any:
        return self.peer.status(NAME, lambda status: words in status.message, meanwhile)

    def count(self, name: str, at_least: int = 0) -> int:
        return self.peer.counter(NAME, name, at_least)

    def answer(self, until: int, fields: Callable[[Any], dict[str, Any]]) -> None:
        """In lock-step, answer each state up to a stamp [ns]."""
        answered: set[int] = set()

        def there() -> bool:
            if self.stamp not in answered and self.stamp < until:
                answered.add(self.stamp)
                self.send(self.stamp, **fields(self.states[-1]))
            return self.stamp >= until

        self.graph.until(there, f"the state stamped {until}")

    def controller(self, name: str, offset: float) -> Process:
        """Start a process that wants all joints at home + offset [rad]."""
        home = " ".join(map(repr, HOME.tolist()))
        command = [sys.executable, "-c", SENDER, name, repr(offset), home]
        env = environment(self.graph.folder, self.graph.domain)
        number = len(self.graph.processes)
        process = Process(command, self.graph.folder, f"{name}_{number}", env)
        self.graph.processes.append(process)
        return process

    def until_at(self, offset: float) -> None:
        goal = HOME + offset
        self.graph.until(
            lambda: np.abs(self.q - goal).max() < REACHED, f"the arm at home + {offset}"
        )


def message(stamp: int = 0, **fields: Any) -> JointState:
    msg = JointState(**{"name": NAMES, **fields})
    msg.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
    return msg


# --- wrong commands --------------------------------------------------------------------------


REST = {"position": HOME.tolist(), "velocity": [0.0] * 6}


@pytest.fixture(scope="module")
def robot(shared_graph: Graph) -> Bench:
    """A position-controlled robot in real time."""
    return Bench(shared_graph, rate=100.0, servo_bandwidth=50.0)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": NAMES[:5], "position": [0.0] * 5}, "joint_reference lacks wrist_3_joint"),
        ({"position": [0.0] * 5}, "6 names but 5 values of position"),
        ({"name": []}, "joint_reference lacks"),
        ({"position": [0.0] * 6, "velocity": [0.0] * 7}, "6 names but 7 values of velocity"),
        ({"position": [0.0, np.inf, 0.0, 0.0, 0.0, 0.0]}, "a non-finite position"),
        ({"position": [0.0] * 6, "velocity": [np.nan] * 6}, "a non-finite velocity"),
        ({"position": [1e300] * 6}, "a too large position"),
        ({"position": [0.0] * 6, "velocity": [0.0, -1e300, 0.0, 0.0, 0.0, 0.0]}, "too large vel"),
        ({"position": [1.7e308] * 6}, "a too large position"),
        ({"name": [*NAMES, NAMES[0]], "position": [0.0] * 7}, "has shoulder_pan_joint twice"),
        ({"effort": [1.0] * 6}, "has efforts only, but the robot is in position control"),
        ({}, "6 names but 0 values of position"),
    ],
)
def test_a_command_that_cannot_be_used_is_rejected_with_its_reason_and_moves_nothing(
    robot: Bench, fields: dict[str, Any], words: str
) -> None:
    robot.graph.until(lambda: np.abs(robot.dq).max() < STANDS, "standstill")
    q, before = robot.q, robot.count("commands rejected")
    robot.send(**fields)
    assert robot.count("commands rejected", before + 1) == before + 1
    status = robot.peer.status(NAME, lambda s: words in values(s).get("last command rejected", ""))
    assert words in values(status)["last command rejected"]
    robot.graph.until_said(robot.process, words)
    np.testing.assert_allclose(robot.q, q, rtol=0, atol=STAYS)
    assert "Traceback" not in robot.process.log


def test_a_robot_that_waits_says_why_it_rejects_commands_and_what_to_do(robot: Bench) -> None:
    words = "commands are rejected: joint_reference has a non-finite"
    status = robot.status(words, lambda: robot.send(position=[np.nan] * 6))
    assert status.level in (b"\x01", b"\x02")
    assert values(status)["remedy"]
    assert float(values(status)["braked for [s]"]) > 0.0
    robot.status("commanded", lambda: robot.go(HOME))


def test_positions_to_a_robot_in_torque_control_are_rejected(graph: Graph) -> None:
    bench = Bench(graph, rate=100.0, control="torque")
    bench.send(**REST)
    assert bench.count("commands rejected", 1) == 1
    bench.graph.until_said(bench.process, "has positions only, but the robot is in torque control")
    bench.send(effort=[1e300, *[0.0] * 5])
    assert bench.count("commands rejected", 2) == 2
    assert bench.process.exit_code is None


def test_a_rejected_command_in_lockstep_stalls_until_the_timeout_which_tells_of_it(
    graph: Graph,
) -> None:
    bench = Bench(graph, mode="lockstep", lockstep_timeout=1.0)
    bench.answer(5 * MS, lambda state: {"position": list(state.position)})
    bench.send(5 * MS, position=[np.nan] * 6)
    assert bench.process.end() == ExitCode.STALLED
    assert "The last command was rejected: joint_reference has a non-finite position" in (
        bench.process.stderr
    )
    assert bench.stamp == 5 * MS
    assert "Traceback" not in bench.process.log


# --- clipped commands ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"position": [*HOME[:2], 3.5, *HOME[3:]]},
            "joint 'elbow_joint' was asked for the position 3.5 rad; its limit is 3.14159 rad",
        ),
        (
            {"velocity": [0.0, 0.0, 0.0, -4.0, 0.0, 0.0]},
            "joint 'wrist_1_joint' was asked for the speed -4 rad/s; its limit is -3.2 rad/s",
        ),
    ],
)
def test_a_command_beyond_a_limit_is_a_warning_while_it_goes_on_and_no_longer(
    robot: Bench, fields: dict[str, Any], words: str
) -> None:
    before = robot.count("commands clipped")
    status = robot.status(words, lambda: robot.send(**{**REST, **fields}))
    assert status.level == b"\x01"
    assert values(status)["remedy"]
    assert words in values(status)["last command clipped"]
    assert robot.count("commands clipped", before + 1) > before
    status = robot.peer.status(NAME, lambda s: s.message == "commanded", lambda: robot.go(HOME))
    assert status.level == b"\x00"
    after = robot.count("commands clipped")
    robot.status("no command for 0.1 s: braked")
    assert robot.count("commands clipped") == after
    robot.move(HOME)


class Said:
    """A health that remembers what was said."""

    def __init__(self) -> None:
        self.values: dict[str, str | int | float] = {}
        self.states: list[tuple[bytes, str]] = []

    def set(self, level: bytes, message: str, remedy: str = "") -> None:
        self.states.append((level, message))

    def complain(self, message: str, *, error: bool = False, about: str = "") -> None:
        assert message

    def warn(self, message: str) -> None:
        self.states.append((b"\x01", message))


def test_the_warning_of_clipping_lasts_as_long_as_the_clipping_whatever_else_is_commanded() -> None:
    health = Said()
    conduct = Conduct(health, lambda: None, "joint_effort")
    conduct.obey()
    for k in range(3):
        conduct.clip(f"case {k}")
    assert health.states[1:] == [(b"\x01", "commanded beyond the limits: case 0")]
    conduct.review()
    assert health.values["last command clipped"] == "case 2"
    conduct.clip("case 3")
    conduct.review()
    assert len(health.states) == 2
    conduct.review()  # nothing was clipped for a second
    assert health.states[2:] == [(b"\x00", "commanded")]
    conduct.clip("case 4")
    assert health.states[3:] == [(b"\x01", "commanded beyond the limits: case 4")]
    assert health.values["commands clipped"] == 5


# --- the order of commands -------------------------------------------------------------------


def test_an_older_command_does_not_take_the_place_of_a_newer_one(robot: Bench) -> None:
    away = HOME + 0.2
    robot.move(HOME)
    late = robot.count("commands out of order")
    strayed = []

    def counted(status: Any) -> bool:
        return int(values(status)["commands out of order"]) >= late + 50

    def both() -> None:
        newer = robot.stamp
        robot.go(HOME, newer)
        robot.go(away, newer - 10 * MS)
        strayed.append(np.abs(robot.q - HOME).max())

    robot.peer.status(NAME, counted, both)
    assert max(strayed) < REACHED


def test_stamps_that_stay_older_are_taken_and_the_stamp_0_at_once(robot: Bench) -> None:
    away = HOME + 0.2
    robot.move(HOME, lambda: robot.stamp)
    late = robot.count("commands out of order")
    robot.move(away, lambda: 5)
    assert robot.count("commands out of order", late + 1) > late
    robot.move(HOME, lambda: robot.stamp)
    late = robot.count("commands out of order")
    robot.move(away)
    assert robot.count("commands out of order") == late
    robot.move(HOME)


def test_only_stamps_that_stay_older_for_longer_than_the_patience_are_taken() -> None:
    order = StampOrder(0.1)
    assert not order.is_late(100, 0.0)
    assert not order.is_late(100, 0.01)  # the last word of a controller
    assert order.is_late(99, 0.02)
    assert not order.is_late(101, 0.03)
    assert order.is_late(99, 0.2)  # a straggler long after is still one
    assert not order.is_late(0, 0.25)
    assert order.is_late(50, 0.3)
    assert not order.is_late(51, 0.31)  # 0.11 s after the first of them
    assert not order.is_late(52, 0.32)
    assert order.is_late(51, 0.33)


# --- two controllers -------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["realtime", "lockstep"])
def test_two_controllers_that_send_are_both_refused_and_named_until_one_is_killed(
    graph: Graph, mode: str
) -> None:
    bench = Bench(graph, mode=mode, rate=100.0, servo_bandwidth=50.0)
    first = bench.controller("first", 0.0)
    bench.status("commanded")
    bench.until_at(0.0)
    bench.controller("second", 0.5)
    words = (
        "two controllers send on 'joint_reference', whose publishers are /first, /peer, /second; "
        "braked, both are refused"
    )
    status = bench.status(words)
    assert status.level == b"\x02"
    assert "stop or deactivate one of them" in values(status)["remedy"]
    graph.until(lambda: np.abs(bench.dq).max() < STANDS, "standstill")
    q, stamp, refused = bench.q, bench.stamp, bench.count("commands of a second controller")
    bench.count("commands of a second controller", refused + 50)
    graph.until(lambda: bench.stamp > stamp + 100 * MS, "time that goes on")
    np.testing.assert_allclose(bench.q, q, rtol=0, atol=STAYS)
    assert np.abs(q - HOME).max() < 0.5 - LEFT
    first.kill()
    bench.status("commanded")
    bench.until_at(0.5)
    assert "Traceback" not in bench.process.log


@pytest.mark.parametrize("successor", ["first", "other"])
def test_the_successor_of_a_killed_controller_is_obeyed_while_the_graph_still_shows_both(
    graph: Graph, successor: str
) -> None:
    bench = Bench(graph, rate=100.0, servo_bandwidth=50.0)
    first = bench.controller("first", 0.0)
    bench.status("commanded")
    count = graph.peer.node.count_publishers
    graph.until(lambda: count("joint_reference") == 2, "the first and the peer in the graph")
    first.kill()
    bench.status("no command for 0.1 s: braked")
    bench.controller(successor, 0.2)

    def obeyed_while_three_are_there() -> bool:  # the killed one, its successor and the peer
        return bool(np.abs(bench.q - HOME).max() > LEFT and count("joint_reference") == 3)

    graph.until(obeyed_while_three_are_there, "the successor obeyed")
    bench.until_at(0.2)
    assert "two controllers" not in bench.process.log
    assert bench.count("commands of a second controller") == 0


def hear(senders: Senders, *numbers: int, since: float = 0.0) -> list[bool]:
    """Let messages of these numbers come, one a millisecond."""
    return [senders.hear(number, since + 0.001 * k) for k, number in enumerate(numbers)]


def both(first: int, second: int, count: int = 5) -> list[int]:
    """Return the numbers of two that send in turn after the first has sent alone."""
    alone = list(range(first - 5, first))
    return alone + [n + k for k in range(count) for n in (first, second)]


@pytest.mark.parametrize("second", [1, 450, 490, 499, 500, 501, 503, 590, 5000])
@pytest.mark.parametrize("at_once", [False, True])
def test_two_that_send_in_turn_are_told_from_each_other_whatever_their_numbers(
    second: int, at_once: bool
) -> None:
    senders = Senders(0.1, 5.0, at_once=at_once)
    heeded = hear(senders, *both(500, second))
    assert senders.contested
    assert not any(heeded[5 + 4 :])  # within two commands of the second
    assert not any(hear(senders, 505, second + 5, 506, second + 6, since=0.02))
    assert all(heeded[:5])


def test_a_second_sender_is_not_heeded_before_the_first_has_been_silent() -> None:
    senders = Senders(0.1, 5.0, at_once=False)
    assert all(hear(senders, 10, 11, 12))
    assert not any(hear(senders, 1, 2, 3, since=0.01))
    assert all(hear(senders, 4, 5, 6, since=0.103))
    assert not senders.contested


def test_lost_messages_are_no_second_sender() -> None:
    senders = Senders(0.1, 5.0, at_once=False)
    assert all(hear(senders, 1, 2, 3, 10, 11, 60, 61, 160))
    assert not senders.contested


def test_messages_that_the_successor_of_a_dead_controller_loses_are_not_of_the_dead() -> None:
    senders = Senders(0.1, 5.0, at_once=False)
    assert all(hear(senders, *range(1, 31)))
    assert all(hear(senders, *range(1, 21), 45, 46, 47, since=1.0))
    assert not senders.contested


def test_a_controller_may_be_switched_to_another_and_back_once() -> None:
    senders = Senders(0.1, 5.0, at_once=False)
    assert all(hear(senders, 100, 101))
    assert all(hear(senders, 1, 2, since=1.0))
    assert all(hear(senders, 102, 103, since=2.0))
    assert not any(hear(senders, 3, 4, since=3.0))  # they take turns: both are there
    assert senders.contested


def test_the_contest_ends_with_the_silence_of_one_or_when_the_graph_shows_one() -> None:
    senders = Senders(0.1, 5.0, at_once=False)
    hear(senders, *both(500, 1))
    assert not any(hear(senders, 505, 506, since=4.9))
    assert all(hear(senders, 507, 508, since=5.1))
    hear(senders, *both(600, 100), since=6.0)
    senders.see(["/a", "/b"])
    assert senders.contested
    senders.see(["/a"])
    assert not senders.contested
    assert all(hear(senders, 700, 701, since=6.1))


def test_without_numbers_two_names_in_the_graph_are_two_controllers() -> None:
    senders = Senders(0.1, 5.0, at_once=False)
    assert all(hear(senders, UNNUMBERED, UNNUMBERED))
    senders.see(["/a", "/a"])
    assert all(hear(senders, UNNUMBERED, UNNUMBERED))
    senders.see(["/a", "/b"])
    assert not any(hear(senders, UNNUMBERED, UNNUMBERED))
    senders.review(100.0)
    assert senders.contested
    senders.see(["/a"])
    assert all(hear(senders, UNNUMBERED, UNNUMBERED))


# --- the protective stop ---------------------------------------------------------------------


FLOATING = {"control": "torque", "gravity": [0.0, 0.0, 0.0]}
RACING = [100.0, *[0.0] * 5]


def damp(state: Any) -> dict[str, Any]:
    return {"effort": [-5.0 * speed for speed in state.velocity[:6]]}


def test_a_joint_that_is_too_fast_makes_the_robot_stop_and_take_commands_again_when_it_stands(
    graph: Graph,
) -> None:
    bench = Bench(graph, mode="lockstep", protective_speed=1.5, **FLOATING)
    bench.answer(500 * MS, lambda _state: {"effort": RACING})
    stopped = bench.status(
        "protective stop: joint 'shoulder_pan_joint' moves at",
        lambda: bench.answer(bench.stamp + MS, lambda _state: {"effort": RACING}),
    )
    assert stopped.level == b"\x02"
    assert "more than 1.5 times its limit 3.15" in stopped.message
    assert values(stopped)["remedy"]
    assert bench.count("protective stops", 1) >= 1
    assert bench.count("commands refused in a stop", 1) >= 1
    fastest = max(abs(state.velocity[0]) for state in bench.states)
    assert 1.5 * 3.15 < fastest < 2.0 * 3.15
    bench.answer(bench.stamp + 200 * MS, damp)
    status = bench.status("commanded")
    assert status.level == b"\x00"


def test_after_a_protective_stop_the_robot_stands_and_says_so_until_a_command(
    graph: Graph,
) -> None:
    bench = Bench(graph, rate=100.0, **FLOATING)
    words = "stands after a protective stop: joint '"
    said = bench.peer.status(
        NAME, lambda s: "protective stop" in s.message, lambda: bench.send(effort=RACING)
    )
    assert said.level == b"\x02"
    status = bench.status(words)
    assert status.level == b"\x02"
    assert "the next command is taken" in values(status)["remedy"]
    assert np.abs(bench.dq).max() < STANDS
    assert bench.status("commanded", lambda: bench.send(effort=[0.0] * 6)).level == b"\x00"


def test_without_limits_there_is_no_protective_stop(graph: Graph) -> None:
    bench = Bench(graph, mode="lockstep", enforce_limits=False, **FLOATING)
    bench.answer(500 * MS, lambda _state: {"effort": RACING})
    assert max(abs(state.velocity[0]) for state in bench.states) > 5.0 * 3.15
    assert bench.count("protective stops") == 0


# --- pushes ----------------------------------------------------------------------------------


def push(force: float, stamp: int = 0) -> WrenchStamped:
    msg = WrenchStamped()
    msg.header.frame_id = "tool0"
    msg.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
    msg.wrench.force.x = force
    return msg


def test_a_push_that_is_not_repeated_ends_after_its_timeout(graph: Graph) -> None:
    bench = Bench(graph, rate=100.0, external_wrench_timeout=2.0)
    pushes = bench.peer.publisher(WrenchStamped, "external_wrench")
    graph.until(pushes.get_subscription_count, "the subscriber of external_wrench")
    pushes.publish(push(10.0))
    graph.until(
        lambda: any(abs(msg.wrench.force.x - 10.0) < FELT for msg in bench.wrenches), "the push"
    )
    graph.until(lambda: abs(bench.wrenches[-1].wrench.force.x) < FELT, "its end")
    assert bench.count("external_wrench timed out", 1) == 1
    pushes.publish(push(1e300))
    assert bench.count("external_wrench rejected", 1) == 1


def test_in_lockstep_a_push_ends_at_its_stamp_and_the_timeout(graph: Graph) -> None:
    bench = Bench(graph, mode="lockstep", external_wrench_timeout=0.02)
    pushes = bench.peer.publisher(WrenchStamped, "external_wrench")
    graph.until(pushes.get_subscription_count, "the subscriber of external_wrench")

    def stay(state: Any) -> dict[str, Any]:
        return {"position": HOME.tolist()}

    bench.answer(10 * MS, stay)
    pushes.publish(push(10.0, 10 * MS))
    graph.until(lambda: bench.peer.status(NAME), "a second for the push to arrive")
    bench.answer(60 * MS, stay)
    graph.until(lambda: ns_from_ros(bench.wrenches[-1].header.stamp) >= 60 * MS, "the wrenches")
    felt = {
        ns_from_ros(msg.header.stamp) // MS
        for msg in bench.wrenches
        if abs(msg.wrench.force.x - 10.0) < FELT
    }
    assert felt == set(range(11, 31))


@pytest.mark.parametrize("control", ["position", "torque"])
def test_a_push_that_is_stronger_than_the_robot_stops_it_and_the_next_command_is_taken(
    graph: Graph, control: str
) -> None:
    bench = Bench(graph, rate=200.0, control=control, external_wrench_timeout=0.2)
    pushes = bench.peer.publisher(WrenchStamped, "external_wrench")
    graph.until(pushes.get_subscription_count, "the subscriber of external_wrench")
    command = {"effort": [0.0] * 6} if control == "torque" else REST
    graph.until(lambda: bench.send(**command) or len(bench.states) > 20, "a robot at work")
    pushes.publish(push(1e5))
    status = bench.status("which no brakes could stop: locked where it was, and the push let go")
    assert status.level == b"\x02"
    assert "a push" in values(status)["remedy"]
    assert bench.count("protective stops", 1) == 1
    assert bench.status("commanded", lambda: bench.send(**command)).level == b"\x00"
    fastest = max(np.abs(state.velocity[:6]).max() for state in bench.states)
    assert fastest < 40.0 * MODEL.limits.velocity.max()
    assert bench.count("external_wrench timed out") == 0


def test_a_push_ends_once_and_a_new_one_starts_the_time_anew() -> None:
    given = PushInput("tool0", 0.5)
    assert not given.is_over(1e9)
    assert given.from_ros(push(1.0), 1.0, has_stamps=False).tolist() == [1.0, 0, 0, 0, 0, 0]
    given.from_ros(push(1.0), 1.4, has_stamps=False)
    assert not given.is_over(1.6)
    assert given.is_over(2.0)
    assert not given.is_over(2.1)
    given.from_ros(push(1.0, 10**9), 1.2, has_stamps=True)
    assert not given.is_over(1.45)
    assert given.is_over(1.51)
    given.from_ros(push(1.0, 10**12), 2.0, has_stamps=True)  # of the future
    assert given.is_over(2.51)
    PushInput("tool0", 0.0).from_ros(push(1.0), 1.0, has_stamps=False)
    with pytest.raises(InvalidMessageError, match="impossible"):
        given.from_ros(push(-1e6), 3.0, has_stamps=False)


# --- reports and ends ------------------------------------------------------------------------


def test_the_report_of_a_second_has_its_rate_gap_age_and_real_time_factor() -> None:
    tally = Tally(10.0)
    for k in range(1, 11):
        tally.take(10.0 + 0.05 * k, 3 * MS if k == 4 else -MS)
    report = tally.report(12.0, 1.0)
    assert report == pytest.approx(
        {
            "commands per second": 5.0,
            "worst gap between commands [ms]": 1500.0,
            "worst command age [ms]": 3.0,
            "real-time factor": 0.5,
        }
    )
    tally.take(12.02, 0)
    report = tally.report(12.5, 1.5)
    assert report["worst gap between commands [ms]"] == pytest.approx(1520.0)
    assert report["commands per second"] == pytest.approx(2.0)
    assert report["worst command age [ms]"] == 0.0
    assert report["real-time factor"] == pytest.approx(1.0)


def test_diagnostics_tell_of_commands_brakes_and_time(robot: Bench) -> None:
    keys = {
        *("commands per second", "commands rejected", "commands clipped", "braked for [s]"),
        *("worst command age [ms]", "worst gap between commands [ms]", "steps given up"),
        *("real-time factor", "protective stops", "commands out of order"),
    }
    found = values(robot.peer.status(NAME, lambda s: keys <= values(s).keys()))
    assert float(found["real-time factor"]) > 0.0

    def commanded(status: Any) -> bool:
        return float(values(status)["commands per second"]) > 1.0

    found = values(robot.peer.status(NAME, commanded, lambda: robot.go(HOME)))
    assert float(found["worst gap between commands [ms]"]) > 0.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_brakes_the_moving_robot_and_ends_it_with_exit_code_0(
    graph: Graph, number: signal.Signals
) -> None:
    # slow enough to be on the way for seconds, and nothing else brakes it
    bench = Bench(graph, rate=100.0, servo_bandwidth=0.5, command_timeout=60.0)
    away = HOME + 1.0
    graph.until(lambda: bench.go(away) or np.abs(bench.dq).max() > 0.2, "motion")
    bench.process.signal(number)
    graph.until(lambda: bench.process.exit_code is not None, "the end")
    graph.until(lambda: np.abs(bench.dq).max() < STANDS, "the last state, at rest")
    assert bench.process.end() == 0
    assert np.abs(bench.q - away).max() > 0.1
    assert "Traceback" not in bench.process.log
