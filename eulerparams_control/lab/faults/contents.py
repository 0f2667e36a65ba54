"""Messages that say what is not so, and stamps that jump."""

import copy
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.faults.base import (
    FROM_ROBOT,
    ROBOT,
    ChangingStage,
    MessageFault,
    RobotFault,
    Stage,
    setting,
)
from eulerparams_control.lab.faults.fields import numbers, put_stamp, stamp_ns

ANY = "random"
_NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


class _ClockJump(ChangingStage):
    def change(self, msg: Any) -> list[Any]:
        put_stamp(msg, stamp_ns(msg) + round(self.fault.by * 1e9))
        return [msg]


@dataclass(frozen=True, kw_only=True)
class ClockJump(RobotFault):
    """The stamps jump, from then on or for a time; of a topic, or of all that the robot sends.

    Attributes:
        by: how far, ahead or, below 0, back [s].
    """

    name: ClassVar[str] = "clock_jump"
    stage: ClassVar[type[Stage]] = _ClockJump

    duration: float = setting("for how long [s]; from then on", low=0.0, default=math.inf)
    by: float = setting("how far [s]", low=-1e6, high=1e6)

    @property
    def end(self) -> float:
        """When the stamps jump for the last time [s]."""
        return self.at if math.isinf(self.duration) else self.at + self.duration

    def is_on(self, topic: str) -> bool:
        """Return whether it is on a topic."""
        return topic in FROM_ROBOT if self.topic == ROBOT else topic == self.topic


class _Nan(ChangingStage):
    def change(self, msg: Any) -> list[Any]:
        found = numbers(msg, self.fault.field)
        if found:
            number = found[int(self.random.integers(len(found)))]
            number.put(self._value())
        return [msg]

    def _value(self) -> float:
        if self.fault.value == ANY:
            return list(_NOT_FINITE.values())[int(self.random.integers(len(_NOT_FINITE)))]
        return _NOT_FINITE[self.fault.value]


@dataclass(frozen=True, kw_only=True)
class Nan(MessageFault):
    """One number of a message is not finite.

    Attributes:
        field: of which numbers one is taken, such as ``position`` or ``wrench.force.x``; "": of
            all.
        value: that it gets: nan, inf, -inf, or random of these.
    """

    name: ClassVar[str] = "nan"
    stage: ClassVar[type[Stage]] = _Nan

    field: str = ""
    value: str = "nan"

    def __post_init__(self) -> None:
        """Refuse what is impossible."""
        super().__post_init__()
        if self.value not in (known := (*_NOT_FINITE, ANY)):
            raise UnknownNameError("value of the fault 'nan'", str(self.value), known)


class _Hold(ChangingStage):
    """Keeps the first message that is hit."""

    def __init__(self, fault: Any, random: np.random.Generator) -> None:
        super().__init__(fault, random)
        self._first: Any = None

    def change(self, msg: Any) -> list[Any]:
        if self._first is None:
            self._first = msg
        held = copy.deepcopy(self._first)
        if self.fault.stamps_go_on:
            put_stamp(held, stamp_ns(msg))
        return [held]


@dataclass(frozen=True, kw_only=True)
class Freeze(MessageFault):
    """The values of the first message repeat, under stamps that go on."""

    name: ClassVar[str] = "freeze"
    stage: ClassVar[type[Stage]] = _Hold
    stamps_go_on: ClassVar[bool] = True


@dataclass(frozen=True, kw_only=True)
class Stuck(MessageFault):
    """The first message repeats, with its stamp."""

    name: ClassVar[str] = "stuck"
    stage: ClassVar[type[Stage]] = _Hold
    stamps_go_on: ClassVar[bool] = False


class _Noise(ChangingStage):
    def change(self, msg: Any) -> list[Any]:
        for number in numbers(msg, self.fault.field):
            number.put(number.value + float(self.random.normal(0.0, self.fault.std)))
        return [msg]


@dataclass(frozen=True, kw_only=True)
class Noise(MessageFault):
    """Each number is off, by a normal distribution.

    Attributes:
        std: standard deviation, in the units of the numbers.
        field: of which numbers, such as ``velocity`` or ``wrench.force``; "": of all.
    """

    name: ClassVar[str] = "noise"
    stage: ClassVar[type[Stage]] = _Noise

    std: float = setting("standard deviation", low=0.0, high=1e6)
    field: str = ""
