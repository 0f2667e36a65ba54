"""The 12 sequences of Euler angles: eqs. (2), (3), the derivative of T, extraction."""

import itertools
import math
import re

import numpy as np
import pytest
from samples import (
    POLE_DISTANCES,
    all_rotations,
    axes_of,
    by_angles,
    clear_of_poles,
    derivative,
    generator,
    near_pole,
    pole_clearance,
    poles,
    uniform,
    vectors,
)
from tolerances import ASIN, DIFFERENCES, RELATIVE, UNBOUNDED, assert_close

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws.orientation import SEQUENCES, EulerSequence
from eulerparams_control.laws.orientation.sequences import wrapped as wrapped_angle
from eulerparams_control.laws.rotations import S

COUNT = 50

every_sequence = pytest.mark.parametrize("name", SEQUENCES)


def random_angles(count, key=0):
    """Return angles (3,) in (-pi, pi), beta included: T is defined everywhere."""
    return list(generator(10, key).uniform(-math.pi, math.pi, size=(count, 3)))


def principal_angles(name, count):
    """Return angles (3,) with beta in the range of extraction, off the poles."""
    lower, upper = poles(name)
    low, high = [-math.pi, lower + 0.05, -math.pi], [math.pi, upper - 0.05, math.pi]
    return list(generator(11).uniform(low, high, size=(count, 3)))


def assert_extracts(name, R, previous=None):
    """Assert that R(extract(R)) = R, and return the angles."""
    phi = EulerSequence(name).extract(R, previous)
    assert_close(by_angles(name, *phi), R)
    return phi


def rounded(R, key):
    """Return R after two products that cancel: the same but for rounding, as from an arm."""
    (turn,) = uniform(1, key)
    return turn.T @ (turn @ R)


# --- the registry ----------------------------------------------------------------------------


def test_there_are_the_12_sequences_whose_neighbours_differ_with_their_axes_and_kind():
    letters = itertools.product("XYZ", repeat=3)
    assert set(SEQUENCES) == {i + j + k for i, j, k in letters if i != j and j != k}
    assert len(SEQUENCES) == 12
    for name in SEQUENCES:
        assert EulerSequence(name).axes == axes_of(name)
        assert EulerSequence(name).is_proper == (name[0] == name[2])
    assert EulerSequence() == EulerSequence("XYZ")  # that of the paper


@pytest.mark.parametrize("name", ["XYY", "xyz", "", "ABC", "XYZX"])
def test_an_unknown_sequence_lists_the_known_ones(name):
    with pytest.raises(UnknownNameError) as caught:
        EulerSequence(name)
    assert f"'{name}'" in str(caught.value)
    assert all(known in str(caught.value) for known in SEQUENCES)
    assert isinstance(caught.value, ConfigurationError)


# --- eqs. (2), (3) ---------------------------------------------------------------------------


@every_sequence
def test_R_is_the_product_of_the_elementary_rotations(name):
    for phi in random_angles(COUNT):
        assert_close(EulerSequence(name).R(phi), by_angles(name, *phi))  # eq. (2)


@every_sequence
def test_T_takes_the_rates_of_the_angles_to_the_angular_velocity(name):
    for phi, dphi in zip(random_angles(COUNT), vectors(COUNT), strict=True):
        dR = derivative(lambda t, phi=phi, dphi=dphi: by_angles(name, *(phi + t * dphi)))
        omega = EulerSequence(name).T(phi) @ dphi  # eq. (3)
        assert_close(dR, S(omega) @ by_angles(name, *phi), DIFFERENCES)  # eq. (1)


@every_sequence
def test_dT_is_the_derivative_of_T(name):
    sequence = EulerSequence(name)
    for phi, dphi in zip(random_angles(COUNT), vectors(COUNT), strict=True):
        dT = derivative(lambda t, phi=phi, dphi=dphi: sequence.T(phi + t * dphi))
        assert_close(sequence.dT(phi, dphi), dT, DIFFERENCES)


# --- distance to the pole --------------------------------------------------------------------


@every_sequence
def test_pole_distance_is_the_angle_between_the_first_and_the_last_axis(name):
    for R in all_rotations():
        distance = EulerSequence(name).pole_distance(R)
        assert distance == pytest.approx(pole_clearance(name, R), abs=ASIN)


@every_sequence
def test_pole_distance_is_accurate_near_both_poles(name):
    for pole, distance in itertools.product(poles(name), POLE_DISTANCES):
        for R in near_pole(name, pole, distance):
            assert EulerSequence(name).pole_distance(R) == pytest.approx(distance, abs=RELATIVE)


# --- rates -----------------------------------------------------------------------------------


@every_sequence
def test_rates_invert_T(name):
    sequence = EulerSequence(name)
    for phi, omega in zip(principal_angles(name, COUNT), vectors(COUNT), strict=True):
        assert_close(sequence.T(phi) @ sequence.rates(phi, omega), omega)


@every_sequence
def test_the_rates_at_a_pole_are_refused_with_the_way_out_or_unbounded(name):
    refusals = []
    for pole in poles(name):
        phi = np.array([0.4, pole, -0.9])
        omega = np.cross(*EulerSequence(name).T(phi).T[:2])
        try:
            rates = EulerSequence(name).rates(phi, omega)
        except SingularityError as error:
            refusals.append(str(error))
            continue
        assert np.abs(rates).max() > UNBOUNDED
    assert refusals or not EulerSequence(name).is_proper  # T(0) is exactly singular
    assert all(re.search(f"{name}.*euler_parameters", text) for text in refusals)


# --- extraction ------------------------------------------------------------------------------


@every_sequence
def test_extraction_inverts_R_everywhere(name):
    for R in all_rotations():
        assert_extracts(name, R)


@every_sequence
def test_extraction_near_and_at_both_poles_inverts_R_and_bears_its_rounding(name):
    for pole, distance in itertools.product(poles(name), POLE_DISTANCES):
        for key, R in enumerate(near_pole(name, pole, distance)):
            phi = assert_extracts(name, R)
            assert abs(phi[1] - pole) == pytest.approx(distance, abs=RELATIVE)
            assert_extracts(name, rounded(R, key))


@every_sequence
def test_extraction_returns_the_angles_in_their_principal_range(name):
    for phi in principal_angles(name, COUNT):
        extracted = EulerSequence(name).extract(by_angles(name, *phi))
        assert_close(extracted, phi)


@every_sequence
def test_the_previous_gamma_is_kept_at_the_pole(name):
    previous = np.array([0.1, 0.2, -2.3])
    for pole in poles(name):
        for R in near_pole(name, pole, distance=0.0):
            assert assert_extracts(name, R, previous)[2] == previous[2]
            assert assert_extracts(name, R)[2] == 0.0


@every_sequence
def test_away_from_the_pole_the_previous_angles_do_not_matter(name):
    previous = np.array([0.1, 0.2, -2.3])
    for R in clear_of_poles(name, COUNT):
        sequence = EulerSequence(name)
        np.testing.assert_array_equal(sequence.extract(R, previous), sequence.extract(R))


def test_wrapped_angles_differ_by_whole_turns_and_lie_within_a_half_turn():
    just_above_pi = np.nextafter(math.pi, 4.0)
    edges = [math.pi, -math.pi, just_above_pi, 3 * math.pi, 5 * math.pi]
    angles = np.concatenate((generator(13).uniform(-20, 20, size=3000), edges))
    wrapped = wrapped_angle(angles)
    turns = (angles - wrapped) / (2 * math.pi)
    assert_close(turns, np.round(turns))
    assert (wrapped > -math.pi).all()
    assert (wrapped <= math.pi).all()
    np.testing.assert_array_equal(wrapped[-5:-3], math.pi)
