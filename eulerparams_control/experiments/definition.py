"""An experiment as its YAML file says it: nodes, variants, criteria.

    claim: one sentence
    equations: ["(28)"]
    robot: ur5
    duration: 5.0                 # [s] of simulated time
    controller: clik
    start_at_reference: true      # begin with zero error at the first way-point
    nodes:                        # parameters of each node, by executable
      clik: {k_Po: 100.0}
    variants:                     # what each run changes
      euler_angles: {clik: {orientation: euler_angles}}
    criteria:
      - {metric: peak_orientation_error, below: 1.0e-3, predicted: 2.0e-4}
"""

import copy
import inspect
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.analysis.metrics import get_metric
from eulerparams_control.analysis.sentence import placeholders
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.resources import config_file

Parameters = dict[str, dict[str, Any]]

NODES = ("pybullet_bridge", "clik", "reference")
CONTROLLERS = {"clik": "joint_reference"}
"""The controllers, and the topic of the command of each."""


@dataclass(frozen=True)
class Criterion:
    """A bound on a metric of one or of two variants.

    Attributes:
        metric: name in ``METRICS``.
        variants: that have to meet it, each one by itself; () is all.
        ratio: instead, two variants whose metrics are divided, the first by the second.
        above, below: the bounds; None is none.
        predicted: what theory or a prototype gives, as text; "" if nothing.
        options: passed to the metric.
        text: what it shows, in words; "" takes that of the metric.
    """

    metric: str
    variants: tuple[str, ...] = ()
    ratio: tuple[str, ...] = ()
    above: float | None = None
    below: float | None = None
    predicted: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    text: str = ""


@dataclass(frozen=True)
class Experiment:
    """An experiment.

    Attributes:
        name: of its file.
        claim: what it shows.
        equations: of the paper that it is about.
        robot: name or path.
        duration: [s] of simulated time.
        controller: executable of the controller.
        start_at_reference: whether q starts at the first way-point instead of home.
        variants: parameters of all nodes, by variant.
        criteria: what has to hold.
        summary: one sentence with numbers; see ``analysis.sentence.fill``.
    """

    name: str
    claim: str
    equations: tuple[str, ...]
    robot: str
    duration: float
    controller: str
    start_at_reference: bool
    variants: dict[str, Parameters]
    criteria: tuple[Criterion, ...]
    summary: str = ""


_KEYS = {
    *("claim", "equations", "robot", "duration", "controller", "start_at_reference"),
    *("nodes", "variants", "criteria", "summary"),
}


def load_experiment(name_or_path: str) -> Experiment:
    """Return an experiment by its name in config/experiments, or from a path.

    Raises:
        UnknownNameError: if there is none of that name; lists those that exist.
        ConfigurationError: if the file is broken; says where.
    """
    is_path = name_or_path.endswith((".yaml", ".yml"))
    path = Path(name_or_path) if is_path else config_file("experiments", name_or_path)
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    try:
        return _experiment(path.stem, content)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error


def _experiment(name: str, content: Any) -> Experiment:
    _require(isinstance(content, dict), f"expected the keys {', '.join(sorted(_KEYS))}")
    for key in content:
        _known("key", key, _KEYS)
    for key in ("claim", "duration", "variants"):
        _require(key in content, f"the key '{key}' is missing")
    controller = content.get("controller", "clik")
    _known("controller", controller, CONTROLLERS)
    duration = content["duration"]
    _require(_is_number(duration) and 0 < duration < math.inf, "duration must be > 0 and finite")
    for key in ("equations", "criteria"):
        _require(isinstance(content.get(key) or [], list), f"{key}: expected a list")
    variants = _variants(content.get("nodes") or {}, content["variants"])
    for metric, *names in placeholders(str(content.get("summary", ""))):
        get_metric(metric)
        for variant in filter(None, names):
            _known("variant in the summary", variant, variants)
    return Experiment(
        name=name,
        claim=str(content["claim"]).strip(),
        equations=tuple(map(str, content.get("equations") or ())),
        robot=str(content.get("robot", "ur5")),
        duration=float(content["duration"]),
        controller=controller,
        start_at_reference=bool(content.get("start_at_reference", False)),
        variants=variants,
        criteria=tuple(_criterion(c, variants) for c in content.get("criteria") or ()),
        summary=str(content.get("summary", "")).strip(),
    )


def _variants(nodes: Any, variants: Any) -> dict[str, Parameters]:
    """Return the parameters of each variant: those of ``nodes`` with its changes."""
    _require(isinstance(variants, dict) and variants, "variants must name at least one")
    merged = {}
    for name, changes in variants.items():
        _require(str(name).replace("_", "").isalnum(), f"variant '{name}': use letters, digits, _")
        merged[str(name)] = copy.deepcopy(_parameters("nodes", nodes))
        for node, values in _parameters(f"variant {name}", changes or {}).items():
            merged[str(name)].setdefault(node, {}).update(values)
    return merged


def _parameters(where: str, nodes: Any) -> Parameters:
    _require(isinstance(nodes, dict), f"{where}: expected parameters by node")
    for node, values in nodes.items():
        _known(f"node in {where}", node, NODES)
        _require(isinstance(values, dict), f"{where}: {node}: expected names and values")
    return {node: dict(values) for node, values in nodes.items()}


def _criterion(content: Any, variants: dict[str, Parameters]) -> Criterion:
    _require(isinstance(content, dict) and "metric" in content, "a criterion needs a metric")
    for key in content:
        _known("key of a criterion", key, Criterion.__dataclass_fields__)
    _check_options(str(content["metric"]), content.get("options") or {})
    values = dict(content)
    for key in ("variants", "ratio"):
        _require(isinstance(values.get(key, []), list), f"{key}: expected a list")
        values[key] = tuple(values.get(key, ()))
        for variant in values[key]:
            _known("variant in a criterion", variant, variants)
    criterion = Criterion(**{**values, "predicted": str(values.get("predicted", ""))})
    _require(len(criterion.ratio) in (0, 2), "ratio: expected two variants")
    bounds = [bound for bound in (criterion.above, criterion.below) if bound is not None]
    _require(bool(bounds) and all(map(_is_number, bounds)), "expected 'above' or 'below', a number")
    return criterion


def _check_options(name: str, options: Any) -> None:
    """Raise ConfigurationError if there is no such metric, or it does not take the options."""
    metric = get_metric(name)
    try:
        inspect.signature(metric.compute).bind(None, **options)
    except TypeError as error:
        raise ConfigurationError(f"options of the metric '{name}': {error}") from error


def _known(kind: str, name: Any, known: Any) -> None:
    if name not in known:
        raise UnknownNameError(kind, str(name), map(str, known))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _require(condition: Any, message: str) -> None:
    if not condition:
        raise ConfigurationError(message)
