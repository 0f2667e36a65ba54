"""The node ``clik``: kinematic control, section III; publishes ``joint_reference``."""

import sys
from dataclasses import dataclass

from eulerparams_control.laws.clik import FEEDBACKS, Clik, ClikLaw
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.scheme import Scheme
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.commands import CommandPublisher
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.control_parameters import ControlParameters
from eulerparams_control.ros.parameters import parameter
from eulerparams_control.ros.qos import QOS_STREAM
from eulerparams_control.ros.runtime import run


@dataclass(frozen=True)
class ClikParameters(ControlParameters):
    """Parameters of the node ``clik``."""

    k_Pp: float = parameter(100.0, "position gain", unit="1/s", bounds=(0.0, 1e4), live=True)
    k_Po: float = parameter(100.0, "orientation gain", unit="1/s", bounds=(0.0, 1e4), live=True)
    feedback: str = parameter("internal", "which q closes the loop", choices=FEEDBACKS)
    max_deviation: float = parameter(
        0.3,
        "a joint farther from its command than this stops the motion",
        unit="rad",
        bounds=(0.001, 100.0),
    )
    k_posture: float = parameter(
        1.0, "gain of the posture", unit="1/s", bounds=(0.0, 1e3), live=True
    )

    def law(self) -> ClikLaw:
        """Return the law with these parameters."""
        return ClikLaw(
            self.representation(),
            self.k_Pp,
            self.k_Po,
            self.inverse(),
            self.posture_or_none(),
            self.k_posture,
        )


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
