"""Frames, motion and efforts of an arm over time."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.stacks import angles_between
from eulerparams_control.laws.inverse import sigma_min
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame, Placement
from eulerparams_control.motion.frames import moved as frame_moved
from eulerparams_control.robot.robot import Robot, RobotState


@dataclass(frozen=True)
class Frames:
    """A frame at N instants, base frame; NaN where there is none.

    Attributes:
        p: (N, 3) [m] its origin.
        R: (N, 3, 3) its orientation.
        dp, omega: (N, 3) [m/s], [rad/s].
        ddp, domega: (N, 3) [m/s^2], [rad/s^2].
    """

    p: Array = field(repr=False)
    R: Array = field(repr=False)
    dp: Array = field(repr=False)
    omega: Array = field(repr=False)
    ddp: Array = field(repr=False)
    domega: Array = field(repr=False)

    @classmethod
    def nowhere(cls, count: int) -> "Frames":
        """Return as many instants at which there is no frame."""
        vectors = (np.full((count, 3), np.nan) for _ in range(5))
        p, *others = vectors
        return cls(p, np.full((count, 3, 3), np.nan), *others)

    @classmethod
    def of(cls, frames: Sequence[DesiredFrame | None]) -> "Frames":
        """Return frames, or None where there is none, as arrays."""
        found = cls.nowhere(len(frames))
        for index, frame in enumerate(frames):
            if frame is not None:
                for column, value in zip(found.columns, frame, strict=True):
                    column[index] = value
        return found

    @property
    def columns(self) -> tuple[Array, ...]:
        """Its arrays, in the order of the fields of ``DesiredFrame``."""
        return tuple(getattr(self, entry.name) for entry in fields(self))

    def __len__(self) -> int:
        return len(self.p)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) whether there is a frame."""
        return ~np.isnan(self.R[:, 0, 0])

    def frame(self, index: int) -> DesiredFrame:
        """Return the frame at one instant."""
        return DesiredFrame(*(column[index] for column in self.columns))

    def take(self, index: NDArray[np.intp]) -> "Frames":
        """Return the frames at the given places; none where a place is negative."""
        taken = Frames(*(column[index] for column in self.columns))
        for column in taken.columns:
            column[index < 0] = np.nan
        return taken

    def at(self, own: NDArray[Any], t: NDArray[Any]) -> "Frames":
        """Return the frames at instants t (M,), those that are among ``own`` (N,), sorted."""
        if not len(own):
            return Frames.nowhere(len(t))
        index = np.minimum(np.searchsorted(own, t), len(own) - 1)
        return self.take(np.where(own[index] == t, index, -1))

    def carrying(self, point: Placement) -> "Frames":
        """Return what these frames carry rigidly at ``point``: see ``DesiredFrame.carrying``."""
        if point is AT_ORIGIN:
            return self
        return Frames.of([self.frame(k).carrying(point) for k in range(len(self))])


def moved(frames: Frames, dt: Array, lasting: float) -> Frames:
    """Return streamed frames dt (N,) [s] after their start, as ``SetPoint.sample`` gives them.

    They go on at their acceleration for ``lasting`` [s], and are held then.
    """
    times = np.clip(dt, 0.0, lasting).tolist()
    ends = [DesiredFrame(*frame_moved(*frames.frame(k), t)) for k, t in enumerate(times)]
    p, R, *rates = Frames.of(ends).columns
    held = (dt > lasting)[:, None]
    return Frames(p, R, *(np.where(held, 0.0, rate) for rate in rates))


# A motion that is nowhere farther [m], [rad] from what was asked, nor slower, is as it was asked.
_NEAR, _ALIGNED, _AS_ASKED = 1e-3, float(np.radians(0.1)), 0.995


@dataclass(frozen=True)
class ShapedMotion:
    """The motion that the references asked for, and as it was shaped.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        asked: the N desired frames by the references; NaN where there is none.
        made: the N frames of ``~/desired``.
        rates: (K, 4) as the controller reported: time [s], rate of time, slowest rate of the
            trajectory, saturated ticks.
    """

    t: Array
    asked: Frames = field(repr=False)
    made: Frames = field(repr=False)
    rates: Array = field(default_factory=lambda: np.zeros((0, 4)), repr=False)


def departure(motion: ShapedMotion) -> str:
    """Describe by how much the motion differs from the references; "" if it is as they asked."""
    with np.errstate(over="ignore", invalid="ignore"):  # what was asked may be non-finite
        away = np.linalg.norm(motion.asked.p - motion.made.p, axis=1)
        angles = angles_between(motion.asked.R, motion.made.R)
    distance = float(np.nanmax(away, initial=0.0))
    angle = float(np.nanmax(angles, initial=0.0))
    slowest = float(motion.rates[:, 1:3].min(initial=1.0))
    found = {
        f"by {1e3 * distance:.3g} mm at most": distance > _NEAR,
        f"by {np.degrees(angle):.3g} deg at most": angle > _ALIGNED,
        f"with time at {100 * slowest:.3g} % at the slowest": slowest < _AS_ASKED,
    }
    words = ", ".join(text for text, differs in found.items() if differs)
    if not words:
        return ""
    if distance or angle:  # else nothing is known of what was asked
        words += ": errors here are those against what was asked"
    return f"the motion was made to differ from what was asked, {words}"


class Efforts(NamedTuple):
    """Commanded efforts over time.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        tau: (N, n) [Nm or N], in the order of the robot's joints.
    """

    t: Array
    tau: Array


def comparable(robot: Robot) -> NDArray[np.bool_]:
    """Return which joints (n,) have values of one unit: those that turn, all if none does."""
    turns: NDArray[np.bool_] = ~robot.is_prismatic
    return turns if turns.any() else ~turns


@dataclass(frozen=True)
class Series:
    """Motion of the arm over time, with the desired frame at the same instants.

    Attributes:
        robot: the arm.
        t: (N,) [s] from the beginning of the recording.
        q, dq: (N, n) positions and velocities [rad, rad/s].
        desired: the N desired frames.
    """

    robot: Robot
    t: Array
    q: Array
    dq: Array
    desired: Frames = field(repr=False)

    @cached_property
    def kinematics(self) -> RobotState:
        """The N states of the arm as one, its fields stacked."""
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            return self.robot.states(self.q, self.dq)

    def before(self, t: Array) -> NDArray[np.intp]:
        """Return the places (M,) of the last states up to instants t (M,) [s]; the first before."""
        return np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0)

    @property
    def p_e(self) -> Array:
        """(N, 3) [m] position of the tip."""
        return self.kinematics.p_e

    @property
    def R_e(self) -> Array:
        """(N, 3, 3) orientation of the tip."""
        return self.kinematics.R_e

    @property
    def omega_e(self) -> Array:
        """(N, 3) [rad/s] angular velocity of the tip."""
        return self.kinematics.omega_e

    @cached_property
    def position_error(self) -> Array:
        """(N,) [m] distance of the tip from the desired one; NaN where there is none."""
        return self.distance_to(self.desired)

    @cached_property
    def orientation_error(self) -> Array:
        """(N,) [rad] angle of the tip from the desired one; NaN where there is none."""
        return self.angle_to(self.desired)

    def distance_to(self, frames: Frames) -> Array:
        """Return (N,) [m] the distance of the tip from N frames; NaN where there is none."""
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            distance: Array = np.linalg.norm(frames.p - self.p_e, axis=1)
        return distance

    def angle_to(self, frames: Frames) -> Array:
        """Return (N,) [rad] the angle of the tip from N frames; NaN where there is none."""
        with np.errstate(over="ignore", invalid="ignore"):
            return angles_between(frames.R, self.R_e)

    @cached_property
    def smallest_singular_value(self) -> Array:
        """(N,) smallest singular value of J: distance to the kinematic singularities.

        Its rows for the position are divided by the characteristic length of the arm.
        """
        return np.array([sigma_min(J, self.robot.length) for J in self.kinematics.J])
