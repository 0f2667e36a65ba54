"""Trajectories of poses alone, and without times: as messages, through the controller."""

import math

import numpy as np
import pytest
from arms import HOME, UR5, clik
from arms import pose_of as tip_pose
from geometry_msgs.msg import Twist
from samples import about, generator
from test_shaper import LIMITS, Motion, assert_at, assert_rests, assert_within
from tolerances import assert_close

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import angle_between, exp, log
from eulerparams_control.messages.from_ros import motion_from_ros
from eulerparams_control.messages.to_ros import (
    duration_to_ros,
    motion_to_ros,
    stamp_to_ros,
    vector_to_ros,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.spline import Poses
from eulerparams_control.motion.trajectories import Trajectory

RATE = 500
X, Y, Z = np.eye(3)
START = tip_pose(UR5, HOME)
# A path passes its points within this [m, rad].
NEAR = 1e-4, math.radians(0.02)


def posed(p=(0.0, 0.0, 0.0), x=(0.0, 0.0, 0.0)):
    """Return a pose: that of the start moved by p (3,) [m] and turned by x (3,) [rad]."""
    return DesiredFrame(START.p_d + p, exp(np.array(x)) @ START.R_d)


def message(poses, times=None, *, stamp=0.0, signs=None, twists=None):
    """Return poses as planners and policies send them: without velocities, unless told."""
    msg = motion_to_ros(Trajectory(range(len(poses)), poses), UR5.base_frame, UR5.tip_frame)
    msg.header.stamp = stamp_to_ros(round(stamp * 1e9))
    for k, point in enumerate(msg.points):
        point.time_from_start = duration_to_ros(0.0 if times is None else times[k])
        turn = point.transforms[0].rotation
        if signs is not None and signs[k] < 0:
            turn.x, turn.y, turn.z, turn.w = -turn.x, -turn.y, -turn.z, -turn.w
        point.velocities, point.accelerations = [], []
        if twists is not None and twists[k] is not None:
            point.velocities = [Twist(linear=vector_to_ros(np.array(twists[k])))]
    return msg


class Arm:
    """A controller on an arm that goes where it is told."""

    def __init__(self, limits=LIMITS, rate=RATE, **options):
        self.controller = Controller(clik(), ControllerOptions(motion=limits, **options), HOME)
        self.q, self.dq, self.k, self.rate = HOME, np.zeros(UR5.n), 0, rate
        self.desired = []

    @property
    def t(self):
        """Time [s] of the next state; it begins at 1 s."""
        return 1.0 + self.k / self.rate

    def send(self, msg):
        """Send a message."""
        motion, start = motion_from_ros(msg, UR5.base_frame, UR5.tip_frame, 0.1)
        self.controller.follow(motion, start)

    def run(self, seconds, events=()):
        """Step; events are pairs of a time [s] and a message."""
        left = sorted(events, key=lambda event: event[0])
        until = self.t + seconds
        while self.t < until - 1e-9:
            while left and left[0][0] <= self.t + 1e-9:
                self.send(left.pop(0)[1])
            command = self.controller.step(round(self.t * 1e9), self.q, self.dq)
            self.q, self.dq = command.q, command.dq
            frame = self.controller.guidance.tick_now.desired
            self.desired.append(frame)
            self.k += 1
        return self

    @property
    def motion(self):
        """The desired motion so far."""
        columns = zip(*self.desired, strict=True)
        return Motion(*(np.array(column) for column in columns), self.controller.guidance.motion)


def assert_passes(motion, poses):
    """Assert that a motion passes poses in their order; between samples it goes straight on."""
    k = 0
    for number, pose in enumerate(poses):
        while not is_passed(motion, k, pose):
            k += 1
            assert k < len(motion.p), f"pose {number} is not passed"


def is_passed(motion, k, pose):
    """Return whether the motion is at a pose within half a step of its sample k."""
    e_p, v, w = pose.p_d - motion.p[k], motion.v[k], motion.w[k]
    if e_p @ e_p > (np.linalg.norm(v) / RATE + NEAR[0]) ** 2:
        return False
    e_o = log(pose.R_d @ motion.R[k].T)
    dt = (v @ e_p + w @ e_o) / max(v @ v + w @ w, 1e-12)
    dt = min(max(dt, -0.6 / RATE), 0.6 / RATE)
    return np.linalg.norm(e_p - dt * v) < NEAR[0] and np.linalg.norm(e_o - dt * w) < NEAR[1]


def line(count, step, turn=0.0):
    """Return poses on a line along y, ``step`` [m] and ``turn`` [rad] apart."""
    return [posed(k * step * Y, k * turn * X) for k in range(count)]


# --- poses with times ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hz", "replaced", "way"), [(5, 0.2, "circle"), (10, 0.1, "circle"), (20, 0.5, "line")]
)
@pytest.mark.parametrize("late", [0.0, 0.15])
def test_chunks_of_a_policy_that_replace_each_other_pass_at_speed(hz, replaced, way, late):
    path = {
        "line": lambda t: posed(0.1 * t * Y, 0.2 * t * X),
        "circle": lambda t: posed(0.08 * np.array([math.cos(t / 0.8) - 1, math.sin(t / 0.8), 0])),
    }[way]
    events = []
    for begin in np.arange(0.0, 3.0, replaced):
        times = np.arange(round(1.6 * hz) + 1) / hz
        chunk = message([path(begin + t) for t in times], times, stamp=1.1 + begin)
        events.append((1.1 + begin + late, chunk))
    motion = Arm().run(5.5, events).motion
    assert_within(motion)
    going = slice(int(1.5 * RATE), int(2.9 * RATE))
    assert_close(np.linalg.norm(motion.v[going], axis=1), 0.1, 0.005)
    assert motion.shaper.leap is None
    t = np.arange(going.start, going.stop) / RATE - 0.1
    away = [np.linalg.norm(p - path(s).p_d) for p, s in zip(motion.p[going], t, strict=True)]
    assert max(away) < 0.001  # on time
    assert_rests(motion)  # the last one has no successor


@pytest.mark.parametrize("times", [[1.0, 2.0, 3.0, 4.0], [0.0, 2.0, 2.5, 4.0]])
def test_poses_within_the_limits_are_passed_at_their_times_and_rest_is_at_the_ends_only(times):
    poses = [
        posed(*p) for p in ((), (0.04 * Y, 0.2 * X), (0.06 * Y + 0.01 * Z, 0.3 * X), (0.1 * Y,))
    ]
    arm = Arm()
    arm.send(message(poses, times))
    motion = arm.run(4.5).motion
    assert_within(motion)
    for t, pose in zip(times, poses, strict=True):
        k = round(t * RATE)
        assert np.linalg.norm(motion.p[k] - pose.p_d) < NEAR[0]
        assert angle_between(motion.R[k], pose.R_d) < NEAR[1]
    for t in times[1:-1]:
        assert np.linalg.norm(motion.v[round(t * RATE)]) > 0.01
    assert_at(motion, poses[-1])
    assert motion.shaper.slowed == 1.0


def test_points_whose_velocities_are_0_rest_there():
    """So does the node ``reference`` say where a way-point rests."""
    poses = line(4, 0.02)
    arm = Arm()
    arm.send(message(poses, [0.0, 1.0, 2.0, 3.0], twists=[None, np.zeros(3), 0.02 * Y, None]))
    motion = arm.run(3.5).motion
    assert_within(motion)
    assert not motion.v[RATE].any()
    assert_close(motion.v[2 * RATE], 0.02 * Y)
    assert_passes(motion, poses)


# --- poses without times ------------------------------------------------------------------
CORNER = [posed([0.01 * max(k - 25, 0), 0.01 * min(k, 25), 0.0]) for k in range(50)]
TURNING = [posed(0.004 * k * Y, 0.05 * k * Z) for k in range(50)]
ONE_WAY = [posed(0.2 * Y * s) for s in (0.0, 0.02, 0.5, 0.53, 0.9, 1.0)]
AND_BACK = [*line(8, 0.02), *line(8, 0.02)[-2::-1]]


@pytest.mark.parametrize("duplicates", [False, True])
@pytest.mark.parametrize(
    ("poses", "most"),
    [(line(50, 0.01), 2.6), (CORNER, 3.5), (TURNING, 3.2), (ONE_WAY, 1.6), (AND_BACK, 2.6)],
    ids=["line", "corner", "turning", "uneven", "back"],
)
def test_poses_without_times_are_passed_as_fast_as_the_limits_allow(poses, most, duplicates):
    arm = Arm()
    arm.send(message([pose for pose in poses for _ in range(1 + duplicates)]))
    motion = arm.run(most).motion
    assert_within(motion)
    assert_passes(motion, poses)
    assert_at(motion, poses[-1])
    used = max(
        np.linalg.norm(rates, axis=1).max() / speed
        for rates, speed in zip((motion.v, motion.w), LIMITS.speeds, strict=True)
    )
    assert used > 0.97
    assert motion.shaper.slowed == pytest.approx(1.0) or poses is not ONE_WAY


def test_the_way_to_the_first_pose_without_a_time_belongs_to_the_path():
    arm = Arm().run(0.1)
    arm.send(message(line(9, 0.02)[1:]))  # 20 mm away
    motion = arm.run(0.6).motion
    assert_passes(motion, line(5, 0.02))
    assert motion.v[-1][1] > 0.2
    here = motion.p[-1] - START.p_d
    further = [posed(here + [0.0, y, 0.01]) for y in (0.04, 0.08, 0.12, 0.2, 0.3)]
    with pytest.raises(InvalidMessageError, match=r"begins 0\.\d+ m .* away"):
        arm.send(message(further[1:]))
    arm.send(message(further))
    motion = arm.run(2.5).motion
    assert_within(motion)
    assert_passes(motion, further[2:])  # once it is met
    assert_at(motion, further[-1])


# --- what is refused, or comes late -------------------------------------------------------
@pytest.mark.parametrize(
    ("times", "twists", "limits", "words"),
    [
        ([0.0, 0.0, 1.0, 2.0], None, LIMITS, r"that of point 1 .* is 0 s after 0 s"),
        ([0.0, 1.0, 0.5, 2.0], None, LIMITS, r"that of point 2 .* is 0\.5 s after 1 s"),
        ([0.0, 1.0, 2.0, 0.0], None, LIMITS, r"that of point 3 .* is 0 s after 2 s"),
        ([0.0, 1.0, 1.0 + 1e-9, 2.0], None, LIMITS, r"point 2 .* comes 1e-09 s after the one bef"),
        (None, [None, None, Y, None], LIMITS, r"point 2 .* has a velocity, and no point has a"),
        (None, None, None, "give each point a time_from_start"),
    ],
)
def test_impossible_times_are_refused_with_the_first_wrong_point(times, twists, limits, words):
    with pytest.raises(InvalidMessageError, match=words):
        Arm(limits=limits).send(message(line(4, 0.01), times, twists=twists))


def test_a_chunk_that_is_too_late_is_refused_and_one_that_comes_again_changes_nothing():
    poses, times = line(21, 0.01), np.arange(21) * 0.1
    arm = Arm().run(0.1)
    with pytest.raises(InvalidMessageError, match="away"):
        arm.send(message(poses, times, stamp=0.3))
    arm.run(0.1, [(1.1, message(poses, times, stamp=1.1))])
    again = [(1.1 + t, message(poses, times, stamp=1.1)) for t in (0.5, 1.0, 1.05, 5.0)]
    motion = arm.run(6.0, again).motion
    assert_within(motion)
    assert_passes(motion, [poses[0], *poses[10:]])
    assert_at(motion, poses[-1])


# --- the spline ---------------------------------------------------------------------------
def spline(times, poses):
    """Return the spline through poses, at rest at its ends."""
    return Poses(times, poses, [False] * len(poses)).from_frame(poses[0])


@pytest.mark.parametrize("step", [0.1, 1.0, 2.5])
def test_a_spline_passes_its_poses_and_is_continuous_to_acceleration(step):
    rng = generator(70)
    axes = [x / np.linalg.norm(x) for x in rng.normal(size=(12, 3))]
    poses = [DesiredFrame(START.p_d, START.R_d)]
    for axis in axes:
        before = poses[-1]
        poses.append(
            DesiredFrame(before.p_d + 0.1 * rng.normal(size=3), before.R_d @ exp(step * axis))
        )
    times = np.cumsum(rng.uniform(0.3, 1.0, 13))
    times -= times[0]
    motion = spline(times.tolist(), poses)
    for t, pose in zip(times, poses, strict=True):
        here, before = motion.sample(t), motion.sample(max(t - 1e-9, 0.0))
        assert np.linalg.norm(here.p_d - pose.p_d) < 1e-12
        assert angle_between(here.R_d, pose.R_d) < 1e-7
        for rate, was in zip(here[2:], before[2:], strict=True):
            np.testing.assert_allclose(rate, was, atol=1e-5)
    for end in (motion.sample(0.0), motion.sample(times[-1])):
        assert not np.concatenate(end[2:]).any()


def test_a_half_turn_past_tool_down_is_even_whatever_the_signs_of_the_quaternions():
    axis = np.array([0.6, -0.64, 0.48])
    down = about(0, math.pi)
    poses = [
        DesiredFrame(START.p_d, down @ exp((k / 20 - 0.5) * math.pi * axis)) for k in range(21)
    ]
    signs = generator(71).choice([-1, 1], 21)
    times = 0.2 * np.arange(21)
    told = [
        motion_from_ros(message(poses, times, signs=s), UR5.base_frame, UR5.tip_frame, 0.1)[0]
        for s in (None, signs)
    ]
    motions = [motion.from_frame(poses[0]) for motion in told]
    for t in np.linspace(0.0, 4.0, 200):
        a, b = (motion.sample(t) for motion in motions)
        np.testing.assert_allclose(a.omega_d, b.omega_d, atol=1e-9)
        if 1.0 < t < 3.0:
            assert np.linalg.norm(a.omega_d) == pytest.approx(math.pi / 4.0, rel=0.01)


def test_between_poses_of_uneven_times_a_spline_goes_beyond_them_by_less_than_half_of_the_way():
    rng = generator(72)
    for _ in range(30):
        times = np.append(0.0, np.cumsum(rng.choice([0.02, 0.1, 1.0, 3.0], 12))).tolist()
        ways = np.append(0.0, np.cumsum(rng.choice([0.0, 0.001, 0.01, 0.1], 12)))
        motion = spline(times, [posed(way * Y, way * Z) for way in ways])
        for k in range(12):
            inside = motion.samples(np.linspace(times[k], times[k + 1], 50)[1:-1])
            beyond = (inside.p_d - START.p_d) @ Y
            way = ways[k + 1] - ways[k]  # 0: a dwell
            assert beyond.min() > ways[k] - way / 2 - 1e-9
            assert beyond.max() < ways[k + 1] + way / 2 + 1e-9
    back = spline([0.0, 1.0, 2.0, 3.0], [posed(y * Y) for y in (0.0, 0.05, 0.1, 0.05)])
    assert ((back.samples(np.linspace(0.0, 3.0, 500)).p_d - START.p_d) @ Y).max() < 0.105
