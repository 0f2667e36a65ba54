"""Bounds of the compliant frame, moments that it cannot balance, a wrench that returns."""

import math

import numpy as np
import pytest
from arms import HOME, UR5, assert_no_jump, pose_of
from samples import generator, rodrigues

from eulerparams_control.errors import ConfigurationError, FollowingError
from eulerparams_control.laws.compliance_bounds import ComplianceBounds
from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.dynamic_control import EffortLimits
from eulerparams_control.laws.impedance_control import ImpedanceControl, ImpedanceLaw, NoMotionLoop
from eulerparams_control.laws.impedance_matrices import impedance_of
from eulerparams_control.laws.orientation import representation
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame
from eulerparams_control.parameters.impedance_control import ImpedanceParameters

HERE = DesiredFrame(np.array([0.4, 0.1, 0.3]), np.eye(3))
BOUNDS = ComplianceBounds(0.1, 0.8, 0.3)
FREE = ComplianceBounds()
DT = 1e-3


def compliance(bounds, orientation="euler_parameters", K_p=(0.0,) * 3, K_o=(5.0,) * 3):
    """Return an impedance that a hand moves easily."""
    p = impedance_of("p", (10.0,) * 3, (40.0,) * 3, K_p, (), 1.0)
    o = impedance_of("o", (0.5,) * 3, (4.0,) * 3, K_o, (), 1.0)
    return ComplianceLaw(representation(orientation), p, o, bounds=bounds)


def pushed(law, wrench_at, seconds, desired_at=lambda t: HERE, dt=DT):
    """Return the desired and the compliant frames under a wrench."""
    frame = CompliantFrame(law)
    times = [k * dt for k in range(round(seconds / dt))]
    return [
        (desired_at(t), frame.step(dt if t > 0 else 0.0, desired_at(t), wrench_at(t)))
        for t in times
    ]


def distances(pairs):
    """Return the displacements (N,) [m] and [rad]."""
    return (
        np.array([np.linalg.norm(frame.p_d - desired.p_d) for desired, frame in pairs]),
        np.array([angle_between(desired.R_d, frame.R_d) for desired, frame in pairs]),
    )


def speeds(pairs):
    """Return the speeds (N,) [m/s] and [rad/s] of the compliant relative to the desired frame."""
    return (
        np.array([np.linalg.norm(frame.dp_d - desired.dp_d) for desired, frame in pairs]),
        np.array([np.linalg.norm(frame.omega_d - desired.omega_d) for desired, frame in pairs]),
    )


def drifting(t):
    """Return a desired frame that moves and turns."""
    axis = np.array([0.0, 0.6, 0.8])
    R = rodrigues(0.3 * t, axis)
    v = np.array([0.05, 0.0, -0.02])
    return DesiredFrame(HERE.p_d + t * v, R, v, 0.3 * axis)


@pytest.mark.parametrize("orientation", ["euler_parameters", "rotation_vector", "euler_angles"])
@pytest.mark.parametrize("desired_at", [lambda t: HERE, drifting], ids=["still", "moving"])
@pytest.mark.parametrize("dt", [1e-3, 8e-3])
def test_a_push_ends_at_the_bounds_without_a_jump(orientation, desired_at, dt):
    w = np.array([20.0, 10.0, 0.0, 0.0, 0.0, 20.0])
    pairs = pushed(compliance(BOUNDS, orientation), lambda t: w, 3.0, desired_at, dt)
    assert_no_jump([frame for _, frame in pairs], dt)
    for found, most in zip(distances(pairs), (0.1, 0.8), strict=True):
        assert found.max() <= most * 1.002
        assert found[-1] == pytest.approx(most, rel=5e-3)
    for found in speeds(pairs):
        assert found.max() <= 0.3 * 1.002
        assert found.max() == pytest.approx(0.3, rel=1e-2)


def test_it_comes_back_from_the_bounds_at_once_when_the_push_ends():
    law = compliance(BOUNDS, K_p=(100.0,) * 3)
    ends = 2.0
    pairs = pushed(law, lambda t: np.array([30.0, 0, 0, 0, 0, 9.0]) * (t < ends), 4.0)
    position, rotation = distances(pairs)
    k = round(ends / DT)
    assert position[k] == pytest.approx(0.1, rel=5e-3)  # no wind-up
    assert position[k + 200] < 0.09
    assert rotation[k + 200] < 0.7
    assert_no_jump([frame for _, frame in pairs], DT)


def test_within_the_bounds_nothing_changes_to_the_bit():
    random = generator(920).normal(size=6)

    def wrench_at(t):
        return np.array([4.0, 3.0, 2.0, 0.5, 0.4, 0.6]) * np.sin(7 * t + random)

    bounded, free = (
        pushed(compliance(bounds), wrench_at, 1.0, drifting) for bounds in (BOUNDS, FREE)
    )
    for (_, a), (_, b) in zip(bounded, free, strict=True):
        for one, other in zip(a, b, strict=True):
            np.testing.assert_array_equal(one, other)


def test_bounds_that_are_lowered_bring_the_frame_back_without_a_jump():
    frame = CompliantFrame(compliance(FREE))
    w, found = np.array([20.0, 0, 0, 0, 0, 4.0]), []
    for k in range(2500):
        if k == 700:
            frame.replace_law(compliance(ComplianceBounds(0.05, 0.3, 0.4)))
        found.append(frame.step(DT if k else 0.0, HERE, w))
    assert_no_jump(found, DT)
    fastest = 10 * 0.4 + 2.0  # [m/s^2] 10 / s of its speed, beside the push
    assert max(np.abs(frame.ddp_d).max() for frame in found) <= fastest
    assert np.linalg.norm(found[699].p_d - HERE.p_d) > 0.15
    assert np.linalg.norm(found[-1].p_d - HERE.p_d) == pytest.approx(0.05, rel=1e-2)
    assert angle_between(HERE.R_d, found[-1].R_d) == pytest.approx(0.3, rel=1e-2)


@pytest.mark.parametrize("wrong", [{"position": 0.0}, {"rotation": -1.0}, {"speed": math.nan}])
def test_bounds_that_are_not_positive_are_refused(wrong):
    with pytest.raises(ConfigurationError, match="expected > 0"):
        ComplianceBounds(**wrong)


# --- what cannot be balanced ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("orientation", "K_o", "least"),
    [
        ("euler_parameters", (50.0, 60.0, 70.0), 50.0),  # K sin(theta)
        ("angle_axis", (50.0, 50.0, 50.0), 25.0),  # K sin(theta) cos(theta)
        ("rotation_vector", (10.0, 60.0, 70.0), 10.0 * math.pi),  # K theta
        ("euler_angles", (10.0, 10.0, 10.0), math.inf),
    ],
)
def test_a_stiffness_that_cannot_balance_the_moment_that_stops_is_said(orientation, K_o, least):
    found = representation(orientation).least_moment(np.diag(K_o))
    assert found == pytest.approx(least, rel=0.02)
    for most, is_said in ((0.9 * min(least, 100.0), False), (1.1 * least, math.isfinite(least))):
        given = ImpedanceParameters(
            orientation=orientation, K_o=K_o, max_contact_torque=min(most, 1e3)
        )
        assert bool(given.advice()) == is_said
    assert not ImpedanceParameters().advice()


# --- a wrench that returns ----------------------------------------------------------------------


@pytest.mark.parametrize(("moved", "stops"), [(0.04, False), (0.06, True)])
def test_a_wrench_that_returns_while_the_frames_are_far_apart_stops(moved, stops):
    law = ImpedanceLaw(
        compliance(FREE, K_p=(1000.0,) * 3), max_jump_position=0.05, max_jump_rotation=0.2
    )
    scheme = ImpedanceControl(NoMotionLoop(UR5, EffortLimits()), law)
    scheme.reset(HOME)
    still, home = 0 * HOME, pose_of(UR5, HOME)
    felt = SensedWrench(np.zeros(6), AT_ORIGIN)
    scheme.sense(felt)
    scheme.tick(0.0, HOME, still, home)
    scheme.sense(None)
    goal = home._replace(p_d=home.p_d + [moved, 0.0, 0.0])  # set-points stream on meanwhile
    for _ in range(5):
        scheme.tick(DT, HOME, still, goal)
    scheme.sense(felt)
    if stops:
        with pytest.raises(FollowingError, match="max_jump_position"):
            scheme.tick(DT, HOME, still, goal)
        scheme.hold(DT, HOME, still)
        scheme.tick(DT, HOME, still, scheme.frame_at(HOME))  # at rest it goes on
    else:
        scheme.tick(DT, HOME, still, goal)
        scheme.tick(DT, HOME, still, goal._replace(p_d=home.p_d + [0.5, 0.0, 0.0]))  # only then
