"""Stamps that jump."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from eulerparams_control.lab.faults.base import ChangingStage, RobotFault, Stage, setting
from eulerparams_control.lab.faults.fields import put_stamp, stamp_ns
from eulerparams_control.lab.faults.topics import FROM_ROBOT, ROBOT


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
