"""Reports of the nodes of an arm on /diagnostics, one for each change."""

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.keys import CAUSE, FROZEN, MODE, PACE, REMEDY, SATURATED, SLOWED

LEVELS = ("ok", "warning", "error", "stale")
"""The names of the levels of diagnostic_msgs/DiagnosticStatus."""

_MOST = 50  # reports of a node that are shown, first and last each; its errors count apart
_LONGEST = 400  # characters of a text

# Modes in which an arm is stopped, the last one of a simulated robot; causes that are no fault.
_STOPS = Mode.STOPPED, Mode.RELEASING, "stopping"
_TOLD = "", Cause.HALT, Cause.DEACTIVATED, Cause.NO_STATES


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


class Told(NamedTuple):
    """The reports of a run.

    Attributes:
        reports: in their order.
        rates: (K, 4) as the controller reported: time [s], rate of time, slowest rate of its
            trajectory, saturated ticks.
        delayed: when [s] a motion came later than it was sent to be, first; inf if none did.
    """

    reports: list[Report]
    rates: Array
    delayed: float


class Reports:
    """The reports of nodes as they come; those that repeat the last one are left out.

    Args:
        controller: the node whose rates of time are kept; "" is none.
    """

    def __init__(self, controller: str = "") -> None:
        self._controller = controller.strip("/")
        self._rates: list[tuple[int, float, float, float]] = []
        self._said: dict[str, Report] = {}
        self._new: list[tuple[int, Report]] = []
        self._waits = math.inf  # [ns]

    def add(self, status: Any, sent: int) -> None:
        """Take a DiagnosticStatus that was sent at a time [ns]."""
        values = {value.key: value.value for value in status.values}
        told = status.name, status.message, values.get(REMEDY, "")
        node, message, remedy = map(_short, told)
        if _waits(values):
            self._waits = min(self._waits, sent)
        if self._controller and status.name.strip("/") == self._controller:
            with suppress(ValueError):
                rates = values.get(PACE, 1), values.get(SLOWED, 1), values.get(SATURATED, 0)
                self._rates.append((sent, *map(float, rates)))  # type: ignore[arg-type]
        report = Report(0.0, node, _level(status.level), message, remedy, _fault(values))
        if message and self._said.get(node) != report:
            self._said[node] = report
            self._new.append((sent, report))

    def drop_after(self, sent: int) -> None:
        """Forget what was sent at that time [ns] or later."""
        self._waits = self._waits if self._waits < sent else math.inf
        self._new = [one for one in self._new if one[0] < sent]
        self._rates = [one for one in self._rates if one[0] < sent]

    def told(self, sent: NDArray[np.int64], t: Array, start: float, end: float) -> Told:
        """Return the reports by the times of the run.

        Args:
            sent: (N,) [ns] when the states were sent.
            t: (N,) [s] their times.
            start, end: [s] of the run that is looked at; the last report of each node before the
                start counts, too.
        """
        order = np.argsort(sent, kind="stable")
        sent, t = sent[order], t[order]
        start = start if start > 0 else -math.inf
        told = sorted(report._replace(t=_time(at, sent, t)) for at, report in self._new)
        earlier = {report.node: report for report in told if report.t < start}
        told = sorted(earlier.values()) + [one for one in told if start <= one.t <= end]
        ran = [(_time(at, sent, t), *rates) for at, *rates in sorted(self._rates)]
        rates = np.array(ran, dtype=float).reshape(-1, 4)
        is_late = self._waits <= sent[-1]
        return Told(
            told,
            rates[(rates[:, 0] >= start) & (rates[:, 0] <= end)],
            _time(int(self._waits), sent, t) if is_late else math.inf,
        )


def shown(reports: Iterable[Report]) -> list[Report]:
    """Return the reports to show, by time: of a node with very many the first and the last."""
    groups: dict[tuple[str, bool], list[Report]] = {}
    for report in reports:
        groups.setdefault((report.node, report.level in ("ok", "warning")), []).append(report)
    parts = (some[:_MOST] + some[_MOST:][-_MOST:] for some in groups.values())
    return sorted((report for part in parts for report in part), key=lambda one: one.t)


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
    return cause if values.get(MODE) in _STOPS and cause not in _TOLD else ""


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
