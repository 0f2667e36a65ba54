"""Every representation of the orientation displacement: eqs. (22), (23), (26)-(31), (38)-(47).

The properties run over the registry.  What is expected of a representation that the
tables below do not name: it has no singularity, and no Lyapunov function.

The error equations of second order are shown exactly, with the derivatives of T and L by complex
steps and by the product rule, in formulas of this file.  They leave no other acceleration.
"""

import math
from itertools import product

import numpy as np
import pytest
import tolerances as tol
from representations import (
    FUNCTIONS,
    OF_ANGLES,
    difference_of_angles,
    every_representation,
    every_sequence,
    make,
    moving,
    regular_motions,
    relative_angles,
)
from samples import (
    about,
    axial,
    clear_of_poles,
    half_turns,
    near_pole,
    pairs_apart,
    poles,
    rodrigues,
    skew,
    uniform,
    unit_vectors,
    vectors,
)

from eulerparams_control.errors import SingularityError
from eulerparams_control.laws.orientation import (
    ORIENTATIONS,
    SEQUENCES,
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    SignRule,
    representation,
)

COUNT = 40
K = 2.0  # k_Po of CLIK [1/s]
K_PO, K_VO = GAINS = 12.0, 5.0  # of dynamic control [1/s^2], [1/s]
REST = np.zeros(3)  # omega_d [rad/s]
ANGLES = (1e-7, 1e-3, 0.5, 1.2, 2.0, 3.1)
RIGHT = math.pi / 2
# Those whose error is zero at 180 deg too.
VANISHES_AT_PI = {"angle_axis"}
# f(theta) of those that pull along the axis of the error, (28), (40), by f(theta) r.
ALONG = {name: f for name, (f, _, _) in FUNCTIONS.items() if name != "angle_axis"}
# The angles of the error [rad] at which a law is singular wherever the frames are.
SINGULAR_ERRORS = {"angle_axis": (RIGHT, math.pi)} | {
    name: (math.pi,) for name in ALONG if name != "euler_parameters"
}
# Those whose error follows from the mutual quaternion and its sign.
HAS_A_SIGN = ("euler_parameters", "modified_rodrigues", "rotation_vector")
# Those for which the paper has V_1 and V_2.
HAVE_V = {"euler_parameters"}


def omega_of(law, R_d, R_e, omega_d=REST, k_Po=K):
    return law.velocity(law.displacement(R_d, R_e), omega_d, k_Po)


def a_o_of(law, m, k_Po=K_PO, k_Vo=K_VO):
    x_de = law.displacement(m.R_d, m.R_e)
    return law.acceleration(x_de, m.omega_d, m.domega_d, m.omega_e, k_Po, k_Vo)


def test_the_representations_are_registered_and_found_by_name_with_their_options():
    assert set(ORIENTATIONS) == {*OF_ANGLES, *FUNCTIONS}
    others = set(OrientationRepresentation.registry) - set(ORIENTATIONS)
    assert all(name.startswith("as_shipped_") for name in others)  # of experiments
    options = OrientationOptions(EulerSequence("ZYZ"), SignRule("shortest"))
    defaults = OrientationOptions(EulerSequence("XYZ"), SignRule("hysteretic", 0.2))
    for name in ORIENTATIONS:
        assert representation(name, options).name == name
        assert representation(name, options).options == options
        assert representation(name).options == defaults


# --- the errors, eqs. (22)-(29) --------------------------------------------------------------
@every_representation
def test_only_sin_theta_r_vanishes_at_180_degrees(name):
    for half_turn, R_e in zip(half_turns(), uniform(len(half_turns())), strict=True):
        error = np.linalg.norm(make(name).displacement(R_e @ half_turn, R_e).error)
        assert (error < tol.ALGEBRAIC) == (name in VANISHES_AT_PI)
        assert error < tol.ALGEBRAIC or error > 0.99 or (math.isnan(error) and name == "rodrigues")


@pytest.mark.parametrize("theta", ANGLES)
def test_the_errors_about_an_axis_have_their_closed_forms(theta):
    for r, R_e in zip(unit_vectors(20), uniform(20), strict=True):
        for name, (f, _, _) in FUNCTIONS.items():
            error = make(name).displacement(rodrigues(theta, r) @ R_e, R_e).error
            tol.assert_close(error, f(theta) * r, tol.ALGEBRAIC * (1 + f(theta) ** 2))


@every_sequence
def test_the_errors_are_those_of_the_angles_of_both_frames_and_of_the_mutual_rotation(sequence):
    law, relative = make("euler_angles", sequence), make("relative_euler_angles", sequence)
    for R_d, R_e in zip(uniform(COUNT), uniform(COUNT, key=1), strict=True):
        phi_d, phi_e, error = law.displacement(R_d, R_e)
        tol.assert_close(EulerSequence(sequence).R(phi_d), R_d)
        tol.assert_close(EulerSequence(sequence).R(phi_e), R_e)
        turns = (phi_d - phi_e - error) / (2 * math.pi)  # eq. (22)
        tol.assert_close(turns, np.round(turns))
        assert np.abs(error).max() <= math.pi
        phi_de = relative.displacement(R_d, R_e).error
        tol.assert_close(R_e @ EulerSequence(sequence).R(phi_de), R_d)


def at_the_poles(sequence="XYZ"):
    """Return rotations at both poles of a sequence, exactly."""
    return [R for pole in poles(sequence) for R in near_pole(sequence, pole, 0.0)]


def test_at_the_pole_angles_keep_the_gamma_of_before():
    law, relative = make("euler_angles"), make("relative_euler_angles")
    before = law.displacement(about(2, 0.3), about(2, -0.8))
    relative_before = relative.displacement(about(2, 0.3), np.eye(3))
    for R in at_the_poles():
        x_de = law.displacement(R, R, before)
        assert (x_de.phi_d[2], x_de.phi_e[2]) == (before.phi_d[2], before.phi_e[2])
        phi_de = relative.displacement(R, np.eye(3), relative_before).error
        assert phi_de[2] == relative_before.error[2]


# --- singularities ---------------------------------------------------------------------------
def singular_pairs(name):
    """Return pairs (R_d, R_e) at a singularity of the law."""
    at_pole = list(zip(at_the_poles(), uniform(40, key=3), strict=True))
    if name == "euler_angles":
        return [pair for P, R in at_pole for pair in ((P, R), (R, P), (P, P))]
    if name == "relative_euler_angles":
        return [(R @ P, R) for P, R in at_pole]
    return [pair for theta in SINGULAR_ERRORS.get(name, ()) for pair in pairs_apart(theta, 20)]


@every_representation
def test_the_distance_is_zero_at_a_singularity_and_infinite_if_there_is_none(name):
    law, singular = make(name), singular_pairs(name)
    distances = [law.singularity_distance(m.R_d, m.R_e) for m in regular_motions(law)]
    assert max(distances) <= math.pi if singular else set(distances) == {math.inf}
    for pair in singular:
        assert law.singularity_distance(*pair) == pytest.approx(0, abs=tol.ALGEBRAIC)


@pytest.mark.parametrize("theta", [0.2, 1.0, 1.5, 1.6, 2.5, 3.0])
def test_the_distance_is_the_angle_that_is_left_of_the_nearer_of_both_frames(theta):
    for pair in ((about(1, theta), np.eye(3)), (np.eye(3), about(1, theta))):
        distance = make("euler_angles").singularity_distance(*pair)
        assert distance == pytest.approx(abs(RIGHT - theta), abs=tol.ALGEBRAIC)
    for pair in pairs_apart(theta, 20):
        for name, singular in SINGULAR_ERRORS.items():
            expected = min(abs(theta - angle) for angle in singular)
            distance = make(name).singularity_distance(*pair)
            assert distance == pytest.approx(expected, abs=tol.ALGEBRAIC)


@pytest.mark.parametrize(
    ("name", "R_d", "R_e", "text"),
    [
        ("angle_axis", np.rint(about(2, RIGHT)), np.eye(3), "90 deg"),
        ("euler_angles", np.eye(3), about(1, 0.5), "ZYZ"),
        ("rodrigues", half_turns()[0], np.eye(3), "180 deg"),
    ],
)
def test_exactly_at_a_singularity_a_law_is_refused_with_the_way_out(name, R_d, R_e, text):
    law, velocities = make(name, "ZYZ"), vectors(3)
    with pytest.raises(SingularityError, match=f"{text}.*euler_parameters"):
        omega_of(law, R_d, R_e, velocities[0])
    for x_de in (law.displacement(R_d, R_e), law.displacement(R_e, R_d)):
        with pytest.raises(SingularityError, match=f"{text}.*euler_parameters"):
            law.acceleration(x_de, *velocities, K, K)


# --- the error and its derivatives, exactly ---------------------------------------------------
def error_of_angle_axis(m, omega_e, domega_e, _sequence):
    """Return sin(theta) r, the vector of R_d R_e', and its two derivatives."""
    S_d, S_e, Q = skew(m.omega_d), skew(omega_e), m.R_d @ m.R_e.T
    dQ = S_d @ Q - Q @ S_e
    ddQ = skew(m.domega_d) @ Q + S_d @ dQ - dQ @ S_e - Q @ skew(domega_e)
    return axial(Q), axial(dQ), axial(ddQ)


def error_along(f):
    """Return the function f(theta) r, Delta omega_de and its derivative: the terms of eq. (41)."""
    return lambda m, omega_e, domega_e, _sequence: (
        f(m.theta) * m.r,
        m.omega_d - omega_e,
        m.domega_d - domega_e,
    )


def error_by(angles):
    """Return the function that gives the error in angles, from e to d, and its derivatives."""
    return lambda m, omega_e, domega_e, sequence: angles(
        sequence, (m.R_e, omega_e, domega_e), (m.R_d, m.omega_d, m.domega_d)
    )


ERRORS = {
    "angle_axis": error_of_angle_axis,
    "euler_angles": error_by(difference_of_angles),
    "relative_euler_angles": error_by(relative_angles),
    **{name: error_along(f) for name, f in ALONG.items()},
}


@pytest.mark.parametrize(
    ("name", "sequence", "gains", "theta"),
    [
        *product(ORIENTATIONS, ["XYZ"], [(0.0, 0.0), (7.0, 0.0), (0.0, 3.0), GAINS], [None]),
        *product(OF_ANGLES, SEQUENCES, [GAINS], [None]),
        *product(ORIENTATIONS, ["XYZ"], [GAINS], (0.0, 1e-9, 1e-7, 1e-4)),
        *product(["angle_axis"], ["XYZ"], [GAINS], (RIGHT - 1e-2, RIGHT + 1e-4, 3.0)),
        *product(HAS_A_SIGN, ["XYZ"], [GAINS], (3.0, math.pi - 1e-4)),
    ],
)
def test_along_the_velocity_and_the_acceleration_the_error_obeys_its_equation(
    name, sequence, gains, theta
):
    """Equations (35), (26) with (29), (39) with (41): ddx + k_Vo dx + k_Po x = 0."""
    law, error, (k_Po, k_Vo) = make(name, sequence), ERRORS[name], gains
    motions = regular_motions(law)
    if theta is not None:
        motions = moving([theta] * 20, clear_of_poles("XYZ", 20))
    for m in motions:
        x, dx, _ = error(m, omega_of(law, m.R_d, m.R_e, m.omega_d, k_Po), REST, sequence)
        tol.assert_close(dx + k_Po * x, 0, tol.ERROR_EQUATION)
        x, dx, ddx = error(m, m.omega_e, a_o_of(law, m, *gains), sequence)
        tol.assert_close(ddx + k_Vo * dx + k_Po * x, 0, tol.ERROR_EQUATION)


@pytest.mark.parametrize("name", HAS_A_SIGN)
def test_on_the_long_way_round_the_laws_pull_the_other_way(name):
    short, long = make(name), make(name, sign="continuous", initial=-1)
    turn_back = ALONG[name](2 * math.pi - 1.0) / ALONG[name](1.0)
    for m in moving([1.0] * 20, uniform(20)):
        x, dx, ddx = ERRORS[name](m, m.omega_e, a_o_of(long, m), "XYZ")
        tol.assert_close(ddx + K_VO * dx - K_PO * turn_back * x, 0, tol.ERROR_EQUATION)
        omega_e = omega_of(long, m.R_d, m.R_e, m.omega_d)
        tol.assert_close(m.omega_d - omega_e, K * turn_back * x, tol.ERROR_EQUATION)
        assert np.abs(a_o_of(long, m) - a_o_of(short, m)).max() > 1


# --- Lyapunov functions, eqs. (30), (31), (42)-(47) ---------------------------------------------
@every_representation
def test_only_the_representations_of_the_paper_have_lyapunov_functions(name):
    law = make(name)
    x_de = law.displacement(about(0, 0.3), about(1, 0.2))
    assert (law.lyapunov_1(x_de, K_PO) is not None) == (name in HAVE_V)
    assert (law.lyapunov_2(x_de, REST, K_PO, K_VO) is not None) == (name in HAVE_V)


def both_signs(R_d, R_e):
    """Return the law that keeps the sign, and the displacement of either sign."""
    laws = [make("euler_parameters", sign="continuous", initial=sign) for sign in (1, -1)]
    return laws[0], [law.displacement(R_d, R_e) for law in laws]


@pytest.mark.parametrize("theta", [0.0, 1e-6, 0.5, 2.0, math.pi])
def test_V_1_is_twice_one_minus_eta(theta):
    rate = -K_PO * math.sin(theta / 2) ** 2  # eq. (31)
    for pair in pairs_apart(theta, 10):
        law, displacements = both_signs(*pair)
        for x_de, sign in zip(displacements, (1, -1), strict=True):
            V = 2 * (1 - sign * math.cos(theta / 2))  # eq. (30)
            tol.assert_close(law.lyapunov_1(x_de, K_PO), [V, rate], tol.ALGEBRAIC * K_PO)


def test_V_2_is_zero_at_Q2_and_four_times_the_gain_at_Q1():
    for R in uniform(20):
        law, (Q2, Q1) = both_signs(R, R)
        for x_de, V in ((Q2, 0.0), (Q1, 4 * K_PO)):  # eqs. (45), (44) with (46)
            value, rate = law.lyapunov_2(x_de, REST, K_PO, K_VO)
            assert value == pytest.approx(V, abs=tol.ALGEBRAIC * K_PO)
            assert rate == 0
            # both are equilibria
            a_o = law.acceleration(x_de, REST, REST, REST, K_PO, K_VO)
            tol.assert_close(a_o, 0, tol.ALGEBRAIC * K_PO)
