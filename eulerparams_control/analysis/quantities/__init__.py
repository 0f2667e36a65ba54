"""All quantities of a run, and the numbers made of them; importing this registers them.

A new one is a function, its reductions and its plot in a module here, found by being there:
``PLACES`` maps a position on the page to plots, ``ROWS`` a position in the table to numbers.
Options that many numbers have:

``of``  what it looks at: the ``command`` (joint_reference), the motion that was ``measured``
    (joint_states), or the ``leading`` of them, which is the default: the command if there
    is one, as with kinematic control, else the measured motion, as with dynamic control.
``after``, ``before``  [s] the time that it looks at, both ends included.
``against``  what an error is measured from: the ``desired`` frame or the ``compliant`` one.
``axis``, ``frame``, ``window``  of vectors: see ``contact``.
"""

import importlib
import pkgutil
from typing import Any

from eulerparams_control.analysis.quantities.base import (
    METRICS,
    Metric,
    Quantity,
    TableNumber,
    get_metric,
    measure,
    quotient,
)
from eulerparams_control.analysis.quantities.errors import ORIENTATION_ERROR
from eulerparams_control.analysis.quantities.motion import EFFORT, JOINT_SPEED, POLE_DISTANCE
from eulerparams_control.analysis.quantities.shaping import DASHED

__all__ = [
    "DASHED",
    "EFFORT",
    "EVERYTHING",
    "JOINT_QUANTITIES",
    "JOINT_SPEED",
    "METRICS",
    "NUMBERS",
    "ORIENTATION_ERROR",
    "POLE_DISTANCE",
    "QUANTITIES",
    "VECTOR_QUANTITIES",
    "Metric",
    "TableNumber",
    "get_metric",
    "measure",
    "quotient",
]


def _by_place(name: str) -> list[Any]:
    """Return what the modules here have under a name, by its place."""
    places: dict[float, Any] = {}
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        own = getattr(importlib.import_module(module.name), name, {})
        if twice := places.keys() & own.keys():
            raise ValueError(f"{module.name}: {name} {min(twice):g} is taken")
        places |= own
    return [places[place] for place in sorted(places)]


EVERYTHING: tuple[Quantity, ...] = tuple(
    each for some in _by_place("PLACES") for each in (some if isinstance(some, tuple) else (some,))
)
"""In the order of the page; the last are drawn dashed with another one."""

QUANTITIES = tuple(q for q in EVERYTHING if not q.components and q not in DASHED.values())
"""The first is the picture that matters, unless another is named."""

VECTOR_QUANTITIES = tuple(q for q in EVERYTHING if q.is_vector)
JOINT_QUANTITIES = tuple(q for q in EVERYTHING if q.is_of_joints)

NUMBERS: tuple[TableNumber, ...] = tuple(_by_place("ROWS"))
"""Of the table, in its order."""
