"""joint_states read at their bytes (CDR): an arm may send a thousand a second."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time

from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import LARGEST

_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # behind the encoding; alignment counts from here
_ANY = None  # a byte of a number, or one that pads: it is what was in the memory of the sender


class JointStateBytes:
    """Where the numbers are in joint_states with one frame_id, names and lengths of sequences.

    Args:
        msg: such a message, valid and with velocities.
        joints: names of the joints of the arm, n.
    """

    def __init__(self, msg: Any, joints: Sequence[str]) -> None:
        self._index, self._count = np.array([*map(msg.name.index, joints)]), len(msg.name)
        texts = [text.encode() + b"\0" for text in (msg.header.frame_id, *msg.name)]
        parts = [(len(text), text) for text in texts]
        parts.insert(1, (self._count, b""))
        form: list[int | None] = [0, 1, *[_ANY] * 10]  # little endian; the stamp
        for length, text in parts:
            form += [_ANY] * (-len(form) % 4)
            form += struct.pack("<I", length) + text
        self._offsets = []
        for values in (msg.position, msg.velocity, msg.effort):
            form += [_ANY] * (-len(form) % 4)
            form += struct.pack("<I", len(values))
            if len(values):
                form += [_ANY] * ((_STAMP_AT - len(form)) % 8)
            self._offsets.append(len(form))
            form += [_ANY] * 8 * len(values)
        self._end = len(form)
        self._common = int.from_bytes([byte or 0 for byte in form])
        self._mask = int.from_bytes([0 if byte is _ANY else 255 for byte in form])

    def read(self, data: bytes) -> tuple[Time, Array, Array] | None:
        """Return the stamp, q (n,) and dq (n,) of a message; None: deserialise and check it.

        It is of another form then, or a number is not finite or too large.
        """
        end = self._end
        if len(data) < end or int.from_bytes(data[:end]) & self._mask != self._common:
            return None
        q, dq = (
            np.frombuffer(data, "<f8", self._count, at)[self._index] for at in self._offsets[:2]
        )
        if not (q @ q <= LARGEST**2 and dq @ dq <= LARGEST**2):  # not so for NaN
            return None
        sec, nanosec = _STAMP.unpack_from(data, _STAMP_AT)
        return Time(sec=sec, nanosec=nanosec), q, dq
