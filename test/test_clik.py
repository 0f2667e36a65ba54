"""Closed-loop inverse kinematics: how errors decay, limits, redundancy, change of law."""

import math
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from arms import HOME, STILL, UR5, displaced, pose_of, robot_named, robot_of
from representations import make
from samples import about, generator, rodrigues
from tolerances import CLOSED_LOOP, HELD, NO_JUMP, REACHED, RELATIVE, assert_close

from eulerparams_control.errors import ConfigurationError, RobotError, SingularityError
from eulerparams_control.laws.clik import Clik, ClikLaw
from eulerparams_control.laws.inverse import DampedInverse
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import way_points

DT = 1e-3  # [s]
K = 10.0  # [1/s]
DP_D, OMEGA_D = np.array([0.03, -0.05, 0.04]), np.array([0.1, -0.2, 0.15])

every_orientation = pytest.mark.parametrize("orientation", ORIENTATIONS)


def law(orientation="euler_parameters", k=K, sequence="ZYX", sign="hysteretic", **options):
    """Return the law with one gain for position and orientation.

    The sequence is far from its pole at the home of the UR5.
    """
    return ClikLaw(make(orientation, sequence, sign), k, k, **options)


def clik(*args, feedback="internal", limits=None, blend_time=0.1, q=HOME, **options):
    """Return CLIK of the UR5, begun at q."""
    scheme = Clik(UR5, law(*args, **options), feedback, limits, blend_time)
    scheme.reset(q)
    return scheme


def moving(frame, t):
    """Return the frame t [s] later, at the twist DP_D, OMEGA_D."""
    speed = float(np.linalg.norm(OMEGA_D))
    R_d = rodrigues(speed * t, OMEGA_D / speed) @ frame.R_d
    return DesiredFrame(frame.p_d + t * DP_D, R_d, DP_D, OMEGA_D)


def run(scheme, desired_at, steps, dt=DT):
    """Return the ticks of a robot that does at once what is commanded."""
    ticks = [scheme.tick(0.0, scheme.hold(0.001, HOME, STILL).q, STILL, desired_at(0.0))]
    for step in range(1, steps):
        command = ticks[-1].command
        ticks.append(scheme.tick(dt, command.q, command.dq, desired_at(step * dt)))
    return ticks


# --- the closed loop, eqs. (25), (26), (28), (29) ----------------------------------------------
@every_orientation
def test_the_errors_decay_with_their_gain_while_the_frame_moves_and_turns(orientation):
    start = displaced()
    ticks = run(clik(orientation), lambda t: moving(start, t), 500)
    decay = np.exp(-K * DT * np.arange(500))[:, None]
    error = np.array([tick.dp_de for tick in ticks])
    assert_close(error, decay * error[0], 0.03 * CLOSED_LOOP)
    assert np.linalg.norm(error[0]) == pytest.approx(0.03, rel=RELATIVE * 1e3)
    if orientation in ("angle_axis", "euler_angles", "relative_euler_angles"):  # by components
        error = np.array([tick.x_de.error for tick in ticks])
        largest = np.linalg.norm(error[0])
        assert largest > 0.3
        assert_close(error, decay * error[0], largest * CLOSED_LOOP)


def test_q_is_the_integral_of_dq_and_dq_of_the_same_instant():
    ticks = run(clik(), lambda _: displaced(), 20)
    np.testing.assert_array_equal(ticks[0].command.q, HOME)
    for before, after in pairwise(ticks):
        q = before.command.q + DT * before.command.dq
        np.testing.assert_array_equal(after.command.q, q)


@every_orientation
@pytest.mark.parametrize("dt", [1e-3, 0.02, 0.1, 1.0])
def test_at_any_rate_the_error_decays_as_in_continuous_time(orientation, dt):
    k, slope = 100.0, make(orientation).slope
    scheme = Clik(UR5, ClikLaw(make(orientation), k, k / slope))
    scheme.reset(HOME)
    home = pose_of(UR5, HOME)
    turn = rodrigues(1e-4, np.array([0.0, 0.6, 0.8]))
    goal = home._replace(p_d=home.p_d + [0.0, 1e-4, 0.0], R_d=turn @ home.R_d)
    scheme.tick(dt, HOME, STILL, goal)
    before = scheme.tick(dt, HOME, STILL, goal)
    for _ in range(3):
        after = scheme.tick(dt, HOME, STILL, goal)
        for error in (
            lambda tick: np.linalg.norm(tick.dp_de),
            lambda tick: angle_between(goal.R_d, tick.state.R_e),
        ):
            decay = math.exp(-k * dt) * error(before)
            assert error(after) == pytest.approx(decay, rel=1e-2, abs=1e-7)
        before = after


# --- feedback -----------------------------------------------------------------------------
def test_internal_feedback_ignores_the_measured_joints_and_measured_feedback_uses_them():
    measured = HOME + 0.05 * generator(80).normal(size=6)
    dq = generator(81).normal(size=6)
    for feedback, q, rate in (("internal", HOME, STILL), ("measured", measured, dq)):
        tick = clik(feedback=feedback).tick(DT, measured, dq, pose_of(UR5, HOME))
        np.testing.assert_array_equal(tick.state.q, q)
        np.testing.assert_array_equal(tick.state.dq, rate)
        np.testing.assert_array_equal(tick.state.p_e, UR5.state(q, STILL).p_e)


@pytest.mark.parametrize(("feedback", "converges"), [("internal", False), ("measured", True)])
def test_only_measured_feedback_removes_a_bias_of_the_arm(feedback, converges):
    bias = np.array([0.02, -0.01, 0.015, 0.01, -0.02, 0.01])
    scheme, goal, q, dq = clik(feedback=feedback), displaced(), HOME + bias, STILL
    for step in range(2000):
        tick = scheme.tick(DT if step else 0.0, q, dq, goal)
        q, dq = tick.command.q + bias, tick.command.dq
    reached = pose_of(UR5, q)
    error = angle_between(goal.R_d, reached.R_d) + np.linalg.norm(goal.p_d - reached.p_d)
    assert (error < 1e-3) == converges
    assert converges or error > 0.01


def test_an_unknown_feedback_is_refused_with_those_that_exist():
    with pytest.raises(ConfigurationError, match=r"feedback is 'both'.*internal.*measured"):
        clik(feedback="both")


# --- another law --------------------------------------------------------------------------
def run_and_replace(laws, blend_time=0.1, steps=30, goal=None):
    """Return two schemes after ``steps`` of the first law; in one the others replaced it.

    And the goal, and the velocity commanded last.
    """
    goal = goal or displaced()
    schemes = [Clik(UR5, laws[0], "internal", None, blend_time) for _ in range(2)]
    for scheme in schemes:
        scheme.reset(HOME)
        last = run(scheme, lambda _: goal, steps)
    for other in laws[1:]:
        schemes[1].replace_law(other)
    return schemes, goal, last[-1].command.dq


@every_orientation
@pytest.mark.parametrize(("x", "angle"), [(0.02, 0.05), (0.2, 0.8), (1e-5, 1e-5)])
def test_an_error_is_undone_no_faster_than_the_tip_may_be_and_can_stop(orientation, x, angle):
    motion, state = MotionLimits(0.25, 1.0, 1.0, 4.0), UR5.state(HOME, STILL)
    goal = DesiredFrame(state.p_e + [x, 0.0, 0.0], about(2, angle) @ state.R_e)
    bounded, free = (
        state.J @ law(orientation, 100.0).velocity(state, goal, None, 0.0, one)[0]
        for one in (motion, None)
    )
    v = np.linalg.norm(bounded[:3])
    assert v <= min(0.25, math.sqrt(2 * 1.0 * x)) * (1 + RELATIVE)
    most = min(1.0, math.sqrt(2 * 4.0 * angle))
    assert np.linalg.norm(bounded[3:]) <= most * (1 + RELATIVE)
    if x == 1e-5:  # small errors are undone as ever
        np.testing.assert_allclose(bounded, free, rtol=RELATIVE)
    else:
        assert v >= 0.99 * min(0.25, math.sqrt(2 * 1.0 * x))


def test_an_error_is_undone_within_the_acceleration_of_the_tip_to_the_end():
    motion, state = MotionLimits(0.25, 1.0, 1.0, 4.0), UR5.state(HOME, STILL)
    errors = np.geomspace(1e-6, 0.1, 400)
    for part, a in ((slice(3), 1.0), (slice(3, 6), 4.0)):
        speeds = []
        for e in errors:
            p_d, R_d = state.p_e + [e * (a == 1.0), 0.0, 0.0], about(0, e * (a == 4.0)) @ state.R_e
            goal = DesiredFrame(p_d, R_d)
            dq = law("euler_parameters", 100.0).velocity(state, goal, None, 0.0, motion)[0]
            speeds.append(np.linalg.norm((state.J @ dq)[part]))
        braking = np.diff(np.square(speeds)) / np.diff(errors) / 2  # v dv/de
        assert 0.99 * a < braking.max() < 1.01 * a


@pytest.mark.parametrize("before", ORIENTATIONS)
@pytest.mark.parametrize("after", ORIENTATIONS)
def test_a_law_is_replaced_by_another_without_a_jump_of_the_velocity(before, after):
    laws = law(before, K), law(after, 3 * K)
    (kept, replaced), goal, last = run_and_replace(laws)
    expected = kept.tick(DT, HOME, STILL, goal)
    tick = replaced.tick(DT, HOME, STILL, goal)
    assert_close(tick.command.dq, last, NO_JUMP)
    np.testing.assert_array_equal(tick.command.q, expected.command.q)
    dq = [one.velocity(tick.state, goal, None)[0] for one in laws]
    assert np.abs(dq[0] - dq[1]).max() > 0.1  # there was something to jump


def test_a_law_on_the_long_way_round_keeps_it_and_does_not_jump_when_its_gain_changes():
    laws = law(k=K, sign="continuous"), law(k=2 * K, sign="continuous")
    goal = pose_of(UR5, HOME)
    schemes = [Clik(UR5, laws[0], blend_time=0.1) for _ in range(2)]
    for scheme in schemes:
        scheme.reset(HOME)
        for angle in (2.0, 3.0, 3.8, 4.5):  # beyond half a turn eta < 0
            turned = goal._replace(R_d=about(2, angle) @ goal.R_d)
            scheme.tick(0.0, HOME, STILL, turned)
    schemes[1].replace_law(laws[1])
    expected, tick = (scheme.tick(0.0, HOME, STILL, turned) for scheme in schemes)
    assert expected.x_de.Q_de.eta < -0.5
    assert tick.x_de.Q_de.eta == expected.x_de.Q_de.eta
    assert_close(tick.command.dq, expected.command.dq, NO_JUMP)


def test_holding_ends_a_blend():
    (_, replaced), goal, _ = run_and_replace((law(k=K), law(k=30 * K)))
    replaced.tick(DT, HOME, STILL, goal)
    replaced.hold(0.001, HOME, STILL)
    dq = replaced.tick(DT, HOME, STILL, replaced.start_frame()).command.dq
    assert_close(dq, 0, HELD * K)


# --- hold and reset -----------------------------------------------------------------------
def test_hold_commands_the_position_commanded_last_without_velocity():
    scheme, given = clik(), HOME.copy()
    scheme.reset(given)
    given += 1  # it is not kept
    ticks = run(scheme, lambda _: displaced(), 50)
    held = scheme.hold(0.001, HOME, STILL)
    np.testing.assert_array_equal(held.q, ticks[-1].command.q)
    np.testing.assert_array_equal(held.dq, STILL)
    later = scheme.tick(0.05, HOME, STILL, scheme.start_frame())
    np.testing.assert_array_equal(later.command.q, held.q)
    assert_close(later.command.dq, 0, HELD)


def test_nothing_is_integrated_when_the_law_has_no_answer():
    scheme = clik()
    before = run(scheme, lambda _: displaced(), 5)[-1].command
    bad = displaced()._replace(p_d=np.array([math.inf, 0, 0]))
    with pytest.raises(SingularityError, match="infinite"), np.errstate(invalid="ignore"):
        scheme.tick(DT, HOME, STILL, bad)
    after = scheme.tick(DT, HOME, STILL, displaced()).command
    np.testing.assert_array_equal(after.q, before.q + DT * before.dq)


# --- redundancy ---------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["panda", "kuka_iiwa"])
def test_the_null_space_does_not_move_the_tip_and_approaches_the_posture(name):
    robot, home = robot_named(name)
    free = np.linalg.svd(robot.state(home, np.zeros(7)).J)[2][6]  # the null space of J
    posture = home + 0.4 * free
    scheme = Clik(robot, law(k=20.0, posture=posture, k_posture=2.0))
    scheme.reset(home)
    frame = scheme.start_frame()
    tick = scheme.tick(0.0, home, np.zeros(7), frame)
    assert np.abs(tick.command.dq).max() > 0.05
    assert_close(tick.state.J @ tick.command.dq, 0, NO_JUMP)
    first = distance = np.linalg.norm(home - posture)
    for _ in range(3000):
        tick = scheme.tick(DT, home, np.zeros(7), frame)
        assert np.linalg.norm(tick.dp_de) < 1e-4
        assert angle_between(frame.R_d, tick.state.R_e) < 1e-4
        nearer = np.linalg.norm(tick.command.q - posture)
        assert nearer < distance + NO_JUMP
        distance = nearer
    assert distance < 0.3 * first
    assert_close(tick.state.J @ tick.command.dq, 0, 1e-3)


def test_a_posture_of_the_wrong_size_is_refused_with_the_names_of_the_joints():
    wrong, scheme = law(posture=np.zeros(5)), clik()
    for take in (scheme.replace_law, partial(Clik, UR5)):
        with pytest.raises(ConfigurationError, match=r"posture has 5 values.* 6 joints .*elbow"):
            take(wrong)
    assert scheme.law.posture is None  # the law that is refused is not taken


def test_the_wrist_singularity_is_crossed_with_damping_and_reached_again():
    q = HOME.copy()
    q[4] = -0.15
    start, end = pose_of(UR5, q), pose_of(UR5, q + 0.3 * np.eye(6)[4])
    path = way_points([0.0, 2.0], [(start.p_d, start.R_d), (end.p_d, end.R_d)])
    speeds = {}
    for name, inverse in (("damped", DampedInverse()), ("exact", DampedInverse(eps=0.0))):
        scheme = clik(k=50.0, inverse=inverse, q=q)
        ticks = run(scheme, path.sample, 3000)
        speeds[name] = max(np.abs(tick.command.dq).max() for tick in ticks)
        assert np.linalg.norm(ticks[-1].dp_de) < 1e-3
        assert math.degrees(angle_between(end.R_d, ticks[-1].state.R_e)) < 1e-2
    assert speeds["damped"] < 5.1 < 44.0 < speeds["exact"]


# --- inverse kinematics -------------------------------------------------------------------
@pytest.mark.parametrize("name", ["kuka_iiwa", "panda", "ur10", "ur5"])
def test_inverse_kinematics_reaches_poses_near_home(name):
    robot, home = robot_named(name)
    for step in 0.3 * generator(83).uniform(-1, 1, size=(20, robot.n)):
        frame = pose_of(robot, home + step)
        q = inverse_kinematics(robot, frame, home)
        reached = pose_of(robot, q)
        assert np.linalg.norm(reached.p_d - frame.p_d) < REACHED
        assert angle_between(reached.R_d, frame.R_d) < REACHED
        assert robot.limits.contain(q)


@pytest.mark.parametrize("name", ["kuka_iiwa", "panda", "ur10", "ur5"])
def test_inverse_kinematics_refuses_a_pose_out_of_reach_with_the_pose(name):
    robot, home = robot_named(name)
    frame = pose_of(robot, home)._replace(p_d=np.array([3.0, 0.5, 0.25]))
    with pytest.raises(RobotError, match=r"\[3.0, 0.5, 0.25\] m.*within reach"):
        inverse_kinematics(robot, frame, home)


@pytest.mark.parametrize("step", [0.2, -0.2])
def test_inverse_kinematics_refuses_a_pose_that_is_reached_outside_the_limits_only(step):
    robot = robot_of("ur5")
    frame = pose_of(robot, HOME + step)
    robot.limits = JointLimits(HOME - 0.1, HOME + 0.1, np.ones(6), np.ones(6))
    with pytest.raises(RobotError, match="only outside the joint limits"):
        inverse_kinematics(robot, frame, HOME)


def test_a_law_replaced_at_the_pole_of_the_euler_angles_does_not_throw_the_arm():
    start = UR5.state(HOME, STILL)
    goal = DesiredFrame(start.p_e, start.R_e)
    scheme = Clik(UR5, law("euler_angles", 100.0), limits=UR5.limits)
    scheme.reset(HOME)
    scheme.tick(0.0, HOME, STILL, goal)
    last = scheme.tick(DT, HOME, STILL, goal._replace(omega_d=np.array([0.0, 0.0, 1e9])))
    scheme.replace_law(law("euler_parameters", 100.0))
    for _ in range(100):
        tick = scheme.tick(DT, HOME, STILL, goal)
        assert np.abs(tick.command.dq).max() <= np.abs(last.command.dq).max() + NO_JUMP
