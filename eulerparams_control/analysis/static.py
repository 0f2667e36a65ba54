"""Static figures for papers: one column wide, drawn with matplotlib.

digests = [Digest.of(load(bag)) for bag in bags]
write_figures("figures", digests, formats=("pdf",))
"""

import hashlib
import io
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, LogFormatterSciNotation, NullLocator

from eulerparams_control.analysis.charts import Chart, Line, Scale, panel
from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import line, sequences
from eulerparams_control.analysis.quantities import EVERYTHING
from eulerparams_control.analysis.quantities.base import Prediction, Quantity
from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.rotations import Array

WIDTH = 3.5
"""[in] of a column of a paper."""

FORMATS = ("svg", "png", "pdf")

STYLE: dict[Any, Any] = {
    "font.family": ["STIXGeneral", "DejaVu Sans"],  # both come with matplotlib: same everywhere
    "mathtext.fontset": "stix",
    "font.size": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "axes.linewidth": 0.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.linewidth": 0.3,
    "grid.color": "0.85",
    "hatch.linewidth": 0.4,
    "legend.frameon": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "eulerparams_control",
    "pdf.fonttype": 42,
}
"""Of every static figure."""

_LONGEST = 46  # characters of a name in the legend
_REFERENCE = re.compile(r'(id="|href="#|url\(#)')


def svg(figure: Figure) -> str:
    """Return a figure as SVG: the same text each time, for a file or a page.

    Its ids, and so its style, are its own: they are made from its content.
    """
    text = _image(figure, "svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    own = f"f{hashlib.sha1(text, usedforsecurity=False).hexdigest()[:10]}-"
    whole = _REFERENCE.sub(rf"\g<1>{own}", text.decode("utf-8"))
    return whole[whole.index("<svg") :].replace(">*{", f">#{own}figure_1 *{{", 1)


def image(figure: Figure, name: str) -> bytes:
    """Return a figure in a format: the same bytes each time."""
    if name == "svg":
        return svg(figure).encode("utf-8")
    if name == "pdf":
        return _image(figure, name, metadata=dict.fromkeys(("Creator", "Producer", "CreationDate")))
    return _image(figure, name, metadata={"Software": None}, dpi=300)


def write(path: Path, content: bytes) -> None:
    """Write a file and its folders; raises ConfigurationError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error}") from error


def plain(text: str, longest: int = _LONGEST) -> str:
    """Return a text from outside as one printable line, its middle left out if it is long."""
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    half = longest // 2
    return text if len(text) <= longest else f"{text[: half - 1]}…{text[-half:]}"


def _image(figure: Figure, name: str, **how: Any) -> bytes:
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # of a name: a box is drawn
        figure.savefig(buffer, format=name, **how)
    return buffer.getvalue()


__all__ = ["chart_figure", "quantity_figure", "svg", "write_figures"]

_ROW = 0.145  # [in] of a line of the legend
_SHORT = 28  # characters of a name in a legend of two columns
_POINTS = 0.5  # of print for a pixel of the screen
_WIDE = 2.2  # of a line over a parameter
_MARKERS = "osD^vP"
_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
_PREDICTED_DASHES = ((4, 2), (4, 1.5, 1, 1.5), (2, 1.5), (10, 2))
_DOTTED: dict[str, Any] = {"color": "0.45", "linestyle": (0, (1, 1.5)), "linewidth": 0.8}
_POLE: dict[str, Any] = {"facecolor": "#cc79a7", "alpha": 0.25, "linewidth": 0, "zorder": 0}
_SINGULAR: dict[str, Any] = {  # hatched: it shows on the other and in grey
    **{"facecolor": "none", "edgecolor": "0.65", "hatch": "//////", "linewidth": 0, "zorder": 0}
}

type _Keys = dict[str, Line2D | Patch]


def write_figures(
    folder: str | Path,
    digests: Sequence[Digest],
    formats: Sequence[str] = ("svg", "png"),
) -> list[Path]:
    """Write one file a format for each quantity that some run has; return them.

    Args:
        folder: made if it does not exist.
        digests: of the runs, laid over each other.
        formats: of "svg", "png" and "pdf".

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
            figure = quantity_figure(digests, quantity)
            for name in formats:
                written.append(Path(folder) / f"{quantity.name}.{name}")
                write(written[-1], image(figure, name))
    return written


@mpl.rc_context(STYLE)
def quantity_figure(
    digests: Sequence[Digest],
    quantity: Quantity,
    predictions: Sequence[Prediction] = (),
    bounds: Sequence[float] = (),
) -> Figure:
    """Return a quantity of all runs over time; vectors and joints as stacked axes.

    Args:
        digests: of the runs.
        quantity: which.
        predictions: those of other quantities are left out.
        bounds: of criteria, drawn dotted where they are on the axis.

    Raises:
        ConfigurationError: no run has the quantity.
    """
    drawn = panel(quantity, digests, predictions)
    if drawn is None:
        raise ConfigurationError(f"no run has recorded {quantity.name}: there is nothing to draw")
    texts = [prediction.text for prediction in drawn.predictions]
    charts = [replace(chart, lines=tuple(_named(chart, texts))) for chart in drawn.charts]
    figure, axes = _figure(len(charts), quantity.is_of_joints)
    keys: _Keys = {}
    for one, chart in zip(axes, charts, strict=True):
        keys |= _draw(one, chart)
        low, high = one.get_ylim()
        for bound in bounds:
            if low < bound < high:
                one.axhline(bound, **_DOTTED)
    if any(chart.near_pole for chart in charts):
        keys[f"near the pole of {sequences(digests)}"] = Patch(**_POLE)
    if any(chart.near_singular for chart in charts):
        keys["near a kinematic singularity"] = Patch(**_SINGULAR)
    return _finished(figure, charts, axes, keys)


@mpl.rc_context(STYLE)
def chart_figure(chart: Chart) -> Figure:
    """Return a chart over a parameter."""
    figure, axes = _figure(1, False)
    return _finished(figure, [chart], axes, _draw(axes[0], chart))


def _named(chart: Chart, texts: Sequence[str]) -> Iterator[Line]:
    """Yield the lines of a chart, those that are predicted with their equations."""
    for index, one in chart.indexed():
        yield replace(one, label=texts[index]) if one.kind == "predicted" else one


def _figure(components: int, wide: bool) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes that share x: one above the other, joints in two columns."""
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


def _draw(axes: Axes, chart: Chart) -> _Keys:
    """Draw a chart into its axes; return the keys of its lines by their labels."""
    for spans, look in ((chart.near_singular, _SINGULAR), (chart.near_pole, _POLE)):
        for start, end in spans:
            axes.axvspan(start, end, **look)
    keys: _Keys = {}
    for index, one in chart.indexed():
        x, y = one.xy
        look = _look(one, index, chart.runs)
        axes.plot(x, y if chart.scale is None else _clipped(y, chart.scale), **look)
        if one.label:
            keys.setdefault(one.label, Line2D([], [], **look))
    if chart.scale is None:
        _fit(axes, chart)
    else:
        _apply(axes, chart.scale)
        on_it = [limit for limit in chart.limits if chart.scale.low < limit < chart.scale.high]
        for limit in on_it:
            axes.axhline(limit, **_DOTTED)
        keys |= {"limit of the URDF": Line2D([], [], **_DOTTED)} if on_it else {}
    if chart.span is not None:
        axes.set_xlim(*chart.span)
    return keys


def _look(one: Line, index: int, runs: int) -> dict[str, Any]:
    if one.kind == "bound":
        return _DOTTED
    if one.kind == "predicted":
        dashes = (0, _PREDICTED_DASHES[index % len(_PREDICTED_DASHES)])
        return {"color": "black", "linestyle": dashes, "linewidth": 0.8, "zorder": 4}
    screen = line(index, runs or index + 1)
    look: dict[str, Any] = {"color": screen["color"], "linestyle": "none"}
    if not one.markers:
        dash = _DASHES[str(screen["dash"])]
        width = _POINTS * float(screen["width"]) if runs else _WIDE  # shows beneath a prediction
        return look | {"linestyle": dash, "linewidth": width}
    if one.kind == "point":
        return look | {"marker": "D", "markersize": 3}
    hollow = {"markersize": 5, "markerfacecolor": "none", "markeredgewidth": 1.2}
    return look | {"marker": _MARKERS[index % len(_MARKERS)], **hollow}  # what lies beneath shows


def _clipped(y: Array, scale: Scale) -> Array:
    """Return values moved to just outside the axis where they are far: 1e25 cannot be drawn."""
    far = scale.high - scale.low
    if scale.logarithmic:
        return np.clip(y, scale.low / 10, 10 * scale.high)
    return np.clip(y, scale.low - far, scale.high + far)


def _apply(axes: Axes, scale: Scale) -> None:
    """Give axes this scale of values."""
    if scale.logarithmic:
        axes.set_yscale("log")
        decades = np.arange(np.ceil(np.log10(scale.low)), np.floor(np.log10(scale.high)) + 1)
        shown = decades[decades % scale.step == 0]
        axes.yaxis.set_major_locator(FixedLocator((10.0**shown).tolist()))
        axes.yaxis.set_major_formatter(LogFormatterSciNotation())
        axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(scale.low, scale.high)


def _fit(axes: Axes, chart: Chart) -> None:
    """Let axes show all lines of a chart without a scale."""
    axes.margins(y=0.1)
    if "x" in chart.log:
        axes.set_xscale("log")
    if "y" in chart.log:
        axes.set_yscale("log")
    elif all((one.xy[1] >= 0).all() for one in chart.lines):
        axes.set_ylim(bottom=0.0)
    if chart.ticks:
        axes.set_xticks(range(len(chart.ticks)), chart.ticks)
        axes.tick_params("x", labelrotation=90 if len(chart.ticks) > 6 else 0)
        axes.set_xlim(-0.5, len(chart.ticks) - 0.5)


def _finished(figure: Figure, charts: Sequence[Chart], axes: Sequence[Axes], keys: _Keys) -> Figure:
    """Return a figure with its names, and the legend above the axes: it grows by its lines."""
    if len(axes) == 1:
        axes[0].set_xlabel(charts[0].xlabel, parse_math=False)
        axes[0].set_ylabel(charts[0].ylabel, parse_math=False)
    else:
        figure.supxlabel(charts[0].xlabel, fontsize=8)
        figure.supylabel(charts[0].ylabel, fontsize=8, parse_math=False)
        for one, chart in zip(axes, charts, strict=True):
            name = plain(chart.title, 30)
            one.set_title(name, loc="left", fontsize=7, pad=2, parse_math=False)
    texts = list(map(plain, keys))
    if not texts:
        return figure
    columns = 2 if max(map(len, texts)) <= _SHORT else 1
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _ROW * math.ceil(len(texts) / columns))
    look = {"ncols": columns, "handlelength": 2.2, "borderpad": 0.1}
    legend = figure.legend([*keys.values()], texts, loc="outside upper center", **look)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure
