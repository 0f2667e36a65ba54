"""Only the ROS layer imports ROS: laws, robot, simulator and analysis work without it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted([*ROOT.glob("eulerparams_control/**/*.py"), *ROOT.glob("sim_bridge/**/*.py")])
ROS = {
    *("rclpy", "rcl_interfaces", "builtin_interfaces", "rosgraph_msgs", "lifecycle_msgs"),
    *("sensor_msgs", "geometry_msgs", "trajectory_msgs", "std_msgs", "std_srvs"),
    *("diagnostic_msgs", "ament_index_python"),
}
ROS_LAYER = "eulerparams_control.ros"
ROS_MODULES = {
    "eulerparams_control.bags.recorder_node",
    "eulerparams_control.bags.recorder_parameters",
    "sim_bridge.bridge_node",
}
BLOCK = """
import importlib, sys
class Block:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {ros!r}:
            raise ImportError(f"ROS is blocked: {{name}}")
sys.meta_path.insert(0, Block())
for module in {modules!r}:
    importlib.import_module(module)
print("imported", len({modules!r}))
"""


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def may_import_ros(module):
    return module == ROS_LAYER or module.startswith(ROS_LAYER + ".") or module in ROS_MODULES


def imports(path, at_module_level=False):
    """Return the names that a file imports; inside functions too unless told otherwise."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = tree.body if at_module_level else ast.walk(tree)
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


@pytest.mark.parametrize("path", SOURCES, ids=module_of)
def test_only_the_ros_layer_imports_ros(path):
    found = {name for name in imports(path) if name.partition(".")[0] in ROS}
    assert may_import_ros(module_of(path)) or not found


@pytest.mark.parametrize("path", SOURCES, ids=module_of)
def test_only_the_ros_layer_imports_the_ros_layer(path):
    found = {name for name in imports(path, at_module_level=True) if may_import_ros(name)}
    assert may_import_ros(module_of(path)) or not found


def test_only_robot_imports_pinocchio_and_only_the_engine_imports_pybullet():
    users = {name: {module_of(p) for p in SOURCES if name in imports(p)}
             for name in ("pinocchio", "pybullet")}  # fmt: skip
    assert users == {
        "pinocchio": {"eulerparams_control.robot"},
        "pybullet": {"sim_bridge.engine"},
    }


def test_all_that_is_not_the_ros_layer_imports_where_there_is_no_ros():
    modules = [m for m in map(module_of, SOURCES) if not may_import_ros(m)]
    code = BLOCK.format(ros=ROS, modules=modules)
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False
    )
    assert result.stdout.strip().endswith(f"imported {len(modules)}"), result.stderr
