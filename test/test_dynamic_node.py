"""The node ``dynamic_control`` as its users run it: what it has of its own.

What it has in common with the other control nodes is in ``test_nodes.py``.  Its arm is moved
by the test, as its dynamics say.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from in_process import World
from ros_processes import (
    FRAMES,
    HOME,
    MODEL,
    UR5,
    Array,
    Controlled,
    FeelingArm,
    TorqueArm,
    assert_holds,
    efforts_of,
    pose,
    reference,
    values,
)
from samples import by_angles, rodrigues
from std_msgs.msg import Float64MultiArray
from tolerances import LAW_IN_A_NODE

from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.messages.to_ros import motion_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Circle

DT = 0.001  # [s] of a tick

# Rounding of the difference of two efforts of up to 150 Nm.
EFFORT_ROUNDING = 1e-12

# What an unknown tool of 1 kg leaves of the errors at the default gains, m and rad: its
# weight over the inertia and the gain, 9.81 / 400 at most for the position.
TOOL_POSITION, TOOL_ROTATION = 9.81 / 400, 0.05


@pytest.fixture(scope="module")
def shared(shared_world: World) -> Controlled:
    """A controller that the tests of this module share; it runs with its defaults."""
    return Controlled(shared_world, "dynamic_control", FRAMES)


@pytest.fixture
def node(shared: Controlled) -> Iterator[Controlled]:
    """The shared controller, active and holding the home position."""
    shared.arm.start_anew()
    yield shared
    shared.restore()


def steps_of(efforts: Array) -> Array:
    """Return the largest change [Nm] of an effort from tick to tick."""
    return np.abs(np.diff(efforts, axis=0)).max(axis=1)


def assert_follows(node: Controlled) -> None:
    """Assert that the next reference is followed from where the arm is."""
    p, R = pose(node.arm.q)
    node.follow(reference(DesiredFrame(p + [0.0, 0.0, 0.02], R), times=(0.2,)))
    node.arm.ticks(800)
    p_e, R_e = pose(node.arm.q)
    assert np.linalg.norm(p_e - p - [0.0, 0.0, 0.02]) < LAW_IN_A_NODE
    assert angle_between(R_e, R) < LAW_IN_A_NODE
    assert node.status().message.endswith(": following a reference")


# --- limits ----------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_no_effort_changes_faster_than_its_limit_and_saturation_is_reported(
    node: Controlled, rate: float
) -> None:
    before = int(values(node.status(lambda s: "saturated ticks" in values(s)))["saturated ticks"])
    node.change(max_effort_rate=rate)
    hold = node.arm.tick()
    p, R = pose(HOME)
    node.references.publish(reference(DesiredFrame(p + [0.0, 0.0, 0.04], R)))  # 16 m/s^2
    steps = steps_of(efforts_of([hold, *node.arm.ticks(100)]))
    assert steps.max() == pytest.approx(rate * DT, abs=EFFORT_ROUNDING)
    ticks = np.count_nonzero(steps > rate * DT - EFFORT_ROUNDING)
    assert ticks > 5
    found = node.status(lambda s: int(values(s)["saturated ticks"]) >= before + ticks)
    assert values(found)["orientation"] == "euler_parameters"


def test_no_effort_exceeds_the_limit_of_its_joint(node: Controlled) -> None:
    node.change(k_Pp=1e4, k_Vp=200.0, max_effort_rate=1e6)
    node.arm.tick()
    p, R = pose(HOME)
    node.references.publish(reference(DesiredFrame(p + [0.0, 0.0, 0.04], R)))  # 400 m/s^2
    efforts = efforts_of(node.arm.ticks(100))
    assert (np.abs(efforts).max(axis=0) == MODEL.limits.effort).sum() >= 2


def test_an_arm_that_is_blocked_is_not_pushed_on_but_held_and_the_reason_said(
    node: Controlled,
) -> None:
    arm = node.arm
    p, R = pose(HOME)
    node.references.publish(reference(DesiredFrame(p + [0.0, 0.0, 0.3], R), times=(0.5,)))
    commands = [arm.tick(HOME) for _ in range(400)]
    status = node.status(lambda s: "holding still" in s.message)
    assert status.level == b"\x02"
    assert "m from the desired frame; at most 0.1 m is allowed: is the arm braked" in status.message
    assert steps_of(efforts_of(commands)).max() <= 1e4 * DT + EFFORT_ROUNDING
    assert np.abs(commands[-1].effort).max() > 0
    assert_holds(commands[-1], HOME)
    assert_follows(node)


# --- Euler angles at their singularity -------------------------------------------------------


@pytest.mark.parametrize("orientation", ["euler_angles", "euler_parameters"])
def test_past_the_pole_the_error_of_euler_angles_stops_the_arm_and_nothing_jumps(
    node: Controlled, orientation: str
) -> None:
    arm, bound = node.arm, 0.06
    node.change(orientation=orientation, k_Po=10.0, max_error_rotation=bound)
    p = np.array([0.485, 0.07, 0.425])
    start, end = (  # the pole of XYZ is halfway
        DesiredFrame(p, by_angles("ZYZ", 0.0, math.radians(beta), math.pi / 2))
        for beta in (80.0, 100.0)
    )
    off = rodrigues(0.05, np.array([0.0, 0.0, 1.0]))  # an error that k_Po lets last
    commands = [arm.start_anew(inverse_kinematics(MODEL, DesiredFrame(p, off @ start.R_d), HOME))]
    node.references.publish(reference(start, end, times=(0.0, 0.4)))
    commands += arm.ticks(800)
    steps = steps_of(efforts_of(commands))
    assert steps.max() <= 1e4 * DT + EFFORT_ROUNDING
    status = node.status(lambda s: True)
    if orientation == "euler_parameters":
        assert status.message == "active with euler_parameters: following a reference"
        assert steps.max() < 0.2
        return
    assert status.level == b"\x02"
    assert "deg from the desired frame; at most 3.4 deg is allowed" in status.message
    assert "holding still: the tip is turned by" in status.message
    assert "or the orientation singular? then send the reference again" in status.message
    arm.ticks(100, dt=0.01)
    assert np.abs(arm.dq).max() < 1e-3
    node.restore()
    assert_follows(node)


# --- types of commands -----------------------------------------------------------------------


def test_the_command_can_be_an_array_of_efforts(world: World) -> None:
    arm = TorqueArm(world, UR5, command=Float64MultiArray)
    world.start("dynamic_control", {**FRAMES, "command_type": "forward", "use_sim_time": True})

    world.until(lambda: (arm.send(arm.message()), arm.commands)[1], "a command")
    gravity = MODEL.dynamic_state(HOME, np.zeros(6)).g
    assert arm.commands[0].data.tolist() == pytest.approx(gravity.tolist(), rel=1e-9)


# --- changes while running -------------------------------------------------------------------


def test_changes_of_the_law_and_its_limits_while_the_arm_moves_make_no_jump(world: World) -> None:
    rate = 500.0
    changes: list[dict[str, Any]] = [
        {"orientation": "euler_angles"},
        {"euler_sequence": "ZYX"},
        {"k_Pp": 900.0, "k_Vp": 60.0},
        {"orientation": "rotation_vector"},
        {"k_Po": 400.0, "k_Vo": 30.0},
        {"damping_eps": 0.3, "damping_max": 0.1},
        {"velocity_scale": 0.8, "max_effort_rate": 400.0, "max_error_position": 0.08},
        {"orientation": "euler_parameters"},
    ]
    node = Controlled(world, "dynamic_control", FRAMES | {"max_effort_rate": rate}, arm=FeelingArm)
    arm = node.arm
    motion = Circle(0.05, np.array([1.0, 0.0, 0.0]), 2.0, tilt=0.3, ramp=0.5).trajectory(
        *pose(HOME)
    )
    msg, start = motion_to_ros(motion, *FRAMES.values()), arm.t
    msg.header.stamp = arm.message().header.stamp
    node.references.publish(msg)
    arm.carry(1.0, np.array([0.0, 0.05, 0.1]))  # it is unknown: there are errors
    commands = []
    for change in ({}, *changes):
        node.change(**change)
        for _ in range(150):
            commands.append(arm.tick())
            desired = motion.sample((arm.t - start) / 1e9)
            p, R = pose(arm.q)
            assert np.linalg.norm(p - desired.p_d) < TOOL_POSITION
            assert angle_between(R, desired.R_d) < TOOL_ROTATION
    assert steps_of(efforts_of(commands)).max() <= rate * DT + EFFORT_ROUNDING
    status = node.status(lambda s: "saturated ticks" in values(s))
    assert values(status)["saturated ticks"] == "0"  # and it is not the limit that prevents it
    assert node.process.stop() == 0
