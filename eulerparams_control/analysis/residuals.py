"""What the impedance equations (52), (59) leave of a recorded wrench: 0 where they hold."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.analysis.compliant import CompliantMotion
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.rotations_batch import turn_back


class _Displacement(NamedTuple):
    """x (N, 3) [m] with its first and second derivative."""

    x: Array
    dx: Array
    ddx: Array


def translational_residual(
    compliant: CompliantMotion, f: Array, Z: Impedance, frame: str
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
    f = f if in_base else turn_back(d.R, f)
    residual: Array = f - (ddx @ Z.M.T + dx @ Z.D.T + x @ Z.K.T)
    return residual


def rotational_residual(compliant: CompliantMotion, mu: Array, Z: Impedance) -> Array:
    """Return mu^d - (M_o dx + D_o x + K_o' eps_cd_d) (N, 3) [Nm], eq. (59).

    NaN without a desired frame.

    Args:
        compliant: motion of the compliant frame.
        mu: (N, 3) [Nm] contact moment at the same instants, base axes.
        Z: M_o, D_o, K_o.
    """
    eta, eps = compliant.Q_cd[:, :1], compliant.Q_cd[:, 1:]
    K_eps = eps @ Z.K.T
    mu_E = 2 * (eta * K_eps + np.cross(eps, K_eps))  # 2 E' K_o eps, eqs. (60), (66)
    mu_d = turn_back(compliant.desired.R, mu)
    residual: Array = mu_d - (compliant.dx @ Z.M.T + compliant.x @ Z.D.T + mu_E)
    return residual


def _in_base(c: Frames, d: Frames) -> _Displacement:
    return _Displacement(c.p - d.p, c.dp - d.dp, c.ddp - d.ddp)


def _in_desired(c: Frames, d: Frames) -> _Displacement:
    """Return the components of p_c - p_d in the desired frame and their derivatives."""
    p, dp, ddp = _in_base(c, d)
    omega, domega = d.omega, d.domega
    dx = dp - np.cross(omega, p)  # in base axes, as seen from the frame that turns
    ddx = ddp - np.cross(domega, p) - 2 * np.cross(omega, dx) - np.cross(omega, np.cross(omega, p))
    return _Displacement(*(turn_back(d.R, v) for v in (p, dx, ddx)))
