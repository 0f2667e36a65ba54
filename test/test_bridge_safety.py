"""The simulated robot as a node: two controllers, signals, an arm torn apart, what it reports."""

import dataclasses
import itertools
import signal
import sys
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from in_process import World
from ros_processes import HOME, UR5, Graph, Process, environment, values
from sensor_msgs.msg import JointState

from eulerparams_control.events import ExitCode
from eulerparams_control.messages.from_ros import ns_from_ros
from sim_bridge.bridge_parameters import BridgeParameters
from sim_bridge.parameters import SimulatorParameters

# A braked joint is slower [rad/s]; brakes leave 1e-7.
STANDS = 1e-3

# A braked arm stays where it is [rad]: what brakes leave, for some seconds.
STAYS = 1e-6

# The servo is this close to a goal that it has reached [rad].
REACHED = 1e-3

# A position that was left [rad]: much more than REACHED.
LEFT = 0.01

NAME = "pybullet_bridge"
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
        self.states = self.peer.listen(JointState, "joint_states")
        self.commands = self.peer.publisher(JointState, "joint_reference")
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

    def go(self, q: Any) -> None:
        self.commands.publish(message(position=np.array(q).tolist(), velocity=[0.0] * 6))

    def status(self, words: str) -> Any:
        return self.peer.status(NAME, lambda status: words in status.message)

    def count(self, name: str, at_least: int = 0) -> int:
        return self.peer.counter(NAME, name, at_least)

    def controller(self, name: str, offset: float) -> Process:
        """Start a process that wants all joints at home + offset [rad]."""
        home = " ".join(map(repr, HOME.tolist()))
        command = [sys.executable, "-c", SENDER, name, repr(offset), home]
        env = environment(self.graph.folder, self.graph.domain)
        process = Process(command, self.graph.folder, name, env)
        self.graph.processes.append(process)
        return process

    def until_at(self, offset: float) -> None:
        goal = HOME + offset
        self.graph.until(
            lambda: np.abs(self.q - goal).max() < REACHED, f"the arm at home + {offset}"
        )


def message(**fields: Any) -> JointState:
    return JointState(name=list(UR5.joints), **fields)


def test_two_controllers_that_send_are_both_refused_and_named_until_one_is_killed(
    graph: Graph,
) -> None:
    bench = Bench(graph, rate=100.0, servo_bandwidth=50.0)
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


def test_a_robot_that_an_effort_tears_apart_ends_with_an_error_after_its_last_finite_state(
    graph: Graph,
) -> None:
    peer = graph.peer
    states = peer.listen(JointState, "joint_states")
    wrenches = peer.listen(WrenchStamped, "wrench")
    health = peer.listen(DiagnosticArray, "/diagnostics")
    commands = peer.publisher(JointState, "joint_effort")
    torn = {"control": "torque", "enforce_limits": False, "tool_mass": 1.0}
    process = graph.start("pybullet_bridge", {"mode": "lockstep", **torn})
    graph.until(lambda: states and commands.get_subscription_count(), "the robot")
    answered: set[int] = set()

    def broken() -> bool:
        stamp = ns_from_ros(states[-1].header.stamp)
        if stamp not in answered:
            answered.add(stamp)
            msg = JointState(name=list(UR5.joints), effort=[1e9] * 6)
            msg.header.stamp = Time(sec=0, nanosec=stamp)
            commands.publish(msg)
        return process.exit_code is not None

    graph.until(broken, "the end")
    words = f"the state of the robot is not finite after step {len(answered)}: q ["
    assert process.end() == ExitCode.DIVERGED
    assert any(line.startswith(f"error: {words}") for line in process.stderr.splitlines())
    assert any("[ERROR]" in line and words in line for line in process.log.splitlines())
    assert "Traceback" not in process.log
    assert "FATAL" not in process.log  # rclpy would tell where in the code

    def reported() -> bool:
        return any(s.level == b"\x02" and words in s.message for d in health for s in d.status)

    graph.until(reported, "the error on /diagnostics")
    assert len(answered) > 1
    for state in states:
        assert np.isfinite([*state.position, *state.velocity, *state.effort]).all()
    for msg in wrenches:
        force, torque = msg.wrench.force, msg.wrench.torque
        assert np.isfinite([force.x, force.y, force.z, torque.x, torque.y, torque.z]).all()


def test_a_robot_reports_mode_cause_and_remedy_and_what_became_of_its_commands(
    world: World,
) -> None:
    peer = world.peer
    latched = peer.listen(DiagnosticStatus, f"{NAME}/status", latched=True)
    commands = peer.publisher(JointState, "joint_effort")
    pushes = peer.publisher(WrenchStamped, "external_wrench")
    torque = {"control": "torque", "gravity": [0.0, 0.0, 0.0], "external_wrench_timeout": 2.0}
    robot = world.start(NAME, {"rate": 100.0, **torque})

    def sent(**fields: Any) -> dict[str, Any]:
        """Return what is said after a command."""
        commands.publish(message(**fields))
        world.advance(0.02)
        return values(latched[-1])

    def modes() -> list[tuple[str, str]]:
        told = [values(status) for status in latched]
        pairs = [(each["mode"], each["cause"]) for each in told]
        return [pair for pair, _ in itertools.groupby(pairs)]

    assert modes() == [("standby", "")]
    assert sent(effort=[0.0] * 6)["mode"] == "obeying"
    while sent(effort=[1e4, *[0.0] * 5])["mode"] == "obeying":
        pass
    world.advance(0.5)
    assert "the next command is taken" in values(latched[-1])["remedy"]
    assert sent(effort=[0.0] * 6)["cause"] == ""
    world.advance(1.0)
    assert modes()[1:] == [
        ("obeying", ""),
        ("obeying", "clipped"),
        ("stopping", "protective_stop"),
        ("braked", "protective_stop"),
        ("obeying", ""),
        ("braked", "silence"),
    ]
    sent(effort=[np.nan] * 6)
    assert "[ERROR] command rejected: joint_effort has a non-finite effort" in robot.log
    push = WrenchStamped()
    push.header.frame_id, push.wrench.force.x = "tool0", 1.0
    pushes.publish(push)
    push.wrench.force.x = 1e300
    pushes.publish(push)
    world.advance(2.5)
    found = values(peer.status(NAME))
    counted = {"protective stops": 1, "commands rejected": 1, "commands out of order": 0,
               "commands of a second controller": 0, "external_wrench timed out": 1,
               "external_wrench rejected": 1, "steps given up": 0}  # fmt: skip
    assert {key: int(found[key]) for key in counted} == counted
    assert int(found["commands clipped"]) > 0
    assert float(found["braked for [s]"]) > 3.0
    assert float(found["real-time factor"]) == pytest.approx(1.0, abs=0.02)
    assert float(found["worst gap between commands [ms]"]) > 1000.0
    assert {"commands per second", "worst command age [ms]"} <= found.keys()
    assert robot.stop() == 0
    assert modes()[-1] == ("ended", "silence")  # why it was braked


def test_the_node_gives_the_simulator_its_drives() -> None:
    assert BridgeParameters().simulator() == SimulatorParameters()
    values = {
        "friction_viscous": (0.5,),
        "friction_coulomb": (0.1, 0.2),
        "noise_position": 1e-5,
        "encoder_resolution": 2**20,
        "velocity_cutoff": 100.0,
    }
    given = dataclasses.asdict(BridgeParameters(**values).simulator())
    assert {name: given[name] for name in values} == values
