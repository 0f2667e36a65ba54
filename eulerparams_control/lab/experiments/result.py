"""Judge an experiment: its criteria on the recordings of its variants, and what came of it.

What came of it is in summary.json, for the terminal and for pages.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from eulerparams_control.analysis.quantities import get_metric, measure, quotient
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.verdict import Verdict, all_met, verdict_from_json
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.experiments.library import Number
from eulerparams_control.lab.experiments.model import Criterion, Experiment

SUMMARY, REPORT, FIGURE = "summary.json", "report.html", "figure.svg"
"""Files of an experiment in its folder, beside the bags."""


def judge(
    experiment: Experiment,
    recordings: Mapping[str, Recording],
    numbers: Mapping[str, Number] = MappingProxyType({}),
) -> list[Verdict]:
    """Return the verdict on each criterion, for each variant that it concerns.

    Args:
        experiment: the experiment.
        recordings: of its variants, as far as they ran.
        numbers: of its library experiment, if that ran.
    """
    return [
        verdict
        for criterion in experiment.criteria
        for verdict in (
            _of_library(criterion, numbers)
            if criterion.number
            else _verdicts(criterion, experiment, recordings)
        )
    ]


def _of_library(criterion: Criterion, numbers: Mapping[str, Number]) -> Iterator[Verdict]:
    if not numbers:
        return
    if criterion.number not in numbers:
        raise UnknownNameError("number of the library", criterion.number, numbers)
    number = numbers[criterion.number]
    text = criterion.text or number.text
    yield _verdict(criterion, "library", number.value, number.unit, text)


def _verdicts(
    criterion: Criterion, experiment: Experiment, recordings: Mapping[str, Recording]
) -> Iterator[Verdict]:
    metric = get_metric(criterion.metric)
    text = criterion.text or metric.description

    def measured(variant: str) -> float:
        return measure(criterion.metric, recordings[variant], **criterion.options)

    together = criterion.together
    if together:
        if set(together) <= recordings.keys():
            value, unit = _joined(criterion, list(map(measured, together)), metric.unit)
            sign = " / " if criterion.ratio else " - " if criterion.difference else ", "
            yield _verdict(criterion, sign.join(together), value, unit, text)
        return
    for variant in criterion.variants or experiment.variants:
        if variant in recordings:
            yield _verdict(criterion, variant, measured(variant), metric.unit, text)


def _joined(criterion: Criterion, values: list[float], unit: str) -> tuple[float, str]:
    """Return what the values of several variants are together, and its unit."""
    if criterion.difference:
        return abs(values[0] - values[1]), unit
    return (quotient(*values) if criterion.ratio else spread(values)), ""


def spread(values: Sequence[float]) -> float:
    """Return (max - min) / mean; NaN if a value is infinite."""
    if not all(map(math.isfinite, values)):
        return math.nan
    return quotient(max(values) - min(values), sum(values) / len(values))


def _verdict(criterion: Criterion, variant: str, measured: float, unit: str, text: str) -> Verdict:
    above, below = criterion.above, criterion.below
    bounds = [f"> {above:g}"] if above is not None else []
    bounds += [f"< {below:g}"] if below is not None else []
    met = (above is None or measured > above) and (below is None or measured < below)
    return Verdict(text, variant, criterion.predicted, measured, unit, ", ".join(bounds), met)


def why_nothing(experiment: Experiment) -> str:
    """Return why nothing was judged, in words."""
    of = {name for c in experiment.criteria for name in c.variants or c.together}
    if not of:
        return "nothing was judged: it has no criteria"
    names = ", ".join(sorted(of))
    return f"nothing was judged: its criteria need variants that did not run, of {names}"


def write_summary(
    path: Path,
    experiment: Experiment,
    recordings: Mapping[str, Recording],
    verdicts: Sequence[Verdict],
    **more: Any,
) -> None:
    """Write summary.json: the claim, each criterion with what was measured, and what diverged.

    It is ``"met": null`` if nothing was judged.

    Args:
        path: of the file.
        experiment: the experiment.
        recordings: of its variants.
        verdicts: on its criteria.
        more: what is written besides; JSON can hold it.
    """
    content = {
        "experiment": experiment.name,
        "claim": experiment.claim,
        "equations": list(experiment.equations),
        "met": all_met(verdicts),
        "criteria": [_json(asdict(verdict)) for verdict in verdicts],
        "diverged": dict(diverged(recordings)),
        **more,
    }
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def diverged(recordings: Mapping[str, Recording]) -> list[tuple[str, float]]:
    """Return the variants that diverged, and when [s]."""
    return [(name, r.diverged) for name, r in recordings.items() if r.diverged is not None]


def _json(values: dict[str, Any]) -> dict[str, Any]:
    """Return values that JSON can hold: it has no infinity and no NaN."""
    return {
        key: str(value) if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }


@dataclass(frozen=True)
class Outcome:
    """What came of an experiment.

    Attributes:
        experiment: which it was.
        folder: what it left.
        verdicts: on its criteria.
        sentence: what it shows, with numbers.
        diverged: variants that diverged, and when [s].
        error: why it could not run, with the last words of a node; "" if it could.
        seconds: of all its runs, each by itself, and of looking at them.
    """

    experiment: Experiment
    folder: Path
    verdicts: tuple[Verdict, ...] = ()
    sentence: str = ""
    diverged: Mapping[str, float] = field(default_factory=dict)
    error: str = ""
    seconds: float = 0.0

    @property
    def met(self) -> bool:
        """Whether it ran, something was judged, and all of that is met."""
        return not self.error and all_met(self.verdicts) is True

    @property
    def missed(self) -> bool:
        """Whether it ran, and a criterion is not met."""
        return not self.error and all_met(self.verdicts) is False

    @property
    def count(self) -> str:
        """How many of its criteria are met, in words."""
        if self.error:
            return "could not run"
        met = sum(verdict.met for verdict in self.verdicts)
        return f"{met} of {len(self.verdicts)} criteria met" if self.verdicts else "nothing judged"

    @property
    def figure(self) -> str:
        """Its picture as SVG; "" if there is none."""
        try:
            return (self.folder / FIGURE).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return ""


def read_outcome(experiment: Experiment, folder: Path, stamp: str) -> Outcome | None:
    """Return the outcome that a folder holds, if it is of the same making; else None."""
    try:
        content = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        is_whole = all((folder / name).is_file() for name in (REPORT, FIGURE))
        if content["stamp"] != stamp or not is_whole:
            return None
        verdicts = tuple(map(verdict_from_json, content["criteria"]))
        sentence, ended = content["sentence"], content["diverged"]
        return Outcome(experiment, folder, verdicts, sentence, ended, seconds=content["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
