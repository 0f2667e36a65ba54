"""(24), (38), (50), (59), (62): what is left of them as they hold, and as they are printed."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from eulerparams_control.experiments.library._arms import ur5
from eulerparams_control.experiments.library._samples import (
    derivative,
    generator,
    rotations,
    size,
    turning,
    vectors,
)
from eulerparams_control.orientation import EulerSequence, representation
from eulerparams_control.orientation.relative_quaternion import RelativeQuaternionRepresentation
from eulerparams_control.rotations import Array, EulerParameters, exp

Residuals = Iterator[tuple[str, float]]

_SAMPLES = 300
_CLEAR = 0.3  # [rad] from the pole
_XYZ = EulerSequence("XYZ")
_k_P, _k_V = 50.0, 14.142
_SMALL = 1e-5  # [rad] of an infinitesimal turn: what (62) leaves out is half of it


def errata() -> Residuals:
    """Yield the residuals of the equations that are wrong in print."""
    yield from _inverse_of_J_A()
    yield from _accelerations()
    yield from _turning_frame()
    yield from _stiffness()


def _clear_of_poles(key: int) -> list[Array]:
    """Return rotations away from the poles of XYZ, where T is regular."""
    return [R for R in rotations(2 * _SAMPLES, key) if _XYZ.pole_distance(R) > _CLEAR][:_SAMPLES]


def _inverse_of_J_A() -> Residuals:
    """Yield those of (24): J^-1 diag(I, T) is the inverse of J_A, which is never built."""
    robot, home = ur5()
    for turn in generator(20).uniform(-0.4, 0.4, size=(_SAMPLES, robot.n)):
        state = robot.state(home + turn, np.zeros(robot.n))
        if _XYZ.pole_distance(state.R_e) > _CLEAR:
            T = _XYZ.T(_XYZ.extract(state.R_e))
            J_A = np.vstack((state.J[:3], np.linalg.solve(T, state.J[3:])))
            J_inverse = np.linalg.inv(state.J)
            product = np.hstack((J_inverse[:, :3], J_inverse[:, 3:] @ T))
            yield "(24)", size(product @ J_A - np.eye(robot.n))


def _accelerations() -> Residuals:
    """Yield those of (38), (50): along domega_e = a_o the error obeys (39)."""
    law = representation("euler_angles")
    pairs = zip(_clear_of_poles(21), _clear_of_poles(22), strict=True)
    motions = zip(vectors(_SAMPLES, 23), vectors(_SAMPLES, 24), vectors(_SAMPLES, 25), strict=True)
    for (R_d, R_e), (omega_d, domega_d, omega_e) in zip(pairs, motions, strict=True):
        x_de = law.displacement(R_d, R_e)
        a_o = law.resolved_acceleration(x_de, omega_d, domega_d, omega_e, _k_P, _k_V)
        T, phi_d, phi_e = _XYZ.T(x_de.phi_e), x_de.phi_d, x_de.phi_e
        dphi_d, dphi_e = _XYZ.rates(phi_d, omega_d), _XYZ.rates(phi_e, omega_e)
        ddphi_d = _XYZ.rates(phi_d, domega_d - _XYZ.dT(phi_d, dphi_d) @ dphi_d)
        last = _XYZ.dT(phi_e, dphi_e) @ dphi_e

        def left(a_o: Array, e: Array = phi_e, last: Array = last, dd: Array = ddphi_d,
                 rest: Array = _k_V * (dphi_d - dphi_e) + _k_P * x_de.dphi_de) -> float:
            """Return what is left of (39) where domega_e = a_o, eq. (35)."""
            return size(dd - _XYZ.rates(e, a_o - last) + rest)

        yield "(38)", left(a_o)
        yield "(38) as printed", left(a_o + T @ (dphi_d - ddphi_d))
        yield "(50)", left(a_o)
        yield "(50) as printed", left(a_o - last + T @ dphi_e)


def _turning_frame() -> Residuals:
    """Yield those of (59): the acceleration of the compliant frame while the desired one turns."""
    law = representation("euler_parameters")
    moving = zip(vectors(_SAMPLES, 26), vectors(_SAMPLES, 27), vectors(_SAMPLES, 28), strict=True)
    for R_d, (omega_d, x, dx) in zip(rotations(_SAMPLES, 29), moving, strict=True):
        y = np.concatenate(([1.0, 0.0, 0.0, 0.0], x))
        dy = np.concatenate((np.zeros(4), dx))
        zero = np.zeros(3)
        found = law.compliance_end(y, dy, zero, R_d, omega_d, zero).domega_c
        rate = derivative(partial(_omega_c, R_d, omega_d, x, dx))
        yield "(59)", size(found - rate)
        yield "(59) as printed", size(R_d @ dx - rate)


def _omega_c(R_d: Array, omega_d: Array, x: Array, dx: Array, t: float) -> Array:
    """Return omega_c (3,) at t: of components x + t dx in the desired frame, which turns."""
    return omega_d + turning(R_d, omega_d)(t) @ (x + t * dx)


def _stiffness() -> Residuals:
    """Yield those of (62), relative: the moment of an infinitesimal turn is K_o times it."""
    law = representation("euler_parameters")
    assert isinstance(law, RelativeQuaternionRepresentation)
    axes, values = rotations(_SAMPLES, 30), generator(31).uniform(20, 100, (_SAMPLES, 3))
    for U, gamma, turn in zip(axes, values, vectors(_SAMPLES, 32), strict=True):
        K_o, x = (U * gamma) @ U.T, _SMALL * turn / np.linalg.norm(turn)
        Q = EulerParameters.from_R(exp(x))
        moment = size(K_o @ x)
        yield "(62)", size(law.elastic_moment(Q, K_o) - K_o @ x) / moment
        printed = EulerParameters(Q.eta - 1, Q.eps).E.T @ K_o @ x  # E'(d eta, d eps)
        yield "(62) as printed", size(printed - K_o @ x) / moment
