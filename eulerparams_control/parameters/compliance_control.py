"""Parameters of the node ``compliance_control``, and what is made of them."""

import math
from dataclasses import dataclass

from eulerparams_control.laws.compliance_control import ComplianceControl
from eulerparams_control.laws.compliant_frame import TRANSLATIONAL_FRAMES
from eulerparams_control.laws.elasticity import Elasticity
from eulerparams_control.laws.impedance_matrices import symmetric_matrix
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.efforts import EffortParameters
from eulerparams_control.parameters.fields import other_default, parameter
from eulerparams_control.robot.robot import Robot


@dataclass(frozen=True)
class ComplianceParameters(EffortParameters, scheme="compliance_control"):
    """Parameters of the node ``compliance_control``."""

    K_p: tuple[float, ...] = parameter(
        (1000.0,) * 3,
        "stiffness; 3: diagonal, 6: xx, xy, xz, yy, yz, zz; 0 along an axis guides by hand",
        unit="N/m",
        live=True,
    )
    K_o: tuple[float, ...] = parameter((30.0,) * 3, "stiffness, as K_p", unit="Nm/rad", live=True)
    K_p_axes: tuple[float, ...] = parameter(
        (), "three unit vectors in a row, along which K_p has its 3 values; empty: x, y, z",
        live=True,
    )  # fmt: skip
    K_o_axes: tuple[float, ...] = parameter((), "the same for K_o", live=True)
    damping_ratio_p: float = parameter(
        1.0, "of each translational mode of the free arm", bounds=(0.05, 10.0), live=True
    )
    damping_ratio_o: float = parameter(
        1.0, "of each rotational mode of the free arm", bounds=(0.05, 10.0), live=True
    )
    translational_frame: str = parameter(
        "base", "whose axes K_p refers to", choices=TRANSLATIONAL_FRAMES, live=True
    )
    error_clip_position: float = parameter(
        0.05,
        "displacement along the stiffest axis from which the force grows no more",
        unit="m",
        bounds=(1e-4, 100.0),
        live=True,
    )
    error_clip_rotation: float = parameter(
        0.2, "the same for the moment", unit="rad", bounds=(1e-3, 100.0), live=True
    )
    max_stretch: float = parameter(
        1.25,
        "displacement beyond which an arm that is pushed on stops, in multiples of that at which "
        "the springs are clipped",
        bounds=(1.0, 1e4),
        live=True,
    )
    max_error_position: float = other_default(ControlParameters, "max_error_position", 10.0)
    max_error_rotation: float = other_default(ControlParameters, "max_error_rotation", math.pi)

    def elasticity(self) -> Elasticity:
        """Return the springs with these parameters; raises ConfigurationError."""
        return Elasticity(
            self.representation(),
            symmetric_matrix("K_p", self.K_p, self.K_p_axes),
            symmetric_matrix("K_o", self.K_o, self.K_o_axes),
            self.error_clip_position,
            self.error_clip_rotation,
            self.translational_frame,
        )

    def make_scheme(self, robot: Robot) -> ComplianceControl:
        """Return compliance control for a robot; raises ConfigurationError."""
        return ComplianceControl(robot, self)
