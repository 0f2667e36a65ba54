"""The node ``reference``: a desired motion, force and stiffness from parameters."""

from collections.abc import Callable

from geometry_msgs.msg import WrenchStamped
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
from eulerparams_control.messages.to_ros import motion_to_ros, stamp_to_ros, wrench_to_ros
from eulerparams_control.motion.trajectories import Circle, Trajectory
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


class Sender:
    """Sends a course under the stamps of states, at a rate [Hz] at most; 0: for each of them."""

    def __init__(self, node: Node, topic: str, course: Course, frame: str, rate: float) -> None:
        self.publisher = node.create_publisher(WrenchStamped, topic, QOS)
        self._course, self._frame = course, frame
        self._period = 1e9 / rate if rate else 0.0  # [ns]
        self.restart()

    def restart(self) -> None:
        """Begin with the next state."""
        self._began: int | None = None
        self._sent = 0

    def answer(self, t: int) -> None:
        """Send what belongs to the state stamped t [ns], if it is due."""
        if self._began is None or t < self._began:
            self._began, self._sent = t, t - int(self._period)
        if self._sent < t < self._sent + self._period:
            return
        self._sent = t
        msg = WrenchStamped()
        msg.header.frame_id = self._frame
        wrench_to_ros(self._course.at((t - self._began) / 1e9), stamp_to_ros(t), msg)
        self.publisher.publish(msg)


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
        p = self._params
        p.refuse_endless()
        motions = {"none": lambda: None, "way_points": p.way_points, "circle": p.circle}
        self._motion: Trajectory | Circle | None = motions[p.motion]()  # refused now, not later
        self._pending = self._motion is not None
        self._robot: Robot | None = None
        self._latest, self._names = b"", list[bytes]()  # joint_states, and the joints of the arm
        self._sent, self._lasting = 0, 0  # [ns] of the motion
        self._begun: int | None = None  # when [ns] it did, as far as is known
        self._publisher = self.create_publisher(MultiDOFJointTrajectory, "reference", QOS)
        frames = {"target_wrench": p.tip_frame, "target_stiffness": ""}
        self._streams = [
            Sender(self, topic, course, frames[topic], p.stream_rate)
            for topic, course in p.courses().items()
        ]
        self._health.set(diagnostics.OK, "waiting for a robot description", mode=WorkMode.WAITING)
        self._started = steady.now()
        self.create_service(Trigger, "~/send", self._on_send)
        take, take_urdf = self._on_joint_states, self._on_robot_description
        self.create_subscription(JointState, "joint_states", take, **overridable(QOS), raw=True)
        if p.robot_description:
            self._set_robot(p.robot_description)
        else:
            latched = overridable(QOS_LATCHED)
            self.create_subscription(String, "robot_description", take_urdf, **latched)
        self.create_timer(0.05, self._try_send, clock=Clock(clock_type=ClockType.STEADY_TIME))

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
            if self._streams and not self._pending and (t := self._last(_stamp)) is not None:
                for stream in self._streams:
                    stream.answer(t)

    def _last[T](self, read: Callable[[JointState], T]) -> T | None:
        """Return what is read from the last joint_states; None if none came that can be read."""
        try:
            return read(deserialized(self._latest, JointState)) if self._latest else None
        except InvalidMessageError as error:
            self._health.reject("joint_states", error)
            self._latest = b""
            return None

    def _try_send(self) -> None:
        """Send the motion of the parameters once subscribers and what it needs are there."""
        if not self._pending:
            self._end_when_over()
            return
        try:
            self._send_motion()
        except InvalidMessageError as error:
            if self._robot is not None or steady.now() - self._started > _LONG:
                self._health.complain(str(error), about="motion")

    def _end_when_over(self) -> None:
        """End when the motion is over, by the stamps of joint_states, if it is sent once."""
        stamp = self._last(_stamp) if self._params.once else None
        if stamp is None:
            return
        t = stamp or round(1e9 * steady.now())  # without stamps
        if self._begun is None or t < self._begun:  # a simulation was started again
            self._begun = t
        if t >= self._begun + self._lasting:
            self.get_logger().info("the motion is over; its controller says how it was followed")
            self.done = True

    def _on_send(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Send the motion again, as after a fault; a circle begins again here."""
        try:
            self._send_motion()
            response.success, response.message = True, self._health.message
        except InvalidMessageError as error:
            response.message = f"not sent: {error}"
        return response

    def _send_motion(self) -> None:
        """Send the motion of the parameters; raises InvalidMessageError if it cannot be sent."""
        publishers = self._publisher, *(stream.publisher for stream in self._streams)
        there = min(publisher.get_subscription_count() for publisher in publishers)
        wanted = self._params.wait_for_subscribers
        if self._motion is None:
            raise InvalidMessageError("the parameter motion is none")
        if self._robot is None:
            raise InvalidMessageError("no robot description yet: is the robot running?")
        if there < wanted:
            raise InvalidMessageError(
                f"waiting for {wanted} subscribers of reference, {there} are there"
            )
        trajectory = self._motion
        if isinstance(trajectory, Circle):
            measured = self._last(self._reader.from_ros)
            if measured is None:
                raise InvalidMessageError("no valid joint_states yet")
            arm = self._robot.state(*measured[1:])
            trajectory = trajectory.trajectory(arm.p_e, arm.R_e)
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
        self._sent, self._pending = self._sent + 1, False
        number = f", number {self._sent}" if self._sent > 1 else ""
        text = f"sent a motion of {trajectory.duration:g} s, {len(msg.points)} points{number}"
        self._health.set(diagnostics.OK, text, mode=WorkMode.DONE)
        tell(Event.SENT)


def _stamp(msg: JointState) -> int:
    return ns_from_ros(msg.header.stamp)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(ReferenceNode, args)
