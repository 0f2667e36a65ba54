"""An experiment as its YAML file says it: nodes, variants, criteria.

    claim: one sentence
    equations: ["(28)"]
    picture: orientation_error    # that the page begins with
    robot: ur5
    duration: 5.0                 # [s] of simulated time
    controller: clik              # or dynamic_control, impedance_control, admittance
    start_at_reference: true      # begin with zero error at the first way-point
    start_turn: [0.0, 0.0, 0.5]   # but turned by this rotation vector, tool frame [rad]
    may_diverge: false            # whether a run may end early, beyond all numbers
    nodes:                        # parameters of each node, by executable
      clik: {k_Po: 100.0}
    variants:                     # what each run changes: of the nodes, or of the keys above
      euler_angles: {clik: {orientation: euler_angles}}
      stiff: {pybullet_bridge: {environment: {plane: {stiffness: 1.0e+5}}}}  # nothing else of it
      dynamic: {controller: dynamic_control, duration: 2.0}
    criteria:
      - {metric: peak_orientation_error, below: 1.0e-3, predicted: 2.0e-4}

``nodes`` may have parameters of controllers that a variant does not use.  The controller
``admittance`` is for arms that take positions: the node impedance_control, whose compliant frame
the node clik follows.
"""

import copy
import inspect
import math
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.analysis.figures import picture
from eulerparams_control.analysis.metrics import get_metric
from eulerparams_control.analysis.sentence import placeholders
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.experiments.controllers import CONTROLLERS
from eulerparams_control.resources import config_file

Parameters = dict[str, dict[str, Any]]

CONTROL_NODES = tuple(
    dict.fromkeys(name for controller in CONTROLLERS.values() for name in controller.executables)
)
NODES = ("pybullet_bridge", *CONTROL_NODES, "reference")


@dataclass(frozen=True)
class Criterion:
    """A bound on a metric of a variant, or of several together.

    Attributes:
        metric: name in ``METRICS``.
        variants: that have to meet it, each one by itself; () is all.
        ratio: instead, two variants whose metrics are divided, the first by the second.
        difference: instead, two variants whose metrics are subtracted, without the sign.
        spread: instead, variants of whose metrics (max - min) / mean is taken.
        above, below: the bounds; None is none.
        predicted: what theory or a prototype gives, as text; "" if nothing.
        options: passed to the metric.
        text: what it shows, in words; "" takes that of the metric.
    """

    metric: str
    variants: tuple[str, ...] = ()
    ratio: tuple[str, ...] = ()
    difference: tuple[str, ...] = ()
    spread: tuple[str, ...] = ()
    above: float | None = None
    below: float | None = None
    predicted: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    text: str = ""

    @property
    def together(self) -> tuple[str, ...]:
        """The variants whose metrics are judged together; () if each is by itself."""
        return self.ratio or self.difference or self.spread


@dataclass(frozen=True)
class Variant:
    """One run of an experiment.

    Attributes:
        nodes: parameters of the nodes.
        duration: [s] of simulated time.
        robot: name or path.
        controller: its name.
        start_at_reference: whether q starts at the first way-point instead of home.
        start_turn: (3,) rotation vector [rad], tool frame, by which the tip is turned there.
        may_diverge: whether the run may end early, beyond all numbers.
    """

    nodes: Parameters
    duration: float
    robot: str = "ur5"
    controller: str = "clik"
    start_at_reference: bool = False
    start_turn: tuple[float, ...] = (0.0, 0.0, 0.0)
    may_diverge: bool = False


@dataclass(frozen=True)
class Experiment:
    """An experiment.

    Attributes:
        name: of its file.
        claim: what it shows.
        equations: of the paper that it is about.
        variants: its runs, by name.
        criteria: what has to hold.
        summary: one sentence with numbers; see ``analysis.sentence.fill``.
        picture: name of the quantity that the page begins with.
    """

    name: str
    claim: str
    equations: tuple[str, ...]
    variants: dict[str, Variant]
    criteria: tuple[Criterion, ...]
    summary: str = ""
    picture: str = "orientation_error"

    def options(self, metric: str, variant: str) -> dict[str, Any]:
        """Return the options of the first criterion on a metric of a variant; {} if none is."""
        for criterion in self.criteria:
            named = criterion.variants or criterion.together
            if criterion.metric == metric and (variant in named or not named):
                return criterion.options
        return {}


_TOGETHER = ("ratio", "difference", "spread")

_RUN_KEYS = tuple(field.name for field in fields(Variant) if field.name != "nodes")
"""What an experiment says of all its runs, and a variant may say otherwise."""

_KEYS = ("claim", "equations", *_RUN_KEYS, "nodes", "variants", "criteria", "summary", "picture")


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
    for key in ("equations", "criteria"):
        _require(isinstance(content.get(key) or [], list), f"{key}: expected a list")
    variants = _variants(content)
    experiment = Experiment(
        name=name,
        claim=str(content["claim"]).strip(),
        equations=tuple(map(str, content.get("equations") or ())),
        variants=variants,
        criteria=tuple(_criterion(c, variants) for c in content.get("criteria") or ()),
        summary=str(content.get("summary", "")).strip(),
        picture=picture(str(content.get("picture", Experiment.picture))).name,
    )
    for metric, *names in placeholders(experiment.summary):
        for variant in filter(None, names):
            _known("variant in the summary", variant, variants)
            _check_options(metric, experiment.options(metric, variant))
    return experiment


def _variants(content: dict[str, Any]) -> dict[str, Variant]:
    """Return the variants: what the experiment says of all its runs, with their changes."""
    common = {key: content[key] for key in _RUN_KEYS if key in content}
    nodes = _parameters("nodes", content.get("nodes") or {})
    _variant("the experiment", common, nodes, {})
    variants = content["variants"]
    _require(isinstance(variants, dict) and variants, "variants must name at least one")
    for name in variants:
        _require(str(name).replace("_", "").isalnum(), f"variant '{name}': use letters, digits, _")
    return {
        str(name): _variant(f"variant {name}", common, nodes, changes or {})
        for name, changes in variants.items()
    }


def _variant(where: str, common: dict[str, Any], nodes: Parameters, changes: Any) -> Variant:
    """Return a run: ``common`` and ``nodes``, with the changes of its own."""
    _require(isinstance(changes, dict), f"{where}: expected parameters by node, or keys")
    for key in changes:
        _known(f"node or key in {where}", key, (*NODES, *_RUN_KEYS))
    own = {key: value for key, value in changes.items() if key in _RUN_KEYS}
    parameters = _parameters(where, {key: changes[key] for key in changes if key not in own})
    merged = _merged(nodes, parameters)
    run = {"start_turn": [0.0, 0.0, 0.0], **common, **own}
    _check_run(where, run)
    run |= {"duration": float(run["duration"]), "start_turn": tuple(map(float, run["start_turn"]))}
    variant = Variant(merged, **run)
    for node in parameters:
        _require(
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
    positive = _is_number(duration) and 0 < duration < math.inf
    _require(positive, f"{where}: duration must be > 0 and finite")
    _known("controller", run.get("controller", "clik"), CONTROLLERS)
    _require(isinstance(run.get("robot", ""), str), f"{where}: robot: expected a name or a path")
    for key in ("start_at_reference", "may_diverge"):
        _require(isinstance(run.get(key, False), bool), f"{where}: {key}: expected true or false")
    numbers = isinstance(turn, list) and len(turn) == 3 and all(map(_is_number, turn))
    _require(
        numbers and all(map(math.isfinite, turn)), f"{where}: start_turn: expected [x, y, z] in rad"
    )
    _require(
        not any(turn) or run.get("start_at_reference", False),
        f"{where}: start_turn needs start_at_reference: true",
    )


def _parameters(where: str, nodes: Any) -> Parameters:
    _require(isinstance(nodes, dict), f"{where}: expected parameters by node")
    for node, values in nodes.items():
        _known(f"node in {where}", node, NODES)
        _require(isinstance(values, dict), f"{where}: {node}: expected names and values")
    return {node: dict(values) for node, values in nodes.items()}


def _criterion(content: Any, variants: dict[str, Variant]) -> Criterion:
    _require(isinstance(content, dict) and "metric" in content, "a criterion needs a metric")
    for key in content:
        _known("key of a criterion", key, Criterion.__dataclass_fields__)
    _check_options(str(content["metric"]), content.get("options") or {})
    values = dict(content)
    for key in ("variants", *_TOGETHER):
        _require(isinstance(values.get(key, []), list), f"{key}: expected a list")
        values[key] = tuple(values.get(key, ()))
        for variant in values[key]:
            _known("variant in a criterion", variant, variants)
    criterion = Criterion(**{**values, "predicted": str(values.get("predicted", ""))})
    for key in ("ratio", "difference"):
        _require(len(values[key]) in (0, 2), f"{key}: expected two variants")
    _require(len(criterion.spread) != 1, "spread: expected two variants or more")
    kinds = sum(bool(values[key]) for key in ("variants", *_TOGETHER))
    _require(kinds <= 1, "expected one of 'variants', 'ratio', 'difference' and 'spread'")
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
