"""Parameters of the node ``dynamic_control``."""

from dataclasses import dataclass

from eulerparams_control.laws.dynamic_control import DynamicControl
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.parameters.efforts import EffortParameters
from eulerparams_control.robot.robot import Robot


@dataclass(frozen=True)
class DynamicParameters(EffortParameters, scheme="dynamic_control"):
    """Parameters of the node ``dynamic_control``: those of its inverse dynamics."""

    def make_scheme(self, robot: Robot, limits: JointLimits | None) -> DynamicControl:
        """Return dynamic control for a robot."""
        return DynamicControl(robot, self.law(), self.dynamics(robot), self.effort_limits(limits))

    def change_scheme(self, scheme: DynamicControl, limits: JointLimits | None) -> None:
        """Let a running scheme go over to these parameters; raises ConfigurationError."""
        scheme.replace_law(self.law(), self.dynamics(scheme.robot), self.effort_limits(limits))
