"""The numbers of the table of runs: of a part of a run, and together."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from eulerparams_control.analysis.metrics import get_metric
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import BagError


class TableNumber(NamedTuple):
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


NUMBERS = (
    TableNumber("diverged at", "divergence_time", needs="diverged"),
    TableNumber("orientation error, peak", "peak_orientation_error"),
    TableNumber("orientation error, end", "final_orientation_error", of_parts=_last),
    TableNumber("  measured, peak", "peak_orientation_error", _MEASURED, "command"),
    TableNumber("  measured, end", "final_orientation_error", _MEASURED, "command", of_parts=_last),
    TableNumber("position error, peak", "peak_position_error"),
    TableNumber("position error, end", "final_position_error", of_parts=_last),
    TableNumber("  measured, peak", "peak_position_error", _MEASURED, "command"),
    TableNumber("  measured, end", "final_position_error", _MEASURED, "command", of_parts=_last),
    TableNumber("force, peak", "peak_force", needs="contact"),
    TableNumber("force, end", "final_force", needs="contact", of_parts=_last),
    TableNumber("moment, peak", "peak_moment", needs="contact"),
    TableNumber("moment, end", "final_moment", needs="contact", of_parts=_last),
    TableNumber("compliant frame, end", "final_displacement", needs="compliant", of_parts=_last),
    TableNumber("compliant frame, end", "final_turn", needs="compliant", of_parts=_last),
    TableNumber("motion loop, peak", "peak_position_error", _COMPLIANT, "compliant"),
    TableNumber("motion loop, peak", "peak_orientation_error", _COMPLIANT, "compliant"),
    TableNumber("joint speed, peak", "peak_joint_speed"),
    TableNumber("  measured, peak", "peak_joint_speed", _MEASURED, "command"),
    TableNumber("effort, peak", "peak_effort", needs="effort"),
    TableNumber("time at an effort limit", "saturated_time", needs="effort", of_parts=sum),
    TableNumber("closest to pole of", "closest_approach", of_parts=min),
    TableNumber("smallest singular value of J", "smallest_singular_value", of_parts=min),
    TableNumber("servo lag, largest", "servo_lag", needs="command"),
)


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
