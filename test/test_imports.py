"""The rooms of the tree: who may import ROS, and in which direction the arrows go."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

from eulerparams_control.laws import compiled
from eulerparams_control.parameters.schemes import schemes

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted([*ROOT.glob("eulerparams_control/**/*.py"), *ROOT.glob("sim_bridge/**/*.py")])
MESSAGES = {
    *("builtin_interfaces", "rosgraph_msgs", "lifecycle_msgs", "rcl_interfaces", "sensor_msgs"),
    *("geometry_msgs", "trajectory_msgs", "std_msgs", "std_srvs", "diagnostic_msgs"),
    "visualization_msgs",
}
ROS = {"rclpy", "ament_index_python", *MESSAGES}

# The floors, from the ground up: a module imports what is on its own floor or below.
FLOORS = (
    ("errors", "events", "resources", "command_line", "parameters.fields", "parameters.real_time"),
    ("laws.compiled", "laws.linear", "laws.rotations"),
    ("motion",),
    ("laws.impedance_matrices", "laws.orientation", "motion.way_points"),
    ("robot.urdf", "robot.urdf_text"),
    ("laws.limits", "laws.inverse", "laws.friction", "robot"),
    ("parameters.schemes", "parameters.common"),
    ("laws", "parameters"),
    ("control",),
    ("messages",),
    ("ros", "bags"),
    ("tool",),
    ("sim_bridge",),
    ("analysis",),
    ("lab",),
    ("live",),
)


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in SOURCES}


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def may_import_ros(module):
    return module.endswith("_node") or "ros" in module.split(".")


def imports(path, at_module_level=False):
    """Return the modules that a file imports; inside functions too unless told otherwise."""
    tree = tree_of(path)
    nodes = tree.body if at_module_level else ast.walk(tree)
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= (inside & MODULES.keys()) or {node.module}
    return names


ARROWS = {name: imports(path) & MODULES.keys() - {name} for name, path in MODULES.items()}


def short(module):
    return module.removeprefix("eulerparams_control.")


def floor_of(module):
    """Return the floor that names most of a module; 0 for the package itself."""
    name = short(module)
    if name == "eulerparams_control":
        return 0
    places = [
        (len(prefix), floor)
        for floor, prefixes in enumerate(FLOORS)
        for prefix in prefixes
        if name == prefix or name.startswith(prefix + ".")
    ]
    assert places, f"{module} is on no floor"
    return max(places)[1]


def test_only_nodes_import_ros_and_only_they_and_what_makes_messages_import_messages():
    """So all else can be imported where there is no ROS."""
    for module, path in MODULES.items():
        allowed = MESSAGES if short(module) in ("messages.to_ros", "messages.markers") else set()
        found = {name for name in imports(path) if name.partition(".")[0] in ROS - allowed}
        assert may_import_ros(module) or not found, module


def test_only_the_ros_layer_imports_the_ros_layer():
    for module, path in MODULES.items():
        found = {name for name in imports(path, at_module_level=True) if may_import_ros(name)}
        assert may_import_ros(module) or not found & MODULES.keys(), module


def test_no_arrow_goes_upward():
    """So what a robot needs imports nothing of bags, analysis or lab."""
    for module, arrows in ARROWS.items():
        assert {to for to in arrows if floor_of(to) > floor_of(module)} == set(), module


def test_no_imports_go_in_a_circle():
    settled = set()
    while True:
        free = {name for name, to in ARROWS.items() if name not in settled and to <= settled}
        if not free:
            break
        settled |= free
    assert sorted(MODULES.keys() - settled) == []


def test_each_class_has_a_name_of_its_own():
    places = defaultdict(list)
    for name, path in MODULES.items():
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(name)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_few_modules_lie_flat():
    flat = sorted(path.name for path in (ROOT / "eulerparams_control").glob("*.py"))
    assert flat == ["__init__.py", "command_line.py", "errors.py", "events.py", "resources.py"]


def loaded_with(module):
    """Return the modules of the package that are loaded with one, which is among them."""
    loaded, pending = set(), {module}
    while pending:
        name = pending.pop()
        loaded.add(name)
        pending |= (imports(MODULES[name], at_module_level=True) & MODULES.keys()) - loaded
    return loaded


def test_analyze_loads_what_draws_figures_and_writes_tables_only_if_they_are_asked_for():
    """To load them takes as long as to analyse half a minute of a bag."""
    for name in loaded_with("eulerparams_control.analysis.main"):
        found = imports(MODULES[name], at_module_level=True)
        assert not {module.partition(".")[0] for module in found} & {"matplotlib", "pyarrow"}, name


def test_a_node_loads_the_parameters_of_no_other_scheme():
    """To load them, and the laws that they are for, takes a tenth of a second."""
    parameters = {f"eulerparams_control.parameters.{name}": name for name in schemes()}
    for name in schemes():
        loaded = loaded_with(f"eulerparams_control.ros.{name}_node")
        assert [parameters[each] for each in loaded & parameters.keys()] == [name]


def test_only_robot_imports_pinocchio_and_only_the_engine_imports_pybullet():
    users = {name: {module for module, path in MODULES.items() if name in imports(path)}
             for name in ("pinocchio", "pybullet")}  # fmt: skip
    assert users == {
        "pinocchio": {"eulerparams_control.robot.robot"},
        "pybullet": {"sim_bridge.engine"},
    }


def test_what_is_compiled_is_in_the_files_that_the_cache_is_named_by():
    found = {path for path in SOURCES if "\n@entry" in path.read_text(encoding="utf-8")}
    assert ROOT / "eulerparams_control/messages/joint_bytes.py" in found
    assert [path for path in found if not any(map(path.is_relative_to, compiled._ROOMS))] == []
