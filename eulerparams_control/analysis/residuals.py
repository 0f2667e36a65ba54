"""What the impedance equations (52), (59) leave of a recorded wrench: 0 where they hold."""

from typing import NamedTuple

import numpy as np

from eulerparams_control.analysis.compliant import CompliantMotion
from eulerparams_control.impedance import Impedance
from eulerparams_control.motion import DesiredFrame
from eulerparams_control.rotations import Array, EulerParameters, cross

_UNKNOWN = np.full(3, np.nan)


class _Displacement(NamedTuple):
    """x (3,) [m] with its first and second derivative."""

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
    rows = []
    for c, d, f_t in zip(compliant.frames, compliant.desired, f, strict=True):
        if d is None:
            rows.append(_UNKNOWN)
            continue
        x, dx, ddx = _in_base(c, d) if frame == "base" else _in_desired(c, d)
        f_t = f_t if frame == "base" else d.R_d.T @ f_t
        rows.append(f_t - (Z.M @ ddx + Z.D @ dx + Z.K @ x))
    return np.array(rows)


def rotational_residual(compliant: CompliantMotion, mu: Array, Z: Impedance) -> Array:
    """Return mu^d - (M_o dx + D_o x + K_o' eps_cd_d) (N, 3) [Nm], eq. (59).

    NaN without a desired frame.

    Args:
        compliant: motion of the compliant frame.
        mu: (N, 3) [Nm] contact moment at the same instants, base axes.
        Z: M_o, D_o, K_o.
    """
    rows = []
    for index, (d, mu_t) in enumerate(zip(compliant.desired, mu, strict=True)):
        if d is None:
            rows.append(_UNKNOWN)
            continue
        x, dx = compliant.x[index], compliant.dx[index]
        eta, *eps = compliant.Q_cd[index].tolist()
        Q = EulerParameters(eta, np.array(eps))
        mu_E = 2 * Q.E.T @ Z.K @ Q.eps  # eqs. (60), (66)
        rows.append(d.R_d.T @ mu_t - (Z.M @ dx + Z.D @ x + mu_E))
    return np.array(rows)


def _in_base(c: DesiredFrame, d: DesiredFrame) -> _Displacement:
    return _Displacement(c.p_d - d.p_d, c.dp_d - d.dp_d, c.ddp_d - d.ddp_d)


def _in_desired(c: DesiredFrame, d: DesiredFrame) -> _Displacement:
    """Return the components of p_c - p_d in the desired frame and their derivatives."""
    p, dp, ddp = _in_base(c, d)
    omega, domega = d.omega_d, d.domega_d
    dx = dp - cross(omega, p)  # in base axes, as seen from the frame that turns
    ddx = ddp - cross(domega, p) - 2 * cross(omega, dx) - cross(omega, cross(omega, p))
    return _Displacement(d.R_d.T @ p, d.R_d.T @ dx, d.R_d.T @ ddx)
