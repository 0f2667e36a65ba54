"""Desired motions: they pass their frames, and their rates are their derivatives."""

import math

import numpy as np
import pytest
import samples
import tolerances as tol

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws.orientation import SEQUENCES
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.shaper import Shaper
from eulerparams_control.motion.trajectories import Circle, Trajectory, way_points
from eulerparams_control.motion.way_points import FORMATS, parse_way_points

S_IN_NS = 1_000_000_000
ANGLES = (0.0, 1e-9, 1e-3, 0.5, 1.5, 2.0, 3.0, math.radians(175))
CIRCLE = Circle(radius=0.15, normal=np.array([1.0, 2.0, -2.0]), period=4.0, tilt=0.4)
P_0, R_0 = np.array([0.4, -0.1, 0.5]), samples.rodrigues(2.1, np.array([0.6, 0.0, 0.8]))


def moving_frame(R, key):
    """Return a frame with that orientation, random position, velocities and accelerations."""
    p, dp, omega, ddp, domega = samples.vectors(5, key=100 + key)
    return DesiredFrame(p, R, dp, omega, ddp, domega)


def trajectory_turning(theta, key=0):
    """Return a motion of three moving frames, each theta [rad] away from its neighbour."""
    ((R_1, R_0),) = samples.pairs_apart(theta, 1, key)
    R_2 = samples.rodrigues(theta, samples.unit_vectors(1, key + 50)[0]) @ R_1
    frames = [moving_frame(R, 10 * key + i) for i, R in enumerate((R_0, R_1, R_2))]
    return Trajectory([0.0, 0.8, 2.0], frames)


def assert_same_frame(a, b, atol):
    """Assert that pose, velocities and accelerations agree."""
    for of_a, of_b in zip(a, b, strict=True):
        tol.assert_close(of_a, of_b, atol)


def assert_rates_are_derivatives(motion, t, atol=tol.MOTION_DIFFERENCES):
    """Assert that velocities and accelerations at t are the derivatives of pose and rates."""
    frame = motion.sample(t)
    S_omega = samples.derivative(lambda h: motion.sample(t + h).R_d) @ frame.R_d.T
    omega = np.array([S_omega[2, 1], S_omega[0, 2], S_omega[1, 0]])
    for name, rate, value in (
        ("dp_d", frame.dp_d, samples.derivative(lambda h: motion.sample(t + h).p_d)),
        ("omega_d", frame.omega_d, omega),
        ("ddp_d", frame.ddp_d, samples.derivative(lambda h: motion.sample(t + h).dp_d)),
        ("domega_d", frame.domega_d, samples.derivative(lambda h: motion.sample(t + h).omega_d)),
    ):
        np.testing.assert_allclose(rate, value, rtol=atol, atol=atol, err_msg=name)


# --- trajectories -------------------------------------------------------------------------
@pytest.mark.parametrize("theta", ANGLES)
def test_a_trajectory_passes_its_frames_with_their_rates_which_are_its_derivatives(theta):
    for key in range(5):
        trajectory = trajectory_turning(theta, key)
        for i, t in enumerate(trajectory.times):
            assert_same_frame(trajectory.sample(t), trajectory.frames[i], tol.THROUGH_POINTS)
            # accelerations near 180 deg have the condition of J_r; jerks are of 1e4
            just_before = trajectory.sample(np.nextafter(t, 0)) if i else trajectory.sample(t)
            assert_same_frame(just_before, trajectory.frames[i], 100 * tol.THROUGH_POINTS)
        for t in samples.generator(60, key).uniform(0.01, 1.99, size=6):
            if abs(t - 0.8) > 1e-3:
                assert_rates_are_derivatives(trajectory, t, 30 * tol.MOTION_DIFFERENCES)


def test_samples_are_those_that_are_taken_one_by_one():
    trajectory = trajectory_turning(1.5)
    t = np.array([-1.0, 0.0, 0.3, 0.8, 1.7, 2.0, 2.5])
    stack = trajectory.samples(t)
    for n, at in enumerate(t):
        assert_same_frame(trajectory.sample(at), [part[n] for part in stack], 0)


def test_a_trajectory_rests_before_and_after_its_frames_or_starts_with_the_frame_given():
    first, last, here = (moving_frame(R, i) for i, R in enumerate(samples.uniform(3)))
    trajectory = Trajectory([0.5, 2.0], [first, last])
    assert trajectory.duration == 2.0
    for t, frame in ((0.0, first), (0.4999, first), (2.0001, last), (99.0, last)):
        assert_same_frame(trajectory.sample(t), DesiredFrame(frame.p_d, frame.R_d), 0)
    longer = trajectory.from_frame(here)
    assert longer.times == [0.0, 0.5, 2.0]
    assert_same_frame(longer.sample(0.0), here, tol.THROUGH_POINTS)
    assert_same_frame(longer.sample(0.5), first, tol.THROUGH_POINTS)
    assert longer.from_frame(last) is longer


# --- way-points ---------------------------------------------------------------------------
@pytest.mark.parametrize("theta", [0.3, 1.5, 2.5, math.radians(179)])
def test_way_points_turn_about_the_equivalent_axis_and_move_on_a_line(theta):
    for key, r in enumerate(samples.unit_vectors(5, key=3)):
        R_start = samples.uniform(5, key=3)[key]
        p_start, p_end = samples.vectors(2, key=20 + key)
        trajectory = way_points(
            [0.0, 3.0], [(p_start, R_start), (p_end, samples.rodrigues(theta, r) @ R_start)]
        )
        for u in (0.0, 0.1, 0.37, 0.5, 0.82, 1.0):
            share = 10 * u**3 - 15 * u**4 + 6 * u**5
            speed = 30 * (u * (1 - u)) ** 2 / 3.0
            frame = trajectory.sample(3.0 * u)
            expected = samples.rodrigues(share * theta, r) @ R_start
            tol.assert_close(frame.R_d, expected, tol.THROUGH_POINTS)
            np.testing.assert_allclose(frame.omega_d, speed * theta * r, atol=tol.THROUGH_POINTS)
            line = p_start + share * (p_end - p_start)
            tol.assert_close(frame.p_d, line, tol.THROUGH_POINTS)


# --- circles ------------------------------------------------------------------------------
@pytest.mark.parametrize("ramp", [0.0, 0.5, 1.0, 4.0])
@pytest.mark.parametrize(("turns", "tilt"), [(1.0, 0.0), (1.0, 0.4), (1.0, 2.0), (2.5, 0.4)])
def test_a_circle_starts_and_ends_at_the_pose_and_its_rates_are_its_derivatives(ramp, turns, tilt):
    circle = CIRCLE._replace(ramp=ramp, turns=turns, tilt=tilt)
    trajectory = circle.trajectory(P_0, R_0)
    end = trajectory.duration
    assert end == pytest.approx(turns * circle.period + ramp, rel=tol.RELATIVE)
    for t in (0.0, end) if turns == 1.0 else (0.0,):
        frame = trajectory.sample(t)
        tol.assert_close(frame.p_d, P_0, tol.ALGEBRAIC)
        tol.assert_close(frame.R_d, R_0, tol.ALGEBRAIC)
        speed = 0.0 if ramp else 2 * math.pi * circle.radius / circle.period
        assert np.linalg.norm(frame.dp_d) == pytest.approx(speed, abs=tol.ALGEBRAIC)
    for t in samples.generator(62).uniform(0.01, end - 0.01, size=60):
        assert_rates_are_derivatives(trajectory, t)
        here, mirrored = trajectory.sample(t), trajectory.sample(end - t)  # it brakes as it started
        gains = [frame.dp_d @ frame.ddp_d for frame in (here, mirrored)]
        assert sum(gains) == pytest.approx(0, abs=tol.RAMPED)


def test_on_a_circle_the_tip_turns_by_the_right_hand_about_the_normal_and_the_tool_on_a_cone():
    for circle, begin in ((CIRCLE, CIRCLE.ramp), (CIRCLE._replace(ramp=0.0), 0.0)):
        trajectory, n = circle.trajectory(P_0, R_0), circle.normal / 3
        half_a_turn = trajectory.sample(circle.ramp / 2 + circle.period / 2)
        centre = (P_0 + half_a_turn.p_d) / 2
        axis = R_0.T @ samples.rodrigues(-circle.tilt, (P_0 - centre) / circle.radius).T @ n
        for t in np.linspace(begin, circle.period, 60):  # between the ramps
            frame, on_cone = trajectory.sample(t), trajectory.sample(t).R_d @ axis
            dp = 2 * math.pi / circle.period * np.cross(n, frame.p_d - centre)
            tol.assert_close(frame.dp_d, dp, tol.RAMPED)
            tol.assert_close(frame.ddp_d, 2 * math.pi / circle.period * np.cross(n, dp), tol.RAMPED)
            assert on_cone @ n == pytest.approx(math.cos(circle.tilt), abs=tol.RAMPED)
            omega = 2 * math.pi / circle.period * (n - on_cone)
            tol.assert_close(frame.omega_d, omega, tol.RAMPED)


# --- set-points ---------------------------------------------------------------------------
def test_a_set_point_is_extrapolated_at_its_twist_then_rests():
    dp, omega = np.array([0.1, -0.2, 0.3]), np.array([0.5, 1.0, -2.0])
    frame = DesiredFrame(P_0, R_0, dp, omega)
    speed = np.linalg.norm(omega)
    set_point = SetPoint(frame, lasting=0.2)
    for t, moved in ((-1.0, 0.0), (0.0, 0.0), (0.07, 0.07), (0.2, 0.2), (0.21, 0.2), (9.0, 0.2)):
        sample = set_point.sample(t)
        tol.assert_close(sample.p_d, P_0 + moved * dp, tol.ALGEBRAIC)
        expected = samples.rodrigues(speed * moved, omega / speed) @ R_0
        tol.assert_close(sample.R_d, expected, tol.ALGEBRAIC)
        still = t > 0.2
        np.testing.assert_array_equal(sample.dp_d, 0 * dp if still else dp)
        np.testing.assert_array_equal(sample.omega_d, 0 * omega if still else omega)


@pytest.mark.filterwarnings("ignore:(overflow|invalid value):RuntimeWarning")
def test_a_frame_that_turns_beyond_all_numbers_is_refused_when_it_is_sampled():
    frame = DesiredFrame(P_0, R_0, omega_d=np.full(3, 1e200))
    with pytest.raises(SingularityError, match="the rotation of the desired frame is not finite"):
        SetPoint(frame, lasting=0.5).sample(0.1)
    with pytest.raises(SingularityError, match="the rotation of the desired frame is not finite"):
        Trajectory([0.0, 1.0], [DesiredFrame(P_0, R_0), frame]).sample(0.5)


# --- start and hold -----------------------------------------------------------------------
def test_a_start_is_kept_to_the_nanosecond_until_then_the_present_goes_on_and_a_hold_ends_it():
    start, trajectory = 1_700_000_000_123_456_789, trajectory_turning(1.0)
    desired, here = Shaper(DesiredFrame(P_0, R_0)), DesiredFrame(P_0, R_0)
    desired.follow(trajectory, start)
    assert_same_frame(desired.sample(start - S_IN_NS), here, 0)
    for t in (1, 1000, 500_000_001, 1_999_999_999):
        assert_same_frame(desired.sample(start + t), trajectory.sample(t / 1e9), 0)
    desired.follow(SetPoint(here, 0.1), start + 3 * S_IN_NS)
    assert_same_frame(desired.sample(start + 2 * S_IN_NS), trajectory.sample(2.0), 0)
    assert_same_frame(desired.sample(start + 3 * S_IN_NS), here, 0)
    desired.follow(trajectory, start + 4 * S_IN_NS)
    last = desired.sample(start + 5 * S_IN_NS)
    desired.hold(last)
    for t in (5 * S_IN_NS, 9 * S_IN_NS):
        assert_same_frame(desired.sample(start + t), last.at_rest(), 0)


# --- rows of numbers ----------------------------------------------------------------------
AXIS = np.array([2.0, -1.0, 2.0]) / 3
ANGLE = 1.9
R = samples.rodrigues(ANGLE, AXIS)
XYZW = [*(math.sin(ANGLE / 2) * AXIS), math.cos(ANGLE / 2)]


def pose(orientation, orientation_format, position=(0.1, 0.2, 0.3)):
    """Return position and orientation of a single way-point."""
    frame = parse_way_points([0.0], position, orientation, orientation_format).sample(0.0)
    return frame.p_d, frame.R_d


def test_a_quaternion_is_x_y_z_w_a_rotation_vector_theta_r_and_angles_are_of_the_sequence():
    for sign in (1, -1):
        p, R_d = pose(sign * np.array(XYZW), "quaternion_xyzw")
        np.testing.assert_array_equal(p, [0.1, 0.2, 0.3])
        tol.assert_close(R_d, R, tol.ALGEBRAIC)
    tol.assert_close(pose(ANGLE * AXIS, "rotation_vector")[1], R, tol.ALGEBRAIC)
    unless_told = parse_way_points([0.0], [0, 0, 0], XYZW)
    tol.assert_close(unless_told.sample(0.0).R_d, R, tol.ALGEBRAIC)
    for sequence in SEQUENCES:
        expected = samples.by_angles(sequence, 0.3, -1.2, 2.5)
        tol.assert_close(pose([0.3, -1.2, 2.5], sequence)[1], expected, tol.ALGEBRAIC)


def test_rows_follow_each_other_and_the_motion_rests_at_each():
    trajectory = parse_way_points(
        [0.0, 1.0, 3.0], [1, 2, 3, 4, 5, 6, 7, 8, 9], [0, 0, 0, 0, 0, 0.5, 0.7, 0, 0], "XYZ"
    )
    expected = (np.eye(3), samples.about(2, 0.5), samples.about(0, 0.7))
    assert trajectory.times == [0.0, 1.0, 3.0]
    for i, (t, R_d) in enumerate(zip(trajectory.times, expected, strict=True)):
        frame = trajectory.sample(t)
        np.testing.assert_allclose(frame.p_d, np.arange(3) + 3 * i + 1, atol=tol.THROUGH_POINTS)
        tol.assert_close(frame.R_d, R_d, tol.THROUGH_POINTS)
        for rate in frame[2:]:
            tol.assert_close(rate, 0, tol.THROUGH_POINTS)


# --- refusals -----------------------------------------------------------------------------
def test_an_unknown_format_is_refused_with_those_that_exist():
    with pytest.raises(UnknownNameError, match="did you mean 'quaternion_xyzw'") as refusal:
        parse_way_points([0.0], [0, 0, 0], [0, 0, 0], "quaternion_wxyz")
    assert all(known in str(refusal.value) for known in FORMATS)
    assert set(FORMATS) == {"quaternion_xyzw", "rotation_vector", *SEQUENCES}


def at_times(*times):
    return Trajectory(times, [DesiredFrame(P_0, R_0)] * 2)


def circle_with(name, value):
    return CIRCLE._replace(**{name: value}).trajectory(P_0, R_0)


ONE, NONE = ([0.0], [0.0, 0.0, 0.0]), [0.0, 0.0, 0.0]  # a time with a position; no turn


@pytest.mark.parametrize(
    ("make", "given", "words"),
    [
        (Trajectory, ([], []), "0 times and 0 frames"),
        (at_times, (0.0,), "1 times and 2 frames"),
        *((at_times, t, "must increase") for t in ((0.0, 0.0), (1.0, 0.5), (0.0, math.nan))),
        *(
            (circle_with, change, "expected positive period and turns")
            for change in (("period", 0.0), ("turns", 0.0), ("ramp", -0.1), ("ramp", 4.1))
        ),
        (circle_with, ("period", math.nan), "expected positive period and turns"),
        (circle_with, ("normal", np.zeros(3)), "normal is zero"),
        *(
            (parse_way_points, rows, words)
            for rows, words in (
                ((*ONE, [0, 0, 0, 1.01], "quaternion_xyzw"), "has norm 1.01; expected 1"),
                (([], [], [], "XYZ"), "0 times, 0 numbers .*, 0 in .*; expected N, 3 N and 3 N"),
                ((*ONE, NONE, "quaternion_xyzw"), "3 in orientations; expected N, 3 N and 4 N"),
                (([0.0, 1.0], NONE, NONE, "rotation_vector"), "2 times, 3 numbers .*, 3 in orie"),
            )
        ),
        *(
            (parse_way_points, rows, "expected finite numbers")
            for rows in (
                ([math.nan], NONE, NONE, "rotation_vector"),
                ([0.0], [math.inf, 0.0, 0.0], NONE, "XYZ"),
                (*ONE, [math.nan, 0.0, 0.0, 1.0], "quaternion_xyzw"),
            )
        ),
    ],
)
def test_what_is_no_motion_is_refused_with_its_numbers(make, given, words):
    with pytest.raises(ConfigurationError, match=words):
        make(*given)
