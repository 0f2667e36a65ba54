"""Motion and efforts of an arm over time."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eulerparams_control.motion import DesiredFrame
from eulerparams_control.orientation import EulerSequence
from eulerparams_control.robot import Robot, RobotState
from eulerparams_control.rotations import Array, angle_between

type Frames = Sequence[DesiredFrame | None]
"""Frames at instants, or None where there is none."""


class Efforts(NamedTuple):
    """Commanded efforts over time.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        tau: (N, n) [Nm or N], in the order of the robot's joints.
    """

    t: Array
    tau: Array

    @property
    def largest(self) -> Array:
        """(N,) [Nm or N] largest absolute effort of a joint."""
        largest: Array = np.abs(self.tau).max(axis=1)
        return largest


class _Kinematics(NamedTuple):
    """The arm at N instants: p_e (N, 3), R_e (N, 3, 3), omega_e (N, 3), J (N, 6, n)."""

    p_e: Array
    R_e: Array
    omega_e: Array
    J: Array


@dataclass(frozen=True)
class Series:
    """Motion of the arm over time, with the desired frame at the same instants.

    Attributes:
        robot: the arm.
        t: (N,) [s] from the beginning of the recording.
        q, dq: (N, n) positions and velocities [rad, rad/s].
        desired: N desired frames, or None where nothing was desired yet.
    """

    robot: Robot
    t: Array
    q: Array
    dq: Array
    desired: Frames = field(repr=False)

    @cached_property
    def _kinematics(self) -> _Kinematics:
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            states = list(map(self.robot.state, self.q, self.dq))
        rows = ((state.p_e, state.R_e, state.omega_e, state.J) for state in states)
        return _Kinematics(*map(np.array, zip(*rows, strict=True)))

    @property
    def R_e(self) -> Array:
        """(N, 3, 3) orientation of the tip."""
        return self._kinematics.R_e

    @property
    def omega_e(self) -> Array:
        """(N, 3) [rad/s] angular velocity of the tip; not finite where dq is beyond all numbers."""
        return self._kinematics.omega_e

    def state(self, index: int) -> RobotState:
        """Return the kinematics of the arm at one instant."""
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            return self.robot.state(self.q[index], self.dq[index])

    @property
    def p_e(self) -> Array:
        """(N, 3) [m] origin of the tip."""
        return self._kinematics.p_e

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
        pairs = zip(frames, self.p_e, strict=True)
        with np.errstate(over="ignore"):  # a run that diverged
            return np.array([np.nan if d is None else np.linalg.norm(d.p_d - p) for d, p in pairs])

    def angle_to(self, frames: Frames) -> Array:
        """Return (N,) [rad] the angle of the tip from N frames; NaN where there is none."""
        pairs = zip(frames, self.R_e, strict=True)
        return np.array([np.nan if d is None else angle_between(d.R_d, R) for d, R in pairs])

    @cached_property
    def turns(self) -> Array:
        """(N - 1,) [rad] angles between successive orientations of the tip."""
        pairs = zip(self.R_e[:-1], self.R_e[1:], strict=True)
        return np.array([angle_between(R_1, R_2) for R_1, R_2 in pairs])

    @cached_property
    def joint_speed(self) -> Array:
        """(N,) [rad/s] largest absolute joint velocity."""
        return np.abs(self.dq).max(axis=1)

    @cached_property
    def smallest_singular_value(self) -> Array:
        """(N,) smallest singular value of J: distance to the kinematic singularities."""
        return np.linalg.svd(self._kinematics.J, compute_uv=False)[:, -1]

    def pole_distance(self, sequence: EulerSequence) -> Array:
        """Return (N,) [rad] the angle of the tip to the pole of a sequence of Euler angles."""
        return np.array([sequence.pole_distance(R) for R in self.R_e])
