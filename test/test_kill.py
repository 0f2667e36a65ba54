"""The controller of a moving arm is killed: the robot brakes, and its successor goes on.

The nodes are in the process of the test, the robot moves in real time by its clock.  Processes that
are killed are in ``test_faulty_runs.py``.
"""

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from in_process import Running, World
from ros_processes import FRAMES, MODEL, values
from sensor_msgs.msg import JointState
from tolerances import assert_close

from eulerparams_control.messages.from_ros import ns_from_ros

pytestmark = pytest.mark.slow

RATE = 100.0
BRIDGE = "pybullet_bridge"
COMMAND_TIMEOUT = 0.2  # [s]
# A braked joint is slower [rad/s]; brakes leave 1e-7.
STANDS = 1e-3
# A joint that follows the circle moves at least this fast now and then [rad/s].
MOVES = 0.02
# The first command after a restart is where the arm was measured [rad].
BEGINS_AT = 1e-6
# Efforts that hold the arm at rest [Nm]: its inertia times gains times what brakes leave.
BEARS = 1e-2

GAINS = {"k_Pp": 100.0, "k_Vp": 20.0, "k_Po": 200.0, "k_Vo": 20.0}  # stable with 50 ms of delay
CONTROLLERS = {
    "clik": {**FRAMES, "k_Pp": 10.0, "k_Po": 10.0},
    "dynamic_control": {**FRAMES, **GAINS},
    "impedance_control": {**FRAMES, **GAINS},
}
CIRCLE = {
    **{**FRAMES, "motion": "circle", "circle_radius": 0.04, "circle_normal": [1.0, 0.0, 0.0]},
    **{"circle_period": 8.0, "circle_turns": 5.0},
}


class Cell:
    """A robot that moves, its controller and its reference; and what they say."""

    def __init__(self, world: World, controller: str) -> None:
        self.world, self.name = world, controller
        control, topic = ("torque", "joint_effort")
        if controller == "clik":
            control, topic = ("position", "joint_reference")
        robot = {"control": control, "rate": RATE, "command_timeout": COMMAND_TIMEOUT}
        self.parameters = {BRIDGE: robot, controller: CONTROLLERS[controller], "reference": CIRCLE}
        self.states = world.peer.listen(JointState, "joint_states")
        self.commands = world.peer.listen(JointState, topic)
        self.statuses = world.peer.listen(DiagnosticArray, "/diagnostics")
        self.nodes: dict[str, Running] = {}
        for name in self.parameters:
            self.start(name)
        world.until(lambda: self.states and self.fastest > MOVES, "motion")

    def start(self, name: str) -> None:
        self.nodes[name] = self.world.start(name, self.parameters[name])

    def kill(self, name: str) -> None:
        self.nodes.pop(name).kill()

    @property
    def fastest(self) -> float:
        return float(np.abs(self.states[-1].velocity).max())

    def next_said(self, name: str, words: str = "") -> Any:
        """Return the next status of a node on /diagnostics with some words."""
        self.statuses.clear()

        def found() -> Any:
            said = (s for array in self.statuses for s in array.status if s.name == name)
            return next((s for s in said if words in s.message), None)

        return self.world.until(found, f"{name} saying '{words}'")

    def goes_on(self) -> None:
        """Let the controller answer for a while, and assert that no node has ended."""
        before = len(self.commands)
        self.world.until(lambda: len(self.commands) > before + 30, "commands")
        for process in self.nodes.values():
            assert process.exit_code is None, process.log


def stamp(message: Any) -> float:
    return ns_from_ros(message.header.stamp) / 1e9


def assert_begins_at_rest(command: Any, state: Any) -> None:
    """Assert that a command leaves the arm where it was measured: no jump."""
    assert command.header.stamp == state.header.stamp
    q = np.array(state.position[:6])
    if command.effort:
        assert_close(command.effort, MODEL.dynamic_state(q, np.zeros(6)).g, BEARS)
    else:
        assert_close(command.position, q, BEGINS_AT)
        assert_close(command.velocity, 0, BEGINS_AT)


@pytest.fixture(params=CONTROLLERS)
def cell(request: Any, world: World) -> Cell:
    return Cell(world, request.param)


def test_without_the_controller_the_robot_brakes_and_its_successor_begins_without_a_jump(cell):
    cell.kill(cell.name)
    status = cell.next_said(BRIDGE, f"no command for {COMMAND_TIMEOUT} s: braked")
    assert status.level == b"\x02"
    assert "see whether the controller is alive" in values(status)["remedy"]
    cell.world.until(lambda: cell.fastest < STANDS, "standstill")
    braked = stamp(cell.commands[-1]) + COMMAND_TIMEOUT + 5 / RATE
    assert all(np.abs(s.velocity).max() < STANDS for s in cell.states if stamp(s) > braked)
    stopped = np.array(cell.states[-1].position[:6])
    cell.states.clear()
    cell.commands.clear()
    cell.start(cell.name)
    cell.goes_on()
    first = cell.commands[0]
    assert_begins_at_rest(first, next(s for s in cell.states if stamp(s) == stamp(first)))
    cell.next_said(BRIDGE, "commanded")
    reached = np.array([s.position[:6] for s in cell.states])
    assert np.abs(reached - stopped).max() < 1e-3  # it was not moved by taking over [rad]
