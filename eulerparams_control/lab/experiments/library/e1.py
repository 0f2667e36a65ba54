"""E1: (1)-(17) hold for random samples and all 12 sequences, but as errata say of the print."""

from collections.abc import Iterable
from itertools import chain

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._errata import errata
from eulerparams_control.lab.experiments.library._section_2 import angles, one_frame, two_frames

ALGEBRAIC, DIFFERENCES, TWICE = 1e-12, 1e-8, 1e-7
PRINTED = "as printed"

_BY_DIFFERENCES = ("(1)", "(3)", "(8)", "(9)", "(14)", "(16)", "(17)", "(24)", "(59)")
_BY_SECOND_DIFFERENCES = ("(38)", "(50)")
_FIRST_ORDER = "(62)"
_LEAST = 1e-17  # what is drawn for a residual of 0


def run() -> Result:
    """Return the largest residual of each equation, as it holds and as it is printed."""
    found = residuals(chain(one_frame(), angles(), two_frames(), errata()))
    holds = {name: value for name, value in found.items() if PRINTED not in name}
    others = (*_BY_DIFFERENCES, *_BY_SECOND_DIFFERENCES, _FIRST_ORDER)
    algebraic = [n for n in holds if n not in others]
    numbers = {
        "algebraic": Number(
            max(holds[n] for n in algebraic), "largest residual of the algebraic equations"
        ),
        "differences": Number(
            max(holds[n] for n in _BY_DIFFERENCES), "largest residual by central differences"
        ),
    }
    return Result(numbers | dict(map(_number, found.items())), _chart(found))


def residuals(samples: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Return the largest residual by the name of the equation."""
    found: dict[str, float] = {}
    for name, value in samples:
        found[name] = max(found.get(name, 0.0), value)
    return dict(sorted(found.items(), key=lambda item: int(item[0][1:].split(")")[0])))


def _number(item: tuple[str, float]) -> tuple[str, Number]:
    """Return a residual with a name that a file can have, such as ``eq_4_as_printed``."""
    name, value = item
    key = "".join(c if c.isalnum() else "_" for c in name.replace("'", "t"))
    return "eq_" + "_".join(filter(None, key.split("_"))), Number(value, f"residual of {name}")


def _chart(found: dict[str, float]) -> Chart:
    equations = list(dict.fromkeys(name.split(" ")[0] for name in found))
    last = len(equations) - 1.0

    def line(label: str, suffix: str) -> Line:
        names = {i: name + suffix for i, name in enumerate(equations)}
        points = [(float(i), max(found[n], _LEAST)) for i, n in names.items() if n in found]
        return Line(label, tuple(points))

    bounds = (
        (TWICE, "bound by second differences"),
        (DIFFERENCES, "bound by differences"),
        (ALGEBRAIC, "bound, algebraic"),
    )
    return Chart(
        "equation",
        "residual",
        (
            *(Line(text, ((0.0, y), (last, y)), "bound") for y, text in bounds),
            line("as it holds", ""),
            line(PRINTED, f" {PRINTED}"),
        ),
        log="y",
        ticks=tuple(equations),
    )
