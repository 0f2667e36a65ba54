"""What is around the robot as a user gives it to its node: in YAML, and with ``-p``."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from ros_processes import ROOT
from sensor_msgs.msg import JointState

from eulerparams_control.errors import EulerParamsError
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.bridge_node import BridgeNode
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


def written(folder: Path) -> Path:
    """Return a file with the environment, as a user gives it to the node."""
    given = {"environment": ENVIRONMENT, **TOOL, **DISTURBANCE}
    file = folder / "environment.yaml"
    file.write_text(yaml.safe_dump({"pybullet_bridge": {"ros__parameters": given}}))
    return file


def test_an_environment_of_a_yaml_file_reaches_the_simulator_to_the_bit(world, tmp_path):
    states = world.peer.listen(JointState, "joint_states")
    wrenches = world.peer.listen(WrenchStamped, "wrench")
    lockstep = {"mode": "lockstep", "control": "torque"}
    world.start("pybullet_bridge", lockstep, files=(written(tmp_path),))
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


def test_the_keys_of_an_environment_are_parameters_that_cannot_be_changed(world, tmp_path):
    world.start("pybullet_bridge", {"rate": 100.0}, files=(written(tmp_path),))
    names = ["environment.table.stiffness", "environment.table.shape", "environment.hand.ramp"]
    assert world.peer.get_parameters("pybullet_bridge", *names) == [20000, "box", 0.0]
    wanted = {"environment.table.stiffness": 5.0}
    refusals = world.peer.set_parameters("pybullet_bridge", **wanted)
    assert len(refusals) == 1
    assert "read-only" in refusals[0]
    assert world.peer.get_parameters("pybullet_bridge", names[0]) == [20000]


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (
            "environment.table.stifness:=1e4",
            "unknown key of the box 'environment.table.stifness' (did you mean "
            "'environment.table.stiffness'?)",
        ),
        ("enviroment.wall.shape:=plane", "unknown parameter 'enviroment.wall.shape'"),
        ("environment.wall:=5", "environment.wall is 5; expected environment.NAME.KEY"),
        ("tool_shape:=sphree", "(did you mean 'sphere'?)"),
    ],
)
def test_a_node_refuses_what_is_misspelt_or_impossible_by_its_name(world, tmp_path, option, words):
    arguments = ["--ros-args", "--params-file", str(written(tmp_path)), "-p", option]
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
