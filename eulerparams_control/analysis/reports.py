"""What the nodes of an arm said of themselves on /diagnostics, each time that it changed."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.rotations import Array

LEVELS = ("ok", "warning", "error", "stale")
"""The names of the levels of diagnostic_msgs/DiagnosticStatus."""

REMEDY = "what to do"
"""The key under which a node says what to do."""

_MOST = 500  # of a run: what flickers is not told to the end
_LONGEST = 400  # characters of a text


class Report(NamedTuple):
    """What a node said when its state changed.

    Attributes:
        t: [s] of the run; before its first and after its last state by the clock of the recorder.
        node: its name.
        level: a name of ``LEVELS``.
        message: what happened.
        remedy: what to do; "" if it did not say.
    """

    t: float
    node: str
    level: str
    message: str
    remedy: str


class Reports:
    """Takes what nodes say, and keeps what is new."""

    def __init__(self) -> None:
        self._said: dict[str, tuple[str, str]] = {}
        self._new: list[tuple[int, Report]] = []
        self._count = 0

    def add(self, status: Any, sent: int) -> None:
        """Take a DiagnosticStatus that was sent at a time [ns]."""
        level, message = _level(status.level), str(status.message)[:_LONGEST]
        is_new = message and self._said.get(status.name) != (level, message)
        if not is_new or self._count == _MOST:
            return
        self._said[status.name] = level, message
        self._count += 1
        remedy = next((v.value for v in status.values if v.key == REMEDY), "")[:_LONGEST]
        self._new.append((sent, Report(0.0, str(status.name), level, message, remedy)))

    def take(self, sent: NDArray[np.int64], t: Array, last: bool) -> list[Report]:
        """Return what was said up to the last state of a part, with its time, and forget it.

        Args:
            sent: (N,) [ns] when the states of the part were sent.
            t: (N,) [s] their times.
            last: whether no part follows.
        """
        order = np.argsort(sent, kind="stable")
        sent, t = sent[order], t[order]
        now = [one for one in self._new if last or one[0] <= sent[-1]]
        self._new = self._new[len(now) :] if not last else []
        return [report._replace(t=_time(at, sent, t)) for at, report in now]


def within(reports: Sequence[Report], start: float, end: float) -> list[Report]:
    """Return what was said from ``start`` to ``end`` [s]; from 0 on is with what came before."""
    return [one for one in reports if (start <= one.t or start <= 0) and one.t <= end]


def _level(value: Any) -> str:
    number = value[0] if isinstance(value, bytes) and value else value
    known = isinstance(number, int) and 0 <= number < len(LEVELS)
    return LEVELS[number] if known else LEVELS[-1]


def _time(at: int, sent: NDArray[np.int64], t: Array) -> float:
    """Return the time of the run [s] at which something was sent at a time [ns]."""
    inside = min(max(at, int(sent[0])), int(sent[-1]))
    return float(np.interp(inside, sent, t)) + (at - inside) / 1e9
