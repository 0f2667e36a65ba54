"""The effect of faults on a stream of messages."""

import copy
import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from eulerparams_control.lab.faults.base import Fault, MessageFault


class Stage:
    """Applies a fault to the messages of one topic.

    Args:
        fault: the fault.
        random: the random numbers of this stage alone.

    Attributes:
        held: what comes out later, each with the time at which it is due [s], in their order.
        first: the first message that was hit, where the fault keeps it.
    """

    def __init__(self, fault: MessageFault, random: np.random.Generator) -> None:
        self.fault, self.random = fault, random
        self.held: deque[tuple[float, Any]] = deque()
        self.first: Any = None

    def take(self, t: float, msg: Any) -> list[Any]:
        """Return what comes out at t [s], as ``msg`` goes in; ``msg`` is its own to change.

        What was due at t has come out before.
        """
        if self.fault.is_active(t) and self._is_hit():
            return self.fault.change(msg, self, t)
        return self.hold(t, msg, t) if self.held and self.fault.keeps_order else [msg]

    def _is_hit(self) -> bool:
        """Return whether the fault hits this message."""
        probability = self.fault.probability
        return probability >= 1 or float(self.random.random()) < probability

    def hold(self, due: float, msg: Any, t: float) -> list[Any]:
        """Keep a message until it is due, behind what is held; return it if that is now, at t."""
        due = max(due, self.held[-1][0] if self.held else due)
        if due <= t:
            return [msg]
        self.held.append((due, msg))
        return []

    def due(self, t: float) -> list[Any]:
        """Return what was held back, and comes out now, at t [s]."""
        out = []
        while self.held and self.held[0][0] <= t:
            out.append(self.held.popleft()[1])
        return self.fault.release(out, self) if out else out

    @property
    def next_due(self) -> float:
        """When the next message that is held back comes out [s]; infinite if there is none."""
        return self.held[0][0] if self.held else math.inf


class FaultStream:
    """The faults of a run, at work on the messages of its topics.

    The same seed, faults and messages at the same times give the same, to the bit.  Faults on the
    same topic are at work one after the other, in the order in which they are given.  Faults of
    nodes do nothing here.  Times do not decrease.

    Args:
        faults: of the run.
        seed: of what is random.
    """

    def __init__(self, faults: Sequence[Fault], seed: int = 0) -> None:
        self.faults = tuple(faults)
        self._seed = seed
        self._stages: dict[str, list[Stage]] = {}

    def touches(self, t: float, topic: str) -> bool:
        """Return whether a message of a topic at t [s] would not go through as it is."""
        return any(stage.fault.is_active(t) or stage.held for stage in self._of(topic))

    def on_message(self, t: float, topic: str, msg: Any) -> list[Any]:
        """Return the messages of a topic that are to be delivered now, in order.

        Where a fault is at work they are copies; else it is ``msg`` itself.  ``msg`` is never
        changed and never kept.

        Args:
            t: since the start [s].
            topic: its name in ``TOPICS``.
            msg: that came on it.
        """
        if not self.touches(t, topic):
            return [msg]
        return [*self._due(t, topic), *_push(t, self._of(topic), [copy.deepcopy(msg)])]

    def due(self, t: float) -> list[tuple[str, Any]]:
        """Return topics and messages that were held back, and are to be delivered now, at t [s]."""
        return [(topic, msg) for topic in self._stages for msg in self._due(t, topic)]

    @property
    def next_due(self) -> float:
        """When the next message that is held back is due [s]; infinite if none is held."""
        stages = [stage for found in self._stages.values() for stage in found]
        return min((stage.next_due for stage in stages), default=math.inf)

    def _of(self, topic: str) -> list[Stage]:
        """Return the faults at work on a topic."""
        if topic not in self._stages:
            name = list(topic.encode())  # so that topics do not share what is random
            self._stages[topic] = [
                Stage(fault, np.random.default_rng([self._seed, k, *name]))
                for k, fault in enumerate(self.faults)
                if isinstance(fault, MessageFault) and fault.is_on(topic)
            ]
        return self._stages[topic]

    def _due(self, t: float, topic: str) -> list[Any]:
        stages = self._of(topic)
        out = []
        for k, stage in reversed(list(enumerate(stages))):  # what is furthest on comes first
            out += _push(t, stages[k + 1 :], stage.due(t))
        return out


def _push(t: float, stages: Sequence[Stage], messages: list[Any]) -> list[Any]:
    for stage in stages:
        messages = [out for msg in messages for out in stage.take(t, msg)]
    return messages
