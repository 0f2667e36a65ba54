"""The lifecycle node of a controller: parameters, transitions, defects.

By default it starts itself as soon as it has a robot description and a state.
"""

from collections.abc import Callable
from dataclasses import asdict
from functools import wraps
from typing import Any

from builtin_interfaces.msg import Time
from rcl_interfaces.msg import SetParametersResult
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.guidance import ControllerOptions
from eulerparams_control.control.mode import MODEL_MISMATCH, REPORT_IT, Why
from eulerparams_control.errors import ConfigurationError, EulerParamsError, ModelError, defect
from eulerparams_control.events import Event, tell
from eulerparams_control.laws.scheme import Scheme
from eulerparams_control.messages.keys import Lifecycle
from eulerparams_control.messages.keys import LifecycleCause as Cause
from eulerparams_control.parameters.common import SIMULATED_ONLY, ControlParameters
from eulerparams_control.parameters.schemes import TORQUE
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.commands import CommandPublisher
from eulerparams_control.ros.control_report import ControlReport
from eulerparams_control.ros.diagnostics import ERROR, OK, WARN, Values
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.qos import overridable
from eulerparams_control.ros.real_time import claim
from eulerparams_control.ros.state_input import StateInput

LONGEST = 3.0
"""[s] that an arm is given to come to rest, beside twice the time that its limits need for it; then
it is let alone where it is."""

_UNCONFIGURED, _INACTIVE = Lifecycle.UNCONFIGURED, Lifecycle.INACTIVE


class ManagedNode(LifecycleNode):
    """The lifecycle of a control node: a robot, and a controller while it is active.

    ControlNode adds the messages.
    """

    parameters_type: type[Any] = ControlParameters

    def __init__(self) -> None:
        super().__init__(self.parameters_type.scheme.name)
        p = self._params = declare(self, self.parameters_type, self._on_change)
        self.refuse_unless_simulated(p)
        self._input = StateInput(self, p.state_timeout, self._on_dispute)
        self._health = ControlReport(self, p, self._input)
        claim(p, self._health)
        self._robot: Robot | None = None
        self._controller: Controller | None = None
        self._description = p.robot_description
        self._stamp = Time()  # of the last command
        self._autostart = p.autostart
        self._deadline: float | None = None  # by which the arm is released, while control ends
        self._at_end: list[Callable[[], None]] = []  # what is called then
        self.add_on_set_parameters_callback(self._keep_sim_time)
        self._survive_wrong_transitions()
        waiting = "waiting for a robot description"
        self._health.set(OK, waiting, mode=_UNCONFIGURED, cause=Cause.NO_DESCRIPTION)

    def make_scheme(self, robot: Robot) -> Scheme:
        """Return the scheme for a robot, from the parameters; raises ConfigurationError."""
        scheme: Scheme = self._params.make_scheme(robot)
        return scheme

    def change_scheme(self, scheme: Scheme, parameters: Any) -> None:
        """Change a running scheme to new parameters; raises ConfigurationError."""
        scheme.change(parameters)

    def doubt(self) -> Why:
        """Return why it is not known whose messages come; Why() if it is, or will be soon."""
        return self._input.doubt()

    def refusal(self) -> str:
        """Return why the arm must not be controlled yet; "" if it may."""
        return self._input.motion() if self._robot else ""

    def _mismatch(self) -> Why:
        """Return why the model is not that of the arm; Why() if it may be."""
        states, robot = self._input, self._robot
        assert states.measured is not None
        assert robot is not None
        try:
            self._params.refuse_start(robot, states.measured[1], states.efforts)
        except ModelError as error:
            return MODEL_MISMATCH._replace(fault=str(error))
        return Why()

    def values_now(self) -> Values:
        """Return what /diagnostics shows once a second, whether there are ticks or not."""
        return {}

    def _activated(self) -> None:
        """Begin to listen to references."""

    def _deactivated(self) -> None:
        """Listen to references no more."""

    def _fail(
        self, text: str, cause: str = Cause.REFUSED, remedy: str = "", mode: str = _INACTIVE
    ) -> TransitionCallbackReturn:
        """Say what is wrong while nothing is controlled."""
        self._health.set(ERROR, text, remedy, mode=mode, cause=cause)
        return TransitionCallbackReturn.FAILURE

    def _fail_for(self, why: Why) -> TransitionCallbackReturn:
        return self._fail(f"not activated: {why.fault}", why.cause, why.remedy)

    def _on_dispute(self, dispute: Why) -> None:
        """Command nothing while two publish the states of the arm, and say so."""
        if self._controller is None:
            if dispute.fault:
                self._fail_for(dispute)
            return
        if dispute.fault:
            self._controller.distrust(dispute)
            self._health.say(self._controller)
        else:  # the next state is answered, which says it
            self._controller.trust()

    # --- parameters --------------------------------------------------------------------

    def refuse_unless_simulated(self, parameters: ControlParameters) -> None:
        """Raise ConfigurationError for what is dangerous outside a simulation."""
        unsafe = parameters.for_simulation
        if unsafe and not self.get_parameter("use_sim_time").value:
            raise ConfigurationError(
                f"{unsafe} is accepted only with use_sim_time: true, in simulation"
            )

    def _keep_sim_time(self, changes: list[Any]) -> SetParametersResult:
        """Refuse to leave simulated time while something unsafe is set, or set with it."""
        new = {change.name: change.value for change in changes}
        unsafe = ""
        if not new.get("use_sim_time", True):
            unsafe = ", ".join(new.keys() & SIMULATED_ONLY) or self._params.for_simulation
        reason = f"use_sim_time stays true with {unsafe}" if unsafe else ""
        return SetParametersResult(successful=not unsafe, reason=reason)

    def _on_change(self, old: Any, new: Any) -> None:
        """Apply parameters that were changed while running, between two ticks."""
        self.refuse_unless_simulated(new)
        robot, controller = self._robot, self._controller
        if robot is not None and (controller is None or new.orientation != old.orientation):
            new.make_scheme(robot)  # nothing is taken of what is refused
        self._params = new
        try:
            if controller is not None:
                self.change_scheme(controller.scheme, new)
                controller.changed(ControllerOptions.of(new))
            elif robot is not None:
                self.make_scheme(robot)  # what measures at rest goes by them, too
        except ConfigurationError:
            self._params = old
            raise
        changed = [name for name, now in asdict(new).items() if now != getattr(old, name)]
        self.get_logger().info(", ".join(f"{name}: {getattr(new, name)}" for name in changed))

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
            return self._fail(f"not configured: {error}", mode=_UNCONFIGURED)
        self._robot = robot
        p = self._params
        self._input.expect(robot, p.scheme.control == TORQUE and p.commands_joints)
        is_compliant = "compliant_frame" in p.scheme.outputs
        frames = (robot.base_frame, robot.tip_frame) if is_compliant else None
        topic, kind = p.scheme.command, p.command_type
        self._commands = CommandPublisher(self, topic, kind, robot.joints, frames)
        waiting = "configured, waiting for joint_states"
        self._health.set(OK, waiting, mode=_INACTIVE, cause=Cause.NO_STATES)
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
            return self._fail(text, Cause.NO_STATES)
        try:
            self._refuse_while_ending()
            if not self._input.is_simulated and self._input.is_stale:
                raise ConfigurationError("joint_states has stopped; is the robot running?")
            if reason := self.refusal():
                raise ConfigurationError(reason)
            if (why := self._mismatch()).fault:
                return self._fail_for(why)
            scheme = self.make_scheme(robot)
        except EulerParamsError as error:
            self._health.values.update(self.values_now())
            return self._fail(f"not activated: {error}")
        options = ControllerOptions.of(self._params)
        self._controller = Controller(scheme, options, measured[1], self._input.efforts)
        self._activated()
        tell(Event.READY)
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the arm to rest, also after this has returned, then command nothing."""
        self._end_control(lambda: self._health.set(WARN, "inactive", mode=_INACTIVE))
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the arm to rest, then command nothing until configured again."""
        self._end_control(self._forget_robot)
        text = "an error in a transition: unconfigured"
        self._fail(text, Cause.TRANSITION_ERROR, mode=_UNCONFIGURED)
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
        """Bring the arm to rest, if it is controlled, then release it and call ``then``."""
        self._autostart = False  # who stopped it decides when it starts again
        self._deactivated()
        controller = self._controller
        if controller is not None and self._deadline is None:
            self._deadline = steady.now() + LONGEST + 2 * controller.guidance.stop_time
            controller.end()
        self._at_end += then
        self._review_end()

    def _review_end(self) -> None:
        """Release an arm that is brought to rest, once it is there, or cannot be."""
        if self._controller is not None and self._deadline is not None:
            in_time = self._input.is_followed and steady.now() < self._deadline
            if in_time and not self._controller.is_at_rest:
                return
        self.close()

    def close(self) -> None:
        """Release an arm that is still brought to rest, and do what waits for that.

        A robot that is heard gets the command after which none follows.
        """
        controller, is_followed = self._controller, self._input.is_followed
        if controller is not None and self._deadline is not None:
            try:
                if is_followed and (command := controller.last_command()):
                    self._commands.publish(self._stamp, command)
            except Exception as error:  # then none is safe: the robot has to brake itself
                self._health.complain(f"no last command: {defect(error)}", error=True)
            self._controller = self._deadline = None
            self._input.forget()
        while self._at_end:
            self._at_end.pop(0)()

    def _refuse_while_ending(self) -> None:
        if self._controller is not None:
            raise ConfigurationError("the arm is still being brought to rest; try again then")

    def _forget_robot(self) -> None:
        self._robot = None
        self._input.forget()

    def at_rest(self) -> bool:
        """Stop the arm; return whether it is at rest, or nothing is heard of it."""
        self._end_control()
        return self._controller is None

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
                text = f"not activated yet: {reason}"
                self._health.set(WARN, text, mode=_INACTIVE, cause=Cause.REFUSED)
            elif (why := self._mismatch()).fault:
                self._fail_for(why)
            else:
                self.trigger_activate()

    def listen(
        self, kind: Any, topic: str, callback: Any, qos: QoSProfile, *, raw: bool = False
    ) -> Subscription:
        """Listen to a topic; a defect of the callback stops the arm, and does not end the node."""

        @wraps(callback)
        def survive(*message: Any) -> None:
            try:
                callback(*message)
            except Exception as error:
                self._on_defect(error)

        return self.create_subscription(kind, topic, survive, **overridable(qos), raw=raw)

    def _on_defect(self, error: Exception) -> None:
        """Hold still after an error that nobody expected."""
        if self._controller is None:
            mode = _INACTIVE if self._robot else _UNCONFIGURED
            self._fail(defect(error), Cause.DEFECT, REPORT_IT, mode)
        else:
            self._controller.fail_for_good(error)
            self._health.complain(defect(error), error=True)  # while no states come, too
            self._health.say(self._controller)

    def _survive_wrong_transitions(self) -> None:
        """Answer a transition that the state does not have; rclpy would end the process."""
        service = self._service_change_state
        change_state = service.callback

        def survive(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except rclpy_implementation.RCLError as error:
                self._health.complain(f"transition refused: {error}")
                response.success = False
                return response

        service.callback = survive
