"""The limits of the joints, and the inverse of the Jacobian."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from arms import HOME, STILL, UR5
from samples import generator
from tolerances import ALGEBRAIC, LIMIT_ROUNDING, RELATIVE, assert_close

from eulerparams_control.control.limiter import Limiter
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.inverse import DampedInverse, sigma_min
from eulerparams_control.laws.limits import JointLimits, factor_within
from eulerparams_control.laws.scheme import JointCommand
from eulerparams_control.parameters.clik import ClikParameters

DT = 0.01  # [s]
LIMITS = JointLimits(
    lower=np.array([-1.0, -2.0, -math.inf]),
    upper=np.array([1.0, 0.5, math.inf]),
    velocity=np.array([2.0, 1.0, 4.0]),
    effort=np.array([10.0, 20.0, math.inf]),
)
EPS = 0.05


def jacobian_with(sigma, columns=6, key=0):
    """Return J (6, columns) with these singular values, of random directions."""
    random = generator(70, key)
    U, _ = np.linalg.qr(random.normal(size=(6, 6)))
    V, _ = np.linalg.qr(random.normal(size=(columns, columns)))
    return U @ np.diag(sigma) @ V[:, :6].T


# --- limits -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("q_1", "dq", "dt", "expected", "atol"),
    [
        (0.0, [1.9, -0.9, 3.9], DT, None, 0),
        (0.0, LIMITS.velocity, DT, None, 0),
        (0.99, [1.5, 0.5, -3.0], 0.1, [0.1, 0.5, -3.0], LIMIT_ROUNDING),  # the others go on
        *((at, [inwards, 0.5, 0.0], DT, None, 0) for at, inwards in ((1.2, -1.0), (-1.5, 1.0))),
        *((at, [out, 0.5, 0.0], DT, [0.0, 0.5, 0.0], 0) for at, out in ((1.2, 1.0), (-1.5, -1.0))),
        (1.2, [-8.0, 0.0, 0.0], DT, [-2.0, 0.0, 0.0], RELATIVE),
        (1.2, [-1.9, 0.0, 0.0], 2.0, [-1.1, 0.0, 0.0], RELATIVE),  # ends at -1
    ],
)
def test_a_velocity_is_limited_by_speed_and_position_and_outside_goes_inwards(
    q_1, dq, dt, expected, atol
):
    limited, changed = LIMITS.limit_velocity(
        np.array([q_1, 0.0, 0.0]), np.array(dq), dt, np.zeros(3)
    )
    assert changed == (expected is not None)
    assert_close(limited, expected if changed else dq, atol)


def test_too_fast_a_motion_is_slowed_in_its_direction_to_the_limit_of_one_joint():
    for dq in 20 * generator(71).normal(size=(200, 3)):
        limited, changed = LIMITS.limit_velocity(np.zeros(3), dq, 1e-6, dq)
        excess = np.max(np.abs(dq) / LIMITS.velocity)
        assert changed == (excess > 1)
        np.testing.assert_allclose(limited, dq / max(excess, 1), rtol=RELATIVE)
        if excess > 1:
            assert np.max(np.abs(limited) / LIMITS.velocity) == pytest.approx(1, rel=RELATIVE)


def test_a_difference_is_modulo_a_turn_where_there_are_no_limits_of_position():
    q, turn = np.array([0.1, 0.2, 0.3]), 2 * math.pi
    moved = q + [0.1, -0.2, 0.3]
    for turns in (-2, 0, 5):
        q_c = moved + turns * turn * np.eye(3)[2]
        assert_close(LIMITS.difference(q_c, q), [0.1, -0.2, 0.3], LIMIT_ROUNDING)
    far = LIMITS.difference(moved + turn * np.eye(3)[0], q)
    assert far[0] == pytest.approx(0.1 + turn, rel=RELATIVE)


# --- limits of acceleration and effort ------------------------------------------------------
JOINTS = 500  # that are simulated at once
STOPPING = 0.01  # [s] of speed by which a joint at full speed overshoots where it must stop


def many_limits():
    """Return the limits of many joints of all sizes, between them some with none."""
    random = generator(75)
    centre, half = random.uniform(-3, 3, size=JOINTS), 10 ** random.uniform(-2, 1, size=JOINTS)
    lower, upper = centre - half, centre + half
    speed = 10 ** random.uniform(-1, 1, size=JOINTS)
    lower[0], upper[0], speed[1] = -math.inf, math.inf, math.inf
    return JointLimits(lower, upper, speed, np.full(JOINTS, math.inf))


def assert_within(limits, q, dq, over=0.0):
    """Assert that speeds keep their limits, and positions theirs but for ``over`` (n,)."""
    assert np.all(np.abs(dq) <= limits.velocity * (1 + RELATIVE))
    assert np.all(q <= limits.upper + over + LIMIT_ROUNDING)
    assert np.all(q >= limits.lower - over - LIMIT_ROUNDING)


def adversaries():
    """Return functions of time and velocity that want an acceleration for each joint."""
    random = generator(76)
    outwards = np.where(random.uniform(size=JOINTS) < 0.5, -1.0, 1.0)
    frequency = random.uniform(1, 30, size=JOINTS)
    return {
        "up": lambda t, dq: np.full(JOINTS, 1e9),
        "down": lambda t, dq: np.full(JOINTS, -1e9),
        "either way": lambda t, dq: 1e3 * outwards,
        "to and fro": lambda t, dq: 300 * np.sign(np.sin(frequency * t)),
        "with the motion": lambda t, dq: 50 * np.sign(dq),
        "at random": lambda t, dq: 1e4 * random.normal(size=JOINTS),
        "moderate": lambda t, dq: outwards + np.sin(frequency * t),
        "none": lambda t, dq: np.zeros(JOINTS),
    }


def play(limits, start, adversary, dt=1e-3, duration=1.0):
    """Yield q and dq after each step of what the limits leave of an adversary's wishes."""
    q, dq = start
    for step in range(round(duration / dt)):
        ddq, _ = limits.limit_acceleration(q, dq, adversary(step * dt, dq), dt)
        dq = dq + dt * ddq
        q = q + dt * dq
        yield q, dq


def states_within(limits):
    """Return q within the limits, and dq within those of speed."""
    random = generator(77)
    lower, upper = np.maximum(limits.lower, -9), np.minimum(limits.upper, 9)
    share = random.uniform(size=JOINTS)
    share[::5], share[1::5] = 0.0, 1.0  # on a limit
    speed = np.minimum(limits.velocity, 20) * random.uniform(-1, 1, size=JOINTS)
    return lower + share * (upper - lower), speed


def that_can_stop(limits, q, dq):
    """Return dq slowed to what the distance to the limits allows: 10 / s of it."""
    return np.clip(dq, 10 * (limits.lower - q), 10 * (limits.upper - q))


every_adversary = pytest.mark.parametrize("adversary", adversaries())


@every_adversary
def test_a_joint_that_comes_to_its_limit_at_full_speed_overshoots_by_little(adversary):
    limits = many_limits()
    start, speed = states_within(limits)
    for q, dq in play(limits, (start, speed), adversaries()[adversary]):
        assert_within(limits, q, dq, STOPPING * np.abs(speed))


@every_adversary
@pytest.mark.parametrize(
    ("of", "dt"),
    [
        *product(["velocity"], (2e-3, 0.1)),
        *product(["acceleration"], (2e-3, 0.02, 0.2)),
    ],
)
def test_what_is_left_of_any_wish_keeps_speed_position_and_acceleration_at_once(adversary, of, dt):
    limits, wanted, n = many_limits(), adversaries()[adversary], 20
    most = 3 * 10 ** generator(900).uniform(-1, 1, size=JOINTS)
    most[2] = math.inf
    limits = JointLimits(*(part[:n] for part in vars(replace(limits, acceleration=most)).values()))
    alone = [JointLimits(*(part[i : i + 1] for part in vars(limits).values())) for i in range(n)]
    q, dq = np.clip(np.zeros(n), limits.lower, limits.upper), np.zeros(n)
    for step in range(round(min(1.5, 300 * dt) / dt)):
        before = dq
        wants = wanted(step * dt, np.resize(dq, JOINTS))
        rows = [(one, q[i : i + 1], dq[i : i + 1], wants[i : i + 1]) for i, one in enumerate(alone)]
        if of == "velocity":
            dq = np.concatenate([x.limit_velocity(q_i, w, dt, dq_i)[0] for x, q_i, dq_i, w in rows])
            assert (np.abs(dq - before) <= limits.acceleration * dt * (1 + 1e-9)).all()
        else:
            ddq = np.concatenate([x.limit_acceleration(*row, dt)[0] for x, *row in rows])
            assert (np.abs(ddq) <= limits.acceleration * (1 + RELATIVE)).all()
            dq = dq + dt * ddq
        q = q + dt * dq
        assert_within(limits, q, dq)


def test_the_limits_are_reached_when_that_is_wanted():
    limits = many_limits()
    start, speed = states_within(limits)
    slow = that_can_stop(limits, start, speed)
    path = list(play(limits, (start, slow), adversaries()["up"], duration=3.0))
    q, fastest = path[-1][0], np.max([dq for _, dq in path], axis=0)
    near = limits.upper - limits.lower < limits.velocity  # these have had the time
    assert near.sum() > 50
    assert_close(q[near], limits.upper[near], 1e-6)
    assert fastest[0] == pytest.approx(limits.velocity[0], rel=1e-9)


@pytest.mark.parametrize("side", [1, -1], ids=["above", "below"])
def test_from_outside_a_joint_can_only_come_back(side):
    limits = many_limits()
    width = limits.upper - limits.lower
    start = np.where(side > 0, limits.upper, limits.lower) + side * 0.3 * np.minimum(width, 1)
    start[0] = 0.0  # it has no outside
    at_rest = start, np.zeros(JOINTS)
    for adversary in ("up", "down", "to and fro", "at random"):
        outermost = start
        for q, dq in play(limits, at_rest, adversaries()[adversary], duration=0.3):
            assert np.all(side * (q - outermost)[1:] <= LIMIT_ROUNDING)
            # where it has been further in, it may move within the limits
            inside = limits.upper if side > 0 else limits.lower
            outermost = side * np.maximum(side * q, side * inside)
            assert np.all(np.abs(dq) <= limits.velocity * (1 + RELATIVE))
    for q, dq in play(limits, at_rest, adversaries()["none"], duration=0.1):
        np.testing.assert_array_equal(q, start)  # and need not
        np.testing.assert_array_equal(dq, np.zeros(JOINTS))
    home = "down" if side > 0 else "up"
    back = list(play(limits, at_rest, adversaries()[home], duration=0.3))[-1][0]
    assert np.all(side * (start - back)[1:] > 1e-3)


def test_too_fast_a_joint_is_braked_at_a_hundred_per_second_of_its_excess_or_as_time_is_left():
    q, dq = np.zeros(3), np.array([2.5, -1.5, 3.9])
    for dt, brakes in ((0.0, 50.0), (1e-3, 50.0), (0.02, 25.0), (0.1, 5.0)):
        limited, changed = LIMITS.limit_acceleration(q, dq, np.zeros(3), dt)
        assert changed
        np.testing.assert_allclose(limited, [-brakes, brakes, 0.0], rtol=RELATIVE)


def test_an_acceleration_or_effort_beyond_a_limit_is_cut_and_all_else_is_not_touched():
    q, wanted = np.array([0.999, 0.0, 0.0]), np.array([50.0, 40.0, -30.0])
    limited, changed = LIMITS.limit_acceleration(q, np.zeros(3), wanted, 1e-3)
    assert changed
    assert limited[0] == pytest.approx(1.0, rel=1e3 * RELATIVE)  # 100 / s of 10 / s of 0.001
    np.testing.assert_array_equal(limited[1:], [40.0, -30.0])
    for asked, allowed in (
        ([10.5, -20.5, 1e300], [10.0, -20.0, 1e300]),
        ([-10.5, 20.5, -1e300], [-10.0, 20.0, -1e300]),
        ([10.0, -20.0, -3.0], [10.0, -20.0, -3.0]),
    ):
        effort, changed = LIMITS.limit_effort(np.array(asked))
        assert (effort.tolist(), changed) == (allowed, asked != allowed)
    none = np.full(3, math.inf)
    free = JointLimits(-none, none, none, none)
    for scale in (1.0, 1e9, 1e300):
        ddq = scale * np.array([1.0, -1.0, 0.0])
        accelerations = free.limit_acceleration(scale * np.ones(3), -ddq, ddq, 1e-3)
        for limited, changed in (accelerations, free.limit_effort(ddq)):
            assert not changed
            np.testing.assert_array_equal(limited, ddq)


# --- the inverse --------------------------------------------------------------------------
@pytest.mark.parametrize("columns", [4, 6, 7, 9])
def test_away_from_singularities_the_damped_inverse_is_the_pseudo_inverse(columns):
    for key in range(50):
        sigma = generator(73, key).uniform(EPS, 2.0, size=6)
        J = jacobian_with(sigma, max(columns, 6), key=key)[:, :columns]
        assert_close(DampedInverse()(J), np.linalg.pinv(J), ALGEBRAIC)


@pytest.mark.parametrize("columns", [6, 7, 9])
@pytest.mark.parametrize("smallest", [0.0499, 0.03, 0.01, 1e-3, 1e-6])
def test_near_a_singularity_it_is_the_formula_of_the_damped_inverse(columns, smallest):
    inverse = DampedInverse(eps=EPS, lambda_max=0.04)
    lambda_2 = (1 - (smallest / EPS) ** 2) * 0.04**2
    for key in range(10):
        J = jacobian_with([2.0, 1.5, 1.0, 0.5, 0.2, smallest], columns, key)
        expected = J.T @ np.linalg.inv(J @ J.T + lambda_2 * np.eye(6))
        assert_close(inverse(J), expected, 1e3 * ALGEBRAIC)
        assert sigma_min(J, 1.0) == pytest.approx(smallest, abs=RELATIVE)


def test_what_is_not_finite_is_not_taken_for_a_singularity_and_no_damping_is_negative():
    for J in (np.full((6, 6), math.nan), np.full((6, 7), math.nan), np.full((6, 4), math.inf)):
        assert not np.isfinite(DampedInverse()(J)).any()
        assert not math.isfinite(sigma_min(J, 1.0))
    for change in ({"eps": -0.1}, {"lambda_max": -1.0}):
        with pytest.raises(ConfigurationError, match=f"{next(iter(change.values()))}.*expected >="):
            DampedInverse(**change)


def test_what_is_not_a_number_stays_so_within_limits():
    limits, nan, zero = JointLimits(*np.ones((4, 1))), np.array([math.nan]), np.zeros(1)
    for found in (
        limits.limit_velocity(nan, zero, 0.01, zero)[0],
        limits.limit_velocity(zero, nan, 0.01, zero)[0],
        limits.limit_acceleration(zero, nan, zero, 0.01)[0],
        limits.limit_effort(nan)[0],
    ):
        assert np.isnan(found).all()


# --- limits of acceleration ------------------------------------------------------------
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
    limits = JointLimits(
        -np.array([1.0, 9.0]), np.array([1.0, 9.0]), *np.full((2, 2), 2.0), np.full(2, 10.0)
    )
    at_the_limit, before = np.array([1.0, 0.0]), np.zeros(2)
    limited, _ = limits.limit_velocity(at_the_limit, np.array([1.0, 0.05]), 0.01, before)
    np.testing.assert_array_equal(limited, [0.0, 0.05])
    brakes = np.array([0.9, 0.0]), np.array([1.0, 1.0])  # 10 / s of the way, at 1 rad/s
    limited, _ = limits.limit_velocity(*brakes, 0.01, np.array([1.0, 0.0]))
    assert_close(limited - [1.0, 0.0], [0.0, 0.1], LIMIT_ROUNDING)
    limited, _ = limits.limit_velocity(np.array([0.91, 0.0]), brakes[1], 0.01, np.array([1.0, 0.0]))
    assert_close(limited - [1.0, 0.0], [-0.1, 0.1], LIMIT_ROUNDING)


def test_a_joint_that_could_not_stop_otherwise_brakes_harder_evenly():
    limits = JointLimits(*np.array([[-1.0, 1.0, 9.0, 1.0, 10.0]]).T)
    # 2.5 rad to stop at 10 rad/s^2: 25 are needed
    q, dq, dt, most = np.array([0.5]), np.array([5.0]), 1e-3, 0.0
    while abs(dq[0]) > 1e-6:
        before, (dq, _) = dq, limits.limit_velocity(q, dq, dt, dq)
        most, q = max(most, (before - dq)[0] / dt), q + dt * dq
    assert most == pytest.approx(25 / (1 + 5 * dt), rel=1e-6)  # steps stop a little later
    assert q == pytest.approx(1.0, abs=1e-6)


def test_clik_says_by_how_much_it_is_slowed():
    scheme = ClikParameters().make_scheme(UR5)
    scheme.bound(replace(UR5.limits, velocity=np.full(6, 0.1), acceleration=np.full(6, 10.0)))
    scheme.reset(HOME)
    start = scheme.start_frame()
    fast = start._replace(dp_d=np.array([0.0, 0.5, 0.0]))
    asked = np.abs(np.linalg.solve(UR5.state(HOME, STILL).J, [0.0, 0.5, 0.0, 0.0, 0.0, 0.0]))
    tick = scheme.tick(1e-3, HOME, STILL, fast)
    assert tick.excess == pytest.approx(asked.max() / 0.1, rel=1e-9)
    assert scheme.tick(1e-3, HOME, STILL, start).excess == 1.0


# --- the last line of defence -----------------------------------------------------------------
TWO = JointLimits(-2 * np.ones(2), 2 * np.ones(2), np.ones(2), np.ones(2), np.full(2, 10.0))


def through(limiter, commands, dt=2e-3):
    """Return q (N, n) and dq (N, n) of what a limiter leaves of commands."""
    left = [limiter(JointCommand(q, dq), q, dt, dt) for q, dq in commands]
    return np.array([c.q for c in left]), np.array([c.dq for c in left])


@pytest.mark.parametrize("dt", [2e-3, 0.02])
@pytest.mark.parametrize("lag", [0.0, 0.02, -0.1, 0.2])
def test_a_stop_or_start_at_once_is_within_the_acceleration_wherever_the_law_begins(lag, dt):
    limiter = Limiter(TWO)
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
    assert_close(q[-1], end, 1e-6)
    assert_close(dq[-1], 0, 1e-5)
    assert (np.abs(q - end) <= 0.5 * 0.98**2 / 10 + abs(lag) + 0.01).all()
    moves = [(np.full(2, -1.0 + 0.5 * k * dt), np.full(2, 0.5)) for k in range(round(3.0 / dt))]
    _, dq = through(Limiter(TWO), moves, dt)  # it begins at once
    assert (np.abs(np.diff(np.vstack([np.zeros(2), dq]), axis=0)) <= 10 * dt + 1e-9).all()
    np.testing.assert_allclose(dq[-1], 0.5, rtol=1e-6)


def test_a_joint_without_a_speed_limit_makes_no_nan_where_no_time_has_passed():
    free = replace(TWO, velocity=np.array([1.0, math.inf]))
    limiter = Limiter(free)
    limiter(JointCommand(np.zeros(2), np.zeros(2)), np.zeros(2), 2e-3)
    command = limiter(JointCommand(np.ones(2), np.zeros(2)), np.ones(2), 0.0)
    np.testing.assert_array_equal(command.q, np.zeros(2))


# --- the parameter ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("base", "step", "most", "factor"),
    [
        ([0.0, 2.0, -3.0], [0.5, 0.5, -0.5], [1.0, 3.0, 4.0], 1.0),
        ([0.0, 2.0, -3.0], [4.0, 2.0, 1.0], [1.0, 3.0, 4.0], 0.25),
        ([0.0, 2.0, -3.0], [0.0, 0.0, -2.0], [1.0, 3.0, 4.0], 0.5),
        ([0.0, 2.0, -3.0], [1.0, 0.0, 0.0], [0.0, 3.0, 4.0], 0.0),  # no room
        ([9.0, 2.0, -3.0], [4.0, 2.0, 1.0], [1.0, 3.0, 4.0], 0.5),  # that does not stop the others
    ],
)
def test_one_factor_keeps_a_step_within_its_bounds_and_its_direction(base, step, most, factor):
    assert factor_within(*map(np.array, (base, step, most))) == factor
