"""All quantities of a run, and the numbers made of them; importing this registers them.

A new one is a function in a module here, which is found by being there: ``drawn`` gives it a plot,
``reduced`` makes metrics of it, ``row`` puts one into the table.  Options that many numbers have:

``of``  what it looks at: the ``command`` (joint_reference), the motion that was ``measured``
    (joint_states), or the ``leading`` of them, which is the default: the command if there
    is one, as with kinematic control, else the measured motion, as with dynamic control.
``after``, ``before``  [s] the time that it looks at, both ends included.
``against``  what an error is measured from: the ``desired`` frame or the ``compliant`` one.
``axis``, ``frame``, ``window``  of vectors: see ``contact``.
"""

import importlib
import pkgutil

from eulerparams_control.analysis.quantities.base import (
    METRICS,
    PLOTS,
    ROWS,
    Metric,
    Quantity,
    TableNumber,
    get_metric,
    measure,
    quotient,
)

__all__ = [
    "BY_NAME",
    "EVERYTHING",
    "METRICS",
    "NUMBERS",
    "Metric",
    "TableNumber",
    "get_metric",
    "measure",
    "quotient",
]

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)

EVERYTHING: tuple[Quantity, ...] = tuple(PLOTS[place] for place in sorted(PLOTS))
"""In the order of the page."""

BY_NAME = {quantity.name: quantity for quantity in EVERYTHING}

NUMBERS: tuple[TableNumber, ...] = tuple(ROWS[place] for place in sorted(ROWS))
"""Of the table, in its order."""
