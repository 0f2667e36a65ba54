"""The shaper: whatever is asked for, what comes out is smooth and within the limits.

Each motion is sampled as a controller does, and its speed, acceleration and jerk are taken from the
frames; that the frames are consistent is checked by differences.
"""

import math
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import pytest
from ruckig import ControlInterface, Ruckig, RuckigError
from samples import about, generator
from tolerances import assert_close

from eulerparams_control.laws.rotations import angle_between, exp, log
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.references import Goal, Jog, SetPoint
from eulerparams_control.motion.shaper import Shaper
from eulerparams_control.motion.time_scale import TimeScale
from eulerparams_control.motion.trajectories import Trajectory, way_points

LIMITS = MotionLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0)
HERE = DesiredFrame(np.array([0.4, 0.1, 0.3]), about(0, math.pi))
X = np.array([1.0, 0.0, 0.0])
SPEED = 0.1
RATE = 500
# Of a limit: what the samples of a plan between which the norm bulges may exceed.
BULGE = 0.05


def moved(x=0.0, angle=0.0, axis=2, twist=0.0, held=HERE):
    """Return a frame x [m] along X and turned, moving at ``twist`` [m/s] along X."""
    R_d = held.R_d @ exp(angle * np.eye(3)[axis])
    return DesiredFrame(held.p_d + x * X, R_d, twist * X)


def turned(rng):
    """Return a random orientation, up to 170 deg from that of HERE."""
    axis = rng.normal(size=3)
    return HERE.R_d @ exp(rng.uniform(0.1, 2.96) * axis / np.linalg.norm(axis))


class Motion(NamedTuple):
    """Sampled frames, stacked, at RATE."""

    p: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    dw: np.ndarray
    shaper: Shaper


def follow(events, duration, limits=LIMITS, rate=RATE, held=HERE, scale=None):
    """Return the motion that a shaper makes of events: (time [s], what to do with it)."""
    shaper, frames = Shaper(held, limits), []
    left = sorted(events, key=lambda event: event[0])
    for k in range(round(duration * rate)):
        t = round(k * 1e9 / rate)
        while left and left[0][0] * 1e9 <= t:
            left.pop(0)[1](shaper)
        if scale is not None:
            scale.advance(1 / rate)
            shaper.wait(round((1 - scale.mean) / rate * 1e9))
        frame = shaper.sample(t)
        if scale is not None:
            frame = scale.paced(1 / rate, scale.wanted(k / rate), frame, shaper.after)
        frames.append(frame)
    return Motion(*(np.array(column) for column in zip(*frames, strict=True)), shaper)


def sent(reference, start=None):
    return lambda shaper: shaper.follow(reference, start)


def norm(rows):
    return np.linalg.norm(rows, axis=1).max(initial=0.0)


def assert_within(motion, limits=LIMITS, rate=RATE, jerk=True):
    """Assert that a motion keeps the limits, is smooth, and is what its derivatives say."""
    for rates, accelerations, speed, acceleration, most in zip(
        (motion.v, motion.w),
        (motion.a, motion.dw),
        limits.speeds,
        limits.accelerations,
        limits.jerks,
        strict=True,
    ):
        assert norm(rates) <= speed * (1 + BULGE)
        assert norm(accelerations) <= acceleration * (1 + BULGE)
        steps = np.diff(rates, axis=0) * rate
        assert norm(steps) <= acceleration * (1 + BULGE)
        if jerk:
            assert norm(np.diff(accelerations, axis=0)) * rate <= most * (1 + BULGE)
            assert norm(steps - (accelerations[1:] + accelerations[:-1]) / 2) <= 2 * most / rate
    way = np.diff(motion.p, axis=0) * rate - (motion.v[1:] + motion.v[:-1]) / 2
    assert norm(way) <= limits.linear_acceleration / rate
    turns = [log(b @ a.T) * rate for a, b in zip(motion.R[:-1], motion.R[1:], strict=True)]
    assert norm(np.array(turns) - (motion.w[1:] + motion.w[:-1]) / 2) <= 4.0 / rate


def assert_rests(motion):
    assert not motion.v[-1].any()
    assert not motion.w[-1].any()


def assert_at(motion, frame):
    assert_close(motion.p[-1], frame.p_d, 1e-9)
    assert angle_between(motion.R[-1], frame.R_d) <= 1e-7
    assert_rests(motion)


def assert_even(rates, nominal, begin=RATE + 100):
    """Assert that a motion goes on at one speed until the sample 3 * RATE."""
    speed = np.linalg.norm(rates[begin : 3 * RATE], axis=1) / nominal
    assert 0.8 < speed.min() <= speed.max() < 1.2


def through(times, *frames):
    """Return the motion that rests at frames."""
    return way_points(times, [(frame.p_d, frame.R_d) for frame in frames])


# --- trajectories -------------------------------------------------------------------------
def test_a_trajectory_within_the_limits_is_followed_to_the_bit():
    path = through([0.0, 2.0, 4.0], HERE, moved(0.2, 0.5), moved())
    motion = follow([(0.1, sent(path))], 4.5)
    for k in range(50, 2250, 7):
        expected = path.sample((round(k * 1e9 / RATE) - 100_000_000) / 1e9)
        assert all(np.array_equal(a, b) for a, b in zip(expected, shaped(motion, k), strict=True))
    assert motion.shaper.slowed == 1.0


def shaped(motion, k):
    return DesiredFrame(*(column[k] for column in motion[:6]))


@pytest.mark.parametrize(
    ("times", "frames"),
    [
        ([0.0, 0.4], [HERE, moved(0.2, 0.3)]),
        ([0.0, 0.01], [HERE, moved(0.04, 0.0)]),
        ([0.0, 3.0, 3.3, 7.0], [HERE, moved(0.2), moved(0.1, 0.5), moved(0.3, 0.5, 1)]),
        ([0.5], [moved(0.3, 2.0)]),
        ([1e-9], [moved(0.04)]),
        ([0.0, 10.0, 10.02], [HERE, moved(0.1), moved(0.105)]),
    ],
    ids=[
        *("fast", "a leap in 10 ms", "a fast corner", "one point", "one in no time"),
        "a leap of 20 ms after 10 s",
    ],
)
def test_a_trajectory_beyond_the_limits_is_slowed_along_its_own_path(times, frames):
    path = through(times, *frames)
    motion = follow([(0.1, sent(path))], times[-1] + 25.0)
    assert_within(motion)
    assert_at(motion, frames[-1])
    assert motion.shaper.slowed < 1
    times = path.from_frame(HERE).times
    dense = np.concatenate([np.linspace(a, b, 2000) for a, b in pairwise(times)])
    dense = path.from_frame(HERE).samples(dense).p_d
    off = [np.linalg.norm(dense - p, axis=1).min() for p in motion.p[::25]]
    assert max(off) < 2e-4


@pytest.mark.parametrize("twist", [0.1, 0.3, 1.0])
def test_a_trajectory_that_begins_or_ends_in_motion_is_joined_and_ended_smoothly(twist):
    frames = [moved(0.0, twist=0.1), moved(0.1, twist=twist)]
    motion = follow([(0.1, sent(Trajectory([0.0, 1.0], frames)))], 9.0)
    assert_within(motion)
    assert_at(motion, frames[-1].at_rest())


# --- goals --------------------------------------------------------------------------------
def shortest(L, theta, limits=LIMITS):
    """Return the least time from rest to rest over L [m] and theta [rad], both limited by jerk."""

    def time(d, v, a, j):
        if v * j < a * a:
            a = math.sqrt(v * j)
        if d >= v * (v / a + a / j):
            return d / v + v / a + a / j
        if d >= 2 * a**3 / j**2:
            return a / j + math.sqrt((a / j) ** 2 + 4 * d / a)
        return (32 * d / j) ** (1 / 3)

    rows = zip((L, theta), limits.speeds, limits.accelerations, limits.jerks, strict=True)
    return max(time(*row) for row in rows)


def test_a_goal_is_reached_in_the_shortest_time_that_the_limits_allow():
    rng = generator(1)
    for _ in range(25):
        goal = DesiredFrame(HERE.p_d + rng.uniform(-0.3, 0.3, 3), turned(rng))
        L = np.linalg.norm(goal.p_d - HERE.p_d)
        least = shortest(L, angle_between(goal.R_d, HERE.R_d))
        motion = follow([(0.0, sent(Goal(goal)))], least + 0.1)
        assert_within(motion)
        assert_at(motion, goal)
        k = int(0.99 * least * RATE)
        assert np.linalg.norm(motion.v[k]) + np.linalg.norm(motion.w[k]) > 0  # not before
        line = np.cross(motion.p - HERE.p_d, (goal.p_d - HERE.p_d) / L)
        assert norm(line) < 1e-9


# --- streams ------------------------------------------------------------------------------
def stream(rate, *, twists=False, jitter=0.0, noise=0.0, ahead=0.0, kind=SetPoint):
    """Return the events of a stream along X, which begins at 0.1 s and lasts for 3 s."""
    rng, events = generator(rate), []
    for k in range(3 * rate):
        t = k / rate
        frame = moved(SPEED * t, twist=SPEED if twists else 0.0)
        frame = frame._replace(p_d=frame.p_d + noise * rng.normal(size=3))
        point = Goal(frame) if kind is Goal else SetPoint(frame, 0.1)
        at = 0.1 + t + jitter / rate * rng.uniform(-1, 1)
        events.append((at, sent(point, round((at + ahead) * 1e9) if ahead else None)))
    return events


@pytest.mark.parametrize(
    ("rate", "kind", "late", "twists"),
    [
        *product((10, 20, 50, 200), (SetPoint, Goal), [0.0], [False]),
        *product([50], [SetPoint], (0.05, 0.1, 0.3, 10.0), (False, True)),  # or a clock is behind
    ],
)
def test_a_stream_becomes_a_motion_of_even_speed_with_little_lag(rate, kind, late, twists):
    motion = follow(stream(rate, kind=kind, ahead=-late, twists=twists), 5.0)
    assert_within(motion)
    assert_even(motion.v, SPEED)
    if not late:
        assert_at(motion, moved(SPEED * (3.0 - 1 / rate)))
    led = SPEED * (min(late, 0.1) + 0.1) if twists else 0.0
    end = (motion.p[-1] - HERE.p_d) @ X - SPEED * (3.0 - 1 / rate)
    assert -1e-9 <= end <= led + 0.01
    if rate <= 50 and not late:
        t = np.arange(RATE + 100, 3 * RATE) / RATE - 0.1
        lag = np.median(t - (motion.p[RATE + 100 : 3 * RATE] - HERE.p_d) @ X / SPEED)
        assert lag <= 2 / rate


@pytest.mark.parametrize("twists", [False, True])
@pytest.mark.parametrize("rate", [5, 10, 20, 50, 200])
@pytest.mark.parametrize(("jitter", "noise"), [(0.2, 0.001), (0.5, 0.002)])
def test_a_stream_with_jitter_and_noise_keeps_the_limits_and_arrives(rate, twists, jitter, noise):
    motion = follow(stream(rate, twists=twists, jitter=jitter, noise=noise), 6.0)
    assert_within(motion)
    goes_on = SPEED * 0.6 if twists else 0.0  # at most, and the brakes
    end = (motion.p[-1] - HERE.p_d) @ X - SPEED * (3.0 - 1 / rate)
    assert -5 * noise - 1e-9 <= end <= goes_on + 5 * noise + 1e-9


def test_a_stream_of_every_tick_within_the_limits_passes_to_the_bit():
    path = through([0.0, 2.0], HERE, moved(0.2, 0.3))
    points = [path.sample(k / RATE) for k in range(2 * RATE)]
    events = [(k / RATE - 1e-4, sent(SetPoint(f, 0.1))) for k, f in enumerate(points)]
    motion = follow(events, 2.5)
    for k in range(1, 2 * RATE):
        assert all(np.array_equal(a, b) for a, b in zip(points[k], shaped(motion, k), strict=True))
    assert_within(motion)


@pytest.mark.parametrize("ahead", [0.002, 0.015, 0.03, 0.3])
def test_set_points_stamped_ahead_are_each_followed_at_their_time(ahead):
    motion = follow(stream(100, twists=True, ahead=ahead), 5.0)
    assert_within(motion)
    t = np.arange(RATE, 3 * RATE) / RATE - 0.1 - ahead
    way = (motion.p[RATE : 3 * RATE] - HERE.p_d) @ X
    assert np.abs(way - SPEED * t).max() < 0.002
    assert motion.shaper.ahead == pytest.approx(ahead, abs=0.002)
    assert motion.shaper.lost == 0


def test_references_that_another_one_overtakes_are_counted():
    shaper = Shaper(HERE, LIMITS)
    for start in (100_000_000, 200_000_000, 0):
        shaper.follow(SetPoint(HERE, 0.1), start)
    shaper.sample(0)
    assert shaper.lost == 2


def test_a_stream_of_which_none_begins_is_told():
    shaper = Shaper(HERE, LIMITS)
    for k in range(300):
        t = k * 10_000_000
        shaper.follow(SetPoint(moved(1e-4 * k), 0.1), t + 2_000_000_000 + k)
        shaper.sample(t)
        assert shaper.is_stalled(t) or not 1.0 < k / 100 <= 2.0
    shaper, start = Shaper(HERE, LIMITS), 5_000_000_000  # one that comes before the first sample
    for t in range(start, start + 2_000_000_000, 10_000_000):
        shaper.follow(SetPoint(HERE, 0.1), start + 1_500_000_000)
        assert shaper.is_stalled(t) == (start + 1_000_000_000 < t < start + 1_510_000_000)
        shaper.sample(t)


def test_an_orientation_stream_passes_tool_down_at_an_even_rate():
    axis, pole = np.array([0.6, -0.64, 0.48]), about(0, math.pi)
    frames = [DesiredFrame(HERE.p_d, pole @ exp((0.02 * k - 0.6) * axis)) for k in range(60)]
    events = [(0.1 + k / 20, sent(Goal(frame))) for k, frame in enumerate(frames)]
    motion = follow(events, 4.5, held=frames[0])
    assert_within(motion)
    assert_even(motion.w, 0.4, begin=RATE)


# --- twists -------------------------------------------------------------------------------
def test_a_twist_is_attained_and_ends_smoothly_when_none_follows():
    twist = np.array([0.1, 0.0, 0.05, 0.0, 0.4, 0.0])
    events = [(0.1 + k / 50, sent(Jog(twist, 0.1))) for k in range(100)]
    motion = follow(events, 4.0)
    assert_within(motion)
    np.testing.assert_allclose(motion.v[2 * RATE], twist[:3], atol=1e-9)
    np.testing.assert_allclose(motion.w[2 * RATE], twist[3:], atol=1e-9)
    assert_rests(motion)
    assert np.linalg.norm(motion.p[-1] - motion.p[int(2.1 * RATE)]) < 0.12 * 0.4


def test_a_twist_beyond_the_limits_is_cut_and_what_came_last_leads_smoothly():
    path = through([0.0, 2.0], HERE, moved(0.2))
    jog = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 9.0])
    events = [
        (0.1, sent(path)),
        (0.8, sent(Jog(jog, 0.4))),
        (1.2, sent(Goal(moved(-0.1, 1.0)))),
        (2.2, sent(SetPoint(moved(0.0, twist=0.1), 0.1))),
        (2.5, sent(Jog(-np.ones(6), 0.4))),
        (3.2, sent(through([2.0], HERE))),
    ]
    motion = follow(events, 9.0)
    assert_within(motion)
    at = [motion.v[int(t * RATE)] for t in (0.7, 1.15, 2.1, 2.85)]
    assert at[0][0] > 0.1
    np.testing.assert_allclose(at[1], 0.25 * X, atol=1e-9)
    assert at[2][0] < -0.1
    assert (at[3] < -0.1).all()
    assert_at(motion, HERE)


# --- stops, and the rate of time ------------------------------------------------------------
class Plan(TimeScale):
    """A rate of time that is to be one value from 0.8 s on, and another from 2 s on."""

    def __init__(self, first, second):
        super().__init__(LIMITS)
        self.first, self.second = first, second

    def wanted(self, t):
        return 1.0 if t < 0.8 else self.first if t < 2.0 else self.second


@pytest.mark.parametrize("rate", [100, RATE])
@pytest.mark.parametrize(("first", "second"), [(0.0, 0.0), (0.0, 1.0), (0.3, 1.0)])
def test_a_motion_halts_and_goes_on_along_its_path_within_the_limits(first, second, rate):
    frames = (HERE, moved(0.2, 0.6), moved(0.2, 0.6))
    path = through([0.0, 2.0, 3.0], *frames)
    motion = follow([(0.1, sent(path))], 6.0, rate=rate, scale=Plan(first, second))
    assert_within(motion, rate=rate)
    line = (motion.p - HERE.p_d) @ np.diag([0.0, 1.0, 1.0])
    assert norm(line) < 1e-12
    stopped = int(1.9 * rate)
    if first == 0.0:
        assert not motion.v[stopped].any()
    if second == 1.0:
        assert_at(motion, frames[-1])


@pytest.mark.parametrize("how", ["path", "stops", "goal", "stream", "jog"])
def test_limits_that_are_lowered_slow_what_moves_and_what_follows_a_stop(how):
    lower = MotionLimits(0.05, 0.2, 1.0, 4.0, 20.0, 80.0)
    stops = (HERE, moved(0.1), moved(0.1), moved(0.2))
    reference = {
        "path": through([0.0, 2.0], HERE, moved(0.2)),
        "stops": through([0.0, 1.0, 2.0, 3.0], *stops),
        "goal": Goal(moved(0.2)),
        "stream": SetPoint(moved(0.0, twist=0.2), 5.0),
        "jog": Jog(np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0]), 5.0),
    }[how]
    shaper = Shaper(HERE, LIMITS)
    shaper.follow(reference, 0)
    frame = [shaper.sample(k * 2_000_000) for k in range(750 if how == "stops" else 400)][-1]
    assert (np.linalg.norm(frame.dp_d) > 0.1) == (how != "stops")
    shaper.change(lower, (0.05, 0.2))
    assert shaper.bearable * 0.25 == pytest.approx(0.05)


@pytest.mark.parametrize(("rate", "is_still"), [(0.0025, False), (0.0015, True), (0.0, True)])
def test_what_begins_while_time_goes_at_less_than_2_in_1000_begins_from_rest(rate, is_still):
    """That is no jump: the tip stops from 0.5 mm/s at most, for which 1 m/s^2 take half a tick."""
    shaper, t = Shaper(HERE, LIMITS), 0
    shaper.follow(SetPoint(moved(twist=0.25), 5.0), 0)
    for k in range(1000):
        t = k * 1_000_000
        shaper.wait(round((1.0 - rate) * 1e6) if k > 800 else 0)
        shaper.sample(t)
    assert np.linalg.norm(shaper.last.dp_d) == pytest.approx(0.25)  # as planned
    shaper.follow(Goal(moved(0.3)), None)
    shaper.wait(round((1.0 - rate) * 1e6))
    shaper.sample(t + 1_000_000)
    assert shaper.restarts == is_still
    assert np.linalg.norm(shaper.last.dp_d) == pytest.approx(0.0 if is_still else 0.25, abs=1e-3)


def test_a_motion_beyond_limits_that_were_lowered_can_always_brake():
    scale = TimeScale(MotionLimits(0.5, 1.0, 0.2, 4.0, 20.0, 80.0))
    circling = moved(twist=0.27)._replace(ddp_d=np.array([0.0, 0.9, 0.0]))
    for _ in range(1500):
        scale.advance(0.002)
        scale.paced(0.002, 0.0, circling, lambda _: circling)
    assert scale.now == 0


def test_a_set_point_that_accelerates_does_not_lead_beyond_the_speed_limit_if_there_is_one():
    a, T = 0.5, 0.45
    points = [
        moved(a * t**2 / 2, twist=a * t)._replace(ddp_d=a * X)
        for t in np.arange(0, T, 1 / RATE).tolist()
    ]
    motion = follow([(k / RATE, sent(SetPoint(f, 0.3))) for k, f in enumerate(points)], 2.0)
    assert norm(motion.v) <= LIMITS.linear_speed * (1 + BULGE)
    motion = follow([(0.1, sent(SetPoint(moved(0.2, twist=3.0), 0.1)))], 0.5, limits=None)
    np.testing.assert_allclose(motion.v[60], 3.0 * X)


# --- leaps, plans -------------------------------------------------------------------------
def test_a_reference_that_leaps_when_it_begins_is_refused_then():
    path = through([0.0, 2.0], HERE, moved(0.25))
    shaper = Shaper(HERE, LIMITS, (0.05, 0.2))
    shaper.follow(path, 0)
    shaper.follow(path, 4_000_000_000)  # begins where the arm was
    frames = [shaper.sample(k * 2_000_000) for k in range(2500)]
    assert shaper.leap is not None
    assert shaper.leap[0] == pytest.approx(0.25)
    np.testing.assert_allclose(frames[-1].p_d, moved(0.25).p_d, atol=1e-12)


class FromRestAlone(Ruckig):
    """A planner that finds no way from a tip that moves."""

    def calculate(self, problem, profile):
        if problem.control_interface is ControlInterface.Position and any(problem.current_velocity):
            raise RuckigError("no way")
        return super().calculate(problem, profile)


@pytest.mark.parametrize(
    ("reference", "arrives"),
    [
        (Goal(moved(0.1)), True),
        (SetPoint(moved(0.1, twist=0.05), 2.0), False),
        (through([0.0, 2.0], HERE, moved(0.1)), False),
    ],
)
def test_where_no_plan_leads_on_the_tip_stops_before_what_follows(monkeypatch, reference, arrives):
    monkeypatch.setattr("eulerparams_control.motion.plan.Ruckig", FromRestAlone)
    jog = sent(Jog(-0.2 * np.eye(6)[0], 5.0))
    motion = follow([(0.0, jog), (0.5, sent(reference))], 4.0)
    assert_within(motion, jerk=False)
    assert not motion.v[-1].any()
    assert (np.linalg.norm(motion.p[-1] - moved(0.1).p_d) < 1e-9) == arrives
