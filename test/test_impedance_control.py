"""Impedance control of an arm: eqs. (48)-(52), (59), E17, E20, faults; section V, Fig. 3.

The arm is for one instant Pinocchio's forward dynamics; where nothing but the compliant frame
matters it stands still.
"""

import math
import re
from functools import cache

import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, robot_named, situations
from representations import every_representation, make
from samples import about, derivative, generator, moving, skew, turn_of, uniform
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
from eulerparams_control.laws.dynamic_control import DynamicControl, resolved_acceleration
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.wrench import SensedWrench, WrenchChain
from eulerparams_control.motion.frames import DesiredFrame, Placement
from eulerparams_control.motion.references import SetPoint
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.impedance_control import ImpedanceParameters

DT = 1e-3  # [s]
NO_WRENCH = np.zeros(6)
AT_TIP = Placement(np.eye(3), np.zeros(3))
BLEND_TIME = 0.1  # [s] in which a wrench goes, or comes back

MIDDLE = DesiredFrame(
    np.array([0.485, 0.07, 0.425]), about(1, math.radians(60)) @ about(2, math.pi / 2)
)  # T1's mid-point

SOFT = {
    **{"M_p": (10.0,) * 3, "D_p": (500.0,) * 3, "K_p": (1000.0,) * 3},
    **{"M_o": (1.0,) * 3, "D_o": (20.0,) * 3, "K_o": (50.0,) * 3},
}
# Nothing is bounded.
FREE = {
    "enforce_limits": False,
    **{"max_displacement_position": 100.0, "max_displacement_rotation": math.pi},
    **{"max_compliant_speed": 1e3, "max_jump_position": 100.0, "max_jump_rotation": math.pi},
    **dict.fromkeys(("max_contact_force", "max_contact_torque"), 1e6),
    **dict.fromkeys(("max_ripple_force", "max_ripple_torque"), 1e6),
}
LIMITED = {
    **{"enforce_limits": True, "shape_motion": False, "max_effort_rate": (2000.0,)},
    **{"max_error_position": 0.1, "max_error_rotation": 0.5},
}


@cache
def at_the_middle():
    """Return q of the UR5 at T1's mid-point."""
    return inverse_kinematics(UR5, MIDDLE, HOME)


def parameters(name="euler_parameters", **given):
    """Return those of the experiments: a motion loop of 60 1/s with each representation."""
    k_Po = 3600.0 / make(name).slope
    return ImpedanceParameters(orientation=name, **{"k_Po": k_Po, **SOFT, **FREE, **given})


def impedance_control(robot=UR5, **given):
    return parameters(**given).make_scheme(robot)


def admittance(**given):
    """Return the scheme that makes the compliant frame only, begun at the mid-point."""
    scheme = impedance_control(command_type="none", **given)
    scheme.reset(at_the_middle())
    return scheme


def sensed_at_tip(w, R_e):
    """Return what a sensor at the tip says of a wrench (6,) in base axes."""
    return SensedWrench(np.concatenate((R_e.T @ w[:3], R_e.T @ w[3:])), AT_TIP)


# --- eqs. (48)-(52): one instant ---------------------------------------------------------------
def in_contact(arm):
    """Return q, dq, a desired frame that moves, and a contact (6,), of ten instants."""
    wrenches = 20 * generator(1000).normal(size=(10, 6))
    return [(*rows, w) for rows, w in zip(situations(*robot_named(arm)), wrenches, strict=True)]


every_arm = pytest.mark.parametrize("arm", ["ur5", "panda"])


@every_representation
@every_arm
def test_the_tip_accelerates_as_the_motion_loop_asks_for_the_compliant_frame(arm, name):
    plant, (robot, _) = Plant(arm), robot_named(arm)  # (49)-(51)
    scheme = impedance_control(robot, name=name)
    gains = 3600.0, 120.0, scheme.parameters.k_Po, 120.0
    for q, dq, desired, w in in_contact(arm):
        scheme.reset(q)
        state = robot.state(q, dq)
        scheme.sense(sensed_at_tip(w, state.R_e))
        tick = scheme.tick(DT, q, dq, desired)
        assert_close(tick.command.frame.p_d, state.p_e, KINEMATICS)  # it begins there
        assert_close(tick.command.frame.omega_d, state.omega_e, 1e-9)
        again = scheme.tick(0.01, q, dq, desired)  # the arm has stayed behind
        found = plant.tip_acceleration(q, dq, plant.acceleration(q, dq, again.command.effort, w))
        own, frame = scheme.law.orientation, again.command.frame
        a, _ = resolved_acceleration(state, frame, own, None, gains)
        assert_close(found, a, 100 * ERROR_EQUATION * max(1.0, np.abs(a).max()))


@every_arm
def test_without_inner_loop_the_tip_itself_obeys_the_impedance_at_each_tick(arm):  # (52), (59)
    plant, (robot, _) = Plant(arm), robot_named(arm)
    scheme = impedance_control(robot, inner_loop=False)
    for q, dq, desired, w in in_contact(arm):
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


def test_where_it_restarts_in_contact_the_desired_frame_balances_the_contact():
    """Else the arm would go where the contact pushes it, by f / K_p, after each gap and stop."""
    scheme, w = admittance(), np.array([5.0, -10.0, 20.0, 1.0, 0.5, -1.0])
    lead(scheme, w, 0.1)
    home = UR5.state(HOME, STILL)
    for restart in (scheme.reset, scheme.resume):
        scheme.sense(sensed_at_tip(w, home.R_e))
        restart(HOME)
        desired = scheme.start_frame()
        assert_close(1000 * (home.p_e - desired.p_d), w[:3], 1e-9)
        turn = turn_of(home.R_e @ desired.R_d.T)
        np.testing.assert_allclose(50 * turn, w[3:], rtol=1e-6, atol=1e-9)
        ticks = [scheme.tick(DT, HOME, STILL, desired) for _ in range(500)]
        assert_close(ticks[-1].command.frame.p_d, home.p_e, 1e-9)
    for restart in (scheme.reset, lambda q: scheme.hold(DT, q, STILL)):
        scheme.sense(sensed_at_tip(NO_WRENCH, home.R_e))  # the contact is gone meanwhile
        scheme.tick(DT, HOME, STILL, desired)
        restart(HOME)
        assert_close(scheme.frame_at(HOME).p_d, home.p_e)


# Off the tip, and with other axes.
AT_CENTRE = {"compliance_frame": "ee_link", "compliance_offset": (0.05, -0.02, 0.15)}
CENTRE = UR5.placement(*AT_CENTRE.values())


def test_the_axes_of_the_centre_are_those_of_the_stiffness():
    K_p, K_o = (500.0, 1000.0, 2000.0), (20.0, 50.0, 100.0)
    Z = {"M_p": (2.0,) * 3, "D_p": (100.0,) * 3, "M_o": (0.2,) * 3, "D_o": (5.0,) * 3}
    scheme = admittance(K_p=K_p, K_o=K_o, translational_frame="desired", **Z, **AT_CENTRE)
    r = MIDDLE.R_d @ CENTRE.p
    for n, k_p, k_o in zip((MIDDLE.R_d @ CENTRE.R).T, K_p, K_o, strict=True):
        scheme.reset(at_the_middle())
        frame = lead(scheme, np.concatenate((10 * n, np.cross(r, 10 * n))), 2.0)[-1].command.frame
        assert_close(frame.p_d - MIDDLE.p_d, 10 / k_p * n, 1e-4)
        scheme.reset(at_the_middle())
        frame = lead(scheme, np.concatenate((0 * n, 2 * n)), 2.0)[-1].command.frame
        assert_close(turn_of(frame.R_d @ MIDDLE.R_d.T), math.asin(2 / k_o) * n, 1e-4)


def test_V_3_is_that_of_the_centre_and_its_measured_rate_that_of_eq_69():
    Z = {"M_o": (0.5, 1.0, 2.0), "D_o": (8.0, 12.0, 16.0), "K_o": (20.0, 50.0, 100.0)}
    scheme = admittance(**Z, **AT_CENTRE)
    controller = Controller(scheme, ControllerOptions(), at_the_middle())
    controller.follow(SetPoint(MIDDLE, 10.0), 0)
    rates = []
    for k in range(200):
        w = np.array([20.0, -30.0, 0.0, 8 * math.sin(0.03 * k), 5.0, -4 * math.cos(0.05 * k)])
        scheme.sense(sensed_at_tip(w, MIDDLE.R_d))
        controller.step(k * MS, at_the_middle(), STILL)
        rates.append(controller.guidance.lyapunov())
    V, by_paper, measured = np.array(list(filter(None, rates))).T
    mean = (by_paper[1:] + by_paper[:-1]) / 2
    assert_close(measured[1:], mean, V_3_SAMPLED * np.abs(by_paper).max())
    tick = controller.guidance.tick_now
    there, desired = (f.carrying(CENTRE) for f in (tick.command.frame, tick.desired))
    own, x = scheme.law.orientation, desired.R_d.T @ there.omega_d
    expected = own.lyapunov_3(desired.R_d.T @ there.R_d, x, scheme.law.rotation, 0 * x).V
    assert 0.01 < V[-1] == pytest.approx(expected, rel=1e-9)
    assert scheme.lyapunov(tick._replace(wrench=None)) is None
    assert scheme.lyapunov(tick._replace(command=tick.command._replace(frame=None))) is None


# --- a wrench that is lost, and found again -------------------------------------------------------
@pytest.mark.parametrize("lost", [0.05, 1.0])
def test_a_wrench_fades_when_it_is_lost_and_comes_back_as_slowly(lost):
    """In (48), that is; the impedance takes it at once when it is back."""
    scheme, w, q = impedance_control(), np.array([10.0, 0, 5.0, 0, 1.0, 0]), at_the_middle()
    lead(scheme, w, 0.1, dt=0.01)
    fade, steps = math.exp(-DT / BLEND_TIME), round(lost / DT)
    state, reference = UR5.dynamic_state(q, STILL), DynamicControl(UR5, parameters())

    def compensated():
        """Return the wrench that the efforts of the last tick compensate."""
        reference.reset(q)
        without = reference.follow(DT, state, tick.command.frame).command.effort
        return np.linalg.solve(state.arm.J.T, without - tick.command.effort)

    for k in range(steps):
        tick = lose(scheme)
        if k in (0, steps // 2, steps - 1):
            assert_close(compensated(), fade**k * w, 1e-9)
    for k in range(300):
        tick = lead(scheme, w, DT, dt=DT)[0]
        assert_close(tick.wrench, w, 1e-9)
        if k in (0, 100, 299):
            expected = (1 - (1 - fade ** (steps - 1)) * fade ** (k + 1)) * w
            assert_close(compensated(), expected, 1e-9)


def test_the_inertia_of_a_moving_tool_is_taken_out_by_the_acceleration_of_the_last_step():
    """Not by one over a gap: the arm goes on while no wrench comes."""
    tool = {"sensed_mass": 2.0, "sensed_com": (0.02, -0.03, 0.08)}
    tool |= {"sensed_inertia": (0.01, 0.0, 0.0, 0.02, 0.0, 0.015)}
    scheme, q, sensed = impedance_control(**tool), at_the_middle(), SensedWrench(NO_WRENCH, AT_TIP)
    dq, ddq = np.full(6, 0.2), np.arange(1.0, 7.0)
    state = UR5.dynamic_state(q, dq)
    scheme.sense(sensed)
    scheme.tick(DT, q, dq - DT * ddq, MIDDLE)
    found = [scheme.tick(DT, q, dq, MIDDLE).wrench]
    scheme.sense(None)
    scheme.tick(DT, q, dq, MIDDLE)
    scheme.sense(sensed)
    found.append(scheme.tick(DT, q, dq, MIDDLE).wrench)
    for w, acceleration in zip(found, (state.arm.J @ ddq + state.dJ_dq, state.dJ_dq), strict=True):
        chain = WrenchChain(scheme.robot, scheme.parameters)
        assert_close(w, chain.contact(sensed, state.arm, acceleration, DT), ERROR_EQUATION)


def test_without_any_wrench_the_frame_stands_where_the_tip_was_first():
    scheme, (q, dq, desired, w) = impedance_control(), in_contact("ur5")[0]
    scheme.reset(q)
    first = UR5.state(q, dq)
    for k in range(3):
        tick = scheme.tick(DT, q + k * DT * dq, dq, desired)
        assert_close(tick.command.frame.p_d, first.p_e, KINEMATICS)
        np.testing.assert_array_equal(tick.command.frame.dp_d, 0)
        assert tick.wrench is None
    scheme.sense(sensed_at_tip(w, first.R_e))
    after = scheme.tick(DT, q, dq, desired).command.frame
    assert_close(after.p_d, first.p_e, 1e-4)


def test_a_trajectory_waits_while_the_wrench_is_lost():
    there = MIDDLE._replace(p_d=MIDDLE.p_d + [0.0, 0.03, 0.0])
    scheme, R = admittance(), MIDDLE.R_d
    controller = Controller(scheme, ControllerOptions(), at_the_middle())
    path = Trajectory([0.0, 0.2], [MIDDLE, there])
    controller.follow(path, 0)
    for k in range(400):
        lost = 100 <= k < 200
        scheme.sense(None if lost else sensed_at_tip(NO_WRENCH, R))
        controller.step(k * MS, at_the_middle(), STILL)
        t = k if k < 100 else max(99, k - 100)
        found, expected = controller.guidance.tick_now.desired, path.sample(t * DT)
        assert_close(found.p_d, expected.p_d, 1e-9)


@pytest.mark.parametrize(("moved", "stops"), [(0.04, False), (0.06, True)])
def test_a_wrench_that_returns_while_the_frames_are_far_apart_stops(moved, stops):
    scheme, q = admittance(max_jump_position=0.05, max_jump_rotation=0.2), at_the_middle()
    sensed = SensedWrench(NO_WRENCH, AT_TIP)
    goal = MIDDLE._replace(p_d=MIDDLE.p_d + [moved, 0.0, 0.0])
    scheme.sense(sensed)
    scheme.tick(0.0, q, STILL, MIDDLE)
    scheme.sense(None)
    for _ in range(5):  # set-points stream on meanwhile
        scheme.tick(DT, q, STILL, goal)
    scheme.sense(sensed)
    if stops:
        with pytest.raises(FollowingError, match="max_jump_position"):
            scheme.tick(DT, q, STILL, goal)
        scheme.hold(DT, q, STILL)
        scheme.tick(DT, q, STILL, scheme.frame_at(q))  # at rest it goes on
    else:
        scheme.tick(DT, q, STILL, goal)
        scheme.tick(DT, q, STILL, goal._replace(p_d=goal.p_d + 0.5))  # only then


# --- other parameters ----------------------------------------------------------------------------
@pytest.mark.parametrize(("change", "end"), [("sign", -1.0), ("tare", 0.0)])
def test_another_sensor_or_tare_is_taken_over_without_a_step_of_the_wrench(change, end):
    scheme, w = admittance(), np.arange(1.0, 7.0)
    tick = lead(scheme, w, 0.02)[-1]
    assert_close(tick.wrench, w, AT_POINT_WRENCH)
    if change == "tare":
        scheme.tare(scheme.chain.felt(sensed_at_tip(w, tick.state.R_e), tick.state, None))
    else:
        scheme.change(parameters(wrench_sign=-1))
    for k, tick in enumerate(lead(scheme, w, 0.3, dt=0.01)):
        share = math.exp(-k * 0.01 / BLEND_TIME)
        assert_close(tick.wrench, (end + (1 - end) * share) * w, AT_POINT_WRENCH)


@pytest.mark.parametrize("begun", [admittance, impedance_control])
def test_an_arm_that_does_not_follow_is_a_fault_by_the_limits_of_now(begun):
    push, scheme = np.array([0, 0, 30.0, 0, 0, 0]), begun(**LIMITED)
    scheme.reset(at_the_middle())
    lead(scheme, push, 0.2)
    scheme.change(parameters(**{**LIMITED, "max_error_position": 0.015}))
    with pytest.raises(FollowingError, match=r"0\.01\d m from the desired frame"):
        lead(scheme, push, 2.0)


def test_with_another_centre_it_goes_on_from_the_same_frame_of_the_tip():
    scheme, w = admittance(), np.array([20.0, 0, 0, 0, 3, 0])
    before = lead(scheme, w, 0.2)[-1].command.frame
    for centre in (AT_CENTRE, {"compliance_offset": (0.1, 0.0, -0.1)}, {}):
        scheme.change(parameters(**centre))
        after = lead(scheme, w, 1e-6, dt=1e-6)[-1].command.frame
        for of in ("p_d", "R_d", "dp_d", "omega_d"):
            assert_close(getattr(after, of), getattr(before, of), 1e-4)
        assert np.abs(after.dp_d).max() > 1e-3


def test_other_parameters_change_the_impedance_only_as_far_as_there_is_energy():
    scheme, w = admittance(stiffness_energy=0.0), np.array([20.0, 0, 0, 0, 0, 0])
    before = lead(scheme, w, 4.0)[-1].command.frame
    scheme.change(parameters(K_p=(4000.0,) * 3, stiffness_energy=0.0))
    after = lead(scheme, w, 0.5, dt=DT)[-1].command.frame
    assert scheme.compliant.waits
    assert scheme.law.translation.K[0, 0] == 4000.0
    assert_close(after.p_d, before.p_d, 1e-4)


def test_a_low_pass_restarts_where_the_wrench_was_lost():
    scheme, w = admittance(wrench_cutoff=0.5), np.array([10.0, 0, 5.0, 0, 1.0, 0])
    lead(scheme, NO_WRENCH, 0.1, dt=0.01)
    assert np.abs(lead(scheme, w, 0.02, dt=0.01)[-1].wrench).max() < 1
    lose(scheme, 0.01)
    assert_close(lead(scheme, w, 0.01, dt=0.01)[0].wrench, w, AT_POINT_WRENCH)


@pytest.mark.parametrize(
    ("bound", "w", "text"),
    [
        ("max_contact_force", [0, 18.0, 24.0, 0, 0, 0], r"30 N; at most 29 N.*max_contact_force"),
        ("max_contact_torque", [0, 0, 0, 18.0, 0, 24.0], "30 Nm; at most 29 Nm.*_contact_torque"),
        ("max_contact_force", [math.nan, 0, 0, 0, 0, 0], "nan N"),
    ],
)
def test_a_contact_that_is_too_large_is_a_fault_that_holds_the_arm(bound, w, text):
    scheme, q = impedance_control(**LIMITED, **{bound: 29.0}), at_the_middle()
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


# --- holding, and going on -----------------------------------------------------------------------
@pytest.mark.parametrize("restart", ["reset", "resume", "hold"])
def test_a_restart_and_a_hold_forget_the_frame_the_low_pass_and_the_blend_of_wrenches(restart):
    scheme, w = admittance(wrench_cutoff=0.5), np.array([20.0, 0, 0, 0, 0, 0])

    def forget():
        if restart == "hold":
            scheme.hold(DT, at_the_middle(), STILL)
        else:
            getattr(scheme, restart)(at_the_middle())

    for sign in (-1, 1):
        frame = lead(scheme, w, 1.0)[-1].command.frame
        assert np.linalg.norm(frame.p_d - MIDDLE.p_d) > 5e-3
        forget()
        tick = lead(scheme, NO_WRENCH, 0.02)[-1]
        if restart != "hold":  # which has felt the contact last
            assert_close(tick.wrench, 0)
        assert_close(tick.command.frame.p_d, MIDDLE.p_d, 1e-8)
        assert_close(tick.command.frame.dp_d, 0, 1e-8)
        lead(scheme, w, 0.1)
        scheme.change(parameters(wrench_sign=sign, wrench_cutoff=0.5))
        lead(scheme, w, 0.02)
        forget()
        assert_close(lead(scheme, w, 0.02)[0].wrench, sign * w, AT_POINT_WRENCH)


def test_a_hold_and_a_resume_keep_the_efforts_as_they_are():
    scheme = impedance_control(**{**LIMITED, "max_effort_rate": (100.0,)})
    scheme.reset(q := at_the_middle())
    scheme.sense(sensed_at_tip(np.array([0, 0, 50.0, 0, 0, 0]), MIDDLE.R_d))
    efforts = [scheme.tick(DT, q, STILL, MIDDLE).command.effort, scheme.hold(DT, q, STILL).effort]
    scheme.resume(q)
    efforts.append(scheme.tick(DT, q, STILL, MIDDLE).command.effort)
    assert np.abs(np.diff(efforts, axis=0)).max() <= 100.0 * DT + ALGEBRAIC
    last = scheme.last_command(q, STILL)
    assert_close(last.effort, UR5.dynamic_state(q, STILL).g, 1e-9)
    assert_close(last.frame.p_d, UR5.state(q, STILL).p_e, KINEMATICS)


@pytest.mark.parametrize("key", range(3))
def test_a_carried_frame_moves_rigidly_with_its_carrier(key):
    motion, point = moving(key), Placement(uniform(1, 30 + key)[0], uniform(1, 40 + key)[0][0])
    p, R, *_ = motion(0.2)
    here = DesiredFrame(*motion(0.2)).carrying(point)
    assert_close(here.p_d, p + R @ point.p)
    assert_close(here.R_d, R @ point.R)
    dp, dR, ddp, domega = (
        derivative(lambda h, i=i: DesiredFrame(*motion(0.2 + h)).carrying(point)[i])
        for i in range(4)
    )
    assert_close(dR, skew(here.omega_d) @ here.R_d, DIFFERENCES)
    assert_close((dp, ddp, domega), (here.dp_d, here.ddp_d, here.domega_d), DIFFERENCES)
    for found, original in zip(here.carrying(point.inverse), motion(0.2), strict=True):
        assert_close(found, original, 10 * ALGEBRAIC)
