"""``teleop``: keyboard and joystick to ``target_twist``, and when it stops."""

import math
import os
import pty
import termios

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import Joy

from eulerparams_control.messages.from_ros import twist_from_ros

TICK = 0.02  # [s] of its timer


class Stick:
    """A joystick, its node, and the twists that were sent."""

    def __init__(self, world, **parameters):
        self.world, self.sent = world, []
        world.peer.node.create_subscription(TwistStamped, "target_twist", self.sent.append, 100)
        self.process = world.start("teleop", {"device": "joy"} | parameters)
        self.publisher = world.peer.publisher(Joy, "joy")

    def say(self, *axes, pressed=True):
        axes = [*axes, *[0.0] * (6 - len(axes))]
        self.publisher.publish(Joy(axes=axes, buttons=[0, 0, 0, 0, int(pressed)]))

    def press(self, *axes):
        """Release the dead-man button, then press it, with the axes elsewhere than neutral."""
        self.say(*axes, pressed=False)
        self.moves(*axes)

    def moves(self, *axes):
        """Return the twist that is sent for axes."""
        self.say(*axes)
        self.world.advance(TICK)
        return self.last()

    def last(self, place=-1):
        return twist_from_ros(self.sent[place], np.eye(3)).tolist() if self.sent else []

    def assert_ended(self):
        """Hold that zero was sent once, and then nothing."""
        assert self.last() == [0.0] * 6
        assert any(self.last(-2))
        count = len(self.sent)
        self.world.advance(1.0)
        assert len(self.sent) == count


@pytest.mark.parametrize("rest", [0.06, -0.2, 1.0])
def test_an_axis_moves_nothing_until_it_was_neutral_while_the_button_was_pressed(world, rest):
    stick = Stick(world)
    stick.press(rest, 0.0, 0.0, 0.0, 1.0)  # and a trigger, which is the axis of z
    assert not stick.moves(-rest, 0.0, 0.0, 0.0, 1.0)  # it has jumped over the middle
    assert "let go of y, z: what rests elsewhere is none of axes" in stick.process.log
    assert stick.moves(0.04, 1.0, 0.0, 0.0, 1.0) == pytest.approx([0.1, 0, 0, 0, 0, 0])
    assert stick.moves(1.0, 0.0, 0.0, 0.0, 1.0) == pytest.approx([0, 0.1, 0, 0, 0, 0])
    stick.press(1.0)  # again, each time that it is pressed
    stick.assert_ended()


def test_a_button_that_is_let_go_sends_zero_at_once_and_silence_does_after_a_timeout(world):
    stick = Stick(world, frame="tool0", signs=[1.0, -1.0, 1.0, 1.0, 1.0, 0.5], joy_timeout=0.2)
    stick.press()
    twist = stick.moves(0.525, 1.0, 0.0, 1.0)  # y, x, -, turn about z
    np.testing.assert_allclose(twist, [0.1, -0.05, 0, 0, 0, 0.4 * 9 / 19], atol=1e-6)
    assert stick.sent[-1].header.frame_id == "tool0"
    stick.say(0.525, 1.0, 0.0, 1.0, pressed=False)
    stick.assert_ended()
    stick.press()
    stick.say(1.0)
    world.advance(0.15)
    assert stick.last()[1] == pytest.approx(-0.1)
    world.advance(0.1)
    stick.assert_ended()


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (None, ""),
        (Joy(axes=[1.0] * 2, buttons=[1] * 5), "2 axes and 5 buttons; expected more: set axes and"),
        (Joy(axes=[1.0] * 6, buttons=[1]), "6 axes and 1 buttons; expected more: set axes and"),
        (Joy(axes=[math.nan] * 6, buttons=[1] * 5), "expected finite numbers"),
    ],
)
def test_after_a_silence_or_what_is_refused_button_and_axes_have_to_be_let_go(world, event, words):
    stick = Stick(world)
    stick.press()
    assert any(stick.moves(1.0))
    world.advance(0.3) if event is None else stick.publisher.publish(event)
    assert words in stick.process.log
    for axis in (1.0, 0.0, 1.0):  # the button is pressed still
        stick.say(axis)
    stick.assert_ended()
    assert "let go of the button" in stick.process.log
    stick.press()
    assert any(stick.moves(1.0))
    world.peer.another_node("second").create_publisher(Joy, "joy", 10).publish(Joy())
    assert "two publishers on 'joy': /peer, /second; expected one" in stick.process.log
    stick.assert_ended()


def test_a_key_moves_the_tip_until_it_is_released_or_any_other_is_pressed(world, monkeypatch):
    types, reads = pty.openpty()
    before = termios.tcgetattr(reads)
    with os.fdopen(reads) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        stick = Stick(world, device="keyboard")
        assert not termios.tcgetattr(reads)[3] & (termios.ICANON | termios.ECHO)  # single keys
        for key, axis in zip("waquijsdeokl", [*range(6)] * 2, strict=True):
            os.write(types, key.encode())
            world.advance(TICK)
            assert np.flatnonzero(stick.last()) == [axis]
            assert stick.last()[axis] == (0.1 if axis < 3 else 0.4) * (1 if key in "waquij" else -1)
        world.advance(0.12)
        for other in (b" ", b"x", b"\x1b[A", b"\x1bOd", b"\x1b[1;5d", b"\xff", b"w"):
            stick.assert_ended()
            for keys in (b"w", other):
                os.write(types, keys)
                world.advance(TICK)
        for backlog in (250 * b"w" + b"x", 98 * b"w" + b"\x1bOd"):  # more than one read
            os.write(types, b"w")
            world.advance(TICK)
            os.write(types, backlog)
            world.advance(TICK)
            stick.assert_ended()
        os.write(types, b"\x1b[A" + b"w")  # the last key counts
        world.advance(TICK)
        assert stick.last()[0] == 0.1
        assert stick.process.stop() == 0
        assert stick.last() == [0.0] * 6
        assert termios.tcgetattr(reads) == before
    os.close(types)
