"""The resolved angular acceleration of every representation: eqs. (38)-(43).

The properties run over the registry.  What is expected of a representation that the tables
below do not name: it has no Lyapunov function.

The error equations are shown exactly, with the derivatives of T and L by complex steps and by
the product rule, in formulas of this file.  They leave no other angular acceleration.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from representations import every_representation, every_sequence, make, of_angles, regular_pairs
from samples import (
    Array,
    about,
    angle_rates,
    axial,
    clear_of_poles,
    half_turns,
    near_pole,
    pairs_apart,
    pole_clearance,
    poles,
    rodrigues,
    skew,
    uniform,
    unit_vectors,
    vectors,
)
from tolerances import ALGEBRAIC, ERROR_EQUATION, ILL_CONDITIONED, RELATIVE, assert_close

from eulerparams_control.laws.orientation import (
    ORIENTATIONS,
    EulerSequence,
)
from eulerparams_control.laws.orientation.base import Laws

COUNT = 40
K_PO, K_VO = GAINS = 12.0, 5.0  # [1/s^2], [1/s]
REST = np.zeros(3)
RIGHT = math.pi / 2

# Those whose error follows from the mutual quaternion: they obey (41), which is not linear.
OF_THE_QUATERNION = ("euler_parameters", "rotation_vector")

# Those for which the paper has V_1 and V_2.
HAVE_V = {"euler_parameters"}


class Motion(NamedTuple):
    R_d: Array
    R_e: Array
    omega_d: Array = REST
    domega_d: Array = REST
    omega_e: Array = REST


def moving(pairs, key=0):
    """Return the pairs (R_d, R_e) as motions with random velocities and accelerations."""
    omegas, domegas, others = (vectors(len(pairs), 10 * key + i) for i in range(3))
    return [
        Motion(R_d, R_e, *velocities)
        for (R_d, R_e), *velocities in zip(pairs, omegas, domegas, others, strict=True)
    ]


def regular_motions(law, count=COUNT):
    """Return motions, any angle apart, that are away from the law's singularities."""
    return moving(regular_pairs(law, count))


def a_o_of(law, motion, k_Po=K_PO, k_Vo=K_VO):
    """Return the angular acceleration that the law asks for."""
    x_de = law.displacement(motion.R_d, motion.R_e)
    rest = motion.omega_d, motion.domega_d, motion.omega_e
    return law.resolved_acceleration(x_de, *rest, k_Po, k_Vo)


# --- the error and its derivatives, exactly ---------------------------------------------------


def angle_and_axis(m):
    """Return theta in [0, pi] and r of R_d R_e', in the base frame; not for half turns."""
    Q = m.R_d @ m.R_e.T
    sin_r, cos = axial(Q), (np.trace(Q) - 1) / 2
    theta = math.atan2(np.linalg.norm(sin_r), cos)
    if theta < 2:
        return theta, sin_r / np.linalg.norm(sin_r) if theta else sin_r
    rr = (Q + Q.T) / 2 - cos * np.eye(3)  # (1 - cos(theta)) r r'
    column = rr[:, np.argmax(np.diag(rr))]
    return theta, math.copysign(1, column @ sin_r) * column / np.linalg.norm(column)


def error_of_euler_angles(m, domega_e, sequence):
    """Return phi_d - phi_e and its two derivatives, eq. (22)."""
    phi_d, phi_e = EulerSequence(sequence).extract(m.R_d), EulerSequence(sequence).extract(m.R_e)
    dphi_d, ddphi_d = angle_rates(sequence, phi_d, m.omega_d, m.domega_d)
    dphi_e, ddphi_e = angle_rates(sequence, phi_e, m.omega_e, domega_e)
    difference = np.angle(np.exp(1j * (phi_d - phi_e)))
    return difference, dphi_d - dphi_e, ddphi_d - ddphi_e


def error_of_relative_euler_angles(m, domega_e, sequence):
    """Return phi_de of R_e' R_d and its two derivatives."""
    phi = EulerSequence(sequence).extract(m.R_e.T @ m.R_d)
    omega_de = m.omega_d - m.omega_e
    in_e = m.R_e.T @ omega_de  # eq. (15)
    din_e = m.R_e.T @ (m.domega_d - domega_e - np.cross(m.omega_e, omega_de))
    return phi, *angle_rates(sequence, phi, in_e, din_e)


def error_of_angle_axis(m, domega_e, sequence):
    """Return sin(theta) r, the vector of R_d R_e', and its two derivatives."""
    S_d, S_e = skew(m.omega_d), skew(m.omega_e)
    Q = m.R_d @ m.R_e.T
    dQ = S_d @ Q - Q @ S_e
    ddQ = skew(m.domega_d) @ Q + S_d @ dQ - dQ @ S_e - Q @ skew(domega_e)
    return axial(Q), axial(dQ), axial(ddQ)


def error_of_euler_parameters(m, domega_e, sequence):
    """Return eps_de, Delta omega_de and its derivative: the terms of eq. (41)."""
    theta, r = angle_and_axis(m)
    return math.sin(theta / 2) * r, m.omega_d - m.omega_e, m.domega_d - domega_e


def error_of_rotation_vector(m, domega_e, sequence):
    """Return theta r, Delta omega_de and its derivative."""
    theta, r = angle_and_axis(m)
    return theta * r, m.omega_d - m.omega_e, m.domega_d - domega_e


ERRORS = {
    "angle_axis": error_of_angle_axis,
    "euler_angles": error_of_euler_angles,
    "euler_parameters": error_of_euler_parameters,
    "relative_euler_angles": error_of_relative_euler_angles,
    "rotation_vector": error_of_rotation_vector,
}


def assert_error_equation(name, law, motion, sequence="XYZ", atol=ERROR_EQUATION, gains=GAINS):
    """Assert ddx + k_Vo dx + k_Po x = 0 along domega_e = a_o, eq. (35)."""
    k_Po, k_Vo = gains
    x, dx, ddx = ERRORS[name](motion, a_o_of(law, motion, k_Po, k_Vo), sequence)
    assert_close(ddx + k_Vo * dx + k_Po * x, 0, atol)


@every_representation
@pytest.mark.parametrize("gains", [(0.0, 0.0), (7.0, 0.0), (0.0, 3.0), GAINS])
def test_along_the_law_the_error_obeys_its_equation_at_every_gain(name, gains):  # eqs. (39), (41)
    law = make(name)
    for motion in regular_motions(law):
        assert_error_equation(name, law, motion, gains=gains)


@of_angles
@every_sequence
def test_along_the_law_the_error_obeys_its_equation_with_every_sequence(name, sequence):  # (39)
    law = make(name, sequence)
    for motion in regular_motions(law, 15):
        assert_error_equation(name, law, motion, sequence)


@pytest.mark.parametrize(
    ("name", "theta"),
    [
        *product(ORIENTATIONS, (0.0, 1e-9, 1e-7, 1e-4)),
        *product(["angle_axis"], (RIGHT - 1e-2, RIGHT + 1e-4, 3.0)),
        *product(OF_THE_QUATERNION, (3.0, math.pi - 1e-4)),
    ],
)
def test_small_errors_and_those_near_90_and_180_degrees_obey_their_equation(name, theta):  # (41)
    frames = zip(clear_of_poles("XYZ", 20), unit_vectors(20), strict=True)
    for motion in moving([(rodrigues(theta, r) @ R_e, R_e) for R_e, r in frames]):
        assert_error_equation(name, make(name), motion)


@every_sequence
@pytest.mark.parametrize("distance", [1e-2, 1e-4])
def test_near_the_pole_eq_39_holds_to_rounding_of_its_growing_terms(sequence, distance):
    law = make("euler_angles", sequence)
    ends = [R for pole in poles(sequence) for R in near_pole(sequence, pole, distance, 4)]
    for motion in moving(list(zip(ends, reversed(ends), strict=True))):
        _, _, ddx = ERRORS["euler_angles"](motion, REST, sequence)  # they grow like 1/distance^2
        size = np.abs(ddx).max()
        assert size > 0.1 / distance
        assert_error_equation("euler_angles", law, motion, sequence, atol=ILL_CONDITIONED * size)


@pytest.mark.parametrize("name", OF_THE_QUATERNION)
def test_on_the_long_way_round_the_law_pulls_the_other_way(name):
    short, long = make(name), make(name, sign="continuous", initial=-1)
    for motion in moving(pairs_apart(1.0, 20)):
        x, dx, ddx = ERRORS[name](motion, a_o_of(long, motion), "XYZ")
        turn_back = (2 * math.pi - 1.0) / 1.0 if name == "rotation_vector" else 1.0
        residual = ddx + K_VO * dx - K_PO * turn_back * x
        assert_close(residual, 0, ERROR_EQUATION)
        assert np.abs(a_o_of(long, motion) - a_o_of(short, motion)).max() > 1


def test_euler_parameters_ask_for_a_bounded_acceleration_everywhere():
    law = make("euler_parameters")
    Rs = [*uniform(100), *half_turns(), *near_pole("XYZ", RIGHT, 0.0)]
    for m in moving(list(zip(Rs, reversed(Rs), strict=True))):
        feedback = a_o_of(law, m) - m.domega_d - K_VO * (m.omega_d - m.omega_e)  # eq. (40)
        assert np.linalg.norm(feedback) <= K_PO * (1 + 100 * RELATIVE)


# --- singularities --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["angle_axis", "euler_angles"])
@pytest.mark.parametrize("delta", [1e-2, 1e-3, 1e-5])
def test_the_acceleration_grows_without_bound_towards_the_singularity(name, delta):
    omega = np.array([0.3, 0.5, 0.8])
    a_o = a_o_of(make(name), Motion(about(1, RIGHT - delta), np.eye(3), omega, omega, omega / 2))
    assert np.linalg.norm(a_o) > 0.1 / delta
    if name == "euler_angles":
        assert np.linalg.norm(a_o) > 0.1 / delta**2  # ddphi_d grows with the square


def test_relative_angles_are_singular_for_errors_of_90_degrees_only():
    omega = np.array([0.3, 0.5, 0.8])
    pole, law = about(1, RIGHT - 1e-5), make("relative_euler_angles")
    at_the_pole = Motion(pole, about(0, -0.3) @ pole, omega, omega, REST)
    assert np.linalg.norm(a_o_of(law, at_the_pole)) < 50
    assert pole_clearance("XYZ", at_the_pole.R_d) < 1e-4
    far_apart = Motion(pole, np.eye(3), omega, omega, REST)
    assert np.linalg.norm(a_o_of(law, far_apart)) > 1e4


# --- Lyapunov functions, eqs. (30), (31), (42)-(47) ---------------------------------------------


@every_representation
def test_only_the_representations_of_the_paper_have_lyapunov_functions(name):
    law = make(name)
    x_de = law.displacement(about(0, 0.3), about(1, 0.2))
    has = name in HAVE_V
    assert (law.lyapunov_1(x_de, K_PO) is not None) == has
    assert (law.lyapunov_2(x_de, REST, K_PO, K_VO) is not None) == has


def both_signs(R_d, R_e):
    """Return the law that keeps the sign, and the displacement of either sign."""
    law = make("euler_parameters", sign="continuous")
    other = make("euler_parameters", sign="continuous", initial=-1)
    return law, [law.displacement(R_d, R_e), other.displacement(R_d, R_e)]


@pytest.mark.parametrize("theta", [0.0, 1e-6, 0.5, 2.0, math.pi])
def test_V_1_is_twice_one_minus_eta(theta):
    for pair in pairs_apart(theta, 10):
        law, displacements = both_signs(*pair)
        for x_de, eta in zip(displacements, (1, -1), strict=True):
            eta *= math.cos(theta / 2)
            value, rate = law.lyapunov_1(x_de, K_PO)
            assert value == pytest.approx(2 * (1 - eta), abs=ALGEBRAIC)  # eq. (30)
            expected = -K_PO * math.sin(theta / 2) ** 2  # eq. (31)
            assert rate == pytest.approx(expected, abs=ALGEBRAIC * K_PO)


def test_V_2_is_zero_at_Q2_and_four_times_the_gain_at_Q1():
    for R in uniform(20):
        law, (Q2, Q1) = both_signs(R, R)
        for x_de, expected in ((Q2, 0.0), (Q1, 4 * K_PO)):  # eqs. (45), (44) with (46)
            value, rate = law.lyapunov_2(x_de, REST, K_PO, K_VO)
            assert value == pytest.approx(expected, abs=ALGEBRAIC * K_PO)
            assert rate == 0
            # both are equilibria
            a_o = law.resolved_acceleration(x_de, REST, REST, REST, K_PO, K_VO)
            assert_close(a_o, 0, ALGEBRAIC * K_PO)


def test_a_representation_without_a_resolved_acceleration_cannot_be_made():
    laws = make("euler_parameters").laws
    with pytest.raises(TypeError, match="acceleration"):
        Laws(laws.displacement, laws.velocity)
