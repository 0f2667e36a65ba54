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
    faults: []                    # what goes wrong, and when: see ``faulty``
    nodes:                        # parameters of each node, by executable
      clik: {k_Po: 100.0}
    variants:                     # what each run changes: of the nodes, or of the keys above
      euler_angles: {clik: {orientation: euler_angles}}
      stiff: {pybullet_bridge: {environment: {plane: {stiffness: 1.0e+5}}}}  # nothing else of it
      dynamic: {controller: dynamic_control, duration: 2.0}
    criteria:                     # the one that matters most first
      - {metric: peak_orientation_error, below: 1.0e-3, predicted: 2.0e-4}
    predictions: ...              # curves over time, see ``predictions``
    chart: ...                    # numbers over a parameter, see ``charts``

``nodes`` may have parameters of controllers that a variant does not use.  The controller
``admittance`` is for arms that take positions: the node impedance_control, whose compliant frame
the node clik follows.

What needs no nodes is calculated in the library, by a module of ``experiments.library``; beside
variants, or instead of them:

    library: e2
    criteria:
      - {number: slope, above: -1.05, below: -0.95, predicted: -1}
"""

from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.analysis.figures import picture
from eulerparams_control.analysis.headline import placeholders
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.experiments.charts import parse_chart
from eulerparams_control.lab.experiments.library import library_names
from eulerparams_control.lab.experiments.model import Criterion, Experiment, Parameters, Variant
from eulerparams_control.lab.experiments.predictions import parse_prediction
from eulerparams_control.lab.experiments.variants import RUN_KEYS, parse_variants
from eulerparams_control.lab.experiments.yaml_checks import (
    check_name,
    check_options,
    is_number,
    known,
    require,
)
from eulerparams_control.resources import config_file

__all__ = ["Criterion", "Experiment", "Parameters", "Variant", "load_experiment"]

_TOGETHER = ("ratio", "difference", "spread")

_DRAWN = ("summary", "picture", "predictions", "chart")
_KEYS = ("claim", "equations", *RUN_KEYS, "nodes", "variants", "library", "criteria", *_DRAWN)

_LIBRARY = "library"
"""What ``{library.NAME}`` in a summary begins with: a number of the library experiment."""


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
        return _experiment(path.stem, content, name_or_path)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error


def _experiment(name: str, content: Any, source: str) -> Experiment:
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
            check_options(metric, experiment.options(metric, variant))


def _criterion(content: Any, variants: dict[str, Variant], library: str) -> Criterion:
    is_number_of = isinstance(content, dict) and "number" in content and "metric" not in content
    require(
        isinstance(content, dict) and ("metric" in content or is_number_of),
        "a criterion needs a metric, or a number of the library",
    )
    for key in content:
        known("key of a criterion", key, Criterion.__dataclass_fields__)
    if is_number_of:
        require(library, f"the number '{content['number']}' needs the key 'library'")
    else:
        check_options(str(content["metric"]), content.get("options") or {})
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
