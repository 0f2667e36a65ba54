"""An experiment: its variants, criteria, predictions and picture; the equations it is about."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from eulerparams_control.analysis.charts import Chart, Line, Points
from eulerparams_control.analysis.quantities import get_metric
from eulerparams_control.analysis.quantities.base import Prediction
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.faults import Fault
from eulerparams_control.lab.run.run_cache import Run
from eulerparams_control.laws.rotations import Array
from eulerparams_control.resources import config_file

Parameters = dict[str, dict[str, Any]]

_STEP = 2e-3  # [s] of the integration of a form


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
        ideal_joints: whether the simulated joints have neither rotors nor friction.
        halt: [s] of simulated time when ~/halt of its first node is called; inf: it is not.
        reports: whether /diagnostics is recorded in lock-step, too.
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
    ideal_joints: bool = False
    halt: float = math.inf
    reports: bool = False

    @property
    def is_in_real_time(self) -> bool:
        """Whether its nodes run in real time, none waiting for another."""
        return self.real_time or bool(self.faults)


@dataclass(frozen=True)
class ChartOf:
    """A chart whose points are a metric of the variants.

    Attributes:
        metric: its name.
        xlabel, ylabel: of the axes; ylabel "" is that of the metric.
        measured: x by variant, by the label of the line.
        predicted: points by label.
        log, ticks: see :class:`Chart`.
    """

    metric: str
    xlabel: str
    measured: Mapping[str, Mapping[str, float]]
    predicted: Mapping[str, Points] = field(default_factory=dict)
    ylabel: str = ""
    log: str = ""
    ticks: tuple[str, ...] = ()

    def filled(self, measure: Callable[[str, str], float | None]) -> Chart:
        """Return the chart; ``measure(metric, variant)`` is None for what did not run."""
        metric = get_metric(self.metric)
        unit = f" [{metric.unit}]" if metric.unit else ""
        lines = [Line(label, line, "predicted") for label, line in self.predicted.items()]
        for label, variants in self.measured.items():
            found = [(x, measure(self.metric, variant)) for variant, x in variants.items()]
            line = tuple((x, y) for x, y in found if y is not None)
            lines.append(Line(label, line, "measured"))
        ylabel = self.ylabel or f"{metric.description}{unit}"
        return Chart(self.xlabel, ylabel, tuple(lines), self.log, self.ticks)


@dataclass(frozen=True)
class Predicted:
    """A curve that theory predicts.

    Attributes:
        quantity: its name.
        text: what it is, with its equation.
        points: (t, y) of its corners [s]; () if it is a form.
        form: name in ``FORMS``; "" if it has corners.
        options: of the form.
    """

    quantity: str
    text: str
    points: Points = ()
    form: str = ""
    options: dict[str, float] = field(default_factory=dict)

    def over(self, duration: float) -> Prediction:
        """Return the curve from 0 to ``duration`` [s]."""
        if self.form:
            t, y = FORMS[self.form](duration, **self.options)
        else:
            t, y = np.array(self.points).T
            if len(t) == 1:
                t, y = np.array([0.0, duration]), np.repeat(y, 2)
        return Prediction(self.quantity, self.text, t, y)


def error_41(duration: float, error: float, k_Po: float, k_Vo: float) -> tuple[Array, Array]:
    """Return t [s] and the orientation error [deg] of (41), from ``error`` [deg] at rest.

    About a fixed axis (41) is theta'' = -k_Vo theta' - k_Po sin(theta / 2); an error of more
    than 180 deg is one with eta < 0, which is undone the long way.
    """

    def rate(y: Array) -> Array:
        return np.array([y[1], -k_Vo * y[1] - k_Po * math.sin(y[0] / 2)])

    t = np.arange(0.0, duration + _STEP / 2, _STEP)
    y, theta = np.array([math.radians(error), 0.0]), np.empty(len(t))
    for i in range(len(t)):
        theta[i] = y[0]
        a = rate(y)
        b = rate(y + _STEP / 2 * a)
        c = rate(y + _STEP / 2 * b)
        y = y + _STEP / 6 * (a + 2 * b + 2 * c + rate(y + _STEP * c))
    return t, np.degrees(np.minimum(np.abs(theta), np.abs(2 * math.pi - theta)))


FORMS: dict[str, Callable[..., tuple[Array, Array]]] = {"error_41": error_41}
"""Curves that follow from an equation, by name."""


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
