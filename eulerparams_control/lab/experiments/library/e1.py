"""E1: (1)-(17) hold for random samples and all 12 sequences, with the errata of the print.

What is left of each equation, also of (24), (38), (50), (59) and (62), as they hold and as they
are printed.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import chain

import numpy as np

from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._arms import SEED, ur5
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import SEQUENCES, EulerSequence, representation
from eulerparams_control.laws.orientation.relative_quaternion import (
    RelativeQuaternionRepresentation,
)
from eulerparams_control.laws.orientation.sequences import wrap
from eulerparams_control.laws.rotations import (
    Array,
    EulerParameters,
    R_angle_axis,
    S,
    exp,
    mutual,
    mutual_R,
    propagation,
    quaternion,
)
from eulerparams_control.robot.robot import Robot

Residuals = Iterator[tuple[str, float]]

ALGEBRAIC, DIFFERENCES, TWICE = 1e-12, 1e-8, 1e-7
PRINTED = "as printed"

_BY_DIFFERENCES = ("(1)", "(3)", "(8)", "(9)", "(14)", "(16)", "(17)", "(24)", "(59)")
_BY_SECOND_DIFFERENCES = ("(38)", "(50)")
_FIRST_ORDER = "(62)"
_LEAST = 1e-17  # what is drawn for a residual of 0

SAMPLES, FEW = 2000, 300  # of (1)-(17), of the errata
_CLEAR = 0.3  # [rad] from the pole: derivatives of the angles grow like 1 / distance^3

_XYZ = EulerSequence("XYZ")
_k_P, _k_V = 50.0, 14.142
_Z = Impedance(np.eye(3), 14.0 * np.eye(3), 50.0 * np.eye(3))
_SMALL = 1e-5  # [rad] of an infinitesimal turn: what (62) leaves out is half of it

STEP = 1e-6  # [s] of the central differences: their floor is about 1e-9

# Central differences of eighth order (Fornberg, 1988), of a function at 0, 1, ..., 4 steps.
# Rounding leaves about 1e-15 / step^2 of the second derivative, what is left out step^8; at 1 ms
# both are below 1e-8 for the angles here.
WIDE_STEP = 1e-3  # [s]
_FIRST = (0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280)
_SECOND = (-205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560)


def run() -> Result:
    """Return the largest residual of each equation, as it holds and as it is printed."""
    found = residuals(chain(one_frame(), angles(), two_frames(), errata()))
    holds = {name: value for name, value in found.items() if PRINTED not in name}
    others = (*_BY_DIFFERENCES, *_BY_SECOND_DIFFERENCES, _FIRST_ORDER)
    algebraic = [n for n in holds if n not in others]
    numbers = {
        "algebraic": Number(
            max(holds[n] for n in algebraic), "largest residual of the algebraic equations"
        ),
        "differences": Number(
            max(holds[n] for n in _BY_DIFFERENCES), "largest residual by central differences"
        ),
    }
    return Result(numbers | dict(map(_number, found.items())), _chart(found))


def residuals(samples: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Return the largest residual by the name of the equation."""
    found: dict[str, float] = {}
    for name, value in samples:
        found[name] = max(found.get(name, 0.0), value)
    return dict(sorted(found.items(), key=lambda item: int(item[0][1:].split(")")[0])))


def _number(item: tuple[str, float]) -> tuple[str, Number]:
    """Return a residual with a name that a file can have, such as ``eq_4_as_printed``."""
    name, value = item
    key = "".join(c if c.isalnum() else "_" for c in name.replace("'", "t"))
    return "eq_" + "_".join(filter(None, key.split("_"))), Number(value, f"residual of {name}")


def _chart(found: dict[str, float]) -> Chart:
    equations = list(dict.fromkeys(name.split(" ")[0] for name in found))
    last = len(equations) - 1.0

    def line(label: str, suffix: str) -> Line:
        names = {i: name + suffix for i, name in enumerate(equations)}
        points = [(float(i), max(found[n], _LEAST)) for i, n in names.items() if n in found]
        return Line(label, tuple(points))

    bounds = (
        (TWICE, "bound by second differences"),
        (DIFFERENCES, "bound by differences"),
        (ALGEBRAIC, "bound, algebraic"),
    )
    return Chart(
        "equation",
        "residual",
        (
            *(Line(text, ((0.0, y), (last, y)), "bound") for y, text in bounds),
            line("as it holds", ""),
            line(PRINTED, f" {PRINTED}"),
        ),
        log="y",
        ticks=tuple(equations),
    )


# --- (1)-(17) ------------------------------------------------------------------------------
def one_frame() -> Residuals:
    """Yield the residuals of (1), (4)-(10) for a frame that turns."""
    omegas, thetas = vectors(SAMPLES, 1), generator(2).uniform(0.5, 2.6, SAMPLES)
    for R, omega, theta in zip(rotations(SAMPLES, 0), omegas, thetas.tolist(), strict=True):
        R_of = turning(R, omega)
        yield "(1)", size(derivative(R_of) - S(omega) @ R)
        yield from _angle_axis(theta, omega / np.linalg.norm(omega))
        Q = quaternion(R)
        yield "(6)", size(Q.eta**2 + Q.eps @ Q.eps - 1)
        yield "(7)", size(Q.R - R)
        printed = (Q.eta**2 - Q.eps @ Q.eps) * np.eye(3) + 2 * np.outer(Q.eps, Q.eps)
        printed = printed - 2 * Q.eta * S(Q.eps)
        yield "(7) as printed", size(printed - R)
        yield "(7) as printed, from R'", size(printed - R.T)
        yield from _propagation(Q, R_of, omega, ("(8)", "(9)"))
        yield "(10)", size(Q.E - (Q.eta * np.eye(3) - S(Q.eps)))


def _angle_axis(theta: float, r: Array) -> Residuals:
    R = angle_axis(theta, r)
    yield "(4)", size(R_angle_axis(theta, r) - R)
    printed = math.cos(theta) * np.eye(3) + (1 - math.cos(theta)) * np.outer(r, r)
    printed = printed - math.sin(theta) * S(r)
    yield "(4) as printed", size(printed - R)
    yield "(4) as printed, from R'", size(printed - R.T)
    Q = EulerParameters.from_angle_axis(theta, r)
    there = Q.eta - math.cos(theta / 2), *(Q.eps - math.sin(theta / 2) * r)
    yield "(5)", max(size(Q.R - R), size(np.array(there)))


def _propagation(
    Q: EulerParameters, R_of: Callable[[float], Array], omega: Array, names: tuple[str, str]
) -> Residuals:
    """Yield the residuals of the rates of eta and eps of R_of(t), whose rate is S(omega) R."""

    def along(t: float) -> Array:
        """Return (eta, eps) at t, of the sign of Q."""
        there = quaternion(R_of(t))
        same = 1.0 if there.eta * Q.eta + there.eps @ Q.eps > 0 else -1.0
        return same * np.array([there.eta, *there.eps])

    rate = derivative(along)
    deta, deps = propagation(*Q, omega)
    yield names[0], size(rate[0] - deta)
    yield names[1], size(rate[1:] - deps)


def angles() -> Residuals:
    """Yield the residuals of (2) and (3) for each of the 12 sequences."""
    for key, name in enumerate(SEQUENCES):
        sequence = EulerSequence(name)
        omegas = vectors(SAMPLES, 100 + key)
        for R, omega in zip(rotations(SAMPLES, 200 + key), omegas, strict=True):
            phi = sequence.extract(R)
            turns = phi[:, None] * np.eye(3)[list(sequence.axes)]
            product = exp(turns[0]) @ exp(turns[1]) @ exp(turns[2])
            yield "(2)", max(size(product - R), size(sequence.R(phi) - R))
            if sequence.pole_distance(R) > _CLEAR:
                dphi = derivative(partial(_angles, sequence, turning(R, omega), phi))
                yield "(3)", size(sequence.T(phi) @ dphi - omega)


def _angles(sequence: EulerSequence, R_of: Callable[[float], Array], phi: Array, t: float) -> Array:
    """Return the angles of a frame at t, moved by whole turns next to those at t = 0."""
    there = sequence.extract(R_of(t))
    return there - 2 * np.pi * np.round((there - phi) / (2 * np.pi))


def two_frames() -> Residuals:
    """Yield the residuals of (11)-(17) for two frames that turn."""
    moving = zip(vectors(SAMPLES, 3), vectors(SAMPLES, 4), strict=True)
    frames = zip(rotations(SAMPLES, 5), rotations(SAMPLES, 6), strict=True)
    for (R_1, R_2), (omega_1, omega_2) in zip(frames, moving, strict=True):
        Q_1, Q_2 = quaternion(R_1), quaternion(R_2)
        Q_21, R_21 = mutual(Q_1, Q_2), R_1.T @ R_2
        yield "(11)", size(mutual_R(R_1, R_2).R - R_21)
        sign = 1.0 if Q_21.eta * mutual_R(R_1, R_2).eta >= 0 else -1.0
        yield "(12)", size(sign * Q_21.eta - mutual_R(R_1, R_2).eta)
        yield "(13)", size(sign * Q_21.eps - mutual_R(R_1, R_2).eps)
        yield "(13) in both frames", size(Q_21.eps - R_21 @ Q_21.eps)
        relative = R_1.T @ (omega_2 - omega_1)
        R_of = partial(_mutual, turning(R_1, omega_1), turning(R_2, omega_2))
        yield "(14)", size(derivative(R_of) - S(relative) @ R_21)
        yield "(15)", size(R_1.T @ omega_2 - R_1.T @ omega_1 - relative)
        yield from _propagation(Q_21, R_of, relative, ("(16)", "(17)"))


def _mutual(one: Callable[[float], Array], two: Callable[[float], Array], t: float) -> Array:
    """Return R_21 (3, 3) of two frames that move, eq. (11)."""
    return one(t).T @ two(t)


# --- the errata ----------------------------------------------------------------------------
def errata() -> Residuals:
    """Yield the residuals of the equations that are wrong in print."""
    yield from _inverse_of_J_A()
    yield from _resolved()
    yield from _compliant()
    yield from _turning_frame()
    yield from _stiffness()


def _clear_of_poles(key: int) -> list[Array]:
    """Return rotations away from the poles of XYZ, where T is regular."""
    return [R for R in rotations(2 * FEW, key) if _XYZ.pole_distance(R) > _CLEAR][:FEW]


def _inverse_of_J_A() -> Residuals:
    """Yield those of (24): J^-1 diag(I, T) is the inverse of J_A, the derivative of (p_e, phi_e).

    J_A comes by differences of the direct kinematics, without J and T.
    """
    robot, home = ur5()
    for turn in generator(20).uniform(-0.4, 0.4, size=(FEW, robot.n)):
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
    motions = zip(vectors(FEW, 23), vectors(FEW, 24), vectors(FEW, 25), strict=True)
    for (R_d, R_e), (omega_d, domega_d, omega_e) in zip(pairs, motions, strict=True):
        x_de = law.displacement(R_d, R_e)
        a_o = law.acceleration(x_de, omega_d, domega_d, omega_e, _k_P, _k_V)
        dphi_d, ddphi_d = _rates(accelerated(R_d, omega_d, domega_d))
        printed = a_o + _XYZ.T(x_de.phi_e) @ (dphi_d - ddphi_d)
        for name, domega_e in (("(38)", a_o), ("(38) as printed", printed)):
            yield name, _left(x_de.error, (dphi_d, ddphi_d), R_e, omega_e, domega_e)


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
    frames = zip(*(_clear_of_poles(key) for key in (33, 34, 35)), strict=True)
    motions = zip(*(vectors(FEW, key) for key in range(36, 41)), strict=True)
    for (R_d, R_c, R_e), (omega_d, domega_d, omega_c, mu, omega_e) in zip(
        frames, motions, strict=True
    ):
        u = law.relative_input(R_d, mu, None)
        y = law.relative_state(R_d, omega_d, R_c, omega_c)
        dy = law.state_rate(y, u, _Z.values)
        R, omega, domega = law.compliant_rotation(y, dy, u, R_d, omega_d, domega_d)
        x_ce = law.displacement(R, R_e)
        a_o = law.acceleration(x_ce, omega, domega, omega_e, _k_P, _k_V)
        dphi_d, ddphi_d = _rates(accelerated(R_d, omega_d, domega_d))
        aims = dphi_d + y[3:], ddphi_d + dy[3:]
        error = wrap(_XYZ.extract(R_d) + y[:3] - x_ce.phi_e)
        T, dphi_e = _XYZ.T(x_ce.phi_e), _XYZ.rates(x_ce.phi_e, omega_e)
        printed = a_o - _XYZ.dT(x_ce.phi_e, dphi_e) @ dphi_e + T @ dphi_e
        for name, domega_e in (("(50)", a_o), ("(50) as printed", printed)):
            yield name, _left(error, aims, R_e, omega_e, domega_e)


def _turning_frame() -> Residuals:
    """Yield those of (59): the acceleration of the compliant frame while the desired one turns."""
    law = representation("euler_parameters")
    zero, Q = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    moving = zip(vectors(FEW, 26), vectors(FEW, 27), vectors(FEW, 28), strict=True)
    for R_d, (omega_d, x, dx) in zip(rotations(FEW, 29), moving, strict=True):
        y, dy = np.concatenate((Q, x)), np.concatenate((0.0 * Q, dx))
        _, _, found = law.compliant_rotation(y, dy, zero, R_d, omega_d, zero)
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
    axes, values = rotations(FEW, 30), generator(31).uniform(20, 100, (FEW, 3))
    for U, gamma, turn in zip(axes, values, vectors(FEW, 32), strict=True):
        K_o, x = (U * gamma) @ U.T, _SMALL * turn / np.linalg.norm(turn)
        Q = quaternion(exp(x))
        moment = size(K_o @ x)
        yield "(62)", size(law.elastic_moment(*Q, K_o) - K_o @ x) / moment
        printed = EulerParameters(Q.eta - 1, Q.eps).E.T @ K_o @ x  # E'(d eta, d eps)
        yield "(62) as printed", size(printed - K_o @ x) / moment


# --- samples -------------------------------------------------------------------------------
def generator(key: int) -> np.random.Generator:
    """Return a random generator that depends on the key alone."""
    return np.random.default_rng((SEED, key))


def rotations(count: int, key: int) -> list[Array]:
    """Return uniform rotations (3, 3): unit quaternions of Gaussian numbers."""
    q = generator(key).normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    return [EulerParameters(float(eta), np.array(eps)).R for eta, *eps in q]


def vectors(count: int, key: int) -> list[Array]:
    """Return vectors (3,) with components of order 1."""
    return list(generator(key).normal(size=(count, 3)))


def turning(R: Array, omega: Array) -> Callable[[float], Array]:
    """Return the frame t -> R(t) that turns at omega (3,) [rad/s] and is R at t = 0."""
    return lambda t: exp(t * omega) @ R


def accelerated(R: Array, omega: Array, domega: Array) -> Callable[[float], Array]:
    """Return a frame t -> R(t) that is R, turns at omega and accelerates by domega at t = 0.

    Its angular velocity is omega + domega t + O(t^2), for the left Jacobian of exp at x is
    I + S(x) / 2 + O(x^2), and S(omega) omega = 0.
    """
    return lambda t: exp(t * omega + t**2 / 2 * domega) @ R


def derivative(function: Callable[[float], Array]) -> Array:
    """Return the derivative of a function of time at t = 0, by central differences."""
    rate: Array = (function(STEP) - function(-STEP)) / (2 * STEP)
    return rate


def derivatives(function: Callable[[float], Array]) -> tuple[Array, Array]:
    """Return the first and the second derivative of a function of time at t = 0."""
    points = [step * WIDE_STEP for step in range(1, len(_SECOND))]
    ahead, behind = (np.array([function(sign * t) for t in points]) for sign in (1, -1))
    first = np.tensordot(_FIRST[1:], ahead - behind, 1)
    second = _SECOND[0] * function(0.0) + np.tensordot(_SECOND[1:], ahead + behind, 1)
    return first / WIDE_STEP, second / WIDE_STEP**2


def size(value: Array | float) -> float:
    """Return the norm of a residual, of Frobenius for matrices."""
    return float(np.linalg.norm(value))


def angle_axis(theta: float, r: Array) -> Array:
    """Return the rotation (3, 3) by theta [rad] about r by Rodrigues' formula, written out."""
    x, y, z = r.tolist()
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R: Array = np.eye(3) + math.sin(theta) * K + (1 - math.cos(theta)) * (K @ K)
    return R
