"""Inputs of a robot: commands in one kind of control, and pushes at its tool."""

from collections.abc import Sequence
from typing import Any

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import LARGEST_COMMAND, JointReader, wrench_from_ros
from eulerparams_control.parameters.schemes import COMMANDS

Command = tuple[Array, ...]
"""q and dq (n,) [rad, rad/s] in position control, tau (n,) [Nm] in torque control."""

STRONGEST = 1e5
"""Nothing pushes an arm so strongly [N, Nm]: it is a mistake."""


class CommandInput:
    """Reads commands, and refuses those for another kind of control by its name.

    Args:
        joints: of the robot, n.
        control: "position" or "torque".

    Attributes:
        topic: on which they come.
    """

    def __init__(self, joints: Sequence[str], control: str) -> None:
        self.topic = COMMANDS[control]
        self._reader = JointReader(joints, self.topic, LARGEST_COMMAND)
        self._is_position = control == "position"

    def from_ros(self, msg: Any) -> Command:
        """Return the command of a message.

        Raises:
            InvalidMessageError: if a joint is missing or named twice, sizes differ, a value is
                not finite or impossible, or the robot is controlled in another way.
        """
        try:
            if self._is_position:
                q = self._reader.read(msg, "position")
                return q, self._reader.read(msg, "velocity") if len(msg.velocity) else 0.0 * q
            return (self._reader.read(msg, "effort"),)
        except InvalidMessageError as error:
            raise self._misfit(msg) or error from None

    def _misfit(self, msg: Any) -> InvalidMessageError | None:
        """Return that a message is for another kind of control, None if it is not."""
        wanted, other = (msg.position, msg.effort)[:: 1 if self._is_position else -1]
        if len(wanted) or not len(other):
            return None
        found, control = ("efforts", "position") if self._is_position else ("positions", "torque")
        return InvalidMessageError(
            f"{self.topic} has {found} only, but the robot is in {control} control; start a "
            f"controller for {control} control, or the robot with another control"
        )


def push_from_ros(msg: Any, frame: str) -> Array:
    """Return force and moment (6,) [N, Nm] of a message, which must be in the sensor frame.

    Raises:
        InvalidMessageError: if the frame is another, or a value not finite or impossible.
    """
    wrench = wrench_from_ros(msg, frame)
    if abs(wrench).max() > STRONGEST:
        raise InvalidMessageError(
            f"the wrench {wrench.tolist()} is impossible; expected up to {STRONGEST:g}"
        )
    return wrench
