"""The control node: what the nodes of all schemes share.

It is wiring: messages are converted, given to the :class:`Controller`, and its answer is
published under the stamp of the joint_states that it answers.
"""

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory
from visualization_msgs.msg import InteractiveMarkerFeedback

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import Mode, Why
from eulerparams_control.errors import InvalidMessageError, UnknownNameError, defect
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.from_ros import motion_from_ros, ns_from_ros, shown
from eulerparams_control.messages.markers import Stiffness
from eulerparams_control.messages.to_ros import stamp_to_ros
from eulerparams_control.parameters.common import LATEST
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros import interactive_target
from eulerparams_control.ros.control_report import ControlReport
from eulerparams_control.ros.interactive_target import InteractiveTarget
from eulerparams_control.ros.managed_node import ManagedNode
from eulerparams_control.ros.publishers import publishers_of, refuse_two_publishers
from eulerparams_control.ros.qos import QOS, QOS_LATCHED
from eulerparams_control.ros.targets import Targets
from eulerparams_control.ros.views import HAS_TF, PERIOD, Views

# The ages are looked at again after this time [s] at the earliest.
_LEAST_WATCH = 0.02

Lead = Callable[[Controller, Robot, Any], None]
"""What takes a message that leads the arm."""

# Number of other robots' joints that are named.
_SHOWN = 5

_NOT_ACTIVE = "not active: nothing is commanded"


class ControlNode(ManagedNode):
    """A lifecycle node that runs one scheme on one arm."""

    def __init__(self) -> None:
        super().__init__()
        self._report = ControlReport(self, self._health, self._input)
        self._leading: dict[str, Subscription] = {}  # what leads the arm, by topic
        self._targets = Targets()
        self._led: dict[str, int] = {}  # the stamp [ns] of the last message, by topic
        self._is_heard = False
        rate = self._params.state_rate
        self._period = int(1e9 / rate) if rate > 0 else 0  # of ~/pose and the like [ns]
        self._health.check, self._health.gather = self._once_a_second, self._gather
        self._shown: Tick | None = None
        on_tf = self._params.publish_tf
        self._views = Views(self, on_tf)
        self._drawn: tuple[int, Tick | None] = -1, None  # stamp [ns], tick
        if on_tf and not HAS_TF:
            self._health.complain("publish_tf: tf2_msgs is not installed; no frames on /tf")
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        draw = partial(self._show, "~/markers", self._draw)
        self.create_timer(PERIOD, draw, clock=clock)
        self._marker = InteractiveTarget(self)
        place = partial(self._show, "~/target", self._place_marker)
        self.create_timer(interactive_target.PERIOD, place, clock=clock)
        period = max(self._params.state_timeout / 2, _LEAST_WATCH)
        self.create_timer(period, self.watch, clock=clock)
        for topic in self._params.paired_targets:
            if topic not in self.leaders():
                raise UnknownNameError("topic in paired_targets", topic, self.leaders())
        self._subscribe()
        self.create_service(Trigger, "~/halt", self._on_halt)
        self.create_service(Trigger, "~/resume", self._on_resume)
        self._try_start()

    def is_complete(self, t: int) -> bool:
        """Whether all that belongs to the state stamped t [ns] has come."""
        p, paired = self._params, self._params.paired_targets
        if p.reference_pairing != LATEST:
            paired = *paired, "reference"
        return not (paired and self._leading) or all(self._led.get(one) == t for one in paired)

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Take what else was measured for the state q, dq (n,), before it is answered."""

    def review(self, controller: Controller, stamp: Any) -> None:
        """Look at what an answer has led to, before its report.

        Args:
            controller: that answered.
            stamp: of its command; None where it commanded nothing.
        """

    def values_of(self, tick: Tick) -> dict[str, str | int | float]:
        """Return what /diagnostics shows of a tick, besides what it shows of all."""
        return {}

    def stiffness_of(self, tick: Tick) -> Stiffness | None:
        """Return the translational stiffness of a tick; None if the scheme has none."""
        return None

    def leaders(self) -> dict[str, tuple[type[Any], Lead]]:
        """Return the topics that lead the arm, their type, and what takes a message."""
        return {
            "reference": (MultiDOFJointTrajectory, self._follow),
            "target_pose": (PoseStamped, self._aim),
            "target_twist": (TwistStamped, self._jog),
            interactive_target.FEEDBACK: (InteractiveMarkerFeedback, self._drag),
        }

    def note(self, why: Why) -> None:
        """Show a warning with the state from now on; Why() takes it back."""
        self._report.note(why)

    def _activated(self) -> None:
        # only now: who publishes a reference can see by it that somebody follows
        for topic, (kind, lead) in self.leaders().items():
            self._leading[topic] = self._listen(kind, topic, partial(self._lead, topic, lead), QOS)
        self._is_heard = False
        self._report.activated()
        self._say()

    def _changed(self) -> None:
        self._report.forget()  # the state names the orientation

    def _deactivated(self) -> None:
        while self._leading:
            self.destroy_subscription(self._leading.popitem()[1])

    # --- messages ----------------------------------------------------------------------

    def _subscribe(self) -> None:
        self._read_state = self._health.reader(JointState, self._input.concerns)
        take = self._on_joint_states
        self._states = self._listen(JointState, "joint_states", take, QOS, raw=True)
        if not self._description:
            self._listen(String, "robot_description", self._on_robot_description, QOS_LATCHED)

    def _on_robot_description(self, msg: String) -> None:
        if self._robot is not None and msg.data != self._description:
            self._health.complain(
                "robot_description has changed: the new one counts after cleanup and configure"
            )
        self._description = msg.data
        self._try_start()

    def _on_joint_states(self, data: bytes) -> None:
        if self._robot is None:
            return
        was_answered = self._input.unanswered is None
        try:
            msg = self._read_state(data)
            if not self._input.take(msg):
                self._say_strange(msg)
                return
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            return
        if not was_answered and self._controller is not None:
            self._health.count("states dropped, waiting for what belongs to them")
        self._answer()

    def _say_strange(self, msg: Any) -> None:
        """Say whose joint_states come, as long as none of the arm do."""
        if self._robot is not None and self._input.measured is None:
            self._health.complain(
                f"joint_states of {', '.join(map(shown, msg.name[:_SHOWN]))} came, but none yet of "
                f"{', '.join(self._robot.joints)}",
                about="strange joint_states",
            )

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
            command = controller.step(t, q, dq, states.receipt)
        except InvalidMessageError as error:
            states.refused()
            self._health.reject("joint_states", error)
            self._see_rivals(controller)
            return
        if command is not None:
            self._stamp = stamp
            self._commands.publish(stamp, command)
        states.answered(is_commanded=command is not None)
        self._see_rivals(controller)
        self.review(controller, None if command is None else stamp)
        period = self._period if command is not None else 0
        if self._report.answered(controller, t, period, self._params.orientation):
            guidance = controller.guidance
            is_asked = guidance.ticked == t and not controller.fault
            tick = guidance.of_law if is_asked else None
            self._report.arm(controller, tick, q, dq, self._stamp)
        self._ending.review()

    def _see_rivals(self, controller: Controller) -> None:
        """Stop the arm if states contradict each other, and two nodes publish them."""
        if controller.admission.is_contested:
            names = publishers_of(self, self._states.topic_name)
            if len(names) > 1:
                controller.supervisor.contest(sorted(names))

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

    def _lead(self, topic: str, lead: Lead, msg: Any) -> None:
        """Let a message lead the arm, or say why it must not."""
        if self._controller is None or self._robot is None:
            return
        try:
            refuse_two_publishers(self, self._leading.get(topic))
            lead(self._controller, self._robot, msg)
        except InvalidMessageError as error:
            self._health.reject(topic, error)
            if topic in self._params.paired_targets and self._controller.mode != Mode.WAITING:
                self._led[topic] = ns_from_ros(msg.header.stamp)  # no other comes
                self._answer()
            return
        self._led[topic] = ns_from_ros(msg.header.stamp)
        if not self._is_silent:  # then that is what has to be said
            self._say()
        self._answer()

    def _follow(self, controller: Controller, robot: Robot, msg: MultiDOFJointTrajectory) -> None:
        frames = robot.base_frame, robot.tip_frame
        motion, start = motion_from_ros(msg, *frames, self._params.reference_timeout)
        controller.orders.follow(motion, start, self._now)

    def _aim(self, controller: Controller, robot: Robot, msg: PoseStamped) -> None:
        controller.orders.aim(self._targets.pose(msg, robot, self._input.measured), self._now)

    def _jog(self, controller: Controller, robot: Robot, msg: TwistStamped) -> None:
        controller.orders.jog(self._targets.twist(msg, robot, self._input.measured), self._now)

    def _drag(self, controller: Controller, robot: Robot, msg: InteractiveMarkerFeedback) -> None:
        goal = self._marker.released(msg, (controller, controller.supervisor.stops))
        if goal is not None:
            self._aim(controller, robot, goal)

    @property
    def _now(self) -> float | None:
        """When a message came [s], steady clock; None where the stamps count."""
        return None if self._is_simulated else steady.now()

    def _on_halt(self, _request: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        """Bring the arm to rest; only ``~/resume`` leads on."""
        if self._controller is None:
            return _answered(answer, _NOT_ACTIVE)
        self._controller.orders.halt()
        return self._ordered(answer)

    def _on_resume(self, _request: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        """Go on from a stop, holding the measured pose."""
        if self._controller is None:
            return _answered(answer, _NOT_ACTIVE)
        try:
            self._controller.orders.resume()
        except InvalidMessageError as error:
            self._health.complain(str(error))
            return _answered(answer, str(error))
        return self._ordered(answer)

    def _ordered(self, answer: Trigger.Response) -> Trigger.Response:
        """Report what an order has changed, and answer it."""
        if not self._is_silent:  # then that is what has to be said
            self._say()
        answer.success, answer.message = True, self._health.message
        return answer

    def _gather(self) -> None:
        """Gather what /diagnostics shows of the controller, and of a tick that it did not show."""
        controller, values = self._controller, self._health.values
        if controller is None:
            return
        values.update(self._report.counts(controller))
        tick = controller.guidance.of_law
        if tick is not None and tick is not self._shown:
            self._shown = tick
            self._report.show(controller, tick, self._params)
            values.update(self.values_of(tick))

    def _show(self, what: str, show: Callable[[], None]) -> None:
        """Show something: a failure must not end the node that controls the arm."""
        try:
            show()
        except Exception as error:
            self._health.complain(f"{defect(error)}, of {what}", error=True, about=what)

    def _draw(self) -> None:
        """Show the last tick to who watches; where the law makes none, where the arm is."""
        controller, robot, measured = self._controller, self._robot, self._input.measured
        if controller is None or robot is None or measured is None or self._is_silent:
            return
        (t, q, dq), tick = measured, controller.guidance.of_law
        last_t, last_tick = self._drawn
        if tick is None or t == last_t or not self._views.is_watched:
            return
        is_stopped, self._drawn = bool(controller.fault) or tick is last_tick, (t, tick)
        stamp = Time(sec=self._stamp.sec, nanosec=self._stamp.nanosec)
        stiffness = self.stiffness_of(tick)
        if is_stopped:
            tick, stamp = tick._replace(arm=robot.arm(q, dq)), stamp_to_ros(t)
        poles = self._params.poles
        self._views.show(tick, robot, stamp, stiffness, poles, is_stopped=is_stopped)

    def _place_marker(self) -> None:
        """Show the target where the arm is led to, or is held."""
        controller, robot, measured = self._controller, self._robot, self._input.measured
        if controller is None or robot is None or measured is None or not self._marker.is_watched:
            return
        frame = controller.guidance.motion.last
        if controller.fault:
            frame = controller.scheme.frame_at(measured[1])
        self._marker.place(frame, robot.base_frame)

    def _say(self) -> None:
        """Report what the controller does, or why it holds still, if that has changed."""
        if self._controller is not None:
            self._report.state(self._controller, self._params.orientation)

    # --- supervision -------------------------------------------------------------------

    @property
    def _is_silent(self) -> bool:
        """Whether valid joint_states came once, and have stopped."""
        return self._input.silence() > self._timeout

    @property
    def _timeout(self) -> float:
        """After which silence [s] joint_states have stopped; not before the next one is due."""
        due = 2 * self._controller.admission.period.seconds if self._controller is not None else 0.0
        return self._input.timeout(max(self._params.state_timeout, due), self._is_simulated)

    def watch(self) -> None:
        """Say that joint_states has stopped, as soon as it has; nothing is commanded then."""
        if self._controller is not None and self._is_silent:
            self._report.silent(self._controller.mode, self._timeout)
        self._ending.review()

    def _once_a_second(self) -> None:
        """Gather what /diagnostics shows once a second."""
        self._health.values.update(self._input.read() | self.values_now())
        if self._controller is None:
            return
        self._health.values["joint_states missed"] = self._controller.admission.period.missed
        self._report.once_a_second(self._controller, self._states.topic_name)
        if self._commands.count_subscribers() == 0 and self.commands_joints:
            self._health.complain(
                f"nobody listens to {self._commands.topic}: does the robot take another command?"
            )


def _answered(answer: Trigger.Response, refusal: str) -> Trigger.Response:
    answer.success, answer.message = False, refusal
    return answer


def node_class(scheme: SchemeInfo) -> type[ControlNode]:
    """Return the class of the node of a scheme."""
    found = vars(importlib.import_module(scheme.node)).values()
    nodes = (item for item in found if isinstance(item, type) and issubclass(item, ControlNode))
    return next(node for node in nodes if node.parameters_type is scheme.parameters)
