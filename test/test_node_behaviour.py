"""The nodes as processes of their own, spoken to over DDS."""

import math
import signal
import subprocess
import sys

import numpy as np
import pytest
from dds_tester import QUIET, FakeRobot, Tester, stamp
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Transform, WrenchStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import (
    JointTrajectory,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from eulerparams_control.catalogue import load_robot
from eulerparams_control.experiments.processes import module_of
from eulerparams_control.motion import DesiredFrame, Trajectory
from eulerparams_control.resources import config_folder
from eulerparams_control.robot import Robot
from eulerparams_control.ros.conversions import motion_to_ros
from eulerparams_control.rotations import exp

UR5 = load_robot("ur5")
FRAMES = {"base_frame": UR5.base_frame, "tip_frame": UR5.tip_frame}
STILL = [0.0] * 6


@pytest.fixture
def tester(tmp_path):
    tester = Tester(tmp_path / "nodes")
    yield tester
    tester.close()


@pytest.fixture
def clik(tester):
    """Return a running clik with its fake robot, its commands, and the tester."""
    return start_clik(tester, {})


class Clik:
    def __init__(self, tester, robot, commands):
        self.tester, self.robot, self.commands = tester, robot, commands

    def tick(self, **changes):
        """Send one state and return the command that answers it."""
        self.robot.send(**changes)
        wanted = self.robot.number
        self.tester.until(
            lambda: any(stamp(c) == wanted for c in self.commands), f"the command stamped {wanted}"
        )
        return next(c for c in self.commands if stamp(c) == wanted)

    def silent_after(self, send):
        """Return whether no command follows from what ``send`` sends."""
        self.tester.spin(QUIET)
        before = len(self.commands)
        send()
        self.tester.spin(QUIET)
        return len(self.commands) == before


def start_clik(tester, parameters, kind=JointState, namespace=""):
    robot, commands = FakeRobot(tester, UR5, namespace), []
    tester.listen(kind, f"{namespace}/joint_reference", commands)
    tester.nodes.start("clik", FRAMES | {"state_timeout": 60.0} | parameters, namespace or "/")
    tester.until(lambda: commands, "the first command", again=robot.send)
    tester.spin(QUIET)
    return Clik(tester, robot, commands)


def parameter(name, value):
    kinds = {bool: ("bool_value", ParameterType.PARAMETER_BOOL),
             float: ("double_value", ParameterType.PARAMETER_DOUBLE),
             str: ("string_value", ParameterType.PARAMETER_STRING)}  # fmt: skip
    field, kind = kinds[type(value)]
    message = Parameter(name=name, value=ParameterValue(type=kind))
    setattr(message.value, field, value)
    return message


def set_parameters(tester, node, **values):
    request = SetParameters.Request(parameters=[parameter(*item) for item in values.items()])
    return tester.call(SetParameters, f"{node}/set_parameters", request).results


def pose_of(q):
    state = Robot(UR5.urdf, UR5.base_frame, UR5.tip_frame).state(np.array(q), np.zeros(6))
    return DesiredFrame(state.p_e, state.R_e)


def reference_to(frame, seconds=1.0):
    return motion_to_ros(Trajectory([seconds], [frame]), UR5.base_frame, UR5.tip_frame)


def moved_frame(distance=0.01, angle=0.1):
    frame = pose_of(UR5.home)
    R_d = exp(np.array([0.0, 0.0, angle])) @ frame.R_d
    return DesiredFrame(frame.p_d + np.array([0.0, 0.0, distance]), R_d)


# --- clik: one state, one command --------------------------------------------------------


def test_one_state_gives_one_command_under_its_stamp(clik):
    before = len(clik.commands)
    for _ in range(20):
        clik.tick()
    clik.tester.spin(QUIET)
    stamps = [stamp(c) for c in clik.commands[before:]]
    assert stamps == list(range(clik.robot.number - 19, clik.robot.number + 1))


def test_without_a_reference_the_measured_pose_is_held(clik):
    command = clik.tick()
    assert list(command.name) == list(UR5.joints)
    assert list(command.position) == list(UR5.home)
    assert list(command.velocity) == STILL


def test_joint_states_are_matched_by_name_whatever_their_order(clik):
    q = np.array(UR5.home)
    order = [3, 0, 5, 1, 4, 2]
    names = [UR5.joints[i] for i in order] + ["gripper"]
    command = clik.tick(
        name=names, position=[*q[order].tolist(), 9.0], velocity=[*STILL, 9.0], ms=10_000_000
    )  # a stamp far ahead: it begins anew at what it reads
    assert list(command.position) == q.tolist()


def test_a_repeated_state_gets_the_same_command_again(clik):
    first = clik.tick()
    before = len(clik.commands)
    clik.robot.send(ms=clik.robot.number)
    clik.tester.until(lambda: len(clik.commands) > before, "the repeated command")
    assert clik.commands[-1] == first


def test_a_reference_is_followed_from_the_next_state_on(clik):
    reference = clik.tester.publisher(MultiDOFJointTrajectory, "reference")
    clik.tester.until(lambda: reference.get_subscription_count() == 1, "clik to listen")
    target = moved_frame()
    reference.publish(reference_to(target, 0.2))
    clik.tester.until(lambda: clik.tester.reported("following a reference"), "the report")
    for _ in range(250):
        command = clik.tick()
    reached = pose_of(command.position)
    assert np.linalg.norm(reached.p_d - target.p_d) < 1e-6
    assert np.abs(reached.R_d - target.R_d).max() < 1e-5
    assert np.linalg.norm(pose_of(UR5.home).p_d - target.p_d) == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("command_type", "kind", "read"),
    [
        ("joint_trajectory", JointTrajectory, lambda c: c.points[0].positions),
        ("forward", Float64MultiArray, lambda c: c.data),
    ],
)
def test_the_command_has_the_type_that_is_asked_for(tester, command_type, kind, read):
    clik = start_clik(tester, {"command_type": command_type}, kind)
    assert list(read(clik.commands[-1])) == list(UR5.home)


def test_in_a_namespace_all_topics_are_of_that_namespace(tester):
    clik = start_clik(tester, {}, namespace="/left")
    assert list(clik.tick().position) == list(UR5.home)


# --- clik: bad input ---------------------------------------------------------------------

BAD_STATES = {
    "a NaN": ({"position": [math.nan, *UR5.home[1:]]}, "non-finite position"),
    "an infinite velocity": ({"velocity": [math.inf, *STILL[1:]]}, "non-finite velocity"),
    "too few positions": ({"position": [0.0] * 5}, "6 names but 5 values of position"),
    "no names": ({"name": []}, "expected shoulder_pan_joint"),
    "a missing joint": (
        {"name": ["a", *UR5.joints[1:]]},
        "lacks shoulder_pan_joint; expected shoulder_pan_joint",
    ),
}


@pytest.mark.parametrize(("changes", "complaint"), BAD_STATES.values(), ids=BAD_STATES.keys())
def test_no_command_follows_from_a_bad_state(clik, changes, complaint):
    assert clik.silent_after(lambda: clik.robot.send(**changes))
    clik.tester.until(lambda: clik.tester.reported("joint_states rejected: 1"), "the count")
    assert complaint in clik.tester.nodes.log("clik")
    assert list(clik.tick().position) == list(UR5.home)


def bad_reference(change):
    msg = reference_to(moved_frame())
    change(msg)
    return msg


def _set(path, value):
    def change(msg):
        target = msg
        *parents, last = path
        for name in parents:
            target = target[name] if isinstance(name, int) else getattr(target, name)
        setattr(target, last, value)

    return change


TRANSFORM = ("points", 0, "transforms", 0)
BAD_REFERENCES = {
    "another frame": (_set(("header", "frame_id"), "map"), "expected the base frame 'base_link'"),
    "another tip": (_set(("joint_names",), ["hand"]), "expected the tip frame ['tool0']"),
    "a NaN": (_set((*TRANSFORM, "translation", "x"), math.nan), "non-finite"),
    "a quaternion of norm 0": (_set((*TRANSFORM,), Transform()), "norm"),
    "no points": (_set(("points",), []), "no points"),
    "no transform": (
        _set(("points",), [MultiDOFJointTrajectoryPoint()]),
        "point 0 of the reference has 0 transforms",
    ),
}


@pytest.mark.parametrize("case", BAD_REFERENCES)
def test_a_bad_reference_is_refused_and_the_pose_held(clik, case):
    change, complaint = BAD_REFERENCES[case]
    msg = reference_to(moved_frame())
    if case == "a quaternion of norm 0":
        msg.points[0].transforms[0].rotation.w = 0.0
        msg.points[0].transforms[0].rotation.z = 0.0
        msg.points[0].transforms[0].rotation.x = 0.0
        msg.points[0].transforms[0].rotation.y = 0.0
    else:
        change(msg)
    reference = clik.tester.publisher(MultiDOFJointTrajectory, "reference")
    clik.tester.until(lambda: reference.get_subscription_count() == 1, "clik to listen")
    reference.publish(msg)
    clik.tester.until(lambda: clik.tester.reported("reference rejected: 1"), "the count")
    assert complaint in clik.tester.nodes.log("clik")
    for _ in range(20):
        command = clik.tick()
    assert list(command.position) == list(UR5.home)
    assert list(command.velocity) == STILL


def test_a_reference_that_begins_too_far_away_is_refused(clik):
    reference = clik.tester.publisher(MultiDOFJointTrajectory, "reference")
    clik.tester.until(lambda: reference.get_subscription_count() == 1, "clik to listen")
    reference.publish(reference_to(moved_frame(distance=0.3), 0.0))
    clik.tester.until(lambda: clik.tester.reported("reference rejected: 1"), "the count")
    assert "0.300 m" in clik.tester.nodes.log("clik")
    assert list(clik.tick().position) == list(UR5.home)


def test_two_publishers_on_reference_are_refused_and_both_named(clik):
    first = clik.tester.publisher(MultiDOFJointTrajectory, "reference")
    clik.tester.nodes.start("reference", FRAMES)
    clik.tester.until(
        lambda: clik.tester.node.count_publishers("/reference") == 2
        and first.get_subscription_count() == 1,
        "two publishers",
    )
    clik.tester.until(  # until clik, too, has learnt both names
        lambda: "publishers on 'reference': /reference, /tester" in clik.tester.nodes.log("clik"),
        "the refusal",
        again=lambda: first.publish(reference_to(moved_frame())),
    )
    assert clik.tester.reported("reference rejected")
    assert list(clik.tick().position) == list(UR5.home)


def test_after_a_jump_of_the_stamps_it_holds_the_pose_measured_then(clik):
    clik.tick()
    clik.robot.q = [q + 0.3 for q in UR5.home]
    assert list(clik.tick(ms=clik.robot.number + 100_000_000).position) == clik.robot.q
    clik.robot.q = [q + 0.1 for q in UR5.home]
    assert list(clik.tick(ms=1).position) == clik.robot.q


# --- clik: parameters --------------------------------------------------------------------


def test_orientation_and_gains_change_while_moving_without_a_jump_of_the_command(tester):
    clik = start_clik(tester, {"k_Pp": 2.0, "k_Po": 2.0})
    reference = tester.publisher(MultiDOFJointTrajectory, "reference")
    tester.until(lambda: reference.get_subscription_count() == 1, "clik to listen")
    reference.publish(reference_to(moved_frame(0.04, 0.15), 0.0))
    tester.until(lambda: tester.reported("following a reference"), "the report")
    for changes in ({"k_Pp": 20.0, "k_Po": 20.0}, {"orientation": "euler_angles"}):
        *_, earlier, before = [clik.tick() for _ in range(5)]
        results = set_parameters(tester, "/clik", **changes)
        assert all(result.successful for result in results), results
        first, *_, last = [clik.tick() for _ in range(60)]
        drift, step, change = (
            np.abs(np.subtract(c.velocity, before.velocity)).max() for c in (earlier, first, last)
        )
        assert change > 0.05  # the new law does ask for something else
        assert step < 1.5 * drift + 0.01 * change
        dt_dq = 1e-3 * np.array(before.velocity)
        assert np.allclose(first.position, before.position + dt_dq, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"k_Po": -1.0}, "between 0 and 10000"),
        ({"k_Po": math.nan}, "finite"),
        ({"orientation": "euler_angels"}, "did you mean 'euler_angles'"),
        ({"tip_frame": "wrist_3_link"}, "cannot be changed while running"),
    ],
)
def test_an_impossible_change_is_refused_with_its_reason(clik, changes, reason):
    (result,) = set_parameters(clik.tester, "/clik", **changes)
    assert not result.successful
    assert reason in result.reason


def run_to_its_end(executable, *arguments):
    """Run an executable that is expected to end by itself; return exit code and stderr."""
    result = subprocess.run(
        [sys.executable, "-m", module_of(executable), "--ros-args", *arguments],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    return result.returncode, result.stderr.strip()


@pytest.mark.parametrize(
    ("executable", "argument", "complaint"),
    [
        ("clik", "k_po:=3.0", "unknown parameter 'k_po' (did you mean 'k_Po'?)"),
        ("clik", "orientation:=quaternion", "known: angle_axis, euler_angles"),
        ("clik", "euler_sequence:=XYY", "known: XYX, XYZ"),
        ("clik", "enforce_limits:=false", "only with use_sim_time"),
        ("clik", "k_Pp:=-5.0", "parameter 'k_Pp' is -5 1/s; expected between 0 and 10000"),
        ("pybullet_bridge", "robot:=ur55", "known: kuka_iiwa, panda, ur10, ur5"),
        ("pybullet_bridge", "urdf:=/nowhere.urdf", "cannot be read"),
        ("pybullet_bridge", "mode:=fast", "known: lockstep, realtime"),
        ("pybullet_bridge", "initial_positions:=[1.0]", "expected 6"),
        ("reference", "motion:=way_points", "0 times"),
        ("reference", "orientation_format:=rpy", "rotation_vector"),
    ],
)
def test_a_bad_parameter_ends_the_process_with_one_line(executable, argument, complaint):
    code, stderr = run_to_its_end(executable, "-p", argument)
    lines = [line for line in stderr.splitlines() if not line.startswith("pybullet build time")]
    assert code == 1
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert complaint in lines[0]


@pytest.mark.parametrize("name", ["euler_angles", "euler_parameters"])
def test_an_overlay_switches_the_orientation(tester, name):
    files = [str(config_folder() / f"{file}.yaml") for file in ("clik", name)]
    command = [sys.executable, "-m", module_of("clik"), "--ros-args"]
    for file in files:
        command += ["--params-file", file]
    process = subprocess.Popen(command, env=tester.nodes.environment)
    try:
        request = GetParameters.Request(names=["orientation", "tip_frame"])
        answer = tester.call(GetParameters, "/clik/get_parameters", request)
    finally:
        process.terminate()
        assert process.wait(30) == 0
    assert [value.string_value for value in answer.values] == [name, "tool0"]


def test_an_unknown_tip_frame_is_refused_with_the_names_that_exist(tester):
    FakeRobot(tester, UR5)
    tester.nodes.start("clik", FRAMES | {"tip_frame": "tool_0"})
    tester.until(lambda: tester.reported("unknown frame 'tool_0' (did you mean 'tool0'?)"), "it")
    assert tester.reported("known: base, base_link")
    state = tester.call(GetState, "/clik/get_state", GetState.Request()).current_state
    assert state.id == State.PRIMARY_STATE_UNCONFIGURED


# --- lifecycle and signals ---------------------------------------------------------------


def change_state(tester, transition):
    request = ChangeState.Request(transition=Transition(id=transition))
    return tester.call(ChangeState, "/clik/change_state", request).success


def test_without_autostart_the_lifecycle_services_start_and_stop_it(tester):
    robot, commands = FakeRobot(tester, UR5), []
    tester.listen(JointState, "joint_reference", commands)
    tester.nodes.start("clik", FRAMES | {"autostart": False, "state_timeout": 60.0})
    assert not change_state(tester, Transition.TRANSITION_ACTIVATE)
    tester.until(lambda: change_state(tester, Transition.TRANSITION_CONFIGURE), "configured")
    assert not change_state(tester, Transition.TRANSITION_ACTIVATE)  # no state yet
    tester.until(lambda: robot.states.get_subscription_count() == 1, "clik to listen")
    tester.until(
        lambda: change_state(tester, Transition.TRANSITION_ACTIVATE), "active", again=robot.send
    )
    tester.until(lambda: commands, "a command", again=robot.send)
    assert change_state(tester, Transition.TRANSITION_DEACTIVATE)
    clik = Clik(tester, robot, commands)
    assert clik.silent_after(robot.send)
    assert list(commands[-1].velocity) == STILL
    assert change_state(tester, Transition.TRANSITION_CLEANUP)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_a_command_that_holds_still(clik, number):
    reference = clik.tester.publisher(MultiDOFJointTrajectory, "reference")
    clik.tester.until(lambda: reference.get_subscription_count() == 1, "clik to listen")
    reference.publish(reference_to(moved_frame(0.05, 0.5), 0.3))
    clik.tester.until(lambda: clik.tester.reported("following a reference"), "the report")
    moving = [clik.tick() for _ in range(100)][-1]
    assert np.abs(moving.velocity).max() > 0.05
    before = len(clik.commands)
    process = clik.tester.nodes.processes["clik"]
    process.send_signal(number)
    clik.tester.until(lambda: process.poll() is not None, "the end of clik")
    clik.tester.until(lambda: len(clik.commands) > before, "the last command")
    assert process.returncode == 0
    assert list(clik.commands[-1].velocity) == STILL
    assert list(clik.commands[-1].position) == list(moving.position)


# --- bridge ------------------------------------------------------------------------------


class Bridge:
    def __init__(self, tester, parameters):
        self.tester = tester
        self.states, self.wrenches, self.clocks, self.order = [], [], [], []
        tester.listen(JointState, "joint_states", self.states)
        tester.listen(WrenchStamped, "wrench", self.wrenches)
        tester.listen(Clock, "/clock", self.clocks)
        self.commands = tester.publisher(JointState, "joint_reference")
        tester.nodes.start("pybullet_bridge", parameters)
        tester.until(
            lambda: self.states and self.commands.get_subscription_count() == 1, "the bridge"
        )

    def answer(self, state, **changes):
        msg = JointState(name=list(UR5.joints), position=list(UR5.home), velocity=STILL)
        msg.header.stamp = state.header.stamp
        for name, value in changes.items():
            setattr(msg, name, value)
        self.commands.publish(msg)


def test_in_real_time_the_bridge_gives_state_wrench_clock_and_description(tester):
    descriptions = []
    tester.listen(String, "robot_description", descriptions, latched=True)
    bridge = Bridge(tester, {"rate": 200.0})
    tester.until(lambda: len(bridge.states) > 50 and len(bridge.clocks) > 10, "messages")
    tester.until(lambda: descriptions, "the latched description")
    assert list(bridge.states[-1].name) == list(UR5.joints)
    assert np.allclose(bridge.states[-1].position, UR5.home, atol=1e-6)  # braked, nobody commands
    assert bridge.wrenches[-1].header.frame_id == UR5.sensor_frame
    assert descriptions[0].data == UR5.urdf
    stamps = [stamp(state) for state in bridge.states]
    assert stamps == list(range(stamps[0], stamps[0] + 5 * len(stamps), 5))


def test_in_lockstep_the_first_state_is_repeated_and_each_answer_makes_one_step(tester):
    bridge = Bridge(tester, {"mode": "lockstep"})
    tester.until(lambda: len(bridge.states) > 3, "the repeated state")
    assert {stamp(state) for state in bridge.states} == {0}
    for k in range(1, 30):
        bridge.answer(bridge.states[-1])
        tester.until(lambda k=k: stamp(bridge.states[-1]) == k, f"the state {k}")
    tester.until(lambda: stamp(bridge.wrenches[-1]) == 29, "the wrench")
    bridge.answer(bridge.states[0])  # an old stamp moves nothing
    tester.spin(QUIET)
    assert stamp(bridge.states[-1]) == 29


def test_a_bad_command_is_refused_by_the_bridge_and_moves_nothing(tester):
    bridge = Bridge(tester, {"mode": "lockstep"})
    for changes, complaint in (
        ({"position": [math.nan, *UR5.home[1:]]}, "joint_reference has a non-finite position"),
        ({"name": ["a", *UR5.joints[1:]]}, "joint_reference lacks shoulder_pan_joint"),
        ({"position": [0.0]}, "6 names but 1 values of position"),
    ):
        bridge.answer(bridge.states[-1], **changes)
        tester.until(lambda c=complaint: c in tester.nodes.log("pybullet_bridge"), complaint)
    assert {stamp(state) for state in bridge.states} == {0}


def test_a_silent_controller_ends_the_lockstep_run_with_an_error(tester):
    bridge = Bridge(tester, {"mode": "lockstep", "lockstep_timeout": 0.5})
    bridge.answer(bridge.states[-1])
    process = tester.nodes.processes["pybullet_bridge"]
    tester.until(lambda: process.poll() is not None, "the end of the bridge")
    assert process.returncode == 1
    log = tester.nodes.log("pybullet_bridge")
    assert "error: no command for the state stamped 0.001 s within 0.5 s" in log
    assert "Traceback" not in log


def test_in_real_time_the_bridge_brakes_when_commands_stop(tester):
    bridge = Bridge(tester, {"rate": 200.0, "command_timeout": 0.2})
    moving = [q + 0.5 for q in UR5.home]
    for _ in range(20):
        bridge.answer(bridge.states[-1], position=moving, velocity=[0.5] * 6)
        tester.spin(0.02)
    tester.until(lambda: tester.reported("no command for 0.2 s: braked"), "the brake")
    tester.spin(QUIET)
    assert np.abs(bridge.states[-1].velocity).max() < 1e-3
    assert np.abs(np.subtract(bridge.states[-1].position, UR5.home)).max() > 0.01
    errors = [s for a in tester.diagnostics for s in a.status if s.level == DiagnosticStatus.ERROR]
    assert errors


# --- reference ---------------------------------------------------------------------------


def test_a_target_pose_leads_to_a_motion_and_a_wrong_frame_to_none(tester):
    robot, references = FakeRobot(tester, UR5), []
    tester.listen(MultiDOFJointTrajectory, "reference", references)
    targets = tester.publisher(PoseStamped, "target_pose")
    tester.nodes.start("reference", FRAMES | {"linear_speed": 0.1})
    tester.until(
        lambda: targets.get_subscription_count() == 1 and tester.reported("ready"), "the node"
    )
    pose = PoseStamped()
    pose.header.frame_id = "map"
    pose.pose.orientation.w = 1.0
    tester.until(
        lambda: "the pose is in the frame 'map'" in tester.nodes.log("reference"),
        "the refusal",
        again=lambda: (robot.send(), targets.publish(pose)),
    )
    assert not references
    frame = pose_of(UR5.home)
    msg = reference_to(DesiredFrame(frame.p_d + np.array([0.0, 0.0, 0.05]), frame.R_d))
    transform = msg.points[0].transforms[0]
    pose.header.frame_id = UR5.base_frame
    pose.pose.orientation = transform.rotation
    for axis in "xyz":
        setattr(pose.pose.position, axis, getattr(transform.translation, axis))
    targets.publish(pose)
    tester.until(lambda: references, "the motion")
    (point,) = references[0].points
    assert references[0].header.frame_id == UR5.base_frame
    assert references[0].joint_names == [UR5.tip_frame]
    assert point.time_from_start.sec * 1e9 + point.time_from_start.nanosec == pytest.approx(5e8)
    assert point.transforms[0].translation == transform.translation
