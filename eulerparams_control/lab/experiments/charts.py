"""A chart of numbers over a parameter: what was measured against what is predicted.

    chart:
      metric: final_moment          # with the options of a criterion on it
      xlabel: beta [deg]
      log: y                        # the axes that are logarithmic: x, y or xy
      measured:
        Euler parameters: {parameters_0_5: 0.5, parameters_60: 60.0}
      predicted:
        50 sin(theta): [[0.5, 7.903], [85.0, 7.903]]
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from eulerparams_control.analysis.charts import Chart, Line, Points
from eulerparams_control.analysis.quantities import get_metric
from eulerparams_control.lab.experiments.yaml_checks import is_number, known, points, require

_KEYS = ("metric", "xlabel", "ylabel", "log", "ticks", "measured", "predicted")


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
    predicted: Mapping[str, Points]
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
    require(isinstance(content, dict), f"chart: expected the keys {', '.join(_KEYS)}")
    for key in content:
        known("key of a chart", key, _KEYS)
    for key in ("metric", "xlabel", "measured"):
        require(key in content, f"chart: the key '{key}' is missing")
    require(content.get("log", "") in ("", "x", "y", "xy"), "chart: log: expected x, y or xy")
    measured, predicted = content["measured"], content.get("predicted") or {}
    require(isinstance(measured, dict) and measured, "chart: measured: expected lines by name")
    require(isinstance(predicted, dict), "chart: predicted: expected lines by name")
    for label, line in measured.items():
        require(isinstance(line, dict) and line, f"chart: {label}: expected x by variant")
        for variant, x in line.items():
            known("variant in the chart", variant, variants)
            require(is_number(x), f"chart: {label}: {variant}: expected a number")
    return ChartOf(
        get_metric(str(content["metric"])) and str(content["metric"]),
        str(content["xlabel"]),
        {str(name): {v: float(x) for v, x in line.items()} for name, line in measured.items()},
        {str(name): points(f"chart: {name}", line) for name, line in predicted.items()},
        str(content.get("ylabel", "")),
        str(content.get("log", "")),
        tuple(map(str, content.get("ticks") or ())),
    )
