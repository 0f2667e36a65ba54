"""The controllers of an experiment: the nodes of each, and what these need in lock-step."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from eulerparams_control.parameters.common import NO_COMMANDS
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import COMMANDS, POSITION, SchemeInfo, schemes
from eulerparams_control.resources import config_folder

_TURNED = {"max_jump_rotation": math.pi, "max_error_rotation": math.pi}
_PAIRED = {"wrench_pairing": "stamp"}

# A compliant frame is followed as it is: see config/clik_admittance.yaml.
_FILE = (config_folder() / "clik_admittance.yaml").read_text(encoding="utf-8")
_WIDE = {
    name: value
    for name, value in yaml.safe_load(_FILE)["/**"]["ros__parameters"].items()
    if not name.endswith("_frame")
}

_LISTENERS = 2  # to each command: who acts on it, and the recorder

# No state is answered before all listen, and none before a reference came.
_LOCK_STEP = {"use_sim_time": True, "require_reference": True, "wait_for_subscribers": _LISTENERS}


@dataclass(frozen=True)
class NodeSetup:
    """A node of a controller.

    Attributes:
        executable: its name.
        own: parameters that it needs in this controller.
        remaps: names of its topics, and what they are to be instead.
        scheme: that it runs; "" that of its name.
    """

    executable: str
    own: Mapping[str, Any] = field(default_factory=dict)
    remaps: Mapping[str, str] = field(default_factory=dict)
    scheme: str = ""

    @property
    def name(self) -> str:
        """The name of the scheme, and of the node."""
        return self.scheme or self.executable

    def parameters(self, is_turned: bool = False, is_lockstep: bool = True) -> dict[str, Any]:
        """Return what it needs in lock-step, and where the start is turned off the reference."""
        needed = {**_LOCK_STEP, **self.known(_PAIRED), **self.own} if is_lockstep else {}
        return needed | (self.known(_TURNED) if is_turned else {})

    def known(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return those values of which the node has a parameter."""
        known = fields_of(schemes()[self.name].parameters)
        return {name: value for name, value in values.items() if name in known}


@dataclass(frozen=True)
class ControllerSetup:
    """Controller of an experiment: one node, or several.

    Attributes:
        nodes: that run, in the order in which they start.
        command: topic of what the robot is told.
        control: what the robot takes it for.
        inputs: topics that it takes besides joint_states and reference.
        records: further topics that it answers each state on.
    """

    nodes: tuple[NodeSetup, ...]
    command: str
    control: str
    inputs: tuple[str, ...] = ()
    records: tuple[str, ...] = ()

    @property
    def executables(self) -> tuple[str, ...]:
        """The names of its nodes."""
        return tuple(node.executable for node in self.nodes)

    @property
    def is_compliant(self) -> bool:
        """Whether it has an impedance, on ``~/impedance`` of its first node."""
        return "K_p" in fields_of(schemes()[self.nodes[0].name].parameters)

    @property
    def answers(self) -> tuple[str, ...]:
        """The topics that have a message for each state; the command last, it lets time go on."""
        return (*self.records, self.command)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics between the robot, what leads it, and the controller; the command last."""
        return ("joint_states", *self.inputs, "reference", self.command)

    @property
    def followers(self) -> int:
        """How many of its nodes take ``reference``."""
        return sum("reference" not in node.remaps for node in self.nodes)


def _controller(scheme: SchemeInfo, executable: str = "") -> ControllerSetup:
    """Return the controller that is one scheme, run by an executable of its name or another."""
    node = NodeSetup(executable or scheme.name, scheme=scheme.name)
    return ControllerSetup((node,), scheme.command, scheme.control, scheme.inputs, scheme.outputs)


_AS_SHIPPED = {
    f"as_shipped_{name}": _controller(
        schemes()[name], f"eulerparams_control.lab.as_shipped.{name}_node"
    )
    for name in ("clik", "compliance_control", "impedance_control")
}
_ALONE = {name: _controller(scheme) for name, scheme in schemes().items()}
CONTROLLERS = {
    **_ALONE,
    **_AS_SHIPPED,
    "admittance": ControllerSetup(
        (
            NodeSetup("impedance_control", {"command_type": NO_COMMANDS}),
            NodeSetup(
                "clik",
                {"reference_pairing": "stamp", **_WIDE},
                remaps={"reference": "compliant_frame"},
            ),
        ),
        COMMANDS[POSITION],
        POSITION,
        ("wrench",),
        ("compliant_frame",),
    ),
}
"""The controllers by name: each scheme by itself, some with laws as shipped, what is made of
several."""
