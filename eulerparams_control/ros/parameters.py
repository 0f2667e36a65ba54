"""Parameters of a node: declared from a dataclass, filled from the overrides, watched."""

import dataclasses
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.parameters.fields import (
    checked,
    fields_of,
    is_list,
    item_type,
    refuse_unknown,
)
from eulerparams_control.ros.parameter_files import refuse_misread

_LISTS = {
    float: Parameter.Type.DOUBLE_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    str: Parameter.Type.STRING_ARRAY,
}


def declare[P](
    node: Node,
    parameters: type[P],
    on_change: Callable[[P, P], None] | None = None,
    prefixes: tuple[str, ...] = (),
) -> P:
    """Declare the fields of ``parameters`` on ``node`` and return them filled.

    Args:
        node: the node whose overrides count.
        parameters: a frozen dataclass whose fields come from
            :func:`eulerparams_control.parameters.fields.parameter`.
        on_change: called with (old, new) when a parameter is set while running; what
            it raises as ConfigurationError refuses the change.  Without it no
            parameter can be changed.
        prefixes: of names that the node declares and checks itself, ``"environment."`` say.

    Raises:
        UnknownNameError: if an override names no parameter of the node.
        ConfigurationError: if a value has the wrong type, size, or is out of bounds; if a
            parameter file is probably meant for the node, but names another.
    """
    fields = fields_of(parameters)
    refuse_misread(node.get_name(), fields)
    refuse_unknown(parameters, node._parameter_overrides, prefixes)
    is_fixed = on_change is None
    filled = parameters(**{n: _declare(node, field, is_fixed) for n, field in fields.items()})
    _watch(node, filled, on_change)
    return filled


def _declare(node: Node, field: dataclasses.Field[Any], is_fixed: bool) -> Any:
    """Declare one parameter and return its value, checked before rclpy looks at it."""
    name = field.name
    given = node._parameter_overrides.get(name)
    value = checked(field, field.default if given is None else given.value)
    typed, free = _typed(field, value), ParameterDescriptor(dynamic_typing=True)
    node.declare_parameter(name, typed.value, free, ignore_override=True)
    if node.get_parameter(name).type_ is not typed.type_:  # rclpy guesses bytes for []
        node.set_parameters([typed])
    node.set_descriptor(name, _descriptor(field, is_fixed or not field.metadata["live"]))
    return value


def _typed(field: dataclasses.Field[Any], value: Any) -> Parameter:
    """Return a checked value as ROS has it: an int for a float, or no list, as what is meant."""
    if is_list(field):
        return Parameter(field.name, _LISTS[item_type(field)], list(value))
    return Parameter(field.name, value=value)


def _descriptor(field: dataclasses.Field[Any], is_fixed: bool) -> ParameterDescriptor:
    """Return what is shown of a parameter; numbers that are no list have a range, too."""
    meta, bounds = field.metadata, field.metadata["bounds"]
    text = meta["description"] + (f" [{meta['unit']}]" if meta["unit"] else "")
    constraints = []
    if bounds:
        constraints.append(f"between {bounds[0]:g} and {bounds[1]:g}")
    if meta["choices"]:
        constraints.append("one of " + ", ".join(meta["choices"]))
    descriptor = ParameterDescriptor(
        description=text,
        additional_constraints="; ".join(constraints),
        read_only=is_fixed,
        dynamic_typing=True,
    )
    if bounds and field.type is float:
        low, high = map(float, bounds)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    if bounds and field.type is int:
        low, high = map(int, bounds)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return descriptor


def _watch(node: Node, current: Any, on_change: Callable[[Any, Any], None] | None) -> None:
    """Check every later change; one that is refused changes nothing."""
    fields = fields_of(type(current))

    def judge(changes: list[Parameter]) -> list[Parameter]:
        """Judge changes before rclpy does, whose refusals say neither a unit nor what exists."""
        try:
            unknown = [change.name for change in changes if not node.has_parameter(change.name)]
            refuse_unknown(type(current), unknown)
            return [as_meant(change) for change in changes]
        except ConfigurationError as error:  # the parameter services answer this kind alone
            refused = ParameterNotDeclaredException([])
            refused.args = (str(error),)
            raise refused from error

    def as_meant(change: Parameter) -> Parameter:
        field = fields.get(change.name)
        if field is None:
            return change
        if on_change is None or not field.metadata["live"]:
            raise ConfigurationError(f"'{change.name}' cannot be changed while running")
        return _typed(field, checked(field, change.value))

    def check(changes: list[Parameter]) -> SetParametersResult:
        nonlocal current
        values = {c.name: checked(fields[c.name], c.value) for c in changes if c.name in fields}
        try:
            if values and on_change is not None:
                changed = dataclasses.replace(current, **values)
                on_change(current, changed)
                current = changed
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_pre_set_parameters_callback(judge)
    node.add_on_set_parameters_callback(check)
