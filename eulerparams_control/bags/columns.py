"""Many messages of one topic at once: their fields as arrays, without an object a message.

Messages whose strings and lengths of sequences agree have the same layout in CDR, so that one of
them shows where each number of all of them is.  For joint_states or wrench that is the rule.

    for group in columns(schema, messages):
        group.numbers["header.stamp.sec"]     # (N,)
        group.numbers["position"]             # (N, n)
        group.texts["name"]                   # ["shoulder", "elbow"], the same in all N
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from eulerparams_control.errors import BagError

_NUMBERS = {
    "bool": "u1", "byte": "u1", "char": "u1", "uint8": "u1", "int8": "i1",
    "uint16": "u2", "int16": "i2", "uint32": "u4", "int32": "i4",
    "uint64": "u8", "int64": "i8", "float32": "f4", "float64": "f8",
}  # fmt: skip

_HEAD = 4  # bytes that say how the rest is encoded; alignment counts from behind them
_ORDERS = {0: ">", 1: "<"}  # CDR, by the second byte
_DEEPEST = 50  # types within types; messages have five or six
_LONGEST = 2**18  # bytes of a schema; those of messages have some thousands
_MOST_FIELDS = 5000


class _Field(NamedTuple):
    """A field of a type; ``length`` is None for one, 0 for a sequence, else of an array."""

    name: str
    type: str
    length: int | None


_ONLY_MEMBER = "structure_needs_at_least_one_member"
_TIME = (_Field("sec", "int32", None), _Field("nanosec", "uint32", None))
_BUILT_IN = {f"builtin_interfaces/msg/{name}": _TIME for name in ("Time", "Duration")}
"""Types whose definition a bag may leave out."""


@dataclass(frozen=True)
class Group:
    """Messages of one layout.

    Attributes:
        index: (N,) their places among all that were given.
        numbers: (N,) or, of arrays, (N, n) by the path of the field.
        texts: what all have in common: a string, or a list of them, by the path of the field.
    """

    index: NDArray[np.intp]
    numbers: dict[str, NDArray[Any]]
    texts: dict[str, Any]


@dataclass
class _Layout:
    """Where the fields of a message are.

    Attributes:
        order: ``<`` or ``>``.
        numbers: offset, type and count by path.
        texts: by path.
        fixed: (L,) whether a byte is part of what the layout depends on.
    """

    order: str
    fixed: NDArray[np.bool_]
    numbers: dict[str, tuple[int, str, int | None]] = field(default_factory=dict)
    texts: dict[str, Any] = field(default_factory=dict)


def columns(schema: Schema, messages: Sequence[bytes]) -> Iterator[Group]:
    """Yield the groups of messages (serialised, CDR) that have one layout.

    Messages that are broken are left out: they are in no group.

    Args:
        schema: of their topic, ros2msg.
        messages: N serialised messages.

    Raises:
        BagError: if the schema cannot be understood.
    """
    types = _types(schema.name, schema.data)
    lengths = np.array([len(message) for message in messages])
    for length in np.unique(lengths).tolist():
        index = np.flatnonzero(lengths == length)
        joined = b"".join([messages[i] for i in index.tolist()])
        rows = np.frombuffer(joined, dtype=np.uint8).reshape(len(index), length)
        yield from _groups(types, schema.name, index, rows)


def check_schema(schema: Schema) -> None:
    """Check that a schema says what its messages are; raises BagError."""
    _types(schema.name, schema.data)


def check(schema: Schema, message: bytes) -> None:
    """Check that a message (serialised, CDR) is one of a type; takes time by its length at most.

    Raises:
        BagError: if the schema cannot be understood.
        ValueError: if the message is not one of its type, or ends too early.
    """
    types = _types(schema.name, schema.data)
    try:
        _Walk(types, message).message(schema.name)
    except (struct.error, IndexError) as error:
        raise ValueError(str(error)) from error


def _groups(
    types: dict[str, tuple[_Field, ...]],
    name: str,
    index: NDArray[np.intp],
    rows: NDArray[np.uint8],
) -> Iterator[Group]:
    while len(index):
        try:
            layout = _Walk(types, rows[0].tobytes()).message(name)
        except (struct.error, UnicodeDecodeError, IndexError, ValueError):
            index, rows = index[1:], rows[1:]
            continue
        same = (rows[:, layout.fixed] == rows[0, layout.fixed]).all(axis=1)
        chosen = rows if same.all() else rows[same]
        numbers = {path: _column(chosen, layout, path) for path in layout.numbers}
        yield Group(index[same], numbers, layout.texts)
        index, rows = index[~same], rows[~same]


def _column(rows: NDArray[np.uint8], layout: _Layout, path: str) -> NDArray[Any]:
    offset, kind, count = layout.numbers[path]
    dtype = np.dtype(layout.order + kind)
    size = dtype.itemsize * (1 if count is None else count)
    part = np.ascontiguousarray(rows[:, offset : offset + size]).view(dtype)
    if count is None:
        return part[:, 0]
    return part.reshape(len(rows), count)


class _Walk:
    """Goes through one message to find where its fields are."""

    def __init__(self, types: dict[str, tuple[_Field, ...]], data: bytes) -> None:
        self._types, self._data = types, data
        if len(data) < _HEAD or data[1] not in _ORDERS:
            raise ValueError("it is not in CDR")
        self._layout = _Layout(_ORDERS[data[1]], np.zeros(len(data), dtype=np.bool_))
        self._layout.fixed[:2] = True
        self._at = _HEAD

    def message(self, name: str) -> _Layout:
        """Return the layout of the message, of the type ``name``."""
        self._fields(name, "")
        return self._layout

    def _fields(self, name: str, prefix: str) -> None:
        for entry in self._types[name]:
            self._field(entry, prefix + entry.name)

    def _field(self, entry: _Field, path: str) -> None:
        count = self._length() if entry.length == 0 else entry.length
        if entry.type in _NUMBERS:
            self._numbers(_NUMBERS[entry.type], path, count)
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


@lru_cache(maxsize=64)
def _types(name: str, text: bytes) -> dict[str, tuple[_Field, ...]]:
    """Return the fields of a type and of those that it contains, from a ros2msg schema."""
    try:
        if len(text) > _LONGEST:
            raise ValueError(f"it has {len(text)} bytes; expected at most {_LONGEST}")
        first, *others = text.decode().split("\n" + "=" * 80 + "\n")
        parts = {name: first}
        for other in others:
            head, _, body = other.partition("\n")
            parts[_full(head.removeprefix("MSG:").strip(), name)] = body
        types = _BUILT_IN | {kind: tuple(_parsed(body, kind)) for kind, body in parts.items()}
        if (count := sum(map(len, types.values()))) > _MOST_FIELDS:
            raise ValueError(f"it has {count} fields; expected at most {_MOST_FIELDS}")
        _check_depth(types, name, ())
    except (UnicodeDecodeError, ValueError) as error:
        raise BagError(f"the schema of {name} cannot be understood: {error}") from error
    return types


def _check_depth(types: dict[str, tuple[_Field, ...]], name: str, within: tuple[str, ...]) -> None:
    """Raise ValueError if a type is not defined, or contains itself or too many in each other."""
    if name not in types:
        raise ValueError(f"the type {name} is not defined")
    if name in within:
        raise ValueError(f"the type {name} contains itself")
    if len(within) > _DEEPEST:
        raise ValueError(f"more than {_DEEPEST} types within each other")
    for kind in dict.fromkeys(entry.type for entry in types[name]):
        if kind not in _NUMBERS and kind != "string":
            _check_depth(types, kind, (*within, name))


def _parsed(body: str, kind: str) -> list[_Field]:
    """Return the fields of a definition; one without any has a byte, as IDL wants it."""
    return list(_fields_of(body, kind)) or [_Field(_ONLY_MEMBER, "uint8", None)]


def _fields_of(body: str, kind: str) -> Iterator[_Field]:
    """Yield the fields of a definition; constants and comments are left out."""
    for line in body.splitlines():
        words = line.partition("#")[0].split()
        if len(words) < 2 or "=" in words[1] or (len(words) > 2 and words[2].startswith("=")):
            continue
        base, bracket, size = words[0].partition("[")
        base = base.partition("<")[0]
        if base == "wstring":
            raise ValueError("it has a wstring")
        count = None if not bracket else 0 if size.startswith(("]", "<")) else int(size[:-1])
        if (bracket and count == 0 and size[0] not in "]<") or (count or 0) < 0:
            raise ValueError(f"an array of {count}")
        known = base in _NUMBERS or base == "string"
        yield _Field(words[1], base if known else _full(base, kind), count)


def _full(name: str, within: str) -> str:
    """Return ``pkg/msg/Type`` of a name as a definition has it."""
    parts = name.split("/")
    package = "std_msgs" if name == "Header" else within.split("/")[0]
    package = parts[0] if len(parts) > 1 else package
    return f"{package}/msg/{parts[-1]}"
