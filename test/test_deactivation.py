"""However control ends: the arm comes to rest, then a last safe command, then silence."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from in_process import World
from ros_processes import FRAMES, HOME, Array, Controlled, assert_may_stay, pose, reference, values
from sensor_msgs.msg import JointState

from eulerparams_control.control.judge import AT_REST
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.ros.ending import LONGEST

# An arm of 0.25 m/s stops within this [m] at 1 m/s^2, with the jerk limit.
STOPPING_DISTANCE = 0.06

# A frictionless arm with its last effort moves by this [m] within 0.5 s at most: it is slower than
# AT_REST, and falls away from there.  It was 0.155 when the effort was that of a moving arm.
DRIFT = 0.01


class Moving(Controlled):
    """A controller whose arm moves at 0.2 m/s or more, and what it publishes."""

    def __init__(self, world: World, executable: str) -> None:
        super().__init__(world, executable, FRAMES)
        self.statuses = self.peer.listen(DiagnosticStatus, f"/{executable}/status", latched=True)
        self.sent = self.peer.listen(JointState, f"/{self.arm.topic}")
        p, R = pose(HOME)
        goal = DesiredFrame(p + [0.0, 0.0, 0.12], R)
        self.follow(reference(goal, times=(1.0,)))
        self.arm.ticks(125, dt=0.004)
        self.sent.clear()
        assert np.linalg.norm(self.speed()) > 0.15

    def speed(self) -> Array:
        a, b = (pose(self.arm.q + dt * self.arm.dq)[0] for dt in (0.0, 1e-6))
        return (b - a) / 1e-6

    @property
    def told(self) -> dict[str, str]:
        """What ``~/status`` says."""
        return values(self.statuses[-1])

    def brakes(self, is_over: Callable[[], Any]) -> float:
        """Tick until the arm was let alone; return how far [m] the tip went."""
        start = pose(self.arm.q)[0]
        self.sent.clear()
        positions = self.arm.ticks_until(is_over)
        last = self.sent[-1]
        assert np.abs(self.arm.dq).max() < AT_REST
        stamps = [ns_from_ros(command.header.stamp) for command in self.sent]
        assert sorted(set(stamps)) == list(positions)  # each state was answered until then
        assert_may_stay(last, self.arm, within=AT_REST)
        count = len(self.sent)
        self.arm._obey(last)
        self.arm.send_next(20)
        assert len(self.sent) == count  # silence
        return float(np.linalg.norm(pose(self.arm.q)[0] - start))


def ends_by(node: Moving, *transitions: str) -> Callable[[], bool]:
    """Make transitions while the arm moves; return what tells that the arm was let alone."""
    for transition in transitions:
        assert node.peer.change_state(node.name, transition)
    return lambda: node.told["mode"] in ("inactive", "finalized")


@pytest.mark.parametrize(
    ("executable", "transitions", "state"),
    [
        ("clik", ("deactivate",), "inactive"),
        ("clik", ("deactivate", "cleanup", "unconfigured_shutdown"), "finalized"),
        ("dynamic_control", ("deactivate",), "inactive"),
        ("dynamic_control", ("active_shutdown",), "finalized"),
        ("impedance_control", ("deactivate", "cleanup"), "unconfigured"),
    ],
)
def test_a_transition_that_ends_control_lets_the_arm_be_braked_after_it_has_returned(
    world, executable, transitions, state
):
    node = Moving(world, executable)
    is_over = ends_by(node, *transitions)
    assert node.peer.lifecycle_state(node.name) == state
    assert not is_over()
    assert node.brakes(is_over) < STOPPING_DISTANCE
    told = [values(status) for status in node.statuses]
    assert ("stopped", "deactivated") in [(one["mode"], one["cause"]) for one in told]
    if executable != "clik":  # a driver without a timeout holds the last effort
        rest = pose(node.arm.q)[0]
        for _ in range(500):
            node.arm._pass(0.001, None)
        assert np.linalg.norm(pose(node.arm.q)[0] - rest) < DRIFT
    if state == "unconfigured":
        assert node.peer.change_state(node.name, "configure")
    if state != "finalized":
        node.arm.dq = np.zeros(6)
        node.arm.send_next(20)
        assert node.peer.change_state(node.name, "activate")


@pytest.mark.parametrize("before", [(), ("deactivate",), ("deactivate", "cleanup")])
@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_a_signal_brings_the_arm_to_rest_also_one_that_is_being_deactivated(
    world, executable, before
):
    node = Moving(world, executable)
    ends_by(node, *before)
    assert not node.process.node.at_rest()
    assert node.brakes(lambda: world.act(node.process.node.at_rest)) < STOPPING_DISTANCE
    assert node.process.stop() == 0


def test_while_it_is_braked_an_arm_is_neither_led_nor_resumed_nor_taken_anew(world):
    node = Moving(world, "clik")
    assert node.peer.change_state("clik", "deactivate")
    assert node.references.get_subscription_count() == 0
    assert not node.peer.change_state("clik", "activate")
    assert "still being brought to rest" in node.process.log
    assert node.peer.change_state("clik", "cleanup")
    assert not node.peer.change_state("clik", "configure")
    assert node.brakes(lambda: node.told["mode"] == "inactive") < STOPPING_DISTANCE
    assert node.peer.change_state("clik", "configure")


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_an_arm_that_does_not_come_to_rest_is_let_alone_in_the_end(world, executable):
    node = Moving(world, executable)
    assert node.peer.change_state(executable, "deactivate")
    start = world.now
    while node.told["mode"] != "inactive":
        node.arm.t += 1_000_000
        node.arm.send(node.arm.message())  # it goes on as it did, whatever it is told
        world.advance(0.01)
        assert world.now < start + LONGEST + 0.6
    assert world.now > start + LONGEST + 0.3  # twice v / a more
    if executable == "dynamic_control":  # its brakes have to act, not an effort of a moment ago
        assert_may_stay(node.sent[-1], node.arm)


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_an_arm_that_tells_nothing_any_more_is_let_alone_at_once(world, executable):
    node = Moving(world, executable)
    assert node.peer.change_state(executable, "deactivate")
    world.advance(0.5)
    assert node.told["mode"] == "inactive"
    assert node.sent == []
