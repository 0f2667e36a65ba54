"""The control node: what the nodes of all schemes share.

It is wiring: messages are converted, given to the :class:`Controller`, and its answer is
published under the stamp of the joint_states that it answers.  A lifecycle node that by
default starts itself as soon as it has a robot description and a state.
"""

import importlib
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from builtin_interfaces.msg import Time
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import REPORT_IT
from eulerparams_control.control.options import ControllerOptions
from eulerparams_control.errors import (
    ConfigurationError,
    EulerParamsError,
    InvalidMessageError,
    defect,
)
from eulerparams_control.events import Event, tell
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import SEPARATE
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Scheme, Tick
from eulerparams_control.messages.from_ros import JointStateReader, motion_from_ros, ns_from_ros
from eulerparams_control.parameters.common import LATEST, NO_COMMANDS, ControlParameters
from eulerparams_control.parameters.schemes import TORQUE, SchemeInfo
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.commands import CommandPublisher, Commands
from eulerparams_control.ros.control_report import ControlReport
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.publishers import publishers_of, refuse_two_publishers
from eulerparams_control.ros.qos import QOS, QOS_LATCHED, QOS_OVERRIDES, QOS_STREAM

# joint_states that came within this time [s] at least are fresh.
_FRESH = 0.1

# The ages are looked at again after this time [s] at the earliest.
_LEAST_WATCH = 0.02

# In simulated time joint_states have stopped after so much [s] of the steady clock.
_SIMULATION_STANDS = 0.5

RCLError = rclpy_implementation.RCLError


class ControlNode(LifecycleNode):
    """A lifecycle node that runs one scheme on one arm."""

    parameters_type: type[Any] = ControlParameters

    def __init__(self) -> None:
        self.interface: SchemeInfo = self.parameters_type.scheme
        super().__init__(self.interface.name)
        self.done = False
        self._health = diagnostics.Health(self)
        self._params = declare(self, self.parameters_type, self._on_change)
        self._check_simulated(self._params)
        self._robot: Robot | None = None
        self._controller: Controller | None = None
        self._description = self._params.robot_description
        self._measured: tuple[int, Array, Array] | None = None
        self._report = ControlReport(self, self._health)
        self._came = 0.0  # when the last joint_states came, steady clock [s]
        self._valid = 0.0  # when the last valid ones came
        self._received = 0.0  # when the last ones were answered
        self._commanded = False
        self._cut = 0  # ticks that a limit had changed a second ago
        self._restarts = 0  # of the controller, a second ago
        self._unanswered: Time | None = None
        self._reference_stamp: int | None = None
        self._health.check = self._once_a_second
        period = max(self._params.state_timeout / 2, _LEAST_WATCH)
        self.create_timer(period, self.watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.add_on_set_parameters_callback(self._keep_sim_time)
        self._reference: Subscription | None = None
        self._autostart = self._params.autostart
        self._health.set(diagnostics.OK, "waiting for a robot description")
        self._survive_wrong_transitions()
        self._subscribe()
        self._try_start()

    def make_robot(self, urdf: str) -> Robot:
        """Return the robot of a URDF, from the parameters; raises RobotError."""
        robot: Robot = self._params.robot(urdf)
        return robot

    def make_scheme(self, robot: Robot, limits: JointLimits | None) -> Scheme:
        """Return the scheme for a robot, from the parameters; raises ConfigurationError."""
        scheme: Scheme = self._params.make_scheme(robot, limits)
        return scheme

    def change_scheme(self, scheme: Scheme, parameters: Any, limits: JointLimits | None) -> None:
        """Change a running scheme to new parameters; raises ConfigurationError."""
        parameters.change_scheme(scheme, limits)

    def make_commands(self, joints: tuple[str, ...]) -> Commands:
        """Return the publisher of the scheme's commands."""
        kind = self._params.command_type
        return CommandPublisher(self, self.interface.command, kind, joints, QOS_STREAM)

    @property
    def commands_joints(self) -> bool:
        """Whether commands for the joints are published at all."""
        return bool(self._params.command_type != NO_COMMANDS)

    def is_complete(self, t: int) -> bool:
        """Whether all that belongs to the state stamped t [ns] has come."""
        return self._params.reference_pairing == LATEST or self._reference_stamp == t

    def observe(self, t: int, q: Array, dq: Array) -> None:
        """Take what else was measured for the state q, dq (n,), before it is answered."""

    def refusal(self) -> str:
        """Return why the arm must not be controlled yet; "" if it may."""
        return ""

    def values_of(self, tick: Tick) -> dict[str, str | int | float]:
        """Return what /diagnostics shows of a tick, besides what it shows of all."""
        return {}

    def values_now(self) -> dict[str, str | int | float]:
        """Return what /diagnostics shows once a second, whether there are ticks or not."""
        return {}

    def note(self, text: str) -> None:
        """Show a warning with the state from now on; "" takes it back."""
        self._report.note(text)

    # --- set-up ------------------------------------------------------------------------

    def _subscribe(self) -> None:
        self._states = self._listen(JointState, "joint_states", self._on_joint_states, QOS)
        if not self._description:
            self._listen(String, "robot_description", self._on_robot_description, QOS_LATCHED)

    def _listen(self, kind: Any, topic: str, callback: Any, qos: QoSProfile) -> Subscription:
        return self.create_subscription(
            kind, topic, self._surviving(callback), qos, qos_overriding_options=QOS_OVERRIDES
        )

    def _check_simulated(self, parameters: Any) -> None:
        """Refuse what is dangerous outside a simulation."""
        unsafe = _unsafe(parameters)
        if unsafe and not self.get_parameter("use_sim_time").value:
            raise ConfigurationError(
                f"{unsafe} is accepted only with use_sim_time: true, in simulation"
            )

    def _keep_sim_time(self, changes: list[Any]) -> SetParametersResult:
        """Refuse to leave simulated time while something unsafe is set, or set with it."""
        new = {change.name: change.value for change in changes}
        if new.get("use_sim_time", True):
            return SetParametersResult(successful=True)
        together = len(new.keys() & _SIMULATED_ONLY) > 0
        unsafe = ", ".join(new.keys() & _SIMULATED_ONLY) if together else _unsafe(self._params)
        reason = f"use_sim_time stays true with {unsafe}" if unsafe else ""
        return SetParametersResult(successful=not unsafe, reason=reason)

    def _limits(self, parameters: Any, robot: Robot) -> JointLimits | None:
        if not parameters.enforce_limits:
            return None
        return robot.limits.scaled(parameters.velocity_scale)

    def _on_change(self, _old: Any, new: Any) -> None:
        """Apply parameters that were changed while running, between two ticks."""
        self._check_simulated(new)
        old, self._params = self._params, new
        try:
            if self._controller is not None and self._robot is not None:
                self.change_scheme(self._controller.scheme, new, self._limits(new, self._robot))
                self._controller.law_changed()
                self._say_changed(old, new)
            elif self._robot is not None:
                self.make_scheme(self._robot, None)  # refuses now what activation would refuse
        except ConfigurationError:
            self._params = old
            raise

    def _say_changed(self, old: Any, new: Any) -> None:
        """Log what was changed while running."""
        changed = [name for name, value in asdict(new).items() if value != getattr(old, name)]
        text = ", ".join(f"{name} {getattr(new, name)}" for name in changed)
        self.get_logger().info(f"changed: {text}")
        self._report.forget()  # the state names the orientation

    # --- lifecycle ---------------------------------------------------------------------

    def _survive_wrong_transitions(self) -> None:
        """Answer a transition that the state does not have; rclpy would end the process."""
        service = self._service_change_state
        change_state = service.callback

        def guarded(request: ChangeState.Request, response: ChangeState.Response) -> Any:
            try:
                return change_state(request, response)
            except RCLError as error:
                self._health.complain(f"transition refused: {error}")
                response.success = False
                return response

        service.callback = guarded

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the robot from its description."""
        try:
            if not self._description:
                raise ConfigurationError(
                    "no robot description: set the parameter robot_description, or publish the "
                    "URDF on the topic robot_description (transient local)"
                )
            robot = self.make_robot(self._description)
            if robot.locked:
                raise ConfigurationError(
                    f"{', '.join(robot.locked)} can move between {robot.base_frame} and "
                    f"{robot.tip_frame}, but is not among the active joints; set joints: []"
                )
            self.make_scheme(robot, None)  # refuses now what activation would refuse
        except EulerParamsError as error:
            self._health.set(diagnostics.ERROR, f"not configured: {error}")
            return TransitionCallbackReturn.FAILURE
        self._robot = robot
        needs_velocity = self.interface.control == TORQUE and self.commands_joints
        self._reader = JointStateReader(robot.joints, needs_velocity)
        self._commands = self.make_commands(robot.joints)
        self._health.set(diagnostics.OK, "configured, waiting for joint_states")
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin at the measured pose with zero error."""
        if self._measured is None or self._robot is None:
            self._health.set(
                diagnostics.ERROR,
                "not activated: no valid joint_states yet; expected the joints "
                + (", ".join(self._robot.joints) if self._robot else ""),
            )
            return TransitionCallbackReturn.FAILURE
        try:
            if reason := self._stale() or self.refusal():
                raise ConfigurationError(reason)
            scheme = self.make_scheme(self._robot, self._limits(self._params, self._robot))
        except EulerParamsError as error:
            self._health.values.update(self.values_now())
            self._health.set(diagnostics.ERROR, f"not activated: {error}")
            return TransitionCallbackReturn.FAILURE
        options = _controller_options(self._params)
        self._controller = Controller(scheme, options, self._measured[1])
        self._cut = self._restarts = 0
        # only now: who publishes a reference can see by it that somebody follows
        self._reference = self._listen(
            MultiDOFJointTrajectory, "reference", self._on_reference, QOS
        )
        self._received, self._commanded, self._heard = 0.0, False, False
        self._report.forget()
        self._say()
        tell(Event.READY)
        return TransitionCallbackReturn.SUCCESS

    def _stale(self) -> str:
        """Return that the state measured last is not of now; "" if it is, or time is simulated."""
        if self.get_clock().ros_time_is_active or steady() - self._valid <= self._is_fresh_for:
            return ""
        return "joint_states has stopped; is the robot running?"

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command to hold still once more, then command nothing."""
        self._end_control()
        self._health.set(diagnostics.WARN, "inactive")
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command to hold still once more, then command nothing until configured again."""
        self._end_control()
        self._robot = None
        self._health.set(diagnostics.ERROR, "an error in a transition: unconfigured")
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command to hold still once more, then never command again."""
        self._end_control()
        self._health.set(diagnostics.WARN, "shut down")
        return TransitionCallbackReturn.SUCCESS

    def _end_control(self) -> None:
        self._send_last()
        self._controller = self._measured = None
        self._autostart = False  # who stopped it decides when it starts again
        if self._reference is not None:
            self.destroy_subscription(self._reference)
            self._reference = None

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the robot."""
        self._robot = self._measured = None
        self._commands.destroy()
        return TransitionCallbackReturn.SUCCESS

    def _is_fresh(self) -> bool:
        """Whether joint_states were answered, and still come."""
        return self._commanded and steady() - self._received <= self._is_fresh_for

    @property
    def _is_fresh_for(self) -> float:
        """For how long [s] joint_states are fresh."""
        return max(float(self._params.state_timeout), _FRESH)

    def _send_last(self) -> None:
        """Send the command after which none follows; not to a robot that is not heard."""
        if self._controller is None or not self._is_fresh():
            return
        try:
            command = self._controller.last_command()
            if command is not None:
                self._commands.publish(self._stamp, command)
        except Exception as error:  # then none is safe: the robot has to brake itself
            self._health.complain(f"no last command: {defect(error)}", error=True)

    def at_rest(self) -> bool:
        """Stop the arm, and return whether it stands, or nothing is heard of it."""
        if self._controller is None or not self._is_fresh():
            return True
        self._controller.halt()
        return self._controller.is_at_rest

    def close(self) -> None:
        """Send the last safe command before the process ends."""
        self._send_last()

    def _try_start(self) -> None:
        """Configure and activate, as far as what is needed has come."""
        if not self._autostart or self._controller is not None:
            return
        if self._robot is None and self._description:
            self.trigger_configure()
        if self._robot is not None and self._measured is not None:
            if reason := self.refusal():
                self._health.set(diagnostics.WARN, f"not activated yet: {reason}")
            else:
                self.trigger_activate()

    # --- messages ----------------------------------------------------------------------

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
        self._came = steady()
        try:
            self._measured = self._reader.from_ros(msg)
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            return
        before, self._valid = self._valid, self._came
        self._report.meter.state(self._measured[0], self._came)
        if self._unanswered is not None and self._controller is not None:
            self._health.count("states dropped, waiting for what belongs to them")
        self._unanswered = msg.header.stamp
        if not self._answer():
            self._valid = before

    def _answer(self) -> bool:
        """Answer the last state, once all that belongs to it is there; return if it is valid."""
        if self._unanswered is None or self._measured is None:
            return True
        t, q, dq = self._measured
        if self._controller is None:  # nothing listens yet to what belongs to the state
            self.observe(t, q, dq)
            self._try_start()
        if self._controller is None or not self._is_heard() or not self.is_complete(t):
            return True
        stamp, self._unanswered = self._unanswered, None
        self.observe(t, q, dq)
        try:
            command = self._controller.step(t, q, dq, self._receipt(self._came))
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            return False
        self._received = self._came
        if command is not None:
            self._commanded = True
            self._stamp = stamp
            self._commands.publish(self._stamp, command)
            self._report.meter.answered(self._came)
            self._report_tick(t, self._controller)
        self._report.began(self._controller)
        self._say()
        return True

    def _receipt(self, now: float) -> float | None:
        """Return a time of receipt [s]; None where time is simulated, and the stamps count."""
        return None if self.get_clock().ros_time_is_active else now

    def _is_heard(self) -> bool:
        """Whether as many listen to the commands as have to, or had when they began."""
        wanted = self._params.wait_for_subscribers
        if not self._heard:
            there = self._commands.count_subscribers()
            self._heard = there >= wanted
            if not self._heard:
                topic = self._commands.topic
                self._health.complain(
                    f"waiting for {wanted} subscribers of {topic}, {there} are there",
                    about="subscribers",
                )
        return self._heard

    def _on_reference(self, msg: MultiDOFJointTrajectory) -> None:
        if self._controller is None or self._robot is None:
            return
        try:
            refuse_two_publishers(self, self._reference)
            motion, start = motion_from_ros(
                msg,
                self._robot.base_frame,
                self._robot.tip_frame,
                self._params.reference_timeout,
            )
            self._controller.follow(motion, start, self._receipt(steady()))
            if not self._is_silent():  # then that is what has to be said
                self._say()
        except InvalidMessageError as error:
            self._health.reject("reference", error)
            return
        self._reference_stamp = ns_from_ros(msg.header.stamp)
        self._answer()

    def _report_tick(self, t: int, controller: Controller) -> None:
        """Report the last tick, now and then."""
        tick, p = controller.guidance.tick_now, self._params
        if tick is None or controller.fault or not self._report.is_due(t, p.state_rate):
            return
        self._report.tick(controller, p, self._stamp, self._robot.base_frame if self._robot else "")
        self._health.values.update(self.values_of(tick))

    def _say(self) -> None:
        """Report what the controller does, or why it holds still, if that has changed."""
        if self._controller is not None:
            self._report.state(self._controller, self._params.orientation)

    # --- supervision -------------------------------------------------------------------

    def watch(self) -> None:
        """Say that joint_states has stopped, as soon as it has; nothing is commanded then."""
        if self._controller is not None and self._is_silent():
            self._report.forget()  # what it does is said again when they are back
            self._health.set(
                diagnostics.ERROR,
                f"no valid joint_states within {self._timeout:g} s: no commands; is the robot "
                "running?",
                "see to the robot and the network; when they are back the arm is held where it is",
            )

    @property
    def _timeout(self) -> float:
        """After which [s] joint_states has stopped; simulated time may stand still."""
        if self.get_clock().ros_time_is_active:
            return max(self._params.state_timeout, _SIMULATION_STANDS)
        return float(self._params.state_timeout)

    def _is_silent(self) -> bool:
        """Whether valid joint_states came once, and have stopped."""
        return steady() - self._valid > self._timeout

    def _once_a_second(self) -> None:
        """Gather what /diagnostics shows once a second."""
        self._health.values.update(self._report.meter.read() | self.values_now())
        if self._controller is None:
            return
        self._complain_of_limits(self._controller)
        self._complain_of_restarts(self._controller)
        if self._commands.count_subscribers() == 0 and self.commands_joints:
            self._health.complain(
                f"nobody listens to {self._commands.topic}: does the robot take another command?"
            )

    def _complain_of_limits(self, controller: Controller) -> None:
        """Say that the motion is more than the arm may do, where limits change most commands."""
        cut, self._cut = controller.guidance.saturated - self._cut, controller.guidance.saturated
        if cut > self._report.meter.answers / 2:
            self._health.complain(
                f"limits have changed {cut} commands of the last second: the motion is faster than "
                "the arm may be, or the gains are too high",
                about="limits",
            )

    def _complain_of_restarts(self, controller: Controller) -> None:
        """Say who publishes joint_states where they jump to and fro."""
        again, self._restarts = controller.resets - self._restarts, controller.resets
        if again > 1:
            names = ", ".join(sorted(publishers_of(self, self._states.topic_name)))
            self._health.complain(
                f"joint_states have jumped {again} times in the last second: expected one robot, "
                f"published by {names}",
                error=True,
                about="restarts",
            )

    def _surviving(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback after whose defects the arm is held, and the node goes on."""

        def survive(msg: Any) -> None:
            try:
                callback(msg)
            except Exception as error:
                self._on_defect(error)

        return survive

    def _on_defect(self, error: Exception) -> None:
        """Hold still after an error that nobody expected."""
        if self._controller is None:
            self._health.set(diagnostics.ERROR, defect(error), REPORT_IT)
        else:
            self._controller.fail_for_good(error)
            self._say()


def node_class(scheme: SchemeInfo) -> type[ControlNode]:
    """Return the class of the node of a scheme."""
    found = vars(importlib.import_module(scheme.node)).values()
    nodes = (item for item in found if isinstance(item, type) and issubclass(item, ControlNode))
    return next(node for node in nodes if node.parameters_type is scheme.parameters)


def _controller_options(p: ControlParameters) -> ControllerOptions:
    """Return how the controller is to treat time and references."""
    return ControllerOptions(
        p.state_timeout,
        p.reference_timeout,
        p.max_jump_position,
        p.max_jump_rotation,
        p.require_reference,
        p.enforce_limits,
        p.slow_below,
        p.max_latency,
    )


_SIMULATED_ONLY = {
    *("enforce_limits", "quaternion_sign", "quaternion_initial_sign", "velocity_scale")
}


def _unsafe(parameters: Any) -> str:
    """Return what is set that is for simulations only; "" if nothing."""
    if not parameters.enforce_limits:
        return "enforce_limits: false"
    if parameters.quaternion_sign == SEPARATE:
        return f"quaternion_sign: {SEPARATE}"
    if parameters.quaternion_initial_sign < 0:
        return f"quaternion_initial_sign: {parameters.quaternion_initial_sign}"
    if parameters.velocity_scale > 1:
        return f"velocity_scale: {parameters.velocity_scale:g}, above 1,"
    return ""
