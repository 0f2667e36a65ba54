"""Way-points as rows of numbers: the formats they can have, and what is refused."""

import math

import numpy as np
import pytest
from samples import about, by_angles, generator, rodrigues
from tolerances import ALGEBRAIC, THROUGH_POINTS

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.orientation import SEQUENCES
from eulerparams_control.motion.way_points import FORMATS, parse_way_points

AXIS = np.array([2.0, -1.0, 2.0]) / 3
ANGLE = 1.9
R = rodrigues(ANGLE, AXIS)
XYZW = [*(math.sin(ANGLE / 2) * AXIS), math.cos(ANGLE / 2)]


def pose(orientation, orientation_format, position=(0.1, 0.2, 0.3)):
    """Return position and orientation of a single way-point."""
    frame = parse_way_points([0.0], position, orientation, orientation_format).sample(0.0)
    return frame.p_d, frame.R_d


def test_a_quaternion_is_read_as_x_y_z_w_and_is_the_format_unless_told_otherwise():
    for sign in (1, -1):
        p, R_d = pose(sign * np.array(XYZW), "quaternion_xyzw")
        np.testing.assert_array_equal(p, [0.1, 0.2, 0.3])
        np.testing.assert_allclose(R_d, R, rtol=0, atol=ALGEBRAIC)
    unless_told = parse_way_points([0.0], [0, 0, 0], XYZW)
    np.testing.assert_allclose(unless_told.sample(0.0).R_d, R, rtol=0, atol=ALGEBRAIC)


def test_a_rotation_vector_is_the_angle_times_the_axis():
    np.testing.assert_allclose(pose(ANGLE * AXIS, "rotation_vector")[1], R, rtol=0, atol=ALGEBRAIC)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_angles_are_those_of_the_sequence_in_radians(sequence):
    for angles in generator(90).uniform(-3, 3, size=(20, 3)):
        expected = by_angles(sequence, *angles)
        np.testing.assert_allclose(pose(angles, sequence)[1], expected, rtol=0, atol=ALGEBRAIC)


def test_every_sequence_is_a_format():
    assert set(FORMATS) == {"quaternion_xyzw", "rotation_vector", *SEQUENCES}


def test_rows_follow_each_other_and_the_motion_rests_at_each():
    trajectory = parse_way_points(
        [0.0, 1.0, 3.0], [1, 2, 3, 4, 5, 6, 7, 8, 9], [0, 0, 0, 0, 0, 0.5, 0.7, 0, 0], "XYZ"
    )
    expected = (np.eye(3), about(2, 0.5), about(0, 0.7))
    assert trajectory.times == [0.0, 1.0, 3.0]
    for i, (t, R_d) in enumerate(zip(trajectory.times, expected, strict=True)):
        frame = trajectory.sample(t)
        np.testing.assert_allclose(frame.p_d, np.arange(3) + 3 * i + 1, atol=THROUGH_POINTS)
        np.testing.assert_allclose(frame.R_d, R_d, rtol=0, atol=THROUGH_POINTS)
        for rate in frame[2:]:
            np.testing.assert_allclose(rate, 0, rtol=0, atol=THROUGH_POINTS)


def test_a_quaternion_printed_with_four_digits_is_normalised():
    _, R_d = pose(np.round(XYZW, 4), "quaternion_xyzw")
    np.testing.assert_allclose(R_d @ R_d.T, np.eye(3), rtol=0, atol=ALGEBRAIC)
    np.testing.assert_allclose(R_d, R, rtol=0, atol=4e-4)  # of four digits


@pytest.mark.parametrize(
    ("values", "norm"), [([0, 0, 0, 0], "0"), ([0, 0, 0, 1.01], "1.01"), ([1, 1, 0, 0], "1.41421")]
)
def test_a_quaternion_that_is_not_of_norm_1_is_refused_with_its_norm(values, norm):
    with pytest.raises(ConfigurationError, match=f"has norm {norm}; expected 1"):
        pose(values, "quaternion_xyzw")


@pytest.mark.parametrize(
    ("times", "positions", "orientations", "orientation_format"),
    [
        ([], [], [], "XYZ"),
        ([0.0], [0, 0], [0, 0, 0], "XYZ"),
        ([0.0], [0, 0, 0], [0, 0, 0, 1], "XYZ"),
        ([0.0], [0, 0, 0], [0, 0, 0], "quaternion_xyzw"),
        ([0.0, 1.0], [0, 0, 0], [0, 0, 0], "rotation_vector"),
        ([0.0], [0, 0, 0, 0, 0, 0], [0, 0, 0], "ZYZ"),
    ],
)
def test_rows_that_do_not_fit_are_refused_with_their_numbers(
    times, positions, orientations, orientation_format
):
    width = 4 if orientation_format == "quaternion_xyzw" else 3
    with pytest.raises(ConfigurationError) as refusal:
        parse_way_points(times, positions, orientations, orientation_format)
    assert str(refusal.value) == (
        f"way-points: {len(times)} times, {len(positions)} numbers in positions, "
        f"{len(orientations)} in orientations; expected N, 3 N and {width} N with "
        f"orientation_format {orientation_format}"
    )


def test_an_unknown_format_is_refused_with_those_that_exist():
    with pytest.raises(UnknownNameError) as refusal:
        parse_way_points([0.0], [0, 0, 0], [0, 0, 0], "quaternion_wxyz")
    text = str(refusal.value)
    assert "unknown orientation_format 'quaternion_wxyz' (did you mean 'quaternion_xyzw'?)" in text
    for known in FORMATS:
        assert known in text


@pytest.mark.parametrize("orientation_format", ["quaternion_xyzw", "rotation_vector", "XYZ"])
@pytest.mark.parametrize("where", ["times", "positions", "orientations"])
def test_numbers_that_are_not_finite_are_refused(orientation_format, where):
    turn = [0.0, 0.0, 0.0, 1.0] if orientation_format == "quaternion_xyzw" else [0.0, 0.0, 0.0]
    for bad in (math.nan, math.inf, -math.inf):
        rows = {"times": [0.0], "positions": [0.0, 0.0, 0.0], "orientations": [*turn]}
        rows[where][0] = bad
        with pytest.raises(ConfigurationError, match="expected finite numbers"):
            parse_way_points(**rows, orientation_format=orientation_format)
