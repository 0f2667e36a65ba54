"""The numbers of runs side by side: a row a number, a column a run."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from rich.table import Table
from rich.text import Text

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.format import number
from eulerparams_control.analysis.labels import labels, sequences
from eulerparams_control.analysis.metrics import get_metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import BagError

MISSING = "-"
"""Where a number was not recorded."""


_TITLE_WIDTH = 33
_NAME_WIDTH = 12


class Row(NamedTuple):
    """A number of each run: what it is, and the numbers as text and as they are."""

    title: str
    values: list[str]
    numbers: list[float | None]


class _Number(NamedTuple):
    """A row of the table.

    ``needs`` names what of a recording it is about, "" if any has it; ``of_parts`` makes the number
    of a run from those of its parts.
    """

    title: str
    metric: str
    options: Mapping[str, str] = MappingProxyType({})
    needs: str = ""
    of_parts: Callable[[list[float]], float] = max

    def together(self, values: Sequence[float | None]) -> float | None:
        """Return the number of a run from those of its parts; None if none has it."""
        known = [value for value in values if value is not None]
        return self.of_parts(known) if known else None


def _last(values: list[float]) -> float:
    return values[-1]


_MEASURED = {"of": "measured"}
_COMPLIANT = {"against": "compliant"}


_NUMBERS = (
    _Number("diverged at", "divergence_time", needs="diverged"),
    _Number("orientation error, peak", "peak_orientation_error"),
    _Number("orientation error, end", "final_orientation_error", of_parts=_last),
    _Number("  measured, peak", "peak_orientation_error", _MEASURED, "command"),
    _Number("  measured, end", "final_orientation_error", _MEASURED, "command", of_parts=_last),
    _Number("position error, peak", "peak_position_error"),
    _Number("position error, end", "final_position_error", of_parts=_last),
    _Number("  measured, peak", "peak_position_error", _MEASURED, "command"),
    _Number("  measured, end", "final_position_error", _MEASURED, "command", of_parts=_last),
    _Number("force, peak", "peak_force", needs="contact"),
    _Number("force, end", "final_force", needs="contact", of_parts=_last),
    _Number("moment, peak", "peak_moment", needs="contact"),
    _Number("moment, end", "final_moment", needs="contact", of_parts=_last),
    _Number("compliant frame, end", "final_displacement", needs="compliant", of_parts=_last),
    _Number("compliant frame, end", "final_turn", needs="compliant", of_parts=_last),
    _Number("motion loop, peak", "peak_position_error", _COMPLIANT, "compliant"),
    _Number("motion loop, peak", "peak_orientation_error", _COMPLIANT, "compliant"),
    _Number("joint speed, peak", "peak_joint_speed"),
    _Number("  measured, peak", "peak_joint_speed", _MEASURED, "command"),
    _Number("effort, peak", "peak_effort", needs="effort"),
    _Number("time at an effort limit", "saturated_time", needs="effort", of_parts=sum),
    _Number("closest to pole of", "closest_approach", of_parts=min),
    _Number("smallest singular value of J", "smallest_singular_value", of_parts=min),
    _Number("servo lag, largest", "servo_lag", needs="command"),
)


def rows(digests: Sequence[Digest]) -> list[Row]:
    """Return the numbers of each run, those left out that none can have.

    They are of the commanded motion if there is one, where they do not say measured.
    """
    columns = [digest.numbers for digest in digests]
    return [
        Row(_title(row, digests), [MISSING if v is None else number(v) for v in values], [*values])
        for row, values in zip(_NUMBERS, zip(*columns, strict=True), strict=True)
        if any(value is not None for value in values)
    ]


def values(recording: Recording) -> list[float | None]:
    """Return the numbers of a run, None where it has none."""
    return [_computed(row, recording) for row in _NUMBERS]


def together(parts: Sequence[Sequence[float | None]]) -> list[float | None]:
    """Return the numbers of a run from those of its parts, in their order."""
    columns = zip(*parts, strict=True)
    return [row.together(column) for row, column in zip(_NUMBERS, columns, strict=True)]


def _computed(row: _Number, recording: Recording) -> float | None:
    if row.needs and getattr(recording, row.needs) is None:
        return None
    try:
        return get_metric(row.metric).compute(recording, **row.options)
    except BagError:
        return None


def terminal_tables(digests: Sequence[Digest], width: int) -> Iterator[Table]:
    """Yield the numbers as tables for a terminal of ``width``, each with the runs that fit."""
    names, found = labels(digests), rows(digests)
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


def _title(row: _Number, digests: Sequence[Digest]) -> str:
    title = row.title
    if row.metric == "closest_approach":
        title += f" {sequences(digests)}"
    unit = get_metric(row.metric).unit
    return f"{title} [{unit}]" if unit else title
