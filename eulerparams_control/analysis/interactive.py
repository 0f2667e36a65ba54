"""Charts as plotly.js takes them: data and layout as JSON can hold them."""

import math
from collections.abc import Iterator, Sequence
from html import escape
from typing import Any

from eulerparams_control.analysis.charts import Chart
from eulerparams_control.analysis.decimation import decimate, packed_reals
from eulerparams_control.analysis.digest import Approach
from eulerparams_control.analysis.labels import PREDICTION_DASHES, colour, line, number

_POINTS = 600_000  # of the whole page, which keeps them below 7 MB
_MOST_BINS = 700  # of a line: more than a screen has pixels for
_GREY = "rgba(128, 128, 128, 0.9)"
_POLE = {"fillcolor": "rgba(204, 121, 167, 0.22)", "line": {"width": 0}}
_EDGE = {"color": "rgba(190, 130, 0, 0.8)", "width": 1, "dash": "dot"}
_SINGULAR = {"fillcolor": "rgba(230, 159, 0, 0.20)", "line": _EDGE}
_ROW = 14  # [px] height of a line of text


def figures(charts: Sequence[Chart], noted: int = 1) -> list[dict[str, Any]]:
    """Return some charts, the first ``noted`` with words at their closest approaches."""
    lines = sum(len(chart.lines) for chart in charts)
    bins = max(20, min(_MOST_BINS, _POINTS // (4 * max(1, lines))))
    layouts = list(map(_layout, charts))
    for chart, layout in zip(charts[:noted], layouts, strict=False):
        layout["annotations"] = list(_notes(chart))
        layout["margin"]["t"] = 12 + _ROW * max(1, len(chart.approaches))
    data = (list(_data(chart, bins)) for chart in charts)
    return [{"data": d, "layout": layout} for d, layout in zip(data, layouts, strict=True)]


def _data(chart: Chart, bins: int) -> Iterator[dict[str, Any]]:
    """Yield the lines; their names come from outside, so they are escaped."""
    for index, one in chart.indexed():
        x, y = decimate(*one.xy, bins)
        drawn: dict[str, Any] = {"type": "scatter", "x": packed_reals(x), "y": packed_reals(y)}
        if one.kind == "point":
            marker = {"color": colour(index), "size": 8, "symbol": "diamond"}
            drawn |= {"mode": "markers", "marker": marker, "hoverinfo": "skip"}
        else:
            drawn |= {"mode": "lines", "hovertemplate": f"%{{y:.6~g}} {chart.unit}"}
            drawn["name"] = escape(one.label)
        if one.kind == "predicted":
            dash = PREDICTION_DASHES[index % len(PREDICTION_DASHES)]
            drawn |= {"meta": "prediction", "line": {"color": _GREY, "width": 2, "dash": dash}}
        else:
            drawn["legendgroup"] = str(index)
        if one.kind == "measured":
            drawn["line"] = {**line(index, chart.runs), "simplify": False}  # it has few points
        yield drawn


def _layout(chart: Chart) -> dict[str, Any]:
    look = {"showline": True, "zeroline": False}
    x_axis = {**look, "title": {"text": chart.xlabel, "standoff": 8}, "range": chart.span}
    y_axis = {**look, "title": {"text": chart.ylabel, "standoff": 14}, "automargin": False}
    y_axis["exponentformat"] = "power"
    if chart.scale is not None and chart.scale.logarithmic:
        ends = [math.log10(chart.scale.low), math.log10(chart.scale.high)]
        y_axis |= {"type": "log", "range": ends, "dtick": chart.scale.step}
    elif chart.scale is not None:
        ends = [chart.scale.low, chart.scale.high]
        y_axis |= {"type": "linear", "range": ends, "showexponent": "last"}
    return {
        "xaxis": x_axis,
        "yaxis": y_axis,
        "shapes": list(_shapes(chart)),
        "margin": {"l": 80, "r": 16, "t": 12, "b": 44},
        "hovermode": "x unified",
        "showlegend": False,
    }


def _shapes(chart: Chart) -> Iterator[dict[str, Any]]:
    """Yield the shades, the closest approaches and the limits."""
    upright = {"yref": "paper", "y0": 0, "y1": 1}
    for spans, look in ((chart.near_pole, _POLE), (chart.near_singular, _SINGULAR)):
        for start, end in spans:
            yield {"type": "rect", "x0": start, "x1": end, **upright, "layer": "below", **look}
    for t, _, _ in chart.approaches:
        dots = {"color": _GREY, "width": 1, "dash": "dot"}
        yield {"type": "line", "x0": t, "x1": t, **upright, "line": dots}
    for y in chart.limits:
        dashes = {"color": _GREY, "width": 1, "dash": "dash"}
        yield {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y, "line": dashes}


def _notes(chart: Chart) -> Iterator[dict[str, Any]]:
    """Yield a note above the plot for each closest approach, inside it from left to right."""
    start, end = chart.span or (0.0, 0.0)
    for index, approach in enumerate(chart.approaches):
        place = (approach.t - start) / max(end - start, 1e-9)
        yield {
            "text": _words(approach),
            "x": approach.t,
            "xanchor": "left" if place < 1 / 3 else "right" if place > 2 / 3 else "center",
            "y": 1,
            "yref": "paper",
            "yanchor": "bottom",
            "yshift": _ROW * (len(chart.approaches) - 1 - index),
            "showarrow": False,
            "font": {"size": 12},
        }


def _words(approach: Approach) -> str:
    degrees = number(math.degrees(approach.distance))
    return f"{degrees} deg from the pole of {approach.sequence}, at {approach.t:.3f} s"
