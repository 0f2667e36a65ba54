"""Dataclasses that people write as YAML: what they may write for each key, and how it is checked.

Whole numbers stand for numbers, one number for equal ones on all axes.
"""

import dataclasses
import math
from array import array
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.rotations import Array, EulerParameters

ORIGIN = (0.0, 0.0, 0.0)
NO_TURN = (0.0, 0.0, 0.0, 1.0)

# A unit quaternion printed with 4 digits is this close to norm 1.
_NORM_TOLERANCE = 1e-3

_UNIT: Any = {"size": 4, "is_unit": True}


def key(unit: str = "", *, default: Any = dataclasses.MISSING, **rule: Any) -> Any:
    """Return a dataclass field for numbers, or for one word.

    Args:
        unit: of each number.
        default: its value when it is not given; without one it must be.
        **rule: ``least`` and ``most`` allowed; ``above`` which numbers must be; ``endless``:
            infinity is allowed; ``whole``: no other number is; ``size``: of a list; ``one``: or
            one number for all of it; ``is_unit``: of norm 1;
            ``choices``: the words; ``is_word``: any word is; ``text``: what it is, for messages;
            ``key``: its name in YAML, where that is another.
    """
    metadata = {"unit": unit, "least": -math.inf, "above": -math.inf, **rule}
    return dataclasses.field(default=default, metadata=metadata)


number, word, vector = key, key, partial(key, size=3)
"""Fields for one number, for a word, and for a list of numbers."""

any_word = partial(key, is_word=True)
"""A field for any word."""

quaternion = partial(key, **_UNIT)
"""A field for a rotation, the unit quaternion x, y, z, w."""


def checked(name: str, value: Any, meta: Mapping[str, Any]) -> Any:
    """Return a value as its field wants it: a word, a float, or a tuple of them.

    Raises:
        ConfigurationError: if it is none; names ``name``, the value and what is expected.
    """
    if not meta:  # it is no key
        return value
    if choices := meta.get("choices"):
        if str(value) not in choices:
            raise UnknownNameError(f"value of {name}:", str(value), choices)
        return str(value)
    if meta.get("is_word"):
        if not isinstance(value, str):
            raise ConfigurationError(f"{name} is {value!r}; expected a name")
        return value
    numbers = _numbers(value)
    size = meta.get("size")
    fits = len(numbers) == (1 if size is None else size) or (meta.get("one") and len(numbers) == 1)
    if not (fits and all(_is_allowed(entry, meta) for entry in numbers)):
        raise ConfigurationError(f"{name} is {_shown(value)}; expected {_expected(meta)}")
    if size is None:
        return int(numbers[0]) if meta.get("whole") else numbers[0]
    if meta.get("is_unit"):
        return _unit(name, numbers)
    return tuple(numbers) if len(numbers) == size else tuple(numbers) * size


def keys_of(kind: type[Any]) -> dict[str, "dataclasses.Field[Any]"]:
    """Return the fields of a dataclass by their keys in YAML."""
    fields = (entry for entry in dataclasses.fields(kind) if entry.init)
    return {entry.metadata.get("key", entry.name): entry for entry in fields}


class Keyed:
    """Base of a frozen dataclass of keys, which are checked whoever gives them."""

    def __post_init__(self) -> None:
        for key, entry in keys_of(type(self)).items():
            value = checked(key, getattr(self, entry.name), entry.metadata)
            object.__setattr__(self, entry.name, value)


def read[K](kind: type[K], what: str, given: Mapping[str, Any], prefix: str = "", **more: Any) -> K:
    """Return a dataclass of keys from YAML.

    Args:
        kind: the dataclass.
        what: it is, for messages.
        given: the values by their keys.
        prefix: of the keys in messages, such as ``environment.table.``.
        more: values of fields that are no keys.

    Raises:
        UnknownNameError: for a key that it does not have; lists those that it has.
        ConfigurationError: if one is missing, or a value impossible.
    """
    keys = {key: entry for key, entry in keys_of(kind).items() if entry.name not in more}
    for key in given:
        if key not in keys:
            raise UnknownNameError(f"key of {what}", f"{prefix}{key}", [prefix + k for k in keys])
    for key, entry in keys.items():
        if key not in given and entry.default is dataclasses.MISSING:
            raise ConfigurationError(f"{prefix}{key} is missing; {what} needs it")
    for key, value in given.items():
        more[keys[key].name] = checked(prefix + key, value, keys[key].metadata)
    try:
        return kind(**more)
    except ConfigurationError as error:
        where = f"{prefix.rstrip('.')}: " if prefix else ""
        raise ConfigurationError(f"{where}{error}") from error


def unit_quaternion(name: str, value: Any) -> tuple[float, ...]:
    """Return a unit quaternion x, y, z, w, normalised; raises as :func:`checked`."""
    unit: tuple[float, ...] = checked(name, value, quaternion().metadata)
    return unit


def rotation(xyzw: Sequence[float]) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion x, y, z, w."""
    x, y, z, w = xyzw
    return EulerParameters(w, np.array([x, y, z])).R


def _numbers(value: Any) -> list[float]:
    """Return the numbers that a value is; NaN, which no field allows, for what is none."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    is_list = isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping)
    return [_number(entry) for entry in (value if is_list else [value])]


def _number(value: Any) -> float:
    is_number = isinstance(value, int | float | np.generic) and not isinstance(value, bool)
    return float(value) if is_number else math.nan


def _is_allowed(value: float, meta: Mapping[str, Any]) -> bool:
    finite = math.isfinite(value) or bool(meta.get("endless") and value == math.inf)
    within = meta["least"] <= value <= meta.get("most", math.inf)
    fits = value.is_integer() or not meta.get("whole")
    return finite and within and fits and value > meta["above"]


def _expected(meta: Mapping[str, Any]) -> str:
    """Return what a field wants, in words."""
    size, one = meta.get("size"), meta.get("one")
    count = "a finite number" if size is None else f"{size} finite numbers"
    count = f"one finite number or {size}" if one else count
    count = "a whole number" if meta.get("whole") else count
    if meta.get("is_unit"):
        count += " x, y, z, w"
    if meta.get("most", math.inf) < math.inf:
        count += f" from {meta['least']:g} to {meta['most']:g}"
    elif meta["least"] > -math.inf:
        count += f" of {meta['least']:g} or more"
    if meta["above"] > -math.inf:
        count += f" above {meta['above']:g}"
    count += f" [{meta['unit']}]" if meta["unit"] else ""
    return count + (f", {meta['text']}" if meta.get("text") else "")


def _unit(name: str, xyzw: list[float]) -> tuple[float, ...]:
    norm = math.hypot(*xyzw)
    if not abs(norm - 1.0) <= _NORM_TOLERANCE:
        raise ConfigurationError(
            f"{name} is {xyzw}, of norm {norm:g}; expected a unit quaternion x, y, z, w"
        )
    return tuple(entry / norm for entry in xyzw)


def _shown(value: Any) -> str:
    """Return a value as its error shows it, with a hint where YAML took a number for a word."""
    try:
        read = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        read = math.nan
    hint = "" if math.isnan(read) else f", a text to YAML; write {read:.1e}"
    return repr(list(value) if isinstance(value, tuple | array) else value) + hint
