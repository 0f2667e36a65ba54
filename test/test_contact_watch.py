"""The passivity observer, and chatter: found, damped, ended; a hand that shakes the tool is not it.

The arm follows its compliant frame as a robot with a position servo does: late.
"""

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from arms import HOME, STILL, UR5, pose_of

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.control.mode import Cause, why_of
from eulerparams_control.errors import ConfigurationError, ContactError
from eulerparams_control.laws.contact_bound import damping_for, stiffest_contact
from eulerparams_control.laws.contact_watch import ContactWatch, Oscillation
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.parameters.impedance_control import ImpedanceParameters

DT = 1e-3
START = pose_of(UR5, HOME)
X = np.array([1.0, 0.0, 0.0])
WALL = 0.01  # [m] from the start, along x
AT_TIP = UR5.placement(UR5.tip_frame)
# The lag and the delay of the servo, and the delay of the sensor [s].
LOOPS = {
    "prompt": (0.0, 0.001, 0.0),
    "delayed": (0.0, 0.015, 0.0),
    "UR5e": (0.02, 0.004, 0.0),
    "slow": (0.04, 0.01, 0.0),
    "sensor 5 ms late": (0.0, 0.001, 0.005),
    "sensor 30 ms late": (0.0, 0.001, 0.03),
}


class Admittance:
    """Impedance control over a servo and a sensor that are late, see LOOPS; the tool goes along n.

    Attributes:
        found: when [s] the damping changed, and to what.
        x, f: [m], [N] of the tip and on it, at each step; it is free at x < 0.
    """

    def __init__(self, lag, delay, sensed_late, n=X, **parameters):
        self.n = n
        p = ImpedanceParameters(command_type="none", **parameters)
        self.scheme = p.make_scheme(UR5)
        self.servo = ClikParameters(enforce_limits=False).make_scheme(UR5)
        self.share = -math.expm1(-DT / lag) if lag else 1.0
        self.q, self.late = HOME, deque([HOME], maxlen=max(1, round(delay / DT)))
        self.felt = deque(maxlen=1 + round(sensed_late / DT))
        self.scheme.reset(self.q)
        self.servo.reset(self.q)
        self.t, self.found, self.x, self.f = 0.0, [], [], []
        self.controller = None  # that leads the scheme, if there is one; then it goes to no target

    def step(self, force, target=0.0, speed=0.0):
        """Go on by a step under a force f(t, x, v) on the tool, to a target [m] along n."""
        before, self.q = self.q, self.q + self.share * (self.late[0] - self.q)
        dq = (self.q - before) / DT
        arm = UR5.state(self.q, dq)
        x, v = self.n @ (arm.p_e - START.p_d) - WALL, self.n @ arm.dp_e
        f = force(self.t, x, v)
        self.felt.append(f)
        w = np.concatenate((self.felt[0] * arm.R_e.T @ self.n, np.zeros(3)))
        self.scheme.sense(SensedWrench(w, AT_TIP))
        there = DesiredFrame(START.p_d + target * self.n, START.R_d, speed * self.n)
        damping = self.scheme.damping
        dt = DT if self.t else 0.0
        if self.controller is None:
            frame = self.scheme.tick(dt, self.q, dq, there).command.frame
        else:
            frame = self.controller.step(round(1e9 * self.t), self.q, dq, self.t).frame
        if self.scheme.damping != damping:
            self.found.append((self.t, self.scheme.damping))
        self.late.append(self.servo.tick(dt, self.q, STILL, frame).command.q)
        self.t += DT
        self.x.append(x)
        self.f.append(f)

    def run(self, seconds, force, depth=0.0, speed=0.05):
        """Go ``depth`` [m] along n, and stay."""
        for k in range(round(seconds / DT)):
            moves = k * DT * speed < depth
            target = k * DT * speed if moves else depth
            self.step(force, target, speed if moves else 0.0)
        return self

    @property
    def ripple(self):
        """How much [N] the force has changed in the last half second."""
        return np.ptp(self.f[-500:])


def wall(stiffness):
    return lambda _t, x, _v: -stiffness * x if x > 0 else 0.0


def patted(t, _x, _v):
    """Return a hand that pats the tool with 20 N, three times a second."""
    return -20.0 if 3 * t % 1 < 0.3 else 0.0


def tapped(t, _x, _v):
    """Return a hand that taps on the tool once."""
    return -40.0 if 0.5 < t < 0.55 else 0.0


def shaken(frequency):
    """Return a hand that holds the tool by 3000 N/m and moves it by 5 mm."""
    return lambda t, x, v: 3000 * (0.005 * math.sin(math.tau * frequency * t) - x - WALL) - 20 * v


def noisy(force, size):
    noise = np.random.default_rng(1)
    return lambda t, x, v: force(t, x, v) + size * noise.standard_normal()


def changing(t, x, _v):
    """Return the force of a surface that is 500 to 9500 N/m stiff, twice a second."""
    return -(5000 + 4500 * math.sin(math.tau * 2 * t)) * max(x, 0.0)


@pytest.mark.parametrize(
    ("loop", "stiffness"),
    [
        *((loop, 2e4) for loop in ("delayed", "UR5e", "slow", "sensor 30 ms late")),
        *(("UR5e", 4e4), ("sensor 5 ms late", 5e4)),
    ],
)
def test_chatter_is_found_within_a_second_and_ended_by_damping(loop, stiffness):
    arm = Admittance(*LOOPS[loop]).run(4.0, wall(stiffness), 0.03)
    found, damping = arm.found[0]
    touched = DT * next(k for k, f in enumerate(arm.f) if f)
    assert found - touched < 1.0
    assert damping == 3.0
    assert arm.ripple < 1.0
    assert arm.f[-1] < -10.0  # it still presses


@pytest.mark.parametrize("loop", ["prompt", "UR5e"])
def test_a_stiffness_that_a_program_swings_in_contact_is_no_chatter(loop):
    """100 to 5000 N/m at 2 Hz, 1 cm into 1e4 N/m: 1 N to 33 N, and no more energy than there is."""
    arm = Admittance(*LOOPS[loop])
    for k in range(3000):
        if k % 20 == 0:
            K = 2550 - 2450 * math.cos(math.tau * 2 * k * DT)
            arm.scheme.change_impedance(ImpedanceParameters(K_p=(K,) * 3).compliance_law())
        moves = k * DT * 0.05 < 0.02
        arm.step(wall(1e4), min(k * DT * 0.05, 0.02), 0.05 if moves else 0.0)
        assert arm.scheme.compliant.energy_left > 0.1
    assert arm.found == []
    assert 25.0 < np.ptp(arm.f[1500:]) < 33.3


def fed(axis, speed, frequency=5.0, force=8.0):
    """Return what a watch says of a contact that swings along an axis, with power from the tool."""
    watch, found = ContactWatch(ImpedanceParameters()), []
    part = axis // 3
    w, v = np.zeros(6), np.zeros(6)
    for k in range(1500):
        swing = math.sin(math.tau * frequency * k * DT)
        w[axis], v[axis] = -force * (1.0, 0.1)[part] * swing, speed * (1.0, 10.0)[part] * swing
        found.append(watch.take(w, v[:3], v[3:], DT))
    return max(found)


@pytest.mark.parametrize("axis", range(6))
def test_a_swing_that_is_fed_is_found_along_and_about_each_axis_unless_it_is_tiny(axis):
    assert fed(axis, 0.02) is Oscillation.IS_FED
    assert fed(axis, -0.02, force=7.0) is Oscillation.NONE  # a hand shakes
    assert fed(axis, 0.001) is Oscillation.NONE  # a sensor that hums
    assert fed(axis, 0.02, frequency=2.0) is Oscillation.NONE


def test_chatter_that_no_damping_ends_stops_the_motion():
    arm = Admittance(*LOOPS["UR5e"], max_contact_force=1e4)
    with pytest.raises(ContactError, match="more is not possible") as stopped:
        arm.run(4.0, wall(1e6), 0.03)
    assert why_of(stopped.value).cause is Cause.CONTACT_OSCILLATES
    assert [damping for _, damping in arm.found] == [3.0, 9.0]
    arm.scheme.hold(DT, arm.q, STILL)
    assert arm.scheme.damping == 1.0  # whatever leads on begins with the law that was asked for


@pytest.mark.parametrize(
    ("loop", "force", "depth", "dampings"),
    [
        *(("prompt", wall(stiffness), 0.03, []) for stiffness in (1e3, 1e4, 1e5)),
        *(("UR5e", wall(stiffness), 0.03, []) for stiffness in (1e3, 1e4)),
        *(("prompt", shaken(frequency), 0.0, []) for frequency in (1, 2, 3, 5, 8)),
        *(("UR5e", shaken(frequency), 0.0, []) for frequency in (1, 2, 3)),
        *((("prompt", noisy(wall(1e4), 2.0), 0.03, []), ("UR5e", changing, 0.03, []))),
        *(("UR5e", tapped, 0.0, []), ("prompt", patted, 0.0, [3.0])),  # damped, but not stopped
    ],
)
def test_what_is_not_chatter_does_not_stop_the_motion(loop, force, depth, dampings):
    """For twice as long as it takes to find chatter, and longer."""
    arm = Admittance(*LOOPS[loop]).run(4.0 if dampings else 2.0, force, depth)
    assert [damping for _, damping in arm.found] == dampings


def test_the_damping_goes_back_when_the_tool_was_free_for_a_while():
    arm = Admittance(*LOOPS["UR5e"]).run(3.0, wall(2e4), 0.03)
    for k in range(3000):
        arm.step(wall(2e4), 0.03 - min(k * DT, 1.0) * 0.03)
    left = DT * np.flatnonzero(arm.f)[-1]
    (_, raised), (back, damping) = arm.found
    assert (raised, damping) == (3.0, 1.0)
    assert back - left == pytest.approx(2.0, abs=0.3)  # from where less than the ripple is felt


def test_parameters_that_are_changed_meanwhile_count_with_their_own_damping():
    arm = Admittance(*LOOPS["UR5e"]).run(1.0, wall(2e4), 0.03)
    assert arm.scheme.damping == 3.0
    arm.scheme.change(replace(arm.scheme.parameters, max_ripple_force=1e5))
    assert arm.scheme.damping == 1.0
    arm.run(1.0, wall(2e4), 0.03)
    assert arm.ripple > 20.0


def test_the_energy_is_what_the_contact_was_given():
    arm = Admittance(*LOOPS["prompt"]).run(3.0, wall(5e3), 0.03)
    assert arm.scheme.contact.energy == pytest.approx(5e3 * arm.x[-1] ** 2 / 2, rel=0.02)  # sampled
    pushed = Admittance(*LOOPS["prompt"]).run(1.0, lambda *_: 10.0)
    assert pushed.scheme.contact.energy == pytest.approx(-10.0 * (pushed.x[-1] + WALL), rel=0.02)


# --- the bound of a late servo ------------------------------------------------------------------


def test_an_impedance_that_is_too_fast_for_a_late_servo_is_refused_with_what_it_needs():
    late = {"servo_lag": 0.04, "servo_delay": 0.01}
    damped, soft = {"D_p": (2600.0,) * 3}, {"D_p": (100.0,) * 3}
    with pytest.raises(ConfigurationError, match="stable on contacts of up") as no:
        ImpedanceParameters(**late, **soft).compliance_law()
    expected = "up to 1.46e+03 N/m; expected stiffest_contact 100000 N/m: give D_p of 2.59e+03"
    assert expected in str(no.value)
    for possible in (late | damped, late | soft | {"stiffest_contact": 1.4e3}, soft):
        ImpedanceParameters(**possible).compliance_law()
    assert stiffest_contact(ImpedanceParameters().translation(), 0.0, 0.0) == math.inf


@pytest.mark.parametrize("stiffness", [2e4, 1e5])
@pytest.mark.parametrize("loop", ["UR5e", "late"])
def test_an_impact_hardly_exceeds_max_contact_force_and_the_tool_is_free_after_the_stop(
    loop, stiffness
):
    lag, delay = {"UR5e": (0.02, 0.004), "late": (0.04, 0.004)}[loop]
    given = {"stiffest_contact": stiffness, "servo_lag": lag, "servo_delay": delay}
    enough = 1.05 * damping_for(stiffness, 10.0, lag, delay)
    arm = Admittance(lag, delay, 0.0, **given, D_p=(enough,) * 3)
    touched, options = wall(stiffness), ControllerOptions.of(arm.scheme.parameters)
    arm.controller = Controller(arm.scheme, options, HOME)
    for k in range(6000):
        if k == 100:  # as fast as the limits of the tip allow: 0.25 m/s, were the arm prompt
            arm.controller.aim(DesiredFrame(START.p_d + 0.2 * X, START.R_d), arm.t)
        arm.step(touched)
    assert arm.controller.why.cause is Cause.CONTACT_TOO_LARGE
    assert -min(arm.f) < 1.1 * arm.scheme.parameters.max_contact_force  # it stops late, too
    assert -arm.f[-1] < 45.0
