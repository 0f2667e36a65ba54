"""The variants of an experiment: what its file says of all runs, and what each changes."""

import copy
import math
from dataclasses import fields
from typing import Any

from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.experiments.faulty import read_faults
from eulerparams_control.lab.experiments.model import LOGS, Parameters, Variant
from eulerparams_control.lab.experiments.yaml_checks import check_name, is_number, known, require

CONTROL_NODES = tuple(
    dict.fromkeys(name for controller in CONTROLLERS.values() for name in controller.executables)
)
NODES = ("pybullet_bridge", *CONTROL_NODES, "reference")

RUN_KEYS = tuple(field.name for field in fields(Variant) if field.name != "nodes")
"""What an experiment says of all its runs, and a variant may say otherwise."""


def parse_variants(content: dict[str, Any]) -> dict[str, Variant]:
    """Return the variants: what the experiment says of all its runs, with their changes."""
    common = {key: content[key] for key in RUN_KEYS if key in content}
    nodes = _parameters("nodes", content.get("nodes") or {})
    _variant("the experiment", common, nodes, {})
    variants = content["variants"]
    require(isinstance(variants, dict) and variants, "variants must name at least one")
    for name in variants:
        check_name("variant", name)
        require(name != LOGS, f"variant '{name}': this is the name of the folder of the logs")
    return {
        str(name): _variant(f"variant {name}", common, nodes, changes or {})
        for name, changes in variants.items()
    }


def _variant(where: str, common: dict[str, Any], nodes: Parameters, changes: Any) -> Variant:
    """Return a run: ``common`` and ``nodes``, with the changes of its own."""
    require(isinstance(changes, dict), f"{where}: expected parameters by node, or keys")
    for key in changes:
        known(f"node or key in {where}", key, (*NODES, *RUN_KEYS))
    own = {key: value for key, value in changes.items() if key in RUN_KEYS}
    parameters = _parameters(where, {key: changes[key] for key in changes if key not in own})
    merged = _merged(nodes, parameters)
    run = {"start_turn": [0.0, 0.0, 0.0], **common, **own}
    _check_run(where, run)
    run |= {"duration": float(run["duration"]), "start_turn": tuple(map(float, run["start_turn"]))}
    run["faults"] = read_faults(where, run)
    variant = Variant(merged, **run)
    for node in parameters:
        require(
            node not in CONTROL_NODES or node in CONTROLLERS[variant.controller].executables,
            f"{where}: parameters of {node}, but its controller is {variant.controller}",
        )
    return variant


def _merged(common: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of ``common`` with changes; of groups in groups only what they name."""
    merged = copy.deepcopy(common)
    for name, value in changes.items():
        is_group = isinstance(value, dict) and isinstance(merged.get(name), dict)
        merged[name] = _merged(merged[name], value) if is_group else copy.deepcopy(value)
    return merged


def _check_run(where: str, run: dict[str, Any]) -> None:
    """Raise ConfigurationError unless the values that a run has are possible."""
    duration, turn = run["duration"], run["start_turn"]
    positive = is_number(duration) and 0 < duration < math.inf
    require(positive, f"{where}: duration must be > 0 and finite")
    known("controller", run.get("controller", Variant.controller), CONTROLLERS)
    require(isinstance(run.get("robot", ""), str), f"{where}: robot: expected a name or a path")
    for key in ("start_at_reference", "may_diverge"):
        require(isinstance(run.get(key, False), bool), f"{where}: {key}: expected true or false")
    seed = run.get("fault_seed", 0)
    is_seed = isinstance(seed, int) and not isinstance(seed, bool) and 0 <= seed < 2**31
    require(is_seed, f"{where}: fault_seed: expected a whole number from 0 to {2**31 - 1}")
    numbers = isinstance(turn, list) and len(turn) == 3 and all(map(is_number, turn))
    require(
        numbers and all(map(math.isfinite, turn)), f"{where}: start_turn: expected [x, y, z] in rad"
    )
    require(
        not any(turn) or run.get("start_at_reference", False),
        f"{where}: start_turn needs start_at_reference: true",
    )


def _parameters(where: str, nodes: Any) -> Parameters:
    require(isinstance(nodes, dict), f"{where}: expected parameters by node")
    for node, values in nodes.items():
        known(f"node in {where}", node, NODES)
        require(isinstance(values, dict), f"{where}: {node}: expected names and values")
    return {node: dict(values) for node, values in nodes.items()}
