"""Contents of the axes of a static figure: curves, predictions, limits and shades."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, LogFormatterSciNotation, NullLocator

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import line
from eulerparams_control.analysis.plots import reached
from eulerparams_control.analysis.poles import merged
from eulerparams_control.analysis.quantity import (
    AnyQuantity,
    JointQuantity,
    Prediction,
    Quantity,
    VectorQuantity,
)
from eulerparams_control.analysis.scale import axis, signed_axis, spans, symmetric_axis
from eulerparams_control.laws.rotations import Array

POLE: dict[str, Any] = {"facecolor": "#cc79a7", "alpha": 0.25, "linewidth": 0, "zorder": 0}
"""Look of the time near a pole of the Euler angles."""

SINGULAR: dict[str, Any] = {
    "facecolor": "none",
    "edgecolor": "0.65",
    "hatch": "//////",
    "linewidth": 0,
    "zorder": 0,
}
"""Look of the time near a kinematic singularity; hatched: it shows on the other and in grey."""

LIMIT: dict[str, Any] = {"color": "0.45", "linestyle": (0, (1, 1.5)), "linewidth": 0.8}
"""Look of a limit of the URDF."""

_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
_POINTS = 0.5  # of print for a pixel of the screen


class Scale(NamedTuple):
    """The axis of values: what :mod:`scale` decided, as numbers of matplotlib.

    Attributes:
        logarithmic: whether it is.
        low, high: its ends.
        step: decades a label, if logarithmic.
    """

    logarithmic: bool
    low: float
    high: float
    step: int = 1

    def clip(self, y: Array) -> Array:
        """Return values moved to just outside the axis where they are far: 1e25 cannot be drawn."""
        far = self.high - self.low
        if self.logarithmic:
            return np.clip(y, self.low / 10, 10 * self.high)
        return np.clip(y, self.low - far, self.high + far)

    def apply(self, axes: Axes) -> None:
        """Give the axes this axis of values."""
        if self.logarithmic:
            axes.set_yscale("log")
            decades = np.arange(np.ceil(np.log10(self.low)), np.floor(np.log10(self.high)) + 1)
            shown = decades[decades % self.step == 0]
            axes.yaxis.set_major_locator(FixedLocator((10.0**shown).tolist()))
            axes.yaxis.set_major_formatter(LogFormatterSciNotation())
            axes.yaxis.set_minor_locator(NullLocator())
        axes.set_ylim(self.low, self.high)


def scales(
    quantity: AnyQuantity, columns: Sequence[Sequence[Array]], limits: Sequence[Array]
) -> list[Scale]:
    """Return the axis of each component of a quantity: what the page decides.

    Args:
        quantity: which.
        columns: for each component the values of each run, and of each prediction.
        limits: of the URDF; those that are near belong to the axis.
    """
    values = [y for column in columns for y in column]
    if isinstance(quantity, VectorQuantity):
        centred = spans(columns, quantity.floor)
        decided = centred or [symmetric_axis(values, quantity.floor)] * len(columns)
        return [_numbers(one, values) for one in decided]
    return [_numbers(_decided(quantity, values, limits), values)] * len(columns)


def _decided(
    quantity: Quantity | JointQuantity, values: Sequence[Array], limits: Sequence[Array]
) -> dict[str, Any]:
    if any((y[np.isfinite(y)] < -quantity.floor).any() for y in values):
        return signed_axis(values, quantity.floor)
    if not quantity.floor:
        return {"type": "linear"}
    shown = [*values, *reached(limits, values)]
    if isinstance(quantity, Quantity):
        return axis(shown, quantity.floor, logarithmic=quantity.logarithmic)
    return axis(shown, quantity.floor, labels=4)


def _numbers(decided: dict[str, Any], values: Sequence[Array]) -> Scale:
    """Return the ends of a plotly axis; from 0 to the largest value if it leaves that open."""
    if "range" in decided:
        low, high = decided["range"]
        if decided["type"] == "log":
            return Scale(True, 10.0**low, 10.0**high, decided["dtick"])
        return Scale(False, low, high)
    finite = [y[np.isfinite(y)].max(initial=0.0) for y in values]
    return Scale(False, 0.0, 1.05 * float(max(finite, default=0.0)) or 1.0)


def draw(axes: Axes, digests: Sequence[Digest], name: str, component: int, shown: Scale) -> None:
    """Draw a component of a quantity of each run that has it."""
    for index, digest in enumerate(digests):
        curves = digest.curves.get(name, ())
        if component < len(curves):
            t, y = curves[component]
            axes.plot(t, shown.clip(y), **look(index, len(digests)))


def look(index: int, count: int) -> dict[str, Any]:
    """Return the look of the lines of a run among ``count``, in print."""
    screen = line(index, count)
    width = _POINTS * float(screen["width"])
    dash = _DASHES[str(screen["dash"])]
    return {"color": screen["color"], "linestyle": dash, "linewidth": width}


def shade(axes: Axes, digests: Sequence[Digest]) -> None:
    """Show when runs were near a pole, and near a kinematic singularity."""
    for start, end in merged(span for digest in digests for span in digest.near_singular):
        axes.axvspan(start, end, **SINGULAR)
    for start, end in merged(span for digest in digests for span in digest.near_pole):
        axes.axvspan(start, end, **POLE)


def predict(axes: Axes, predictions: Sequence[Prediction], component: int, shown: Scale) -> None:
    """Draw what theory says of a component."""
    for index, prediction in enumerate(predictions):
        if (y := column(prediction, component)) is not None:
            axes.plot(prediction.t, shown.clip(y), **predicted_look(index))


def column(prediction: Prediction, component: int) -> Array | None:
    """Return what a prediction says of a component; None if it says nothing."""
    y = prediction.y.reshape(len(prediction.t), -1)
    return y[:, component] if component < y.shape[1] else None


def predicted_look(index: int) -> dict[str, Any]:
    """Return the look of a prediction among those of a quantity."""
    dashes = ((0, (4, 2)), (0, (4, 1.5, 1, 1.5)), (0, (1, 1)))
    return {"color": "black", "linestyle": dashes[index % 3], "linewidth": 0.8, "zorder": 4}


def draw_limits(axes: Axes, limits: Sequence[Array], shown: Scale) -> bool:
    """Draw the limits that are on the axis; return whether there is one."""
    known = np.unique(np.concatenate([np.zeros(0), *limits]))
    on_it = known[(shown.low < known) & (known < shown.high)]
    for value in on_it:
        axes.axhline(value, **LIMIT)
    return bool(len(on_it))
