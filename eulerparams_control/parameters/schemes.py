"""The control schemes by name: what each takes, gives and is told.

A scheme is registered by its dataclass of parameters, where that is defined:

    @dataclass(frozen=True)
    class ClikParameters(ControlParameters, scheme="clik", control=POSITION): ...

A module of ``parameters`` or of ``laws`` is found by being there, and so is the node of a scheme,
``ros/NAME_node.py``.
"""

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

POSITION, TORQUE = "position", "torque"
COMMANDS = {POSITION: "joint_reference", TORQUE: "joint_effort"}
"""The topic of the commands to a robot, by what it takes them for."""

_ROOMS = ("eulerparams_control.parameters", "eulerparams_control.laws")
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

    @property
    def node(self) -> str:
        """The module of its node."""
        return f"eulerparams_control.ros.{self.name}_node"


@cache
def schemes() -> Mapping[str, SchemeInfo]:
    """Return all schemes, sorted by name, whichever was imported first."""
    for room in map(importlib.import_module, _ROOMS):
        for module in pkgutil.iter_modules(room.__path__, f"{room.__name__}."):
            importlib.import_module(module.name)
    return MappingProxyType(dict(sorted(_REGISTRY.items())))
