"""The simulated robot as a node: what is around it, two controllers, signals, what it reports."""

import itertools
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from ros_processes import HOME, ROOT, UR5, values, wrench_stamped
from sensor_msgs.msg import JointState

from eulerparams_control.errors import EulerParamsError
from eulerparams_control.events import ExitCode
from sim_bridge.bridge_node import BridgeNode
from sim_bridge.bridge_parameters import BridgeParameters
from sim_bridge.drive_modes import OnSilence
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.simulator import Simulator

# A braked joint is slower [rad/s]; brakes leave 1e-7.
STANDS = 1e-3

NAME = "pybullet_bridge"

# One of each kind, whole numbers among them, within reach of the tool.
ENVIRONMENT = {
    "table": {
        "shape": "box", "size": [1, 1, 1], "position": [0.485, 0.02, -0.2], "stiffness": 20000,
        "damping": 100.0, "friction": 0.5,
    },
    "spring": {"shape": "spring", "position": [0.5, 0.0, 0.4], "stiffness": [100.0, 200.0, 300.0]},
    "handle": {"shape": "torsion_spring", "orientation": [0, 0, 0, 1], "stiffness": 5},
    "hand": {"shape": "push", "force": [1.0, 2.0, 3.0], "frame": "tool", "start": 0.002},
}  # fmt: skip
TOOL = {"tool_shape": "sphere", "tool_size": [0.08], "tool_position": [0.0, 0.0, 0.01]}
DISTURBANCE = {"disturbance_effort": [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]}


# --- two controllers, signals, reports ------------------------------------------------------
def message(**fields: Any) -> JointState:
    return JointState(name=list(UR5.joints), **fields)


def test_two_controllers_that_send_are_both_refused_and_named_until_one_is_killed(world):
    peer = world.peer
    robot = world.start(NAME, {"rate": 100.0})
    nodes = [world.create_node(name) for name in ("first", "second")]
    goals = [node.create_publisher(JointState, "joint_reference", 10) for node in nodes]
    here = message(position=HOME.tolist(), velocity=[0.0] * 6)

    def send(count: int) -> None:
        for goal in goals[:count]:
            goal.publish(here)

    peer.status(NAME, lambda s: s.message == "commanded", lambda: send(1))
    named = "publishers are /first, /second; "
    status = peer.status(NAME, lambda s: named in s.message, lambda: send(2))
    assert status.level == b"\x02"
    nodes[1].destroy_node()
    peer.status(NAME, lambda s: s.message == "commanded", lambda: send(1))
    assert robot.exit_code is None


def test_a_signal_brakes_the_moving_robot_and_ends_it_with_exit_code_0(graph):
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
    process.signal(signal.SIGINT)
    graph.until(lambda: process.exit_code is not None, "the end")
    graph.until(lambda: np.abs(states[-1].velocity[:6]).max() < STANDS, "the last state, at rest")
    assert process.end() == 0
    assert np.abs(states[-1].position[:6] - (HOME + 1.0)).max() > 0.1
    assert "Traceback" not in process.log


def test_a_robot_that_an_effort_tears_apart_ends_with_an_error_after_its_last_finite_state(world):
    peer = world.peer
    states = peer.listen(JointState, "joint_states")
    told = peer.listen(DiagnosticArray, "/diagnostics")
    commands = peer.publisher(JointState, "joint_effort")
    torn = {"control": "torque", "enforce_limits": False, "tool_mass": 1.0}
    process = world.start(NAME, {"mode": "lockstep", **torn})
    world.until(lambda: states, "the robot")
    while process.exit_code is None:
        msg = message(effort=[1e9] * 6)
        msg.header.stamp = states[-1].header.stamp
        commands.publish(msg)
    assert process.exit_code == ExitCode.DIVERGED
    assert "not finite after step" in process.stderr

    ended = [values(s) for array in told for s in array.status if s.level == b"\x02"]
    assert (ended[-1]["mode"], ended[-1]["cause"]) == ("ended", "diverged")
    assert len(states) > 1
    for state in states:
        assert np.isfinite([*state.position, *state.velocity, *state.effort]).all()


def test_a_robot_reports_mode_cause_and_remedy_and_what_became_of_its_commands(world):
    peer = world.peer
    latched = peer.listen(DiagnosticStatus, f"{NAME}/status", latched=True)
    commands = peer.publisher(JointState, "joint_effort")
    pushes = peer.publisher(WrenchStamped, "external_wrench")
    torque = {"control": "torque", "gravity": [0.0, 0.0, 0.0], "external_wrench_timeout": 2.0}
    robot = world.start(NAME, {"rate": 100.0, **torque})

    def sent(*efforts: float) -> dict[str, Any]:
        """Return what is said after a command."""
        commands.publish(message(effort=[*efforts, *[0.0] * (6 - len(efforts))]))
        world.advance(0.02)
        return values(latched[-1])

    sent(0.0)
    while sent(1e4)["mode"] == "obeying":
        pass
    world.advance(0.5)
    assert values(latched[-1])["remedy"]
    sent(0.0)
    world.advance(1.0)
    told = [values(status) for status in latched]
    assert [pair for pair, _ in itertools.groupby((s["mode"], s["cause"]) for s in told)] == [
        ("standby", ""),
        ("obeying", ""),
        ("obeying", "clipped"),
        ("stopping", "protective_stop"),
        ("braked", "protective_stop"),
        ("obeying", ""),
        ("braked", "silence"),
    ]
    sent(np.nan)
    for force in (1.0, 1e300):
        pushes.publish(wrench_stamped(force))
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
    warned = peer.status(
        NAME, lambda s: "a command rejected" in s.message, lambda: (sent(0.0), sent(np.nan))
    )
    assert warned.level == b"\x01"
    assert robot.stop() == 0
    assert values(latched[-1])["mode"] == "ended"


def test_the_parameters_of_the_node_reach_the_simulator_and_the_drive():
    assert BridgeParameters().simulator() == SimulatorParameters()
    p = BridgeParameters(
        on_silence="hold_last", max_joint_acceleration=(3.0,), servo_lag=0.1, velocities=False,
        friction_coulomb=(0.1, 0.2), encoder_resolution=2**20,
    )  # fmt: skip
    policy, given = p.policy(), p.simulator()
    assert (policy.on_silence, policy.max_joint_acceleration) == (OnSilence.HOLD_LAST, (3.0,))
    assert (given.servo_lag, given.velocities) == (0.1, False)
    assert (given.friction_coulomb, given.encoder_resolution) == ((0.1, 0.2), 2**20)


# --- what is around it ----------------------------------------------------------------------
@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with the environment, as a user gives it to the node."""
    given = {"environment": ENVIRONMENT, **TOOL, **DISTURBANCE}
    file = tmp_path / "environment.yaml"
    file.write_text(yaml.safe_dump({"pybullet_bridge": {"ros__parameters": given}}))
    return file


def test_an_environment_of_a_yaml_file_reaches_the_simulator_to_the_bit_and_stays(world, file):
    states = world.peer.listen(JointState, "joint_states")
    wrenches = world.peer.listen(WrenchStamped, "wrench")
    lockstep = {"mode": "lockstep", "control": "torque"}
    world.start(NAME, lockstep, files=(file,))
    world.until(lambda: states and wrenches, "the robot")
    given = {"environment": ENVIRONMENT, "control": "torque", **TOOL, **DISTURBANCE}
    sim = Simulator(UR5, SimulatorParameters(**given))
    alone = sim.read()
    sim.close()
    assert list(states[0].position) == alone.q.tolist()
    assert list(states[0].effort) == alone.tau.tolist()
    force, torque = wrenches[0].wrench.force, wrenches[0].wrench.torque
    found = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    assert found == alone.wrench.tolist()
    assert np.linalg.norm(found[:3]) > 1.0
    names = ["environment.table.stiffness", "environment.table.shape", "environment.hand.ramp"]
    (refusal,) = world.peer.set_parameters(NAME, **{names[0]: 5.0})
    assert "read-only" in refusal
    assert world.peer.get_parameters(NAME, *names) == [20000, "box", 0.0]


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("environment.table.stifness:=1e4", "(did you mean 'environment.table.stiffness'?)"),
        ("enviroment.wall.shape:=plane", "unknown parameter 'enviroment.wall.shape'"),
    ],
)
def test_a_node_refuses_what_is_misspelt_or_impossible_by_its_name(world, file, option, words):
    arguments = ["--ros-args", "--params-file", str(file), "-p", option]
    with pytest.raises(EulerParamsError, match=re.escape(words)):
        world.make(BridgeNode, [], cli_args=arguments)


def test_the_environment_of_the_example_can_be_used_as_it_is_written(world):
    lines = (ROOT / "config" / "pybullet_bridge.yaml").read_text().splitlines()
    start = lines.index("    #environment:")
    lines[start:] = [line.replace("#", "", 1) for line in lines[start:]]
    content = yaml.safe_load("\n".join(lines))["/**"]["ros__parameters"]
    given = {"environment": content["environment"], "collide_links": True}
    SimulatorParameters(**given)
    bridge = world.start("pybullet_bridge", given | {"duration": 0.01})
    assert bridge.end() == 0, bridge.log
