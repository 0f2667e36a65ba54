"""The node ``impedance_control``: section V; publishes ``joint_effort`` and ``compliant_frame``."""

from dataclasses import replace
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import STIFFNESS_WAITS, Cause, Why, calmed
from eulerparams_control.errors import (
    ConfigurationError,
    EulerParamsError,
    InvalidMessageError,
    RobotError,
)
from eulerparams_control.laws.compliant_frame import ComplianceLaw
from eulerparams_control.laws.impedance_control import ImpedanceControl
from eulerparams_control.laws.rotations import Array, angle_between
from eulerparams_control.laws.scheme import Scheme, Tick
from eulerparams_control.messages.from_ros import wrench_from_ros
from eulerparams_control.messages.keys import WRENCH_FRAME
from eulerparams_control.messages.to_ros import impedance_to_ros
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.commands import ImpedancePublisher
from eulerparams_control.ros.control_node import ControlNode
from eulerparams_control.ros.diagnostics import Values
from eulerparams_control.ros.message_info import deserialized
from eulerparams_control.ros.publishers import refuse_two_publishers, unheard
from eulerparams_control.ros.qos import QOS
from eulerparams_control.ros.resting_contact import RestingContact, norms
from eulerparams_control.ros.runtime import run
from eulerparams_control.ros.target_wrench import AT_ITS_END, TargetWrench
from eulerparams_control.ros.targets import Topics
from eulerparams_control.ros.wrench_input import WrenchInput


class ImpedanceControlNode(ControlNode):
    """Impedance control of one arm."""

    parameters_type = ImpedanceParameters

    def _subscribe(self) -> None:
        # K_p, K_o that target_stiffness asked for, by those of the parameters, until these change
        self._asked: dict[Any, dict[str, tuple[float, ...]]] = {}
        self._contact: RestingContact | None = None  # until the robot is known
        self._sensor, self._set_backs = WrenchInput(self._input, self._params), 0
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
        """Return impedance control for a robot, with the stiffness of the parameters."""
        self._asked.clear()
        p: ImpedanceParameters = self._params
        scheme = p.make_scheme(robot, self._contact.chain if self._contact else None)
        scheme.sense(self._sensor.fresh)
        return scheme

    def change_scheme(self, scheme: Scheme, parameters: Any) -> None:
        """Go over to new parameters; raises ConfigurationError."""
        assert isinstance(scheme, ImpedanceControl)
        declared = parameters.K_p, parameters.K_o
        asked = self._asked.get(declared, {})
        scheme.change(replace(parameters, **asked))
        self._asked = {declared: asked}
        if self._contact is not None:
            self._contact.wrenches.clear()  # they are of another tool or bias

    def leaders(self) -> Topics:
        """Return the topics that lead the stiffness and the force of the arm."""
        return {
            "target_stiffness": (WrenchStamped, self._stiffen),
            "target_wrench": (WrenchStamped, self._pressing.take),
        }

    def _stiffen(self, controller: Controller, msg: WrenchStamped) -> None:
        """Take the diagonals of K_p, K_o, in the axes that K_p has; its frame may be empty."""
        p, robot = self._params, controller.scheme.robot
        frame = robot.base_frame if p.translational_frame == "base" else robot.tip_frame
        diagonals = wrench_from_ros(msg, msg.header.frame_id and frame).tolist()
        asked = {"K_p": tuple(diagonals[:3]), "K_o": tuple(diagonals[3:])}
        assert isinstance(controller.scheme, ImpedanceControl)
        controller.scheme.change_impedance(replace(p, **asked).compliance_law())
        self._asked = {(p.K_p, p.K_o): asked}

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
        msg = None
        try:
            msg = deserialized(data, WrenchStamped)
            refuse_two_publishers(self, self._wrench)
            placement = self._placement(msg.header.frame_id)
            self._sensor.take(msg, placement)
        except EulerParamsError as error:
            if msg is not None:
                self._sensor.refuse(msg)
            self._health.reject("wrench", error)
        self._answer()

    def _placement(self, frame_id: str) -> Placement:
        """Return where the sensor is, seen from the tip.

        Raises InvalidMessageError if it is not fixed there, or where its axes are is not known.
        """
        p, robot, state = self._params, self._robot, self._input.measured
        assert robot is not None
        if p.wrench_axes:  # about the tip
            if state is None:
                raise InvalidMessageError("no valid joint_states yet, which turn the wrench")
            axes = robot.link_at(p.wrench_axes, state[1]).R
            self._health.values[WRENCH_FRAME] = f"about {robot.tip_frame}, axes of {p.wrench_axes}"
            return Placement(robot.link_at(robot.tip_frame, state[1]).R.T @ axes, np.zeros(3))
        frame = p.wrench_frame or frame_id
        if frame not in self._placements:
            try:
                self._placements[frame] = robot.placement(frame)
            except RobotError as error:
                raise InvalidMessageError(f"{error}; {_remedy(robot, frame)}") from error
            said = frame
            if not frame:
                said = (
                    f"{robot.tip_frame}, assumed: the frame_id of the wrench is empty; set "
                    "wrench_frame if not"
                )
                self._health.complain(f"the wrench is taken to be in {said}", about="frame")
            self._health.values[WRENCH_FRAME] = said
        return self._placements[frame]

    def is_complete(self, t: int) -> bool:
        """Whether the wrench of the state stamped t [ns] is there, or is not to be expected."""
        return super().is_complete(t) and self._sensor.is_complete(t)

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Take the wrench for the state, and remember it for a tare."""
        controller, contact = self._controller, self._contact
        if contact is None:
            return
        set_backs = controller.admission.set_backs if controller is not None else 0
        if set_backs > self._set_backs:
            self._sensor.set_back()
        self._set_backs = set_backs
        is_new = self._sensor.choose(t, q, contact.chain.robot.limits)
        sensed = self._sensor.fresh
        if (scheme := self._scheme) is not None:
            scheme.sense(sensed)
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
        why = Why()
        if trouble.note:
            why = trouble._replace(note=f"{trouble.note}: the compliant frame is frozen")
        elif scheme.damping > 1.0:
            why = calmed(scheme.damping)
        elif scheme.compliant.waits:
            why = STIFFNESS_WAITS
        elif scheme.is_at_its_end:
            why = AT_ITS_END
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
        try:
            if self._contact is None:
                raise ConfigurationError("the robot is not known yet: configure first")
            felt, spread = self._contact.tare(self._scheme)
        except ConfigurationError as error:
            response.message = f"not tared: {error}"
            return response
        f, mu, f_spread, mu_spread = map(_text, np.reshape((felt, spread), (4, 3)))
        self._health.values["tare [N, Nm]"] = f"{f} {mu}"
        response.success = True
        response.message = (
            f"tared: force {f} N, moment {mu} Nm about the tip in its axes, standard deviations "
            f"{f_spread} N, {mu_spread} Nm"
        )
        self.get_logger().info(response.message)
        return response

    @property
    def _scheme(self) -> ImpedanceControl | None:
        """The active scheme."""
        scheme = self._controller.scheme if self._controller else None
        return scheme if isinstance(scheme, ImpedanceControl) else None

    def values_now(self) -> Values:
        """Return the contact that is felt while the arm is held, or not yet controlled."""
        is_moved = self._controller is not None and not self._controller.fault
        return {} if is_moved or self._contact is None else self._contact.values()

    def values_of(self, scheme: ImpedanceControl, tick: Tick) -> Values:
        """Return what /diagnostics shows of a tick."""
        frame, desired = tick.command.frame, tick.desired
        if frame is None:
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


def _remedy(robot: Robot, frame: str) -> str:
    """Return what to do about a wrench in a frame that is not fixed to the tip."""
    try:
        robot.link_at(frame, np.zeros(robot.n))
    except RobotError:
        return "set wrench_frame if the driver names another frame than the URDF"
    return (
        f"let the driver publish it in a link that is; if its moment is about {robot.tip_frame} "
        f"and only its axes are those of {frame} set wrench_axes to {frame}; wrench_frame would "
        "turn its forces wrongly"
    )


def _text(values: Array) -> str:
    return "[" + ", ".join(f"{value:.3g}" for value in values) + "]"


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ImpedanceControlNode, args)
