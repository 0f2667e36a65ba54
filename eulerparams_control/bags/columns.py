"""Many messages of one topic at once: their fields as arrays, without an object a message.

Of messages of one layout one shows where each number of all of them is, see :mod:`bags.layout`.

    for group in columns(schema, messages):
        group.numbers["header.stamp.sec"]     # (N,)
        group.numbers["position"]             # (N, n)
        group.texts["name"]                   # ["shoulder", "elbow"], the same in all N
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from eulerparams_control.bags.layout import NUMBERS, Field, Layout
from eulerparams_control.errors import BagError

_DEEPEST = 50  # types within types; messages have five or six
_LONGEST = 2**18  # bytes of a schema; those of messages have some thousands
_MOST_FIELDS = 5000

_ONLY_MEMBER = "structure_needs_at_least_one_member"
_TIME = (Field("sec", "int32", None), Field("nanosec", "uint32", None))
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


def have_same_fields(schema: Schema, definition: bytes) -> bool:
    """Return whether a schema has the fields that a definition of its type says.

    Comments, constants and defaults may differ.

    Args:
        schema: of a bag.
        definition: ros2msg.

    Raises:
        BagError: if the schema is of another encoding, or cannot be understood.
    """
    if schema.encoding != "ros2msg":
        raise BagError(
            f"the schema of {schema.name} is {schema.encoding or 'empty'}; only ros2msg can be read"
        )
    return _types(schema.name, schema.data) == _types(schema.name, definition)


def check(schema: Schema, message: bytes) -> None:
    """Check that a message (serialised, CDR) is one of a type; takes time by its length at most.

    Raises:
        BagError: if the schema cannot be understood.
        ValueError: if the message is not one of its type, or ends too early.
    """
    Layout(_types(schema.name, schema.data), schema.name, message)


def _groups(
    types: dict[str, tuple[Field, ...]],
    name: str,
    index: NDArray[np.intp],
    rows: NDArray[np.uint8],
) -> Iterator[Group]:
    while len(index):
        try:
            layout = Layout(types, name, rows[0].tobytes())
        except ValueError:
            index, rows = index[1:], rows[1:]
            continue
        same = (rows[:, layout.fixed] == rows[0, layout.fixed]).all(axis=1)
        chosen = rows if same.all() else rows[same]
        numbers = {path: _column(chosen, *place) for path, place in layout.numbers.items()}
        yield Group(index[same], numbers, layout.texts)
        index, rows = index[~same], rows[~same]


def _column(
    rows: NDArray[np.uint8], at: int, dtype: np.dtype[Any], shape: tuple[int, ...]
) -> NDArray[Any]:
    part = rows[:, at : at + dtype.itemsize * math.prod(shape)]
    return np.ascontiguousarray(part).view(dtype).reshape(len(rows), *shape)


@lru_cache(maxsize=64)
def _types(name: str, text: bytes) -> dict[str, tuple[Field, ...]]:
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


def _check_depth(types: dict[str, tuple[Field, ...]], name: str, within: tuple[str, ...]) -> None:
    """Raise ValueError if a type is not defined, or contains itself or too many in each other."""
    if name not in types:
        raise ValueError(f"the type {name} is not defined")
    if name in within:
        raise ValueError(f"the type {name} contains itself")
    if len(within) > _DEEPEST:
        raise ValueError(f"more than {_DEEPEST} types within each other")
    for kind in dict.fromkeys(entry.type for entry in types[name]):
        if kind not in NUMBERS and kind != "string":
            _check_depth(types, kind, (*within, name))


def _parsed(body: str, kind: str) -> list[Field]:
    """Return the fields of a definition; one without any has a byte, as IDL wants it."""
    return list(_fields_of(body, kind)) or [Field(_ONLY_MEMBER, "uint8", None)]


def _fields_of(body: str, kind: str) -> Iterator[Field]:
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
        known = base in NUMBERS or base == "string"
        yield Field(words[1], base if known else _full(base, kind), count)


def _full(name: str, within: str) -> str:
    """Return ``pkg/msg/Type`` of a name as a definition has it."""
    parts = name.split("/")
    package = "std_msgs" if name == "Header" else within.split("/")[0]
    package = parts[0] if len(parts) > 1 else package
    return f"{package}/msg/{parts[-1]}"
