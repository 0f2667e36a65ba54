"""From the sensor to the contact: each part of the chain against what a rigid body feels.

The truth is made in this file, in base axes and from positions: point forces on a tool, its
weight, and the rate of its momentum.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from arms import HOME, UR5
from samples import generator, moving, positive_definite, rodrigues, uniform, unit_vectors
from tolerances import ALGEBRAIC, MOMENTUM, assert_close

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.wrench import RestingWrench, SensedWrench, WrenchChain, WrenchOptions
from eulerparams_control.motion.frames import Placement
from eulerparams_control.robot.robot import RobotState, Tool

COUNT = 40
DT = 1e-3  # [s]
I = np.eye(3)
AT_TIP = Placement(I, np.zeros(3))
GRAVITY = np.array([0.0, 0.0, -9.81])


class Truth(NamedTuple):
    """A contact at the tip (6,), in base axes and about its origin, with the arm and the sensor."""

    contact: np.ndarray
    arm: RobotState
    sensor: Placement


def arm_at(R_e, p_e=(0.3, -0.2, 0.5), dp_e=(0.0,) * 3, omega_e=(0.0,) * 3):
    """Return the state of some arm whose tip is there."""
    none = np.zeros(6)
    tip = np.array(p_e), R_e, np.array(dp_e), np.array(omega_e)
    return RobotState(none, none, *tip, np.zeros((6, 6)))


def sensors(count, key=0):
    """Return where sensor frames may be, seen from the tip."""
    places = 0.1 * generator(800, key).normal(size=(count, 3))
    return [Placement(R, p) for R, p in zip(uniform(count, 801 + key), places, strict=True)]


def of_point_forces(points, forces, origin):
    """Return force and moment (6,) about ``origin`` of forces at points, all in one frame."""
    moments = np.cross(points - origin, forces)
    return np.concatenate((forces.sum(axis=0), moments.sum(axis=0)))


def truths(count=COUNT, key=0):
    """Return contacts of three point forces each, and what an exact sensor says of them."""
    random = generator(802, key)
    for R_e, sensor in zip(uniform(count, 803 + key), sensors(count, key), strict=True):
        arm = arm_at(R_e, random.normal(size=3))
        points, forces = random.normal(size=(2, 3, 3))
        contact = of_point_forces(points, forces, arm.p_e)
        R_s, p_s = R_e @ sensor.R, arm.p_e + R_e @ sensor.p
        about_sensor = of_point_forces(points, forces, p_s)
        said = np.concatenate((R_s.T @ about_sensor[:3], R_s.T @ about_sensor[3:]))
        yield Truth(contact, arm, sensor), said


def chain(**options):
    return WrenchChain(WrenchOptions(**options))


def contact(options, said, truth, acceleration=None, dt=DT):
    """Return what a new chain makes of one sample."""
    sensed = SensedWrench(said, truth.sensor)
    return WrenchChain(options).contact(sensed, truth.arm, acceleration, dt)


# --- the tool ---------------------------------------------------------------------------------
def tools(count=COUNT, key=0):
    """Return tools of up to 3 kg whose centre of mass is up to 0.2 m away, in the tip frame."""
    random = generator(804, key)
    for inertia in positive_definite(count, 805 + key, 0.005, 0.02):
        yield Tool(random.uniform(0.5, 3), random.uniform(-0.2, 0.2, 3), inertia)


def at_rest(arm):
    """Return the motion of a tip that does not move."""
    return lambda t: (arm.p_e, arm.R_e, *np.zeros((4, 3)))


def momentum(tool, motion, t):
    """Return momentum and angular momentum about the base's origin (6,) of a tool at the tip."""
    p, R, dp, omega, _, _ = motion(t)
    r = R @ tool.com
    P = tool.mass * (dp + np.cross(omega, r))
    return np.concatenate((P, np.cross(p + r, P) + R @ tool.inertia @ R.T @ omega))


def felt_of(tool, motion, t, gravity=GRAVITY, step=1e-5):
    """Return what a sensor feels of a tool that moves (6,): base axes, about the tip.

    It holds the tool against its weight and makes it move: minus the rate of its momentum.
    """
    rate = (momentum(tool, motion, t + step) - momentum(tool, motion, t - step)) / (2 * step)
    p, R = motion(t)[:2]
    weight = tool.mass * gravity
    about_base = np.concatenate((weight, np.cross(p + R @ tool.com, weight))) - rate
    return np.concatenate((about_base[:3], about_base[3:] - np.cross(p, about_base[:3])))


def said_of(felt, arm, sensor):
    """Return the wrench (6,), base axes, about the tip, as the sensor says it."""
    R_s, r = arm.R_e @ sensor.R, arm.R_e @ sensor.p
    return np.concatenate((R_s.T @ felt[:3], R_s.T @ (felt[3:] - np.cross(r, felt[:3]))))


@pytest.mark.parametrize("inertial", [True, False])
def test_weight_and_inertia_are_taken_out_each_by_its_own_switch(inertial):
    (tool,), motion = tools(1, key=2), moving(5)
    p, R, dp, omega, ddp, domega = motion(0.3)
    truth = next(truths(1))[0]._replace(arm=arm_at(R, p, dp, omega))
    both = felt_of(tool, motion, 0.3)
    weight = felt_of(tool, at_rest(truth.arm), 0.0)
    said = said_of(truth.contact + both, truth.arm, truth.sensor)
    options = WrenchOptions(tool=tool, weight=False, inertial=inertial)
    found = contact(options, said, truth, np.concatenate((ddp, domega)))
    left_in = weight if inertial else both
    assert_close(found, truth.contact + left_in, MOMENTUM)


def test_without_a_known_acceleration_only_the_weight_is_taken_out():
    (tool,), (truth, said) = tools(1), next(truths(1))
    moving_arm = truth._replace(arm=truth.arm._replace(omega_e=np.array([1.0, 2.0, 3.0])))
    options = WrenchOptions(tool=tool, inertial=True)
    expected = contact(replace(options, inertial=False), said, truth)
    assert_close(contact(options, said, moving_arm), expected)


# --- bias, tare ---------------------------------------------------------------------------------
def tared(options, truth, said):
    """Return a chain that takes what it feels now for no contact."""
    own = WrenchChain(options)
    own.tare(own.felt(SensedWrench(said, truth.sensor), truth.arm, None))
    return own


def test_a_tare_takes_out_an_unknown_bias_in_every_orientation():
    bias = generator(807).normal(size=6)
    (tool,) = tools(1)
    options = WrenchOptions(sign=-1, tool=tool)
    own = None
    for R, (truth, _) in zip(uniform(COUNT, 9), truths(), strict=True):
        arm, sensor = truth.arm._replace(R_e=R), sensors(1)[0]  # it stays where it is on the tip
        weight = said_of(felt_of(tool, at_rest(arm), 0.0), arm, sensor)
        if own is None:  # at the first, without contact
            own = tared(options, truth._replace(arm=arm, sensor=sensor), -(weight + bias))
        touch = said_of(truth.contact, arm, sensor)
        found = own.contact(SensedWrench(-(weight + bias + touch), sensor), arm, None, DT)
        assert_close(found, truth.contact, 10 * ALGEBRAIC)


def test_a_second_tare_replaces_the_first_and_other_options_and_resets_keep_it():
    truth, said = next(truths(1))
    own, sensed = (
        tared(WrenchOptions(cutoff=1.0), truth, 3 * said),
        SensedWrench(said, truth.sensor),
    )
    own.contact(sensed, truth.arm, None, DT)
    again = own.felt(sensed, truth.arm, None)
    own.tare(again)
    assert_close(own.tared, again)
    again += 100.0  # it keeps no array of others
    assert_close(own.contact(sensed, truth.arm, None, DT), 0)  # nor what the low-pass has seen
    own.replace_options(WrenchOptions(dead_force=1e-9))
    own.reset()
    assert_close(own.contact(sensed, truth.arm, None, DT), 0)


# --- dead band ----------------------------------------------------------------------------------
def through_a_dead_band(w, force, torque):
    """Return what is left of a wrench at the tip, in base axes."""
    truth = Truth(w, arm_at(I), AT_TIP)
    return contact(WrenchOptions(dead_force=force, dead_torque=torque), w, truth)


def test_a_dead_band_shortens_force_and_moment_each_by_its_own_width_to_nothing_within():
    widths = generator(808).uniform(0, 3, size=(COUNT, 2))
    lengths = zip((0.0, 0.5, 1.0, 1.0 + 1e-6, 2.0) * (COUNT // 5), widths, strict=True)
    for u, v, (length, (force, torque)) in zip(
        unit_vectors(COUNT), unit_vectors(COUNT, 1), lengths, strict=True
    ):  # in widths
        w = length * np.concatenate((force * u, torque * v))
        left = max(0.0, length - 1)  # the direction is kept, and there is no step at the edge
        expected = left * np.concatenate((force * u, torque * v))
        assert_close(through_a_dead_band(w, force, torque), expected)


# --- low-pass -----------------------------------------------------------------------------------
LOAD = np.array([3.0, -1.0, 2.0, 0.3, 0.2, -0.1])


def filtered(own, w, dt=DT, arm=None):
    """Return what the chain gives for a wrench at the tip."""
    return own.contact(SensedWrench(w, AT_TIP), arm or arm_at(I), None, dt)


def test_the_step_response_does_not_depend_on_how_the_time_is_divided():
    own, t = chain(cutoff=5.0), 0.0
    filtered(own, np.zeros(6))
    for dt in generator(810).uniform(0, 0.02, size=50):
        t += dt
        assert_close(filtered(own, LOAD, dt), (1 - math.exp(-2 * math.pi * 5 * t)) * LOAD)
    before = filtered(own, LOAD, 0.0)
    assert_close(filtered(own, -LOAD, 0.0), before)  # in no time nothing changes


def test_the_low_pass_is_after_the_dead_band_in_the_axes_of_the_tip_and_its_cut_off_may_change():
    own = chain(cutoff=1.0)  # the arm turns, its sensor feels the same
    for k in range(20):
        R_e = rodrigues(0.1 * k, unit_vectors(1)[0])
        found = filtered(own, LOAD, arm=arm_at(R_e))
        assert_close(found, np.concatenate((R_e @ LOAD[:3], R_e @ LOAD[3:])))
    own, force = chain(cutoff=1.0, dead_force=1.0), np.array([4.0, 0, 0, 0, 0, 0])
    filtered(own, np.zeros(6))
    share = 1 - math.exp(-2 * math.pi * DT)
    before = filtered(own, force)
    assert before[0] == pytest.approx(share * 3.0, rel=1e-9)  # 0 the other way round
    own.replace_options(WrenchOptions(cutoff=8.0))  # it goes on from there
    share = 1 - math.exp(-2 * math.pi * 8 * DT)
    assert_close(filtered(own, force), before + share * (force - before))


def test_without_a_cut_off_nothing_is_filtered_and_the_first_sample_passes():
    own, low = chain(), chain(cutoff=1.0)
    for w in generator(811).normal(size=(10, 6)):
        assert_close(filtered(own, w), w)
    assert_close(filtered(low, LOAD), LOAD)
    assert np.abs(filtered(low, 0 * LOAD)).max() > 0.9  # not the second
    low.reset()
    assert_close(filtered(low, 2 * LOAD), 2 * LOAD)


# --- all together -------------------------------------------------------------------------------
@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (3.0, -9.0, 2.0)], ids=["floor", "wall"])
def test_all_parts_together_find_the_contact(gravity):
    biases = generator(812).normal(size=(COUNT, 6))
    for (truth, _), tool, bias, key in zip(truths(), tools(), biases, range(COUNT), strict=True):
        motion = moving(key)
        p, R, dp, omega, ddp, domega = motion(0.1)
        arm = arm_at(R, p, dp, omega)
        of_tool = felt_of(tool, motion, 0.1, np.array(gravity))
        felt = said_of(truth.contact + of_tool, arm, truth.sensor)
        options = WrenchOptions(
            sign=-1, tool=tool, inertial=True, bias=tuple(bias), dead_force=0.4, dead_torque=0.2,
            cutoff=50.0, gravity=gravity,
        )  # fmt: skip
        moved = truth._replace(arm=arm)
        found = contact(options, -(felt + bias), moved, np.concatenate((ddp, domega)))
        assert_close(found, through_a_dead_band(truth.contact, 0.4, 0.2), MOMENTUM)


REFUSED = [
    *(({"sign": sign}, f"wrench_sign is {sign}; expected 1 or -1") for sign in (0, 2, -2, 0.5)),
    *(({"bias": (0.0,) * n}, f"wrench_bias has {n} values; expected 6") for n in (0, 3, 5, 7)),
    *(
        ({name: value}, f"{name} is {value}; expected >= 0")
        for name in ("dead_force", "dead_torque", "cutoff")
        for value in (-1e-9, math.nan, math.inf)
    ),
]


@pytest.mark.parametrize(("given", "text"), REFUSED)
def test_impossible_options_are_refused(given, text):
    with pytest.raises(ConfigurationError, match=text):
        WrenchOptions(**given)


# --- the mean at rest ---------------------------------------------------------------------------
def test_the_mean_at_rest_is_that_of_what_the_chain_feels_of_the_last_samples():
    robot, home, (tool,), still = UR5, HOME, tools(1), np.zeros(6)
    own, resting = chain(tool=tool, sign=-1, cutoff=1.0, dead_force=9.0), RestingWrench(20)
    own.tare(np.arange(6.0))  # what is felt is before the tare
    sensor, noise = sensors(1)[0], generator(813).normal(size=(30, 6))
    assert resting.count == 0
    for count, w in enumerate(noise, start=1):
        resting.add(SensedWrench(w, sensor), home, still)
        assert resting.count == min(count, 20)
    expected = own.felt(
        SensedWrench(noise[10:].mean(axis=0), sensor), robot.state(home, still), None
    )
    assert_close(resting.mean(own, robot), expected)
    assert_close(resting.spread(), noise[10:].std(axis=0))
    resting.clear()
    assert resting.count == 0


def test_an_arm_is_still_if_no_joint_moves_by_more_than_its_bound():
    home, resting = HOME, RestingWrench(10)
    sensed = SensedWrench(np.zeros(6), AT_TIP)
    for k in range(10):
        resting.add(sensed, home + 0.004 * (k % 2) * np.eye(6)[k % 6], np.zeros(6))
    assert resting.is_still
    resting.add(sensed, home + 0.006 * np.eye(6)[2], np.zeros(6))
    assert not resting.is_still
    for _ in range(10):  # what was before is forgotten
        resting.add(sensed, home, np.zeros(6))
    assert resting.is_still


def test_the_mean_is_that_of_the_poses_at_which_the_samples_were_taken():
    robot, home, (tool,) = UR5, HOME, tools(1)
    own, resting = chain(tool=tool), RestingWrench(10)
    for q in home + generator(814).uniform(-1, 1, size=(10, 6)):
        arm = robot.state(q, np.zeros(6))
        weight = said_of(felt_of(tool, at_rest(arm), 0.0), arm, AT_TIP)
        resting.add(SensedWrench(weight, AT_TIP), q, np.zeros(6))
    assert_close(resting.mean(own, robot), 0, 10 * ALGEBRAIC)
