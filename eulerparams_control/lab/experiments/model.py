"""An experiment: its variants, criteria, predictions and picture; the equations it is about."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from eulerparams_control.analysis.quantities.base import Prediction
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.experiments.drawn import ChartOf, Predicted
from eulerparams_control.lab.faults.base import Fault
from eulerparams_control.lab.run.run_cache import Run
from eulerparams_control.resources import config_file

Parameters = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Criterion:
    """A bound on a metric of a variant, of several together, or on a number of the library.

    Attributes:
        metric: name in ``METRICS``; "" if it is on a number.
        variants: that have to meet it, each one by itself; () is all.
        ratio: instead, two variants whose metrics are divided, the first by the second.
        difference: instead, two variants whose metrics are subtracted, without the sign.
        spread: instead, variants of whose metrics (max - min) / mean is taken.
        above, below: the bounds; None if there is none.
        predicted: what theory or a prototype gives, as text; "" if nothing.
        options: passed to the metric.
        text: what it shows, in words; "" takes that of the metric or of the number.
        number: name of a number of the library experiment; "" if it is on a metric.
    """

    metric: str = ""
    variants: tuple[str, ...] = ()
    ratio: tuple[str, ...] = ()
    difference: tuple[str, ...] = ()
    spread: tuple[str, ...] = ()
    above: float | None = None
    below: float | None = None
    predicted: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    text: str = ""
    number: str = ""

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
        may_diverge: whether the run may end early, its state non-finite.
        faults: that happen in it; with some it is in real time.
        fault_seed: of what is random in them.
        real_time: whether it is in real time without faults, too, else in lock-step.
    """

    nodes: Parameters
    duration: float
    robot: str = "ur5"
    controller: str = "clik"
    start_at_reference: bool = False
    start_turn: tuple[float, ...] = (0.0, 0.0, 0.0)
    may_diverge: bool = False
    faults: tuple[Fault, ...] = ()
    fault_seed: int = 0
    real_time: bool = False

    @property
    def is_in_real_time(self) -> bool:
        """Whether its nodes run in real time, none waiting for another."""
        return self.real_time or bool(self.faults)


@dataclass(frozen=True)
class Experiment:
    """An experiment.

    Attributes:
        name: of its file.
        claim: what it shows.
        equations: of the paper that it is about.
        variants: its runs, by name; none if it is in the library alone.
        criteria: what has to hold; the one that matters most first.
        summary: one sentence with numbers; see ``analysis.headline.fill``.
        picture: name of the quantity that the page begins with.
        library: name of what is calculated without nodes, a module of
            ``experiments.library``; "" if nothing.
        predictions: curves over time that theory predicts.
        chart: what is drawn over a parameter; None if nothing.
        source: the name or path by which it was loaded.
    """

    name: str
    claim: str
    equations: tuple[str, ...]
    variants: dict[str, Variant]
    criteria: tuple[Criterion, ...]
    summary: str = ""
    picture: str = "orientation_error"
    library: str = ""
    predictions: tuple[Predicted, ...] = ()
    chart: ChartOf | None = None
    source: str = ""

    def options(self, metric: str, variant: str) -> dict[str, Any]:
        """Return the options of the first criterion on a metric of a variant; {} if none is."""
        for criterion in self.criteria:
            named = criterion.variants or criterion.together
            if criterion.metric == metric and (variant in named or not named):
                return criterion.options
        return {}

    def predicted(self, variants: Sequence[str]) -> list[Prediction]:
        """Return the predicted curves over the time of the longest of these variants."""
        duration = max((self.variants[name].duration for name in variants), default=0.0)
        return [prediction.over(duration) for prediction in self.predictions]


@dataclass
class Task:
    """An experiment that is to be run.

    Attributes:
        experiment: which.
        folder: where its results go.
        variants: those to run.
        runs: those that have ended; None for one that could not.
        error: why one could not; "" if all could.
    """

    experiment: Experiment
    folder: Path
    variants: Sequence[str]
    runs: dict[str, Run | None] = field(default_factory=dict)
    error: str = ""


class Equation(NamedTuple):
    """An equation of the paper, as ``config/paper/equations.yaml`` has it.

    Attributes:
        number: as the paper has it, such as ``(28)``.
        text: as it holds.
        printed: what the paper prints instead, or what it leaves out; "" if it is right.
    """

    number: str
    text: str
    printed: str = ""


@cache
def _all() -> dict[int, dict[str, str]]:
    text = config_file("paper", "equations").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text))


def equation(number: str) -> Equation:
    """Return an equation by its number, such as ``(28)``; a reference is returned as it is.

    Raises:
        UnknownNameError: if the paper has no such equation, or it is not written out here.
    """
    inner = number.strip("()")
    if not inner.isdigit():
        return Equation(number, "")
    if int(inner) not in _all():
        raise UnknownNameError("equation", number, (f"({n})" for n in _all()))
    return Equation(number, **_all()[int(inner)])
