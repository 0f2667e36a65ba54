"""The controllers of an experiment: the nodes of each, and what these need in lock-step."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

_TURNED = {"max_jump_rotation": math.pi}
_TURNED_DYNAMIC = _TURNED | {"max_error_rotation": math.pi}

_LISTENERS = 2  # to each command: who acts on it, and the recorder

# No state is answered before all listen, and none before a reference came.
_LOCK_STEP = {
    "use_sim_time": True,
    "require_reference": True,
    "wait_for_subscribers": _LISTENERS,
}


@dataclass(frozen=True)
class ControlNode:
    """A node of a controller.

    Attributes:
        executable: its name.
        own: parameters that it needs in this controller.
        turned: parameters with which a start off the reference is no fault.
        remaps: names of its topics, and what they are to be instead.
    """

    executable: str
    own: Mapping[str, Any] = field(default_factory=dict)
    turned: Mapping[str, Any] = field(default_factory=lambda: _TURNED)
    remaps: Mapping[str, str] = field(default_factory=dict)

    def parameters(self, is_turned: bool) -> dict[str, Any]:
        """Return what it needs in lock-step, and where the start is turned off the reference."""
        return {**_LOCK_STEP, **self.own, **(self.turned if is_turned else {})}


@dataclass(frozen=True)
class Controller:
    """What an experiment calls a controller.

    Attributes:
        nodes: that run, in the order in which they start.
        command: topic of what the robot is told.
        control: what the robot takes it for.
        records: further topics that it answers each state on.
    """

    nodes: tuple[ControlNode, ...]
    command: str
    control: str
    records: tuple[str, ...] = ()

    @property
    def executables(self) -> tuple[str, ...]:
        """The names of its nodes."""
        return tuple(node.executable for node in self.nodes)

    @property
    def answers(self) -> tuple[str, ...]:
        """The topics that have a message for each state; the command last, it lets time go on."""
        return (*self.records, self.command)

    @property
    def followers(self) -> int:
        """How many of its nodes take ``reference``."""
        return sum("reference" not in node.remaps for node in self.nodes)


_PAIRED = {"wrench_pairing": "stamp"}

CONTROLLERS = {
    "clik": Controller((ControlNode("clik"),), "joint_reference", "position"),
    "dynamic_control": Controller(
        (ControlNode("dynamic_control", turned=_TURNED_DYNAMIC),), "joint_effort", "torque"
    ),
    "impedance_control": Controller(
        (ControlNode("impedance_control", _PAIRED, _TURNED_DYNAMIC),),
        "joint_effort",
        "torque",
        ("compliant_frame",),
    ),
    "admittance": Controller(
        (
            ControlNode("impedance_control", _PAIRED | {"command_type": "none"}, _TURNED_DYNAMIC),
            ControlNode(
                "clik",
                {"reference_pairing": "stamp", "reference_timeout": 0.02},
                remaps={"reference": "compliant_frame"},
            ),
        ),
        "joint_reference",
        "position",
        ("compliant_frame",),
    ),
}
"""The controllers by name."""
