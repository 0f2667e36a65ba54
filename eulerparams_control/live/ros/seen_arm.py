"""The arm as the pages show it: its joints, tip, frames and contact, of the newest messages."""

import math
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.rotations import Array
from eulerparams_control.live.geometry import Passage, passage, stiffness_of
from eulerparams_control.live.page import Notices
from eulerparams_control.live.ros.exchange import Exchange
from eulerparams_control.live.ros.topics import Newest
from eulerparams_control.live.view import View
from eulerparams_control.messages.from_ros import (
    JointStateReader,
    quaternion_from_ros,
    vector_from_ros,
    wrench_from_ros,
)
from eulerparams_control.messages.to_ros import vector_to_ros
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.schemes import SchemeInfo
from eulerparams_control.robot.robot import Robot


class SeenArm:
    """What is known of the arm.

    Args:
        node: that listens.
        scheme: of the controller.
        exchange: has its parameters.
        notices: say what cannot be read.

    Attributes:
        robot: None while none is known.
        tip, home: where the tip is, and was at first, seen from the base; None: not known.
        states, pose: of joint_states, and of the controller.
    """

    def __init__(
        self, node: Node, scheme: SchemeInfo, exchange: Exchange, notices: Notices
    ) -> None:
        self._scheme, self._exchange, self._notices = scheme, exchange, notices
        self.states = Newest(node, JointState, "joint_states", depth=10)
        self._wrench = Newest(node, WrenchStamped, "wrench")
        self.pose = Newest(node, PoseStamped, f"{scheme.name}/pose")
        self._desired = Newest(node, MultiDOFJointTrajectory, f"{scheme.name}/desired")
        self._compliant = Newest(node, MultiDOFJointTrajectory, "compliant_frame")
        self._reader, self._q = JointStateReader(()), np.zeros(0)
        self._stiffness: tuple[Any, Any] = None, None
        self.expect(None)

    def expect(self, robot: Robot | None) -> None:
        """See this robot from now on."""
        self.robot = robot
        self.tip: Placement | None = None
        self.home: Placement | None = None
        self._passage: Passage | None = None
        if robot is not None:
            self._reader = JointStateReader(robot.joints)

    def look(self) -> View:
        """Return what is seen now: the part of a view that is of the arm."""
        guarded = self._notices.guarded
        states, wrench = self.states.look(self._concerns), self._wrench.look()
        moved = force = None
        if states is not None and self.robot is not None:
            moved = guarded("joint_states cannot be read", self._move, states)
        if wrench is not None:
            force = guarded("The wrench cannot be read", self._force, wrench)
        joints, speed = moved or ({}, 0.0)
        desired, compliant = (
            guarded("A frame cannot be read", _frame, topic.look())
            for topic in (self._desired, self._compliant)
        )
        self.pose.look()
        return View(
            joints=joints,
            speed=speed,
            tip=self.tip,
            desired=desired,
            compliant=compliant,
            force=force,
            stiffness=self._stiffness_now(desired),
        )

    def _concerns(self, msg: JointState) -> bool:
        return self.robot is None or self._reader.concerns(msg)

    def _move(self, states: JointState) -> tuple[dict[str, float], float]:
        """Return the joints [rad or m] by name, and the speed of the fastest [rad/s or m/s]."""
        _, self._q, dq = self._reader.from_ros(states)
        if self.robot is not None:
            arm = self.robot.state(self._q, 0.0 * dq)
            self.tip = Placement(arm.R_e, arm.p_e)
            self.home = self.home or self.tip
        named = zip(states.name, states.position, strict=True)
        return {name: x for name, x in named if math.isfinite(x)}, float(np.abs(dq).max())

    def _sensor_axes(self, felt: WrenchStamped) -> Array | None:
        """Return the axes (3, 3) of the sensor, seen from the base."""
        frame = str(self._exchange.values.get("wrench_frame") or felt.header.frame_id)
        if self.robot is None or self.tip is None:
            return None
        text = "No force; set wrench_frame"
        at = self._notices.guarded(text, self.robot.placement, frame)
        return None if at is None else np.asarray(self.tip.R) @ np.asarray(at.R)

    def _force(self, felt: WrenchStamped) -> Array | None:
        """Return the force (3,) [N] of the contact on the tool, seen from the base."""
        if (R := self._sensor_axes(felt)) is None:
            return None
        sign = float(self._exchange.values.get("wrench_sign") or 1.0)
        return sign * R @ wrench_from_ros(felt, felt.header.frame_id)[:3]

    def wrench_to_ros(self, wrench: Array) -> WrenchStamped:
        """Return a wrench (6,) along the axes of the base, in the frame of the sensor."""
        msg, felt = WrenchStamped(), self._wrench.look()
        if felt is not None and (R := self._sensor_axes(felt)) is not None:
            msg.header.frame_id = felt.header.frame_id
            msg.wrench.force, msg.wrench.torque = (
                vector_to_ros(R.T @ part) for part in np.split(wrench, 2)
            )
        return msg

    def _stiffness_now(self, desired: Placement | None) -> Array | None:
        """Return the stiffness (3, 3) [N/m] along the axes of the base, if there is one."""
        values, known = self._exchange.values, self._stiffness[0]
        if values is not known:
            self._stiffness = values, stiffness_of(self._scheme, values)
        if self._stiffness[1] is None:
            return None
        K, axes = self._stiffness[1]
        R = np.eye(3) if axes == "base" or desired is None else np.asarray(desired.R)
        return R @ np.asarray(K) @ R.T

    def beside_pole(self, *, beyond: bool, page: int) -> Placement | None:
        """Return where the tip is before a pole of the Euler angles, or beyond it.

        Where it goes beyond, the next way is back.  None if the arm reaches no pole, which is said
        on a page.
        """
        if self.robot is None or self.tip is None:
            return None
        sequence = EulerSequence(str(self._exchange.values.get("euler_sequence", "XYZ")))
        if not beyond or self._passage is None:
            self._passage = passage(self.robot, self._q, sequence.axes)
        if self._passage is None:
            text = f"From here the arm reaches no pole of {sequence.name} on both sides; choose "
            self._notices.show("Out of reach", text + "other Euler angles (Law).", page)
            return None
        before, there = self._passage
        if beyond:
            self._passage = Passage(there, before)
        return Placement(there if beyond else before, self.tip.p)


def _frame(msg: Any) -> Placement | None:
    """Return where the only point of a message is."""
    if msg is None or not msg.points or not msg.points[0].transforms:
        return None
    at = msg.points[0].transforms[0]
    p = vector_from_ros(at.translation)
    if not np.isfinite(p).all():
        raise InvalidMessageError(f"a frame is at {p.tolist()}; expected finite numbers")
    return Placement(quaternion_from_ros(at.rotation).R, p)
