"""What sections II and III claim, shown in the library alone: E2, E5, Q1 and Q2."""

import math

import numpy as np
import pytest
from samples import about, derivative, pairs_apart, turning, uniform, vectors
from tolerances import (
    ALGEBRAIC,
    CLOSED_FORM,
    COND_J,
    DIFFERENCES,
    ESCAPE_RATE,
    LONG_WAY_DEG,
    POSE_FOUND,
    SEEN,
    SLOPE,
    V_INCREASE,
)

from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    SignRule,
    representation,
)
from eulerparams_control.laws.rotations import EulerParameters, exp, log, mutual_R
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

DT = 1e-3  # [s]
K = 10.0  # k_Po [1/s]
X, Y, Z = np.eye(3)

# LE: the desired orientation of the large errors; the error is about the tool's z, as
# the last joint makes it.
R_LE = about(1, math.radians(60)) @ about(2, math.radians(90))
ERRORS_DEG = (30, 60, 90, 120, 150, 170, 180)
REST = np.zeros(3)
TURNING = np.array([0.3, -0.5, 0.4])  # omega_d [rad/s]


def law_with(sign):
    """Return the representation by Euler parameters with that rule for the sign."""
    return representation("euler_parameters", OrientationOptions(sign=SignRule(sign)))


def V_1(Q_de):
    """Return V_1, eq. (30)."""
    return (Q_de.eta - 1) ** 2 + Q_de.eps @ Q_de.eps


def simulate(law, R_e, omega_d, duration, previous=None):
    """Return the displacement at each step of the closed loop (28), R_e integrated by exp."""
    R_d_of, x_de, history = turning(R_LE, omega_d), previous, []
    for step in range(round(duration / DT)):
        x_de = law.displacement(R_d_of(step * DT), R_e, x_de)
        history.append(x_de)
        R_e = exp(DT * law.resolved_velocity(x_de, omega_d, K)) @ R_e
    return history


def large_error(error_deg):
    """Return R_e at that error [deg] from LE, about the tool's z."""
    return R_LE @ about(2, -math.radians(error_deg))


# --- eqs. (29)-(31), E5 ----------------------------------------------------------------------


@pytest.mark.parametrize("error_deg", ERRORS_DEG)
@pytest.mark.parametrize("omega_d", [REST, TURNING], ids=["at rest", "turning"])
def test_eta_follows_its_closed_form_and_V_1_never_increases(error_deg, omega_d):
    history = simulate(law_with("hysteretic"), large_error(error_deg), omega_d, duration=1.5)
    eta = np.array([x_de.Q_de.eta for x_de in history])
    t = DT * np.arange(len(eta))
    c = math.atanh(math.cos(math.radians(error_deg) / 2))
    np.testing.assert_allclose(eta, np.tanh(K * t / 2 + c), rtol=0, atol=CLOSED_FORM)
    assert np.diff([V_1(x_de.Q_de) for x_de in history]).max() <= V_INCREASE
    assert eta[-1] > 1 - CLOSED_FORM


def test_V_1_is_twice_one_minus_eta_for_both_signs():
    for R_d, R_e in zip(uniform(100), uniform(100, key=1), strict=True):
        Q = mutual_R(R_e, R_d)
        for Q_de in (Q, -Q):
            assert V_1(Q_de) == pytest.approx(2 * (1 - Q_de.eta), abs=ALGEBRAIC)  # eq. (30)


@pytest.mark.parametrize("theta", [0.1, 1.0, 2.0, 3.0, math.pi])
@pytest.mark.parametrize("sign", [1, -1], ids=["short way", "long way"])
def test_the_rate_of_V_1_is_minus_the_gain_times_the_square_of_eps(theta, sign):
    law = law_with("continuous")
    for (R_d, R_e), omega_d in zip(pairs_apart(theta, 20), vectors(20), strict=True):
        first = law.displacement(R_d, R_e)
        x_de = law.displacement(R_d, R_e, first if sign > 0 else first._replace(Q_de=-first.Q_de))
        R_d_of = turning(R_d, omega_d)
        R_e_of = turning(R_e, law.resolved_velocity(x_de, omega_d, K))

        def V_1_at(t, d=R_d_of, e=R_e_of, x_de=x_de):
            return V_1(law.displacement(d(t), e(t), x_de).Q_de)

        expected = -K * x_de.eps_de @ x_de.eps_de  # eq. (31)
        assert derivative(V_1_at) == pytest.approx(expected, abs=DIFFERENCES)


# --- the equilibria Q1 and Q2, eqs. (44)-(47) --------------------------------------------------


def at_Q1(R_d, R_e):
    """Return the displacement before the first sample, of the sign that goes the long way."""
    x_de = law_with("shortest").displacement(R_d, R_e)
    return x_de._replace(Q_de=-x_de.Q_de, eps_de=-x_de.eps_de)


@pytest.mark.parametrize("sigma", [1e-6, 0.01, 0.5, 1.0, 2.0])
def test_V_1_drops_by_two_sigma_off_Q1(sigma):
    for r in (X, Y, Z):
        Q_de = EulerParameters(-1 + sigma, math.sqrt(2 * sigma - sigma**2) * r)
        assert Q_de.eta**2 + Q_de.eps @ Q_de.eps == pytest.approx(1, abs=ALGEBRAIC)  # eq. (6)
        assert K * V_1(Q_de) == pytest.approx(4 * K - 2 * sigma * K, abs=ALGEBRAIC)  # (46), (47)


def test_Q1_and_Q2_are_equilibria_of_the_same_orientation():
    law = law_with("continuous")
    for R in uniform(20):
        Q2 = law.displacement(R, R)
        Q1 = law.displacement(R, R, at_Q1(R, R))
        for x_de, eta in ((Q1, -1), (Q2, 1)):
            assert x_de.Q_de.eta == pytest.approx(eta, abs=ALGEBRAIC)  # eqs. (44), (45)
            omega = law.resolved_velocity(x_de, np.zeros(3), K)
            np.testing.assert_allclose(omega, 0, rtol=0, atol=ALGEBRAIC * K)


def test_Q1_is_left_at_half_the_gain_and_Q2_reached_the_long_way():
    R_e = large_error(1.0)
    history = simulate(law_with("continuous"), R_e, REST, 3.0, at_Q1(R_LE, R_e))
    eta = np.array([x_de.Q_de.eta for x_de in history])
    from_Q1 = 2 * np.arccos(np.clip(-eta, -1, 1))  # [rad] from 1 deg to 360 deg
    leaving = np.flatnonzero(from_Q1 < math.radians(10))
    rate = np.polyfit(DT * leaving, np.log(from_Q1[leaving]), 1)[0]
    assert rate == pytest.approx(K / 2, rel=ESCAPE_RATE)
    assert math.degrees(from_Q1[-1] - from_Q1[0]) == pytest.approx(359, abs=LONG_WAY_DEG)


@pytest.mark.parametrize("sign", ["shortest", "hysteretic"])
def test_an_error_is_undone_the_short_way_whatever_came_before(sign):
    R_e = large_error(1.0)
    history = simulate(law_with(sign), R_e, REST, 0.1, at_Q1(R_LE, R_e))
    assert min(x_de.Q_de.eta for x_de in history) >= math.cos(math.radians(0.5)) - ALGEBRAIC


# --- E2: the analytical Jacobian of (24) is ill-conditioned, the geometric one is not ----------


def solve_pose(robot, q, p, R):
    """Return q (n,) at which the tip is at p, R, by Newton's method from a q nearby."""
    for _ in range(20):
        state = robot.state(q, np.zeros(robot.n))
        error = np.concatenate((p - state.p_e, state.R_e @ log(state.R_e.T @ R)))
        q = q + np.linalg.solve(state.J, error)
    assert np.abs(error).max() < POSE_FOUND
    return q


def jacobian_on_T1(R):
    """Return J (6, 6) of the UR5 at the position of T1 at 2 s and the orientation R."""
    ur5 = load_robot("ur5")
    robot = Robot(ur5.urdf, ur5.base_frame, ur5.tip_frame, ur5.joints)
    q0 = np.array([-0.21662, -1.1967, 1.83698, 1.78954, -1.39217, -2.98951])  # T1 at 0 s
    q = solve_pose(robot, q0, np.array([0.485, 0.07, 0.425]), R)
    return robot.state(q, np.zeros(robot.n)).J


def condition_numbers(delta_deg):
    """Return cond(J_A) and cond(J) on T1 at 2 s, delta [deg] from the pole of XYZ."""
    R = about(2, math.radians(delta_deg)) @ about(1, math.pi / 2) @ about(2, math.pi / 2)
    J = jacobian_on_T1(R)
    T = EulerSequence("XYZ").T(EulerSequence("XYZ").extract(R))
    J_A = np.vstack((J[:3], np.linalg.solve(T, J[3:])))  # eq. (24)
    return np.linalg.cond(J_A), np.linalg.cond(J)


def test_the_analytical_jacobian_is_ill_conditioned_near_the_pole_and_the_geometric_is_not():
    delta_deg = np.array([10.0, 3.0, 1.0, 0.3, 0.1])
    cond_J_A, cond_J = np.array([condition_numbers(delta) for delta in delta_deg]).T
    slope = np.polyfit(np.log(delta_deg), np.log(cond_J_A), 1)[0]
    assert slope == pytest.approx(-1, abs=SLOPE)
    assert cond_J_A[[0, 2, 4]] == pytest.approx([57, 578, 5.8e3], rel=SEEN)
    assert cond_J.max() < COND_J
