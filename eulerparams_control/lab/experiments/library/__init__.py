"""Experiments in the library alone, without nodes: one file each, found by its name.

A module here has a function ``run`` that returns a :class:`Result`; an experiment's file names
it with ``library: e1``.  It needs no ROS, and gives the same numbers each time.
"""

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.experiments.charts import Chart


@dataclass(frozen=True)
class Number:
    """A number of a library experiment.

    Attributes:
        value: the number.
        text: what it is.
        unit: of it; "" if none.
    """

    value: float
    text: str
    unit: str = ""


@dataclass(frozen=True)
class Result:
    """What a library experiment found.

    Attributes:
        numbers: by name.
        chart: the picture of it; None if there is none.
    """

    numbers: dict[str, Number] = field(default_factory=dict)
    chart: Chart | None = None

    def to_json(self) -> dict[str, Any]:
        """Return what JSON can hold, which has no infinity and no NaN."""
        numbers = {name: [str(n.value), n.text, n.unit] for name, n in self.numbers.items()}
        return {"numbers": numbers, "chart": self.chart and self.chart.to_json()}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Result":
        """Return the result of :meth:`to_json`."""
        numbers = {
            n: Number(float(v), text, unit) for n, (v, text, unit) in content["numbers"].items()
        }
        return cls(numbers, content["chart"] and Chart.from_json(content["chart"]))


def library_names() -> list[str]:
    """Return the names of the library experiments, sorted."""
    return sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))


def run_library(name: str) -> Result:
    """Return what the library experiment of that name finds; raises UnknownNameError."""
    if name not in library_names():
        raise UnknownNameError("library experiment", name, library_names())
    result: Result = importlib.import_module(f"{__name__}.{name}").run()
    return result
