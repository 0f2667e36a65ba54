"""Names and colours that tell runs apart, the same in every plot and table; numbers as text."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eulerparams_control.analysis.recording import RecordedRun

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's, which colour-blind people tell apart."""

DASHES = ("solid", "dash", "dot", "dashdot")
"""Of the lines, once the colours are used up."""

PREDICTION_DASHES = ("dash", "dashdot", "dot")
"""Of the lines that are predicted, in a page."""


def labels(runs: "Sequence[RecordedRun]") -> list[str]:
    """Return a name for each run: its folder, with as many parents as it takes to differ.

    The namespace of the arm comes after it, where there is one.
    """
    arms = [run.namespace for run in runs]
    paths = [run.path.resolve() for run in runs]
    depth = max((len(path.parts) for path in paths), default=1)
    for parts in range(1, depth + 1):
        names = [f"{Path(*p.parts[-parts:])}{arm}" for p, arm in zip(paths, arms, strict=True)]
        if len(set(names)) == len(names):
            return names
    return [f"{i}: {path.name}" for i, path in enumerate(paths, 1)]  # the same bag twice


def sequences(runs: "Sequence[RecordedRun]") -> str:
    """Return the names of the Euler angles of some runs, most often one."""
    return "/".join(sorted({run.sequence.name for run in runs}))


def colour(index: int) -> str:
    """Return the colour of a run."""
    return COLOURS[index % len(COLOURS)]


def dash(index: int) -> str:
    """Return the dash of the lines of a run."""
    return DASHES[index // len(COLOURS) % len(DASHES)]


def line(index: int, count: int) -> dict[str, str | float]:
    """Return the look of the lines of a run among ``count``.

    The first is the widest: it shows beneath those that cover it.
    """
    width = 1.6 + 2.4 * (1 - (index + 1) / count)
    return {"color": colour(index), "dash": dash(index), "width": round(width, 2)}


def number(value: float) -> str:
    """Return a number with three significant digits, in powers of ten where that is shorter."""
    if not math.isfinite(value) or value == 0:
        return f"{value:g}"
    if 1e-3 <= abs(value) < 1e5:
        digits = max(0, 2 - math.floor(math.log10(abs(value))))
        return f"{value:.{digits}f}"
    return f"{value:.2e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def quantity(value: float, unit: str) -> str:
    """Return a number and its unit."""
    return f"{number(value)} {unit}".rstrip()
