"""The numbers of runs side by side: a row a number, a column a run."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from rich.table import Table
from rich.text import Text

from eulerparams_control.analysis.labels import labels, sequences
from eulerparams_control.analysis.metrics import get_metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.text import number
from eulerparams_control.errors import BagError

MISSING = "-"
"""Where a number was not recorded."""


_TITLE_WIDTH = 33
_NAME_WIDTH = 12


class Row(NamedTuple):
    """A number of each run: what it is, and the numbers as text."""

    title: str
    values: list[str]


_COMMAND: Mapping[str, Any] = {"of": "command"}
_MEASURED: Mapping[str, Any] = {"of": "measured"}
_LEADING: Mapping[str, Any] = {"of": "leading"}
_NUMBERS: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    ("orientation error, peak", "peak_orientation_error", _COMMAND),
    ("orientation error, end", "final_orientation_error", _COMMAND),
    ("  measured, peak", "peak_orientation_error", _MEASURED),
    ("  measured, end", "final_orientation_error", _MEASURED),
    ("position error, peak", "peak_position_error", _COMMAND),
    ("position error, end", "final_position_error", _COMMAND),
    ("  measured, peak", "peak_position_error", _MEASURED),
    ("  measured, end", "final_position_error", _MEASURED),
    ("joint speed, peak", "peak_joint_speed", _COMMAND),
    ("  measured, peak", "peak_joint_speed", _MEASURED),
    ("closest to pole of", "closest_approach", _LEADING),
    ("smallest singular value of J", "smallest_singular_value", _LEADING),
    ("servo lag, largest", "servo_lag", {}),
)


def rows(recordings: Sequence[Recording]) -> list[Row]:
    """Return the numbers of each run; of the command, where it does not say measured."""
    return [
        Row(
            _title(title, metric, recordings),
            [_value(metric, options, recording) for recording in recordings],
        )
        for title, metric, options in _NUMBERS
    ]


def terminal_tables(recordings: Sequence[Recording], width: int) -> Iterator[Table]:
    """Yield the numbers as tables for a terminal of ``width``, each with the runs that fit."""
    names, found = labels(recordings), rows(recordings)
    count = max(1, (width - _TITLE_WIDTH) // (_NAME_WIDTH + 3))
    for first in range(0, len(names), count):
        shown = slice(first, first + count)
        table = Table()
        table.add_column("", no_wrap=True)
        for name in names[shown]:
            table.add_column(_broken(name), justify="right", overflow="fold")
        for row in found:
            table.add_row(Text(row.title), *row.values[shown])
        yield table


def _broken(name: str) -> Text:
    """Return a name in short lines, which end at underscores where they can."""
    n = _NAME_WIDTH
    return Text("\n".join(re.findall(rf".{{1,{n - 1}}}(?:_|$)|.{{1,{n}}}", name)))


def _title(title: str, metric: str, recordings: Sequence[Recording]) -> str:
    if metric == "closest_approach":
        title += f" {sequences(recordings)}"
    unit = get_metric(metric).unit
    return f"{title} [{unit}]" if unit else title


def _value(metric: str, options: Mapping[str, Any], recording: Recording) -> str:
    try:
        return number(get_metric(metric).compute(recording, **options))
    except BagError:
        return MISSING
