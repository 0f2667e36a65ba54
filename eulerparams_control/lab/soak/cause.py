"""Why a state was not answered: what the counters of /diagnostics and the kernel say of then.

Each count explains one state only.  A state that nothing explains is a finding.
"""

from collections import deque
from collections.abc import Mapping

from eulerparams_control.control.mode import Cause, Mode

REFUSED = "refused by the controller as too late"
OVERRUN = "overrun in the queue of the controller: it, or the robot, had no processor"
WITHHELD = "withheld by the controller, as the arm ran away when nobody had a processor"
UNSEEN = "answered, but the monitor lost the command"

_KEPT = 1000  # reports and waits that are remembered: more than those of PATIENCE

# A report comes once a second; on a busy machine the state is read, and the report sent, later [s].
_SLACK = 5.0

# The modes of a controller that commands nothing on purpose, and of one that goes on.
_SILENT = (Mode.RELEASING, Mode.DISTRUSTING)
_ACTIVE = (Mode.WAITING, Mode.HOLDING, Mode.FOLLOWING)

# Waits for a processor count that began so long [s] before a state, or after it.
_AROUND = 0.25


class Allowance:
    """A counter as it was reported, whose increments explain as many states of their time."""

    def __init__(self) -> None:
        self._reports: deque[tuple[float, int]] = deque(maxlen=_KEPT)  # time [s], left since then
        self._last: int | None = None

    def report(self, t: float, count: int) -> None:
        """Take the counter as it is at t [s]."""
        left = 0 if self._last is None else max(0, count - self._last)
        self._last = count
        self._reports.append((t, left))

    def add(self, t: float, count: int) -> None:
        """Take an increment at t [s]."""
        self._reports.append((t, count))

    def first(self, sent: float) -> float | None:
        """Return when one was counted that may be a state sent at ``sent`` [s]; None if none is."""
        for t, left in self._reports:
            if left > 0 and sent <= t <= sent + _SLACK:
                return t
        return None

    def take(self, when: float) -> None:
        """Use up one that was counted at ``when`` [s]."""
        for index, (t, left) in enumerate(self._reports):
            if t == when and left > 0:
                self._reports[index] = t, left - 1
                return


class Waits:
    """When threads had to wait: increments of their waiting time."""

    def __init__(self) -> None:
        self._waits: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._last: tuple[float, Mapping[int, float]] = 0.0, {}

    def sample(self, t: float, waited: Mapping[int, float]) -> None:
        """Take how long [s] each thread has waited in all, at t [s]; the longest wait counts."""
        begin, before = self._last
        self._last = t, waited
        longest = max((waited[k] - before[k] for k in waited.keys() & before.keys()), default=0.0)
        self._waits.append((begin, t, longest))

    def around(self, sent: float) -> float:
        """Return the longest wait [s] around ``sent`` [s]."""
        found = [w for a, b, w in self._waits if a <= sent + _AROUND and b >= sent - _AROUND]
        return max(found, default=0.0)


class Causes:
    """Finds the causes for one robot.

    Args:
        queue: [s] that the queue of the controller lasts.

    Attributes:
        refused: counter of states that the controller refused.
        overrun: counter of states that never came to the controller.
        unseen: commands that the monitor lost, by their numbers.
        waits: of the controller, and of the robot, which makes up for its own in a burst.
    """

    def __init__(self, queue: float) -> None:
        self._queue = queue
        self.refused, self.overrun, self.unseen = Allowance(), Allowance(), Allowance()
        self.waits = Waits()
        self._silences: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._silent: float | None = None

    def said(self, t: float, mode: str, cause: str = "") -> None:
        """Take the mode of the controller from t [s] on, and its cause."""
        if cause == Cause.NO_STATES:  # there is nothing to answer
            return
        if mode in _SILENT and self._silent is None and self._is_starved(t):
            self._silent = t - _AROUND
        elif mode in _ACTIVE and self._silent is not None:
            self._silences.append((self._silent, t))
            self._silent = None

    def _is_starved(self, t: float) -> bool:
        """Whether for half of the time that the queue lasts, at least, there was no processor."""
        return self.waits.around(t) >= self._queue / 2

    def _is_withheld(self, sent: float) -> bool:
        now = self._silent is not None and sent >= self._silent
        return now or any(begin <= sent <= end for begin, end in self._silences)

    def of(self, sent: float) -> str:
        """Return why a state sent at ``sent`` [s] was not answered; "" if nothing tells.

        Of several counts the one that was reported first is used: states are asked for in their
        order, and so none is left without a cause that another one could have had.
        """
        counts = {REFUSED: self.refused, UNSEEN: self.unseen}
        if self._is_starved(sent):  # it was not its own work that kept it
            counts[OVERRUN] = self.overrun
        found = [(when, cause) for cause in counts if (when := counts[cause].first(sent))]
        if not found:
            return WITHHELD if self._is_withheld(sent) else ""
        when, cause = min(found)
        counts[cause].take(when)
        return cause
