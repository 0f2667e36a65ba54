"""The node ``impedance_control``: section V; publishes ``joint_effort`` and ``compliant_frame``."""

import math
import sys
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from eulerparams_control.compliance import TRANSLATIONAL_FRAMES, ComplianceLaw
from eulerparams_control.errors import ConfigurationError, InvalidMessageError, RobotError
from eulerparams_control.impedance import Impedance, damping_of_ratio, symmetric_matrix
from eulerparams_control.limits import JointLimits
from eulerparams_control.messages import ns_from_ros, wrench_from_ros
from eulerparams_control.motion import AT_ORIGIN, Placement
from eulerparams_control.robot import Robot
from eulerparams_control.ros.commands import CommandPublisher, ComplianceCommands
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.control_parameters import LATEST, PAIRINGS
from eulerparams_control.ros.dynamic_control_node import DynamicParameters, require_size
from eulerparams_control.ros.parameters import parameter
from eulerparams_control.ros.qos import QOS, QOS_STREAM
from eulerparams_control.ros.runtime import run
from eulerparams_control.rotations import Array, angle_between
from eulerparams_control.schemes.base import Scheme, Tick
from eulerparams_control.schemes.dynamic import DynamicControl
from eulerparams_control.schemes.impedance import (
    ImpedanceControl,
    ImpedanceLaw,
    MotionLoop,
    NoMotionLoop,
)
from eulerparams_control.wrench import SensedWrench, WrenchChain, WrenchOptions

# Slower than this [rad/s] a joint stands still, for a tare.
_AT_REST = 0.01


@dataclass(frozen=True)
class ImpedanceParameters(DynamicParameters):
    """Parameters of the node ``impedance_control``."""

    command_type: str = parameter(
        "joint_state",
        "message type of the command; none: compliant_frame only, for an arm that takes positions",
        choices=("joint_state", "forward", "none"),
    )
    k_Pp: float = parameter(
        3600.0, "position gain of the motion loop", unit="1/s^2", bounds=(0.0, 1e6), live=True
    )
    k_Vp: float = parameter(120.0, "its damping", unit="1/s", bounds=(0.0, 1e4), live=True)
    k_Po: float = parameter(
        7200.0, "orientation gain of the motion loop", unit="1/s^2", bounds=(0.0, 1e6), live=True
    )
    k_Vo: float = parameter(120.0, "its damping", unit="1/s", bounds=(0.0, 1e4), live=True)
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
        "", "link fixed to the tip that is the centre of compliance; empty: the tip"
    )
    compliance_offset: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "of the centre of compliance in that link", unit="m"
    )
    inner_loop: bool = parameter(
        True, "false: the impedance acts on the measured frame, without a motion loop"
    )
    wrench_sign: int = parameter(
        1, "-1: the sensor reports what the tool exerts", bounds=(-1, 1)
    )
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
    tare_samples: int = parameter(100, "that a tare is the mean of", bounds=(1, 100_000))
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
        def value(name: str) -> Any:
            return getattr(self, name + suffix)

        M = symmetric_matrix("M" + suffix, value("M"))
        K = symmetric_matrix("K" + suffix, value("K"), getattr(self, f"K{suffix}_axes"))
        given, ratio = value("D"), value("damping_ratio")
        try:
            checked = Impedance(M, np.zeros((3, 3)), K)
            D = symmetric_matrix("D", given) if given else damping_of_ratio(M, K, ratio)
            checked = replace(checked, D=D)
        except ConfigurationError as error:
            raise ConfigurationError(f"impedance{suffix}: {error}") from error
        if not np.linalg.eigvalsh(D)[0] > 0:
            how = "give" if not given else "raise"
            raise ConfigurationError(
                f"D{suffix} is not positive definite: without damping along an axis the arm drifts "
                f"there; {how} D{suffix} in {unit}"
            )
        return checked

    def centre(self, robot: Robot) -> Placement:
        """Return the centre of compliance seen from the tip; raises ConfigurationError."""
        require_size("compliance_offset", self.compliance_offset, 3)
        if self.compliance_frame in ("", robot.tip_frame) and not any(self.compliance_offset):
            return AT_ORIGIN
        try:
            link = robot.placement(self.compliance_frame or robot.tip_frame)
        except RobotError as error:
            raise ConfigurationError(f"compliance_frame: {error}") from error
        return Placement(link.R, link.p + link.R @ np.array(self.compliance_offset))

    def wrench_options(self, robot: Robot) -> WrenchOptions:
        """Return how the contact is made of what the sensor says; raises ConfigurationError."""
        gravity = tuple(robot.gravity.tolist())
        return WrenchOptions(
            self.wrench_sign,
            (self.body("sensed") or self.tool()) if self.compensate_tool_weight else None,
            gravity,
            self.compensate_tool_inertia,
            self.wrench_bias,
            self.force_dead_band,
            self.torque_dead_band,
            self.wrench_cutoff,
        )

    def impedance_law(self, robot: Robot) -> ImpedanceLaw:
        """Return all that the impedance is made of; raises ConfigurationError."""
        compliance = ComplianceLaw(
            self.representation(), self.translation(), self.rotation(), self.translational_frame
        )
        return ImpedanceLaw(
            compliance, self.wrench_options(robot), self.centre(robot), self.inner_loop
        )


class ImpedanceControlNode(ControlNode):
    """Impedance control of one arm."""

    parameters_type = ImpedanceParameters

    def __init__(self) -> None:
        self._sensed: SensedWrench | None = None  # the last valid one
        self._sensed_at = (0, 0.0)  # stamp [ns], time of receipt on the steady clock [s]
        self._fresh: SensedWrench | None = None  # the same, while it is not too old
        self._placements: dict[str, Placement] = {}
        self._was_fresh = True
        super().__init__("impedance_control")

    def _subscribe(self) -> None:
        p = self._params
        self.needs_velocity = p.command_type != "none"
        self._felt: deque[Array] = deque(maxlen=p.tare_samples)
        self._wrench = self._listen(WrenchStamped, "wrench", self._on_wrench, QOS)
        self.create_service(Trigger, "~/tare", self._on_tare)
        super()._subscribe()

    # --- the scheme --------------------------------------------------------------------

    def make_robot(self, urdf: str) -> Robot:
        """Return the robot with its tool."""
        robot: Robot = self._params.robot(urdf)
        return robot

    def make_scheme(self, robot: Robot, limits: JointLimits | None) -> ImpedanceControl:
        """Return impedance control for a robot."""
        p = self._params
        law, bounds = p.impedance_law(robot), p.effort_limits(limits)
        motion: MotionLoop
        if p.command_type == "none":
            motion = NoMotionLoop(robot, bounds)
        else:
            motion = DynamicControl(robot, p.law(), p.dynamics(robot), bounds)
        self._chain.replace_options(law.wrench)
        scheme = ImpedanceControl(motion, law, self._chain)
        scheme.sense(self._fresh)
        return scheme

    def change_scheme(
        self, scheme: Scheme, parameters: Any, limits: JointLimits | None
    ) -> None:
        """Go over to new parameters."""
        assert isinstance(scheme, ImpedanceControl)
        p: ImpedanceParameters = parameters
        robot = scheme.robot
        scheme.replace_law(
            p.impedance_law(robot), p.law(), p.dynamics(robot), p.effort_limits(limits)
        )

    def make_commands(self, joints: tuple[str, ...]) -> ComplianceCommands:
        """Return the publishers of ``compliant_frame`` and ``joint_effort``."""
        kind, robot = self._params.command_type, self._robot
        assert robot is not None
        efforts = None
        if kind != "none":
            efforts = CommandPublisher(self, "joint_effort", kind, joints, QOS_STREAM)
        return ComplianceCommands(self, robot.base_frame, robot.tip_frame, efforts)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the robot from its description; forget tare and sensor."""
        self._chain = WrenchChain(WrenchOptions())
        self._felt.clear()
        self._placements.clear()
        self._sensed = self._fresh = None
        return super().on_configure(state)

    # --- the wrench --------------------------------------------------------------------

    def _on_wrench(self, msg: WrenchStamped) -> None:
        if self._robot is None:
            return
        frame = msg.header.frame_id
        try:
            if frame not in self._placements:
                self._placements[frame] = self._robot.placement(frame)
            w = wrench_from_ros(msg, frame)
        except (InvalidMessageError, RobotError) as error:
            self._reject("wrench", error)
            return
        self._sensed = SensedWrench(w, self._placements[frame])
        self._sensed_at = ns_from_ros(msg.header.stamp), time.monotonic()
        self._answer()

    def _age(self, t: int) -> float:
        """Return the age [s] of the wrench at the stamp t [ns]; in simulation by the stamps."""
        stamp, received = self._sensed_at
        if self._sensed is None:
            return math.inf
        if self.get_clock().ros_time_is_active:
            return abs(t - stamp) / 1e9
        return time.monotonic() - received

    def is_complete(self, t: int) -> bool:
        """Whether the wrench of the state stamped t [ns] is there, or is not to be expected."""
        if not super().is_complete(t):
            return False
        if self._params.wrench_pairing == LATEST or self._sensed is None:
            return True
        return self._sensed_at[0] == t or self._age(t) > self._params.wrench_timeout

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Take the wrench for the state, and remember it for a tare."""
        fresh = self._age(t) <= self._params.wrench_timeout
        self._fresh = self._sensed if fresh else None
        if self._controller is not None:
            scheme = self._controller.scheme
            assert isinstance(scheme, ImpedanceControl)
            scheme.sense(self._fresh)
            self._report_wrench(fresh)
        if self._fresh is None or (np.abs(dq) > _AT_REST).any() or self._robot is None:
            self._felt.clear()
            return
        self._felt.append(self._chain.felt(self._fresh, self._robot.state(q, dq), None))

    def _report_wrench(self, fresh: bool) -> None:
        if fresh != self._was_fresh:
            self._was_fresh = fresh
            self.note(
                "" if fresh else f"no valid wrench within {self._params.wrench_timeout:g} s: the "
                "compliant frame is frozen; is the force/torque sensor running?"
            )

    def refusal(self) -> str:
        """Return why the arm must not be controlled yet; "" if it may."""
        p = self._params
        if not self._felt:
            return (
                f"no valid wrench on {self._wrench.topic_name} while the arm stands still; is the "
                "force/torque sensor running?"
            )
        self._was_fresh = True
        contact = self._felt[-1] - self._chain.tared
        force, torque = (float(np.linalg.norm(part)) for part in (contact[:3], contact[3:]))
        self._health.values["contact force [N]"] = force
        self._health.values["contact moment [Nm]"] = torque
        if force <= p.max_activation_force and torque <= p.max_activation_torque:
            return ""
        return (
            f"a wrench above max_activation_force {p.max_activation_force:g} N or "
            f"max_activation_torque {p.max_activation_torque:g} Nm is felt: move the arm away "
            "from what it touches, or call ~/tare if it touches nothing"
        )

    def _on_tare(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take the mean of the last samples for no contact."""
        missing = self._params.tare_samples - len(self._felt)
        if self._robot is None or missing > 0:
            response.success = False
            response.message = (
                f"not tared: {missing} more wrenches are needed while the arm stands still; "
                f"{self._params.tare_samples} in all (tare_samples)"
            )
            return response
        felt = np.mean(self._felt, axis=0)
        spread = np.std(self._felt, axis=0)
        self._chain.tare(felt)
        response.success = True
        response.message = (
            f"tared: force {_text(felt[:3])} N, moment {_text(felt[3:])} Nm about the tip in its "
            f"axes, standard deviations {_text(spread[:3])} N, {_text(spread[3:])} Nm"
        )
        self.get_logger().info(response.message)
        return response

    def values_of(self, tick: Tick) -> dict[str, str | int | float]:
        """Return what /diagnostics shows of a tick."""
        if tick.wrench is None or tick.command.frame is None:
            return {}
        compliant, desired = tick.command.frame, tick.desired
        return {
            "contact force [N]": float(np.linalg.norm(tick.wrench[:3])),
            "contact moment [Nm]": float(np.linalg.norm(tick.wrench[3:])),
            "displacement [m]": float(np.linalg.norm(compliant.p_d - desired.p_d)),
            "displacement [rad]": angle_between(desired.R_d, compliant.R_d),
        }


def _text(values: Array) -> str:
    return "[" + ", ".join(f"{value:.3g}" for value in values) + "]"


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ImpedanceControlNode, args)


if __name__ == "__main__":
    sys.exit(main())
