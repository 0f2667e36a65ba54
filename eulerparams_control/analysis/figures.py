"""The plots of runs over time, laid over each other."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import plotly.graph_objects as go

from eulerparams_control.analysis.contact_quantities import VECTORS
from eulerparams_control.analysis.decimation import decimate
from eulerparams_control.analysis.grids import joint_panel, vector_panel
from eulerparams_control.analysis.labels import colour, sequences
from eulerparams_control.analysis.plots import (
    GREY,
    Panel,
    Runs,
    draw_limits,
    finish,
    present,
    trace,
)
from eulerparams_control.analysis.poles import NEAR, Approach, approach, near_pole
from eulerparams_control.analysis.quantities import (
    JOINT_QUANTITIES,
    ORIENTATION_ERROR,
    POLE_DISTANCE,
    QUANTITIES,
)
from eulerparams_control.analysis.quantity import JointQuantity, Quantity, VectorQuantity
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.scale import axis
from eulerparams_control.analysis.text import number
from eulerparams_control.errors import UnknownNameError
from eulerparams_control.rotations import Array

_POINTS = 150_000  # of the whole page, which keeps it below 8 MB
_MOST_BINS = 700  # of a line: more than a screen has pixels for
_SHADE = "rgba(204, 121, 167, 0.20)"


class Panels(NamedTuple):
    """The plots of the page.

    Attributes:
        over_time: of the runs, the one that matters first.
        vectors: of contact and compliance, by component.
        joints: of each joint.
    """

    over_time: list[Panel]
    vectors: list[Panel]
    joints: list[Panel]


def picture(name: str) -> Quantity:
    """Return the quantity of that name; raises UnknownNameError."""
    names = {quantity.name: quantity for quantity in QUANTITIES}
    if name not in names:
        raise UnknownNameError("picture", name, names)
    return names[name]


def panels(recordings: Sequence[Recording], first: Quantity = ORIENTATION_ERROR) -> Panels:
    """Return the plots of the page, ``first`` first; those without data left out."""
    ordered = dict.fromkeys((first, *QUANTITIES))
    over_time = {quantity: _runs(quantity, recordings) for quantity in ordered}
    vectors = {quantity: _runs(quantity, recordings) for quantity in VECTORS}
    joints = {quantity: _runs(quantity, recordings) for quantity in JOINT_QUANTITIES}
    bins = _bins([*over_time.values(), *vectors.values(), *joints.values()])
    return Panels(
        _drawn(_panel(q, recordings, runs, bins, q is first) for q, runs in over_time.items()),
        _drawn(vector_panel(q, recordings, runs, bins) for q, runs in vectors.items()),
        _drawn(joint_panel(q, recordings, runs, bins) for q, runs in joints.items()),
    )


def _runs(
    quantity: Quantity | VectorQuantity | JointQuantity, recordings: Sequence[Recording]
) -> Runs:
    return [quantity.of(recording) for recording in recordings]


def _drawn(drawn: Iterator[Panel | None]) -> list[Panel]:
    return [panel for panel in drawn if panel is not None]


def _bins(quantities: Sequence[Runs]) -> int:
    """Return the number of bins of a line with which the page does not grow too large."""
    shapes = [y.shape for runs in quantities for t, y in runs if len(t)]
    lines = sum(math.prod(shape[1:]) for shape in shapes)
    return max(20, min(_MOST_BINS, _POINTS // (4 * max(1, lines))))


def _panel(
    quantity: Quantity, recordings: Sequence[Recording], runs: Runs, bins: int, is_first: bool
) -> Panel | None:
    if not any(len(t) for t, _ in runs):
        return None
    figure = go.Figure()
    for index, (t, y) in enumerate(runs):
        if len(t):
            figure.add_trace(trace(recordings, index, *decimate(t, y, bins), quantity.unit))
    label = quantity.label.format(sequence=sequences(recordings))
    values = [y for _, y in runs]
    if quantity.limits is not None:
        limits = present(quantity.limits, recordings, runs)
        values += draw_limits(figure, limits, values)
    figure.update_yaxes(title=label, title_standoff=14, **_y_axis(quantity, values))
    _mark_poles(figure, recordings, is_first)
    if quantity is POLE_DISTANCE:
        figure.add_traces(list(_markers(recordings)))
    finish(figure, recordings)
    if not is_first:
        return Panel(quantity.title, quantity.caption, figure, 300)
    figure.update_layout(showlegend=len(recordings) > 1)
    return Panel(quantity.title, quantity.caption, figure, 420)


def _y_axis(quantity: Quantity, runs: Sequence[Array]) -> dict[str, Any]:
    if quantity.floor:
        return axis(runs, quantity.floor, logarithmic=quantity.logarithmic)
    return {"type": "linear", "rangemode": "tozero"}


def _mark_poles(figure: go.Figure, recordings: Sequence[Recording], in_words: bool) -> None:
    """Shade the time near the pole, mark the closest approach, and say what it is."""
    for start, end in near_pole(recordings):
        figure.add_vrect(start, end, fillcolor=_SHADE, line_width=0, layer="below")
    closest = min(map(approach, recordings), key=lambda a: a.distance)
    if closest.distance < NEAR:
        text = _approach_text(closest) if in_words else ""
        figure.add_vline(closest.t, line={"color": GREY, "width": 1, "dash": "dot"})
        place = {"x": closest.t, "y": 1, "yref": "paper", "yanchor": "bottom"}
        figure.add_annotation(text=text, showarrow=False, **place)


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
