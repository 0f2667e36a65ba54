"""The node ``teleop``: keyboard or joystick (a SpaceMouse is one) jog the tip, on target_twist."""

import os
import re
import select
import sys
import termios
import tty
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Joy

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import ConfigurationError, InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.keys import WorkMode
from eulerparams_control.messages.to_ros import vector_to_ros
from eulerparams_control.parameters.teleop import JOY, NONE, TeleopParameters
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.publishers import refuse_two_publishers
from eulerparams_control.ros.qos import QOS, overridable
from eulerparams_control.ros.runtime import run

HELP = """
  w s  forward, back (x)   q e  up, down (z)   i k  pitch   hold a key to move,
  a d  left, right   (y)   u o  roll           j l  yaw     any other one stops"""
_KEYS = dict(zip("waquijsdeokl", np.vstack((np.eye(6), -np.eye(6))), strict=True))
_AXES = np.array(("x", "y", "z", "roll", "pitch", "yaw"))
_PERIOD, _NEUTRAL = 0.02, 0.01  # [s] between two twists; deflection that is none, at least
_SEQUENCE = re.compile(r"\x1b[\[O][0-9;]*.")  # an arrow, say, whose letters are no keys of ours


class Interlock:
    """Lets an axis pass once it was neutral while the dead-man button was pressed.

    So a trigger, or what is deflected when the button is pressed, moves nothing.  The button has
    to be seen released before.  ``waits_for`` names what has to be let go.
    """

    def __init__(self) -> None:
        self.lock()

    def lock(self) -> None:
        """Let nothing pass until the button was seen released, and then each axis neutral."""
        self.waits_for, self._was_released, self._was_neutral = "", False, np.zeros(6, dtype=bool)

    def passing(self, axes: Array, is_pressed: bool, neutral: float) -> Array:
        """Return the axes (6,), from -1 to 1, 0 where they may not pass; neutral within that."""
        self._was_released |= not is_pressed
        self._was_neutral |= np.abs(axes) <= neutral
        self._was_neutral &= is_pressed and self._was_released
        self.waits_for = ""
        if is_pressed and not self._was_neutral.all():
            names = ", ".join(_AXES[~self._was_neutral])
            self.waits_for = names if self._was_released else "the button"
        return np.where(self._was_neutral, axes, 0.0)


class TeleopNode(Node):
    """Publishes the twist that a person asks for, and zero once when it ends."""

    parameters_type = TeleopParameters

    def __init__(self) -> None:
        super().__init__("teleop")
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, self.parameters_type)
        self._wish, self._until, self._moves = np.zeros(6), 0.0, False  # from -1 to 1; until [s]
        self._interlock = Interlock()
        self._settings: Any = None  # of the terminal, to restore
        self._publisher = self.create_publisher(TwistStamped, "target_twist", QOS)
        if p.device == JOY:
            self._input = self.create_subscription(Joy, "joy", self._on_joy, **overridable(QOS))
        elif not sys.stdin.isatty():
            raise ConfigurationError(
                "keyboard needs a terminal: start it in one, or set device: joy"
            )
        else:
            self._settings = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            print(HELP, flush=True)
        self._health.set(diagnostics.OK, f"ready: {p.device}", mode=WorkMode.READY)
        self.create_timer(_PERIOD, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_joy(self, msg: Joy) -> None:
        now, axes, deadzone = steady.now(), np.zeros(6), self._params.deadzone
        if now > self._until:  # the first one, or after a silence
            self._interlock.lock()
        self._until = now + self._params.joy_timeout
        try:
            refuse_two_publishers(self, self._input)
            read, is_pressed = _read(msg, self._params)
            axes = self._interlock.passing(read, is_pressed, max(deadzone, _NEUTRAL))
            axes = np.sign(axes) * np.maximum(np.abs(axes) - deadzone, 0.0) / (1.0 - deadzone)
            if what := self._interlock.waits_for:
                self._health.complain(f"let go of {what}: what rests elsewhere is none of axes")
                self._health.warn(f"waiting for {what}")
        except InvalidMessageError as error:
            self._interlock.lock()
            self._health.reject("joy", error)
        self._wish = axes
        if not axes.any():
            self._send(axes)  # at once

    def _on_timer(self) -> None:
        if self._settings is not None and (keys := self._typed()):
            self._wish = _KEYS.get(keys[-1], np.zeros(6))
            self._until = steady.now() + self._params.key_timeout
        self._send(self._wish if steady.now() < self._until else np.zeros(6))

    def _typed(self) -> str:
        """Return all keys since the last time, lest a backlog plays on; a sequence is an escape."""
        found, file = b"", sys.stdin.fileno()
        while select.select([file], [], [], 0)[0] and (more := os.read(file, 100)):
            found += more
        return _SEQUENCE.sub("\x1b", found.decode(errors="replace"))

    def _send(self, axes: Array) -> None:
        """Publish a twist; zero once, and then nothing: others may lead."""
        if axes.any() or self._moves:
            msg = TwistStamped()
            msg.header.stamp = self.get_clock().now().to_msg()
            msg.header.frame_id = self._params.frame
            msg.twist.linear = vector_to_ros(self._params.linear_speed * axes[:3])
            msg.twist.angular = vector_to_ros(self._params.angular_speed * axes[3:])
            self._publisher.publish(msg)
        self._moves = bool(axes.any())

    def close(self) -> None:
        """Stop the tip, and give the terminal back."""
        self._send(np.zeros(6))
        if self._settings is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._settings)


def _read(msg: Joy, p: TeleopParameters) -> tuple[Array, bool]:
    """Return the axes (6,), and whether the dead-man button is pressed."""
    if max(p.axes) >= len(msg.axes) or p.deadman >= len(msg.buttons):
        found = f"{len(msg.axes)} axes and {len(msg.buttons)} buttons"
        raise InvalidMessageError(f"joy has {found}; expected more: set axes and deadman")
    axes = np.array([0.0 if i == NONE else msg.axes[i] for i in p.axes]) * p.signs
    if not np.isfinite(axes).all():
        raise InvalidMessageError(f"joy says {axes.tolist()}; expected finite numbers")
    return np.clip(axes, -1.0, 1.0), bool(msg.buttons[p.deadman])


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(TeleopNode, args, tells=False)
