"""From the sensor to the contact: each part of the chain against what a rigid body feels.

The truth is made in this file, in base axes and from positions: point forces on a tool, its
weight, and the rate of its momentum.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
import pytest
from arms import HOME, UR5
from samples import generator, moving, positive_definite, rodrigues, uniform, unit_vectors
from tolerances import ALGEBRAIC, MOMENTUM, assert_close

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.wrench import SensedWrench, WrenchChain, is_still, mean_felt
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.fields import from_mapping
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot, RobotState, Tool

COUNT = 40
DT = 1e-3  # [s]
I, STILL = np.eye(3), np.zeros(6)
AT_TIP = Placement(I, np.zeros(3))
GRAVITY = np.array([0.0, 0.0, -9.81])


class Truth(NamedTuple):
    """A contact at the tip (6,), in base axes and about its origin, with the arm and the sensor."""

    contact: np.ndarray
    arm: RobotState
    sensor: Placement

    def sensed(self, felt):
        """Return what the sensor measures of a wrench (6,), base axes, about the tip."""
        R_s, r = self.arm.R_e @ self.sensor.R, self.arm.R_e @ self.sensor.p
        mu = felt[3:] - np.cross(r, felt[:3])
        return SensedWrench(np.concatenate((R_s.T @ felt[:3], R_s.T @ mu)), self.sensor)


def arm_at(R_e, p_e=(0.3, -0.2, 0.5), dp_e=(0.0,) * 3, omega_e=(0.0,) * 3):
    """Return the state of some arm whose tip is there."""
    tip = np.array(p_e), R_e, np.array(dp_e), np.array(omega_e)
    return RobotState(STILL, STILL, *tip, np.zeros((6, 6)))


def truths(count=COUNT, key=0):
    """Return contacts of three point forces each, and sensors anywhere on the tool."""
    random = generator(802, key)
    places = 0.1 * generator(800, key).normal(size=(count, 3))
    for R_e, R_s, p_s in zip(uniform(count, 803), uniform(count, 801), places, strict=True):
        p_e, points, forces = random.normal(size=3), *random.normal(size=(2, 3, 3))
        moments = np.cross(points - p_e, forces)
        contact = np.concatenate((forces.sum(axis=0), moments.sum(axis=0)))
        yield Truth(contact, arm_at(R_e, p_e), Placement(R_s, p_s))


def chain_of(tool=None, robot=UR5, **given):
    """Return a new chain of parameters, with a tool."""
    if tool is not None:
        six = tuple(tool.inertia[np.triu_indices(3)])
        given |= {"tool_mass": tool.mass, "tool_com": tuple(tool.com), "tool_inertia": six}
    return WrenchChain(robot, ImpedanceParameters(**given))


def contact(chain, sensed, truth, acceleration=None):
    """Return what a chain makes of one sample."""
    return chain.contact(sensed, truth.arm, acceleration, DT)


# --- the tool ---------------------------------------------------------------------------------
def tools(count=COUNT, key=0):
    """Return tools of up to 3 kg whose centre of mass is up to 0.2 m away, in the tip frame."""
    random = generator(804, key)
    for inertia in positive_definite(count, 805 + key, 0.01, 0.02):
        yield Tool(random.uniform(0.5, 3), random.uniform(-0.2, 0.2, 3), inertia)


def weight_of(tool, arm, gravity=GRAVITY):
    """Return the weight (6,) of a tool, base axes, about the tip."""
    weight = tool.mass * gravity
    return np.concatenate((weight, np.cross(arm.R_e @ tool.com, weight)))


def momentum(tool, motion, t):
    """Return momentum and angular momentum about the base's origin (6,) of a tool at the tip."""
    p, R, dp, omega, _, _ = motion(t)
    r = R @ tool.com
    P = tool.mass * (dp + np.cross(omega, r))
    return np.concatenate((P, np.cross(p + r, P) + R @ tool.inertia @ R.T @ omega))


def inertia_of(tool, motion, t, step=1e-5):
    """Return minus the rate of the momentum (6,) of a tool, base axes, about the tip."""
    rate = (momentum(tool, motion, t + step) - momentum(tool, motion, t - step)) / (2 * step)
    return -np.concatenate((rate[:3], rate[3:] - np.cross(motion(t)[0], rate[:3])))


@pytest.mark.parametrize("weight", [True, False])
@pytest.mark.parametrize("inertial", [True, False, None], ids=["inertia", "off", "unknown"])
@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (3.0, -9.0, 2.0)], ids=["floor", "wall"])
def test_all_parts_together_find_the_contact_weight_and_inertia_by_their_switches(
    weight, inertial, gravity
):
    about, biases = load_robot("ur5"), generator(812).normal(size=(COUNT, 6))
    robot = Robot(about.urdf, about.base_frame, about.tip_frame, gravity=gravity)
    for truth, tool, bias, key in zip(truths(), tools(), biases, range(COUNT), strict=True):
        motion = moving(key)
        p, R, dp, omega, ddp, domega = motion(0.1)
        truth = truth._replace(arm=arm_at(R, p, dp, omega))
        a = None if inertial is None else np.concatenate((ddp, domega))
        of_tool = weight_of(tool, truth.arm, robot.gravity), inertia_of(tool, motion, 0.1)
        sensed = truth.sensed(truth.contact + sum(of_tool))
        chain = chain_of(
            tool,
            robot,
            wrench_sign=-1,
            wrench_bias=tuple(bias),
            compensate_tool_weight=weight,
            compensate_tool_inertia=inertial is not False,
            force_dead_band=0.4,
            torque_dead_band=0.2,
            wrench_cutoff=50.0,
        )
        found = contact(chain, sensed._replace(w=-(sensed.w + bias)), truth, a)
        left = sum(w for w, is_out in zip(of_tool, (weight, inertial), strict=True) if not is_out)
        assert_close(found, shortened(truth.contact + left, 0.4, 0.2), MOMENTUM)


def shortened(w, force, torque):
    """Return a wrench whose force and moment are each shorter by a width, or nothing."""
    parts = zip(np.split(w, 2), (force, torque), strict=True)
    return np.concatenate(
        [max(0.0, 1.0 - width / np.linalg.norm(v)) * v if v.any() else v for v, width in parts]
    )


# --- bias, tare ---------------------------------------------------------------------------------
def test_a_tare_takes_out_an_unknown_bias_in_every_orientation():
    bias, (tool,), first = generator(807).normal(size=6), tools(1), next(truths(1))
    own = chain_of(tool, wrench_sign=-1)
    for k, (R, truth) in enumerate(zip(uniform(COUNT, 9), truths(), strict=True)):
        here = first._replace(arm=truth.arm._replace(R_e=R))  # the sensor stays on the tip
        touch, weight = truth.contact if k else STILL, weight_of(tool, here.arm)
        sensed = here.sensed(touch + weight)
        sensed = sensed._replace(w=-(sensed.w + bias))
        if k == 0:
            own.tare(own.felt(sensed, here.arm, None))
        assert_close(own.contact(sensed, here.arm, None, DT), touch, 10 * ALGEBRAIC)


def test_a_second_tare_replaces_the_first_and_other_options_and_resets_keep_it():
    truth = next(truths(1))
    own, sensed = chain_of(wrench_cutoff=1.0), truth.sensed(truth.contact)
    own.tare(3 * own.felt(sensed, truth.arm, None))
    own.contact(sensed, truth.arm, None, DT)
    again = own.felt(sensed, truth.arm, None)
    own.tare(again)
    assert_close(own.tared, again)
    again += 100.0  # it keeps no array of others
    assert_close(own.contact(sensed, truth.arm, None, DT), 0)  # nor what the low-pass has seen
    own.change(ImpedanceParameters(force_dead_band=1e-9))
    own.reset()
    assert_close(own.contact(sensed, truth.arm, None, DT), 0)


# --- dead band and low-pass ----------------------------------------------------------------------
LOAD = np.array([3.0, -1.0, 2.0, 0.3, 0.2, -0.1])


def filtered(own, w, dt=DT, arm=None):
    """Return what the chain gives for a wrench at the tip."""
    return own.contact(SensedWrench(w, AT_TIP), arm or arm_at(I), None, dt)


@pytest.mark.parametrize("length", [0.0, 0.5, 1.0, 1.0 + 1e-6, 2.0])
def test_a_dead_band_shortens_force_and_moment_each_by_its_own_width_to_nothing_within(length):
    widths = generator(808).uniform(0, 3, size=(10, 2))
    left = max(0.0, length - 1)  # the direction is kept, and there is no step at the edge
    for u, v, (force, torque) in zip(unit_vectors(10), unit_vectors(10, 1), widths, strict=True):
        w = np.concatenate((force * u, torque * v))
        own = chain_of(force_dead_band=force, torque_dead_band=torque)
        assert_close(filtered(own, length * w), left * w)


def test_the_step_response_does_not_depend_on_how_the_time_is_divided():
    own, t = chain_of(wrench_cutoff=5.0), 0.0
    filtered(own, STILL)
    for dt in generator(810).uniform(0, 0.02, size=50):
        t += dt
        assert_close(filtered(own, LOAD, dt), (1 - math.exp(-2 * math.pi * 5 * t)) * LOAD)
    before = filtered(own, LOAD, 0.0)
    assert_close(filtered(own, -LOAD, 0.0), before)  # in no time nothing changes


def test_the_low_pass_is_after_the_dead_band_in_the_axes_of_the_tip_and_its_cut_off_may_change():
    own = chain_of(wrench_cutoff=1.0)  # the arm turns, its sensor feels the same
    for k in range(20):
        R_e = rodrigues(0.1 * k, unit_vectors(1)[0])
        expected = np.concatenate((R_e @ LOAD[:3], R_e @ LOAD[3:]))
        assert_close(filtered(own, LOAD, arm=arm_at(R_e)), expected)
    own, force = chain_of(wrench_cutoff=1.0, force_dead_band=1.0), 4.0 * np.eye(6)[0]
    filtered(own, STILL)
    before = filtered(own, force)
    share = 1 - math.exp(-2 * math.pi * DT)
    assert before[0] == pytest.approx(share * 3.0, rel=1e-9)  # 0 the other way round
    own.change(ImpedanceParameters(wrench_cutoff=8.0))  # it goes on from there
    share = 1 - math.exp(-2 * math.pi * 8 * DT)
    assert_close(filtered(own, force), before + share * (force - before))


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"wrench_sign": 0}, "wrench_sign is 0; expected 1 or -1"),
        ({"wrench_bias": (0.0,) * 5}, "wrench_bias has 5 values; expected 6"),
        ({"wrench_bias": (math.nan,) * 6}, "'wrench_bias' is nan; expected a finite number"),
        ({"force_dead_band": -1e-9}, "'force_dead_band' is -1e-09.*; expected"),
        ({"torque_dead_band": math.nan}, "'torque_dead_band' is nan.*; expected"),
        ({"wrench_cutoff": math.inf}, "'wrench_cutoff' is inf.*; expected"),
    ],
)
def test_impossible_parameters_are_refused(given, text):
    with pytest.raises(ConfigurationError, match=text):
        WrenchChain(UR5, from_mapping(ImpedanceParameters, given))


# --- the mean at rest ---------------------------------------------------------------------------
def test_the_mean_at_rest_is_that_of_what_the_chain_feels_of_samples_at_their_poses():
    truth, (tool,), noise = next(truths(1)), tools(1), generator(813).normal(size=(15, 6))
    own = chain_of(tool, wrench_sign=-1, wrench_cutoff=1.0, force_dead_band=9.0)
    samples = []
    own.tare(np.arange(6.0))  # what is felt is before the tare
    for count, w in enumerate(noise, start=1):
        q = HOME + generator(814, count).uniform(-1, 1, size=6)
        here = truth._replace(arm=UR5.state(q, STILL))
        sensed = here.sensed(w + weight_of(tool, here.arm))
        samples.append((sensed._replace(w=-sensed.w), q, STILL))
        felt = np.concatenate((here.arm.R_e.T @ w[:3], here.arm.R_e.T @ w[3:]))
        noise[count - 1] = felt
    assert_close(mean_felt(own, samples[5:]), noise[5:].mean(axis=0), 10 * ALGEBRAIC)


def test_an_arm_is_still_if_no_joint_moves_by_more_than_its_bound():
    samples, noise = deque(maxlen=10), generator(815).normal(size=(10, 6))
    for k in range(10):
        q = HOME + (0.004 * (k % 2) + 2 * math.pi * (k % 3)) * np.eye(6)[k % 6]  # a driver wraps
        samples.append((SensedWrench(noise[k], AT_TIP), q, STILL))
    assert is_still(samples)
    samples.append((SensedWrench(STILL, AT_TIP), HOME + 0.006 * np.eye(6)[2], STILL))
    assert not is_still(samples)
    for _ in range(10):  # what was before is forgotten
        samples.append((SensedWrench(STILL, AT_TIP), HOME, STILL))
    assert is_still(samples)
