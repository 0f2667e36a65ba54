"""Pictures in an experiment's file: a chart over a parameter, predicted curves over time.

chart:                          # what was measured against what is predicted
  metric: final_moment          # with the options of a criterion on it
  xlabel: beta [deg]
  log: y                        # the axes that are logarithmic: x, y or xy
  measured:
    Euler parameters: {parameters_0_5: 0.5, parameters_60: 60.0}
  predicted:
    50 sin(theta): [[0.5, 7.903], [85.0, 7.903]]
predictions:                    # of theory for a quantity over time
  - {quantity: moment, text: "50 sin(theta) = 500 (10 deg - theta)", value: 7.903}
  - {quantity: force, text: ..., points: [[0.0, 0.0], [1.0, 9.52]]}
  - {quantity: orientation_error, text: (41), form: error_41,
     options: {error: 30.0, k_Po: 100.0, k_Vo: 14.142}}
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line, Points, picture
from eulerparams_control.analysis.quantities import get_metric
from eulerparams_control.analysis.quantities.base import Prediction
from eulerparams_control.lab.run.yaml_checks import (
    check_call,
    check_keys,
    is_number,
    known,
    points,
    require,
)
from eulerparams_control.laws.rotations import Array

_STEP = 2e-3  # [s] of the integration of a form


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
