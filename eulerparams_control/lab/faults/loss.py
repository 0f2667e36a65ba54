"""Messages that are lost, and messages that come more than once."""

import copy
from dataclasses import dataclass
from typing import Any, ClassVar

from eulerparams_control.lab.faults.base import ChangingStage, MessageFault, Stage, setting


class _Drop(ChangingStage):
    def change(self, msg: Any) -> list[Any]:
        return []


@dataclass(frozen=True, kw_only=True)
class Drop(MessageFault):
    """Messages are lost."""

    name: ClassVar[str] = "drop"
    stage: ClassVar[type[Stage]] = _Drop


class _Duplicate(ChangingStage):
    def change(self, msg: Any) -> list[Any]:
        return [msg, *(copy.deepcopy(msg) for _ in range(self.fault.copies))]


@dataclass(frozen=True, kw_only=True)
class Duplicate(MessageFault):
    """Messages come again, at once after the first.

    Attributes:
        copies: how many more of each.
    """

    name: ClassVar[str] = "duplicate"
    stage: ClassVar[type[Stage]] = _Duplicate

    copies: int = setting("more of each message", low=1, high=100, default=1)

    def __post_init__(self) -> None:
        """Refuse what is impossible."""
        super().__post_init__()
        self.check_whole("copies", self.copies)
