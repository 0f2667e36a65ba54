"""Parameters of the node ``clik``, and the law that is made of them."""

from dataclasses import dataclass

from eulerparams_control.laws.clik import FEEDBACKS, Clik, ClikLaw
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.scheme import ErrorBounds
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.parameters.schemes import POSITION
from eulerparams_control.robot.robot import Robot


@dataclass(frozen=True)
class ClikParameters(ControlParameters, scheme="clik", control=POSITION):
    """Parameters of the node ``clik``."""

    k_Pp: float = parameter(ClikLaw.k_Pp, "position gain", unit="1/s", bounds=(0.0, 1e4), live=True)
    k_Po: float = parameter(
        ClikLaw.k_Po, "orientation gain", unit="1/s", bounds=(0.0, 1e4), live=True
    )
    feedback: str = parameter("internal", "which q closes the loop", choices=FEEDBACKS)
    max_deviation: float = parameter(
        0.1,
        "a joint farther from its command than this stops the motion",
        unit="rad",
        bounds=(0.001, 100.0),
    )
    k_posture: float = parameter(
        ClikLaw.k_posture, "gain of the posture", unit="1/s", bounds=(0.0, 1e3), live=True
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

    def max_error(self) -> ErrorBounds:
        """Return the errors of the tip that stop the motion."""
        return ErrorBounds(self.max_error_position, self.max_error_rotation)

    def make_scheme(self, robot: Robot, limits: JointLimits | None) -> Clik:
        """Return CLIK for a robot."""
        deviation, error = self.max_deviation, self.max_error()
        motion = self.motion_limits()
        return Clik(robot, self.law(), self.feedback, limits, 0.1, deviation, error, motion)

    def change_scheme(self, scheme: Clik, limits: JointLimits | None) -> None:
        """Let a running CLIK go over to these parameters."""
        scheme.replace_law(self.law())
        scheme.keep_to(limits, self.max_error(), self.motion_limits())
