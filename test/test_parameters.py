"""Parameters and files: taken where they are possible, else refused in a line that names why."""

import dataclasses
import math
import re
import typing
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from hypothesis import given
from hypothesis import strategies as st
from in_process import World, class_of, run_to_its_end
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from ros_processes import ros_arguments
from samples import examples

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.parameters.fields import fields_of, from_mapping, parameter
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.resources import config_folder, config_names
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros.parameter_files import refuse_misread
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


@pytest.fixture
def node(shared_world: World, tmp_path: Path) -> Iterator[Callable[..., Node]]:
    """Makes nodes whose parameters are overridden by those of a YAML file."""
    made: list[Node] = []

    def make(**overrides: Any) -> Node:
        for old in made:
            old.destroy_node()
        arguments = ros_arguments(tmp_path / "parameters", overrides, (), ())
        made[:] = [rclpy.create_node("tested", context=shared_world.context, cli_args=arguments)]
        return made[0]

    yield make
    for last in made:
        last.destroy_node()


def test_without_overrides_the_defaults_hold_are_described_and_cannot_be_changed(node):
    overrides = {"use_sim_time": True, "qos_overrides./joint_states.subscription.depth": 5}
    own = node(**overrides)  # which rclpy declares itself
    assert declare(own, Gains) == Gains()
    assert own.get_parameter("use_sim_time").value is True
    assert own.get_parameter("k").value == 10.0
    assert own.get_parameter("weights").value == [1.0, 2.0]
    assert own.get_parameter("posture").type_ is Parameter.Type.DOUBLE_ARRAY
    assert own.get_parameter("names").type_ is Parameter.Type.STRING_ARRAY
    k, law = own.describe_parameter("k"), own.describe_parameter("law")
    assert (k.description, k.additional_constraints) == ("gain [1/s]", "between 0 and 100")
    assert (law.description, law.additional_constraints) == ("which law", "one of fast, slow")
    assert change(own, k=1.0) == ["'k' cannot be changed while running"]
    assert own.get_parameter("k").value == 10.0


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
        ({"k": 100.5}, "parameter 'k' is 100.5 1/s; expected between 0 and 100"),
        ({"k": math.nan}, "parameter 'k' is nan; expected a finite number 1/s"),
        ({"k": "fast"}, "parameter 'k' is 'fast', a str; expected a float"),
        ({"steps": 2.5}, "parameter 'steps' is 2.5, a float; expected a int"),
        ({"steps": 10}, "parameter 'steps' is 10; expected between 1 and 9"),
        ({"strict": 1}, "parameter 'strict' is 1, a int; expected a bool"),
        ({"law": "fsat"}, "'fsat' (did you mean 'fast'?); known: fast, slow"),
        ({"weights": 1.0}, "parameter 'weights' is 1.0; expected a list"),
        ({"weights": [1.0, math.nan]}, "parameter 'weights' is nan; expected a finite number"),
        ({"weights": ["a"]}, "parameter 'weights' is 'a', a str; expected a float"),
        ({"names": [1, 2]}, "parameter 'names' is 1, a int; expected a str"),
        ({"names": "shoulder"}, "parameter 'names' is 'shoulder'; expected a list"),
    ],
)
def test_an_override_that_is_not_possible_is_refused_with_what_was_expected(node, overrides, words):
    with pytest.raises(ConfigurationError, match=re.escape(words)) as refusal:
        declare(node(**overrides), Gains)
    assert "\n" not in str(refusal.value)
    with pytest.raises(type(refusal.value), match=re.escape(words)):
        from_mapping(Gains, overrides)


# --- changes while running -------------------------------------------------------------------
def change(own: Node, **values: Any) -> list[str]:
    """Set parameters together; return the reason of the refusal, if it is one."""
    try:
        result = own.set_parameters_atomically([Parameter(k, value=v) for k, v in values.items()])
    except ParameterNotDeclaredException as refusal:  # its text is the answer of the services
        return [str(refusal)]
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
        ({"k": 50.0, "steps": 100}, "parameter 'steps' is 100; expected between 1 and 9"),
        ({"k": 1.0, "names": ["a"]}, "'names' cannot be changed while running"),
        ({"mass": 6.0}, "too heavy"),
        ({"laww": "fast"}, "unknown parameter 'laww' (did you mean 'law'?); known: "),
    ],
)
def test_a_change_that_is_not_possible_is_refused_and_changes_nothing(node, values, words):
    own = node()
    seen: list[Gains] = []

    def refuse_heavy(_: Gains, new: Gains) -> None:
        if new.mass > 5.0:
            raise ConfigurationError("too heavy")
        seen.append(new)

    declare(own, Gains, refuse_heavy)
    (reason,) = change(own, **values)
    assert reason.startswith(words)
    assert seen == []
    assert [own.get_parameter(name).value for name in ("k", "mass", "steps")] == [10.0, 1.0, 3]
    assert change(own, mass=5.0) == []  # what was refused has left nothing behind
    assert seen == [Gains(mass=5.0)]


@pytest.mark.parametrize("name", schemes())
def test_speed_scale_and_effort_rate_bound_the_commands(name):
    arm, kind = load_robot("ur5"), schemes()[name].parameters
    given = {"velocity_scale": 0.25, "max_joint_acceleration": [3.0], "max_effort_rate": [123.0]}
    given |= {"base_frame": arm.base_frame, "tip_frame": arm.tip_frame}
    p = from_mapping(kind, {key: given[key] for key in given.keys() & fields_of(kind).keys()})
    robot = p.robot(arm.urdf)
    bounds = p.make_scheme(robot).bounds
    assert bounds.joints.velocity.tolist() == (0.25 * robot.limits.velocity).tolist()
    assert bounds.joints.acceleration.tolist() == [3.0] * robot.n
    assert bounds.joints.upper.tolist() == robot.limits.upper.tolist()
    assert name == "clik" or np.unique(bounds.effort_rate).tolist() == [123.0]


# --- any value -------------------------------------------------------------------------------
NODES = (*schemes(), "reference", "pybullet_bridge", "bag_recorder", "identify_tool")
forty = examples(40)


@pytest.mark.parametrize("executable", [*NODES, "teleop", "watchdog", "fault_injector"])
def test_each_parameter_of_a_node_shows_its_bounds_as_a_range_and_whether_it_can_change(
    node, executable
):
    kind, own = class_of(executable).parameters_type, node()
    declare(own, kind, lambda old, new: None)
    for name, field in fields_of(kind).items():
        shown, bounds = own.describe_parameter(name), field.metadata["bounds"]
        assert shown.read_only is not field.metadata["live"], name
        ranges = [*shown.floating_point_range, *shown.integer_range]
        if bounds is None or field.type not in (int, float):
            assert not ranges, name
            continue
        (found,) = ranges
        assert (found.from_value, found.to_value) == bounds
        assert all(map(math.isfinite, bounds)), name  # a slider has two ends
        assert field.type is float or max(map(abs, bounds)) < 2**31, name  # of 32 bits
        assert bounds[0] <= own.get_parameter(name).value <= bounds[1]
        assert (shown.type == Parameter.Type.INTEGER.value) is (field.type is int)


WORDS = st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), max_size=8)
NUMBERS = st.floats() | st.sampled_from([1e308, -1e308, 5e-324, math.nan, math.inf, 1e400])
SCALARS = st.one_of(NUMBERS, st.integers(-(2**63), 2**63 - 1), st.booleans(), WORDS)
VALUES = st.one_of(
    SCALARS,
    st.lists(NUMBERS, max_size=7),
    st.lists(st.integers(-(2**31), 2**31), max_size=7),
    st.lists(WORDS, max_size=3),
    st.lists(st.booleans(), max_size=3),
)


def assert_of_their_types(found: Any) -> None:
    """Assert that each parameter has the type, the bounds and the words of its field."""
    hints = typing.get_type_hints(type(found))
    for field in dataclasses.fields(found):
        value = getattr(found, field.name)
        is_list = typing.get_origin(hints[field.name]) is tuple
        kind = typing.get_args(hints[field.name])[0] if is_list else hints[field.name]
        for each in value if is_list else [value]:
            assert type(each) is kind
            assert kind is not float or math.isfinite(each)
            low, high = field.metadata["bounds"] or (-math.inf, math.inf)
            assert kind not in (int, float) or low <= each <= high
            assert not field.metadata["choices"] or each in field.metadata["choices"]


@pytest.mark.parametrize("executable", NODES)
@forty
@given(data=st.data())
def test_any_value_of_a_parameter_is_of_its_type_or_refused_by_its_name(data, executable, node):
    kind = class_of(executable).parameters_type
    name = data.draw(st.sampled_from([field.name for field in dataclasses.fields(kind)]))
    value = data.draw(VALUES)
    refusal = ""
    try:
        assert_of_their_types(declare(node(**{name: value}), kind))
    except ConfigurationError as error:
        refusal = str(error)
    except rclpy_implementation.RCLError:
        pass  # an integer of 64 bits that rcl does not take; the executable says so in one line
    assert not refusal or f"'{name}'" in refusal
    assert "\n" not in refusal


# --- sections --------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("arguments", "refused"),
    [
        ("-p clik:enforce_limits:=maybe", "'enforce_limits' is 'maybe', a str; expected a bool"),
        ("-p max_linear_speed:=0,05", "'max_linear_speed' is '0,05'"),
        ("--params-file words.yaml", "'k_Po' is 'slow'"),
        ("-p other:k_Pp:=fast -p k_Pp:=1e-3 -p k_Po:=.5 -p orientation:=no -p x:=y", ""),
        ("-p enforce_limits:=true --params-file none.yaml", ""),
    ],
)
def test_a_word_for_a_number_is_refused_also_where_another_source_gives_a_number(
    arguments, refused, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("words.yaml").write_text("clik: {ros__parameters: {k_Pp: 100.0, k_Po: slow}}")
    fields = fields_of(schemes()["clik"].parameters)
    with pytest.raises(ConfigurationError, match=refused) if refused else nullcontext():
        refuse_misread("clik", fields, ["clik", "--ros-args", *arguments.split()])


EMPTY: dict[str, Any] = {"ros__parameters": {}}


@pytest.mark.parametrize(
    ("content", "refused"),
    [
        *(({section: EMPTY}, True) for section in ("click", "/left/clik_", "/CLIK")),
        *(({section: EMPTY}, False) for section in ("clik", "/left/clik", "/*", "/reference")),
        ({"left": {"clik": EMPTY}}, False),
        ({"/**": EMPTY, "/clikk": EMPTY}, False),
        ({"clik": EMPTY, "clik_2": EMPTY}, False),
        *((content, False) for content in ([1, 2], None)),
    ],
)
def test_a_file_for_nearly_this_node_is_refused_and_others_left_to_rcl(content, refused, tmp_path):
    file = tmp_path / "parameters.yaml"
    file.write_text(yaml.safe_dump(content))
    arguments = ["x", "--ros-args", "--params-file", str(file), "--params-file", "/none"]
    words = r"did you mean 'clik'\?"
    with pytest.raises(ConfigurationError, match=words) if refused else nullcontext():
        refuse_misread("clik", {}, arguments)


# --- files of experiments and maps ---------------------------------------------------------------
def leaves(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the way to each value of nested mappings and lists, itself among them."""
    yield path
    pairs = dict(enumerate(content)) if isinstance(content, list) else content
    for key, value in pairs.items() if isinstance(pairs, dict) else ():
        yield from leaves(value, (*path, key))


def replaced(content: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Return a copy of nested mappings and lists with another value in one place."""
    if not path:
        return value
    copy = dict(content) if isinstance(content, dict) else list(content)
    copy[path[0]] = replaced(copy[path[0]], path[1:], value)
    return copy


@forty
@given(data=st.data())
def test_a_damaged_file_of_an_experiment_is_taken_or_refused(data, tmp_path):
    name = data.draw(st.sampled_from(config_names("experiments")))
    content = yaml.safe_load((config_folder() / "experiments" / f"{name}.yaml").read_text())
    path = data.draw(st.sampled_from(list(leaves(content))))
    value = data.draw(st.none() | VALUES | st.dictionaries(WORDS, SCALARS, max_size=2))
    file = tmp_path / f"{name}.yaml"
    damaged = yaml.safe_dump(replaced(content, path, value), allow_unicode=True)
    file.write_text(damaged, encoding="utf-8")
    refusal = str(file)
    try:
        load_experiment(str(file))
    except ConfigurationError as error:
        refusal = str(error)
    assert str(file) in refusal


# --- as executables ----------------------------------------------------------------------------
FILES = (
    ("/**: {ros__parameters: {use_sim_tme: true}}", "did you mean 'use_sim_time'"),
    ("/**: {ros__parameters: {a: {b: {c: 1}}}}", "unknown parameter 'a.b.c'"),
    ("/**: {ros__parameters: {joints: [a, ", "parameters.yaml"),
    ("/**:\n  ros__parameters:\n    joints: [a, 1]\n", "line_num 3"),
)


@pytest.mark.parametrize("executable", NODES)
def test_an_executable_refuses_a_file_in_one_line_and_ends(executable, tmp_path):
    file = tmp_path / "parameters.yaml"
    other = f"/{executable}x: {{ros__parameters: {{a: 1}}}}"
    for text, words in (*FILES, (other, f"{file} has parameters for the node '/{executable}x'")):
        file.write_text(text)
        process = run_to_its_end(executable, tmp_path, files=[file])
        assert process.exit_code == 1
        (line,) = process.stderr.splitlines()
        assert words in line
