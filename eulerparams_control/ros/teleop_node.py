"""The node ``teleop``: keyboard, joystick or SpaceMouse move the tip, on ``target_twist``."""

import math
import os
import re
import select
import sys
import termios
import tty
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Joy

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import ConfigurationError, InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import vector_from_ros
from eulerparams_control.messages.keys import WorkMode
from eulerparams_control.messages.to_ros import vector_to_ros
from eulerparams_control.parameters.teleop import KEYBOARD, NO_AXIS, SPACENAV, TeleopParameters
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.publishers import refuse_two_publishers
from eulerparams_control.ros.qos import QOS, overridable
from eulerparams_control.ros.runtime import run

HELP = """
  w s   forward, back (x)      u o   roll       + -    faster, slower
  a d   left, right   (y)      i k   pitch      space  stop
  q e   up, down      (z)      j l   yaw        Ctrl-C end
Keep a key pressed to move; the tip stops when it is released.
"""
_KEYS = {
    key: (axis, sign)
    for axis, pair in enumerate(("ws", "ad", "qe", "uo", "ik", "jl"))
    for key, sign in zip(pair, (1.0, -1.0), strict=True)
}
_FASTER = {"+": 1.25, "=": 1.25, "-": 0.8}
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_NEUTRAL = 0.01  # an axis is neutral within this, whatever the deadzone
_LEAST, _MOST = 0.05, 4.0  # times the speeds of the parameters
_SEQUENCE = re.compile(r"\x1b[\[O][0-9;]*.")  # of arrows and the like: letters, but no keys of ours


class Deflection:
    """What a person asks for last, each axis from -1 to 1, until it is too old.

    Attributes:
        axes: (6,) x, y, z and the turns about them.
        until: until when it counts [s], steady clock.
    """

    def __init__(self) -> None:
        self.stop()

    def stop(self) -> None:
        """Ask for nothing."""
        self.axes, self.until = np.zeros(6), -math.inf

    def take(self, axes: Array, deadzone: float, until: float) -> None:
        """Ask for axes (6,) until a time [s]."""
        axes = np.clip(axes, -1.0, 1.0)
        beyond = np.maximum(np.abs(axes) - deadzone, 0.0) / (1.0 - deadzone)  # without a jump
        self.axes, self.until = np.sign(axes) * beyond, until

    def now(self, t: float) -> Array:
        """Return the axes (6,) at the time t [s]; zeros if they are too old."""
        return self.axes if t < self.until else np.zeros(6)


class Interlock:
    """Lets an axis pass once it was neutral while the dead-man button was pressed.

    So what rests elsewhere, as a trigger or a stick that drifts, moves nothing, nor does what is
    deflected when the button is pressed.  The button has to be seen released before; a device
    without one is as if it were pressed always.

    Attributes:
        waits_for: why not all passes, for people; "" if it does.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Restart, after a silence of the device or an invalid message."""
        self.waits_for, self._was_released, self._neutral = "", False, np.zeros(6, dtype=bool)

    def passing(self, axes: Array, pressed: bool | None, neutral: float) -> Array:
        """Return the axes (6,) of which those that may not pass are 0.

        Args:
            axes: from -1 to 1; finite.
            pressed: whether the button is; None if there is none.
            neutral: deflection that counts as none.
        """
        self.waits_for = ""
        if pressed is False:
            self._was_released, self._neutral[:] = True, False
            return np.zeros(6)
        if pressed and not self._was_released:
            self.waits_for = "the dead-man button, pressed from the start: release it"
            return np.zeros(6)
        self._neutral |= np.abs(axes) <= neutral
        if not self._neutral.all():
            off = ", ".join(
                f"{name} at {value:.2f}"
                for name, value, passes in zip(AXES, axes, self._neutral, strict=True)
                if not passes
            )
            self.waits_for = (
                f"axes that were not neutral since the start or the dead-man button: {off}; let go "
                "of them. What rests there, as a trigger, is none for axes; a drift asks for a "
                "larger deadzone"
            )
        return np.where(self._neutral, axes, 0.0)


class Terminal:
    """The keys of the terminal, one by one, without being shown.

    Raises:
        ConfigurationError: if there is no terminal.
    """

    def __init__(self) -> None:
        if not sys.stdin.isatty():
            raise ConfigurationError(
                "device: keyboard needs a terminal; start it with ros2 run, not ros2 launch, or "
                "set device: joy or spacenav"
            )
        self._file = sys.stdin.fileno()
        self._before = termios.tcgetattr(self._file)
        tty.setcbreak(self._file)

    def pressed(self) -> str:
        """Return the keys that were pressed since; one with a sequence is an escape."""
        found = b""
        while select.select([self._file], [], [], 0)[0] and (more := os.read(self._file, 100)):
            found += more
        return _SEQUENCE.sub("\x1b", found.decode(errors="replace"))

    def restore(self) -> None:
        """Set the terminal back as it was."""
        termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)


class TeleopNode(Node):
    """Publishes the twist that a person asks for, and zero once when it ends."""

    parameters_type = TeleopParameters

    def __init__(self) -> None:
        super().__init__("teleop")
        self.done = False
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, self.parameters_type)
        self._wish, self._factor, self._moves = Deflection(), 1.0, False
        self._interlock, self._heard = Interlock(), -math.inf  # when a message came last [s]
        self._publisher = self.create_publisher(TwistStamped, "target_twist", QOS)
        self._terminal: Terminal | None = None
        if p.device == KEYBOARD:
            self._terminal = Terminal()
            print(HELP, flush=True)
        else:
            kind, topic = (Twist, "spacenav/twist") if p.device == SPACENAV else (Joy, "joy")
            self._input = self.create_subscription(kind, topic, self._on_device, **overridable(QOS))
        self._health.set(diagnostics.OK, f"ready: {p.device}", mode=WorkMode.READY)
        self.create_timer(1 / p.rate, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_device(self, msg: Any) -> None:
        try:
            refuse_two_publishers(self, self._input)
            p = self._params
            is_twist, now = isinstance(msg, Twist), steady.now()
            axes, pressed = (_axes_of_twist(msg), None) if is_twist else _axes_of_joy(msg, p)
            if not np.isfinite(axes).all():
                raise InvalidMessageError(
                    f"the device says {axes.tolist()}; expected finite numbers"
                )
            if now > self._heard + p.joy_timeout:
                self._interlock.reset()
            self._heard = now
            passing = self._interlock.passing(axes * p.signs, pressed, max(p.deadzone, _NEUTRAL))
            self._wish.take(passing, p.deadzone, now + p.joy_timeout)
        except InvalidMessageError as error:
            self._wish.stop()
            self._interlock.reset()
            self._health.reject(self._input.topic_name.lstrip("/"), error)
        self._health.values["waits for"] = self._interlock.waits_for
        if self._interlock.waits_for:
            self._health.complain(f"waiting for {self._interlock.waits_for}", about="interlock")
            self._health.warn("waiting for axes or the dead-man button")

    def _on_timer(self) -> None:
        if self._terminal is not None:
            for key in self._terminal.pressed():
                self._on_key(key)
        axes = self._wish.now(steady.now())
        if axes.any() or self._moves:  # zero once, and then nothing: others may lead
            self._publish(axes)
        self._moves = bool(axes.any())

    def _on_key(self, key: str) -> None:
        if key in _KEYS:
            axis, sign = _KEYS[key]
            until = steady.now() + self._params.key_timeout
            self._wish.take(sign * np.eye(6)[axis], 0.0, until)
        elif key in _FASTER:
            self._factor = min(max(self._factor * _FASTER[key], _LEAST), _MOST)
            linear, angular = self._factor * self._speeds
            print(f"\r{linear:.3f} m/s, {angular:.3f} rad/s   ", end="", flush=True)
        else:
            self._wish.stop()

    @property
    def _speeds(self) -> Array:
        return np.array([self._params.linear_speed, self._params.angular_speed])

    def _publish(self, axes: Array) -> None:
        linear, angular = (self._factor * self._speeds)[:, None] * axes.reshape(2, 3)
        twist = Twist(linear=vector_to_ros(linear), angular=vector_to_ros(angular))
        msg = TwistStamped(twist=twist)
        msg.header.stamp = self.get_clock().now().to_msg()
        msg.header.frame_id = self._params.frame
        self._publisher.publish(msg)

    def close(self) -> None:
        """Stop the tip, and give the terminal back."""
        if self._moves:
            self._publish(np.zeros(6))
        if self._terminal is not None:
            self._terminal.restore()


def _axes_of_twist(msg: Twist) -> Array:
    """Return the six axes of a SpaceMouse, from -1 to 1."""
    return np.concatenate((vector_from_ros(msg.linear), vector_from_ros(msg.angular)))


def _axes_of_joy(msg: Joy, parameters: TeleopParameters) -> tuple[Array, bool | None]:
    """Return the six axes of a joystick, and whether its dead-man button is pressed, if any.

    Raises:
        InvalidMessageError: if it lacks an axis, or the button.
    """
    most, button = max(parameters.axes), parameters.deadman
    if most >= len(msg.axes) or button >= len(msg.buttons):
        raise InvalidMessageError(
            f"joy has {len(msg.axes)} axes and {len(msg.buttons)} buttons; expected the axes "
            f"{list(parameters.axes)} and the deadman button {button}: set axes and deadman"
        )
    axes = np.array([0.0 if i == NO_AXIS else msg.axes[i] for i in parameters.axes])
    return axes, None if button == NO_AXIS else bool(msg.buttons[button])


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(TeleopNode, args, tells=False)


if __name__ == "__main__":
    sys.exit(main())
