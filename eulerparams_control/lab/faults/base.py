"""Faults: their interface and registry, and their effect on the messages of a topic."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
import yaml

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.run.yaml_checks import known, require
from eulerparams_control.parameters.schemes import COMMANDS
from sim_bridge.environment.keys import Keyed, any_word, keys_of, number, read

FROM_ROBOT = ("joint_states", "wrench")
TO_CONTROLLER = (*FROM_ROBOT, "reference")
TO_ROBOT = tuple(COMMANDS.values())
TOPICS = (*TO_CONTROLLER, *TO_ROBOT)
"""Those that a fault can be on."""

ROBOT = "robot"
"""In the place of a topic: all of those that come from the robot, together."""

setting = partial(number, "")
"""A field of a fault, its unit in ``text``; what is ``drawn`` draws it for a topic."""


@dataclass(frozen=True)
class Draw:
    """Random numbers from which faults are drawn.

    Attributes:
        random: where they come from.
        topics: that a fault can be on.
        controller: name of the node that may be killed.
    """

    random: np.random.Generator
    topics: tuple[str, ...]
    controller: str

    def any_of(self, names: tuple[str, ...]) -> str:
        """Return one of the names at random."""
        return names[int(self.random.integers(len(names)))]

    def number(self, low: float, high: float) -> float:
        """Return a number from low to high, each order of magnitude as likely as the next."""
        return round(float(math.exp(self.random.uniform(math.log(low), math.log(high)))), 6)

    def is_so(self) -> bool:
        """Return true in half of the cases."""
        return float(self.random.random()) < 0.5

    def sometimes(self) -> float:
        """Return a probability: of each message in half of the cases."""
        return 1.0 if self.is_so() else self.number(0.05, 1.0)


@dataclass(frozen=True, kw_only=True)
class Fault(Keyed):
    """A fault: what goes wrong, and when.

    Attributes:
        name: of the kind.
        topics: that it can be on.
        shakes: whether it moves the arm, or seems to, on topics from and to the robot.
        topic: on which; "" if it is on a node.
        at: when it begins [s], since the start.
        duration: for how long [s]; ``for`` in YAML.

    Raises:
        ConfigurationError: if a value is impossible; says which, and what is possible.
    """

    registry: ClassVar[dict[str, type["Fault"]]] = {}
    name: ClassVar[str] = ""
    topics: ClassVar[tuple[str, ...]] = TOPICS
    shakes: ClassVar[bool] = False

    topic: str = any_word()
    at: float = setting(text="when it begins [s]", least=0.0, most=1e6)
    duration: float = setting(
        key="for", text="for how long [s]; .inf is to the end", least=0.0, endless=True
    )

    def __init_subclass__(cls, **about: Any) -> None:
        """Register a kind of fault, ``about`` being its class attributes."""
        for key, value in about.items():
            setattr(cls, key, value)
        if about:
            Fault.registry[cls.name] = cls

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        super().__post_init__()
        if "topic" in keys_of(type(self)):
            known(f"topic of the fault '{self.name}'", self.topic, self.topics)

    @classmethod
    def drawn(cls, draw: Draw, at: float, duration: float) -> Self:
        """Return a random one, on one of the topics."""
        topic = draw.any_of(draw.topics)
        own = {
            entry.name: draws(draw, topic)
            for entry in fields(cls)
            if (draws := entry.metadata.get("drawn"))
        }
        return cls(**{"topic": topic, "at": at, "duration": duration, **own})

    @property
    def end(self) -> float:
        """When it is over, and messages can be correct again [s]."""
        return self.at + self.duration

    def is_active(self, t: float) -> bool:
        """Return whether it is at work at t [s]."""
        return self.at <= t < self.at + self.duration

    def is_on(self, topic: str) -> bool:
        """Return whether it is on a topic."""
        return topic == self.topic

    def __str__(self) -> str:
        """Return it as the flow-style YAML that it is read from."""
        given = {key: getattr(self, entry.name) for key, entry in keys_of(type(self)).items()}
        content = {"fault": self.name, **given}
        text = yaml.safe_dump(content, default_flow_style=True, sort_keys=False, width=math.inf)
        return str(text).strip()


@dataclass(frozen=True, kw_only=True)
class MessageFault(Fault):
    """A fault on the messages of a topic.

    Attributes:
        keeps_order: whether what it does not hit waits behind what it holds.
        probability: with which it hits a message.
    """

    keeps_order: ClassVar[bool] = False

    probability: float = setting(text="of a message to be hit", least=0.0, most=1.0, default=1.0)

    def __init_subclass__(cls, **about: Any) -> None:
        """Register a kind, which has a ``change`` of its own."""
        if about and cls.change is MessageFault.change:
            raise TypeError(f"{cls.__name__} changes no message: it needs a change")
        super().__init_subclass__(**about)

    def change(self, msg: Any, stage: Any, t: float) -> list[Any]:
        """Return what comes out at t [s] for a message that is hit.

        Args:
            msg: its own to change.
            stage: random numbers, and what it has to remember on this topic: a ``stream.Stage``.
            t: now.
        """
        raise NotImplementedError

    def release(self, messages: list[Any], stage: Any) -> list[Any]:
        """Return messages that were held as they come out."""
        return messages


def parse_faults(where: str, content: Any) -> tuple[Fault, ...]:
    """Return the faults of a list of YAML; raises ConfigurationError that says which is wrong."""
    require(isinstance(content, list), f"{where}: expected a list of {{fault: ..., at: ..., ...}}")
    faults = []
    for place, entry in enumerate(content, 1):
        try:
            faults.append(parse_fault(entry))
        except ConfigurationError as error:
            raise ConfigurationError(f"{where}: entry {place}: {error}") from error
    return tuple(faults)


def parse_fault(content: Any) -> Fault:
    """Return the fault that a mapping of YAML describes.

    Raises:
        ConfigurationError: if it is incomplete, or a value is impossible.
        UnknownNameError: if there is no such fault, key, topic or value; lists those that exist.
    """
    names = ", ".join(sorted(Fault.registry))
    is_fault = isinstance(content, Mapping) and "fault" in content
    require(is_fault, f"a fault needs the key 'fault', one of {names}; got {content!r}")
    given = {str(key): value for key, value in content.items()}
    name = str(given.pop("fault"))
    known("fault", name, Fault.registry)
    return read(Fault.registry[name], f"the fault '{name}'", given, f"{name}.")
