"""Reports of a node on /diagnostics: counters, events, its health; 1 Hz and at changes."""

import math
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import defect, kind_of
from eulerparams_control.events import Event, tell
from eulerparams_control.messages.keys import CAUSE, MODE, REMEDY, SINCE, UNHEARD
from eulerparams_control.ros.publishers import unheard
from eulerparams_control.ros.qos import QOS_LATCHED

Values = dict[str, str | int | float]

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

# The same complaint is logged again after this time at the earliest.
_REPEAT_SECONDS = 5.0

# Number of complaints that are remembered.
_REMEMBERED = 20

# How long [s] a passing event, such as a rejected message, stays a warning.
_PASSES = 3.0

# Longest reason of a rejection that is shown [characters].
_LONGEST_REASON = 300


class Health:
    """The health of a node: a state with its level, counters, values, and what passes.

    Args:
        node: the node that reports.

    Attributes:
        message: what the state says.
        values: counters and values shown with the state.
        check: called once a second, before the state is published.
        gather: called each time before the state is published with its values.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._status_publisher = node.create_publisher(DiagnosticStatus, "~/status", QOS_LATCHED)
        self._level, self.message, self._remedy = WARN, "starting", ""
        self._mode = self._cause = ""
        self._since = self._now
        self._is_logged = True  # the state; else one like it was, a moment ago
        self._passing: dict[str, float] = {}  # warnings, and until when they last
        self._logged: dict[str, float] = {}
        self.values: Values = {}
        self.check: Callable[[], None] = lambda: None
        self.gather: Callable[[], None] = lambda: None
        node.create_timer(1.0, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_timer(self) -> None:
        self.check()
        self.values.pop(UNHEARD, None)
        for subscription in self._node.subscriptions:
            if (why := unheard(self._node, subscription)).fault:
                text = f"{why.fault}; {why.remedy}"
                self.values[UNHEARD] = text
                self.complain(text, error=True, about=f"QoS of {subscription.topic_name}")
                self.warn(f"a publisher of {subscription.topic_name} is not heard")
        if not self._is_logged:
            self._log()
        self.publish()

    @property
    def _now(self) -> float:
        return float(self._node.get_clock().now().nanoseconds / 1e9)

    def set(
        self, level: bytes, message: str, remedy: str = "", *, mode: str, cause: str = ""
    ) -> None:
        """Change the state; what is new is logged and published at once.

        Args:
            level: OK, WARN or ERROR.
            message: what happened, for people.
            remedy: what to do about it; "" if nothing, or if the message says so.
            mode: what the node does, for programs.
            cause: why, for programs; "" if as it was asked to.
        """
        before = self._level, self.message, self._remedy, self._mode, self._cause
        if (level, message, remedy, mode, cause) == before:
            return
        if (mode, cause) != before[3:]:
            self._since = self._now
            tell(Event.MODE, mode=mode, cause=cause)
        if level == ERROR and (level, message) != before[:2]:
            self.count("faults")
            self.values |= {"last fault": message, "last fault at [s]": self._now}
        self._level, self.message, self._remedy = level, message, remedy
        self._mode, self._cause = mode, cause
        self._log()
        self._status_publisher.publish(self._status(level, message, {}))
        self.publish()

    def _log(self) -> None:
        """Log the state."""
        if self._level == OK:
            self._node.get_logger().info(self.message)
            self._is_logged = True
            return
        # one that comes again and again, with other numbers, does not hide the rest
        about = f"{self._mode} {self._cause}" if self._level == WARN and self._cause else ""
        self._is_logged = self.complain(self.message, error=self._level == ERROR, about=about)

    def complain(self, message: str, *, error: bool = False, about: str = "") -> bool:
        """Log a warning or an error, those about the same not more than every few seconds.

        Return whether it was logged.  ``about`` is what it is about; "" is the message itself.
        """
        now, key = steady.now(), about or message
        if now - self._logged.get(key, -math.inf) < _REPEAT_SECONDS:
            return False
        self._logged.pop(key, None)
        self._logged[key] = now  # the newest last
        if len(self._logged) > _REMEMBERED:
            del self._logged[next(iter(self._logged))]
        if error:
            self._node.get_logger().error(message)
            tell(Event.FAULT, text=message)
        else:
            self._node.get_logger().warning(message)
        return True

    def warn(self, message: str) -> None:
        """Show a warning for some seconds, where else all is well."""
        is_new = steady.now() >= self._passing.get(message, -math.inf)
        self._passing[message] = steady.now() + _PASSES
        if is_new:
            self.publish()

    def reject(self, topic: str, error: Exception) -> None:
        """Count a message that cannot be used, say why, and warn for some seconds."""
        what = f"{topic} rejected"
        self.count(what)
        self.values["last rejected"] = f"{topic}: {str(error)[:_LONGEST_REASON]}"
        self.complain(f"{what}: {error}", error=True, about=f"{topic} {kind_of(error)}")
        self.warn(what)

    def attempt(self, show: Callable[[], None], what: str) -> None:
        """Show something; a failure is logged, and does not end the node."""
        try:
            show()
        except Exception as error:
            self.complain(f"{defect(error)}, of {what}", error=True, about=what)

    def count(self, name: str) -> None:
        """Add one to a counter."""
        self.values[name] = int(self.values.get(name, 0)) + 1

    def publish(self) -> None:
        """Publish the state now."""
        self.attempt(self.gather, "/diagnostics")
        level, message = self._level, self.message
        passing = sorted(text for text, until in self._passing.items() if steady.now() < until)
        if level == OK and passing:
            level, message = WARN, "; ".join([message, *passing])
        msg = DiagnosticArray(status=[self._status(level, message, self.values)])
        msg.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(msg)

    def _status(self, level: bytes, message: str, more: Values) -> DiagnosticStatus:
        since = f"{self._since:.9f}"
        state = {MODE: self._mode, CAUSE: self._cause, SINCE: since, REMEDY: self._remedy}
        return DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name().lstrip("/"),
            message=message,
            values=[KeyValue(key=k, value=_text(value)) for k, value in (state | more).items()],
        )


def _text(value: str | float) -> str:
    if isinstance(value, float) and abs(value) >= 1e6:
        return f"{value:.3f}"  # a time of the day
    return f"{value:.6g}" if isinstance(value, float) else str(value)
