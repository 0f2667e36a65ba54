"""(24), (38), (50), (59), (62): what is left of them as they hold, and as they are printed."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from eulerparams_control.lab.experiments.library._arms import ur5
from eulerparams_control.lab.experiments.library._samples import (
    accelerated,
    derivative,
    derivatives,
    generator,
    rotations,
    size,
    turning,
    vectors,
)
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import EulerSequence, representation
from eulerparams_control.laws.orientation.euler_angles import AnglesInput
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
    RelativeTurn,
)
from eulerparams_control.laws.orientation.sequences import wrap
from eulerparams_control.laws.rotations import Array, EulerParameters, exp
from eulerparams_control.robot.robot import Robot

Residuals = Iterator[tuple[str, float]]

_SAMPLES = 300
_CLEAR = 0.3  # [rad] from the pole
_XYZ = EulerSequence("XYZ")
_k_P, _k_V = 50.0, 14.142
_Z = Impedance(np.eye(3), 14.0 * np.eye(3), 50.0 * np.eye(3))
_SMALL = 1e-5  # [rad] of an infinitesimal turn: what (62) leaves out is half of it


def errata() -> Residuals:
    """Yield the residuals of the equations that are wrong in print."""
    yield from _inverse_of_J_A()
    yield from _resolved()
    yield from _compliant()
    yield from _turning_frame()
    yield from _stiffness()


def _clear_of_poles(key: int) -> list[Array]:
    """Return rotations away from the poles of XYZ, where T is regular."""
    return [R for R in rotations(2 * _SAMPLES, key) if _XYZ.pole_distance(R) > _CLEAR][:_SAMPLES]


def _inverse_of_J_A() -> Residuals:
    """Yield those of (24): J^-1 diag(I, T) is the inverse of J_A, the derivative of (p_e, phi_e).

    J_A comes by differences of the direct kinematics, without J and T.
    """
    robot, home = ur5()
    for turn in generator(20).uniform(-0.4, 0.4, size=(_SAMPLES, robot.n)):
        q = home + turn
        state = robot.state(q, np.zeros(robot.n))
        if _XYZ.pole_distance(state.R_e) > _CLEAR:
            phi_e = _XYZ.extract(state.R_e)
            pose = partial(_pose, robot, q, phi_e)
            J_A = np.column_stack([derivatives(partial(pose, dq))[0] for dq in np.eye(robot.n)])
            J_inverse = np.linalg.inv(state.J)
            product = np.hstack((J_inverse[:, :3], J_inverse[:, 3:] @ _XYZ.T(phi_e)))
            yield "(24)", size(product @ J_A - np.eye(robot.n))


def _pose(robot: Robot, q: Array, phi: Array, dq: Array, t: float) -> Array:
    """Return (p_e, phi_e) (6,) at q + t dq, the angles next to phi."""
    state = robot.state(q + t * dq, np.zeros(robot.n))
    return np.concatenate((state.p_e, _next_to(phi, _XYZ.extract(state.R_e))))


def _next_to(phi: Array, there: Array) -> Array:
    """Return angles moved by whole turns next to phi (3,)."""
    return phi + wrap(there - phi)


def _resolved() -> Residuals:
    """Yield those of (38): along domega_e = a_o the angles, differenced twice, obey (39)."""
    law = representation("euler_angles")
    pairs = zip(_clear_of_poles(21), _clear_of_poles(22), strict=True)
    motions = zip(vectors(_SAMPLES, 23), vectors(_SAMPLES, 24), vectors(_SAMPLES, 25), strict=True)
    for (R_d, R_e), (omega_d, domega_d, omega_e) in zip(pairs, motions, strict=True):
        x_de = law.displacement(R_d, R_e)
        a_o = law.resolved_acceleration(x_de, omega_d, domega_d, omega_e, _k_P, _k_V)
        dphi_d, ddphi_d = _rates(accelerated(R_d, omega_d, domega_d))
        printed = a_o + _XYZ.T(x_de.phi_e) @ (dphi_d - ddphi_d)
        for name, domega_e in (("(38)", a_o), ("(38) as printed", printed)):
            yield name, _left(x_de.dphi_de, (dphi_d, ddphi_d), R_e, omega_e, domega_e)


def _rates(R_of: Callable[[float], Array]) -> tuple[Array, Array]:
    """Return dphi, ddphi (3,) of a frame that moves, at t = 0: of its angles, without T and dT."""
    phi = _XYZ.extract(R_of(0.0))
    return derivatives(lambda t: _next_to(phi, _XYZ.extract(R_of(t))))


def _left(
    error: Array, aims: tuple[Array, Array], R_e: Array, omega_e: Array, domega_e: Array
) -> float:
    """Return what is left of (39), or (51), of an end effector that moves so.

    Args:
        error: (3,) [rad] Delta phi, of what it follows to it.
        aims: the first and second derivative of the angles of what it follows.
        R_e: (3, 3) where it is.
        omega_e: (3,) [rad/s].
        domega_e: (3,) [rad/s^2].
    """
    dphi_e, ddphi_e = _rates(accelerated(R_e, omega_e, domega_e))
    dphi, ddphi = aims
    return size(ddphi - ddphi_e + _k_V * (dphi - dphi_e) + _k_P * error)


def _compliant() -> Residuals:
    """Yield those of (50): along domega_e = a_o the angles phi_c - phi_e obey (51).

    The compliant frame is that of (55): its angles are phi_d + Delta phi_cd, those of the desired
    frame differenced, and the law gets what follows from them, R_c, omega_c and domega_c.
    """
    law = representation("euler_angles")
    (begin, drive, rate, _, end_of), options = law.compliance, law.options.values
    frames = zip(*(_clear_of_poles(key) for key in (33, 34, 35)), strict=True)
    motions = zip(*(vectors(_SAMPLES, key) for key in range(36, 41)), strict=True)
    for (R_d, R_c, R_e), (omega_d, domega_d, omega_c, mu, omega_e) in zip(
        frames, motions, strict=True
    ):
        u = drive(R_d, mu, AnglesInput(np.zeros(3), mu), options)
        y = begin(R_d, omega_d, R_c, omega_c, options)
        dy = rate(y, u, _Z.values, options)
        end = end_of(y, dy, u, R_d, omega_d, domega_d, options)
        x_ce = law.displacement(end.R_c, R_e)
        a_o = law.resolved_acceleration(x_ce, end.omega_c, end.domega_c, omega_e, _k_P, _k_V)
        dphi_d, ddphi_d = _rates(accelerated(R_d, omega_d, domega_d))
        aims = dphi_d + y.dphi_cd, ddphi_d + dy.dphi_cd
        error = wrap(_XYZ.extract(R_d) + y.phi_cd - x_ce.phi_e)
        T, dphi_e = _XYZ.T(x_ce.phi_e), _XYZ.rates(x_ce.phi_e, omega_e)
        printed = a_o - _XYZ.dT(x_ce.phi_e, dphi_e) @ dphi_e + T @ dphi_e
        for name, domega_e in (("(50)", a_o), ("(50) as printed", printed)):
            yield name, _left(error, aims, R_e, omega_e, domega_e)


def _turning_frame() -> Residuals:
    """Yield those of (59): the acceleration of the compliant frame while the desired one turns."""
    law = representation("euler_parameters")
    end, options = law.compliance.end, law.options.values
    moving = zip(vectors(_SAMPLES, 26), vectors(_SAMPLES, 27), vectors(_SAMPLES, 28), strict=True)
    for R_d, (omega_d, x, dx) in zip(rotations(_SAMPLES, 29), moving, strict=True):
        zero = np.zeros(3)
        y = RelativeTurn(EulerParameters(1.0, zero), x)
        dy = RelativeTurn(EulerParameters(0.0, zero), dx)
        found = end(y, dy, zero, R_d, omega_d, zero, options).domega_c
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
