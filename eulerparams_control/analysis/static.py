"""Static figures for papers: one column wide, each quantity its own file.

digests = [Digest.of(load(bag)) for bag in bags]
write_figures("figures", digests, formats=("pdf",))
"""

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.grids import joint_titles
from eulerparams_control.analysis.labels import labels, sequences
from eulerparams_control.analysis.plots import limits_of
from eulerparams_control.analysis.quantities import EVERYTHING
from eulerparams_control.analysis.quantity import (
    AnyQuantity,
    JointQuantity,
    Prediction,
    VectorQuantity,
)
from eulerparams_control.analysis.static_axes import (
    LIMIT,
    POLE,
    SINGULAR,
    column,
    draw,
    draw_limits,
    look,
    predict,
    predicted_look,
    scales,
    shade,
)
from eulerparams_control.analysis.static_image import (
    FORMATS,
    STYLE,
    WIDTH,
    image,
    plain,
    svg,
    write,
)
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.rotations import Array

__all__ = ["quantity_figure", "svg", "write_figures"]

_ROW = 0.145  # [in] of a line of the legend


def write_figures(
    folder: str | Path,
    digests: Sequence[Digest],
    formats: Sequence[str] = ("svg", "png"),
    predictions: Sequence[Prediction] = (),
) -> list[Path]:
    """Write one file a format for each quantity that some run has; return them.

    Args:
        folder: made if it does not exist.
        digests: of the runs, laid over each other.
        formats: of "svg", "png" and "pdf".
        predictions: drawn with the quantities that they belong to.

    Raises:
        UnknownNameError: for another format.
        ConfigurationError: a file cannot be written.
    """
    for name in formats:
        if name not in FORMATS:
            raise UnknownNameError("format", name, FORMATS)
    written = []
    for quantity in EVERYTHING:
        if any(quantity.name in digest.curves for digest in digests):
            figure = quantity_figure(digests, quantity, predictions)
            for name in formats:
                written.append(Path(folder) / f"{quantity.name}.{name}")
                write(written[-1], image(figure, name))
    return written


def quantity_figure(
    digests: Sequence[Digest], quantity: AnyQuantity, predictions: Sequence[Prediction] = ()
) -> Figure:
    """Return a quantity of all runs over time; vectors and joints as stacked axes.

    Args:
        digests: of the runs.
        quantity: which.
        predictions: those of other quantities are left out.

    Raises:
        ConfigurationError: no run has the quantity.
    """
    theory = [prediction for prediction in predictions if prediction.quantity == quantity.name]
    columns = _columns(digests, quantity, theory)
    if not columns:
        raise ConfigurationError(f"no run has recorded {quantity.name}: there is nothing to draw")
    with mpl.rc_context(STYLE):
        figure, axes = _figure(len(columns), isinstance(quantity, JointQuantity))
        limited = _draw(axes, digests, quantity, theory, columns)
        axes[0].set_xlim(min(d.start for d in digests), max(d.end for d in digests))
        _name_axes(figure, axes, quantity, digests)
        _add_legend(figure, _legend(digests, theory, limited))
    return figure


def _draw(
    axes: Sequence[Axes],
    digests: Sequence[Digest],
    quantity: AnyQuantity,
    theory: Sequence[Prediction],
    columns: Sequence[Sequence[Array]],
) -> bool:
    """Draw each component into its axes; return whether a limit of the URDF is among it."""
    limits = _limits(quantity, digests)
    limited = False
    for i, (one, shown) in enumerate(zip(axes, scales(quantity, columns, limits), strict=True)):
        shown.apply(one)
        shade(one, digests)
        draw(one, digests, quantity.name, i, shown)
        predict(one, theory, i, shown)
        own = [x[i : i + 1] for x in limits] if isinstance(quantity, JointQuantity) else limits
        limited |= draw_limits(one, own, shown)
    return limited


def _figure(components: int, wide: bool) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes that share time: one above the other, joints in two columns."""
    columns = 2 if wide and components > 3 else 1
    rows = math.ceil(components / columns)
    height = 1.9 if components == 1 else 0.35 + 0.9 * rows
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for spare in grid.flat[components:]:
        spare.remove()
    for below in grid[-2][columns - (rows * columns - components) :] if rows > 1 else ():
        below.xaxis.set_tick_params(labelbottom=True)  # nothing is under it
    return figure, list(grid.flat[:components])


def _name_axes(
    figure: Figure, axes: Sequence[Axes], quantity: AnyQuantity, digests: Sequence[Digest]
) -> None:
    label = quantity.label.format(sequence=sequences(digests))
    if len(axes) == 1:
        axes[0].set_ylabel(label, parse_math=False)
        axes[0].set_xlabel("time [s]")
        return
    figure.supylabel(label, fontsize=8, parse_math=False)
    figure.supxlabel("time [s]", fontsize=8)
    names: Sequence[str] = joint_titles(digests)
    if isinstance(quantity, VectorQuantity):
        names = quantity.components
    for one, name in zip(axes, names, strict=False):
        one.set_title(plain(name, 30), loc="left", fontsize=7, pad=2, parse_math=False)


def _columns(
    digests: Sequence[Digest], quantity: AnyQuantity, predictions: Sequence[Prediction]
) -> list[list[Array]]:
    """Return what the axis of each component has to show."""
    curves = [digest.curves.get(quantity.name, ()) for digest in digests]
    columns = []
    for i in range(max(map(len, curves), default=0)):
        theory = [column(prediction, i) for prediction in predictions]
        columns.append(
            [run[i].y for run in curves if i < len(run)] + [y for y in theory if y is not None]
        )
    return columns


def _limits(quantity: AnyQuantity, digests: Sequence[Digest]) -> list[Array]:
    """Return the (n,) limits of the robots whose runs have the quantity."""
    if isinstance(quantity, VectorQuantity) or quantity.limits is None:
        return []
    runs = [index for index, digest in enumerate(digests) if quantity.name in digest.curves]
    return limits_of(quantity.limits, digests, runs)


def _legend(
    digests: Sequence[Digest], predictions: Sequence[Prediction], limits: bool
) -> list[tuple[Line2D | Patch, str]]:
    """Return the keys and their texts, for what is there to tell apart."""
    runs = enumerate(labels(digests))
    keys: list[tuple[Line2D | Patch, str]] = [
        (Line2D([], [], **look(index, len(digests))), name) for index, name in runs
    ]
    for index, prediction in enumerate(predictions):
        keys.append((Line2D([], [], **predicted_look(index)), prediction.text))
    if limits:
        keys.append((Line2D([], [], **LIMIT), "limit of the URDF"))
    if any(digest.near_pole for digest in digests):
        keys.append((Patch(**POLE), f"near the pole of {sequences(digests)}"))
    if any(digest.near_singular for digest in digests):
        keys.append((Patch(**SINGULAR), "near a kinematic singularity"))
    return keys


def _add_legend(figure: Figure, keys: Sequence[tuple[Line2D | Patch, str]]) -> None:
    """Put the legend above the axes, outside the curves; the figure grows by its lines."""
    texts = [plain(text) for _, text in keys]
    columns = 2 if max(map(len, texts)) <= 26 else 1
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _ROW * math.ceil(len(texts) / columns))
    handles = [handle for handle, _ in keys]
    legend = figure.legend(
        handles, texts, loc="outside upper center", ncols=columns, handlelength=2.2, borderpad=0.1
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
