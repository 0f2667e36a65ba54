"""Events that processes tell programs: JSON lines on stdout, and exit codes.

Words for people go to stderr and to /diagnostics; no program reads them.  In a terminal, which a
person reads, the events are left out.
"""

import json
import sys
from contextlib import suppress
from enum import IntEnum, StrEnum
from typing import Any


class ExitCode(IntEnum):
    """How a process of this package ended."""

    OK = 0
    ERROR = 1  # wrong input, a defect; of tools: something that was looked for was found
    NOT_RUN = 2  # of tools: what was asked for could not be run
    REFUSED = 3  # what exists is not ours, or would be overwritten
    DIVERGED = 4  # a state or a command left the finite numbers
    STALLED = 5  # nobody answered in time
    INTERRUPTED = 130


class Event(StrEnum):
    """What happened in a process."""

    READY = "ready"  # it does its work from now on
    SENT = "sent"  # a motion has left
    COMMANDED = "commanded"  # the robot has found its controller
    PROGRESS = "progress"  # ``t`` [s] of the simulation or of the work
    MODE = "mode"  # a controller has another ``mode``, for a ``cause``
    FAULT = "fault"  # something is wrong; ``text`` says what
    ENDED = "ended"  # it ends; ``exit_code``, and ``text`` if it failed


_tells = False


def begin() -> None:
    """Tell events from now on: this process runs a node, and its stdout is no terminal."""
    global _tells
    _tells = not sys.stdout.isatty()


def tell(event: Event, **fields: Any) -> None:
    """Write an event as one JSON line to stdout, if it is for that: ``{"event": "ready", ...}``."""
    if not _tells:
        return
    with suppress(OSError, ValueError):  # who listened has gone: no reason to end
        print(json.dumps({"event": event.value, **fields}), flush=True, file=sys.stdout)


def events_of(text: str) -> list[dict[str, Any]]:
    """Return the events among the lines of an output; a line that is none is left out."""
    return [found for line in text.splitlines() if (found := _event_of(line)) is not None]


def _event_of(line: str) -> dict[str, Any] | None:
    if not line.startswith("{"):
        return None
    try:
        found = json.loads(line)
    except ValueError:  # a line that was cut, or that is somebody else's
        return None
    return found if isinstance(found, dict) and "event" in found else None
