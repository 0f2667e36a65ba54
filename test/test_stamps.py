"""Drivers whose stamps stand: there is no time to move by, whatever the arm does."""

from typing import Any

import numpy as np
import pytest
from ros_processes import (
    FRAMES,
    HOME,
    STANDSTILL,
    Controlled,
    assert_holds,
    pose,
    reference,
    values,
)
from test_sources import REAL, Started, an_arm, go_on, says

from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.ros.senders import LOOK

REFUSED = "reference rejected: the stamp of joint_states stays"


def goal() -> Any:
    """Return a reference 2 cm above home, at once."""
    p, R = pose(HOME)
    return reference(DesiredFrame(p + [0.0, 0.0, 0.02], R), times=(0.5,))


def repeats(arm: Any, seconds: float) -> None:
    """Let an arm publish one state again and again."""
    for _ in range(round(seconds / 0.004)):
        arm.graph.advance(0.004)
        arm.send(arm.message())


@pytest.mark.parametrize("stamp", [0, 5_000_000_000])
def test_a_stamp_that_is_always_the_same_is_told_and_nothing_is_followed(world, stamp):
    arm = an_arm(world, "clik")
    arm.t = stamp
    node = Started(world, "clik", arm)
    references = world.peer.publisher(type(goal()), "reference")
    repeats(arm, LOOK + 0.5)
    status = says(node, "stamp_stuck", "holding", lambda: repeats(arm, 0.1))
    assert status.level == b"\x02"
    assert f"their stamp stays at {stamp / 1e9:g} s" in status.message
    assert "give each state the time" in values(status)["remedy"]
    references.publish(goal())
    repeats(arm, 0.5)
    assert REFUSED in node.process.log
    assert "following" not in node.process.log
    assert_holds(arm.commands[-1], HOME)


@pytest.mark.parametrize("executable", ["dynamic_control", "compliance_control"])
def test_under_a_stamp_that_is_always_the_same_no_efforts_act(world, executable):
    arm = an_arm(world, executable)
    arm.t = 0
    node = Started(world, executable, arm)
    repeats(arm, LOOK + 0.5)
    count = len(arm.commands)
    assert says(node, "stamp_stuck", "stopped", lambda: repeats(arm, 0.1))
    assert len(arm.commands) == count


def test_a_stamp_that_stays_when_a_motion_is_over_ends_it_until_stamps_go_on(world):
    node = Controlled(world, "clik", REAL)
    arm = node.arm
    node.references.publish(goal())
    arm.ticks(800)
    assert "following" in node.process.log
    arm.send_next()
    stood = world.now
    repeats(arm, 0.3)
    assert says(node, "stamp_stuck", "holding", lambda: repeats(arm, 0.1)).level == b"\x02"
    node.references.publish(goal())
    assert REFUSED in node.process.log
    arm.t += round((world.now - stood) * 1e9)
    go_on(arm, 0.1)
    node.references.publish(goal())
    assert says(node, "", "following", lambda: go_on(arm, 0.1))


def test_in_simulated_time_a_motion_waits_while_the_stamp_stays_and_that_is_told(world):
    node = Controlled(world, "clik", FRAMES)
    arm = node.arm
    node.follow(goal())
    arm.ticks(100)
    arm.send_next()
    repeats(arm, 1.0)
    status = says(node, "stamp_stuck", "holding", lambda: repeats(arm, 0.1))
    assert status.level == b"\x01"
    arm.tick()
    arm.ticks(3)
    assert np.abs(arm.dq).max() > STANDSTILL  # it goes on
    assert says(node, "", "following", lambda: arm.ticks(100))
