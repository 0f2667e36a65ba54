"""From the types of the core to messages; ``from_ros.py`` has the way back."""

from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import (
    PoseStamped,
    Quaternion,
    Transform,
    Twist,
    TwistStamped,
    Vector3,
    WrenchStamped,
)
from numpy.typing import ArrayLike
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.rotations import Array, quaternion
from eulerparams_control.messages.keys import IMPEDANCE, SPRINGS
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

_MOST_SECONDS = 2**31 - 1  # 32 bits with a sign
_UPPER = np.triu_indices(3)


def stamp_to_ros(ns: int) -> Time:
    """Return nanoseconds as a stamp."""
    sec, nanosec = divmod(ns, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def duration_to_ros(seconds: float) -> Duration:
    """Return seconds as a duration; raises ConfigurationError if a message cannot hold them."""
    if not 0 <= seconds < _MOST_SECONDS:
        raise ConfigurationError(f"{seconds:g} s: expected 0 to {_MOST_SECONDS:g} s")
    sec, nanosec = divmod(round(seconds * 1e9), 1_000_000_000)
    return Duration(sec=sec, nanosec=nanosec)


def numbers_to_ros(values: Array | None) -> "array[float]":
    """Return (n,) as float64[], as rclpy takes it without looking at each number."""
    return array("d", b"" if values is None else values.tobytes())


def vector_to_ros(v: Array) -> Vector3:
    """Return (3,) as a message."""
    x, y, z = v.tolist()
    return Vector3(x=x, y=y, z=z)


def quaternion_to_ros(R: Array) -> Quaternion:
    """Return R (3, 3) as xyzw."""
    eta, eps = quaternion(R)
    x, y, z = eps.tolist()
    return Quaternion(x=x, y=y, z=z, w=float(eta))


def motion_to_ros(
    trajectory: Trajectory, base_frame: str, tip_frame: str
) -> MultiDOFJointTrajectory:
    """Return a trajectory as a reference that starts at receipt."""
    msg = MultiDOFJointTrajectory(joint_names=[tip_frame])
    msg.header.frame_id = base_frame
    for t, frame in zip(trajectory.times, trajectory.frames, strict=True):
        point = MultiDOFJointTrajectoryPoint(
            transforms=[Transform()], velocities=[Twist()], accelerations=[Twist()]
        )
        point.time_from_start = duration_to_ros(t)
        frame_to_ros(frame, point)
        msg.points.append(point)
    return msg


def frame_to_ros(frame: DesiredFrame, point: MultiDOFJointTrajectoryPoint) -> None:
    """Write a desired frame into a point that has one transform and twists."""
    pose, velocity, acceleration = point.transforms[0], point.velocities[0], point.accelerations[0]
    pose.rotation = quaternion_to_ros(frame.R_d)
    for v, part in (
        (frame.p_d, pose.translation),
        (frame.dp_d, velocity.linear),
        (frame.omega_d, velocity.angular),
        (frame.ddp_d, acceleration.linear),
        (frame.domega_d, acceleration.angular),
    ):
        part.x, part.y, part.z = v.tolist()


def pose_to_ros(p: Array, R: Array, stamp: Time, frame_id: str) -> PoseStamped:
    """Return p (3,) [m] and R (3, 3) as a pose."""
    msg = PoseStamped()
    msg.header.stamp, msg.header.frame_id = stamp, frame_id
    msg.pose.position.x, msg.pose.position.y, msg.pose.position.z = p.tolist()
    msg.pose.orientation = quaternion_to_ros(R)
    return msg


def error_to_ros(dp_de: Array, error: Array, stamp: Time, frame_id: str) -> TwistStamped:
    """Return the position error (3,) [m] and the orientation error (3,) as a twist."""
    msg = TwistStamped()
    msg.header.stamp, msg.header.frame_id = stamp, frame_id
    msg.twist.linear, msg.twist.angular = vector_to_ros(dp_de), vector_to_ros(error)
    return msg


def lyapunov_to_ros(V: float, dV: float, dV_measured: float) -> Float64MultiArray:
    """Return a Lyapunov function, its derivative by the paper and as measured, labelled."""
    label = "V, dV by the paper, dV measured"
    msg = Float64MultiArray(data=[float(V), float(dV), float(dV_measured)])
    msg.layout.dim.append(MultiArrayDimension(label=label, size=3, stride=3))
    return msg


def impedance_to_ros(translation: Impedance, rotation: Impedance, stamp: Time) -> JointState:
    """Return the matrices of an impedance by name, as positions of :data:`keys.IMPEDANCE`."""
    numbers = [matrix[_UPPER] for Z in (translation, rotation) for matrix in (Z.M, Z.D, Z.K)]
    return _named(IMPEDANCE, numbers, stamp)


def springs_to_ros(K_p: Array, K_o: Array, clips: Sequence[float], stamp: Time) -> JointState:
    """Return stiffnesses (3, 3) and clips by name, as positions of :data:`keys.SPRINGS`."""
    return _named(SPRINGS, [K_p[_UPPER], K_o[_UPPER], clips], stamp)


def _named(names: Sequence[str], numbers: Sequence[ArrayLike], stamp: Time) -> JointState:
    msg = JointState(name=list(names), position=np.concatenate(numbers).tolist())
    msg.header.stamp = stamp
    return msg


def wrench_to_ros(wrench: Array, stamp: Time, msg: WrenchStamped) -> None:
    """Write force and moment (6,) [N, Nm] and the stamp into a message."""
    msg.header.stamp = stamp
    force, torque = msg.wrench.force, msg.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = wrench.tolist()
