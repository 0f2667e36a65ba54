"""What is around the robot as a user gives it to its node: in YAML, and with ``-p``."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from ros_processes import ROOT, Graph
from sensor_msgs.msg import JointState

from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.simulator import Simulator

UR5 = load_robot("ur5")

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
STEPS = 6


def expected() -> list[Any]:
    """Return q, dq, tau and wrench of each step of the simulator alone."""
    parameters = {"environment": ENVIRONMENT, "control": "torque", **TOOL, **DISTURBANCE}
    sim = Simulator(UR5, SimulatorParameters(**parameters))
    states = [sim.read()]
    for _ in range(STEPS - 1):
        sim.command_effort(np.zeros(6))
        sim.step()
        states.append(sim.read())
    sim.close()
    return states


def test_an_environment_of_a_yaml_file_reaches_the_simulator_to_the_bit(
    graph: Graph, tmp_path: Path
) -> None:
    peer = graph.peer
    states = peer.listen(JointState, "joint_states")
    wrenches = peer.listen(WrenchStamped, "wrench")
    commands = peer.publisher(JointState, "joint_effort")
    given = {"environment": ENVIRONMENT, **TOOL, **DISTURBANCE}
    file = tmp_path / "environment.yaml"
    file.write_text(yaml.safe_dump({"pybullet_bridge": {"ros__parameters": given}}))
    lockstep = {"mode": "lockstep", "control": "torque"}
    graph.start("pybullet_bridge", lockstep, files=(file,))
    graph.until(lambda: states and commands.get_subscription_count(), "the robot")
    seen: dict[int, tuple[JointState, WrenchStamped]] = {}

    def finished() -> bool:
        for state in states:
            stamp = ns_from_ros(state.header.stamp)
            pair = [w for w in wrenches if ns_from_ros(w.header.stamp) == stamp]
            if stamp not in seen and pair:
                seen[stamp] = state, pair[0]
                msg = JointState(name=list(UR5.joints), effort=[0.0] * 6)
                msg.header.stamp = Time(sec=0, nanosec=stamp)
                commands.publish(msg)
        return len(seen) >= STEPS

    graph.until(finished, "the steps")
    for k, alone in enumerate(expected()):
        state, wrench = seen[k * 1_000_000]
        assert list(state.position) == alone.q.tolist()
        assert list(state.velocity) == alone.dq.tolist()
        assert list(state.effort) == alone.tau.tolist()
        force, torque = wrench.wrench.force, wrench.wrench.torque
        felt = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
        assert felt == alone.wrench.tolist()
    assert np.linalg.norm(expected()[-1].wrench[:3]) > 10.0


def test_the_keys_of_an_environment_are_parameters_that_cannot_be_changed(graph: Graph) -> None:
    graph.start("pybullet_bridge", {"environment": ENVIRONMENT, **TOOL, "rate": 100.0})
    names = ["environment.table.stiffness", "environment.table.shape", "environment.hand.ramp"]
    assert graph.peer.get_parameters("pybullet_bridge", *names) == [20000, "box", 0.0]
    wanted = {"environment.table.stiffness": 5.0}
    refusals = graph.peer.set_parameters("pybullet_bridge", **wanted)
    assert len(refusals) == 1
    assert "read-only" in refusals[0]
    assert graph.peer.get_parameters("pybullet_bridge", names[0]) == [20000]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ["environment.table.stifness:=1e4"],
            "unknown key of the box 'environment.table.stifness' (did you mean "
            "'environment.table.stiffness'?)",
        ),
        (["enviroment.wall.shape:=plane"], "unknown parameter 'enviroment.wall.shape'"),
        (["environment.wall.position:=[1,0,0]"], "environment.wall.shape is missing; expected one"),
        (["environment.wall:=5"], "environment.wall is 5; expected environment.NAME.KEY"),
        (["environment.hand.force:=[1.0]"], "environment.hand.force is [1.0]; expected 3 finite"),
        (["tool_shape:=sphree"], "(did you mean 'sphere'?)"),
        (["tool_size:=[1.0,2.0]"], "tool_size is [1.0, 2.0]; expected radius of a sphere"),
        (["disturbance_effort:=[1.0,2.0]"], "disturbance_effort must be empty, one number or 6"),
    ],
)
def test_a_node_refuses_what_is_misspelt_or_impossible_by_its_name(
    graph: Graph, tmp_path: Path, options: list[str], words: str
) -> None:
    file = tmp_path / "environment.yaml"
    given = {"environment": ENVIRONMENT, **TOOL}
    file.write_text(yaml.safe_dump({"pybullet_bridge": {"ros__parameters": given}}))
    overrides = [word for option in options for word in ("-p", option)]
    process = graph.run("pybullet_bridge", "--ros-args", "--params-file", str(file), *overrides)
    graph.until(lambda: process.exit_code is not None, "the end")
    assert process.end() == 1
    assert words in process.stderr
    assert process.stderr.strip().splitlines()[-1].startswith("error: ")
    assert "Traceback" not in process.log


def test_the_environment_of_the_example_can_be_used_as_it_is_written(graph: Graph) -> None:
    lines = (ROOT / "config" / "pybullet_bridge.yaml").read_text().splitlines()
    start = lines.index("    #environment:")
    lines[start:] = [line.replace("#", "", 1) for line in lines[start:]]
    content = yaml.safe_load("\n".join(lines))["/**"]["ros__parameters"]
    given = {"environment": content["environment"], "collide_links": True}
    SimulatorParameters(**given)
    process = graph.start("pybullet_bridge", given | {"duration": 0.01})
    assert process.end() == 0, process.log
