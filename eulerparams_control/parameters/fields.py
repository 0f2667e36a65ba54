"""Parameters as one frozen dataclass a node, checked where they enter.

A field is declared with :func:`parameter`.  A node reads the overrides (YAML, ``-p``) with
:func:`eulerparams_control.ros.parameters.declare`, all else, the parameters of a bag say, with
:func:`from_mapping`.  Both check types, bounds, choices and names.
"""

import dataclasses
import math
import sys
import typing
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from eulerparams_control.errors import ConfigurationError, UnknownNameError

# Declared by rclpy itself in every node.
_RCLPY_NAMES = ("use_sim_time", "start_type_description_service")
_RCLPY_PREFIXES = ("qos_overrides.",)


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = "",
    bounds: tuple[float, float] | None = None,
    choices: Collection[str] | None = None,
    live: bool = False,
) -> Any:
    """Return a dataclass field that stands for one ROS parameter.

    Args:
        default: its value when nothing overrides it; its type is the parameter's.
        description: what it is, as ``ros2 param describe`` shows it.
        unit: of each number.
        bounds: lowest and highest number allowed, both included.
        choices: the words allowed.
        live: whether it may be changed while the node is active.
    """
    metadata = {
        "description": description,
        "unit": unit,
        "bounds": bounds,
        "choices": choices,
        "live": live,
    }
    return dataclasses.field(default=default, metadata=metadata)


def other_default(parameters: type[Any], name: str, default: Any, of: str = "") -> Any:
    """Return the field of that name of other parameters, with another default.

    Args:
        parameters: the other dataclass.
        name: of the field.
        default: its default here.
        of: what the description says besides.
    """
    metadata = dict(fields_of(parameters)[name].metadata)
    metadata["description"] = f"{metadata['description']} {of}".strip()
    return dataclasses.field(default=default, metadata=metadata)


def from_mapping[P](parameters: type[P], values: Mapping[str, Any]) -> P:
    """Return the dataclass ``parameters`` filled from names and values; the rest are defaults.

    Args:
        parameters: a frozen dataclass whose fields come from :func:`parameter`.
        values: as YAML or a bag has them; those that rclpy declares itself are left out.

    Raises:
        UnknownNameError: if a name is not a parameter.
        ConfigurationError: if a value has the wrong type, or is out of bounds.
    """
    refuse_unknown(parameters, values)
    fields = fields_of(parameters)
    return parameters(**{n: checked(fields[n], v) for n, v in values.items() if n in fields})


def fields_of(parameters: type[Any]) -> dict[str, dataclasses.Field[Any]]:
    """Return the fields of a dataclass of parameters by name."""
    return {field.name: field for field in dataclasses.fields(parameters)}


def default_text(field: dataclasses.Field[Any]) -> str:
    """Return the default of a parameter as YAML has it."""
    value = list(field.default) if isinstance(field.default, tuple) else field.default
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text or '""'


def allowed(field: dataclasses.Field[Any]) -> list[str]:
    """Return the words that a parameter allows, or from where to where its numbers are."""
    bounds = field.metadata["bounds"]
    return ["{:g} to {:g}".format(*bounds)] if bounds else [*(field.metadata["choices"] or ())]


def refuse_unknown(
    parameters: type[Any], names: Iterable[str], prefixes: tuple[str, ...] = ()
) -> None:
    """Raise UnknownNameError for the first name that is not a parameter.

    Args:
        parameters: a dataclass of parameters.
        names: to check; those that rclpy declares itself are accepted.
        prefixes: of further names that are accepted.
    """
    own = fields_of(parameters)
    for name in names:
        if name in own or name in _RCLPY_NAMES or name.startswith(_RCLPY_PREFIXES + prefixes):
            continue
        raise UnknownNameError("parameter", name, [*own, *prefixes, *_RCLPY_NAMES])


def checked(field: dataclasses.Field[Any], value: Any) -> Any:
    """Return a value as the type of a field, checked; raises ConfigurationError."""
    if not is_list(field):
        return _checked_item(field, value, field.type)
    if value is None:  # rclpy's value of an empty list
        return ()
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ConfigurationError(f"parameter '{field.name}' is {value!r}; expected a list")
    return tuple(_checked_item(field, entry, item_type(field)) for entry in value)


def is_list(field: dataclasses.Field[Any]) -> bool:
    """Whether a parameter is a list."""
    return typing.get_origin(field.type) is tuple


def item_type(field: dataclasses.Field[Any]) -> Any:
    """Return the type of each item of a list: float, int or str."""
    return typing.get_args(field.type)[0]


def _checked_item(field: dataclasses.Field[Any], value: Any, kind: Any) -> Any:
    name, meta = field.name, field.metadata
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value) if abs(value) < sys.float_info.max else math.inf
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise ConfigurationError(
            f"parameter '{name}' is {value!r}, a {type(value).__name__}; expected a {kind.__name__}"
        )
    unit = f" {meta['unit']}" if meta["unit"] else ""
    if kind is float and not math.isfinite(value):
        raise ConfigurationError(f"parameter '{name}' is {value}; expected a finite number{unit}")
    if meta["bounds"] and not meta["bounds"][0] <= value <= meta["bounds"][1]:
        low, high = meta["bounds"]
        raise ConfigurationError(
            f"parameter '{name}' is {value:g}{unit}; expected between {low:g} and {high:g}"
        )
    if meta["choices"] and value not in meta["choices"]:
        raise UnknownNameError(f"value of parameter '{name}':", value, meta["choices"])
    return value
