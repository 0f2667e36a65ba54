"""Parameters of the node ``impedance_control``, and what is made of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eulerparams_control.errors import ConfigurationError, RobotError
from eulerparams_control.laws.compliant_frame import TRANSLATIONAL_FRAMES, ComplianceLaw
from eulerparams_control.laws.contact_bound import damping_for, stiffest_contact
from eulerparams_control.laws.impedance_control import ImpedanceControl
from eulerparams_control.laws.impedance_matrices import (
    Impedance,
    damping_of_ratio,
    symmetric_matrix,
)
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.wrench import WrenchChain
from eulerparams_control.motion.frames import Placement
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.parameters.common import LATEST, NO_COMMANDS, PAIRINGS
from eulerparams_control.parameters.efforts import ResolvedParameters, require_size
from eulerparams_control.parameters.fields import other_default, parameter
from eulerparams_control.robot.robot import Robot, Tool

# A push [1/s] along each axis has to fade at least as fast.
_LEAST_DAMPING = 0.5

# The mass beyond the sensor at most, as a part of that of the impedance: above about 0.56 a delay
# of some ms destabilises the arm, as the sensor feels the acceleration before it is known.
_MOST_TOOL = 0.5


# Part of max_contact_force that an arm which follows late may make of a contact.
_IMPACT_PART = 0.65


@dataclass(frozen=True)
class ImpedanceParameters(
    ResolvedParameters,
    scheme="impedance_control",
    inputs=("wrench",),
    outputs=("compliant_frame",),
):
    """Parameters of the node ``impedance_control``."""

    command_type: str = parameter(
        "joint_state",
        "message type of the command; none: compliant_frame only, for an arm that takes positions",
        choices=("joint_state", "forward", NO_COMMANDS),
    )
    k_Pp: float = other_default(ResolvedParameters, "k_Pp", 3600.0, "of the motion loop")
    k_Vp: float = other_default(ResolvedParameters, "k_Vp", 120.0)
    k_Po: float = other_default(ResolvedParameters, "k_Po", 7200.0, "of the motion loop")
    k_Vo: float = other_default(ResolvedParameters, "k_Vo", 120.0)
    M_p: tuple[float, ...] = parameter(
        (10.0,) * 3, "mass; 3: diagonal, 6: xx, xy, xz, yy, yz, zz", unit="kg", live=True
    )
    D_p: tuple[float, ...] = parameter(
        (), "damping, as M_p; empty: by damping_ratio_p", unit="Ns/m", live=True
    )
    K_p: tuple[float, ...] = parameter(
        (1000.0,) * 3, "stiffness, as M_p; 0 along an axis guides by hand", unit="N/m", live=True
    )
    M_o: tuple[float, ...] = parameter((1.0,) * 3, "inertia, as M_p", unit="kg m^2", live=True)
    D_o: tuple[float, ...] = parameter(
        (), "damping, as M_p; empty: by damping_ratio_o", unit="Nms/rad", live=True
    )
    K_o: tuple[float, ...] = parameter((50.0,) * 3, "stiffness, as M_p", unit="Nm/rad", live=True)
    K_p_axes: tuple[float, ...] = parameter(
        (), "three unit vectors in a row, along which K_p has its 3 values; empty: x, y, z",
        live=True,
    )  # fmt: skip
    K_o_axes: tuple[float, ...] = parameter((), "the same for K_o", live=True)
    damping_ratio_p: float = parameter(
        1.5, "of each translational mode, if D_p is empty", bounds=(0.0, 100.0), live=True
    )
    damping_ratio_o: float = parameter(
        1.5, "of each rotational mode, if D_o is empty", bounds=(0.0, 100.0), live=True
    )
    translational_frame: str = parameter(
        "base", "whose axes M_p, D_p, K_p refer to", choices=TRANSLATIONAL_FRAMES, live=True
    )
    compliance_frame: str = parameter(
        "", "link fixed to the tip whose origin and axes the compliance has; empty: the tip"
    )
    compliance_offset: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "of the centre of compliance in that link", unit="m"
    )
    inner_loop: bool = parameter(
        True, "false: the impedance acts on the measured frame, without a motion loop"
    )
    wrench_sign: int = parameter(1, "-1: the sensor reports what the tool exerts", bounds=(-1, 1))
    wrench_pairing: str = parameter(
        LATEST, "wrench of a state: the newest, or the one of its stamp", choices=PAIRINGS
    )
    wrench_timeout: float = parameter(
        0.1, "without a wrench the compliant frame is frozen after", unit="s", bounds=(0.001, 60.0)
    )
    wrench_bias: tuple[float, ...] = parameter(
        (0.0,) * 6, "force and moment of the sensor without contact, its frame", unit="N, Nm",
        live=True,
    )  # fmt: skip
    sensed_mass: float = parameter(
        0.0, "beyond the sensor, where it is not tool_mass; 0: tool_mass", unit="kg",
        bounds=(0.0, 1000.0),
    )  # fmt: skip
    sensed_com: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "its centre of mass in the tip frame", unit="m"
    )
    sensed_inertia: tuple[float, ...] = parameter(
        (0.0,) * 6, "xx, xy, xz, yy, yz, zz about the centre of mass", unit="kg m^2"
    )
    compensate_tool_weight: bool = parameter(
        True, "whether the sensor feels the weight of the tool, which is then taken out"
    )
    compensate_tool_inertia: bool = parameter(
        True, "whether its inertia is taken out, too; else it counts twice, in (33) and in (48)"
    )
    force_dead_band: float = parameter(
        0.0, "by which forces are shortened", unit="N", bounds=(0.0, 1e4), live=True
    )
    torque_dead_band: float = parameter(
        0.0, "by which moments are shortened", unit="Nm", bounds=(0.0, 1e4), live=True
    )
    wrench_cutoff: float = parameter(
        0.0, "of the low-pass of the wrench; 0: none", unit="Hz", bounds=(0.0, 1e5), live=True
    )
    wrench_frame: str = parameter(
        "", "link of the sensor, fixed to the tip; empty: the frame_id of the wrench"
    )
    wrench_axes: str = parameter(
        "", "link in whose axes the wrench is, about the tip, whatever its frame_id; empty: none"
    )
    max_displacement_position: float = parameter(
        0.3,
        "of the compliant from the desired frame; there it ends",
        unit="m",
        bounds=(1e-4, 100.0),
        live=True,
    )
    max_displacement_rotation: float = parameter(
        1.5, "the same for the rotation; pi: none", unit="rad", bounds=(1e-3, math.pi), live=True
    )
    max_compliant_speed: float = parameter(
        1.0,
        "of the compliant relative to the desired frame",
        unit="m/s, rad/s",
        bounds=(0.001, 1e3),
        live=True,
    )
    max_contact_force: float = parameter(
        140.0, "a larger one stops the motion", unit="N", bounds=(0.0, 1e6), live=True
    )
    max_contact_torque: float = parameter(
        40.0, "a larger one stops the motion", unit="Nm", bounds=(0.0, 1e6), live=True
    )
    max_ripple_force: float = parameter(
        4.0,
        "a contact force that swings by more, fed by the arm, is damped, then stops the motion",
        unit="N",
        bounds=(0.01, 1e6),
        live=True,
    )
    max_ripple_torque: float = parameter(
        0.4, "the same for the moment", unit="Nm", bounds=(0.001, 1e6), live=True
    )
    stiffness_energy: float = parameter(
        0.5,
        "that a growing stiffness may add, beside what the damping takes; then it waits",
        unit="J",
        bounds=(0.0, 1e6),
        live=True,
    )
    stiffest_contact: float = parameter(
        1e5,
        "that is expected: on a stiffer one the force overshoots; the approach is slower for it",
        unit="N/m",
        bounds=(100.0, 1e8),
        live=True,
    )
    servo_lag: float = parameter(
        0.0,
        "with which the arm follows compliant_frame, to be stable on stiffest_contact; 0: prompt; "
        "the later it follows, the slower it moves: no impact exceeds 0.65 of max_contact_force",
        unit="s",
        bounds=(0.0, 1.0),
        live=True,
    )
    servo_delay: float = parameter(
        0.0, "the same: after which it follows, and its wrench comes", unit="s", bounds=(0.0, 1.0),
        live=True,
    )  # fmt: skip
    max_error_position: float = parameter(
        0.04,
        "a tip farther from the compliant frame stops the motion",
        unit="m",
        bounds=(1e-4, 100.0),
        live=True,
    )
    force_axes: tuple[str, ...] = parameter(
        ("z",), "of x, y, z of the compliance_frame, along which target_wrench presses", live=True
    )
    force_bandwidth: float = parameter(
        5.0, "of the force that is exerted", unit="Hz", bounds=(0.1, 20.0), live=True
    )
    max_approach_speed: float = parameter(
        0.02,
        "with which target_wrench looks for a contact",
        unit="m/s",
        bounds=(1e-4, 1.0),
        live=True,
    )
    tare_samples: int = parameter(100, "that a tare is the mean of", bounds=(1, 100_000))
    max_tare_force: float = parameter(
        30.0, "a larger one is not tared: the tool touches something", unit="N", bounds=(0.0, 1e6)
    )
    max_tare_torque: float = parameter(3.0, "the same for the moment", unit="Nm", bounds=(0.0, 1e6))
    max_activation_force: float = parameter(
        5.0, "no activation while a larger force is felt", unit="N", bounds=(0.0, 1e6)
    )
    max_activation_torque: float = parameter(
        0.5, "no activation while a larger moment is felt", unit="Nm", bounds=(0.0, 1e6)
    )

    def translation(self) -> Impedance:
        """Return M_p, D_p, K_p; raises ConfigurationError."""
        return self._impedance("_p", "Ns/m")

    def rotation(self) -> Impedance:
        """Return M_o, D_o, K_o; raises ConfigurationError."""
        return self._impedance("_o", "Nms/rad")

    def _impedance(self, suffix: str, unit: str) -> Impedance:
        def matrix(letter: str, axes: Sequence[float] = ()) -> Array:
            return symmetric_matrix(letter + suffix, getattr(self, letter + suffix), axes)

        given, ratio = getattr(self, f"D{suffix}"), getattr(self, f"damping_ratio{suffix}")
        try:
            M, K = matrix("M"), matrix("K", getattr(self, f"K{suffix}_axes"))
            undamped = Impedance(M, np.zeros((3, 3)), K)  # only of such a root can be taken
            checked = replace(undamped, D=matrix("D") if given else damping_of_ratio(M, K, ratio))
        except ConfigurationError as error:
            raise ConfigurationError(f"impedance{suffix}: {error}") from error
        if not checked.least_damping >= _LEAST_DAMPING:
            how = "raise" if given else "give"
            raise ConfigurationError(
                f"D{suffix} is too small against M{suffix} along an axis, where the arm would "
                f"drift: {checked.least_damping:.3g} 1/s; expected at least {_LEAST_DAMPING:g} "
                f"1/s: {how} D{suffix} in {unit}"
            )
        return checked

    def centre(self, robot: Robot) -> Placement:
        """Return the centre of compliance seen from the tip; raises ConfigurationError."""
        require_size("compliance_offset", self.compliance_offset, 3)
        try:
            return robot.placement(self.compliance_frame, self.compliance_offset)
        except RobotError as error:
            raise ConfigurationError(f"compliance_frame: {error}") from error

    def sensor(self) -> tuple[Array, Tool | None]:
        """Return the bias (6,) of the sensor, after its sign, and the tool beyond it, or None.

        Raises:
            ConfigurationError: if the sign, the bias or the numbers of the tool are impossible.
        """
        if self.wrench_sign not in (1, -1):
            raise ConfigurationError(f"wrench_sign is {self.wrench_sign}; expected 1 or -1")
        require_size("wrench_bias", self.wrench_bias, 6)
        return np.array(self.wrench_bias, dtype=float), self.body("sensed") or self.tool()

    def compliance_law(self) -> ComplianceLaw:
        """Return the impedance equations; raises ConfigurationError."""
        law = ComplianceLaw(
            self.representation(),
            self.translation(),
            self.rotation(),
            self.translational_frame,
            (
                self.max_displacement_position,
                self.max_displacement_rotation,
                min(self.max_compliant_speed, self.impact_speed),
            ),
        )
        self._refuse_late(law.translation)
        _, tool = self.sensor()
        if tool is not None:
            self._refuse_tool(tool, law)
        return law

    @property
    def impact_speed(self) -> float:
        """The speed [m/s] at which the tip may meet ``stiffest_contact``.

        An arm that follows late goes on by v (lag + delay), where the contact has the stiffness
        K_e: v = F / (K_e (lag + delay)) for the force F.
        """
        late = self.servo_lag + self.servo_delay
        force = _IMPACT_PART * self.max_contact_force
        is_bound = late > 0.0 and force > 0.0
        return force / (self.stiffest_contact * late) if is_bound else math.inf

    def motion_limits(self) -> MotionLimits | None:
        """Return the limits of the tip, which is no faster than ``impact_speed``."""
        limits = super().motion_limits()
        if limits is None:
            return None
        return replace(limits, linear_speed=min(limits.linear_speed, self.impact_speed))

    def force_selection(self) -> Array:
        """Return (3,) 1 for each of x, y, z in force_axes, else 0; raises ConfigurationError."""
        axes = self.force_axes
        if not set(axes) <= {"x", "y", "z"} or len(set(axes)) != len(axes):
            raise ConfigurationError(
                f"force_axes is {list(axes)}; expected some of x, y, z, each once at most"
            )
        return np.array([float(axis in axes) for axis in "xyz"])

    def advice(self) -> str:
        """Return what is to be said of an impedance that is possible, but weak; "" if nothing."""
        least = self.representation().least_moment(self.rotation().K)
        if least >= self.max_contact_torque:
            return ""
        return (
            f"K_o balances at most {least:.3g} Nm about one of its axes, less than "
            f"max_contact_torque {self.max_contact_torque:g} Nm: under more the compliant frame "
            "turns to max_displacement_rotation; raise K_o, or lower max_contact_torque"
        )

    def make_scheme(self, robot: Robot, chain: WrenchChain | None = None) -> ImpedanceControl:
        """Return impedance control for a robot, with the tare of a chain that is in use."""
        return ImpedanceControl(robot, self, chain)

    def _refuse_late(self, Z: Impedance) -> None:
        """Raise ConfigurationError for a servo that is too late for the contact expected, (CB2)."""
        lag, delay, stiffness = self.servo_lag, self.servo_delay, self.stiffest_contact
        if not lag + delay > 0.0:
            return
        most = stiffest_contact(Z, lag, delay)
        if most < stiffness:
            damping = damping_for(stiffness, Z.greatest_mass, lag, delay)
            raise ConfigurationError(
                f"with servo_lag {lag:g} s and servo_delay {delay:g} s this impedance is stable on "
                f"contacts of up to {most:.3g} N/m; expected stiffest_contact {stiffness:g} N/m: "
                f"give D_p of {damping:.3g} Ns/m or more, or lower stiffest_contact"
            )

    def _refuse_tool(self, tool: Tool, compliance: ComplianceLaw) -> None:
        """Raise ConfigurationError for a tool that is too heavy for the impedance."""
        arm = float(tool.com @ tool.com)
        for name, least, carried, unit in (
            ("M_p", compliance.translation.least_mass, tool.mass, "kg"),
            ("M_o", compliance.rotation.least_mass,
             tool.mass * arm + float(np.linalg.eigvalsh(tool.inertia)[-1]), "kg m^2"),
        ):  # fmt: skip
            if carried > _MOST_TOOL * least:
                raise ConfigurationError(
                    f"{name} is {least:.3g} {unit} along an axis, but the sensor carries "
                    f"{carried:.3g} {unit}; expected {name} at least {1 / _MOST_TOOL:g} times that"
                )
