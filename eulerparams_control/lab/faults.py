"""Faults on purpose: what goes wrong between a robot and its controller, and when.

    faults = [parse_fault({"fault": "drop", "topic": "wrench", "at": 1.0, "for": 0.2})]
    stream = FaultStream(faults, seed=1)
    for msg in stream.on_message(t, "wrench", msg): deliver(msg)
    for topic, msg in stream.due(t): deliver(msg)    # what was held back, and is due

A run repeats: what comes out depends on the seed, the messages and their times alone.
"""

import copy
import math
from array import array
from bisect import bisect_right, insort
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter, setitem
from typing import Any, ClassVar, override

import numpy as np
import yaml

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.run.yaml_checks import known, require
from eulerparams_control.parameters.schemes import COMMANDS
from sim_bridge.environment.keys import Keyed, any_word, keys_of, number, read, word

TOPICS = ("joint_states", "wrench", "reference", *COMMANDS.values())
"""Those that a fault can be on."""

FAULTY = "faulty/"
"""What stands before their names, where faults are at work."""

RENAMED = {
    "reorder": "'delay' with by: 0.0 and jitter: the time [s] within which messages are mixed",
    "nan": "'corrupt' with value: nan, inf, -inf or random",
    "noise": "'corrupt' with noise: its standard deviation",
    "freeze": "'drop' with repeat: values",
    "stuck": "'drop' with repeat: message",
    "clock_jump": "'corrupt' with stamp_offset: the jump [s], on each topic of the robot",
    "second_publisher": "'duplicate' with rate: that of the second publisher [Hz]",
}
"""Kinds of earlier versions, and what to write instead."""

_NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_SECOND = 1_000_000_000  # [ns]

setting = partial(number, "", least=0.0)
"""A field for a number of 0 or more, its unit in ``text``."""

beginning = partial(setting, text="when it begins [s], since the start", most=1e6)


class Fault(Keyed):
    """Something that goes wrong ``at`` a time [s] since the start; ``name`` is its kind in YAML."""

    name: ClassVar[str]
    at: float

    @property
    def end(self) -> float:
        """When it is over, with all that it has held back [s]."""
        raise NotImplementedError

    def __str__(self) -> str:
        """Return it as the flow-style YAML that it is read from."""
        given = {key: getattr(self, entry.name) for key, entry in keys_of(type(self)).items()}
        content = {"fault": self.name, **given}
        text = yaml.safe_dump(content, default_flow_style=True, sort_keys=False, width=math.inf)
        return str(text).strip()


@dataclass(frozen=True, kw_only=True)
class Kill(Fault):
    """A node is killed without warning, and restarted, by the experiment that runs the nodes."""

    name = "kill"
    node: str = any_word()
    at: float = beginning()
    restart_after: float = setting(
        text="until it is started again [s]; .inf is never", endless=True, default=math.inf
    )

    @property
    @override
    def end(self) -> float:
        return self.at + self.restart_after


@dataclass(frozen=True, kw_only=True)
class MessageFault(Fault):
    """A fault on the messages of a topic."""

    topic: str = word(choices=TOPICS)
    at: float = beginning()
    duration: float = setting(key="for", text="for how long [s]; .inf is to the end", endless=True)
    probability: float = setting(text="of a message to be hit", most=1.0, default=1.0)

    @property
    @override
    def end(self) -> float:
        return self.at + self.duration

    def is_active(self, t: float) -> bool:
        """Return whether it hits messages at t [s]."""
        return self.at <= t < self.at + self.duration

    def change(self, msg: Any, stage: "Stage", t: float) -> list[Any]:
        """Return what comes out at t [s] for a message that is hit, which may be changed."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Drop(MessageFault):
    """Messages are lost.

    In their place comes, with ``repeat``, the first that was hit: the whole ``message``, or its
    ``values`` under the stamps of those that are lost.
    """

    name = "drop"
    repeat: str = word(choices=("nothing", "message", "values"), default="nothing")

    @override
    def change(self, msg: Any, stage: "Stage", t: float) -> list[Any]:
        if self.repeat == "nothing":
            return []
        stage.first = msg if stage.first is None else stage.first
        again = copy.deepcopy(stage.first)
        if self.repeat == "values":
            again.header.stamp = copy.copy(msg.header.stamp)
        return [again]


@dataclass(frozen=True, kw_only=True)
class Delay(MessageFault):
    """Messages come late, in their order; with ``jitter`` one overtakes another."""

    name = "delay"
    by: float = setting(text="how late [s]", most=60.0)
    jitter: float = setting(text="how much later still, at most [s]", most=60.0, default=0.0)

    @property
    @override
    def end(self) -> float:
        return self.at + self.duration + self.by + self.jitter

    @override
    def change(self, msg: Any, stage: "Stage", t: float) -> list[Any]:
        due = t + self.by + self.jitter * float(stage.random.random())
        if not self.jitter:
            stage.not_before = due
        return stage.hold(due, msg, t)


@dataclass(frozen=True, kw_only=True)
class Duplicate(MessageFault):
    """Messages come more than once.

    With ``rate`` the messages stay as they are: the injector has a second node send the last one
    again and again, on the same topic.
    """

    name = "duplicate"
    copies: int = setting(text="more of each message", least=1, most=100, whole=True, default=1)
    rate: float = setting(text="of a second publisher [Hz]", most=1000.0, default=0.0)

    @override
    def change(self, msg: Any, stage: "Stage", t: float) -> list[Any]:
        return [msg, *(copy.deepcopy(msg) for _ in range(0 if self.rate else self.copies))]


@dataclass(frozen=True, kw_only=True)
class Corrupt(MessageFault):
    """Numbers of messages are wrong: all of them, or those of a field such as ``wrench.force``.

    One of them gets the ``value``, each of them ``noise``; the stamp gets ``stamp_offset``.
    """

    name = "corrupt"
    field: str = any_word(default="")
    value: str = word(choices=("kept", *_NOT_FINITE, "random"), default="kept")
    noise: float = setting(text="standard deviation, in their unit", most=1e6, default=0.0)
    stamp_offset: float = setting(text="on stamps [s]", least=-1e6, most=1e6, default=0.0)

    @override
    def __post_init__(self) -> None:
        super().__post_init__()
        is_wrong = self.value != "kept" or self.noise or self.stamp_offset
        require(is_wrong, "it changes nothing; expected value, noise or stamp_offset")

    @override
    def change(self, msg: Any, stage: "Stage", t: float) -> list[Any]:
        found = list(_numbers(msg, self.field))
        if self.noise:
            for value, put in found:
                put(value + float(stage.random.normal(0.0, self.noise)))
        if found and self.value != "kept":
            values = list(_NOT_FINITE) if self.value == "random" else [self.value]
            _, put = found[int(stage.random.integers(len(found)))]
            put(_NOT_FINITE[values[int(stage.random.integers(len(values)))]])
        if self.stamp_offset:
            stamp = msg.header.stamp
            ns = stamp.sec * _SECOND + stamp.nanosec + round(self.stamp_offset * _SECOND)
            stamp.sec, stamp.nanosec = divmod(ns, _SECOND)
        return [msg]


KINDS: dict[str, type[Fault]] = {
    kind.name: kind for kind in (Drop, Delay, Duplicate, Corrupt, Kill)
}


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
    is_fault = isinstance(content, Mapping) and "fault" in content
    require(is_fault, f"a fault needs the key 'fault', one of {', '.join(KINDS)}; got {content!r}")
    given = {str(key): value for key, value in content.items()}
    name = str(given.pop("fault"))
    require(name not in RENAMED, f"the fault '{name}' is now written {RENAMED.get(name)}")
    known("fault", name, KINDS)
    return read(KINDS[name], f"the fault '{name}'", given, f"{name}.")


def _numbers(
    value: Any, field: str, path: str = ""
) -> Iterator[tuple[float, Callable[[float], None]]]:
    """Yield the numbers of a message in ``field``, each with a function that puts another there."""
    store: Callable[[Any, Any, Any], None]
    entries: list[tuple[Any, str, Any]]
    if isinstance(value, list | array):
        store, entries = setitem, [(k, f"{path}[{k}]", entry) for k, entry in enumerate(value)]
    else:
        names: dict[str, str] = getattr(value, "get_fields_and_field_types", dict)()
        store, entries = setattr, [(n, f"{path}.{n}".lstrip("."), getattr(value, n)) for n in names]
    for key, inner, entry in entries:
        if not isinstance(entry, float):
            yield from _numbers(entry, field, inner)
        elif field in ("", inner) or inner.startswith((f"{field}.", f"{field}[")):
            yield entry, partial(store, value, key)


@dataclass
class Stage:
    """A fault at work on the messages of a topic, with its own random numbers."""

    fault: MessageFault
    random: np.random.Generator
    first: Any = None  # message that was hit, where the fault repeats it
    held: list[tuple[float, Any]] = field(default_factory=list)  # when due [s], and the message
    not_before: float = -math.inf  # [s], for a message that is not hit, behind what is held

    def take(self, t: float, msg: Any) -> list[Any]:
        """Return what comes out at t [s], as ``msg`` goes in, after what was due before."""
        if self.fault.is_active(t) and float(self.random.random()) < self.fault.probability:
            return self.fault.change(msg, self, t)
        return self.hold(self.not_before, msg, t)

    def hold(self, due: float, msg: Any, t: float) -> list[Any]:
        """Keep a message until it is due; return it if that is now, at t [s]."""
        if due <= t:
            return [msg]
        insort(self.held, (due, msg), key=itemgetter(0))
        return []

    def due(self, t: float) -> list[Any]:
        """Return what was held back, and comes out now, at t [s]."""
        count = bisect_right(self.held, t, key=itemgetter(0))
        out = [msg for _, msg in self.held[:count]]
        del self.held[:count]
        return out


class FaultStream:
    """The faults of a run, at work on the messages of its topics, one after the other as given.

    Args:
        faults: of the run; those of nodes do nothing here.
        seed: of what is random.
    """

    def __init__(self, faults: Sequence[Fault], seed: int = 0) -> None:
        self._stages: dict[str, list[Stage]] = {}
        for k, fault in enumerate(faults):
            if isinstance(fault, MessageFault):
                stage = Stage(fault, np.random.default_rng([seed, k]))
                self._stages.setdefault(fault.topic, []).append(stage)

    def touches(self, t: float, topic: str) -> bool:
        """Return whether a message of a topic at t [s] would not go through as it is."""
        stages = self._stages.get(topic, ())
        return any(stage.fault.is_active(t) or stage.held for stage in stages)

    def on_message(self, t: float, topic: str, msg: Any) -> list[Any]:
        """Return what comes out of a topic at t [s], as ``msg`` goes in, which is not changed."""
        if not self.touches(t, topic):
            return [msg]
        return [*self._due(t, topic), *_push(t, self._stages[topic], [copy.deepcopy(msg)])]

    def due(self, t: float) -> list[tuple[str, Any]]:
        """Return topics and messages that were held back, and come out now, at t [s]."""
        return [(topic, msg) for topic in self._stages for msg in self._due(t, topic)]

    def _due(self, t: float, topic: str) -> list[Any]:
        stages = self._stages[topic]
        out = []
        for k, stage in reversed(list(enumerate(stages))):  # what is furthest on comes first
            out += _push(t, stages[k + 1 :], stage.due(t))
        return out


def _push(t: float, stages: Sequence[Stage], messages: list[Any]) -> list[Any]:
    for stage in stages:
        messages = [out for msg in messages for out in stage.take(t, msg)]
    return messages
