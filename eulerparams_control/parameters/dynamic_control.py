"""Parameters of the node ``dynamic_control``."""

from dataclasses import dataclass

from eulerparams_control.laws.dynamic_control import DynamicControl
from eulerparams_control.parameters.efforts import ResolvedParameters
from eulerparams_control.robot.robot import Robot


@dataclass(frozen=True)
class DynamicParameters(ResolvedParameters, scheme="dynamic_control"):
    """Parameters of the node ``dynamic_control``: those of its inverse dynamics."""

    def make_scheme(self, robot: Robot) -> DynamicControl:
        """Return dynamic control for a robot."""
        return DynamicControl(robot, self)
