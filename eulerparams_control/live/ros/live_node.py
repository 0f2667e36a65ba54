"""The node ``live``: between the open pages and the nodes that they show and command.

All is done by the thread of the executor, 30 times a second; the pages leave their orders at the
desk.  What the robot says 1000 times a second is read when it is shown.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.clock import steady
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import EulerParamsError, InvalidMessageError, defect, kind_of
from eulerparams_control.events import Event, tell
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.rotations import Array
from eulerparams_control.live.desk import KEPT, Deed, Desk, Order
from eulerparams_control.live.geometry import Passage, passage, stiffness_of
from eulerparams_control.live.page import serve, stop
from eulerparams_control.live.panel import BASE, LivePanel
from eulerparams_control.live.ros.exchange import Exchange
from eulerparams_control.live.ros.topics import Newest, Outlet
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
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.robot.catalogue import RobotDescription
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.qos import QOS_LATCHED
from sim_bridge.drive_modes import DriveMode

BRIDGE = "pybullet_bridge"
_HZ = 30.0
_SILENT = 0.6  # [s] without what comes often, after which that is said
_QUIET = 1.6  # [s] the same, of what comes once a second
_LONG = 5.0  # [s] without a word of the simulated robot, after which there is none

_STOPPED = Mode.STOPPED, Mode.RELEASING

_T = TypeVar("_T")
_AGAIN = 5.0  # [s] after which the same notice is shown again
_OFTEN = 2.0  # [Hz] of what tells within _SILENT that its sender is gone
_MOMENT = 0.1  # [m] a moment is a force times this
_TARGETS = "target_pose", "target_twist", "external_wrench"


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
        self._scheme, self._desk, self._began = scheme, Desk(), steady.now()
        self._prefix = self.get_namespace().strip("/")
        self._said: dict[str, Any] = {}  # the last status of each node
        self._heard: dict[str, float] = {}  # when, each node
        self._refused: dict[str, int] = {}
        self._turned = -math.inf
        self._stops = self._grip = 0  # of the arm: now, and when the mouse took the target
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
        self._server.on_client_connect(self._on_page)
        self._server.on_client_disconnect(
            lambda client: self._desk.put(Order(client.client_id + 1, Deed.LEFT))
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
        self._exchange = Exchange(
            self,
            name,
            list(fields_of(self._scheme.parameters)),
            {Deed.HALT: name, Deed.RESUME: name, "unlock": BRIDGE},
            self._notify,
            self._alarm,
        )

    @property
    def _values(self) -> dict[str, Any]:
        """Parameters of the controller, by name."""
        return self._exchange.values

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
            if prefix == self._prefix and name in (self._scheme.name, BRIDGE):
                self._guarded("A status cannot be read", self._take_status, name, status)

    def _take_status(self, name: str, status: DiagnosticStatus) -> None:
        values = {entry.key: entry.value for entry in status.values}
        before = self._said.get(name, (0, "", {}))[2].get(MODE)
        self._said[name] = status.level[0], status.message, values
        if name == self._scheme.name and values.get(MODE) in _STOPPED and before not in _STOPPED:
            self._stops += 1
        self._heard[name] = steady.now()
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
        self._let_go(steady.now())
        self._server.scene.reset()
        try:
            robot = Robot(self._urdf, base, tip)
            self._scene = Scene(self._server, robot, self._urdf, self._on_drag)
        except (EulerParamsError, OSError, ValueError) as error:
            self._undrawn = f"The robot cannot be drawn: {error}"
        else:
            self._undrawn = ""
            self._robot, self._reader = robot, JointStateReader(robot.joints)
            for client in self._server.get_clients().values():
                self._scene.show_to(client.camera)

    # --- orders --------------------------------------------------------------------------

    def _on_page(self, client: Any) -> None:
        if self._robot is not None:
            self._scene.show_to(client.camera)

    def _on_drag(self, page: int, phase: str, at: Placement) -> None:
        self._desk.put(Order(page, Deed.DRAG, (phase, at)))

    def _obey(self, order: Order, now: float) -> None:
        deed, desk = order.deed, self._desk
        if deed is Deed.DRAG and order.value[0] == "end":
            self._end_drag(order.page)
            return
        if not self._may(order, now):
            return
        match deed:
            case Deed.HALT | Deed.RESUME:
                self._let_go(now)
                self._exchange.forget()
                drive = self._said.get(BRIDGE, (0, "", {}))[2].get(MODE)
                if deed is Deed.RESUME and drive == DriveMode.STOPPING:
                    # halted, the commands begin where the arm is: then the robot takes them
                    self._exchange.call(Deed.HALT, Deed.RESUME, "unlock")
                else:
                    self._exchange.call(deed)
            case Deed.SET:
                self._exchange.want(*order.value)
            case Deed.LEFT:
                if order.page == desk.owner:
                    self._let_go(now)
                desk.left(order.page, now)
                self._end_drag(order.page)
            case Deed.RELEASE:
                desk.let_go(now)
            case Deed.JOG | Deed.PUSH if not desk.holds(order, now):
                desk.let_go(now)
                text = "What it asks for was changed on a page: let go, wait, press it again."
                self._notify("Not held any longer", text, order.page)
            case Deed.JOG:
                _, axis, part, self._jog_axes = order.value
                self._goal = None
                self._target.forget()
                desk.jog(_along(axis, part * self._speed(axis)), order.at)
            case Deed.PUSH | Deed.KEEP:
                _, axis, force = order.value
                wrench = _along(axis, force * (1.0 if axis < 3 else _MOMENT))
                if deed is Deed.KEEP:
                    desk.push(wrench, now, KEPT)
                else:
                    desk.push(wrench, order.at)
            case Deed.DRAG | Deed.HOME | Deed.APPROACH | Deed.PASS:
                goal = self._goal_of(order)
                if goal is not None:
                    self._goal = goal
                    desk.end_jog()
                    self._jog.forget()

    def _may(self, order: Order, now: float) -> bool:
        """Return whether an order may be obeyed; say why not."""
        title, why, deed = "Not taken", "", order.deed
        if order.is_late(now):
            if deed.is_held:
                return False  # the button sends another, if it is still held
            why = "The page, or this computer, was too slow: do it again."
        elif not deed.moves:
            return True
        elif not self._desk.may(order.page, now):
            title, why = "Wait", f"Page {self._desk.owner} moves the arm."
        elif deed.is_far and not self._is_simulated(now):
            why = "Only a simulated arm is sent there."
        if why:
            self._notify(title, why, order.page)
        return not why

    def _dragged(self, order: Order) -> Placement | None:
        """Return where a target is dragged to; None at first, and if it is not to be any more."""
        phase, at = order.value
        if phase == "start":
            self._scene.dragged_by, self._grip = order.page, self._stops
            return None
        if self._scene.dragged_by == order.page and self._grip == self._stops:
            goal: Placement = at
            return goal
        text = "The arm stopped, or another page moved it meanwhile: drag the target again."
        self._notify("Not taken", text, order.page)
        return None

    def _end_drag(self, page: int) -> None:
        if self._robot is not None and self._scene.dragged_by == page:
            self._scene.dragged_by = None

    def _let_go(self, now: float) -> None:
        """End what was asked for, also what nobody has heard yet."""
        self._goal = None
        self._desk.let_go(now)
        self._target.forget()
        self._jog.forget()

    def _goal_of(self, order: Order) -> Placement | None:
        """Return the goal that an order names; None: none."""
        if order.deed is Deed.HOME:
            return self._home
        if self._robot is None or self._tip is None:
            return None
        if order.deed is Deed.DRAG:
            return self._dragged(order)
        sequence = EulerSequence(str(self._values.get("euler_sequence", "XYZ")))
        if order.deed is Deed.APPROACH or self._passage is None:
            self._passage = passage(self._robot, self._q, sequence.axes)
        if self._passage is None:
            text = f"From here the arm reaches no pole of {sequence.name} on both sides; choose "
            self._notify("Out of reach", text + "other Euler angles (Law).", order.page)
            return None
        before, beyond = self._passage
        if order.deed is Deed.PASS:
            self._passage = Passage(beyond, before)
        return Placement(beyond if order.deed is Deed.PASS else before, self._tip.p)

    def _speed(self, axis: int) -> float:
        name = "max_linear_speed" if axis < 3 else "max_angular_speed"
        return float(self._values.get(name) or 0.1)

    def _alarm(self, title: str, text: str) -> None:
        self._notify(title, text, colour="red")

    def _notify(
        self, title: str, text: str, page: int = 0, colour: Any = "orange", about: str = ""
    ) -> None:
        """Show a text on one page, 0: on all; the same, or one about the same, after a while."""
        now = steady.now()
        self._told = {said: t for said, t in self._told.items() if now < t + _AGAIN}
        if (page, about or text) in self._told:
            return
        self._told[page, about or text] = now
        for number, client in self._server.get_clients().items():
            if page in (0, number + 1):
                client.add_notification(title, text, auto_close_seconds=8.0, color=colour)

    def _guarded(self, what: str, do: Callable[..., _T], *given: Any) -> _T | None:
        """Return what comes of it; None where it fails, which is said, and logged once."""
        try:
            return do(*given)
        except Exception as error:
            text = str(error) if isinstance(error, EulerParamsError) else defect(error)
            self._notify(what, text, colour="red", about=f"{what}: {kind_of(error)}")
            if kind_of(error) not in self._failed:
                self._failed.add(kind_of(error))
                self.get_logger().error(f"{what}: {text}")
            return None

    # --- 30 times a second ---------------------------------------------------------------

    def _turn(self) -> None:
        now = steady.now()
        for order in self._desk.taken():
            self._guarded("Not taken", self._obey, order, now)
        self._guarded("No answer", self._exchange.hear, self._turned)
        self._guarded("Not set", self._exchange.turn, now)
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
        if values is not known:
            self._stiffness = values, stiffness_of(self._scheme, values)
        if self._stiffness[1] is None:
            return None
        K, axes = self._stiffness[1]
        R = np.eye(3) if axes == "base" or desired is None else np.asarray(desired.R)
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
