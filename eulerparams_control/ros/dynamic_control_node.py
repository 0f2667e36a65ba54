"""The node ``dynamic_control``: section IV; publishes ``joint_effort``."""

import sys

from eulerparams_control.laws.dynamic_control import DynamicControl
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.scheme import Scheme
from eulerparams_control.parameters.dynamic_control import DynamicParameters
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.commands import CommandPublisher
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.qos import QOS_STREAM
from eulerparams_control.ros.runtime import run


class DynamicControlNode(ControlNode):
    """Dynamic control of one arm."""

    parameters_type = DynamicParameters
    needs_velocity = True

    def __init__(self) -> None:
        super().__init__("dynamic_control")

    def make_robot(self, urdf: str) -> Robot:
        """Return the robot with its tool."""
        robot: Robot = self._params.robot(urdf)
        return robot

    def make_scheme(self, robot: Robot, limits: JointLimits | None) -> DynamicControl:
        """Return dynamic control for a robot."""
        p = self._params
        return DynamicControl(robot, p.law(), p.dynamics(robot), p.effort_limits(limits))

    def change_scheme(
        self, scheme: Scheme, parameters: DynamicParameters, limits: JointLimits | None
    ) -> None:
        """Go over to new parameters."""
        assert isinstance(scheme, DynamicControl)
        p = parameters
        scheme.replace_law(p.law(), p.dynamics(scheme.robot), p.effort_limits(limits))

    def make_commands(self, joints: tuple[str, ...]) -> CommandPublisher:
        """Return the publisher of ``joint_effort``."""
        kind = self._params.command_type
        return CommandPublisher(self, "joint_effort", kind, joints, QOS_STREAM)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(DynamicControlNode, args)


if __name__ == "__main__":
    sys.exit(main())
