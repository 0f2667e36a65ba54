"""Flaws of a bag that can be read all the same."""

from collections.abc import Iterable
from enum import StrEnum
from typing import NamedTuple


class BagFlaw(StrEnum):
    """A kind of what can be wrong."""

    UNFINISHED = "unfinished"  # a file has no end: its recorder was killed
    DAMAGED = "damaged"  # a part of a file cannot be read
    LEFT_OUT = "left_out"  # messages that cannot be used
    INCOMPLETE = "incomplete"  # a topic ends early, or lacks values
    PARAMETERS = "parameters"  # of a node are not valid
    FRAMES = "frames"  # of the reference are others: errors are not known
    DELAY = "delay"  # the motion came later than it was sent to be


class BagWarning(NamedTuple):
    """One thing that is wrong: its kind, and what it is, for people."""

    kind: BagFlaw
    text: str


def in_words(warnings: Iterable[BagWarning]) -> str:
    """Return what is wrong in a line, for people; "" if nothing is."""
    return "; ".join(warning.text for warning in warnings)
