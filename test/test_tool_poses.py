"""When a pose is taken: an arm that is moved from one to the next, and its sensor."""

import math

import numpy as np
import pytest
from ros_processes import HOME, Array, pose
from samples import generator
from tolerances import assert_close

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.tool.poses import Pose, PoseCollector, PoseOptions

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


def test_in_each_new_orientation_one_pose_is_taken(bench):
    for number, q in enumerate([HOME, TILTED, HOME - [0, 0, 0, 0.9, 0, 0]], 1):
        bench.rest(q, 1.5)
        assert len(bench.poses) == number
        assert_close(bench.poses[-1].R_s, pose(q)[1])
    down = np.array([0.0, 0.0, -1.0])
    directions = [p.R_s.T @ down for p in bench.poses]
    assert_close(bench.collector.directions, directions)
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


def test_a_wrench_from_before_the_standstill_is_refused(bench):
    came_to_rest = bench.t + 10 * MS
    bench.rest(HOME, 0.15, wrench=None)
    bench.collector.feel(came_to_rest, WRENCH)
    with pytest.raises(InvalidMessageError, match=r"0.101 s behind joint_states, before the arm"):
        bench.collector.feel(came_to_rest - MS, WRENCH)


def test_a_wrench_that_comes_again_is_refused_and_one_without_stamp_is_taken(bench):
    bench.rest(HOME, 0.15, wrench=None)
    bench.collector.feel(bench.t, WRENCH)
    with pytest.raises(InvalidMessageError, match="again under the same stamp; it is stale"):
        bench.collector.feel(bench.t, WRENCH)
    for _ in range(19):
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


def test_it_says_what_it_waits_for(bench):
    assert bench.collector.doing == "waiting until the arm stands still"
    bench.rest(HOME, 0.2)
    assert bench.collector.doing == "averaging, keep the arm still"
    bench.rest(HOME, 0.2)
    assert bench.collector.doing == "waiting for another orientation"
    bench.tick(TILTED)
    assert bench.collector.doing == "waiting until the arm stands still"
