"""Judge an experiment: its criteria on the recordings of its variants."""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from eulerparams_control.analysis.metrics import get_metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.experiments.definition import Criterion, Experiment


@dataclass(frozen=True)
class Verdict:
    """One criterion judged.

    Attributes:
        text: what was measured, in words.
        variant: of which variant, or of which two.
        predicted: by theory or a prototype; "" if nothing.
        measured: the number.
        unit: of it.
        bound: in words, such as ``< 0.001``.
        met: whether it holds.
    """

    text: str
    variant: str
    predicted: str
    measured: float
    unit: str
    bound: str
    met: bool


def judge(experiment: Experiment, recordings: dict[str, Recording]) -> list[Verdict]:
    """Return the verdict on each criterion, for each variant that it concerns."""
    return [
        verdict
        for criterion in experiment.criteria
        for verdict in _verdicts(criterion, experiment, recordings)
    ]


def _verdicts(
    criterion: Criterion, experiment: Experiment, recordings: dict[str, Recording]
) -> Iterator[Verdict]:
    metric = get_metric(criterion.metric)
    text = criterion.text or metric.description

    def measure(variant: str) -> float:
        return metric.compute(recordings[variant], **criterion.options)

    if criterion.ratio:
        numerator, denominator = criterion.ratio
        if numerator in recordings and denominator in recordings:
            ratio = measure(numerator) / measure(denominator)
            yield _verdict(criterion, f"{numerator} / {denominator}", ratio, "", text)
        return
    for variant in criterion.variants or experiment.variants:
        if variant in recordings:
            yield _verdict(criterion, variant, measure(variant), metric.unit, text)


def _verdict(
    criterion: Criterion, variant: str, measured: float, unit: str, text: str
) -> Verdict:
    above, below = criterion.above, criterion.below
    bounds = [f"> {above:g}"] if above is not None else []
    bounds += [f"< {below:g}"] if below is not None else []
    met = (above is None or measured > above) and (below is None or measured < below)
    return Verdict(text, variant, criterion.predicted, measured, unit, ", ".join(bounds), met)


def write_summary(path: Path, experiment: Experiment, verdicts: list[Verdict]) -> None:
    """Write summary.json: the claim, and each criterion with what was measured."""
    content = {
        "experiment": experiment.name,
        "claim": experiment.claim,
        "equations": list(experiment.equations),
        "met": all(verdict.met for verdict in verdicts),
        "criteria": [_json(asdict(verdict)) for verdict in verdicts],
    }
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _json(values: dict[str, Any]) -> dict[str, Any]:
    """Return values that JSON can hold: it has no infinity and no NaN."""
    return {
        key: str(value) if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }
