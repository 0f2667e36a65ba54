"""Each control scheme of the registry: its interface, its node, its parameters, its law."""

import importlib

import numpy as np
import pytest
from arms import HOME, STILL, UR5
from tolerances import HELD, NULL_SPACE, assert_close

from eulerparams_control.command_line import executables
from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.parameters.fields import fields_of, from_mapping
from eulerparams_control.parameters.schemes import COMMANDS, SchemeInfo, schemes
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


def test_its_parameters_are_described_and_its_defaults_are_possible(scheme):
    fields = fields_of(scheme.parameters)
    assert all(field.metadata["description"] for field in fields.values())
    defaults = {name: field.default for name, field in fields.items()}
    assert from_mapping(scheme.parameters, defaults) == scheme.parameters()
