"""Wrenches that come too seldom, or in other axes than those of the tip."""

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from ros_processes import FRAMES, HOME, MODEL, Controlled, values, wrench_stamped
from test_sources import Started, an_arm, go_on

NAME = "impedance_control"


def slow_sensor(arm: Any, every: int, burst: int = 1) -> Callable[[], None]:
    """Let the sensor of an arm publish once in so many states, in bursts: after each call."""
    arm.sensor.on, numbers = False, count(1)

    def send() -> None:
        if next(numbers) % every < burst:
            arm.sensor.wrenches.publish(arm.sensor.message(arm, arm.message().header.stamp))

    return send


def told(arm: Any, seconds: float, *others: Callable[[], None]) -> list[Any]:
    """Let time pass; return what the node says of itself meanwhile."""
    heard = arm.graph.peer.listen(DiagnosticArray, "/diagnostics")
    go_on(arm, seconds, *others, period=0.005)
    assert heard
    return [status for array in heard for status in array.status]


@pytest.mark.parametrize(
    ("every", "burst", "rate", "gap"),
    [
        (25, 1, "10", "0.125"),  # with the default period of 5 ms: 0.125 s
        (40, 1, "5", "0.2"),
        (200, 1, "1", "1"),
        (100, 8, "16", "0.465"),
    ],
)
@pytest.mark.parametrize("simulated", [False, True])
def test_a_sensor_whose_rate_is_too_low_is_told_its_rate_and_the_parameter(
    world, every, burst, rate, gap, simulated
):
    arm = an_arm(world, NAME)
    Started(world, NAME, arm, use_sim_time=simulated)
    send = slow_sensor(arm, every, burst)
    go_on(arm, 5.0, send, period=0.005)
    seen = told(arm, 3.0, send)
    assert {values(status)["cause"] for status in seen} == {"wrench_rate_too_low"}
    (message,) = {status.message for status in seen}
    assert f"has gaps of up to {gap} s, but wrench_timeout is 0.1 s" in message
    assert "let the sensor publish 20 times a second" in values(seen[0])["remedy"]
    assert f"set wrench_timeout to {2 * float(gap):.2g} s" in values(seen[0])["remedy"]
    assert arm.commands == []


def test_with_that_timeout_a_slow_sensor_is_believed(world):
    arm = an_arm(world, NAME)
    Started(world, NAME, arm, wrench_timeout=0.25)
    go_on(arm, 3.0, slow_sensor(arm, 25), period=0.005)
    assert arm.commands


def test_a_sensor_that_becomes_slow_freezes_the_frame_until_it_is_fast_again(world):
    arm = an_arm(world, NAME)
    Started(world, NAME, arm)
    go_on(arm, 2.0, period=0.005)
    assert arm.commands
    send = slow_sensor(arm, 25)
    go_on(arm, 1.0, send, period=0.005)
    statuses = told(arm, 2.0, send)
    assert {values(status)["cause"] for status in statuses} == {"wrench_rate_too_low"}
    assert "the compliant frame is frozen" in statuses[-1].message
    arm.sensor.on = True
    go_on(arm, 6.0, period=0.005)
    (*_, status) = told(arm, 2.0)
    assert values(status)["cause"] != "wrench_rate_too_low"
    assert "frozen" not in status.message


def test_one_gap_or_two_are_no_rate(world):
    node = Controlled(world, NAME, FRAMES)
    arm = node.arm
    for _ in range(2):
        arm.ticks(50)
        arm.sensor.on = False
        arm.ticks(150)
        assert values(node.status())["cause"] != "wrench_rate_too_low"
        arm.sensor.on = True
    arm.ticks(50)
    assert "frozen" not in node.status().message


# --- frames -------------------------------------------------------------------------------------
def measures(arm: Any, frame_id: str, axes: str = "tool0") -> None:
    """Let the sensor of an arm measure about the tip in the axes of a link, and name a frame."""

    def message(arm: Any, stamp: Any) -> Any:
        R = MODEL.link_at(axes, arm.q).R
        w = (arm.contact().reshape(2, 3) @ R).ravel()
        w[5] += 1e-12 * (stamp.nanosec // 1_000_000 % 7)  # it is no sensor that is stuck
        return wrench_stamped(*w, frame=frame_id, stamp=stamp)

    arm.sensor.message = message


def test_that_the_frame_of_a_wrench_without_one_is_assumed_is_told(world):
    arm = an_arm(world, NAME)
    measures(arm, frame_id="")
    node = Started(world, NAME, arm)
    (*_, status) = told(arm, 2.0)
    assert values(status)["wrench frame"].startswith("tool0, assumed: the frame_id of the wrench")
    assert arm.commands
    assert node.process.log.count("is taken to be in tool0") == 1
    measures(arm, frame_id="ee_link")
    (*_, status) = told(arm, 2.0)
    assert values(status)["wrench frame"] == "ee_link"


@pytest.mark.parametrize("frame", ["base_link", "base", "forearm_link"])
def test_a_wrench_in_axes_that_the_arm_turns_is_refused_with_what_turns_it_rightly(world, frame):
    arm = an_arm(world, NAME)
    measures(arm, frame_id=frame)
    node = Started(world, NAME, arm)
    go_on(arm, 1.0)
    assert f"the frame '{frame}' is not fixed to the tip 'tool0'" in node.process.log
    assert f"set wrench_axes to {frame}; wrench_frame would turn its" in node.process.log
    assert arm.commands == []


def test_a_frame_that_is_no_link_is_refused_with_wrench_frame(world):
    arm = an_arm(world, NAME)
    measures(arm, frame_id="ft_sensor")
    node = Started(world, NAME, arm)
    go_on(arm, 0.5)
    assert "set wrench_frame if the driver names another frame than the URDF" in node.process.log


@pytest.mark.parametrize("link", ["base_link", "base", "forearm_link"])
def test_a_wrench_about_the_tip_in_the_axes_of_a_link_is_turned_by_the_kinematics(world, link):
    arm = an_arm(world, NAME)
    Started(world, NAME, arm, wrench_axes=link, max_activation_force=100.0)
    measures(arm, frame_id="anything", axes=link)
    arm.push(3.0, -5.0, 7.0, 0.1, 0.2, -0.3)  # base axes, about the tip
    go_on(arm, 1.5)
    node = world.running[-1].node
    scheme = node._controller.scheme
    for q in (HOME, HOME + 0.01 * np.arange(6.0)):
        arm.q = q
        go_on(arm, 0.3)
        tick = scheme.chain.contact(node._sensor.fresh, MODEL.state(q, 0.0 * q), None, 0.004)
        np.testing.assert_allclose(tick, [3.0, -5.0, 7.0, 0.1, 0.2, -0.3], atol=1e-6)
    (*_, status) = told(arm, 2.0)
    assert values(status)["wrench frame"] == f"about tool0, axes of {link}"
