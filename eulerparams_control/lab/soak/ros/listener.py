"""Listens to one robot and its controller, as bytes: the stamps are all that is needed."""

import struct
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState

from eulerparams_control.lab.soak.cause import Causes
from eulerparams_control.lab.soak.ledger import Ledger
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.ros.qos import QOS_STREAM

_QUEUE = 10  # states that wait for a controller, by its QoS
_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # behind the header of the encoding

Info = dict[str, Any]


class Listener:
    """The states of a robot, the commands to it, and what explains their absence.

    Args:
        node: that listens.
        controller: its name, which is that of its namespace as well.
        rate: [Hz] of the states.
    """

    def __init__(self, node: Node, controller: str, rate: float) -> None:
        self.controller = controller
        self.ledger, self.causes = Ledger(), Causes(_QUEUE / rate)
        self._number: int | None = None
        self._node = node
        self._inputs = [
            self._listen("joint_states", self._on_state),
            self._listen(schemes()[controller].command, self._on_command),
        ]

    def _listen(self, topic: str, callback: Callable[[bytes, Info], None]) -> tuple[Any, Any]:
        name = f"/{self.controller}/{topic}"
        return self._node.create_subscription(
            JointState, name, lambda _: None, QOS_STREAM, raw=True
        ), callback

    def take_all(self) -> bool:
        """Take what has come; return whether anything had."""
        found = False
        for subscription, callback in self._inputs:
            with subscription.handle:
                while taken := subscription.handle.take_message(JointState, True):
                    found = True
                    callback(*taken)
        return found

    def _on_state(self, message: bytes, info: Info) -> None:
        self.ledger.state(_stamp_of(message), info["source_timestamp"] / 1e9)

    def _on_command(self, message: bytes, info: Info) -> None:
        received, number = info["received_timestamp"] / 1e9, info["publication_sequence_number"]
        if self._number is not None and number > self._number + 1:
            self.causes.unseen.add(received, number - self._number - 1)
        self._number = number
        self.ledger.command(_stamp_of(message), received)


def _stamp_of(message: bytes) -> int:
    """Return the stamp [ns] of a message that begins with a header."""
    seconds, nanoseconds = _STAMP.unpack_from(message, _STAMP_AT)
    return int(seconds * 10**9 + nanoseconds)
