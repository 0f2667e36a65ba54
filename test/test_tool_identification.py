"""A tool and the bias of its sensor from poses at rest: the least squares, free of ROS."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from ros_processes import HOME, ROOT, Array, pose
from samples import about, generator, rodrigues, uniform, unit_vectors, vectors
from tolerances import ALGEBRAIC, assert_close

from eulerparams_control.errors import IdentificationError
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.motion.way_points import parse_way_points
from eulerparams_control.tool.identification import (
    GRAVITY,
    LEAST_SPREAD,
    Identification,
    identify,
    spread,
)

# Of a sample of the sensor, N and Nm, and how many samples are averaged: 1 s at 1 kHz.
NOISE = np.repeat([0.1, 0.005], 3)
SAMPLES = 1000

# What has to be found to how much.
MASS, COM, BIAS = 0.01, 0.002, 0.01

# Identifications of which z-scores are taken.  The mean of z^2 of so many, Student's t with 12
# degrees of freedom or more, has a standard deviation of 0.045, that of z one of 0.025.
RUNS = 2000
Z_SQUARED, Z = 4 * 0.045, 4 * 0.025


class Truth(NamedTuple):
    """A tool and a bias."""

    mass: float
    com: Array
    bias: Array

    def wrenches(self, orientations: list[Array], gravity: Array) -> Array:
        """Return what the sensor measures (N, 6), from weight and lever in root axes."""
        measured = []
        for R in orientations:
            weight, lever = self.mass * gravity, R @ self.com
            measured.append(np.concatenate((R.T @ weight, R.T @ np.cross(lever, weight))))
        return np.array(measured) + self.bias


def some(key: int) -> Truth:
    """Return a realistic tool, 0.3 to 5 kg, with a bias of 5 N and 0.3 Nm."""
    random = generator(50, key)
    force, torque = unit_vectors(2, key=1000 + key)
    mass = math.exp(random.uniform(math.log(0.3), math.log(5.0)))
    return Truth(mass, random.uniform(-0.1, 0.1, 3), np.concatenate((5 * force, 0.3 * torque)))


def shipped_motion() -> list[Array]:
    """Return the orientations (3, 3) of the tip at home and at the shipped way-points."""
    text = (ROOT / "config" / "identify_tool_motion.yaml").read_text()
    p = yaml.safe_load(text)["/**"]["ros__parameters"]
    names = ("times", "positions", "orientations", "orientation_format")
    motion = parse_way_points(*(p[name] for name in names))
    return [pose(HOME)[1], *(frame.R_d for frame in motion.frames[::2])]


MOTION = shipped_motion()


def measured(truth: Truth, key: int, orientations: list[Array] = MOTION[:6]) -> Identification:
    """Return what is identified from noisy averages."""
    noise = generator(51, key).normal(size=(len(orientations), 6)) * NOISE / math.sqrt(SAMPLES)
    return identify(orientations, truth.wrenches(orientations, np.array(GRAVITY)) + noise)


# --- what is found ---------------------------------------------------------------------------


@pytest.mark.parametrize("key", range(20))
@pytest.mark.parametrize("count", [3, 4, 6, 20])
def test_without_noise_the_tool_and_the_bias_are_found_exactly(key, count):
    truth, gravity = some(key), 9.81 * unit_vectors(1, key=2000 + key)[0]
    orientations = uniform(count, key=50)
    found = identify(orientations, truth.wrenches(orientations, gravity), gravity)
    assert found.mass == pytest.approx(truth.mass, rel=ALGEBRAIC)
    assert_close(found.com, truth.com)
    assert_close(found.bias, truth.bias, 10 * ALGEBRAIC)
    assert found.residual_force.shape == found.residual_torque.shape == (count,)
    assert max(found.residual_force.max(), found.residual_torque.max()) < 10 * ALGEBRAIC


def test_with_the_noise_of_a_sensor_it_is_found_within_the_bars():
    for key in range(1000):
        truth = some(key)
        found = measured(truth, key)
        assert found.mass == pytest.approx(truth.mass, rel=MASS)
        assert np.linalg.norm(found.com - truth.com) < COM
        for part in (slice(3), slice(3, 6)):
            error = np.linalg.norm(found.bias[part] - truth.bias[part])
            assert error < BIAS * np.linalg.norm(truth.bias[part])


@pytest.mark.parametrize("count", [6, 7])
def test_the_standard_deviations_are_those_of_the_errors(count):
    """Each error over its standard deviation has Student's t of the degrees of freedom left."""
    truth = some(0)
    z = []
    for key in range(RUNS):
        found = measured(truth, key, MOTION[:count])
        errors = (found.mass - truth.mass, *(found.com - truth.com), *(found.bias - truth.bias))
        z.append(np.array(errors) / (found.mass_std, *found.com_std, *found.bias_std))
    force, torque = 3 * count - 4, 3 * count - 6
    freedom = np.array([force, *[torque] * 3, *[force] * 3, *[torque] * 3])
    assert_close(np.mean(z, axis=0), 0, Z)
    assert_close(np.mean(np.square(z), axis=0), freedom / (freedom - 2), Z_SQUARED)


def test_the_mass_has_its_share_in_the_standard_deviation_of_the_centre_of_mass():
    """Far from the sensor, where the error of the mass counts most."""
    truth = Truth(0.5, np.array([0.0, 0.0, 5.0]), np.zeros(6))
    z = []
    for key in range(RUNS):
        found = measured(truth, key)
        z.append((found.com[2] - truth.com[2]) / found.com_std[2])
    assert np.mean(np.square(z)) == pytest.approx(14 / 12, abs=Z_SQUARED)


def test_what_does_not_fit_is_left_over_in_its_pose():
    truth = some(1)
    wrenches = truth.wrenches(MOTION, np.array(GRAVITY))
    wrenches[3] += [4.0, 0.0, 0.0, 0.0, 0.0, 0.5]
    found = identify(MOTION, wrenches)
    assert np.argmax(found.residual_force) == np.argmax(found.residual_torque) == 3
    assert 2.0 < found.residual_force[3] < 4.0
    assert 0.2 < found.residual_torque[3] < 0.5
    assert found.mass_std > 100 * measured(truth, 0, MOTION).mass_std


# --- what is refused -------------------------------------------------------------------------


def turned(axis: Array, *degrees: float) -> list[Array]:
    """Return orientations that are turned about an axis (3,) of the base."""
    return [rodrigues(math.radians(angle), axis) @ MOTION[0] for angle in degrees]


@pytest.mark.parametrize(
    ("orientations", "angle"),
    [
        (turned(np.array([0.0, 0.0, 1.0]), 0, 40, 80, 120, 160), "0.0"),  # about the vertical
        (turned(np.array([0.0, 1.0, 0.0]), 0, 90, 0, 90, 0, 90), "0.0"),  # two directions
        (turned(np.array([0.0, 1.0, 0.0]), 0, 20, 40), "4.0"),  # almost on a line
        ([about(i % 3, math.radians(2 * i)) for i in range(5)], "5.5"),  # all similar
    ],
)
def test_too_similar_poses_are_refused_with_those_that_help(orientations, angle):
    wrenches = some(0).wrenches(orientations, np.array(GRAVITY))
    with pytest.raises(IdentificationError) as refusal:
        identify(orientations, wrenches)
    assert f"the {len(orientations)} poses are too similar" in str(refusal.value)
    assert f"that are {angle} deg apart; expected 10 deg at least" in str(refusal.value)
    assert "Tilt the sensor by 20 deg or more about two of its axes" in str(refusal.value)
    assert "turns about the vertical tell nothing" in str(refusal.value)


@pytest.mark.parametrize("key", range(10))
def test_a_negative_mass_is_refused_as_a_wrong_sign(key):
    wrenches = -some(key).wrenches(MOTION, np.array(GRAVITY))
    with pytest.raises(IdentificationError, match=r"negative, -.*; set wrench_sign: -1"):
        identify(MOTION, wrenches)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_no_mass_is_refused_as_no_tool(noise):
    wrenches = some(0)._replace(mass=0.0).wrenches(MOTION, np.array(GRAVITY))
    wrenches += noise * generator(52).normal(size=wrenches.shape)
    with pytest.raises(IdentificationError, match="which is no tool"):
        identify(MOTION, wrenches)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda R, h, g: (R, h[:-1], g), r"expected \(7, 3, 3\), \(7, 6\), \(3,\)"),
        (lambda R, h, g: (R, h[:, :5], g), r"have the shapes .*\(7, 5\)"),
        (lambda R, h, g: (R, h, g[:2]), r"have the shapes .*\(2,\)"),
        (lambda R, h, g: (R, h, 0 * g), "gravity not zero"),
        (lambda R, h, g: (R, h * math.nan, g), "must be finite numbers"),
        (lambda R, h, g: (np.array(R) + math.inf, h, g), "must be finite numbers"),
        (lambda R, h, g: (R[:0], h[:0], g), "too few poses, 0; expected at least 3 "),
        (lambda R, h, g: (R[:1], h[:1], g), "too few poses, 1; .* differ by 20 deg or more"),
        (lambda R, h, g: (R[:2], list(h[:2]), g), "too few poses, 2; expected at least 3 "),
    ],
)
def test_what_is_no_measurement_is_refused(change, words):
    gravity = np.array(GRAVITY)
    with pytest.raises(IdentificationError, match=words):
        identify(*change(MOTION, some(0).wrenches(MOTION, gravity), gravity))


# --- how different poses are -----------------------------------------------------------------


@pytest.mark.parametrize("degrees", [1.0, 10.0, 45.0, 90.0, 119.0])
@pytest.mark.parametrize("R", uniform(3, key=51))
def test_three_directions_an_angle_apart_have_this_spread(degrees, R):
    angle = math.radians(degrees)
    half = math.asin(2 / math.sqrt(3) * math.sin(angle / 2))  # of the cone that they are on
    cone = [about(2, turn) @ about(1, half) @ [0, 0, 1] for turn in np.radians([0, 120, 240])]
    assert spread(np.array(cone) @ R) == pytest.approx(angle, abs=1e-7)
    assert spread(3.0 * np.array([*cone, cone[0], cone[2]]) @ R) == pytest.approx(angle, abs=1e-7)


def test_the_spread_is_zero_of_two_directions_and_large_of_many():
    a, b = unit_vectors(2, key=50)
    assert spread([]) == spread([a, b]) == 0.0
    assert spread([a, b, a, a, b]) < 1e-7
    assert math.radians(60) < spread(vectors(100, key=50)) < math.radians(120)


def test_the_shipped_motion_has_six_orientations_that_differ_and_more():
    down = np.array([R.T @ [0, 0, -1] for R in MOTION])
    assert len(MOTION) == 7
    angles = np.degrees(np.arccos(np.clip(down @ down.T, -1, 1))) + 180 * np.eye(7)
    assert angles.min() > 40.0
    assert spread(down[:6]) > 5 * LEAST_SPREAD
    turns = [angle_between(a, b) for a, b in pairwise(MOTION)]
    assert max(turns) < math.radians(170)  # between way-points the shorter way is taken
