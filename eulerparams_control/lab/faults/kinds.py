"""The kinds of faults, each with how it is drawn at random; and random sequences of them."""

import copy
import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.faults.base import (
    FROM_ROBOT,
    ROBOT,
    TOPICS,
    Draw,
    Fault,
    MessageFault,
    setting,
)
from eulerparams_control.lab.faults.fields import numbers, put_stamp, stamp_ns
from eulerparams_control.parameters.schemes import schemes
from sim_bridge.environment.keys import any_word

FIRST = 0.1
"""Part of the run before the first fault begins: the controller is to be at work."""

LAST = 0.6
"""Part of the run at whose end all faults are over, so that recovery can be judged."""

_MOST = 4  # faults of a sequence
_LONGEST, _SHORTEST = 0.5, 0.01  # [s] of a fault

_NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_ANY = "random"

_NOISE = {"wrench": 5.0, "joint_effort": 2.0}  # largest standard deviation [N, Nm]; else:
_NOISE_OF_OTHERS = 0.01  # [rad, m]


def _sometimes() -> Any:
    """Return the probability with which a fault hits a message, drawn too."""
    return setting(
        text="of a message to be hit", least=0.0, most=1.0, default=1.0,
        drawn=lambda draw, _: draw.sometimes(),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Drop(MessageFault, name="drop", shakes=True):
    """Messages are lost."""

    probability: float = _sometimes()

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        return []


@dataclass(frozen=True, kw_only=True)
class Duplicate(MessageFault, name="duplicate"):
    """Messages are repeated at once.

    Attributes:
        copies: how many more of each.
    """

    copies: int = setting(
        text="more of each message", least=1, most=100, whole=True, default=1,
        drawn=lambda draw, _: int(draw.random.integers(1, 4)),
    )  # fmt: skip

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        return [msg, *(copy.deepcopy(msg) for _ in range(self.copies))]


@dataclass(frozen=True, kw_only=True)
class Delay(MessageFault, name="delay", shakes=True, keeps_order=True):
    """Messages come late, in their order: at the end those that are held come in a burst.

    Attributes:
        by: how late [s].
    """

    by: float = setting(
        text="how late [s]", least=0.0, most=60.0, drawn=lambda draw, _: draw.number(0.005, 0.3)
    )

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        held: list[Any] = stage.hold(t + self.by, msg, t)
        return held

    @property
    def end(self) -> float:
        """When the last that was held has come [s]."""
        return self.at + self.duration + self.by


@dataclass(frozen=True, kw_only=True)
class Reorder(MessageFault, name="reorder", shakes=True):
    """Messages come in groups, each in another order than they were sent in.

    Attributes:
        depth: messages in a group; the first of them never comes first.
    """

    depth: int = setting(
        text="messages that are mixed", least=2, most=100, whole=True, default=2,
        drawn=lambda draw, _: int(draw.random.integers(2, 6)),
    )  # fmt: skip

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        stage.hold(self.at + self.duration, msg, t)
        return stage.due(math.inf) if len(stage.held) == self.depth else []

    def release(self, messages: list[Any], stage: Any) -> list[Any]:
        """Return them turned by at least one place."""
        if len(messages) < 2:
            return messages
        first = 1 + int(stage.random.integers(len(messages) - 1))
        rest = [k for k in range(len(messages)) if k != first]
        return [messages[k] for k in (first, *stage.random.permutation(rest))]


@dataclass(frozen=True, kw_only=True)
class Nan(MessageFault, name="nan", shakes=True):
    """One number of a message is not finite.

    Attributes:
        field: of which numbers one is taken, such as ``position`` or ``wrench.force.x``; "": of
            all.
        value: that it gets: nan, inf, -inf, or random of these.
    """

    field: str = any_word(default="")
    value: str = setting(
        text="that it gets", choices=(*_NOT_FINITE, _ANY), default="nan", drawn=lambda *_: _ANY
    )
    probability: float = _sometimes()

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        found = numbers(msg, self.field)
        if found:
            number = found[int(stage.random.integers(len(found)))]
            values = list(_NOT_FINITE.values()) if self.value == _ANY else []
            known = values or [_NOT_FINITE[self.value]]
            number.put(known[int(stage.random.integers(len(known))) if values else 0])
        return [msg]


@dataclass(frozen=True, kw_only=True)
class Freeze(MessageFault, name="freeze", shakes=True):
    """The values of the first message repeat, under stamps that go on."""

    stamps_go_on: ClassVar[bool] = True

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        stage.first = msg if stage.first is None else stage.first
        held = copy.deepcopy(stage.first)
        if self.stamps_go_on:
            put_stamp(held, stamp_ns(msg))
        return [held]


@dataclass(frozen=True, kw_only=True)
class Stuck(Freeze, name="stuck"):
    """The first message repeats, with its stamp."""

    stamps_go_on: ClassVar[bool] = False


def _drawn_noise(draw: Draw, topic: str) -> float:
    largest = _NOISE.get(topic, _NOISE_OF_OTHERS)
    return draw.number(0.01 * largest, largest)


@dataclass(frozen=True, kw_only=True)
class Noise(MessageFault, name="noise", shakes=True):
    """Each number gets noise of a normal distribution.

    Attributes:
        std: standard deviation, in the units of the numbers.
        field: of which numbers, such as ``velocity`` or ``wrench.force``; "": of all.
    """

    std: float = setting(text="standard deviation", least=0.0, most=1e6, drawn=_drawn_noise)
    field: str = any_word(default="")

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        for number in numbers(msg, self.field):
            number.put(number.value + float(stage.random.normal(0.0, self.std)))
        return [msg]


@dataclass(frozen=True, kw_only=True)
class ClockJump(MessageFault, name="clock_jump", topics=(*TOPICS, ROBOT)):
    """The stamps jump, from then on or for a time; of a topic, or of all that the robot sends.

    Attributes:
        by: how far, ahead or, below 0, back [s].
    """

    duration: float = setting(
        key="for", text="for how long [s]; from then on", least=0.0, endless=True, default=math.inf
    )
    by: float = setting(
        text="how far [s]", least=-1e6, most=1e6,
        drawn=lambda draw, _: draw.number(0.01, 10.0) * (1 if draw.is_so() else -1),
    )  # fmt: skip

    @property
    def end(self) -> float:
        """When the stamps jump for the last time [s]."""
        return self.at if math.isinf(self.duration) else self.at + self.duration

    def is_on(self, topic: str) -> bool:
        """Return whether it is on a topic."""
        return topic in FROM_ROBOT if self.topic == ROBOT else topic == self.topic

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """See MessageFault."""
        put_stamp(msg, stamp_ns(msg) + round(self.by * 1e9))
        return [msg]

    @classmethod
    def drawn(cls, draw: Draw, at: float, duration: float) -> Self:
        """See Fault."""
        found = super().drawn(draw, at, duration)
        return replace(found, topic=ROBOT, duration=math.inf) if draw.is_so() else found


@dataclass(frozen=True, kw_only=True)
class SecondPublisher(Fault, name="second_publisher"):
    """Another node publishes to the same topic: the last true message with an offset.

    Nothing of this happens to the messages: who has the nodes does it.

    Attributes:
        rate: of its messages [Hz].
        offset: on each number of its messages but those of rotations, in the unit of the number.
    """

    rate: float = setting(text="of its messages [Hz]", least=0.1, most=1000.0, default=20.0)
    offset: float = setting(
        text="on each of its numbers", least=-1e6, most=1e6, default=0.0,
        drawn=lambda draw, _: round(float(draw.random.uniform(-0.02, 0.02)), 6),
    )  # fmt: skip

    def message(self, last: Any) -> Any:
        """Return what it publishes, after a true message."""
        own = copy.deepcopy(last)
        for number in numbers(own):
            if ".rotation." not in number.path:  # they are unit quaternions
                number.put(number.value + self.offset)
        return own

    @classmethod
    def drawn(cls, draw: Draw, at: float, duration: float) -> Self:
        """See Fault."""
        return replace(super().drawn(draw, at, duration), topic="reference")


@dataclass(frozen=True, kw_only=True)
class Kill(Fault, name="kill"):
    """A node is killed without warning, and restarted, by the harness that runs the nodes.

    Attributes:
        node: its executable.
        restart_after: how long after its death it is started again [s]; infinite: never.
    """

    topic: str = field(default="", init=False)
    duration: float = field(default=0.0, init=False)
    node: str = any_word()
    restart_after: float = setting(
        text="until it is started again [s]", least=0.0, endless=True, default=math.inf
    )

    @property
    def end(self) -> float:
        """When it is started again [s]; infinite if never."""
        return self.at + self.restart_after

    @classmethod
    def drawn(cls, draw: Draw, at: float, duration: float) -> Self:
        """See Fault."""
        return cls(node=draw.controller, at=at, restart_after=duration)


def random_faults(seed: int, controller: str, duration: float) -> tuple[Fault, ...]:
    """Return a random sequence of faults, by when they begin; the same for the same seed.

    From one to four of all kinds, each from 0.01 to 0.5 s, all of them over after ``LAST`` of the
    run.

    Args:
        seed: the same gives the same.
        controller: name of its scheme, which may be killed and is started again.
        duration: of the run [s].

    Raises:
        UnknownNameError: if there is no such scheme.
    """
    if controller not in schemes():
        raise UnknownNameError("controller", controller, schemes())
    random = np.random.default_rng([seed, *controller.encode()])
    draw = Draw(random, schemes()[controller].topics, controller)
    kinds = tuple(Fault.registry)
    count = range(int(random.integers(1, _MOST + 1)))
    drawn = [_drawn(Fault.registry[draw.any_of(kinds)], draw, duration) for _ in count]
    return tuple(sorted(drawn, key=lambda fault: fault.at))


def _drawn(kind: type[Fault], draw: Draw, duration: float) -> Fault:
    """Return a fault of a kind that is over in time: one that is not is drawn again."""
    first, last = FIRST * duration, LAST * duration
    while True:
        at = round(float(draw.random.uniform(first, last)), 6)
        fault = kind.drawn(draw, at, draw.number(_SHORTEST, _LONGEST))
        if fault.end <= last:
            return fault
