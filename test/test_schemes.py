"""Each control scheme of the registry: its interface, its node, its parameters, its law."""

import importlib

import numpy as np
import pytest
from arms import HOME, STILL, UR5
from tolerances import HELD, NULL_SPACE, assert_close

from eulerparams_control.command_line import executables
from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.parameters.fields import fields_of, from_mapping
from eulerparams_control.parameters.schemes import COMMANDS, SchemeInfo, schemes
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.control_node import ControlNode

STEP = 1_000_000  # [ns]
FRAMES = {"base_frame": UR5.base_frame, "tip_frame": UR5.tip_frame}


@pytest.fixture(params=schemes())
def scheme(request: pytest.FixtureRequest) -> SchemeInfo:
    return schemes()[request.param]


def test_its_interface_is_that_of_its_experiment(scheme):
    controller = CONTROLLERS[scheme.name]
    assert controller.executables == (scheme.name,)
    assert controller.topics == scheme.topics
    assert controller.answers == (*scheme.outputs, scheme.command)
    assert controller.control == scheme.control
    assert scheme.command == COMMANDS[scheme.control]


def test_its_node_is_an_executable_that_has_its_parameters(scheme):
    module = importlib.import_module(executables()[scheme.name])
    classes = [each for each in vars(module).values() if isinstance(each, type)]
    nodes = [each for each in classes if issubclass(each, ControlNode)]
    assert scheme.parameters in [node.parameters_type for node in nodes]
    assert callable(module.main)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_an_arm_at_rest_is_held_without_an_error(scheme, orientation):
    parameters = from_mapping(scheme.parameters, FRAMES | {"orientation": orientation})
    controller = Controller(parameters.make_scheme(UR5), ControllerOptions(), HOME)
    command = controller.step(STEP, HOME, STILL)
    assert command is not None
    if scheme.control == "position":
        assert (command.q == HOME).all()
        assert_close(command.dq, 0, HELD)
    else:
        assert_close(command.effort, UR5.dynamic_state(HOME, STILL).g, NULL_SPACE)
    tick = controller.guidance.tick_now
    assert tick is not None
    np.testing.assert_array_equal(tick.dp_de, np.zeros(3))
    np.testing.assert_array_equal(tick.desired.p_d, UR5.state(HOME, STILL).p_e)
    assert_close(tick.x_de.error, 0)


def test_parameters_that_are_refused_change_nothing(scheme):
    law = from_mapping(scheme.parameters, FRAMES).make_scheme(UR5)
    parts = [law, *(part for part in (getattr(law, "motion", None),) if part is not None)]
    before = [dict(vars(part)) for part in parts]
    slower = {"velocity_scale": 0.1, "max_linear_speed": 5.0, "quaternion_initial_sign": -1}
    with pytest.raises(ConfigurationError, match="eta is -1"):
        law.change(from_mapping(scheme.parameters, FRAMES | slower))
    for part, kept in zip(parts, before, strict=True):
        assert all(vars(part)[name] is value for name, value in kept.items())


def test_where_a_joint_has_no_effort_limit_efforts_are_finite_also_after_no_time(scheme):
    about = load_robot("ur5")
    urdf = 'effort="inf"'.join(about.urdf.rsplit('effort="28.0"', 1))
    robot = Robot(urdf, about.base_frame, about.tip_frame)
    assert np.isinf(robot.limits.effort[5])
    law = from_mapping(scheme.parameters, FRAMES).make_scheme(robot)
    law.reset(HOME)
    here = law.frame_at(HOME)
    commands = []
    for dt, x in ((0.0, 0.0), (1e-3, 0.0), (0.0, 1e-3), (1e-3, 1e-3)):
        desired = here._replace(p_d=here.p_d + x)
        commands.append(law.tick(dt, HOME, STILL, desired).command)
        law.resume(HOME)
    commands += [law.hold(dt, HOME, STILL + 0.1) for dt in (0.0, 1e-3)]
    for command in commands:
        assert all(part is None or np.isfinite(part).all() for part in command[:3])


def test_its_parameters_are_described_and_its_defaults_are_possible(scheme):
    fields = fields_of(scheme.parameters)
    assert all(field.metadata["description"] for field in fields.values())
    defaults = {name: field.default for name, field in fields.items()}
    assert from_mapping(scheme.parameters, defaults) == scheme.parameters()
