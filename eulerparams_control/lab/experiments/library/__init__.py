"""Experiments in the library alone, without nodes: one file each, found by its name.

A module here has a function ``run`` that returns a :class:`Result`; an experiment's file names
it with ``library: e1``.  It needs no ROS, and gives the same numbers each time.
"""

import importlib
import pkgutil
from dataclasses import dataclass, field

from eulerparams_control.analysis.charts import Chart
from eulerparams_control.errors import UnknownNameError


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
    """Result of a library experiment.

    Attributes:
        numbers: by name.
        chart: the picture of it; None if there is none.
    """

    numbers: dict[str, Number] = field(default_factory=dict)
    chart: Chart | None = None


def library_names() -> list[str]:
    """Return the names of the library experiments, sorted."""
    return sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))


def run_library(name: str) -> Result:
    """Return what the library experiment of that name finds; raises UnknownNameError."""
    if name not in library_names():
        raise UnknownNameError("library experiment", name, library_names())
    result: Result = importlib.import_module(f"{__name__}.{name}").run()
    return result
