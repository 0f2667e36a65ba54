"""Reports of the nodes of an arm on /diagnostics, one for each change."""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.keys import (
    BEGAN,
    CAUSE,
    FROZEN,
    MODE,
    PACE,
    REMEDY,
    SATURATED,
    SLOWED,
)

LEVELS = ("ok", "warning", "error", "stale")
"""The names of the levels of diagnostic_msgs/DiagnosticStatus."""

_MOST_SHOWN = 50  # reports of a node that are shown, first and last each; its errors count apart
_LONGEST = 400  # characters of a text

# Modes in which an arm is stopped, the last one of a simulated robot; causes that are no fault.
_STOPS = Mode.STOPPED, Mode.RELEASING, "stopping"
_NO_FAULT = "", Cause.HALT, Cause.DEACTIVATED, Cause.NO_STATES


class Report(NamedTuple):
    """Report of a node when its state changed.

    Attributes:
        t: [s] of the run, by the clocks of who sent this and joint_states.
        node: its name.
        level: a name of ``LEVELS``, or its number.
        message: what happened.
        remedy: what to do; "" if the node named nothing.
        fault: the key of the cause for which it stopped the arm; "" if it did not.
    """

    t: float
    node: str
    level: str
    message: str
    remedy: str
    fault: str = ""


class RunReports(NamedTuple):
    """The reports of a run.

    Attributes:
        reports: in their order.
        rates: (K, 4) as the controller reported: time [s], rate of time, slowest rate of its
            trajectory, saturated ticks.
        delayed: when [s] a motion came later than it was sent to be, first; inf if none did.
        stopped: when [s] the arm was stopped, first; inf if it was not.
    """

    reports: list[Report]
    rates: Array
    delayed: float
    stopped: float


type Statuses = Sequence[tuple[int, Any]]
"""When [ns] each DiagnosticStatus was sent, and the status."""


def run_reports(
    statuses: Statuses, controller: str, sent: NDArray[np.int64], t: Array, start: float, end: float
) -> RunReports:
    """Return the reports by the times of the run; those that repeat the last one are left out.

    Args:
        statuses: of the nodes.
        controller: the node whose rates of time are kept; "" is none.
        sent: (N,) [ns] when the states were sent.
        t: (N,) [s] their times.
        start, end: [s] of the run that is looked at; the last report of each node before the
            start counts, too.
    """
    order = np.argsort(sent, kind="stable")
    sent, t = sent[order], t[order]
    start = start if start > 0 else -math.inf
    last: dict[str, Report] = {}
    new, ran, waits, stops = [], [], math.inf, math.inf
    for at, status in statuses:
        values = {value.key: value.value for value in status.values}
        if _waits(values):
            waits = min(waits, at)
        if values.get(MODE) in _STOPS:
            stops = min(stops, at)
        if controller and status.name.strip("/") == controller:
            with suppress(ValueError):
                rates = values.get(PACE, 1), values.get(SLOWED, 1), values.get(SATURATED, 0)
                ran.append((_time(at, sent, t), *map(float, rates)))
        node, message, remedy = map(_short, (status.name, status.message, values.get(REMEDY, "")))
        report = Report(0.0, node, _level(status.level), message, remedy, _fault(values))
        if message and last.get(node) != report:
            last[node] = report
            new.append(report._replace(t=_time(at, sent, t)))
    earlier = {report.node: report for report in sorted(new) if report.t < start}
    inside = [report for report in sorted(new) if start <= report.t <= end]
    speeds = np.array(sorted(ran), dtype=float).reshape(-1, 4)
    return RunReports(
        sorted(earlier.values()) + inside,
        speeds[(speeds[:, 0] >= start) & (speeds[:, 0] <= end)],
        *(_time(int(at), sent, t) if at <= sent[-1] else math.inf for at in (waits, stops)),
    )


def reference_starts(statuses: Statuses, namespace: str) -> dict[int, int]:
    """Return when the status was sent [ns], by the stamp [ns] at which a reference began.

    Args:
        statuses: of the nodes.
        namespace: of the arm whose references they are.
    """
    found: dict[int, int] = {}
    for sent, status in statuses:
        for value in status.values if namespace_of(status) == namespace else ():
            if value.key == BEGAN and _is_stamp(value.value):
                found.setdefault(int(value.value), sent)
    return found


def namespace_of(status: Any) -> str:
    """Return the namespace of the node that a status is of."""
    return f"/{status.name.lstrip('/')}".rpartition("/")[0]


def shown(reports: Iterable[Report]) -> list[Report]:
    """Return the reports to show, by time: of a node with very many the first and the last."""
    groups: dict[tuple[str, bool], list[Report]] = {}
    for report in reports:
        groups.setdefault((report.node, report.level in ("ok", "warning")), []).append(report)
    parts = (some[:_MOST_SHOWN] + some[_MOST_SHOWN:][-_MOST_SHOWN:] for some in groups.values())
    return sorted((report for part in parts for report in part), key=lambda one: one.t)


def _is_stamp(text: str) -> bool:
    """Return whether a text is a time [ns] as stamps have it."""
    return text.isascii() and text.isdecimal() and len(text) <= 19


def _waits(values: Mapping[str, str]) -> bool:
    """Return whether the motion that is followed waits, and comes later than it was sent to be."""
    with suppress(ValueError):  # of somebody else
        rate = min(float(values.get(PACE, 1)), float(values.get(SLOWED, 1)))
        slows = rate < 1 or values.get(FROZEN) == "1"
        return values.get(MODE) == Mode.FOLLOWING and slows
    return False


def _fault(values: Mapping[str, str]) -> str:
    """Return the cause for which a node stopped the arm; "" if it did not, or was told to."""
    cause = _short(values.get(CAUSE, ""))
    return cause if values.get(MODE) in _STOPS and cause not in _NO_FAULT else ""


def _short(text: str) -> str:
    """Return a text from outside, printable and not too long."""
    text = "".join(c if c.isprintable() else " " for c in text[: _LONGEST + 1])
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]} ..."


def _level(value: Any) -> str:
    number = value[0] if isinstance(value, bytes) and value else value
    known = isinstance(number, int) and 0 <= number < len(LEVELS)
    return LEVELS[number] if known else f"level {number}"


def _time(at: int, sent: NDArray[np.int64], t: Array) -> float:
    """Return the time of the run [s] at which something was sent at a time [ns]."""
    inside = min(max(at, int(sent[0])), int(sent[-1]))
    return float(np.interp(inside, sent, t)) + (at - inside) / 1e9
