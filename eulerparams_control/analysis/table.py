"""The numbers of runs side by side: a row a number, a column a run."""

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rich.table import Table
from rich.text import Text

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.labels import labels, number, sequences
from eulerparams_control.analysis.quantities import NUMBERS, TableNumber, get_metric

MISSING = "-"
"""Where a number was not recorded."""


_TITLE_WIDTH = 33
_NAME_WIDTH = 12


class Row(NamedTuple):
    """A number of each run: what it is, and the numbers as text and as they are."""

    title: str
    values: list[str]
    numbers: list[float | None]


def rows(digests: Sequence[Digest]) -> list[Row]:
    """Return the numbers of each run, those left out that none can have.

    They are of the commanded motion if there is one, unless they say measured.
    """
    columns = [digest.numbers for digest in digests]
    return [
        Row(_title(row, digests), [MISSING if v is None else number(v) for v in values], [*values])
        for row, values in zip(NUMBERS, zip(*columns, strict=True), strict=True)
        if any(value is not None for value in values)
    ]


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


def _title(row: TableNumber, digests: Sequence[Digest]) -> str:
    title = row.title
    if row.metric == "closest_approach":
        title += f" {sequences(digests)}"
    unit = get_metric(row.metric).unit
    return f"{title} [{unit}]" if unit else title
