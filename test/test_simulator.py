"""The simulator against Pinocchio and against what a robot's drivers promise."""

import dataclasses
import itertools
import re
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import reduced_model
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import assert_close

from eulerparams_control.errors import ConfigurationError, RobotError, SimulationError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from eulerparams_control.robot.robot import Robot
from eulerparams_control.robot.urdf import COULOMB_SPEED
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.protection import POSITION_MARGIN, Protection
from sim_bridge.simulator import Simulator, SimulatorState
from sim_bridge.urdf import SENSOR_LINK, Body, simulation_urdf

# --- tolerances ----------------------------------------------------------------------
# Inverse dynamics of (dq' - dq) / dt: rounding of dq (1e-15) over dt (1e-3) times an
# inertia of 10, and two decades for torques of 100 Nm.
TORQUE = 1e-9
# One step of q += dt dq: one rounding of numbers of order 1.
ROUNDING = 1e-14
# The same of the last step of Newton's method, 1e-15 rad/s.
IMPLICIT_TORQUE = 1e-8
# Joint speeds that the motors leave: 50 iterations of PyBullet's solver, 1e-8 seen.
MOTOR_SPEED = 1e-7
# Drift of an arm that stands, within 1 s: gravity's rounding in torque control, an
# unstable equilibrium; MOTOR_SPEED for 1 s when braked.
DRIFT = 1e-7
# A static wrench: the quaternion of the sensor link (1e-15) times 10 N, while the brakes
# leave accelerations of MOTOR_SPEED / dt = 1e-4 m/s^2 on 1 kg.
STATIC_WRENCH = 1e-3
# A weight at rest: rounding of the orientation, 1e-15, and two decades. PyBullet's float32
# frames would be wrong by 2e-6.
WEIGHT = 1e-12
# Newton and Euler at one instant against momentum over a step of 0.1 ms: the tool turns
# by 3 rad/s dt = 3e-4 of some 30 N, and jerks.
STEP_OF_MOTION = 0.05
# The torque that brakes hold against a push, from their speeds: MOTOR_SPEED / dt * 10 kg m^2.
HOLDING_TORQUE = 1e-2
# Geometric decay of a servo over 100 steps, relative: MOTOR_SPEED in 0.01 rad/s.
DECAY = 1e-4
# Overshoot of a joint stop that is hit at full speed: one step of 10 rad/s, rad.
STOP = 0.02
# A low pass summed up in closed form: rounding of differences of q (1e-16) over dt.
FILTERED = 1e-10
# Mean and standard deviation of N samples: 4.5 sigma, once in 100,000 tests.
SAMPLES = 4000
MEAN = 4.5 / np.sqrt(SAMPLES)
DEVIATION = 4.5 / np.sqrt(2 * SAMPLES)

# --- samples -------------------------------------------------------------------------
ROBOTS = ("ur5", "ur10", "panda", "kuka_iiwa")
GRAVITY = np.array([0.0, 0.0, -9.81])
TOOL_COM = (0.02, -0.03, 0.1)
TOOL_INERTIA = (0.002, 0.0001, 0.0002, 0.003, 0.0003, 0.004)
TOOL = {"tool_mass": 1.0, "tool_com": TOOL_COM, "tool_inertia": TOOL_INERTIA}

seeds = st.integers(0, 2**32 - 1)

# All that a URDF may contain and PyBullet gets wrong: a link without <inertial>, full and
# impossible tensors about a turned frame, damping, a gripper, a mimic joint.
ODD_ROBOT = """
<robot name="odd">
  <link name="base"/>
  <link name="column"><inertial><origin xyz="0.1 0 0.2" rpy="0.3 -0.7 1.1"/><mass value="3"/>
    <inertia ixx="0.05" ixy="0.01" ixz="-0.005" iyy="0.04" iyz="0.003" izz="0.03"/>
  </inertial></link>
  <link name="bare"/>
  <link name="boom"><inertial><origin xyz="0 0.05 0.3"/><mass value="2"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.09"/></inertial></link>
  <link name="wrist"><inertial><origin xyz="0 0.02 0.1" rpy="1 0 0"/><mass value="1"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.02" iyz="0.002" izz="0.01"/></inertial></link>
  <link name="tip"/>
  <link name="left"><inertial><origin xyz="0 0.1 0"/><mass value="0.4"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <link name="right"><inertial><origin xyz="0 -0.1 0"/><mass value="0.3"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="column"/>
    <origin xyz="0 0 0.5" rpy="0.2 0.1 0"/><axis xyz="0 0 1"/><dynamics damping="3"/></joint>
  <joint name="bolt" type="fixed"><parent link="column"/><child link="bare"/>
    <origin xyz="0.3 0 0.1" rpy="0 1.5707963267948966 0.4"/></joint>
  <joint name="slide" type="prismatic"><parent link="bare"/><child link="boom"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><dynamics damping="5" friction="2"/>
    <limit lower="-5" upper="5" velocity="3" effort="200"/></joint>
  <joint name="bend" type="revolute"><parent link="boom"/><child link="wrist"/>
    <origin xyz="0 0.2 0.3" rpy="0.5 0 0"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-3" upper="3" velocity="3" effort="50"/></joint>
  <joint name="flange" type="fixed"><parent link="wrist"/><child link="tip"/>
    <origin xyz="0 0 0.2" rpy="0 0.3 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="tip"/><child link="left"/>
    <origin xyz="0 0 0.05"/><axis xyz="0 1 0"/><dynamics damping="1"/>
    <limit lower="0" upper="0.04" velocity="1" effort="10"/></joint>
  <joint name="grip_too" type="prismatic"><parent link="tip"/><child link="right"/>
    <origin xyz="0 0 0.05"/><axis xyz="0 -1 0"/><mimic joint="grip"/>
    <limit lower="0" upper="0.04" velocity="1" effort="10"/></joint>
</robot>
"""

ODD = RobotDescription(
    name="odd",
    urdf_path=Path("odd.urdf"),
    urdf=ODD_ROBOT,
    base_frame="base",
    tip_frame="tip",
    sensor_frame="tip",
    joints=("turn", "slide", "bend"),
    home=(0.3, 0.1, -0.4),
)


OF_JOINTS = "rotor_inertia", "friction_viscous", "friction_coulomb"


@cache
def robot(name: str) -> RobotDescription:
    """Return a robot whose joints are those of its URDF."""
    return (
        ODD
        if name == "odd"
        else dataclasses.replace(load_robot(name), **dict.fromkeys(OF_JOINTS, ()))
    )


@cache
def _shared(name: str, **parameters: Any) -> Simulator:
    return Simulator(robot(name), SimulatorParameters(**parameters))


def simulator(name: str, **parameters: Any) -> Simulator:
    """Return a simulator at home, that several tests share."""
    sim = _shared(name, **parameters)
    sim.reset()
    return sim


class Model:
    """Pinocchio's view of a robot, other joints locked at zero, with a tool."""

    def __init__(self, description: Any, tool: Body | None = None, gravity: Any = GRAVITY) -> None:
        urdf = description.urdf
        if description is ODD:  # nq = nv
            urdf = urdf.replace("<dynamics", '<limit effort="1e9" velocity="1e9"/><dynamics', 1)
            urdf = urdf.replace('type="continuous"', 'type="revolute"')
        self.model = reduced_model(urdf, description.joints)
        self.frame = self.model.getFrameId(description.sensor_frame)
        self.placement = self.model.frames[self.frame].placement
        self.joint = self.model.frames[self.frame].parentJoint
        if tool is not None:
            inertia = pin.Inertia(tool.mass, tool.com, tool.inertia)
            self.model.appendBodyToJoint(self.joint, inertia, self.placement)
        self.model.gravity.linear = np.array(gravity)
        self.data = self.model.createData()
        self.n = self.model.nv

    def tau(self, q: Any, dq: Any, ddq: Any, wrench: Any = None) -> Any:
        """Inverse dynamics under a wrench at the sensor frame, in its axes."""
        forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
        if wrench is not None:
            forces[self.joint] = self.placement.act(pin.Force(np.array(wrench)))
        return pin.rnea(self.model, self.data, q, dq, ddq, forces)

    def gravity(self, q: Any) -> Any:
        """The efforts that hold the arm at rest."""
        return self.tau(q, 0.0 * q, 0.0 * q)

    def friction_of(self, parameters: dict[str, Any]) -> tuple[Any, Any]:
        """Viscous and Coulomb friction as it is given, or else as the URDF states it."""
        given = (parameters.get(f"friction_{kind}", ()) for kind in ("viscous", "coulomb"))
        stated = (self.model.damping, self.model.friction)
        return tuple(s if g == () else np.array(g) for g, s in zip(given, stated, strict=True))

    def friction(self, dq: Any) -> Any:
        """The effort of what the URDF states."""
        return self.model.damping * dq + self.model.friction * np.tanh(dq / COULOMB_SPEED)

    def R(self, q: Any) -> Any:
        pin.forwardKinematics(self.model, self.data, q)
        return pin.updateFramePlacement(self.model, self.data, self.frame).rotation

    def J(self, q: Any) -> Any:
        """Jacobian of the sensor frame in its own axes."""
        return pin.computeFrameJacobian(self.model, self.data, q, self.frame)

    def weight_and_inertia(self, tool: Body, q: Any, dq: Any, ddq: Any) -> Any:
        """What a tool exerts on the sensor, by Newton and Euler at one instant."""
        Y = pin.Inertia(tool.mass, tool.com, tool.inertia)
        gravity = pin.Motion(self.R(q).T @ GRAVITY, np.zeros(3))
        pin.forwardKinematics(self.model, self.data, q, dq, ddq)
        v = pin.getFrameVelocity(self.model, self.data, self.frame)
        a = pin.getFrameAcceleration(self.model, self.data, self.frame)
        return (Y * (gravity - a) - v.cross(Y * v)).vector


def random_q(name: str, rng: np.random.Generator) -> Any:
    limits = np.array([(-2.5, 2.5)] * len(robot(name).joints))
    if name != "odd":
        model = Model(robot(name)).model
        limits = np.stack([model.lowerPositionLimit + 0.05, model.upperPositionLimit - 0.05], 1)
    return rng.uniform(*np.clip(limits, -2.5, 2.5).T)


def run(sim: Simulator, steps: int) -> SimulatorState:
    for _ in range(steps):
        sim.step()
    return sim.read()


# --- dynamics ------------------------------------------------------------------------
GIVEN = [((), ()), (0.0, ()), ((), 0.0), ((1.5,), (0.2,)), ((), 0.3), ("each", "each")]
ROTORS = (0.5, 0.4, 0.3, 0.05, 0.04, 0.03)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        *((name, tool) for name in (*ROBOTS, "odd") for tool in ({}, TOOL)),
        *((name, {"rate": 500.0}) for name in ROBOTS),
        *(
            (name, {"rate": 8000.0, "friction_viscous": viscous, "friction_coulomb": coulomb})
            for name in ("kuka_iiwa", "odd")
            for viscous, coulomb in GIVEN
        ),
        *(
            ("ur5", {"disturbance_effort": effort, "friction_viscous": friction})
            for effort in (2.0, (3.0,), (0.0, 3.0, -3.0, 1.0, 1.0, -1.0))
            for friction in (0.0, 1.0)
        ),
        ("ur5", {"rotor_inertia": ROTORS}),
        ("ur5", {"gravity": (0.0, 3.0, 0.5), **TOOL}),
    ],
)
@given(seed=seeds)
@settings(deadline=None, max_examples=10)
def test_a_step_obeys_the_inverse_dynamics_of_pinocchio_with_all_that_acts(name, parameters, seed):
    """What a URDF states of friction holds where none is given; what disturbs is not reported."""
    n = len(robot(name).joints)
    each = tuple(0.05 * k for k in range(n))
    given = {key: each if value == "each" else value for key, value in parameters.items()}
    sim = simulator(name, control="torque", enforce_limits=False, **given)
    model = Model(robot(name), sim.parameters.tool, given.get("gravity", GRAVITY))
    rate, (d, c) = sim.parameters.rate, model.friction_of(given)
    added, rotors = (
        np.broadcast_to(given.get(key, 0.0), n) for key in ("disturbance_effort", "rotor_inertia")
    )
    rng, fastest = np.random.default_rng(seed), 0.0
    sim.reset(random_q(name, rng))
    for _ in range(20):
        before = sim.read()
        push = rng.uniform(-20.0, 20.0, 6)
        ddq = 0.1 * rate * rng.uniform(-1.0, 1.0, n) - 10.0 * before.dq
        tau = model.tau(before.q, before.dq, ddq, push)
        sim.command_effort(tau)
        sim.set_external_wrench(push)
        after = run(sim, 1)
        ddq_seen = (after.dq - before.dq) * rate
        moved = model.tau(before.q, before.dq, ddq_seen, push) + rotors * ddq_seen
        friction = d * before.dq + c * np.tanh(before.dq / COULOMB_SPEED)
        assert moved == pytest.approx(tau + added - friction, abs=TORQUE * max(1.0, 1e-3 * rate))
        assert after.q == pytest.approx(before.q + after.dq / rate, abs=ROUNDING)
        assert after.tau.tolist() == tau.tolist()
        fastest = max(fastest, np.abs(after.dq).max())
    assert (after.step, after.t) == (20, pytest.approx(20 / rate))
    assert fastest > 0.1  # rad/s: it did move, well above COULOMB_SPEED


def moved(arm: RobotDescription, **parameters: Any) -> Any:
    """Return where a robot is after some steps under efforts."""
    sim = Simulator(arm, SimulatorParameters(control="torque", **parameters))
    try:
        for _ in range(20):
            sim.command_effort(np.full(len(arm.joints), 5.0))
            sim.step()
        return sim.read().q
    finally:
        sim.close()


@pytest.mark.parametrize("key", OF_JOINTS)
def test_what_a_robot_states_of_its_joints_counts_before_the_urdf_and_after_the_parameters(key):
    stated, other = (0.2, 0.3, 0.4), (0.5, 0.6, 0.7)
    arm = dataclasses.replace(ODD, **{key: stated})
    assert (moved(arm) != moved(ODD)).any()
    assert moved(arm).tolist() == moved(ODD, **{key: stated}).tolist()
    for value in (other, (0.0,)):
        assert moved(arm, **{key: value}).tolist() == moved(ODD, **{key: value}).tolist()


# --- what of a URDF is not the arm, or is said in other words ------------------------------
CONTACT = '<contact><inertia_scaling value="3"/><lateral_friction value="9"/></contact>'
HEAVY = """<link name="box"><inertial><origin xyz="0.3 0 0"/><mass value="50"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def put(old: str, new: str) -> str:
    """Return the odd robot with its first ``old`` replaced."""
    assert old in ODD_ROBOT
    return ODD_ROBOT.replace(old, new, 1)


def beside(kind: str, parent: str = "base", link: str = '<link name="box"/>') -> str:
    """Return the odd robot with one more link, on a joint of its own."""
    ends = f'<parent link="{parent}"/><child link="box"/><origin xyz="0 0 1"/>'
    limit = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    return put("</robot>", f'{link}<joint name="more" type="{kind}">{ends}{limit}</joint></robot>')


SAME_ARM = {
    "an axis of length 2": put('<axis xyz="0 0 1"/>', '<axis xyz="0 0 2"/>'),
    "an axis of length 3 to slide along": put('<axis xyz="0 1 0"/>', '<axis xyz="0 3 0"/>'),
    "a short axis": put('<axis xyz="0.6 0 0.8"/>', '<axis xyz="6e-5 0 8e-5"/>'),
    "PyBullet's own words": put('<link name="wrist">', f'<link name="wrist">{CONTACT}'),
    "a name space": put("<robot", '<robot xmlns="http://www.ros.org"'),
    "limits of a joint without end": put(
        '<dynamics damping="3"/>',
        '<limit lower="0.2" upper="0.3" velocity="1e-3" effort="1e-9"/><dynamics damping="3"/>',
    ),
    "a frame that floats": beside("floating"),
    "a box that floats": beside("floating", link=HEAVY),
    "a cart": beside("planar", link=HEAVY),
    "a second arm": beside("revolute", link=HEAVY),
    "a joint of an unknown type": beside("screw"),
    "a massless branch that moves": beside("revolute", "tip"),
    "a frame without inertia": beside("fixed", "tip", HEAVY.replace('"50"', '"0"')).replace(
        '"1" iyy="1" izz="1"', '"0" iyy="0" izz="0"'
    ),
    "a joint with the name of its link": put('joint name="flange"', 'joint name="tip"'),
    "a joint with the name of another": put('joint name="grip"', 'joint name="universe"'),
    "names with signs": ODD_ROBOT.replace('"boom"', "'b&quot;&lt;o\u00f6&amp;m %s'"),
}


@pytest.mark.parametrize("case", SAME_ARM)
def test_what_is_not_the_arm_or_said_in_other_words_changes_no_acceleration(case):
    """The model is Pinocchio's of the plain URDF."""
    model, rng = Model(ODD), np.random.default_rng(5)
    description = dataclasses.replace(ODD, urdf=SAME_ARM[case])
    assert description.urdf != ODD.urdf
    free = {"friction_viscous": 0.0, "friction_coulomb": 0.0, "enforce_limits": False}
    sim = Simulator(description, SimulatorParameters(control="torque", **free))
    own = Robot(description.urdf, "base", "tip")
    try:
        for _ in range(5):
            sim.reset(np.array(ODD.home) + rng.uniform(-0.2, 0.2, 3))
            for _ in range(3):
                before, tau = sim.read(), rng.uniform(-20.0, 20.0, 3)
                sim.command_effort(tau)
                after = run(sim, 1)
                ddq = (after.dq - before.dq) * sim.parameters.rate
                assert model.tau(before.q, before.dq, ddq) == pytest.approx(tau, abs=TORQUE)
                state = own.dynamic_state(before.q, before.dq)
                assert_close(
                    state.B @ ddq + state.C_dq + state.g, model.tau(before.q, before.dq, ddq)
                )
    finally:
        sim.close()


# --- brakes --------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "control"), [*((name, "torque") for name in ROBOTS), ("ur5", "position")]
)
def test_a_robot_stands_braked_until_its_first_command(name, control):
    sim = simulator(name, control=control, **TOOL)
    model = Model(robot(name), sim.parameters.tool)
    held = model.gravity(np.array(robot(name).home))
    assert sim.read().tau == pytest.approx(held, abs=HOLDING_TORQUE)  # at once
    state = run(sim, 1000)
    assert state.q == pytest.approx(np.array(robot(name).home), abs=DRIFT)
    assert state.tau == pytest.approx(held, abs=HOLDING_TORQUE)


def test_brakes_and_servo_have_no_more_than_the_effort_limit():
    sim = simulator("ur5", control="position")
    sim.set_external_wrench([0.0, 0.0, 0.0, 0.0, 0.0, 32.0])  # the wrist has 28 Nm
    state = run(sim, 10)
    assert abs(state.tau[5]) == pytest.approx(28.0)
    assert np.abs(state.dq[5]) > 1.0
    sim.reset()
    sim.command_position(np.array(robot("ur5").home) + 1.0, np.zeros(6))
    assert run(sim, 1).tau == pytest.approx([150.0] * 3 + [28.0] * 3)


# --- force/torque sensor -------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "gravity"), [*((name, GRAVITY) for name in ROBOTS), ("ur5", (0.0, 3.0, 0.0))]
)
@given(seed=seeds)
@settings(deadline=None, max_examples=5)
def test_a_hanging_tool_is_read_as_its_weight_at_its_centre_of_mass(name, gravity, seed):
    sim, model = simulator(name, gravity=tuple(gravity), **TOOL), Model(robot(name))
    sim.reset(random_q(name, np.random.default_rng(seed)))
    for state, tolerance in ((sim.read(), WEIGHT), (run(sim, 50), STATIC_WRENCH)):
        force = model.R(state.q).T @ gravity
        assert state.wrench[:3] == pytest.approx(force, abs=tolerance)
        assert state.wrench[3:] == pytest.approx(np.cross(TOOL_COM, force), abs=tolerance)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_moving_tool_is_read_with_its_inertia(name):
    sim = simulator(name, rate=10000.0, enforce_limits=False, **TOOL)
    model, home = Model(robot(name)), np.array(robot(name).home)
    phase = np.arange(model.n)
    for k in range(2000):
        w = 8.0 * (k / 10000.0) + phase
        sim.command_position(home + 0.2 * (np.sin(w) - np.sin(phase)), 1.6 * np.cos(w))
        before = sim.read()
        sim.step()
        after = sim.read()
        if k > 1000 and k % 50 == 0:
            ddq = (after.dq - before.dq) * 10000.0
            seen = model.weight_and_inertia(sim.parameters.tool, after.q, after.dq, ddq)
            assert after.wrench == pytest.approx(seen, abs=STEP_OF_MOTION)
    still = model.weight_and_inertia(sim.parameters.tool, after.q, 0 * ddq, 0 * ddq)
    assert np.abs(after.wrench - still).max() > 20 * STEP_OF_MOTION  # the motion matters


@pytest.mark.parametrize(("frame", "height"), [("panda_link8", 0.0), ("panda_link7", 0.107)])
def test_the_sensor_carries_all_that_is_distal_to_it(frame, height):
    flange = dataclasses.replace(robot("panda"), sensor_frame=frame)  # fixed, or on a joint
    sim = Simulator(flange, SimulatorParameters(tool_mass=0.5, tool_com=(0.0, 0.0, 0.2)))
    force = Model(flange).R(np.array(flange.home)).T @ GRAVITY * (0.73 + 2 * 0.015 + 0.5)
    assert sim.read().wrench[:3] == pytest.approx(force, abs=STATIC_WRENCH)
    hand = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, -np.pi / 4), np.array([0.0, 0.0, height]))
    com = 0.73 * (hand * np.array([-0.01, 0.0, 0.03])) + 0.03 * (hand * np.array([0, 0, 0.0584]))
    com = (com + 0.5 * np.array([0.0, 0.0, 0.2])) / 1.26
    assert sim.read().wrench[3:] == pytest.approx(np.cross(com, force), abs=STATIC_WRENCH)
    sim.close()


# --- servo ---------------------------------------------------------------------------
@pytest.mark.parametrize("bandwidth", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("name", ROBOTS)
def test_an_error_of_the_servo_decays_with_its_bandwidth(name, bandwidth):
    sim = simulator(name, servo_bandwidth=bandwidth, enforce_limits=False)
    home = np.array(robot(name).home)
    sim.command_position(home + 0.1, np.zeros_like(home))
    for k in (1, 4, 5, 20, 70):
        steps = k + sim.read().step
        state = run(sim, k)
        decay = (1.0 - bandwidth * 1e-3) ** steps
        assert home + 0.1 - state.q == pytest.approx(0.1 * decay, abs=DECAY * 0.1)


# --- limits --------------------------------------------------------------------------
def test_efforts_speeds_and_positions_are_clipped_to_the_limits_of_the_urdf():
    sim, efforts, states = simulator("ur5", control="torque"), np.repeat([150.0, 28.0], 3), []
    for tau in (efforts, 2.0 * efforts):
        sim.reset()
        sim.command_effort(tau)
        states.append(run(sim, 5))
    assert states[1].tau.tolist() == efforts.tolist()
    assert states[1].q.tolist() == states[0].q.tolist()
    sim.command_effort(-2.0 * efforts)
    assert run(sim, 1).tau.tolist() == (-efforts).tolist()
    servo = simulator("ur5")
    for k in range(250):
        servo.command_position(servo.read().q, np.full(6, 0.02 * k))
        servo.step()
    assert servo.read().dq == pytest.approx([3.15] * 3 + [3.2] * 3, abs=MOTOR_SPEED)
    servo.reset([0.0, -1.0, 3.1, 0.0, 0.0, 0.0])
    servo.command_position([0.0, -1.0, 9.0, 0.0, 0.0, 0.0], np.zeros(6))
    state = run(servo, 500)
    assert state.q[2] == pytest.approx(3.14159265359, abs=DRIFT)
    # the motor does not press against the stop
    assert state.tau == pytest.approx(Model(robot("ur5")).gravity(state.q), abs=HOLDING_TORQUE)


def test_a_joint_stops_at_its_limit_in_torque_control():
    sim = simulator("ur5", control="torque")
    sim.reset([0.0, -1.0, 3.1, 0.0, 0.0, 0.0])
    sim.command_effort([0.0, 0.0, 60.0, 0.0, 0.0, 0.0])
    highest = max(run(sim, 1).q[2] for _ in range(300))
    assert np.pi < highest + STOP < np.pi + 2 * STOP


# --- friction ------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "parameters"),  # that of the speed before would be unstable: viscous, Coulomb or both
    [
        ("kuka_iiwa", {"rate": 200.0}),
        ("ur10", {"friction_coulomb": 1.0}),
        ("odd", {"rate": 100.0, "friction_viscous": 5.0, "friction_coulomb": (0.5, 1.0, 0.4)}),
    ],
)
def test_friction_on_links_too_light_for_the_step_is_that_of_the_speed_after_it(name, parameters):
    sim = simulator(name, control="torque", enforce_limits=False, **parameters)
    model, rate = Model(robot(name)), sim.parameters.rate
    d, c = model.friction_of(parameters)
    push = np.array([3.0, -2.0, 1.0, 0.3, 0.2, -0.1])
    sim.set_external_wrench(push)
    for k in range(200):
        before = sim.read()
        gravity = model.gravity(before.q)
        sim.command_effort(gravity + 3.0 * np.sin(0.05 * k + np.arange(model.n)))
        after = run(sim, 1)
        friction = d * after.dq + c * np.tanh(after.dq / COULOMB_SPEED)
        moved = model.tau(before.q, before.dq, (after.dq - before.dq) * rate, push)
        assert moved == pytest.approx(after.tau - friction, abs=IMPLICIT_TORQUE)
        assert after.q == pytest.approx(before.q + after.dq / rate, abs=ROUNDING)
    assert np.abs(after.dq).max() > COULOMB_SPEED


def test_the_order_of_the_joints_is_that_of_the_robot():
    order, states = [2, 0, 1], []
    home = tuple(np.array(ODD.home)[order])
    turned = dataclasses.replace(ODD, joints=("bend", "turn", "slide"), home=home)
    for arm, coulomb, effort in (
        (turned, (2.0, 3.0, 9.0), [4.0, 2.0, 30.0]),
        (ODD, (3.0, 9.0, 2.0), [2.0, 30.0, 4.0]),
    ):
        options = {"control": "torque", "rate": 100.0, "friction_coulomb": coulomb}
        sim = Simulator(arm, SimulatorParameters(**options))
        sim.command_effort(effort)
        states.append(run(sim, 20))
        sim.close()
    assert states[0].q == pytest.approx(states[1].q[order], abs=ROUNDING)
    assert np.abs(states[0].dq).min() > COULOMB_SPEED


def test_the_servo_overcomes_friction_and_its_effort_shows_it():
    still = {"gravity": (0.0, 0.0, 0.0), "friction_viscous": 2.0, "friction_coulomb": 1.0}
    sim, model = simulator("ur5", **still), Model(robot("ur5"), gravity=np.zeros(3))
    speed = np.array([0.3, -0.2, 0.1, 0.3, -0.2, 0.1])
    for _ in range(100):
        before = sim.read()
        sim.command_position(before.q, speed)
        after = run(sim, 1)
    assert after.dq == pytest.approx(speed, abs=MOTOR_SPEED)
    friction = 2.0 * before.dq + np.tanh(before.dq / COULOMB_SPEED)
    moved = model.tau(before.q, before.dq, (after.dq - before.dq) * 1e3)
    assert after.tau == pytest.approx(moved + friction, abs=HOLDING_TORQUE)


# --- limits: what is clipped, and the protective stop --------------------------------
def limits(joints: int, **changed: Any) -> JointLimits:
    one = np.ones(joints)
    values = {"lower": -one, "upper": one, "velocity": one, "effort": one} | changed
    return JointLimits(**values)


def test_the_worst_of_what_is_clipped_is_told_and_nothing_else():
    sim = simulator("ur5", control="torque")
    for effort, clipped in (
        ([150.0, -150.0, 0.0, 28.0, -28.0, -0.0], None),
        ([160.0, 0.0, -200.0, 0.0, 30.0, 0.0], ("elbow_joint", "effort", -200.0, -150.0, "Nm")),
        ([0.0] * 6, None),
    ):
        sim.command_effort(effort)
        assert sim.clipped == clipped
        words = "joint 'elbow_joint' was asked for the effort -200 Nm; its limit is -150 Nm"
        assert clipped is None or str(sim.clipped) == words
    servo = simulator("odd")
    for q, dq, clipped in (
        ([1e6, 4.9, 2.9], [1e6, 2.9, 2.9], None),  # the turning joint has no limits
        ([0.0, 5.5, 0.0], [0.0, 0.0, 9.0], ("slide", "position", 5.5, 5.0, "m")),
        ([0.0, 0.0, 0.0], [0.0, 4.0, 0.0], ("slide", "speed", 4.0, 3.0, "m/s")),
    ):
        servo.command_position(q, dq)
        assert servo.clipped == clipped
    servo.brake()
    assert servo.clipped is None


def test_a_joint_beyond_its_limits_by_more_than_the_margin_or_where_it_stood_is_a_violation():
    each = {"velocity": np.array([1.0, 2.0]), "lower": np.array([-3.0, -1.0])}
    protection, rest, near = Protection(("a", "b"), limits(2, **each), 1.5), [0.0, 0.0], 9e-5
    assert near < POSITION_MARGIN
    protection.let_stand(rest)
    assert protection.violation([1.0 + near, -1.0 - near], [-1.5, 3.0]) == ""
    assert protection.violation(rest, [0.0, -3.01]).startswith("joint 'b' moves at -3.01 rad/s")
    assert protection.violation(rest, [1.51, 0.0]).startswith("joint 'a' moves at 1.51 rad/s")
    alone, beyond = Protection(("a",), limits(1), 1.5), "0.21 beyond its limit 1"
    alone.let_stand([1.2])  # it may stay and turn back but go no further
    assert alone.violation([1.2], [0.5]) == ""
    assert alone.violation([1.21], [0.5]) == f"joint 'a' is at 1.21 rad, {beyond}"
    alone.let_stand([0.9])
    assert alone.violation([1.2], [0.0]) != ""
    for q, words in ((1.01, "joint 'b' is at 1.01 rad, 0.01 beyond its limit 1"),
                     (-1.2, "joint 'b' is at -1.2 rad, 0.2 beyond its limit -1")):  # fmt: skip
        assert protection.violation([0.0, q], rest) == words


@pytest.mark.parametrize("strength", [1e3, 1e5])
@pytest.mark.parametrize(
    ("control", "enforced"),
    [("position", True), ("braked", True), ("torque", True), ("torque", False)],
)
@pytest.mark.parametrize("name", ROBOTS)
def test_a_push_that_no_brakes_could_stop_is_let_go_and_the_arm_locked_where_it_was(
    name, control, strength, enforced
):
    options = {"control": control} if control != "braked" else {}
    sim = simulator(name, rate=200.0, enforce_limits=enforced, **options)
    arm = robot(name)
    home, n = np.array(arm.home), len(arm.joints)
    bound = 40 * Robot(arm.urdf, arm.base_frame, arm.tip_frame).limits.velocity
    if control == "position":
        sim.command_position(home, np.zeros(n))
    elif control == "torque":
        sim.command_effort(sim.read().tau)
    sim.set_external_wrench([0.0, 0.0, 0.0, *[strength] * 3])
    fastest = 0.0
    for _ in range(40):
        before = sim.read().q
        sim.step()
        fastest = max(fastest, float((np.abs(sim.read().dq) / bound).max()))
        if "locked" in sim.violation or fastest > 1:
            break
    assert (fastest <= 1) == enforced
    if not enforced:
        assert sim.violation == ""
        return
    assert sim.violation.startswith("joint '")
    assert sim.violation.endswith("could stop: locked where it was, and the push released")
    np.testing.assert_array_equal(sim.read().q, before)
    np.testing.assert_array_equal(sim.read().dq, 0.0)
    assert not sim.is_pushed
    sim.brake()
    state = run(sim, 20)
    assert sim.is_standing
    assert np.abs(state.wrench).max() < 1.0  # nothing is felt any more


def test_a_speed_limit_of_0_locks_no_other_joint():
    arm = robot("ur5")
    stated = r'(<joint name="wrist_3_joint".*?velocity=)"[^"]*"'
    limited = re.sub(stated, r'\1"0"', arm.urdf, flags=re.DOTALL)
    assert limited != arm.urdf
    sim = Simulator(dataclasses.replace(arm, urdf=limited), SimulatorParameters())
    goal = np.array(arm.home) + [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
    sim.command_position(goal, np.zeros(6))
    for _ in range(400):
        sim.step()
        assert sim.violation == ""
    assert_close(sim.read().q, goal, 1e-3)
    sim.close()


def test_an_arm_that_no_brakes_could_stop_is_locked_where_it_was():
    sim = simulator("ur10", control="torque", rate=100.0)
    before = sim.read().q
    sim.command_effort([0.0] * 5 + [56.0])  # on a link of 2e-4 kg m^2
    sim.step()
    assert re.match(r"joint 'wrist_3_joint' .*could stop: locked where it was$", sim.violation)
    np.testing.assert_array_equal([sim.read().q, sim.read().dq], [before, 0.0 * before])
    sim.brake()
    assert_close(run(sim, 10).q, before, 1e-5)


# --- refusals ------------------------------------------------------------------------
BAD = {
    "a sum that is not finite": [1.7e308, 1.7e308, float("nan"), 0.0, 0.0, 0.0],
    "nan": [0.0, 0.0, 0.0, 0.0, 0.0, float("nan")],
    "infinite": [0.0, 0.0, 0.0, 0.0, 0.0, float("inf")],
    "opposite infinities": [float("-inf"), float("inf"), 0.0, 0.0, 0.0, 0.0],
    "short": [0.0] * 5,
    "long": [0.0] * 7,
    "matrix": [[0.0] * 6],
}


def refuse(sim: Simulator, bad: list[float]) -> None:
    zero = np.zeros(6)
    calls = [
        lambda: sim.set_external_wrench(bad),
        lambda: sim.command_effort(bad),
        lambda: sim.command_position(bad, zero),
        lambda: sim.command_position(zero, bad),
        lambda: sim.reset(bad),
    ]
    for call in calls:
        with pytest.raises(SimulationError, match=r"6 finite numbers|command, but control is"):
            call()


@pytest.mark.parametrize("control", ["position", "torque"])
@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
def test_a_bad_command_is_refused_and_changes_nothing(bad, control):
    sim = simulator("ur5", control=control)
    trajectories = []
    for refusing in (False, True):
        sim.reset()
        states = []
        for k in range(30):
            if refusing:
                refuse(sim, bad)
            if k == 10 and control == "torque":
                sim.command_effort(np.full(6, 3.0))
            if k == 10 and control == "position":
                sim.command_position(np.array(robot("ur5").home) + 0.2, np.full(6, 0.1))
            if k == 15:
                sim.set_external_wrench(np.arange(6.0))
            states.append(np.concatenate(run(sim, 1)[2:]))
        trajectories.append(np.array(states))
    assert np.array_equal(trajectories[0], trajectories[1])


@pytest.mark.parametrize("field", ["q", "dq", "motors", "reaction"])
@pytest.mark.parametrize("bad", [[np.nan, 0.0], [np.inf, 0.0], [0.0, -np.inf], [np.inf, -np.inf]])
def test_whatever_is_not_finite_after_a_step_is_refused(monkeypatch, field, bad):
    sim = simulator("ur5")
    sample = sim.engine.sample()
    broken = sample._replace(**{field: (*getattr(sample, field)[:4], *bad)})
    monkeypatch.setattr(sim.engine, "sample", lambda: broken)
    with pytest.raises(SimulationError, match="not finite after step 1"):
        sim.step()
    tool = simulator("ur5", **TOOL)
    motion = tool.engine.sensor_motion()._replace(v=np.full(3, np.nan))
    monkeypatch.setattr(tool.engine, "sensor_motion", lambda: motion)
    with pytest.raises(SimulationError, match=r"after step 1: .* sensor \[nan"):
        tool.step()
    assert np.isfinite(tool.read().wrench).all()


RUB = {"friction_coulomb": 1.0}  # implicit for this robot


@pytest.mark.parametrize("tool", [{}, TOOL, RUB], ids=["bare", "tool", "friction"])
@pytest.mark.parametrize("strength", [1e9, 1e30, 1e300])
@pytest.mark.parametrize("cause", ["effort", "push", "both"])
@pytest.mark.filterwarnings("error")
def test_a_robot_torn_apart_says_so_and_never_reports_what_is_not_finite(cause, strength, tool):
    sim = simulator("kuka_iiwa", control="torque", enforce_limits=False, **tool)
    fresh = run(sim, 3)
    sim.command_effort(np.full(7, strength if cause != "push" else 0.0))
    if cause != "effort":
        sim.set_external_wrench(np.full(6, -strength))
    words = r"not finite after step \d+: q \[.*dq \[.*effort \[.*sensor \["
    steps = itertools.count(fresh.step + 1)
    with pytest.raises(SimulationError, match=words) as error:
        for step in steps:
            sim.step()
            state = sim.read()
            assert np.isfinite([*state.q, *state.dq, *state.tau, *state.wrench]).all()
            assert state.step == step < 1000
    assert f"after step {sim.read().step + 1}:" in str(error.value)
    last = sim.read()
    assert np.isfinite([*last.q, *last.dq, *last.tau, *last.wrench]).all()
    sim.reset()
    again = run(sim, 3)
    assert again.q.tolist() == fresh.q.tolist()
    assert again.wrench.tolist() == fresh.wrench.tolist()


SPRING = {"shape": "spring", "position": [0.5, 0, 0.2], "stiffness": 1.0}
BOX = {"shape": "box", "position": [0.5, 0, 0.2], "size": [1, 1, 0.1]}


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"control": "velocity"}, "control must be one of ('position', 'torque')"),
        ({"rate": 0.0}, "rate must be positive"),
        ({"servo_bandwidth": -1.0}, "servo_bandwidth must be positive"),
        ({"servo_bandwidth": 1001.0}, "must not exceed the rate 1000.0 Hz"),
        ({"gravity": (0.0, -9.81)}, "gravity must be 3 numbers"),
        ({"wrench_bias": (0.0,) * 5 + (float("nan"),)}, "wrench_bias must be finite"),
        ({"tool_mass": -1.0}, "tool_mass must be 0 or more"),
        ({"tool_inertia": TOOL_INERTIA}, "tool_inertia is given without tool_mass"),
        ({"tool_mass": 1.0, "tool_inertia": (1, 5, 0, 1, 0, 1)}, "negative principal moment"),
        ({"friction_coulomb": (0.0, -1.0)}, "friction_coulomb must be 0 or more"),
        ({"noise_force": -1.0}, "noise_force must be 0 or more"),
        ({"encoder_resolution": -1}, "encoder_resolution must be 0 or more"),
        ({"velocity_cutoff": -1.0}, "velocity_cutoff must be 0 or more"),
        ({"velocity_cutoff": 500.0}, "velocity_cutoff 500.0 Hz must be below half the rate 1000.0"),
        (
            {"velocity_cutoff": 50.0, "noise_velocity": 0.1},
            "noise_velocity 0.1 rad/s is given with velocity_cutoff 50.0 Hz",
        ),
        ({"disturbance_effort": np.nan}, "disturbance_effort must be finite, got nan"),
        ({"tool_shape": "spere"}, "unknown value of tool_shape: 'spere' (did you mean 'sphere'?)"),
        ({"tool_shape": "box"}, "tool_size is []; expected x, y, z of a box, above 0 [m]"),
        ({"tool_shape": "sphere", "tool_size": (0.1, 0.1)}, "expected radius of a sphere"),
        ({"tool_shape": "sphere", "tool_size": np.nan}, "tool_size is [nan]; expected radius"),
        ({"tool_size": (0.1,)}, "tool_size is given without tool_shape"),
        ({"tool_position": (0.1,)}, "tool_position must be 3 numbers"),
        ({"tool_orientation": (1, 1, 0, 0)}, "tool_orientation is [1.0, 1.0, 0.0, 0.0], of norm"),
        (
            {"environment": {"spring": SPRING, "table": BOX}},
            "environment.table is solid, but nothing of the robot can touch it; set tool_shape",
        ),
    ],
)
def test_an_impossible_parameter_is_refused_with_the_bound(values, reason):
    with pytest.raises(ConfigurationError, match=re.escape(reason)):
        SimulatorParameters(**values)


@pytest.mark.parametrize(
    ("arm", "parameters", "error", "words"),  # what is no URDF at all: ``test_fuzz_urdf.py``
    [
        (
            dataclasses.replace(ODD, urdf=ODD_ROBOT.replace('"continuous"', '"planar"')),
            {}, RobotError, "joint 'turn'",
        ),
        (
            dataclasses.replace(robot("ur5"), sensor_frame="forearm_link"),
            {}, RobotError, "the sensor at 'forearm_link' is not moved by",
        ),
        (robot("ur5"), {"gui": True}, SimulationError, "no display for PyBullet's window"),
        *(
            (robot("ur5"), {name: (1.0, 1.0)}, ConfigurationError, f"{name} must be empty, one num")
            for name in ("friction_viscous", "disturbance_effort", "rotor_inertia")
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_simulated_is_refused_and_why(monkeypatch, arm, parameters, error, words):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(error, match=words):
        Simulator(arm, SimulatorParameters(**parameters))


# --- noise and bias ------------------------------------------------------------------
def test_noise_has_its_deviation_and_bias_its_value():
    bias = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
    parameters = {
        "noise_position": 1e-4,
        "noise_velocity": 1e-2,
        "noise_force": 0.5,
        "noise_torque": 0.05,
        "wrench_bias": tuple(bias),
    }
    sim = simulator("ur5", **parameters)
    states = [run(sim, 1) for _ in range(SAMPLES)]
    home = np.array(robot("ur5").home)
    for values, mean, sigma in [
        ([s.q for s in states], home, np.full(6, 1e-4)),
        ([s.dq for s in states], np.zeros(6), np.full(6, 1e-2)),
        ([s.wrench for s in states], bias, np.repeat([0.5, 0.05], 3)),
    ]:
        assert np.all(np.abs(np.mean(values, axis=0) - mean) < MEAN * sigma)
        assert np.std(values, axis=0) == pytest.approx(sigma, rel=DEVIATION)
    noise = np.array([[*s.q, *s.dq, *s.wrench] for s in states])
    correlation = np.corrcoef(noise.T) - np.eye(18)
    assert np.abs(correlation).max() < 1.2 * MEAN  # 153 pairs


# --- encoders ------------------------------------------------------------------------
def moving(**parameters: Any) -> list[SimulatorState]:
    """Return the states of an arm that follows a reference."""
    sim = Simulator(robot("ur5"), SimulatorParameters(**parameters))
    states = [sim.read()]
    for k in range(200):
        q_ref = np.array(robot("ur5").home) + 0.1 * np.sin(0.02 * k + np.arange(6.0))
        sim.command_position(q_ref, np.zeros(6))
        states.append(run(sim, 1))
    sim.close()
    return states


def array(states: list[SimulatorState], name: str) -> Any:
    return np.array([getattr(state, name) for state in states])


@pytest.mark.parametrize("resolution", [1000, 4096, 2**20])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_an_encoder_counts_the_noisy_position_to_the_nearest(noise, resolution):
    exact = moving(noise_position=noise, seed=3)
    counted = moving(noise_position=noise, seed=3, encoder_resolution=resolution)
    grid = 2.0 * np.pi / resolution
    q, counts = array(exact, "q"), array(counted, "q") / grid
    assert counts == pytest.approx(np.round(counts), abs=1e-6)
    error = np.abs(array(counted, "q") - q)
    assert 0.45 * grid < error.max() < 0.5 * grid * (1.0 + 1e-6)
    assert array(counted, "dq").tolist() == array(exact, "dq").tolist()
    assert array(counted, "wrench").tolist() == array(exact, "wrench").tolist()


@pytest.mark.parametrize("cutoff", [5.0, 60.0, 499.0])
@pytest.mark.parametrize("drives", [{}, {"noise_position": 1e-3, "encoder_resolution": 4096}])
def test_the_velocity_is_the_filtered_difference_quotient_of_the_measured_position(drives, cutoff):
    states = moving(velocity_cutoff=cutoff, **drives)
    rates = np.diff(array(states, "q"), axis=0) * 1e3
    decay = np.exp(-2.0 * np.pi * cutoff * 1e-3)
    response = (1.0 - decay) * decay ** np.arange(len(rates))
    filtered = [np.convolve(rate, response)[: len(rates)] for rate in rates.T]
    start, *dq = array(states, "dq")
    assert start.tolist() == [0.0] * 6
    assert np.transpose(dq) == pytest.approx(np.array(filtered), abs=FILTERED)
    assert np.abs(filtered).max() > 0.1


ENCODERS = {"encoder_resolution": 4096, "velocity_cutoff": 50.0}


@pytest.mark.parametrize(
    ("noise", "names"),
    [
        ({"noise_position": 1e-3, "noise_force": 1.0, "noise_torque": 0.1}, ("q", "wrench")),
        (ENCODERS | {"noise_position": 1e-3}, ("q", "dq")),
    ],
)
def test_noise_follows_its_seed_and_leaves_the_motion_alone(noise, names):
    one, again, other = (moving(seed=seed, **noise) for seed in (1, 1, 2))
    exact = moving()
    for name in names:
        assert np.array_equal(array(one, name), array(again, name))
        assert not np.array_equal(array(one, name), array(other, name))
        assert np.all(array(one, name)[1:] != array(exact, name)[1:])
    assert np.array_equal(array(one, "tau"), array(exact, "tau"))


# --- the seam ------------------------------------------------------------------------
def test_a_command_is_copied():
    sim = simulator("ur5", control="torque")
    tau = np.full(6, 1.0)
    sim.command_effort(tau)
    tau[:] = 1000.0
    assert run(sim, 1).tau.tolist() == [1.0] * 6
    servo, speed = simulator("ur5"), np.full(6, 0.01)
    servo.command_position(servo.read().q, speed)
    speed[:] = 1.0
    assert run(servo, 1).dq == pytest.approx(np.full(6, 0.01), abs=MOTOR_SPEED)


# --- loading -------------------------------------------------------------------------
def test_no_file_is_left_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    sim = Simulator(robot("ur5"), SimulatorParameters())
    for _ in range(2):  # twice is no error
        sim.close()
    broken = dataclasses.replace(ODD, urdf=ODD_ROBOT.replace('"3"', '"x"'))
    with pytest.raises(RobotError):
        Simulator(broken, SimulatorParameters())
    assert list(tmp_path.iterdir()) == []


def test_only_links_that_matter_are_simulated_and_begin_within_their_limits():
    text = simulation_urdf(robot("ur5"), SimulatorParameters().tool, stops=True, shapes=[]).text
    arm = ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]
    links = ["base_link", *(f"{name}_link" for name in arm), "world", SENSOR_LINK]
    assert re.findall('<link name="([^"]*)"', text) == links
    fingers = ("panda_finger_joint1", "panda_finger_joint2")  # locked, and after the arm's
    assert simulator("panda").joint_names == (*robot("panda").joints, *fingers)
    with pytest.raises(SimulationError, match=r"'elbow_joint', 4\.0, is outside -3\.14.* 3\.14"):
        simulator("ur5").reset([0.0, 0.0, 4.0, 0.0, 0.0, 0.0])
    simulator("ur5", enforce_limits=False).reset([0.0, 0.0, 4.0, 0.0, 0.0, 0.0])


def test_a_mesh_that_is_missing_matters_only_where_it_is_needed():
    mesh = '<geometry><mesh filename="package://no/such.stl"/></geometry>'
    broken = {
        (shape, link): dataclasses.replace(
            ODD, urdf=beside("fixed").replace(link, f"{link[:-2]}><{shape}>{mesh}</{shape}></link>")
        )
        for shape in ("collision", "visual")
        for link in ('<link name="tip"/>', '<link name="base"/>', '<link name="box"/>')
    }
    for (shape, link), arm in broken.items():
        Simulator(arm, SimulatorParameters()).close()
        if (shape, link) != ("collision", '<link name="tip"/>'):
            Simulator(arm, SimulatorParameters(collide_links=True)).close()
            text = simulation_urdf(
                arm, SimulatorParameters().tool, stops=True, shapes=["visual", "collision"]
            ).text
            assert "mesh" not in text
    with pytest.raises(
        RobotError, match=r"^link 'tip': mesh 'package://no/such\.stl' was not found"
    ):
        Simulator(
            broken["collision", '<link name="tip"/>'], SimulatorParameters(collide_links=True)
        )


@pytest.mark.parametrize("name", ["panda", "tiago"])
def test_no_line_of_what_pybullet_reads_is_so_long_that_it_breaks_it(name):
    """It reads 8191 characters of a line, and the rest as another one, within a number or not."""
    shapes, no_tool = ["collision", "visual"], SimulatorParameters().tool
    text = simulation_urdf(robot(name), no_tool, stops=True, shapes=shapes).text
    assert len(text) > 8191
    assert max(map(len, text.splitlines())) < 4096
