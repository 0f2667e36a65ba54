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
    fields, values = fields_of(parameters), {}
    refuse_misread(node.get_name(), fields)
    refuse_unknown(parameters, node._parameter_overrides, prefixes)
    for name, field in fields.items():  # checked before rclpy looks at them
        given = node._parameter_overrides.get(name)
        values[name] = checked(field, field.default if given is None else given.value)
        typed, free = _typed(field, values[name]), ParameterDescriptor(dynamic_typing=True)
        node.declare_parameter(name, typed.value, free, ignore_override=True)
        if node.get_parameter(name).type_ is not typed.type_:  # rclpy guesses bytes for []
            node.set_parameters([typed])
        is_fixed = on_change is None or not field.metadata["live"]
        node.set_descriptor(name, _descriptor(field, is_fixed))
    filled = parameters(**values)
    _watch(node, filled, on_change)
    return filled


def _typed(field: dataclasses.Field[Any], value: Any) -> Parameter:
    """Return a checked value as ROS has it: an int for a float, or no list, as what is meant."""
    if is_list(field):
        return Parameter(field.name, _LISTS[item_type(field)], list(value))
    return Parameter(field.name, value=value)


def _descriptor(field: dataclasses.Field[Any], is_fixed: bool) -> ParameterDescriptor:
    """Return what is shown of a parameter; numbers that are no list have a range, too."""
    meta = field.metadata
    text = meta["description"] + (f" [{meta['unit']}]" if meta["unit"] else "")
    shown = ParameterDescriptor(description=text, read_only=is_fixed, dynamic_typing=True)
    if meta["choices"]:
        shown.additional_constraints = "one of " + ", ".join(meta["choices"])
    if meta["bounds"]:
        low, high = map(float, meta["bounds"])
        shown.additional_constraints = f"between {low:g} and {high:g}"
        if field.type is float:
            shown.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif field.type is int:
            whole = IntegerRange(from_value=int(low), to_value=int(high), step=1)
            shown.integer_range = [whole]
    return shown


def _watch(node: Node, current: Any, on_change: Callable[[Any, Any], None] | None) -> None:
    """Check every later change; one that is refused changes nothing."""
    fields = fields_of(type(current))

    def judge(changes: list[Parameter]) -> list[Parameter]:
        """Judge changes before rclpy does, whose refusals say neither a unit nor what exists."""
        try:
            unknown = [change.name for change in changes if not node.has_parameter(change.name)]
            refuse_unknown(type(current), unknown)
            return [as_meant(change) if change.name in fields else change for change in changes]
        except ConfigurationError as error:  # the parameter services answer this kind alone
            refused = ParameterNotDeclaredException([])
            refused.args = (str(error),)
            raise refused from error

    def as_meant(change: Parameter) -> Parameter:
        field = fields[change.name]
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
