"""Faults: their interface and registry, and their effect on the messages of a topic."""

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar

import numpy as np
import yaml

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.parameters.schemes import COMMANDS

FROM_ROBOT = ("joint_states", "wrench")
TO_CONTROLLER = (*FROM_ROBOT, "reference")
TO_ROBOT = tuple(COMMANDS.values())
TOPICS = (*TO_CONTROLLER, *TO_ROBOT)
"""Those that a fault can be on."""

ROBOT = "robot"
"""In the place of a topic: all of those that come from the robot, together."""

_INF = float("inf")


def setting(text: str, *, low: float = -_INF, high: float = _INF, **default: Any) -> Any:
    """Return a field of a fault: a number from ``low`` to ``high``, with its unit in ``text``."""
    return field(**default, metadata={"text": text, "low": low, "high": high})


@dataclass(frozen=True, kw_only=True)
class Fault:
    """What goes wrong, and when.

    Attributes:
        topic: on which; "" if it is on a node.
        at: when it begins [s], since the start.
        duration: for how long [s]; ``for`` in YAML.

    Raises:
        ConfigurationError: if a value is impossible; says which, and what is possible.
    """

    registry: ClassVar[dict[str, type["Fault"]]] = {}
    name: ClassVar[str] = ""
    topics: ClassVar[tuple[str, ...]] = TOPICS

    topic: str
    at: float = setting("when it begins [s]", low=0.0, high=1e6)
    duration: float = setting("for how long [s]; .inf is to the end", low=0.0)

    def __init_subclass__(cls) -> None:
        """Register a kind of fault by its name."""
        if cls.name:
            Fault.registry[cls.name] = cls

    def __post_init__(self) -> None:
        """Refuse what is impossible."""
        for key, entry in settings(type(self)).items():
            value = getattr(self, entry.name)
            if "low" in entry.metadata:
                self._check(key, value, entry.metadata)
            elif not isinstance(value, str):
                raise ConfigurationError(f"fault '{self.name}': {key}: {value!r}; expected a name")
            elif key == "topic" and value not in self.topics:
                raise UnknownNameError(f"topic of the fault '{self.name}'", value, self.topics)

    def _check(self, key: str, value: Any, spec: Mapping[str, Any]) -> None:
        low, high = spec["low"], spec["high"]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not low <= value <= high:
            raise ConfigurationError(
                f"fault '{self.name}': {key}: {value!r}; expected a number from {low:g} to "
                f"{high:g}, {spec['text']}"
            )

    def check_whole(self, key: str, value: Any) -> None:
        """Raise ConfigurationError unless a value is a whole number."""
        if not isinstance(value, int):
            raise ConfigurationError(
                f"fault '{self.name}': {key}: {value!r}; expected a whole number"
            )

    @property
    def end(self) -> float:
        """When it is over, and what comes can be as it should again [s]."""
        return self.at + self.duration

    def is_active(self, t: float) -> bool:
        """Return whether it is at work at t [s]."""
        return self.at <= t < self.at + self.duration

    def is_on(self, topic: str) -> bool:
        """Return whether it is on a topic."""
        return topic == self.topic

    def __str__(self) -> str:
        """Return it as the flow-style YAML that it is read from."""
        given = {key: getattr(self, entry.name) for key, entry in settings(type(self)).items()}
        content = {"fault": self.name, **given}
        text = yaml.safe_dump(content, default_flow_style=True, sort_keys=False, width=_INF)
        return str(text).strip()


def settings(kind: type[Fault]) -> dict[str, "Field[Any]"]:
    """Return what a kind of fault takes, by the key of YAML."""
    return {
        "for" if entry.name == "duration" else entry.name: entry
        for entry in fields(kind)
        if entry.init
    }


class Stage(ABC):
    """A fault at work on one topic: messages go in, and others come out.

    Args:
        fault: which.
        random: of its own.
    """

    def __init__(self, fault: Any, random: np.random.Generator) -> None:
        self.fault = fault
        self.random = random

    @abstractmethod
    def take(self, t: float, msg: Any) -> list[Any]:
        """Return what comes out at t [s], as ``msg`` goes in; ``msg`` is its own to change.

        What was due at t has come out before.
        """

    def _is_hit(self) -> bool:
        """Return whether the fault hits this message."""
        probability: float = self.fault.probability
        return probability >= 1 or float(self.random.random()) < probability

    def due(self, t: float) -> list[Any]:
        """Return what was held back, and comes out now, at t [s]."""
        return []

    @property
    def next_due(self) -> float:
        """When the next message that is held back comes out [s]; infinite if there is none."""
        return _INF


class ChangingStage(Stage):
    """A fault that hits each message by itself, by chance."""

    def take(self, t: float, msg: Any) -> list[Any]:
        """See Stage."""
        if not self.fault.is_active(t) or not self._is_hit():
            return [msg]
        return self.change(msg)

    @abstractmethod
    def change(self, msg: Any) -> list[Any]:
        """Return what comes out for a message that is hit."""


@dataclass(frozen=True, kw_only=True)
class MessageFault(Fault):
    """A fault on the messages of a topic.

    Attributes:
        probability: with which it hits a message.
    """

    stage: ClassVar[type[Stage]]

    probability: float = setting("of a message to be hit", low=0.0, high=1.0, default=1.0)


@dataclass(frozen=True, kw_only=True)
class RobotFault(MessageFault):
    """A fault that can also be on all topics that come from the robot, together."""

    topics: ClassVar[tuple[str, ...]] = (*TOPICS, ROBOT)


def parse_faults(where: str, content: Any) -> tuple[Fault, ...]:
    """Return the faults of a list of YAML; raises ConfigurationError that says which is wrong."""
    if not isinstance(content, list):
        raise ConfigurationError(f"{where}: expected a list of {{fault: ..., at: ..., ...}}")
    faults = []
    for number, entry in enumerate(content, 1):
        try:
            faults.append(parse_fault(entry))
        except ConfigurationError as error:
            raise ConfigurationError(f"{where}: entry {number}: {error}") from error
    return tuple(faults)


def parse_fault(content: Any) -> Fault:
    """Return the fault that a mapping of YAML describes.

    Raises:
        ConfigurationError: if it is incomplete, or a value is impossible.
        UnknownNameError: if there is no such fault, key, topic or value; lists those that exist.
    """
    if not isinstance(content, Mapping) or "fault" not in content:
        raise ConfigurationError(
            f"a fault needs the key 'fault', one of {', '.join(sorted(Fault.registry))}; "
            f"got {content!r}"
        )
    name = str(content["fault"])
    if name not in Fault.registry:
        raise UnknownNameError("fault", name, Fault.registry)
    kind = Fault.registry[name]
    known = settings(kind)
    given = {str(key): value for key, value in content.items() if key != "fault"}
    for key in given:
        if key not in known:
            raise UnknownNameError(f"key of the fault '{name}'", key, known)
    for key, entry in known.items():
        if entry.default is dataclasses.MISSING and key not in given:
            needed = (k for k, e in known.items() if e.default is dataclasses.MISSING)
            raise ConfigurationError(
                f"fault '{name}': the key '{key}' is missing; it needs {', '.join(needed)}"
            )
    return kind(**{known[key].name: _value(known[key].type, v) for key, v in given.items()})


def _value(kind: Any, value: Any) -> Any:
    """Return a value of YAML as a field has it: .nan and .inf can be words, 1 can be 1.0."""
    if kind in (str, "str") and isinstance(value, float):
        return str(value)
    if kind in (float, "float") and type(value) is int:
        return float(value)
    return value
