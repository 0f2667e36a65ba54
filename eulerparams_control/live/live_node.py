"""The node ``live``: between the open pages and the nodes that they show and command.

All is done by the thread of the executor, 30 times a second; the pages leave their orders at the
desk.  What the robot says 1000 times a second is read when it is shown.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.type_support import check_for_type_support
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.clock import steady
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import EulerParamsError, InvalidMessageError, defect, kind_of
from eulerparams_control.events import Event, tell
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.rotations import Array
from eulerparams_control.live.desk import KEPT, Desk, Order
from eulerparams_control.live.geometry import Passage, passage
from eulerparams_control.live.page import serve, stop
from eulerparams_control.live.panel import BASE, LivePanel
from eulerparams_control.live.scene import Scene
from eulerparams_control.live.view import View
from eulerparams_control.messages.from_ros import (
    JointStateReader,
    quaternion_from_ros,
    vector_from_ros,
    wrench_from_ros,
)
from eulerparams_control.messages.keys import CAUSE, MODE, REMEDY
from eulerparams_control.messages.to_ros import pose_to_ros, vector_to_ros
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.fields import fields_of, from_mapping
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.robot.catalogue import RobotDescription
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.qos import QOS, QOS_LATCHED
from sim_bridge.drive_modes import DriveMode

BRIDGE = "pybullet_bridge"
_HZ = 30.0
_SILENT, _QUIET, _LONG = 0.6, 1.6, 5.0
"""[s] of what comes often, and of what comes once a second, where it commands the arm or not."""

_T = TypeVar("_T")
_ASK_EVERY = 0.5  # [s] for the parameters
_AGAIN = 5.0  # [s] after which the same notice is shown again
_CONFIRMS = 0.5  # [s] in which a service answers
_OFTEN = 2.0  # [Hz] of what tells within _SILENT that its sender is gone
_RESTS = 2.0  # [s] after which a publisher is taken back
_MOMENT = 0.1  # [m] a moment is a force times this
_LAST = Duration(seconds=0.5)  # for the last messages to arrive
_TARGETS = "target_pose", "target_twist", "external_wrench"
_FAR = {"approach", "pass", "home"}  # of a simulated arm only: nobody watches the way
_MOVES = {"drag", "jog", "push", "keep"} | _FAR


class _Call(NamedTuple):
    """A call of a service: until when [s] it is to be answered; None is what comes of no answer."""

    client: Any
    future: Any
    until: float
    then: Callable[[Any], None]


class Newest:
    """The newest message of a topic, taken when it is looked at: no callback for each of them."""

    def __init__(self, node: Node, kind: type[Any], topic: str, depth: int = 1) -> None:
        self._kind, self._message, self.came = kind, None, -math.inf
        check_for_type_support(kind)  # which loads it
        qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT).get_c_qos_profile()
        with node.handle:
            self._handle = rclpy_implementation.Subscription(node.handle, kind, topic, qos)

    def look(self, concerns: Callable[[Any], bool] = lambda _: True) -> Any:
        """Return the newest of those that concern us; None before the first."""
        with self._handle:
            while found := self._handle.take_message(self._kind, False):
                if concerns(found[0]):
                    self._message, self.came = found[0], steady()
        return self._message


class Outlet:
    """A publisher that is there while it is used: others may lead the arm after it."""

    def __init__(self, node: Node, kind: type[Any], topic: str) -> None:
        self._node, self._make = node, partial(node.create_publisher, kind, topic, QOS)
        self._publisher: Any = None
        self._used, self._unheard = -math.inf, None

    def send(self, msg: Any) -> None:
        """Publish a message, later if nobody hears it yet."""
        self._publisher = self._publisher or self._make()
        self._used, self._unheard = steady(), msg
        self.turn()

    def turn(self) -> None:
        """Send what nobody has heard yet; take the publisher back if it is not used."""
        if self._unheard is not None and self._publisher.get_subscription_count():
            self._publisher.publish(self._unheard)
            self._unheard = None
        if self._publisher is not None and steady() - self._used > _RESTS:
            self._node.destroy_publisher(self._publisher)
            self._publisher = self._unheard = None

    def close(self, msg: Any) -> None:
        """Publish a last message, if it is used."""
        if self._publisher is not None:
            self._publisher.publish(msg)
            self._publisher.wait_for_all_acked(_LAST)


class LiveNode(Node):
    """Serves the pages of one controller.

    Args:
        host, port: of the server.
        scheme: of the controller.
        robot: if it is known; else it comes from robot_description.
        start: called once the pages are served; returns what tells, in words, which of the
            processes that it started has ended.

    Raises:
        EulerParamsError: if the pages cannot be served, or nothing be started.
    """

    def __init__(
        self,
        host: str,
        port: int,
        scheme: SchemeInfo,
        robot: RobotDescription | None = None,
        start: Callable[["LiveNode"], Callable[[], str]] = lambda _: str,
    ) -> None:
        super().__init__("live")
        self.done = False
        self._scheme, self._desk, self._began = scheme, Desk(), steady()
        self._prefix = self.get_namespace().strip("/")
        self._said: dict[str, Any] = {}  # the last status of each node
        self._heard: dict[str, float] = {}  # when, each node
        self._refused: dict[str, int] = {}
        self._values: dict[str, Any] = {}
        self._wanted: dict[str, Any] = {}  # to be set: until that is confirmed
        self._calls: list[_Call] = []
        self._asked = self._turned = -math.inf
        self._failed: set[str] = set()  # what was said already
        self._told: dict[tuple[int, str], float] = {}  # when, each page and text
        self._robot: Robot | None = None
        self._reader = JointStateReader(())
        self._q = np.zeros(0)
        self._tip: Placement | None = None
        self._home: Placement | None = None
        self._passage: Passage | None = None
        self._goal: Placement | None = None
        self._stiffness: tuple[Any, Any] = None, None
        self._subscribe(scheme.name)
        self._server = serve(host, port)
        self._panel = LivePanel(self._server, scheme, "eulerparams_control", self._desk.put)
        self._urdf, self._built = "", ("", "", "")
        self._undrawn = "No robot_description has come: nothing is drawn."
        if robot is not None:
            self._urdf = robot.urdf
            self._build(robot.base_frame, robot.tip_frame)
        self._ended = start(self)
        self._server.on_client_disconnect(
            lambda client: self._desk.put(Order(client.client_id + 1, "left"))
        )
        self.create_timer(1 / _HZ, self._turn, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.url = f"http://{host}:{self._server.get_port()}"
        print(f"The page is at {self.url} (dark: {self.url}/?darkMode)", flush=True)
        tell(Event.READY, url=self.url)

    def _subscribe(self, name: str) -> None:
        self._states = Newest(self, JointState, "joint_states", depth=10)
        self._wrench = Newest(self, WrenchStamped, "wrench")
        self._pose = Newest(self, PoseStamped, f"{name}/pose")
        self._desired = Newest(self, MultiDOFJointTrajectory, f"{name}/desired")
        self._compliant = Newest(self, MultiDOFJointTrajectory, "compliant_frame")
        self.create_subscription(String, "robot_description", self._on_description, QOS_LATCHED)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._target = Outlet(self, PoseStamped, "target_pose")
        self._jog = Outlet(self, TwistStamped, "target_twist")
        self._push = Outlet(self, WrenchStamped, "external_wrench")
        self._get = self.create_client(GetParameters, f"{name}/get_parameters")
        self._set = self.create_client(SetParameters, f"{name}/set_parameters")
        services = {"halt": name, "resume": name, "unlock": BRIDGE}
        self._triggers = {
            service: self.create_client(Trigger, f"{node}/{service}")
            for service, node in services.items()
        }

    def close(self) -> None:
        """End jog and push, and the pages."""
        try:
            self._push.close(self._wrench_message(np.zeros(6)))
        finally:
            try:
                self._jog.close(TwistStamped())
            finally:
                stop(self._server)

    # --- what is heard -------------------------------------------------------------------

    def _on_description(self, msg: String) -> None:
        self._urdf = msg.data

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            prefix, _, name = status.name.rpartition("/")
            if prefix != self._prefix or name not in (self._scheme.name, BRIDGE):
                continue
            values = {entry.key: entry.value for entry in status.values}
            self._said[name] = status.level[0], status.message, values
            self._heard[name] = steady()
            refused = sum(int(values.get(f"{topic} rejected", 0)) for topic in _TARGETS)
            if refused > self._refused.get(name, refused):
                self._notify("Not taken", values.get("last rejected", ""))
            self._refused[name] = refused

    def _build(self, base: str, tip: str) -> None:
        """Draw the robot, if it is another one than before."""
        if not self._urdf or self._built == (self._urdf, base, tip):
            return
        self._built = self._urdf, base, tip
        self._undrawn = "The robot cannot be drawn."
        self._robot = self._tip = self._home = self._passage = None
        self._desk.let_go(steady())
        self._server.scene.reset()
        try:
            robot = Robot(self._urdf, base, tip)
            self._scene = Scene(self._server, robot, self._urdf, self._on_drag)
        except (EulerParamsError, OSError, ValueError) as error:
            self._undrawn = f"The robot cannot be drawn: {error}"
        else:
            self._undrawn = ""
            self._robot, self._reader = robot, JointStateReader(robot.joints)

    # --- parameters ----------------------------------------------------------------------

    def _exchange(self, now: float) -> None:
        """Set what is wanted, and ask for what there is."""
        busy = [call.client for call in self._calls]
        if self._wanted and not self._set.service_is_ready():
            self._wanted.clear()
            self._alarm("Not set", "The controller is not there.")
        if self._wanted and self._set not in busy:
            sent = dict(self._wanted)
            parameters = [_parameter(*entry).to_parameter_msg() for entry in sent.items()]
            request = SetParameters.Request(parameters=parameters)
            self._ask(self._set, request, now, partial(self._on_set, sent))
        due = now > self._asked + _ASK_EVERY and self._get not in busy
        if due and self._get.service_is_ready():
            self._asked, names = now, list(fields_of(self._scheme.parameters))
            request = GetParameters.Request(names=names)
            self._ask(self._get, request, now, partial(self._on_parameters, names))

    def _ask(self, client: Any, request: Any, now: float, then: Callable[[Any], None]) -> None:
        self._calls.append(_Call(client, client.call_async(request), now + _CONFIRMS, then))

    def _hear(self, now: float) -> None:
        """Take what services have answered, or not in time, ``now`` [s] being the last turn."""
        for call in self._calls[:]:
            if call.future.done() or now > call.until:
                self._calls.remove(call)
                call.client.remove_pending_request(call.future)
                call.then(call.future.result() if call.future.done() else None)

    def _on_set(self, sent: dict[str, Any], answer: Any) -> None:
        if answer is None:
            text = f"{', '.join(sent)} was not confirmed within {_CONFIRMS:g} s: it is sent again."
            self._alarm("Not set", text)
            return
        for (name, value), result in zip(sent.items(), answer.results, strict=True):
            if self._wanted.get(name) == value:
                del self._wanted[name]
            if result.successful:
                self._values = self._values | {name: value}
            else:
                self._notify("The controller refuses this", result.reason)
        self._asked = -math.inf  # ask what they are now

    def _on_parameters(self, names: list[str], answer: Any) -> None:
        if answer is not None:
            values = map(parameter_value_to_python, answer.values)
            self._values = dict(zip(names, values, strict=True))

    # --- orders --------------------------------------------------------------------------

    def _on_drag(self, page: int, phase: str, at: Placement) -> None:
        self._desk.put(Order(page, "drag", (phase, at)))

    def _obey(self, order: Order, now: float) -> None:
        desk, value = self._desk, order.value
        if order.name in _MOVES and not desk.may(order.page, now):
            self._notify("Wait", f"Page {desk.owner} moves the arm.", order.page)
            return
        if order.name in _FAR and not self._is_simulated(now):
            self._notify("Not taken", "Only a simulated arm is sent there.", order.page)
            return
        match order.name:
            case "halt" | "resume":
                self._goal = None
                desk.let_go(now)
                robot = self._said.get(BRIDGE, (0, "", {}))[2].get(MODE)
                if order.name == "resume" and robot == DriveMode.STOPPING:
                    self._call("unlock", now)
                self._call(order.name, now)
            case "set":
                name, number, given = value
                known = self._wanted.get(name, self._values.get(name))
                if known is not None:
                    many = isinstance(known, Sequence) and not isinstance(known, str)
                    new = list(known) if many else [known]
                    new[number] = given
                    self._wanted[name] = new if many else given
            case "left":
                desk.left(order.page, now)
                if self._robot is not None and order.page == self._scene.dragged_by:
                    self._scene.dragged_by = None
            case "let go":
                desk.let_go(now)
            case "drag" if self._robot is not None:
                phase, at = value
                self._scene.dragged_by = None if phase == "end" else order.page
                self._goal = at if phase == "update" else self._goal
            case "jog" | "push" if not desk.holds(order, now):
                desk.let_go(now)
                text = "What it asks for was changed on a page: press the button again."
                self._notify("Not held any longer", text, order.page)
            case "jog":
                _, axis, part, self._jog_axes = value
                desk.jog(_along(axis, part * self._speed(axis)), now)
            case "push" | "keep":
                _, axis, force = value
                wrench = _along(axis, force * (1.0 if axis < 3 else _MOMENT))
                desk.push(wrench, now, *([KEPT] if order.name == "keep" else []))
            case "home":
                self._goal = self._home
            case "approach" | "pass":
                self._to_the_pole(order)

    def _speed(self, axis: int) -> float:
        name = "max_linear_speed" if axis < 3 else "max_angular_speed"
        return float(self._values.get(name) or 0.1)

    def _to_the_pole(self, order: Order) -> None:
        if self._robot is None or self._tip is None:
            return
        sequence = EulerSequence(str(self._values.get("euler_sequence", "XYZ")))
        if order.name == "approach" or self._passage is None:
            self._passage = passage(self._robot, self._q, sequence.axes)
        if self._passage is None:
            text = f"From here the arm reaches no pole of {sequence.name} on both sides; choose "
            self._notify("Out of reach", text + "other Euler angles (Law).", order.page)
            return
        before, beyond = self._passage
        if order.name == "pass":
            self._passage = Passage(beyond, before)
        self._goal = Placement(beyond if order.name == "pass" else before, self._tip.p)

    def _call(self, name: str, now: float) -> None:
        client = self._triggers[name]
        if client.service_is_ready():
            self._ask(client, Trigger.Request(), now, partial(self._on_called, name))
        else:
            self._on_called(name, None)

    def _on_called(self, name: str, answer: Any) -> None:
        what = "use the emergency stop." if name == "halt" else "try again."
        if answer is None:
            self._alarm(f"No {name}", f"{name.capitalize()} was not confirmed: {what}")
        elif not answer.success:
            self._alarm(f"No {name}", f"{answer.message}: {what}")

    def _alarm(self, title: str, text: str) -> None:
        self._notify(title, text, colour="red")

    def _notify(self, title: str, text: str, page: int = 0, colour: Any = "orange") -> None:
        """Show a text on one page, 0: on all; the same only after a while."""
        if steady() < self._told.get((page, text), -math.inf) + _AGAIN:
            return
        self._told[page, text] = steady()
        for number, client in self._server.get_clients().items():
            if page in (0, number + 1):
                client.add_notification(title, text, auto_close_seconds=8.0, color=colour)

    def _guarded(self, what: str, do: Callable[..., _T], *given: Any) -> _T | None:
        """Return what comes of it; None where it fails, which is said once."""
        try:
            return do(*given)
        except Exception as error:
            text = str(error) if isinstance(error, EulerParamsError) else defect(error)
            if kind_of(error) not in self._failed:
                self._failed.add(kind_of(error))
                self._notify(what, text)
                self.get_logger().error(f"{what}: {text}")
            return None

    # --- 30 times a second ---------------------------------------------------------------

    def _turn(self) -> None:
        now = steady()
        for order in self._desk.taken():
            self._guarded("Not taken", self._obey, order, now)
        self._guarded("No answer", self._hear, self._turned)
        self._guarded("Not set", self._exchange, now)
        self._guarded("Not drawn", self._show, now)
        self._guarded("Not sent", self._send, now)
        self._turned = now

    def _show(self, now: float) -> None:
        if p := self._values:
            self._build(str(p["base_frame"] or ""), str(p["tip_frame"] or ""))
        view = self._look(now)
        self._panel.update(view)
        if self._robot is not None:
            if self._scene.dragged_by != self._desk.owner:
                self._scene.dragged_by = None
            self._scene.update(view)

    def _concerns(self, msg: JointState) -> bool:
        return self._robot is None or self._reader.concerns(msg)

    def _is_simulated(self, now: float) -> bool:
        return now - self._heard.get(BRIDGE, -math.inf) < _LONG

    def _send(self, now: float) -> None:
        if self._goal is not None and self._robot is not None:
            p, R = np.asarray(self._goal.p, dtype=float), np.asarray(self._goal.R)
            stamp = PoseStamped().header.stamp  # 0: from its receipt on
            self._target.send(pose_to_ros(p, R, stamp, self._robot.base_frame))
            self._goal = None
        twist, wrench = self._desk.twist(now), self._desk.wrench(now)
        if twist is not None and self._robot is not None:
            msg = TwistStamped()
            is_base = self._jog_axes == BASE
            msg.header.frame_id = self._robot.base_frame if is_base else self._robot.tip_frame
            msg.twist.linear, msg.twist.angular = map(vector_to_ros, np.split(twist, 2))
            self._jog.send(msg)
        if wrench is not None:
            self._push.send(self._wrench_message(wrench))
        for outlet in (self._target, self._jog, self._push):
            outlet.turn()

    def _wrench_message(self, wrench: Array) -> WrenchStamped:
        """Return a wrench (6,) along the axes of the base, in the frame of the sensor."""
        msg, felt = WrenchStamped(), self._wrench.look()
        if felt is not None and (R := self._sensor_axes(felt)) is not None:
            msg.header.frame_id = felt.header.frame_id
            msg.wrench.force, msg.wrench.torque = (
                vector_to_ros(R.T @ part) for part in np.split(wrench, 2)
            )
        return msg

    def _sensor_axes(self, felt: WrenchStamped) -> Array | None:
        """Return the axes (3, 3) of the sensor, seen from the base."""
        frame = str(self._values.get("wrench_frame") or felt.header.frame_id)
        if self._robot is None or self._tip is None:
            return None
        at = self._guarded("No force; set wrench_frame", self._robot.placement, frame)
        return None if at is None else np.asarray(self._tip.R) @ np.asarray(at.R)

    def _force(self, felt: WrenchStamped) -> Array | None:
        """Return the force (3,) [N] of the contact on the tool, seen from the base."""
        if (R := self._sensor_axes(felt)) is None:
            return None
        sign = float(self._values.get("wrench_sign") or 1.0)
        return sign * R @ wrench_from_ros(felt, felt.header.frame_id)[:3]

    def _arm(self, states: JointState) -> tuple[dict[str, float], float]:
        """Return the joints [rad or m] by name, and the speed of the fastest [rad/s or m/s]."""
        _, self._q, dq = self._reader.from_ros(states)
        if self._robot is not None:
            arm = self._robot.state(self._q, 0.0 * dq)
            self._tip = Placement(arm.R_e, arm.p_e)
            self._home = self._home or self._tip
        named = zip(states.name, states.position, strict=True)
        return {name: x for name, x in named if math.isfinite(x)}, float(np.abs(dq).max())

    def _look(self, now: float) -> View:
        """Gather what is known."""
        states, wrench = self._states.look(self._concerns), self._wrench.look()
        level, message, values = self._said.get(self._scheme.name, (0, "", {}))
        moved = force = None
        if states is not None and self._robot is not None:
            moved = self._guarded("joint_states cannot be read", self._arm, states)
        if wrench is not None:
            force = self._guarded("The wrench cannot be read", self._force, wrench)
        joints, speed = moved or ({}, 0.0)
        desired, compliant = (
            self._guarded("A frame cannot be read", _frame, topic.look())
            for topic in (self._desired, self._compliant)
        )
        self._pose.look()
        bridge = self._said.get(BRIDGE, (0, "", {}))
        clients = self._server.get_clients()
        return View(
            mode=values.get(MODE, ""),
            cause=values.get(CAUSE, ""),
            level=level,
            message=message,
            remedy=values.get(REMEDY, ""),
            robot=f"{bridge[1]}. {bridge[2].get(REMEDY, '')}" if bridge[0] else "",
            trouble=self._what_is_wrong(now),
            joints=joints,
            speed=speed,
            tip=self._tip,
            desired=desired,
            compliant=compliant,
            force=force,
            parameters=self._values,
            stiffness=self._stiffness_now(desired),
            is_simulated=self._is_simulated(now),
            can_push=force is not None and self.count_subscribers("external_wrench") > 0,
            owner=self._desk.owner,
            pages=len(clients),
        )

    def _what_is_wrong(self, now: float) -> str:
        """Return which node is gone or silent, in words; "" if none is."""
        if ended := self._ended():
            return ended
        name, mode = self._scheme.name, self._said.get(self._scheme.name, (0, "", {}))[2].get(MODE)
        silence = now - max(self._states.came, self._began)
        if silence > _SILENT:
            what = "none has come yet" if self._states.came < 0 else f"for {silence:.0f} s"
            return f"No joint_states, {what}: does the robot run?"
        often = mode in (Mode.HOLDING, Mode.FOLLOWING) and (
            self._values.get("state_rate", 0.0) >= _OFTEN
        )
        silence = now - max(self._heard.get(name, 0.0), self._pose.came, self._began)
        if silence > (_SILENT if often else _QUIET):
            return f"{name} is silent for {silence:.0f} s: has it ended? Nothing commands the arm."
        return self._undrawn

    def _stiffness_now(self, desired: Placement | None) -> Array | None:
        """Return the stiffness (3, 3) [N/m] along the axes of the base, if there is one."""
        values, known = self._values, self._stiffness[0]
        if values is not known and values.get("K_p") is not None:
            try:
                found = from_mapping(self._scheme.parameters, values)
                self._stiffness = values, (found.translation().K, found.translational_frame)
            except EulerParamsError:
                self._stiffness = values, None
        if self._stiffness[1] is None:
            return None
        K, axes = self._stiffness[1]
        R = np.eye(3) if axes == BASE or desired is None else np.asarray(desired.R)
        return R @ np.asarray(K) @ R.T


def _frame(msg: Any) -> Placement | None:
    """Return where the only point of a message is."""
    if msg is None or not msg.points or not msg.points[0].transforms:
        return None
    at = msg.points[0].transforms[0]
    p = vector_from_ros(at.translation)
    if not np.isfinite(p).all():
        raise InvalidMessageError(f"a frame is at {p.tolist()}; expected finite numbers")
    return Placement(quaternion_from_ros(at.rotation).R, p)


def _along(axis: int, size: float) -> Array:
    return size * np.eye(6)[axis]


def _parameter(name: str, value: Any) -> Parameter:
    if isinstance(value, list) and not value:
        return Parameter(name, Parameter.Type.DOUBLE_ARRAY, [])
    return Parameter(name, value=value)
