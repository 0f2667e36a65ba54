"""Runs with faults: in real time, with ``fault_injector`` between the robot and its controller.

    duration: 6.0
    faults:                       # of the experiment, or of a variant
      - {fault: drop, topic: joint_states, at: 1.0, for: 0.3, probability: 0.5}
      - {fault: kill, node: clik, at: 2.0, restart_after: 0.5}
    fault_seed: 1                 # of what is random

Times count from the first message on ``reference``.  What faults there are, and what they take,
says ``eulerparams_control.lab.faults``; ``kill`` ends a node of the run, without a word: the
controller, ``reference``, ``pybullet_bridge`` or ``bag_recorder``.  A ``reference`` that is
started again sends its motion again, as a user would.  The run waits until a node that is started
again is at work, a robot until it is commanded; faults of messages go on meanwhile.

The bag has joint_states as the robot sent them, the commands as the controller sent them and as
the robot got them (``faulty/...``), references as they were sent, and /diagnostics.
"""

from collections.abc import Mapping
from typing import Any

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.experiments.controllers import (
    CONTROLLERS,
    ControllerSetup,
    NodeSetup,
)
from eulerparams_control.lab.experiments.model import Variant
from eulerparams_control.lab.experiments.yaml_checks import known, require
from eulerparams_control.lab.faults import ROBOT, Fault, Kill, parse_faults

INJECTOR = "fault_injector"
FAULTY = "faulty/"
OTHERS = ("reference", "pybullet_bridge", "bag_recorder")
"""The nodes of a run besides its controller, that may be killed, too."""

RATE = 250.0
"""[Hz] of the robot unless the experiment says otherwise: all nodes share a machine."""


def read_faults(where: str, run: Mapping[str, Any]) -> tuple[Fault, ...]:
    """Return the faults of a run.

    Raises:
        ConfigurationError: if one is impossible in it; says which.
    """
    if run.get("faults") in (None, []):
        return ()
    name = str(run.get("controller", Variant.controller))
    controller = CONTROLLERS[name]
    require(len(controller.nodes) == 1, f"{where}: faults need one controller, not {name}")
    require(not run.get("may_diverge"), f"{where}: may_diverge does not go with faults")
    faults = parse_faults(f"{where}: faults", run["faults"])
    for number, fault in enumerate(faults, 1):
        try:
            _check(fault, controller, float(run["duration"]))
        except ConfigurationError as error:
            raise ConfigurationError(f"{where}: faults: entry {number}: {error}") from error
    return faults


def _check(fault: Fault, controller: ControllerSetup, duration: float) -> None:
    """Raise ConfigurationError unless a fault can do something in a run."""
    if isinstance(fault, Kill):
        known("node that can be killed", fault.node, (*controller.executables, *OTHERS))
    else:
        known(f"topic with {controller.executables[0]}", fault.topic, (*controller.topics, ROBOT))
    require(fault.at < duration, f"it begins at {fault.at:g} s, the run ends at {duration:g} s")


def remaps(controller: ControllerSetup) -> dict[str, dict[str, str]]:
    """Return the topics that have another name for each node: those that the injector gives on."""
    *inwards, command = controller.topics
    to_controller = {topic: FAULTY + topic for topic in inwards}
    nodes = {node.executable: {**to_controller, **node.remaps} for node in controller.nodes}
    return {**nodes, "pybullet_bridge": {command: FAULTY + command}}


def control_parameters(node: NodeSetup, is_turned: bool) -> dict[str, Any]:
    """Return what a control node needs in real time: what it has by default."""
    return node.turned(is_turned)


def bridge_parameters() -> dict[str, Any]:
    """Return what the bridge needs in real time; it goes on until it is stopped."""
    return {"mode": "realtime", "rate": RATE}


def injector_parameters(
    controller: ControllerSetup, faults: tuple[Fault, ...], seed: int
) -> dict[str, Any]:
    """Return what the injector is told."""
    told = [str(fault) for fault in faults if not isinstance(fault, Kill)]
    topics = list(controller.topics)
    values: dict[str, Any] = {"topics": topics, "start_on": "reference", "seed": seed}
    return values | {"faults": told} if told else values


def recorded(controller: ControllerSetup) -> list[str]:
    """Return the topics that are recorded."""
    own = ["robot_description", "wrench", "joint_states", "reference", "/diagnostics"]
    return [*controller.answers, FAULTY + controller.command, *own]
