"""The controller: stamps, references, faults; no command is ever other than finite."""

import math
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, clik, dynamic_control
from driven import CHECKED, DT, LIMITS, Driver, assert_holds, moved, pose_of
from representations import OF_ANGLES
from samples import about, by_angles, generator, near_pole, poles, rodrigues, uniform
from tolerances import ALGEBRAIC, GUARD_ROUNDING, HELD, RELATIVE, assert_close

from eulerparams_control.control.controller import ControllerOptions
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.clik import FEEDBACKS
from eulerparams_control.laws.orientation import ORIENTATIONS, SEQUENCES, SIGNS
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.references import Goal, SetPoint
from eulerparams_control.motion.trajectories import Trajectory, way_points

ANY_JUMP = ControllerOptions(max_jump_position=math.inf, max_jump_rotation=math.inf)
UNCHECKED = ControllerOptions()


def standing(options=UNCHECKED, scheme=None):
    """Return an arm that stands whatever is commanded, in simulated time."""
    return Driver(scheme or clik(), options=options, real=False, obeys=False)


def on_its_way(**options):
    """Return one whose commands move, and the last of them."""
    arm = standing(scheme=clik(**options))
    arm.go(moved(0.1, 0.5))
    command = arm.run(0.3)[-1]
    assert np.abs(command.dq).max() > 0.05
    return arm, command


def is_finite(command):
    given = [values for values in command if values is not None]
    return len(given) > 0 and all(np.isfinite(values).all() for values in given)


# --- stamps -------------------------------------------------------------------------------
def test_a_stamp_that_is_repeated_gets_the_identical_command_and_integrates_nothing():
    (arm, command), (twin, _) = on_its_way(), on_its_way()
    assert arm.step(0.0) is command
    after, expected = arm.step(), twin.step()
    np.testing.assert_array_equal(after.q, expected.q)
    np.testing.assert_array_equal(after.dq, expected.dq)
    assert arm.resets == 0


@pytest.mark.parametrize(("dq", "dx"), [(0.0, 0.01), (0.1, 0.0)])
def test_a_state_that_changes_under_the_same_stamp_gets_no_command_and_stops_the_arm(dq, dx):
    arm, _ = on_its_way()
    for _ in range(2):
        assert arm.step(0.0, q=HOME + dx, dq=STILL + dq) is None  # one may be sent twice
        assert arm.mode is Mode.FOLLOWING
    assert arm.step(q=HOME, dq=STILL).q is not None
    for _ in range(3):
        assert arm.step(0.0, q=HOME + dx, dq=STILL + dq) is None
    assert "stamp stays" in arm.fault
    np.testing.assert_array_equal(arm.step(q=HOME, dq=STILL).dq, STILL)
    assert arm.fault


@pytest.mark.parametrize("back", [1e-9, DT, 0.1 - 1e-9])
def test_a_state_that_is_older_than_the_last_one_is_refused(back):
    (arm, _), (twin, _) = on_its_way(), on_its_way()
    with pytest.raises(InvalidMessageError, match="the stamp goes back by"):
        arm.step(stamps=-back, q=HOME + 0.02)
    after, expected = arm.step(back + DT, q=HOME), twin.step()
    np.testing.assert_array_equal(after.q, expected.q)
    assert arm.resets == 0


@pytest.mark.parametrize(
    ("q", "dq", "text"),
    [
        (0.0, 10.0, "elbow_joint moves at 10 rad/s, more than 3 times its limit"),
        (0.2, 0.0, "elbow_joint jumps by 0.2 rad within 0.001 s"),
    ],
)
def test_a_state_that_the_arm_cannot_have_reached_is_refused_while_limits_are_on(q, dq, text):
    elbow, checked, unchecked = np.eye(6)[2], standing(CHECKED), standing()
    for arm in (checked, unchecked):
        arm.step()
    with pytest.raises(InvalidMessageError, match=text):
        checked.step(q=HOME + q * elbow, dq=dq * elbow)
    assert_holds(checked, HOME)
    assert unchecked.step(q=HOME + q * elbow, dq=dq * elbow) is not None


@pytest.mark.parametrize("jump", [-5.0, 0.1 + 1e-6, 60.0])
@pytest.mark.parametrize("feedback", FEEDBACKS)
def test_after_a_jump_of_the_stamp_nothing_is_integrated_and_the_measured_pose_held(jump, feedback):
    arm, _ = on_its_way(feedback=feedback)
    command = arm.step(jump, q=HOME + 0.02)
    np.testing.assert_array_equal(command.q, HOME + 0.02)
    assert_close(command.dq, 0, 100 * HELD)
    assert_holds(arm, HOME + 0.02)
    assert arm.resets == 1


# --- limits -------------------------------------------------------------------------------
@pytest.mark.parametrize("way", [(0.4, 0.4, 0.4), (0.0, 0.0, 0.8)])
def test_a_goal_out_of_reach_is_gone_to_without_swinging(way):
    scheme = clik(limited=True, k_Po=200.0, shape_motion=True, max_joint_acceleration=(10.0,))
    arm = Driver(scheme, options=ControllerOptions(motion=LIMITS), period=4e-3, real=False)
    home, v = arm.here, np.zeros(3)
    arm.aim(home._replace(p_d=home.p_d + way))
    for _ in range(1500):
        arm.step()
        before, v = v, (UR5.state(arm.q, arm.dq).J @ arm.dq)[:3]
        assert np.linalg.norm(v) <= 1.05 * LIMITS.linear_speed
        assert np.linalg.norm(v - before) <= 1.05 * LIMITS.linear_acceleration * 4e-3
    assert np.linalg.norm(arm.here.p_d - home.p_d) > 0.3
    assert np.linalg.norm(v) < 0.02
    assert arm.fault == ""


def test_elbow_and_wrists_are_no_faster_than_max_link_speed_where_the_tip_only_turns():
    fastest = []
    for most in (math.inf, 0.05):
        options = ControllerOptions(motion=LIMITS, max_link_speed=most)
        arm = Driver(clik(limited=True, shape_motion=True), options=options, real=False)
        arm.aim(moved(0.0, 0.8))
        speeds = [UR5.link_speed(c.q, c.dq) for c in arm.run(4.0)]
        fastest.append(max(speeds))
    assert fastest[0] > 0.06
    assert fastest[1] <= 0.05


def slower(limits, **others):
    return replace(limits, velocity=0.02 * limits.velocity, **others)


def test_an_arm_under_efforts_whose_speed_limits_are_lowered_does_not_run_away():
    plant, scheme = Plant(), dynamic_control()
    arm, speeds = standing(scheme=scheme), []
    arm.go(moved(0.2), seconds=1.5)
    for step in range(2000):
        if step == 600:
            low = slower(scheme.limits, acceleration=np.full(6, 10.0))
            scheme.bound(low)
            arm.changed(UNCHECKED)
            assert np.abs(plant.dq).max() > 2 * 1.5 * low.velocity.max()
        plant.step(arm.step(q=plant.q, dq=plant.dq).effort)
        speeds.append(np.abs(plant.dq))
    assert arm.fault == ""
    assert (np.array(speeds[1600:]) <= 1.05 * low.velocity).all()
    assert np.abs(plant.dq).max() > 0.01
    arm.step(q=plant.q, dq=plant.dq + np.eye(6)[0])  # now it does
    assert "runs away" in arm.fault


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.01])
def test_speed_limits_that_are_lowered_in_motion_are_come_to_within_the_accelerations(dt):
    options = ControllerOptions(motion=LIMITS)
    scheme = clik(limited=True, max_joint_acceleration=(10.0,))
    arm = Driver(scheme, options=options, period=dt, real=False)
    arm.go(moved(0.2), seconds=1.5)
    arm.run(0.7)
    scheme.bound(slower(scheme.limits))
    arm.changed(options)
    assert np.abs(arm.dq).max() > 0.1
    arm.run(1.1)
    q = np.array([HOME, *(command.q for command in arm.commands)])
    dq = np.array([STILL, *(command.dq for command in arm.commands)])
    most = 10.0 * dt * (1 + RELATIVE) + GUARD_ROUNDING
    assert np.abs(np.diff(dq, axis=0)).max() <= most
    assert np.abs(np.diff(q, 2, axis=0)).max() <= most * dt + GUARD_ROUNDING
    steps = np.linalg.norm(np.diff(UR5.states(q, dq).dp_e, axis=0), axis=1)
    assert steps.max() <= 1.05 * dt
    assert (np.abs(dq[-1]) <= 0.02 * UR5.limits.velocity + GUARD_ROUNDING).all()
    assert np.abs(dq[-1]).max() > 0.01
    assert arm.fault == ""


def test_while_the_speed_override_is_0_a_reference_moves_nothing():
    arm = standing(ControllerOptions(motion=LIMITS, speed_override=0.0))
    arm.go(moved(0.1))
    assert_holds(arm, HOME, steps=500)


# --- references ---------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("x", "angle"), [(0.2, 0.0), (-0.0501, 0.0), (0.0, 0.5), (0.0, -0.201), (0.5, 3.0)]
)
@pytest.mark.parametrize("kind", [lambda f: SetPoint(f, 0.1), lambda f: Trajectory([0.0], [f])])
def test_a_reference_that_begins_too_far_away_is_refused_with_numbers(x, angle, kind):
    arm = standing()
    arm.step()
    away = f"begins {abs(x):.3f} m and {math.degrees(abs(angle)):.1f} deg away"
    with pytest.raises(InvalidMessageError, match=away):
        arm.follow(kind(moved(x, angle)), None)
    assert_holds(arm, HOME)


@pytest.mark.parametrize(("x", "angle"), [(0.0499, 0.0), (0.0, 0.199), (0.04, -0.1)])
def test_a_reference_that_begins_near_is_followed_at_once(x, angle):
    arm, frame = standing(), moved(x, angle)
    arm.step()
    arm.follow(SetPoint(frame, 0.1), None)
    arm.step()
    np.testing.assert_array_equal(arm.guidance.tick_now.desired.p_d, frame.p_d)
    np.testing.assert_array_equal(arm.guidance.tick_now.desired.R_d, frame.R_d)


@pytest.mark.parametrize("times", [[0.0, 2.0], [1.0, 2.0]])
def test_a_trajectory_that_started_long_ago_is_refused_where_it_has_come_far_since(times):
    arm = standing()
    arm.step()
    here, goal = moved(), moved(0.3, 1.0)
    late = way_points(times, [(here.p_d, here.R_d), (goal.p_d, goal.R_d)])
    with pytest.raises(InvalidMessageError, match=r"0\.300 m and 57\.3 deg"):
        arm.follow(late, arm.t - 5 * 10**9)
    assert_holds(arm, HOME)
    for start in (0, -(10**7), 5 * 10**9):
        arm.follow(late, arm.t + start)


def out_of(way, reach=UR5.reach):
    """Return a frame so far from the first joint, in parts of the length of the links."""
    far = reach.centre + way * reach.radius * np.array([0.6, 0.48, 0.64])
    return pose_of(HOME)._replace(p_d=far)


@pytest.mark.parametrize("far", [1.02, 1e3, math.nan, math.inf])
@pytest.mark.parametrize(
    "motion_to",
    [
        Goal,
        lambda far: SetPoint(far, 0.1),
        lambda far: Trajectory([0.0, 2.0, 4.0], [pose_of(HOME), far, pose_of(HOME)]),
    ],
    ids=["goal", "set-point", "trajectory"],
)
def test_what_leads_beyond_the_stretched_arm_is_refused_first(motion_to, far):
    arm = standing()
    arm.step()
    with pytest.raises(InvalidMessageError, match=r"out of reach|expected finite values"):
        arm.follow(motion_to(out_of(far)), None)
    if not math.isfinite(far):
        with pytest.raises(InvalidMessageError, match="target"):
            arm.jog(np.full(6, far))
    assert_holds(arm, HOME)
    assert arm.mode is Mode.HOLDING
    arm = standing(ANY_JUMP)
    arm.follow(motion_to(out_of(0.99)), None)
    assert arm.mode is Mode.FOLLOWING


def test_from_beyond_the_arm_a_reference_may_lead_back_and_of_a_late_one_the_rest_is_judged():
    guidance = standing(ANY_JUMP).guidance
    here, back, farther = map(out_of, (1.1, 1.05, 1.15))
    for frame in (here, back):
        guidance.refuse(SetPoint(frame, 0.1), 0.0, here)
        guidance.refuse(Goal(frame), 0.0, here)
    with pytest.raises(InvalidMessageError, match=r"it is 1\.426 m .* links are 1\.240 m long"):
        guidance.refuse(SetPoint(farther, 0.1), 0.0, here)
    home = pose_of(HOME)
    motion = Trajectory([0.0, 1.0, 2.0], [home, farther, home])
    guidance.refuse(motion, 1.5, home)
    with pytest.raises(InvalidMessageError, match="out of reach"):
        guidance.refuse(motion, 0.5, home)


def test_where_a_reference_is_required_there_is_silence_until_the_first():
    required, elsewhere = ControllerOptions(require_reference=True), HOME + 0.4
    arm = standing(required)
    assert arm.run(0.05) == [None] * 50
    with pytest.raises(InvalidMessageError):
        arm.follow(SetPoint(moved(0.2), 0.1), None)
    assert arm.step() is None  # one refused is no reference
    assert arm.step(9.0, q=elsewhere) is None  # moved by others
    arm.follow(SetPoint(pose_of(elsewhere), 0.1), None)
    assert_holds(arm, elsewhere)
    assert arm.resets == 0
    arm = standing(required)
    arm.step()
    arm.follow(SetPoint(moved(), 0.1), None)
    assert_holds(arm, elsewhere)
    assert "moved before the reference began" in arm.fault


# --- an arm that is held ------------------------------------------------------------------
def test_an_arm_that_does_not_follow_is_held_where_it_was_measured():
    arm = standing(scheme=clik(limited=True, max_deviation=0.05))
    arm.go(moved(0.2, 0.8))
    while not arm.fault:
        assert np.abs(arm.step().q - HOME).max() <= 0.05
        assert len(arm.commands) < 1000
    assert "from its command" in arm.fault
    # the command goes back to where the arm is, no faster than its joints may
    q = np.array([command.q for command in (arm.commands[-1], *arm.run(0.03))])
    assert (np.abs(np.diff(q, axis=0)) <= DT * UR5.limits.velocity + GUARD_ROUNDING).all()
    assert_holds(arm, HOME)


def test_an_arm_is_at_rest_when_its_joints_were_measured_to_be():
    arm = standing()
    for speed, rests in ((0.0, True), (0.009, True), (0.011, False), (-0.5, False)):
        arm.step(1.0, dq=speed * np.eye(6)[3])
        assert arm.is_at_rest == rests


@pytest.mark.parametrize("is_fault", [False, True])
@pytest.mark.parametrize("scheme", [clik, dynamic_control])
def test_references_that_are_refused_do_not_move_an_arm_that_is_held(scheme, is_fault):
    sag = np.array([0.0, 1e-3, 1e-3, 0.0, 0.0, 0.0])  # the arm gives way a little
    arm, asked = standing(scheme=scheme()), standing(scheme=scheme())
    for one in (arm, asked):
        one.step()
        if is_fault:
            one.step(0.0, q=HOME + 1e-6)
        else:
            one.halt()
        one.step(q=HOME)
    for _ in range(3):  # with pauses, after which a fault is no reason
        with pytest.raises(InvalidMessageError):
            asked.follow(SetPoint(moved(0.3, 1.0), 0.1), None)
        np.testing.assert_equal(*(one.run(0.6, q=HOME + sag) for one in (arm, asked)))


@pytest.mark.parametrize("resumes", [True, False])
def test_a_reference_is_compared_with_where_an_arm_that_is_held_has_come_to(resumes):
    arm, _ = on_its_way()
    if resumes:
        arm.halt()
    else:
        for _ in range(3):
            arm.step(0.0, q=HOME + 1e-6)  # a fault, after which a pause will do
    there = HOME + 0.3  # moved by others
    arm.run(1.0, q=there)  # its commands brake
    if resumes:
        arm.resume()
    with pytest.raises(InvalidMessageError, match="begins"):
        arm.follow(SetPoint(pose_of(HOME), 0.1), None)
    arm.run(1.0)
    arm.follow(SetPoint(pose_of(there), 0.1), None)
    assert_holds(arm, there)


@pytest.mark.parametrize("twists", [False, True])
@pytest.mark.parametrize("rate", [5, 10, 50])
def test_a_stream_that_the_tip_lags_is_not_refused(rate, twists):
    arm, speed = standing(ControllerOptions(motion=LIMITS)), 0.24
    arm.step()
    for n in range(round(1.5 * rate)):
        frame = moved(speed * n / rate)
        frame = frame._replace(dp_d=speed * np.eye(3)[0]) if twists else frame
        arm.follow(SetPoint(frame, 0.1), None)
        arm.run(1 / rate)
    tip = arm.guidance.motion.last.p_d[0] - pose_of(HOME).p_d[0]
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


def feed(arm, sequence, key):
    """Follow garbage; return the number of faults.

    The arm does what it is commanded where that is a position; an arm that is commanded by
    efforts stays where it is.
    """
    faults = 0
    for frame in garbage(sequence, key):
        with suppress(InvalidMessageError):  # what is refused is not followed
            arm.follow(SetPoint(frame, 0.02), None)
        for _ in range(4):
            command = arm.step(8e-3)
            assert is_finite(command)
            assert all(values is None or values.shape == (6,) for values in command)
            faults += bool(arm.fault)
            if command.q is not None and np.abs(command.q).max() < 1e3:
                arm.q, arm.dq = command.q, command.dq
    return faults


FAMILIES = sorted(
    {(orientation, "XYZ", "hysteretic") for orientation in ORIENTATIONS}
    | {(name, s, "hysteretic") for name in OF_ANGLES for s in SEQUENCES}
    | {(name, "XYZ", sign) for name in ("euler_parameters", "rotation_vector") for sign in SIGNS}
)


@pytest.mark.filterwarnings("ignore:(overflow|invalid value|divide by zero):RuntimeWarning")
@pytest.mark.parametrize("family", FAMILIES, ids="-".join)
@pytest.mark.parametrize("limited", [True, False], ids=["limits", "no limits"])
def test_no_desired_frame_makes_a_command_that_is_not_finite(family, limited):
    orientation, sequence, sign = family
    options = {"euler_sequence": sequence, "quaternion_sign": sign, "limited": limited}
    schemes = [clik(orientation, feedback=feedback, **options) for feedback in FEEDBACKS]
    for key, scheme in enumerate([*schemes, dynamic_control(orientation, **options)]):
        faults = feed(standing(ANY_JUMP, scheme), sequence, key)
    assert faults > 0  # of the efforts


@pytest.mark.parametrize("scheme", [partial(clik, limited=True), dynamic_control])
def test_garbage_does_not_survive_in_the_controller(scheme):
    arm = standing(ANY_JUMP, scheme("euler_angles"))
    with np.errstate(all="ignore"):
        feed(arm, "XYZ", 3)
    command = arm.step(1000.0, q=HOME, dq=STILL)  # the stamp jumps: it restarts
    if command.q is None:
        command = arm.run(0.002)[-1]
        assert_close(command.effort, UR5.dynamic_state(HOME, STILL).g, 1e3 * ALGEBRAIC)
    else:
        assert_holds(arm, HOME)
    arm.follow(SetPoint(pose_of(HOME), 0.05), None)
    assert is_finite(arm.step())
    assert arm.fault == ""
