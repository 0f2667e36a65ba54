"""Reports of a control node: ~/pose, ~/desired, ~/error, ~/lyapunov and /diagnostics."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import Cause, Mode, Why
from eulerparams_control.control.pace import Nearness
from eulerparams_control.errors import listed
from eulerparams_control.laws.inverse import sigma_min
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.keys import BEGAN, FROZEN, PACE, SATURATED, SLOWED
from eulerparams_control.messages.to_ros import (
    error_to_ros,
    lyapunov_to_ros,
    motion_to_ros,
    pose_to_ros,
    quaternion_to_ros,
    vector_to_ros,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.ros import diagnostics
from eulerparams_control.ros.publishers import names_of_publishers, publishers_of
from eulerparams_control.ros.state_input import StateInput

Values = dict[str, str | int | float]


class ControlReport:
    """The reports of a control node.

    Args:
        node: the node that reports.
        health: of the node.
        states: that the node answers.
        on_tf: whether the frames are on /tf, too, where tf2_msgs is installed.
    """

    def __init__(
        self, node: Node, health: diagnostics.Health, states: StateInput, *, on_tf: bool
    ) -> None:
        self._node, self._health, self._states = node, health, states
        self._next = 0
        self._cut = self._restarts = 0  # of the controller, a second ago
        self._said: Any = None
        self._began: int | None = None
        self._note = Why()
        self._pose = node.create_publisher(PoseStamped, "~/pose", 10)
        self._desired = node.create_publisher(MultiDOFJointTrajectory, "~/desired", 10)
        self._error = node.create_publisher(TwistStamped, "~/error", 10)
        self._lyapunov = node.create_publisher(Float64MultiArray, "~/lyapunov", 10)
        self._frames: Any = None
        if on_tf and find_spec("tf2_msgs"):
            self._tf = import_module("tf2_msgs.msg").TFMessage
            self._frames = node.create_publisher(self._tf, "/tf", 100)
        elif on_tf:
            health.complain("publish_tf: tf2_msgs is not installed; no frames on /tf")

    def note(self, why: Why) -> None:
        """Show a warning with the state from now on; Why() takes it back."""
        self._note = why
        self.forget()

    def forget(self) -> None:
        """Say the state again when it is said next, changed or not."""
        self._said = None

    def activated(self) -> None:
        """Count from now on."""
        self._cut = self._restarts = 0
        self.forget()

    def once_a_second(self, controller: Controller, states_topic: str, topic: str) -> None:
        """Complain of a motion that is more than the arm may do, of states that jump, of rivals.

        Args:
            controller: that is active.
            states_topic: of joint_states.
            topic: of the commands.
        """
        several = self._node.count_publishers(topic) > 1
        if several and len(rivals := publishers_of(self._node, topic)) > 1:
            self._health.complain(
                f"{listed(rivals)} publish {topic}: the arm obeys one at most; end "
                "or deactivate the others",
                error=True,
                about="rivals",
            )
        cut, self._cut = controller.guidance.saturated - self._cut, controller.guidance.saturated
        if cut > self._states.answers / 2:
            self._health.complain(
                f"limits have changed {cut} commands of the last second: the motion is faster than "
                "the arm may be, or the gains are too high",
                about="limits",
            )
        resets = controller.resets
        again, self._restarts = resets - self._restarts, resets
        if again > 1 and not controller.rate.is_too_low:
            names = names_of_publishers(self._node, states_topic)
            why = (
                "is a computer too busy (then let the robot run at a lower rate, or a simulated "
                "one in lock-step with use_sim_time), or was its clock set?"
            )
            if len(names) > 1:
                why = "expected one robot."
            self._health.complain(
                f"joint_states have jumped {again} times in the last second: {why} They are "
                f"published by {listed(names)}",
                error=True,
                about="restarts",
            )

    def unanswered(self, mode: Mode, why: Why, *, is_fault: bool = True) -> None:
        """Report why no state leads on; what the controller does is said again later."""
        self.forget()
        status = {"mode": mode.value, "cause": why.cause.value}
        level = diagnostics.ERROR if is_fault else diagnostics.WARN
        self._health.set(level, why.fault, why.remedy, **status)

    def answered(self, controller: Controller, t: int, period: int, orientation: str) -> bool:
        """Report what changed with the answer to a state; return whether its tick is due, too.

        Args:
            controller: that answered.
            t: stamp of the state [ns].
            period: of the reports of ticks [ns]; 0 for none.
            orientation: the representation.
        """
        began = controller.guidance.motion.began
        if began != self._began:  # who analyses a recording cannot know it else
            self._began = began
            if began is not None:
                self._health.values[BEGAN] = began
                self._health.publish()
        self.state(controller, orientation)
        if not period or self._next - period <= t < self._next:
            return False
        self._next = t + period
        return True

    def arm(
        self, controller: Controller, tick: Tick | None, q: Array, dq: Array, stamp: Any
    ) -> None:
        """Publish the pose, and desired frame, error and Lyapunov function of a tick, if heard.

        Args:
            controller: that answered.
            tick: of the law; None where it was not asked: the pose is the measured one then.
            q, dq: (n,) measured.
            stamp: of the state.
        """
        robot, stamp = controller.scheme.robot, Time(sec=stamp.sec, nanosec=stamp.nanosec)
        frame = robot.base_frame
        if self._pose.get_subscription_count():
            arm = robot.state(q, dq) if tick is None else tick.state
            self._pose.publish(pose_to_ros(arm.p_e, arm.R_e, stamp, frame))
        if tick is None:
            return
        if self._desired.get_subscription_count():
            desired = motion_to_ros(Trajectory([0.0], [tick.desired]), frame, robot.tip_frame)
            desired.header.stamp = stamp
            self._desired.publish(desired)
        if self._error.get_subscription_count():
            self._error.publish(error_to_ros(tick.dp_de, np.asarray(tick.x_de.error), stamp, frame))
        if self._lyapunov.get_subscription_count():
            lyapunov = controller.guidance.lyapunov()
            if lyapunov is not None:
                self._lyapunov.publish(lyapunov_to_ros(*lyapunov))

    def frames(
        self, controller: Controller, tick: Tick | None, q: Array, dq: Array, stamp: Any
    ) -> None:
        """Publish on /tf where the arm is, and the other frames of a tick.

        Args:
            controller: that answered, with a command or without.
            tick: of the law; None where it was not asked.
            q, dq: (n,) measured.
            stamp: of the state.
        """
        if self._frames is None:
            return
        robot = controller.scheme.robot
        arm = robot.state(q, dq)
        frames = {"actual": DesiredFrame(arm.p_e, arm.R_e)}
        if tick is not None:
            frames["desired"] = tick.desired
            if tick.command.frame is not None:
                frames["compliant"] = tick.command.frame
        name = self._node.get_fully_qualified_name().strip("/")  # two arms share /tf
        found = [TransformStamped(child_frame_id=f"{name}/{which}") for which in frames]
        for msg, frame in zip(found, frames.values(), strict=True):
            msg.header.stamp = Time(sec=stamp.sec, nanosec=stamp.nanosec)
            msg.header.frame_id = robot.base_frame
            msg.transform.translation = vector_to_ros(frame.p_d)
            msg.transform.rotation = quaternion_to_ros(frame.R_d)
        self._frames.publish(self._tf(transforms=found))

    def counts(self, controller: Controller) -> Values:
        """Return what a controller has counted, whether or not it moves."""
        motion = controller.guidance.motion
        return {
            PACE: controller.guidance.scale.now,
            SLOWED: motion.slowed,
            FROZEN: int(controller.scheme.is_frozen),
            "references ahead of joint_states [s]": motion.ahead,
            "references that never began": motion.lost,
            SATURATED: controller.guidance.saturated,
        }

    def show(self, controller: Controller, tick: Tick, parameters: ControlParameters) -> None:
        """Show the values of a tick in /diagnostics."""
        self._health.values.update(_values(controller, tick, parameters))

    def state(self, controller: Controller, orientation: str) -> None:
        """Report what the controller does, or why it holds still, if that has changed."""
        pace, now = controller.guidance.pace, controller.state
        rate, slowed = controller.guidance.scale.now, _slowed(controller)
        mode, why = now.mode, now.why
        near = pace.singularity, pace.limit, rate < 1
        slowly, note = controller.rate.why, self._note
        presses = controller.scheme.is_pressing
        said = mode, why.cause, why.fault, why.note, now.latch, orientation, presses
        saying = *said, slowed, slowly.note, *near
        if saying == self._said:
            return
        self._said = saying
        cause = why.cause or note.cause
        status = {"mode": mode.value, "cause": cause.value}
        if why.fault:
            self._health.set(diagnostics.ERROR, f"holding still: {why.fault}", now.remedy, **status)
            return
        slow = _nearness(controller)
        pressing = ", pressing with target_wrench" if presses else ""
        doing = f"active with {orientation}: {_doing(mode, why)}{pressing}"
        warns = bool(slow or slowly.note or cause)
        self._health.set(
            diagnostics.WARN if warns else diagnostics.OK,
            "; ".join(filter(None, (doing, slow, slowed, slowly.note, note.note))),
            "; ".join(filter(None, (now.remedy, slowly.remedy, note.remedy))) if warns else "",
            **status,
        )


_DOING = {
    Mode.WAITING: "waiting for a reference",
    Mode.HOLDING: "holding the measured pose",
    Mode.FOLLOWING: "following a reference",
    Mode.STOPPED: "holding the joints",
    Mode.RELEASING: "letting the arm come to rest",
    Mode.DISTRUSTING: "no commands until the states go on steadily",
}


def _doing(mode: Mode, why: Why) -> str:
    """Return what a controller without a fault does, in words."""
    if why.cause is Cause.STREAM_ENDED and not why.note:
        return "holding the last desired pose: the set-points have stopped"
    return f"{_DOING[mode]}, after {why.note}" if why.note else _DOING[mode]


def _slowed(controller: Controller) -> str:
    """Return by how much the trajectory that is followed is slowed for the limits, in words."""
    percent = round(100 * controller.guidance.motion.slowed)
    if controller.mode is not Mode.FOLLOWING or percent >= 100:
        return ""
    return (
        f"slowed to {percent} % for the limits of the tip: raise max_linear_speed, "
        "max_angular_speed and the accelerations, or give it more time"
    )


def _nearness(controller: Controller) -> str:
    """Return what the arm is near to, in words; "" if it is clear of all."""
    pace, words = controller.guidance.pace, []
    if pace.singularity is not Nearness.CLEAR:
        words.append(f"{pace.singularity.name.lower()} a kinematic singularity")
    if pace.limit is not Nearness.CLEAR:
        joint = controller.scheme.robot.joints[pace.joint]
        words.append(f"{pace.limit.name.lower()} the limit of {joint}")
    slowed = "slowed down, " if words and controller.guidance.scale.now < 1 else ""
    return slowed + " and ".join(words)


def _values(controller: Controller, tick: Tick, parameters: ControlParameters) -> Values:
    """Return what /diagnostics shows of a tick of any scheme."""
    arm = tick.state
    distance = parameters.representation().singularity_distance(tick.desired.R_d, arm.R_e)
    pace, length = controller.guidance.pace, controller.scheme.robot.length
    sigma = sigma_min(arm.J, length)
    return {
        "orientation": parameters.orientation,
        "distance to representation singularity [rad]": distance,
        "smallest singular value of J": sigma,
        "inverse of J": "damped" if sigma < parameters.damping_eps else "exact",
        "kinematic singularity": pace.singularity.name.lower(),
        "limit of a joint": pace.limit.name.lower(),
        "saturated": int(tick.saturated),
    }
