"""The control node: what the nodes of all schemes share.

It is wiring: messages are converted, given to the :class:`Controller`, and its answer is
published under the stamp of the joint_states that it answers.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.from_ros import shown
from eulerparams_control.messages.keys import Lifecycle
from eulerparams_control.ros.diagnostics import Values
from eulerparams_control.ros.managed_node import ManagedNode
from eulerparams_control.ros.message_info import NUMBER, with_info
from eulerparams_control.ros.publishers import unheard
from eulerparams_control.ros.qos import QOS, QOS_LATCHED
from eulerparams_control.ros.rviz import RViz
from eulerparams_control.ros.targets import Leaders, Topics

# The ages are looked at again after this time [s] at the earliest.
_LEAST_WATCH = 0.02

# Time [s] between two views in RViz.
_VIEW_PERIOD = 0.1

# Time [s] after which publishers that are there are known.
_DISCOVERY = 5.0

# Number of other robots' joints that are named.
_SHOWN = 5


class ControlNode(ManagedNode):
    """A lifecycle node that runs one scheme on one arm."""

    def __init__(self) -> None:
        super().__init__()
        self._is_heard, self._began = False, steady.now()
        self._health.check, self._health.gather = self._once_a_second, self._gather
        self._rviz = RViz(self)
        period = max(self._params.state_timeout / 2, _LEAST_WATCH)
        for seconds, callback in ((period, self.watch), (_VIEW_PERIOD, self._show_in_rviz)):
            self.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._subscribe()
        self._leaders = Leaders(self, self._params, self._input, self._rviz, self.leaders())
        self.create_service(Trigger, "~/halt", partial(self._on_order, Controller.halt))
        self.create_service(Trigger, "~/resume", partial(self._on_order, Controller.resume))
        self._try_start()

    def is_complete(self, t: int) -> bool:
        """Whether all that belongs to the state stamped t [ns] has come."""
        return self._leaders.are_here(t)

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Take what else was measured for the state q, dq (n,), before it is answered."""

    def review(self, controller: Controller, stamp: Any) -> None:
        """Look at what an answer led to; ``stamp`` is that of its command, None without one."""

    def values_of(self, scheme: Any, tick: Tick) -> Values:
        """Return what /diagnostics shows of a tick, besides what it shows of all."""
        return {}

    def leaders(self) -> Topics:
        """Return the topics of the scheme that lead the arm, besides those of all."""
        return {}

    def _activated(self) -> None:
        assert self._controller is not None
        # only now: who publishes a reference can see by it that somebody follows
        self._leaders.begin(self._controller, self._lead)
        self._is_heard = False
        self._say()

    def _deactivated(self) -> None:
        self._leaders.end()

    # --- messages ----------------------------------------------------------------------

    def _subscribe(self) -> None:
        take, take_urdf = with_info(self._on_joint_states), self._on_robot_description
        self._input.subscription = self.listen(JointState, "joint_states", take, QOS, raw=True)
        self._urdfs: Subscription | None = None
        if not self._description:
            self._urdfs = self.listen(String, "robot_description", take_urdf, QOS_LATCHED)

    def _on_robot_description(self, msg: String) -> None:
        if self._robot is not None and msg.data != self._description:
            self._health.complain(
                "robot_description has changed: the new one counts after cleanup and configure"
            )
        self._description = msg.data
        self._try_start()

    def _on_joint_states(self, data: bytes, info: Mapping[str, Any]) -> None:
        if self._robot is None:
            return
        was_answered = self._input.unanswered is None
        try:
            strangers = self._input.take(data, info[NUMBER])
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            return
        if not strangers:
            if not was_answered and self._controller is not None:
                self._health.count("states dropped, waiting for what belongs to them")
            self._answer()
        elif self._input.measured is None:
            self._health.complain(
                f"joint_states of {', '.join(map(shown, strangers[:_SHOWN]))} came, but none yet "
                f"of {', '.join(self._robot.joints)}",
                about="strange joint_states",
            )

    def _answer(self) -> None:
        """Answer the last state, once all that belongs to it is there."""
        states = self._input
        if states.unanswered is None or states.measured is None:
            return
        (t, q, dq), are_believed = states.measured, states.source.look(steady.now())
        if self._controller is None:  # nothing listens yet to what belongs to the state
            self.observe(t, q, dq)
            self._try_start()
        controller = self._controller
        if controller is None or not are_believed:
            return
        if not (self._is_heard or self._hears()) or not self.is_complete(t):
            return
        stamp, states.unanswered = states.unanswered, None
        self.observe(t, q, dq)
        try:
            command = controller.step(t, q, dq, states.receipt)
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            states.refused(controller.admission)
            return
        if command is not None:
            self._stamp = stamp
            self._commands.publish(stamp, command)
        states.answered(controller.admission, is_commanded=command is not None)
        self.review(controller, None if command is None else stamp)
        if states.stands and controller.mode is Mode.FOLLOWING and not self._input.is_simulated:
            why = states.standing()  # there is no time to move by
            controller.settle(why._replace(fault="", note=why.fault))
        self._health.answered(controller, is_commanded=command is not None)
        self._review_end()

    # --- what leads the arm ----------------------------------------------------------------

    def _hears(self) -> bool:
        """Look whether as many listen to the commands as have to."""
        commands, wanted = self._commands.publisher, self._params.wait_for_subscribers
        there = commands.get_subscription_count()
        self._is_heard = there >= wanted
        if not self._is_heard:
            text = f"waiting for {wanted} subscribers of {commands.topic_name}, {there} are there"
            self._health.complain(text, about="subscribers")
        return self._is_heard

    def _lead(self, topic: str, msg: Any) -> None:
        """Let a message lead the arm, or say why it must not."""
        states, controller = self._input, self._controller
        try:
            states.source.refuse_in_dispute()
            is_led = controller is not None and controller.state.is_led
            if is_led and states.stands and not states.is_simulated:
                raise InvalidMessageError("the stamp of joint_states stays: there is no time")
            self._leaders.take(topic, msg)
        except InvalidMessageError as error:
            self._health.reject(topic, error)
            if not self._leaders.skip(topic, msg):
                return
        else:
            self._say()
        self._answer()

    def _on_order(self, order: Callable[[Controller], None], _request: Any, answer: Any) -> Any:
        """Obey an order of an operator, or say why not."""
        try:
            if self._controller is None:
                raise InvalidMessageError("not active: nothing is commanded")
            if order is Controller.resume:
                self._input.source.accept(steady.now())
            order(self._controller)
            self._say()
            answer.success, answer.message = True, self._health.message
        except InvalidMessageError as error:
            self._health.complain(str(error))
            answer.message = str(error)
        return answer

    # --- what is said ----------------------------------------------------------------------

    def _say(self) -> None:
        """Say what the controller does, unless no states come: that is said by :meth:`watch`."""
        if self._controller is not None and not self._input.is_silent:
            self._health.say(self._controller)

    def watch(self) -> None:
        """Say that joint_states has stopped, as soon as it has; nothing is commanded then."""
        states = self._input
        if self._controller is not None and states.is_silent and not states.source.dispute.fault:
            self._health.say(self._controller)
        elif self._input.is_simulated and not states.source.is_believed:
            self._answer()  # the state may come but once
        self._review_end()

    def _once_a_second(self) -> None:
        """Gather what /diagnostics shows once a second, and complain of what is missing."""
        states, controller = self._input, self._controller
        topic = states.subscription.topic_name
        self._health.values |= states.read() | self.values_now()
        states.source.review()  # the names are known by now
        is_late = steady.now() - self._began > _DISCOVERY
        if is_late and states.measured is None and not self.count_publishers(topic):
            self._health.complain(f"nobody publishes {topic}: is a robot there?")
        waited_for, mode, has_come = self._urdfs, Lifecycle.UNCONFIGURED, bool(self._description)
        if self._robot is not None:
            waited_for, mode = states.subscription, Lifecycle.INACTIVE
            has_come = states.measured is not None
        if not has_come and waited_for and (why := unheard(self, waited_for)).fault:
            self._fail(why.fault, why.cause, why.remedy, mode)
        if controller is None:
            return
        commands = self._commands.publisher
        self._health.once_a_second(controller, commands.topic_name)
        if self._params.commands_joints and not commands.get_subscription_count():
            self._health.complain(
                f"nobody listens to {commands.topic_name}: does the robot take another command?"
            )

    def _gather(self) -> None:
        if self._controller is not None:
            more = partial(self.values_of, self._controller.scheme)
            self._health.show(self._controller, more)

    def _show_in_rviz(self) -> None:
        controller, measured = self._controller, self._input.measured
        if controller is not None and measured is not None and not self._input.is_silent:
            show = partial(self._rviz.show, controller, measured)
            self._health.attempt(show, "~/markers")
