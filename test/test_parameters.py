"""Parameters: declared from a dataclass, checked where they enter, changed while running."""

import dataclasses
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter
from ros_processes import free_domain

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.parameters.fields import fields_of, from_mapping, parameter
from eulerparams_control.ros.parameters import declare


@dataclass(frozen=True)
class Gains:
    """Parameters of every type."""

    k: float = parameter(10.0, "gain", unit="1/s", bounds=(0.0, 100.0), live=True)
    mass: float = parameter(1.0, "of the tool", unit="kg", live=True)
    steps: int = parameter(3, "how many", bounds=(1, 9), live=True)
    law: str = parameter("fast", "which law", choices=("fast", "slow"), live=True)
    strict: bool = parameter(True, "whether to be", live=True)
    weights: tuple[float, ...] = parameter((1.0, 2.0), "of the joints", live=True)
    posture: tuple[float, ...] = parameter((), "of the joints; empty: none", live=True)
    names: tuple[str, ...] = parameter((), "of the joints; empty: all")
    frame: str = parameter("tool0", "is fixed")


MakeNode = Callable[..., Node]


@pytest.fixture
def node(tmp_path: Path) -> Iterator[MakeNode]:
    """Makes a node whose parameters are overridden by those of a YAML file."""
    contexts: list[Context] = []

    def make(**overrides: Any) -> Node:
        file = tmp_path / "parameters.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": overrides}}))
        contexts.append(Context())
        options = ["--ros-args", "--params-file", str(file)] if overrides else []
        rclpy.init(args=options, context=contexts[-1], domain_id=free_domain())
        return rclpy.create_node("tested", context=contexts[-1])

    yield make
    for context in contexts:
        context.try_shutdown()


def test_without_overrides_the_defaults_hold(node):
    own = node()
    assert declare(own, Gains) == Gains()
    assert own.get_parameter("k").value == 10.0
    assert own.get_parameter("weights").value == [1.0, 2.0]
    assert own.get_parameter("posture").type_ is Parameter.Type.DOUBLE_ARRAY
    assert own.get_parameter("names").type_ is Parameter.Type.STRING_ARRAY


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ({"k": 20.0, "steps": 5, "weights": [3.0]}, Gains(20.0, 1.0, 5, weights=(3.0,))),
        ({"law": "slow", "names": ["a", "b"]}, Gains(law="slow", names=("a", "b"))),
        ({"strict": False, "frame": "flange"}, Gains(strict=False, frame="flange")),
        ({"k": 20, "weights": [1, 2, 3]}, Gains(20.0, weights=(1.0, 2.0, 3.0))),
        ({"weights": [], "names": []}, Gains(weights=(), names=())),
    ],
)
def test_a_yaml_file_overrides_what_it_names(node, overrides, expected):
    found = declare(node(**overrides), Gains)
    assert found == expected == from_mapping(Gains, overrides | {"use_sim_time": True})
    assert all(isinstance(number, float) for number in (found.k, *found.weights))


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"laww": "fast"}, "unknown parameter 'laww' (did you mean 'law'?); known: frame, k, law"),
        ({"qqqqqq": 1}, "unknown parameter 'qqqqqq'; known: frame, k, law, mass, names"),
        ({"k": 100.5}, "parameter 'k' is 100.5 1/s; expected between 0 and 100"),
        ({"k": -1}, "parameter 'k' is -1 1/s; expected between 0 and 100"),
        ({"k": math.nan}, "parameter 'k' is nan; expected a finite number 1/s"),
        ({"mass": math.inf}, "parameter 'mass' is inf; expected a finite number kg"),
        ({"k": "fast"}, "parameter 'k' is 'fast', a str; expected a float"),
        ({"k": True}, "parameter 'k' is True, a bool; expected a float"),
        ({"steps": 2.5}, "parameter 'steps' is 2.5, a float; expected a int"),
        ({"steps": True}, "parameter 'steps' is True, a bool; expected a int"),
        ({"steps": 10}, "parameter 'steps' is 10; expected between 1 and 9"),
        ({"strict": 1}, "parameter 'strict' is 1, a int; expected a bool"),
        ({"law": "fsat"}, "'fsat' (did you mean 'fast'?); known: fast, slow"),
        ({"weights": 1.0}, "parameter 'weights' is 1.0; expected a list"),
        ({"weights": [1.0, math.nan]}, "parameter 'weights' is nan; expected a finite number"),
        ({"weights": ["a"]}, "parameter 'weights' is 'a', a str; expected a float"),
        ({"names": [1, 2]}, "parameter 'names' is 1, a int; expected a str"),
        ({"names": "shoulder"}, "parameter 'names' is 'shoulder'; expected a list"),
        ({"k": [1.0]}, "parameter 'k' is "),
    ],
)
def test_an_override_that_is_not_possible_is_refused_with_what_was_expected(node, overrides, words):
    with pytest.raises(ConfigurationError, match=re.escape(words)) as refusal:
        declare(node(**overrides), Gains)
    assert "\n" not in str(refusal.value)
    with pytest.raises(type(refusal.value), match=re.escape(words)):
        from_mapping(Gains, overrides)


def test_what_rclpy_declares_itself_is_no_unknown_parameter(node):
    overrides = {"use_sim_time": True, "qos_overrides./joint_states.subscription.depth": 5}
    own = node(**overrides)
    assert declare(own, Gains) == Gains()
    assert own.get_parameter("use_sim_time").value is True


def test_a_parameter_is_described_with_its_unit_bounds_and_choices(node):
    own = node()
    declare(own, Gains)
    k, law = own.describe_parameter("k"), own.describe_parameter("law")
    assert (k.description, k.additional_constraints) == ("gain [1/s]", "between 0 and 100")
    assert (law.description, law.additional_constraints) == ("which law", "one of fast, slow")


# --- changes while running -------------------------------------------------------------------


def change(own: Node, **values: Any) -> list[str]:
    """Set parameters together; return the reason of the refusal, if it is one."""
    result = own.set_parameters_atomically([Parameter(k, value=v) for k, v in values.items()])
    return [] if result.successful else [result.reason]


def test_a_change_is_given_with_what_was_before_and_then_holds(node):
    own = node(k=5.0)
    seen: list[tuple[Gains, Gains]] = []
    start = declare(own, Gains, lambda old, new: seen.append((old, new)))
    assert change(own, k=7.0) == []
    assert change(own, k=8.0, law="slow", posture=[0.5, 1.0]) == []
    second = dataclasses.replace(start, k=7.0)
    third = dataclasses.replace(second, k=8.0, law="slow", posture=(0.5, 1.0))
    assert seen == [(start, second), (second, third)]
    assert own.get_parameter("k").value == 8.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"k": "much"}, "parameter 'k' is 'much', a str; expected a float"),
        ({"law": "medium"}, "'medium'; known: fast, slow"),
        ({"weights": [1.0, math.inf]}, "parameter 'weights' is inf; expected a finite number"),
        ({"frame": "tool1"}, "'frame' cannot be changed while running"),
        ({"k": 50.0, "steps": 100}, "parameter 'steps' is 100; expected between 1 and 9"),
    ],
)
def test_a_change_that_is_not_possible_is_refused_and_changes_nothing(node, values, words):
    own = node()
    seen: list[Gains] = []
    declare(own, Gains, lambda _, new: seen.append(new))
    before = {name: own.get_parameter(name).value for name in values}
    (reason,) = change(own, **values)
    assert words in reason
    assert seen == []
    assert {name: own.get_parameter(name).value for name in values} == before
    assert change(own, mass=2.0) == []  # what was refused has left nothing behind
    assert seen == [Gains(mass=2.0)]


def test_a_name_that_is_unknown_is_answered_with_the_one_that_was_probably_meant(node):
    own = node()
    declare(own, Gains, lambda *_: None)
    with pytest.raises(ParameterNotDeclaredException) as refusal:  # its text is the answer
        change(own, laww="fast")
    assert str(refusal.value).startswith("unknown parameter 'laww' (did you mean 'law'?); known: ")


def test_what_the_node_refuses_is_refused_with_its_reason(node):
    own = node()

    def refuse_heavy(_: Gains, new: Gains) -> None:
        if new.mass > 5.0:
            raise ConfigurationError("too heavy")

    declare(own, Gains, refuse_heavy)
    assert change(own, mass=6.0) == ["too heavy"]
    assert own.get_parameter("mass").value == 1.0
    assert change(own, mass=5.0, k=1) == []
    assert own.get_parameter("mass").value == 5.0


def test_without_a_way_to_apply_it_no_parameter_can_be_changed(node):
    own = node()
    declare(own, Gains)
    assert change(own, k=1.0) == ["'k' cannot be changed while running"]
    assert own.get_parameter("k").value == 10.0


def test_clik_takes_the_choices_that_exist():
    choices = {name: field.metadata["choices"] for name, field in fields_of(ClikParameters).items()}
    angles = ("angle_axis", "euler_angles", "euler_parameters", "relative_euler_angles")
    assert set(choices["orientation"]) == {*angles, "rotation_vector"}
    assert set(choices["euler_sequence"]) == {
        *("XYX", "XYZ", "XZX", "XZY", "YXY", "YXZ"),
        *("YZX", "YZY", "ZXY", "ZXZ", "ZYX", "ZYZ"),
    }
    assert set(choices["quaternion_sign"]) == {"continuous", "hysteretic", "separate", "shortest"}
    assert set(choices["command_type"]) == {"forward", "joint_state", "joint_trajectory"}
    assert set(choices["feedback"]) == {"internal", "measured"}
