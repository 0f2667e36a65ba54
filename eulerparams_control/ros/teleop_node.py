"""The node ``teleop``: keyboard or joystick (a SpaceMouse is one) jog the tip, on target_twist."""

import os
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


class TeleopNode(Node):
    """Publishes the twist that a person asks for, and zero once when it ends."""

    parameters_type = TeleopParameters

    def __init__(self) -> None:
        super().__init__("teleop")
        self.done = False
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, self.parameters_type)
        self._wish, self._until, self._moves = np.zeros(6), 0.0, False  # from -1 to 1; until [s]
        self._settings: Any = None  # of the terminal, to restore
        self._publisher = self.create_publisher(TwistStamped, "target_twist", QOS)
        if p.device == JOY:
            self._input = self.create_subscription(Joy, "joy", self._on_joy, **overridable(QOS))
        elif not sys.stdin.isatty():
            raise ConfigurationError("keyboard needs a terminal: use ros2 run, or device: joy")
        else:
            self._settings = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            print(HELP, flush=True)
        self._health.set(diagnostics.OK, f"ready: {p.device}", mode=WorkMode.READY)
        self.create_timer(_PERIOD, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _lock(self) -> None:
        """Let nothing pass until the button was seen released, and then each axis neutral."""
        self._was_released, self._was_neutral = False, np.zeros(6, dtype=bool)

    def _on_joy(self, msg: Joy) -> None:
        now, axes, deadzone = steady.now(), np.zeros(6), self._params.deadzone
        if now > self._until:  # the first one, or after a silence
            self._lock()
        self._until = now + self._params.joy_timeout
        try:
            refuse_two_publishers(self, self._input)
            axes, is_pressed = _read(msg, self._params)
            self._was_released |= not is_pressed
            self._was_neutral |= np.abs(axes) <= max(deadzone, _NEUTRAL)
            self._was_neutral &= is_pressed and self._was_released
            beyond = np.maximum(np.abs(axes) - deadzone, 0.0) / (1.0 - deadzone)
            axes = np.where(self._was_neutral, np.sign(axes) * beyond, 0.0)
            if is_pressed and not self._was_neutral.all():
                what = ", ".join(_AXES[~self._was_neutral]) if self._was_released else "the button"
                self._health.complain(f"let go of {what}: what rests elsewhere is none of axes")
                self._health.warn(f"waiting for {what}")
        except InvalidMessageError as error:
            self._lock()
            self._health.reject("joy", error)
        self._wish = axes
        if not axes.any():
            self._send(axes)  # at once

    def _on_timer(self) -> None:
        if self._settings is not None and select.select([sys.stdin], [], [], 0)[0]:
            keys = os.read(sys.stdin.fileno(), 100).decode(errors="replace")  # an arrow has letters
            self._wish = _KEYS.get("" if "\x1b" in keys else keys[-1:], np.zeros(6))
            self._until = steady.now() + self._params.key_timeout
        self._send(self._wish if steady.now() < self._until else np.zeros(6))

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


if __name__ == "__main__":
    sys.exit(main())
