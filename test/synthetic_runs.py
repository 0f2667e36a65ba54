"""Bags of an arm so simple that every number of a run can be worked out by hand.

A hinge turns a rod of 1 m about the base's y axis: R = R_y(q), p = (cos q, 0, -sin q).
So the angle to the desired frame at q = 0 is |q|, the distance to it 2 sin(|q| / 2), and
the angle to the pole of XYZ 90 deg - |q|.  A second joint, which rests, rolls the rod about
itself.  The columns of J are orthogonal, of norm sqrt(2) and 1: its singular values.

The sensor is 0.2 m before the tip, turned by 90 deg about the rod: its y is the tip's z.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Transform, Vector3, WrenchStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.quantities import METRICS, measure
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags import Bag, BagWriter
from eulerparams_control.bags.format import Topic
from eulerparams_control.bags.reader import RawMessage
from eulerparams_control.messages.keys import BEGAN
from eulerparams_control.messages.to_ros import motion_to_ros, stamp_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

URDF = """<robot name="rod">
<link name="base"/><link name="tip"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-4" upper="4" velocity="3" effort="10"/></joint>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="roll" type="revolute"><parent link="arm"/><child link="rod"/><axis xyz="1 0 0"/>
<limit lower="-4" upper="4" velocity="3" effort="10"/></joint>
<link name="rod"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="1 0 0"/></joint>
<link name="sensor"/>
<joint name="mount" type="fixed"><parent link="rod"/><child link="sensor"/>
<origin xyz="0.8 0 0" rpy="1.5707963267948966 0 0"/></joint>
</robot>"""

DISTANCE = 0.01  # [m] of a reference that moves
PERIOD_NS = 10_000_000
_LATENCY_NS = 400_000  # of an effort behind the joint_states that it answers
_START = 1_700_000_000_000_000_000
_TYPES = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_reference": "sensor_msgs/msg/JointState",
    "/joint_effort": "sensor_msgs/msg/JointState",
    "/reference": "trajectory_msgs/msg/MultiDOFJointTrajectory",
    "/robot_description": "std_msgs/msg/String",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/wrench": "geometry_msgs/msg/WrenchStamped",
    "/target_wrench": "geometry_msgs/msg/WrenchStamped",
    "/compliant_frame": "trajectory_msgs/msg/MultiDOFJointTrajectory",
}


def write_run(
    folder: Path,
    measured: Sequence[float],
    command: Sequence[float] | None = None,
    *,
    speeds: Sequence[float] | None = None,
    efforts: Sequence[float] | None = None,
    desired: bool = True,
    urdf: str = URDF,
    parameters: Mapping[str, Any] | None = None,
    node: str = "",
    lasting: float = 0.0,
    began: int | None = None,
    wrenches: Sequence[Sequence[float]] | None = None,
    sensor: str = "tip",
    compliant: Sequence[DesiredFrame] | None = None,
    targets: Sequence[Sequence[float]] = (),
    impedances: Mapping[int, Callable[[Any], JointState]] = MappingProxyType({}),
) -> Path:
    """Write a bag with a sample every 10 ms; return its folder.

    With efforts the reference comes after the first joint_states, and before its answer.

    Args:
        folder: of the bag.
        measured, command: q [rad] in joint_states and joint_reference.
        speeds: [rad/s] of the command, or of the measured motion if there is none.
        efforts: [Nm] of the hinge in joint_effort; None leaves it out.
        desired: whether a reference keeps the tip at q = 0.
        urdf: in robot_description; "" leaves it out.
        parameters: of the node; None leaves all parameters out.
        node: their node; "" is that of the command.
        lasting: [s] of a reference that moves the tip by ``DISTANCE``; 0 is one that rests.
        began: when the controller says that the reference began, after the first stamp [ns].
        wrenches: force and moment (6,) in wrench, before joint_states; None leaves it out.
        sensor: the frame that they are in.
        compliant: the frames in compliant_frame; None leaves it out.
        impedances: what makes ~/impedance with a stamp, by the sample from which it acts.
        targets: force and moment (6,) in the first messages of target_wrench, in the tip's frame.
    """
    node = node or ("/clik" if efforts is None else "/dynamic_control")
    referred = _START if efforts is None else _START + _LATENCY_NS // 2
    with BagWriter(folder) as bag:
        own = {f"{node}/impedance": _TYPES["/joint_states"]} if impedances else {}
        for name, kind in (_TYPES | own).items():
            bag.add_topic(Topic(name, kind))
        if parameters is not None:
            nodes = {node: {"ros__parameters": dict(parameters)}}
            bag.attach("parameters.yaml", yaml.safe_dump(nodes))
        if urdf:
            bag.write("/robot_description", serialize_message(String(data=urdf)), _START, _START)
        for index, q in enumerate(measured):
            stamp = _START + index * PERIOD_NS
            dq = 0.0 if speeds is None or command is not None else speeds[index]
            if wrenches is not None:
                bag.write("/wrench", _wrench(stamp, wrenches[index], sensor), stamp, stamp)
            if index < len(targets):
                bag.write("/target_wrench", _wrench(stamp, targets[index], "tip"), stamp, stamp)
            bag.write("/joint_states", _joint_state(stamp, q, dq), stamp, stamp)
            if desired and index == 0:
                reference = serialize_message(_reference(lasting))
                bag.write("/reference", reference, referred, referred)
            if began is not None and index == 20:
                bag.write("/diagnostics", _diagnostics(node, _START + began), stamp, stamp)
            if index in impedances:
                data = serialize_message(impedances[index](stamp_to_ros(stamp)))
                bag.write(f"{node}/impedance", data, stamp, stamp)
            if compliant is not None:
                data = _compliant(stamp, compliant[index])
                bag.write("/compliant_frame", data, stamp, stamp)
            if command is not None:
                dq = 0.0 if speeds is None else speeds[index]
                bag.write("/joint_reference", _joint_state(stamp, command[index], dq), stamp, stamp)
            if efforts is not None:
                answered = stamp + _LATENCY_NS
                bag.write("/joint_effort", _joint_effort(stamp, efforts[index]), answered, answered)
    return folder


def recorded(folder: Path, *args: Any, **options: Any) -> Recording:
    """Return the recording of a run, see ``write_run``."""
    return load(write_run(folder, *args, **options))


def write_messages(
    folder: Path, topics: Mapping[str, str], messages: Iterable[RawMessage], parameters: str = ""
) -> Path:
    """Write a bag of these topics and their types, with no parameters but those given, in YAML."""
    with BagWriter(folder) as writer:
        if parameters:
            writer.attach("parameters.yaml", parameters)
        for name, kind in topics.items():
            writer.add_topic(Topic(name, kind))
        for topic, log_time, publish_time, data in messages:
            writer.write(topic, data, log_time, publish_time)
    return folder


def rewritten(
    source: Path,
    folder: Path,
    change: Callable[[RawMessage, int], RawMessage | None],
    parameters: str = "",
    topic: str = "",
) -> Path:
    """Write a bag again, each message as ``change`` returns it of its number in its topic.

    None leaves it out.  Those of other topics stay as they are if a topic is given.
    """
    counts: dict[str, int] = {}
    messages = []
    for message in Bag(source).read_raw():
        counts[message.topic] = counts.get(message.topic, -1) + 1
        if topic in ("", message.topic):
            changed = change(message, counts[message.topic])
            messages += [changed] if changed else []
        else:
            messages.append(message)
    return write_messages(folder, topics_of(source), messages, parameters)


def topics_of(source: Path) -> dict[str, str]:
    return {name: info.type for name, info in Bag(source).topics.items()}


def arms_together(folder: Path, arms: Mapping[str, Path], said: Sequence[RawMessage] = ()) -> Path:
    """Write the bags of arms into one, each below its namespace but for what nodes say."""
    topics, messages = {"/diagnostics": _TYPES["/diagnostics"]}, list(said)
    for side, source in arms.items():
        for message in Bag(source).read_raw():
            below = "" if message.topic == "/diagnostics" else side
            messages.append(message._replace(topic=below + message.topic))
        topics |= {side + name: kind for name, kind in topics_of(source).items()}
    return write_messages(folder, topics, sorted(messages, key=lambda m: m.log_time))


def all_numbers(run: Recording) -> dict[str, float]:
    """Return every metric of a run; those that need options have some."""
    options: dict[str, dict[str, Any]] = {
        "period_growth": {"period": 0.01},
        "growth_rate": {"low": 7.0, "high": 10.0},
        "posture_cost": {"posture": [0.0, 0.0]},
        "force_ripple": {"window": 1.0},
        "escape_rate": {"low": 1.0, "high": 2.0},
        "memory_growth": {"node": "controller"},
    }
    return {name: measure(name, run, **options.get(name, {})) for name in METRICS}


def _joint_state(stamp: int, q: float, dq: float) -> bytes:
    names = ["roll", "gripper", "hinge"]
    message = JointState(name=names, position=[0.0, 9.0, q], velocity=[0.0, 9.0, dq])
    return _stamped(message, stamp)


def _joint_effort(stamp: int, tau: float) -> bytes:
    return _stamped(JointState(name=["roll", "gripper", "hinge"], effort=[0.5, 99.0, tau]), stamp)


def _wrench(stamp: int, wrench: Sequence[float], sensor: str) -> bytes:
    message = WrenchStamped()
    message.header.frame_id = sensor
    values = list(map(float, wrench))
    for part, (x, y, z) in (("force", values[:3]), ("torque", values[3:])):
        setattr(message.wrench, part, Vector3(x=x, y=y, z=z))
    return _stamped(message, stamp)


def _compliant(stamp: int, frame: DesiredFrame) -> bytes:
    return _stamped(motion_to_ros(Trajectory([0.0], [frame]), "base", "tip"), stamp)


def _stamped(message: Any, stamp: int) -> bytes:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    return bytes(serialize_message(message))


def _reference(lasting: float) -> MultiDOFJointTrajectory:
    at_zero = Transform(translation=Vector3(x=1.0))
    message = MultiDOFJointTrajectory(joint_names=["tip"])
    message.header.frame_id = "base"
    message.points = [MultiDOFJointTrajectoryPoint(transforms=[at_zero])]
    if lasting:
        away = Transform(translation=Vector3(x=1.0, z=DISTANCE))
        end = MultiDOFJointTrajectoryPoint(transforms=[away])
        end.time_from_start.nanosec = round(lasting * 1e9)
        message.points.append(end)
    return message


def _diagnostics(node: str, began: int) -> bytes:
    values = [KeyValue(key=BEGAN, value=str(began))]
    status = DiagnosticStatus(name=node.removeprefix("/"), values=values)
    return bytes(serialize_message(DiagnosticArray(status=[status])))
