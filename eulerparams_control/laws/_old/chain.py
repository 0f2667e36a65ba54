"""A serial arm: kinematics, eqs. (18)-(20), and the efforts of eq. (32), by recursion.

From base to tip for positions and motions, back for forces (Newton and Euler: Luh, Walker and
Paul, On-line computational scheme for mechanical manipulators, 1980).  All vectors are in the
base frame.  The arm is rows of numbers: ``chain`` (n + 1, ...) has a :class:`Link` a joint, and
the :class:`ChainTip`; ``work`` (n, WORK) is filled by :func:`place` and read by the others.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws._old.compiled import (
    Array,
    Input,
    Row,
    Rows,
    kernel,
    layout,
    to_rows,
)
from eulerparams_control.laws._old.linear import Mat, Vec, cross, identity, outer
from eulerparams_control.laws._old.rotations import R_angle_axis
from eulerparams_control.robot.robot import Robot, RobotState


class Link(NamedTuple):
    """A joint, and the body that it moves.

    Attributes:
        R, p: orientation and origin [m] of the joint at 0, in the joint before it.
        axis: unit vector about which it turns, or along which it slides.
        slides: whether it is prismatic.
        mass: [kg] of the body.
        com: [m] centre of mass.
        inertia: [kg m^2] about that.
    """

    R: Mat
    p: Vec
    axis: Vec
    slides: bool
    mass: float
    com: Vec
    inertia: Mat


class ChainTip(NamedTuple):
    """Where the tip is in the last joint, R and p [m], and gravity [m/s^2] in the base frame."""

    R: Mat
    p: Vec
    gravity: Vec


class PlacedJoint(NamedTuple):
    """A joint where it is: R, p [m], its axis z, and r [m] from the joint before it."""

    R: Mat
    p: Vec
    z: Vec
    r: Vec


class BodyLoad(NamedTuple):
    """What moves a body: f [N] and mu [Nm] about its centre of mass, c [m] from the joint."""

    f: Vec
    mu: Vec
    c: Vec


class Motion(NamedTuple):
    """Motion of a point of a body: v [m/s], omega [rad/s], and their derivatives a, domega."""

    v: Vec
    omega: Vec
    a: Vec
    domega: Vec


class TipState(NamedTuple):
    """The tip in the base frame, eqs. (18)-(20): its pose, and its motion at ddq = 0.

    Of that a and domega are the parts of dJ dq.
    """

    p_e: Vec
    R_e: Mat
    motion: Motion


TIP = layout(TipState).width
"""Width of a tip in a row."""

read_tip, _put_tip = layout(TipState)[1:3]
_link, _tip = layout(Link).read, layout(ChainTip).read
_placed, _put_placed = layout(PlacedJoint)[1:3]
_load, _put_load = layout(BodyLoad)[1:3]
_LOAD = layout(PlacedJoint).width  # where it begins
WORK = _LOAD + layout(BodyLoad).width


@cache
def chain_of_robot(robot: Robot) -> Array:
    """Return the chain (n + 1, ...) of an arm."""
    model, tip = robot.model, robot.model.frames[robot.tip_id].placement
    chain, zero = np.zeros((robot.n + 1, layout(Link).width)), np.zeros(robot.n)
    bodies = zip(model.joints[1:], model.jointPlacements[1:], model.inertias[1:], strict=True)
    for row, (joint, at, body) in zip(chain, bodies, strict=False):
        motion = joint.createData()
        joint.calc(motion, zero, zero)
        along, about = np.split(motion.S.ravel(), 2)
        mass = along.any(), body.mass, body.lever, body.inertia
        row[:] = to_rows(Link, (at.rotation, at.translation, along + about, *mass))
    at_tip = tip.rotation, tip.translation, robot.gravity
    chain[-1, : layout(ChainTip).width] = to_rows(ChainTip, at_tip)
    return chain


# --- kinematics -----------------------------------------------------------------------------


@kernel
def place(chain: Rows, q: Input, work: Rows) -> tuple[Mat, Vec]:
    """Place the joints at q (n,) in ``work``; return R_e and p_e [m], eqs. (18), (19)."""
    R, p = identity(1.0), Vec(0.0, 0.0, 0.0)
    for i in range(len(q)):
        link = _link(chain[i], 0)
        r = R @ link.p
        R = R @ link.R
        z = R @ link.axis
        if link.slides:
            r = r + q[i] * z
        else:
            R = R @ R_angle_axis(q[i] + 0.0 * q[i], link.axis)  # NaN for an infinite q
        p = p + r
        _put_placed(work[i], 0, PlacedJoint(R, p, z, r))
    tip = _tip(chain[len(q)], 0)
    return R @ tip.R, p + R @ tip.p


@kernel
def jacobian(chain: Rows, p_e: Vec, work: Rows, J: Rows) -> None:
    """Fill J (6, n), linear part first, eq. (20)."""
    for i in range(len(work)):
        at, slides = _placed(work[i], 0), _link(chain[i], 0).slides
        v = at.z if slides else cross(at.z, p_e - at.p)
        omega = Vec(0.0, 0.0, 0.0) if slides else at.z
        J[0, i], J[1, i], J[2, i] = v.x, v.y, v.z
        J[3, i], J[4, i], J[5, i] = omega.x, omega.y, omega.z


@kernel
def _at_rest(a: Vec) -> Motion:
    return Motion(Vec(0.0, 0.0, 0.0), Vec(0.0, 0.0, 0.0), a, Vec(0.0, 0.0, 0.0))


@kernel
def _carried(by: Motion, r: Vec) -> Motion:
    """Return the motion of a point of the same body that is r further on."""
    v = cross(by.omega, r)
    a = cross(by.domega, r) + cross(by.omega, v)
    return Motion(by.v + v, by.omega, by.a + a, by.domega)


@kernel
def _moved(by: Motion, slides: bool, dz: Vec, ddz: Vec) -> Motion:
    """Return the motion after a joint that moves by dz, ddz along or about its axis."""
    turned = cross(by.omega, dz)
    if slides:
        return Motion(by.v + dz, by.omega, by.a + 2.0 * turned + ddz, by.domega)
    return Motion(by.v, by.omega + dz, by.a, by.domega + turned + ddz)


@kernel
def tip_motion(chain: Rows, p_e: Vec, dq: Input, work: Rows) -> Motion:
    """Return the motion of the tip at ddq = 0: dp_e, omega_e of eq. (20), and dJ dq."""
    nothing = Vec(0.0, 0.0, 0.0)
    motion, p = _at_rest(nothing), nothing
    for i in range(len(dq)):
        at, slides = _placed(work[i], 0), _link(chain[i], 0).slides
        motion, p = _moved(_carried(motion, at.r), slides, dq[i] * at.z, nothing), at.p
    return _carried(motion, p_e - p)


# --- dynamics -------------------------------------------------------------------------------


@kernel
def efforts(
    chain: Rows, dq: Input, ddq: Input, work: Rows, gravity: bool, coriolis: bool, tau: Row
) -> None:
    """Fill tau (n,) with B ddq + C dq + g, eq. (32), the last two where they are wanted."""
    n, nothing = len(dq), Vec(0.0, 0.0, 0.0)
    motion = _at_rest(-_tip(chain[n], 0).gravity if gravity else nothing)
    for i in range(n):
        link, at = _link(chain[i], 0), _placed(work[i], 0)
        dz = dq[i] * at.z if coriolis else nothing
        motion = _moved(_carried(motion, at.r), link.slides, dz, ddq[i] * at.z)
        c, inertia, omega = at.R @ link.com, at.R @ link.inertia @ at.R.T, motion.omega
        mu = inertia @ motion.domega + cross(omega, inertia @ omega)
        _put_load(work[i], _LOAD, BodyLoad(link.mass * _carried(motion, c).a, mu, c))
    f, mu, r = nothing, nothing, nothing  # on the joint; r to the one after it
    for i in range(n - 1, -1, -1):
        at, load = _placed(work[i], 0), _load(work[i], _LOAD)
        mu = load.mu + cross(load.c, load.f) + mu + cross(r, f)
        f, r = f + load.f, at.r
        tau[i] = at.z @ (f if _link(chain[i], 0).slides else mu)


@kernel
def joint_inertia(chain: Rows, work: Rows, B: Rows) -> None:
    """Fill B (n, n): its columns are the efforts of unit accelerations at rest.

    By composite bodies (Featherstone, Rigid Body Dynamics Algorithms, sec. 6.2): what a joint
    carries is a body of one mass, with its first and second moments about the joint.
    """
    mass, first, second = 0.0, Vec(0.0, 0.0, 0.0), identity(0.0)
    for j in range(len(work) - 1, -1, -1):
        link, at = _link(chain[j], 0), _placed(work[j], 0)
        c, inertia = at.R @ link.com, at.R @ link.inertia @ at.R.T
        first, mass = first + link.mass * c, mass + link.mass
        second = second + inertia + link.mass * _spread(c, c)
        f, mu = cross(at.z, first), second @ at.z
        if link.slides:
            f, mu = mass * at.z, cross(first, at.z)
        for i in range(j, -1, -1):  # down to the base
            by = _placed(work[i], 0)
            B[i, j] = B[j, i] = by.z @ (f if _link(chain[i], 0).slides else mu)
            mu = mu + cross(by.r, f)
        moved = _spread(first, at.r) + _spread(at.r, first) + mass * _spread(at.r, at.r)
        first, second = first + mass * at.r, second + moved


@kernel
def _spread(a: Vec, b: Vec) -> Mat:
    """Return a' b I - b a', the second moment of unit masses: at a = b, with Steiner's terms."""
    return identity(a @ b) - outer(b, a)


# --- what Python calls ----------------------------------------------------------------------
#
# An arm is a row of 8 n + TIP: q, dq (n,), the tip, and J (6, n).


@kernel
def arm_width(n: int) -> int:
    """Return how many floats the row of an arm of n joints has."""
    return 8 * n + TIP


@kernel
def jacobian_in(arm: Row, n: int) -> Rows:
    """Return J (6, n) of the row of an arm."""
    return arm[2 * n + TIP : 8 * n + TIP].reshape(6, n)


def arm_state(arm: Array, n: int) -> RobotState:
    """Return the state whose parts are views of the row of an arm of n joints."""
    tip = arm[2 * n :]
    R_e, J = tip[3:12].reshape(3, 3), jacobian_in(arm, n)
    return RobotState(arm[:n], arm[n : 2 * n], tip[:3], R_e, tip[12:15], tip[15:18], J)


@kernel
def dJ_dq(arm: Row, n: int) -> Row:
    """Return dJ dq (6,) of the row of an arm, the acceleration of the tip at ddq = 0."""
    return arm[2 * n + TIP - 6 : 2 * n + TIP]


@kernel
def put_arm(chain: Rows, q: Input, dq: Input, work: Rows, arm: Row) -> TipState:
    """Fill in the row of an arm, eqs. (18)-(20), and ``work``; return the tip."""
    n, J = len(q), jacobian_in(arm, len(q))
    R, p = place(chain, q, work)
    jacobian(chain, p, work, J)
    tip = TipState(p, R, tip_motion(chain, p, dq, work))
    for i in range(n):
        arm[i], arm[n + i] = q[i], dq[i]
    _put_tip(arm, 2 * n, tip)
    return tip
