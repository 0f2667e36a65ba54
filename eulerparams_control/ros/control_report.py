"""What a control node says of itself, and of its arm: ~/status, /diagnostics, ~/pose and more."""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import Cause, Mode, Why, waiting
from eulerparams_control.control.pace import Nearness
from eulerparams_control.errors import listed
from eulerparams_control.laws.inverse import sigma_min
from eulerparams_control.laws.scheme import Tick
from eulerparams_control.messages.keys import BEGAN, FROZEN, PACE, SATURATED, SLOWED
from eulerparams_control.messages.to_ros import (
    error_to_ros,
    lyapunov_to_ros,
    motion_to_ros,
    pose_to_ros,
    quaternion_to_ros,
    stamp_to_ros,
    vector_to_ros,
)
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.ros.diagnostics import ERROR, OK, WARN, Health, Values
from eulerparams_control.ros.publishers import names_of_publishers, rivals
from eulerparams_control.ros.state_input import State, StateInput

# Time [s] for which the time of a motion stands until that is said.
_WAITS = 0.5


class ControlReport(Health):
    """The health of a control node, and what it publishes about its arm.

    Args:
        node: the node that reports.
        parameters: of the node; those that count here are fixed.
        states: of the arm.

    Attributes:
        note: a warning that is shown with the state; Why() is none.
    """

    def __init__(self, node: Node, parameters: ControlParameters, states: StateInput) -> None:
        super().__init__(node)
        self._states = states
        rate = parameters.state_rate
        self._period = int(1e9 / rate) if rate > 0 else 0  # of ~/pose and the like [ns]
        self._next = 0  # when they are due [ns]
        # whose commands limits had changed, and whose states had jumped, so often a second ago
        self._counted: tuple[Controller | None, int, int] = None, 0, 0
        self._began: int | None = None
        self._shown: Tick | None = None
        self.note = Why()
        self._said: Any = None  # what the state is made of, and its text
        self._pose = node.create_publisher(PoseStamped, "~/pose", 10)
        self._desired = node.create_publisher(MultiDOFJointTrajectory, "~/desired", 10)
        self._error = node.create_publisher(TwistStamped, "~/error", 10)
        self._lyapunov = node.create_publisher(Float64MultiArray, "~/lyapunov", 10)
        self._frames: Any = None
        if parameters.publish_tf and find_spec("tf2_msgs"):
            self._tf = import_module("tf2_msgs.msg").TFMessage
            self._frames = node.create_publisher(self._tf, "/tf", 100)
        elif parameters.publish_tf:
            self.complain("publish_tf: tf2_msgs is not installed; no frames on /tf")

    # --- status --------------------------------------------------------------------------

    def say(self, controller: Controller, *, is_answered: bool = False) -> None:
        """Say what the controller does, or why no state leads on.

        ``is_answered``: a state has come, however long ago, and has its answer now.
        """
        states, mode, level = self._states, controller.mode, ERROR
        if fault := states.source.dispute.fault:
            why = states.source.dispute._replace(fault=f"{fault}: no commands")
        elif not is_answered and states.is_silent:
            why = states.silent()
        elif states.stands and controller.state.is_led:
            why, mode = states.standing(), Mode.HOLDING
            level = WARN if states.is_simulated else ERROR
        else:
            self._say_mode(controller)
            return
        self.set(level, why.fault, why.remedy, mode=mode, cause=why.cause)

    def _say_mode(self, controller: Controller) -> None:
        """Say what the controller does, or why it holds still."""
        now, scheme, pace = controller.state, controller.scheme, controller.guidance.pace
        why, rate, note = now.why, controller.rate.why, self.note
        if not note.cause and controller.guidance.waited > _WAITS:
            note = waiting(scheme.behind)
        orientation, slowed = scheme.parameters.orientation, _slowed(controller)
        # without the joint that is near a limit, which may change often
        key = (
            *(now.mode, why, now.latch, rate, note, orientation, scheme.is_pressing, slowed),
            *(pace.singularity, pace.limit, controller.guidance.scale.now < 1),
        )
        if (key, self.message) == self._said:
            return
        level, text, remedy = ERROR, f"holding still: {why.fault}", now.remedy
        cause = why.cause or note.cause
        if not why.fault:
            pressing = ", pressing with target_wrench" if scheme.is_pressing else ""
            doing = f"active with {orientation}: {_doing(now.mode, why)}{pressing}"
            near = _nearness(controller)
            level = WARN if near or rate.note or cause else OK
            text = "; ".join(filter(None, (doing, near, slowed, rate.note, note.note)))
            remedies = (now.remedy, rate.remedy, note.remedy) if level == WARN else ()
            remedy = "; ".join(filter(None, remedies))
        self.set(level, text, remedy, mode=now.mode, cause=cause)
        self._said = key, self.message

    # --- /diagnostics --------------------------------------------------------------------

    def once_a_second(self, controller: Controller, commands: str) -> None:
        """Complain of who else commands, of a motion that is too fast, of states that jump.

        ``commands`` is the topic of the commands.
        """
        if names := rivals(self._node, commands):
            self.complain(
                f"{listed(names)} publish {commands}: the arm obeys one at most; end "
                "or deactivate the others",
                error=True,
                about="rivals",
            )
        cut, jumps = controller.guidance.saturated, controller.resets
        before, self._counted = self._counted, (controller, cut, jumps)
        if before[0] is controller:
            cut, jumps = cut - before[1], jumps - before[2]
        if cut > self._states.answers / 2:
            self.complain(
                f"limits have changed {cut} commands of the last second: the motion is faster than "
                "the arm may be, or the gains are too high",
                about="limits",
            )
        self.values["joint_states missed"] = controller.rate.missed
        if jumps > 1 and not controller.rate.is_too_low:
            names = names_of_publishers(self._node, self._states.subscription.topic_name)
            self.complain(
                f"joint_states of {listed(names)} have jumped {jumps} times in the last second; "
                "expected one robot, whose clock goes steadily: if its computer is too busy let "
                "it run at a lower rate, or a simulated one in lock-step with use_sim_time",
                error=True,
                about="restarts",
            )

    def show(self, controller: Controller, more: Callable[[Tick], Values]) -> None:
        """Show in /diagnostics what a controller has counted, and its last tick, if it is new.

        ``more`` returns what the scheme shows of a tick.
        """
        guidance, scheme = controller.guidance, controller.scheme
        tick = guidance.tick_now
        self.values |= {
            PACE: guidance.scale.now,
            SLOWED: guidance.motion.slowed,
            FROZEN: int(scheme.is_frozen),
            "references ahead of joint_states [s]": guidance.motion.ahead,
            "references that never began": guidance.motion.lost,
            SATURATED: guidance.saturated,
        }
        if tick is None or tick is self._shown:
            return
        self._shown, parameters, pace = tick, scheme.parameters, guidance.pace
        turns, sigma = parameters.representation(), sigma_min(tick.state.J, scheme.robot.length)
        distance = turns.singularity_distance(tick.desired.R_d, tick.state.R_e)
        self.values |= {
            "orientation": parameters.orientation,
            "distance to representation singularity [rad]": distance,
            "smallest singular value of J": sigma,
            "inverse of J": "damped" if sigma < parameters.damping_eps else "exact",
            "kinematic singularity": pace.singularity.name.lower(),
            "limit of a joint": pace.limit.name.lower(),
            "saturated": int(tick.saturated),
            **more(tick),
        }

    # --- the arm -------------------------------------------------------------------------

    def answered(self, controller: Controller, *, is_commanded: bool) -> None:
        """Report what changed with the answer to the last state, and the arm if that is due."""
        guidance, states = controller.guidance, self._states
        if guidance.motion.began != self._began:  # who analyses a recording cannot know it else
            self._began = guidance.motion.began
            if self._began is not None:
                self.values[BEGAN] = self._began
                self.publish()
        self.say(controller, is_answered=True)
        state = states.measured
        assert state is not None
        t = state[0]
        if not self._period or self._next - self._period <= t < self._next:
            return
        self._next = t + self._period
        is_asked = guidance.ticked == t and not controller.fault
        tick = guidance.tick_now if is_asked else None
        if is_commanded:
            self._publish_arm(controller, tick, state)
        if self._frames is not None and not states.source.dispute.fault:  # else: whose state is it?
            self.attempt(lambda: self._publish_frames(controller, tick, state), "/tf")

    def _publish_arm(self, controller: Controller, tick: Tick | None, state: State) -> None:
        """Publish what somebody listens to of the arm, and of a tick that answers its state."""
        robot, stamp = controller.scheme.robot, stamp_to_ros(state[0])
        frame = robot.base_frame
        if self._pose.get_subscription_count():
            arm = robot.state(*state[1:]) if tick is None else tick.state
            self._pose.publish(pose_to_ros(arm.p_e, arm.R_e, stamp, frame))
        if tick is None:
            return
        if self._desired.get_subscription_count():
            desired = motion_to_ros(Trajectory([0.0], [tick.desired]), frame, robot.tip_frame)
            desired.header.stamp = stamp
            self._desired.publish(desired)
        if self._error.get_subscription_count():
            self._error.publish(error_to_ros(tick.dp_de, np.asarray(tick.x_de.error), stamp, frame))
        if self._lyapunov.get_subscription_count() and (V := controller.guidance.lyapunov()):
            self._lyapunov.publish(lyapunov_to_ros(*V))

    def _publish_frames(self, controller: Controller, tick: Tick | None, state: State) -> None:
        """Publish on /tf where the arm is, and the other frames of a tick."""
        robot, (t, q, dq) = controller.scheme.robot, state
        arm = robot.state(q, dq)
        frames = {"actual": DesiredFrame(arm.p_e, arm.R_e)}
        if tick is not None:
            frames["desired"] = tick.desired
            if tick.command.frame is not None:
                frames["compliant"] = tick.command.frame
        name, transforms = self._node.get_fully_qualified_name().strip("/"), []
        for which, frame in frames.items():
            msg = TransformStamped(child_frame_id=f"{name}/{which}")  # two arms share /tf
            msg.header.stamp, msg.header.frame_id = stamp_to_ros(t), robot.base_frame
            msg.transform.translation = vector_to_ros(frame.p_d)
            msg.transform.rotation = quaternion_to_ros(frame.R_d)
            transforms.append(msg)
        self._frames.publish(self._tf(transforms=transforms))


_DOING = {
    Mode.WAITING: "waiting for a reference",
    Mode.HOLDING: "holding the measured pose",
    Mode.FOLLOWING: "following a reference",
    Mode.STOPPED: "holding the joints",
    Mode.RELEASING: "letting the arm come to rest",
    Mode.DISTRUSTING: "no commands until the states go on steadily",
}


def _doing(mode: Mode, why: Why) -> str:
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
    pace, words = controller.guidance.pace, []
    if pace.singularity is not Nearness.CLEAR:
        words.append(f"{pace.singularity.name.lower()} a kinematic singularity")
    if pace.limit is not Nearness.CLEAR:
        joint = controller.scheme.robot.joints[pace.joint]
        words.append(f"{pace.limit.name.lower()} the limit of {joint}")
    slowed = "slowed down, " if words and controller.guidance.scale.now < 1 else ""
    return slowed + " and ".join(words)
