"""The node ``impedance_control``: section V; publishes ``joint_effort`` and ``compliant_frame``."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import STIFFNESS_WAITS, Cause, Why, calmed
from eulerparams_control.errors import ConfigurationError, InvalidMessageError, RobotError
from eulerparams_control.laws.compliant_frame import ComplianceLaw
from eulerparams_control.laws.impedance_control import ImpedanceControl
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.laws.scheme import Scheme, Tick
from eulerparams_control.messages.from_ros import shown
from eulerparams_control.messages.keys import WRENCH_FRAME
from eulerparams_control.messages.to_ros import impedance_to_ros
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.commands import ImpedancePublisher
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.message_info import deserialized
from eulerparams_control.ros.publishers import refuse_two_publishers, unheard
from eulerparams_control.ros.qos import QOS
from eulerparams_control.ros.resting_contact import RestingContact, norms
from eulerparams_control.ros.runtime import run
from eulerparams_control.ros.rviz import Stiffness
from eulerparams_control.ros.target_wrench import AT_ITS_END, TargetWrench
from eulerparams_control.ros.targets import Topics
from eulerparams_control.ros.wrench_input import WrenchInput

type Diagonals = dict[str, tuple[float, ...]]
"""Those of K_p and K_o, by the names of the parameters."""


class ImpedanceControlNode(ControlNode):
    """Impedance control of one arm."""

    parameters_type = ImpedanceParameters
    _declared: tuple[tuple[float, ...], tuple[float, ...]]  # K_p, K_o of the parameters

    def __init__(self) -> None:
        self._note_on_wrench, self._set_backs = Why(), 0
        self._stiffness: Diagonals = {}  # that target_stiffness asked for, until K_p, K_o change
        self._contact: RestingContact | None = None  # until the robot is known
        super().__init__()

    def _subscribe(self) -> None:
        self._sensor = WrenchInput(self._input, self._params)
        self._placements: dict[str, Placement] = {}
        self._pressing = TargetWrench(self._input)
        self._impedance = ImpedancePublisher[ComplianceLaw](
            self, lambda law, stamp: impedance_to_ros(law.translation, law.rotation, stamp)
        )
        self._wrench = self.listen(WrenchStamped, "wrench", self._on_wrench, QOS, raw=True)
        self.create_service(Trigger, "~/tare", self._on_tare)
        super()._subscribe()

    # --- the scheme --------------------------------------------------------------------

    def make_scheme(self, robot: Robot) -> ImpedanceControl:
        """Return impedance control for a robot."""
        p: ImpedanceParameters = self._params
        scheme = p.make_scheme(robot, self._contact.chain if self._contact else None)
        scheme.sense(self._sensor.fresh)
        return scheme

    def change_scheme(self, scheme: Scheme, parameters: Any) -> None:
        """Go over to new parameters; raises ConfigurationError."""
        assert isinstance(scheme, ImpedanceControl)
        declared = parameters.K_p, parameters.K_o
        stiffness = self._stiffness if declared == self._declared else {}
        scheme.change(replace(parameters, **stiffness))
        self._stiffness, self._declared = stiffness, declared
        if self._contact is not None:
            self._contact.wrenches.clear()  # they are of another tool or bias

    def leaders(self) -> Topics:
        """Return the topics that lead the stiffness and the force of the arm."""
        return {
            "target_stiffness": (WrenchStamped, self._stiffen),
            "target_wrench": (WrenchStamped, self._pressing.take),
        }

    def _activated(self) -> None:
        self._stiffness, self._declared = {}, (self._params.K_p, self._params.K_o)
        self._pressing.forget()
        super()._activated()

    def _stiffen(self, controller: Controller, msg: WrenchStamped) -> None:
        p, robot = self._params, controller.scheme.robot
        in_base = p.translational_frame == "base"
        stiffness = _stiffness_from_ros(msg, robot.base_frame if in_base else robot.tip_frame)
        self._leaders.refuse_overtaken("target_stiffness", msg)
        assert isinstance(controller.scheme, ImpedanceControl)
        try:
            controller.scheme.change_impedance(replace(p, **stiffness).compliance_law())
        except ConfigurationError as error:
            raise InvalidMessageError(str(error)) from error
        self._stiffness = stiffness

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the robot from its description; forget tare and sensor."""
        result = super().on_configure(state)
        self._placements.clear()
        self._sensor.forget()
        if self._robot is not None:
            self._contact = RestingContact(self._robot, self._params)
            if advice := self._params.advice():
                self._health.complain(advice, about="impedance")
        return result

    def _forget_robot(self) -> None:
        super()._forget_robot()
        self._contact = None

    # --- the wrench --------------------------------------------------------------------

    def _on_wrench(self, data: bytes) -> None:
        if self._robot is None:
            return
        try:
            msg = deserialized(data, WrenchStamped)
        except InvalidMessageError as error:
            self._health.reject("wrench", error)
            return
        try:
            refuse_two_publishers(self, self._wrench)
            placement = self._placement(msg.header.frame_id)
            self._sensor.take(msg, placement)
        except InvalidMessageError as error:
            self._sensor.refuse(msg)
            self._health.reject("wrench", error)
        self._answer()

    def _placement(self, frame_id: str) -> Placement:
        """Return where the sensor is, seen from the tip; raises InvalidMessageError."""
        p, robot = self._params, self._robot
        assert robot is not None
        if p.wrench_axes:
            return self._placement_of_axes(robot, p.wrench_axes)
        frame = p.wrench_frame or frame_id
        if frame not in self._placements:
            try:
                self._placements[frame] = robot.placement(frame)
            except RobotError as error:
                raise InvalidMessageError(f"{error}; {self._remedy(robot, frame)}") from error
            said, why = frame or robot.tip_frame, ""
            if not frame:
                why = ", assumed: the frame_id of the wrench is empty; set wrench_frame if not"
                self._health.complain(f"the wrench is taken to be in {said}{why}", about="frame")
            self._health.values[WRENCH_FRAME] = f"{said}{why}"
        return self._placements[frame]

    def _placement_of_axes(self, robot: Robot, link: str) -> Placement:
        """Return how a sensor is turned that measures about the tip in the axes of a link."""
        if self._input.measured is None:
            raise InvalidMessageError("no valid joint_states yet, which turn the wrench")
        q = self._input.measured[1]
        try:
            axes = robot.link_at(link, q).R
        except RobotError as error:
            raise InvalidMessageError(f"wrench_axes: {error}") from error
        self._health.values[WRENCH_FRAME] = f"about {robot.tip_frame}, axes of {link}"
        return Placement(robot.link_at(robot.tip_frame, q).R.T @ axes, np.zeros(3))

    def _remedy(self, robot: Robot, frame: str) -> str:
        """Return what to do about a wrench in a frame that is not fixed to the tip."""
        try:
            robot.link_at(frame, np.zeros(robot.n))
        except RobotError:
            return "set wrench_frame if the driver names another frame than the URDF"
        return (
            f"let the driver publish it in a link that is; if its moment is about "
            f"{robot.tip_frame} and only its axes are those of {frame} set wrench_axes to {frame}; "
            "wrench_frame would turn its forces wrongly"
        )

    def is_complete(self, t: int) -> bool:
        """Whether the wrench of the state stamped t [ns] is there, or is not to be expected."""
        return super().is_complete(t) and self._sensor.is_complete(t)

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Take the wrench for the state, and remember it for a tare."""
        robot, controller, contact = self._robot, self._controller, self._contact
        if robot is None or contact is None:
            return
        if controller is not None and controller.admission.set_backs > self._set_backs:
            self._sensor.set_back()
        self._set_backs = controller.admission.set_backs if controller is not None else 0
        is_new, sensed = self._sensor.choose(t, q, robot.limits), self._sensor.fresh
        if controller is not None:
            assert isinstance(controller.scheme, ImpedanceControl)
            controller.scheme.sense(sensed)
            self._pressing.exert(controller, t, self._params.target_timeout)
        if sensed is None:
            contact.wrenches.clear()
        elif is_new:
            contact.wrenches.append((sensed, q, dq))

    def review(self, controller: Controller, stamp: Any) -> None:
        """Publish the impedance; say what is wrong with the wrench, or with the contact."""
        trouble, scheme = self._sensor.trouble, controller.scheme
        assert isinstance(scheme, ImpedanceControl)
        if stamp is not None:
            self._impedance.show(stamp, scheme.compliant.law_now)
        if trouble.note:
            why = trouble._replace(note=f"{trouble.note}: the compliant frame is frozen")
        elif scheme.damping > 1.0:
            why = calmed(scheme.damping)
        elif scheme.compliant.waits:
            why = STIFFNESS_WAITS
        else:
            why = AT_ITS_END if scheme.is_at_its_end else Why()
        if why != self._note_on_wrench:
            self._note_on_wrench = why
            self._health.note = why

    def doubt(self) -> Why:
        """Return why it is not known whose messages come; Why() if it is, or will be soon."""
        why, trouble = super().doubt(), self._sensor.trouble
        if not why.fault and trouble.note:
            why = unheard(self, self._wrench)
        if not why.fault and trouble.cause is Cause.WRENCH_RATE_TOO_LOW:
            why = trouble._replace(fault=f"{trouble.note} (topic {self._wrench.topic_name})")
        return why

    def refusal(self) -> str:
        """Return why the arm must not be controlled yet; "" if it may."""
        if reason := super().refusal():
            return reason
        topic = self._wrench.topic_name
        if self._sensor.trouble.note or self._contact is None:
            return f"{self._sensor.trouble.note} (topic {topic})"
        waits = self._input.repeats and self._sensor.repeats  # a simulator, for its answer
        return self._contact.refusal(topic, waits=waits)

    def _on_tare(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take the mean of the last samples for no contact."""
        contact, wanted = self._contact, self._params.tare_samples
        count = len(contact.wrenches) if contact is not None else 0
        try:
            if contact is None or count < wanted:
                raise ConfigurationError(
                    f"{wanted - count} more valid wrenches are needed, {wanted} in all "
                    "(tare_samples)"
                )
            felt, spread = contact.tare(self._scheme)
        except ConfigurationError as error:
            response.message = f"not tared: {error}"
            return response
        self._health.values["tare [N, Nm]"] = f"{_text(felt[:3])} {_text(felt[3:])}"
        response.success = True
        response.message = (
            f"tared: force {_text(felt[:3])} N, moment {_text(felt[3:])} Nm about the tip in its "
            f"axes, standard deviations {_text(spread[:3])} N, {_text(spread[3:])} Nm"
        )
        self.get_logger().info(response.message)
        return response

    @property
    def _scheme(self) -> ImpedanceControl | None:
        """The active scheme."""
        scheme = self._controller.scheme if self._controller else None
        return scheme if isinstance(scheme, ImpedanceControl) else None

    def values_now(self) -> dict[str, str | int | float]:
        """Return the contact that is felt while the arm is held, or not yet controlled."""
        is_moved = self._controller is not None and not self._controller.fault
        return {} if is_moved or self._contact is None else self._contact.values()

    def stiffness_of(self, tick: Tick) -> Stiffness | None:
        """Return K_p at the centre of compliance; None while there is no compliant frame."""
        scheme, frame = self._scheme, tick.command.frame
        if frame is None or scheme is None:
            return None
        K_p = scheme.compliant.law_now.stiffness(tick.desired.R_d)
        return K_p, frame.carrying(scheme.centre).p_d

    def values_of(self, tick: Tick) -> dict[str, str | int | float]:
        """Return what /diagnostics shows of a tick."""
        scheme, frame, desired = self._scheme, tick.command.frame, tick.desired
        if frame is None or scheme is None:
            return {}
        force, moment = norms(tick.wrench) if tick.wrench is not None else ("unknown",) * 2
        at_centre = [each.carrying(scheme.centre).R_d for each in (desired, frame)]
        return {
            "contact force [N]": force,
            "contact moment [Nm]": moment,
            "energy given to the contact [J]": scheme.contact.energy,
            "energy left for stiffness [J]": scheme.compliant.energy_left,
            "change of the impedance": scheme.compliant.changed,
            "force exerted [N]": _text(scheme.force.wanted) if scheme.force.is_on else "none asked",
            "stiffness of the contact [N/m]": _text(scheme.force.stiffness),
            "displacement [m]": float(np.linalg.norm(frame.p_d - desired.p_d)),
            "displacement [rad]": angle_between(desired.R_d, frame.R_d),
            "distance to singularity of the impedance [rad]": (
                self._params.representation().singularity_distance(*at_centre)
            ),
        }


def _stiffness_from_ros(msg: WrenchStamped, frame_id: str) -> Diagonals:
    """Return the diagonals of K_p [N/m] and K_o [Nm/rad] that a message asks for.

    Args:
        msg: the message.
        frame_id: of the axes of K_p.

    Raises:
        InvalidMessageError: if the frame is another, or a number is negative or not finite.
    """
    if msg.header.frame_id not in ("", frame_id):
        raise InvalidMessageError(
            f"its frame_id is {shown(msg.header.frame_id)}; expected {frame_id}, whose axes "
            "K_p has (translational_frame), or none"
        )
    K_p, K_o = ((part.x, part.y, part.z) for part in (msg.wrench.force, msg.wrench.torque))
    if not all(0.0 <= value < math.inf for value in (*K_p, *K_o)):
        raise InvalidMessageError(
            f"K_p is {[*K_p]} N/m, K_o {[*K_o]} Nm/rad; expected finite numbers of 0 or more"
        )
    return {"K_p": K_p, "K_o": K_o}


def _text(values: Array) -> str:
    return "[" + ", ".join(f"{value:.3g}" for value in values) + "]"


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ImpedanceControlNode, args)
