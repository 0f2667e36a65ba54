"""The commands of a robot in one kind of control."""

from collections.abc import Sequence
from typing import Any

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.messages import CommandReader
from eulerparams_control.rotations import Array

Command = tuple[Array, ...]
"""q and dq (n,) [rad, rad/s] in position control, tau (n,) [Nm] in torque control."""


class Commands:
    """Reads commands, and refuses those for another kind of control by its name.

    Args:
        joints: of the robot, n.
        control: "position" or "torque".

    Attributes:
        topic: on which they come.
    """

    def __init__(self, joints: Sequence[str], control: str) -> None:
        self._reader = CommandReader(joints, control)
        self._is_position = control == "position"
        self.topic = "joint_reference" if self._is_position else "joint_effort"

    def from_ros(self, msg: Any) -> Command:
        """Return the command of a message.

        Raises:
            InvalidMessageError: if a joint is missing or named twice, sizes differ, a value is
                not finite or impossible, or the robot is controlled in another way.
        """
        if self._is_position:
            if not len(msg.position) and len(msg.effort):
                raise self._misfit("efforts", "position")
            return self._reader.position_from_ros(msg)
        if not len(msg.effort) and len(msg.position):
            raise self._misfit("positions", "torque")
        return (self._reader.effort_from_ros(msg),)

    def _misfit(self, found: str, control: str) -> InvalidMessageError:
        return InvalidMessageError(
            f"{self.topic} has {found} only, but the robot is in {control} control; start a "
            f"controller for {control} control, or the robot with another control"
        )
