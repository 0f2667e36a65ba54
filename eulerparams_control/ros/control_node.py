"""The control node: what the nodes of all schemes share.

It is wiring: messages are converted, given to the :class:`Controller`, and its answer is
published under the stamp of the joint_states that it answers.
"""

import importlib

from rclpy.clock import Clock, ClockType
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.from_ros import motion_from_ros, ns_from_ros
from eulerparams_control.parameters.common import LATEST
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.ros.control_report import ControlReport
from eulerparams_control.ros.managed_node import ManagedNode
from eulerparams_control.ros.publishers import refuse_two_publishers
from eulerparams_control.ros.qos import QOS, QOS_LATCHED

# The ages are looked at again after this time [s] at the earliest.
_LEAST_WATCH = 0.02


class ControlNode(ManagedNode):
    """A lifecycle node that runs one scheme on one arm."""

    def __init__(self) -> None:
        super().__init__()
        self._report = ControlReport(self, self._health, self._input)
        self._reference: Subscription | None = None
        self._reference_stamp: int | None = None
        self._is_heard = False
        rate = self._params.state_rate
        self._period = int(1e9 / rate) if rate > 0 else 0  # of ~/pose and the like [ns]
        self._health.check = self._once_a_second
        period = max(self._params.state_timeout / 2, _LEAST_WATCH)
        self.create_timer(period, self.watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._subscribe()
        self._try_start()

    def is_complete(self, t: int) -> bool:
        """Whether all that belongs to the state stamped t [ns] has come."""
        return self._params.reference_pairing == LATEST or self._reference_stamp == t

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Take what else was measured for the state q, dq (n,), before it is answered."""

    def values_of(self, tick: Tick) -> dict[str, str | int | float]:
        """Return what /diagnostics shows of a tick, besides what it shows of all."""
        return {}

    def note(self, text: str) -> None:
        """Show a warning with the state from now on; "" takes it back."""
        self._report.note(text)

    def _activated(self) -> None:
        # only now: who publishes a reference can see by it that somebody follows
        self._reference = self._listen(
            MultiDOFJointTrajectory, "reference", self._on_reference, QOS
        )
        self._is_heard = False
        self._report.activated()
        self._say()

    def _changed(self) -> None:
        self._report.forget()  # the state names the orientation

    def _deactivated(self) -> None:
        if self._reference is not None:
            self.destroy_subscription(self._reference)
            self._reference = None

    # --- messages ----------------------------------------------------------------------

    def _subscribe(self) -> None:
        self._states = self._listen(JointState, "joint_states", self._on_joint_states, QOS)
        if not self._description:
            self._listen(String, "robot_description", self._on_robot_description, QOS_LATCHED)

    def _on_robot_description(self, msg: String) -> None:
        if self._robot is not None and msg.data != self._description:
            self._health.complain(
                "robot_description has changed: the new one counts after cleanup and configure"
            )
        self._description = msg.data
        self._try_start()

    def _on_joint_states(self, msg: JointState) -> None:
        if self._robot is None:
            return
        was_answered = self._input.unanswered is None
        try:
            self._input.take(msg)
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            return
        if not was_answered and self._controller is not None:
            self._health.count("states dropped, waiting for what belongs to them")
        self._answer()

    def _answer(self) -> None:
        """Answer the last state, once all that belongs to it is there."""
        states, controller = self._input, self._controller
        if states.unanswered is None or states.measured is None:
            return
        t, q, dq = states.measured
        if controller is None:  # nothing listens yet to what belongs to the state
            self.observe(t, q, dq)
            self._try_start()
            controller = self._controller
        if controller is None or not (self._is_heard or self._hears()) or not self.is_complete(t):
            return
        stamp, states.unanswered = states.unanswered, None
        self.observe(t, q, dq)
        try:
            command = controller.step(t, q, dq, None if self._is_simulated else states.came)
        except InvalidMessageError as error:
            states.refused()
            self._health.reject("joint_states", error)
            return
        if command is not None:
            self._stamp = stamp
            self._commands.publish(stamp, command)
        states.answered(is_commanded=command is not None)
        period = self._period if command is not None else 0
        if self._report.answered(controller, t, period, self._params.orientation):
            self._report_tick(controller)

    def _hears(self) -> bool:
        """Return whether as many listen to the commands as have to."""
        wanted, there = self._params.wait_for_subscribers, self._commands.count_subscribers()
        self._is_heard = there >= wanted
        if not self._is_heard:
            self._health.complain(
                f"waiting for {wanted} subscribers of {self._commands.topic}, {there} are there",
                about="subscribers",
            )
        return self._is_heard

    def _on_reference(self, msg: MultiDOFJointTrajectory) -> None:
        if self._controller is None or self._robot is None:
            return
        try:
            refuse_two_publishers(self, self._reference)
            frames = self._robot.base_frame, self._robot.tip_frame
            motion, start = motion_from_ros(msg, *frames, self._params.reference_timeout)
            now = None if self._is_simulated else steady()
            self._controller.follow(motion, start, now)
            if not self._is_silent:  # then that is what has to be said
                self._say()
        except InvalidMessageError as error:
            self._health.reject("reference", error)
            return
        self._reference_stamp = ns_from_ros(msg.header.stamp)
        self._answer()

    def _report_tick(self, controller: Controller) -> None:
        """Report the last tick, unless the arm is held."""
        tick = controller.guidance.tick_now
        if tick is None or controller.fault or self._robot is None:
            return
        self._report.tick(controller, self._params, self._stamp, self._robot.base_frame)
        self._health.values.update(self.values_of(tick))

    def _say(self) -> None:
        """Report what the controller does, or why it holds still, if that has changed."""
        if self._controller is not None:
            self._report.state(self._controller, self._params.orientation)

    # --- supervision -------------------------------------------------------------------

    @property
    def _is_silent(self) -> bool:
        """Whether valid joint_states came once, and have stopped."""
        return self._input.is_silent(self._params.state_timeout, self._is_simulated)

    def watch(self) -> None:
        """Say that joint_states has stopped, as soon as it has; nothing is commanded then."""
        if self._controller is not None and self._is_silent:
            timeout = self._input.timeout(self._params.state_timeout, self._is_simulated)
            self._report.silent(self._controller.mode, timeout)

    def _once_a_second(self) -> None:
        """Gather what /diagnostics shows once a second."""
        self._health.values.update(self._input.read() | self.values_now())
        if self._controller is None:
            return
        self._report.once_a_second(self._controller, self._states.topic_name)
        if self._commands.count_subscribers() == 0 and self.commands_joints:
            self._health.complain(
                f"nobody listens to {self._commands.topic}: does the robot take another command?"
            )


def node_class(scheme: SchemeInfo) -> type[ControlNode]:
    """Return the class of the node of a scheme."""
    found = vars(importlib.import_module(scheme.node)).values()
    nodes = (item for item in found if isinstance(item, type) and issubclass(item, ControlNode))
    return next(node for node in nodes if node.parameters_type is scheme.parameters)
