"""An experiment as its YAML file says it: nodes, variants, criteria.

    claim: one sentence
    equations: ["(28)"]
    picture: orientation_error    # that the page begins with
    robot: ur5
    duration: 5.0                 # [s] of simulated time
    controller: clik              # or dynamic_control, impedance_control, admittance
    start_at_reference: true      # begin with zero error at the first way-point
    start_turn: [0.0, 0.0, 0.5]   # but turned by this rotation vector, tool frame [rad]
    may_diverge: false            # whether a run may end early, non-finite
    faults: []                    # what goes wrong, and when: see ``faulty``
    real_time: false              # whether it is in real time without faults, too
    ideal_joints: false           # true: the simulated joints have neither rotors nor friction
    halt: 1.0                     # [s] when ~/halt is called, in lock-step
    reports: false                # whether /diagnostics is recorded in lock-step, too
    nodes:                        # parameters of each node, by executable
      clik: {k_Po: 100.0}
    variants:                     # what each run changes: of the nodes, or of the keys above
      euler_angles: {clik: {orientation: euler_angles}}
      stiff: {pybullet_bridge: {environment: {plane: {stiffness: 1.0e+5}}}}  # nothing else of it
      dynamic: {controller: dynamic_control, duration: 2.0}
    criteria:                     # the one that matters most first
      - {metric: peak_orientation_error, below: 1.0e-3, predicted: 2.0e-4}
    chart:                        # what was measured against what is predicted
      metric: final_moment        # with the options of a criterion on it
      xlabel: beta [deg]
      log: y                      # the axes that are logarithmic: x, y or xy
      measured:
        Euler parameters: {parameters_0_5: 0.5, parameters_60: 60.0}
      predicted:
        50 sin(theta): [[0.5, 7.903], [85.0, 7.903]]
    predictions:                  # of theory for a quantity over time
      - {quantity: moment, text: "50 sin(theta) = 500 (10 deg - theta)", value: 7.903}
      - {quantity: force, text: ..., points: [[0.0, 0.0], [1.0, 9.52]]}
      - {quantity: orientation_error, text: (41), form: error_41,
         options: {error: 30.0, k_Po: 100.0, k_Vo: 14.142}}

``nodes`` may have parameters of controllers that a variant does not use.  The controller
``admittance`` is for arms that take positions: the node impedance_control, whose compliant frame
the node clik follows.

What needs no nodes is calculated in the library, by a module of ``experiments.library``; beside
variants, or instead of them:

    library: e2
    criteria:
      - {number: slope, above: -1.05, below: -0.95, predicted: -1}
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from typing import Any

from eulerparams_control.analysis.charts import Points, picture
from eulerparams_control.analysis.headline import placeholders
from eulerparams_control.analysis.quantities import get_metric
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.experiments.faulty import read_faults
from eulerparams_control.lab.experiments.library import library_names
from eulerparams_control.lab.experiments.model import (
    FORMS,
    ChartOf,
    Criterion,
    Experiment,
    Parameters,
    Predicted,
    Variant,
)
from eulerparams_control.lab.run.run_cache import LOGS
from eulerparams_control.lab.run.yaml_checks import (
    check_call,
    check_keys,
    check_name,
    is_number,
    known,
    load,
    points,
    require,
)

CONTROL_NODES = tuple(
    dict.fromkeys(name for controller in CONTROLLERS.values() for name in controller.executables)
)
NODES = ("pybullet_bridge", *CONTROL_NODES, "reference")

RUN_KEYS = tuple(field.name for field in fields(Variant) if field.name != "nodes")
"""Keys that an experiment gives for all its runs, and a variant may override."""

__all__ = ["Criterion", "Experiment", "Parameters", "Variant", "load_experiment"]

_TOGETHER = ("ratio", "difference", "spread")

_DRAWN = ("summary", "picture", "predictions", "chart")
_KEYS = ("claim", "equations", *RUN_KEYS, "nodes", "variants", "library", "criteria", *_DRAWN)

_LIBRARY = "library"
"""Prefix of ``{library.NAME}`` in a summary: a number of the library experiment."""


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
    for key in ("start_at_reference", "may_diverge", "real_time", "ideal_joints", "reports"):
        require(isinstance(run.get(key, False), bool), f"{where}: {key}: expected true or false")
    halt, is_real = run.get("halt", 0.0), run.get("real_time") or run.get("faults")
    is_time = is_number(halt) and 0 <= halt < duration
    require(is_time, f"{where}: halt: expected a time before the end, in s")
    require(not (is_real and "halt" in run), f"{where}: halt needs a run in lock-step")
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


def load_experiment(name_or_path: str) -> Experiment:
    """Return an experiment by its name in config/experiments, or from a path; see ``load``."""
    return load("experiments", name_or_path, partial(_experiment, name_or_path))


def _experiment(source: str, name: str, content: Any) -> Experiment:
    check_name("experiment", name)  # of the folder of its results
    _check_keys(content)
    variants = parse_variants(content) if "variants" in content else {}
    library = str(content.get("library", ""))
    if library:
        known("library experiment", library, library_names())
    experiment = Experiment(
        name=name,
        claim=str(content["claim"]).strip(),
        equations=tuple(map(str, content.get("equations") or ())),
        variants=variants,
        criteria=tuple(_criterion(c, variants, library) for c in content.get("criteria") or ()),
        summary=str(content.get("summary", "")).strip(),
        picture=picture(str(content.get("picture", Experiment.picture))).name,
        library=library,
        predictions=tuple(map(parse_prediction, content.get("predictions") or ())),
        chart=parse_chart(content["chart"], variants) if "chart" in content else None,
        source=source,
    )
    _check_summary(experiment)
    return experiment


def _check_keys(content: Any) -> None:
    require(isinstance(content, dict), f"expected the keys {', '.join(sorted(_KEYS))}")
    for key in content:
        known("key", key, _KEYS)
    needed = ("claim",) if "library" in content else ("claim", "duration", "variants")
    for key in needed:
        require(key in content, f"the key '{key}' is missing")
    for key in ("equations", "criteria", "predictions"):
        require(isinstance(content.get(key) or [], list), f"{key}: expected a list")


def _check_summary(experiment: Experiment) -> None:
    """Raise ConfigurationError if the summary names what the experiment does not have."""
    for metric, *names in placeholders(experiment.summary):
        if metric == _LIBRARY and experiment.library:
            continue
        for variant in filter(None, names):
            known("variant in the summary", variant, experiment.variants)
            _check_options(metric, experiment.options(metric, variant))


def _check_options(name: str, options: Any) -> None:
    """Raise ConfigurationError if there is no such metric, or it does not take the options."""
    check_call(f"the metric '{name}'", get_metric(name).compute, options)


def _criterion(content: Any, variants: dict[str, Variant], library: str) -> Criterion:
    check_keys("criteria", "a criterion", content, Criterion)
    if "metric" in content:
        _check_options(str(content["metric"]), content.get("options") or {})
    else:
        require("number" in content, "a criterion needs a metric, or a number of the library")
        require(library, f"the number '{content['number']}' needs the key 'library'")
    values = dict(content)
    for key in ("variants", *_TOGETHER):
        require(isinstance(values.get(key, []), list), f"{key}: expected a list")
        values[key] = tuple(values.get(key, ()))
        for variant in values[key]:
            known("variant in a criterion", variant, variants)
    criterion = Criterion(**{**values, "predicted": str(values.get("predicted", ""))})
    _check_criterion(criterion, sum(bool(values[key]) for key in ("variants", *_TOGETHER)))
    return criterion


def _check_criterion(criterion: Criterion, kinds: int) -> None:
    """Raise ConfigurationError unless a criterion has bounds and variants that fit."""
    for key in ("ratio", "difference"):
        require(len(getattr(criterion, key)) in (0, 2), f"{key}: expected two variants")
    require(len(criterion.spread) != 1, "spread: expected two variants or more")
    require(kinds <= 1, "expected one of 'variants', 'ratio', 'difference' and 'spread'")
    bounds = [bound for bound in (criterion.above, criterion.below) if bound is not None]
    require(bool(bounds) and all(map(is_number, bounds)), "expected 'above' or 'below', a number")


def parse_chart(content: Any, variants: Mapping[str, Any]) -> ChartOf:
    """Return a chart from YAML; raises ConfigurationError."""
    check_keys("chart", "a chart", content, ChartOf, ("metric", "xlabel", "measured"))
    get_metric(str(content["metric"]))
    require(content.get("log", "") in ("", "x", "y", "xy"), "chart: log: expected x, y or xy")
    measured, predicted = content["measured"], content.get("predicted") or {}
    require(isinstance(measured, dict) and measured, "chart: measured: expected lines by name")
    require(isinstance(predicted, dict), "chart: predicted: expected lines by name")
    for label, line in measured.items():
        require(isinstance(line, dict) and line, f"chart: {label}: expected x by variant")
        for variant, x in line.items():
            known("variant in the chart", variant, variants)
            require(is_number(x), f"chart: {label}: {variant}: expected a number")
    words = {key: str(content.get(key, "")) for key in ("metric", "xlabel", "ylabel", "log")}
    return ChartOf(
        measured={str(k): {v: float(x) for v, x in line.items()} for k, line in measured.items()},
        predicted={str(k): points(f"chart: {k}", line) for k, line in predicted.items()},
        ticks=tuple(map(str, content.get("ticks") or ())),
        **words,
    )


def parse_prediction(content: Any) -> Predicted:
    """Return a prediction from YAML; raises ConfigurationError."""
    what, options = "predictions", content.get("options") or {} if isinstance(content, dict) else {}
    check_keys(what, "a prediction", content, Predicted, ("quantity", "text"), ("value",))
    name, form = picture(str(content["quantity"])).name, str(content.get("form", ""))
    kinds = [key for key in ("value", "points", "form") if key in content]
    require(len(kinds) == 1, "predictions: expected one of 'value', 'points' and 'form'")
    corners: Points = ()
    if kinds == ["points"]:
        corners = points("predictions: points", content["points"])
    elif kinds == ["value"]:
        require(is_number(content["value"]), "predictions: value: expected a number")
        corners = ((0.0, float(content["value"])),)
    else:
        known("form of a prediction", form, FORMS)
        check_call(f"the form '{form}'", FORMS[form], options)
        require(all(map(is_number, options.values())), f"options of the form '{form}': numbers")
    numbers = {key: float(value) for key, value in options.items()} if form else {}
    return Predicted(name, str(content["text"]), corners, form, numbers)
