"""The robot arm on Pinocchio: from joint values to the frozen state that the laws take.

Pinocchio's world is the base frame here, and its reference frame LOCAL_WORLD_ALIGNED: everything
is in axes of the base frame, and about the origin of the tip.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from eulerparams_control.errors import RobotError
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import AT_ORIGIN, Placement
from eulerparams_control.robot.urdf import (
    UrdfTree,
    joint_friction,
    joint_limits,
    refuse_motionless,
)

_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
_LINK = pin.FrameType.BODY  # a joint may have the name of a link

_LENGTH_OF_REACH = 0.8
_MAX_REACH = 100.0  # [m] whatever the limits of a rail say


class Reach(NamedTuple):
    """A sphere that the tip never leaves, though it does not reach all points of it."""

    centre: Array  # (3,) [m] the first joint, base frame
    radius: float  # [m] the sum of the links from there on, and of how far joints slide

    def distance(self, p: Array) -> float:
        """Return the distance [m] of a position (3,) from the first joint."""
        return math.dist(p, self.centre)


class RobotState(NamedTuple):
    """Kinematics of the arm in the base frame; having them proves that they are up to date."""

    q: Array  # (n,) [rad or m] joint positions, in the order of Robot.joints
    dq: Array  # (n,) [rad/s or m/s]
    p_e: Array  # (3,) [m] origin of the tip, eq. (18)
    R_e: Array  # (3, 3) orientation of the tip, eq. (19)
    dp_e: Array  # (3,) [m/s] velocity of the tip, eq. (20)
    omega_e: Array  # (3,) [rad/s] angular velocity of the tip, eq. (20)
    J: Array  # (6, n) geometric Jacobian, linear part first, eq. (20)


class DynamicState(NamedTuple):
    """Kinematics and dynamics of the arm at one instant: the terms of eq. (32)."""

    arm: RobotState
    dJ_dq: Array  # (6,) [m/s^2, rad/s^2] dJ dq, the acceleration of the tip at ddq = 0
    B: Array  # (n, n) [kg m^2] joint inertia
    C_dq: Array  # (n,) [Nm] Coriolis and centrifugal efforts C dq
    g: Array  # (n,) [Nm] gravitational efforts


class Tool(NamedTuple):
    """A body fixed to a frame, as a tool that the URDF does not have to the tip."""

    mass: float  # [kg]
    com: Array  # (3,) [m] centre of mass
    inertia: Array  # (3, 3) [kg m^2] about that, axes of the frame


class Robot:
    """A serial arm of n active joints, from a URDF; for one thread at a time.

    Joints that are not active (grippers, mimics, other arms) are held at 0 in the model.

    Args:
        urdf: the text of the URDF.
        base_frame: the link that poses and twists refer to; "" is the root.
        tip_frame: the link that is controlled.
        joints: names of the active joints; () is all that move between base and tip.
        gravity: (3,) [m/s^2] in the root link.
        tool: carried at the tip; None if there is none.

    Attributes:
        limits, friction: of the n active joints, as the URDF states them.
        model: Pinocchio's, with the base frame as its world; nq = nv = n.
        gravity: (3,) [m/s^2] in the base frame.
        length: characteristic length [m]: 0.8 times the sum of the distances between successive
            joints, up to the tip, and of the ranges of those that slide; of a UR5 it is 0.99 m.
        mount: joints between the root and the base that could turn it against gravity, held at 0
            in the model too; one that slides, as the lift of a torso does, is none of them.

    Raises RobotError if the URDF is broken, or a frame or joint is not there.
    """

    def __init__(
        self,
        urdf: str,
        base_frame: str,
        tip_frame: str,
        joints: Sequence[str] = (),
        gravity: Sequence[float] = (0.0, 0.0, -9.81),
        tool: Tool | None = None,
    ) -> None:
        tree = self._tree = UrdfTree(urdf)
        self.base_frame = tree.link(base_frame or tree.root, "base_frame")
        self.tip_frame = tree.link(tip_frame, "tip_frame")
        self.joints = tree.moving(self.base_frame, self.tip_frame, joints)
        if not self.joints:
            raise RobotError(
                f"no joint moves between base_frame '{self.base_frame}' and tip_frame "
                f"'{self.tip_frame}'"
            )
        self.n = len(self.joints)
        before = tree.chain(tree.root, self.base_frame)
        self.mount = tuple(j for j in before if tree.kind(j) not in ("fixed", "prismatic"))
        self.is_prismatic = np.array([tree.kind(j) == "prismatic" for j in self.joints])
        active = [tree.joints[joint] for joint in self.joints]
        self.limits = JointLimits(*np.array([joint_limits(joint) for joint in active]).T)
        self.friction = JointFriction(*np.array([joint_friction(joint) for joint in active]).T)

        self.model = _model_of(tree, self.joints, self.base_frame, gravity)
        self._tip = self._id(self.tip_frame)
        if tool is not None:
            tip = self.model.frames[self._tip]
            self.model.inertias[tip.parentJoint] += tip.placement.act(pin.Inertia(*tool))
        self.gravity = np.array(self.model.gravity.linear)
        self._weightless = pin.Model(self.model)
        self._weightless.gravity.linear = np.zeros(3)
        self._data, self._zero = self.model.createData(), np.zeros(self.n)
        self.length, self.reach = self._lengths()

    def refuse_joints(self) -> None:
        """Raise RobotError, with what helps, if the joints from base to tip cannot be controlled.

        One that moves but is not active is held at 0 in the model, and nowhere else.
        """
        tree = self._tree
        for joint in self.joints:
            refuse_motionless(tree.joints[joint])
        others = [j for j in tree.chain(self.base_frame, self.tip_frame) if j not in self.joints]
        if locked := [joint for joint in others if tree.kind(joint) != "fixed"]:
            raise RobotError(
                f"{', '.join(locked)} can move between {self.base_frame} and {self.tip_frame} "
                "but is not among the active joints: set joints: [] if it has a motor, and remove "
                'its <mimic>; else make it type="fixed" in the URDF, or set tip_frame to '
                f"{tree.end(locked[0], 'parent')} or a link before it"
            )

    def refuse_size(self, q: Array, dq: Array) -> None:
        """Raise RobotError unless q and dq are (n,)."""
        if q.shape != (self.n,) or dq.shape != (self.n,):
            raise RobotError(f"q and dq have shapes {q.shape}, {dq.shape}; expected ({self.n},)")

    def placement(self, frame: str, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Placement:
        """Return where a point (3,) [m] of a link is, seen from the tip; "" is the tip.

        Raises RobotError if there is no such link, or a joint can move between it and the tip.
        """
        if frame in ("", self.tip_frame) and not any(offset):
            return AT_ORIGIN
        frame = self._tree.link(frame or self.tip_frame, "frame")
        if moving := self._moving_between(frame, self.tip_frame):
            raise RobotError(
                f"the frame '{frame}' is not fixed to the tip '{self.tip_frame}': "
                f"{', '.join(moving)} can move between them"
            )
        T_e, T = (self.model.frames[self._id(name)].placement for name in (self.tip_frame, frame))
        seen = T_e.actInv(T)
        return Placement(seen.rotation.copy(), seen.act(np.array(offset, dtype=float)))

    def link_at(self, frame: str, q: Array) -> Placement:
        """Return where a link is at q (n,), seen from the base frame; "" is the base frame.

        Raises RobotError if there is no such link, or another joint moves it against the base.
        """
        if frame in ("", self.base_frame):
            return AT_ORIGIN
        moving = self._moving_between(self._tree.link(frame, "frame_id"), self.base_frame)
        if others := [joint for joint in moving if joint not in self.joints]:
            raise RobotError(
                f"where the frame '{frame}' is depends on {', '.join(others)}, which is not among "
                f"the active joints {', '.join(self.joints)}; name a frame that these carry"
            )
        pin.forwardKinematics(self.model, self._data, np.array(q, dtype=float))
        seen = pin.updateFramePlacement(self.model, self._data, self._id(frame))
        return Placement(seen.rotation.copy(), seen.translation.copy())

    def _id(self, link: str) -> int:
        return self.model.getFrameId(link, _LINK)

    def _moving_between(self, link: str, other: str) -> list[str]:
        tree = self._tree
        between = set(tree.chain(tree.root, link)) ^ set(tree.chain(tree.root, other))
        return sorted(joint for joint in between if tree.kind(joint) != "fixed")

    def state(self, q: Array, dq: Array) -> RobotState:
        """Return the kinematics for q, dq (n,), else RobotError is raised; eqs. (18)-(20)."""
        q, dq = np.array(q, dtype=float), np.array(dq, dtype=float)
        self.refuse_size(q, dq)
        model, data, tip = self.model, self._data, self._tip
        pin.computeJointJacobians(model, data, q)
        T_e = pin.updateFramePlacement(model, data, tip)  # (18), (19)
        J = pin.getFrameJacobian(model, data, tip, _AXES).reshape(6, self.n)
        v_e = J.dot(dq)  # (20)
        p_e, R_e = T_e.translation.copy(), T_e.rotation.copy()
        return RobotState(q, dq, p_e, R_e, v_e[:3], v_e[3:], J)

    def link_speed(self, q: Array, dq: Array) -> float:
        """Return the speed [m/s] of the origin of a link, of the fastest one, at q, dq (n,)."""
        pin.forwardKinematics(self.model, self._data, q, dq)
        return max(math.sqrt(v.linear @ v.linear) for v in self._data.v[1:])

    def states(self, q: Array, dq: Array) -> RobotState:
        """Return the kinematics of N samples q, dq (N, n) as one, its fields stacked."""
        stacked = RobotState(
            *(np.empty((len(q), *field.shape)) for field in self.state(self._zero, self._zero))
        )
        for k, sample in enumerate(zip(q, dq, strict=True)):
            for field, value in zip(stacked, self.state(*sample), strict=True):
                field[k] = value
        return stacked

    def dynamic_state(self, q: Array, dq: Array) -> DynamicState:
        """Return kinematics and dynamics for q, dq (n,): the terms of eq. (32)."""
        arm = self.state(q, dq)
        model, data, q, dq = self.model, self._data, arm.q, arm.dq
        pin.forwardKinematics(model, data, q, dq, self._zero)
        a_e = pin.getFrameClassicalAcceleration(model, data, self._tip, _AXES)
        B = pin.crba(model, data, q)
        C_dq = pin.nonLinearEffects(self._weightless, data, q, dq)
        g = pin.computeGeneralizedGravity(model, data, q)
        return DynamicState(arm, a_e.vector.copy(), B, C_dq, g)

    def _lengths(self) -> tuple[float, Reach]:
        first, *links = [at.translation for at in self.model.jointPlacements[1:]]
        links.append(self.model.frames[self._tip].placement.translation)
        stretched = sum(float(np.linalg.norm(link)) for link in links)
        slides = np.array([self.limits.lower, self.limits.upper])[:, self.is_prismatic]
        ranges = slides[1] - slides[0]
        length = stretched + float(ranges[np.isfinite(ranges)].sum())
        radius = min(stretched + float(np.abs(slides).max(axis=0).sum()), _MAX_REACH)
        return _LENGTH_OF_REACH * length if length > 0 else 1.0, Reach(first.copy(), radius)


def carried_by(tree: UrdfTree, frame: str) -> Tool:
    """Return the body of all links that a link, not the root, carries, in its frame, joints at 0.

    The link itself counts if it is on a fixed joint: then it is a place on the link before;
    else it is the last link of an arm.
    """
    robot, carrier = tree.moving_only(()), tree.chain(tree.root, frame)[-1]
    if tree.kind(carrier) != "fixed":
        link = next(link for link in robot.iter("link") if link.get("name") == frame)
        del link[:]
    next(j for j in robot.iter("joint") if j.get("name") == carrier).set("type", "floating")
    body = _build(robot).inertias[1]
    return Tool(body.mass, body.lever.copy(), body.inertia.copy())


def _model_of(
    tree: UrdfTree, joints: tuple[str, ...], base: str, gravity: Sequence[float]
) -> pin.Model:
    """Return the model in which only ``joints`` move, with the base as its world.

    Continuous joints are revolute ones without limits, so that q are angles, any number of turns.
    """
    robot = tree.moving_only(joints)
    for joint in robot.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
    model = _build(robot)
    base_in_root = model.frames[model.getFrameId(base, _LINK)].placement.copy()
    model.jointPlacements[1] = base_in_root.actInv(model.jointPlacements[1])
    for frame in model.frames:
        if frame.parentJoint == 0:
            frame.placement = base_in_root.actInv(frame.placement)
    model.gravity.linear = base_in_root.rotation.T @ np.array(gravity, dtype=float)
    return model


def _build(robot: ET.Element) -> pin.Model:
    """Return Pinocchio's model of a ``<robot>``.

    It names no joint, so that none is taken for a link, or for Pinocchio's own 'universe'.
    """
    for number, joint in enumerate(robot.iter("joint")):
        joint.set("name", f"joint_{number}")
    try:
        return pin.buildModelFromXML(ET.tostring(robot, encoding="unicode"))
    except Exception as error:  # it leaks any type
        raise RobotError(f"Pinocchio cannot read the URDF: {error}") from error
