"""Typed errors of the package.

Every error that bad input can cause derives from :class:`EulerParamsError`, so a
program can catch them all and show their one-line message.  A message says what
was wrong, what was expected, and what to do.
"""

import difflib
import re
import traceback
from collections import Counter
from collections.abc import Iterable
from typing import ClassVar

from eulerparams_control.events import ExitCode

# A message is no longer than this.
_LONGEST = 2000

# What differs between messages that are wrong in the same way: names, lists, numbers.
_QUOTED = re.compile(r"'[^']*'|\[[^]]*\]|[-+]?\d[\d.e+-]*")


class EulerParamsError(Exception):
    """Base of all errors that this package raises on bad input.

    Attributes:
        remedy: what is to be done when it stops a motion; "" if the message says it all.
        exit_code: with which a process ends because of it.
    """

    remedy: ClassVar[str] = ""
    exit_code: ExitCode = ExitCode.ERROR

    def __str__(self) -> str:
        """Return the message in one line of bounded length: it quotes what came from outside."""
        text = "".join(c if c.isprintable() else " " for c in super().__str__())
        line = " ".join(text.split())
        return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 500]} ... {line[-400:]}"


def text_of(error: Exception) -> str:
    """Return what an error says; of one that is not ours its type, too."""
    return str(error) if isinstance(error, EulerParamsError) else repr(error)


class ConfigurationError(EulerParamsError):
    """A parameter, a YAML file or an option is impossible."""


class UnknownNameError(ConfigurationError):
    """A name is not among those that exist.

    Args:
        kind: what the name stands for, e.g. ``"robot"``.
        name: the name that was given.
        known: the names that exist.
    """

    def __init__(self, kind: str, name: object, known: Iterable[str]) -> None:
        name = str(name)
        names = sorted(known)
        known_text = ", ".join(names) or "none"
        super().__init__(f"unknown {kind} '{name}'{did_you_mean(name, names)}; known: {known_text}")


class SingularityError(EulerParamsError):
    """A representation has no finite answer at this orientation."""

    remedy = "send a reference that keeps away from it, or choose another orientation"


class FollowingError(EulerParamsError):
    """The arm does not follow its commands."""

    remedy = (
        "find what blocks, brakes or delays the arm, then send the reference again; one out of "
        "reach, nearer"
    )


class OverloadError(FollowingError):
    """The contact is larger than it may be."""

    remedy = "free the tool, then send the reference again"


class LoadError(FollowingError):
    """A load, or a push, is more than the springs of the arm hold."""

    remedy = (
        "take the load off, or declare it (tool_mass, tool_com), or raise K_p, K_o, "
        "error_clip_position or max_stretch; then send the reference again"
    )


class ContactError(FollowingError):
    """The controller feeds an oscillation of its contact."""

    remedy = (
        "lower K, or raise M and the damping, for a contact that is so stiff; see to delays of "
        "sensor, network and servo; then send the reference again"
    )


class UnsafeCommandError(EulerParamsError):
    """A command is not finite; it must not leave."""

    remedy = "send the reference again; report it if it repeats: the law is to see to this"


class RobotError(EulerParamsError):
    """The robot description lacks what is asked of it (a frame, a joint, a limit)."""


class ModelError(ConfigurationError):
    """The model is not that of the arm: it must not be controlled by it."""


class InvalidMessageError(EulerParamsError):
    """A message cannot be used; no command may follow from it."""


class BagError(EulerParamsError):
    """A bag is broken, incomplete, or in the way."""


class OccupiedError(BagError):
    """What exists in the place of a new bag; nothing is overwritten."""

    exit_code = ExitCode.REFUSED


class SimulationError(EulerParamsError):
    """The simulator was asked for something impossible, or lost its controller.

    Args:
        message: what was wrong.
        exit_code: with which a process ends because of it.
    """

    def __init__(self, message: str, exit_code: ExitCode = ExitCode.ERROR) -> None:
        super().__init__(message)
        self.exit_code = exit_code

    def __str__(self) -> str:
        """Return the message as it is: it quotes lines of a log."""
        return Exception.__str__(self)


class IdentificationError(EulerParamsError):
    """The poses taken do not tell what the tool is."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the nearest known name, or ``""``."""
    by_lower = {entry.lower(): entry for entry in known}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.65)
    return f" (did you mean '{by_lower[close[0]]}'?)" if close else ""


def listed(names: Iterable[str]) -> str:
    """Return names in a row, each with how often it is there if that is several times.

    "" is a node whose name is not known yet.
    """
    counts = Counter(sorted(names))
    return ", ".join(
        f"{name or 'one whose name is not known yet'}{f' {n} times' if n > 1 else ''}"
        for name, n in counts.items()
    )


def defect(error: Exception) -> str:
    """Return what to say of an error that nobody expected, in one line."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{frame.filename.rpartition('/')[2]}:{frame.lineno}"
    return f"internal error {type(error).__name__}: {error} ({where})"


def kind_of(error: Exception) -> str:
    """Return what an error is about, without what it quotes: the same for many messages."""
    return _QUOTED.sub("", re.split("[:;]", str(error), maxsplit=1)[0])
