"""The supervision: the guard of the commands, the pace, ages by receipt, defects, modes."""

import itertools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from arms import HOME, STILL, UR5, clik, dynamic_control, robot_of
from driven import DT, MS, Driver, moved, on_its_way, pose_of
from samples import generator
from tolerances import GUARD_ROUNDING, HELD, RELATIVE

from eulerparams_control.control.controller import ControllerOptions
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
from eulerparams_control.errors import InvalidMessageError, SingularityError
from eulerparams_control.laws.limits import POSITION_RATE, JointLimits
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import way_points

TIMEOUT = ControllerOptions().state_timeout
V = UR5.limits.velocity
each_law = pytest.mark.parametrize("scheme", [clik, dynamic_control])


def weight(q):
    return UR5.dynamic_state(q, STILL).g


def most_step(arm):
    """Return by how much an effort may change in a tick [Nm]."""
    return arm.scheme.bounds.effort_rate * DT + GUARD_ROUNDING


def raises(kind=ZeroDivisionError):
    def failing(*_args, **_kwargs):
        raise kind("of all things")

    return failing


def alter(arm, change):
    """Let the law command what ``change`` makes of its command."""
    tick = arm.scheme.tick

    def altered(*args):
        found = tick(*args)
        return found._replace(command=change(found.command))

    arm.scheme.tick = altered


def change_under_the_same_stamp(arm):
    """Let a fault happen: a clock that stands."""
    for _ in range(3):
        assert arm.step(0.0, q=arm.q + 1e-6, dq=STILL) is None
    assert arm.why.cause is Cause.STAMP_STUCK


# --- the guard ----------------------------------------------------------------------------
@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["q", "dq", "effort", "frame", "half"])
def test_a_command_that_is_not_finite_never_leaves_the_controller(field, bad, limited):
    arm = on_its_way((dynamic_control if field == "effort" else clik)(limited=limited))
    value, text = np.array([0.0, bad, *[0.0] * 4]), f"non-finite {field}"
    if field == "frame":
        value, text = DesiredFrame(value[:3], np.eye(3)), "compliant frame"
    if field == "half":
        field, value, text = "dq", None, "alone; expected both"
    alter(arm, lambda command: command._replace(**{field: value}))
    command = arm.step()
    assert text in arm.fault
    assert command is None or np.isfinite(command.effort).all()  # gravity compensation
    del arm.scheme.tick
    command = arm.step()
    assert np.isfinite(command.effort if command.q is None else command.q).all()
    assert command.dq is None or not command.dq.any()


@each_law
def test_whatever_is_asked_for_no_command_is_beyond_a_limit_or_jumps(scheme):
    random, limits = generator(601), UR5.limits
    arm = Driver(scheme(limited=True), obeys=False, real=False)
    arm.run(0.05)

    def anything(command):
        values = 10 ** random.uniform(-3, 6) * random.normal(size=(3, 6))
        return JointCommand(*(c if c is None else v for c, v in zip(command, values)))  # noqa: B905

    alter(arm, anything)
    for _ in range(500):
        before, dt = arm.commands[-1], 1e-4 * random.integers(5, 30)
        command = arm.step(dt)
        if scheme is dynamic_control:
            assert (np.abs(command.effort) <= limits.effort).all()
            reach = dt * arm.scheme.bounds.effort_rate
            assert (np.abs(command.effort - before.effort) <= reach + GUARD_ROUNDING).all()
            continue
        assert (command.q <= limits.upper).all()
        assert (command.q >= limits.lower).all()
        assert (np.abs(command.dq) <= limits.velocity).all()
        assert (np.abs(command.q - before.q) <= dt * limits.velocity + GUARD_ROUNDING).all()
    assert (arm.mode, arm.fault) == (Mode.HOLDING, "")


@pytest.mark.parametrize(("asked", "allowed"), [(0.3, 0.2), (0.2, 0.2), (0.1, 0.1)])
def test_an_arm_beyond_its_limit_may_stay_there_and_come_back_but_not_go_on(asked, allowed):
    edge, elbow = UR5.limits.upper[2], np.eye(6)[2]
    outside = HOME * (1 - elbow) + (edge + 0.2) * elbow
    arm = Driver(clik(limited=True, q=outside), q=outside)
    alter(arm, lambda _: JointCommand(outside + (asked - 0.2) * elbow, STILL))
    assert arm.step().q[2] == pytest.approx(edge + allowed, rel=RELATIVE)


# --- the pace -----------------------------------------------------------------------------
def update(pace, now, q, dq, sigma=1.0):
    """Look at an arm whose Jacobian has the smallest singular value sigma."""
    assert LOOK < 0.01
    pace.update(0.01, now, q, dq, np.diag([1.0, 1.0, 1.0, 1.0, 1.0, sigma]))


def passed(pace, sigmas):
    found = []
    for sigma in sigmas:
        update(pace, 1.0, STILL, STILL, sigma)
        found.append((pace.singularity, pace.wanted))
    return found


def test_a_singularity_is_approached_and_left_at_a_pace_as_its_distance_out_twice_as_fast():
    sigmas = [0.2, 0.06, 0.045, 0.03, 0.011, 0.001, 0.0, 0.01, 0.02, 0.04, 0.06]
    near, paces = zip(*passed(Pace(None, 0.05), sigmas), strict=True)
    c, a, i, leaving = Nearness
    assert near == (c, c, a, a, i, i, i, i, leaving, leaving, c)
    np.testing.assert_allclose(paces, [1, 1, 0.9, 0.6, 0.22, LEAST, LEAST, 0.2, 0.8, 1, 1])
    # a threshold of 0 slows nothing down
    assert set(passed(Pace(None, 0.0), [0.01, 0.0, 0.001])) == {(c, 1.0)}


@pytest.mark.parametrize("side", [1, -1])
def test_a_joint_slows_the_motion_down_as_it_comes_near_its_limit(side):
    limits = JointLimits(-np.ones(6), np.ones(6), np.full(6, 3.0), np.full(6, 1.0))
    third, distance, pace = side * np.eye(6)[2], 0.02, Pace(limits, 0.0)
    update(pace, 1.0, (1 - distance) * third, 1.0 * third)
    assert (pace.limit, pace.joint) == (Nearness.APPROACHING, 2)
    for _ in range(3):  # the joint goes as fast as the pace says
        assert pace.wanted == pytest.approx(POSITION_RATE * distance)
        update(pace, pace.wanted, (1 - distance) * third, pace.wanted * third)
    for place, speed, limit in (
        (0.995, 1.0, Nearness.INSIDE),
        (0.95, -0.5, Nearness.LEAVING),
        (0.5, -0.5, Nearness.CLEAR),
    ):
        update(pace, 1.0, place * third, speed * third)
        assert pace.limit is limit


# --- a law that fails ---------------------------------------------------------------------
@each_law
def test_after_a_defect_in_the_law_the_arm_is_held_and_the_place_told(scheme):
    arm = on_its_way(scheme(limited=True))
    arm.scheme.tick = raises()
    command = arm.step()
    expected = r"internal error ZeroDivisionError: of all things \(test_supervision.py:\d+\)"
    assert re.fullmatch(expected, arm.fault)
    assert "report" in arm.why.remedy
    if command.q is not None:
        np.testing.assert_allclose(command.dq, 0, atol=HELD)
    else:
        np.testing.assert_allclose(command.effort, weight(arm.q), atol=20.0)  # not let go


def test_after_a_singularity_the_arm_is_held_until_the_next_reference():
    arm = on_its_way(clik(limited=True))
    arm.scheme.tick = raises(SingularityError)
    arm.step()
    del arm.scheme.tick  # the law has an answer again
    for _ in range(600):
        arm.step()
        assert arm.fault == "of all things"
    assert not arm.dq.any()
    arm.go(arm.here)
    arm.step()
    assert (arm.mode, arm.fault) == (Mode.FOLLOWING, "")


def test_a_reference_that_leaps_in_the_tick_that_stops_the_arm_stops_it_no_second_time():
    arm = on_its_way(clik(limited=True))
    here = arm.here
    arm.go(moved(0.3))
    arm.follow(SetPoint(here, 0.1), arm.t + 600 * MS, arm.now)  # where it is not then
    arm.run(0.599)
    arm.scheme.tick = raises(SingularityError)
    arm.step()
    del arm.scheme.tick
    arm.run(1.0)
    arm.aim(arm.here, arm.now)
    arm.step()
    assert (arm.mode, arm.fault) == (Mode.FOLLOWING, "")


def test_a_law_that_cannot_even_hold_has_a_defect_and_gravity_is_compensated():
    arm = on_its_way(dynamic_control())
    arm.scheme.hold = arm.scheme.tick = raises(SingularityError)
    np.testing.assert_allclose(arm.step().effort, weight(arm.q), atol=20.0)
    assert arm.why.cause is Cause.DEFECT


def test_a_law_that_is_never_finite_leaves_the_arm_to_its_brakes_after_it_let_go():
    arm = on_its_way(dynamic_control())
    hold = arm.scheme.hold

    def never_finite(command):
        return command._replace(effort=command.effort * math.nan)

    alter(arm, never_finite)
    arm.scheme.hold = lambda *a: never_finite(hold(*a))
    lets_go(arm, STILL)
    assert "non-finite effort" in arm.fault
    assert arm.run(0.05) == [None] * 50


def test_gravity_compensation_that_is_not_finite_is_a_fault_and_no_effort_follows_it():
    arm = on_its_way(dynamic_control())
    good = arm.scheme.last_command
    arm.scheme.last_command = lambda *_: JointCommand(effort=np.full(6, math.nan))
    assert arm.step(dq=1.6 * V) is None  # it runs away
    assert (arm.mode, arm.why.cause) == (Mode.RELEASING, Cause.UNSAFE_COMMAND)
    arm.scheme.last_command = good
    assert arm.step(q=arm.q + DT * 1.6 * V) is None


def test_a_restart_that_fails_is_a_restart_again_at_the_next_state():
    arm = on_its_way(clik(limited=True))
    by_hand, reset, resets = arm.q + 0.5, arm.scheme.reset, arm.resets
    arm.scheme.reset = raises()
    with pytest.raises(ZeroDivisionError) as planted:
        arm.step(10.0, q=by_hand)
    arm.fail_for_good(planted.value)
    arm.scheme.reset = reset
    command = arm.step(q=by_hand)
    assert arm.resets == resets + 2
    if command is not None:
        np.testing.assert_allclose(command.q, by_hand, atol=HELD)
    assert arm.why.cause is Cause.DEFECT


def test_after_a_silence_of_its_own_a_controller_begins_where_the_arm_is_then():
    arm = on_its_way(clik(limited=True))
    tick, hold = arm.scheme.tick, arm.scheme.hold
    arm.scheme.tick = arm.scheme.hold = raises()
    assert arm.run(0.15, dq=STILL) == [None] * 150
    arm.scheme.tick, arm.scheme.hold = tick, hold
    braked = arm.q - 0.02
    command = arm.step(q=braked)
    np.testing.assert_allclose(command.q, braked, atol=HELD)
    assert not command.dq.any()


# --- states that are not believed ---------------------------------------------------------
def test_a_state_that_repeats_itself_for_too_long_gets_no_more_commands():
    arm = on_its_way(clik(limited=True))
    arm.obeys = False
    assert np.abs(arm.step().dq).max() > 0.01
    assert arm.step(0.9 * TIMEOUT, stamps=0.0) is None
    assert arm.fault == ""
    assert arm.step(1.1 * TIMEOUT, stamps=0.0) is None
    assert "repeats itself" in arm.fault
    np.testing.assert_allclose(arm.step(stamps=0.2, dq=STILL).dq, 0, atol=HELD)  # new ones come
    assert arm.fault


def test_a_position_at_rest_is_repeated_as_long_as_its_state_is_but_no_effort():
    arm = Driver(clik(limited=True))
    first = arm.step()
    assert arm.step(10.0, stamps=0.0) is first
    assert arm.fault == ""
    arm = Driver(dynamic_control())
    assert arm.step() is not None
    assert arm.step(0.01, stamps=0.0) is None
    assert arm.fault == ""  # it may have come twice
    assert arm.step(10.0, stamps=0.0) is None
    assert "repeats itself" in arm.fault


def test_positions_that_stay_while_speeds_are_reported_are_not_believed():
    arm = on_its_way(dynamic_control())
    faults = []
    for _ in range(50):
        arm.step(dq=np.full(6, 0.5))
        faults.append(bool(arm.fault))
    assert 15 <= faults.index(True) <= 25  # 0.01 rad at 0.5 rad/s
    assert "stay the same to the bit" in arm.fault
    assert None in arm.run(0.2)
    assert arm.step(q=arm.q + 1e-6) is not None  # held then
    assert arm.fault


def test_states_that_stay_late_are_taken_again_after_a_second_but_never_under_efforts():
    arm = on_its_way(clik(limited=True))
    taken = []
    for step in range(1, 1200):
        try:
            arm.step(dq=STILL, late=0.08)
            taken.append(step)
        except InvalidMessageError:
            pass
    assert taken[0] == pytest.approx(1000, abs=90)
    assert taken == list(range(taken[0], 1200))
    assert arm.resets == 1  # it holds: the motion is over
    arm = on_its_way(dynamic_control())
    for _ in range(3000):
        with pytest.raises(InvalidMessageError, match="deactivate and activate"):
            arm.step(late=0.08)


@each_law
def test_after_an_outage_what_was_under_way_is_refused(scheme):
    arm = on_its_way(scheme())
    for after, late in ((DT, 1.5), (0.5, 1.0)):
        with pytest.raises(InvalidMessageError, match="later than the best one"):
            arm.step(after, late=late)
    assert arm.step(1.002, dq=STILL) is not None
    assert arm.resets == 1


@each_law
def test_a_second_publisher_of_states_with_a_clock_of_its_own_moves_nothing(scheme):
    arm = on_its_way(scheme())
    controller, q, commands = arm.controller, arm.q, []
    for step in range(1, 400):
        now, t = arm.now + step * DT, arm.t + step * MS
        commands.append(controller.step(t, q, STILL, now))
        if step % 20 == 0:  # another arm, of another day
            commands.append(controller.step(t + 10**18, q + 0.3, STILL, now))
    assert set(commands[25:]) == {None}


def test_a_simulation_that_begins_anew_is_believed_when_it_goes_on_steadily():
    arm = on_its_way(clik(limited=True))
    arm.step(stamps=(MS - arm.t) / 1e9, q=HOME + 0.2, dq=STILL)
    answers = [arm.commands[-1], *arm.run(0.3)]
    assert answers[0] is None
    np.testing.assert_allclose(answers[-1].q, HOME + 0.2, atol=HELD)
    assert answers.count(None) <= 1000 * TIMEOUT + 1


def test_an_arm_at_rest_with_noisy_speeds_and_coarse_encoders_is_believed():
    arm, random = Driver(dynamic_control()), generator(602)
    for _ in range(10_000):
        assert arm.step(dq=random.normal(0, 3e-3, 6)) is not None
    assert arm.fault == ""


# --- an arm that runs away ----------------------------------------------------------------
def lets_go(arm, dq, steps=200):
    """Assert that the efforts of an arm at dq come to gravity compensation, and then end."""
    before = None
    for _ in range(steps):
        command = arm.step(q=arm.q + DT * dq, dq=dq)
        assert arm.fault
        if command is None:
            gravity = arm.scheme.last_command(arm.q, dq).effort
            np.testing.assert_allclose(before, gravity, atol=2.0)
            return
        if before is not None:
            assert (np.abs(command.effort - before) <= most_step(arm)).all()
        before = command.effort
    raise AssertionError("it goes on to command")


def released():
    """Return an arm that ran away and rests."""
    arm = on_its_way(dynamic_control())
    lets_go(arm, 1.6 * V)
    assert "wrist_1_joint at 5.12 rad/s" in arm.fault
    random, q, modes = generator(603), arm.q, []
    for k in range(400):
        q = q + (k == 150) * 3e-3  # it moves once more
        noisy = {"q": q + random.normal(0, 1e-4, 6), "dq": random.normal(0, 0.01, 6)}
        assert arm.step(**noisy) is None
        modes.append(arm.mode)
    assert (modes[300], modes[-1]) == (Mode.RELEASING, Mode.STOPPED)
    arm.step(q=q, dq=STILL)
    return arm


def test_an_arm_that_runs_away_while_it_is_held_gets_no_efforts_until_it_is_resumed():
    arm = on_its_way(clik(limited=True))
    arm.halt()
    assert arm.step(dq=1.6 * V) is not None  # it takes positions
    arm = on_its_way(dynamic_control(), real=False)
    for _ in range(100):  # in lock-step the robot does not go on without a command
        command = arm.step(q=arm.q + DT * 1.6 * V, dq=1.6 * V)
    assert "runs away" in arm.fault
    np.testing.assert_allclose(command.effort, weight(arm.q), atol=2.0)
    arm = on_its_way(dynamic_control())
    arm.halt()
    assert arm.step(dq=0.9 * V) is not None  # its efforts stop it
    lets_go(arm, 1.6 * V)
    assert "runs away" in arm.fault


def test_an_arm_that_still_moves_long_after_it_was_stopped_gets_no_efforts():
    """A loop that is late swings instead of coming to rest."""
    arm = on_its_way(dynamic_control())
    arm.halt()
    commands = []
    for step in range(1, 700):
        dq = np.full(6, 2.5 * math.cos(step / 20))
        commands.append(arm.step(q=arm.q + DT * dq, dq=dq) is not None)
    assert all(commands[:499])
    assert not any(commands[600:])
    assert "runs away" in arm.fault


def test_a_reference_that_comes_right_after_the_resume_of_a_released_arm_is_followed():
    arm = released()
    arm.resume()
    arm.go(arm.here)
    effort = arm.step().effort
    assert arm.mode is Mode.FOLLOWING
    np.testing.assert_allclose(effort, weight(arm.q), atol=2.0)


@pytest.mark.parametrize("silence", [0.02, 0.08, 0.5])  # [s], below and above state_timeout
def test_after_the_resume_of_a_released_arm_that_sags_in_a_silence_no_effort_jumps(silence):
    arm = released()
    arm.resume()
    before, sag = arm.here, min(5.0 * silence**2, 0.2) * np.eye(6)[1]
    efforts = [arm.step(silence, q=arm.q + sag).effort]
    efforts += [command.effort for command in arm.run(0.1)]
    # a late tick counts as three at most
    assert (np.abs(efforts[0] - weight(arm.q)) <= 3 * most_step(arm)).all()
    assert (np.abs(np.diff(efforts, axis=0)) <= most_step(arm)).all()
    held = arm.here if silence > TIMEOUT else before
    np.testing.assert_allclose(arm.guidance.motion.last.p_d, held.p_d, atol=HELD)
    assert arm.mode is Mode.HOLDING


# --- what leads out of a stop -------------------------------------------------------------
def asks(arm):
    """Yield what asks for a motion, each kind of reference at rest where the arm is."""
    here, now = arm.here, arm.receipt
    yield lambda: arm.follow(SetPoint(here, 0.1), None, now)
    yield lambda: arm.follow(way_points([2.0], [(here.p_d, here.R_d)]), None, now)
    yield lambda: arm.aim(here, now)
    yield lambda: arm.jog(np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]), now)


def refuses_all(arm, text):
    for ask in asks(arm):
        with pytest.raises(InvalidMessageError, match=text):
            ask()


@pytest.mark.parametrize("duration", [0.0, 0.02, 0.6, 1.6])
def test_a_stream_has_to_pause_after_a_fault_by_the_clock_that_goes_on(duration):
    arm = on_its_way(clik(limited=True))
    now, here = arm.now, arm.here
    motion = SetPoint(here, 0.1) if not duration else way_points([duration], [(here.p_d, here.R_d)])
    arm.follow(motion, None, now - 0.02)
    change_under_the_same_stamp(arm)
    for step in range(100):  # no states come meanwhile
        with pytest.raises(InvalidMessageError, match="send nothing for"):
            arm.follow(motion, None, now + 0.02 * step)
    arm.follow(motion, None, now + 0.02 * 99 + 0.51)
    assert arm.fault == ""


@pytest.mark.parametrize("faults", [(), (0,), (1,), (0, 1)])
@each_law
def test_only_a_resume_leads_out_of_a_halt_also_if_faults_come_before_or_after_it(scheme, faults):
    arm = on_its_way(scheme())
    for when in (0, 1):
        if when in faults:
            change_under_the_same_stamp(arm)
        if when == 0:
            arm.halt()
    for seconds in (0.1, 0.7):  # soon, and after a pause
        arm.run(seconds, dq=STILL)
        refuses_all(arm, "call ~/resume")
    assert arm.mode is Mode.STOPPED
    arm.resume()
    assert (arm.mode, arm.fault) == (Mode.HOLDING, "")
    refuses_all(arm, "send nothing for 0.5 s")  # it came while the arm was held, and has to pause
    before, q = arm.commands[-1], arm.q
    command = arm.step()
    if command.q is not None:
        np.testing.assert_allclose(command.q, q, atol=HELD)
    else:
        assert (np.abs(command.effort - before.effort) <= most_step(arm)).all()
    arm.run(0.3)
    refuses_all(arm, "send nothing for 0.5 s")
    arm.run(0.51)
    for ask in asks(arm):
        ask()
        assert arm.mode is Mode.FOLLOWING


def test_a_fault_is_resumed_at_once_but_not_while_the_arm_moves():
    arm = on_its_way(dynamic_control())
    change_under_the_same_stamp(arm)
    arm.step(dq=STILL + 0.1)
    with pytest.raises(InvalidMessageError, match="ask when it is at rest"):
        arm.resume()
    assert arm.why.cause is Cause.STAMP_STUCK
    arm.step(dq=STILL)
    arm.resume()
    assert arm.mode is Mode.HOLDING


def test_neither_a_reference_nor_a_resume_leads_out_of_a_runaway_or_a_defect():
    runaway, broken = on_its_way(dynamic_control()), on_its_way(clik(limited=True))
    runaway.step(dq=1.6 * V)
    broken.scheme.tick = raises()
    broken.step()
    del broken.scheme.tick
    broken.step(1.0, dq=STILL)
    for arm, text, cause in (
        (runaway, "runs away", Cause.RUNAWAY),
        (broken, "deactivate and activate", Cause.DEFECT),
    ):
        refuses_all(arm, text)
        with pytest.raises(InvalidMessageError, match=text):
            arm.resume()
        assert arm.why.cause is cause


def test_a_slow_joint_that_was_to_stop_does_not_run_away_below_a_tenth_of_a_rad_per_second():
    robot = robot_of("ur5")
    robot.limits = replace(robot.limits, velocity=np.full(6, 0.1))
    arm = Driver(dynamic_control(robot=robot))
    arm.halt()
    for speed, mode in ((0.09, Mode.STOPPED), (0.11, Mode.RELEASING)):
        arm.run(0.6)
        arm.step(dq=np.full(6, speed))
        assert arm.mode is mode


def test_what_pushes_an_arm_that_was_to_stop_knows_no_limit_of_its_motion():
    arm = Driver(dynamic_control(velocity_scale=0.2))
    arm.halt()
    for speed, mode in ((0.4, Mode.STOPPED), (0.6, Mode.RELEASING)):
        arm.run(0.6)
        arm.step(dq=speed * V)
        assert arm.mode is mode


@pytest.mark.parametrize(
    ("v", "a", "omega"), [(10.0, 0.0, 0.0), (10.0, -200.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 63.0)]
)
def test_a_set_point_whose_twist_leads_far_away_is_refused_wherever_it_ends(v, a, omega):
    x = np.eye(3)[0]
    leads = pose_of(HOME)._replace(dp_d=v * x, ddp_d=a * x, omega_d=omega * x)
    with pytest.raises(InvalidMessageError, match="twist of the set-point leads"):
        Driver(clik(limited=True)).follow(SetPoint(leads, 0.1), None)


# --- the table of modes, and what each keeps ----------------------------------------------
def rows(table):
    """Return the words of each row of a table; several blanks are between the columns."""
    return [re.split(r"  +", line.strip()) for line in table.strip().split("\n")]


HEAD, *ROWS = rows("""
event      waiting    holding      following    stopped      releasing    distrusting
REFERENCE  following  following    following    following    following    distrusting
RESTART    waiting    holding      holding      stopped      releasing    distrusting
DISTRUST   waiting    distrusting  distrusting  distrusting  distrusting  distrusting
TRUST      waiting    holding      following    stopped      releasing    holding
FAULT      waiting    stopped      stopped      stopped      releasing    distrusting
DEFECT     waiting    stopped      stopped      stopped      releasing    distrusting
HALT       waiting    stopped      stopped      stopped      releasing    distrusting
END        waiting    stopped      stopped      stopped      releasing    distrusting
RESUME     waiting    holding      following    holding      releasing    distrusting
RUNS_AWAY  waiting    releasing    releasing    releasing    releasing    distrusting
FROZEN     waiting    releasing    releasing    releasing    releasing    distrusting
RECOVERED  waiting    holding      following    stopped      stopped      distrusting
""")
FAULT = Why(Cause.NOT_FOLLOWING, "the arm is blocked", "free it", at=3.0)
WHYS = {
    "FAULT": FAULT,
    "OTHER": Why(Cause.STAMP_STUCK, "the stamp stays", "see to it", at=5.0),
    "DEFECT": Why(Cause.DEFECT, "internal error", "report it", at=4.0),
    "RUNS_AWAY": Why(Cause.RUNAWAY, "it runs away", "see to it", at=4.0),
    "FROZEN": Why(Cause.FROZEN_ENCODER, "it stays", "see to it", at=4.0),
    "HALT": HALTED._replace(at=6.0),
    "END": DEACTIVATED,
}


def test_each_event_leads_from_each_mode_to_the_one_of_the_table():
    found = {
        (mode, event): TRANSITIONS[mode].get(event, mode) for mode in Mode for event in ModeEvent
    }
    assert found == {
        (Mode(mode), ModeEvent[event]): Mode(after)
        for event, *row in ROWS
        for mode, after in zip(HEAD[1:], row, strict=True)
    }
    assert TRANSITIONS.keys() == set(Mode)


@pytest.mark.parametrize(
    ("events", "mode", "cause", "at", "remedy"),
    rows(
        """
FAULT OTHER                  stopped    stamp_stuck    3  see to it
FAULT HALT                   stopped    not_following  3  free it; call ~/resume
FAULT RESTART                stopped    not_following  3  free it
FAULT REFERENCE              following  -              0  -
HALT                         stopped    halt           6  call ~/resume
HALT FAULT                   stopped    not_following  6  free it; call ~/resume
END                          stopped    deactivated    0  activate to start again
END DEFECT                   stopped    defect         0  report it
DEFECT OTHER                 stopped    defect         4  report it
DEFECT RUNS_AWAY             releasing  defect         4  report it
DEFECT HALT                  stopped    defect         4  report it
RUNS_AWAY                    releasing  runaway        4  see to it; call ~/resume
RUNS_AWAY RECOVERED          stopped    runaway        4  see to it; call ~/resume
FROZEN RECOVERED             stopped    frozen_encoder 4  see to it
""".replace("encoder 4", "encoder  4")
    ),
)
def test_what_a_mode_keeps_of_what_has_led_to_it(events, mode, cause, at, remedy):
    state = ModeState(Mode.HOLDING)
    for word in events.split():
        event = ModeEvent["FAULT" if word == "OTHER" else word]
        state = state.after(event, WHYS.get(word, Why()))
    expected = mode, cause.strip("-"), float(at), remedy.strip("-")
    assert (state.mode, state.why.cause, state.why.at, state.remedy) == expected
    assert state.is_halted is (mode != "following")


STOPS = {
    ModeEvent.FAULT: Latch.PAUSE,
    ModeEvent.RUNS_AWAY: Latch.RESUME,
    ModeEvent.FROZEN: Latch.PAUSE,
    ModeEvent.HALT: Latch.RESUME,
    ModeEvent.DEFECT: Latch.NEVER,
    ModeEvent.END: Latch.NEVER,
}


@pytest.mark.parametrize(
    "start", [ModeState(mode) for mode in (Mode.HOLDING, Mode.WAITING)]
    + [ModeState(Mode.HOLDING).distrusted(7.0)],
)  # fmt: skip
def test_of_two_stops_the_one_that_is_harder_to_leave_counts(start):
    for first, second in itertools.product(STOPS, repeat=2):
        mode = start.after(first, FAULT).after(second, FAULT)
        ran_away = ModeEvent.RUNS_AWAY in (first, second) and start.mode is Mode.HOLDING
        mode = mode.after(ModeEvent.RESTART, WHYS["OTHER"])
        assert not ran_away or mode.is_runaway  # it has to come to rest
        mode = mode.after(ModeEvent.RECOVERED, Why())
        latch = max(STOPS[first], STOPS[second])
        assert mode.latch is latch, (first, second)
        mode = mode.after(ModeEvent.TRUST, Why()).after(ModeEvent.RECOVERED, Why())
        assert not ran_away or mode.after(ModeEvent.FAULT, FAULT).ran_away
        left = mode.after(ModeEvent.RESUME, Why())
        assert left.latch is (Latch.NEVER if latch is Latch.NEVER else Latch.NONE)
