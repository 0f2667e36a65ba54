"""The compliant frame over time, against the desired frame: what the impedance of section V does.

Notation: ``p_cd_d`` (3,) [m] R_d' (p_c - p_d); ``R_cd`` (3, 3) R_d' R_c; ``rho_cd_d`` (3,) [rad]
its rotation vector; ``x`` (3,) [rad/s] R_d' (omega_c - omega_d), as in (59); all of them in the
desired frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eulerparams_control.analysis.series import Frames
from eulerparams_control.motion import AT_ORIGIN, DesiredFrame, Placement
from eulerparams_control.rotations import Array, EulerParameters, cross, log

_NOWHERE = np.full(3, np.nan)


@dataclass(frozen=True)
class CompliantMotion:
    """The compliant frame over time, with the desired frame at the same instants.

    What is relative to the desired frame is NaN where there is none.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        frames: N compliant frames; their p_d, R_d, ... are p_c, R_c, ...
        desired: N desired frames, or None where nothing was desired yet.
    """

    t: Array
    frames: tuple[DesiredFrame, ...] = field(repr=False)
    desired: Frames = field(repr=False)

    def at(self, t: Array) -> Frames:
        """Return the compliant frame at each of the instants t (M,) [s], None where is none."""
        frames = dict(zip(self.t.tolist(), self.frames, strict=True))
        return [frames.get(instant) for instant in t.tolist()]

    def carrying(self, point: Placement) -> "CompliantMotion":
        """Return the motion of what both frames carry rigidly at ``point``."""
        if point is AT_ORIGIN:
            return self
        desired = [None if frame is None else frame.carrying(point) for frame in self.desired]
        carried = tuple(frame.carrying(point) for frame in self.frames)
        return CompliantMotion(self.t, carried, desired)

    @cached_property
    def p_c(self) -> Array:
        """(N, 3) [m] origin of the compliant frame."""
        return np.array([frame.p_d for frame in self.frames])

    @cached_property
    def speed(self) -> Array:
        """(N,) [m/s] of its origin."""
        with np.errstate(over="ignore"):  # a run that diverged
            return np.linalg.norm([frame.dp_d for frame in self.frames], axis=1)

    @cached_property
    def p_cd_d(self) -> Array:
        """(N, 3) [m] displacement from the desired frame, in its axes."""
        return self._relative(lambda c, d: d.R_d.T @ (c.p_d - d.p_d))

    @cached_property
    def R_cd(self) -> Array:
        """(N, 3, 3) orientation relative to the desired frame."""
        pairs = zip(self.frames, self.desired, strict=True)
        nowhere = np.full((3, 3), np.nan)
        return np.array([nowhere if d is None else d.R_d.T @ c.R_d for c, d in pairs])

    @cached_property
    def rho_cd_d(self) -> Array:
        """(N, 3) [rad] rotation vector of R_cd."""
        return self._relative(lambda c, d: log(d.R_d.T @ c.R_d))

    @cached_property
    def Q_cd(self) -> Array:
        """(N, 4) eta_cd, eps_cd_d of R_cd, with eta_cd >= 0, eq. (64)."""
        known = np.isfinite(self.R_cd[:, 0, 0])
        Q = np.full((len(self.t), 4), np.nan)
        Q[known] = [[eta, *eps] for eta, eps in map(EulerParameters.from_R, self.R_cd[known])]
        return Q

    @cached_property
    def x(self) -> Array:
        """(N, 3) [rad/s] angular velocity relative to the desired frame, in its axes."""
        return self._relative(lambda c, d: d.R_d.T @ (c.omega_d - d.omega_d))

    @cached_property
    def dx(self) -> Array:
        """(N, 3) [rad/s^2] rate of the components x.

        R_d' (domega_c - domega_d - omega_d x omega_c): the axes of the components turn (erratum
        of (59)).
        """
        return self._relative(
            lambda c, d: d.R_d.T @ (c.domega_d - d.domega_d - cross(d.omega_d, c.omega_d))
        )

    def _relative(self, of: Callable[[DesiredFrame, DesiredFrame], Array]) -> Array:
        """Return ``of`` the compliant and the desired frame (N, 3)."""
        pairs = zip(self.frames, self.desired, strict=True)
        return np.array([_NOWHERE if d is None else of(c, d) for c, d in pairs])
