"""The direction of imports: down the floors, and only nodes import ROS."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROS = {"rclpy", "ament_index_python", "builtin_interfaces", "rosgraph_msgs", "rcl_interfaces"}
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for room in ("eulerparams_control", "sim_bridge")
    for path in (ROOT / room).rglob("*.py")
}
# From the ground up: a module imports what is on its own floor or below.
FLOORS = (
    ("errors", "events", "resources", "command_line", "parameters.fields", "parameters.real_time"),
    ("laws.jit", "laws.rotations"),
    ("motion",),
    ("laws.impedance_matrices", "laws.orientation", "motion.way_points"),
    ("robot.urdf",),
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


def imports(path):
    """Return the modules that a file imports, inside functions too."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= (inside & MODULES.keys()) or {node.module}
    return names


def floor(module):
    """Return the floor whose prefix of a module is the longest; the package itself is below all."""
    name = module.removeprefix("eulerparams_control").removeprefix(".")
    places = [
        (len(p), k) for k, ps in enumerate(FLOORS) for p in ps if f"{name}.".startswith(f"{p}.")
    ]
    return max(places)[1] if name else 0


def test_imports_go_down_and_only_nodes_and_what_makes_messages_import_ros():
    for module, path in MODULES.items():
        names, parts = imports(path), module.split(".")
        assert {n for n in names & MODULES.keys() if floor(n) > floor(module)} == set(), module
        packages = {name.partition(".")[0] for name in names}
        is_ros = packages & ROS or any(name.endswith(("_msgs", "_srvs")) for name in packages)
        assert not is_ros or "ros" in parts or parts[-1].endswith("_node") or "messages" in parts
        assert "pinocchio" not in packages or parts[-2] == "robot" or "laws" in parts, module
        assert "pybullet" not in packages or module == "sim_bridge.engine", module
