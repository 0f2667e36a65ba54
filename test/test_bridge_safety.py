"""The simulated robot as a node: two controllers, signals, an arm torn apart, what it reports."""

import dataclasses
import itertools
import signal
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from in_process import World
from ros_processes import HOME, UR5, values
from sensor_msgs.msg import JointState

from eulerparams_control.events import ExitCode
from eulerparams_control.messages.from_ros import ns_from_ros
from sim_bridge.bridge_parameters import BridgeParameters
from sim_bridge.parameters import SimulatorParameters

# A braked joint is slower [rad/s]; brakes leave 1e-7.
STANDS = 1e-3

# The servo is this close to a goal that it has reached [rad].
REACHED = 1e-3

NAME = "pybullet_bridge"


def is_standing(states: list[JointState]) -> bool:
    return bool(np.abs(states[-1].velocity[:6]).max() < STANDS)


def message(**fields: Any) -> JointState:
    return JointState(name=list(UR5.joints), **fields)


def start_controller(world: World, name: str, q: Any) -> Any:
    """Start a node that answers each state with the command to go to q (n,) [rad]."""
    node = world.create_node(name)
    publisher = node.create_publisher(JointState, "joint_reference", 10)
    goal = message(position=q.tolist(), velocity=[0.0] * 6)

    def answer(state: JointState) -> None:
        goal.header.stamp = state.header.stamp
        publisher.publish(goal)

    node.create_subscription(JointState, "joint_states", answer, 10)
    return node


def test_two_controllers_that_send_are_both_refused_and_named_until_one_is_killed(world):
    peer = world.peer
    states = peer.listen(JointState, "joint_states")
    robot = world.start(NAME, {"rate": 100.0, "servo_bandwidth": 50.0})
    first = start_controller(world, "first", HOME)
    peer.status(NAME, lambda s: s.message == "commanded")
    start_controller(world, "second", HOME + 0.5)
    words = (
        "two controllers send on 'joint_reference', whose publishers are /first, /second; "
        "braked, both are refused"
    )
    status = peer.status(NAME, lambda s: words in s.message)
    assert status.level == b"\x02"
    assert "stop or deactivate one of them" in values(status)["remedy"]
    world.until(lambda: is_standing(states), "standstill")
    first.destroy_node()
    peer.status(NAME, lambda s: s.message == "commanded")
    goal = HOME + 0.5
    world.until(lambda: np.abs(states[-1].position[:6] - goal).max() < REACHED, "its goal")
    assert robot.exit_code is None


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_brakes_the_moving_robot_and_ends_it_with_exit_code_0(graph, number):
    states = graph.peer.listen(JointState, "joint_states")
    commands = graph.peer.publisher(JointState, "joint_reference")
    # slow enough to be on the way for seconds, and nothing else brakes it
    slow = {"rate": 100.0, "servo_bandwidth": 0.5, "command_timeout": 60.0}
    process = graph.start(NAME, slow)
    away = message(position=(HOME + 1.0).tolist(), velocity=[0.0] * 6)

    def is_fast() -> bool:
        commands.publish(away)
        return bool(states) and np.abs(states[-1].velocity).max() > 0.2

    graph.until(is_fast, "motion")
    process.signal(number)
    graph.until(lambda: process.exit_code is not None, "the end")
    graph.until(lambda: is_standing(states), "the last state, at rest")
    assert process.end() == 0
    assert np.abs(states[-1].position[:6] - (HOME + 1.0)).max() > 0.1
    assert "Traceback" not in process.log


def test_a_robot_that_an_effort_tears_apart_ends_with_an_error_after_its_last_finite_state(graph):
    peer = graph.peer
    states = peer.listen(JointState, "joint_states")
    health = peer.listen(DiagnosticArray, "/diagnostics")
    commands = peer.publisher(JointState, "joint_effort")
    torn = {"control": "torque", "enforce_limits": False, "tool_mass": 1.0}
    process = graph.start(NAME, {"mode": "lockstep", **torn})
    graph.until(lambda: states and commands.get_subscription_count(), "the robot")
    answered: set[int] = set()

    def broken() -> bool:
        stamp = ns_from_ros(states[-1].header.stamp)
        if stamp not in answered:
            answered.add(stamp)
            msg = message(effort=[1e9] * 6)
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


def test_a_robot_reports_mode_cause_and_remedy_and_what_became_of_its_commands(world):
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

    def send_both() -> None:
        for effort in (0.0, np.nan):
            commands.publish(message(effort=[effort] * 6))

    warned = peer.status(NAME, lambda s: s.message == "commanded; a command rejected", send_both)
    assert warned.level == b"\x01"
    world.advance(0.5)
    assert robot.stop() == 0
    assert modes()[-1] == ("ended", "silence")  # why it was braked


def test_the_node_gives_the_simulator_its_drives():
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
