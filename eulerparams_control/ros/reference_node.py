"""The node ``reference``: a desired motion, force and stiffness from parameters."""

import sys
from typing import Any

from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import InvalidMessageError, RobotError
from eulerparams_control.events import Event, tell
from eulerparams_control.messages.from_ros import JointStateReader, ns_from_ros
from eulerparams_control.messages.keys import LifecycleCause, WorkMode
from eulerparams_control.messages.to_ros import motion_to_ros, stamp_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.course import Course
from eulerparams_control.parameters.reference import ReferenceParameters
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.message_info import deserialized
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.qos import QOS, QOS_LATCHED, overridable
from eulerparams_control.ros.runtime import run

# Largest number of points: a controller takes some 50 ms to read them, and commands nothing then.
_MANY = 1000

# Without a robot description for longer [s] it complains.
_LONG = 5.0

_NO_ROBOT = "no robot description yet"


class Sender:
    """Sends a course on a topic, a message for each state that is due, with its stamp.

    Args:
        node: that sends.
        topic: of WrenchStamped.
        course: what is sent.
        frame: of the messages.
        rate: [Hz] at most; 0: a message for each state.
    """

    def __init__(self, node: Node, topic: str, course: Course, frame: str, rate: float) -> None:
        self._publisher = node.create_publisher(WrenchStamped, topic, QOS)
        self._course, self._frame = course, frame
        self._period = 1e9 / rate if rate else 0.0  # [ns]
        self.restart()

    def restart(self) -> None:
        """Begin with the next state."""
        self._began: int | None = None
        self._sent = 0

    @property
    def subscribers(self) -> int:
        """How many listen."""
        return int(self._publisher.get_subscription_count())

    def answer(self, msg: Any) -> None:
        """Send what belongs to a state, if it is due."""
        t = ns_from_ros(msg.header.stamp)
        if self._began is None or t < self._began:
            self._began, self._sent = t, t - int(self._period)
        if self._sent < t < self._sent + self._period:
            return
        self._sent = t
        values = self._course.at((t - self._began) / 1e9).tolist()
        sent = WrenchStamped(wrench=Wrench(force=_vector(values[:3]), torque=_vector(values[3:])))
        sent.header.stamp, sent.header.frame_id = stamp_to_ros(t), self._frame
        self._publisher.publish(sent)


def _vector(values: list[float]) -> Vector3:
    return Vector3(x=values[0], y=values[1], z=values[2])


class ReferenceNode(Node):
    """Sends one motion when its subscribers are there, and again when asked, or ends after it.

    Force and stiffness begin with it, and go on to the end; without a motion they begin at once.
    """

    parameters_type = ReferenceParameters

    def __init__(self) -> None:
        super().__init__("reference")
        self.done = False
        self._health = diagnostics.Health(self)
        self._params = declare(self, self.parameters_type)
        self._params.refuse_endless()
        self._pending = self._params.motion != "none"
        self._way_points = (
            self._params.way_points() if self._params.motion == "way_points" else None
        )
        if self._params.motion == "circle":
            self._params.circle()  # refuses now what the start of the motion would refuse
        self._robot: Robot | None = None
        self._latest, self._names = b"", list[bytes]()  # joint_states, and the joints of the arm
        self._sent, self._lasting = 0, 0  # [ns] of the motion
        self._begun: int | None = None  # when [ns] it did, as far as is known
        self._publisher = self.create_publisher(MultiDOFJointTrajectory, "reference", QOS)
        p = self._params
        frames = {"target_wrench": p.tip_frame, "target_stiffness": ""}
        self._streams = [
            Sender(self, topic, course, frames[topic], p.stream_rate)
            for topic, course in p.courses().items()
        ]
        self._health.set(diagnostics.OK, "waiting for a robot description", mode=WorkMode.WAITING)
        self._started = steady.now()
        self._subscribe()
        self.create_timer(0.05, self._try_send, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _subscribe(self) -> None:
        self.create_service(Trigger, "~/send", self._on_send)
        self.create_subscription(
            JointState,
            "joint_states",
            self._on_joint_states,
            **overridable(QOS),
            raw=True,
        )
        if self._params.robot_description:
            self._set_robot(self._params.robot_description)
        else:
            self.create_subscription(
                String,
                "robot_description",
                self._on_robot_description,
                **overridable(QOS_LATCHED),
            )

    def _set_robot(self, urdf: str) -> None:
        p = self._params
        self._robot = Robot(urdf, p.base_frame, p.tip_frame, p.joints)
        self._reader = JointStateReader(self._robot.joints)
        self._names = [joint.encode() for joint in self._robot.joints]
        self._health.set(diagnostics.OK, "ready", mode=WorkMode.READY)

    def _on_robot_description(self, msg: String) -> None:
        try:
            self._set_robot(msg.data)
        except RobotError as error:
            text, cause = f"robot_description refused: {error}", LifecycleCause.REFUSED
            self._health.set(diagnostics.ERROR, text, mode=WorkMode.WAITING, cause=cause)

    def _on_joint_states(self, serialized: bytes) -> None:
        if any(name in serialized for name in self._names):  # else it is one of others
            self._latest = serialized  # read when a motion starts from it
            if self._streams and not self._pending:
                try:
                    state = deserialized(serialized, JointState)
                except InvalidMessageError as error:
                    self._health.reject("joint_states", error)
                    return
                for stream in self._streams:
                    stream.answer(state)

    def _present_pose(self) -> DesiredFrame | str:
        """Return the pose of the arm measured last, or why there is none."""
        if self._robot is None:
            return _NO_ROBOT
        if not self._latest:
            return "no valid joint_states yet"
        try:
            _, q, dq = self._reader.from_ros(deserialized(self._latest, JointState))
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            self._latest = b""
            return "no valid joint_states"
        state = self._robot.state(q, dq)
        return DesiredFrame(state.p_e, state.R_e)

    def _try_send(self) -> None:
        """Send the motion of the parameters once subscribers and what it needs are there."""
        if not self._pending:
            self._end_when_over()
            return
        if self._robot is None:
            if steady.now() - self._started > _LONG:
                self._health.complain(f"{_NO_ROBOT}: is the robot running?", about="robot")
            return
        if reason := self._send_motion():
            self._health.complain(reason, about="motion")
        else:
            self._pending = False

    def _end_when_over(self) -> None:
        """End when the motion is over, by the stamps of joint_states, if it is sent once."""
        if not (self._params.once and self._latest):
            return
        try:
            stamp = ns_from_ros(deserialized(self._latest, JointState).header.stamp)
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            self._latest = b""
            return
        t = stamp or round(1e9 * steady.now())  # without stamps
        if self._begun is None or t < self._begun:  # a simulation was started again
            self._begun = t
        if t >= self._begun + self._lasting:
            text = "the motion is over; whether the arm followed it, its controller says"
            self.get_logger().info(text)
            self.done = True

    def _on_send(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Send the motion of the parameters again, as after a fault; a circle begins again here."""
        reason = self._send_motion()
        response.success = not reason
        response.message = f"not sent: {reason}" if reason else self._health.message
        self._pending = self._pending and bool(reason)
        return response

    def _send_motion(self) -> str:
        """Send the motion of the parameters; return why it was not sent, "" if it was.

        Whether it is followed, the controller says.
        """
        counts = [stream.subscribers for stream in self._streams]
        there = min([self._publisher.get_subscription_count(), *counts])
        wanted = self._params.wait_for_subscribers
        if self._params.motion == "none":
            return "the parameter motion is none"
        if self._robot is None:
            return _NO_ROBOT
        if there < wanted:
            return f"waiting for {wanted} subscribers of reference, {there} are there"
        if self._way_points is not None:
            self._send(self._way_points)
        elif isinstance(pose := self._present_pose(), str):
            return pose
        else:
            self._send(self._params.circle().trajectory(pose.p_d, pose.R_d))
        return ""

    def _send(self, trajectory: Trajectory) -> None:
        assert self._robot is not None
        msg = motion_to_ros(trajectory, self._robot.base_frame, self._robot.tip_frame)
        if len(msg.points) > _MANY:
            self._health.complain(
                f"a motion of {len(msg.points)} points takes the controller longer than its robot "
                "waits for a command; with fewer way-points or turns the arm need not brake"
            )
        self._publisher.publish(msg)
        self._lasting, self._begun = round(1e9 * trajectory.duration), None
        for stream in self._streams:
            stream.restart()
        self._sent += 1
        number = f", number {self._sent}" if self._sent > 1 else ""
        text = f"sent a motion of {trajectory.duration:g} s, {len(msg.points)} points{number}"
        self._health.set(diagnostics.OK, text, mode=WorkMode.DONE)
        tell(Event.SENT)

    def close(self) -> None:
        """Nothing has to be undone."""


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ReferenceNode, args)


if __name__ == "__main__":
    sys.exit(main())
