"""The limits of the joints, and the inverse of the Jacobian."""

import math

import numpy as np
import pytest
from samples import generator
from tolerances import ALGEBRAIC, LIMIT_ROUNDING, RELATIVE

from eulerparams_control.catalogue import load_robot
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.inverse import DampedInverse, smallest_singular_value
from eulerparams_control.limits import JointLimits
from eulerparams_control.robot import Robot

DT = 0.01  # [s]
LIMITS = JointLimits(
    lower=np.array([-1.0, -2.0, -math.inf]),
    upper=np.array([1.0, 0.5, math.inf]),
    velocity=np.array([2.0, 1.0, 4.0]),
    effort=np.array([10.0, 20.0, math.inf]),
)
EPS = 0.05


def robot_named(name):
    """Return a robot of the catalogue and its home."""
    description = load_robot(name)
    robot = Robot(
        description.urdf, description.base_frame, description.tip_frame, description.joints
    )
    return robot, np.array(description.home)


def jacobian_with(sigma, columns=6, key=0):
    """Return J (6, columns) with these singular values, of random directions."""
    random = generator(70, key)
    U, _ = np.linalg.qr(random.normal(size=(6, 6)))
    V, _ = np.linalg.qr(random.normal(size=(columns, columns)))
    return U @ np.diag(sigma) @ V[:, :6].T


# --- limits -------------------------------------------------------------------------------


def test_a_velocity_within_the_limits_is_not_touched():
    dq = np.array([1.9, -0.9, 3.9])
    limited, changed = LIMITS.limit_velocity(np.zeros(3), dq, DT)
    assert not changed
    np.testing.assert_array_equal(limited, dq)


def test_a_velocity_on_the_limits_is_not_touched():
    _, changed = LIMITS.limit_velocity(np.zeros(3), LIMITS.velocity, DT)
    assert not changed


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


def test_the_smallest_singular_value_is_that_of_the_jacobian():
    for columns in (6, 7):
        J = jacobian_with([2.0, 1.5, 1.0, 1.0, 0.5, 0.125], columns)
        assert smallest_singular_value(J) == pytest.approx(0.125, abs=ALGEBRAIC)


@pytest.mark.parametrize("change", [{"eps": -0.1}, {"lambda_max": -1.0}])
def test_negative_damping_is_refused(change):
    with pytest.raises(ConfigurationError, match=f"{next(iter(change.values()))}.*expected >= 0"):
        DampedInverse(**change)
