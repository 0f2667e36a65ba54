"""The robot arm: from joint values to the frozen state that the laws take.

The only user of Pinocchio, which reads the URDF; the formulas of :mod:`.chain` are compared with
it when a robot is made, in its reference frame LOCAL_WORLD_ALIGNED, turned into the base frame.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from eulerparams_control.errors import RobotError, UnknownNameError
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import AT_ORIGIN, Placement
from eulerparams_control.robot import chain
from eulerparams_control.robot.urdf import (
    MOVING,
    UrdfTree,
    attribute,
    joint_friction,
    joint_limits,
    refuse_motionless,
)

_REFERENCE = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

# Relative error of what the formulas make of a model.
_EXACT = 1e-9

# The characteristic length of an arm, of its reach.
_OF_REACH = 0.8

# No arm reaches farther [m], whatever the limits of its rail say.
_FARTHEST = 100.0

_LINK = pin.FrameType.BODY  # a joint may have the name of a link


class Reach(NamedTuple):
    """A sphere that the tip never leaves; it does not reach all that is in it.

    Attributes:
        centre: (3,) [m] the first joint, base frame.
        radius: [m] the sum of the links from there on, and of how far joints slide.
    """

    centre: Array
    radius: float

    def distance(self, p: Array) -> float:
        """Return the distance [m] of a position (3,) from the first joint."""
        return math.dist(p, self.centre)


class RobotState(NamedTuple):
    """Kinematics of the arm at one instant; having one proves that they are up to date.

    Attributes:
        q: (n,) joint positions [rad or m], in the order of ``Robot.joints``.
        dq: (n,) joint velocities [rad/s or m/s].
        p_e: (3,) [m] origin of the tip, base frame, eq. (18).
        R_e: (3, 3) orientation of the tip, base frame, eq. (19).
        dp_e: (3,) [m/s] velocity of the tip, base frame, eq. (20).
        omega_e: (3,) [rad/s] angular velocity of the tip, base frame, eq. (20).
        J: (6, n) geometric Jacobian, base frame, linear part first, eq. (20).
    """

    q: Array
    dq: Array
    p_e: Array
    R_e: Array
    dp_e: Array
    omega_e: Array
    J: Array

    @classmethod
    def of(cls, arm: Array, n: int) -> "RobotState":
        """Return the state whose parts are views of the row of an arm of n joints."""
        tip = arm[2 * n :]
        R_e, J = tip[3:12].reshape(3, 3), chain.jacobian_in(arm, n)
        return cls(arm[:n], arm[n : 2 * n], tip[:3], R_e, tip[12:15], tip[15:18], J)


class DynamicState(NamedTuple):
    """Kinematics and dynamics of the arm at one instant: the terms of eq. (32).

    Attributes:
        arm: its kinematics.
        dJ_dq: (6,) [m/s^2, rad/s^2] dJ dq, the acceleration of the tip at ddq = 0, base frame.
        B: (n, n) joint inertia [kg m^2].
        C_dq: (n,) Coriolis and centrifugal efforts C dq [Nm].
        g: (n,) gravitational efforts [Nm].
    """

    arm: RobotState
    dJ_dq: Array
    B: Array
    C_dq: Array
    g: Array


class Tool(NamedTuple):
    """A body fixed to the tip that the URDF does not know.

    Attributes:
        mass: [kg].
        com: (3,) [m] centre of mass in the tip frame.
        inertia: (3, 3) [kg m^2] about that, axes of the tip frame.
    """

    mass: float
    com: Array
    inertia: Array


class Robot:
    """A serial arm of n active joints, from a URDF.

    Joints that are not active (grippers, mimics, other arms) are held still in the
    model.  Revolute, continuous and prismatic joints may be mixed.

    Args:
        urdf: the text of the URDF.
        base_frame: the link that poses and twists refer to; "" is the root link.
        tip_frame: the link that is controlled.
        joints: names of the active joints; () is all that move between base and tip.
        gravity: (3,) [m/s^2] in the root link.
        tool: carried at the tip; None if there is none.

    Attributes:
        base_frame, tip_frame: as given, "" resolved.
        joints: the n active joints, base to tip.
        limits: of the active joints.
        friction: of the active joints, as the URDF states it.
        chain: (n + 1, ...) the arm as the formulas of :mod:`.chain` take it.
        length: characteristic length [m]: 0.8 times the sum of the distances between the origins
            of successive joints, up to the tip, and of the ranges of those that slide; that of
            a UR5 is 0.99 m.
        reach: where the tip can be at all.
        is_prismatic: (n,) which of the active joints slide; the others turn.
        locked: joints between base and tip that could move, but are held at 0 in the model.
        mount: joints between the root and the base that could turn it against gravity, held at 0
            in the model too; one that slides, as the lift of a torso does, is none of them.

    Raises:
        RobotError: if the URDF is broken, or a frame or joint is not there.
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
        self.base_frame = _frame(tree, base_frame or tree.root, "base_frame")
        self.tip_frame = _frame(tree, tip_frame, "tip_frame")
        self.joints = _active_joints(tree, self.base_frame, self.tip_frame, joints)
        self.n = len(self.joints)
        self.locked = tuple(
            joint
            for joint in tree.chain(self.base_frame, self.tip_frame)
            if joint not in self.joints and tree.joints[joint].get("type") != "fixed"
        )
        self.mount = tuple(
            joint
            for joint in tree.chain(tree.root, self.base_frame)
            if tree.joints[joint].get("type") not in ("fixed", "prismatic")
        )
        kinds = [tree.joints[joint].get("type") for joint in self.joints]
        self.is_prismatic = np.array([kind == "prismatic" for kind in kinds])
        self.limits = JointLimits(
            *np.array([joint_limits(tree.joints[joint]) for joint in self.joints]).T
        )
        self.friction = JointFriction(
            *np.array([joint_friction(tree.joints[joint]) for joint in self.joints]).T
        )
        self._model = _model_of(tree, self.joints)
        self._model.gravity.linear = np.array(gravity, dtype=float)
        self._tip = self._model.getFrameId(self.tip_frame, _LINK)
        if tool is not None:
            self._carry(tool)
        self._data = self._model.createData()
        self._zero, self._base = np.zeros(self.n), self._base_placement()
        self.length, self.reach = self._lengths()
        self._continuous = [joint.nq == 2 for joint in self._model.joints[1:]]
        self.chain = self._chain()
        self._refuse_other_model()

    def refuse_joints(self) -> None:
        """Raise RobotError, with what helps, if the joints from base to tip cannot be controlled.

        One that moves but is not active is held at 0 in the model, and nowhere else; the limits
        of one that is active may not let it move.
        """
        joints = self._tree.joints
        for joint in self.joints:
            refuse_motionless(joints[joint])
        if not self.locked:
            return
        between = f"between {self.base_frame} and {self.tip_frame}"
        for joint in self.locked:
            mimic, kind = joints[joint].find("mimic"), joints[joint].get("type")
            if mimic is None and kind in MOVING:
                continue
            what = f"is {kind}" if mimic is None else f"mimics {attribute(mimic, 'joint')}"
            motor = "" if mimic is None else ", or remove its <mimic> if it has a motor of its own"
            raise RobotError(
                f"{joint} {between} {what}, which a chain of independent joints cannot have: set "
                f"tip_frame to {self._tree.end(joint, 'parent')} or a link before it, or make "
                f'the joint type="fixed" in the URDF{motor}'
            )
        raise RobotError(
            f"{', '.join(self.locked)} can move {between}, but is not among the active joints; set "
            "joints: []"
        )

    @property
    def gravity(self) -> Array:
        """Gravity (3,) [m/s^2] in the base frame."""
        return np.array(self._base.rotation.T @ self._model.gravity.linear)

    def placement(self, frame: str, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Placement:
        """Return where a link that is fixed to the tip is, seen from the tip.

        Args:
            frame: the link; "" is the tip.
            offset: (3,) [m] in the link, of the point that is meant.

        Raises:
            RobotError: if there is no such link, or a joint can move between it and the tip.
        """
        if frame in ("", self.tip_frame) and not any(offset):
            return AT_ORIGIN
        frame = _frame(self._tree, frame or self.tip_frame, "frame")
        between = set(self._tree.chain(self._tree.root, frame)) ^ set(
            self._tree.chain(self._tree.root, self.tip_frame)
        )
        moving = sorted(j for j in between if self._tree.joints[j].get("type") != "fixed")
        if moving:
            raise RobotError(
                f"the frame '{frame}' is not fixed to the tip '{self.tip_frame}': "
                f"{', '.join(moving)} can move between them"
            )
        tip = self._model.frames[self._tip].placement
        there = self._model.frames[self._model.getFrameId(frame, _LINK)].placement
        relative = tip.actInv(there)
        R = relative.rotation.copy()
        return Placement(R, relative.translation + R @ np.array(offset))

    def link_at(self, frame: str, q: Array) -> Placement:
        """Return where a link is at q (n,), seen from the base frame.

        Args:
            frame: the link; "" is the base frame.
            q: (n,) positions of the active joints.

        Raises:
            RobotError: if there is no such link, or another joint moves it against the base.
        """
        if frame in ("", self.base_frame):
            return AT_ORIGIN
        tree, frame = self._tree, _frame(self._tree, frame, "frame_id")
        carried, base = (set(tree.chain(tree.root, link)) for link in (frame, self.base_frame))
        others = sorted((carried ^ base).difference(self.joints))
        moving = [joint for joint in others if tree.joints[joint].get("type") != "fixed"]
        if moving:
            raise RobotError(
                f"where the frame '{frame}' is depends on {', '.join(moving)}, which is not among "
                f"the active joints {', '.join(self.joints)}; name a frame that these carry"
            )
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, self._configuration(q))
        there = pin.updateFramePlacement(model, data, model.getFrameId(frame, _LINK))
        seen = self._base.actInv(there)
        return Placement(seen.rotation.copy(), seen.translation.copy())

    def state(self, q: Array, dq: Array) -> RobotState:
        """Return the kinematics for q, dq (n,) in the order of ``joints``; eqs. (18)-(20).

        Raises:
            RobotError: if q or dq has not n elements.
        """
        return RobotState.of(self.arm(q, dq), self.n)

    def arm(self, q: Array, dq: Array) -> Array:
        """Return the row of the arm, see :mod:`.chain`, at q, dq (n,).

        Raises:
            RobotError: if q or dq has not n elements.
        """
        arm, work = np.empty(chain.arm_width(self.n)), np.empty((self.n, chain.WORK))
        chain.state(self.chain, *self._checked(q, dq), work, arm)
        return arm

    def states(self, q: Array, dq: Array) -> RobotState:
        """Return the kinematics of N samples q, dq (N, n) as one, its fields stacked.

        Raises:
            RobotError: if q or dq has not n columns.
        """
        if q.shape != dq.shape or q.shape != (len(q), self.n):
            raise RobotError(f"q and dq have shapes {q.shape}, {dq.shape}; expected (N, {self.n})")
        N, n = q.shape
        arms = np.empty((N, chain.arm_width(n)))
        chain.states(self.chain, q, dq, arms)
        tip = arms[:, 2 * n :]
        R_e, J = tip[:, 3:12].reshape(N, 3, 3), tip[:, chain.TIP :].reshape(N, 6, n)
        return RobotState(q, dq, tip[:, :3], R_e, tip[:, 12:15], tip[:, 15:18], J)

    def dynamic_state(self, q: Array, dq: Array) -> DynamicState:
        """Return kinematics and dynamics for q, dq (n,); the terms of eq. (32).

        Raises:
            RobotError: if q or dq has not n elements.
        """
        arm, n = np.empty(chain.arm_width(self.n)), self.n
        terms = np.empty((n, n)), np.empty(n), np.empty(n)
        chain.dynamic_state(self.chain, *self._checked(q, dq), arm, *terms)
        return DynamicState(RobotState.of(arm, n), chain.dJ_dq(arm, n), *terms)

    def _checked(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return q, dq (n,) as formulas take them; raises RobotError."""
        q, dq = np.asarray(q, dtype=float), np.asarray(dq, dtype=float)
        self.refuse_size(q, dq)
        return q, dq

    def refuse_size(self, q: Array, dq: Array) -> None:
        """Raise RobotError if q or dq has not n elements."""
        if q.shape != (self.n,) or dq.shape != (self.n,):
            raise RobotError(f"q and dq have shapes {q.shape}, {dq.shape}; expected ({self.n},)")

    def _chain(self) -> Array:
        """Return the chain of the model, from the base frame on."""
        model, tip = self._model, self._model.frames[self._tip].placement
        placements, links = model.jointPlacements.tolist()[1:], []
        placements[0] = self._base.actInv(placements[0])  # it is in the root
        for joint, at, body in zip(model.joints[1:], placements, model.inertias[1:], strict=True):
            motion = joint.createData()
            joint.calc(motion, pin.neutral(model), self._zero)
            along, about = np.split(motion.S.ravel(), 2)
            mass = along.any(), body.mass, body.lever, body.inertia
            links.append((at.rotation, at.translation, along + about, *mass))
        return chain.chain_of(links, (tip.rotation, tip.translation, self.gravity))

    def _refuse_other_model(self) -> None:
        """Raise RobotError unless the formulas make of the chain what Pinocchio makes."""
        model, data, turn = self._model, self._data, np.kron(np.eye(2), self._base.rotation)
        for q, dq, ddq in np.random.default_rng(0).uniform(-1.0, 1.0, (2, 3, self.n)):
            arm, dJ_dq, B, C_dq, g = self.dynamic_state(q, dq)
            at = self._configuration(q)
            J = pin.computeFrameJacobian(model, data, at, self._tip, _REFERENCE)
            pin.forwardKinematics(model, data, at, dq, self._zero)
            tip = pin.updateFramePlacement(model, data, self._tip).homogeneous
            a = pin.getFrameClassicalAcceleration(model, data, self._tip, _REFERENCE).vector
            for found, expected in (
                ((self._base * pin.SE3(arm.R_e, arm.p_e)).homogeneous, tip),
                (turn @ arm.J, J.reshape(6, self.n)),  # it comes as (6,) for n = 1
                (np.concatenate((arm.dp_e, arm.omega_e)), arm.J @ dq),
                (turn @ dJ_dq, a),
                (B @ ddq + C_dq + g, pin.rnea(model, data, at, dq, ddq)),
            ):
                scale = max(1.0, np.abs(tip).max(), np.abs(expected).max())
                if not np.abs(found - expected).max() <= _EXACT * scale:
                    raise RobotError(
                        "the formulas of this package and Pinocchio, which read the URDF, differ "
                        f"for this arm at q = {q.tolist()}: {found.tolist()}, {expected.tolist()}"
                    )

    def _lengths(self) -> tuple[float, Reach]:
        """Return the characteristic length [m], and how far the tip can be."""
        placements, slides = self._model.jointPlacements, self.is_prismatic
        links = [*placements[2:], self._model.frames[self._tip].placement]
        stretched = sum(float(np.linalg.norm(link.translation)) for link in links)
        lower, upper = self.limits.lower[slides], self.limits.upper[slides]
        ranges = upper - lower
        length = stretched + float(ranges[np.isfinite(ranges)].sum())
        radius = min(stretched + float(np.maximum(abs(lower), abs(upper)).sum()), _FARTHEST)
        first = self._base.actInv(placements[1]).translation
        return _OF_REACH * length if length > 0 else 1.0, Reach(first, radius)

    def _carry(self, tool: Tool) -> None:
        """Add a tool to the model of the link that carries the tip."""
        frame = self._model.frames[self._tip]
        body = frame.placement.act(pin.Inertia(tool.mass, tool.com, tool.inertia))
        self._model.inertias[frame.parentJoint] += body

    def _configuration(self, q: Array) -> Array:
        """Return Pinocchio's configuration: cosine and sine for each continuous joint."""
        if self._model.nq == self.n:
            return q
        values: list[float] = []
        for angle, continuous in zip(q.tolist(), self._continuous, strict=True):
            values += (math.cos(angle), math.sin(angle)) if continuous else (angle,)
        return np.array(values)

    def _base_placement(self) -> pin.SE3:
        """Return the placement of the base frame in the root frame, which is constant."""
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, pin.neutral(model))
        base = model.getFrameId(self.base_frame, _LINK)
        return pin.updateFramePlacement(model, data, base).copy()


def _frame(tree: UrdfTree, name: str, parameter: str) -> str:
    if name not in tree.links:
        raise RobotError(f"{parameter}: {UnknownNameError('frame', name, tree.links)}")
    return name


def _active_joints(tree: UrdfTree, base: str, tip: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the active joints from base to tip, checked against the tree."""
    moving = tree.moving(base, tip)
    for joint in joints:
        if joint not in moving:
            raise RobotError(f"joints: {UnknownNameError('joint', joint, moving)}")
    active = tuple(joint for joint in moving if joint in joints or not joints)
    if not active:
        raise RobotError(f"no joint moves between base_frame '{base}' and tip_frame '{tip}'")
    return active


def _model_of(tree: UrdfTree, joints: tuple[str, ...]) -> pin.Model:
    """Return the Pinocchio model in which only ``joints`` move.

    It names no joint, so that none is taken for a link, or for Pinocchio's own 'universe'.
    """
    robot = tree.moving_only(joints)
    for number, joint in enumerate(robot.iter("joint")):
        joint.set("name", f"joint_{number}")
    try:
        return pin.buildModelFromXML(ET.tostring(robot, encoding="unicode"))
    except Exception as error:  # it leaks any type
        raise RobotError(f"Pinocchio cannot read the URDF: {error}") from error
