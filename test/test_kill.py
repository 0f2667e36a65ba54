"""Each node of a moving arm is killed, in real time: the others go on, and its successor too.

With ``clik`` the nodes are processes, which the graph shows for a while when they are dead, on a
machine that may be busy: timeouts are longer than their defaults, and all is judged by stamps and
by what the nodes report.  With the others they are in the process of the test.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from in_process import Running, World
from ros_processes import FRAMES, HOME, MODEL, Graph, Process, values
from sensor_msgs.msg import JointState

from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.messages.keys import BEGAN

pytestmark = pytest.mark.slow

RATE = 100.0
BRIDGE = "pybullet_bridge"

# [s] The timeout of the robot, and how old a command may be when it is taken on a busy machine:
# together less than twice the timeout, so that one that is too long is seen.
COMMAND_TIMEOUT, COMMAND_AGE = 0.4, 0.3

# A braked joint is slower [rad/s]; brakes leave 1e-7.
STANDS = 1e-3

# A joint that follows the circle moves at least this fast now and then [rad/s].
MOVES = 0.02

# The first command after a restart is where the arm was measured [rad]; the position to the bit,
# if it stands.
BEGINS_AT = 1e-6

# Efforts that bear the arm that stands [Nm]: its inertia times gains times what brakes leave.
BEARS = 1e-2

# A robot is so old [s] that the stamps of its successor are far from its own, even if the graph
# takes seconds to show it: a clock that goes back by less than state_timeout is another fault.
OLD = 10.0

# A new robot may be seen later than its controller sees it [rad]: it stands at home, and sinks
# by less than this from its brakes to what holds it.
SINKS = 1e-4

GAINS = {"k_Pp": 100.0, "k_Vp": 20.0, "k_Po": 200.0, "k_Vo": 20.0}  # bear 50 ms of delay
PATIENT = {"state_timeout": 2.0, "max_latency": 1.5}
CONTROLLERS = {
    "clik": {**FRAMES, **PATIENT, "k_Pp": 10.0, "k_Po": 10.0},
    "dynamic_control": {**FRAMES, **PATIENT, **GAINS},
    "impedance_control": {**FRAMES, **PATIENT, **GAINS, "wrench_timeout": 2.0},
}
CIRCLE = {
    **FRAMES,
    "motion": "circle",
    "circle_radius": 0.04,
    "circle_normal": [1.0, 0.0, 0.0],
    "circle_period": 8.0,
    "circle_turns": 5.0,
}


class Cell:
    """A robot, its controller and its reference; and what they say."""

    def __init__(self, graph: Graph | World, controller: str) -> None:
        self.graph, self.controller = graph, controller
        is_clik = controller == "clik"
        self.topic = "joint_reference" if is_clik else "joint_effort"
        control = "position" if is_clik else "torque"
        self.parameters: dict[str, dict[str, Any]] = {
            BRIDGE: {"control": control, "rate": RATE, "command_timeout": COMMAND_TIMEOUT},
            controller: CONTROLLERS[controller],
            "reference": CIRCLE,
        }
        self.states = graph.peer.listen(JointState, "joint_states")
        self.commands = graph.peer.listen(JointState, self.topic)
        self.statuses = graph.peer.listen(DiagnosticArray, "/diagnostics")
        self.nodes: dict[str, Process | Running] = {}
        for name in (BRIDGE, controller):
            self.start(name)
        graph.until(lambda: self.states and self.commands, "states and commands")

    def start(self, name: str) -> None:
        self.nodes[name] = self.graph.start(name, self.parameters[name])

    def kill(self, name: str) -> None:
        assert self.nodes[name].exit_code is None
        self.nodes.pop(name).kill()
        self.graph.peer.catch_up()  # what waits here is of its life

    def move(self) -> None:
        """Let the arm go along the circle, if it does not."""
        self.graph.peer.catch_up()
        status = self.until_said(self.controller, "", len(self.said(self.controller)))
        if "following" not in status.message or not self.is_moving:
            if "reference" in self.nodes:
                self.kill("reference")
            before = self.began
            self.start("reference")
            # an arm that moves still does not tell that its new motion has begun
            self.graph.until(lambda: self.began not in (None, before), "the new motion")
        self.graph.until(lambda: self.is_moving, "motion")
        for process in self.nodes.values():
            assert process.exit_code is None, process.log

    @property
    def began(self) -> str | None:
        """When the motion that the controller follows began, if it has said so."""
        found = (values(s).get(BEGAN) for s in reversed(self.said(self.controller)))
        return next(filter(None, found), None)

    @property
    def is_moving(self) -> bool:
        return bool(np.abs(self.states[-1].velocity).max() > MOVES)

    def said(self, name: str) -> list[Any]:
        """Return all that a node has said on /diagnostics."""
        return [s for message in self.statuses for s in message.status if s.name == name]

    def until_said(self, name: str, words: str, since: int) -> Any:
        """Return the first status of a node with some words among those after ``since``."""

        def found() -> Any:
            return next((s for s in self.said(name)[since:] if words in s.message), None)

        return self.graph.until(found, f"{name} saying '{words}'")

    def goes_on(self, messages: list[Any], count: int = 20) -> None:
        """Wait for more of some messages, beside those that wait already."""
        self.graph.peer.catch_up()
        before = len(messages)
        self.graph.until(lambda: len(messages) >= before + count, "more messages")

    def state_of(self, command: Any) -> Any:
        """Return the state that a command answers, which may be read after it."""

        def found() -> Any:
            same = (s for s in reversed(self.states) if s.header.stamp == command.header.stamp)
            return next(same, None)

        return self.graph.until(found, "the state that a command answers")


def stamp(message: Any) -> float:
    return ns_from_ros(message.header.stamp) / 1e9


class Newcomer:
    """Tells the messages of a new robot, or the answers to it, from what is late of the old one.

    The stamps of the new one begin anew.  Messages may overtake each other by a little, so they are
    told apart by half the life of the old one.
    """

    def __init__(self, messages: list[Any]) -> None:
        self._messages, self._count = messages, len(messages)
        self._half = stamp(messages[-1]) / 2

    def first(self) -> Any:
        """Return its first message; None as long as there is none."""
        new = (m for m in self._messages[self._count :] if stamp(m) < self._half)
        return next(new, None)


def assert_begins_at_rest(command: Any, state: Any, at: float = BEGINS_AT) -> None:
    """Assert that a command leaves the arm where it was measured, to ``at`` [rad]: no jump."""
    q = np.array(state.position[:6])
    if command.effort:
        gravity = MODEL.dynamic_state(q, np.zeros(6)).g
        np.testing.assert_allclose(command.effort, gravity, rtol=0, atol=BEARS)
    else:
        np.testing.assert_allclose(command.position, q, rtol=0, atol=at)
        np.testing.assert_allclose(command.velocity, 0, rtol=0, atol=BEGINS_AT)


@pytest.fixture(scope="module", params=CONTROLLERS)
def cell(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    kind = Graph if request.param == "clik" else World
    with kind(tmp_path_factory.mktemp(request.param)) as graph:
        yield Cell(graph, request.param)


def test_without_the_reference_the_motion_goes_on_and_its_successor_is_followed_at_once(cell):
    cell.move()
    name = cell.controller
    began = cell.began
    cell.kill("reference")
    cell.goes_on(cell.commands)
    assert cell.said(name)[-1].message.endswith("following a reference")
    cell.start("reference")
    cell.graph.until(lambda: cell.began != began, "the new motion")
    assert "reference rejected" not in values(cell.said(name)[-1])
    assert "two publishers" not in cell.nodes[name].log


def test_without_the_controller_the_robot_brakes_and_its_successor_begins_without_a_jump(cell):
    cell.move()
    since, graph = len(cell.said(BRIDGE)), cell.graph
    cell.kill(cell.controller)
    status = cell.until_said(BRIDGE, f"no command for {COMMAND_TIMEOUT} s: braked", since)
    graph.peer.catch_up()
    assert status.level == b"\x02"
    assert "see whether the controller is alive" in values(status)["remedy"]
    graph.until(lambda: np.abs(cell.states[-1].velocity).max() < STANDS, "standstill")
    last = stamp(cell.commands[-1])
    after = [s for s in cell.states if stamp(s) > last + COMMAND_TIMEOUT + COMMAND_AGE]
    assert all(np.abs(s.velocity).max() < STANDS for s in after)
    for process in cell.nodes.values():
        assert process.exit_code is None
    stopped, since = np.array(cell.states[-1].position[:6]), len(cell.said(BRIDGE))
    held, before = stamp(cell.states[-1]), len(cell.commands)
    cell.start(cell.controller)
    cell.goes_on(cell.commands, count=30)
    taken_over = cell.commands[before:]
    assert stamp(taken_over[0]) >= held
    assert_begins_at_rest(taken_over[0], cell.state_of(taken_over[0]))
    cell.until_said(BRIDGE, "commanded", since)
    reached = np.array([s.position[:6] for s in cell.states if stamp(s) >= held])
    assert np.abs(reached - stopped).max() < 1e-3  # it was not moved by taking over [rad]


def test_without_the_robot_nothing_is_commanded_and_its_successor_is_held_where_it_is(cell):
    cell.graph.until(lambda: stamp(cell.states[-1]) > OLD, "an old robot")
    cell.move()
    name = cell.controller
    since = len(cell.said(name))
    cell.kill(BRIDGE)
    status = cell.until_said(name, "no valid joint_states within", since)
    assert status.level == b"\x02"
    assert "no commands" in status.message
    cell.graph.peer.catch_up()
    before = stamp(cell.commands[-1])
    assert before <= stamp(cell.states[-1])  # nothing was commanded beyond the last state
    assert cell.nodes[name].exit_code is None
    since = len(cell.said(name))
    commands, states = Newcomer(cell.commands), Newcomer(cell.states)
    cell.start(BRIDGE)

    def is_home() -> bool:
        return bool(np.abs(np.array(cell.states[-1].position[:6]) - HOME).max() < 1e-2)

    cell.graph.until(is_home, "the new robot")
    cell.until_said(name, "holding the measured pose, after a", since)
    first = cell.graph.until(commands.first, "the first command to it")
    assert_begins_at_rest(first, cell.graph.until(states.first, "its first state"), SINKS)
    cell.goes_on(cell.commands, count=30)
    assert is_home()  # it is held there
    assert any("commanded" in status.message for status in cell.said(BRIDGE))


