"""Loads that nobody declared, joints that rub, and a model that is not that of the arm."""

from dataclasses import replace

import numpy as np
import pytest
from arms import robot_named
from leaning import Leaning

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.errors import ModelError
from eulerparams_control.laws.elasticity import Elasticity
from eulerparams_control.laws.orientation import EulerSequence, OrientationOptions, representation
from eulerparams_control.laws.rotations import angle_between, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot

G = 9.81


def loaded(arm, kilograms, **parameters):
    """Return an arm under compliance control to whose tip a load was hung."""
    leaning = Leaning("compliance_control", arm, parameters=parameters)
    leaning.run(0.1)
    leaning.forget()
    leaning.force = lambda p, v: np.array((0.0, 0.0, -G * kilograms))
    leaning.run(1.5)
    return leaning


@pytest.mark.parametrize("arm", ["ur5", "panda", "kuka_iiwa"])
def test_a_load_that_the_springs_do_not_hold_stops_a_compliant_arm(arm):
    leaning = loaded(arm, 10.0)
    assert leaning.gave_way < 0.080
    assert leaning.mode is Mode.STOPPED
    assert leaning.controller.why.cause is Cause.OVERLOADED
    leaning.forget()
    leaning.run(0.5)
    assert leaning.gave_way < 0.002  # it is held


def test_what_the_springs_hold_and_what_they_are_to_give_way_to_is_no_overload():
    assert loaded("ur5", 3.0).mode is Mode.HOLDING
    leaning = loaded("ur5", 6.0, max_stretch=1e4)
    assert leaning.gave_way > 0.08
    assert leaning.mode is Mode.HOLDING


@pytest.mark.parametrize("arm", ["ur5", "kuka_iiwa", "xarm7"])
def test_light_wrists_turn_against_the_friction_of_their_joints(arm):
    leaning = Leaning("compliance_control", arm)
    leaning.run(0.1)
    here = leaning.scheme.start_frame()
    there = DesiredFrame(here.p_d, here.R_d @ exp(np.array((0.0, 0.0, 0.6))))
    leaning.controller.aim(there, leaning.now)
    leaning.run(3.0)
    assert angle_between(leaning.plant.tip_state()[1], there.R_d) < np.radians(2.0)


@pytest.mark.parametrize("orientation", ["euler_angles", "relative_euler_angles"])
def test_next_to_a_pole_springs_pull_no_harder_than_twice_as_at_their_clip(orientation):
    clip, K = 0.2, 30.0
    options = OrientationOptions(EulerSequence("XYZ"))
    springs = Elasticity(representation(orientation, options), np.eye(3), K * np.eye(3), 0.05, clip)
    R_d = exp(np.array((0.0, np.pi / 2 - 0.01, 0.0)))
    R_e = R_d if orientation == "euler_angles" else np.eye(3)
    for axis in np.eye(3):
        turned = DesiredFrame(np.zeros(3), R_d @ exp(0.05 * axis))
        moment = springs.wrench(np.zeros(3), R_e, turned).mu
        assert np.linalg.norm(moment) < 2.001 * clip * K


@pytest.mark.parametrize("law", ["clik", "dynamic_control", "impedance_control"])
@pytest.mark.parametrize("arm", ["panda", "kuka_iiwa"])
def test_a_redundant_arm_keeps_the_posture_in_which_it_began(arm, law):
    robot, home = robot_named(arm)
    about = load_robot(arm)
    given = schemes()[law].parameters(base_frame=about.base_frame, tip_frame=about.tip_frame)
    scheme = given.make_scheme(robot)
    scheme.reset(home)
    law_of_joints = getattr(scheme, "motion", scheme)
    assert not law_of_joints.way_to_posture(home).any()
    away = home + 0.1
    np.testing.assert_allclose(law_of_joints.way_to_posture(away), -0.1)
    scheme.change(replace(given, posture=tuple(away)))
    assert not law_of_joints.way_to_posture(away).any()


class Mounted:
    """An arm at rest, and the parameters of its controller."""

    def __init__(self, arm="ur5", **parameters):
        about = load_robot(arm)
        self.parameters = schemes()["dynamic_control"].parameters(
            base_frame=about.base_frame, tip_frame=about.tip_frame, **parameters
        )
        self.robot = self.parameters.robot(about.urdf)
        self.q = np.array(about.home)

    def weight(self, gravity=(0.0, 0.0, -G), tool_mass=0.0):
        """Return the efforts (n,) that hold it where gravity is another one, with a tool."""
        given = replace(self.parameters, gravity=gravity, tool_mass=tool_mass)
        robot = given.robot(load_robot("ur5").urdf)
        return robot.dynamic_state(self.q, np.zeros_like(self.q)).g

    def refuse(self, effort):
        self.parameters.refuse_start(self.robot, self.q, effort)


def test_an_arm_whose_efforts_contradict_the_model_is_not_activated():
    arm = Mounted()
    for fits in (None, np.zeros(6), arm.weight(), arm.weight(tool_mass=1.0)):
        arm.refuse(fits)
    on_a_wall = arm.weight(gravity=(-G, 0.0, 0.0))
    with pytest.raises(ModelError, match="hold its weight"):
        arm.refuse(on_a_wall)
    Mounted(effort_feedback=False).refuse(on_a_wall)
    Mounted(gravity=(-G, 0.0, 0.0)).refuse(on_a_wall)
    for joint in range(6):  # one of them alone
        with pytest.raises(ModelError, match="hold its weight"):
            arm.refuse(arm.weight() + 60.0 * np.eye(6)[joint])


def test_of_an_arm_that_compensates_its_weight_or_is_held_by_its_brakes_no_effort_is_compared():
    arm = Mounted()
    for reported in (np.zeros(6), arm.weight(), -arm.weight()):
        Mounted(compensate_gravity=False).refuse(reported)
    arm.refuse(np.full(6, 1e-3))


def test_an_arm_that_cannot_bear_its_weight_is_not_activated():
    arm = Mounted(tool_mass=30.0)
    with pytest.raises(ModelError, match="it would fall"):
        arm.refuse(None)


def test_a_motion_whose_time_stands_because_something_holds_the_arm_says_that_it_waits():
    leaning = Leaning("compliance_control", "ur5")
    leaning.run(0.1)
    at = leaning.plant.tip_state()[0]
    leaning.force = lambda p, v: 5e4 * (at - p) - 200.0 * v  # it is clamped
    here = leaning.scheme.start_frame()
    leaning.controller.aim(DesiredFrame(here.p_d + (0.0, 0.3, 0.0), here.R_d), leaning.now)
    guidance = leaning.controller.guidance
    leaning.run(0.3)
    assert guidance.waited == 0.0
    leaning.run(1.5)
    assert guidance.waited > 0.5
    leaning.force = lambda p, v: np.zeros(3)
    leaning.run(1.0)
    assert guidance.waited == 0.0
    assert max(leaning.speeds) < 0.3
