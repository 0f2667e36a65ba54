"""The limits of joint acceleration: in the laws, in the limiter, and as a parameter."""

import math
from dataclasses import replace

import numpy as np
import pytest
from arms import HOME, STILL, UR5
from samples import generator
from tolerances import LIMIT_ROUNDING, RELATIVE

from eulerparams_control.control.command_limiter import CommandLimiter
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.clik import Clik, ClikLaw
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.parameters.clik import ClikParameters

JOINTS = 20  # that are simulated at once
ONE = np.array([1.0])


def many_limits(*, alone=False):
    """Return the limits of joints of all sizes, between them one with none."""
    random = generator(900)
    centre, half = random.uniform(-3, 3, size=JOINTS), 10 ** random.uniform(-2, 1, size=JOINTS)
    speed, a = 10 ** random.uniform(-1, 1, size=(2, JOINTS))
    lower, upper = centre - half, centre + half
    lower[0], upper[0], speed[1], a[2] = -math.inf, math.inf, math.inf, math.inf
    limits = JointLimits(lower, upper, speed, np.full(JOINTS, math.inf), 3 * a)
    if not alone:
        return limits
    return [
        JointLimits(*(part[i : i + 1] for part in vars(limits).values())) for i in range(JOINTS)
    ]


def wishes():
    """Return functions of time that want something of many joints, without end."""
    random = generator(901)
    outwards = np.where(random.uniform(size=JOINTS) < 0.5, -1.0, 1.0)
    frequency = random.uniform(1, 30, size=JOINTS)
    return {
        "outwards": lambda t: 1e6 * outwards,
        "to and fro": lambda t: 300 * np.sign(np.sin(frequency * t)),
        "at random": lambda t: 1e3 * random.normal(size=JOINTS),
        "moderate": lambda t: outwards + np.sin(frequency * t),
    }


@pytest.mark.parametrize("wish", wishes())
@pytest.mark.parametrize("dt", [5e-4, 2e-3, 0.02, 0.1])
def test_velocities_keep_speed_position_and_acceleration_at_once(wish, dt):
    wanted, limits = wishes()[wish], many_limits()
    each = many_limits(alone=True)
    q, dq = np.clip(np.zeros(JOINTS), limits.lower, limits.upper), np.zeros(JOINTS)
    for step in range(round(min(1.5, 300 * dt) / dt)):
        before, wants = dq, wanted(step * dt)
        dq = np.concatenate(
            [
                one.limit_velocity(q[i : i + 1], wants[i : i + 1], dt, before[i : i + 1])[0]
                for i, one in enumerate(each)
            ]
        )
        assert (np.abs(dq) <= limits.velocity * (1 + RELATIVE)).all()
        assert (np.abs(dq - before) <= limits.acceleration * dt * (1 + 1e-9)).all()
        q = q + dt * dq
        assert (q <= limits.upper + LIMIT_ROUNDING).all()
        assert (q >= limits.lower - LIMIT_ROUNDING).all()


def test_a_change_that_is_too_large_is_shortened_as_a_whole():
    random, free = generator(902), JointLimits(-9 * np.ones(6), 9 * np.ones(6), *np.ones((2, 6)))
    limits = replace(free, acceleration=np.linspace(5, 10, 6))
    for _ in range(100):
        before, wanted = random.uniform(-0.9, 0.9, size=(2, 6))
        limited, changed = limits.limit_velocity(np.zeros(6), wanted, 0.01, before)
        assert changed
        share = (limited - before) / (wanted - before)
        np.testing.assert_allclose(share, share[0], rtol=1e-9)
        most = np.abs(limited - before) / (limits.acceleration * 0.01)
        assert most.max() == pytest.approx(1, rel=1e-9)


def test_a_joint_that_has_to_brake_does_and_does_not_hold_up_the_others():
    limits = JointLimits(-ONE * [1, 9], ONE * [1, 9], *np.full((2, 2), 2.0), np.full(2, 10.0))
    at_the_limit, before = np.array([1.0, 0.0]), np.zeros(2)
    limited, _ = limits.limit_velocity(at_the_limit, np.array([1.0, 0.05]), 0.01, before)
    np.testing.assert_array_equal(limited, [0.0, 0.05])
    brakes = np.array([0.9, 0.0]), np.array([1.0, 1.0])  # 10 / s of the way, at 1 rad/s
    limited, _ = limits.limit_velocity(*brakes, 0.01, np.array([1.0, 0.0]))
    np.testing.assert_allclose(limited - [1.0, 0.0], [0.0, 0.1], rtol=0, atol=LIMIT_ROUNDING)
    limited, _ = limits.limit_velocity(np.array([0.91, 0.0]), brakes[1], 0.01, np.array([1.0, 0.0]))
    np.testing.assert_allclose(limited - [1.0, 0.0], [-0.1, 0.1], rtol=0, atol=LIMIT_ROUNDING)


def test_a_joint_that_could_not_stop_otherwise_brakes_harder_evenly():
    limits = JointLimits(-ONE, ONE, 9 * ONE, ONE, 10 * ONE)
    q, dq, dt = 0.5 * ONE, 5 * ONE, 1e-3  # 2.5 rad to stop at 10 rad/s^2: 25 are needed
    most = 0.0
    while abs(dq[0]) > 1e-6:
        before, (dq, _) = dq, limits.limit_velocity(q, dq, dt, dq)
        most, q = max(most, (before - dq)[0] / dt), q + dt * dq
    assert most == pytest.approx(25 / (1 + 5 * dt), rel=1e-6)  # steps stop a little later
    assert q == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("wish", wishes())
@pytest.mark.parametrize("dt", [5e-4, 2e-3, 0.02])
def test_accelerations_keep_speed_position_and_their_own_limit(wish, dt):
    wanted, limits = wishes()[wish], many_limits()
    each = many_limits(alone=True)
    q, dq = np.clip(np.zeros(JOINTS), limits.lower, limits.upper), np.zeros(JOINTS)
    for step in range(round(min(1.5, 300 * dt) / dt)):
        wants = 10 * wanted(step * dt)
        ddq = np.concatenate(
            [
                one.limit_acceleration(*(v[i : i + 1] for v in (q, dq, wants)), dt)[0]
                for i, one in enumerate(each)
            ]
        )
        assert (np.abs(ddq) <= limits.acceleration * (1 + RELATIVE)).all()
        dq = dq + dt * ddq
        q = q + dt * dq
        assert (np.abs(dq) <= limits.velocity * (1 + RELATIVE)).all()
        assert (q <= limits.upper + LIMIT_ROUNDING).all()
        assert (q >= limits.lower - LIMIT_ROUNDING).all()


def test_what_keeps_the_limits_is_not_touched():
    dq, before, ddq = np.full(6, 0.5), np.full(6, 0.4901), np.linspace(-9.9, 9.9, 6)
    for limits in (UR5.limits, replace(UR5.limits, acceleration=np.full(6, 10.0))):
        assert limits.limit_velocity(HOME, dq, 1e-3, before)[0] is dq
        limited, changed = limits.limit_acceleration(HOME, dq, ddq, 1e-3)
        assert limited is ddq
        assert not changed


def clik(**limits):
    """Return CLIK of the UR5 with limits of acceleration."""
    limited = replace(UR5.limits, **{"acceleration": np.full(6, 10.0), **limits})
    return Clik(UR5, ClikLaw(representation("euler_parameters")), limits=limited)


def moving(scheme, speed=0.8, dt=1e-3):
    """Let a scheme follow a motion until its joints are fast; return the last command."""
    start, (q, _) = scheme.start_frame(), scheme.hold(dt, HOME, STILL)[:2]
    v = np.array([0.0, speed, 0.0])
    for k in range(400):
        p, dp = start.p_d + v * (k * dt), v
        tick = scheme.tick(dt, q, STILL, start._replace(p_d=p, dp_d=dp))
        q = tick.command.q
    return tick.command


def test_clik_brakes_into_a_stop_along_its_way():
    scheme, dt = clik(), 1e-3
    scheme.reset(HOME)
    before = moving(scheme)
    assert np.abs(before.dq).max() > 0.5
    direction = before.dq / np.linalg.norm(before.dq)
    for _ in range(1000):
        now = scheme.hold(dt, before.q, before.dq)
        assert (np.abs(now.dq - before.dq) <= 10 * dt * (1 + RELATIVE)).all()
        np.testing.assert_allclose(now.q - before.q, dt * before.dq, rtol=0, atol=LIMIT_ROUNDING)
        np.testing.assert_allclose(now.dq, direction * (direction @ now.dq), atol=1e-12)
        before = now
        if not now.dq.any():
            break
    assert not now.dq.any()
    assert not scheme.last_command(now.q, STILL).dq.any()


def test_clik_says_by_how_much_it_is_slowed():
    scheme = clik(velocity=np.full(6, 0.1))
    scheme.reset(HOME)
    start = scheme.start_frame()
    fast = start._replace(dp_d=np.array([0.0, 0.5, 0.0]))
    asked = np.abs(scheme.law.velocity(UR5.state(HOME, STILL), fast, None)[0])
    tick = scheme.tick(1e-3, HOME, STILL, fast)
    assert tick.excess == pytest.approx(asked.max() / 0.1, rel=1e-9)
    assert scheme.tick(1e-3, HOME, STILL, start).excess == 1.0


# --- the last line of defence -----------------------------------------------------------------

LIMITS = JointLimits(-2 * np.ones(2), 2 * np.ones(2), np.ones(2), np.ones(2), np.full(2, 10.0))


def through(limiter, commands, dt=2e-3):
    """Return q (N, n) and dq (N, n) of what a limiter leaves of commands."""
    left = [limiter(JointCommand(q, dq), q, dt, dt) for q, dq in commands]
    return np.array([c.q for c in left]), np.array([c.dq for c in left])


def constant(speed, steps, q=-1.0, dt=2e-3):
    """Return commands of a motion of constant speed, as a law integrates it."""
    return [(np.full(2, q + k * dt * speed), np.full(2, speed)) for k in range(steps)]


@pytest.mark.parametrize("dt", [2e-3, 0.02])
@pytest.mark.parametrize("lag", [0.0, 0.02, -0.1, 0.2])
def test_a_stop_at_once_is_braked_also_where_the_law_begins_elsewhere(lag, dt):
    limiter = CommandLimiter(LIMITS)
    ramp = [(np.zeros(2), np.zeros(2))]
    for k in range(1, round(0.1 / dt)):  # exact for steps: q goes on by the velocity before
        ramp.append((ramp[-1][0] + dt * ramp[-1][1], np.full(2, 10 * k * dt)))
    q_0, _ = through(limiter, ramp, dt)
    assert limiter.bounded == 0
    end = q_0[-1] - lag
    q, dq = through(limiter, 2000 * [(end, np.zeros(2))], dt)
    assert limiter.bounded > 0
    speeds = np.vstack([ramp[-1][1], np.diff(np.vstack([q_0[-1], q]), axis=0) / dt])
    assert (np.abs(np.diff(speeds, axis=0)) <= 10 * dt + 1e-9).all()
    assert (np.abs(np.diff(np.vstack([ramp[-1][1], dq]), axis=0)) <= 10 * dt + 1e-9).all()
    np.testing.assert_allclose(q[-1], end, rtol=0, atol=1e-6)
    np.testing.assert_allclose(dq[-1], 0, rtol=0, atol=1e-5)
    assert (np.abs(q - end) <= 0.5 * 0.98**2 / 10 + abs(lag) + 0.01).all()


def test_a_motion_that_begins_at_once_begins_within_the_acceleration():
    _, dq = through(CommandLimiter(LIMITS), constant(0.5, 1500))
    assert (np.abs(np.diff(np.vstack([np.zeros(2), dq]), axis=0)) <= 10 * 2e-3 + 1e-9).all()
    np.testing.assert_allclose(dq[-1], 0.5, rtol=1e-6)


def test_a_joint_without_a_speed_limit_makes_no_nan_where_no_time_has_passed():
    free = replace(LIMITS, velocity=np.array([1.0, math.inf]))
    limiter = CommandLimiter(free)
    limiter(JointCommand(np.zeros(2), np.zeros(2)), np.zeros(2), 2e-3)
    command = limiter(JointCommand(np.ones(2), np.zeros(2)), np.ones(2), 0.0)
    np.testing.assert_array_equal(command.q, np.zeros(2))


# --- the parameter ------------------------------------------------------------------------------


def test_the_parameter_is_one_number_or_one_a_joint():
    np.testing.assert_array_equal(ClikParameters().limits(UR5).acceleration, np.full(6, 10.0))
    six = tuple(float(k) for k in range(1, 7))
    given = ClikParameters(max_joint_acceleration=six).limits(UR5)
    np.testing.assert_array_equal(given.acceleration, six)
    assert ClikParameters(enforce_limits=False).limits(UR5) is None
    for wrong in ((), (1.0, 2.0), 7 * (1.0,)):
        with pytest.raises(ConfigurationError, match=r"max_joint_acceleration.*shoulder_pan_joint"):
            ClikParameters(max_joint_acceleration=wrong).limits(UR5)
