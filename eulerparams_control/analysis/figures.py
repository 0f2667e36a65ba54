"""The plots of runs over time, laid over each other."""

import math
from collections.abc import Callable, Iterator, Sequence
from html import escape
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.labels import colour, labels, line, sequences
from eulerparams_control.analysis.poles import NEAR, Approach, approach, near_pole
from eulerparams_control.analysis.quantities import (
    JOINT_QUANTITIES,
    POLE_DISTANCE,
    QUANTITIES,
    JointQuantity,
    Quantity,
)
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.scale import axis
from eulerparams_control.analysis.text import number
from eulerparams_control.rotations import Array

_POINTS = 150_000  # of the whole page, which keeps it below 8 MB
_MOST_BINS = 700  # of a line: more than a screen has pixels for
_COLUMNS = 2  # of the joints
_SHADE = "rgba(204, 121, 167, 0.20)"
_GREY = "rgba(128, 128, 128, 0.9)"
_NEAR_LIMIT = 4.0  # limit over largest value, up to which the axis shows the limit
_LARGEST = float(np.finfo(np.float32).max)

type _Runs = Sequence[tuple[Array, Array]]  # instants and values of each run


class Panel(NamedTuple):
    """A plot with its words.

    Attributes:
        title: above it.
        caption: below it.
        figure: the plot.
        height: [px].
    """

    title: str
    caption: str
    figure: go.Figure
    height: int


class Panels(NamedTuple):
    """The plots of the page.

    Attributes:
        over_time: of the runs, the one that matters first.
        joints: of each joint.
    """

    over_time: list[Panel]
    joints: list[Panel]


def panels(recordings: Sequence[Recording]) -> Panels:
    """Return the plots of the page; those without data left out."""
    bins = _bins(recordings)
    over_time = [_panel(quantity, recordings, bins) for quantity in QUANTITIES]
    joints = [_joint_panel(quantity, recordings, bins) for quantity in JOINT_QUANTITIES]
    return Panels(
        [panel for panel in over_time if panel is not None],
        [panel for panel in joints if panel is not None],
    )


def _bins(recordings: Sequence[Recording]) -> int:
    lines = sum(
        len(QUANTITIES) + len(JOINT_QUANTITIES) * recording.robot.n for recording in recordings
    )
    return max(20, min(_MOST_BINS, _POINTS // (4 * max(1, lines))))


def _panel(quantity: Quantity, recordings: Sequence[Recording], bins: int) -> Panel | None:
    runs = [quantity.of(recording) for recording in recordings]
    if not any(len(t) for t, _ in runs):
        return None
    figure = go.Figure()
    for index, (t, y) in enumerate(runs):
        if len(t):
            figure.add_trace(_trace(recordings, index, *decimate(t, y, bins), quantity.unit))
    label = quantity.label.format(sequence=sequences(recordings))
    values = [y for _, y in runs]
    if quantity.limits is not None:
        limits = _present(quantity.limits, recordings, runs)
        values += _draw_limits(figure, limits, values)
    figure.update_yaxes(title=label, title_standoff=14, **_y_axis(quantity, values))
    _mark_poles(figure, quantity, recordings)
    _finish(figure, recordings)
    if quantity is not QUANTITIES[0]:
        return Panel(quantity.title, quantity.caption, figure, 300)
    figure.update_layout(showlegend=len(recordings) > 1)
    return Panel(quantity.title, quantity.caption, figure, 420)


def _present(
    limits: Callable[[Recording], Array], recordings: Sequence[Recording], runs: _Runs
) -> list[Array]:
    """Return the limits of the robots whose runs have the quantity."""
    pairs = zip(recordings, runs, strict=True)
    return [limits(recording) for recording, (t, _) in pairs if len(t)]


def _y_axis(quantity: Quantity, runs: Sequence[Array]) -> dict[str, Any]:
    if quantity.floor:
        return axis(runs, quantity.floor, logarithmic=quantity.logarithmic)
    return {"type": "linear", "rangemode": "tozero"}


def _trace(
    recordings: Sequence[Recording], index: int, t: Array, y: Array, unit: str
) -> go.Scatter:
    """Return the line of a run; its name comes from outside, so it is escaped."""
    return go.Scatter(
        x=t.astype(np.float32),
        y=np.clip(y, -_LARGEST, _LARGEST).astype(np.float32),
        name=escape(labels(recordings)[index]),
        legendgroup=str(index),
        mode="lines",
        line=line(index, len(recordings)),
        hovertemplate=f"%{{y:.3~g}} {unit}",
    )


def _mark_poles(figure: go.Figure, quantity: Quantity, recordings: Sequence[Recording]) -> None:
    """Shade the time near the pole, mark the closest approach, of each run where it is drawn."""
    for start, end in near_pole(recordings):
        figure.add_vrect(start, end, fillcolor=_SHADE, line_width=0, layer="below")
    closest = min(map(approach, recordings), key=lambda a: a.distance)
    if closest.distance < NEAR:
        text = _approach_text(closest) if quantity is QUANTITIES[0] else ""
        figure.add_vline(closest.t, line={"color": _GREY, "width": 1, "dash": "dot"})
        place = {"x": closest.t, "y": 1, "yref": "paper", "yanchor": "bottom"}
        figure.add_annotation(text=text, showarrow=False, **place)
    if quantity is POLE_DISTANCE:
        figure.add_traces(list(_markers(recordings)))


def _approach_text(closest: Approach) -> str:
    degrees = number(math.degrees(closest.distance))
    return f"{degrees} deg from the pole of {closest.sequence}, at {closest.t:.3f} s"


def _markers(recordings: Sequence[Recording]) -> Iterator[go.Scatter]:
    for index, recording in enumerate(recordings):
        closest = approach(recording)
        yield go.Scatter(
            x=[closest.t],
            y=[math.degrees(closest.distance)],
            mode="markers",
            marker={"color": colour(index), "size": 8, "symbol": "diamond"},
            legendgroup=str(index),
            showlegend=False,
            hoverinfo="skip",
        )


def _draw_limits(
    figure: go.Figure, limits: Sequence[Array], values: Sequence[Array], **where: Any
) -> list[Array]:
    """Draw the limits; return those that the axis has to reach."""
    known = np.unique(np.concatenate(limits))
    known = known[np.isfinite(known)]
    for limit in known:
        figure.add_hline(limit, line={"color": _GREY, "width": 1, "dash": "dash"}, **where)
    top = max(float(run.max()) for run in values if len(run))
    return [known[known < _NEAR_LIMIT * top]]


def _joint_panel(
    quantity: JointQuantity, recordings: Sequence[Recording], bins: int
) -> Panel | None:
    """Return a quantity of each joint, one plot a joint, on equal axes."""
    runs = [quantity.of(recording) for recording in recordings]
    shown = [r for r, (t, _) in zip(recordings, runs, strict=True) if len(t)]
    if not shown:
        return None
    titles = _joint_titles(shown)
    rows = math.ceil(len(titles) / _COLUMNS)
    gaps = {"vertical_spacing": 0.30 / rows, "horizontal_spacing": 0.1}
    figure = make_subplots(rows, _COLUMNS, subplot_titles=titles, **gaps)
    values = [y for _, y in runs if len(y)]
    limits = _present(quantity.limits, recordings, runs)
    for joint in range(len(titles)):
        where = {"row": joint // _COLUMNS + 1, "col": joint % _COLUMNS + 1}
        for trace in _joint_lines(joint, quantity, recordings, bins):
            figure.add_trace(trace, **where)
        own = [limit[joint : joint + 1] for limit in limits]
        reached = _draw_limits(figure, own, values, **where)
        figure.update_yaxes(_equal_axis(values, reached, quantity.floor), **where)
    figure.update_yaxes(title=quantity.label, title_standoff=14, col=1)
    height = 210 * rows + 60
    return Panel(quantity.title, quantity.caption, _finish(figure, recordings), height)


def _equal_axis(runs: Sequence[Array], reached: list[Array], floor: float) -> dict[str, Any]:
    """Return the axis of every joint: like that of the largest, down to the smallest if log."""
    shown = axis([y.max(axis=1) for y in runs] + reached, floor, labels=4)
    if shown["type"] == "linear":
        return shown
    return axis([y.ravel() for y in runs] + reached, floor, labels=4, logarithmic=True)


def _joint_lines(
    joint: int, quantity: JointQuantity, recordings: Sequence[Recording], bins: int
) -> Iterator[go.Scatter]:
    for index, recording in enumerate(recordings):
        t, y = quantity.of(recording)
        if len(t) and joint < recording.robot.n:
            yield _trace(recordings, index, *decimate(t, y[:, joint], bins), quantity.unit)


def _joint_titles(recordings: Sequence[Recording]) -> list[str]:
    """Return a title for each joint: its name, or its names where the robots differ."""
    names = zip_longest(*(recording.robot.joints for recording in recordings), fillvalue="")
    return [escape(" / ".join(filter(None, dict.fromkeys(joint)))) for joint in names]


def _finish(figure: go.Figure, recordings: Sequence[Recording]) -> go.Figure:
    """Return the figure with what all have in common: the time axis and the look."""
    start = min(float(recording.leading.t[0]) for recording in recordings)
    end = max(float(recording.leading.t[-1]) for recording in recordings)
    figure.update_xaxes(title="time [s]", range=[start, end], showline=True, title_standoff=8)
    figure.update_annotations(font_size=12)
    figure.update_yaxes(showline=True, zeroline=False, automargin=False, exponentformat="power")
    figure.update_layout(
        template="none",
        margin={"l": 80, "r": 16, "t": 32, "b": 48},
        hovermode="x unified",
        showlegend=False,
        legend={"orientation": "h", "x": 0, "y": -0.18, "yanchor": "top"},
    )
    return figure
