"""Checks shared by the readers of YAML: experiments, faults."""

import inspect
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.resources import config_file


def load[T](folder: str, name: str, read: Callable[[str, Any], T]) -> T:
    """Return the content of a YAML file, by its name in ``config/FOLDER`` or by its path.

    Args:
        folder: of config.
        name: of the file, or a path that ends in ``.yaml``.
        read: makes it of the name of the file and of its content.

    Raises:
        UnknownNameError: if there is none of that name; lists those that exist.
        ConfigurationError: if the file is broken; says where.
    """
    path = Path(name) if name.endswith((".yaml", ".yml")) else config_file(folder, name)
    try:
        return read(path.stem, yaml.safe_load(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, yaml.YAMLError, ConfigurationError) as error:
        raise ConfigurationError(f"{path}: {error}") from error


def known(kind: str, name: Any, names: Any) -> None:
    """Raise UnknownNameError unless a name is one of those."""
    if not isinstance(name, str) or name not in names:
        raise UnknownNameError(kind, str(name), map(str, names))


def is_number(value: Any) -> bool:
    """Return whether a value of YAML is a number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def require(condition: Any, message: str) -> None:
    """Raise ConfigurationError unless the condition holds."""
    if not condition:
        raise ConfigurationError(message)


def check_keys(
    where: str,
    what: str,
    content: Any,
    kind: type[Any],
    needed: Iterable[str] = (),
    more: Iterable[str] = (),
) -> None:
    """Raise ConfigurationError unless YAML has keys that are fields of a dataclass, or ``more``.

    Args:
        where: it is, for messages.
        what: has the keys, for messages.
        content: of the YAML.
        kind: the dataclass.
        needed: keys that have to be there.
        more: keys that are no fields.
    """
    keys = (*(field.name for field in fields(kind)), *more)
    require(isinstance(content, dict), f"{where}: expected the keys {', '.join(keys)}")
    for key in content:
        known(f"key of {what}", key, keys)
    for key in needed:
        require(key in content, f"{where}: the key '{key}' is missing")


def check_name(kind: str, name: Any) -> None:
    """Raise ConfigurationError unless a name can be that of a folder: letters, digits, _."""
    require(str(name).replace("_", "").isalnum(), f"{kind} '{name}': use letters, digits, _")


def check_call(what: str, function: Callable[..., Any], options: Any) -> None:
    """Raise ConfigurationError unless a function takes these options after its first argument."""
    try:
        inspect.signature(function).bind(None, **options)
    except TypeError as error:
        raise ConfigurationError(f"options of {what}: {error}") from error


def points(where: str, value: Any) -> tuple[tuple[float, float], ...]:
    """Return [[x, y], ...] as pairs of numbers; raises ConfigurationError."""
    fits = isinstance(value, list) and all(
        isinstance(pair, list) and len(pair) == 2 and all(map(is_number, pair)) for pair in value
    )
    require(fits and value, f"{where}: expected [[x, y], ...], numbers, at least one pair")
    return tuple((float(x), float(y)) for x, y in value)
