"""Dynamic control: the closed loop (32)-(43), its limits, redundancy, change of law, holding.

The arm is simulated by Pinocchio's forward dynamics, which has neither B nor C dq.
"""

import math
from dataclasses import replace
from itertools import product
from xml.etree import ElementTree

import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, displaced, pose_of, robot_named, robot_of
from representations import every_representation, make
from samples import about, generator
from sensor_msgs.msg import JointState
from tolerances import (
    ALGEBRAIC,
    ERROR_EQUATION,
    NO_JUMP,
    NULL_SPACE,
    RELATIVE,
    assert_close,
)

from eulerparams_control.control.command_limiter import CommandLimiter
from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import (
    ConfigurationError,
    FollowingError,
    RobotError,
    SingularityError,
)
from eulerparams_control.laws.clik import Clik, ClikLaw
from eulerparams_control.laws.compliant_frame import ComplianceBounds
from eulerparams_control.laws.dynamic_control import (
    DynamicControl,
    EffortLimits,
    ResolvedAcceleration,
)
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.hold import JointHold
from eulerparams_control.laws.inverse import DampedInverse, sigma_min
from eulerparams_control.laws.inverse_dynamics import InverseDynamics
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.rotations import angle_between, exp
from eulerparams_control.laws.scheme import ErrorBounds, JointCommand
from eulerparams_control.messages.from_ros import JointStateReader
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.motion_limits import MotionLimits
from eulerparams_control.motion.trajectories import way_points
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot
from eulerparams_control.robot.urdf import COULOMB_SPEED

DT = 1e-3  # [s]
MS = 1_000_000  # [ns]
T_0 = 1_700_000_000_000_000_000  # [ns]
RATE = 2000.0  # [Nm/s]
FRICTION = JointFriction(np.array([0.5, 0.4, 0.3, 0.2, 0.1, 0.05]), np.arange(6) / 3)


def law(name="euler_parameters", k_Po=None, sequence="ZYX", sign="hysteretic", initial=1, **gains):
    """Return the law; the sequence is far from its pole at the home of the UR5.

    Unless given, the gains of all orientations make the same bandwidth.
    """
    if k_Po is None:
        k_Po = 800.0 if name == "euler_parameters" else 400.0
    return ResolvedAcceleration(make(name, sequence, sign, initial), k_Po=k_Po, **gains)


def limits_of(robot=UR5, rate=RATE, position=math.inf, rotation=math.inf, joints=None):
    return EffortLimits(joints or robot.limits, rate, position, rotation)


def dynamic(limits=None, dynamics=None, blend_time=0.1, q=HOME, robot=UR5, **options):
    """Return dynamic control, begun at q; without limits if none are given."""
    scheme = DynamicControl(
        robot, law(**options), dynamics or InverseDynamics(), limits or EffortLimits(), blend_time
    )
    scheme.reset(q)
    return scheme


def gravity(q=HOME):
    return UR5.dynamic_state(q, STILL).g


def from_home_to(frame, duration):
    return way_points([0.0, duration], [pose_of(UR5, HOME)[:2], frame[:2]])


def states(robot, home, count=10, key=0):
    """Return random q, dq near home, away from singularities of the arm."""
    random = generator(310, key)
    pairs = [
        (home + 0.4 * random.uniform(-1, 1, robot.n), random.normal(size=robot.n))
        for _ in range(4 * count)
    ]
    regular = [p for p in pairs if sigma_min(robot.state(*p).J, 1.0) > 0.1]
    return regular[:count]


def desired_frames(robot, home, count=10, key=0):
    """Return desired frames near home with random velocities and accelerations."""
    poses = [displaced(key=i, robot=robot, q=home)[:2] for i in range(count)]
    rates = generator(311, key).normal(size=(count, 4, 3))
    return [DesiredFrame(*pose, *rate) for pose, rate in zip(poses, rates, strict=True)]


# --- the law (33) on the model (32) --------------------------------------------------------
@pytest.mark.parametrize("name", ["kuka_iiwa", "panda", "ur10", "ur5"])
def test_inverse_and_forward_dynamics_give_the_acceleration_that_is_asked_for(name):  # (34), (35)
    robot, home = robot_named(name)
    plant, dynamics = Plant(name), InverseDynamics(posture=home + 0.1)
    for (q, dq), a in zip(states(robot, home), generator(312).normal(size=(10, 6)), strict=True):
        state = robot.dynamic_state(q, dq)
        tau = dynamics.effort(robot, state.arm, dynamics.acceleration(state, 5 * a))
        ddq = plant.acceleration(q, dq, tau)
        assert_close(plant.tip_acceleration(q, dq, ddq), 5 * a, ERROR_EQUATION)
        by_J = state.arm.J @ ddq + state.dJ_dq  # the derivative of eq. (20)
        assert_close(by_J, 5 * a, ERROR_EQUATION)


@every_representation
def test_the_position_error_obeys_eq_37_and_the_orientation_follows_a_o(name):
    resolved = law(name, 50.0, k_Pp=70.0, k_Vp=11.0, k_Vo=9.0)
    plant, dynamics = Plant(), InverseDynamics()
    for (q, dq), desired in zip(states(UR5, HOME), desired_frames(UR5, HOME), strict=True):
        state = UR5.dynamic_state(q, dq)
        a, dp_de, x_de = resolved.acceleration(state.arm, desired, None)
        tau = dynamics.effort(UR5, state.arm, dynamics.acceleration(state, a))
        accelerated = plant.tip_acceleration(q, dq, plant.acceleration(q, dq, tau))
        ddp_de, ddp_rate = desired.ddp_d - accelerated[:3], desired.dp_d - state.arm.dp_e
        residual = ddp_de + 11 * ddp_rate + 70 * (desired.p_d - state.arm.p_e)  # eq. (37)
        assert_close(residual, 0, ERROR_EQUATION)
        np.testing.assert_array_equal(dp_de, desired.p_d - state.arm.p_e)  # eq. (21)
        motion = desired.omega_d, desired.domega_d, state.arm.omega_e
        a_o = resolved.orientation.resolved_acceleration(x_de, *motion, 50.0, 9.0)
        assert_close(accelerated[3:], a_o, ERROR_EQUATION)  # (35)


# --- what is compensated -------------------------------------------------------------------
@pytest.mark.parametrize("switch", ["gravity", "coriolis", "friction"])
def test_a_switch_that_is_off_leaves_out_exactly_its_term(switch):
    on = InverseDynamics(friction=FRICTION)
    others = {"gravity": True, "coriolis": True, "friction": FRICTION}
    off = InverseDynamics(**{**others, switch: None if switch == "friction" else False})
    for (q, dq), ddq in zip(states(UR5, HOME), generator(314).normal(size=(10, 6)), strict=True):
        state = UR5.dynamic_state(q, dq)
        term = {
            "gravity": state.g,
            "coriolis": state.C_dq,
            "friction": FRICTION.viscous * dq + FRICTION.coulomb * np.tanh(dq / COULOMB_SPEED),
        }[switch]
        kept = [array.copy() for array in state[1:]]
        found = on.effort(UR5, state.arm, ddq) - off.effort(UR5, state.arm, ddq)
        assert_close(found, term, 1e3 * ALGEBRAIC)
        assert np.abs(term).max() > 0.01
        for before, after in zip(kept, state[1:], strict=True):
            np.testing.assert_array_equal(before, after)  # the state is not changed
        whole = state.B @ ddq + state.C_dq + state.g + FRICTION.effort(dq)  # eq. (33)
        assert_close(on.effort(UR5, state.arm, ddq), whole, 1e3 * ALGEBRAIC)


# --- redundancy and kinematic singularities ------------------------------------------------
@pytest.mark.parametrize("name", ["kuka_iiwa", "panda"])
def test_posture_and_damping_do_not_change_the_acceleration_of_the_tip(name):
    robot, home = robot_named(name)
    plain = InverseDynamics(k_null=0.0)
    tending = InverseDynamics(posture=home - 0.5, k_posture=30.0, k_null=7.0)
    for (q, dq), a in zip(states(robot, home), generator(316).normal(size=(10, 6)), strict=True):
        state = robot.dynamic_state(q, dq)
        ddq, ddq_0 = tending.acceleration(state, a), plain.acceleration(state, a)
        J, free = state.arm.J, np.linalg.svd(state.arm.J)[2][6]
        assert_close(J @ ddq, J @ ddq_0, NULL_SPACE)
        assert_close(J @ ddq + state.dJ_dq, a, NULL_SPACE)
        assert free @ ddq_0 == pytest.approx(0, abs=NULL_SPACE)
        expected = free @ (-7 * dq - 30 * (q - home + 0.5))
        assert free @ ddq == pytest.approx(expected, abs=NULL_SPACE)


def at_the_wrist_singularity():
    """Return joints of the UR5 whose axes 4 and 6 are in line, and the motion that is lost."""
    q = HOME.copy()
    q[4] = 0.0
    U, sigma, Vt = np.linalg.svd(UR5.state(q, STILL).J)
    assert sigma[-1] < ALGEBRAIC
    return q, U[:, 5], Vt[5]


def test_at_a_singularity_the_motion_that_does_not_move_the_tip_is_damped():
    q, lost, free = at_the_wrist_singularity()
    for speed, k_null in ((0.5, 10.0), (-1.0, 4.0), (1.0, 0.0)):
        state = UR5.dynamic_state(q, speed * free)
        ddq = InverseDynamics(k_null=k_null).acceleration(state, np.zeros(6))
        assert free @ ddq == pytest.approx(-k_null * speed, abs=NULL_SPACE)
        # and an acceleration of the tip that no joint can give is not tried
        other = InverseDynamics(k_null=k_null).acceleration(state, 1e3 * lost)
        assert_close(other, ddq, 1e3 * NULL_SPACE)


# --- the scheme at 1 kHz -------------------------------------------------------------------


def lead_round(scheme, *angles):
    """Let the desired frame turn about z [rad]; return where it ends, and the last tick."""
    home = pose_of(UR5, HOME)
    for angle in angles:
        turned = home._replace(R_d=about(2, angle) @ home.R_d)
        tick = scheme.tick(DT, HOME, STILL, turned)
    return turned, tick


@pytest.mark.parametrize(
    "interrupt",
    [lambda scheme: scheme.reset(HOME), lambda scheme: scheme.hold(DT, HOME, STILL)],
    ids=["reset", "hold"],
)
def test_a_reset_and_a_hold_forget_the_displacement_of_before_and_end_a_blend(interrupt):
    scheme = dynamic(sign="continuous")
    turned, tick = lead_round(scheme, 2.0, 3.0, 4.0)
    assert tick.x_de.Q_de.eta < 0
    interrupt(scheme)
    assert scheme.tick(DT, HOME, STILL, turned).x_de.Q_de.eta > 0
    scheme.replace_law(law(k_Pp=900.0), InverseDynamics(), EffortLimits())
    blended = scheme.tick(DT, HOME, STILL, displaced())
    assert np.abs(blended.command.effort - unlimited_effort(scheme, blended)).max() > 1
    interrupt(scheme)
    tick = scheme.tick(DT, HOME, STILL, displaced())
    assert_close(tick.command.effort, unlimited_effort(scheme, tick), NULL_SPACE)


# --- limits --------------------------------------------------------------------------------
def unlimited_effort(scheme, tick):
    """Return the efforts of the law alone for a tick."""
    state = UR5.dynamic_state(tick.state.q, tick.state.dq)
    a, _, _ = scheme.law.acceleration(state.arm, tick.desired, None)
    return scheme.dynamics.effort(scheme.robot, state.arm, scheme.dynamics.acceleration(state, a))


def test_a_tick_is_saturated_if_and_only_if_a_limit_changed_its_command():
    path = from_home_to(displaced(0.3, 1.5, key=5), 0.4)
    slow = UR5.limits.scaled(0.3)
    scheme, plant, told = dynamic(limits_of(rate=300.0, joints=slow)), Plant(), set()
    for step in range(600):
        tick = scheme.tick(DT, plant.q, plant.dq, path.sample(step * DT))
        changed = np.abs(tick.command.effort - unlimited_effort(scheme, tick)).max() > 1e-9
        assert tick.saturated == changed
        told.add(tick.saturated)
        plant.step(tick.command.effort)
    assert told == {True, False}


def test_without_limits_nothing_bounds_the_efforts_and_no_error_stops_the_motion():
    scheme = dynamic(EffortLimits(None, rate=1.0, error_position=1e-3, error_rotation=1e-3))
    bounded("clik", 1e-3, 1e-3).tick(DT, HOME, STILL, displaced(2.0, 2.0))
    for goal in (pose_of(UR5, HOME), displaced(2.0, 2.0)):
        tick = scheme.tick(DT, HOME, STILL, goal)
        assert_close(tick.command.effort, unlimited_effort(scheme, tick), NULL_SPACE)
        assert not tick.saturated
    assert np.any(np.abs(tick.command.effort) > UR5.limits.effort)
    of_pi = dynamic(limits_of(rotation=math.pi))
    for angle in (1.0, 3.0, math.pi):
        assert np.isfinite(of_pi.tick(DT, HOME, STILL, displaced(0.0, angle)).command.effort).all()


def test_the_tip_brakes_hardly_more_than_it_may_where_an_error_is_undone():
    random, motion = generator(991), MotionLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0)
    gains = {"k_Pp": 3600.0, "k_Vp": 120.0, "k_Po": 7200.0, "k_Vo": 120.0}
    scheme = dynamic(EffortLimits(UR5.limits, RATE, motion=motion), **gains)
    goal, plant, braking = pose_of(UR5, HOME), Plant(), np.zeros(2)
    plant.q = HOME + 0.1 * random.uniform(-1, 1, 6)
    for step in range(500):
        tick = scheme.tick(DT, plant.q, plant.dq, goal)
        ddq = plant.acceleration(plant.q, plant.dq, tick.command.effort)
        a = np.reshape(plant.tip_acceleration(plant.q, plant.dq, ddq), (2, 3))
        if step > 100:  # it is under way
            braking = np.maximum(braking, np.linalg.norm(a, axis=1))
        plant.step(tick.command.effort)
    assert (braking > 0.95 * np.array(motion.accelerations)).all()
    assert (braking < 1.25 * np.array(motion.accelerations)).all()


# --- the rate of the efforts ---------------------------------------------------------------
def assert_rate_is_kept(efforts, rate, dt=DT):
    """Assert that no effort changes faster than its rate between two commands, dt [s] apart.

    Return how fast [Nm/s] the fastest one changes from command to command.
    """
    fastest = np.abs(np.diff(efforts, axis=0)).max(axis=1) / dt
    np.testing.assert_array_less(fastest, rate * (1 + 1e-9))
    return fastest


class Run:
    """A controller of dynamic control on the arm, step by step; keeps what it commands."""

    def __init__(self, scheme, options=None):
        self.scheme, self.plant, self.t = scheme, Plant(), T_0
        self.controller = Controller(scheme, options or ControllerOptions(), self.plant.q)
        self.efforts, self.faults = [], []

    def steps(self, count, held=False):
        """Do some steps; the arm does not move while it is held by others."""
        for _ in range(count):
            self.t += MS
            command = self.controller.step(self.t, self.plant.q, self.plant.dq)
            assert np.isfinite(command.effort).all()
            self.efforts.append(command.effort)
            self.faults.append(self.controller.fault)
            if held:
                self.plant.dq = np.zeros(6)
            else:
                self.plant.step(command.effort)


def towards(frame, duration=1.0):
    return way_points([duration], [frame[:2]])


def test_the_rate_is_kept_through_a_change_of_law_a_hold_a_fault_and_a_new_reference():
    rate, limits = 400.0, limits_of(rate=400.0, position=0.01, rotation=0.2)
    run = Run(dynamic(limits))
    run.steps(20)
    run.controller.orders.follow(towards(displaced(0.15, 0.8), 0.6), None)
    run.steps(250)
    for name, gain in (("euler_angles", 900.0), ("angle_axis", 200.0)):
        run.scheme.replace_law(law(name, gain, k_Pp=gain), InverseDynamics(), limits)
        run.steps(60)
    run.controller.orders.halt()  # in the middle of the motion
    run.steps(600)
    run.controller.orders.resume()
    run.controller.orders.follow(towards(displaced(0.15, 0.8), 0.6), None)
    run.steps(150)
    run.steps(600, held=True)  # somebody holds the arm until the error is too large
    assert "from the desired frame" in run.faults[-1]
    run.steps(600)  # a fault is left by a reference after a pause
    run.controller.orders.follow(towards(pose_of(UR5, HOME), 0.5), None)
    run.steps(300)
    assert run.faults[-1] == ""
    fastest = assert_rate_is_kept(run.efforts, rate)
    assert np.sum(fastest > 0.999 * rate) > 20  # it was a bound
    assert run.controller.guidance.saturated > 0


def test_a_smaller_limit_of_the_effort_is_approached_at_the_rate():
    scheme, goal = dynamic(limits_of(rate=500.0)), pose_of(UR5, HOME)
    last = scheme.tick(DT, HOME, STILL, goal).command.effort
    weak = replace(UR5.limits, effort=np.full(6, 10.0))
    assert np.abs(last).max() > 25
    scheme.replace_law(law(), InverseDynamics(), limits_of(rate=500.0, joints=weak))
    for _ in range(60):
        tick = scheme.tick(DT, HOME, STILL, goal)
        assert tick.saturated
        assert_rate_is_kept([last, tick.command.effort], 500.0)
        last = tick.command.effort
    assert np.abs(last).max() == 10.0


def test_after_a_gap_of_the_stamps_the_efforts_begin_anew():
    run, q = Run(dynamic(limits_of(rate=1.0))), HOME + np.array([0, 0.5, 0, 0, 0, 0])
    run.steps(5)
    command = run.controller.step(run.t + 10_000 * MS, q, STILL)
    assert np.abs(gravity(q) - run.efforts[-1]).max() > 5
    assert_close(command.effort, gravity(q), NULL_SPACE)


# --- another law ---------------------------------------------------------------------------
@pytest.mark.parametrize("before", ORIENTATIONS)
@pytest.mark.parametrize("after", ORIENTATIONS)
def test_a_law_is_replaced_by_another_without_a_jump_of_the_effort(before, after):
    goal = displaced()
    scheme = dynamic(name=before, k_Po=100.0)
    (q, dq) = states(UR5, HOME)[0]
    last = scheme.tick(DT, q, dq, goal).command.effort
    other = law(after, 900.0, k_Pp=900.0)
    scheme.replace_law(other, InverseDynamics(), EffortLimits())
    tick = scheme.tick(DT, q, dq, goal)
    assert_close(tick.command.effort, last, NO_JUMP)
    assert np.abs(unlimited_effort(scheme, tick) - last).max() > 5  # there was something to jump


def test_a_blend_of_the_acceleration_decays_exponentially_to_the_new_law_and_dynamics():
    (q, dq), goal = states(UR5, HOME)[0], displaced()
    scheme = dynamic(name="euler_angles", blend_time=0.1)
    scheme.tick(DT, q, dq, goal)
    dynamics = InverseDynamics(gravity=False, friction=FRICTION)
    scheme.replace_law(law(k_Pp=900.0), dynamics, EffortLimits())
    B, offsets = UR5.dynamic_state(q, dq).B, []
    for _ in range(3):
        tick = scheme.tick(0.05, q, dq, goal)
        offset = np.linalg.solve(B, tick.command.effort - unlimited_effort(scheme, tick))
        offsets.append(offset)
    assert scheme.dynamics == dynamics
    assert np.abs(offsets[0]).max() > 1
    for i in (1, 2):
        assert_close(offsets[i], math.exp(-0.5 * i) * offsets[0], 100 * NO_JUMP)


def test_a_law_keeps_to_the_long_way_round_unless_its_rule_for_the_sign_changes():
    for other in (law(k_Po=900.0, sign="continuous"), law(sign="hysteretic")):
        scheme = dynamic(sign="continuous")
        turned, before = lead_round(scheme, 2.0, 3.0, 3.5)  # within the hysteresis of the other
        assert before.x_de.Q_de.eta < 0
        scheme.replace_law(other, InverseDynamics(), EffortLimits())
        eta = scheme.tick(DT, HOME, STILL, turned).x_de.Q_de.eta
        keeps = other.orientation.options.sign.name == "continuous"
        assert eta == (before.x_de.Q_de.eta if keeps else -before.x_de.Q_de.eta)


def test_of_a_law_that_saturates_nothing_goes_on():
    scheme = dynamic(limits_of(rate=math.inf))
    assert scheme.tick(DT, HOME, STILL, displaced(0.5, 0.1)).saturated
    scheme.replace_law(law(k_Po=0.0, k_Pp=0.0), InverseDynamics(), limits_of(rate=math.inf))
    tick = scheme.tick(DT, HOME, STILL, displaced(0.5, 0.1))
    assert_close(tick.command.effort, gravity(), NULL_SPACE)


def test_a_tick_that_is_refused_leaves_the_step_to_another_law_to_the_next_one():
    goal, limits = displaced(0.01, 0.05), limits_of(rate=math.inf, position=1.0)
    scheme = dynamic(limits)
    before = scheme.tick(DT, HOME, STILL, goal).command.effort
    scheme.replace_law(law(k_Pp=900.0), InverseDynamics(), limits)
    with pytest.raises(FollowingError):
        scheme.tick(DT, HOME, STILL, displaced(2.0))
    assert_close(scheme.tick(DT, HOME, STILL, goal).command.effort, before, NULL_SPACE)


# --- hold ----------------------------------------------------------------------------------


def test_hold_is_stiff_as_effort_limits_and_sampling_bear_and_critically_damped():
    nothing, q, dq = np.zeros(6), HOME + 1e-3 * np.arange(6), 0.01 * np.ones(6)
    begun, state = UR5.dynamic_state(HOME, STILL), UR5.dynamic_state(q, dq)
    hold = JointHold(UR5.limits, np.full(6, math.inf), UR5.length, begun, nothing, None, False)
    squares, V = np.linalg.eig(np.linalg.solve(state.B, np.diag(UR5.limits.effort / 0.05)))
    w = np.minimum(np.sqrt(squares), 60.0 * math.exp(DT / 0.6))  # it begins so
    root = V @ np.diag(w) @ np.linalg.inv(V)
    expected = state.C_dq + state.g + state.B @ (root @ root @ (HOME - q) - 2 * root @ dq)
    assert_close(hold.effort(DT, state, nothing, nothing, None), expected, NULL_SPACE)


def test_hold_leaves_the_friction_that_helps_to_stop():
    schemes = dynamic(), dynamic(dynamics=InverseDynamics(friction=FRICTION))
    rubbed, free = (scheme.hold(DT, HOME, 0.1 * np.ones(6)).effort for scheme in schemes)
    np.testing.assert_array_equal(rubbed, free)


def test_hold_does_not_undo_whole_turns_of_a_joint_without_position_limits():
    robot = robot_of("ur5")
    none = np.full(6, math.inf)
    robot.limits = replace(robot.limits, lower=-none, upper=none)
    scheme = dynamic(robot=robot)
    scheme.hold(DT, HOME, STILL)
    effort = scheme.hold(DT, HOME + 2 * math.pi * np.array([1, 0, -1, 0, 2, 0]), STILL).effort
    assert_close(effort, gravity(), NULL_SPACE)


@pytest.mark.parametrize("compensated", [True, False])
def test_the_last_command_is_gravity_alone_within_the_limits(compensated):
    dynamics = InverseDynamics(gravity=compensated, friction=FRICTION)
    scheme = dynamic(limits_of(rate=1.0), dynamics)
    scheme.tick(DT, HOME, STILL, displaced())
    effort = scheme.last_command(HOME, 0.5 * np.ones(6)).effort
    np.testing.assert_array_equal(effort, compensated * gravity())
    weak = robot_of("ur5")
    weak.limits = replace(weak.limits, effort=np.full(6, 10.0))
    effort = dynamic(robot=weak).last_command(HOME, STILL).effort
    np.testing.assert_array_equal(effort, np.clip(gravity(), -10, 10))


def test_hold_begins_anew_after_a_tick_or_a_reset_and_its_start_frame_is_the_measured_pose():
    scheme, q = dynamic(), HOME + 0.2
    g, frame = UR5.dynamic_state(q, STILL).g, pose_of(UR5, q)

    def led():
        for _ in range(300):  # as long as what was felt elsewhere is forgotten
            scheme.tick(DT, q, STILL, frame)

    for begin_anew in (led, lambda: scheme.reset(q)):
        scheme.hold(DT, HOME, STILL)
        np.testing.assert_array_equal(scheme.start_frame().p_d, pose_of(UR5, HOME).p_d)
        begin_anew()
        assert_close(scheme.hold(DT, q, STILL).effort, g, NULL_SPACE)
        np.testing.assert_array_equal(scheme.start_frame().p_d, frame.p_d)
    scheme.reset(q)
    q += 1  # it keeps no array of others
    np.testing.assert_array_equal(scheme.start_frame().p_d, frame.p_d)


def test_a_law_without_a_finite_answer_is_told_and_nothing_kept():
    schemes, goal = [dynamic(limits_of()) for _ in range(2)], displaced()
    for scheme in schemes:
        scheme.tick(DT, HOME, STILL, goal)
    far = goal._replace(ddp_d=np.array([1e200, 0, 0]))
    q, lost, _ = at_the_wrist_singularity()
    undamped = dynamic(dynamics=InverseDynamics(DampedInverse(eps=0.0)), q=q)
    beyond = pose_of(UR5, q)._replace(ddp_d=1e150 * lost[:3], domega_d=1e150 * lost[3:])
    for scheme, at, frame, words in (
        (schemes[1], HOME, far, "infinite acceleration"),
        (undamped, q, beyond, "infinite joint"),
    ):
        with np.errstate(all="ignore"), pytest.raises(SingularityError, match=words):
            scheme.tick(DT, at, STILL, frame)
    expected, tick = (scheme.tick(DT, HOME, STILL, displaced(0.05)) for scheme in schemes)
    np.testing.assert_array_equal(tick.command.effort, expected.command.effort)


def test_hold_needs_no_jacobian_nor_orientation_and_leaves_an_arm_where_others_braked_it():
    q, _, _ = at_the_wrist_singularity()
    scheme = dynamic(name="euler_angles", dynamics=InverseDynamics(DampedInverse(eps=0)))
    assert_close(scheme.hold(DT, q, STILL).effort, gravity(q), NULL_SPACE)
    scheme = dynamic(limits_of(joints=replace(UR5.limits, acceleration=np.full(6, 10.0))))
    for k in range(3000):
        command = scheme.hold(0.01, HOME, STILL if k else np.ones(6))
    assert_close(command.effort, gravity(), 1e-3)  # what the brakes bore fades in 2 s


# --- joints that turn on and on ------------------------------------------------------------
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
    posture, still, turn = q + 0.2, np.zeros(7), 2 * math.pi * np.eye(7)[0]
    desired = pose_of(robot, q)
    dynamics = InverseDynamics(posture=posture)
    for scheme in (
        Clik(robot, ClikLaw(make("euler_parameters"), posture=posture)),
        dynamic(dynamics=dynamics, q=q, robot=robot),
    ):
        commands = []
        for measured in (q, q + turn, q - turn):
            scheme.reset(measured)
            command = scheme.tick(1e-3, measured, still, desired).command
            commands.append(command.dq if command.effort is None else command.effort)
        assert_close(commands[1:], [commands[0]] * 2, 1e-9)


def test_a_restart_goes_on_by_the_turn_commanded_and_the_limiter_never_the_long_way(turning):
    (robot, q), still, turn = turning, np.zeros(7), 2 * math.pi * np.eye(7)[0]
    scheme = Clik(robot, ClikLaw(make("euler_parameters")), limits=robot.limits)
    scheme.reset(q + turn)
    scheme.resume(q + 0.01)  # wrapped by its driver
    q_c = scheme.tick(1e-3, q, still, scheme.start_frame()).command.q
    assert_close(q_c, q + turn + 0.01, ALGEBRAIC)
    limiter = CommandLimiter(robot.limits)
    limiter(JointCommand(q + turn, still), q, 1e-3, 1e-3)
    for _ in range(1000):
        command = limiter(JointCommand(q, still), q, 1e-3, 1e-3)
        assert_close(command.q, q + turn, 1e-12)


# --- where efforts begin, and what they are limited for ------------------------------------
def test_the_limits_of_efforts_count_what_the_robot_adds():
    robot = robot_of("panda")
    q = np.array([0.0, 1.5, 0.0, -0.1, 0.0, 1.6, 0.0])  # stretched out: heavy
    state = robot.dynamic_state(q, np.zeros(7))
    far = pose_of(robot, q)
    for added, options in ((0.0, {}), (state.g, {"gravity": False})):
        for way in (-0.09, 0.09):
            scheme = dynamic(limits_of(robot, 1e9), InverseDynamics(**options), q=q, robot=robot)
            stiff = replace(scheme.law, k_Pp=1e4)
            scheme.replace_law(stiff, scheme.dynamics, scheme.limits)
            scheme.reset(q)
            goal = far._replace(p_d=far.p_d + [0.0, 0.0, way])
            effort = scheme.tick(1e-3, q, np.zeros(7), goal).command.effort
            total = np.abs(effort + added)
            assert (total <= robot.limits.effort * (1 + RELATIVE)).all()
            assert total.max() == pytest.approx(robot.limits.effort[total.argmax()], rel=RELATIVE)


@pytest.mark.parametrize("reported", [None, np.zeros(6), np.arange(6.0)], ids=["no", "0", "yes"])
@pytest.mark.parametrize("gravity", [True, False])
def test_efforts_begin_at_what_acts_and_ramp_each_at_its_rate(reported, gravity):
    rate, dt = np.linspace(500.0, 1000.0, 6), 1e-3
    scheme = dynamic(limits_of(rate=rate), InverseDynamics(gravity=gravity))
    scheme.start_from(reported)
    home, start = pose_of(UR5, HOME), UR5.dynamic_state(HOME, STILL).g if gravity else STILL
    if gravity and reported is not None and reported.any():
        start = reported
    goal = home._replace(p_d=home.p_d + [0.0, 0.05, 0.09])
    times = dt * np.array([0.0, 1.0, 2.0, 5.0, 1.0, 0.1])
    efforts = [start] + [scheme.tick(t, HOME, STILL, goal).command.effort for t in times]
    steps, most = np.abs(np.diff(efforts, axis=0)), np.maximum(times, dt)[:, None] * rate
    assert (steps <= most + 1e-12).all()
    assert np.isclose(steps, most).any()


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
        controller = Controller(dynamic(limits_of(rate=1000.0)), ControllerOptions(), HOME, efforts)
        command = controller.step(1_000_000_000, HOME, STILL)
        assert np.abs(command.effort - start).max() <= 1000.0 * 1e-3 + 1e-12


def test_a_limit_of_acceleration_leaves_the_efforts_against_a_disturbance():
    plant, dt, disturbance = Plant(), 1e-3, np.array([0.0, 3.0, 3.0, 1.0, 1.0, 1.0])
    joints = replace(UR5.limits, acceleration=np.full(6, 5.0))  # of 1 Nm the wrist makes 58
    scheme, home, plant.q = (
        dynamic(limits_of(rate=1000.0, joints=joints)),
        pose_of(UR5, HOME),
        HOME.copy(),
    )
    for _ in range(1500):
        effort = scheme.tick(dt, plant.q, plant.dq, home).command.effort
        plant.step(effort + disturbance, dt)
        assert np.abs(plant.dq).max() < 1.5  # it takes some 20 ms until that is known
    assert np.abs(plant.dq).max() < 1e-3
    assert angle_between(pose_of(UR5, plant.q).R_d, home.R_d) < 0.2


def test_a_stop_under_efforts_keeps_the_acceleration_and_does_not_swing():
    plant, dt, a = Plant(), 1e-3, 5.0
    joints = replace(UR5.limits, acceleration=np.full(6, a))
    scheme, plant.q = dynamic(limits_of(rate=1e5, joints=joints)), HOME.copy()
    plant.dq = start = np.array([0.8, -0.4, 0.3, 0.2, 0.1, -0.5])
    end = HOME + start * 0.8 / (0.8 * a) / 2  # at 80 % of a
    for _ in range(1500):
        before = plant.dq
        plant.step(scheme.hold(dt, plant.q, plant.dq).effort, dt)
        assert np.abs(plant.dq - before).max() <= a * dt * 1.1
        assert (plant.dq / start).min() > -1e-3
    assert np.abs(plant.dq).max() < 1e-3
    assert_close(plant.q, end, 1e-3)


# --- the size of the arm -------------------------------------------------------------------
def scaled(name, factor):
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
        sigma = sigma_min(J_l, large.length)
        assert sigma_min(J_s, small.length) == pytest.approx(sigma, abs=1e-12)
        damped += sigma < DampedInverse.eps
        v_l, v_s = np.ones(6), np.array([0.25] * 3 + [1.0] * 3)
        dq_l = DampedInverse(length=large.length)(J_l) @ v_l
        dq_s = DampedInverse(length=small.length)(J_s) @ v_s
        assert_close(dq_s, dq_l, 1e-7 * np.linalg.norm(dq_l))
    assert 20 < damped < 150


@pytest.mark.parametrize(
    "gains", [(40.0, 0.0, 40.0, 4.0), (0.0, 0.0, 40.0, 4.0), (4.0, 4.0, 40.0, 0.0)]
)
def test_a_loop_without_damping_asks_for_what_its_gains_say(gains):
    law = ResolvedAcceleration(make("euler_parameters"), *gains)
    arm = UR5.state(HOME, STILL)
    desired = DesiredFrame(arm.p_e + [0.1, 0.0, 0.0], exp(np.array([0.0, 0.2, 0.0])) @ arm.R_e)
    a, dp_de, x_de = law.acceleration(arm, desired, None)
    assert_close(a, [*(gains[0] * dp_de), *(gains[2] * x_de.eps_de)], 1e-12)


# --- too large an error --------------------------------------------------------------------
DEG = math.radians(1)


def bounded(scheme, position=math.inf, rotation=math.inf, **limits):
    """Return CLIK, or dynamic control with an orientation, whose errors are bounded."""
    if scheme != "clik":
        return dynamic(limits_of(position=position, rotation=rotation), name=scheme)
    law = ClikLaw(make("euler_parameters"))
    found = Clik(UR5, law, max_error=ErrorBounds(position, rotation), **limits)
    found.reset(HOME)
    return found


@pytest.mark.parametrize("name", ["euler_parameters", "euler_angles", "clik"])
@pytest.mark.parametrize(
    ("bound", "within", "beyond", "text"),
    [
        ({"position": 0.05}, (0.04999, 0.0), (0.051, 0.0), r"0\.051 m .* 0\.05 m is allowed"),
        ({"rotation": 10 * DEG}, (0.0, 9.99 * DEG), (0.0, 10.5 * DEG), r"10\.5 deg.* 10\.0 deg is"),
    ],
    ids=["position", "rotation"],
)
def test_an_error_beyond_its_bound_stops_the_motion(name, bound, within, beyond, text):
    scheme = bounded(name, **bound, limits=UR5.limits)
    scheme.tick(DT, HOME, STILL, displaced(*within))
    scheme.reset(HOME)
    with pytest.raises(FollowingError, match=f"{text}.*max_error_{next(iter(bound))}"):
        scheme.tick(DT, HOME, STILL, displaced(*beyond))


# --- Lyapunov functions of a run, eqs. (42), (43) ------------------------------------------


def test_over_a_change_of_the_law_no_derivative_of_V_2_is_measured():
    run = Run(dynamic())
    run.controller.orders.follow(towards(displaced(0.05, 0.3)), None)
    run.steps(100)
    missing = [run.controller.guidance.lyapunov() is None]
    run.scheme.replace_law(law(k_Po=100.0), InverseDynamics(), EffortLimits())
    run.controller.changed(ControllerOptions())
    for _ in range(3):
        missing.append(run.controller.guidance.lyapunov() is None)
        run.steps(1)
    assert missing == [False, True, True, False]


# --- bad input -----------------------------------------------------------------------------
BOUNDS = ("rate", "error_position", "error_rotation")
COMPLIANCE = ("position", "rotation", "speed")


def clik(**gains):
    return ClikLaw(make("euler_parameters"), **gains)


def friction(friction_viscous=0.0, friction_coulomb=0.0):
    return JointFriction(np.array([friction_viscous]), np.array([friction_coulomb]))


@pytest.mark.parametrize(
    ("make", "names", "values", "text"),
    [
        (clik, ("k_Pp", "k_Po", "k_posture"), (-1.0, math.nan, math.inf), "expected >= 0"),
        (ComplianceBounds, COMPLIANCE, (0.0, -1.0, math.nan), "expected > 0"),
        (law, ("k_Pp", "k_Vp", "k_Po", "k_Vo"), (-1.0, math.nan, math.inf), "expected >= 0"),
        (InverseDynamics, ("k_posture", "k_null"), (-1.0, math.nan, math.inf), "expected >= 0"),
        (EffortLimits, BOUNDS, (0.0, -1.0, math.nan), "expected > 0"),
        (friction, ("friction_viscous", "friction_coulomb"), (-0.1, math.nan, math.inf), ""),
    ],
    ids=["CLIK", "compliance", "gains", "null space", "bounds", "friction"],
)
def test_an_impossible_number_is_refused_with_its_name_and_value(make, names, values, text):
    for name, value in product(names, values):
        with pytest.raises(ConfigurationError, match=rf"{name} is \[?{value}.*{text}"):
            make(**{name: value})


@pytest.mark.parametrize(
    ("dynamics", "text"),
    [
        (InverseDynamics(posture=np.zeros(5)), "posture has 5 values"),
        (InverseDynamics(friction=JointFriction(np.ones(2), np.ones(6))), "friction_viscous has 2"),
        (InverseDynamics(friction=JointFriction(np.ones(6), np.ones(7))), "friction_coulomb has 7"),
    ],
)
def test_values_of_the_wrong_number_are_refused_and_a_law_with_them_is_not_taken(dynamics, text):
    scheme, words = dynamic(), rf"{text}.* 6 joints shoulder_pan_joint, .*elbow"
    kept = scheme.law, scheme.dynamics, scheme.limits
    with pytest.raises(ConfigurationError, match=words):
        scheme.replace_law(law("euler_angles"), dynamics, limits_of())
    assert (scheme.law, scheme.dynamics, scheme.limits) == kept
    with pytest.raises(ConfigurationError, match=words):
        dynamic(dynamics=dynamics)


# A turret on a lift; what stands for LIFT and LIMIT varies.
TURRET = """
<robot name="turret"> <link name="world"/> <link name="base"/>
  <link name="turret">INERTIA</link>
  <joint name="lift" type="LIFT"> <parent link="world"/> <child link="base"/> <axis xyz="0 0 1"/>
    <limit lower="0" upper="1" velocity="1" effort="9"/> </joint>
  <joint name="turn" type="revolute"> <parent link="base"/> <child link="turret"/>
    <axis xyz="0 0 1"/> <limit lower="-1" upper="1" velocity="1" effort="LIMIT"/> </joint>
</robot>
"""
INERTIA = """<inertial> <mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/> </inertial>"""


@pytest.mark.parametrize(
    ("inertia", "lift", "limit", "text"),
    [
        ("", "fixed", "9", "not positive definite.*lacks <inertial>.*beyond turn"),
        (INERTIA, "fixed", "0", "effort limit of 0 for turn"),
        (INERTIA, "revolute", "9", "lift can turn between the root.*base: the direction of grav"),
    ],
)
def test_a_robot_whose_efforts_cannot_be_known_is_refused(inertia, lift, limit, text):
    def turret(inertia, lift, limit):
        urdf = TURRET.replace("INERTIA", inertia).replace("LIFT", lift).replace("LIMIT", limit)
        return dynamic(robot=Robot(urdf, "base", "turret"), q=np.zeros(1))

    for harmless in ("fixed", "prismatic"):
        turret(INERTIA, harmless, "9")
    with pytest.raises(RobotError, match=text):
        turret(inertia, lift, limit)
