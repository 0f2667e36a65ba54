"""Trajectories of poses alone, and without times: as messages, through the controller."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from arms import HOME, UR5
from arms import pose_of as tip_pose
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, Twist, Vector3
from samples import about, generator
from test_shaper import LIMITS, Motion, assert_within
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.clik import Clik, ClikLaw
from eulerparams_control.laws.rotations import angle_between, exp, log
from eulerparams_control.messages.from_ros import motion_from_ros
from eulerparams_control.messages.to_ros import duration_to_ros, quaternion_to_ros, vector_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from representations import make

RATE = 500
X, Y, Z = np.eye(3)
START = tip_pose(UR5, HOME)
# A path passes its points within this [m, rad].
NEAR = 1e-4, math.radians(0.02)


def posed(p=(0.0, 0.0, 0.0), x=(0.0, 0.0, 0.0)):
    """Return a pose: that of the start moved by p (3,) [m] and turned by x (3,) [rad]."""
    return DesiredFrame(START.p_d + p, exp(np.array(x)) @ START.R_d)


def message(poses, times=None, *, stamp=0.0, signs=None, twists=None):
    """Return poses as planners and policies send them: without velocities, unless told."""
    msg = MultiDOFJointTrajectory(joint_names=[UR5.tip_frame])
    msg.header.frame_id = UR5.base_frame
    if stamp:
        ns = round(stamp * 1e9)
        msg.header.stamp = Time(sec=ns // 10**9, nanosec=ns % 10**9)
    for k, pose in enumerate(poses):
        turn = quaternion_to_ros(pose.R_d)
        if signs is not None and signs[k] < 0:
            turn.x, turn.y, turn.z, turn.w = -turn.x, -turn.y, -turn.z, -turn.w
        point = MultiDOFJointTrajectoryPoint(
            transforms=[Transform(translation=vector_to_ros(pose.p_d), rotation=turn)]
        )
        if times is not None:
            point.time_from_start = duration_to_ros(times[k])
        if twists is not None and twists[k] is not None:
            linear = Vector3(x=twists[k][0], y=twists[k][1], z=twists[k][2])
            point.velocities = [Twist(linear=linear)]
        msg.points.append(point)
    return msg


class Arm:
    """A controller on an arm that goes where it is told."""

    def __init__(self, limits=LIMITS, rate=RATE, **options):
        law = ClikLaw(make("euler_parameters", "XYZ", "hysteretic"), 100.0, 100.0)
        self.controller = Controller(
            Clik(UR5, law), ControllerOptions(motion=limits, **options), HOME
        )
        self.q, self.dq, self.k, self.rate = HOME, np.zeros(UR5.n), 0, rate
        self.desired = []

    @property
    def t(self):
        """Time [s] of the next state; it begins at 1 s."""
        return 1.0 + self.k / self.rate

    def send(self, msg):
        """Send a message."""
        motion, start = motion_from_ros(msg, UR5.base_frame, UR5.tip_frame, 0.1)
        self.controller.orders.follow(motion, start)

    def run(self, seconds, events=()):
        """Step; events are pairs of a time [s] and a message."""
        left = sorted(events, key=lambda event: event[0])
        until = self.t + seconds
        while self.t < until - 1e-9:
            while left and left[0][0] <= self.t + 1e-9:
                self.send(left.pop(0)[1])
            command = self.controller.step(round(self.t * 1e9), self.q, self.dq)
            self.q, self.dq = command.q, command.dq
            frame = self.controller.guidance.tick_now.desired
            self.desired.append(DesiredFrame.of(frame.row))
            self.k += 1
        return self

    @property
    def motion(self):
        """The desired motion so far."""
        columns = zip(*self.desired, strict=True)
        return Motion(*(np.array(column) for column in columns), self.controller.guidance.motion)


def assert_passes(motion, poses):
    """Assert that a motion passes poses in their order, as near as its samples show."""
    begin = 0
    for pose in poses:
        away = np.linalg.norm(motion.p[begin:] - pose.p_d, axis=1)
        angles = np.array([angle_between(R, pose.R_d) for R in motion.R[begin:]])
        score = away / NEAR[0] + angles / NEAR[1]
        k = int(np.argmin(score))
        # between two samples the nearest is on the line
        p, R = motion.p[begin + k], motion.R[begin + k]
        v, w = motion.v[begin + k], motion.w[begin + k]
        e_p, e_o = pose.p_d - p, log(pose.R_d @ R.T)
        dt = (v @ e_p + w @ e_o) / max(v @ v + w @ w, 1e-12)
        dt = min(max(dt, -1 / RATE), 1 / RATE)
        assert np.linalg.norm(e_p - dt * v) < NEAR[0]
        assert np.linalg.norm(e_o - dt * w) < NEAR[1]
        begin += max(k - 1, 0)


def assert_ends_at(motion, pose):
    assert np.linalg.norm(motion.p[-1] - pose.p_d) < 1e-9
    assert angle_between(motion.R[-1], pose.R_d) < 1e-7
    assert not motion.v[-1].any()
    assert not motion.w[-1].any()


def ripple(speeds, nominal):
    """Return the largest part by which speeds are away from the nominal one."""
    return np.abs(speeds / nominal - 1).max()


def line(count, step, turn=0.0):
    """Return poses on a line along y, ``step`` [m] and ``turn`` [rad] apart."""
    return [posed(k * step * Y, k * turn * X) for k in range(count)]


# --- poses with times ---------------------------------------------------------------------
def test_poses_10_mm_and_100_ms_apart_are_passed_at_an_even_speed():
    poses = line(31, 0.01, 0.02)
    arm = Arm()
    arm.send(message(poses, np.arange(31) * 0.1))
    motion = arm.run(4.0).motion
    assert_within(motion)
    assert_passes(motion, poses)
    assert_ends_at(motion, poses[-1])
    middle = slice(RATE, int(2.5 * RATE))
    assert ripple(np.linalg.norm(motion.v[middle], axis=1), 0.1) < 0.05
    assert ripple(np.linalg.norm(motion.w[middle], axis=1), 0.2) < 0.05
