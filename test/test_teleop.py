"""``teleop``: keyboard, joystick and SpaceMouse to ``target_twist``, and when it stops."""

import math
import os
import pty
import termios
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from in_process import Running, World
from ros_processes import values
from sensor_msgs.msg import Joy

from eulerparams_control.messages.from_ros import twist_from_ros

SPEEDS = np.array([0.1] * 3 + [0.4] * 3)
TICK = 0.02  # [s] of its timer


def numbers(msg: TwistStamped) -> list[float]:
    return list(twist_from_ros(msg, np.eye(3)))


class Sent(list[Any]):
    """The twists that were sent."""

    @property
    def last(self) -> list[float]:
        return numbers(self[-1])

    def assert_ended(self, world: World) -> None:
        """Hold that zero was sent once, and then nothing."""
        assert self.last == [0.0] * 6
        assert any(numbers(self[-2]))
        count = len(self)
        world.advance(1.0)
        assert len(self) == count


def start(world: World, **parameters: Any) -> tuple[Running, Sent]:
    sent = Sent()
    world.peer.node.create_subscription(TwistStamped, "target_twist", sent.append, 100)
    return world.start("teleop", parameters), sent


# --- devices -----------------------------------------------------------------------------------
def joy(*axes: float, pressed: bool = True) -> Joy:
    return Joy(axes=[*axes, *[0.0] * (6 - len(axes))], buttons=[0, 0, 0, 0, int(pressed)])


def press(world: World, stick: Any, *axes: float) -> None:
    """Release the dead-man button, then press it, with the axes elsewhere than neutral."""
    for pressed in (False, True):
        stick.publish(joy(*axes, pressed=pressed))
        world.advance(TICK)


TRIGGER = (0.0, 0.0, 0.0, 0.0, 1.0)  # it is the axis of z


def test_a_trigger_that_rests_at_1_moves_nothing_and_is_named(world):
    process, sent = start(world, device="joy")
    stick = world.peer.publisher(Joy, "joy")
    press(world, stick, *TRIGGER)
    assert not sent
    assert "waiting for axes that were not neutral since the start or the dead-man" in process.log
    assert "z at 1.00; let go of them" in process.log
    stick.publish(joy(0.0, 1.0, 0.0, 0.0, 1.0))  # the other axes move the tip
    world.advance(TICK)
    assert sent.last == pytest.approx([0.1, 0, 0, 0, 0, 0])
    assert "z at 1.00" in values(world.peer.status("teleop"))["waits for"]


@pytest.mark.parametrize("rest", [0.06, -0.2, 1.0, -1.0])
def test_an_axis_that_is_off_neutral_when_the_button_is_pressed_waits_until_it_was_there(
    world, rest
):
    _, sent = start(world, device="joy")
    stick = world.peer.publisher(Joy, "joy")
    press(world, stick, rest)
    stick.publish(joy(-rest))  # it has jumped over the middle
    world.advance(TICK)
    assert not sent
    stick.publish(joy(0.04))
    world.advance(TICK)
    stick.publish(joy(1.0))
    world.advance(TICK)
    assert sent.last == pytest.approx([0, 0.1, 0, 0, 0, 0])


def test_an_axis_has_to_be_neutral_each_time_that_the_button_is_pressed(world):
    _, sent = start(world, device="joy")
    stick = world.peer.publisher(Joy, "joy")
    press(world, stick)
    stick.publish(joy(1.0))
    world.advance(TICK)
    assert sent.last == pytest.approx([0, 0.1, 0, 0, 0, 0])
    press(world, stick, 1.0)
    sent.assert_ended(world)


def test_a_button_that_is_pressed_from_the_start_has_to_be_released(world):
    process, sent = start(world, device="joy")
    stick = world.peer.publisher(Joy, "joy")
    for axis in (0.0, 1.0):
        stick.publish(joy(axis))
        world.advance(TICK)
    assert not sent
    assert "waiting for the dead-man button, pressed from the start: release it" in process.log


@pytest.mark.parametrize("event", ["silence", "fewer axes"])
def test_a_joystick_that_comes_back_begins_anew(world, event):
    _, sent = start(world, device="joy", joy_timeout=0.2)
    stick = world.peer.publisher(Joy, "joy")
    press(world, stick)
    stick.publish(joy(1.0))
    world.advance(TICK)
    assert any(sent.last)
    if event == "silence":
        world.advance(0.3)
    else:
        stick.publish(Joy(axes=[0.0], buttons=[0] * 5))
    for axis in (1.0, 0.0, 1.0):  # the button is still pressed
        stick.publish(joy(axis))
        world.advance(TICK)
    sent.assert_ended(world)


@pytest.mark.parametrize("device", ["spacenav", "joy"])
def test_a_device_without_a_dead_man_button_is_neutral_first(world, device):
    _, sent = start(world, device=device, deadman=-1)
    kind, topic = (Joy, "joy") if device == "joy" else (Twist, "spacenav/twist")
    twist = Twist()
    twist.linear.x = 1.0
    moved, still = (twist, Twist()) if device == "spacenav" else (joy(0.0, 1.0), joy())
    source = world.peer.publisher(kind, topic)
    for _ in range(2):
        source.publish(moved)
        world.advance(TICK)
    assert not sent
    for msg in (still, moved):
        source.publish(msg)
        world.advance(TICK)
    assert sent.last == pytest.approx([0.1, 0, 0, 0, 0, 0])


def test_a_joystick_moves_the_tip_while_its_deadman_button_is_pressed_and_it_is_not_silent(world):
    signs = [1.0, -1.0, 1.0, 1.0, 1.0, 0.5]
    _, sent = start(world, device="joy", frame="tool0", signs=signs, joy_timeout=0.2)
    stick = world.peer.publisher(Joy, "joy")
    press(world, stick)
    for _ in range(5):
        stick.publish(joy(0.525, 1.0, 0.0, 1.0))  # y, x, -, turn about z
        world.advance(TICK)
    assert len(sent) == 5
    assert sent[-1].header.frame_id == "tool0"
    np.testing.assert_allclose(sent.last, SPEEDS * [1, -0.5, 0, 0, 0, 9 / 19], atol=1e-6)
    stick.publish(joy(0.525, 1.0, 0.0, 1.0, pressed=False))
    world.advance(TICK)
    sent.assert_ended(world)
    press(world, stick)
    stick.publish(joy(1.0))  # then it falls silent
    world.advance(0.15)
    assert sent.last[1] == pytest.approx(-0.1)
    world.advance(0.1)
    sent.assert_ended(world)


@pytest.mark.parametrize(
    ("msg", "words"),
    [
        (Joy(axes=[1.0, 1.0], buttons=[1] * 5), "joy has 2 axes and 5 buttons; expected the axes"),
        (Joy(axes=[1.0] * 6, buttons=[1]), "the deadman button 4: set axes and deadman"),
        (joy(math.nan), "expected finite numbers"),
    ],
)
def test_a_joystick_that_does_not_fit_stops_the_tip_and_is_said(world, msg, words):
    process, sent = start(world, device="joy")
    stick = world.peer.publisher(Joy, "joy")
    press(world, stick)
    stick.publish(joy(1.0))
    world.advance(TICK)
    stick.publish(msg)
    assert words in process.log
    world.advance(TICK)
    sent.assert_ended(world)
    assert values(world.peer.status("teleop"))["joy rejected"] == "1"
    world.peer.another_node("second").create_publisher(Joy, "joy", 10).publish(joy(1.0))
    assert "two publishers on 'joy': /peer, /second; expected one" in process.log


def test_a_spacemouse_moves_the_tip_and_what_it_says_is_bounded(world):
    _, sent = start(world, device="spacenav", deadzone=0.0)
    mouse = world.peer.publisher(Twist, "spacenav/twist")
    mouse.publish(Twist())
    msg = Twist()
    msg.linear.x, msg.linear.z, msg.angular.y = 0.5, -7.0, 0.25
    mouse.publish(msg)
    world.advance(TICK)
    np.testing.assert_allclose(sent.last, SPEEDS * [0.5, 0, -1, 0, 0.25 * 1, 0], atol=1e-9)
    mouse.publish(Twist())
    world.advance(TICK)
    sent.assert_ended(world)


# --- the keyboard ----------------------------------------------------------------------------
@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, int]]:
    """A terminal as the standard input: what a person types into, and what is read."""
    types, reads = pty.openpty()
    with os.fdopen(reads, closefd=False) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield types, reads
    os.close(types)
    os.close(reads)


def test_a_key_moves_the_tip_until_it_is_released(world, terminal):
    types, reads = terminal
    before = termios.tcgetattr(reads)
    process, sent = start(world)
    assert not termios.tcgetattr(reads)[3] & termios.ICANON  # single keys
    assert not termios.tcgetattr(reads)[3] & termios.ECHO
    for _ in range(10):  # as a terminal repeats it
        os.write(types, b"w")
        world.advance(0.033)
    assert sent.last == pytest.approx([0.1, 0, 0, 0, 0, 0])
    world.advance(0.12)
    sent.assert_ended(world)
    for keys, expected in (
        (b"s", [-0.1, 0, 0, 0, 0, 0]),
        (b"q", [0, 0, 0.1, 0, 0, 0]),
        (b"l", [0, 0, 0, 0, 0, -0.4]),
        (b"+i", [0, 0, 0, 0, 0.5, 0]),
        (b"--d", [0, -0.08, 0, 0, 0, 0]),
    ):
        os.write(types, keys)
        world.advance(TICK)
        assert sent.last == pytest.approx(expected), keys
    assert process.stop() == 0
    assert sent.last == [0.0] * 6
    assert termios.tcgetattr(reads) == before


@pytest.mark.parametrize("keys", [b" ", b"x", b"\x1b[A", b"\x1bOd", b"\x1b[1;5d", b"\xff"])
def test_any_other_key_stops_the_tip_also_one_that_sends_letters(world, terminal, keys):
    _, sent = start(world)
    os.write(terminal[0], b"w")
    world.advance(TICK)
    assert any(sent.last)
    os.write(terminal[0], keys)
    world.advance(TICK)
    sent.assert_ended(world)
