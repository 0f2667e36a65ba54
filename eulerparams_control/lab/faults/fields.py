"""The numbers of a message, whatever its type, and its stamp."""

from array import array
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

_SECOND = 1_000_000_000


class NumberField(NamedTuple):
    """A floating-point number in a message.

    Attributes:
        path: of it, such as ``position[2]`` or ``wrench.force.x``.
        owner: the list, or the part of the message, that has it.
        key: its place in the list, or its name.
        value: that it had.
    """

    path: str
    owner: Any
    key: Any
    value: float

    def put(self, value: float) -> None:
        """Give it another value."""
        if isinstance(self.key, str):
            setattr(self.owner, self.key, value)
        else:
            self.owner[self.key] = value


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
    entries: Iterable[tuple[Any, str, Any]] = ()
    if isinstance(value, list | array):
        entries = ((k, f"{path}[{k}]", entry) for k, entry in enumerate(value))
    elif hasattr(value, "get_fields_and_field_types") or hasattr(value, "__dict__"):
        dot = "." if path else ""
        entries = ((n, f"{path}{dot}{n}", getattr(value, n)) for n in _names(value))
    for key, inner, entry in entries:
        if isinstance(entry, float):
            yield NumberField(inner, value, key, entry)
        else:
            yield from _walk(entry, inner)


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
