"""Parameters of the node ``clik``, and the law that is made of them."""

from dataclasses import dataclass

from eulerparams_control.laws.clik import FEEDBACKS, Clik
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.parameters.schemes import POSITION
from eulerparams_control.robot.robot import Robot


@dataclass(frozen=True)
class ClikParameters(ControlParameters, scheme="clik", control=POSITION):
    """Parameters of the node ``clik``."""

    k_Pp: float = parameter(100.0, "position gain", unit="1/s", bounds=(0.0, 1e4), live=True)
    k_Po: float = parameter(100.0, "orientation gain", unit="1/s", bounds=(0.0, 1e4), live=True)
    feedback: str = parameter("internal", "which q closes the loop", choices=FEEDBACKS)
    max_deviation: float = parameter(
        0.1,
        "a joint farther from its command than this stops the motion",
        unit="rad",
        bounds=(0.001, 100.0),
    )
    k_posture: float = parameter(
        1.0, "gain of the posture", unit="1/s", bounds=(0.0, 1e3), live=True
    )

    def make_scheme(self, robot: Robot) -> Clik:
        """Return CLIK for a robot."""
        return Clik(robot, self)
