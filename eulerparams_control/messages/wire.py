"""Messages at their bytes (CDR): numbers read and written where a message before had them.

Messages whose strings and lengths of sequences agree have the same layout, so that one of them
shows where each number of all of them is.  What comes in a layout that is known is read by offset;
any other goes the plain way, deserialised as a whole, and its layout is known from then on.
"""

import struct
from collections import namedtuple
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.laws.rotations import Array

NUMBERS = {
    "bool": "u1", "byte": "u1", "char": "u1", "uint8": "u1", "int8": "i1",
    "uint16": "u2", "int16": "i2", "uint32": "u4", "int32": "i4",
    "uint64": "u8", "int64": "i8", "float32": "f4", "float64": "f8",
}  # fmt: skip

_HEAD = 4  # bytes that say how the rest is encoded; alignment counts from behind them
_ORDERS = {0: ">", 1: "<"}  # CDR, by the second byte
_LITTLE_ENDIAN = b"\0\1"


class Field(NamedTuple):
    """A field of a type; ``length`` is None for one, 0 for a sequence, else of an array."""

    name: str
    type: str
    length: int | None


@dataclass
class Layout:
    """Where the fields of a message are.

    Attributes:
        order: ``<`` or ``>``.
        numbers: offset, type and count by path.
        texts: by path.
        fixed: (L,) whether a byte is part of what the layout depends on.
        end: behind the last field.
    """

    order: str
    fixed: NDArray[np.bool_]
    end: int = 0
    numbers: dict[str, tuple[int, str, int | None]] = field(default_factory=dict)
    texts: dict[str, Any] = field(default_factory=dict)

    def part(self, path: str) -> tuple[tuple[int, ...], np.dtype[Any], int]:
        """Return the shape of a number or an array of them, its type, and where it begins."""
        at, kind, count = self.numbers[path]
        return () if count is None else (count,), np.dtype(self.order + kind), at


class Walk:
    """Goes through one message to find where its fields are."""

    def __init__(self, types: dict[str, tuple[Field, ...]], data: bytes) -> None:
        self._types, self._data = types, data
        if len(data) < _HEAD or data[1] not in _ORDERS:
            raise ValueError("it is not in CDR")
        self._layout = Layout(_ORDERS[data[1]], np.zeros(len(data), dtype=np.bool_))
        self._layout.fixed[:2] = True
        self._at = _HEAD

    def message(self, name: str) -> Layout:
        """Return the layout of the message, of the type ``name``."""
        self._fields(name, "")
        self._layout.end = self._at
        return self._layout

    def _fields(self, name: str, prefix: str) -> None:
        for each in self._types[name]:
            self._field(each, prefix + each.name)

    def _field(self, entry: Field, path: str) -> None:
        count = self._length() if entry.length == 0 else entry.length
        if entry.type in NUMBERS:
            self._numbers(NUMBERS[entry.type], path, count)
        elif entry.type == "string":
            texts = [self._text() for _ in range(1 if count is None else count)]
            self._layout.texts[path] = texts[0] if count is None else texts
        elif count is None:
            self._fields(entry.type, path + ".")
        else:
            self._layout.texts[path] = count
            for i in range(count):
                self._fields(entry.type, f"{path}[{i}].")

    def _numbers(self, kind: str, path: str, count: int | None) -> None:
        size = int(kind[1])
        if count != 0:
            self._at += (_HEAD - self._at) % size
        self._layout.numbers[path] = (self._at, kind, count)
        self._take(size * (1 if count is None else count))

    def _length(self) -> int:
        self._at += (_HEAD - self._at) % 4
        at = self._at
        self._take(4, fixed=True)
        (length,) = struct.unpack_from(self._layout.order + "I", self._data, at)
        if length > len(self._data):
            raise ValueError("a sequence is longer than the message")
        return int(length)

    def _text(self) -> str:
        length = self._length()
        at = self._at
        self._take(length, fixed=True)
        return self._data[at : at + length].rstrip(b"\0").decode()

    def _take(self, size: int, fixed: bool = False) -> None:
        end = self._at + size
        if end > len(self._data):
            raise ValueError("the message ends too early")
        self._layout.fixed[self._at : end] |= fixed
        self._at = end


_STAMPED = (
    *(Field("sec", "int32", None), Field("nanosec", "uint32", None)),
    Field("frame_id", "string", None),
)
_OF_JOINTS = *_STAMPED, Field("joint_names", "string", 0), Field("points", "uint32", None)
_FROM_START = Field("from_start_sec", "int32", None), Field("from_start_nanosec", "uint32", None)
_TYPES = {
    "JointState": (
        *(*_STAMPED, Field("name", "string", 0)),
        *(Field(name, "float64", 0) for name in ("position", "velocity", "effort")),
    ),
    "Clock": _STAMPED[:2],
    "WrenchStamped": (*_STAMPED, Field("wrench", "float64", 6)),
    "Float64MultiArray": (
        *(Field("dim", "uint32", None), Field("data_offset", "uint32", None)),
        Field("data", "float64", 0),
    ),
    "JointTrajectory": (
        *_OF_JOINTS,
        *(Field(name, "float64", 0) for name in ("positions", "velocities", "accelerations")),
        *(Field("effort", "float64", 0), *_FROM_START),
    ),
    "MultiDOFJointTrajectory": (
        *(*_OF_JOINTS, Field("transforms", "uint32", None)),
        *(Field(name, "float64", 3) for name in ("p_d", "eps")),
        *(Field("eta", "float64", None), Field("velocities", "uint32", None)),
        *(Field(name, "float64", 3) for name in ("dp_d", "omega_d")),
        Field("accelerations", "uint32", None),
        *(Field(name, "float64", 3) for name in ("ddp_d", "domega_d")),
        *_FROM_START,
    ),
}
"""Layouts of messages; those of a motion have one point, with all of its parts."""

_KNOWN = 8  # layouts on a topic: those of the arm, of its gripper, of other arms
_LONGEST = 2**12  # bytes of a message whose layout is learnt: dozens of joints

# Parts of messages, by the names that they have in the messages of rclpy.
Stamp = namedtuple("Stamp", "sec nanosec")
_Header = namedtuple("_Header", "stamp frame_id")
_Wrench = namedtuple("_Wrench", "force torque")
_Vector3 = namedtuple("_Vector3", "x y z")

_STAMP = 2  # numbers of a message that are its stamp, the first ones
_stamp = struct.Struct("<iI")

_CODES = {"i4": "i", "u4": "I", "f8": "d"}  # of struct


def stamp_of(data: bytes) -> Stamp:
    """Return the stamp of a message of a known layout."""
    stamp: Stamp = tuple.__new__(Stamp, _stamp.unpack_from(data, _HEAD))
    return stamp


class AtBytes(NamedTuple):
    """A message of a known layout, with the fields that it has in rclpy.

    Attributes:
        header: of the message.
        name: of its joints; None if it has none.
        numbers: all of them, in their order, the stamp first.
        known: its layout.
    """

    header: Any
    name: list[str] | None
    numbers: tuple[float, ...]
    known: "_Known"

    @property
    def position(self) -> tuple[float, ...]:
        """Positions of the joints [rad or m]."""
        return self.numbers[self.known.parts["position"]]

    @property
    def velocity(self) -> tuple[float, ...]:
        """Velocities of the joints [rad/s or m/s]."""
        return self.numbers[self.known.parts["velocity"]]

    @property
    def effort(self) -> tuple[float, ...]:
        """Efforts of the joints [Nm or N]."""
        return self.numbers[self.known.parts["effort"]]

    @property
    def six(self) -> tuple[float, ...]:
        """Force [N] and moment [Nm] of a WrenchStamped."""
        return self.numbers[self.known.parts["wrench"]]

    @property
    def wrench(self) -> Any:
        """The same with the fields that it has in rclpy."""
        w = self.six
        return _Wrench(_Vector3(*w[:3]), _Vector3(*w[3:]))


@dataclass(frozen=True)
class JointsAt:
    """Where the joints of an arm are in all JointStates of a layout.

    Attributes:
        known: the layout.
        position, velocity, count: where these begin, and how many there are.
        index: (n,) which of them are those of the arm.
    """

    known: "_Known"
    position: int
    velocity: int
    count: int
    index: NDArray[np.intp]

    def read(self, data: bytes, most: float) -> tuple[int, Array, Array] | None:
        """Return the stamp [ns], q (n,) and dq (n,) of a message at its bytes.

        None, if it has another layout, or q or dq is not finite, or its norm larger than ``most``.
        """
        if not self.known.fits(data):
            return None
        q: Array = np.frombuffer(data, "<f8", self.count, self.position)[self.index]
        dq: Array = np.frombuffer(data, "<f8", self.count, self.velocity)[self.index]
        if not (q @ q <= most * most and dq @ dq <= most * most):
            return None
        seconds, nanoseconds = _stamp.unpack_from(data, _HEAD)
        return seconds * 1_000_000_000 + nanoseconds, q, dq


class _Known:
    """A layout of a message that came, and what all messages of this layout have in common."""

    def __init__(self, layout: Layout, data: bytes, msg: Any) -> None:
        self._end = layout.end
        fixed = layout.fixed[: self._end] * np.uint8(255)
        self._mask = int.from_bytes(fixed.tobytes(), "little")
        self._common = int.from_bytes(data[: self._end], "little") & self._mask
        self._frame_id, self._name = msg.header.frame_id, getattr(msg, "name", None)
        self.parts: dict[str, slice] = {}
        codes, end, first = "<", 0, 0
        for path, (at, kind, count) in layout.numbers.items():
            length = 1 if count is None else count
            codes += f"{at - end}x{length}{_CODES[kind]}" if length else ""
            end = at + length * int(kind[1]) if length else end
            self.parts[path], first = slice(first, first + length), first + length
        self._unpack = struct.Struct(codes).unpack_from
        self._joints: dict[tuple[int, ...], JointsAt] = {}
        self._numbers = layout.numbers

    def fits(self, data: bytes) -> bool:
        """Whether a message has this layout."""
        end = self._end
        is_long = len(data) >= end
        return is_long and int.from_bytes(data[:end], "little") & self._mask == self._common

    def message(self, data: bytes) -> AtBytes:
        """Return what a message of this layout says."""
        numbers, new = self._unpack(data), tuple.__new__  # without a call of Python
        header = new(_Header, (new(Stamp, numbers[:_STAMP]), self._frame_id))
        return new(AtBytes, (header, self._name, numbers, self))

    def joints(self, index: tuple[int, ...]) -> JointsAt:
        """Return where the positions and velocities of these joints are."""
        if index not in self._joints:
            (position, _, count), (velocity, *_) = (
                self._numbers[path] for path in ("position", "velocity")
            )
            self._joints[index] = JointsAt(self, position, velocity, count or 0, np.array(index))
        return self._joints[index]


class Reader:
    """Reads messages of one type as those of rclpy, at their bytes once their layout is known.

    Args:
        kind: the type, "JointState" or "WrenchStamped".
        plain: deserialises a message.
        concerns: whether a message is meant for us: of others the first few layouts are learnt.
    """

    def __init__(
        self,
        kind: str,
        plain: Callable[[bytes], Any],
        concerns: Callable[[Any], bool] = lambda _: True,
    ) -> None:
        self._kind, self._plain, self._concerns = kind, plain, concerns
        self._known: list[_Known] = []
        self._others: list[_Known] = []

    def read(self, data: bytes) -> Any:
        """Return a message, or what has its fields; raises what ``plain`` raises."""
        for known in (*self._known, *self._others):
            if known.fits(data):
                return known.message(data)
        msg = self._plain(data)
        is_ours = self._concerns(msg)
        if data[:2] != _LITTLE_ENDIAN or len(data) > _LONGEST:
            return msg
        if not is_ours and len(self._others) == _KNOWN:
            return msg
        try:
            layout = Walk(_TYPES, data).message(self._kind)
        except (struct.error, IndexError, ValueError):  # not UTF-8
            return msg
        if is_ours:
            self._known = [_Known(layout, data, msg), *self._known[: _KNOWN - 1]]
        else:
            self._others.append(_Known(layout, data, msg))
        return msg


class Template:
    """A message whose stamp and numbers are written into its bytes.

    Args:
        kind: the type.
        data: such a message (serialised), with as many numbers as those to come.
        names: of the fields of the numbers.
        written: of the numbers of each field; the others stay.
    """

    def __init__(self, kind: str, data: bytes, names: Iterable[str], written: Any = ...) -> None:
        layout = Walk(_TYPES, data).message(kind)
        kept = layout.fixed  # what lies between is what was in memory
        kept[:_HEAD] = True
        for at, number, count in layout.numbers.values():
            kept[at : at + np.dtype(number).itemsize * (1 if count is None else count)] = True
        self._data = bytearray((np.frombuffer(data, np.uint8) * kept).tobytes())
        self._stamp = struct.Struct(layout.order + "iI")
        parts = [layout.part(name) for name in names]
        self._numbers = [
            np.ndarray(shape, dtype, self._data, at)[written] for shape, dtype, at in parts
        ]

    def filled(self, stamp: Any, values: Iterable[Array | float]) -> bytes:
        """Return the message with the numbers of the fields; a stamp of None stays."""
        if stamp is not None:
            self._stamp.pack_into(self._data, _HEAD, stamp.sec, stamp.nanosec)
        for numbers, value in zip(self._numbers, values, strict=True):
            numbers[...] = value
        return bytes(self._data)
