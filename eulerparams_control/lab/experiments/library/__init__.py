"""Experiments in the library alone, without nodes: one file each, found by its name.

A module here has a function ``run`` that returns a :class:`Result`; an experiment's file names
it with ``library: e1``.  A module ``map_NAME`` is a map, see ``_map``.  It needs no ROS, and gives
the same numbers each time.
"""

import importlib
import pkgutil
from concurrent.futures import Executor
from dataclasses import dataclass, field

from matplotlib.figure import Figure

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
        picture: of it: a chart, or the figure of a map; None if there is none.
    """

    numbers: dict[str, Number] = field(default_factory=dict)
    picture: Chart | Figure | None = None


def library_names() -> list[str]:
    """Return the names of the library experiments, sorted."""
    return sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_"))


def is_map(name: str) -> bool:
    """Return whether a library experiment is a map, of many cells."""
    return name.startswith("map_")


def run_library(name: str, pool: Executor | None = None) -> Result:
    """Return what the library experiment of that name finds; raises UnknownNameError.

    Args:
        name: of the module.
        pool: for the cells of a map; None: they are simulated here.
    """
    if name not in library_names():
        raise UnknownNameError("library experiment", name, library_names())
    module = importlib.import_module(f"{__name__}.{name}")
    result: Result
    if is_map(name):
        result = module.result(module.MAP.sweep(module.simulate, pool))
    else:
        result = module.run()
    return result
