"""Options of a controller on time and references."""

from dataclasses import dataclass, fields
from typing import Any

from eulerparams_control.motion.motion_limits import MotionLimits


@dataclass(frozen=True)
class ControllerOptions:
    """Options of a controller on time and references.

    Attributes:
        state_timeout: [s] gap in the stamps of the state after which it starts again.
        reference_timeout: [s] for which a single streamed frame holds its twist.
        max_jump_position: [m] by which a reference may be away from the desired frame.
        max_jump_rotation: [rad] the same for the rotation.
        require_reference: whether to be silent until the first reference.
        check_states: whether states that the robot cannot have reached are refused.
        slow_below: smallest singular value of J below which the motion slows down; 0 never.
        max_latency: [s] by which a state may come later than the best one did.
        target_timeout: [s] for which a twist goes on without a successor.
        speed_override: rate of time of what is followed; 0 halts on the path.
        motion: limits of the tip; None shapes nothing.
    """

    state_timeout: float = 0.1
    reference_timeout: float = 0.1
    max_jump_position: float = 0.05
    max_jump_rotation: float = 0.2
    require_reference: bool = False
    check_states: bool = False
    slow_below: float = 0.05
    max_latency: float = 0.05
    target_timeout: float = 0.1
    speed_override: float = 1.0
    motion: MotionLimits | None = None

    @property
    def max_jump(self) -> tuple[float, float]:
        """By how much a reference may be away [m], [rad]."""
        return self.max_jump_position, self.max_jump_rotation

    @classmethod
    def of(cls, parameters: Any) -> "ControllerOptions":
        """Return the options that the parameters of a node say; with limits states are checked."""
        names = {field.name for field in fields(cls)} - {"check_states", "motion"}
        values = {name: getattr(parameters, name) for name in names}
        return cls(
            **values, check_states=parameters.enforce_limits, motion=parameters.motion_limits()
        )
