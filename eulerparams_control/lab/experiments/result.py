"""What came of an experiment, as summary.json has it: for the terminal and for pages."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eulerparams_control.analysis.verdict import Verdict, all_met, verdict_from_json
from eulerparams_control.lab.experiments.model import Experiment

SUMMARY, REPORT, FIGURE = "summary.json", "report.html", "figure.svg"
"""What an experiment leaves in its folder, beside the bags."""


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
        return _outcome(experiment, folder, content)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _outcome(experiment: Experiment, folder: Path, content: dict[str, Any]) -> Outcome:
    return Outcome(
        experiment,
        folder,
        tuple(map(verdict_from_json, content["criteria"])),
        content["sentence"],
        content["diverged"],
        seconds=content["seconds"],
    )
