"""Closed-loop inverse kinematics: how errors decay, limits, redundancy, change of law."""

import math
from functools import partial
from itertools import pairwise

import arms
import numpy as np
import pytest
from arms import HOME, STILL, UR5, displaced, pose_of, robot_named, robot_of
from samples import about, generator, rodrigues
from tolerances import CLOSED_LOOP, HELD, REACHED, RELATIVE, assert_close

from eulerparams_control.errors import RobotError
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import ORIENTATIONS, representation
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.motion.frames import DesiredFrame

DT = 1e-3  # [s]
K = 10.0  # [1/s]
DP_D, OMEGA_D = np.array([0.03, -0.05, 0.04]), np.array([0.1, -0.2, 0.15])
# With the limits of the tip, and none of the joints that matters.
TIP_LIMITS = {"limited": True, "shape_motion": True, "velocity_scale": 1e3}

every_orientation = pytest.mark.parametrize("orientation", ORIENTATIONS)
# The sequence is far from its pole at the home of the UR5.
clik = partial(arms.clik, k_Pp=K, k_Po=K, euler_sequence="ZYX")


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
    if orientation in ("angle_axis", "euler_angles", "relative_euler_angles"):  # by components
        error = np.array([tick.x_de.error for tick in ticks])
        largest = np.linalg.norm(error[0])
        assert largest > 0.3
        assert_close(error, decay * error[0], largest * CLOSED_LOOP)
    for before, after in pairwise(ticks):  # q and dq are of the same instant
        np.testing.assert_array_equal(after.command.q, before.command.q + DT * before.command.dq)


@every_orientation
@pytest.mark.parametrize("dt", [1e-3, 0.02, 0.1, 1.0])
def test_at_any_rate_the_error_decays_as_in_continuous_time(orientation, dt):
    k, slope = 100.0, representation(orientation).slope
    scheme = clik(orientation, k_Pp=k, k_Po=k / slope, euler_sequence="XYZ")
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


@pytest.mark.parametrize(("feedback", "converges"), [("internal", False), ("measured", True)])
def test_only_measured_feedback_removes_a_bias_of_the_arm(feedback, converges):
    bias = np.array([0.02, -0.01, 0.015, 0.01, -0.02, 0.01])
    scheme, goal, q, dq = clik(feedback=feedback), displaced(), HOME + bias, STILL
    for step in range(2000):
        tick = scheme.tick(DT if step else 0.0, q, dq, goal)
        np.testing.assert_array_equal(tick.state.q, q if converges else tick.command.q)
        q, dq = tick.command.q + bias, tick.command.dq
    reached = pose_of(UR5, q)
    error = angle_between(goal.R_d, reached.R_d) + np.linalg.norm(goal.p_d - reached.p_d)
    assert error < 1e-3 if converges else error > 0.01


# --- the limits of the tip ----------------------------------------------------------------
@every_orientation
@pytest.mark.parametrize(("x", "angle"), [(0.02, 0.05), (0.2, 0.8), (1e-5, 1e-5)])
def test_an_error_is_undone_no_faster_than_the_tip_may_be_and_can_stop(orientation, x, angle):
    state = UR5.state(HOME, STILL)
    goal = DesiredFrame(state.p_e + [x, 0.0, 0.0], about(2, angle) @ state.R_e)
    bounded, free = (
        state.J @ scheme.tick(0.0, HOME, STILL, goal).command.dq
        for scheme in (
            clik(orientation, k_Pp=100.0, k_Po=100.0, **TIP_LIMITS),
            clik(orientation, k_Pp=100.0, k_Po=100.0),
        )
    )
    v, fastest = np.linalg.norm(bounded[:3]), min(0.25, math.sqrt(2 * 1.0 * x))
    assert v <= fastest * (1 + RELATIVE)
    most = min(1.0, math.sqrt(2 * 4.0 * angle))
    assert np.linalg.norm(bounded[3:]) <= most * (1 + RELATIVE)
    if x == 1e-5:  # small errors are undone as ever
        np.testing.assert_allclose(bounded, free, rtol=RELATIVE)
    else:
        assert v >= 0.99 * fastest


# --- hold and reset -----------------------------------------------------------------------
def test_hold_commands_the_position_commanded_last_without_velocity():
    q = HOME.copy()
    scheme = clik(q=q)
    q += 1  # it is not kept
    before = run(scheme, lambda _: displaced(), 50)[-1].command
    held = scheme.hold(0.001, HOME, STILL)
    np.testing.assert_array_equal(held.q, before.q)
    np.testing.assert_array_equal(held.dq, STILL)
    later = scheme.tick(0.05, HOME, STILL, scheme.start_frame())
    np.testing.assert_array_equal(later.command.q, held.q)
    assert_close(later.command.dq, 0, HELD * K)


# --- inverse kinematics -------------------------------------------------------------------
@pytest.mark.parametrize("name", ["kuka_iiwa", "panda", "ur10", "ur5"])
def test_inverse_kinematics_reaches_poses_near_home_and_refuses_one_out_of_reach(name):
    robot, home = robot_named(name)
    for step in 0.3 * generator(83).uniform(-1, 1, size=(20, robot.n)):
        frame = pose_of(robot, home + step)
        q = inverse_kinematics(robot, frame, home)
        reached = pose_of(robot, q)
        assert np.linalg.norm(reached.p_d - frame.p_d) < REACHED
        assert angle_between(reached.R_d, frame.R_d) < REACHED
        assert np.all((robot.limits.lower <= q) & (q <= robot.limits.upper))
    with pytest.raises(RobotError, match=r"\[3.0, 0.5, 0.25\] m.*within reach"):
        inverse_kinematics(robot, frame._replace(p_d=np.array([3.0, 0.5, 0.25])), home)


@pytest.mark.parametrize("step", [0.2, -0.2])
def test_inverse_kinematics_refuses_a_pose_that_is_reached_outside_the_limits_only(step):
    robot = robot_of("ur5")
    frame = pose_of(robot, HOME + step)
    robot.limits = JointLimits(HOME - 0.1, HOME + 0.1, np.ones(6), np.ones(6))
    with pytest.raises(RobotError, match="only outside the joint limits"):
        inverse_kinematics(robot, frame, HOME)
