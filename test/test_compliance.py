"""The laws of impedance (52)-(71) and their integration: the compliant frame.

The properties run over the registry.  Elastic moments are compared with the formulas of this file,
in angle and axis.
"""

import math
import re
from itertools import pairwise

import numpy as np
import pytest
import tolerances as tol
from arms import assert_no_jump
from representations import (
    FUNCTIONS,
    OF_ANGLES,
    OF_THE_QUATERNION,
    difference_of_angles,
    every_representation,
    make,
    of_the_quaternion,
    relative_angles,
    relative_motion,
)
from samples import (
    K_STAR,
    T_of,
    angle,
    axial,
    by_angles,
    generator,
    k_star_axes,
    moving,
    pole_clearance,
    positive_definite,
    rodrigues,
    skew,
    turn_of,
    uniform,
    unit_vectors,
    vectors,
)

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws.compliant_frame import (
    MAX_RATE,
    STOP_TIME,
    TRANSLATIONAL_FRAMES,
    ComplianceLaw,
    CompliantFrame,
)
from eulerparams_control.laws.impedance_matrices import Impedance, damping_of_ratio
from eulerparams_control.laws.orientation import ORIENTATIONS, SEQUENCES, EulerSequence
from eulerparams_control.laws.rotations import quaternion
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.impedance_control import ImpedanceParameters

COUNT = 12
DT = 1e-3  # [s]
I, O = np.eye(3), np.zeros(3)
RIGHT = math.pi / 2

U_STAR = k_star_axes()
STAR = (U_STAR * K_STAR) @ U_STAR.T  # K*
PROPER = [s for s in SEQUENCES if s[0] == s[2]]
THREE_AXES = [s for s in SEQUENCES if s not in PROPER]

every_frame = pytest.mark.parametrize("frame", TRANSLATIONAL_FRAMES)


def damped(M, K, ratio=1.0):
    """Return the impedance of mass M and stiffness K, numbers or matrices."""
    M, K = (A if np.ndim(A) else A * I for A in (M, K))
    return Impedance(M, damping_of_ratio(M, K, ratio), K)


SOFT_P, SOFT_O = damped(10.0, 1000.0), damped(1.0, 100.0)  # 10 1/s


def law(name="euler_parameters", rotation=SOFT_O, translation=SOFT_P, frame="base", sequence="XYZ"):
    return ComplianceLaw(make(name, sequence), translation, rotation, frame)


def at(R=I, p=O, *rates):
    """Return a frame at rest, unless rates are given."""
    return DesiredFrame(np.array(p, dtype=float), R, *rates)


def wrench(f=O, mu=O):
    return np.concatenate((f, mu))


def begun(law, desired, frame):
    """Return a compliant frame that is there at first."""
    compliant = CompliantFrame(law)
    compliant.begin(desired, frame)
    return compliant


def follow(compliant, desired_at, wrench_at, times):
    """Return the compliant frames at some times; the first is the one of the beginning."""
    steps = [0.0, *(now - before for before, now in pairwise(times))]
    return [
        compliant.step(dt, desired_at(t), wrench_at(t)) for dt, t in zip(steps, times, strict=True)
    ]


def constant(value):
    return lambda t: value


def times(duration, dt=DT):
    return dt * np.arange(round(duration / dt) + 1)


def turned(x):
    theta = float(np.linalg.norm(x))
    return rodrigues(theta, x / theta) if theta else I


# --- the formulas, independent of the code -----------------------------------------------------
def printed_moment(name, theta, r, K):
    """Return mu_E = 2 psi Omega' K_o o of o = f(theta) r, as the errata print it."""
    f, df, psi = FUNCTIONS[name]
    rr = np.outer(r, r)
    around = (I - rr) / math.tan(theta / 2) - skew(r)
    Omega = df(theta) * rr + f(theta) / 2 * around
    return 2 * psi * Omega.T @ K @ (f(theta) * r)


def rotating(frame):
    return frame.R_d, frame.omega_d, frame.domega_d


def residual_of_eq_55(Z, d, c, mu, sequence):
    """Return M_o Delta ddphi + D_o Delta dphi + K_o Delta phi - T'(phi_c) mu, at rest (56)."""
    phi, dphi, ddphi = difference_of_angles(sequence, rotating(d), rotating(c))
    T = T_of(sequence, EulerSequence(sequence).extract(c.R_d))
    return Z.M @ ddphi + Z.D @ dphi + Z.K @ phi - T.T @ mu


def residual_of_relative_angles(Z, d, c, mu, sequence):
    """Return M ddphi + D dphi + K phi - T'(phi) mu^d, with T(0)' M_o T(0) for M and so on."""
    phi, dphi, ddphi = relative_angles(sequence, rotating(d), rotating(c))
    T_0 = T_of(sequence, O)
    left = T_0.T @ (Z.M @ T_0 @ ddphi + Z.D @ T_0 @ dphi + Z.K @ T_0 @ phi)
    return left - T_of(sequence, phi).T @ d.R_d.T @ mu


def residual_of_eq_59(name):
    """Return the function M_o dx + D_o x + mu_E - mu^d."""

    def residual(Z, d, c, mu, _):
        R_cd, x, dx = relative_motion(rotating(d), rotating(c))
        rho = turn_of(R_cd)
        theta = float(np.linalg.norm(rho))
        return Z.M @ dx + Z.D @ x + printed_moment(name, theta, rho / theta, Z.K) - d.R_d.T @ mu

    return residual


RESIDUALS = {
    "euler_angles": residual_of_eq_55,
    "relative_euler_angles": residual_of_relative_angles,
    **{name: residual_of_eq_59(name) for name in FUNCTIONS},
}


def residual_of_eq_52(Z, frame, d, c, f):
    """Return M_p ddx + D_p dx + K_p x - f, components in the axes of the frame."""
    x, dx, ddx = c.p_d - d.p_d, c.dp_d - d.dp_d, c.ddp_d - d.ddp_d
    if frame == "desired":  # x = R_d' (p_c - p_d), and its derivatives
        w, dw, R = d.omega_d, d.domega_d, d.R_d
        ddx = ddx - 2 * np.cross(w, dx) + np.cross(w, np.cross(w, x)) - np.cross(dw, x)
        x, dx, ddx, f = R.T @ x, R.T @ (dx - np.cross(w, x)), R.T @ ddx, R.T @ f
    return Z.M @ ddx + Z.D @ dx + Z.K @ x - f


# --- elastic moments, eqs. (56)-(66) --------------------------------------------------------------
@of_the_quaternion
@pytest.mark.parametrize("theta", [1e-7, 1e-3, 0.5, RIGHT, 2.5, 3.1])
def test_the_elastic_moment_is_that_of_its_function_of_the_angle(name, theta):
    samples = unit_vectors(COUNT), positive_definite(COUNT, 0, 10, 100), uniform(COUNT, 4)
    for r, K, R_d in zip(*samples, strict=True):
        found = -R_d.T @ make(name).spring(R_d, R_d @ rodrigues(theta, r), K).moment
        expected = printed_moment(name, theta, r, K)
        # 1 Nm is added to what may be 5e6 Nm
        atol = max(tol.STIFFNESS, tol.RELATIVE * np.abs(expected).max() ** 2)
        tol.assert_close(found, expected, atol)


@of_the_quaternion
def test_the_impedance_does_not_depend_on_the_sign_of_the_quaternion(name):
    own, Z = make(name), damped(1.0, STAR).values
    for R, x, mu in zip(uniform(COUNT, 10), vectors(COUNT), vectors(COUNT, 1), strict=True):
        Q = quaternion(R)
        assert own.elastic_energy(-Q, STAR) == own.elastic_energy(Q, STAR)
        one, other = (own.state_rate(np.hstack((*sign, x)), mu, Z) for sign in (Q, -Q))
        tol.assert_close(other, np.hstack((-one[:4], one[4:])), 1e2 * tol.ALGEBRAIC)


@every_representation
def test_V_3_is_kinetic_and_elastic_energy_and_its_rate_damping_and_contact_power(name):
    Z = Impedance(*positive_definite(3, 60))
    for r, x, mu in zip(unit_vectors(COUNT), vectors(COUNT), vectors(COUNT, 1), strict=True):
        found = make(name).lyapunov_3(rodrigues(1.1, r), x, Z, mu)
        if name not in OF_THE_QUATERNION:
            assert found is None
            continue
        f, _, psi = FUNCTIONS[name]
        energy = x @ Z.M @ x / 2 + psi * f(1.1) ** 2 * (r @ Z.K @ r)  # (68)
        power = -x @ Z.D @ x + mu @ x  # (69)
        np.testing.assert_allclose(found, (energy, power), rtol=tol.ALGEBRAIC)


# --- the equations hold along a motion, and the frame moves as it says ---------------------------
def clear_motions(count):
    """Return desired frames over time that begin away from the pole of XYZ."""
    motions = [moving(i) for i in range(8 * count)]
    clear = [m for m in motions if pole_clearance("XYZ", m(0.0)[1]) > 0.6][:count]
    return [lambda t, m=m: DesiredFrame(*m(t)) for m in clear]


def contact(key):
    """Return a wrench that changes smoothly with time."""
    force, rate, phase = generator(905, key).normal(size=(3, 6))
    return lambda t: 10 * force * np.sin(5 * rate * t + phase)


@every_frame
@pytest.mark.parametrize(
    ("name", "sequence"),
    [
        *((name, "XYZ") for name in ORIENTATIONS),
        *(("relative_euler_angles", s) for s in THREE_AXES),
    ],
)
def test_the_equations_hold_at_each_sample_and_its_rates_are_derivatives(name, sequence, frame):
    """Equations (52), (55), (59), of general matrices and motions."""
    dt = 2e-4
    for key, desired_at in enumerate(clear_motions(2)):
        M_p, D_p, K_p, M_o, D_o, K_o = positive_definite(6, 50 + key)
        Z_p, Z_o = Impedance(M_p, 8 * D_p, 40 * K_p), Impedance(M_o, 8 * D_o, 40 * K_o)
        first, (dp, dR, v, omega) = desired_at(0.0), 0.3 * generator(906, key).normal(size=(4, 3))
        start = at(turned(dR) @ first.R_d, first.p_d + dp, first.dp_d + v, first.omega_d + omega)
        compliant = begun(law(name, Z_o, Z_p, frame, sequence), first, start)
        wrench_at = contact(key)
        frames = follow(compliant, desired_at, wrench_at, times(0.1, dt))
        for t, c in list(zip(times(0.1, dt), frames, strict=True))[::25]:
            d, (f, mu) = desired_at(t), np.split(wrench_at(t), 2)
            moments = RESIDUALS[name](Z_o, d, c, mu, sequence)
            tol.assert_close(moments, 0, tol.IMPEDANCE_EQUATION)
            forces = residual_of_eq_52(Z_p, frame, d, c, f)
            tol.assert_close(forces, 0, tol.IMPEDANCE_EQUATION)
        p, R, *rates = map(np.array, zip(*frames, strict=True))
        dp, dR, dv, domega = (
            (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * dt) for x in (p, R, *rates[:2])
        )
        turning = [axial(dR_now @ R_now.T) for dR_now, R_now in zip(dR, R[2:-2], strict=True)]
        tol.assert_close((dp, turning, dv, domega), [x[2:-2] for x in rates], tol.COMPLIANT_RATES)
        assert np.abs([x[-1] for x in rates]).min() > 1e-4  # all of them move


# --- integration ---------------------------------------------------------------------------------
@every_representation
@pytest.mark.parametrize("slope", [0.0, 4.0], ids=["constant", "ramp"])
def test_the_integration_is_of_order_4(name, slope):
    desired, load = at(by_angles("XYZ", 0.3, 0.4, 0.2)), np.array([20.0, -30, 40, 10, 5, -8])
    rates = np.array([0.5, 0.0, -1.0]), np.array([1.0, 2.0, -1.0])
    start = at(turned(np.array([0.6, -0.5, 0.4])) @ desired.R_d, 0.1 + O, *rates)
    own = law(name, Impedance(I, 8 * I, STAR), Impedance(I, 8 * I, 100 * I))
    assert own.rate * 0.02 < 0.5  # no step is divided

    def end(dt):
        t, compliant = times(0.4, dt), begun(own, desired, start)
        return follow(compliant, constant(desired), lambda t: load * (1 - slope * t), t)[-1]

    exact = end(0.0025)
    way, turn = zip(
        *((math.dist(c.p_d, exact.p_d), angle(c.R_d, exact.R_d)) for c in (end(0.02), end(0.01))),
        strict=True,
    )
    for coarse, fine in (way, turn):
        assert tol.OF_ORDER_4[0] < coarse / fine < tol.OF_ORDER_4[1]


@every_representation
@pytest.mark.parametrize("dt", [1e-3, 2e-2])
def test_a_fast_impedance_moves_as_in_short_steps_with_a_wrench_linear_between_samples(name, dt):
    # poles at -0.92 and -0.03 times the greatest rate, and a moment that turns by 0.02
    m, d, k, mu = 0.01, 0.0095 * MAX_RATE, 0.0003 * MAX_RATE**2, 6e-6 * MAX_RATE**2
    fast = Impedance(m * I, d * I, k * I)
    own = law(name, fast, fast)
    assert 0.9 * MAX_RATE < own.rate < MAX_RATE
    push, still = lambda t: wrench(15 * mu * t * I[1], mu * I[1]), constant(at())
    long, short = (
        follow(begun(own, at(), at()), still, push, times(0.2, step)) for step in (dt, 1e-4)
    )
    for c, exact in zip(long, short[:: round(dt / 1e-4)], strict=True):
        tol.assert_close(c.p_d, exact.p_d, tol.FAST_MODES * short[-1].p_d[1])
        assert angle(c.R_d, exact.R_d) <= tol.FAST_MODES * mu / k
    tol.assert_close(c.R_d.T @ c.R_d, I, 10 * tol.ALGEBRAIC)


# --- what is refused -----------------------------------------------------------------------------
def test_an_unknown_frame_and_angles_that_are_singular_at_zero_error_are_refused():
    with pytest.raises(UnknownNameError, match=r"translational_frame 'tool'.*base, desired"):
        law(frame="tool")
    for sequence in PROPER:
        with pytest.raises(ConfigurationError, match=f"{sequence} are singular.*XYZ"):
            law("relative_euler_angles", sequence=sequence)


@pytest.mark.parametrize(("which", "mass"), [("translation", "M_p"), ("rotation", "M_o")])
@every_representation
def test_an_impedance_that_is_too_fast_is_refused_with_the_mass_to_raise(name, which, mass):
    just, beyond = 0.999 * MAX_RATE, 1.001 * MAX_RATE
    for fast in (lambda r: Impedance(I, r * I, O * I), lambda r: Impedance(I, O * I, r**2 * I)):
        law(name, **{which: fast(just)})
        with pytest.raises(ConfigurationError, match=re.escape(f"{beyond:.4g}")) as caught:
            law(name, **{which: fast(beyond)})
        assert set(re.findall("M_[po]", str(caught.value))) == {mass}


R_AWAY = by_angles("XYZ", 0.3, 0.4, 0.2)


def test_a_wrench_beyond_all_numbers_raises():
    compliant = begun(law(), at(R_AWAY), at(R_AWAY))
    with np.errstate(all="ignore"), pytest.raises(SingularityError, match="not finite"):
        for _ in range(20):
            compliant.step(0.1, at(R_AWAY), np.full(6, 1e308))


# --- beginning, jumps, freezing, other laws -------------------------------------------------------
@every_frame
@every_representation
@pytest.mark.parametrize("start", [0.2, 0.195], ids=["at a sample", "between samples"])
def test_a_desired_velocity_that_jumps_is_approached_without_a_jump(name, frame, start):
    dt, v, omega = 0.01, np.array([0.2, 0.0, -0.1]), np.array([0.3, 0.5, -0.2])

    def desired_at(t):
        s, rates = max(0.0, t - start), (v, omega) if t > start - 1e-9 else (O, O)
        return at(turned(s * omega) @ R_AWAY, s * v, *rates)

    compliant = begun(law(name, frame=frame), at(R_AWAY), at(R_AWAY))
    frames = follow(compliant, desired_at, constant(wrench()), times(1.5, dt))
    assert_no_jump(frames, dt)
    assert np.abs(frames[round(0.2 / dt)].dp_d).max() < 0.2 * 0.25  # it was not taken over
    assert np.linalg.norm(frames[-1].p_d - desired_at(1.5).p_d) < 1e-4
    assert angle(frames[-1].R_d, desired_at(1.5).R_d) < 1e-3


@every_frame
@every_representation
@pytest.mark.parametrize("moves", [True, False], ids=["moving", "still"])
@pytest.mark.parametrize("frozen", [1, 5, 150], ids=lambda count: f"{count} ticks")
def test_a_frozen_frame_comes_to_rest_and_goes_on_without_a_jump(name, frame, moves, frozen):
    dt, w = 2e-3, contact(2)(0.2)
    desired_at = clear_motions(1)[0] if moves else constant(at(R_AWAY))
    compliant = begun(law(name, frame=frame), desired_at(0.0), desired_at(0.0))
    frames = [follow(compliant, desired_at, constant(w), times(0.1, 5 * dt))[-1]]
    assert np.abs(frames[0].dp_d).max() > 5e-3
    frames += [compliant.freeze(dt, at()) for _ in range(frozen)]
    # meanwhile the desired frame has moved on
    frames += [compliant.step(dt, desired_at(0.3 + k * dt), w) for k in range(30)]
    assert_no_jump(frames, dt)
    assert np.abs(frames[-1].dp_d).max() > 1e-4


def test_a_frozen_frame_stops_exponentially_however_the_time_is_divided():
    start = at(R_AWAY, [0.1, 0.2, 0.3], np.array([0.5, -1.0, 2.0]), np.array([1.0, 3.0, -2.0]))
    left = math.exp(-0.3 / STOP_TIME)
    way, (v, omega) = STOP_TIME * (1 - left), (left * start.dp_d, left * start.omega_d)
    for steps in ([0.3], [0.01] * 30, [0.0, 0.1, 0.0, 0.19, 0.01]):
        compliant = begun(law(), at(R_AWAY), start)
        for dt in steps:
            frame = compliant.freeze(dt, at())
        tol.assert_close((frame.dp_d, frame.omega_d), (v, omega))
        tol.assert_close((frame.ddp_d, frame.domega_d), (-v / STOP_TIME, -omega / STOP_TIME))
        tol.assert_close(frame.p_d, start.p_d + way * start.dp_d)
        tol.assert_close(frame.R_d, turned(way * start.omega_d) @ R_AWAY)


LAWS = [
    *(law(name, frame=frame) for name in ORIENTATIONS for frame in TRANSLATIONAL_FRAMES),
    *(law(name, sequence="ZYX") for name in OF_ANGLES),
]


@pytest.mark.parametrize("k", range(len(LAWS)))
@pytest.mark.parametrize("apart", [1, 5])
def test_another_law_goes_on_from_the_same_frame_and_velocities(k, apart):
    before, after = LAWS[k - apart], LAWS[k]
    desired_at, dt, wrench_at = clear_motions(1)[0], 2e-3, contact(4)
    compliant = begun(before, desired_at(0.0), desired_at(0.0))
    last = follow(compliant, desired_at, wrench_at, times(0.1, 5 * dt))[-1]
    compliant.change(after)
    assert compliant.law is after
    here = compliant.step(0.0, desired_at(0.1), wrench_at(0.1))
    for found, expected in zip(here[:4], last[:4], strict=True):
        tol.assert_close(found, expected, 1e2 * tol.ALGEBRAIC)
    compliant.change(before)
    compliant.change(after)
    later = [0.1 + k * dt for k in range(1, 7)]
    assert_no_jump([here, *(compliant.step(dt, desired_at(t), wrench_at(t)) for t in later)], dt)


# --- bounds of the compliant frame, and moments that it cannot balance ----------------------------
def bounded(bounds=(0.1, 0.8, 0.3), name="euler_parameters", K_p=0.0):
    translation, rotation = Impedance(10 * I, 40 * I, K_p * I), Impedance(0.5 * I, 4 * I, 5 * I)
    return ComplianceLaw(make(name), translation, rotation, bounds=bounds)


@pytest.mark.parametrize("name", ["euler_parameters", "rotation_vector", "euler_angles"])
@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("dt", [1e-3, 8e-3])
def test_a_push_ends_at_the_bounds_without_a_jump(name, moves, dt):
    v, omega = moves * np.array([0.05, 0.0, -0.02]), moves * np.array([0.0, 0.18, 0.24])
    desired = [at(turned(t * omega), t * v, v, omega) for t in times(3.0, dt)]
    compliant, push = CompliantFrame(bounded(name=name)), wrench([20.0, 10.0, 0], [0, 0, 20.0])
    frames = [compliant.step(dt if k else 0.0, d, push) for k, d in enumerate(desired)]
    assert_no_jump(frames, dt)
    pairs = list(zip(frames, desired, strict=True))
    far = np.array([(np.linalg.norm(c.p_d - d.p_d), angle(d.R_d, c.R_d)) for c, d in pairs])
    fast = np.linalg.norm([np.subtract(c[2:4], d[2:4]) for c, d in pairs], axis=2).max(axis=0)
    assert np.all(far.max(axis=0) <= [0.1 * 1.002, 0.8 * 1.002])
    assert far[-1] == pytest.approx([0.1, 0.8], rel=5e-3)
    assert fast.max() <= 0.3 * 1.002
    assert fast == pytest.approx([0.3, 0.3], rel=1e-2)


def test_it_comes_back_from_bounds_that_are_lowered_and_at_once_when_the_push_ends():
    compliant = CompliantFrame(bounded((math.inf,) * 3, K_p=100.0))
    push = wrench([20.0, 0, 0], [0, 0, 4.0])
    free = follow(compliant, constant(at()), constant(push), times(0.7))
    compliant.change(bounded((0.05, 0.3, 0.4), K_p=100.0))
    lowered = [compliant.step(DT, at(), push) for _ in range(1800)]
    fastest = 10 * 0.4 + 2.0  # [m/s^2] 10 / s of its speed, beside the push
    assert max(np.abs(c.ddp_d).max() for c in lowered) <= fastest
    assert np.linalg.norm(free[-1].p_d) > 0.15
    assert np.linalg.norm(lowered[-1].p_d) == pytest.approx(0.05, rel=1e-2)
    assert angle(I, lowered[-1].R_d) == pytest.approx(0.3, rel=1e-2)
    back = [compliant.step(DT, at(), wrench()) for _ in range(250)]
    assert np.linalg.norm(back[-1].p_d) < 0.045  # no wind-up
    assert angle(I, back[-1].R_d) < 0.26
    assert_no_jump(free + lowered + back, DT)


@pytest.mark.parametrize(
    ("name", "K_o", "least"),
    [
        ("euler_parameters", (50.0, 60.0, 70.0), 50.0),  # K sin(theta)
        ("angle_axis", (50.0, 50.0, 50.0), 25.0),  # K sin(theta) cos(theta)
        ("rotation_vector", (10.0, 60.0, 70.0), 10.0 * math.pi),  # K theta
        # K f f' with f = 4 tan(theta / 4), at 180 deg
        ("modified_rodrigues", (5.0, 60.0, 70.0), 5.0 * 8.0),
        ("euler_angles", (10.0, 10.0, 10.0), math.inf),
    ],
)
def test_a_stiffness_that_cannot_balance_the_moment_that_stops_is_reported(name, K_o, least):
    assert make(name).least_moment(np.diag(K_o)) == pytest.approx(least, rel=0.02)
    for most, is_said in ((0.9 * min(least, 100.0), False), (1.1 * least, math.isfinite(least))):
        own = ImpedanceParameters(orientation=name, K_o=K_o, max_contact_torque=min(most, 1e3))
        assert bool(own.advice()) == is_said
    assert not ImpedanceParameters().advice()
