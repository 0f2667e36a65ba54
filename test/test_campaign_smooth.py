"""Campaigns of smooth motions: their robots, what their users send, and that they repeat."""

import numpy as np
import pytest
from ros_processes import HOME, MODEL
from test_campaign import repeated

from eulerparams_control.lab.campaign.draws import (
    CHUNKS,
    GOALS,
    POSES,
    SMOOTH_MOTIONS,
    STREAM,
    TWISTS,
    RobotDraw,
    StreamDraw,
)
from eulerparams_control.lab.campaign.plan import SMOOTH, faults_of, make_plan
from eulerparams_control.lab.campaign.schedule import plans
from eulerparams_control.lab.campaign.streams import Sent, Stream
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

HOME_X = float(MODEL.state(HOME, np.zeros(6)).p_e[0])


def test_smooth_sequences_have_robots_and_users_of_all_kinds_and_seeds_keep_their_old_ones():
    todo = plans(600, 0, kind=SMOOTH)
    robots = [plan.robot for plan in todo]
    assert {plan.motion for plan in todo} == set(SMOOTH_MOTIONS)
    assert {robot.rate for robot in robots} == {20.0, 50.0, 125.0, 250.0, 500.0, 1000.0}
    for name in ("turns", "velocities", "on_silence"):
        assert len({getattr(robot, name) for robot in robots}) == 2, name
    for plan in todo:
        is_clik = plan.controller == "clik"
        assert is_clik or plan.robot.velocities
        assert is_clik or plan.robot.rate >= 250.0
        assert not is_clik or plan.parameters()["k_Pp"] <= 0.4 * plan.robot.rate
        old = make_plan(plan.seed, plan.controller)
        assert (old.robot, old.stream, old.asked) == (RobotDraw(), StreamDraw(), None)
        assert plan.asked is not None
    assert todo == plans(600, 0, kind=SMOOTH)


def sent(motion: str, draw: StreamDraw, rate: float = 1000.0) -> list[tuple[float, Sent]]:
    """Return when [s] and what is sent of a motion along x at 0.1 m/s, in 2 s."""
    home = MODEL.state(HOME, np.zeros(6))
    p, R = home.p_e, home.R_e
    v = np.array([0.1, 0.0, 0.0])
    frames = [DesiredFrame(p + t * v, R, v) for t in (0.0, 1.0, 2.0)]
    line = Trajectory([0.0, 1.0, 2.0], frames)
    stream = Stream(draw, motion, line, 0.0, 1 / rate, np.random.default_rng(1))
    return [(k / rate, each) for k in range(round(2 * rate)) for each in stream.due(k / rate)]


@pytest.mark.parametrize(
    ("draw", "rate", "count", "spread"),
    [
        (StreamDraw(50.0), 1000.0, 100, 1e-9),
        (StreamDraw(200.0), 20.0, 1 + 39 * 10, 1e-9),  # all that came between two looks
        (StreamDraw(20.0, jitter=0.2), 1000.0, 41, 0.2 / 20.0),  # the last one is early
    ],
)
def test_pieces_come_at_their_rate_with_their_jitter(draw, rate, count, spread):
    found = sent(STREAM, draw, rate)
    assert len(found) == count
    early = [t - k / draw.rate for k, (t, _) in enumerate(found)] if rate == 1000.0 else [0.0]
    assert 0.5 * spread <= max(np.abs(early)) + 1e-9 <= 2.2 * spread + 2e-9 + 1e-3 * (spread > 1e-6)


def test_pieces_say_what_they_are_to_say():
    def line(each: Sent, t: float) -> float:
        return float(abs(each.motion.frames[0].p_d[0] - HOME_X - 0.1 * t))

    exact = sent(STREAM, StreamDraw(50.0, skew=0.02))
    assert all(line(each, t) < 1e-12 and each.stamp == t + 0.02 for t, each in exact)
    assert all(each.motion.frames[0].dp_d[0] == pytest.approx(0.1) for _, each in exact)
    blind = sent(POSES, StreamDraw(50.0, twists=False, noise=1e-3))
    off = [line(each, t) for t, each in blind]
    assert 0.3e-3 < np.std(off) < 3e-3
    assert all(not each.motion.frames[0].dp_d.any() for _, each in blind)
    assert {each.topic for _, each in blind} == {"target_pose"}
    chunks = sent(CHUNKS, StreamDraw(5.0, ahead=1.0))
    assert [each.motion.times for _, each in chunks] == [pytest.approx(np.arange(1, 11) / 10)] * 10
    t, each = chunks[3]
    assert each.motion.frames[4].p_d[0] == pytest.approx(HOME_X + 0.1 * (t + 0.5))
    goals = sent(GOALS, StreamDraw(10.0))
    assert {round(float(each.motion.frames[0].p_d[0] - HOME_X), 6) for _, each in goals} == {
        0.1, 0.2}  # fmt: skip
    twists = sent(TWISTS, StreamDraw(10.0, twists=False))
    assert {each.topic for _, each in twists} == {"target_twist"}
    assert all(each.motion.frames[0].dp_d[0] == pytest.approx(0.1) for _, each in twists)


def test_a_smooth_sequence_in_lock_step_repeats_to_the_bit():
    all_plans = (make_plan(seed, "clik", kind=SMOOTH) for seed in range(1000))
    plan = next(p for p in all_plans if p.robot.turns and p.robot.rate == 50.0 and faults_of(p))
    assert len(repeated(plan).commands) > 50
