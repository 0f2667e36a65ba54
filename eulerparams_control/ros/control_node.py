"""The control node: what the nodes of all schemes share.

It is wiring: messages are converted, given to the :class:`Controller`, and its answer is
published under the stamp of the joint_states that it answers.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import NO_STATES, Mode, Why, contested, replaced, stuck
from eulerparams_control.errors import InvalidMessageError, defect, listed
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.from_ros import shown
from eulerparams_control.messages.keys import Lifecycle
from eulerparams_control.ros.control_report import ControlReport
from eulerparams_control.ros.diagnostics import ERROR
from eulerparams_control.ros.managed_node import ManagedNode
from eulerparams_control.ros.message_info import NUMBER
from eulerparams_control.ros.publishers import names_of_publishers, unheard
from eulerparams_control.ros.qos import QOS, QOS_LATCHED
from eulerparams_control.ros.rviz import RViz, Stiffness
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
        on_tf = self._params.publish_tf
        self._report = ControlReport(self, self._health, self._input, on_tf=on_tf)
        self._is_heard, self._began = False, steady.now()
        self._dispute = Why()  # about whose joint_states come
        self._rivals: list[str] = []  # the names of who publish them
        self._waits_for_look = False
        rate = self._params.state_rate
        self._period = int(1e9 / rate) if rate > 0 else 0  # of ~/pose and the like [ns]
        self._health.check, self._health.gather = self._once_a_second, self._gather
        self._shown: Tick | None = None
        self._rviz = RViz(self)
        period = max(self._params.state_timeout / 2, _LEAST_WATCH)
        for seconds, callback in ((period, self.watch), (_VIEW_PERIOD, self._show_in_rviz)):
            self.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._subscribe()
        leaders = self._input, self._rviz, self.leaders()
        self._leaders = Leaders(self, self._params, *leaders)
        self.create_service(Trigger, "~/halt", partial(self._on_order, Controller.halt))
        self.create_service(Trigger, "~/resume", partial(self._on_order, Controller.resume))
        self._try_start()

    def is_complete(self, t: int) -> bool:
        """Whether all that belongs to the state stamped t [ns] has come."""
        return not self._leaders.paired or self._leaders.are_here(t)

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

    def leaders(self) -> Topics:
        """Return the topics of the scheme that lead the arm, besides those of all."""
        return {}

    def note(self, why: Why) -> None:
        """Show a warning with the state from now on; Why() takes it back."""
        self._report.note(why)

    def _activated(self) -> None:
        assert self._controller is not None
        # only now: who publishes a reference can see by it that somebody follows
        self._leaders.begin(self._controller, self._lead)
        self._is_heard = False
        self._report.activated()
        self._say()

    def _changed(self) -> None:
        self._report.forget()  # the state names the orientation

    def _deactivated(self) -> None:
        self._leaders.end()

    # --- messages ----------------------------------------------------------------------

    def _subscribe(self) -> None:
        take = self._on_joint_states
        self._states = self.listen(
            JointState, "joint_states", take, QOS, raw=True, with_numbers=True
        )
        self._urdfs: Subscription | None = None
        if not self._description:
            self._urdfs = self.listen(
                String, "robot_description", self._on_robot_description, QOS_LATCHED
            )

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
            if strangers := self._input.take(data, info[NUMBER]):
                self._say_strange(strangers)
                return
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            return
        finally:
            if self._input.source.is_disputed is not bool(self._dispute.fault):
                self._see_dispute()
        if not was_answered and self._controller is not None:
            self._health.count("states dropped, waiting for what belongs to them")
        self._answer()

    def _say_strange(self, joints: Sequence[str]) -> None:
        """Say whose joint_states come, as long as none of the arm do."""
        if self._robot is not None and self._input.measured is None:
            self._health.complain(
                f"joint_states of {', '.join(map(shown, joints[:_SHOWN]))} came, but none yet of "
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
            self._waits_for_look = not (states.source.is_believed or self.believes())
            self._try_start()
            controller = self._controller
        if controller is None or not (self._is_heard or self._hears()) or not self.is_complete(t):
            return
        self._waits_for_look = not (states.source.is_believed or self.believes())
        if self._waits_for_look:
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
        if self._stands:
            self._say_standing(controller)
            return
        if self._report.answered(controller, t, self._period, self._params.orientation):
            guidance = controller.guidance
            is_asked = guidance.ticked == t and not controller.fault
            what = controller, guidance.of_law if is_asked else None, q, dq, stamp
            if command is not None:
                self._report.arm(*what)
            if not self._dispute.fault:  # else it is not known whose state it is
                self._show("/tf", partial(self._report.frames, *what))
        self._ending.review()

    @property
    def _stands(self) -> bool:
        """Whether time stands still: states come and are answered, but under one stamp.

        A robot in lock-step may wait so while its controller waits for a reference.
        """
        states, controller = self._input, self._controller
        if controller is None or states.standing <= self._timeout:
            return False
        return states.is_commanded and controller.mode in (Mode.HOLDING, Mode.FOLLOWING)

    def _say_standing(self, controller: Controller) -> None:
        """Say that there is no time to move by; the arm is held, unless it is simulated time."""
        t = self._input.measured[0] if self._input.measured is not None else 0
        why = stuck(f"joint_states come, but their stamp stays at {t / 1e9:g} s")
        mode, is_simulated = controller.mode, self.time.is_simulated
        if mode is Mode.FOLLOWING and not is_simulated:
            controller.settle(why._replace(fault="", note=why.fault))
        if mode is Mode.FOLLOWING:
            mode = Mode.HOLDING
        self._report.unanswered(mode, why, is_fault=not is_simulated)

    # --- whose joint_states come ---------------------------------------------------------

    def doubt(self) -> Why:
        """Return why it is not known whose joint_states come; Why() if it is, or will be soon."""
        return self._dispute if self._dispute.fault else unheard(self, self._states)

    def believes(self) -> bool:
        """Return whether joint_states are believed to be the arm's."""
        return self._input.source.look(steady.now(), self._has_several)

    def _has_several(self) -> bool:
        return bool(self.count_publishers(self._states.topic_name) > 1)

    def _see_rivals(self, controller: Controller) -> None:
        """See two publishers by states that contradict each other, where they are not numbered."""
        source = self._input.source
        if source.is_numbered or not controller.admission.is_contested or not self._has_several():
            return
        source.contradict(steady.now())
        self._see_dispute()

    def _see_dispute(self) -> None:
        """Command nothing while two publish the states of the arm, and say so."""
        source, controller, before = self._input.source, self._controller, self._dispute
        self._dispute = Why()
        if source.is_disputed:
            names = names_of_publishers(self, self._states.topic_name)
            if not before.fault or len(names) >= len(self._rivals):  # who has ended is named still
                self._rivals = names
            self._dispute = contested(listed(self._rivals))
            if not source.is_contested:
                self._dispute = replaced(listed(names))
        if self._dispute == before:
            return
        if controller is not None and self._dispute.fault:
            controller.distrust(self._dispute)
        elif controller is not None:
            controller.trust()
        elif self._dispute.fault:
            text, why = f"not activated: {self._dispute.fault}", self._dispute
            self._tell(ERROR, text, Lifecycle.INACTIVE, why.cause, why.remedy)
        self._say()

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

    def _lead(self, topic: str, msg: Any) -> None:
        """Let a message lead the arm, or say why it must not."""
        try:
            self._refuse_in_dispute()
            if self._stands and not self.time.is_simulated:
                raise InvalidMessageError("the stamp of joint_states stays: there is no time")
            self._leaders.take(topic, msg)
        except InvalidMessageError as error:
            self._health.reject(topic, error)
            if self._leaders.skip(topic, msg):
                self._answer()
            return
        if not self._is_silent:  # then that is what has to be said
            self._say()
        self._answer()

    def _on_order(
        self,
        order: Callable[[Controller], None],
        _request: Trigger.Request,
        answer: Trigger.Response,
    ) -> Trigger.Response:
        """Obey an order of an operator, or say why not."""
        if self._controller is None:
            answer.message = "not active: nothing is commanded"
            return answer
        try:
            if order is Controller.resume:
                self._input.source.accept(steady.now())
                self._see_dispute()
                self._refuse_in_dispute()
            order(self._controller)
        except InvalidMessageError as error:
            self._health.complain(str(error))
            answer.message = str(error)
            return answer
        if not self._is_silent:  # then that is what has to be said
            self._say()
        answer.success, answer.message = True, self._health.message
        return answer

    def _refuse_in_dispute(self) -> None:
        if self._dispute.fault:
            raise InvalidMessageError(f"{self._dispute.fault}; {self._dispute.remedy}")

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

    def _show_in_rviz(self) -> None:
        controller, measured = self._controller, self._input.measured
        if controller is not None and measured is not None and not self._is_silent:
            show = partial(self._rviz.show, controller, measured, self.stiffness_of)
            self._show("~/markers", show)

    def _show(self, what: str, show: Callable[[], None]) -> None:
        """Show something: a failure must not end the node that controls the arm."""
        try:
            show()
        except Exception as error:
            self._health.complain(f"{defect(error)}, of {what}", error=True, about=what)

    def _say(self) -> None:
        """Report what the controller does, or why it holds still, if that has changed."""
        if self._controller is None:
            return
        if self._stands and not self._is_silent:
            self._say_standing(self._controller)
        elif self._dispute.fault:
            fault = f"{self._dispute.fault}: no commands"
            self._report.unanswered(self._controller.mode, self._dispute._replace(fault=fault))
        else:
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
        return self._input.timeout(max(self._params.state_timeout, due), self.time.is_simulated)

    def watch(self) -> None:
        """Say that joint_states has stopped, as soon as it has; nothing is commanded then."""
        if self._controller is not None and self._is_silent and not self._dispute.fault:
            fault = (
                f"no valid joint_states within {self._timeout:g} s: no commands; is the robot "
                "running?"
            )
            self._report.unanswered(self._controller.mode, NO_STATES._replace(fault=fault))
        elif self._waits_for_look and self.time.is_simulated:  # the state may come but once
            self._answer()
        self._ending.review()

    def _once_a_second(self) -> None:
        """Gather what /diagnostics shows once a second."""
        self._health.values.update(self._input.read() | self.values_now())
        if self._dispute.fault:
            self._see_dispute()  # whose names are known by now
        is_late = steady.now() - self._began > _DISCOVERY
        if is_late and self._input.measured is None and not self.count_publishers("joint_states"):
            self._health.complain(f"nobody publishes {self._states.topic_name}: is a robot there?")
        self._say_unheard()
        if self._controller is None:
            return
        self._health.values["joint_states missed"] = self._controller.admission.period.missed
        self._report.once_a_second(self._controller, self._states.topic_name, self._commands.topic)
        if self._commands.count_subscribers() == 0 and self._params.commands_joints:
            self._health.complain(
                f"nobody listens to {self._commands.topic}: does the robot take another command?"
            )

    def _say_unheard(self) -> None:
        """Say why nothing comes of what is needed first, where that is the QoS."""
        why = Why()
        if self._robot is None and self._urdfs is not None and not self._description:
            why, mode = unheard(self, self._urdfs), Lifecycle.UNCONFIGURED
        elif self._robot is not None and self._input.measured is None:
            why, mode = unheard(self, self._states), Lifecycle.INACTIVE
        if why.fault:
            self._tell(ERROR, why.fault, mode, why.cause, why.remedy)
