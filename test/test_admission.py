"""Times of the states of a robot: order, gaps, rates, clocks that are off."""

from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from arms import HOME, UR5, Plant, clik, dynamic_control, robot_named, robot_of
from driven import CHECKED, LIMITS, MS, T_0, Driver, moved
from samples import generator
from tolerances import RELATIVE, assert_close

from eulerparams_control.control.clock import Latency, Rate
from eulerparams_control.control.controller import ControllerOptions
from eulerparams_control.control.mode import Cause, Mode, Why
from eulerparams_control.errors import InvalidMessageError, RobotError
from eulerparams_control.robot.catalogue import find_urdf
from eulerparams_control.robot.robot import Robot

KINOVA = Robot(
    find_urdf("example-robot-data:kinova_description/robots/kinova.urdf", Path()).read_text(),
    "base",
    "j2s6s200_end_effector",
)  # joints 1, 4 and 6 are continuous
DT, ACCELERATION = 0.002, 10.0  # [s], [rad/s^2]


def on_its_way(options=CHECKED, **parameters):
    """Return a UR5 under CLIK halfway to a goal, and that goal."""
    arm, goal = Driver(clik(limited=True, **parameters), options=options, period=DT), moved(0.2)
    arm.run(0.1)
    arm.go(goal, seconds=1.5)
    arm.run(0.75)
    return arm, goal


def kinova(q, **options):
    """Return a Kinova under CLIK at q."""
    scheme = clik(limited=True, robot=KINOVA, max_joint_acceleration=(ACCELERATION,))
    return Driver(scheme, q, period=DT, **options)


def turn(arm, joint, angle):
    """Send the motion to where a joint is turned by an angle [rad]."""
    arm.go(arm.scheme.frame_at(arm.q + angle * np.eye(6)[joint]), seconds=1.5)


# --- turns ----------------------------------------------------------------------------------
NEAR_PI = np.array([0.3, 2.9, 1.3, -2.07, 1.4, np.pi - 0.15])


def stamp_jump(arm):
    arm.step(stamps=0.3)


def silence(arm):
    arm.step(0.3)


def fault(arm):
    arm.q = arm.q + 1e-3
    for _ in range(3):
        arm.step(0.0, q=arm.q)  # under the same stamp
    assert arm.why.cause is Cause.STAMP_STUCK
    arm.q = arm.q - 1e-3
    arm.run(0.6)


@pytest.mark.parametrize("event", [stamp_jump, silence, fault])
@pytest.mark.parametrize("wraps", [True, False])
def test_a_driver_that_wraps_continuous_joints_never_makes_a_command_step(event, wraps):
    arm = kinova(NEAR_PI, wraps=wraps)
    arm.run(0.1)
    for angle, goal in ((0.4, np.pi + 0.25), (-0.3, np.pi - 0.05)):
        turn(arm, 5, angle)
        arm.run(2.0)
        assert arm.commands[-1].q[5] == pytest.approx(goal, abs=1e-3)  # through pi, and back
        event(arm)
        arm.run(0.6)
    turn(arm, 5, 0.4)
    arm.run(0.75)
    if event is not silence:  # after which the arm has come to rest
        event(arm)
    arm.run(1.0)
    q = np.array([command.q for command in arm.commands if command is not None])
    assert np.abs(np.diff(q, 2, axis=0)).max() <= ACCELERATION * DT**2 + 1e-9 * DT


def test_a_joint_without_wrapping_is_where_it_says_it_is_after_a_silence():
    """Its driver lost the count of turns: a command a turn away would turn the arm round."""
    arm = kinova(NEAR_PI)
    arm.run(0.1)
    command = arm.step(5.0, q=arm.q - 2 * np.pi * np.eye(6)[5])
    assert_close(command.q, arm.q, RELATIVE)
    assert command.q[5] < 0


def test_joints_with_limits_are_never_taken_a_turn_away():
    arm = kinova(np.zeros(6), options=ControllerOptions())
    turning = np.isinf(KINOVA.limits.upper)
    assert turning.tolist() == [True, False, False, True, False, True]
    command = arm.step(q=np.full(6, 6.2))
    np.testing.assert_allclose(command.q[turning], 6.2 - 2 * np.pi)
    arm = Driver(clik(), options=ControllerOptions())
    np.testing.assert_allclose(arm.step(q=np.full(6, 6.2)).q, 6.2)


def test_a_state_of_another_size_is_refused_and_the_next_one_is_taken():
    arm, _ = on_its_way()
    for more in (1, 3):
        q = arm.q
        with pytest.raises(RobotError, match=r"expected \(6,\)"):
            arm.step(q=np.append(q, more * [9.0]))
        assert arm.step(q=q) is not None


# --- clocks that are set ---------------------------------------------------------------------
@pytest.mark.parametrize("jump", [0.3, -20.0])
@pytest.mark.parametrize("event", ["", "halt", "aim"])
def test_after_a_jump_of_the_stamps_the_tip_brakes_along_its_path_within_the_limits(jump, event):
    options = replace(CHECKED, motion=LIMITS)
    arm, goal = on_its_way(options, max_joint_acceleration=(ACCELERATION,))
    if event == "halt":
        arm.halt()
        arm.run(0.05)
    arm.step(stamps=jump)
    arm.run(0.05)
    if event == "aim":  # it goes on from where it is
        arm.aim(goal, arm.now)
    else:
        stopped, jumped = (Mode.STOPPED, Cause.HALT), (Mode.HOLDING, Cause.STAMP_JUMP)
        assert (arm.mode, arm.why.cause) == (stopped if event == "halt" else jumped)
    assert np.abs(arm.dq).max() > 0.05
    arm.run(2.0)
    q = np.array([command.q for command in arm.commands])
    p = UR5.states(q, np.zeros_like(q)).p_e
    assert np.linalg.norm(np.diff(p, 2, axis=0), axis=1).max() <= 1.05 * DT**2
    assert np.abs(p - p[0])[:, 1:].max() < 1e-6
    assert np.abs(arm.dq).max() < 1e-6
    assert (np.linalg.norm(p[-1] - goal.p_d) < 1e-6) == (event == "aim")


def ends_at(arm, goal):
    arm.run(1.0)
    desired = arm.guidance.tick_now.desired
    np.testing.assert_allclose(desired.p_d, goal.p_d, atol=1e-9)


def test_the_motion_goes_on_as_it_was_where_the_stamps_alone_go_on_by_a_little():
    arm, goal = on_its_way()
    arm.step(stamps=0.05)
    ends_at(arm, goal)
    q = np.array([command.q for command in arm.commands])
    assert np.abs(np.diff(q, 2, axis=0)).max() <= ACCELERATION * DT**2


@pytest.mark.parametrize("between", ["a repeated stamp", "a leap of the arm"])
def test_after_a_clock_was_set_back_a_bad_state_does_not_make_the_next_ones_late(between):
    arm = Driver(dynamic_control(), options=replace(CHECKED, max_latency=0.03), period=0.004)
    arm.run(0.2)
    first, last = arm.t, arm.now

    def put(stamp, q=HOME):
        with suppress(InvalidMessageError):
            arm.step(stamps=(first + stamp * MS - arm.t) / 1e9, q=q)

    for k in range(4):
        put(4 * k - 60)  # it is set back
    put(*((0, HOME) if between == "a repeated stamp" else (1, HOME + 2.0)))
    for stamp in (-30, -40):  # disordered
        put(stamp)
    arm.now = last + 0.08
    for k in range(1, 20):
        arm.step(stamps=(first + (1 + 4 * k) * MS - arm.t) / 1e9, q=HOME)  # none is refused


def test_after_a_clock_was_set_back_lateness_is_judged_again():
    arm = Driver(dynamic_control(), options=replace(CHECKED, max_latency=0.03), period=0.004)
    arm.run(0.2)
    for k in range(30):
        with suppress(InvalidMessageError):  # until the stamps are where they were
            arm.step(stamps=-0.06 if k == 0 else None)
    assert arm.commands[-1] is not None
    with pytest.raises(InvalidMessageError, match="later than the best one"):
        arm.step(late=0.05)


# --- gaps -----------------------------------------------------------------------------------
@pytest.mark.parametrize("gap", [0.02, 0.05, 0.09])
@pytest.mark.parametrize("feedback", ["internal", "measured"])
def test_after_a_gap_positions_step_by_three_periods_and_the_motion_waits(gap, feedback):
    arm, goal = on_its_way(feedback=feedback)
    command, desired = arm.step(), arm.guidance.tick_now.desired
    after = arm.step(gap)
    most = 3.001 * DT * np.abs([command.dq, after.dq]).max(axis=0)
    assert (np.abs(after.q - command.q) <= most + RELATIVE).all()
    went = arm.guidance.tick_now.desired.p_d - desired.p_d
    assert np.linalg.norm(went) <= 3.01 * DT * np.linalg.norm(desired.dp_d)
    ends_at(arm, goal)  # later, but all of it


@pytest.mark.parametrize(
    ("missed", "is_held", "leap", "is_simulated"),
    [
        (0, False, 0.0, False),
        (25, False, 0.0, True),
        (25, False, 0.0, False),
        (25, True, 0.0, False),  # the first one comes as late as the next
        (0, False, 0.046, False),  # of the stamps alone
        (0, False, -0.046, False),
        (0, False, -0.0465, False),
        (25, False, 0.04, False),
    ],
)
def test_under_efforts_the_motion_goes_on_as_the_arm_does(missed, is_held, leap, is_simulated):
    """The efforts acted: waiting would pull the arm back, by 4.5 m/s^2 after 50 ms."""
    plant, arm = Plant(), Driver(dynamic_control(), real=not is_simulated)
    tau, peak, first = None, 0.0, 350
    arm.go(moved(0.2), seconds=1.5)
    for step in range(1000):
        states = [(step * DT + leap * (step >= first), plant.q.copy(), plant.dq.copy())]
        if step == first:
            held = states * is_held
        if step < first + missed:
            states *= step < first
        elif step == first + missed:
            states = held + states
        for place, (stamp, q, dq) in enumerate(states):
            arm.now = 50.0 + step * DT + 1e-4 * place
            with suppress(InvalidMessageError):  # until the stamps are where they were
                command = arm.step(0.0, stamps=stamp + (T_0 - arm.t) / 1e9, q=q, dq=dq)
                tau = tau if command is None else command.effort  # None: at the same stamp again
        ddq = plant.acceleration(plant.q, plant.dq, tau)
        if step > 345:
            a = plant.tip_acceleration(plant.q, plant.dq, ddq)
            peak = max(peak, np.linalg.norm(a[:3]))
        plant.step(tau, DT)
    assert arm.fault == ""
    assert peak < 0.6


# --- rates ----------------------------------------------------------------------------------
def periods(text):
    """Return the steps [s] of a pattern of milliseconds."""
    return [float(word) / 1e3 for word in text.split()]


@pytest.mark.parametrize(
    ("steps", "seconds", "missed"),
    [
        (periods("2") * 100, 0.002, 0),
        (periods("1.7 2.3 2.1 1.9") * 25, 0.002, 0),
        (periods("90") + periods("2") * 99, 0.002, 0),  # it began with a hiccup
        ((periods("2") * 49 + periods("50")) * 2, 0.002, 48),
        (periods("2") * 50 + periods("10") * 400, 0.010, None),
        (periods("10") * 50 + periods("2") * 400, 0.002, None),
        (periods("125") * 20, 0.125, 0),
    ],
)
def test_after_nine_steps_the_usual_period_is_known_whatever_is_lost_or_late(
    steps, seconds, missed
):
    rate = Rate(0.1)
    for step in steps:
        rate.take(step)
    assert rate.period == pytest.approx(seconds, rel=0.06)
    assert missed is None or rate.missed == missed
    first, known = Rate(0.1), []
    for step in [0.3, *[0.1] * 8]:
        first.take(step)
        known.append((first.least, first.period))
    assert known == [(0, 0)] * 2 + [(0.1 / 1.5, 0)] * 6 + [(0.1, 0.1)]


def fast(gain=100.0):
    """Return CLIK with this gain."""
    return clik(limited=True, k_Pp=gain, k_Po=gain)


def effort(k_Po=800.0):
    """Return dynamic control with this gain; the error of Euler parameters has the slope 1/2."""
    return dynamic_control(k_Pp=100.0, k_Vp=20.0, k_Po=k_Po, k_Vo=20.0)


@pytest.mark.parametrize(
    ("scheme", "rate", "fault", "warning"),
    [
        (fast, 1000, "", ""),
        (fast, 150, "", "150 times a second, too seldom for k_Pp 100, whose loop has 100 1/s"),
        (fast, 40, "40 times a second, too seldom for k_Pp 100, whose loop has 100 1/s", ""),
        (partial(fast, 10.0), 40, "", ""),
        (partial(fast, 10.0), 20.5, "", ""),
        (partial(effort, 20_000.0), 80, "too seldom for k_Po 20000, whose loop has 100 1/s", ""),
        (partial(effort, 20_000.0), 500, "", ""),
        (effort, 30, "", "too seldom for k_Po 800, whose loop has 20 1/s"),
    ],
)
def test_a_rate_that_the_gains_do_not_bear_is_a_fault_or_a_warning(scheme, rate, fault, warning):
    arm = Driver(scheme(), period=1 / rate)
    arm.run(15 / rate)
    note = arm.rate.why.note
    assert (fault in arm.fault, bool(fault)) == (True, bool(arm.fault))
    assert (warning in note, bool(warning)) == (True, bool(note))
    if fault:
        assert arm.why.cause is Cause.RATE_TOO_LOW
        assert arm.step() is not None  # it is held
        with pytest.raises(InvalidMessageError, match="too seldom"):
            arm.aim(arm.here, 99.0)


@pytest.mark.parametrize(("rotors", "rate"), [(0.0, 680), (0.1, 206)])
def test_the_rate_at_which_a_hand_that_lets_go_is_seen_in_time_is_said(rotors, rate):
    robot, home = robot_of("kuka_iiwa"), robot_named("kuka_iiwa")[1]
    robot.model.armature[:] = rotors
    scheme = dynamic_control(robot=robot, q=home, shape_motion=True)
    arm = Driver(scheme, home, period=1.3 / rate)
    arm.run(0.2)
    assert "a hand that leaned on the arm" in arm.rate.why.note
    assert f"publish {scheme.release_rate:.3g} times a second" in arm.rate.why.remedy
    assert scheme.release_rate == pytest.approx(rate, rel=0.01)  # F / (m_d 0.25 m/s)
    arm = Driver(scheme, home, period=0.8 / rate)
    arm.run(0.2)
    assert arm.rate.why == Why()


def test_the_remedy_of_a_rate_that_is_too_low_helps():
    arm = Driver(fast(), period=0.025)
    arm.run(0.5)
    remedy = "publish 200 times a second or more, or set k_Pp to 20 or less"
    assert remedy in arm.why.remedy
    arm.scheme.change(fast(20.0).parameters)
    arm.run(0.6)
    turn(arm, 5, 0.2)
    arm.run(2.0)
    assert arm.fault == ""
    assert arm.mode is Mode.FOLLOWING
    arm.scheme.change(fast(100.0).parameters)  # a gain is judged when it is changed
    arm.step()
    assert arm.why.cause is Cause.RATE_TOO_LOW


def test_jitter_about_the_bound_does_not_toggle_the_verdict():
    arm, random = Driver(fast(), period=0.0105), generator(701)
    verdicts = []
    for _ in range(2000):
        arm.step(0.0105 * random.uniform(0.7, 1.3))
        verdicts.append(arm.rate.is_too_low)
    assert sum(before != after for before, after in pairwise(verdicts)) <= 1


@pytest.mark.parametrize("is_simulated", [False, True])
@pytest.mark.parametrize("scheme", [clik, dynamic_control])
def test_states_that_come_less_often_than_the_timeout_are_a_fault_with_its_remedy(
    scheme, is_simulated
):
    arm = Driver(scheme(), period=0.125, real=not is_simulated)
    last, why = arm.run(2.5)[-1], arm.why
    assert why.cause is Cause.RATE_TOO_LOW
    assert "come every 0.125 s, but state_timeout is 0.1 s" in why.fault
    assert "set state_timeout to 0.25 s" in why.remedy
    if scheme is clik:
        np.testing.assert_array_equal(last.q, HOME)
    else:  # there is no loop that could hold it at 8 Hz
        assert last is None


# --- clocks that are off ----------------------------------------------------------------------
MINUTES = 20.0


def lateness(clock, seconds, rate=100, jitter=1e-3):
    """Return when states are refused [s] under efforts; ``clock`` makes stamps of the time."""
    latency, random, refused = Latency(0.03), generator(702), []
    for k in range(round(seconds * rate)):
        t = k / rate
        stamp, now = round(1e9 * (1000 + clock(t))), 50.0 + t + random.exponential(jitter)
        if latency.of(stamp, now, patient=False) > latency.most:
            refused.append(t)
    return refused


@pytest.mark.parametrize(
    ("clock", "seconds", "silent"),
    [
        *((lambda t, s=ppm: t * (1 + 1e-6 * s), 60 * MINUTES, 0) for ppm in (-1e3, -200, 200, 1e3)),
        (lambda t: t - 0.1 * (t > 100), 150, 10),  # stepped back: within the allowed lateness
        (lambda t: t - (t > 10) * (0.1 + 0.03 * np.sin(t)), 35, 25),  # no clock swings so
    ],
)
def test_a_clock_that_drifts_by_1000_ppm_or_is_set_is_told_from_lateness(clock, seconds, silent):
    assert len(lateness(clock, seconds)) == pytest.approx(100 * silent, abs=5 * bool(silent))


@pytest.mark.parametrize("slewed", [0.04, 0.2, -0.2])
def test_a_clock_that_is_slewed_silences_no_arm_for_longer_than_some_seconds(slewed):
    """As chrony slews: by 40 ms within 1 s, and by more at that speed."""
    duration = abs(slewed) / 0.04
    refused = lateness(
        lambda t: t - np.sign(slewed) * 0.04 * np.clip(t - 100, 0, duration), seconds=200
    )
    assert len(refused) < 100 * (duration + 11)
    assert all(100 <= t < 100 + duration + 11 for t in refused)


@pytest.mark.parametrize("growth", [0.005, 0.01, 0.1])
def test_lateness_that_grows_by_congestion_is_refused_for_as_long_as_it_grows(growth):
    refused = lateness(lambda t: t - growth * max(0.0, t - 10), seconds=60)
    from_then_on = [k / 100 for k in range(round(100 * (10.5 + 0.03 / (growth - 0.002))), 6000)]
    assert set(from_then_on) <= set(np.round(refused, 2))
