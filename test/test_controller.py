"""The controller: stamps, references, faults; no command is ever other than finite."""

import math
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, clik, dynamic_control
from arms import pose_of as tip_pose
from samples import about, by_angles, generator, near_pole, poles, rodrigues, uniform
from tolerances import ALGEBRAIC, GUARD_ROUNDING, HELD, RELATIVE, assert_close

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.clik import FEEDBACKS
from eulerparams_control.laws.orientation import ORIENTATIONS, SEQUENCES, SIGNS
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.references import Goal, SetPoint
from eulerparams_control.motion.trajectories import Trajectory, way_points

MS = 1_000_000  # [ns]
T_0 = 1_700_000_000_000_000_000  # [ns]
LIMITS = MotionLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0)
ANY_JUMP = ControllerOptions(max_jump_position=math.inf, max_jump_rotation=math.inf)

pose_of = partial(tip_pose, UR5)


def controller(options=None, q=HOME, **scheme):
    """Return a controller of CLIK that begins at q."""
    return Controller(clik(**scheme), options or ControllerOptions(), q)


def moved(x=0.0, angle=0.0):
    """Return home's pose moved along and turned about the base's x."""
    home = pose_of(HOME)
    return DesiredFrame(home.p_d + x * np.eye(3)[0], about(0, angle) @ home.R_d)


def moving_controller(*chosen, **options):
    """Return a controller on its way, its last command and the stamp of it."""
    running = controller(*chosen, **options)
    goal = moved(0.1, 0.5)
    running.follow(way_points([1.0], [(goal.p_d, goal.R_d)]), None)
    for step in range(300):
        t = T_0 + step * MS
        command = running.step(t, HOME, STILL)
    assert np.abs(command.dq).max() > 0.05
    return running, command, t


def is_finite(command):
    given = [values for values in command if values is not None]
    return len(given) > 0 and all(np.isfinite(values).all() for values in given)


def assert_holds(running, t, q):
    """Assert that the controller commands q at rest from t on."""
    for step in range(3):
        command = running.step(t + step * MS, q, STILL)
        assert_close(command.q, q, HELD)
        assert_close(command.dq, 0, 100 * HELD)


# --- stamps -------------------------------------------------------------------------------
def test_a_stamp_that_is_repeated_gets_the_identical_command_and_integrates_nothing():
    running, command, t = moving_controller()
    assert running.step(t, HOME, STILL) is command
    twin, _, _ = moving_controller()
    after, expected = (one.step(t + MS, HOME, STILL) for one in (running, twin))
    np.testing.assert_array_equal(after.q, expected.q)
    np.testing.assert_array_equal(after.dq, expected.dq)
    assert running.resets == 0


@pytest.mark.parametrize(("dq", "dx"), [(0.0, 0.01), (0.1, 0.0)])
def test_a_state_that_changes_under_the_same_stamp_gets_no_command_and_stops_the_arm(dq, dx):
    running, _, t = moving_controller()
    assert running.step(t, HOME + dx, STILL + dq) is None
    assert "stamp stays" in running.fault
    command = running.step(t + MS, HOME, STILL)
    np.testing.assert_array_equal(command.dq, STILL)
    assert running.fault


@pytest.mark.parametrize("back", [1, MS, 100 * MS - 1])
def test_a_state_that_is_older_than_the_last_one_is_refused(back):
    running, _, t = moving_controller()
    twin, _, _ = moving_controller()
    with pytest.raises(InvalidMessageError, match="the stamp goes back by"):
        running.step(t - back, HOME + 0.02, STILL)
    after, expected = (one.step(t + MS, HOME, STILL) for one in (running, twin))
    np.testing.assert_array_equal(after.q, expected.q)
    assert running.resets == 0


def test_a_state_that_the_arm_cannot_have_reached_is_refused_while_limits_are_on():
    fast, far = 10.0 * np.eye(6)[2], 0.2 * np.eye(6)[0]
    for check, q, dq, text in (
        (True, HOME, fast, "elbow_joint moves at 10 rad/s, more than 3 times its limit"),
        (True, HOME + far, STILL, "shoulder_pan_joint jumps by 0.2 rad within 0.001 s"),
        (False, HOME + far, fast, ""),
    ):
        running = controller(ControllerOptions(check_states=check))
        before = running.step(T_0, HOME, STILL)
        if not text:
            assert running.step(T_0 + MS, q, dq) is not None
            continue
        with pytest.raises(InvalidMessageError, match=text):
            running.step(T_0 + MS, q, dq)
        assert_close(running.step(T_0 + 2 * MS, HOME, STILL).q, before.q, HELD)


@pytest.mark.parametrize("jump", [-5000 * MS, 100 * MS + 1, 60_000 * MS], ids="{} ns".format)
@pytest.mark.parametrize("feedback", FEEDBACKS)
def test_after_a_jump_of_the_stamp_nothing_is_integrated_and_the_measured_pose_held(jump, feedback):
    running, _, t = moving_controller(feedback=feedback)
    measured = HOME + 0.02
    command = running.step(t + jump, measured, STILL)
    assert running.resets == 1
    np.testing.assert_array_equal(command.q, measured)
    assert_close(command.dq, 0, 100 * HELD)
    assert_holds(running, t + jump + MS, measured)
    assert running.resets == 1


def move_in_all_ways(scheme):
    """Let an arm follow each kind of reference, while it is an error to compile anything."""
    options = ControllerOptions(motion=LIMITS)
    running, dp, t = Controller(scheme, options, HOME), np.array([0.05, 0.0, 0.0]), T_0
    goal = moved(0.05, 0.3)

    def go_on(steps):
        nonlocal t
        for _ in range(steps):
            t += MS
            running.step(t, HOME, STILL)

    with patch("numba.core.dispatcher.Dispatcher.compile", side_effect=AssertionError):
        go_on(3)
        for seconds in (0.1, 1.0):  # too fast, then within the limits, which join on the way
            running.follow(way_points([seconds], [(goal.p_d, goal.R_d)]), None)
            go_on(100)
        for dp_d in (dp, 0 * dp):
            for n in range(20):
                there = running.guidance.motion.last
                frame = DesiredFrame(there.p_d + 0.005 * n * dp, there.R_d, dp_d)
                running.follow(SetPoint(frame, 0.1), None)
                go_on(5)
        running.aim(goal)
        go_on(200)
        running.jog(np.array([*dp, 0.0, 0.2, 0.0]))
        go_on(100)
        running.changed(replace(options, motion=replace(options.motion, linear_speed=0.05)))
        running.changed(replace(options, speed_override=0.5))
        go_on(100)
        assert not running.guidance.motion.is_at_rest
        assert running.fault == ""
        running.halt()
        go_on(300)
    assert running.mode is Mode.STOPPED


def test_nothing_is_compiled_while_an_arm_moves():
    code = "from test_controller import *; move_in_all_ways(clik())"
    code += "; move_in_all_ways(dynamic_control(limited=False))"
    subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, check=True)


@pytest.mark.parametrize("way", [(0.4, 0.4, 0.4), (0.0, 0.0, 0.8)])
def test_a_goal_out_of_reach_is_gone_to_without_swinging(way):
    options = {"shape_motion": True, "max_joint_acceleration": (10.0,)}
    scheme = clik(limited=True, k_Po=200.0, **options)
    running, home = Controller(scheme, ControllerOptions(motion=LIMITS), HOME), pose_of(HOME)
    running.aim(home._replace(p_d=home.p_d + way))
    command, v = JointCommand(HOME, STILL), np.zeros(3)
    for step in range(1500):
        command = running.step(T_0 + 4 * step * MS, command.q, command.dq)
        before, v = v, (UR5.state(command.q, command.dq).J @ command.dq)[:3]
        speed = np.linalg.norm(v)
        assert speed <= 1.05 * LIMITS.linear_speed
        assert np.linalg.norm(v - before) <= 1.05 * LIMITS.linear_acceleration * 4e-3
    assert np.linalg.norm(pose_of(command.q).p_d - home.p_d) > 0.3
    assert speed < 0.02
    assert running.fault == ""


def slower(limits, **others):
    return replace(limits, velocity=0.02 * limits.velocity, **others)


def test_an_arm_under_efforts_whose_speed_limits_are_lowered_does_not_run_away():
    plant, scheme, goal = Plant(), dynamic_control(), moved(0.2)
    running = Controller(scheme, ControllerOptions(), HOME)
    running.follow(way_points([1.5], [(goal.p_d, goal.R_d)]), None)
    speeds = []
    for step in range(2000):
        if step == 600:
            low = slower(scheme.limits, acceleration=np.full(6, 10.0))
            scheme.bound(low)
            running.changed(ControllerOptions())
            assert np.abs(plant.dq).max() > 2 * 1.5 * low.velocity.max()
        plant.step(running.step(T_0 + step * MS, plant.q, plant.dq).effort)
        speeds.append(np.abs(plant.dq))
    assert running.fault == ""
    assert (np.array(speeds[1600:]) <= 1.05 * low.velocity).all()
    assert np.abs(plant.dq).max() > 0.01
    plant.dq[0] = 1.0  # now it does
    for step in range(2000, 2003):
        running.step(T_0 + step * MS, plant.q, plant.dq)
    assert "runs away" in running.fault


@pytest.mark.parametrize("dt", [1, 2, 10])
def test_speed_limits_that_are_lowered_in_motion_are_come_to_within_the_accelerations(dt):
    options, accelerations = ControllerOptions(motion=LIMITS), {"max_joint_acceleration": (10.0,)}
    running = controller(options, limited=True, **accelerations)
    commands = [JointCommand(HOME, STILL)]
    goal = moved(0.2)
    running.follow(way_points([1.5], [(goal.p_d, goal.R_d)]), None)
    for step in range(1800 // dt):
        if step == 700 // dt:
            running.scheme.bound(slower(running.scheme.limits))
            running.changed(options)
            assert np.abs(commands[-1].dq).max() > 0.1
        last = commands[-1]
        commands.append(running.step(T_0 + step * dt * MS, last.q, last.dq))
    q, dq = (np.array([getattr(one, name) for one in commands]) for name in ("q", "dq"))
    most = 10.0 * dt / 1000 * (1 + RELATIVE) + GUARD_ROUNDING
    assert np.abs(np.diff(dq, axis=0)).max() <= most
    assert np.abs(np.diff(q, 2, axis=0)).max() <= most * dt / 1000 + GUARD_ROUNDING
    steps = np.linalg.norm(np.diff(UR5.states(q, dq).dp_e, axis=0), axis=1)
    assert steps.max() <= 1.05 * dt / 1000
    assert (np.abs(dq[-1]) <= 0.02 * UR5.limits.velocity + GUARD_ROUNDING).all()
    assert np.abs(dq[-1]).max() > 0.01
    assert running.fault == ""


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e3])
def test_a_target_that_no_arm_reaches_is_refused(value):
    running = controller()
    with pytest.raises(InvalidMessageError, match="out of reach" if value == 1e3 else "target"):
        running.aim(moved(value))
    if not math.isfinite(value):
        with pytest.raises(InvalidMessageError, match="target"):
            running.jog(np.full(6, value))
        with pytest.raises(InvalidMessageError):
            running.follow(SetPoint(moved(value), 0.1), None)
    assert running.mode is Mode.HOLDING


def test_while_the_speed_override_is_0_a_reference_moves_nothing():
    running, goal = controller(ControllerOptions(motion=LIMITS, speed_override=0.0)), moved(0.1)
    running.follow(way_points([1.0], [(goal.p_d, goal.R_d)]), None)
    assert_holds(running, T_0, HOME)
    assert_holds(running, T_0 + 500 * MS, HOME)


# --- references ---------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("x", "angle"), [(0.2, 0.0), (-0.0501, 0.0), (0.0, 0.5), (0.0, -0.201), (0.5, 3.0)]
)
@pytest.mark.parametrize("as_trajectory", [False, True])
def test_a_reference_that_begins_too_far_away_is_refused_with_numbers(x, angle, as_trajectory):
    running = controller()
    running.step(T_0, HOME, STILL)
    frame = moved(x, angle)
    motion = Trajectory([0.0], [frame]) if as_trajectory else SetPoint(frame, 0.1)
    with pytest.raises(InvalidMessageError) as refusal:
        running.follow(motion, None)
    away = f"begins {abs(x):.3f} m and {math.degrees(abs(angle)):.1f} deg away"
    assert away in str(refusal.value)
    assert_holds(running, T_0 + MS, HOME)


@pytest.mark.parametrize(("x", "angle"), [(0.0499, 0.0), (0.0, 0.199), (0.04, -0.1)])
def test_a_reference_that_begins_near_is_followed_at_once(x, angle):
    running = controller()
    running.step(T_0, HOME, STILL)
    frame = moved(x, angle)
    running.follow(SetPoint(frame, 0.1), None)
    running.step(T_0 + MS, HOME, STILL)
    np.testing.assert_array_equal(running.guidance.tick_now.desired.p_d, frame.p_d)
    np.testing.assert_array_equal(running.guidance.tick_now.desired.R_d, frame.R_d)


@pytest.mark.parametrize("times", [[0.0, 2.0], [1.0, 2.0]])
def test_a_trajectory_that_started_long_ago_is_refused_where_it_has_come_far_since(times):
    running = controller()
    running.step(T_0, HOME, STILL)
    here, goal = moved(), moved(0.3, 1.0)
    late = way_points(times, [(here.p_d, here.R_d), (goal.p_d, goal.R_d)])
    with pytest.raises(InvalidMessageError, match=r"0\.300 m and 57\.3 deg"):
        running.follow(late, T_0 - 5000 * MS)
    assert_holds(running, T_0 + MS, HOME)
    for start in (T_0, T_0 - 10 * MS, T_0 + 5000 * MS):
        running.follow(late, start)


def out_of(reach, way, frame):
    """Return a frame so far from the first joint, in parts of the length of the links."""
    return frame._replace(p_d=reach.centre + way * reach.radius * np.array([0.6, 0.0, 0.8]))


@pytest.mark.parametrize(
    "motion_to",
    [
        Goal,
        lambda far: SetPoint(far, 0.1),
        lambda far: Trajectory([0.0, 2.0, 4.0], [pose_of(HOME), far, pose_of(HOME)]),
    ],
    ids=["goal", "set-point", "trajectory"],
)
def test_what_leads_beyond_the_stretched_arm_is_refused_first(motion_to):
    running = controller()
    running.step(T_0, HOME, STILL)
    for way in (1.02, math.nan):
        with pytest.raises(InvalidMessageError, match=r"out of reach|expected finite values"):
            running.follow(motion_to(out_of(UR5.reach, way, pose_of(HOME))), None)
    assert_holds(running, T_0 + MS, HOME)
    assert running.mode is Mode.HOLDING
    running = controller(ANY_JUMP)
    running.follow(motion_to(out_of(UR5.reach, 0.99, pose_of(HOME))), None)
    assert running.guidance.motion.waiting


def test_where_the_desired_frame_is_beyond_the_arm_a_reference_may_be_no_farther_out():
    guidance = controller(ANY_JUMP).guidance
    here, back, farther = (out_of(UR5.reach, way, pose_of(HOME)) for way in (1.1, 1.05, 1.15))
    for frame in (here, back):
        guidance.refuse(SetPoint(frame, 0.1), 0.0, here)
        guidance.refuse(Goal(frame), 0.0, here)
    with pytest.raises(InvalidMessageError, match=r"it is 1\.426 m .* links are 1\.240 m long"):
        guidance.refuse(SetPoint(farther, 0.1), 0.0, here)


def test_of_a_trajectory_that_is_late_only_what_is_to_come_has_to_be_within_reach():
    guidance = controller(ANY_JUMP).guidance
    here, far = pose_of(HOME), out_of(UR5.reach, 1.2, pose_of(HOME))
    motion = Trajectory([0.0, 1.0, 2.0], [here, far, here])
    guidance.refuse(motion, 1.5, here)
    with pytest.raises(InvalidMessageError, match="out of reach"):
        guidance.refuse(motion, 0.5, here)


def test_where_a_reference_is_required_there_is_silence_until_the_first():
    running, elsewhere = controller(ControllerOptions(require_reference=True)), HOME + 0.4
    for step in range(50):
        assert running.step(T_0 + step * MS, HOME, STILL) is None
    assert running.guidance.tick_now is None
    with pytest.raises(InvalidMessageError):
        running.follow(SetPoint(moved(0.2), 0.1), None)
    assert running.step(T_0 + 50 * MS, HOME, STILL) is None  # one refused is no reference
    assert running.step(T_0 + 9000 * MS, elsewhere, STILL) is None  # moved by others
    running.follow(SetPoint(pose_of(elsewhere), 0.1), None)
    assert_holds(running, T_0 + 9001 * MS, elsewhere)
    assert running.resets == 0
    running = controller(ControllerOptions(require_reference=True))
    running.step(T_0, HOME, STILL)
    running.follow(SetPoint(moved(), 0.1), None)
    assert_holds(running, T_0 + MS, elsewhere)
    assert "moved before the reference began" in running.fault


# --- faults -------------------------------------------------------------------------------
def test_an_arm_that_does_not_follow_is_held_where_it_was_measured():
    running = controller(limited=True, max_deviation=0.05)
    goal = moved(0.2, 0.8)
    running.follow(way_points([1.0], [(goal.p_d, goal.R_d)]), None)
    t = T_0
    while not running.fault:
        command = running.step(t, HOME, STILL)
        assert np.abs(command.q - HOME).max() <= 0.05
        t += MS
    assert "from its command" in running.fault
    assert t < T_0 + 1000 * MS
    # the command goes back to where the arm is, no faster than its joints may
    for _ in range(30):
        before, command = command.q, running.step(t, HOME, STILL)
        t += MS
        assert np.all(np.abs(command.q - before) <= 1e-3 * UR5.limits.velocity + GUARD_ROUNDING)
    assert_holds(running, t, HOME)


def test_an_arm_is_at_rest_when_its_joints_were_measured_to_be():
    running = controller()
    for speed, rests in ((0.0, True), (0.009, True), (0.011, False), (-0.5, False)):
        running.step(T_0 + int(1e9 * (1 + speed)), HOME, speed * np.eye(6)[3])
        assert running.is_at_rest == rests


@pytest.mark.parametrize("scheme", [clik, dynamic_control])
def test_references_that_are_refused_do_not_move_an_arm_that_is_held(scheme):
    sag = np.array([0.0, 1e-3, 1e-3, 0.0, 0.0, 0.0])  # the arm gives way a little
    held = []
    for asks in (False, True):
        running = Controller(scheme(), ControllerOptions(), HOME)
        running.step(T_0, HOME, STILL)
        running.halt()
        held.append([running.step(T_0 + MS, HOME, STILL)])
        for step in range(2, 50):
            held[-1].append(running.step(T_0 + step * MS, HOME + sag, STILL))
            if asks:
                with pytest.raises(InvalidMessageError):
                    running.follow(SetPoint(moved(0.3, 1.0), 0.1), None)
    for left, asked in zip(*held, strict=True):
        np.testing.assert_equal(asked, left)


def test_a_reference_is_compared_with_where_an_arm_that_is_held_has_come_to():
    running, _, t = moving_controller()
    running.halt()
    there, t = HOME + 0.3, t + MS  # moved by others
    running.step(t, there, STILL)
    while not running.is_at_rest:  # its commands brake
        t += MS
        running.step(t, there, STILL)
    running.resume()
    with pytest.raises(InvalidMessageError):
        running.follow(SetPoint(pose_of(HOME), 0.1), None)
    running.follow(SetPoint(pose_of(there), 0.1), None)
    assert_holds(running, t + MS, there)


@pytest.mark.parametrize("twists", [False, True])
@pytest.mark.parametrize("rate", [5, 10, 50])
def test_a_stream_that_the_tip_lags_is_not_refused(rate, twists):
    running, speed = controller(ControllerOptions(motion=LIMITS)), 0.24
    running.step(T_0, HOME, STILL)
    for step in range(1, 1500):
        if step % (1000 // rate) == 1:
            frame = moved(speed * (step - 1) / 1000)
            frame = frame._replace(dp_d=speed * np.eye(3)[0]) if twists else frame
            running.follow(SetPoint(frame, 0.1), None)
        running.step(T_0 + step * MS, HOME, STILL)
    tip = running.guidance.motion.last.p_d[0] - pose_of(HOME).p_d[0]
    assert tip > speed * (1.5 - 2 / rate - 0.15)


# --- commands are finite whatever is desired --------------------------------------------------
def garbage(sequence, key):
    """Return desired frames of any size, orientation and velocity, at and near the poles."""
    random = generator(95, key)
    home = pose_of(HOME)
    at_poles = [
        R
        for pole in poles(sequence)
        for distance in (0.0, 1e-15, 1e-9, 1e-4)
        for R in near_pole(sequence, pole, distance)[:1]
    ]
    at_poles += [by_angles(sequence, 0.0, pole, 0.0) for pole in poles(sequence)]
    half_turns = [rodrigues(math.pi, r) @ home.R_d for r in np.eye(3)]
    quarter_turns = [about(axis, math.pi / 2) @ home.R_d for axis in range(3)]
    frames = []
    for R in [*uniform(6, key), *at_poles, *half_turns, *quarter_turns, home.R_d]:
        scale = 10.0 ** random.uniform(-300, 308, size=5) * (random.uniform(size=5) < 0.4)
        values = scale[:, None] * random.uniform(-1, 1, size=(5, 3))
        frames.append(DesiredFrame(home.p_d + values[0], R, *values[1:]))
    return frames


def feed(running, motions, steps=4, dt=8 * MS):
    """Follow each motion for some steps; return the number of faults.

    The arm does what it is commanded where that is a position; an arm that is commanded by
    efforts stays where it is.
    """
    t, q, dq, faults = T_0, HOME, STILL, 0
    for motion in motions:
        with suppress(InvalidMessageError):  # what is refused is not followed
            running.follow(motion, None)
        for _ in range(steps):
            t += dt
            command = running.step(t, q, dq)
            assert is_finite(command)
            assert all(values is None or values.shape == (6,) for values in command)
            faults += bool(running.fault)
            if command.q is not None and np.abs(command.q).max() < 1e3:
                q, dq = command.q, command.dq
    return faults


ANGLES, QUATERNIONS = (
    {"euler_angles", "relative_euler_angles"},
    {"euler_parameters", "rotation_vector"},
)
FAMILIES = sorted(
    {(orientation, "XYZ", "hysteretic") for orientation in ORIENTATIONS}
    | {(orientation, sequence, "hysteretic") for orientation in ANGLES for sequence in SEQUENCES}
    | {(orientation, "XYZ", sign) for orientation in QUATERNIONS for sign in SIGNS}
)


@pytest.mark.filterwarnings("ignore:(overflow|invalid value|divide by zero):RuntimeWarning")
@pytest.mark.parametrize("family", FAMILIES, ids="-".join)
@pytest.mark.parametrize("limited", [True, False], ids=["limits", "no limits"])
def test_no_desired_frame_makes_a_command_that_is_not_finite(family, limited):
    orientation, sequence, sign = family
    options = {"euler_sequence": sequence, "quaternion_sign": sign, "limited": limited}
    schemes = [clik(orientation, feedback=feedback, **options) for feedback in FEEDBACKS]
    for key, scheme in enumerate([*schemes, dynamic_control(orientation, **options)]):
        running = Controller(scheme, ANY_JUMP, HOME)
        faults = feed(running, [SetPoint(frame, 0.02) for frame in garbage(sequence, key)])
    assert faults > 0  # of the efforts


@pytest.mark.parametrize("scheme", [partial(clik, limited=True), dynamic_control])
def test_garbage_does_not_survive_in_the_controller(scheme):
    with np.errstate(all="ignore"):
        running = Controller(scheme("euler_angles"), ANY_JUMP, HOME)
        feed(running, [SetPoint(frame, 0.02) for frame in garbage("XYZ", 3)])
    t = T_0 + 10**12
    g = UR5.dynamic_state(HOME, STILL).g
    for step in range(3):  # the stamp jumps: it restarts
        command = running.step(t + step * MS, HOME, STILL)
        if command.q is None:
            assert_close(command.effort, g, 1e3 * ALGEBRAIC)
    if command.q is not None:
        assert_holds(running, t + 3 * MS, HOME)
    running.follow(SetPoint(pose_of(HOME), 0.05), None)
    assert is_finite(running.step(t + 6 * MS, HOME, STILL))
    assert running.fault == ""
