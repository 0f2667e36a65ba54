"""Parameters that every control node has."""

import math
from dataclasses import dataclass

from eulerparams_control.controller import ControllerOptions
from eulerparams_control.orientation import (
    ORIENTATIONS,
    SEQUENCES,
    SIGNS,
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    SignRule,
    representation,
)
from eulerparams_control.ros.commands import CommandPublisher
from eulerparams_control.ros.parameters import parameter


@dataclass(frozen=True)
class ControlParameters:
    """Parameters of every control node."""

    robot_description: str = parameter("", "URDF; empty: from the topic robot_description")
    base_frame: str = parameter("", "link that poses refer to; empty: the root link")
    tip_frame: str = parameter("tool0", "link that is controlled")
    joints: tuple[str, ...] = parameter((), "active joints; empty: all from base to tip")
    orientation: str = parameter(
        "euler_parameters",
        "representation of the orientation displacement",
        choices=ORIENTATIONS,
        live=True,
    )
    euler_sequence: str = parameter(
        "XYZ", "sequence of the Euler angles", choices=SEQUENCES, live=True
    )
    quaternion_sign: str = parameter(
        "hysteretic", "sign of the mutual quaternion", choices=SIGNS, live=True
    )
    hysteresis: float = parameter(
        0.2, "eta below minus this flips the sign", bounds=(0.0, 0.99), live=True
    )
    damping_eps: float = parameter(
        0.05, "singular value of J where damping sets in", bounds=(0.0, 1.0), live=True
    )
    damping_max: float = parameter(
        0.05, "damping at a kinematic singularity", bounds=(0.0, 1.0), live=True
    )
    enforce_limits: bool = parameter(
        True, "keep to the limits of the URDF; false only with use_sim_time"
    )
    velocity_scale: float = parameter(
        1.0, "fraction of the URDF's velocity limits", bounds=(0.001, 1.0), live=True
    )
    command_type: str = parameter(
        "joint_state", "message type of the command", choices=CommandPublisher.TYPES
    )
    state_timeout: float = parameter(
        0.1, "gap of joint_states that ends commands", unit="s", bounds=(0.001, 60.0)
    )
    reference_timeout: float = parameter(
        0.1, "a single streamed frame holds its twist for", unit="s", bounds=(0.0, 60.0)
    )
    max_jump_position: float = parameter(
        0.05, "a reference may begin this far away", unit="m", bounds=(0.0, 100.0)
    )
    max_jump_rotation: float = parameter(
        0.2, "a reference may begin turned by this", unit="rad", bounds=(0.0, math.pi)
    )
    max_deviation: float = parameter(
        0.3,
        "a joint farther from its command than this stops the motion",
        unit="rad",
        bounds=(0.001, 100.0),
    )
    require_reference: bool = parameter(False, "be silent until the first reference")
    state_rate: float = parameter(
        50.0, "rate of ~/pose and ~/error at most", unit="Hz", bounds=(0.0, 10000.0)
    )
    autostart: bool = parameter(True, "configure and activate as soon as possible")

    def representation(self) -> OrientationRepresentation:
        """Return the representation that they name."""
        options = OrientationOptions(
            EulerSequence(self.euler_sequence), SignRule(self.quaternion_sign, self.hysteresis)
        )
        return representation(self.orientation, options)

    def controller_options(self) -> ControllerOptions:
        """Return how the controller is to treat time and references."""
        return ControllerOptions(
            self.state_timeout,
            self.reference_timeout,
            self.max_jump_position,
            self.max_jump_rotation,
            self.require_reference,
        )
