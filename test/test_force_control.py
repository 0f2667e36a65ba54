"""A force of the tool on the environment, FC1-FC5: regulated, followed, lost, ended, refused.

The arm is PyBullet's, and presses along z of its tool; where the servo of the arm is late it is
that of ``test_contact_watch``.
"""

import math

import numpy as np
import pytest
from arms import pose_of, robot_named
from samples import positive_definite, uniform
from simulated import IDEAL, Simulated, frames_of
from test_contact_watch import LOOPS, START, Admittance, wall
from tolerances import ALGEBRAIC, assert_close

from eulerparams_control.control.mode import Cause, Mode, Why
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.force_control import ForceControl
from eulerparams_control.laws.impedance_matrices import Matrices
from eulerparams_control.laws.rotations import quaternion
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.impedance_control import ImpedanceParameters

FORCE = 10.0  # [N]
SPEED = 0.02  # [m/s] of the approach at most
GAP = 0.003  # [m] to the surface
BALL = 0.01  # [m] radius of the tool
# The speed of the tip is measured with the lag of its motion loop [m/s].
MEASURED = 5e-4


class Pressing(Simulated):
    """An arm over a surface, along z of its tool.

    Attributes:
        f, x, v: [N], [m], [m/s] along z of the tool: what it exerts, its way, its speed.
    """

    def __init__(self, name="ur5", rate=1000, gap=GAP, stiffness=1e4, noise=0.0, **parameters):
        p, R = pose_of(*robot_named(name))[:2]
        eta, eps = quaternion(R @ np.diag([1.0, -1.0, -1.0]))  # faces the tool
        wall = {
            "shape": "plane",
            "position": (p + R[:, 2] * (gap + BALL)).tolist(),
            "orientation": [*map(float, eps), float(eta)],
            "stiffness": stiffness,
            "damping": 5e-4 * stiffness,
        }
        simulated = {"tool_shape": "sphere", "tool_size": (BALL,), "environment": {"wall": wall}}
        simulated |= {"noise_force": noise, "rate": rate, "each": 1000 // rate, **IDEAL}
        given = ImpedanceParameters(**frames_of(name), max_approach_speed=SPEED, **parameters)
        super().__init__(name, given, **simulated)
        self.sensor = self.robot.placement(self.robot.tip_frame)
        self.f, self.x, self.v = [], [], []

    def run(self, seconds, force=None):
        """Go on while a force [N] is asked for; None: none is sent."""
        for _ in range(round(seconds * self.rate)):
            state = self.simulator.read()
            self.scheme.sense(SensedWrench(state.wrench, self.sensor))
            if force is not None:
                self.scheme.press(np.array([0.0, 0.0, force]))
            self.step(state)
            arm = self.robot.state(state.q, state.dq)
            n = arm.R_e[:, 2]
            self.f.append(-state.wrench[2])
            self.x.append(n @ (arm.p_e - self.start.p_d))
            self.v.append(n @ arm.dp_e)
        return self

    def press(self, seconds):
        return self.run(seconds, FORCE)


ARMS = [("ur5", 1000, K) for K in (1e3, 1e4, 1e5, 1e6)]
ARMS += [("panda", 500, 1e4), ("kuka_iiwa", 200, 1e5), ("panda", 1000, 1e6), ("ur5", 200, 1e3)]


@pytest.mark.parametrize(("name", "rate", "stiffness"), ARMS)
def test_a_force_is_reached_on_what_is_soft_and_on_what_is_stiff(name, rate, stiffness):
    arm = Pressing(name, rate, stiffness=stiffness, stiffest_contact=1e6, gap=0.0005).press(1.6)
    f = np.array(arm.f)
    touched = int(np.argmax(f > 0))
    within = np.flatnonzero(abs(f - FORCE) > 0.01 * FORCE)[-1] + 1  # for good
    assert (within - touched) / rate < 1.0  # [s]
    assert f.max() / FORCE - 1.0 < 0.3
    fastest = FORCE / math.sqrt(10.0 * 1e6)  # (FC5)
    assert np.abs(arm.v[:touched]).max() < fastest + MEASURED
    assert np.abs(arm.v).max() < SPEED + MEASURED * 1000 / rate
    assert arm.scheme.force.stiffness[2] == pytest.approx(stiffness, rel=0.4)
    assert arm.scheme.damping == 1.0


@pytest.mark.parametrize("end", ["stream", "halt", "fault"])
def test_where_pressing_ends_the_arm_stays_where_it_is(end):
    arm = Pressing(gap=0.02, max_contact_force=12.0).press(3.0)
    x, controller = arm.x[-1], arm.controller
    assert arm.f[-1] == pytest.approx(FORCE, rel=0.01)
    if end == "fault":
        arm.simulator.set_external_wrench(np.array([0.0, 0.0, -4.0, 0.0, 0.0, 0.0]))
        arm.run(0.01)
        arm.simulator.set_external_wrench(None)
    elif end == "halt":
        controller.halt()
    else:
        controller.settle(Why(Cause.STREAM_ENDED))
    arm.run(1.0)
    assert arm.controller.mode is (Mode.HOLDING if end == "stream" else Mode.STOPPED)
    if end == "halt":  # nothing goes on by itself
        controller.resume()
        arm.run(0.5)
    assert not arm.scheme.force.is_on
    assert np.abs(np.array(arm.x[-1000:]) - x).max() < 2e-3
    assert np.abs(arm.v[-900:]).max() < SPEED


def test_while_no_wrench_is_measured_the_tool_rests_and_then_goes_on():
    arm = Pressing().press(1.5)
    x = arm.x[-1]
    read = arm.scheme.sense
    arm.scheme.sense = lambda _: read(None)
    arm.press(0.5)
    arm.scheme.sense = read
    assert arm.x[-1] == pytest.approx(x, abs=1e-3)
    arm.press(1.0)
    assert arm.f[-1] == pytest.approx(FORCE, rel=0.01)


@pytest.mark.parametrize(
    ("loop", "stiffness", "seconds", "dampings", "ripple"),
    [
        *((loop, 2e4, 3.0, [], 0.1) for loop in sorted(LOOPS.keys() - {"sensor 30 ms late"})),
        ("sensor 30 ms late", 2e4, 6.0, [3.0], 2.0),  # that is a lower bandwidth of the force
        ("sensor 30 ms late", 1e5, 6.0, [3.0, 9.0], 0.1),
    ],
)
def test_a_servo_that_is_late_presses_too(loop, stiffness, seconds, dampings, ripple):
    arm = Admittance(*LOOPS[loop], n=START.R_d[:, 2])
    for _ in range(round(1000 * seconds)):
        if arm.t > 0.05:
            arm.scheme.press(np.array([0.0, 0.0, FORCE]))
        arm.step(wall(stiffness))
    assert arm.f[-1] == pytest.approx(-FORCE, rel=0.1 * ripple)
    assert arm.ripple < ripple
    assert [times for _, times in arm.found][: len(dampings) or None] == dampings


def test_a_contact_that_begins_is_not_taken_for_noise():
    """It is felt for 0.09 s before, from when the noise is hardly known; f rises by 150 N/s."""
    arm = Pressing(rate=500, gap=0.0005, stiffness=1e4, stiffest_contact=1e4)
    for _ in range(200):
        arm.press(0.002)
        if arm.scheme.force.stiffness[2] > 0:
            break
    assert arm.scheme.force.stiffness[2] > 0
    assert 0 < arm.f[-1] < 2.0


@pytest.mark.parametrize("f_d", [FORCE, -FORCE])
@pytest.mark.parametrize(("size", "rate"), [(2.0, 2.0), (3.0, 5.0)])  # [N], [Hz]
def test_a_sway_of_the_sensor_is_no_contact(size, rate, f_d):
    """From when the noise is hardly known."""
    force, still = ForceControl(ImpedanceParameters()), DesiredFrame(np.zeros(3), np.eye(3))
    force.press(np.array([0.0, 0.0, f_d]))
    for t in np.arange(0.0, 2.0, 0.001):
        f = size * math.sin(2 * math.pi * rate * t)
        force.drive(0.001, still, still, still, np.array([0.0, 0.0, -f, 0.0, 0.0, 0.0]), 1.0)
        assert np.isnan(force.stiffness).all()


@pytest.mark.parametrize("in_base", [True, False])
def test_along_the_axes_there_is_no_stiffness_and_across_them_the_impedance_stays(in_base):
    R_e, R_d = uniform(2)
    force, at_tip = ForceControl(ImpedanceParameters()), DesiredFrame(np.zeros(3), R_e)
    force.press(np.array([0.0, 0.0, FORCE]))
    _, rate = force.drive(0.0, at_tip, at_tip, at_tip, np.zeros(6), 1.0)
    R = R_e if in_base else R_d.T @ R_e
    n = R[:, 2]
    M, D, K = positive_definite(3, least=10.0, most=100.0)
    freed = force.freed(R, rate, Matrices(np.linalg.inv(M), D, K))
    assert_close(freed.K @ n, 0, 1e3 * ALGEBRAIC)
    assert_close(freed.M_inverse @ freed.D @ n, rate * n, 1e3 * ALGEBRAIC)
    P = np.eye(3) - np.outer(n, n)
    for Z, Z_freed in ((M, np.linalg.inv(freed.M_inverse)), (D, freed.D), (K, freed.K)):
        assert_close(P @ Z_freed @ P, P @ Z @ P, 1e3 * ALGEBRAIC)


def test_noise_of_the_sensor_is_no_contact():
    arm = Pressing(rate=500, gap=0.01, stiffest_contact=1e5, noise=0.3).press(2.5)
    touched = int(np.argmax(np.array(arm.x) > 0.01))  # where the surface is
    assert touched > 0
    assert np.abs(arm.v[:touched]).max() < 0.0115  # as without noise, (FC5)
    assert np.mean(arm.f[-200:]) == pytest.approx(FORCE, rel=0.02)
    assert arm.scheme.damping == 1.0


def test_impossible_axes_are_refused():
    for wrong in (("w",), ("z", "z"), ("",)):
        with pytest.raises(ConfigurationError, match="expected some of x, y, z"):
            ForceControl(ImpedanceParameters(force_axes=wrong))
