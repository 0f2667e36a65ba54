"""The lifecycle node of a controller: parameters, transitions, defects.

By default it starts itself as soon as it has a robot description and a state.
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.guidance import ControllerOptions
from eulerparams_control.control.mode import REPORT_IT, Why
from eulerparams_control.errors import ConfigurationError, EulerParamsError, defect
from eulerparams_control.events import Event, tell
from eulerparams_control.laws.scheme import Scheme
from eulerparams_control.messages.keys import Lifecycle
from eulerparams_control.messages.keys import LifecycleCause as Cause
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.schemes import TORQUE
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.commands import CommandPublisher, Commands
from eulerparams_control.ros.control_report import ControlReport
from eulerparams_control.ros.diagnostics import ERROR, OK, WARN, Values
from eulerparams_control.ros.ending import Ending
from eulerparams_control.ros.guards import (
    keep_sim_time,
    refuse_unless_simulated,
    survive_wrong_transitions,
    surviving,
)
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.qos import QOS_STREAM, overridable
from eulerparams_control.ros.real_time import claim
from eulerparams_control.ros.state_input import StateInput


class ManagedNode(LifecycleNode):
    """A lifecycle node with a robot, and a controller while it is active."""

    parameters_type: type[Any] = ControlParameters

    def __init__(self) -> None:
        super().__init__(self.parameters_type.scheme.name)
        self.done = False
        p = self._params = declare(self, self.parameters_type, self._on_change)
        self._health = ControlReport(self, p)
        refuse_unless_simulated(self, p)
        claim(p, self._health)
        self._robot: Robot | None = None
        self._controller: Controller | None = None
        self._description = p.robot_description
        self._input = StateInput(self, p.state_timeout, self._on_dispute)
        self._stamp = Time()  # of the last command
        self._autostart = p.autostart
        self._ending = Ending(lambda: self._input.is_followed, self._release)
        keep_sim_time(self, lambda: self._params)
        waiting, mode = "waiting for a robot description", Lifecycle.UNCONFIGURED
        self._health.set(OK, waiting, mode=mode, cause=Cause.NO_DESCRIPTION)
        survive_wrong_transitions(self, self._health)

    def make_scheme(self, robot: Robot) -> Scheme:
        """Return the scheme for a robot, from the parameters; raises ConfigurationError."""
        scheme: Scheme = self._params.make_scheme(robot)
        return scheme

    def change_scheme(self, scheme: Scheme, parameters: Any) -> None:
        """Change a running scheme to new parameters; raises ConfigurationError."""
        scheme.change(parameters)

    def make_commands(self, joints: tuple[str, ...]) -> Commands:
        """Return the publisher of the scheme's commands."""
        p = self._params
        return CommandPublisher(self, p.scheme.command, p.command_type, joints, QOS_STREAM)

    def doubt(self) -> Why:
        """Return why it is not known whose messages come; Why() if it is, or will be soon."""
        return self._input.doubt()

    def refusal(self) -> str:
        """Return why the arm must not be controlled yet; "" if it may."""
        return self._input.motion() if self._robot else ""

    def values_now(self) -> Values:
        """Return what /diagnostics shows once a second, whether there are ticks or not."""
        return {}

    @abstractmethod
    def _activated(self) -> None:
        """Begin to listen to references."""

    @abstractmethod
    def _deactivated(self) -> None:
        """Listen to references no more."""

    def _fail(
        self, text: str, mode: Lifecycle, cause: str = Cause.REFUSED, remedy: str = ""
    ) -> TransitionCallbackReturn:
        """Say what is wrong while nothing is controlled."""
        self._health.set(ERROR, text, remedy, mode=mode, cause=cause)
        return TransitionCallbackReturn.FAILURE

    def _fail_for(self, why: Why) -> TransitionCallbackReturn:
        text = f"not activated: {why.fault}"
        return self._fail(text, Lifecycle.INACTIVE, why.cause, why.remedy)

    def _on_dispute(self, dispute: Why) -> None:
        """Command nothing while two publish the states of the arm, and say so."""
        if self._controller is None:
            if dispute.fault:
                self._fail_for(dispute)
            return
        if dispute.fault:
            self._controller.distrust(dispute)
        else:
            self._controller.trust()
        self._health.say(self._controller, self._input)

    # --- parameters --------------------------------------------------------------------

    def _on_change(self, _old: Any, new: Any) -> None:
        """Apply parameters that were changed while running, between two ticks."""
        refuse_unless_simulated(self, new)
        old, self._params = self._params, new
        try:
            if self._controller is not None and self._robot is not None:
                if new.orientation != old.orientation:  # nothing is taken of what is refused
                    new.make_scheme(self._robot)
                self.change_scheme(self._controller.scheme, new)
                self._controller.changed(ControllerOptions.of(new))
                changed = [name for name, now in asdict(new).items() if now != getattr(old, name)]
                text = ", ".join(f"{name} {getattr(new, name)}" for name in changed)
                self.get_logger().info(f"changed: {text}")
            elif self._robot is not None:
                # refuses now what activation would refuse
                self.make_scheme(self._robot)
        except ConfigurationError:
            self._params = old
            raise

    # --- lifecycle ---------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the robot from its description."""
        try:
            self._refuse_while_ending()
            if not self._description:
                raise ConfigurationError(
                    "no robot description: set the parameter robot_description, or publish the "
                    "URDF on the topic robot_description (transient local)"
                )
            robot = self._params.robot(self._description)
            robot.refuse_joints()
            self.make_scheme(robot).rehearse()  # refuses now what activation would refuse
        except EulerParamsError as error:
            return self._fail(f"not configured: {error}", Lifecycle.UNCONFIGURED)
        self._robot = robot
        p = self._params
        self._input.expect(robot, p.scheme.control == TORQUE and p.commands_joints)
        self._commands = self.make_commands(robot.joints)
        waiting, mode = "configured, waiting for joint_states", Lifecycle.INACTIVE
        self._health.set(OK, waiting, mode=mode, cause=Cause.NO_STATES)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin at the measured pose with zero error."""
        measured, robot = self._input.measured, self._robot
        assert robot is not None
        if (why := self.doubt()).fault:
            return self._fail_for(why)
        if measured is None:
            joints = ", ".join(robot.joints)
            text = f"not activated: no valid joint_states yet; expected the joints {joints}"
            return self._fail(text, Lifecycle.INACTIVE, Cause.NO_STATES)
        try:
            self._refuse_while_ending()
            if not self._input.is_simulated and self._input.is_silent:
                raise ConfigurationError("joint_states has stopped; is the robot running?")
            if reason := self.refusal():
                raise ConfigurationError(reason)
            scheme = self.make_scheme(robot)
        except EulerParamsError as error:
            self._health.values.update(self.values_now())
            return self._fail(f"not activated: {error}", Lifecycle.INACTIVE)
        options = ControllerOptions.of(self._params)
        self._controller = Controller(scheme, options, measured[1], self._input.efforts)
        self._activated()
        tell(Event.READY)
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the arm to rest, also after this has returned, then command nothing."""
        self._end_control(lambda: self._health.set(WARN, "inactive", mode=Lifecycle.INACTIVE))
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the arm to rest, then command nothing until configured again."""
        self._end_control(self._forget_robot)
        text = "an error in a transition: unconfigured"
        self._fail(text, Lifecycle.UNCONFIGURED, Cause.TRANSITION_ERROR)
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the arm to rest, also after this has returned, then never command again."""
        self._end_control(lambda: self._health.set(WARN, "shut down", mode=Lifecycle.FINALIZED))
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the robot, when it is at rest."""
        self._end_control(self._forget_robot, self._commands.destroy)
        return TransitionCallbackReturn.SUCCESS

    # --- the end of control ------------------------------------------------------------

    def _end_control(self, *then: Callable[[], None]) -> None:
        """Bring the arm to rest, if it is controlled, and release it; call ``then`` at last."""
        self._autostart = False  # who stopped it decides when it starts again
        self._deactivated()
        self._ending.begin(self._controller, *then)

    def _refuse_while_ending(self) -> None:
        if self._controller is not None:
            raise ConfigurationError("the arm is still being brought to rest; try again then")

    def _release(self) -> None:
        """Send the command after which none follows; not to a robot that is not heard."""
        controller, is_followed = self._controller, self._input.is_followed
        try:
            if controller and is_followed and (command := controller.last_command()):
                self._commands.publish(self._stamp, command)
        except Exception as error:  # then none is safe: the robot has to brake itself
            self._health.complain(f"no last command: {defect(error)}", error=True)
        self._controller = None
        self._input.forget()

    def _forget_robot(self) -> None:
        self._robot = None
        self._input.forget()

    def at_rest(self) -> bool:
        """Stop the arm; return whether it is at rest, or nothing is heard of it."""
        self._end_control()
        return self._controller is None

    def close(self) -> None:
        """Send the last safe command before the process ends, if it was not yet."""
        self._ending.finish()

    def _try_start(self) -> None:
        """Configure and activate, as far as what is needed has come."""
        if not self._autostart or self._controller is not None:
            return
        if self._robot is None and self._description:
            self.trigger_configure()
        if self._robot is not None and self._input.measured is not None:
            if (why := self.doubt()).fault:
                self._fail_for(why)
            elif not self._input.source.look(steady.now()):
                pass  # a second look at who publishes the states comes first
            elif reason := self.refusal():
                text, mode = f"not activated yet: {reason}", Lifecycle.INACTIVE
                self._health.set(WARN, text, mode=mode, cause=Cause.REFUSED)
            else:
                self.trigger_activate()

    def listen(
        self, kind: Any, topic: str, callback: Any, qos: QoSProfile, *, raw: bool = False
    ) -> Subscription:
        """Listen to a topic; a defect of the callback stops the arm, and does not end the node."""
        guarded = surviving(callback, self._on_defect)
        return self.create_subscription(kind, topic, guarded, **overridable(qos), raw=raw)

    def _on_defect(self, error: Exception) -> None:
        """Hold still after an error that nobody expected."""
        if self._controller is None:
            mode = Lifecycle.INACTIVE if self._robot else Lifecycle.UNCONFIGURED
            self._fail(defect(error), mode, Cause.DEFECT, REPORT_IT)
        else:
            self._controller.fail_for_good(error)
            self._health.say(self._controller, self._input)
