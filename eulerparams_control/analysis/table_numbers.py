"""The numbers of the table of runs: of a part of a run, and together."""

from collections.abc import Sequence

from eulerparams_control.analysis.quantities import NUMBERS, TableNumber, get_metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import BagError


def values(recording: Recording) -> list[float | None]:
    """Return the numbers of a run, None where it has none."""
    return [_computed(row, recording) for row in NUMBERS]


def together(parts: Sequence[Sequence[float | None]]) -> list[float | None]:
    """Return the numbers of a run from those of its parts, in their order."""
    columns = zip(*parts, strict=True)
    return [row.together(column) for row, column in zip(NUMBERS, columns, strict=True)]


def _computed(row: TableNumber, recording: Recording) -> float | None:
    if row.needs and getattr(recording, row.needs) is None:
        return None
    try:
        return get_metric(row.metric).compute(recording, **row.options)
    except BagError:
        return None
