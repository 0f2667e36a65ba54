"""The controller of a moving arm is killed: the robot brakes, and its successor goes on.

The nodes are in the process of the test, the robot moves in real time by its clock.  Processes that
are killed are in ``test_faulty_runs.py``.
"""

import numpy as np
import pytest
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


def stamp(message):
    return ns_from_ros(message.header.stamp) / 1e9


@pytest.mark.parametrize("name", CONTROLLERS)
def test_without_the_controller_the_robot_brakes_and_its_successor_begins_without_a_jump(
    world, name
):
    control, topic = ("torque", "joint_effort")
    if name == "clik":
        control, topic = ("position", "joint_reference")
    states = world.peer.listen(JointState, "joint_states")
    commands = world.peer.listen(JointState, topic)
    robot = {"control": control, "rate": RATE, "command_timeout": COMMAND_TIMEOUT}
    for node, parameters in ((BRIDGE, robot), ("reference", CIRCLE)):
        world.start(node, parameters)
    controller = world.start(name, CONTROLLERS[name])

    def is_faster(speed):
        return bool(states) and np.abs(states[-1].velocity).max() > speed

    world.until(lambda: is_faster(MOVES), "motion")
    controller.kill()
    words = f"no command for {COMMAND_TIMEOUT} s: braked"
    status = world.peer.status(BRIDGE, lambda s: words in s.message)
    assert status.level == b"\x02"
    assert "see whether the controller is alive" in values(status)["remedy"]
    world.until(lambda: not is_faster(STANDS), "standstill")
    braked = stamp(commands[-1]) + COMMAND_TIMEOUT + 5 / RATE
    assert all(np.abs(s.velocity).max() < STANDS for s in states if stamp(s) > braked)
    stopped = np.array(states[-1].position[:6])
    states.clear()
    commands.clear()
    successor = world.start(name, CONTROLLERS[name])
    world.until(lambda: len(commands) > 30, "commands")
    q = next(np.array(s.position[:6]) for s in states if stamp(s) == stamp(commands[0]))
    if control == "torque":
        assert_close(commands[0].effort, MODEL.dynamic_state(q, np.zeros(6)).g, BEARS)
    else:
        assert_close(commands[0].position, q, BEGINS_AT)
        assert_close(commands[0].velocity, 0, BEGINS_AT)
    world.peer.status(BRIDGE, lambda s: "commanded" in s.message)
    assert successor.exit_code is None
    reached = np.array([s.position[:6] for s in states])
    assert np.abs(reached - stopped).max() < 1e-3  # it was not moved by taking over [rad]
