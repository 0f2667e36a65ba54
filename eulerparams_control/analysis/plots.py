"""What all plots share: the line of a run, limits, the time axis and the look."""

from collections.abc import Callable, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go

from eulerparams_control.analysis.labels import labels, line
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.rotations import Array

GREY = "rgba(128, 128, 128, 0.9)"

_NEAR_LIMIT = 4.0  # limit over largest value, up to which the axis shows the limit
_LARGEST = float(np.finfo(np.float32).max)

type Runs = Sequence[tuple[Array, Array]]
"""Instants and values of each run."""


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


def trace(
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


def present(
    limits: Callable[[Recording], Array], recordings: Sequence[Recording], runs: Runs
) -> list[Array]:
    """Return the limits of the robots whose runs have the quantity."""
    pairs = zip(recordings, runs, strict=True)
    return [limits(recording) for recording, (t, _) in pairs if len(t)]


def draw_limits(
    figure: go.Figure, limits: Sequence[Array], values: Sequence[Array], **where: Any
) -> list[Array]:
    """Draw the limits; return those that the axis has to reach."""
    known = np.unique(np.concatenate(limits))
    known = known[np.isfinite(known)]
    for limit in known:
        figure.add_hline(limit, line={"color": GREY, "width": 1, "dash": "dash"}, **where)
    top = max(float(run.max()) for run in values if len(run))
    return [known[known < _NEAR_LIMIT * top]]


def finish(figure: go.Figure, recordings: Sequence[Recording]) -> go.Figure:
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
