"""What bounds the laws: exact gains, errors that stop, turns of joints, efforts that ramp."""

import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, pose_of, robot_of
from samples import generator, rodrigues
from sensor_msgs.msg import JointState
from tolerances import ALGEBRAIC, RELATIVE, assert_close

from eulerparams_control.control.command_limiter import CommandLimiter
from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import FollowingError
from eulerparams_control.laws.clik import Clik, ClikLaw
from eulerparams_control.laws.dynamic_control import (
    DynamicControl,
    EffortLimits,
    ResolvedAcceleration,
)
from eulerparams_control.laws.inverse import DampedInverse, smallest_singular_value
from eulerparams_control.laws.inverse_dynamics import InverseDynamics
from eulerparams_control.laws.orientation import ORIENTATIONS, representation
from eulerparams_control.laws.rotations import angle_between, exp
from eulerparams_control.laws.scheme import ErrorBounds, JointCommand
from eulerparams_control.messages.from_ros import JointStateReader
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

AROUND = 2 * math.pi


def clik_law(orientation="euler_parameters", **options):
    return ClikLaw(representation(orientation), **options)


def dynamic(robot=UR5, q=HOME, dynamics=None, **limits):
    """Return dynamic control with limits, begun at q (n,)."""
    bounds = EffortLimits(**{"joints": robot.limits, "rate": 1000.0, **limits})
    law = ResolvedAcceleration(representation("euler_parameters"))
    scheme = DynamicControl(robot, law, dynamics or InverseDynamics(), bounds)
    scheme.reset(q)
    return scheme


# --- the gains of CLIK ------------------------------------------------------------------------


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("dt", [1e-3, 0.02, 0.1, 1.0])
def test_at_any_rate_the_error_decays_as_in_continuous_time(orientation, dt):
    k, slope = 100.0, representation(orientation).slope
    scheme = Clik(UR5, clik_law(orientation, k_Pp=k, k_Po=k / slope))
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


# --- errors that stop CLIK --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("moved", "turned", "stops"),
    [(0.099, 0.0, False), (0.101, 0.0, True), (0.0, 0.49, False), (0.0, 0.51, True)],
)
def test_clik_stops_where_the_tip_is_too_far_from_the_desired_frame(moved, turned, stops):
    scheme = Clik(UR5, clik_law(), limits=UR5.limits, max_error=ErrorBounds(0.1, 0.5))
    scheme.reset(HOME)
    home = pose_of(UR5, HOME)
    R = rodrigues(turned, np.array([1.0, 0.0, 0.0])) @ home.R_d
    goal = home._replace(p_d=home.p_d + [0.0, moved, 0.0], R_d=R)
    if stops:
        with pytest.raises(FollowingError, match=r"max_error_(position|rotation)"):
            scheme.tick(1e-3, HOME, STILL, goal)
    else:
        scheme.tick(1e-3, HOME, STILL, goal)
    free = Clik(UR5, clik_law(), max_error=ErrorBounds(0.1, 0.5))
    free.reset(HOME)
    free.tick(1e-3, HOME, STILL, goal)  # as without limits


# --- joints that turn on and on -----------------------------------------------------------------


@pytest.fixture
def turning():
    """A seven-joint arm of which one joint has no limits, and its home."""
    robot = robot_of("panda")
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[0], upper[0] = -math.inf, math.inf
    robot.limits = replace(robot.limits, lower=lower, upper=upper)
    return robot, np.array([0.1, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def test_the_posture_is_the_same_by_any_turn(turning):
    robot, q = turning
    posture, still, turn = q + 0.2, np.zeros(7), AROUND * np.eye(7)[0]
    desired = pose_of(robot, q)
    dynamics = InverseDynamics(posture=posture)
    for scheme in (Clik(robot, clik_law(posture=posture)), dynamic(robot, q, dynamics)):
        commands = []
        for measured in (q, q + turn, q - turn):
            scheme.reset(measured)
            command = scheme.tick(1e-3, measured, still, desired).command
            commands.append(command.dq if command.effort is None else command.effort)
        np.testing.assert_allclose(commands[1:], [commands[0]] * 2, rtol=0, atol=1e-9)


def test_a_restart_goes_on_by_the_turn_that_was_commanded(turning):
    robot, q = turning
    scheme, turn = Clik(robot, clik_law(), limits=robot.limits), AROUND * np.eye(7)[0]
    scheme.reset(q + turn)
    scheme.resume(q + 0.01)  # wrapped by its driver
    q_c = scheme.tick(1e-3, q, np.zeros(7), scheme.start_frame()).command.q
    np.testing.assert_allclose(q_c, q + turn + 0.01, rtol=0, atol=ALGEBRAIC)


def test_the_limiter_never_goes_the_long_way(turning):
    robot, q = turning
    limiter, still, turn = CommandLimiter(robot.limits), np.zeros(7), AROUND * np.eye(7)[0]
    limiter(JointCommand(q + turn, still), q, 1e-3, 1e-3)
    for _ in range(1000):
        command = limiter(JointCommand(q, still), q, 1e-3, 1e-3)
        np.testing.assert_allclose(command.q, q + turn, rtol=0, atol=1e-12)


# --- efforts ------------------------------------------------------------------------------------


def test_the_limits_of_efforts_count_what_the_robot_adds():
    robot = robot_of("panda")
    q = np.array([0.0, 1.5, 0.0, -0.1, 0.0, 1.6, 0.0])  # stretched out: heavy
    state = robot.dynamic_state(q, np.zeros(7))
    far = pose_of(robot, q)
    for added, options in ((0.0, {}), (state.g, {"gravity": False})):
        for way in (-0.09, 0.09):
            scheme = dynamic(robot, q, InverseDynamics(**options), rate=1e9)
            scheme.law = replace(scheme.law, k_Pp=1e4)
            goal = far._replace(p_d=far.p_d + [0.0, 0.0, way])
            effort = scheme.tick(1e-3, q, np.zeros(7), goal).command.effort
            total = np.abs(effort + added)
            assert (total <= robot.limits.effort * (1 + RELATIVE)).all()
            assert total.max() == pytest.approx(robot.limits.effort[total.argmax()], rel=RELATIVE)


@pytest.mark.parametrize("reported", [None, np.zeros(6), np.arange(6.0)], ids=["no", "0", "yes"])
@pytest.mark.parametrize("gravity", [True, False])
def test_efforts_begin_at_what_acts_and_ramp_each_at_its_rate(reported, gravity):
    rate, dt = np.linspace(500.0, 1000.0, 6), 1e-3
    scheme = dynamic(dynamics=InverseDynamics(gravity=gravity), rate=rate)
    scheme.start_from(reported)
    home, start = pose_of(UR5, HOME), UR5.dynamic_state(HOME, STILL).g if gravity else STILL
    if gravity and reported is not None and reported.any():
        start = reported
    goal = home._replace(p_d=home.p_d + [0.0, 0.05, 0.09])
    efforts = [start] + [scheme.tick(k * dt, HOME, STILL, goal).command.effort for k in (0, 1, 1)]
    steps = np.abs(np.diff(efforts, axis=0))
    assert (steps <= rate * dt + 1e-12).all()
    assert np.isclose(steps, rate * dt).any()


def test_a_controller_begins_at_the_efforts_of_joint_states_where_they_can_be_used():
    reader, msg = JointStateReader(UR5.joints), JointState(name=list(reversed(UR5.joints)))
    msg.position, reported = HOME[::-1].tolist(), np.arange(6.0)
    reader.from_ros(msg)
    for given, start in (
        (reported[::-1], reported),
        ([], UR5.dynamic_state(HOME, STILL).g),
        ([math.nan] * 6, UR5.dynamic_state(HOME, STILL).g),
    ):
        msg.effort = list(given)
        efforts = reader.effort_from_ros(msg)
        controller = Controller(dynamic(), ControllerOptions(), HOME, efforts)
        command = controller.step(1_000_000_000, HOME, STILL)
        assert np.abs(command.effort - start).max() <= 1000.0 * 1e-3 + 1e-12


def test_a_limit_of_acceleration_leaves_the_efforts_against_a_disturbance():
    plant, dt, disturbance = Plant(), 1e-3, np.array([0.0, 3.0, 3.0, 1.0, 1.0, 1.0])
    joints = replace(UR5.limits, acceleration=np.full(6, 5.0))  # of 1 Nm the wrist makes 58
    scheme, home, plant.q = dynamic(joints=joints), pose_of(UR5, HOME), HOME.copy()
    for _ in range(1500):
        effort = scheme.tick(dt, plant.q, plant.dq, home).command.effort
        plant.step(effort + disturbance, dt)
        assert np.abs(plant.dq).max() < 1.5  # it takes some 20 ms until that is known
    assert np.abs(plant.dq).max() < 1e-3
    assert angle_between(pose_of(UR5, plant.q).R_d, home.R_d) < 0.2


def test_a_stop_under_efforts_keeps_the_acceleration_and_does_not_swing():
    plant, dt, a = Plant(), 1e-3, 5.0
    joints = replace(UR5.limits, acceleration=np.full(6, a))
    scheme, plant.q = dynamic(joints=joints, rate=1e5), HOME.copy()
    plant.dq = start = np.array([0.8, -0.4, 0.3, 0.2, 0.1, -0.5])
    longest, soft = 0.8 / (0.8 * a), 0.05  # [s] at 80 % of a, until it fades
    end = HOME + start * (longest + soft**2 / longest) / 2
    for _ in range(1500):
        before = plant.dq
        plant.step(scheme.hold(dt, plant.q, plant.dq).effort, dt)
        assert np.abs(plant.dq - before).max() <= a * dt * 1.1
        assert (plant.dq / start).min() > -1e-3
    assert np.abs(plant.dq).max() < 1e-3
    np.testing.assert_allclose(plant.q, end, rtol=0, atol=1e-3)


# --- the size of the arm -------------------------------------------------------------------------


def scaled(name, factor):
    """Return an arm of the catalogue in another size."""
    about = load_robot(name)
    root = ElementTree.fromstring(about.urdf)
    for origin in root.iter("origin"):
        xyz = [factor * float(value) for value in origin.get("xyz", "0 0 0").split()]
        origin.set("xyz", " ".join(map(repr, xyz)))
    urdf = ElementTree.tostring(root, encoding="unicode")
    return Robot(urdf, about.base_frame, about.tip_frame, about.joints)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_small_arm_is_damped_and_slowed_where_the_large_one_is(name):
    large, small = robot_of(name), scaled(name, 0.25)
    assert small.length == pytest.approx(0.25 * large.length, rel=1e-9)
    random, damped = generator(910), 0
    for q in random.uniform(-2.0, 2.0, size=(200, large.n)):
        J_l, J_s = (robot.state(q, np.zeros(robot.n)).J for robot in (large, small))
        sigma = smallest_singular_value(J_l, large.length)
        assert smallest_singular_value(J_s, small.length) == pytest.approx(sigma, abs=1e-12)
        damped += sigma < DampedInverse.eps
        v_l, v_s = np.ones(6), np.array([0.25] * 3 + [1.0] * 3)
        dq_l = DampedInverse(length=large.length)(J_l) @ v_l
        dq_s = DampedInverse(length=small.length)(J_s) @ v_s
        np.testing.assert_allclose(dq_s, dq_l, rtol=0, atol=1e-7 * np.linalg.norm(dq_l))
    assert 20 < damped < 150


def test_the_length_of_a_ur5_is_a_metre_and_the_schemes_use_that_of_their_arm():
    assert UR5.length == pytest.approx(0.99, abs=0.005)
    small = scaled("ur5", 0.25)
    for scheme in (Clik(small, clik_law()), dynamic(small)):
        law = scheme.law if isinstance(scheme, Clik) else scheme.dynamics
        assert law.inverse.length == small.length


@pytest.mark.parametrize(
    "gains", [(40.0, 0.0, 40.0, 4.0), (0.0, 0.0, 40.0, 4.0), (4.0, 4.0, 40.0, 0.0)]
)
def test_a_loop_without_damping_asks_for_what_its_gains_say(gains):
    law = ResolvedAcceleration(representation("euler_parameters"), *gains)
    arm = UR5.state(HOME, STILL)
    desired = DesiredFrame(arm.p_e + [0.1, 0.0, 0.0], exp(np.array([0.0, 0.2, 0.0])) @ arm.R_e)
    a, dp_de, x_de = law.acceleration(arm, desired, None)
    assert_close(a, [*(gains[0] * dp_de), *(gains[2] * x_de.eps_de)], 1e-12)
