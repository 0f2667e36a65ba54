"""Compliance control: springs that make no energy, dampers that fit the arm, and their bounds.

The properties run over the registry of representations.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from arms import HOME, STILL, UR5, Plant, pose_of, robot_named
from geometry_msgs.msg import WrenchStamped
from representations import every_representation, make
from ros_processes import Controlled, pose, values, wrench_stamped
from samples import about, generator, positive_definite, turn_of, uniform, unit_vectors
from sensor_msgs.msg import JointState
from simulated import IDEAL, Simulated, frames_of
from tolerances import (
    DAMPING_RATIO,
    FORCE_IN_CONTACT,
    GRADIENT,
    NULL_SPACE,
    RELATIVE,
    assert_close,
)

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.elasticity import Elasticity
from eulerparams_control.laws.rotations import exp
from eulerparams_control.messages.keys import SPRINGS
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.compliance_control import ComplianceParameters
from eulerparams_control.parameters.fields import from_mapping

K_P, K_O = 300 * positive_definite(1, key=1)[0], 10 * positive_definite(1, key=2)[0]
SIX = np.triu_indices(3)
FRAMES = frames_of("ur5")
# [Nm/s] With so little the springs pull less, so that they can be taken back.
SLOW_EFFORTS = {"max_effort_rate": (1000.0,)}
FAR, UNCLIPPED = {"clip_position": 0.02, "clip_rotation": 0.1}, {}
# The first angle is so near to pi that a small turn passes it.
TURNED = about(0, math.pi - 1e-6) @ about(1, -0.2) @ about(2, 0.4)
DESIRED = DesiredFrame(np.array([0.3, 0.1, 0.4]), TURNED)


def springs_with(orientation="euler_parameters", K_p=K_P, K_o=K_O, **given):
    return Elasticity(make(orientation), K_p, K_o, **given)


def parameters_with(orientation="euler_parameters", name="ur5", K_p=K_P, **given):
    given |= {"orientation": orientation, "enforce_limits": False}
    given |= {"K_p": K_p[SIX].tolist(), "K_o": K_O[SIX].tolist()}
    given |= {"error_clip_position": 100.0, "error_clip_rotation": 100.0}
    return from_mapping(ComplianceParameters, frames_of(name) | given)


def control(orientation="euler_parameters", **given):
    return parameters_with(orientation, **given).make_scheme(UR5)


# --- the springs ---------------------------------------------------------------------------
@every_representation
@pytest.mark.parametrize("given", [UNCLIPPED, FAR])
@pytest.mark.parametrize("frame", ["base", "desired"])
@pytest.mark.parametrize("theta", [0.5, 1.4, 2.5])
def test_what_a_spring_exerts_is_minus_the_gradient_of_its_energy(name, given, frame, theta):
    springs, h = springs_with(name, frame=frame, **given), 1e-6
    most = 2.0 * springs.clip_rotation * np.linalg.eigvalsh(springs.K_o)[-1]
    for x, turn in zip(unit_vectors(8, key=3), unit_vectors(8, key=4), strict=True):
        p, R = DESIRED.p_d + 0.05 * x, exp(theta * turn) @ DESIRED.R_d
        pull = springs.wrench(p, R, DESIRED)
        for e in np.eye(3):
            along = [springs.wrench(p + s * h * e, R, DESIRED).energy for s in (1, -1)]
            turned = [springs.wrench(p, exp(s * h * e) @ R, DESIRED).energy for s in (1, -1)]
            assert_close(e @ pull.f, -(along[0] - along[1]) / (2 * h), GRADIENT)
            if np.linalg.norm(pull.mu) < (1.0 - RELATIVE) * most:  # it is cut next to a pole
                assert_close(e @ pull.mu, -(turned[0] - turned[1]) / (2 * h), GRADIENT)


@every_representation
@pytest.mark.parametrize("frame", ["base", "desired"])
def test_for_small_displacements_it_has_the_stiffness_that_is_stated(name, frame):
    x, turn = (1e-4 * v for v in unit_vectors(2, key=6))
    R_d, springs = DESIRED.R_d, springs_with(name, frame=frame)
    A = np.eye(3) if frame == "base" else R_d
    for sign in (1, -1):
        pull = springs.wrench(DESIRED.p_d + sign * x, exp(sign * turn) @ R_d, DESIRED)
        assert_close(pull.f, -sign * A @ K_P @ A.T @ x)
        assert pull.energy < 1e-4
        if name != "euler_angles":  # whose stiffness depends on the orientation, (58)
            stated = sign * R_d @ K_O @ R_d.T @ turn
            assert_close(pull.mu, -stated, 1e-3 * np.abs(stated).max())


@pytest.mark.parametrize("axis", range(3))
def test_beyond_its_clip_a_spring_pulls_no_more(axis):
    values, axes = np.linalg.eigh(K_P)
    springs, soft = springs_with(**FAR), math.sqrt(values[-1] / values[axis])
    for far in (1.0, 3.0, 100.0):
        pull = springs.wrench(DESIRED.p_d + far * 0.02 * soft * axes[:, axis], DESIRED.R_d, DESIRED)
        assert_close(pull.f, -0.02 * math.sqrt(values[-1] * values[axis]) * axes[:, axis])
        assert_close(pull.stretch, far)


def test_an_axis_without_stiffness_bounds_nothing():
    springs = springs_with(K_p=np.diag([0.0, 500.0, 500.0]), K_o=np.zeros((3, 3)), **FAR)
    pull = springs.wrench(DESIRED.p_d + [0.5, 0.01, 0.0], uniform(1)[0], DESIRED)
    assert_close(pull.f, [0.0, -5.0, 0.0])
    assert_close(pull.mu, np.zeros(3))


# --- the arm -------------------------------------------------------------------------------
def poles(scheme, plant, desired):
    """Return the poles [1/s] of the free arm at rest in the desired frame, by differences."""
    h, n = 1e-6, len(plant.q)

    def ddq(q, dq):
        scheme.reset(q)
        tau = scheme.tick(1e-3, q, dq, desired).command.effort
        return plant.acceleration(q, dq, tau)

    q, eye = plant.q, np.eye(n)
    by_q = [(ddq(q + h * e, 0 * e) - ddq(q - h * e, 0 * e)) / (2 * h) for e in eye]
    by_dq = [(ddq(q, h * e) - ddq(q, -h * e)) / (2 * h) for e in eye]
    top = np.hstack([np.zeros((n, n)), eye])
    return np.linalg.eigvals(np.vstack([top, np.hstack([np.array(by_q).T, np.array(by_dq).T])]))


def damping_ratios(scheme):
    """Return those of the poles, at home, and the largest |pole| [1/s]."""
    found = poles(scheme, Plant(), pose_of(UR5, HOME))
    return -found.real / np.abs(found), np.abs(found).max()


@every_representation
@pytest.mark.parametrize("frame", ["base", "desired"])
def test_each_mode_of_the_free_arm_has_the_damping_ratio(name, frame):
    ratios = {"damping_ratio_p": 0.7, "damping_ratio_o": 0.7}
    found, _ = damping_ratios(control(name, translational_frame=frame, **ratios))
    assert_close(found, 0.7, DAMPING_RATIO)


def test_two_damping_ratios_bound_those_of_the_modes_and_the_fastest_is_known():
    scheme = control(damping_ratio_p=0.5, damping_ratio_o=0.9)
    ratios, fastest = damping_ratios(scheme)
    assert 0.5 - DAMPING_RATIO < ratios.min() < 0.6 < 0.8 < ratios.max() < 0.9 + DAMPING_RATIO
    scheme.tick(1e-3, HOME, STILL, pose_of(UR5, HOME))
    known = scheme.fastest_gain
    assert known.rate == pytest.approx(fastest / 0.9, rel=0.05)
    assert known.name == "K_o"
    scheme.hold(1e-3, HOME, STILL)
    assert scheme.fastest_gain == known


def test_it_follows_a_motion_by_its_acceleration():
    scheme, plant, a = control(), Plant(), np.array([0.3, -0.2, 0.1])
    desired = pose_of(UR5, HOME)._replace(ddp_d=a, domega_d=2 * a)
    tau = scheme.tick(1e-3, HOME, STILL, desired).command.effort
    reached = plant.tip_acceleration(HOME, STILL, plant.acceleration(HOME, STILL, tau))
    assert_close(reached, [*a, *(2 * a)], NULL_SPACE)


def test_an_arm_that_is_as_fast_as_it_may_be_is_not_drawn_further():
    scheme = from_mapping(ComplianceParameters, FRAMES | SLOW_EFFORTS).make_scheme(UR5)
    home, parts, pulls = pose_of(UR5, HOME), [], []
    for speed in (-0.3, 0.2, 0.22, 0.24, 0.25, 0.3):
        dq = np.linalg.solve(UR5.state(HOME, STILL).J, [speed, 0, 0, 0, 0, 0])
        ticks = []
        for away in (0.03, 0.0):
            scheme.reset(HOME)
            desired = home._replace(p_d=home.p_d + [away, 0.0, 0.0])
            ticks.append(scheme.tick(1e-3, HOME, dq, desired))
        drawn, free = ticks
        pulls.append(np.abs(drawn.command.effort - free.command.effort).max())
        more = drawn.effects.dissipated - free.effects.dissipated
        parts.append(1.0 - more / (30.0 * speed))
        assert drawn.effects.lowered == 0.0
    assert_close(parts[:2] + parts[4:], [1.0, 1.0, 0.0, 0.0], 1e-9)
    assert 1.0 > parts[2] > parts[3] > 0.0
    assert pulls[1] > 0.1
    assert max(pulls[4:]) < 1e-9  # the springs are not felt


def test_clips_that_are_lowered_and_return_make_no_energy_around_any_closed_path():
    robot, home = robot_named("panda")
    parameters = from_mapping(ComplianceParameters, frames_of("panda") | SLOW_EFFORTS)
    scheme, start = parameters.make_scheme(robot), pose_of(robot, home)
    t = np.linspace(0.0, 2 * math.pi, 1500)
    for k in range(4):
        c = generator(9, k).normal(size=(2, 7))
        path = home + 0.3 * (c[0] * np.sin(t)[:, None] + c[1] * (np.cos(t)[:, None] - 1.0))
        scheme.reset(home)
        lowered, work, last = [], 0.0, None
        for q in path:
            tick = scheme.tick(1e-3, q, 0 * q, start)
            state, effects = tick.state, tick.effects
            w = np.array([*effects.f, *effects.mu])
            if last is not None:
                moved = [*(state.p_e - last[0].p_e), *turn_of(state.R_e @ last[0].R_e.T)]
                work += (w + last[1]) / 2 @ moved
            last = state, w
            lowered.append(effects.lowered)
        assert max(lowered) > 0.3
        assert lowered[-1] == 0.0  # they have returned
        assert work < -0.05  # and did not give back what lowering them took


@pytest.mark.parametrize(
    ("name", "rate", "stiffness"),
    [("ur5", 1000.0, 0.0), ("panda", 1000.0, 100.0), ("kuka_iiwa", 200.0, 4000.0)],
)
def test_an_arm_that_is_let_go_while_its_springs_change_keeps_to_its_speeds(name, rate, stiffness):
    run = Blocked(name, rate, 2.0).go(2.0)
    run.scheme.change(replace(run.parameters, K_p=(1000.0, stiffness, 1000.0)))
    run.go(2.0)
    assert not run.controller.fault
    assert (np.max(run.speeds, axis=0) < run.most).all()


def test_what_the_arm_loses_is_what_the_dampers_take():
    scheme, plant, dt = control(damping_ratio_p=0.3, damping_ratio_o=0.3), Plant(), 1e-4
    home = pose_of(UR5, HOME)
    scheme.tick(dt, plant.q, plant.dq, home)
    plant.q = plant.q + 1e-3 * np.arange(6)
    found = []
    for _ in range(1500):
        tick = scheme.tick(dt, plant.q, plant.dq, home)
        found.append(scheme.lyapunov(tick))
        plant.step(tick.command.effort, dt)
    V, dV = np.array(found).T
    assert V[-1] < 0.3 * V[0]
    assert_close(V[-1] - V[0], dt * dV.sum(), 0.01 * V[0])


# --- blocked -------------------------------------------------------------------------------
class Blocked(Simulated):
    """An arm that goes 0.3 m along y, where a wall is that vanishes after a while.

    Attributes:
        speeds: [m/s], [rad/s] of the tip at each tick.
        most: their limits.
        forces: [N] that the environment feels along y, at each tick.
    """

    def __init__(self, name, rate, seconds, **given):
        self.parameters = from_mapping(ComplianceParameters, frames_of(name) | given)
        position = list(pose_of(*robot_named(name)).p_d + [0.0, 0.03, 0.0])
        wall = {"shape": "plane", "position": position, "damping": 200.0, "end": seconds,
                "orientation": [0.5**0.5, 0.0, 0.0, 0.5**0.5], "stiffness": 2e4}  # fmt: skip
        solids = {"tool_shape": "sphere", "tool_size": [0.01], "environment": {"wall": wall}}
        # wrists as light as those of an ideal iiwa need states at 680 Hz
        joints = {} if name == "kuka_iiwa" else IDEAL
        super().__init__(name, self.parameters, rate=rate, **solids, **joints)
        self.end = self.start._replace(p_d=self.start.p_d + [0.0, 0.3, 0.0])
        self.controller.follow(Trajectory([0.0, 3.0], [self.start, self.end]), None)
        self.speeds, self.forces = [], []
        limits = self.parameters.motion_limits()
        self.most = np.array([limits.linear_speed, limits.angular_speed])

    def go(self, seconds):
        for _ in range(round(seconds * self.rate)):
            state = self.simulator.read()
            self.step(state)
            arm = self.controller.guidance.tick_now.state
            self.speeds.append([np.linalg.norm(arm.dp_e), np.linalg.norm(arm.omega_e)])
            self.forces.append(-(arm.R_e @ state.wrench[:3])[1])
        return self

    @property
    def y(self):
        """How far [m] the tip has come."""
        return self.controller.guidance.tick_now.state.p_e[1] - self.start.p_d[1]


@pytest.mark.parametrize(
    ("name", "rate", "force"),
    [("ur5", 200.0, 50.0), ("panda", 200.0, 38.14), ("kuka_iiwa", 1000.0, 50.0)],
)
def test_a_blocked_arm_pushes_and_then_follows_without_a_stop_or_a_lunge(name, rate, force):
    """With K_p error_clip_position, or what a light arm can take back when it is let go."""
    run = Blocked(name, rate, 6.0).go(6.0)
    tick = run.controller.guidance.tick_now
    assert_close(tick.effects.f[1], force, 0.1)
    assert tick.desired.p_d[1] - run.start.p_d[1] < 0.1  # it waits
    run.go(5.0)
    assert not run.controller.fault
    tick = run.controller.guidance.tick_now
    assert_close(tick.state.p_e, run.end.p_d, FORCE_IN_CONTACT)
    assert_close(turn_of(tick.state.R_e.T @ run.end.R_d), np.zeros(3), FORCE_IN_CONTACT)
    assert (np.max(run.speeds, axis=0) < run.most).all()


def test_a_blocked_arm_pushes_no_more_while_its_motion_goes_on_and_can_be_called_back():
    run = Blocked("ur5", 200.0, 100.0).go(1.5)
    assert max(run.forces) < 1.1 * 50.0  # the acceleration of the motion is besides
    run.controller.aim(run.start)
    run.go(0.7)
    assert_close(run.y, 0.0, 0.005)
    assert not run.controller.fault
    assert (np.max(run.speeds, axis=0) < run.most).all()


def test_where_no_spring_acts_a_tip_beyond_its_speed_is_braked():
    run = Blocked("ur5", 200.0, 0.01, K_p=(1000.0, 1000.0, 0.0))
    run.controller.aim(run.start)
    run.simulator.set_external_wrench(np.array([0.0, 0.0, 20.0, 0.0, 0.0, 0.0]))
    run.go(2.0)
    assert 0.9 * run.most[0] < np.max(run.speeds, axis=0)[0] < 1.25 * run.most[0]
    assert not run.controller.fault


# --- a force that is fed forward -------------------------------------------------------------
def test_a_force_is_added_to_that_of_the_springs_and_taken_back():
    """A wall of k = 2e4 N/m, 1 mm before the desired frame: f = 15 N + K_p (1 mm - f / k)."""
    run = Blocked("ur5", 200.0, 2.0)
    run.controller.aim(run.start._replace(p_d=run.start.p_d + [0.0, 0.021, 0.0]))
    run.go(1.0)

    def press(force, ticks=200):
        for _ in range(ticks):
            run.scheme.press(run.start.R_d.T @ [0.0, force, 0.0])
            run.go(0.005)

    press(15.0, 1)
    assert np.linalg.norm(run.scheme.fed) == pytest.approx(1.0)  # 200 N/s
    press(15.0)
    assert_close(run.forces[-1], 16.0 / 1.05, 0.01)
    assert np.abs(np.diff(run.forces[200:])).max() < 3.0  # it ramps
    press(15.0)  # the wall has gone: the springs hold
    assert_close(run.y, 0.021 + 0.015, 1e-3)
    assert (np.max(run.speeds, axis=0) < run.most).all()
    press(0.0)
    assert_close(run.y, 0.021, 1e-3)
    assert not run.scheme.is_pressing


def test_a_force_ends_with_a_halt_and_the_springs_have_to_hold_it():
    run = Blocked("ur5", 200.0, 0.01)
    run.scheme.press(np.array([0.0, 0.0, 5.0]))
    run.go(0.1)
    assert_close(run.scheme.fed, [0.0, 0.0, 5.0])
    assert run.scheme.springs == (run.scheme.elasticity, 1.0)
    run.controller.halt()
    run.go(0.5)
    assert not run.scheme.is_pressing
    assert run.scheme.springs is None
    y, free = np.array([0.0, 1.0, 0.0]), springs_with(K_p=np.diag([1e3, 0.0, 1e3]), **FAR)
    run.scheme.elasticity.refuse_force(44.0 * y, np.eye(3))
    for springs, force in ((run.scheme.elasticity, 46.0), (free, 1.0)):
        with pytest.raises(ConfigurationError, match=f"do not hold {force:g} N"):
            springs.refuse_force(force * y, np.eye(3))


def test_its_node_adds_a_force_until_the_stream_ends_and_refuses_what_no_spring_holds(world):
    node = Controlled(world, "compliance_control", FRAMES)
    arm, (p, R) = node.arm, pose(HOME)
    targets = node.peer.sender(WrenchStamped, "/target_wrench")

    def press(ticks, *wrench):
        for _ in range(ticks):
            targets.publish(wrench_stamped(*wrench, stamp=arm.message().header.stamp))
            arm.tick()

    def assert_fed(force, z):
        assert_close(R.T @ (pose(arm.q)[0] - p), [0.0, 0.0, z], 5e-4)
        assert float(values(node.status())["force fed forward [N]"]) == pytest.approx(force)

    press(1, 0.0, 0.0, 60.0)
    assert "the springs do not hold 60 N" in node.process.log
    press(1, 0.0, 0.0, 10.0, 1.0)
    assert "expected no moment" in node.process.log
    press(600, 0.0, 0.0, 10.0)
    assert_fed(10.0, 0.01)
    arm.ticks(700)  # the stream has ended
    assert_fed(0.0, 0.0)


def test_the_springs_that_act_are_published_while_they_change(world):
    node = Controlled(world, "compliance_control", FRAMES)
    found = node.peer.listen(JointState, "/compliance_control/impedance")
    node.graph.until(lambda: node.arm.ticks(1) or found, "~/impedance")
    assert [*found[-1].name] == [*SPRINGS]
    found.clear()
    node.arm.ticks(100)
    assert len(found) <= 1  # one a second
    node.change(K_p=[2000.0, 1000.0, 1000.0], error_clip_position=0.01)
    node.arm.ticks(1)
    now = dict(zip(found[-1].name, found[-1].position, strict=True))
    stiffness = [now[name] for name in ("K_p.xx", "K_p.xy", "K_p.yy", "K_o.zz")]
    assert stiffness == [2000.0, 0.0, 1000.0, 30.0]
    assert [now["error_clip_position"], now["error_clip_rotation"]] == [0.01, 0.2]


# --- parameters ----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"K_p": [1.0, 1.0]}, "K_p has 2 values"),
        ({"K_p": [-1.0, 1.0, 1.0]}, "K_p: K has the negative eigenvalue"),
        ({"K_o": [1.0, 2.0, 0.0, 1.0, 0.0, 1.0]}, "negative eigenvalue -1"),
        ({"K_o": [1.0, 1.0, 1.0], "K_o_axes": [1.0, 0.0]}, "K_o_axes has 2 values"),
        ({"orientation": "relative_euler_angles", "euler_sequence": "ZYZ"}, "have no impedance"),
        ({"damping_ratio_p": 0.0}, "damping_ratio_p' is 0"),
        ({"error_clip_position": 0.0}, "error_clip_position' is 0"),
        ({"M_p": [1.0, 1.0, 1.0]}, "M_p"),
    ],
)
def test_impossible_parameters_are_refused(given, words):
    with pytest.raises(ConfigurationError, match=words):
        from_mapping(ComplianceParameters, FRAMES | given).elasticity()
