"""The supervision: the guard of the commands, the pace, ages by receipt, defects."""

import itertools
import math
import re

import numpy as np
import pytest
from arms import HOME, STILL, UR5, clik, dynamic_control
from samples import generator
from test_controller import MS, T_0, moved, pose_of
from tolerances import GUARD_ROUNDING, HELD, RELATIVE

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.control.limiter import Limiter
from eulerparams_control.control.mode import (
    DEACTIVATED,
    HALTED,
    TRANSITIONS,
    Cause,
    Latch,
    Mode,
    ModeEvent,
    ModeState,
    Why,
)
from eulerparams_control.control.pace import LEAST, LOOK, Nearness, Pace
from eulerparams_control.errors import InvalidMessageError, SingularityError, UnsafeCommandError
from eulerparams_control.laws.limits import POSITION_RATE, JointLimits
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import way_points

LIMITS = JointLimits(
    np.array([-1.0, -2.0, -np.inf]),
    np.array([1.0, 0.5, np.inf]),
    np.array([2.0, 1.0, 4.0]),
    np.array([10.0, 20.0, 5.0]),
)
ZERO = np.zeros(3)
RATE = 1000.0  # [Nm/s]
DT = 0.001  # [s]
TIMEOUT = ControllerOptions().state_timeout
CHECKED = ControllerOptions(check_states=True)


# --- the guard ----------------------------------------------------------------------------
@pytest.mark.parametrize("field", ["q", "dq", "effort", "frame"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("limits", [LIMITS, None])
def test_a_command_that_is_not_finite_is_refused_whether_limits_are_on_or_not(field, bad, limits):
    value, text = np.array([0.0, bad, 0.0]), f"non-finite {field}"
    if field == "frame":
        value, text = DesiredFrame(value, np.eye(3)), "compliant frame"
    with pytest.raises(UnsafeCommandError, match=text):
        Limiter(limits)(JointCommand(**{field: value}), ZERO, DT)


@pytest.mark.parametrize("half", [JointCommand(q=ZERO), JointCommand(dq=ZERO)])
def test_a_position_without_a_velocity_or_the_reverse_is_refused(half):
    with pytest.raises(UnsafeCommandError, match="alone; expected both"):
        Limiter(LIMITS)(half, ZERO, DT)


def test_whatever_is_asked_for_no_command_is_beyond_a_limit_or_jumps():
    random = generator(601)
    guard = Limiter(LIMITS, RATE)
    before = guard(JointCommand(ZERO, ZERO, ZERO), ZERO, DT)
    for _ in range(500):
        scale = 10 ** random.uniform(-3, 6)
        wanted = JointCommand(*(scale * random.normal(size=(3, 3))))
        dt = 10 ** random.uniform(-4, -1)
        command = guard(wanted, ZERO, dt)
        assert np.all(command.q <= LIMITS.upper)
        assert np.all(command.q >= LIMITS.lower)
        assert np.all(np.abs(command.dq) <= LIMITS.velocity)
        assert np.all(np.abs(command.effort) <= LIMITS.effort)
        step = np.abs(command.q - before.q)
        assert np.all(step <= dt * LIMITS.velocity + GUARD_ROUNDING)
        assert np.all(np.abs(command.effort - before.effort) <= dt * RATE + GUARD_ROUNDING)
        before = command
    assert guard.bounded > 400


def test_an_arm_beyond_its_limit_may_stay_there_and_come_back_but_not_go_on():
    guard = Limiter(LIMITS)
    outside = np.array([1.2, 0.0, 0.0])
    for asked, allowed in ((1.3, 1.2), (1.2, 1.2), (1.1, 1.1)):
        guard.forget()
        command = guard(JointCommand(np.array([asked, 0.0, 0.0]), ZERO), outside, DT)
        assert command.q[0] == pytest.approx(allowed, rel=RELATIVE)


def test_the_command_before_bounds_the_next_unless_it_was_refused_or_forgotten():
    guard, far = Limiter(LIMITS, RATE), JointCommand(np.full(3, 0.4), ZERO, np.full(3, 4.0))
    for _ in range(2):
        command = JointCommand(np.full(3, 0.1), np.full(3, 0.2), np.full(3, 0.3))
        assert guard(command, ZERO, DT) is command  # within all bounds
    assert guard.bounded == 0
    guard(JointCommand(ZERO, ZERO, ZERO), ZERO, DT)
    with pytest.raises(UnsafeCommandError):
        guard(JointCommand(effort=np.full(3, math.nan)), ZERO, DT)
    np.testing.assert_allclose(guard(far, ZERO, DT).effort, RATE * DT, rtol=1e-6)
    guard.forget()
    assert guard(far, ZERO, DT) is far


# --- the pace -----------------------------------------------------------------------------
def jacobian(sigma):
    """Return a Jacobian whose smallest singular value is sigma."""
    return np.diag([1.0, 1.0, 1.0, 1.0, 1.0, sigma])


def update(pace, now, q, dq, J):
    assert LOOK < 0.01
    pace.update(0.01, now, q, dq, J)


def passed(pace, sigmas):
    found = []
    for sigma in sigmas:
        update(pace, 1.0, np.zeros(6), np.zeros(6), jacobian(sigma))
        found.append((pace.singularity, pace.wanted))
    return found


def test_a_singularity_is_approached_inside_and_left_and_clear_again():
    pace = Pace(None, 0.05)
    sigmas = [0.2, 0.06, 0.045, 0.03, 0.011, 0.001, 0.0, 0.01, 0.02, 0.04, 0.06]
    found = [singularity for singularity, _ in passed(pace, sigmas)]
    c, a, i, leaving = Nearness
    assert found == [c, c, a, a, i, i, i, i, leaving, leaving, c]


def test_towards_a_singularity_the_pace_goes_as_its_distance_never_to_zero_and_out_twice_so():
    for sigma, expected in ((0.06, 1.0), (0.04, 0.8), (0.02, 0.4), (0.006, 0.12), (0.0, LEAST)):
        pace = Pace(None, 0.05)
        assert passed(pace, [sigma] * 100)[-1][1] == pytest.approx(expected, rel=RELATIVE)
    out = Pace(None, 0.05)
    assert passed(out, [0.005] * 100)[-1][1] == pytest.approx(0.1, rel=RELATIVE)
    sigmas = np.linspace(0.013, 0.02, 200)
    assert passed(out, sigmas)[-1][1] == pytest.approx(2 * 0.02 / 0.05, rel=RELATIVE)
    # a threshold of 0 slows nothing down
    assert passed(Pace(None, 0.0), [0.01, 0.0, 0.001])[-1] == (Nearness.CLEAR, 1.0)


@pytest.mark.parametrize("side", [1, -1])
def test_a_joint_slows_the_motion_down_as_it_comes_near_its_limit(side):
    limits = JointLimits(-np.ones(6), np.ones(6), np.full(6, 3.0), np.full(6, 1.0))
    q, dq = np.zeros(6), np.zeros(6)
    distance = 0.02
    q[2], dq[2] = side * (1 - distance), side * 1.0
    pace = Pace(limits, 0.0)
    update(pace, 1.0, q, dq, jacobian(1.0))
    assert (pace.limit, pace.joint) == (Nearness.APPROACHING, 2)
    for _ in range(3):  # the joint goes as fast as the pace says
        assert pace.wanted == pytest.approx(POSITION_RATE * distance)
        dq[2] = side * pace.wanted
        update(pace, pace.wanted, q, dq, jacobian(1.0))
    q[2] = side * 0.995
    update(pace, 1.0, q, dq, jacobian(1.0))
    assert pace.limit is Nearness.INSIDE
    q[2], dq[2] = side * 0.95, -side * 0.5
    update(pace, 1.0, q, dq, jacobian(1.0))
    assert (pace.limit, pace.joint) == (Nearness.LEAVING, 2)
    q[2] = side * 0.5
    update(pace, 1.0, q, dq, jacobian(1.0))
    assert pace.limit is Nearness.CLEAR


# --- the controller, supervised -----------------------------------------------------------
def following(scheme, now=None):
    """Return a controller on its way, and the stamp and state of its last step."""
    running = Controller(scheme, CHECKED, HOME)
    goal = moved(0.1, 0.4)
    running.follow(way_points([1.0], [(goal.p_d, goal.R_d)]), None)
    q, dq = HOME.copy(), STILL
    for step in range(200):
        t = T_0 + step * MS
        at = None if now is None else now + step * DT
        command = running.step(t, q, dq, at)
        if command.q is not None:  # the arm does what it is told
            q, dq = command.q, command.dq
    return running, t, q, dq, at


def lets_go(running, t, q, dq, now=None, steps=200):
    """Assert that from the stamp t on the efforts go to gravity compensation, and then end.

    Return the stamp after the first state that got no command.
    """
    before = None
    for step in range(steps):
        at = None if now is None else now + step * DT
        command = running.step(t + step * MS, q + step * DT * dq, dq, at)
        assert running.fault
        if command is None:
            np.testing.assert_allclose(before, running.scheme.last_command(q, dq).effort, atol=2.0)
            return t + (step + 1) * MS
        if before is not None:
            most = running.scheme.bounds.effort_rate * DT + GUARD_ROUNDING
            assert np.all(np.abs(command.effort - before) <= most)
        before = command.effort
    raise AssertionError("it goes on to command")


class Failing:
    def __init__(self, kind=ZeroDivisionError):
        self.kind = kind

    def __call__(self, *_args, **_kwargs):
        raise self.kind("of all things")


def alter(running, change):
    """Let the law of a controller command what ``change`` makes of its command."""
    tick = running.scheme.tick

    def altered(*args):
        found = tick(*args)
        return found._replace(command=change(found.command))

    running.scheme.tick = altered


@pytest.mark.parametrize("scheme", [clik, dynamic_control])
def test_after_a_defect_in_the_law_the_arm_is_held_and_the_place_told(scheme):
    running, t, q, dq, _ = following(scheme(limited=True))
    running.scheme.tick = Failing()
    command = running.step(t + MS, q, dq)
    expected = r"internal error ZeroDivisionError: of all things \(test_supervision.py:\d+\)"
    assert re.fullmatch(expected, running.fault)
    assert "report" in running.why.remedy
    if command.q is not None:
        np.testing.assert_allclose(command.dq, 0, atol=HELD)
    else:
        g = UR5.dynamic_state(q, STILL).g
        np.testing.assert_allclose(command.effort, g, atol=20.0)  # held, not let go
    del running.scheme.tick
    running.step(t + 2 * MS, q, dq)
    assert "ZeroDivisionError" in running.fault  # until the next reference


def test_after_a_singularity_the_arm_is_held_until_the_next_reference():
    running, t, q, dq, _ = following(clik(limited=True))
    running.scheme.tick = Failing(SingularityError)
    command = running.step(t + MS, q, dq)
    del running.scheme.tick  # the law has an answer again
    for step in range(2, 600):
        command = running.step(t + step * MS, command.q, command.dq)
        assert running.fault == "of all things"
    assert not command.dq.any()
    here = running.scheme.frame_at(command.q)
    running.follow(way_points([1.0], [(here.p_d, here.R_d)]), None)
    running.step(t + 600 * MS, command.q, command.dq)
    assert (running.mode, running.fault) == (Mode.FOLLOWING, "")


def test_a_command_that_is_not_finite_never_leaves_the_controller():
    running, t, q, dq, _ = following(clik(limited=True))
    alter(running, lambda command: command._replace(q=command.q * math.nan))
    assert running.step(t + MS, q, dq) is None
    assert "non-finite q" in running.fault
    del running.scheme.tick
    command = running.step(t + 2 * MS, q, dq)
    assert np.isfinite(command.q).all()
    assert not command.dq.any()


def test_a_state_that_repeats_itself_for_too_long_gets_no_more_commands():
    running, t, q, dq, now = following(clik(limited=True), now=50.0)
    last = running.step(t + MS, q, dq, now + DT)
    assert np.abs(last.dq).max() > 0.01
    assert running.step(t + MS, q, dq, now + 0.9 * TIMEOUT) is None
    assert running.fault == ""
    assert running.step(t + MS, q, dq, now + 2 * TIMEOUT) is None
    assert "repeats itself" in running.fault
    command = running.step(t + 200 * MS, q, STILL, now + 2 * TIMEOUT)  # new ones come
    np.testing.assert_allclose(command.dq, 0, atol=HELD)
    assert running.fault


def test_an_effort_that_a_defect_makes_too_large_or_too_sudden_is_bounded():
    running, t, q, dq, _ = following(dynamic_control())
    before = running.step(t + MS, q, dq).effort
    alter(running, lambda command: command._replace(effort=np.full(6, 1e9)))
    effort = running.step(t + 2 * MS, q, dq).effort
    assert np.all(
        np.abs(effort - before) <= running.scheme.bounds.effort_rate * DT + GUARD_ROUNDING
    )
    for step in range(3, 600):
        effort = running.step(t + step * MS, q, dq).effort
    np.testing.assert_allclose(effort, UR5.limits.effort, rtol=RELATIVE)
    assert running.limiter.bounded > 0


def test_a_position_at_rest_is_repeated_as_long_as_its_state_is_but_no_effort():
    running = Controller(clik(limited=True), CHECKED, HOME)
    first = running.step(T_0, HOME, STILL, 50.0)
    assert running.step(T_0, HOME, STILL, 60.0) is first
    assert running.fault == ""
    running = Controller(dynamic_control(), CHECKED, HOME)
    assert running.step(T_0, HOME, STILL, 50.0) is not None
    assert running.step(T_0, HOME, STILL, 50.01) is None
    assert running.fault == ""  # it may have come twice
    assert running.step(T_0, HOME, STILL, 60.1) is None
    assert "repeats itself" in running.fault


def test_positions_that_stay_while_speeds_are_reported_are_not_believed():
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    dq = np.full(6, 0.5)
    for step in range(1, 100):
        running.step(t + step * MS, q, dq, now + step * DT)
        if running.fault:
            break
    assert 15 <= step <= 25  # 0.01 rad at 0.5 rad/s
    assert "stay the same to the bit" in running.fault
    while running.step(t + step * MS, q, dq, now + step * DT) is not None:
        step += 1
        assert step < 200
    step += 1
    assert running.step(t + step * MS, q + 1e-6, dq, now + step * DT) is not None  # held then
    assert running.fault


def test_an_arm_that_runs_away_while_it_is_held_gets_no_efforts_until_it_is_resumed():
    running, t, q, _, _ = following(clik(limited=True))
    limit = UR5.limits.velocity
    running.halt()
    assert running.step(t + MS, q + 0.003, 1.6 * limit) is not None  # it takes positions
    running, t, q, _, _ = following(dynamic_control())
    for step in range(1, 100):  # in lock-step the robot does not go on without a command
        q = q + DT * 1.6 * limit
        command = running.step(t + step * MS, q, 1.6 * limit)
    assert "runs away" in running.fault
    np.testing.assert_allclose(command.effort, UR5.dynamic_state(q, STILL).g, atol=2.0)
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    running.halt()
    assert running.step(t + MS, q, 0.9 * limit, now + DT) is not None  # its efforts stop it
    t_0, t = t, lets_go(running, t + 2 * MS, q + 0.003, 1.6 * limit, now + 2 * DT)
    assert "runs away" in running.fault
    q, now = running.q, now + (t - t_0) / 1e9
    for step in range(400):  # it stands; nothing restarts by itself
        assert running.step(t + step * MS, q, STILL, now + step * DT) is None
    assert "runs away" in running.fault
    assert running.mode is Mode.STOPPED
    running.halt()  # nor by other stops
    assert running.step(t + 401 * MS, q, STILL, now + 0.401) is None
    running.resume()
    command = running.step(t + 402 * MS, q, STILL, now + 0.402)
    np.testing.assert_allclose(command.effort, UR5.dynamic_state(q, STILL).g, atol=1e-6)


def test_an_arm_that_still_moves_long_after_it_was_stopped_gets_no_efforts():
    """A loop that is late swings instead of coming to rest."""
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    running.halt()
    commands = []
    for step in range(1, 700):
        dq = np.full(6, 2.5 * math.cos(step / 20))
        q = q + DT * dq
        commands.append(running.step(t + step * MS, q, dq, now + step * DT) is not None)
    assert all(commands[:499])
    assert not any(commands[600:])
    assert "runs away" in running.fault


def test_states_that_stay_late_are_taken_again_after_a_second_where_the_arm_is_then():
    running, t, q, _dq, now = following(clik(limited=True), now=50.0)
    taken = []
    for step in range(1, 1200):
        try:
            running.step(t + step * MS, q, STILL, now + step * DT + 0.08)
            taken.append(step)
        except InvalidMessageError:
            pass
    assert taken[0] == pytest.approx(1000, abs=90)
    assert taken == list(range(taken[0], 1200))
    assert running.resets == 1  # it holds: the motion is over
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    for step in range(1, 3000):  # under efforts never
        with pytest.raises(InvalidMessageError, match="deactivate and activate"):
            running.step(t + step * MS, q, STILL, now + step * DT + 0.08)


@pytest.mark.parametrize("scheme", [clik, dynamic_control])
def test_after_an_outage_what_was_under_way_is_refused(scheme):
    running, t, q, _, now = following(scheme(), now=50.0)
    with pytest.raises(InvalidMessageError, match="later than the best one"):
        running.step(t + MS, q, STILL, now + 1.5)
    with pytest.raises(InvalidMessageError, match="later than the best one"):
        running.step(t + 500 * MS, q, STILL, now + 1.501)
    assert running.step(t + 1502 * MS, q, STILL, now + 1.502) is not None
    assert running.resets == 1


@pytest.mark.parametrize("duration", [0.0, 0.02, 0.6, 1.6])
def test_a_stream_has_to_pause_after_a_fault_by_the_clock_that_goes_on(duration):
    running, t, q, _, now = following(clik(limited=True), now=50.0)
    here = running.scheme.frame_at(q)
    motion = SetPoint(here, 0.1) if not duration else way_points([duration], [(here.p_d, here.R_d)])
    running.follow(motion, None, now - 0.02)
    running.step(t, q + 1e-6, STILL, now)  # another state under the same stamp
    assert running.why.cause is Cause.STAMP_STUCK
    for step in range(100):  # no states come meanwhile
        with pytest.raises(InvalidMessageError, match="send nothing for"):
            running.follow(motion, None, now + 0.02 * step)
    running.follow(motion, None, now + 0.02 * 99 + 0.51)
    assert running.fault == ""


@pytest.mark.parametrize("accelerates", [False, True])
def test_a_set_point_whose_twist_leads_far_away_is_refused_wherever_it_ends(accelerates):
    running = Controller(clik(limited=True), CHECKED, HOME)
    there_and_back = pose_of(HOME)._replace(
        dp_d=np.array([10.0, 0.0, 0.0]), ddp_d=np.array([-200.0 if accelerates else 0.0, 0.0, 0.0])
    )
    with pytest.raises(InvalidMessageError, match="twist of the set-point leads"):
        running.follow(SetPoint(there_and_back, 0.1), None)
    spinning = pose_of(HOME)._replace(omega_d=np.array([0.0, 0.0, 2 * math.pi / 0.1]))
    with pytest.raises(InvalidMessageError, match="twist of the set-point leads"):
        running.follow(SetPoint(spinning, 0.1), None)


@pytest.mark.parametrize("scheme", [clik, dynamic_control])
def test_a_second_publisher_of_states_with_a_clock_of_its_own_moves_nothing(scheme):
    running, t, q, _, now = following(scheme(), now=50.0)
    commands = []
    for step in range(1, 400):
        commands.append(running.step(t + step * MS, q, STILL, now + step * DT))
        if step % 20 == 0:  # another arm, of another day
            commands.append(running.step(t + 10**18 + step * MS, q + 0.3, STILL, now + step * DT))
    after = commands[25:]
    assert after.count(None) == len(after)


def test_a_simulation_that_begins_anew_is_believed_when_it_goes_on_steadily():
    running, _, _, _, now = following(clik(limited=True), now=50.0)
    q = HOME + 0.2
    answers = [running.step(k * MS, q, STILL, now + k * DT) for k in range(1, 300)]
    assert answers[0] is None
    assert answers[-1] is not None
    np.testing.assert_allclose(answers[-1].q, q, atol=HELD)
    assert answers.count(None) <= 1000 * TIMEOUT + 1


def test_an_arm_at_rest_with_noisy_speeds_and_coarse_encoders_is_believed():
    running, random = Controller(dynamic_control(), CHECKED, HOME), generator(602)
    for step in range(10_000):
        assert running.step(T_0 + step * MS, HOME, random.normal(0, 3e-3, 6)) is not None
    assert running.fault == ""


def test_an_arm_that_ran_away_is_seen_to_stand_though_its_speeds_are_noisy():
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    random = generator(603)
    t_0, t = t, lets_go(running, t + MS, q, 1.6 * UR5.limits.velocity, now + DT)
    assert "wrist_1_joint at 5.12 rad/s" in running.fault
    q, now = running.q, now + (t - t_0) / 1e9
    modes = []
    for k in range(400):
        noisy = q + random.normal(0, 1e-4, 6), random.normal(0, 0.01, 6)
        assert running.step(t + k * MS, *noisy, now + k * DT) is None
        modes.append(running.mode)
    assert (modes[100], modes[-1]) == (Mode.RELEASING, Mode.STOPPED)


def test_a_law_that_is_never_finite_leaves_the_arm_to_its_brakes_after_it_let_go():
    running, t, q, dq, now = following(dynamic_control(), now=50.0)
    hold = running.scheme.hold

    def never_finite(command):
        return command._replace(effort=command.effort * math.nan)

    alter(running, never_finite)
    running.scheme.hold = lambda *a: never_finite(hold(*a))
    t_0, t = t, lets_go(running, t + MS, q, dq, now + DT)
    assert "non-finite effort" in running.fault
    q, now = running.q, now + (t - t_0) / 1e9
    assert [running.step(t + k * MS, q, dq, now + k * DT) for k in range(50)] == [None] * 50


def test_after_a_silence_of_its_own_a_controller_begins_where_the_arm_is_then():
    running, t, q, _, now = following(clik(limited=True), now=50.0)
    tick, hold = running.scheme.tick, running.scheme.hold
    running.scheme.tick = running.scheme.hold = Failing()
    for step in range(1, 150):
        assert running.step(t + step * MS, q, STILL, now + step * DT) is None
    assert "ZeroDivisionError" in running.fault
    running.scheme.tick, running.scheme.hold = tick, hold
    braked = q - 0.02
    command = running.step(t + 150 * MS, braked, STILL, now + 150 * DT)
    np.testing.assert_allclose(command.q, braked, atol=HELD)
    assert not command.dq.any()


def released():
    """Return a controller whose arm ran away and rests, and the next stamp, q and time."""
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    since = t
    t = lets_go(running, t + MS, q, 1.6 * UR5.limits.velocity, now + DT)
    q, now = running.q, now + (t - since) / 1e9
    for k in range(400):
        assert running.step(t + k * MS, q, STILL, now + k * DT) is None
    return running, t + 400 * MS, q, now + 400 * DT


def test_a_reference_that_comes_right_after_the_resume_of_a_released_arm_is_followed():
    running, t, q, now = released()
    here = running.scheme.frame_at(q)
    running.resume()
    running.follow(way_points([1.0], [(here.p_d, here.R_d)]), None, now)
    effort = running.step(t, q, STILL, now).effort
    assert running.mode is Mode.FOLLOWING
    np.testing.assert_allclose(effort, UR5.dynamic_state(q, STILL).g, atol=2.0)


@pytest.mark.parametrize("silence", [20, 80, 500])  # [ms], below and above state_timeout
def test_after_the_resume_of_a_released_arm_that_sags_in_a_silence_no_effort_jumps(silence):
    running, t, q, now = released()
    running.resume()
    before, q = q, q + [0.0, min(5.0 * (silence / 1000) ** 2, 0.2), 0.0, 0.0, 0.0, 0.0]
    most = running.scheme.bounds.effort_rate * DT + GUARD_ROUNDING
    ticks = range(silence, 100 + silence)
    efforts = [running.step(t + k * MS, q, STILL, now + k * DT).effort for k in ticks]
    g = UR5.dynamic_state(q, STILL).g
    assert np.all(np.abs(efforts[0] - g) <= 3 * most)  # a late tick counts as three at most
    assert np.all(np.abs(np.diff(efforts, axis=0)) <= most)
    held = running.scheme.frame_at(q if silence > 1000 * TIMEOUT else before)
    np.testing.assert_allclose(running.guidance.motion.last.p_d, held.p_d, atol=HELD)
    assert running.mode is Mode.HOLDING


# --- defects at the wrong moment ----------------------------------------------------------
def test_a_restart_that_fails_is_a_restart_again_at_the_next_state():
    running, t, q, _, now = following(clik(limited=True), now=50.0)
    reset, moved_by_hand = running.scheme.reset, q + 0.5
    running.scheme.reset = Failing()
    with pytest.raises(ZeroDivisionError) as planted:
        running.step(t + 10_000 * MS, moved_by_hand, STILL, now + 10.0)
    running.fail_for_good(planted.value)
    running.scheme.reset = reset
    command = running.step(t + 10_001 * MS, moved_by_hand, STILL, now + 10.001)
    assert running.resets == 2
    if command is not None:
        np.testing.assert_allclose(command.q, moved_by_hand, atol=HELD)
    assert running.why.cause is Cause.DEFECT


def test_a_law_that_cannot_even_hold_has_a_defect_that_no_reference_leads_out_of():
    running, t, q, dq, _ = following(dynamic_control())
    running.scheme.hold = Failing(SingularityError)
    running.guidance.desired = Failing(SingularityError)
    assert running.step(t + MS, q, dq) is not None  # gravity compensation
    assert running.why.cause is Cause.DEFECT
    with pytest.raises(InvalidMessageError, match="deactivate and activate"):
        running.follow(SetPoint(running.scheme.frame_at(q), 0.1), None)


def test_gravity_compensation_that_is_not_finite_is_a_fault_and_no_effort_follows_it():
    running, t, q, _dq, now = following(dynamic_control(), now=50.0)
    good, limits = running.scheme.last_command, running.limiter.limits
    running.scheme.last_command = lambda *_: JointCommand(effort=np.full(6, math.nan))
    fast = 1.6 * limits.velocity  # it runs away
    tick = now + DT
    assert running.step(t + MS, q, fast, tick) is None
    assert (running.mode, running.why.cause) == (Mode.RELEASING, Cause.UNSAFE_COMMAND)
    running.scheme.last_command = good
    assert running.step(t + 2 * MS, q + DT * fast, fast, tick + DT) is None


# --- halt and resume -----------------------------------------------------------------------
def asks(running, q, now):
    """Yield what asks for a motion, each kind of reference at rest where the arm is."""
    here = running.scheme.frame_at(q)
    yield lambda: running.follow(SetPoint(here, 0.1), None, now)
    yield lambda: running.follow(way_points([2.0], [(here.p_d, here.R_d)]), None, now)
    yield lambda: running.aim(here, now)
    yield lambda: running.jog(np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]), now)


@pytest.mark.parametrize("scheme", [clik, dynamic_control])
def test_only_a_resume_leads_out_of_a_halt_also_if_faults_come_before_or_after_it(scheme):
    for faults in ((), (0,), (1,), (0, 1)):
        running, t, q, _, now = following(scheme(), now=50.0)
        for when in (0, 1):
            if when in faults:
                running.step(t, q + 1e-6, STILL, now)  # another state under the same stamp
            if when == 0:
                running.halt()
        for step in range(1, 800):
            t_step, now_step = t + step * MS, now + step * DT
            before = running.step(t_step, q, STILL, now_step)
            if step in (100, 790):  # soon, and after a pause
                for ask in asks(running, q, now_step):
                    with pytest.raises(InvalidMessageError, match="call ~/resume"):
                        ask()
        assert running.mode is Mode.STOPPED
        running.resume()
        assert (running.mode, running.why.fault) == (Mode.HOLDING, "")
        command = running.step(t_step + MS, q, STILL, now_step + DT)
        if command.q is not None:
            np.testing.assert_allclose(command.q, q, atol=HELD)
        else:
            most = running.scheme.bounds.effort_rate * DT + GUARD_ROUNDING
            assert (np.abs(command.effort - before.effort) <= most).all()
        for ask in asks(running, q, now_step + DT):
            ask()
            assert running.mode is Mode.FOLLOWING


def test_a_fault_is_resumed_at_once_but_not_while_the_arm_moves():
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    running.step(t, q + 1e-6, STILL, now)
    running.step(t + MS, q, STILL + 0.1, now + DT)
    with pytest.raises(InvalidMessageError, match="ask when it is at rest"):
        running.resume()
    assert running.why.cause is Cause.STAMP_STUCK
    running.step(t + 2 * MS, q, STILL, now + 2 * DT)
    running.resume()
    assert running.mode is Mode.HOLDING


def test_neither_a_reference_nor_a_resume_leads_out_of_a_runaway_or_a_defect():
    running, t, q, _, now = following(dynamic_control(), now=50.0)
    running.step(t + MS, q, 1.6 * UR5.limits.velocity, now + DT)
    for ask in asks(running, q, now + DT):
        with pytest.raises(InvalidMessageError, match="runs away"):
            ask()
    with pytest.raises(InvalidMessageError, match="runs away"):
        running.resume()
    assert running.mode is Mode.RELEASING
    assert "runs away" in running.fault
    running, t, q, _, now = following(clik(limited=True), now=50.0)
    running.scheme.tick = Failing()
    running.step(t + MS, q, STILL, now + DT)
    del running.scheme.tick
    running.step(t + 1000 * MS, q, STILL, now + 1.0)
    for ask in asks(running, q, now + 1.0):
        with pytest.raises(InvalidMessageError, match="deactivate and activate"):
            ask()
    with pytest.raises(InvalidMessageError, match="deactivate and activate"):
        running.resume()
    assert running.why.cause is Cause.DEFECT


# --- the table of modes, and what each keeps ----------------------------------------------
TABLE = """
event       waiting   holding     following   stopped     releasing   distrusting
REFERENCE   following following   following   following   following   distrusting
RESTART     waiting   holding     holding     stopped     releasing   distrusting
DISTRUST    waiting   distrusting distrusting distrusting distrusting distrusting
TRUST       waiting   holding     following   stopped     releasing   holding
FAULT       waiting   stopped     stopped     stopped     releasing   distrusting
DEFECT      waiting   stopped     stopped     stopped     releasing   distrusting
HALT        waiting   stopped     stopped     stopped     releasing   distrusting
END         waiting   stopped     stopped     stopped     releasing   distrusting
RESUME      waiting   holding     following   holding     releasing   distrusting
RUNS_AWAY   waiting   releasing   releasing   releasing   releasing   distrusting
FROZEN      waiting   releasing   releasing   releasing   releasing   distrusting
RECOVERED   waiting   holding     following   stopped     stopped     distrusting
"""
HEAD, *ROWS = (line.split() for line in TABLE.split("\n") if line)
EXPECTED = {
    (Mode(mode), ModeEvent[event]): Mode(after)
    for event, *row in ROWS
    for mode, after in zip(HEAD[1:], row, strict=True)
}
FAULT = Why(Cause.NOT_FOLLOWING, "the arm is blocked", "free it", at=3.0)
OTHER_FAULT = Why(Cause.STAMP_STUCK, "the stamp stays", "see to it", at=5.0)
DEFECT = Why(Cause.DEFECT, "internal error", "report it", at=4.0)
RUNAWAY = Why(Cause.RUNAWAY, "it runs away", "see to it", at=4.0)
HALT = Why(Cause.HALT, at=6.0)


def test_each_event_leads_from_each_mode_to_the_one_of_the_table():
    found = {
        (mode, event): TRANSITIONS[mode].get(event, mode) for mode in Mode for event in ModeEvent
    }
    assert found == EXPECTED
    assert TRANSITIONS.keys() == set(Mode)


def led(start, *steps):
    mode = ModeState(start)
    for event, why in steps:
        mode = mode.after(ModeEvent[event], why)
    return mode


STOP, RAN_AWAY, HALTS = ("FAULT", FAULT), ("RUNS_AWAY", RUNAWAY), ("HALT", HALTED)
BROKE, ENDS = ("DEFECT", DEFECT), ("END", DEACTIVATED)
FIRST_TOLD = OTHER_FAULT._replace(at=FAULT.at)


@pytest.mark.parametrize(
    ("start", "steps", "expected"),
    [
        (Mode.HOLDING, [STOP, ("FAULT", OTHER_FAULT)], {"mode": Mode.STOPPED, "why": FIRST_TOLD}),
        *((Mode.HOLDING, [STOP, (event, HALT)], {"why": FAULT}) for event in ("HALT", "RESTART")),
        (
            Mode.HOLDING,
            [STOP, ("REFERENCE", Why())],
            {"mode": Mode.FOLLOWING, "why": Why(), "is_halted": False},
        ),
        (Mode.HOLDING, [ENDS], {"mode": Mode.STOPPED, "cause": Cause.DEACTIVATED}),
        (Mode.HOLDING, [ENDS, BROKE], {"cause": Cause.DEFECT}),
        (Mode.HOLDING, [ENDS, HALTS], {"latch": Latch.NEVER}),  # no reason to resume then
        (Mode.HOLDING, [HALTS], {"remedy": "call ~/resume"}),
        (Mode.HOLDING, [HALTS, STOP], {"remedy": "free it; call ~/resume"}),
        (Mode.HOLDING, [STOP], {"remedy": "free it"}),
        (Mode.HOLDING, [STOP, HALTS], {"remedy": "free it; call ~/resume"}),
        (Mode.WAITING, [HALTS], {"mode": Mode.WAITING, "latch": Latch.RESUME, "cause": Cause.HALT}),
        (Mode.WAITING, [HALTS, ("RESUME", Why())], {"why": Why()}),
        *(
            (
                Mode.HOLDING,
                [BROKE, (event, OTHER_FAULT)],
                {"latch": Latch.NEVER, "cause": Cause.DEFECT},
            )
            for event in ("FAULT", "RUNS_AWAY", "HALT")
        ),
        (Mode.WAITING, [BROKE], {"mode": Mode.WAITING, "latch": Latch.NEVER}),
        (Mode.WAITING, [BROKE, ("HALT", HALT)], {"latch": Latch.NEVER}),
        (Mode.HOLDING, [RAN_AWAY], {"ran_away": True}),
        (
            Mode.HOLDING,
            [("FROZEN", OTHER_FAULT)],
            {"ran_away": False},
        ),  # it need not come to rest
        (Mode.HOLDING, [RAN_AWAY, ("FROZEN", OTHER_FAULT)], {"ran_away": True}),
        (Mode.HOLDING, [RAN_AWAY, ("RECOVERED", Why())], {"mode": Mode.STOPPED, "why": RUNAWAY}),
        *(
            (Mode.HOLDING, [*before, ("RECOVERED", Why()), *after], {"ran_away": True})
            for before in ([RAN_AWAY], [("FROZEN", OTHER_FAULT), RAN_AWAY])
            for after in ([], [STOP], [("FROZEN", OTHER_FAULT), ("RECOVERED", Why())])
        ),
    ],
)
def test_what_a_mode_keeps_of_what_has_led_to_it(start, steps, expected):
    mode = led(start, *steps)
    found = {name: mode.why.cause if name == "cause" else getattr(mode, name) for name in expected}
    assert found == expected


STOPS = {
    ModeEvent.FAULT: Latch.PAUSE,
    ModeEvent.RUNS_AWAY: Latch.RESUME,
    ModeEvent.FROZEN: Latch.PAUSE,
    ModeEvent.HALT: Latch.RESUME,
    ModeEvent.DEFECT: Latch.NEVER,
    ModeEvent.END: Latch.NEVER,
}


@pytest.mark.parametrize(
    "start",
    [
        ModeState(Mode.HOLDING),
        ModeState(Mode.WAITING),
        ModeState(Mode.HOLDING).distrusted(7.0),
    ],
)
def test_of_two_stops_the_one_that_is_harder_to_leave_counts(start):
    for first, second in itertools.product(STOPS, repeat=2):
        mode = start.after(first, FAULT).after(second, FAULT)
        mode = mode.after(ModeEvent.RESTART, OTHER_FAULT).after(ModeEvent.RECOVERED, Why())
        latch = max(STOPS[first], STOPS[second])
        assert mode.latch is latch, (first, second)
        mode = mode.after(ModeEvent.TRUST, Why()).after(ModeEvent.RECOVERED, Why())
        left = mode.after(ModeEvent.RESUME, Why())
        assert left.latch is (Latch.NEVER if latch is Latch.NEVER else Latch.NONE)


def test_an_arm_is_at_rest_after_it_stayed_in_one_place_for_0_2_s():
    mode = ModeState(Mode.RELEASING, RUNAWAY, ran_away=True)
    here, there = np.zeros(2), np.array([0.0, 3e-3])
    assert not any(mode.rests(0.01, here) for _ in range(19))
    assert not any(mode.rests(0.01, there) for _ in range(19))  # it moved meanwhile
    assert mode.rests(0.01, there + 1e-3)
