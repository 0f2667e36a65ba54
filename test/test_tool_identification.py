"""A tool and the bias of its sensor from poses at rest: the least squares, free of ROS."""

import math
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from ros_processes import HOME, ROOT, UR5, Array, pose
from samples import about, generator, rodrigues, uniform, unit_vectors
from tolerances import ALGEBRAIC, KINEMATICS, assert_close

from eulerparams_control.errors import (
    IdentificationError,
    InvalidMessageError,
    RobotError,
)
from eulerparams_control.motion.way_points import parse_way_points
from eulerparams_control.tool.identification import GRAVITY, Identification, identify, spread
from eulerparams_control.tool.mount import Carried, SensorMount
from eulerparams_control.tool.poses import Pose, PoseCollector, PoseOptions
from eulerparams_control.tool.report import ToolReport

# Of a sample of the sensor, N and Nm, and how many samples are averaged: 1 s at 1 kHz.
NOISE = np.repeat([0.1, 0.005], 3)
SAMPLES = 1000
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
BIASED = some(0).bias


def turned(axis: Array, *degrees: float) -> list[Array]:
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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda R, h, g: (R, -h, g), r"negative, -.*; set wrench_sign: -1"),
        (lambda R, h, g: (R, 0 * h + BIASED, g), "which is no tool"),
        (lambda R, h, g: (R, BIASED + 0.01 * generator(52).normal(size=h.shape), g), "is no tool"),
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
    assert spread([]) == spread(cone[:2]) == 0.0
    assert spread([*cone[:2], cone[0], cone[0], cone[1]]) < 1e-7


# --- when a pose is taken --------------------------------------------------------------------
MS = 1_000_000  # [ns]
OPTIONS = PoseOptions(settle_time=0.1, averaging_time=0.2, max_speed=0.02)
TILTED = HOME + [0, 0, 0, 0.9, 0, 0]
WRENCH = np.arange(6.0)
# Mean and standard deviation of 20 or so samples of order 1.
AVERAGE = 1e-12


class Bench:
    """Plays an arm with its sensor: a state and a wrench every 10 ms."""

    def __init__(self, options: PoseOptions = OPTIONS) -> None:
        gravity = np.array([0.0, 0.0, -9.81])
        self.collector = PoseCollector(options, lambda q: pose(q)[1], gravity)
        self.t = 1000 * MS
        self.q = HOME
        self.said: list[str] = []

    def tick(self, q: Array, dq: Array | None = None, wrench: Array | None = WRENCH) -> None:
        self.t += 10 * MS
        self.q = q
        event = self.collector.move(self.t, q, 0 * q if dq is None else dq)
        if isinstance(event, str) and event:
            self.said.append(event)
        if wrench is not None:
            self.collector.feel(self.t, wrench)

    def rest(self, q: Array, seconds: float = 0.35, wrench: Array | None = WRENCH) -> None:
        for _ in range(round(seconds * 100)):
            self.tick(q, wrench=wrench)

    @property
    def poses(self) -> list[Pose]:
        return self.collector.poses


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_pose_is_taken_after_settling_of_the_averages_since_then(bench):
    wrenches = generator(60).normal(size=(31, 6))
    for wrench in wrenches[:-1]:  # 0.1 s and 0.2 s from the first state on
        bench.tick(HOME, wrench=wrench)
    assert bench.poses == []
    bench.tick(HOME, wrench=wrenches[-1])
    (taken,), used = bench.poses, wrenches[10:30]
    assert_close(taken.R_s, pose(HOME)[1])
    assert_close(taken.wrench, used.mean(axis=0), AVERAGE)
    assert_close(taken.wrench_std, used.std(axis=0, ddof=1) / math.sqrt(20), AVERAGE)
    assert taken.samples == 20
    assert bench.said == []


@pytest.mark.parametrize("moving", ["position", "velocity", "slowly"])
def test_while_the_arm_moves_no_pose_is_taken(bench, moving):
    for k in range(100):
        step = {"position": 3e-3, "velocity": 0.0, "slowly": 2.2e-4}[moving]  # [rad] in 10 ms
        dq = np.full(6, 0.03) if moving == "velocity" else None
        bench.tick(HOME + [0, 0, 0, k * step, 0, 0], dq)
    assert bench.poses == []


def test_noise_of_the_positions_is_no_motion_and_their_mean_is_the_pose(bench):
    positions = HOME + generator(61).normal(scale=1e-4, size=(32, 6))  # 0.01 rad/s by differences
    for q in positions:
        bench.tick(q)
    assert len(bench.poses) == 1
    assert_close(bench.poses[0].R_s, pose(positions[11:31].mean(axis=0))[1], AVERAGE)


def test_if_the_arm_moves_meanwhile_the_pose_is_dropped_and_taken_anew(bench):
    bench.rest(HOME, 0.25, wrench=10 * WRENCH)
    bench.tick(TILTED, wrench=10 * WRENCH)
    assert bench.said == ["the arm moved too early, the pose was dropped: let it rest"]
    bench.rest(TILTED, 0.25)
    assert bench.poses == []
    bench.rest(TILTED, 0.1)
    assert len(bench.poses) == 1
    assert_close(bench.poses[0].wrench, WRENCH, AVERAGE)
    assert_close(bench.poses[0].R_s, pose(TILTED)[1])
    assert len(bench.said) == 1


def test_a_small_turn_or_one_about_the_vertical_is_no_new_pose_and_said_once(bench):
    bench.rest(TILTED)
    bench.rest(HOME)
    for offset, words in (([1, 0, 0, 0, 0, 0], "gravity 0 deg"), ([0, 0, 0, 0.3, 0, 0], "17 deg")):
        bench.said.clear()
        bench.rest(HOME + offset, 2.0)
        assert len(bench.poses) == 2
        assert len(bench.said) == 1
        assert words in bench.said[0]
        assert "from where it was in pose 2; expected 20 deg at least: tilt it" in bench.said[0]
        assert "turns about the vertical do not count" in bench.said[0]


def test_a_pose_needs_enough_wrenches_or_what_is_missing_is_said(bench):
    bench.rest(HOME, 1.0, wrench=None)
    assert bench.poses == []
    assert "0 wrenches within 0.2 s; expected 10 at least: does the sensor run?" in bench.said[0]
    bench.rest(HOME, 0.5)
    assert len(bench.poses) == 1


def test_a_wrench_of_before_or_that_comes_again_is_refused_and_one_without_stamp_taken(bench):
    came_to_rest = bench.t + 10 * MS
    bench.rest(HOME, 0.15, wrench=None)
    with pytest.raises(InvalidMessageError, match=r"0.101 s behind joint_states, before the arm"):
        bench.collector.feel(came_to_rest - MS, WRENCH)
    for stamp in (came_to_rest, bench.t):
        bench.collector.feel(stamp, WRENCH)
    with pytest.raises(InvalidMessageError, match="again under the same stamp; it is stale"):
        bench.collector.feel(bench.t, WRENCH)
    for _ in range(18):
        bench.collector.feel(0, WRENCH)
    bench.rest(HOME, 0.2, wrench=None)
    assert bench.poses[0].samples == 20


@pytest.mark.parametrize("jump", [-100.0, 0.6])
def test_after_a_jump_of_the_stamps_the_standstill_begins_anew(bench, jump):
    bench.rest(HOME, 0.25)
    bench.t += round(jump * 1e9)
    bench.rest(HOME, 0.3)
    assert bench.poses == []
    bench.tick(HOME)
    assert len(bench.poses) == 1


# --- the report ------------------------------------------------------------------------------
LINK = '<link name="{}"/>'
HEAVY = """<link name="{}"><inertial><origin xyz="{}"/><mass value="{}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>
<origin xyz="{}" rpy="{}"/><axis xyz="{}"/><limit velocity="1" effort="1" lower="-2" upper="2"/>
</joint>"""

# An arm of two joints; at its flange a sensor, turned and displaced, with a gripper of 0.5 kg,
# whose finger of 0.1 kg slides, and beyond it the tip.
GRIPPER = f"""<robot name="arm">{"".join(map(LINK.format, ("base", "sensor", "tip")))}
{HEAVY.format("upper", "0 0 0", 2)}{HEAVY.format("flange", "0 0 0", 1)}
{HEAVY.format("gripper", "0 0 0.1", 0.5)}{HEAVY.format("finger", "0 0.02 0", 0.1)}
{JOINT.format("shoulder", "revolute", "base", "upper", "0 0 1", "0 0 0", "0 0 1")}
{JOINT.format("elbow", "revolute", "upper", "flange", "1 0 0", "0 0 0", "0 1 0")}
{JOINT.format("mount", "fixed", "flange", "sensor", "0.1 0 0", "0 0 1.5707963267948966", "1 0 0")}
{JOINT.format("grip", "fixed", "sensor", "gripper", "0 0 0.05", "3.141592653589793 0 0", "1 0 0")}
{JOINT.format("slide", "prismatic", "gripper", "finger", "0 0 -0.2", "0.3 0.5 -0.7", "0 1 0")}
{JOINT.format("end", "fixed", "gripper", "tip", "0 0 -0.3", "0.3 0.5 -0.7", "1 0 0")}
</robot>"""

RPY = about(2, -0.7) @ about(1, 0.5) @ about(0, 0.3)  # of the finger and the tip
GRIP = about(0, math.pi)
# 0.5 kg at z = 0.05 - 0.1, and the finger.
FINGER = np.array([0, 0, 0.05]) + GRIP @ ([0, 0, -0.2] + RPY @ [0, 0.02, 0])
KNOWN = Carried(0.6, (0.5 * np.array([0, 0, -0.05]) + 0.1 * FINGER) / 0.6)


def mount(frame: str = "sensor", tip: str = "tip") -> SensorMount:
    return SensorMount(GRIPPER, frame, tip)


# --- the sensor on the arm -------------------------------------------------------------------
def test_a_point_of_the_sensor_is_given_in_the_tip_frame_and_its_orientation_in_the_root_link():
    point, q = np.array([0.1, 0.2, 0.3]), np.array([0.3, -0.4])
    expected = RPY.T @ (GRIP.T @ (point - [0, 0, 0.05]) - [0, 0, -0.3])
    assert_close(mount().in_tip(point), expected, KINEMATICS)
    assert_close(mount(tip="sensor").in_tip(point), point, KINEMATICS)
    R = about(2, 0.3) @ about(1, -0.4) @ about(2, math.pi / 2)
    assert_close(mount().orientation(q), R, KINEMATICS)
    assert mount().joints == ("shoulder", "elbow")


@pytest.mark.parametrize(
    ("frames", "error", "words"),
    [
        (("senser", "tip"), RobotError, "did you mean 'sensor'.*known: base,"),
        (("sensor", "tipp"), RobotError, "did you mean 'tip'.*known: base,"),
        (("upper", "tip"), RobotError, "elbow moves between the sensor at 'upper' and the tip_fra"),
        (("finger", "tip"), RobotError, "slide moves between .* the tip_frame 'tip'; expected"),
    ],
)
def test_a_sensor_that_is_none_or_not_fixed_to_the_tip_is_refused(frames, error, words):
    with pytest.raises(error, match=words):
        mount(*frames)


# --- what the URDF says it carries -----------------------------------------------------------
def test_what_the_sensor_carries_is_what_the_urdf_has_beyond_it():
    assert mount().carried.mass == pytest.approx(KNOWN.mass)
    assert_close(mount().carried.com, KNOWN.com, KINEMATICS)
    assert mount("tip").carried == (0.0, pytest.approx(np.zeros(3)))
    assert mount("gripper").carried.mass == pytest.approx(0.6)  # on a fixed joint: a place
    assert mount("flange").carried.mass == pytest.approx(0.6)  # the last link is not carried


# --- the report ------------------------------------------------------------------------------
FOUND = Identification(
    1.5, np.array([0.01, -0.02, 0.06]), np.array([3.0, -2.0, 3.5, 0.2, -0.1, 1e-7]),
    0.0012, np.full(3, 1e-4), np.full(6, 1e-3), np.array([0.02, 0.3, 0.01]),
    np.array([0.002, 0.001, 0.03]), math.radians(40),
)  # fmt: skip


def report(
    found: Identification = FOUND, where: SensorMount | None = None, noise: float = 1e-3
) -> ToolReport:
    poses = [Pose(np.eye(3), np.zeros(6), np.full(6, noise), 1000)] * 3
    return ToolReport(found, poses, where or SensorMount(UR5.urdf, "tool0", "tool0"))


def parameters(text: str, section: str) -> dict[str, object]:
    return dict(yaml.safe_load(text)[section]["ros__parameters"])


def numbers(value: object) -> Array:
    assert isinstance(value, list)
    assert all(isinstance(number, float) for number in value)  # as ROS wants them
    return np.array(value)


def test_the_parameters_are_yaml_with_the_tool_at_the_tip_and_the_bias_of_the_sensor():
    text = report(where=mount("tip"))._replace(wrench_sign=-1).yaml()
    tool, bias = parameters(text, "/**"), parameters(text, "/**/impedance_control")
    assert tool["tool_mass"] == 1.5
    assert_close(numbers(tool["tool_com"]), FOUND.com, 1e-6)
    assert bias["wrench_sign"] == -1
    assert_close(numbers(bias["wrench_bias"]), FOUND.bias, 1e-6)
    assert tool.keys() | bias.keys() == {"tool_mass", "tool_com", "wrench_sign", "wrench_bias"}


def test_what_the_urdf_has_beyond_the_sensor_is_no_part_of_the_tool():
    added = Carried(0.4, generator(70).normal(size=3))
    mass = KNOWN.mass + added.mass
    com = (KNOWN.mass * KNOWN.com + added.mass * added.com) / mass
    full = report(FOUND._replace(mass=mass, com=com), mount())
    assert full.tool.mass == pytest.approx(added.mass)
    assert_close(full.tool.com, mount().in_tip(added.com))
    tool = parameters(full.yaml(), "/**")
    assert tool["tool_mass"] == pytest.approx(added.mass)
    assert_close(numbers(tool["tool_com"]), full.tool.com, 1e-6)
    sensed = parameters(full.yaml(), "/**/impedance_control")
    assert sensed["sensed_mass"] == pytest.approx(mass)
    assert_close(numbers(sensed["sensed_com"]), mount().in_tip(com), 1e-6)
    (warning,) = full.warnings()
    assert "the URDF has 0.6 kg beyond the sensor; tool_mass and tool_com are what" in warning


@pytest.mark.parametrize(("excess", "wrong"), [(0.002, False), (-0.002, False), (-0.1, True)])
def test_a_tool_that_the_urdf_has_already_is_none(excess, wrong):
    known = report(FOUND._replace(mass=KNOWN.mass + excess, com=KNOWN.com), mount())
    tool = parameters(known.yaml(), "/**")
    assert tool == {"tool_mass": 0.0, "tool_com": [0.0, 0.0, 0.0]}
    assert ("correct its inertials" in " ".join(known.warnings())) == wrong


@pytest.mark.parametrize(
    ("residual", "words"),
    [
        (
            {"residual_force": [0.1, 0.6, 0.2]},
            "pose 2 leaves 0.6 N of force unexplained, more than",
        ),
        ({"residual_torque": [0.01, 0.01, 0.06]}, "pose 3 leaves 0.06 Nm of torque unexplained"),
    ],
)
def test_a_pose_that_does_not_fit_is_warned_of(residual, words):
    found = FOUND._replace(**{name: np.array(values) for name, values in residual.items()})
    (warning,) = report(found).warnings()
    assert words in warning
    assert "does the tool touch something there, or does a cable pull?" in warning
    assert report(found, noise=0.1).warnings() == []  # so far averages are off by noise
    assert report().warnings() == []
