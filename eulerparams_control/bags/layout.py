"""Where the fields of a serialised message (CDR) are."""

import struct
from typing import Any, NamedTuple

import numpy as np

NUMBERS = {
    "bool": "u1", "byte": "u1", "char": "u1", "uint8": "u1", "int8": "i1",
    "uint16": "u2", "int16": "i2", "uint32": "u4", "int32": "i4",
    "uint64": "u8", "int64": "i8", "float32": "f4", "float64": "f8",
}  # fmt: skip

_HEAD = 4  # bytes that say how the rest is encoded; alignment counts from behind them
_ORDERS = {0: ">", 1: "<"}  # CDR, by the second byte


class Field(NamedTuple):
    """A field of a type; ``length`` is None for one, 0 for a sequence, else of an array."""

    name: str
    type: str
    length: int | None


class Layout:
    """Offsets of the fields of one message, and of all that have its strings and lengths.

    Args:
        types: the fields of each type.
        name: the type of the message.
        data: the message.

    Attributes:
        numbers: offset, type and shape, by path.
        texts: strings, lists of them, and numbers of messages in a sequence, by path.
        fixed: (L,) whether a byte is part of what the layout depends on.

    Raises:
        ValueError: if the message is not one of its type, or ends too early.
    """

    def __init__(self, types: dict[str, tuple[Field, ...]], name: str, data: bytes) -> None:
        if len(data) < _HEAD or data[1] not in _ORDERS:
            raise ValueError("it is not in CDR")
        self._types, self._data, self._order, self._at = types, data, _ORDERS[data[1]], _HEAD
        self.numbers: dict[str, tuple[int, np.dtype[Any], tuple[int, ...]]] = {}
        self.texts: dict[str, Any] = {}
        self.fixed = np.zeros(len(data), dtype=np.bool_)
        self.fixed[:2] = True
        self._message(name, "")

    def _message(self, name: str, prefix: str) -> None:
        for field in self._types[name]:
            self._field(field, prefix + field.name)

    def _field(self, field: Field, path: str) -> None:
        count = self._length() if field.length == 0 else field.length
        if field.type in NUMBERS:
            dtype = np.dtype(self._order + NUMBERS[field.type])
            if count != 0:
                self._align(dtype.itemsize)
            self.numbers[path] = self._at, dtype, () if count is None else (count,)
            self._skip(dtype.itemsize * (1 if count is None else count))
        elif field.type == "string":
            self.texts[path] = (
                self._text() if count is None else [self._text() for _ in range(count)]
            )
        elif count is None:
            self._message(field.type, path + ".")
        else:
            self.texts[path] = count
            for i in range(count):
                self._message(field.type, f"{path}[{i}].")

    def _align(self, size: int) -> None:
        self._at += (_HEAD - self._at) % size

    def _length(self) -> int:
        self._align(4)
        (length,) = struct.unpack(self._order + "I", self._fixed(4))
        if length > len(self._data):
            raise ValueError("a sequence is longer than the message")
        return int(length)

    def _text(self) -> str:
        return self._fixed(self._length()).rstrip(b"\0").decode()

    def _fixed(self, size: int) -> bytes:
        at = self._at
        self._skip(size)
        self.fixed[at : self._at] = True
        return self._data[at : self._at]

    def _skip(self, size: int) -> None:
        self._at += size
        if self._at > len(self._data):
            raise ValueError("the message ends too early")
