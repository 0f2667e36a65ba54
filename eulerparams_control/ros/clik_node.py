"""The node ``clik``: kinematic control, section III; publishes ``joint_reference``."""

import sys

from eulerparams_control.laws.clik import Clik
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.scheme import Scheme
from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.commands import CommandPublisher
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.qos import QOS_STREAM
from eulerparams_control.ros.runtime import run


class ClikNode(ControlNode):
    """Kinematic control of one arm."""

    parameters_type = ClikParameters

    def __init__(self) -> None:
        super().__init__("clik")

    def make_scheme(self, robot: Robot, limits: JointLimits | None) -> Clik:
        """Return CLIK for a robot."""
        p = self._params
        return Clik(robot, p.law(), p.feedback, limits, max_deviation=p.max_deviation)

    def change_scheme(
        self, scheme: Scheme, parameters: ClikParameters, limits: JointLimits | None
    ) -> None:
        """Go over to new parameters."""
        assert isinstance(scheme, Clik)
        scheme.replace_law(parameters.law())
        scheme.limits = limits

    def make_commands(self, joints: tuple[str, ...]) -> CommandPublisher:
        """Return the publisher of ``joint_reference``."""
        kind = self._params.command_type
        return CommandPublisher(self, "joint_reference", kind, joints, QOS_STREAM)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ClikNode, args)


if __name__ == "__main__":
    sys.exit(main())
