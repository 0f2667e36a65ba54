"""The drives of the simulated robot as its node runs them: parameters, and a state torn apart."""

import dataclasses

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from ros_processes import Graph
from sensor_msgs.msg import JointState

from eulerparams_control.events import ExitCode
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.bridge_node import BridgeParameters
from sim_bridge.parameters import SimulatorParameters

UR5 = load_robot("ur5")


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


@pytest.mark.parametrize("effort", [1e8, 1e9])
def test_a_robot_that_an_effort_tears_apart_ends_with_an_error_after_its_last_finite_state(
    graph: Graph, effort: float
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
            msg = JointState(name=list(UR5.joints), effort=[effort] * 6)
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
