"""The compliant frame over time, against the desired frame: what the impedance of section V does.

Notation: ``p_cd_d`` (3,) [m] R_d' (p_c - p_d); ``R_cd`` (3, 3) R_d' R_c; ``rho_cd_d`` (3,) [rad]
its rotation vector; ``x`` (3,) [rad/s] R_d' (omega_c - omega_d), as in (59); all of them in the
desired frame.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eulerparams_control.analysis.frames import Frames
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.rotations_batch import (
    quaternions,
    rotation_vectors,
    transposed,
    turn_back,
)
from eulerparams_control.motion.frames import AT_ORIGIN, Placement


@dataclass(frozen=True)
class CompliantMotion:
    """The compliant frame over time, with the desired frame at the same instants.

    What is relative to the desired frame is NaN where there is none.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        frames: the N compliant frames.
        desired: the N desired frames.
    """

    t: Array
    frames: Frames = field(repr=False)
    desired: Frames = field(repr=False)

    def at(self, t: Array) -> Frames:
        """Return the compliant frame at each of the instants t (M,) [s], none where is none."""
        return self.frames.at(self.t, t)

    def carrying(self, point: Placement) -> "CompliantMotion":
        """Return the motion of what both frames carry rigidly at ``point``."""
        if point is AT_ORIGIN:
            return self
        return CompliantMotion(self.t, self.frames.carrying(point), self.desired.carrying(point))

    @property
    def p_c(self) -> Array:
        """(N, 3) [m] origin of the compliant frame."""
        return self.frames.p

    @cached_property
    def speed(self) -> Array:
        """(N,) [m/s] of its origin."""
        with np.errstate(over="ignore"):  # a run that diverged
            speed: Array = np.linalg.norm(self.frames.dp, axis=1)
        return speed

    @cached_property
    def p_cd_d(self) -> Array:
        """(N, 3) [m] displacement from the desired frame, in its axes."""
        return turn_back(self.desired.R, self.frames.p - self.desired.p)

    @cached_property
    def R_cd(self) -> Array:
        """(N, 3, 3) orientation relative to the desired frame."""
        R_cd: Array = transposed(self.desired.R) @ self.frames.R
        return R_cd

    @cached_property
    def rho_cd_d(self) -> Array:
        """(N, 3) [rad] rotation vector of R_cd."""
        return rotation_vectors(quaternions(self.R_cd))

    @cached_property
    def Q_cd(self) -> Array:
        """(N, 4) eta_cd, eps_cd_d of R_cd, with eta_cd >= 0, eq. (64)."""
        return np.column_stack(quaternions(self.R_cd))

    @cached_property
    def x(self) -> Array:
        """(N, 3) [rad/s] angular velocity relative to the desired frame, in its axes."""
        return turn_back(self.desired.R, self.frames.omega - self.desired.omega)

    @cached_property
    def dx(self) -> Array:
        """(N, 3) [rad/s^2] rate of the components x.

        R_d' (domega_c - domega_d - omega_d x omega_c): the axes of the components turn (erratum
        of (59)).
        """
        c, d = self.frames, self.desired
        return turn_back(d.R, c.domega - d.domega - np.cross(d.omega, c.omega))
