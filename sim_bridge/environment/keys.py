"""The keys of a thing: what a person may write for each of them, and how it is checked.

They come from YAML written by people: whole numbers stand for numbers, one number for
equal ones on all axes.
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
            one number for all of it; ``is_unit``: of norm 1; ``choices``: the words; ``text``:
            what it is, for messages.
    """
    metadata = {"unit": unit, "least": -math.inf, "above": -math.inf, **rule}
    return dataclasses.field(default=default, metadata=metadata)


number, word, vector = key, key, partial(key, size=3)
"""Fields for one number, for a word, and for a list of numbers."""

quaternion = partial(key, **_UNIT)
"""A field for a rotation, the unit quaternion x, y, z, w."""


def checked(name: str, value: Any, meta: Mapping[str, Any]) -> Any:
    """Return a value as its field wants it: a word, a float, or a tuple of them.

    Raises:
        ConfigurationError: if it is none; names ``name``, the value and what is expected.
    """
    if choices := meta.get("choices"):
        if str(value) not in choices:
            raise UnknownNameError(f"value of {name}:", str(value), choices)
        return value
    numbers = _numbers(value)
    size = meta.get("size")
    fits = len(numbers) == (size or 1) or bool(meta.get("one") and len(numbers) == 1)
    if not (fits and all(_is_allowed(entry, meta) for entry in numbers)):
        raise ConfigurationError(f"{name} is {_shown(value)}; expected {_expected(meta)}")
    if size is None:
        return int(numbers[0]) if meta.get("whole") else numbers[0]
    if meta.get("is_unit"):
        return _unit(name, numbers)
    return tuple(numbers) if len(numbers) == size else tuple(numbers) * size


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
