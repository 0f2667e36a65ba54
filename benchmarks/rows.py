"""Results of `make bench`: ratios, their goals, their history, and the page."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from eulerparams_control.analysis.html import write_html
from eulerparams_control.analysis.labels import colour, line

type Run = dict[str, Any]
"""A line of the history."""

GOALS = {
    "tick / bare calls: clik": "<= 1.5",
    "tick / bare calls: dynamic_control": "<= 1.5",
    "tick / bare calls: impedance_control": "<= 1.8",
    "tick / bare calls: compliance_control": "<= 1.8",
    "cold tick / cold bare calls": "<= 1",
    "pink's solve_ik / tick of clik": ">= 6",
    "node / typed echo, p50": "<= 0.97",
    "node / typed echo, p99": "<= 1.1",
    "node with wrench / typed echo, p50": "<= 1.05",
    "node with wrench / typed echo, p99": "<= 1.2",
    "node with realtime_priority / typed echo, p99": "<= 0.8",
    "states answered / sent": ">= 1",
    "all controllers and a bridge at 1 kHz together: answered / sent": ">= 1",
    "lock-step, steps/s / bare echo and PyBullet step": ">= 0.9",
    "lock-step with wrench, steps/s / bare echo and PyBullet step": ">= 0.8",
    "bare PyBullet step / controlled step in one process": ">= 0.3",
    "bridge in real time, processor time / bare PyBullet step and echo": "<= 2",
    "recorder, 10 topics of 1 kHz: stored / sent": ">= 1",
    "analyze, MB/s / mcap alone": ">= 0.9",
    "start to first command / numpy, pin and rclpy alone, s more": "<= 1.5",
}
"""What each ratio is to be; those that are not here have no goal."""

_DASHED = {"color": "#808890", "width": 1.5, "dash": "dash"}
_LOOK = {
    **dict.fromkeys(("paper_bgcolor", "plot_bgcolor"), "rgba(0,0,0,0)"),
    "font": {"color": "#808890"},
    "margin": {"l": 44, "r": 8, "t": 8, "b": 24},
    "showlegend": False,
}
_GRID = {"gridcolor": "rgba(128,128,128,0.25)", "zeroline": False}


class Row(NamedTuple):
    """A ratio.

    Attributes:
        what: is divided by what; all of the same have the same goal.
        of: which of them.
        ratio: compared with the goal.
        figure: the two, with units.
    """

    what: str
    of: str
    ratio: float
    figure: str

    @classmethod
    def of_times(cls, what: str, of: str, own: float, bare: float) -> "Row":
        """Return the ratio of two times [s]."""
        return cls(what, of, own / bare, f"{1e6 * own:.1f} us / {1e6 * bare:.1f} us")

    @property
    def goal(self) -> str:
        """What the ratio is to be; "" if there is no goal."""
        return GOALS.get(self.what, "")

    @property
    def is_met(self) -> bool | None:
        """Whether the ratio is as it is to be; None if there is no goal."""
        sign, _, bound = self.goal.partition(" ")
        if not sign:
            return None
        return self.ratio <= float(bound) if sign == "<=" else self.ratio >= float(bound)


def append(history: Path, rows: Iterable[Row], **about: Any) -> None:
    """Append a run as a JSON line: what is said about it, and its rows."""
    with history.open("a", encoding="utf-8") as file:
        rounded = [row._replace(ratio=float(f"{row.ratio:.4g}")) for row in rows]
        file.write(json.dumps({**about, "rows": rounded}) + "\n")


def read(history: Path) -> list[Run]:
    """Return all runs, the oldest first."""
    runs = map(json.loads, history.read_text(encoding="utf-8").splitlines())
    return [{**run, "rows": [Row(*row) for row in run["rows"]]} for run in runs]


def write_page(path: Path, runs: Sequence[Run]) -> None:
    """Write the page: how the newest ratios stand to the goals, and all of them by commit."""
    newest: dict[bool, dict[tuple[str, str], Row]] = {False: {}, True: {}}
    for run in runs:
        newest[run["loaded"] > 0] |= {(row.what, row.of): row for row in run["rows"]}
    judged = [row.is_met for row in newest[False].values() if row.is_met is not None]
    found = dict.fromkeys(what for what, _ in newest[False])
    whats = [what for what in dict.fromkeys([*GOALS, *found]) if what in found]
    plots = [{"id": f"plot{k}", **_plot(what, runs)} for k, what in enumerate(whats)]
    write_html(
        path,
        "speed.html",
        judged=judged,
        last=_words(runs[-1]),
        cards=[(what, GOALS.get(what), list(_lines(what, *newest.values()))) for what in whats],
        is_loaded=bool(newest[True]),
        plots=plots,
    )


def _words(run: Run) -> str:
    return f"{run['commit']}, {run['date']}, {run['machine']}"


def _lines(
    what: str, newest: Mapping[tuple[str, str], Row], loaded: Mapping[tuple[str, str], Row]
) -> Iterator[tuple[str, Row, Row | None]]:
    """Yield the colour of each row of a ratio, the row, and the same under load."""
    rows = (row for row in newest.values() if row.what == what)
    for k, row in enumerate(rows):
        yield colour(k), row, loaded.get((what, row.of))


def _plot(what: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Return the plot of a ratio over the runs that have it."""
    having = [run for run in runs if any(row.what == what for row in run["rows"])]
    lines: dict[str, list[tuple[int, Run, Row]]] = {}
    for x, run in enumerate(having):
        for row in (row for row in run["rows"] if row.what == what):
            lines.setdefault(row.of, []).append((x, run, row))
    data = [
        {
            "name": of or "ratio",
            "mode": "lines+markers",
            "x": [x for x, *_ in points],
            "y": [row.ratio for *_, row in points],
            "text": [f"{escape(_words(run))}<br>{row.figure}" for _, run, row in points],
            "hovertemplate": "%{y:.3g}<br>%{text}",
            "line": line(k, len(lines)),
            "marker": {"size": 8, "symbol": [_symbol(run) for _, run, _ in points]},
        }
        for k, (of, points) in enumerate(lines.items())
    ]
    bound = [float(GOALS[what].split()[1])] if what in GOALS else []
    goal = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "line": _DASHED}
    top = max([*bound, *(row.ratio for points in lines.values() for *_, row in points)])
    ticks = {"tickvals": list(range(len(having))), "ticktext": [run["commit"] for run in having]}
    axes = {"xaxis": {**_GRID, **ticks, "range": [-0.5, len(having) - 0.5]},
            "yaxis": {**_GRID, "range": [0.0, 1.1 * top]}}  # fmt: skip
    shapes = [{**goal, "y0": y, "y1": y} for y in bound]
    return {"data": data, "layout": {**_LOOK, **axes, "shapes": shapes}}


def _symbol(run: Run) -> str:
    return "x" if run["loaded"] else "circle-open" if run["quick"] else "circle"
