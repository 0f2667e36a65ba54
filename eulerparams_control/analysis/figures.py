"""The plots of runs over time, laid over each other."""

import math
from collections.abc import Iterator, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.labels import colour, labels, line, sequences
from eulerparams_control.analysis.poles import NEAR, Approach, approach, near_pole
from eulerparams_control.analysis.quantities import (
    JOINT_SPEED,
    POLE_DISTANCE,
    QUANTITIES,
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
_NEAR_LIMIT = 4.0  # limit over largest speed, up to which the axis shows the limit


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


def panels(recordings: Sequence[Recording]) -> list[Panel]:
    """Return the plots of the page, the one that matters first; those without data left out."""
    bins = _bins(recordings)
    drawn = [_panel(quantity, recordings, bins) for quantity in QUANTITIES]
    joints = _joint_speeds(recordings, bins)
    return [panel for panel in drawn if panel is not None] + [joints]


def _bins(recordings: Sequence[Recording]) -> int:
    lines = sum(len(QUANTITIES) + recording.robot.n for recording in recordings)
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
    if quantity is JOINT_SPEED:
        values += _draw_limits(figure, [r.robot.limits.velocity for r in recordings], values)
    figure.update_yaxes(title=label, title_standoff=14, **_y_axis(quantity, values))
    _mark_poles(figure, quantity, recordings)
    _finish(figure, recordings)
    if quantity is not QUANTITIES[0]:
        return Panel(quantity.title, quantity.caption, figure, 300)
    figure.update_layout(showlegend=len(recordings) > 1)
    return Panel(quantity.title, quantity.caption, figure, 420)


def _y_axis(quantity: Quantity, runs: Sequence[Array]) -> dict[str, Any]:
    if quantity.floor:
        return axis(runs, quantity.floor)
    return {"type": "linear", "rangemode": "tozero"}


def _trace(
    recordings: Sequence[Recording], index: int, t: Array, y: Array, unit: str
) -> go.Scatter:
    """Return the line of a run; its name comes from outside, so it is escaped."""
    return go.Scatter(
        x=t.astype(np.float32),
        y=y.astype(np.float32),
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
    figure: go.Figure, limits: Sequence[Array], speeds: Sequence[Array], **where: Any
) -> list[Array]:
    """Draw the velocity limits; return those that the axis has to reach."""
    known = np.unique(np.concatenate(limits))
    known = known[np.isfinite(known)]
    for limit in known:
        figure.add_hline(limit, line={"color": _GREY, "width": 1, "dash": "dash"}, **where)
    top = max(float(speed.max()) for speed in speeds)
    return [known[known < _NEAR_LIMIT * top]]


def _joint_speeds(recordings: Sequence[Recording], bins: int) -> Panel:
    """Return the speed of each joint, one plot a joint, on equal axes."""
    longest = max(recordings, key=lambda recording: recording.robot.n)
    rows = math.ceil(longest.robot.n / _COLUMNS)
    titles = [escape(joint) for joint in longest.robot.joints]
    gaps = {"vertical_spacing": 0.30 / rows, "horizontal_spacing": 0.1}
    figure = make_subplots(rows, _COLUMNS, subplot_titles=titles, **gaps)
    speeds = [recording.leading.joint_speed for recording in recordings]
    for joint in range(longest.robot.n):
        where = {"row": joint // _COLUMNS + 1, "col": joint % _COLUMNS + 1}
        for trace in _joint_lines(joint, recordings, bins):
            figure.add_trace(trace, **where)
        limits = [r.robot.limits.velocity[joint : joint + 1] for r in recordings]
        reached = _draw_limits(figure, limits, speeds, **where)
        figure.update_yaxes(axis(speeds + reached, JOINT_SPEED.floor, labels=4), **where)
    figure.update_yaxes(title="|dq| [rad/s]", title_standoff=14, col=1)
    caption = "Speed of each joint. Dashed: its velocity limit in the URDF, where it is near."
    return Panel("Speed of each joint", caption, _finish(figure, recordings), 210 * rows + 60)


def _joint_lines(joint: int, recordings: Sequence[Recording], bins: int) -> Iterator[go.Scatter]:
    for index, recording in enumerate(recordings):
        if joint < recording.robot.n:
            speed = np.abs(recording.leading.dq[:, joint])
            points = decimate(recording.leading.t, speed, bins)
            yield _trace(recordings, index, *points, "rad/s")


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
