"""What a robot does about its commands besides obeying: it brakes, refuses, and says why."""

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from eulerparams_control.errors import kind_of

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
"""Levels of /diagnostics."""

_COMMANDED = "commanded"

# No text of a message that was refused is longer on /diagnostics.
_LONGEST = 300

COUNTERS = (
    "commands rejected",
    "commands clipped",
    "commands out of order",
    "commands of a second controller",
    "commands refused in a stop",
    "protective stops",
    "steps given up",
)
"""Keys on /diagnostics of what is counted."""


class Health(Protocol):
    """Where it is said: the health of the node."""

    values: dict[str, str | int | float]

    def set(self, level: bytes, message: str, remedy: str = "") -> None:
        """Change the state."""

    def complain(self, message: str, *, error: bool = False, about: str = "") -> None:
        """Log a warning or an error."""

    def warn(self, message: str) -> None:
        """Warn for some seconds, where else all is well."""


_FIND_OUT = "find out what made it do this: the controller, a push or a contact"


class Conduct:
    """The state of a robot towards its controller, as /diagnostics shows it.

    Args:
        health: of the node.
        brake: stops the robot.
        topic: of the commands.

    Attributes:
        is_braked: whether the next command that is taken begins anew.
        is_stopping: whether a protective stop has not come to rest yet.
        is_contested: whether two controllers command.
    """

    def __init__(self, health: Health, brake: Callable[[], None], topic: str) -> None:
        self._health, self._brake, self._topic = health, brake, topic
        self.is_braked, self.is_stopping, self.is_contested = True, False, False
        self._braked_since = time.monotonic()
        self._violation = self._clipped = self._rejected = ""
        self._is_clipping = False
        self._reason: tuple[bytes, str, str] = OK, "", ""
        for name in COUNTERS:
            health.values[name] = 0

    def start(self, message: str) -> None:
        """Say what stands ready, braked until the first command."""
        self._reason = OK, message, ""
        self._health.set(*self._reason)

    def count(self, name: str, number: int = 1) -> None:
        """Add to a counter."""
        self._health.values[name] = int(self._health.values.get(name, 0)) + number

    def obey(self) -> None:
        """Say that a command is taken, after brakes."""
        self.is_braked, self._rejected = False, ""
        self._health.set(OK, _COMMANDED)

    def brake(self, reason: str, remedy: str) -> None:
        """Brake, and say why and what to do."""
        self._brake()
        if not self.is_braked:
            self.is_braked, self._braked_since = True, time.monotonic()
        self._is_clipping, self._rejected = False, ""
        self._say(ERROR, reason, remedy)

    def _say(self, level: bytes, reason: str, remedy: str) -> None:
        """Say why the robot is braked."""
        self._reason = level, reason, remedy
        self._health.set(level, reason, remedy)

    def reject(self, error: Exception) -> None:
        """Count a command that cannot be used, and say why."""
        text = self._rejected = str(error)[:_LONGEST]
        self._health.values["last command rejected"] = text
        self.count("commands rejected")
        self._health.complain(f"command rejected: {text}", error=True, about=kind_of(error))
        self._health.warn("a command rejected")

    @property
    def rejected(self) -> str:
        """Why the last command was rejected, if none was taken after it; "" if it was not."""
        return self._rejected

    def clip(self, text: str) -> None:
        """Count a command that was cut to a limit, and warn while it goes on."""
        self.count("commands clipped")
        self._clipped = text
        if not self._is_clipping:
            self._is_clipping = True
            self._health.values["last command clipped"] = text
            self._health.set(
                WARN,
                f"{_COMMANDED} beyond the limits: {text}",
                "keep the commands of the controller within the limits of the robot",
            )

    def stop(self, violation: str) -> None:
        """Brake, and refuse commands until the robot stands."""
        self.is_stopping, self._violation = True, violation
        self.count("protective stops")
        self.brake(
            f"protective stop: {violation}; braked, commands are refused until it stands",
            _FIND_OUT,
        )

    def stand(self) -> None:
        """Say that the robot stands after a protective stop, and takes commands again."""
        self.is_stopping = False
        self._say(
            ERROR,
            f"stands after a protective stop: {self._violation}",
            f"{_FIND_OUT}; the next command is taken",
        )

    def contest(self, names: Sequence[str]) -> None:
        """Brake because two controllers command; ``names`` are those of their nodes."""
        self.is_contested = True
        each = [f"{name} {names.count(name)} times" if names.count(name) > 1 else name
                for name in dict.fromkeys(names)]  # fmt: skip
        self.brake(
            f"two controllers send on '{self._topic}', whose publishers are {', '.join(each)}; "
            "braked, both are refused",
            "stop or deactivate one of them; the commands of the other are taken then",
        )

    def settle(self) -> None:
        """Say that one of two controllers has gone."""
        self.is_contested = False
        self._say(WARN, "braked until the next command: one of two controllers has gone", "")

    def review(self) -> None:
        """Bring the state up to date, once a second."""
        braked = time.monotonic() - self._braked_since if self.is_braked else 0.0
        self._health.values["braked for [s]"] = braked
        if self._is_clipping:
            self._health.values["last command clipped"] = self._clipped
        if self._is_clipping and not self._clipped:
            self._is_clipping = False
            self._health.set(OK, _COMMANDED)
        self._clipped = ""
        if self.is_braked and self._rejected:
            level, reason, remedy = self._reason
            also = f"{reason}; commands are rejected: {self._rejected}"
            self._health.set(max(level, WARN), also, remedy or "see what the controller sends")
