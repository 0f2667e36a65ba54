"""Parameters of a node: declared from a dataclass, filled from the overrides, watched."""

import dataclasses
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.parameters.fields import (
    checked,
    fields_of,
    is_list,
    item_type,
    refuse_unknown,
)
from eulerparams_control.ros.parameter_files import given_words, refuse_misspelt_sections

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
    refuse_misspelt_sections(node.get_name())
    refuse_unknown(parameters, node._parameter_overrides, prefixes)
    fields = fields_of(parameters)
    refuse_words(node.get_name(), fields)
    values = {name: checked(field, _declare(node, field)) for name, field in fields.items()}
    filled = parameters(**values)
    _watch(node, filled, on_change)
    return filled


def refuse_words(name: str, fields: dict[str, Any], arguments: list[str] | None = None) -> None:
    """Raise ConfigurationError where a word is given for what is no text."""
    for key, word in given_words(name, arguments):
        if key in fields and not isinstance(fields[key].default, str):
            try:
                float(word)  # 1e-3 is a word for YAML
            except ValueError:
                checked(fields[key], word)


def _declare(node: Node, field: Any) -> Any:
    """Declare one parameter and return its value, unchecked."""
    name, default = field.name, list(field.default) if is_list(field) else field.default
    node.declare_parameter(name, default, _descriptor(field))
    if node.get_parameter(name).type_ is Parameter.Type.BYTE_ARRAY:  # rclpy's guess for []
        node.set_parameters([Parameter(name, _LISTS[item_type(field)], [])])
    return node.get_parameter(name).value


def _descriptor(field: dataclasses.Field[Any]) -> ParameterDescriptor:
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


def _watch(node: Node, current: Any, on_change: Callable[[Any, Any], None] | None) -> None:
    """Check every later change; one that is refused changes nothing."""
    fields = fields_of(type(current))

    def check(changes: list[Parameter]) -> SetParametersResult:
        nonlocal current
        try:
            values = {}
            for change in changes:
                if change.name not in fields:
                    continue
                if on_change is None or not fields[change.name].metadata["live"]:
                    raise ConfigurationError(f"'{change.name}' cannot be changed while running")
                values[change.name] = checked(fields[change.name], change.value)
            if values and on_change is not None:
                changed = dataclasses.replace(current, **values)
                on_change(current, changed)
                current = changed
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def refuse_unknown_names(changes: list[Parameter]) -> list[Parameter]:
        """Say which name is unknown before rclpy refuses it, which does not."""
        names = [change.name for change in changes if not node.has_parameter(change.name)]
        try:
            refuse_unknown(type(current), names)
        except UnknownNameError as error:
            refusal = ParameterNotDeclaredException(names)
            refusal.args = (str(error),)  # the answer of the parameter services
            raise refusal from error
        return changes

    node.add_pre_set_parameters_callback(refuse_unknown_names)
    node.add_on_set_parameters_callback(check)
