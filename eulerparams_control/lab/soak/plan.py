"""What a soak runs: which controllers, for how long, and what their nodes are told."""

import math
from dataclasses import dataclass
from typing import Any

from eulerparams_control.parameters.schemes import TORQUE, schemes
from eulerparams_control.robot.catalogue import RobotDescription

CONTROLLERS = tuple(schemes())

_WARM_UP = 60.0  # [s] at most, a quarter of the rest at most
_QUARTERS, _PAGE = 4, 60.0

# A reference of more turns, of 60 points each, takes a controller longer to read than the robot
# waits for a command.
_TURNS, _LEAST_PERIOD, _RAMPS = 10, 8.0, 6

# With two processes in the loop at a few hundred Hz the arm bears these gains.
_GAINS = {"k_Pp": 400.0, "k_Vp": 40.0, "k_Po": 800.0, "k_Vo": 40.0}

_STATE_RATE = 5.0  # [Hz] of what is recorded


@dataclass(frozen=True)
class SoakPlan:
    """A soak.

    Attributes:
        controllers: that run at the same time, each with a robot of its own.
        seconds: [s] that count, after the warm-up.
        rate: [Hz] of joint_states.
    """

    controllers: tuple[str, ...] = CONTROLLERS
    seconds: float = 1200.0
    rate: float = 250.0

    @property
    def warm_up(self) -> float:
        """[s] before anything counts: what is loaded, filled and discovered once."""
        return min(_WARM_UP, self.seconds / _QUARTERS)

    @property
    def pages(self) -> int:
        """Into how many parts the time is divided: a minute at most, the same in each quarter."""
        return _QUARTERS * math.ceil(self.seconds / (_QUARTERS * _PAGE))

    @property
    def page(self) -> float:
        """[s] of a part."""
        return self.seconds / self.pages

    def bridge(self, controller: str) -> dict[str, Any]:
        """Return the parameters of the robot of a controller."""
        return {"mode": "realtime", "control": schemes()[controller].control, "rate": self.rate}

    def control(self, controller: str, robot: RobotDescription) -> dict[str, Any]:
        """Return the parameters of a controller."""
        gains = _GAINS if schemes()[controller].control == TORQUE else {}
        frames = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame}
        return frames | gains | {"state_rate": _STATE_RATE}

    def reference(self, robot: RobotDescription) -> dict[str, Any]:
        """Return the parameters of a slow circle that outlasts the soak."""
        whole = 2 * (self.warm_up + self.seconds)
        period = max(_LEAST_PERIOD, whole / _TURNS)
        return {
            "base_frame": robot.base_frame,
            "tip_frame": robot.tip_frame,
            "motion": "circle",
            "circle_radius": 0.05,
            "circle_normal": [1.0, 0.0, 0.0],
            "circle_tilt": 0.3,
            "circle_period": period,
            "circle_turns": float(math.ceil(whole / period)),
            "circle_ramp": period / _RAMPS,
        }

    def topics(self) -> list[str]:
        """Return what is recorded: little, so that the bag stays small."""
        own = [f"/{c}/{c}/{name}" for c in self.controllers for name in ("pose", "error")]
        return ["/diagnostics", *own]
