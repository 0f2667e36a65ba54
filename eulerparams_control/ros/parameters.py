"""Node parameters as one frozen dataclass a node, checked where they enter.

A field is declared with :func:`parameter`; :func:`declare` makes the ROS parameters,
reads the overrides (YAML, ``-p``) and returns the filled dataclass.  Names that the
node does not have are refused with the name that was probably meant.
"""

import dataclasses
import math
import typing
from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.ros.parameter_files import refuse_misspelt_sections

# Declared by rclpy itself in every node.
_RCLPY_NAMES = ("use_sim_time", "start_type_description_service")
_RCLPY_PREFIXES = ("qos_overrides.",)


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = "",
    bounds: tuple[float, float] | None = None,
    choices: Sequence[str] | None = None,
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


def declare[P](
    node: Node,
    parameters: type[P],
    on_change: Callable[[P, P], None] | None = None,
    prefixes: tuple[str, ...] = (),
) -> P:
    """Declare the fields of ``parameters`` on ``node`` and return them filled.

    Args:
        node: the node whose overrides count.
        parameters: a frozen dataclass whose fields come from :func:`parameter`.
        on_change: called with (old, new) when a parameter is set while running; what
            it raises as ConfigurationError refuses the change.  Without it no
            parameter can be changed.
        prefixes: of names that the node declares and checks itself, ``"environment."`` say.

    Raises:
        UnknownNameError: if an override names no parameter of the node.
        ConfigurationError: if a value has the wrong type, size, or is out of bounds; if a
            parameter file is probably meant for the node, but names another.
    """
    refuse_misspelt_sections(node.get_name())
    fields = {field.name: field for field in dataclasses.fields(parameters)}  # type: ignore[arg-type]
    _refuse_unknown(node._parameter_overrides, fields, prefixes)
    hints = typing.get_type_hints(parameters)
    values = {}
    for name, field in fields.items():
        value = _declare_one(node, name, field, hints[name])
        values[name] = _convert(name, value, field, hints[name])
    filled = parameters(**values)
    _watch(node, filled, fields, hints, on_change)
    return filled


def _refuse_unknown(
    overrides: typing.Iterable[str], fields: dict[str, Any], prefixes: tuple[str, ...]
) -> None:
    for name in overrides:
        if name in fields or name in _RCLPY_NAMES or name.startswith(_RCLPY_PREFIXES + prefixes):
            continue
        raise UnknownNameError("parameter", name, [*fields, *prefixes, *_RCLPY_NAMES])


def _declare_one(node: Node, name: str, field: Any, hint: Any) -> Any:
    """Declare one parameter and return its value, unchecked."""
    is_list = typing.get_origin(hint) is tuple
    default = list(field.default) if is_list else field.default
    node.declare_parameter(name, default, _descriptor(field))
    if node.get_parameter(name).type_ is Parameter.Type.BYTE_ARRAY:  # rclpy's guess for []
        strings = str in typing.get_args(hint)
        kind = Parameter.Type.STRING_ARRAY if strings else Parameter.Type.DOUBLE_ARRAY
        node.set_parameters([Parameter(name, kind, [])])
    return node.get_parameter(name).value


def _descriptor(field: Any) -> ParameterDescriptor:
    meta = field.metadata
    text = meta["description"] + (f" [{meta['unit']}]" if meta["unit"] else "")
    constraints = []
    if meta["bounds"]:
        constraints.append(f"between {meta['bounds'][0]:g} and {meta['bounds'][1]:g}")
    if meta["choices"]:
        constraints.append("one of " + ", ".join(meta["choices"]))
    return ParameterDescriptor(
        description=text, additional_constraints="; ".join(constraints), dynamic_typing=True
    )


def _convert(name: str, value: Any, field: Any, hint: Any) -> Any:
    """Return ``value`` as the type of the field, checked."""
    item = typing.get_args(hint)[0] if typing.get_origin(hint) is tuple else hint
    if item is hint:
        return _convert_item(name, value, field, item)
    if value is None:  # rclpy's value of an empty list
        return ()
    if isinstance(value, (str, int, float)):
        raise ConfigurationError(f"parameter '{name}' is {value!r}; expected a list")
    return tuple(_convert_item(name, entry, field, item) for entry in value)


def _convert_item(name: str, value: Any, field: Any, kind: Any) -> Any:
    meta = field.metadata
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
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


def _watch(
    node: Node,
    current: Any,
    fields: dict[str, Any],
    hints: dict[str, Any],
    on_change: Callable[[Any, Any], None] | None,
) -> None:
    """Check every later change; one that is refused changes nothing."""

    def check(changes: list[Parameter]) -> SetParametersResult:
        nonlocal current
        try:
            values = {}
            for change in changes:
                if change.name not in fields:
                    continue
                field = fields[change.name]
                if on_change is None or not field.metadata["live"]:
                    raise ConfigurationError(f"'{change.name}' cannot be changed while running")
                values[change.name] = _convert(change.name, change.value, field, hints[change.name])
            if values and on_change is not None:
                changed = dataclasses.replace(current, **values)
                on_change(current, changed)
                current = changed
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)
