"""Faults from YAML."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.lab.faults.base import Fault, settings


def parse_faults(where: str, content: Any) -> tuple[Fault, ...]:
    """Return the faults of a list of YAML; raises ConfigurationError that says which is wrong."""
    if not isinstance(content, list):
        raise ConfigurationError(f"{where}: expected a list of {{fault: ..., at: ..., ...}}")
    faults = []
    for number, entry in enumerate(content, 1):
        try:
            faults.append(parse_fault(entry))
        except ConfigurationError as error:
            raise ConfigurationError(f"{where}: entry {number}: {error}") from error
    return tuple(faults)


def parse_fault(content: Any) -> Fault:
    """Return the fault that a mapping of YAML describes.

    Raises:
        ConfigurationError: if it is incomplete, or a value is impossible.
        UnknownNameError: if there is no such fault, key, topic or value; lists those that exist.
    """
    if not isinstance(content, Mapping) or "fault" not in content:
        raise ConfigurationError(
            f"a fault needs the key 'fault', one of {', '.join(sorted(Fault.registry))}; "
            f"got {content!r}"
        )
    name = str(content["fault"])
    if name not in Fault.registry:
        raise UnknownNameError("fault", name, Fault.registry)
    kind = Fault.registry[name]
    known = settings(kind)
    given = {str(key): value for key, value in content.items() if key != "fault"}
    for key in given:
        if key not in known:
            raise UnknownNameError(f"key of the fault '{name}'", key, known)
    for key, entry in known.items():
        if entry.default is dataclasses.MISSING and key not in given:
            needed = (k for k, e in known.items() if e.default is dataclasses.MISSING)
            raise ConfigurationError(
                f"fault '{name}': the key '{key}' is missing; it needs {', '.join(needed)}"
            )
    return kind(**{known[key].name: _value(known[key].type, v) for key, v in given.items()})


def _value(kind: Any, value: Any) -> Any:
    """Return a value of YAML as a field has it: .nan and .inf can be words, 1 can be 1.0."""
    if kind in (str, "str") and isinstance(value, float):
        return str(value)
    if kind in (float, "float") and type(value) is int:
        return float(value)
    return value
