"""Pose laws as other packages ship them, for comparison only: one error for the whole pose.

Importing this registers ``as_shipped_log6`` and ``as_shipped_dual`` as representations, which the
node ``clik`` of this room takes for laws of the pose; k_Pp is the gain of both parts.  With
T_e^-1 T_d = {p, R}, in the axes of the tip:

| name | linear and angular velocity |
| --- | --- |
| ``as_shipped_log6`` | k log6, k log R: pink, mink |
| ``as_shipped_dual`` | 2 k times the vector parts of the unit dual quaternion x_e* x_d |
"""

from typing import Any, ClassVar, NamedTuple

import numpy as np

from eulerparams_control.laws._old.compiled import (
    Formula,
    Input,
    Inputs,
    Row,
    Rows,
    formula,
    slot,
    template,
)
from eulerparams_control.laws._old.linear import Mat, Vec, VecLike, cross, put_vec, solve
from eulerparams_control.laws._old.orientation.base import OrientationRepresentation, law_of
from eulerparams_control.laws._old.orientation.euler_parameters import EulerParametersRepresentation
from eulerparams_control.laws._old.orientation.rotation_vector import RotationVectorRepresentation
from eulerparams_control.laws._old.rotations import log, quaternion, right_jacobian
from eulerparams_control.laws.clik import Clik, ClikLaw, _tick, over
from eulerparams_control.laws.inverse import invert, resolve
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import TipLimits


class Twist(NamedTuple):
    """Linear and angular velocity (3,) for the gain 1, axes of the tip."""

    v: VecLike
    omega: VecLike


@formula
def log6(p: Vec, R: Mat) -> Twist:
    """Return log6 of {p, R}: along it the tip goes on a screw."""
    omega = log(R)
    return Twist(solve(right_jacobian(-omega), p), omega)


@formula
def dual(p: Vec, R: Mat) -> Twist:
    """Return twice the vector parts of Q + (unit) p Q / 2."""
    Q = quaternion(R)
    return Twist(Q.eta * p + cross(p, Q.eps), 2.0 * Q.eps)


displacement = pose = slot


def _law(
    q: Input, p_e: Vec, R_e: Mat, J: Inputs, desired: DesiredFrame, previous: Any, numbers: Any,
    most: TipLimits, dt: float, posture: Input, joints: Rows, dq: Row,
) -> tuple[Any, bool]:  # fmt: skip
    """Fill dq (n,) for a goal at rest, without limits of the tip; see ``laws.clik``."""
    twist, k = pose(R_e.T @ (desired.p_d - p_e), R_e.T @ desired.R_d), over(numbers.k_Pp, dt)
    bracket, inverse = np.empty(6), np.empty((len(q), 6))
    put_vec(bracket, 0, k * (R_e @ twist.v))
    put_vec(bracket, 3, k * (R_e @ twist.omega))
    invert(J, numbers.eps, numbers.lambda_max, numbers.length, inverse)
    resolve(inverse, J, bracket, np.zeros(len(q)), dq)
    return displacement(desired.R_d, R_e, previous, numbers.options), True


class PoseLaw(OrientationRepresentation):
    """A representation that is of the whole pose; its ``law`` takes the place of that of CLIK."""

    law: ClassVar[Any]

    def __init_subclass__(cls, pose: Formula, **kwargs: Any) -> None:
        cls.law = staticmethod(template(_law, f"{cls.__name__}_law", pose=pose))
        super().__init_subclass__(**kwargs)


class Log6(PoseLaw, RotationVectorRepresentation, pose=log6):
    """log6 of the pose."""

    name = "as_shipped_log6"


class Dual(PoseLaw, EulerParametersRepresentation, pose=dual):
    """The unit dual quaternion."""

    name = "as_shipped_dual"


class PoseClik(Clik):
    """CLIK with a law of the pose."""

    def _take(self, law: ClikLaw) -> None:
        super()._take(law)
        kind = type(law.orientation)
        if issubclass(kind, PoseLaw):
            self._step = law_of(_tick, kind.law, kind)
