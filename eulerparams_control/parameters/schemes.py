"""The control schemes by name: their topics, commands and parameters.

A scheme is registered by its dataclass of parameters, where that is defined:

    @dataclass(frozen=True)
    class ClikParameters(ControlParameters, scheme="clik", control=POSITION): ...

and listed here; its node is ``ros/NAME_node.py``.
"""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

POSITION, TORQUE = "position", "torque"
COMMANDS = {POSITION: "joint_reference", TORQUE: "joint_effort"}
"""The topic of the commands to a robot, by what it takes them for."""

_NAMES = ("clik", "compliance_control", "dynamic_control", "impedance_control")
_REGISTRY: dict[str, "SchemeInfo"] = {}


@dataclass(frozen=True)
class SchemeInfo:
    """The interface of a control scheme.

    Attributes:
        name: of the scheme, its executable and its node.
        parameters: the dataclass of its parameters.
        control: what the robot takes its commands for, ``POSITION`` or ``TORQUE``.
        inputs: topics that it takes besides joint_states and reference.
        outputs: topics on which it answers each state besides its command.
    """

    name: str
    parameters: type[Any]
    control: str = TORQUE
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _REGISTRY[self.name] = self

    @property
    def command(self) -> str:
        """The topic of its commands."""
        return COMMANDS[self.control]

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics between the robot, what leads it, and the scheme; the command last."""
        return ("joint_states", *self.inputs, "reference", self.command)


@cache
def schemes() -> Mapping[str, SchemeInfo]:
    """Return all schemes, sorted by name."""
    for name in _NAMES:
        importlib.import_module(f"eulerparams_control.parameters.{name}")
    return MappingProxyType({name: _REGISTRY[name] for name in _NAMES})
