"""Nodes that die, and nodes that are one too many.

Nothing of this happens to the messages: who has the nodes does it.
"""

import copy
import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

from eulerparams_control.lab.faults.base import Fault, setting
from eulerparams_control.lab.faults.fields import numbers


@dataclass(frozen=True, kw_only=True)
class Kill(Fault):
    """A node is killed, without a word, and started again.

    Attributes:
        node: its executable.
        restart_after: how long after its death it is started again [s]; infinite: never.
    """

    name: ClassVar[str] = "kill"

    topic: str = field(default="", init=False)
    duration: float = field(default=0.0, init=False)
    node: str
    restart_after: float = setting("until it is started again [s]", low=0.0, default=math.inf)

    @property
    def end(self) -> float:
        """When it is started again [s]; infinite if never."""
        return self.at + self.restart_after


@dataclass(frozen=True, kw_only=True)
class SecondPublisher(Fault):
    """Another node publishes to the same topic, what is a little beside the last true message.

    Attributes:
        rate: of its messages [Hz].
        offset: on each number of its messages but those of rotations, in the unit of the number.
    """

    name: ClassVar[str] = "second_publisher"

    rate: float = setting("of its messages [Hz]", low=0.1, high=1000.0, default=20.0)
    offset: float = setting("on each of its numbers", low=-1e6, high=1e6, default=0.0)

    def message(self, last: Any) -> Any:
        """Return what it publishes, after a true message."""
        own = copy.deepcopy(last)
        for number in numbers(own):
            if ".rotation." not in number.path:  # they are unit quaternions
                number.put(number.value + self.offset)
        return own
