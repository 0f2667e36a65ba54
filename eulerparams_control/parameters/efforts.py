"""Parameters of the schemes that command efforts, and what is made of them."""

from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.impedance_matrices import symmetric_matrix
from eulerparams_control.laws.inverse_dynamics import refuse_mismatch
from eulerparams_control.laws.rotations import Array
from eulerparams_control.parameters.common import ControlParameters, each_joint
from eulerparams_control.parameters.fields import other_default, parameter
from eulerparams_control.robot.robot import Robot, Tool


@dataclass(frozen=True)
class EffortParameters(ControlParameters):
    """Parameters of every scheme that commands efforts by inverse dynamics."""

    command_type: str = parameter(
        "joint_state", "message type of the command", choices=("joint_state", "forward")
    )
    max_latency: float = other_default(ControlParameters, "max_latency", 0.03)
    k_posture: float = parameter(
        10.0, "gain of the posture", unit="1/s^2", bounds=(0.0, 1e5), live=True
    )
    k_null: float = parameter(
        10.0,
        "damping of motions that do not move the tip",
        unit="1/s",
        bounds=(0.0, 1e3),
        live=True,
    )
    compensate_gravity: bool = parameter(True, "false: the robot does it itself")
    compensate_coriolis: bool = parameter(True, "false: the robot does it itself")
    compensate_friction: bool = parameter(
        False, "true only where the friction is known: too much of it drives the joints"
    )
    effort_feedback: bool = parameter(
        True, "false where the effort of joint_states is not that of the joints [Nm or N]"
    )
    friction_viscous: tuple[float, ...] = parameter(
        (), "one, or one a joint; empty: of the URDF", unit="Nm s/rad", bounds=(0.0, 1e4)
    )
    friction_coulomb: tuple[float, ...] = parameter(
        (), "one, or one a joint; empty: of the URDF", unit="Nm", bounds=(0.0, 1e4)
    )
    rotor_inertia: tuple[float, ...] = parameter(
        (),
        "of the motors, at the joints, which no URDF has; one, or one a joint; empty: none",
        unit="kg m^2",
        bounds=(0.0, 1e4),
    )
    gravity: tuple[float, ...] = parameter((0.0, 0.0, -9.81), "in the root link", unit="m/s^2")
    tool_mass: float = parameter(0.0, "that the URDF lacks", unit="kg", bounds=(0.0, 1000.0))
    tool_com: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "its centre of mass in the tip frame", unit="m"
    )
    tool_inertia: tuple[float, ...] = parameter(
        (0.0,) * 6, "xx, xy, xz, yy, yz, zz about the centre of mass", unit="kg m^2"
    )
    max_effort_rate: tuple[float, ...] = parameter(
        (),
        "one, or one a joint; empty: the effort limit in 0.02 s, 2000 or more; too little cannot "
        "stop the arm, and makes its hold oscillate",
        unit="Nm/s",
        bounds=(100.0, 1e9),
        live=True,
    )

    def robot(self, urdf: str) -> Robot:
        """Return the robot of a URDF with its tool and its rotors.

        Raises:
            ConfigurationError: if the numbers of tool, gravity or rotors are impossible.
            RobotError: if the URDF lacks a frame or a joint.
        """
        require_size("gravity", self.gravity, 3)
        frames = self.base_frame, self.tip_frame
        robot = Robot(urdf, *frames, self.joints, self.gravity, self.tool())
        if self.rotor_inertia:  # Pinocchio adds it to the diagonal of B, and to nothing else
            robot.model.armature = each_joint("rotor_inertia", self.rotor_inertia, robot)
        return robot

    def refuse_start(self, robot: Robot, q: Array, effort: Array | None) -> None:
        """Raise ModelError if the model contradicts an arm at rest, see :func:`refuse_mismatch`."""
        if self.commands_joints:
            refuse_mismatch(robot, self, q, effort)

    def friction_of(self, robot: Robot) -> JointFriction | None:
        """Return the friction that is compensated, or None; raises ConfigurationError."""
        viscous, coulomb = self.friction_viscous, self.friction_coulomb
        friction = JointFriction(
            each_joint("friction_viscous", viscous, robot) if viscous else robot.friction.viscous,
            each_joint("friction_coulomb", coulomb, robot) if coulomb else robot.friction.coulomb,
        )
        return friction if self.compensate_friction else None

    def effort_rate(self, robot: Robot) -> Array:
        """Return the rates (n,) [Nm/s] at which efforts may change; raises ConfigurationError."""
        rate = self.max_effort_rate
        return each_joint("max_effort_rate", rate, robot) if rate else robot.limits.effort_rate

    def tool(self) -> Tool | None:
        """Return the tool; None if it has no mass.

        Raises:
            ConfigurationError: if its numbers are impossible.
        """
        return self.body("tool")

    def body(self, name: str) -> Tool | None:
        """Return the body of the parameters NAME_mass, NAME_com, NAME_inertia; None if massless.

        Raises:
            ConfigurationError: if its numbers are impossible.
        """
        mass, com, six = (getattr(self, f"{name}_{part}") for part in ("mass", "com", "inertia"))
        require_size(f"{name}_com", com, 3)
        require_size(f"{name}_inertia", six, 6)
        inertia = symmetric_matrix(f"{name}_inertia", six)
        moments = np.linalg.eigvalsh(inertia)
        if moments[-1] > (moments[0] + moments[1]) * (1 + 1e-9) or moments[0] < 0:
            raise ConfigurationError(
                f"{name}_inertia has the principal moments {moments.tolist()}; of a body none is "
                "negative or larger than the sum of the two others"
            )
        if mass == 0:
            if any(six) or any(com):
                raise ConfigurationError(
                    f"{name}_com or {name}_inertia is given, but {name}_mass is 0"
                )
            return None
        return Tool(mass, np.array(com), inertia)


@dataclass(frozen=True)
class ResolvedParameters(EffortParameters):
    """Parameters of every scheme that resolves accelerations, section IV."""

    k_Pp: float = parameter(400.0, "position gain", unit="1/s^2", bounds=(0.0, 1e6), live=True)
    k_Vp: float = parameter(40.0, "its damping", unit="1/s", bounds=(0.0, 1e4), live=True)
    k_Po: float = parameter(800.0, "orientation gain", unit="1/s^2", bounds=(0.0, 1e6), live=True)
    k_Vo: float = parameter(40.0, "its damping", unit="1/s", bounds=(0.0, 1e4), live=True)


def require_size(name: str, values: tuple[float, ...], size: int) -> None:
    """Raise ConfigurationError unless there are ``size`` values."""
    if len(values) != size:
        raise ConfigurationError(f"{name} has {len(values)} values; expected {size}")
