"""What the pages ask for: obeyed, or refused; and what is sent to the arm for it."""

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node

from eulerparams_control.laws.rotations import Array
from eulerparams_control.live.desk import KEPT, Deed, Desk, Order
from eulerparams_control.live.page import Notices
from eulerparams_control.live.panel import BASE
from eulerparams_control.live.ros.exchange import Exchange
from eulerparams_control.live.ros.reports import NodeReports
from eulerparams_control.live.ros.seen_arm import SeenArm
from eulerparams_control.live.ros.topics import Outlet
from eulerparams_control.live.scene import Scene
from eulerparams_control.messages.to_ros import pose_to_ros, vector_to_ros
from eulerparams_control.motion.frames import Placement
from sim_bridge.drive_modes import DriveMode

_MOMENT = 0.1  # [m] a moment is a force times this


class Pilot:
    """Leads the arm as the pages ask.

    Args:
        node: that publishes.
        exchange: with the nodes that are commanded.
        arm: that is led.
        reports: of controller and robot.
        notices: say what is refused.

    Attributes:
        desk: where the pages leave their orders.
        scene: in which the target is dragged; None while no arm is drawn.
    """

    def __init__(
        self, node: Node, exchange: Exchange, arm: SeenArm, reports: NodeReports, notices: Notices
    ) -> None:
        self.desk = Desk()
        self.scene: Scene | None = None
        self._exchange, self._arm, self._reports, self._notices = exchange, arm, reports, notices
        self._target = Outlet(node, PoseStamped, "target_pose")
        self._jog = Outlet(node, TwistStamped, "target_twist")
        self._push = Outlet(node, WrenchStamped, "external_wrench")
        self._goal: Placement | None = None
        self._jog_axes: Any = BASE
        self._grip = 0  # how often the arm had stopped when the mouse took the target

    def close(self) -> None:
        """End jog and push."""
        try:
            self._push.close(self._arm.wrench_to_ros(np.zeros(6)))
        finally:
            self._jog.close(TwistStamped())

    def drag(self, page: int, phase: str, at: Placement) -> None:
        """Leave the order of a page to drag the target; any thread may."""
        self.desk.put(Order(page, Deed.DRAG, (phase, at)))

    def turn(self, now: float) -> None:
        """Obey the orders that have come."""
        for order in self.desk.taken():
            self._notices.guarded("Not taken", self._obey, order, now)

    def _obey(self, order: Order, now: float) -> None:
        deed, desk = order.deed, self.desk
        if deed is Deed.DRAG and order.value[0] == "end":
            self._end_drag(order.page)
            return
        if not self._may(order, now):
            return
        match deed:
            case Deed.HALT | Deed.RESUME:
                self.let_go(now)
                self._exchange.forget()
                if deed is Deed.RESUME and self._reports.of_robot.mode == DriveMode.STOPPING:
                    # halted, the commands begin where the arm is: then the robot takes them
                    self._exchange.call(Deed.HALT, Deed.RESUME, "unlock")
                else:
                    self._exchange.call(deed)
            case Deed.SET:
                self._exchange.want(*order.value)
            case Deed.LEFT:
                if order.page == desk.owner:
                    self.let_go(now)
                desk.left(order.page, now)
                self._end_drag(order.page)
            case Deed.RELEASE:
                desk.let_go(now)
            case Deed.JOG | Deed.PUSH if not desk.holds(order, now):
                desk.let_go(now)
                text = "What it asks for was changed on a page: let go, wait, press it again."
                self._notices.show("Not held any longer", text, order.page)
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
        elif not self.desk.may(order.page, now):
            title, why = "Wait", f"Page {self.desk.owner} moves the arm."
        elif deed.is_far and not self._reports.is_simulated(now):
            why = "Only a simulated arm is sent there."
        if why:
            self._notices.show(title, why, order.page)
        return not why

    def _dragged(self, order: Order, scene: Scene) -> Placement | None:
        """Return where a target is dragged to; None at first, and if it is not to be any more."""
        phase, at = order.value
        if phase == "start":
            scene.dragged_by, self._grip = order.page, self._reports.stops
            return None
        if scene.dragged_by == order.page and self._grip == self._reports.stops:
            goal: Placement = at
            return goal
        text = "The arm stopped, or another page moved it meanwhile: drag the target again."
        self._notices.show("Not taken", text, order.page)
        return None

    def _end_drag(self, page: int) -> None:
        if self.scene is not None and self.scene.dragged_by == page:
            self.scene.dragged_by = None

    def let_go(self, now: float) -> None:
        """End what was asked for, also what nobody has heard yet."""
        self._goal = None
        self.desk.let_go(now)
        self._target.forget()
        self._jog.forget()

    def _goal_of(self, order: Order) -> Placement | None:
        """Return the goal that an order names; None: none."""
        if order.deed is Deed.HOME:
            return self._arm.home
        if order.deed is not Deed.DRAG:
            return self._arm.beside_pole(beyond=order.deed is Deed.PASS, page=order.page)
        if self.scene is None or self._arm.tip is None:
            return None
        return self._dragged(order, self.scene)

    def _speed(self, axis: int) -> float:
        name = "max_linear_speed" if axis < 3 else "max_angular_speed"
        return float(self._exchange.values.get(name) or 0.1)

    def send(self, now: float) -> None:
        """Send what is asked for now."""
        robot = self._arm.robot
        if self._goal is not None and robot is not None:
            p, R = np.asarray(self._goal.p, dtype=float), np.asarray(self._goal.R)
            stamp = PoseStamped().header.stamp  # 0: from its receipt on
            self._target.send(pose_to_ros(p, R, stamp, robot.base_frame))
            self._goal = None
        twist, wrench = self.desk.twist(now), self.desk.wrench(now)
        if twist is not None and robot is not None:
            msg = TwistStamped()
            is_base = self._jog_axes == BASE
            msg.header.frame_id = robot.base_frame if is_base else robot.tip_frame
            msg.twist.linear, msg.twist.angular = map(vector_to_ros, np.split(twist, 2))
            self._jog.send(msg)
        if wrench is not None:
            self._push.send(self._arm.wrench_to_ros(wrench))
        for outlet in (self._target, self._jog, self._push):
            outlet.turn()


def _along(axis: int, size: float) -> Array:
    return size * np.eye(6)[axis]
