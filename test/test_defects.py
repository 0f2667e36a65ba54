"""A defect anywhere, or a halt: the arm is held or brought to rest, and the reason is said."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped
from in_process import World
from ros_processes import FRAMES, HOME, Controlled, Graph, assert_may_stay, pose, reference, values
from std_srvs.srv import Trigger

from eulerparams_control.control.judge import AT_REST
from eulerparams_control.messages.from_ros import ns_from_ros, quaternion_from_ros, vector_from_ros
from eulerparams_control.motion.frames import DesiredFrame

DT = 0.001  # [s] of a tick: an arm that is at rest moves less than AT_REST in it


def moving(graph: World | Graph, executable: str) -> Controlled:
    """Return a controller with a defect, and its arm on its way."""
    node = Controlled(graph, executable, FRAMES)
    p, R = pose(HOME)
    node.follow(reference(DesiredFrame(p + [0.0, 0.0, 0.1], R), times=(1.0,)))
    return node


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_a_defect_outside_the_law_ends_the_node_with_the_arm_at_rest_and_one_line(
    graph, executable
):
    node = moving(graph, f"{executable} broken in timer")
    sent = node.peer.listen(type(node.arm.tick()), f"/{node.arm.topic}")
    graph.until(lambda: node.arm.tick() and sent, "a command that is heard")
    positions = node.arm.ticks_until(lambda: node.process.exit_code is not None)
    assert node.process.end() == 1
    assert np.abs(node.arm.dq).max() < AT_REST
    lines = [line for line in node.process.stderr.splitlines() if "error: internal error" in line]
    assert len(lines) == 1
    assert "planted in a timer (broken_node.py:" in lines[0]
    assert "Traceback" not in node.process.log
    graph.until(lambda: ns_from_ros(sent[-1].header.stamp) in positions, "the last command")
    node.arm.q = positions[ns_from_ros(sent[-1].header.stamp)]
    assert_may_stay(sent[-1], node.arm, within=AT_REST * DT)


def test_that_limits_change_most_commands_is_said(world):
    slack = {"max_joint_acceleration": [0.05], "max_error_position": 10.0, "max_deviation": 10.0}
    node = Controlled(world, "clik", FRAMES | slack | {"max_error_rotation": 3.0})
    p, R = pose(HOME)
    sides = [0.04, -0.04]

    def hurries() -> bool:
        sides.reverse()
        node.references.publish(reference(DesiredFrame(p + [0.0, sides[0], 0.0], R), times=(0.5,)))
        node.arm.ticks(60)
        return "limits have changed" in node.process.log

    world.until(hurries, "that most commands are changed")
    assert "commands of the last second: the motion is faster than the arm" in node.process.log


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_an_arm_that_is_halted_says_so_and_is_resumed_when_it_is_at_rest(world, executable):
    node = Controlled(world, executable, FRAMES)
    p, R = pose(HOME)
    node.follow(reference(DesiredFrame(p + [0.0, 0.0, 0.1], R), times=(1.0,)))
    node.arm.ticks(300)

    def ask(service: str) -> tuple[bool, str]:
        response = node.peer.call(Trigger, f"/{executable}/{service}", Trigger.Request())
        return response.success, response.message

    assert ask("halt")[0]
    done, why = ask("resume")
    assert not done
    assert "ask when it is at rest" in why
    status = values(node.status(lambda s: values(s)["mode"] == "stopped"))
    assert (status["cause"], status["remedy"]) == ("halt", "call ~/resume")
    poses = node.peer.listen(PoseStamped, f"{executable}/pose")
    errors = node.peer.listen(TwistStamped, f"{executable}/error")
    node.arm.ticks(1000)
    assert np.abs(node.arm.dq).max() < AT_REST
    assert errors  # while it braked
    errors.clear()
    pushed = node.arm.q + 1e-4
    for _ in range(50):
        node.arm.tick(pushed)
    p, R = pose(pushed)
    last = poses[-1].pose
    np.testing.assert_allclose(vector_from_ros(last.position), p, atol=1e-9)
    np.testing.assert_allclose(quaternion_from_ros(last.orientation).R, R, atol=1e-9)
    assert not errors
    assert ask("resume")[0]
    assert values(node.status())["mode"] == "holding"


def test_a_controller_that_is_not_active_has_nothing_to_halt_or_resume(world):
    world.start("clik", {**FRAMES, "autostart": False})
    for service in ("halt", "resume"):
        response = world.peer.call(Trigger, f"/clik/{service}", Trigger.Request())
        assert not response.success
        assert "not active" in response.message
