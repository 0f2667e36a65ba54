"""Each robot of the catalogue: its home, what its URDF states, and how it tracks its own motion."""

import math

import numpy as np
import pytest
from arms import robot_named
from samples import generator
from simulated import Simulated, frames_of
from tolerances import ROBOTS_DEG, ROBOTS_MM

from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.laws.inverse import DampedInverse, sigma_min
from eulerparams_control.laws.inverse_dynamics import joint_efforts
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.parameters.dynamic_control import DynamicParameters
from eulerparams_control.parameters.reference import ReferenceParameters
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.simulator import Simulator, SimulatorParameters

# The smallest singular value of J at home is so many times that at which damping sets in: room
# for an experiment, as are the distance to the position limits [rad] and the part of the efforts
# that the weight takes.
CONDITION, ROOM, WEIGHT = 3.0, 0.5, 0.6
# The least joint inertia [kg m^2] that is one, and not the rounding of none.
INERTIA = 1e-6
# [rad/s] of a joint, by rounding and by the order of the integration.
ONE_TICK = 1e-3

MOTIONS = load_experiment("robots").variants
each_robot = pytest.mark.parametrize("name", config_names("robots"))


@each_robot
def test_a_urdf_states_inertia_and_limits_and_home_is_away_from_these_and_singularities(name):
    robot, home = robot_named(name)
    state, limits = robot.dynamic_state(home, np.zeros(robot.n)), robot.limits
    assert robot.n in (6, 7)
    assert np.linalg.eigvalsh(state.B)[0] > INERTIA
    for limit in (limits.effort, limits.velocity):
        assert np.all((limit > 0) & np.isfinite(limit))
    assert sigma_min(state.arm.J, robot.length) > CONDITION * DampedInverse().eps
    assert np.all(home - limits.lower > ROOM)
    assert np.all(limits.upper - home > ROOM)
    assert np.all(np.abs(state.g) < WEIGHT * limits.effort)


@each_robot
def test_a_controller_that_knows_the_rotors_gives_the_joints_the_accelerations_it_asks_for(name):
    (_, home), about = robot_named(name), load_robot(name)
    random, ideal = generator(36), {"friction_viscous": 0.0, "friction_coulomb": 0.0}
    parameters = DynamicParameters(**frames_of(name), rotor_inertia=about.rotor_inertia)
    robot = parameters.robot(about.urdf)
    sim = Simulator(about, SimulatorParameters(control="torque", enforce_limits=False, **ideal))
    try:
        for _ in range(5):
            sim.reset(home)
            ddq = random.uniform(-5.0, 5.0, robot.n)
            for _ in range(20):
                q, dq = sim.motion
                sim.command_effort(joint_efforts(robot.dynamic_state(q, dq), ddq))
                sim.step()
            np.testing.assert_allclose(sim.motion[1], 0.02 * ddq, atol=ONE_TICK)
    finally:
        sim.close()


@each_robot
def test_dynamic_control_tracks_the_motion_of_a_robot_within_its_limits(name):
    (robot, home), given = robot_named(name), MOTIONS[name].nodes
    rotors = load_robot(name).rotor_inertia
    parameters = DynamicParameters(
        **frames_of(name), **given["dynamic_control"], rotor_inertia=rotors
    )
    motion = ReferenceParameters(**given["reference"]).way_points()
    q_0 = inverse_kinematics(robot, motion.frames[0], home)
    arm = Simulated(name, parameters, q_0, **given.get("pybullet_bridge", {}))
    assert arm.robot.joints == robot.joints
    arm.controller.follow(motion, 0)
    for _ in range(4000):  # until it is there
        arm.step(arm.simulator.read())
        tick = arm.controller.guidance.tick_now
        assert math.degrees(angle_between(tick.desired.R_d, tick.state.R_e)) < ROBOTS_DEG
        assert 1e3 * np.linalg.norm(tick.dp_de) < ROBOTS_MM
        assert np.all(np.abs(tick.state.dq) < robot.limits.velocity)
        assert not tick.saturated
    assert not arm.controller.fault
    assert np.linalg.norm(tick.state.p_e - motion.frames[-1].p_d) < 1e-3 * ROBOTS_MM
