"""Real arms of the launch files, and the parameters that are given to nodes, merged key by key.

``config/robots/real/NAME.yaml`` adds an arm; such a file elsewhere is named by its path.
"""

import json
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from pkgutil import resolve_name
from tempfile import NamedTemporaryFile
from typing import Any, NamedTuple

from eulerparams_control.errors import ConfigurationError, UnknownNameError, did_you_mean
from eulerparams_control.parameters.fields import checked, fields_of, refuse_unknown
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.resources import config_file, config_names
from eulerparams_control.ros.parameter_files import load_yaml, named_sections

BRIDGE, WATCHDOG, RECORDER = "pybullet_bridge", "watchdog", "bag_recorder"
_OTHERS = {  # the parameters of the nodes that are no controllers, imported where one is used
    BRIDGE: "sim_bridge.bridge_parameters:BridgeParameters",
    WATCHDOG: "eulerparams_control.parameters.watchdog:WatchdogParameters",
    RECORDER: "eulerparams_control.bags.ros.recorder_node:RecorderParameters",
}
_FREE = ("environment.",)  # names that pybullet_bridge checks itself

ARGUMENTS = (
    *("namespace", "base_frame", "tip_frame"),
    *("position_controller", "effort_controller", "watchdog"),
)
"""Arguments of bringup that an arm fills where they are empty."""

_EXAMPLES = {"topics": "{wrench: /sensor/wrench}", "parameters": "{watchdog: {timeout: 0.1}}"}
_TOPICS = (  # between nodes, besides those of the schemes
    *("driver_effort", "external_wrench", "robot_description"),
    *("target_pose", "target_stiffness", "target_twist", "target_wrench"),
)
_KEYS = ("description", "controllers", *ARGUMENTS, "topics", "parameters")

type Parameters = Mapping[str, Mapping[str, Any]]
"""Parameters of nodes: by the name of the node, then by that of the parameter, with dots."""


class RealArm(NamedTuple):
    """A real arm behind its driver."""

    name: str = ""  # of its file
    controllers: tuple[str, ...] = ()  # that can control it, the default first; empty: any
    arguments: Mapping[str, str] = {}  # of bringup, those of ``ARGUMENTS`` that it has
    topics: Mapping[str, str] = {}  # other names of topics
    parameters: Mapping[str, Mapping[str, Any]] = {}  # of nodes


def arm_launch(file: str) -> Any:
    """Return the LaunchDescription of bringup for the real arm that a launch file is named for."""
    from launch import LaunchDescription  # of ROS 2: who launches has it
    from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription

    arm = load_arm(Path(file).name.removesuffix(".launch.py"))
    only = {"robot": (arm.name,), "sim": ("false",), "controller": arm.controllers}
    declared = [
        DeclareLaunchArgument(name, default_value=values[0], choices=list(values))
        for name, values in only.items()
    ]
    path = str(Path(file).with_name("bringup.launch.py"))
    return LaunchDescription([*declared, IncludeLaunchDescription(path)])


def load_arm(name_or_path: str) -> RealArm:
    """Return the arm of ``config/robots/real/<name>.yaml``, or of a path to such a file.

    Raises ConfigurationError if there is no such arm, or something in its file is impossible.
    """
    path = Path(name_or_path)
    if path.suffix != ".yaml":
        known = config_names("robots/real")
        if name_or_path not in known:
            raise UnknownNameError("real arm", name_or_path, known)
        path = config_file("robots/real", name_or_path)
    try:
        entry = _mapping("holds", load_yaml(path))
        for key in entry:
            if key not in _KEYS:
                raise UnknownNameError("key", key, _KEYS)
        controllers = entry.get("controllers") or []
        if not isinstance(controllers, list):
            raise ConfigurationError(f"controllers is {controllers!r}; expected a list of names")
        return RealArm(
            path.stem,
            tuple(map(str, controllers)),
            {name: _argument(name, entry[name]) for name in ARGUMENTS if name in entry},
            topics_of(entry.get("topics")),
            parameters_of(entry.get("parameters")),
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error


def _argument(name: str, value: Any) -> str:
    kind, expected = (bool, "true or false") if name == "watchdog" else (str, "a name")
    if not isinstance(value, kind):
        raise ConfigurationError(f"{name} is {value!r}; expected {expected}")
    return str(value).lower() if kind is bool else str(value)


def read_argument(name: str, text: str) -> dict[str, Any]:
    """Return the mapping that an argument is in YAML; raises ConfigurationError if it is none."""
    try:
        return _mapping("it holds", load_yaml(text))
    except ConfigurationError as error:
        raise ConfigurationError(
            f"{name} is {text!r}; expected a mapping in YAML, {name}:='{_EXAMPLES[name]}': {error}"
        ) from error


def topics_of(given: Any) -> dict[str, str]:
    """Return other names of topics, checked; raises ConfigurationError."""
    topics, known = _mapping("topics:", given), {*_TOPICS}
    for scheme in schemes().values():
        known |= {*scheme.topics, *scheme.outputs}
    for name, other in topics.items():
        if not name.startswith(("/", "~")) and name not in known:
            raise UnknownNameError("topic", name, known)
        if not (isinstance(other, str) and other.strip()):
            raise ConfigurationError(f"topic '{name}' is {other!r}; expected the name of a topic")
    return topics


def parameters_of(given: Any) -> Parameters:
    """Return parameters of nodes with their names in dots, checked; raises ConfigurationError."""
    return {node: _checked(node, each) for node, each in _mapping("parameters:", given).items()}


def parameters_of_file(path: str, namespace: str, controllers: Collection[str]) -> Parameters:
    """Return what a parameter file of ROS has for nodes in a namespace, checked.

    A section whose last part is a wildcard is for the ``controllers``, those that are started.  One
    that has no namespace counts in each.  Raises ConfigurationError if the file cannot be read, is
    for no node, or something in it is impossible.
    """
    nodes, found = {*_OTHERS, *schemes()}, list[Parameters]()
    try:
        sections = list(named_sections(_mapping("holds", load_yaml(Path(path)))))
        for section, values in sections:
            part = section.rpartition("/")[2]
            if part not in nodes and did_you_mean(part, nodes):
                raise UnknownNameError("node", part, nodes)
            pattern = re.escape(section).replace(r"/\*\*", "(/.*)?").replace(r"\*", "[^/]*")
            for node in nodes & {part} or nodes & {*controllers}:
                name = re.sub("/+", "/", f"/{namespace}/{node}")
                if section == f"/{node}" or re.fullmatch(pattern, name):
                    found.append({node: _checked(node, values)})
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error
    if not found:
        names = ", ".join(section for section, _ in sections) or "no node"
        raise ConfigurationError(f"{path} is for {names}; expected one of {', '.join(nodes)}")
    return merged(*found)


def merged(*layers: Parameters) -> Parameters:
    """Return parameters of nodes, key by key; the last layer that has one counts."""
    found: dict[str, dict[str, Any]] = {}
    for layer in layers:
        for node, values in layer.items():
            found.setdefault(node, {}).update(values)
    return found


def parameter_files(values: Mapping[str, Any]) -> list[str]:
    """Return a new file of the parameters of a node: launch_ros refuses empty lists otherwise.

    It is JSON, which is YAML with each text in quotes: else rcl reads '1e-3' or 'y' as no text.
    """
    if not values:
        return []
    content = {"/**": {"ros__parameters": values}}
    with NamedTemporaryFile("wb", prefix="parameters_", suffix=".yaml", delete=False) as file:
        file.write(json.dumps(content, ensure_ascii=False, default=str).encode())
    return [file.name]


def _mapping(what: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict | None):
        raise ConfigurationError(f"{what} {value!r}; expected a mapping")
    return {str(key): entry for key, entry in (value or {}).items()}


def _flat(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return nested mappings as one whose names have dots, as ROS has them."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{above}{key}"
        found |= _flat(value, f"{name}.") if isinstance(value, dict) else {name: value}
    return found


def _checked(node: str, given: Any) -> dict[str, Any]:
    """Return parameters with their names in dots; raises ConfigurationError as the node would."""
    if node not in (known := {*_OTHERS, *schemes()}):
        raise UnknownNameError("node", node, known)
    values = _flat(_mapping(f"parameters of '{node}':", given))
    kind = resolve_name(_OTHERS[node]) if node in _OTHERS else schemes()[node].parameters
    fields = fields_of(kind)
    try:
        refuse_unknown(kind, values, _FREE if node == BRIDGE else ())
        return values | {
            name: checked(fields[name], value) for name, value in values.items() if name in fields
        }
    except ConfigurationError as error:
        raise ConfigurationError(f"{node}: {error}") from error
