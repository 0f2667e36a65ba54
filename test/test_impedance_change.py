"""Changes of M, D, K under a displacement: smooth, and with no more energy than the tank has."""

import math

import numpy as np
import pytest
from arms import assert_no_jump
from representations import OF_THE_QUATERNION, every_representation, make
from samples import generator, positive_definite, uniform

from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.impedance_change import between
from eulerparams_control.laws.impedance_matrices import Impedance, damping_of_ratio
from eulerparams_control.laws.rotations import exp
from eulerparams_control.motion.frames import DesiredFrame

I, O, DT = np.eye(3), np.zeros(3), 1e-3
R_D = exp(np.array([0.3, 0.6, -0.3]))
DESIRED = DesiredFrame(O, R_D, O, O, O, O)
TANK = 0.3  # [J]


def law(K_p, K_o=30.0, M_p=10.0, name="euler_parameters", frame="base"):
    M, K = M_p * I, K_p * np.diag([1.0, 0.5, 2.0])
    translation = Impedance(M, damping_of_ratio(M, K, 1.0), K)
    rotation = Impedance(I, damping_of_ratio(I, K_o * I, 1.0), K_o * I)
    return ComplianceLaw(make(name), translation, rotation, frame)


def go(compliant, wrench, seconds, dt=DT):
    """Return the compliant frames under a wrench (6,)."""
    wrench = np.array(wrench, dtype=float)
    return [compliant.step(dt, DESIRED, wrench) for _ in range(round(seconds / dt))]


def pressed(law, wrench, tank=math.inf):
    """Return a compliant frame that a wrench (6,) has displaced until it is at rest."""
    compliant = CompliantFrame(law, tank)
    go(compliant, wrench, 2.0, 10 * DT)
    return compliant


def energy(compliant):
    """Return the energy [J] of the displacement, by what the frames and the law of now are."""
    c, now = compliant.now, compliant.law_now
    v, x = c.dp_d - DESIRED.dp_d, c.p_d - DESIRED.p_d
    V_3 = now.orientation.lyapunov_3(R_D.T @ c.R_d, R_D.T @ c.omega_d, now.rotation, O)
    return v @ now.translation.M @ v / 2 + x @ now.stiffness(R_D) @ x / 2 + V_3.V


@pytest.mark.parametrize(
    ("name", "frame", "tank"),
    [
        *((name, "base", TANK) for name in OF_THE_QUATERNION),
        *(("euler_parameters", *given) for given in (("desired", TANK), ("base", math.inf))),
    ],
)
def test_a_stiffness_that_swings_in_contact_gives_no_more_than_the_tank(name, frame, tank):
    """Beside what a noisy wrench gives.

    The stiffness swings between 100 and 5000 N/m at 2 Hz, the mass between 5 and 15 kg.
    """
    random, given, growth = generator(2026), 0.0, []
    last = push = np.array([20.0, -10.0, 15.0, 2.0, 1.0, -1.0])
    compliant = pressed(law(100.0, 5.0, name=name, frame=frame), push, tank)
    begin = energy(compliant)
    for k in range(1500):
        share = (1 - math.cos(2 * math.pi * 2 * k * DT)) / 2
        if k % 20 == 0:
            K_p, K_o, M_p = 100 + 4900 * share, 5 + 195 * share, 10 + 5 * math.sin(9 * k * DT)
            compliant.change(law(K_p, K_o, M_p, name, frame))
        wrench, before = push + random.normal(size=6) * [3, 3, 3, 0.3, 0.3, 0.3], compliant.now
        c = compliant.step(DT, DESIRED, wrench)
        mean, last = (last + wrench) / 2, wrench  # it goes linearly from sample to sample
        given += mean[:3] @ (c.p_d - before.p_d)
        given += mean[3:] @ (DT * (c.omega_d + before.omega_d) / 2)
        growth.append(energy(compliant) - begin - given)
        assert compliant.energy_left >= 0.0
    assert max(growth) <= TANK if tank == TANK else max(growth) > 3 * TANK


@every_representation
def test_a_change_waits_where_the_tank_is_empty_and_goes_on_where_it_is_led_back(name):
    push = [10.0, 0.0, 0.0, 0.0, 0.0, 1.0]  # 10 cm on 100 N/m: 25 J at 5000 N/m
    compliant = pressed(law(100.0, name=name), push, TANK)
    compliant.change(law(5000.0, name=name))
    frames = go(compliant, push, 0.3)
    assert compliant.waits
    assert 0.0 < compliant.changed < 0.3
    assert compliant.law.translation.K[0, 0] == 5000.0
    assert compliant.law_now.translation.K[0, 0] < 1500.0
    speed = max(np.linalg.norm(frame.dp_d) for frame in frames)
    assert speed <= math.sqrt(2 * (TANK + 0.5) / 10.0)  # what the tank, and the spring, can give
    assert_no_jump(frames + go(compliant, np.zeros(6), 3.0), DT)  # it comes back
    assert compliant.changed == 1.0
    assert compliant.law_now is compliant.law
    assert compliant.energy_left == pytest.approx(TANK)


def test_without_a_displacement_a_change_is_done_soon_and_needs_nothing():
    compliant = pressed(law(100.0), np.zeros(6), 0.0)
    compliant.change(law(5000.0))
    assert all(np.array_equal(frame.p_d, O) for frame in go(compliant, np.zeros(6), 1.0))
    assert compliant.changed == 1.0


@pytest.mark.parametrize("s", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_on_the_way_all_matrices_stay_positive_and_the_damping_ratio_is_kept(s):
    """(IC2), (IC3); the ratio where the mass has the axes of the stiffness."""
    matrices = iter(positive_definite(300, key=8, least=1e-3, most=50.0))
    for U in uniform(50):
        ends = [Impedance(*(next(matrices) for _ in range(3))) for _ in range(2)]
        there = Impedance(*between(s, *ends))  # refuses what is not
        assert min(np.linalg.eigvalsh(Z).min() for Z in (there.M, there.D, there.K)) > 0
        M, *stiffness = (U @ np.diag(Z.K.diagonal()) @ U.T for Z in (there, *ends))
        ends = [Impedance(M, damping_of_ratio(M, K, 0.7), K) for K in stiffness]
        there = Impedance(*between(s, *ends))
        np.testing.assert_allclose(there.D, damping_of_ratio(M, there.K, 0.7), atol=1e-9)
        np.testing.assert_allclose(there.M, M, atol=1e-12)
        if s in (0.0, 1.0):
            np.testing.assert_allclose(there.K, stiffness[round(s)], atol=1e-9)


@pytest.mark.parametrize(
    ("light", "heavy"), [((0.5, 65.0), (100.0, 5000.0)), ((0.1, 95.0), (9.0, 8500.0))]
)
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_a_change_of_mass_and_damping_stays_stable_and_has_a_law_at_each_instant(light, heavy, dt):
    """M^-1 linear in s would move at 2.5e3 and 2e4 1/s on the way, beyond MAX_RATE and any step."""
    laws = [
        ComplianceLaw(make("euler_parameters"), *(Impedance(M * I, D * I, 500.0 * I),) * 2)
        for M, D in (light, heavy)
    ]
    push, compliant = [5.0, 0.0, 0.0, 0.0, 0.0, 1.0], CompliantFrame(laws[0])
    frames = go(compliant, push, 1.0, dt)
    for law in (*laws[::-1], laws[1]):
        compliant.change(law)
        for _ in range(20):
            frames += go(compliant, push, dt, dt)
            assert compliant.law_now.rate <= 2.0 * max(law.rate for law in laws)  # (IC3)
    assert max(np.linalg.norm(frame.p_d) for frame in frames) < 1.05 * 5.0 / 500.0


@every_representation
def test_what_acts_on_the_way_is_what_the_law_of_now_says(name):
    push = np.array([3.0, 2.0, 1.0, 0.3, 0.2, 0.1])
    compliant = pressed(law(300.0, 10.0, name=name), push)
    compliant.change(law(900.0, 30.0, M_p=5.0, name=name))
    frame = go(compliant, push, 0.06)[-1]
    assert 0.5 < compliant.changed < 0.9
    other = CompliantFrame(compliant.law_now)
    other.begin(DESIRED, frame)
    again = other.step(0.0, DESIRED, push)
    np.testing.assert_allclose(again.ddp_d, frame.ddp_d, atol=1e-9)
    np.testing.assert_allclose(again.domega_d, frame.domega_d, atol=1e-9)
