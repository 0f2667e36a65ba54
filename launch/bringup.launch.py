"""A robot, simulated or real, its controller, a watchdog for efforts, a recorder, the page."""

from collections.abc import Container, Iterator
from typing import Any

from ament_index_python.packages import get_packages_with_prefixes
from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.parameters.schemes import TORQUE, schemes
from eulerparams_control.resources import PACKAGE, config_folder
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros import arm_launch
from eulerparams_control.ros.arm_launch import (
    BRIDGE,
    RECORDER,
    WATCHDOG,
    RealArm,
    load_arm,
    merged,
    read_argument,
)

RSP = "robot_state_publisher"
VIEWS = config_folder() / "views"
FRAMES = "base_frame", "tip_frame"
SIMULATED = "ur5"  # where no robot is named

# What the watchdog has to know as its controller does, unless it is given otherwise.
SHARED = "base_frame", "tip_frame", "joints", "compensate_gravity", "tool_mass", "tool_com"

# The nodes of a controller, each with its file of config.
CONTROLLERS = {name: {name: name} for name in schemes()} | {
    "push_test": {"impedance_control": "impedance_control"},  # which commands nothing
    "admittance": {"impedance_control": "impedance_control", "clik": "clik_admittance"},
}
EFFORTS = tuple(name for name, scheme in schemes().items() if scheme.control == TORQUE)

# In an admittance the motion is sent to impedance_control, and clik follows the compliant frame
# alone: its other inputs get topics on which nobody sends.
FOLLOWS = {
    "reference": "compliant_frame",
    "target_pose": "~/target_pose",
    "target_twist": "~/target_twist",
    "~/target/feedback": "~/unused_feedback",
    "~/target/update": "~/unused_update",
}

BOOLEAN = "true", "false"
ARGUMENTS: dict[str, tuple[str, str, tuple[str, ...] | None]] = {
    "robot": ("", "simulated: of config/robots, ur5; real: of config/robots/real; or a path", None),
    "controller": ("clik", "what controls it", tuple(CONTROLLERS)),
    "sim": ("true", "false: the driver of a real robot runs", BOOLEAN),
    "use_sim_time": ("false", "time is that of /clock, for all nodes", BOOLEAN),
    "live": ("false", "serve the page on which a person moves the arm", BOOLEAN),
    "rviz": ("false", "show the arm in rviz2, if that is installed", BOOLEAN),
    "foxglove": ("false", "start foxglove_bridge, if that is installed", BOOLEAN),
    "foxglove_address": ("127.0.0.1", "that foxglove_bridge serves; 0.0.0.0: all", None),
    "record": ("false", "record all topics as a bag in this folder", BOOLEAN),
    "base_frame": ("", "that poses refer to; empty: that of the robot, or base_link", None),
    "tip_frame": ("", "that is controlled; empty: that of the robot, or tool0", None),
    "namespace": ("", "of all nodes, for one of several arms; empty: that of the robot", None),
    "position_controller": (
        "", "ros2_control's that takes positions; empty: that of the robot, or JointState", None),
    "effort_controller": (
        "", "ros2_control's that takes efforts; empty: that of the robot, or JointState", None),
    "watchdog": (
        "", "before driver_effort; with effort_controller always; empty: as the robot says",
        ("", *BOOLEAN)),
    "topics": ("{}", "other names of topics, YAML: {wrench: /sensor/wrench}", None),
    "parameters": ("{}", "of nodes, YAML: {clik: {k_Pp: 50.0}, watchdog: {timeout: 0.1}}", None),
    "params_file": ("", "YAML file of parameters, the last that counts", None),
}  # fmt: skip


def taken(controller: str, other: str) -> tuple[str, str]:
    """Return the message type that a controller of ros2_control takes, and its topic."""
    if not controller:
        return "joint_state", other
    if "trajectory" in controller:
        return "joint_trajectory", f"{controller}/joint_trajectory"
    return "forward", f"{controller}/commands"


def command_topics(given: dict[str, str]) -> dict[str, str]:
    """Return the topics of the commands, by what our nodes call them."""
    controllers = {"joint_reference": "position_controller", "driver_effort": "effort_controller"}
    return {name: taken(given[kind], name)[1] for name, kind in controllers.items()}


def refuse_unsuitable(arm: RealArm, controller: str) -> None:
    """Raise UnknownNameError for a controller that an arm does not take, or nobody knows."""
    for name in arm.controllers:
        if name not in CONTROLLERS:
            raise UnknownNameError(f"controller of '{arm.name}':", name, CONTROLLERS)
    if arm.controllers and controller not in arm.controllers:
        raise UnknownNameError(f"controller of '{arm.name}':", controller, arm.controllers)


def shown(package: str, installed: Container[str], **given: Any) -> Action:
    """Return what shows the arm, or a line that says what to install for it."""
    if package in installed:
        return Node(package=package, executable=package, **given)
    name = package.replace("_", "-")
    return LogInfo(msg=f"{package} is not installed: apt install ros-jazzy-{name}")


class Request:
    """What the arguments ask for.

    Attributes:
        given: the arguments, by name.
        controllers: nodes of the controller, each with its file of config.
        parameters: of nodes, by name: of the arm, then as given, then of params_file.
        robot: the simulated one; None for a real one.
        frames: those of base_frame and tip_frame that are known.
        takes_efforts: whether the arm takes efforts.
        is_guarded: whether they go through the watchdog.
        position_type, effort_type: the message types that the robot takes.
        topics: other names of topics, for all nodes.
    """

    def __init__(self, given: dict[str, str]) -> None:
        self.given, self.controllers = given, CONTROLLERS[given["controller"]]
        self.robot, own, arm = None, {}, RealArm()
        if self.asks("sim"):
            self.robot = load_robot(given["robot"] or SIMULATED)
            own = {"base_frame": self.robot.base_frame, "tip_frame": self.robot.tip_frame}
            # it takes JointState, and is no controller of ros2_control
            given["position_controller"] = given["effort_controller"] = ""
        elif given["robot"]:
            arm = load_arm(given["robot"])
            refuse_unsuitable(arm, given["controller"])
        asked = {name: topic for name, topic in command_topics(given).items() if name != topic}
        for name in arm_launch.ARGUMENTS:
            given[name] = given[name] or arm.arguments.get(name, "")
        self.frames = own | {name: given[name] for name in FRAMES if given[name]}
        self.takes_efforts = given["controller"] in EFFORTS
        is_behind = bool(given["effort_controller"]) or self.asks("watchdog")
        self.is_guarded = self.takes_efforts and is_behind
        self.position_type, _ = taken(given["position_controller"], "joint_reference")
        self.effort_type, _ = taken(given["effort_controller"], "driver_effort")
        topics = read_argument("topics", given["topics"])
        self.topics = command_topics(given) | {**arm.topics} | asked | arm_launch.topics_of(topics)
        parameters = read_argument("parameters", given["parameters"])
        layers = [arm.parameters, arm_launch.parameters_of(parameters)]
        if file := given["params_file"]:
            namespace = given["namespace"]
            layers.append(arm_launch.parameters_of_file(file, namespace, self.controllers))
        self.parameters = merged(*layers)

    def asks(self, name: str) -> bool:
        """Whether an argument is "true"."""
        return self.given[name] == "true"

    def node(
        self,
        name: str,
        own: dict[str, Any] | None = None,
        renamed: dict[str, str] | None = None,
    ) -> Node:
        """Return a node of this package with parameters and topics of its own."""
        values = {**(own or {}), **self.parameters.get(name, {})}
        file = config_folder() / f"{self.controllers.get(name, name)}.yaml"
        return Node(
            package=PACKAGE,
            executable=name,
            namespace=self.given["namespace"],
            parameters=[str(file), *self.clock, *arm_launch.parameter_files(values)],
            remappings=(self.topics | (renamed or {})).items(),
            output="screen",
        )

    @property
    def clock(self) -> list[dict[str, bool]]:
        """The parameters of a node whose time is that of /clock."""
        return [{"use_sim_time": True}] if self.asks("use_sim_time") else []

    @property
    def rotors(self) -> list[float]:
        """The inertia [kg m^2] of the rotors of a simulated robot, as a data sheet has it."""
        if self.robot is None:
            return []
        given = self.parameters.get(BRIDGE, {}).get("rotor_inertia")
        return list(given or self.robot.rotor_inertia)

    def shared(self) -> dict[str, Any]:
        """Return what the watchdog has to know as its controller does.

        Raises:
            ConfigurationError: if gravity would be commanded twice, or not at all, once it acts.
        """
        (controller,), name = self.controllers, "compensate_gravity"
        theirs, own = (self.parameters.get(node, {}) for node in (controller, WATCHDOG))
        adds = theirs.get(name, True)
        if own.get(name, adds) is not adds:
            raise ConfigurationError(
                f"{name} is {str(adds).lower()} for {controller}, and {str(not adds).lower()} for "
                f"{WATCHDOG}: the arm would fall or rise when that acts; give both the same"
            )
        return {key: theirs[key] for key in SHARED if key in theirs}


def robot(request: Request) -> Iterator[Action]:
    """Yield the simulated robot, and what publishes the frames of its links."""
    if request.robot is None:
        return
    own: dict[str, Any] = {
        "robot": request.given["robot"] or SIMULATED,
        "control": "torque" if request.takes_efforts else "position",
    }
    if request.asks("live"):
        own["external_wrench_timeout"] = 0.5  # [s] a push ends when its page has gone
    guarded = {"joint_effort": request.topics["driver_effort"]} if request.is_guarded else {}
    yield request.node(BRIDGE, own, guarded)
    if RSP in get_packages_with_prefixes():
        hidden = {"robot_description": "~/robot_description"}  # the bridge publishes it
        yield Node(
            package=RSP,
            executable=RSP,
            namespace=request.given["namespace"],
            parameters=[*request.clock, {"robot_description": request.robot.urdf}],
            remappings=hidden.items(),
        )


def law(request: Request) -> Iterator[Action]:
    """Yield the nodes of the controller, behind the watchdog if they need one."""
    if request.is_guarded:
        own = request.frames | request.shared()
        yield request.node(WATCHDOG, own | {"command_type": request.effort_type})
    admits = "joint_state" if request.takes_efforts else "none"
    types = {"clik": request.position_type, "impedance_control": admits}
    for name, file in request.controllers.items():
        own = {**request.frames, "command_type": types.get(name, "joint_state")}
        if name in EFFORTS and (rotors := request.rotors):
            own["rotor_inertia"] = rotors
        yield request.node(name, own, FOLLOWS if file == "clik_admittance" else {})


def views(request: Request) -> Iterator[Action]:
    """Yield what shows the arm, and what records it."""
    namespace, topics = request.given["namespace"], request.topics.items()
    if request.asks("live"):
        leading = next(iter(request.controllers))
        yield Node(
            package=PACKAGE,
            executable="live",
            namespace=namespace,
            arguments=["--attach", "--controller", leading],
            parameters=request.clock,
            remappings=topics,
            output="screen",
        )
    if request.asks("record"):
        yield request.node(RECORDER)
    installed = get_packages_with_prefixes()
    if request.asks("rviz"):
        base = request.frames.get("base_frame")
        fixed = ["-f", base] if base else []
        arguments = ["-d", str(VIEWS / "arm.rviz"), *fixed]
        given = {"namespace": namespace, "remappings": topics, "parameters": request.clock}
        yield shown("rviz2", installed, arguments=arguments, **given)
    if request.asks("foxglove"):
        address = request.given["foxglove_address"]
        yield shown("foxglove_bridge", installed, parameters=[*request.clock, {"address": address}])
        if "foxglove_bridge" in installed:
            layout = VIEWS / "foxglove.json"
            text = f"Foxglove: open ws://{address}:8765 and import the layout {layout}"
            yield LogInfo(msg=text)


def bringup(context: LaunchContext) -> list[Action]:
    """Return what is to be started for the arguments that are given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    request = Request(given)
    return [*robot(request), *law(request), *views(request)]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what is made of them."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text, choices=choices)
        for name, (default, text, choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=bringup)])
