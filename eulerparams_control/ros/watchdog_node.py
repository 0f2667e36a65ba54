"""The node ``watchdog``: ``joint_effort`` to a driver without a timeout, or what brakes the arm."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from eulerparams_control.control.clock import steady
from eulerparams_control.control.mode import Why
from eulerparams_control.control.watch import Watch, WatchMode
from eulerparams_control.errors import EulerParamsError, InvalidMessageError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.messages.from_ros import LARGEST_COMMAND, JointReader, JointStateReader
from eulerparams_control.parameters.watchdog import WatchdogParameters
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.commands import CommandPublisher
from eulerparams_control.ros.message_info import NUMBER, with_info
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.publishers import names_of_publishers, refuse_two_publishers, unheard
from eulerparams_control.ros.qos import QOS, QOS_LATCHED, overridable
from eulerparams_control.ros.runtime import run
from eulerparams_control.ros.senders import Source

_RESUME = "see to the controller; when it sends efforts again, call ~/resume"
SAYS = {
    WatchMode.WAITING: ("waiting for joint_states and joint_effort", ""),
    WatchMode.PASSING: ("passing joint_effort on", ""),
    WatchMode.BRAKING: ("joint_effort is silent: the arm is braked", _RESUME),
    WatchMode.HOLDING: ("joint_effort was silent: the arm is held by gravity and damping", _RESUME),
    WatchMode.BLIND: ("joint_states is silent: gravity compensation only", "engage the brakes"),
}


class WatchdogNode(Node):
    """Sits between a controller of efforts and a driver that holds the last one for ever."""

    parameters_type = WatchdogParameters

    def __init__(self) -> None:
        super().__init__("watchdog")
        self._health = diagnostics.Health(self)
        p = self._params = declare(self, self.parameters_type)
        self._watch: Watch | None = None
        publishers = partial(names_of_publishers, self, "joint_states")
        self._source = Source(publishers, self._on_dispute)
        self._health.check = self._source.review
        if p.robot_description:
            self._set_robot(p.robot_description)
        else:
            latched = overridable(QOS_LATCHED)
            self.create_subscription(String, "robot_description", self._on_urdf, **latched)
            text = "waiting for a robot description"
            self._health.set(diagnostics.OK, text, mode=WatchMode.WAITING)
        self.create_service(Trigger, "~/resume", self._on_resume)
        self.create_timer(p.timeout / 5, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_urdf(self, msg: String) -> None:
        try:
            if self._watch is None:
                self._set_robot(msg.data)
        except EulerParamsError as error:
            text = f"robot_description refused: {error}"
            self._health.set(diagnostics.ERROR, text, mode=WatchMode.WAITING)

    def _set_robot(self, urdf: str) -> None:
        robot, kind = self._params.robot(urdf), self._params.command_type
        self._commands = JointReader(robot.joints, "joint_effort", LARGEST_COMMAND)
        self._reader = JointStateReader(robot.joints, needs_velocity=True)
        self._driver = CommandPublisher(self, "driver_effort", kind, robot.joints)
        self._watch, self._stamp = Watch(robot, self._params), Time()
        self._efforts = self.create_subscription(
            JointState, "joint_effort", self._on_effort, **overridable(QOS)
        )
        self._states = self.create_subscription(
            JointState, "joint_states", with_info(self._on_state), **overridable(QOS)
        )
        self._send(None)

    def _on_effort(self, msg: JointState) -> None:
        assert self._watch is not None
        try:
            refuse_two_publishers(self, self._efforts)
            tau = self._commands.read(msg, "effort")
        except InvalidMessageError as error:
            self._health.reject("joint_effort", error)
            return
        self._stamp = msg.header.stamp
        self._send(self._watch.effort(tau, steady.now()))

    def _on_state(self, msg: JointState, info: Mapping[str, Any]) -> None:
        assert self._watch is not None
        if not self._reader.concerns(msg):  # a gripper's, say
            return
        now = steady.now()
        try:
            self._source.hear(info[NUMBER], now)
            _, q, dq = self._reader.from_ros(msg)
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            return
        self._stamp = msg.header.stamp
        if self._source.look(now):
            self._send(self._watch.state(q, dq, now))

    def _on_dispute(self, dispute: Why) -> None:
        if self._watch is not None and dispute.fault:
            self._watch.lose_sight()
        self._look()

    def _look(self) -> None:
        if self._watch is not None:
            self._send(self._watch.look(steady.now()))

    def _send(self, tau: Array | None) -> None:
        """Send efforts to the driver, if there are any, and say what is done."""
        assert self._watch is not None
        if tau is not None:
            self._driver.publish(self._stamp, JointCommand(effort=tau))
        text, remedy = SAYS[self._watch.mode]
        why = self._source.dispute
        if not why.fault and self._watch.mode in (WatchMode.WAITING, WatchMode.BLIND):
            why = unheard(self, self._states)
        if why.fault:
            text, remedy = f"{why.fault}: {text}", why.remedy
        level = diagnostics.ERROR if remedy else diagnostics.OK
        self._health.set(level, text, remedy, mode=self._watch.mode, cause=why.cause)

    def _on_resume(self, _request: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        try:
            self._source.accept(steady.now())
            if self._watch is not None:
                self._watch.resume(steady.now())
                self._send(None)
            answer.success, answer.message = True, self._health.message
        except InvalidMessageError as error:
            answer.message = str(error)
        return answer

    def at_rest(self) -> bool:
        """Brake the arm before the end; return whether it is at rest, or nothing acts."""
        # what is sent last is gravity compensation: it may stay
        return self._watch is None or self._watch.brake()


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(WatchdogNode, args)
