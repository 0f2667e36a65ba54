"""Plots side by side, on equal axes: one for each joint, one for each component of a vector."""

import math
from collections.abc import Sequence
from html import escape
from itertools import zip_longest
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.plots import Panel, Runs, draw_limits, finish, present, trace
from eulerparams_control.analysis.quantity import JointQuantity, VectorQuantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.scale import axis, symmetric_axis
from eulerparams_control.rotations import Array

_COLUMNS = 2  # of the joints


def joint_panel(
    quantity: JointQuantity, recordings: Sequence[Recording], runs: Runs, bins: int
) -> Panel | None:
    """Return a quantity of each joint, one plot a joint; None if there is none.

    Args:
        quantity: what it is.
        recordings: the runs.
        runs: the quantity of each run.
        bins: of a line.
    """
    shown = [r for r, (t, _) in zip(recordings, runs, strict=True) if len(t)]
    if not shown:
        return None
    titles = _joint_titles(shown)
    figure = _grid(titles, _COLUMNS)
    values = [y for _, y in runs if len(y)]
    limits = present(quantity.limits, recordings, runs)
    for joint in range(len(titles)):
        where = {"row": joint // _COLUMNS + 1, "col": joint % _COLUMNS + 1}
        _draw(figure, where, joint, quantity.unit, recordings, runs, bins)
        own = [limit[joint : joint + 1] for limit in limits]
        reached = draw_limits(figure, own, values, **where)
        figure.update_yaxes(_equal_axis(values, reached, quantity.floor), **where)
    return _panel(quantity, figure, recordings, math.ceil(len(titles) / _COLUMNS))


def vector_panel(
    quantity: VectorQuantity, recordings: Sequence[Recording], runs: Runs, bins: int
) -> Panel | None:
    """Return the components of a vector, one plot each; None if there is none but rounding.

    Args:
        quantity: what it is.
        recordings: the runs.
        runs: the quantity of each run.
        bins: of a line.
    """
    values = [y for _, y in runs if len(y)]
    if not any((np.abs(y) > quantity.floor).any() for y in values):
        return None
    figure = _grid(["x", "y", "z"], 3)
    for component in range(3):
        where = {"row": 1, "col": component + 1}
        _draw(figure, where, component, quantity.unit, recordings, runs, bins)
        figure.update_yaxes(symmetric_axis(values, quantity.floor), **where)
    return _panel(quantity, figure, recordings, 1)


def _grid(titles: Sequence[str], columns: int) -> go.Figure:
    rows = math.ceil(len(titles) / columns)
    gaps = {"vertical_spacing": 0.30 / rows, "horizontal_spacing": 0.2 / columns}
    return make_subplots(rows, columns, subplot_titles=titles, **gaps)


def _panel(
    quantity: JointQuantity | VectorQuantity,
    figure: go.Figure,
    recordings: Sequence[Recording],
    rows: int,
) -> Panel:
    figure.update_yaxes(title=quantity.label, title_standoff=14, col=1)
    return Panel(quantity.title, quantity.caption, finish(figure, recordings), 210 * rows + 60)


def _draw(
    figure: go.Figure,
    where: dict[str, int],
    column: int,
    unit: str,
    recordings: Sequence[Recording],
    runs: Runs,
    bins: int,
) -> None:
    """Draw one column of the values of each run that has it."""
    for index, (t, y) in enumerate(runs):
        if len(t) and column < y.shape[1]:
            line = trace(recordings, index, *decimate(t, y[:, column], bins), unit)
            figure.add_trace(line, **where)


def _equal_axis(runs: Sequence[Array], reached: list[Array], floor: float) -> dict[str, Any]:
    """Return the axis of every joint: like that of the largest, down to the smallest if log."""
    shown = axis([y.max(axis=1) for y in runs] + reached, floor, labels=4)
    if shown["type"] == "linear":
        return shown
    return axis([y.ravel() for y in runs] + reached, floor, labels=4, logarithmic=True)


def _joint_titles(recordings: Sequence[Recording]) -> list[str]:
    """Return a title for each joint: its name, or its names where the robots differ."""
    names = zip_longest(*(recording.robot.joints for recording in recordings), fillvalue="")
    return [escape(" / ".join(filter(None, dict.fromkeys(joint)))) for joint in names]
