"""A robot, simulated or real, its controller, a watchdog for efforts, a recorder, the page."""

from collections.abc import Container
from typing import Any

import yaml
from ament_index_python.packages import get_packages_with_prefixes
from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.resources import PACKAGE, config_folder
from eulerparams_control.robot.catalogue import load_robot

RSP = "robot_state_publisher"
VIEWS = config_folder() / "views"
BRIDGE, WATCHDOG, RECORDER = OTHERS = "pybullet_bridge", "watchdog", "bag_recorder"

# The nodes of a controller, each with its file of config.
CONTROLLERS = {
    "clik": {"clik": "clik"},
    "dynamic_control": {"dynamic_control": "dynamic_control"},
    "impedance_control": {"impedance_control": "impedance_control"},
    "push_test": {"impedance_control": "impedance_control"},  # which commands nothing
    "admittance": {"impedance_control": "impedance_control", "clik": "clik_admittance"},
}
EFFORTS = "dynamic_control", "impedance_control"

# In an admittance the motion is sent to impedance_control, and clik follows the compliant frame.
FOLLOWS = {name: f"~/{name}" for name in ("target_pose", "target_twist")}
FOLLOWS["reference"] = "compliant_frame"

BOOLEAN = "true", "false"
ARGUMENTS: dict[str, tuple[str, str, tuple[str, ...] | None]] = {
    "robot": ("ur5", "simulated robot: a name of config/robots, or a path of such a file", None),
    "controller": ("clik", "what controls it", tuple(CONTROLLERS)),
    "sim": ("true", "false: the driver of a real robot runs", BOOLEAN),
    "live": ("false", "serve the page on which a person moves the arm", BOOLEAN),
    "rviz": ("false", "show the arm in rviz2, if that is installed", BOOLEAN),
    "foxglove": ("false", "start foxglove_bridge, if that is installed", BOOLEAN),
    "foxglove_address": ("127.0.0.1", "that foxglove_bridge serves; 0.0.0.0: all", None),
    "record": ("false", "record all topics as a bag in this folder", BOOLEAN),
    "base_frame": ("", "that poses refer to; empty: that of the robot, or base_link", None),
    "tip_frame": ("", "that is controlled; empty: that of the robot, or tool0", None),
    "namespace": ("", "of all nodes, for one of several arms", None),
    "position_controller": ("", "ros2_control's that takes positions; empty: JointState", None),
    "effort_controller": ("", "ros2_control's that takes efforts, behind the watchdog", None),
    "watchdog": ("false", "before driver_effort; with effort_controller always", BOOLEAN),
    "topics": ("{}", "other names of topics, YAML: {wrench: /sensor/wrench}", None),
    "parameters": ("{}", "of nodes, YAML: {clik: {k_Pp: 50.0}, watchdog: {timeout: 0.1}}", None),
    "params_file": ("", "YAML file for the controller, the last that counts", None),
}  # fmt: skip


def taken(controller: str, other: str) -> tuple[str, str]:
    """Return the message type that a controller of ros2_control takes, and its topic."""
    if not controller:
        return "joint_state", other
    if "trajectory" in controller:
        return "joint_trajectory", f"{controller}/joint_trajectory"
    return "forward", f"{controller}/commands"


def shown(package: str, installed: Container[str], **given: Any) -> Action:
    """Return what shows the arm, or a line that says what to install for it."""
    if package in installed:
        return Node(package=package, executable=package, **given)
    name = package.replace("_", "-")
    return LogInfo(msg=f"{package} is not installed: apt install ros-jazzy-{name}")


def bringup(context: LaunchContext) -> list[Action]:
    """Return what is to be started for the arguments that are given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    is_sim, controllers = given["sim"] == "true", CONTROLLERS[given["controller"]]
    parameters: dict[str, dict[str, Any]] = yaml.safe_load(given["parameters"])
    known = {*OTHERS, "clik", *EFFORTS}
    for name in parameters.keys() - known:
        raise UnknownNameError("node", name, known)
    if is_sim:  # it takes JointState, and is no controller of ros2_control
        given["position_controller"] = given["effort_controller"] = ""
    takes_efforts = given["controller"] in EFFORTS
    is_guarded = takes_efforts and bool(given["effort_controller"] or given["watchdog"] == "true")
    position_type, joint_reference = taken(given["position_controller"], "joint_reference")
    effort_type, driver_effort = taken(given["effort_controller"], "driver_effort")
    topics = {"joint_reference": joint_reference, "driver_effort": driver_effort}
    topics |= yaml.safe_load(given["topics"])

    frames = {name: given[name] for name in ("base_frame", "tip_frame") if given[name]}
    if is_sim:
        robot = load_robot(given["robot"])
        frames = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame, **frames}

    def node(name: str, file: str, own: dict[str, Any], renamed: dict[str, str]) -> Node:
        values = {**own, **parameters.get(name, {})}
        files = [str(config_folder() / f"{file}.yaml"), given["params_file"]]
        last = files[1:] if name in controllers and given["params_file"] else []
        return Node(
            package=PACKAGE,
            executable=name,
            namespace=given["namespace"],
            parameters=[files[0], *filter(None, [values]), *last],
            remappings=(topics | renamed).items(),
            output="screen",
        )

    installed, nodes = get_packages_with_prefixes(), []
    if is_sim:
        own = {"robot": given["robot"], "control": "torque" if takes_efforts else "position"}
        if given["live"] == "true":
            own["external_wrench_timeout"] = 0.5  # a push ends when its page has gone
        guarded = {"joint_effort": topics["driver_effort"]} if is_guarded else {}
        nodes.append(node(BRIDGE, BRIDGE, own, guarded))
        if RSP in installed:
            own = {"robot_description": robot.urdf}
            hidden = {"robot_description": "~/robot_description"}  # the bridge publishes it
            nodes.append(Node(package=RSP, executable=RSP, namespace=given["namespace"],
                              parameters=[own], remappings=hidden.items()))  # fmt: skip
    if is_guarded:
        nodes.append(node(WATCHDOG, WATCHDOG, {**frames, "command_type": effort_type}, {}))
    types = {"clik": position_type, "impedance_control": "joint_state" if takes_efforts else "none"}
    for name, file in controllers.items():
        own = {**frames, "command_type": types.get(name, "joint_state")}
        nodes.append(node(name, file, own, FOLLOWS if file == "clik_admittance" else {}))
    if given["live"] == "true":
        leading = next(iter(controllers))
        nodes.append(
            Node(
                package=PACKAGE,
                executable="live",
                namespace=given["namespace"],
                arguments=["--attach", "--controller", leading],
                remappings=topics.items(),
                output="screen",
            )
        )
    if given["record"] == "true":
        nodes.append(node(RECORDER, RECORDER, {}, {}))
    arguments = ["-d", str(VIEWS / "arm.rviz")]
    if "base_frame" in frames:
        arguments += ["-f", frames["base_frame"]]
    if given["rviz"] == "true":
        nodes.append(shown("rviz2", installed, arguments=arguments, namespace=given["namespace"],
                           remappings=topics.items()))  # fmt: skip
    if given["foxglove"] == "true":
        address = given["foxglove_address"]
        nodes.append(shown("foxglove_bridge", installed, parameters=[{"address": address}]))
        if "foxglove_bridge" in installed:
            layout = VIEWS / "foxglove.json"
            text = f"Foxglove: open ws://{address}:8765 and import the layout {layout}"
            nodes.append(LogInfo(msg=text))
    return nodes


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what is made of them."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text, choices=choices)
        for name, (default, text, choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=bringup)])
