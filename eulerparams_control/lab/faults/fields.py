"""The numbers of a message, whatever its type, and its stamp."""

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

_SECOND = 1_000_000_000


@dataclass(frozen=True)
class NumberField:
    """A floating-point number in a message.

    Attributes:
        path: of it, such as ``position[2]`` or ``wrench.force.x``.
        value: that it has.
        put: gives it another.
    """

    path: str
    value: float
    put: Callable[[float], None]


def numbers(msg: Any, field: str = "") -> list[NumberField]:
    """Return the numbers of a message, in order; only those of ``field`` if one is named.

    A field is a beginning of a path, up to the end of a name: ``position``, ``wrench.force`` or
    ``points[0].transforms``.
    """
    found = _walk(msg, "")
    return [number for number in found if not field or _is_within(number.path, field)]


def _is_within(path: str, field: str) -> bool:
    return path.startswith(field) and path[len(field) : len(field) + 1] in ("", ".", "[")


def _walk(value: Any, path: str) -> Iterator[NumberField]:
    if isinstance(value, list | array):
        for k, entry in enumerate(value):
            yield from _entry(entry, f"{path}[{k}]", _putter(value.__setitem__, k))
    elif hasattr(value, "get_fields_and_field_types") or hasattr(value, "__dict__"):
        for name in _names(value):
            inner = f"{path}.{name}" if path else name
            put = _putter(partial(setattr, value), name)
            yield from _entry(getattr(value, name), inner, put)


def _entry(value: Any, path: str, put: Callable[[float], None]) -> Iterator[NumberField]:
    if isinstance(value, float):
        yield NumberField(path, value, put)
    else:
        yield from _walk(value, path)


def _putter(put: Callable[[Any, float], Any], key: Any) -> Callable[[float], None]:
    def at_key(value: float) -> None:
        put(key, value)

    return at_key


def _names(msg: Any) -> list[str]:
    if hasattr(msg, "get_fields_and_field_types"):
        return list(msg.get_fields_and_field_types())
    return list(vars(msg))


def stamp_ns(msg: Any) -> int:
    """Return the stamp of a message [ns]."""
    stamp = msg.header.stamp
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def put_stamp(msg: Any, ns: int) -> None:
    """Give a message another stamp [ns]; before 1970 as the message type can say it."""
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(ns, _SECOND)
