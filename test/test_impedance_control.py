"""Impedance control of an arm: eqs. (48)-(52), (59), E17, E20, faults; section V, Fig. 3.

The arm is for one instant Pinocchio's forward dynamics; where nothing but the compliant frame
matters it stands still.
"""

import math
import re
from functools import cache

import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, robot_named
from representations import every_representation, make
from samples import (
    about,
    angle,
    derivative,
    generator,
    moving,
    rodrigues,
    skew,
    turn_of,
    uniform,
    unit_vectors,
)
from simulated import MS
from tolerances import (
    ALGEBRAIC,
    AT_POINT_WRENCH,
    DIFFERENCES,
    ERROR_EQUATION,
    KINEMATICS,
    V_3_SAMPLED,
    assert_close,
)

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.control.mode import Cause
from eulerparams_control.errors import FollowingError
from eulerparams_control.laws.compliant_frame import ComplianceLaw
from eulerparams_control.laws.dynamic_control import (
    DynamicControl,
    EffortLimits,
    ResolvedAcceleration,
)
from eulerparams_control.laws.impedance_control import ImpedanceControl, ImpedanceLaw, NoMotionLoop
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.inverse_dynamics import InverseDynamics
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.wrench import SensedWrench, WrenchChain, WrenchOptions
from eulerparams_control.motion.frames import DesiredFrame, Placement
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Tool

DT = 1e-3  # [s]
I = np.eye(3)
O = np.zeros(3)
NO_WRENCH = np.zeros(6)
AT_TIP = Placement(I, O)
SOFT_P = Impedance(10 * I, 500 * I, 1000 * I)
SOFT_O = Impedance(I, 20 * I, 50 * I)
RATE = 2000.0  # [Nm/s]
NO_LIMITS = EffortLimits()

MIDDLE = DesiredFrame(
    np.array([0.485, 0.07, 0.425]), about(1, math.radians(60)) @ about(2, math.pi / 2)
)  # T1's mid-point


@cache
def at_the_middle():
    """Return q of the UR5 at T1's mid-point."""
    return inverse_kinematics(UR5, MIDDLE, HOME)


def resolved(name="euler_parameters"):
    """Return the inner loop of the experiments, with the same bandwidth for all."""
    k_Po = 7200.0 if name == "euler_parameters" else 3600.0
    return ResolvedAcceleration(make(name), 3600.0, 120.0, k_Po, 120.0)


def impedance_law(name="euler_parameters", p=SOFT_P, o=SOFT_O, frame="base", wrench=None, **given):
    return ImpedanceLaw(ComplianceLaw(make(name), p, o, frame), wrench or WrenchOptions(), **given)


def limits_of(rate=RATE, position=0.1):
    return EffortLimits(UR5.limits, rate, position, error_rotation=0.5)


def impedance_control(limits=NO_LIMITS, robot=UR5, inner="euler_parameters", **law):
    motion = DynamicControl(robot, resolved(inner), InverseDynamics(), limits)
    return ImpedanceControl(motion, impedance_law(**law))


def admittance(limits=NO_LIMITS, **law):
    """Return the scheme that makes the compliant frame only, begun at the mid-point."""
    scheme = ImpedanceControl(NoMotionLoop(UR5, limits), impedance_law(**law))
    scheme.reset(at_the_middle())
    return scheme


def sensed_at_tip(w, R_e):
    """Return what a sensor at the tip says of a wrench (6,) in base axes."""
    return SensedWrench(np.concatenate((R_e.T @ w[:3], R_e.T @ w[3:])), AT_TIP)


# --- eqs. (48)-(52): one instant ---------------------------------------------------------------
def situations(arm, count=5):
    """Return random q, dq near home, desired frames near the tip, and contacts."""
    robot, home = robot_named(arm)
    random = generator(1000)
    for _ in range(count):
        q, dq = home + 0.2 * random.uniform(-1, 1, robot.n), random.normal(size=robot.n)
        state = robot.state(q, dq)
        x = random.normal(size=3)
        turn = rodrigues(0.3, x / np.linalg.norm(x))
        p_d = state.p_e + 0.02 * random.normal(size=3)
        desired = DesiredFrame(p_d, turn @ state.R_e, *random.normal(size=(4, 3)))
        yield q, dq, desired, 20 * random.normal(size=6)


@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_with_the_wrench_compensated_the_joints_accelerate_as_without_contact(arm):  # (48)
    plant, (robot, _) = Plant(arm), robot_named(arm)
    motion = DynamicControl(robot, resolved(), InverseDynamics(), NO_LIMITS)
    for q, dq, desired, w in situations(arm):
        state = robot.dynamic_state(q, dq)
        motion.reset(q)
        free = motion.tick(DT, q, dq, desired).command.effort
        motion.reset(q)
        touched = motion.tick(DT, q, dq, desired, -w).command.effort
        expected = plant.acceleration(q, dq, free, NO_WRENCH)
        assert_close(plant.acceleration(q, dq, touched, w), expected, ERROR_EQUATION)
        tau = motion.dynamics.effort(robot, state.arm, expected, w)
        wrong = plant.acceleration(q, dq, tau, w)
        assert np.abs(wrong - expected).max() > 1  # h for w


@every_representation
@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_the_tip_accelerates_as_the_motion_loop_asks_for_the_compliant_frame(arm, name):
    plant, (robot, _) = Plant(arm), robot_named(arm)  # (49)-(51)
    inner = "angle_axis" if name == "relative_euler_angles" else name  # it may be another
    for q, dq, desired, w in situations(arm):
        scheme = impedance_control(robot=robot, name=name, inner=inner)
        scheme.reset(q)
        arm_state = robot.state(q, dq)
        scheme.sense(sensed_at_tip(w, arm_state.R_e))
        tick = scheme.tick(DT, q, dq, desired)
        assert_close(tick.command.frame.p_d, arm_state.p_e, KINEMATICS)  # it begins there
        assert_close(tick.command.frame.omega_d, arm_state.omega_e, 1e-9)
        again = scheme.tick(0.05, q, dq, desired)  # the arm has stayed behind
        frame = again.command.frame
        assert np.linalg.norm(frame.p_d - arm_state.p_e) > 1e-3
        assert angle(frame.R_d, arm_state.R_e) > 1e-3
        ddq = plant.acceleration(q, dq, again.command.effort, w)
        found = plant.tip_acceleration(q, dq, ddq)
        a, _, _ = resolved(inner).acceleration(arm_state, frame, None)
        size = max(1.0, np.abs(a).max())
        assert_close(found, a, 100 * ERROR_EQUATION * size)
        a_p = frame.ddp_d + 120 * (frame.dp_d - arm_state.dp_e) + 3600 * (frame.p_d - arm_state.p_e)
        assert_close(found[:3], a_p, 100 * ERROR_EQUATION * size)  # (49)


@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_without_inner_loop_the_tip_itself_obeys_the_impedance_at_each_tick(arm):  # (52), (59)
    plant, (robot, _) = Plant(arm), robot_named(arm)
    scheme = impedance_control(robot=robot, inner_loop=False)
    for q, dq, desired, w in situations(arm):
        scheme.sense(sensed_at_tip(w, robot.state(q, dq).R_e))
        tick = scheme.tick(DT, q, dq, desired)
        a = plant.tip_acceleration(q, dq, plant.acceleration(q, dq, tick.command.effort, w))
        e, d = tick.state, desired
        forces = 10 * (a[:3] - d.ddp_d) + 500 * (e.dp_e - d.dp_d) + 1000 * (e.p_e - d.p_d)
        assert_close(forces, w[:3], 1e-5)
        turn = turn_of(d.R_d.T @ e.R_e)
        theta = np.linalg.norm(turn)
        x = d.R_d.T @ (e.omega_e - d.omega_d)
        dx = d.R_d.T @ (a[3:] - d.domega_d - np.cross(d.omega_d, e.omega_e))
        moments = dx + 20 * x + 50 * math.sin(theta) / theta * turn
        assert_close(moments, d.R_d.T @ w[3:], 1e-5)


# --- the compliant frame alone: an arm that stands still ------------------------------------------
def lead(scheme, w, duration, dt=0.02):
    """Return the ticks of a scheme whose arm stands still under a wrench (6,), base axes."""
    sensed = sensed_at_tip(w, UR5.state(at_the_middle(), STILL).R_e)
    ticks = []
    for _ in range(round(duration / dt)):
        scheme.sense(sensed)
        ticks.append(scheme.tick(dt, at_the_middle(), STILL, MIDDLE))
    return ticks


def lose(scheme, dt=DT):
    """Return a tick of a scheme whose arm stands still and feels nothing."""
    scheme.sense(None)
    assert scheme.is_frozen
    return scheme.tick(dt, at_the_middle(), STILL, MIDDLE)


def change_to(scheme, law, limits=NO_LIMITS):
    scheme.replace_law(law, resolved(), InverseDynamics(), limits)


def test_without_a_motion_loop_nothing_but_the_compliant_frame_is_commanded():
    scheme = admittance()
    tick = lead(scheme, np.array([5.0, -10.0, 20.0, 1.0, 0.5, -1.0]), 4.0)[-1]
    frame = tick.command.frame
    assert tick.command[:3] == (None, None, None)
    assert_close(frame.p_d - MIDDLE.p_d, [5e-3, -0.01, 0.02], 1e-4)
    turn = turn_of(frame.R_d @ MIDDLE.R_d.T)
    np.testing.assert_allclose(50 * np.sin(turn), [1, 0.5, -1], rtol=1e-2)
    for command in (scheme.hold(DT, HOME, STILL), scheme.last_command(HOME, STILL)):
        assert command[:3] == (None, None, None)
        assert_close(command.frame.p_d, UR5.state(HOME, STILL).p_e, KINEMATICS)
        np.testing.assert_array_equal(command.frame.dp_d, 0)


def test_where_it_begins_anew_in_contact_the_desired_frame_balances_the_contact():
    """Else the arm would go where the contact pushes it, by f / K_p, after each gap and stop."""
    scheme, w = admittance(), np.array([5.0, -10.0, 20.0, 1.0, 0.5, -1.0])
    lead(scheme, w, 0.1)
    home = UR5.state(HOME, STILL)
    for begin_anew in (scheme.reset, scheme.resume):
        scheme.sense(sensed_at_tip(w, home.R_e))
        begin_anew(HOME)
        desired = scheme.start_frame()
        assert_close(1000 * (home.p_e - desired.p_d), w[:3], 1e-9)
        turn = turn_of(home.R_e @ desired.R_d.T)
        np.testing.assert_allclose(50 * turn, w[3:], rtol=1e-6, atol=1e-9)
        assert scheme.frame_at(HOME).p_d == pytest.approx(desired.p_d)
        scheme.sense(sensed_at_tip(w, home.R_e))
        ticks = [scheme.tick(DT, HOME, STILL, desired) for _ in range(500)]
        moved = ticks[-1].command.frame.p_d - home.p_e
        assert np.abs(moved).max() < 1e-9
    for begin_anew in (scheme.reset, lambda q: scheme.hold(DT, q, STILL)):
        scheme.sense(sensed_at_tip(NO_WRENCH, home.R_e))  # the contact is gone meanwhile
        scheme.tick(DT, HOME, STILL, desired)
        begin_anew(HOME)
        assert scheme.start_frame().p_d == pytest.approx(home.p_e)


def about_point(p, R, force):
    return np.concatenate((force, np.cross(R @ p, force)))


CENTRE = Placement(rodrigues(0.7, unit_vectors(1, key=20)[0]), np.array([0.05, -0.02, 0.15]))


def test_the_axes_of_the_centre_are_those_of_the_stiffness():
    soft = Impedance(2 * I, 100 * I, np.diag([500.0, 1000.0, 2000.0]))
    R = MIDDLE.R_d @ CENTRE.R
    own = admittance(p=soft, frame="desired", centre=CENTRE)
    for i, stiffness in enumerate((500.0, 1000.0, 2000.0)):
        own.reset(at_the_middle())
        w = about_point(CENTRE.p, MIDDLE.R_d, 10 * R[:, i])
        frame = lead(own, w, 2.0)[-1].command.frame
        assert_close(frame.p_d - MIDDLE.p_d, 10 / stiffness * R[:, i], 1e-4)
    K_o = Impedance(0.2 * I, 5 * I, np.diag([20.0, 50.0, 100.0]))
    moment = 2 * R[:, 0]
    last = lead(admittance(o=K_o, centre=CENTRE), np.array([*O, *moment]), 2.0)[-1]
    turn = turn_of(last.command.frame.R_d @ MIDDLE.R_d.T)
    assert_close(turn, math.asin(2 / 20) * R[:, 0], 1e-4)


def test_V_3_is_that_of_the_centre_and_its_measured_rate_that_of_eq_69():
    Z = Impedance(*map(np.diag, ([0.5, 1.0, 2.0], [8.0, 12.0, 16.0], [20.0, 50.0, 100.0])))
    scheme = admittance(o=Z, centre=CENTRE)
    controller = Controller(scheme, ControllerOptions(), at_the_middle())
    controller.orders.follow(SetPoint(MIDDLE, 10.0), 0)
    R, rates = UR5.state(at_the_middle(), STILL).R_e, []
    for k in range(200):
        w = np.array([20.0, -30.0, 0.0, 8 * math.sin(0.03 * k), 5.0, -4 * math.cos(0.05 * k)])
        scheme.sense(sensed_at_tip(w, R))
        controller.step(k * MS, at_the_middle(), STILL)
        told = controller.guidance.lyapunov()
        if told is not None:
            rates.append(told)
    V, by_paper, measured = np.array(rates).T
    mean = (by_paper[1:] + by_paper[:-1]) / 2
    assert_close(measured[1:], mean, V_3_SAMPLED * np.abs(by_paper).max())
    tick = controller.guidance.tick_now
    there, desired = (f.carrying(CENTRE) for f in (tick.command.frame, tick.desired))
    x, turn = desired.R_d.T @ there.omega_d, turn_of(desired.R_d.T @ there.R_d)
    theta = np.linalg.norm(turn)
    eps = math.sin(theta / 2) / theta * turn
    expected = x @ Z.M @ x / 2 + 2 * eps @ Z.K @ eps  # (68)
    assert V[-1] == pytest.approx(expected, rel=1e-9)
    assert V[-1] > 0.01


def test_without_a_frame_or_a_wrench_there_is_no_V_3():
    scheme = admittance()
    tick = lead(scheme, NO_WRENCH, 0.02)[-1]
    assert scheme.lyapunov(tick) is not None
    assert scheme.lyapunov(tick._replace(wrench=None)) is None
    assert scheme.lyapunov(tick._replace(command=tick.command._replace(frame_row=None))) is None
    angles = admittance(name="euler_angles")
    assert angles.lyapunov(lead(angles, NO_WRENCH, 0.02)[-1]) is None


# --- a wrench that is lost, and found again -------------------------------------------------------
BLEND_TIME = 0.1  # [s] in which a wrench goes, or comes back


@pytest.mark.parametrize("lost", [0.05, 1.0])
def test_a_wrench_fades_when_it_is_lost_and_comes_back_as_slowly(lost):
    """In (48), that is; the impedance takes it at once when it is back."""
    scheme, w, q = impedance_control(), np.array([10.0, 0, 5.0, 0, 1.0, 0]), at_the_middle()
    lead(scheme, w, 0.1, dt=0.01)
    fade, steps = math.exp(-DT / BLEND_TIME), round(lost / DT)
    J, reference = UR5.state(q, STILL).J, impedance_control()

    def known():
        """Return the wrench that the efforts of the last tick compensate."""
        frame = tick.command.frame
        reference.motion.reset(q)
        without = reference.motion.tick(DT, q, STILL, frame).command.effort
        return np.linalg.solve(J.T, without - tick.command.effort)

    for k in range(steps):
        tick = lose(scheme)
        if k in (0, steps // 2, steps - 1):
            assert_close(known(), fade**k * w, 1e-9)
    for k in range(300):
        tick = lead(scheme, w, DT, dt=DT)[0]
        expected = (1 - (1 - fade ** (steps - 1)) * fade ** (k + 1)) * w
        assert_close(tick.wrench, w, 1e-9)
        if k in (0, 100, 299):
            assert_close(known(), expected, 1e-9)


def test_the_inertia_of_the_tool_is_that_of_the_last_step_when_a_wrench_is_found_again():
    """The arm goes on while no wrench comes: its change of speed since then is no acceleration."""
    tool = Tool(2.0, np.array([0.0, 0.02, 0.05]), 0.002 * I)
    options = WrenchOptions(tool=tool, gravity=(0.0, 0.0, 0.0))
    scheme, q = impedance_control(wrench=options), at_the_middle()
    R, dq = MIDDLE.R_d, np.full(6, 0.2)
    scheme.sense(sensed_at_tip(NO_WRENCH, R))
    scheme.tick(DT, q, STILL, MIDDLE)
    scheme.sense(None)
    scheme.tick(DT, q, dq, MIDDLE)
    scheme.sense(sensed_at_tip(NO_WRENCH, R))
    found = scheme.tick(DT, q, dq, MIDDLE).wrench
    assert np.abs(found).max() < 1.0  # centripetal; 0.2 rad/s within 1 ms would be above 100 N


def test_the_inertia_of_a_moving_tool_is_taken_out_by_the_acceleration_of_the_last_step():
    tool = Tool(2.0, np.array([0.02, -0.03, 0.08]), np.diag([0.01, 0.02, 0.015]))
    options = WrenchOptions(tool=tool)
    scheme, q = impedance_control(wrench=options), at_the_middle()
    sensed = SensedWrench(NO_WRENCH, AT_TIP)
    dq, ddq = np.full(6, 0.2), np.arange(1.0, 7.0)
    for rate in (dq - DT * ddq, dq):
        scheme.sense(sensed)
        tick = scheme.tick(DT, q, rate, MIDDLE)
    state = UR5.dynamic_state(q, dq)
    a = state.arm.J @ ddq + state.dJ_dq  # the derivative of eq. (20)
    felt, still = (WrenchChain(options).contact(sensed, state.arm, x, DT) for x in (a, None))
    assert_close(tick.wrench, felt, ERROR_EQUATION)
    assert np.abs(felt - still).max() > 1.0


def test_without_any_wrench_the_frame_stands_where_the_tip_was_first():
    scheme, (q, dq, desired, w) = impedance_control(), next(situations("ur5"))
    scheme.reset(q)
    first = UR5.state(q, dq)
    for k in range(3):
        scheme.sense(None)
        tick = scheme.tick(DT, q + k * DT * dq, dq, desired)
        assert_close(tick.command.frame.p_d, first.p_e, KINEMATICS)
        np.testing.assert_array_equal(tick.command.frame.dp_d, 0)
        assert tick.wrench is None
        assert scheme.lyapunov(tick) is None
    scheme.sense(sensed_at_tip(w, first.R_e))
    after = scheme.tick(DT, q, dq, desired).command.frame
    assert_close(after.p_d, first.p_e, 1e-4)


def test_a_trajectory_waits_while_the_wrench_is_lost():
    there = MIDDLE._replace(p_d=MIDDLE.p_d + [0.0, 0.03, 0.0])
    scheme, R = admittance(), MIDDLE.R_d
    controller = Controller(scheme, ControllerOptions(), at_the_middle())
    path = Trajectory([0.0, 0.2], [MIDDLE, there])
    controller.orders.follow(path, 0)
    for k in range(400):
        lost = 100 <= k < 200
        scheme.sense(None if lost else sensed_at_tip(NO_WRENCH, R))
        controller.step(k * MS, at_the_middle(), STILL)
        t = k if k < 100 else max(99, k - 100)
        found, expected = controller.guidance.tick_now.desired, path.sample(t * DT)
        assert_close(found.p_d, expected.p_d, 1e-9)
    controller.orders.follow(Trajectory([0.0, 0.2], [there, MIDDLE]), None)
    for k in range(400, 501):
        controller.step(k * MS, at_the_middle(), STILL)  # the next one waits no more
    assert controller.guidance.tick_now.desired.p_d[1] - MIDDLE.p_d[1] == pytest.approx(0.015)


@pytest.mark.parametrize(("moved", "stops"), [(0.04, False), (0.06, True)])
def test_a_wrench_that_returns_while_the_frames_are_far_apart_stops(moved, stops):
    scheme, q, R = admittance(max_jump_position=0.05, max_jump_rotation=0.2), at_the_middle(), I
    felt, goal = sensed_at_tip(NO_WRENCH, R), MIDDLE._replace(p_d=MIDDLE.p_d + [moved, 0.0, 0.0])
    scheme.sense(felt)
    scheme.tick(0.0, q, STILL, MIDDLE)
    scheme.sense(None)
    for _ in range(5):  # set-points stream on meanwhile
        scheme.tick(DT, q, STILL, goal)
    scheme.sense(felt)
    if stops:
        with pytest.raises(FollowingError, match="max_jump_position"):
            scheme.tick(DT, q, STILL, goal)
        scheme.hold(DT, q, STILL)
        scheme.tick(DT, q, STILL, scheme.frame_at(q))  # at rest it goes on
    else:
        scheme.tick(DT, q, STILL, goal)
        scheme.tick(DT, q, STILL, goal._replace(p_d=goal.p_d + 0.5))  # only then


def largest_step(efforts):
    return np.abs(np.diff(efforts, axis=0)).max()


# --- another law -------------------------------------------------------------------------------
@pytest.mark.parametrize(("change", "end"), [("sign", -1.0), ("tare", 0.0)])
def test_another_sensor_or_tare_is_taken_over_without_a_step_of_the_wrench(change, end):
    scheme, w = admittance(), np.arange(1.0, 7.0)
    tick = lead(scheme, w, 0.02)[-1]
    assert_close(tick.wrench, w, AT_POINT_WRENCH)
    if change == "tare":
        scheme.tare(scheme.chain.felt(sensed_at_tip(w, tick.state.R_e), tick.state, None))
    else:
        other = impedance_law(wrench=WrenchOptions(sign=-1))
        change_to(scheme, other)
        assert scheme.law is other
    for k, tick in enumerate(lead(scheme, w, 0.3, dt=0.01)):
        share = math.exp(-k * 0.01 / BLEND_TIME)
        assert_close(tick.wrench, (end + (1 - end) * share) * w, AT_POINT_WRENCH)


def test_an_arm_that_does_not_follow_is_a_fault_also_by_limits_of_another_law():
    far, push = limits_of(position=0.015), np.array([0, 0, 30.0, 0, 0, 0])
    for scheme in (admittance(far), impedance_control(far)):
        scheme.reset(at_the_middle())
        with pytest.raises(FollowingError, match=r"0\.01\d m from the desired frame"):
            lead(scheme, push, 2.0)
    for scheme in (admittance(), impedance_control()):
        scheme.reset(at_the_middle())
        lead(scheme, push / 6, 0.2)
        change_to(scheme, impedance_law(), limits_of(position=1e-6))
        with pytest.raises(FollowingError):
            lead(scheme, push / 6, 0.2)


def test_a_law_with_another_centre_goes_on_from_the_same_frame_of_the_tip():
    scheme, w = admittance(), np.array([20.0, 0, 0, 0, 3, 0])
    before = lead(scheme, w, 0.2)[-1].command.frame
    for centre in (CENTRE, Placement(about(1, 0.4), np.array([0.1, 0.0, -0.1])), AT_TIP):
        change_to(scheme, impedance_law(centre=centre))
        after = lead(scheme, w, 1e-6, dt=1e-6)[-1].command.frame
        for of in ("p_d", "R_d", "dp_d", "omega_d"):
            assert_close(getattr(after, of), getattr(before, of), 1e-4)
        assert np.abs(after.dp_d).max() > 1e-3


@pytest.mark.parametrize(
    ("forget", "at"),
    [
        (lambda scheme: lose(scheme, 0.01), -1),  # it fades in again
        (lambda scheme: scheme.reset(at_the_middle()), 0),
        (lambda scheme: scheme.hold(0.01, at_the_middle(), STILL), 0),
    ],
    ids=["lost", "reset", "hold"],
)
def test_a_low_pass_begins_anew_where_the_wrench_was_not_followed(forget, at):
    scheme, w = admittance(wrench=WrenchOptions(cutoff=0.5)), np.array([10.0, 0, 5.0, 0, 1.0, 0])
    lead(scheme, NO_WRENCH, 0.1, dt=0.01)
    slow = lead(scheme, w, 0.02, dt=0.01)[-1]
    assert np.abs(slow.wrench).max() < 1
    forget(scheme)
    tick = lead(scheme, w, 2.0, dt=0.01)[at]
    np.testing.assert_allclose(tick.wrench, w, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("bound", "w", "text"),
    [
        ("max_force", [0, 18.0, 24.0, 0, 0, 0], r"30 N; at most 29 N.*max_contact_force"),
        ("max_moment", [0, 0, 0, 18.0, 0, 24.0], r"30 Nm; at most 29 Nm.*max_contact_torque"),
        ("max_force", [math.nan, 0, 0, 0, 0, 0], "nan N"),
    ],
)
def test_a_contact_that_is_too_large_is_a_fault_that_holds_the_arm(bound, w, text):
    scheme, q = impedance_control(limits_of(), **{bound: 29.0}), at_the_middle()
    controller = Controller(scheme, ControllerOptions(), q)
    for step, share in enumerate((0.5, 0.96, 1.0)):  # up to 28.8 N or Nm is allowed
        felt = np.array(w) if share == 1 else share * np.nan_to_num(w)
        scheme.sense(sensed_at_tip(felt, MIDDLE.R_d))
        command = controller.step(step * MS, q, STILL)
        assert bool(controller.fault) == (share == 1)
    assert re.search(text, controller.fault)
    assert controller.why.cause is Cause.CONTACT_TOO_LARGE
    assert_close(command.frame.p_d, UR5.state(q, STILL).p_e, KINEMATICS)
    assert np.isfinite(command.effort).all()
    scheme.law.refuse_wrench(28.9, 28.9)  # is allowed


# --- holding, and going on -----------------------------------------------------------------------
def test_a_stop_a_hold_and_a_reset_forget_the_frame_and_end_the_going_over_to_another_wrench():
    scheme, q, w = admittance(), at_the_middle(), np.array([20.0, 0, 0, 0, 0, 0])
    forgetting = (scheme.reset, scheme.resume, lambda q: scheme.hold(DT, q, STILL))
    for sign, forget in zip((-1, 1, -1), forgetting, strict=True):
        frame = lead(scheme, w, 1.0)[-1].command.frame
        assert np.linalg.norm(frame.p_d - MIDDLE.p_d) > 5e-3
        forget(q)
        frame = lead(scheme, NO_WRENCH, 0.02)[-1].command.frame
        assert_close(frame.p_d, MIDDLE.p_d, 1e-8)
        assert_close(frame.dp_d, 0, 1e-8)
        lead(scheme, w, 0.1)
        change_to(scheme, impedance_law(wrench=WrenchOptions(sign=sign)))
        lead(scheme, w, 0.02)
        forget(q)
        assert_close(lead(scheme, w, 0.02)[0].wrench, sign * w, AT_POINT_WRENCH)


def test_a_hold_and_a_resume_keep_the_efforts_as_they_are():
    scheme = impedance_control(limits_of(rate=100.0))
    scheme.reset(q := at_the_middle())
    scheme.sense(sensed_at_tip(np.array([0, 0, 50.0, 0, 0, 0]), MIDDLE.R_d))
    before = scheme.tick(DT, q, STILL, MIDDLE).command.effort
    held = scheme.hold(DT, q, STILL).effort
    assert largest_step([before, held]) <= 100.0 * DT + ALGEBRAIC
    scheme.resume(q)
    after = scheme.tick(DT, q, STILL, MIDDLE).command.effort
    assert largest_step([held, after]) <= 100.0 * DT + ALGEBRAIC
    last = scheme.last_command(q, STILL)
    assert_close(last.effort, UR5.dynamic_state(q, STILL).g, 1e-9)
    assert_close(last.frame.p_d, UR5.state(q, STILL).p_e, KINEMATICS)


# --- frames that are carried, gravity -------------------------------------------------------------
@pytest.mark.parametrize("key", range(10))
def test_a_carried_frame_moves_rigidly_with_its_carrier(key):
    motion, point = moving(key), Placement(uniform(1, 30 + key)[0], uniform(1, 40 + key)[0][0])

    def carried(t):
        return DesiredFrame(*motion(t)).carrying(point)

    def rate(of):
        return derivative(lambda h: getattr(carried(0.2 + h), of))

    p, R, *_ = motion(0.2)
    here = carried(0.2)
    assert_close(here.p_d, p + R @ point.p)
    assert_close(here.R_d, R @ point.R)
    for of in ("p_d", "dp_d", "omega_d"):
        assert_close(rate(of), getattr(here, f"d{of}"), DIFFERENCES)
    assert_close(rate("R_d"), skew(here.omega_d) @ here.R_d, DIFFERENCES)
    for found, original in zip(here.carrying(point.inverse), motion(0.2), strict=True):
        assert_close(found, original, 10 * ALGEBRAIC)
