"""What is marked in the time of all plots: where a run is near a singularity, and how near."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.format import number
from eulerparams_control.analysis.plots import GREY
from eulerparams_control.analysis.poles import NEAR, Approach, Interval, merged

REPRESENTATION = "rgba(204, 121, 167, 0.22)"
KINEMATIC = "rgba(230, 159, 0, 0.20)"
KINEMATIC_EDGE = "rgba(190, 130, 0, 0.8)"

_LINE = 14  # [px] height of a line of text

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
