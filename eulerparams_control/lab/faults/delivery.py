"""Messages that are lost, come more than once, late, or in another order."""

import copy
import math
from collections import deque
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

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


class _Delay(Stage):
    """A queue: what went in first comes out first, and nothing overtakes."""

    def __init__(self, fault: Any, random: np.random.Generator) -> None:
        super().__init__(fault, random)
        self._held: deque[tuple[float, Any]] = deque()

    def take(self, t: float, msg: Any) -> list[Any]:
        is_late = self.fault.is_active(t) and self._is_hit()
        free = t + self.fault.by if is_late else t
        if self._held:
            free = max(free, self._held[-1][0])
        if free <= t:
            return [msg]
        self._held.append((free, msg))
        return []

    def due(self, t: float) -> list[Any]:
        out = []
        while self._held and self._held[0][0] <= t:
            out.append(self._held.popleft()[1])
        return out

    @property
    def next_due(self) -> float:
        return self._held[0][0] if self._held else math.inf


@dataclass(frozen=True, kw_only=True)
class Delay(MessageFault):
    """Messages come late, in their order: at the end those that are held come in a burst.

    Attributes:
        by: how late [s].
    """

    name: ClassVar[str] = "delay"
    stage: ClassVar[type[Stage]] = _Delay

    by: float = setting("how late [s]", low=0.0, high=60.0)

    @property
    def end(self) -> float:
        """When the last that was held has come [s]."""
        return self.at + self.duration + self.by


class _Reorder(ChangingStage):
    """Holds messages until there are ``depth``, and gives them in an order that is not theirs."""

    def __init__(self, fault: Any, random: np.random.Generator) -> None:
        super().__init__(fault, random)
        self._held: list[Any] = []

    def change(self, msg: Any) -> list[Any]:
        self._held.append(msg)
        return self._all() if len(self._held) == self.fault.depth else []

    def due(self, t: float) -> list[Any]:
        return self._all() if t >= self.next_due else []

    def _all(self) -> list[Any]:
        """Return what is held, turned by at least one place."""
        held, self._held = self._held, []
        if len(held) < 2:
            return held
        first = 1 + int(self.random.integers(len(held) - 1))
        rest = [k for k in range(len(held)) if k != first]
        return [held[k] for k in (first, *self.random.permutation(rest))]

    @property
    def next_due(self) -> float:
        return self.fault.at + self.fault.duration if self._held else math.inf


@dataclass(frozen=True, kw_only=True)
class Reorder(MessageFault):
    """Messages come in groups, each in an order that is not that in which they were sent.

    Attributes:
        depth: messages in a group; the first of them never comes first.
    """

    name: ClassVar[str] = "reorder"
    stage: ClassVar[type[Stage]] = _Reorder

    depth: int = setting("messages that are mixed", low=2, high=100, default=2)

    def __post_init__(self) -> None:
        """Refuse what is impossible."""
        super().__post_init__()
        self.check_whole("depth", self.depth)
