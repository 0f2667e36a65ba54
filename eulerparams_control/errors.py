"""Typed errors of the package.

Every error that bad input can cause derives from :class:`EulerParamsError`, so a
program can catch them all and show their one-line message.  A message says what
was wrong, what was expected, and what to do.
"""

import difflib
from collections.abc import Iterable


class EulerParamsError(Exception):
    """Base of all errors that this package raises on bad input."""


class ConfigurationError(EulerParamsError):
    """A parameter, a YAML file or an option is impossible."""


class UnknownNameError(ConfigurationError):
    """A name is not among those that exist.

    Args:
        kind: what the name stands for, e.g. ``"robot"``.
        name: the name that was given.
        known: the names that exist.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        names = sorted(known)
        known_text = ", ".join(names) or "none"
        super().__init__(f"unknown {kind} '{name}'{did_you_mean(name, names)}; known: {known_text}")


class SingularityError(EulerParamsError):
    """A representation has no finite answer at this orientation."""


class FollowingError(EulerParamsError):
    """The arm does not follow its commands."""


class RobotError(EulerParamsError):
    """The robot description lacks what is asked of it (a frame, a joint, a limit)."""


class InvalidMessageError(EulerParamsError):
    """A message cannot be used; no command may follow from it."""


class BagError(EulerParamsError):
    """A bag is broken, incomplete, or in the way."""


class SimulationError(EulerParamsError):
    """The simulator was asked for something impossible, or lost its controller."""


class IdentificationError(EulerParamsError):
    """The poses taken do not tell what the tool is."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the nearest known name, or ``""``."""
    by_lower = {entry.lower(): entry for entry in known}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.65)
    return f" (did you mean '{by_lower[close[0]]}'?)" if close else ""
