"""Small plots side by side, on equal axes: one for each joint, one for each component.

What is marked in the time of all plots: where a run is near a singularity, and how near.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import number
from eulerparams_control.analysis.plots import (
    GREY,
    Drawing,
    Figure,
    Lines,
    Panel,
    layout,
    limit_lines,
    limits_of,
    predicted,
    reached,
    traces,
)
from eulerparams_control.analysis.poles import NEAR, Approach, Interval, merged
from eulerparams_control.analysis.quantity import JointQuantity, VectorQuantity
from eulerparams_control.analysis.scale import axis, spans, symmetric_axis
from eulerparams_control.laws.rotations import Array

REPRESENTATION = "rgba(204, 121, 167, 0.22)"
KINEMATIC = "rgba(230, 159, 0, 0.20)"
KINEMATIC_EDGE = "rgba(190, 130, 0, 0.8)"

_LINE = 14  # [px] height of a line of text

_HEIGHT = 220  # [px]


def bands(digests: Sequence[Digest]) -> list[dict[str, Any]]:
    """Return the shades of the time near the poles, and near the kinematic singularities."""
    poles = merged(interval for digest in digests for interval in digest.near_pole)
    singular = merged(interval for digest in digests for interval in digest.near_singular)
    edge = {"line": {"color": KINEMATIC_EDGE, "width": 1, "dash": "dot"}}
    return [
        *(_band(interval, REPRESENTATION, {"line": {"width": 0}}) for interval in poles),
        *(_band(interval, KINEMATIC, edge) for interval in singular),
    ]


def _band(interval: Interval, fill: str, edge: dict[str, Any]) -> dict[str, Any]:
    start, end = interval
    place = {"type": "rect", "x0": start, "x1": end, "yref": "paper", "y0": 0, "y1": 1}
    return {**place, "fillcolor": fill, "layer": "below", **edge}


def closest(digests: Sequence[Digest]) -> list[Approach]:
    """Return the closest approach to the pole of each sequence of Euler angles, if near."""
    found: dict[str, Approach] = {}
    for digest in digests:
        approach = digest.approach
        best = found.get(approach.sequence)
        if approach.distance < NEAR and (best is None or approach.distance < best.distance):
            found[approach.sequence] = approach
    return list(found.values())


def approach_lines(approaches: Sequence[Approach]) -> list[dict[str, Any]]:
    """Return a line at each closest approach."""
    line = {"color": GREY, "width": 1, "dash": "dot"}
    return [
        {"type": "line", "x0": a.t, "x1": a.t, "yref": "paper", "y0": 0, "y1": 1, "line": line}
        for a in approaches
    ]


def approach_notes(
    approaches: Sequence[Approach], start: float, end: float
) -> Iterator[dict[str, Any]]:
    """Yield a note above the plot for each closest approach, inside it from left to right."""
    for index, approach in enumerate(approaches):
        place = (approach.t - start) / max(end - start, 1e-9)
        yield {
            "text": _words(approach),
            "x": approach.t,
            "xanchor": "left" if place < 1 / 3 else "right" if place > 2 / 3 else "center",
            "y": 1,
            "yref": "paper",
            "yanchor": "bottom",
            "yshift": _LINE * (len(approaches) - 1 - index),
            "showarrow": False,
            "font": {"size": 12},
        }


def top_margin(approaches: Sequence[Approach]) -> int:
    """Return the margin [px] above a plot that its notes need."""
    return 12 + _LINE * max(1, len(approaches))


def _words(approach: Approach) -> str:
    degrees = number(math.degrees(approach.distance))
    return f"{degrees} deg from the pole of {approach.sequence}, at {approach.t:.3f} s"


def joint_panel(quantity: JointQuantity, drawing: Drawing) -> Panel | None:
    """Return a quantity of each joint, one plot a joint; None if there is none."""
    columns = _columns(quantity.name, drawing.digests)
    if not columns:
        return None
    shown = sorted({index for lines in columns for index in lines})
    values = [lines[index].y for lines in columns for index in lines]
    limits = limits_of(quantity.limits, drawing.digests, shown)
    figures = []
    for joint, (title, lines) in enumerate(
        zip(joint_titles([drawing.digests[i] for i in shown]), columns, strict=False)
    ):
        own = [limit[joint : joint + 1] for limit in limits]
        y_axis = _equal_axis(columns, reached(own, values), quantity.floor)
        figures.append(_figure(title, joint, lines, quantity, drawing, y_axis, limit_lines(own)))
    return _panel(quantity, drawing, figures)


def vector_panel(quantity: VectorQuantity, drawing: Drawing) -> Panel | None:
    """Return the components of a vector, one plot each; None if there is none but rounding."""
    columns = _columns(quantity.name, drawing.digests)
    values = [curve.y for lines in columns for curve in lines.values()]
    if not any((np.abs(y[np.isfinite(y)]) > quantity.floor).any() for y in values):
        return None
    titles = [*quantity.components, *[""] * len(columns)]
    centred = spans([[c.y for c in lines.values()] for lines in columns], quantity.floor)
    y_axes = centred or [symmetric_axis(values, quantity.floor)] * len(columns)
    figures = [
        _figure(title, component, lines, quantity, drawing, y_axis)
        for component, (title, lines, y_axis) in enumerate(
            zip(titles, columns, y_axes, strict=False)
        )
    ]
    return _panel(quantity, drawing, figures)


def _columns(name: str, digests: Sequence[Digest]) -> list[Lines]:
    """Return the lines of each component, or joint."""
    curves = {i: digest.curves[name] for i, digest in enumerate(digests) if name in digest.curves}
    count = max(map(len, curves.values()), default=0)
    return [
        {index: run[column] for index, run in curves.items() if column < len(run)}
        for column in range(count)
    ]


def _figure(
    title: str,
    column: int,
    lines: Lines,
    quantity: JointQuantity | VectorQuantity,
    drawing: Drawing,
    y_axis: dict[str, Any],
    shapes: Sequence[dict[str, Any]] = (),
) -> Figure:
    data = traces(drawing, lines, quantity.unit)
    data += predicted(drawing, quantity.name, quantity.unit, column)
    marks = [*bands(drawing.digests), *shapes]
    return Figure(title, data, layout(drawing.digests, y_axis, quantity.label, marks), _HEIGHT)


def _panel(
    quantity: JointQuantity | VectorQuantity, drawing: Drawing, figures: list[Figure]
) -> Panel:
    texts = [f"{one.name}: {one.text}" for one in drawing.of(quantity.name)]
    return Panel(quantity.name, quantity.group, quantity.title, quantity.caption, figures, texts)


def _equal_axis(columns: Sequence[Lines], reached: list[Array], floor: float) -> dict[str, Any]:
    """Return the axis of every joint: like that of the largest, down to the smallest if log."""
    runs = sorted({index for lines in columns for index in lines})
    every = [
        np.concatenate([lines[index].y for lines in columns if index in lines]) for index in runs
    ]
    shown = axis([_largest(columns, index) for index in runs] + reached, floor, labels=4)
    if shown["type"] == "linear":
        return shown
    return axis(every + reached, floor, labels=4, logarithmic=True)


def _largest(columns: Sequence[Lines], run: int) -> Array:
    """Return the values of that joint of a run which has the largest."""
    values = [lines[run].y for lines in columns if run in lines]
    return max(values, key=lambda y: float(y[np.isfinite(y)].max(initial=0.0)))


def joint_titles(digests: Sequence[Digest]) -> list[str]:
    """Return a title for each joint: its name, or its names where the robots differ."""
    names = zip_longest(*(digest.robot.joints for digest in digests), fillvalue="")
    return [" / ".join(filter(None, dict.fromkeys(joint))) for joint in names]
