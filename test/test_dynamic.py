"""Dynamic control: the closed loop (32)-(43), its limits, redundancy, change of law, holding.

The arm is simulated by Pinocchio's forward dynamics, which has neither B nor C dq.
"""

import math
import re
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import arms
import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, displaced, pose_of, robot_named, robot_of, situations
from samples import about, generator
from tolerances import ALGEBRAIC, ERROR_EQUATION, NO_JUMP, NULL_SPACE, RELATIVE, assert_close

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import (
    ConfigurationError,
    FollowingError,
    RobotError,
    SingularityError,
)
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.hold import JointHold
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.motion.trajectories import way_points
from eulerparams_control.parameters.compliance_control import ComplianceParameters
from eulerparams_control.parameters.dynamic_control import DynamicParameters
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.urdf import COULOMB_SPEED

DT = 1e-3  # [s]
ANY_RATE = (math.inf,)
VISCOUS, COULOMB = (0.5, 0.4, 0.3, 0.2, 0.1, 0.05), tuple(np.arange(6) / 3)
FRICTION = {"compensate_friction": True, "friction_viscous": VISCOUS, "friction_coulomb": COULOMB}

# The sequence is far from its pole at the home of the UR5.
clik = partial(arms.clik, euler_sequence="ZYX")
limited = partial(arms.dynamic_control, euler_sequence="ZYX")
free = partial(limited, limited=False)


def springs(orientation="euler_parameters", *, limited=False, **values):
    """Return compliance control, begun at home."""
    values |= {"orientation": orientation, "euler_sequence": "ZYX", "enforce_limits": limited}
    return arms.begun(ComplianceParameters(**values))


def change(scheme, **values):
    """Let a scheme go over to parameters that differ in some values."""
    scheme.change(replace(scheme.parameters, **values))


def value(tick):
    """Return the velocities or the efforts (n,) that a tick commands."""
    return tick.command.dq if tick.command.effort is None else tick.command.effort


def law_alone(scheme, tick):
    """Return the ``value`` of the law of a scheme for a tick: no limits, nothing before."""
    state, parameters = tick.state, replace(scheme.parameters, enforce_limits=False)
    alone = arms.begun(parameters, q=state.q, robot=scheme.robot)
    return value(alone.tick(0.0, state.q, state.dq, tick.desired))


def gravity(q=HOME):
    return UR5.dynamic_state(q, STILL).g


# --- the law (33) on the model (32) --------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "arm"),
    [(name, "ur5") for name in ORIENTATIONS]
    + [("euler_parameters", arm) for arm in ("kuka_iiwa", "panda", "ur10")],
)
def test_the_position_error_obeys_eq_37_and_the_orientation_follows_a_o(name, arm):
    (robot, home), plant = robot_named(arm), Plant(arm)
    gains = {"k_Pp": 70.0, "k_Vp": 11.0, "k_Po": 50.0, "k_Vo": 9.0}
    scheme = free(name, robot=robot, posture=tuple(home + 0.1), **gains)
    for q, dq, desired in situations(robot, home):
        scheme.reset(q)
        tick = scheme.tick(0.0, q, dq, desired)
        ddq, at = plant.acceleration(q, dq, tick.command.effort), tick.state
        accelerated = plant.tip_acceleration(q, dq, ddq)
        ddp_de, dp_de = desired.ddp_d - accelerated[:3], desired.p_d - at.p_e
        residual = ddp_de + 11 * (desired.dp_d - at.dp_e) + 70 * dp_de  # eq. (37)
        assert_close(residual, 0, ERROR_EQUATION)
        np.testing.assert_array_equal(tick.dp_de, dp_de)  # eq. (21)
        motion = desired.omega_d, desired.domega_d, at.omega_e
        a_o = scheme.orientation.acceleration(tick.x_de, *motion, 50.0, 9.0)
        assert_close(accelerated[3:], a_o, ERROR_EQUATION)  # (35)
        by_J = at.J @ ddq + robot.dynamic_state(q, dq).dJ_dq  # the derivative of eq. (20)
        assert_close(by_J, accelerated, ERROR_EQUATION)


@pytest.mark.parametrize("switch", ["gravity", "coriolis", "friction"])
def test_a_switch_that_is_off_leaves_out_exactly_its_term(switch):
    on, off = free(**FRICTION), free(**{**FRICTION, f"compensate_{switch}": False})
    for q, dq, desired in situations():
        state = UR5.dynamic_state(q, dq)
        d = np.array(VISCOUS) * dq + np.array(COULOMB) * np.tanh(dq / COULOMB_SPEED)
        term = {"gravity": state.g, "coriolis": state.C_dq, "friction": d}[switch]
        tau, without = (one.tick(0.0, q, dq, desired).command.effort for one in (on, off))
        assert_close(tau - without, term, 1e3 * ALGEBRAIC)
        assert np.abs(term).max() > 0.01
        whole = state.B @ on.ddq + state.C_dq + state.g + d  # eq. (33)
        assert_close(tau, whole, 1e3 * ALGEBRAIC)


# --- redundancy ----------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["kuka_iiwa", "panda"])
def test_posture_and_damping_act_in_the_null_space_and_do_not_move_the_tip(name):
    robot, home = robot_named(name)
    to_posture = {"posture": tuple(home - 0.5), "k_posture": 30.0}
    kinematic = [clik(robot=robot, q=home, **more) for more in ({}, to_posture)]
    dynamic = [free(robot=robot, **more) for more in ({"k_null": 0.0}, to_posture | {"k_null": 7})]
    for q, dq, desired in situations(robot, home):
        J, away = robot.state(q, dq).J, q - home + 0.5
        null, found = np.linalg.svd(J)[2][6], []
        for scheme in (*kinematic, *dynamic):
            scheme.reset(q)
            tick = scheme.tick(0.0, q, dq, desired)
            found.append(scheme.ddq if scheme in dynamic else tick.command.dq)
        for plain, tending, expected in (
            (*found[:2], -30 * away),
            (*found[2:], -7 * dq - 30 * away),
        ):
            assert_close(J @ tending, J @ plain, NULL_SPACE)
            assert_close(null @ plain, 0, NULL_SPACE)
            assert_close(null @ tending, null @ expected, NULL_SPACE)


# --- what a tick keeps ---------------------------------------------------------------------
def lead_round(scheme, *angles):
    """Let the desired frame turn about z [rad]; return where it ends, and the last tick."""
    home = pose_of(UR5, HOME)
    for angle in angles:
        turned = home._replace(R_d=about(2, angle) @ home.R_d)
        tick = scheme.tick(0.0, HOME, STILL, turned)
    return turned, tick


@pytest.mark.parametrize(("make", "jump"), [(clik, 0.1), (free, 1)])
@pytest.mark.parametrize(
    "interrupt",
    [lambda scheme: scheme.reset(HOME), lambda scheme: scheme.hold(DT, HOME, STILL)],
    ids=["reset", "hold"],
)
def test_a_reset_and_a_hold_forget_the_displacement_of_before_and_end_a_blend(
    make, jump, interrupt
):
    scheme = make(quaternion_sign="continuous")
    turned, tick = lead_round(scheme, 2.0, 3.0, 4.0)
    assert tick.x_de.Q_de.eta < 0
    interrupt(scheme)
    assert scheme.tick(DT, HOME, STILL, turned).x_de.Q_de.eta > 0
    change(scheme, k_Pp=900.0)
    blended = scheme.tick(0.0, HOME, STILL, displaced())
    assert np.abs(value(blended) - law_alone(scheme, blended)).max() > jump
    interrupt(scheme)
    tick = scheme.tick(0.0, HOME, STILL, displaced())
    assert_close(value(tick), law_alone(scheme, tick), NULL_SPACE)


AT_THE_WRIST = HOME * (1, 1, 1, 1, 0, 1)  # its singularity: axes 4 and 6 are in line


@pytest.mark.parametrize(
    ("make", "q", "beyond", "words"),
    [
        (clik, HOME, {"p_d": np.full(3, math.inf)}, "infinite joint velocity"),
        (limited, HOME, {"ddp_d": np.full(3, 1e200)}, "infinite acceleration of the tip"),
        (partial(free, damping_eps=0.0), AT_THE_WRIST, {"ddp_d": np.full(3, 1e150)}, "joint acc"),
    ],
)
def test_a_law_without_a_finite_answer_is_told(make, q, beyond, words):
    scheme, desired = make(q=q), pose_of(UR5, q)._replace(**beyond)
    with np.errstate(all="ignore"), pytest.raises(SingularityError, match=words):
        scheme.tick(DT, q, STILL, desired)


# --- limits --------------------------------------------------------------------------------
def test_without_limits_no_error_stops_the_motion():
    for make in (clik, free):
        make(max_error_position=1e-3).tick(DT, HOME, STILL, displaced(0.1))


def test_a_tick_is_saturated_if_and_only_if_a_limit_changed_its_command():
    goal = displaced(0.3, 1.5, key=5)
    path = way_points([0.0, 0.4], [pose_of(UR5, HOME)[:2], goal[:2]])
    scheme = limited(max_effort_rate=(300.0,), velocity_scale=0.3)
    plant, seen = Plant(), set()
    for step in range(600):
        tick = scheme.tick(DT, plant.q, plant.dq, path.sample(step * DT))
        changed = np.abs(tick.command.effort - law_alone(scheme, tick)).max() > 1e-9
        assert tick.saturated == changed
        seen.add(tick.saturated)
        plant.step(tick.command.effort)
    assert seen == {True, False}


@pytest.mark.parametrize(
    "scheme",
    [
        *(limited, partial(limited, "euler_angles")),
        *(partial(make, limited=True) for make in (clik, springs)),
    ],
)
@pytest.mark.parametrize(
    ("name", "bound", "within", "beyond", "text"),
    [
        ("position", 0.05, (0.04999, 0.0), (0.051, 0.0), r"0\.051 m .* 0\.05 m is allowed"),
        ("rotation", 0.17, (0.0, 0.1699), (0.0, 0.175), r"10\.0 deg.* 9\.7 deg is allowed"),
    ],
)
def test_an_error_beyond_its_bound_stops_the_motion(scheme, name, bound, within, beyond, text):
    bounded = scheme(**{f"max_error_{name}": bound})
    bounded.tick(DT, HOME, STILL, displaced(*within))
    bounded.reset(HOME)
    with pytest.raises(FollowingError, match=f"{text}.*max_error_{name}"):
        bounded.tick(DT, HOME, STILL, displaced(*beyond))


def test_the_tip_brakes_hardly_more_than_it_may_where_an_error_is_undone():
    random, gains = generator(991), {"k_Pp": 3600.0, "k_Vp": 120.0, "k_Po": 7200.0, "k_Vo": 120.0}
    scheme = limited(shape_motion=True, **gains)
    goal, plant, braking = pose_of(UR5, HOME), Plant(), np.zeros(2)
    plant.q = HOME + 0.1 * random.uniform(-1, 1, 6)
    for step in range(500):
        tick = scheme.tick(DT, plant.q, plant.dq, goal)
        ddq = plant.acceleration(plant.q, plant.dq, tick.command.effort)
        a = np.reshape(plant.tip_acceleration(plant.q, plant.dq, ddq), (2, 3))
        if step > 100:  # it is under way
            braking = np.maximum(braking, np.linalg.norm(a, axis=1))
        plant.step(tick.command.effort)
    accelerations = np.array(scheme.parameters.motion_limits().accelerations)
    assert (braking > 0.95 * accelerations).all()
    assert (braking < 1.25 * accelerations).all()


@pytest.mark.parametrize("compensated", [True, False])
def test_the_limits_of_efforts_count_what_the_robot_adds(compensated):
    robot, still = robot_of("panda"), np.zeros(7)
    q = np.array([0.0, 1.5, 0.0, -0.1, 0.0, 1.6, 0.0])  # stretched out: heavy
    state, far = robot.dynamic_state(q, still), pose_of(robot, q)
    for way in (-0.09, 0.09):
        options = {"compensate_gravity": compensated, "max_effort_rate": (1e9,)}
        scheme = limited(robot=robot, q=q, k_Pp=1e4, **options)
        goal = far._replace(p_d=far.p_d + [0.0, 0.0, way])
        total = scheme.tick(1e-3, q, still, goal).command.effort + (not compensated) * state.g
        part = np.abs(total) / robot.limits.effort
        assert part.max() == pytest.approx(1, rel=RELATIVE)
        step, asked = total - state.g, state.B @ scheme.ddq  # shortened as a whole
        assert_close(step / np.linalg.norm(step), asked / np.linalg.norm(asked))


def test_a_limit_of_acceleration_leaves_the_efforts_against_a_disturbance():
    plant, dt, disturbance = Plant(), 1e-3, np.array([0.0, 3.0, 3.0, 1.0, 1.0, 1.0])
    options = {"max_effort_rate": (1000.0,), "max_joint_acceleration": (5.0,)}
    scheme, home = limited(**options), pose_of(UR5, HOME)  # of 1 Nm the wrist makes 58
    for _ in range(1500):
        effort = scheme.tick(dt, plant.q, plant.dq, home).command.effort
        plant.step(effort + disturbance, dt)
        assert np.abs(plant.dq).max() < 1.5  # it takes some 20 ms until that is known
    assert np.abs(plant.dq).max() < 1e-3
    assert angle_between(pose_of(UR5, plant.q).R_d, home.R_d) < 0.2


# --- the rate of the efforts ---------------------------------------------------------------


@pytest.mark.parametrize("reported", [None, np.zeros(6), np.full(6, math.nan), np.arange(6.0)])
@pytest.mark.parametrize("compensated", [True, False])
def test_efforts_begin_at_what_acts_and_ramp_each_at_its_rate(reported, compensated):
    rate, home, start = np.linspace(500.0, 1000.0, 6), pose_of(UR5, HOME), compensated * gravity()
    scheme = limited(max_effort_rate=tuple(rate), compensate_gravity=compensated)
    Controller(scheme, ControllerOptions(), HOME, reported)
    if compensated and reported is not None and reported.any() and np.isfinite(reported).all():
        start = reported
    goal = home._replace(p_d=home.p_d + [0.0, 0.05, 0.09])
    times = DT * np.array([0.0, 1.0, 2.0, 5.0, 1.0, 0.1])
    efforts = [scheme.tick(t, HOME, STILL, goal).command.effort for t in times]
    steps, most = np.abs(np.diff([start, *efforts], axis=0)), np.maximum(times, DT)[:, None] * rate
    assert (steps <= most + 1e-12).all()
    assert np.isclose(steps, most).any()


# --- another law ---------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "gains", "jump"),
    [
        *((make, {"k_Po": 90.0, "k_Pp": 90.0}, jump) for make, jump in ((clik, 0.1), (free, 5))),
        (springs, {"K_p": (3000.0,) * 3, "K_o": (50.0,) * 3}, 5),
    ],
)
@pytest.mark.parametrize("before", ORIENTATIONS)
@pytest.mark.parametrize("after", ORIENTATIONS)
def test_a_law_is_replaced_by_another_without_a_jump_and_acts_in_the_end(
    make, gains, jump, before, after
):
    scheme, goal, (q, dq) = make(before), displaced(), situations()[0][:2]
    scheme.reset(q)
    for _ in range(5):
        last = scheme.tick(DT, q, dq, goal)
    change(scheme, orientation=after, **gains)
    tick = scheme.tick(DT, q, dq, goal)
    assert_close(value(tick), value(last), NO_JUMP)
    assert np.abs(law_alone(scheme, tick) - value(last)).max() > jump  # there was something to jump
    for _ in range(300):
        tick = scheme.tick(0.01, q, dq, goal)
    assert_close(value(tick), law_alone(scheme, tick), NO_JUMP)


@pytest.mark.parametrize("make", [clik, free])
@pytest.mark.parametrize(("sign", "kept"), [("continuous", 1), ("hysteretic", -1)])
def test_a_law_keeps_to_the_long_way_round_unless_its_rule_for_the_sign_changes(make, sign, kept):
    scheme = make(quaternion_sign="continuous")
    turned, before = lead_round(scheme, 2.0, 3.0, 3.5)  # within the hysteresis of the other
    assert before.x_de.Q_de.eta < 0
    change(scheme, k_Po=900.0, quaternion_sign=sign)
    tick = scheme.tick(0.0, HOME, STILL, turned)
    assert tick.x_de.Q_de.eta == kept * before.x_de.Q_de.eta
    assert_close(value(tick), value(before), NO_JUMP)


def test_of_a_law_that_saturates_nothing_goes_on():
    scheme = limited(max_effort_rate=ANY_RATE)
    assert scheme.tick(DT, HOME, STILL, displaced(0.5, 0.1)).saturated
    change(scheme, k_Po=0.0, k_Pp=0.0)
    tick = scheme.tick(DT, HOME, STILL, displaced(0.5, 0.1))
    assert_close(tick.command.effort, gravity(), NULL_SPACE)


# --- hold ----------------------------------------------------------------------------------
def test_hold_is_stiff_as_effort_limits_and_sampling_bear_and_critically_damped():
    nothing, q, dq = np.zeros(6), HOME + 1e-3 * np.arange(6), 0.01 * np.ones(6)
    begins, state = UR5.dynamic_state(HOME, STILL), UR5.dynamic_state(q, dq)
    hold = JointHold(UR5.limits, np.full(6, math.inf), UR5.length, begins, nothing, None, False)
    squares, V = np.linalg.eig(np.linalg.solve(state.B, np.diag(UR5.limits.effort / 0.05)))
    w = np.minimum(np.sqrt(squares), 60.0 * math.exp(DT / 0.6))  # it begins so
    root = V @ np.diag(w) @ np.linalg.inv(V)
    expected = state.C_dq + state.g + state.B @ (root @ root @ (HOME - q) - 2 * root @ dq)
    assert_close(hold.effort(DT, state, nothing, nothing, None), expected, NULL_SPACE)


def test_hold_asks_for_no_more_than_the_limits_of_the_efforts():
    for away, dq in np.split(generator(77).uniform(-1, 1, size=(40, 6)), 20):
        scheme = limited(max_effort_rate=(1e9,))
        scheme.hold(DT, HOME, STILL)
        effort = scheme.hold(DT, HOME + away, 3.0 * dq).effort
        assert (np.abs(effort) <= UR5.limits.effort).all()


def test_hold_leaves_the_friction_that_helps_to_stop():
    efforts = [one.hold(DT, HOME, STILL + 0.1).effort for one in (free(), free(**FRICTION))]
    np.testing.assert_array_equal(*efforts)


def test_hold_does_not_undo_whole_turns_of_a_joint_without_position_limits():
    robot, none = robot_of("ur5"), np.full(6, math.inf)
    robot.limits = replace(robot.limits, lower=-none, upper=none)
    scheme = free(robot=robot)
    scheme.hold(DT, HOME, STILL)
    effort = scheme.hold(DT, HOME + 2 * math.pi * np.array([1, 0, -1, 0, 2, 0]), STILL).effort
    assert_close(effort, gravity(), NULL_SPACE)


@pytest.mark.parametrize("compensated", [True, False])
def test_the_last_command_is_gravity_alone_within_the_limits(compensated):
    scheme = limited(max_effort_rate=(1.0,), compensate_gravity=compensated, **FRICTION)
    scheme.tick(DT, HOME, STILL, displaced())
    effort = scheme.last_command(HOME, 0.5 * np.ones(6)).effort
    np.testing.assert_array_equal(effort, compensated * gravity())
    weak = robot_of("ur5")
    weak.limits = replace(weak.limits, effort=np.full(6, 10.0))
    effort = free(robot=weak).last_command(HOME, STILL).effort
    np.testing.assert_array_equal(effort, np.clip(gravity(), -10, 10))


def test_hold_begins_anew_after_a_tick_or_a_reset_and_its_start_frame_is_the_measured_pose():
    scheme, q = free(), HOME + 0.2
    g, frame = gravity(q), pose_of(UR5, q)

    def lead():
        for _ in range(300):  # as long as what was felt elsewhere is forgotten
            scheme.tick(DT, q, STILL, frame)

    for begin_anew in (lead, lambda: scheme.reset(q)):
        scheme.hold(DT, HOME, STILL)
        np.testing.assert_array_equal(scheme.start_frame().p_d, pose_of(UR5, HOME).p_d)
        begin_anew()
        assert_close(scheme.hold(DT, q, STILL).effort, g, NULL_SPACE)
        np.testing.assert_array_equal(scheme.start_frame().p_d, frame.p_d)


def test_hold_needs_no_jacobian_nor_orientation_and_leaves_an_arm_where_others_braked_it():
    scheme = free("euler_angles", damping_eps=0.0)
    effort = scheme.hold(DT, AT_THE_WRIST, STILL).effort
    assert_close(effort, gravity(AT_THE_WRIST), NULL_SPACE)
    scheme = limited(max_joint_acceleration=(10.0,))
    for k in range(3000):
        command = scheme.hold(0.01, HOME, STILL if k else np.ones(6))
    assert_close(command.effort, gravity(), 1e-3)  # what the brakes bore fades in 2 s


def test_a_stop_under_efforts_keeps_the_acceleration_and_does_not_swing():
    plant, a = Plant(), 5.0
    scheme = limited(max_effort_rate=(1e5,), max_joint_acceleration=(a,))
    plant.dq = start = np.array([0.8, -0.4, 0.3, 0.2, 0.1, -0.5])
    end = HOME + start * 0.8 / (0.8 * a) / 2  # at 80 % of a
    for _ in range(1500):
        before = plant.dq
        plant.step(scheme.hold(DT, plant.q, plant.dq).effort, DT)
        assert np.abs(plant.dq - before).max() <= a * DT * 1.1
        assert (plant.dq / start).min() > -1e-3
    assert np.abs(plant.dq).max() < 1e-3
    assert_close(plant.q, end, 1e-3)


# --- joints that turn on and on ------------------------------------------------------------
TURN = 2 * math.pi * np.eye(7)[0]


def turning():
    """Return a seven-joint arm whose first joint has no limits, and its home."""
    robot = robot_of("panda")
    robot.limits.lower[0], robot.limits.upper[0] = -math.inf, math.inf
    robot.limits = replace(robot.limits)
    return robot, np.array(load_robot("panda").home)


@pytest.mark.parametrize("make", [clik, free])
def test_the_posture_is_the_same_by_any_turn(make):
    robot, q = turning()
    scheme, desired = make(robot=robot, posture=tuple(q + 0.2)), pose_of(robot, q)
    values = []
    for measured in (q, q + TURN, q - TURN):
        scheme.reset(measured)
        values.append(value(scheme.tick(DT, measured, np.zeros(7), desired)))
    assert_close(values[1:], [values[0]] * 2, 1e-9)


def test_a_restart_goes_on_by_the_turn_commanded():
    robot, q = turning()
    scheme = clik(limited=True, robot=robot, q=q + TURN)
    scheme.resume(q + 0.01)  # wrapped by its driver
    q_c = scheme.tick(DT, q, np.zeros(7), scheme.start_frame()).command.q
    assert_close(q_c, q + TURN + 0.01, ALGEBRAIC)


# --- bad input -----------------------------------------------------------------------------
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
@pytest.mark.parametrize("name", ["viscous", "coulomb"])
def test_an_impossible_friction_is_refused_with_its_name_and_value(name, value):
    values = {"viscous": np.zeros(1), "coulomb": np.zeros(1), name: np.array([value])}
    with pytest.raises(ConfigurationError, match=rf"friction_{name} is \[{value}"):
        JointFriction(**values)


@pytest.mark.parametrize(
    ("make", "others", "name", "values"),
    [
        (clik, {}, "posture", 5 * (0.0,)),
        (limited, {}, "max_joint_acceleration", 7 * (1.0,)),
        (limited, FRICTION, "friction_coulomb", 7 * (1.0,)),
        (limited, {}, "max_effort_rate", 3 * (1e3,)),
    ],
)
def test_values_of_the_wrong_number_are_refused(make, others, name, values):
    scheme = make()
    wrong = replace(scheme.parameters, **{**others, name: values})
    words = rf"{name} has {len(values)} values.* 6 joints shoulder_pan_joint, .*elbow"
    for take in (scheme.change, lambda parameters: parameters.make_scheme(UR5)):
        with pytest.raises(ConfigurationError, match=words):
            take(wrong)


@pytest.mark.parametrize(
    ("old", "new", "base_frame", "text"),
    [
        ("(?s)<inertial>.*?</inertial>", "", "", "not positive definite.*lacks <inertial>.*beyond"),
        ('effort="150.0"', 'effort="0"', "", "effort limit of 0 for shoulder_pan_joint, should"),
        ("", "", "shoulder_link", "shoulder_pan_joint can turn between .*: the direction of grav"),
        ('(pan_joint" type=)"revolute"', r'\1"prismatic"', "shoulder_link", ""),  # it is a lift
    ],
)
def test_a_robot_whose_efforts_cannot_be_known_is_refused(old, new, base_frame, text):
    parameters = DynamicParameters(base_frame=base_frame, tip_frame="tool0", rotor_inertia=(0.1,))
    robot = parameters.robot(re.sub(old, new, load_robot("ur5").urdf))  # rotors hide nothing
    with pytest.raises(RobotError, match=text) if text else nullcontext():
        DynamicParameters().make_scheme(robot)
