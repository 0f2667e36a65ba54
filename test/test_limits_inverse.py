"""The limits of the joints, and the inverse of the Jacobian."""

import math

import numpy as np
import pytest
from arms import robot_named
from samples import generator
from tolerances import ALGEBRAIC, LIMIT_ROUNDING, RELATIVE

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.inverse import DampedInverse, smallest_singular_value
from eulerparams_control.laws.limits import JointLimits

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


def test_a_velocity_within_or_on_the_limits_is_not_touched():
    for dq in (np.array([1.9, -0.9, 3.9]), LIMITS.velocity):
        limited, changed = LIMITS.limit_velocity(np.zeros(3), dq, DT)
        assert not changed
        np.testing.assert_array_equal(limited, dq)


def test_too_fast_a_motion_is_slowed_in_its_direction_to_the_limit_of_one_joint():
    for dq in 20 * generator(71).normal(size=(200, 3)):
        limited, changed = LIMITS.limit_velocity(np.zeros(3), dq, 1e-6)
        excess = np.max(np.abs(dq) / LIMITS.velocity)
        assert changed == (excess > 1)
        np.testing.assert_allclose(limited, dq / max(excess, 1), rtol=RELATIVE)
        if excess > 1:
            assert np.max(np.abs(limited) / LIMITS.velocity) == pytest.approx(1, rel=RELATIVE)


def test_from_within_no_joint_goes_beyond_its_limits_whatever_is_wanted():
    random = generator(72)
    for scale in (0.1, 1.0, 10.0, 1e6, 1e300):
        for _ in range(100):
            q = random.uniform([-1, -2, -9], [1, 0.5, 9])
            dt = 10 ** random.uniform(-4, 0)
            limited, _ = LIMITS.limit_velocity(q, scale * random.normal(size=3), dt)
            assert np.all(np.abs(limited) <= LIMITS.velocity * (1 + RELATIVE))
            reached = q + dt * limited
            assert np.all(reached <= LIMITS.upper + LIMIT_ROUNDING)
            assert np.all(reached >= LIMITS.lower - LIMIT_ROUNDING)


def test_a_joint_stops_at_its_limit_and_the_others_go_on():
    q = np.array([0.99, 0.0, 0.0])
    limited, changed = LIMITS.limit_velocity(q, np.array([1.5, 0.5, -3.0]), 0.1)
    assert changed
    np.testing.assert_allclose(limited, [0.1, 0.5, -3.0], rtol=0, atol=LIMIT_ROUNDING)


@pytest.mark.parametrize("outside", [1.2, -1.5])
def test_from_outside_only_inward_motion_is_allowed(outside):
    q = np.array([outside, 0.0, 0.0])
    inwards = -math.copysign(1.0, outside)
    limited, changed = LIMITS.limit_velocity(q, np.array([inwards, 0.5, 0.0]), DT)
    assert not changed
    np.testing.assert_array_equal(limited, [inwards, 0.5, 0.0])
    limited, changed = LIMITS.limit_velocity(q, np.array([-inwards, 0.5, 0.0]), DT)
    assert changed
    np.testing.assert_array_equal(limited, [0.0, 0.5, 0.0])


def test_from_outside_inward_motion_keeps_to_the_speed_and_to_the_other_end():
    q = np.array([1.2, 0.0, 0.0])
    limited, _ = LIMITS.limit_velocity(q, np.array([-8.0, 0.0, 0.0]), DT)
    assert limited[0] == pytest.approx(-2.0, rel=RELATIVE)
    limited, _ = LIMITS.limit_velocity(q, np.array([-1.9, 0.0, 0.0]), 2.0)
    assert limited[0] == pytest.approx(-1.1, rel=RELATIVE)  # ends at -1


def test_limits_scaled_have_slower_speeds_only():
    scaled = LIMITS.scaled(0.25)
    np.testing.assert_allclose(scaled.velocity, [0.5, 0.25, 1.0], rtol=RELATIVE)
    for name in ("lower", "upper", "effort"):
        np.testing.assert_array_equal(getattr(scaled, name), getattr(LIMITS, name))
    assert LIMITS.velocity.tolist() == [2.0, 1.0, 4.0]


def test_positions_on_the_limits_are_within_and_beyond_are_not():
    assert LIMITS.contain(np.array([1.0, -2.0, 1e9]))
    assert not LIMITS.contain(np.array([np.nextafter(1.0, 2), 0.0, 0.0]))
    assert not LIMITS.contain(np.array([0.0, np.nextafter(-2.0, -3), 0.0]))


def test_a_difference_is_modulo_a_turn_where_there_are_no_limits_of_position():
    q, turn = np.array([0.1, 0.2, 0.3]), 2 * math.pi
    moved = q + [0.1, -0.2, 0.3]
    for turns in (-2, 0, 5):
        q_c = moved + turns * turn * np.eye(3)[2]
        difference = LIMITS.difference(q_c, q)
        np.testing.assert_allclose(difference, [0.1, -0.2, 0.3], rtol=0, atol=LIMIT_ROUNDING)
        np.testing.assert_array_equal(LIMITS.deviation(q_c, q), np.abs(difference))
    far = LIMITS.difference(moved + turn * np.eye(3)[0], q)
    assert far[0] == pytest.approx(0.1 + turn, rel=RELATIVE)


# --- limits of acceleration and effort ------------------------------------------------------

JOINTS = 500  # that are simulated at once
STOPPING = 0.01  # [s] of speed by which a joint at full speed overshoots where it must stop


def many_limits():
    """Return the limits of many joints of all sizes, between them one with none."""
    random = generator(75)
    centre, half = random.uniform(-3, 3, size=JOINTS), 10 ** random.uniform(-2, 1, size=JOINTS)
    lower, upper = centre - half, centre + half
    speed = 10 ** random.uniform(-1, 1, size=JOINTS)
    lower[0], upper[0], speed[1] = -math.inf, math.inf, math.inf
    return JointLimits(lower, upper, speed, np.full(JOINTS, math.inf))


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
@pytest.mark.parametrize("dt", [1e-3, 1e-2, 0.05, 0.2])
def test_no_acceleration_that_is_wanted_leads_beyond_position_or_speed(adversary, dt):
    limits = many_limits()
    start, speed = states_within(limits)
    slow = that_can_stop(limits, start, speed)
    for q, dq in play(limits, (start, slow), adversaries()[adversary], dt):
        assert np.all(np.abs(dq) <= limits.velocity * (1 + RELATIVE))
        assert np.all(q <= limits.upper + LIMIT_ROUNDING)
        assert np.all(q >= limits.lower - LIMIT_ROUNDING)


@every_adversary
def test_a_joint_at_full_speed_at_its_limit_stops_within_a_hundredth_of_it(adversary):
    limits = many_limits()
    start, speed = states_within(limits)
    over = STOPPING * np.abs(speed)
    for q, dq in play(limits, (start, speed), adversaries()[adversary]):
        assert np.all(np.abs(dq) <= limits.velocity * (1 + RELATIVE))
        assert np.all(q <= limits.upper + over + LIMIT_ROUNDING)
        assert np.all(q >= limits.lower - over - LIMIT_ROUNDING)


def test_the_limits_are_reached_when_that_is_wanted():
    limits = many_limits()
    start, speed = states_within(limits)
    slow = that_can_stop(limits, start, speed)
    path = list(play(limits, (start, slow), adversaries()["up"], duration=3.0))
    q, fastest = path[-1][0], np.max([dq for _, dq in path], axis=0)
    near = limits.upper - limits.lower < limits.velocity  # these have had the time
    assert near.sum() > 50
    np.testing.assert_allclose(q[near], limits.upper[near], rtol=0, atol=1e-6)
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


def test_the_acceleration_of_one_joint_is_limited_and_the_others_keep_theirs():
    q = np.array([0.999, 0.0, 0.0])
    wanted = np.array([50.0, 40.0, -30.0])
    limited, changed = LIMITS.limit_acceleration(q, np.zeros(3), wanted, 1e-3)
    assert changed
    assert limited[0] == pytest.approx(1.0, rel=1e3 * RELATIVE)  # 100 / s of 10 / s of 0.001
    np.testing.assert_array_equal(limited[1:], [40.0, -30.0])


def test_without_limits_no_finite_acceleration_is_touched():
    none = np.full(3, math.inf)
    free = JointLimits(-none, none, none, none)
    for scale in (1.0, 1e9, 1e300):
        ddq = scale * np.array([1.0, -1.0, 0.0])
        limited, changed = free.limit_acceleration(scale * np.ones(3), -ddq, ddq, 1e-3)
        assert not changed
        np.testing.assert_array_equal(limited, ddq)
        limited, changed = free.limit_effort(ddq)
        assert not changed
        np.testing.assert_array_equal(limited, ddq)


def test_an_effort_beyond_its_limit_is_cut_to_it_and_told():
    wanted = np.array([10.5, -20.5, 1e300])
    limited, changed = LIMITS.limit_effort(wanted)
    assert changed
    assert limited.tolist() == [10.0, -20.0, 1e300]
    limited, changed = LIMITS.limit_effort(-wanted)
    assert changed
    assert limited.tolist() == [-10.0, 20.0, -1e300]
    on_it = np.array([10.0, -20.0, -3.0])
    limited, changed = LIMITS.limit_effort(on_it)
    assert not changed
    np.testing.assert_array_equal(limited, on_it)


# --- the inverse --------------------------------------------------------------------------


def test_away_from_singularities_the_damped_inverse_is_the_inverse():
    for key in range(50):
        sigma = generator(73, key).uniform(EPS, 2.0, size=6)
        J = jacobian_with(sigma, key=key)
        np.testing.assert_allclose(DampedInverse()(J), np.linalg.inv(J), rtol=0, atol=ALGEBRAIC)


@pytest.mark.parametrize("name", ["panda", "kuka_iiwa"])
def test_for_seven_joints_it_is_the_pseudo_inverse(name):
    robot, home = robot_named(name)
    J = robot.state(home, np.zeros(7)).J
    J_inverse = DampedInverse()(J)
    np.testing.assert_allclose(J_inverse, np.linalg.pinv(J), rtol=0, atol=ALGEBRAIC)
    np.testing.assert_allclose(J @ J_inverse, np.eye(6), rtol=0, atol=ALGEBRAIC)


@pytest.mark.parametrize("columns", [6, 7, 9])
@pytest.mark.parametrize("smallest", [0.0499, 0.03, 0.01, 1e-3, 1e-6])
def test_near_a_singularity_it_is_the_formula_of_the_damped_inverse(columns, smallest):
    inverse = DampedInverse(eps=EPS, lambda_max=0.04)
    lambda_2 = (1 - (smallest / EPS) ** 2) * 0.04**2
    for key in range(10):
        J = jacobian_with([2.0, 1.5, 1.0, 0.5, 0.2, smallest], columns, key)
        expected = J.T @ np.linalg.inv(J @ J.T + lambda_2 * np.eye(6))
        np.testing.assert_allclose(inverse(J), expected, rtol=0, atol=1e3 * ALGEBRAIC)


@pytest.mark.parametrize("columns", [6, 7])
def test_at_and_near_singularities_it_is_bounded_by_the_damping(columns):
    inverse = DampedInverse()
    for smallest in [0.0, *np.geomspace(1e-16, 1, 60).tolist()]:
        J = jacobian_with([2.0, 1.5, 1.0, 1.0, 1.0, smallest], columns)
        norm = np.linalg.norm(inverse(J), 2)
        # s / (s^2 + lambda^2) <= 1 / (2 lambda), and 1 / s above eps; in between at most 1 / eps
        assert norm <= (1 / EPS) * (1 + ALGEBRAIC)


def test_it_is_continuous_where_damping_sets_in():
    inverse = DampedInverse()
    for columns in (6, 7):
        below, above = (
            inverse(jacobian_with([2.0, 1.5, 1.0, 1.0, 1.0, EPS * factor], columns))
            for factor in (1 - 1e-9, 1 + 1e-9)
        )
        np.testing.assert_allclose(below, above, rtol=0, atol=1e-6)


def test_a_direction_that_is_lost_gets_no_velocity():
    J = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    lost = np.eye(6)[5]
    for inverse in (DampedInverse(), DampedInverse(eps=0.0), DampedInverse(lambda_max=0.0)):
        np.testing.assert_array_equal(inverse(J) @ lost, np.zeros(6))


def test_fewer_joints_than_six_give_the_least_squares_velocity():
    J = generator(74).normal(size=(6, 4))
    np.testing.assert_allclose(DampedInverse()(J), np.linalg.pinv(J), rtol=0, atol=ALGEBRAIC)


def test_without_damping_it_is_unbounded_near_a_singularity():
    J = jacobian_with([2.0, 1.5, 1.0, 1.0, 1.0, 1e-9])
    assert np.linalg.norm(DampedInverse(eps=0.0)(J), 2) == pytest.approx(1e9, rel=1e-6)


def test_the_wrist_singularity_of_the_ur5_is_passed_with_bounded_speed():
    robot, home = robot_named("ur5")
    q = home.copy()
    q[4] = 0.0  # joints 4 and 6 in line
    J = robot.state(q, np.zeros(6)).J
    assert smallest_singular_value(J) == pytest.approx(0, abs=ALGEBRAIC)
    v = np.ones(6)
    assert np.linalg.norm(DampedInverse()(J) @ v) <= np.linalg.norm(v) / EPS


def test_what_is_not_finite_is_not_taken_for_a_singularity():
    for J in (np.full((6, 6), math.nan), np.full((6, 7), math.nan), np.full((6, 4), math.inf)):
        assert not np.isfinite(DampedInverse()(J)).any()
        assert not math.isfinite(smallest_singular_value(J))


def test_the_smallest_singular_value_is_that_of_the_jacobian():
    for smallest in np.geomspace(1e-9, 1e-2, 15):
        J = jacobian_with([2.0, 1.5, 1.0, 1.0, 0.5, smallest], 7)
        assert smallest_singular_value(J) == pytest.approx(smallest, abs=RELATIVE)
    for columns in (6, 7):
        J = jacobian_with([2.0, 1.5, 1.0, 1.0, 0.5, 0.125], columns)
        assert smallest_singular_value(J) == pytest.approx(0.125, abs=ALGEBRAIC)


@pytest.mark.parametrize("change", [{"eps": -0.1}, {"lambda_max": -1.0}])
def test_negative_damping_is_refused(change):
    with pytest.raises(ConfigurationError, match=f"{next(iter(change.values()))}.*expected >= 0"):
        DampedInverse(**change)


def test_what_is_not_a_number_stays_so_within_limits():
    limits, nan = JointLimits(*np.array([[-1.0, 1.0, 2.0, 9.0]]).T), np.array([math.nan])
    zero = np.zeros(1)
    for found in (
        limits.limit_velocity(nan, zero, 0.01)[0],
        limits.limit_velocity(zero, nan, 0.01)[0],
        limits.limit_acceleration(zero, nan, zero, 0.01)[0],
        limits.limit_effort(nan)[0],
        limits.excess(nan),
    ):
        assert np.isnan(found).all()
