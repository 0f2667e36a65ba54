"""The compliant frame over time, against the desired frame: what the impedance of section V does.

Notation: ``p_cd_d`` (3,) [m] R_d' (p_c - p_d); ``R_cd`` (3, 3) R_d' R_c; ``rho_cd_d`` (3,) [rad]
its rotation vector; ``x`` (3,) [rad/s] R_d' (omega_c - omega_d), as in (59); all of them in the
desired frame.

The impedance equations (52), (55), (59) relate motion and wrench at the centre of compliance of the
node impedance_control, which may be off the tip.  What they leave of a recorded wrench is 0 where
they hold.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.series import Frames
from eulerparams_control.analysis.stacks import quaternions, rotation_vectors
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.rotations import Array, quaternion
from eulerparams_control.motion.frames import AT_ORIGIN, Placement
from eulerparams_control.parameters.impedance_control import ImpedanceParameters

_FELT = 1e-6  # [N], [Nm] smallest contact that is not rounding


def in_axes(R: Array, vectors: Array) -> Array:
    """Return R' v (N, 3): vectors v (N, 3) by their components in axes R (N, 3, 3)."""
    components: Array = np.einsum("nji,nj->ni", R, vectors)
    return components


def _times(M: Array, x: Array) -> Array:
    """Return M x (N, 3) for a matrix M (3, 3), or one for each sample (N, 3, 3)."""
    product: Array = (M @ x[..., None])[..., 0]
    return product


class SensorSeries(NamedTuple):
    """Measurements of a force/torque sensor over time.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        w: (N, 6) [N, Nm] as measured, in the frame of the same index and about its origin.
        frames: (N,) names of links.
    """

    t: Array
    w: Array
    frames: NDArray[Any]


class Wrenches(NamedTuple):
    """Contact wrench over time, of the environment on the tool: f, mu of (52), (59).

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        f: (N, 3) [N] force, base axes.
        mu: (N, 3) [Nm] moment about the origin of the tip, base axes.
    """

    t: Array
    f: Array
    mu: Array

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return f and mu (M, 3) at instants t (M,) [s], the last samples; NaN before the first."""
        index = np.searchsorted(self.t, t, side="right") - 1
        f, mu = self.f[index], self.mu[index]
        f[index < 0] = mu[index < 0] = np.nan
        return f, mu

    @property
    def is_felt(self) -> bool:
        """Whether there is more in it than rounding."""
        return bool(np.abs(self.f).max() > _FELT or np.abs(self.mu).max() > _FELT)


class ActingImpedance(NamedTuple):
    """The impedance, or the springs, that acted, each from its instant on.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        numbers: (N, 38) upper triangles of M_p, D_p, K_p, M_o, D_o, K_o, and the clips of springs,
            [m], [rad]; 0 what there is none of.
    """

    t: Array
    numbers: Array

    @property
    def matrices(self) -> Array:
        """(N, 6, 3, 3) M_p, D_p, K_p, M_o, D_o, K_o."""
        found = np.empty((len(self.t), 6, 3, 3))
        rows, columns = np.triu_indices(3)
        numbers = self.numbers[:, :36].reshape(-1, 6, 6)
        found[..., rows, columns] = found[..., columns, rows] = numbers
        return found

    def before(self, t: Array) -> NDArray[np.intp]:
        """Return the places (M,) of what acted at instants t (M,) [s]; -1 before the first."""
        return np.searchsorted(self.t, t, side="right") - 1


class Impedances(NamedTuple):
    """M, D, K (N, 3, 3) of one of the two equations of an impedance, at N instants."""

    M: Array
    D: Array
    K: Array

    def at(self, place: int) -> Impedance:
        """Return the one at an instant."""
        return Impedance(self.M[place], self.D[place], self.K[place])


def impedances(
    t: Array, told: ImpedanceParameters, acting: ActingImpedance | None
) -> tuple[Impedances, Impedances]:
    """Return the impedances of translation and rotation that acted at instants t (N,) [s].

    Args:
        t: instants.
        told: the parameters, which count before the first one that was recorded.
        acting: those recorded; None if there are none.

    Raises:
        ConfigurationError: if the parameters are impossible.
    """
    Z_p, Z_o = told.translation(), told.rotation()
    found = np.empty((len(t), 6, 3, 3))
    found[:] = [Z_p.M, Z_p.D, Z_p.K, Z_o.M, Z_o.D, Z_o.K]
    if acting is not None:
        last = acting.before(t)
        found[last >= 0] = acting.matrices[last[last >= 0]]
    return Impedances(*np.moveaxis(found[:, :3], 1, 0)), Impedances(
        *np.moveaxis(found[:, 3:], 1, 0)
    )


class PressedForce(NamedTuple):
    """The force of the tool ON the environment, and its target, along the axes of the compliance.

    Attributes:
        t: (N,) [s] of the wrench.
        f: (N, 3) [N] exerted along force_axes, 0 along the others.
        f_d: (N, 3) [N] asked for; NaN where nothing is.
        R: (N, 3, 3) the axes, as columns, base frame.
        on: (3,) 1 for each of force_axes, else 0.
    """

    t: Array
    f: Array
    f_d: Array
    R: Array
    on: Array


def shifted(w: Array, sensor: Placement) -> tuple[Array, Array]:
    """Return force and moment (N, 3) of the sensor frame in the axes of the tip, about it."""
    f_t = w[:, :3] @ sensor.R.T
    return f_t, w[:, 3:] @ sensor.R.T + np.cross(sensor.p, f_t)


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

    @cached_property
    def p_cd_d(self) -> Array:
        """(N, 3) [m] displacement from the desired frame, in its axes."""
        return in_axes(self.desired.R, self.frames.p - self.desired.p)

    @cached_property
    def R_cd(self) -> Array:
        """(N, 3, 3) orientation relative to the desired frame."""
        R_cd: Array = np.swapaxes(self.desired.R, 1, 2) @ self.frames.R
        return R_cd

    @cached_property
    def rho_cd_d(self) -> Array:
        """(N, 3) [rad] rotation vector of R_cd."""
        return rotation_vectors(self.R_cd)

    @cached_property
    def Q_cd(self) -> Array:
        """(N, 4) eta_cd, eps_cd_d of R_cd, with eta_cd >= 0, eq. (64)."""
        return quaternions(map(quaternion, self.R_cd))

    @cached_property
    def x(self) -> Array:
        """(N, 3) [rad/s] angular velocity relative to the desired frame, in its axes."""
        return in_axes(self.desired.R, self.frames.omega - self.desired.omega)

    @cached_property
    def dx(self) -> Array:
        """(N, 3) [rad/s^2] rate of the components x.

        R_d' (domega_c - domega_d - omega_d x omega_c): the axes of the components turn (erratum
        of (59)).
        """
        c, d = self.frames, self.desired
        return in_axes(d.R, c.domega - d.domega - np.cross(d.omega, c.omega))


class ImpedanceRun(NamedTuple):
    """An impedance at work, at N instants.

    Attributes:
        motion: of the compliant and the desired frame at the centre of compliance.
        f: (N, 3) [N] contact force, base axes; 0 if no wrench is known.
        mu: (N, 3) [Nm] contact moment about the centre, base axes; 0 if no wrench is known.
    """

    motion: CompliantMotion
    f: Array
    mu: Array

    @property
    def f_d(self) -> Array:
        """(N, 3) [N] f in the desired frame; NaN where there is none."""
        return self._in_desired(self.f)

    @property
    def mu_d(self) -> Array:
        """(N, 3) [Nm] mu in the desired frame; NaN where there is none."""
        return self._in_desired(self.mu)

    def _in_desired(self, vectors: Array) -> Array:
        return in_axes(self.motion.desired.R, vectors)


class _Displacement(NamedTuple):
    """x (N, 3) [m] with its first and second derivative."""

    x: Array
    dx: Array
    ddx: Array


def translational_residual(
    compliant: CompliantMotion, f: Array, Z: Impedance | Impedances, frame: str
) -> Array:
    """Return f - (M_p ddx + D_p dx + K_p x) (N, 3) [N], eq. (52); NaN without a desired frame.

    Args:
        compliant: motion of the compliant frame.
        f: (N, 3) [N] contact force at the same instants, base axes.
        Z: M_p, D_p, K_p.
        frame: whose axes these refer to, "base" or "desired".
    """
    c, d = compliant.frames, compliant.desired
    in_base = frame == "base"
    x, dx, ddx = _in_base(c, d) if in_base else _in_desired(c, d)
    f = f if in_base else in_axes(d.R, f)
    residual: Array = f - (_times(Z.M, ddx) + _times(Z.D, dx) + _times(Z.K, x))
    return residual


def rotational_residual(compliant: CompliantMotion, mu: Array, Z: Impedance | Impedances) -> Array:
    """Return mu^d - (M_o dx + D_o x + K_o' eps_cd_d) (N, 3) [Nm], eq. (59).

    NaN without a desired frame.

    Args:
        compliant: motion of the compliant frame.
        mu: (N, 3) [Nm] contact moment at the same instants, base axes.
        Z: M_o, D_o, K_o.
    """
    eta, eps = compliant.Q_cd[:, :1], compliant.Q_cd[:, 1:]
    K_eps = _times(Z.K, eps)
    mu_E = 2 * (eta * K_eps + np.cross(eps, K_eps))  # 2 E' K_o eps, eqs. (60), (66)
    mu_d = in_axes(compliant.desired.R, mu)
    residual: Array = mu_d - (_times(Z.M, compliant.dx) + _times(Z.D, compliant.x) + mu_E)
    return residual


def _in_base(c: Frames, d: Frames) -> _Displacement:
    return _Displacement(c.p - d.p, c.dp - d.dp, c.ddp - d.ddp)


def _in_desired(c: Frames, d: Frames) -> _Displacement:
    """Return the components of p_c - p_d in the desired frame and their derivatives."""
    p, dp, ddp = _in_base(c, d)
    omega, domega = d.omega, d.domega
    dx = dp - np.cross(omega, p)  # in base axes, as seen from the frame that turns
    ddx = ddp - np.cross(domega, p) - 2 * np.cross(omega, dx) - np.cross(omega, np.cross(omega, p))
    return _Displacement(*(in_axes(d.R, v) for v in (p, dx, ddx)))
