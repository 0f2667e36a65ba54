"""Parameters that every control node has."""

import math
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import (
    SEPARATE,
    SEQUENCES,
    SIGNS,
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    SignRule,
    representation,
)
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.parameters.real_time import RealTimeParameters
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.robot.robot import Robot

NO_COMMANDS = "none"
"""Instead of a message type: nothing is commanded."""

LATEST = "latest"
PAIRINGS = (LATEST, "stamp")
"""The message that belongs to a state: the newest, or the one of the same stamp."""

SIMULATED_ONLY = frozenset(
    (
        *("enforce_limits", "shape_motion", "velocity_scale"),
        *("quaternion_sign", "quaternion_initial_sign"),
    )
)
"""Parameters with values that are for simulations only, see ``for_simulation``."""


@dataclass(frozen=True)
class ControlParameters(RealTimeParameters):
    """Parameters of every control node."""

    robot_description: str = parameter("", "URDF; empty: from the topic robot_description")
    base_frame: str = parameter("", "link that poses refer to; empty: the root link")
    tip_frame: str = parameter("tool0", "link that is controlled")
    joints: tuple[str, ...] = parameter((), "active joints; empty: all from base to tip")
    orientation: str = parameter(
        "euler_parameters",
        "representation of the orientation displacement",
        choices=OrientationRepresentation.registry,
        live=True,
    )
    euler_sequence: str = parameter(
        "XYZ", "sequence of the Euler angles", choices=SEQUENCES, live=True
    )
    quaternion_sign: str = parameter(
        SignRule.name,
        "sign of the mutual quaternion; separate, in simulation only, takes the long way round",
        choices=(*SIGNS, SEPARATE),
        live=True,
    )
    quaternion_initial_sign: int = parameter(
        SignRule.initial,
        "of eta at the start; -1 with continuous only, to study Q1",
        bounds=(-1, 1),
        live=True,
    )
    hysteresis: float = parameter(
        SignRule.delta, "eta below minus this flips the sign", bounds=(0.0, 0.99), live=True
    )
    damping_eps: float = parameter(
        DampedInverse.eps, "singular value of J where damping sets in", bounds=(0.0, 1.0), live=True
    )
    damping_max: float = parameter(
        DampedInverse.lambda_max, "damping at a kinematic singularity", bounds=(0.0, 1.0), live=True
    )
    slow_below: float = parameter(
        0.05, "singular value of J below which the motion slows down; 0 never", bounds=(0.0, 1.0)
    )
    posture: tuple[float, ...] = parameter(
        (), "joint positions that a redundant arm tends to; empty: none", unit="rad", live=True
    )
    enforce_limits: bool = parameter(
        True, "keep to the limits of the URDF; false only with use_sim_time"
    )
    velocity_scale: float = parameter(
        1.0,
        "times the URDF's velocity limits; above 1 in simulation only",
        bounds=(0.001, 100.0),
        live=True,
    )
    max_joint_acceleration: tuple[float, ...] = parameter(
        (10.0,), "one, or one a joint", unit="rad/s^2", bounds=(0.01, 1e6), live=True
    )
    max_error_position: float = parameter(
        0.1, "a larger position error stops the motion", unit="m", bounds=(1e-4, 100.0), live=True
    )
    max_error_rotation: float = parameter(
        0.5,
        "a larger orientation error stops the motion; pi: none does",
        unit="rad",
        bounds=(1e-3, math.pi),
        live=True,
    )
    shape_motion: bool = parameter(
        True, "make references smooth, within the limits of the tip; false only with use_sim_time"
    )
    max_linear_speed: float = parameter(
        0.25, "of the tip", unit="m/s", bounds=(0.001, 100.0), live=True
    )
    max_angular_speed: float = parameter(
        1.0, "of the tip", unit="rad/s", bounds=(0.001, 100.0), live=True
    )
    max_link_speed: float = parameter(
        0.0,
        "of the origin of each link, elbow and wrists among them; 0: max_linear_speed",
        unit="m/s",
        bounds=(0.0, 100.0),
        live=True,
    )
    max_linear_acceleration: float = parameter(
        1.0, "of the tip", unit="m/s^2", bounds=(0.01, 1e4), live=True
    )
    max_angular_acceleration: float = parameter(
        4.0, "of the tip", unit="rad/s^2", bounds=(0.01, 1e4), live=True
    )
    max_linear_jerk: float = parameter(
        20.0, "of the tip", unit="m/s^3", bounds=(0.1, 1e6), live=True
    )
    max_angular_jerk: float = parameter(
        80.0, "of the tip", unit="rad/s^3", bounds=(0.1, 1e6), live=True
    )
    speed_override: float = parameter(
        1.0,
        "rate of time of what is followed: 0 halts on the path, 1 is as asked",
        bounds=(0.0, 1.0),
        live=True,
    )
    command_type: str = parameter(
        "joint_state",
        "message type of the command",
        choices=("joint_state", "joint_trajectory", "forward"),
    )
    state_timeout: float = parameter(
        0.1, "gap of joint_states that ends commands", unit="s", bounds=(0.001, 60.0)
    )
    max_latency: float = parameter(
        0.05,
        "joint_states that come later than the best ones by this are dropped",
        unit="s",
        bounds=(0.001, 60.0),
    )
    reference_timeout: float = parameter(
        0.1, "a single streamed frame holds its twist for", unit="s", bounds=(0.0, 60.0)
    )
    target_timeout: float = parameter(
        0.1, "a target_twist, or a target_wrench, goes on for", unit="s", bounds=(0.0, 1.0)
    )
    max_jump_position: float = parameter(
        0.05, "largest distance at which a reference may begin", unit="m", bounds=(0.0, 100.0)
    )
    max_jump_rotation: float = parameter(
        0.2, "a reference may begin turned by this", unit="rad", bounds=(0.0, math.pi)
    )
    reference_pairing: str = parameter(
        LATEST,
        "what a state is answered with: the reference there is, or the one of its stamp",
        choices=PAIRINGS,
    )
    paired_targets: tuple[str, ...] = parameter(
        (), "topics, as target_wrench, of which each state waits for the message of its stamp"
    )
    require_reference: bool = parameter(False, "be silent until the first reference")
    wait_for_subscribers: int = parameter(
        0, "of the command, before the first state is answered", bounds=(0, 100)
    )
    state_rate: float = parameter(
        50.0,
        "rate of ~/pose, ~/desired, ~/error and ~/lyapunov at most",
        unit="Hz",
        bounds=(0.0, 10000.0),
    )
    publish_tf: bool = parameter(
        False, "desired, compliant, actual frame on /tf at state_rate, where tf2_msgs is installed"
    )
    autostart: bool = parameter(True, "configure and activate as soon as possible")

    scheme: ClassVar[SchemeInfo]

    def __init_subclass__(cls, scheme: str = "", **interface: Any) -> None:
        """Register the scheme whose parameters these are; without a name they are of none.

        Args:
            scheme: its name.
            interface: the further attributes of its :class:`SchemeInfo`.
        """
        super().__init_subclass__()
        if scheme:
            cls.scheme = SchemeInfo(scheme, cls, **interface)

    @property
    def for_simulation(self) -> str:
        """What is set that is for simulations only; "" if nothing."""
        if not self.enforce_limits:
            return "enforce_limits: false"
        if not self.shape_motion:
            return "shape_motion: false"
        if self.quaternion_sign == SEPARATE:
            return f"quaternion_sign: {SEPARATE}"
        if self.quaternion_initial_sign < 0:
            return f"quaternion_initial_sign: {self.quaternion_initial_sign}"
        if self.velocity_scale > 1:
            return f"velocity_scale: {self.velocity_scale:g}, above 1,"
        return ""

    def limits(self, robot: Robot) -> JointLimits | None:
        """Return what bounds the commands for a robot; None if nothing does.

        Raises:
            ConfigurationError: if there is neither one limit nor one a joint.
        """
        acceleration = each_joint("max_joint_acceleration", self.max_joint_acceleration, robot)
        if not self.enforce_limits:
            return None
        velocity = self.velocity_scale * robot.limits.velocity
        return replace(robot.limits, velocity=velocity, acceleration=acceleration)

    def motion_limits(self) -> MotionLimits | None:
        """Return the limits of the tip; None if nothing bounds it."""
        if not (self.enforce_limits and self.shape_motion):
            return None
        names = (field.name for field in fields(MotionLimits))
        return MotionLimits(**{name: getattr(self, f"max_{name}") for name in names})

    def representation(self) -> OrientationRepresentation:
        """Return the representation that they name."""
        return representation(self.orientation, self.orientation_options())

    @property
    def commands_joints(self) -> bool:
        """Whether commands for the joints are published at all."""
        return self.command_type != NO_COMMANDS

    def orientation_options(self) -> OrientationOptions:
        """Return what representations may differ in besides their name."""
        return OrientationOptions(
            EulerSequence(self.euler_sequence),
            SignRule(self.quaternion_sign, self.hysteresis, self.quaternion_initial_sign),
        )

    def robot(self, urdf: str) -> Robot:
        """Return the robot of a URDF; raises RobotError if it lacks a frame or a joint."""
        return Robot(urdf, self.base_frame, self.tip_frame, self.joints)

    def refuse_start(self, robot: Robot, q: Array, effort: Array | None) -> None:
        """Raise ModelError if the robot at q (n,), with its efforts, is not as the model says."""

    def inverse(self, robot: Robot) -> DampedInverse:
        """Return the inverse of the Jacobian of a robot."""
        return DampedInverse(self.damping_eps, self.damping_max, robot.length)

    def posture_of(self, robot: Robot) -> Array | None:
        """Return the posture (n,) [rad or m] of a robot, or None; raises ConfigurationError."""
        if self.posture and len(self.posture) != robot.n:
            raise ConfigurationError(
                f"posture has {len(self.posture)} values; expected one for each of the {robot.n} "
                f"joints {', '.join(robot.joints)}"
            )
        return np.array(self.posture, dtype=float) if self.posture else None


def each_joint(name: str, given: tuple[float, ...], robot: Robot) -> Array:
    """Return one value a joint (n,) where one, or one a joint, is given.

    Raises:
        ConfigurationError: if it is another number of values.
    """
    if len(given) not in (1, robot.n):
        raise ConfigurationError(
            f"{name} has {len(given)} values; expected one for each of the {robot.n} joints "
            f"{', '.join(robot.joints)}, or one for all"
        )
    return np.full(robot.n, given[0]) if len(given) == 1 else np.array(given)
