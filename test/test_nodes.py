"""The nodes as their users run them: real processes that talk over DDS.

What the control nodes have in common is tested here for each of them; what
``impedance_control`` has of its own, in ``test_impedance_node.py``.
"""

import math
import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from in_process import each_once, run_to_its_end
from ros_processes import (
    AT_ONCE,
    FRAMES,
    HOME,
    MODEL,
    ROOT,
    UNSHAPED,
    UR5,
    Arm,
    Controlled,
    assert_holds,
    pose,
    reference,
    values,
)
from rosgraph_msgs.msg import Clock
from samples import rodrigues
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from tolerances import LAW_IN_A_NODE, RELATIVE, SIMULATED_POSE, THROUGH_A_QUATERNION, assert_close
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from eulerparams_control import events
from eulerparams_control.events import Event, events_of
from eulerparams_control.laws.inverse import sigma_min
from eulerparams_control.laws.rotations import angle_between, quaternion
from eulerparams_control.messages.from_ros import motion_from_ros, ns_from_ros, vector_from_ros
from eulerparams_control.messages.keys import SLOWED
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import RobotState

CONFIG = ROOT / "config"
CONTROLLERS = ("clik", "dynamic_control", "impedance_control")
# V and its derivatives of the same state, by two formulas; that measured divides by 1 ms.
LYAPUNOV = 1e-9
# Parameters that are for simulations only.
UNSAFE: tuple[tuple[str, Any, str], ...] = (
    ("enforce_limits", False, "enforce_limits: false"),
    ("quaternion_sign", "separate", "quaternion_sign: separate"),
    ("velocity_scale", 1.5, "velocity_scale: 1.5, above 1,"),
)

# Of impedance_control: a change while running, and a value at configuration.
IMPOSSIBLE: tuple[tuple[str, Any, str], ...] = (
    ("K_p", [1000.0, -1.0, 10.0], "impedance_p: K has the negative eigenvalue -1: [[1000.0, "),
    ("K_p", [0.0, 1.0, 1.0], "would drift: 0 1/s; expected at least 0.5 1/s: give D_p in Ns/m"),
    ("D_p", [0.0, 1.0, 1.0], "D_p is too small against M_p along an axis, where the arm would dri"),
    ("M_p", [1e-6] * 3, "M_p is too small for D_p or K_p: the impedance moves at"),
    ("wrench_bias", [0.0] * 5, "; expected 6"),
    *(
        (name, value, f"'{name}' cannot be changed while running")
        for name, value in (
            ("wrench_sign", -1), ("wrench_timeout", 1.0), ("compliance_offset", [0.0, 0.0, 0.1])
        )
    ),
)  # fmt: skip
NOT_CONFIGURED: tuple[tuple[dict[str, Any], str], ...] = (
    ({"tip_frame": "tool1"}, "configured: tip_frame: unknown frame 'tool1' (did you mean"),
    ({"wrench_sign": 0}, "wrench_sign is 0; expected 1 or -1"),
    ({"compliance_frame": "tool1"}, "compliance_frame: frame: unknown frame 'tool1' (did you mean"),
    ({"K_p": [-1.0, 1.0, 1.0]}, "impedance_p: K has the negative eigenvalue -1"),
)

WRENCH = "{fault: drop, topic: wrench, at: 1, for: 1}"
NO_FIELD = "{fault: corrupt, topic: wrench, at: 1, for: 1, value: nan, field: wrench.moment}"
CIRCLE = {"motion": "circle", "circle_radius": 0.05, "circle_period": 2.0, "circle_turns": 1.0}
ENDLESS = {"wrenches": [0.0, 0.0, 5.0, 0.0, 0.0, 0.0], "wrench_times": [0.0]}
# An arm whose joints are slower than this stands [rad/s].
AT_REST = 0.02

shared = each_once(lambda _: AT_ONCE)


@pytest.fixture(params=CONTROLLERS)
def node(request: pytest.FixtureRequest, shared: Any) -> Iterator[Controlled]:
    """A controller that is shared, active and holding the home position."""
    controlled = shared(request.param)
    controlled.arm.start_anew()
    yield controlled
    controlled.restore()


# --- what is refused -------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("node", "name", "value", "words"),
    [
        ("clik", "tip_frame", "base_link", "'tip_frame' cannot be changed while running"),
        ("clik", "posture", [0.0, 1.0], "posture has 2 values; expected one for each of the 6"),
        ("dynamic_control", "posture", [0.1], "posture has 1 values; expected one for each of"),
        ("dynamic_control", "tool_mass", 1.0, "'tool_mass' cannot be changed while running"),
        *(("impedance_control", *each) for each in IMPOSSIBLE),
        *(
            (executable, name, value, f"{words} is accepted only with use_sim_time: true")
            for executable in CONTROLLERS
            for name, value, words in UNSAFE[1:]
        ),
        *((executable, *UNSAFE[0][:2], "cannot be changed") for executable in CONTROLLERS),
    ],
    indirect=["node"],
)
def test_a_change_of_a_parameter_that_is_not_possible_is_refused_and_changes_nothing(
    node, name, value, words
):
    before = node.peer.get_parameters(node.name, name)
    assert node.peer.set_parameters(node.name, use_sim_time=False) == []
    try:
        (reason,) = node.peer.set_parameters(node.name, **{name: value})
    finally:
        assert node.peer.set_parameters(node.name, use_sim_time=True) == []
    assert words in reason
    assert node.peer.get_parameters(node.name, name) == before
    assert_holds(node.arm.tick(), HOME)


# --- reports ---------------------------------------------------------------------------------
def test_each_state_gets_one_command_in_order_and_pose_error_and_diagnostics_report_the_loop(node):
    peer, arm = node.peer, node.arm
    first = arm.t + 1_000_000
    arm.send_next(50)
    stamps = [ns_from_ros(command.header.stamp) for command in arm.commands]
    arm.commands.clear()
    assert stamps == list(range(first, arm.t + 1, 1_000_000))
    poses = peer.listen(PoseStamped, f"{node.name}/pose")
    errors = peer.listen(TwistStamped, f"{node.name}/error")
    arm.ticks(50)
    assert poses[-1].header.frame_id == errors[-1].header.frame_id == "base_link"
    assert_close(vector_from_ros(poses[-1].pose.position), pose(HOME)[0], LAW_IN_A_NODE)
    assert_close(vector_from_ros(errors[-1].twist.angular), 0.0, LAW_IN_A_NODE)
    found = values(peer.status(node.name, lambda s: "inverse of J" in values(s)))
    sigma = sigma_min(MODEL.state(HOME, 0 * HOME).J, MODEL.length)
    assert float(found["smallest singular value of J"]) == pytest.approx(sigma, rel=1e-5)
    expected = {"inverse of J": "exact", "orientation": "euler_parameters", "saturated": "0"}
    assert expected.items() <= found.items()


@pytest.mark.parametrize(
    ("node", "k_Po"), [("clik", 2.0), ("dynamic_control", 800.0)], indirect=["node"]
)
def test_the_error_and_the_lyapunov_function_are_those_of_the_state(node, k_Po):
    errors = node.peer.listen(TwistStamped, f"{node.name}/error")
    functions = node.peer.listen(Float64MultiArray, f"{node.name}/lyapunov")
    node.change(k_Po=k_Po, **UNSHAPED | {"max_joint_acceleration": [20.0]})
    p, R = pose(HOME)
    desired = DesiredFrame(p + [0.0, 0.02, 0.0], rodrigues(0.15, np.array([0.0, 0.6, 0.8])) @ R)
    node.follow(reference(desired))
    states = {}
    for _ in range(120):  # the joints are too slow for it at first
        node.arm.tick()
        states[node.arm.t] = MODEL.state(node.arm.q, node.arm.dq)

    stamps = [ns_from_ros(error.header.stamp) for error in errors[-4:]]
    assert set(np.diff(stamps)) == {20_000_000}  # 50 Hz
    for t, error, function in zip(stamps[2:], errors[-2:], functions[-2:], strict=True):
        e_p, eps = vector_from_ros(error.twist.linear), vector_from_ros(error.twist.angular)
        assert e_p == pytest.approx(desired.p_d - states[t].p_e)
        assert eps == pytest.approx(quaternion(desired.R_d @ states[t].R_e.T).eps, abs=LYAPUNOV)
        now = lyapunov(node, k_Po, desired, states[t])
        before = lyapunov(node, k_Po, desired, states[t - 1_000_000])
        (dimension,) = function.layout.dim
        assert (dimension.label, dimension.size) == ("V, dV by the paper, dV measured", 3)
        expected = [*now, (now[0] - before[0]) / 1e-3]
        assert function.data.tolist() == pytest.approx(expected, rel=LYAPUNOV, abs=LYAPUNOV)
        assert now[0] > 1e-6


def test_what_is_made_of_a_trajectory_beyond_the_limits_of_the_tip_is_published_and_said(node):
    desired = node.peer.listen(MultiDOFJointTrajectory, f"{node.name}/desired")
    p, R = pose(HOME)
    goal = DesiredFrame(p - [0.0, 0.0, 0.2], R)
    node.follow(reference(goal, times=(0.4,)))
    began = node.arm.t
    status = node.status(lambda s: s.message.endswith("or give it more time"))
    assert (status.level, values(status)["remedy"]) == (b"\x00", "")  # a note, no fault
    node.arm.ticks(375, dt=0.004)
    found = node.status(lambda s: float(values(s).get(SLOWED, "1")) < 1)
    rate = float(values(found)[SLOWED])
    fastest = 0.2 / 0.4 * 15 / 8  # of a quintic from rest to rest
    assert 0.8 * 0.25 / fastest < rate <= 1.01 * 0.25 / fastest
    assert f"slowed to {100 * rate:.0f} % for the limits of the tip: raise" in status.message
    assert float(values(found)["references ahead of joint_states [s]"]) == 0.0
    assert values(found)["references that never began"] == "0"
    frames = []
    for msg in desired:
        point, stamp = motion_from_ros(msg, *FRAMES.values(), 0.0)
        if stamp is not None and stamp >= began:
            frames.append(point.sample(0.0))
    assert 0.22 < max(np.linalg.norm(frame.dp_d) for frame in frames) <= 0.25 * 1.01
    assert frames[-1].p_d == pytest.approx(goal.p_d, abs=THROUGH_A_QUATERNION)
    np.testing.assert_allclose(frames[-1].R_d, R, atol=THROUGH_A_QUATERNION)


def lyapunov(
    node: Controlled, k_Po: float, desired: DesiredFrame, state: RobotState
) -> tuple[float, float]:
    """Return V_1 or V_2 with its derivative at rest, eqs. (30), (31) or (42), (43)."""
    theta = angle_between(desired.R_d, state.R_e)
    V_1 = 4 * math.sin(theta / 4) ** 2  # (eta - 1)^2 + eps' eps = 2 (1 - cos(theta / 2))
    if node.name == "clik":
        return V_1, -k_Po * math.sin(theta / 2) ** 2
    omega_2 = float(state.omega_e @ state.omega_e)
    return k_Po * V_1 + omega_2 / 2, -40.0 * omega_2  # k_Vo is 40 / s


def test_a_representation_that_is_changed_between_two_states_is_shown_by_its_first_tick(node):
    node.change(orientation="rotation_vector")
    node.arm.ticks(50)
    node.change(orientation="euler_parameters")
    node.graph.advance(1.5)  # what is shown meanwhile is none of the tick of the other one
    node.arm.ticks(50)
    assert "internal error" not in node.status().message + node.graph.logs()


# --- lifecycle -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("executable", "autostart"), [("clik", True), ("clik", False), ("dynamic_control", True)]
)
def test_a_controller_is_configured_activated_deactivated_cleaned_up(world, executable, autostart):
    peer = world.peer
    arm = Controlled.ARMS[executable](world, UR5)
    process = world.start(executable, {**FRAMES, "autostart": autostart, "use_sim_time": True})

    def change(transition: str, then: str, *, is_possible: bool = True) -> None:
        assert peer.change_state(executable, transition) is is_possible
        assert peer.lifecycle_state(executable) == then

    if not autostart:
        change("activate", "unconfigured", is_possible=False)
        change("configure", "inactive")
        lacking = arm.message()
        lacking.name = [*UR5.joints[:3], "wrist", *UR5.joints[4:]]
        arm.send(lacking)
        assert "joint_states lacks wrist_1_joint; expected shoulder_pan_joint" in process.log
        change("activate", "inactive", is_possible=False)
        arm.send_next()
        change("activate", "active")
    arm.connect()
    change("configure", "active", is_possible=False)  # not fatal
    change("deactivate", "inactive")
    arm.q, arm.dq = HOME + 0.1, np.zeros(6)
    arm.send(arm.message())
    change("activate", "active")
    assert_holds(arm.tick(arm.q), arm.q)  # it begins at the measured pose
    change("deactivate", "inactive")
    change("cleanup", "unconfigured")
    change("configure", "inactive")
    assert process.stop() == 0


@pytest.mark.parametrize(
    ("executable", "number", "obeys"),
    [
        ("clik", signal.SIGINT, True),
        ("dynamic_control", signal.SIGTERM, False),
        ("impedance_control", signal.SIGTERM, True),
    ],
)
def test_a_signal_brings_the_arm_to_rest_if_it_obeys_and_ends_with_a_safe_command(
    graph, executable, number, obeys
):
    patient = {"state_timeout": 5.0}  # where the machine is slow
    node = Controlled(graph, executable, FRAMES | patient, namespace="/left")
    arm = node.arm
    commands = node.peer.listen(JointState, f"/left/{arm.topic}")
    p, R = pose(HOME)
    node.follow(reference(DesiredFrame(p + [0.0, 0.0, 0.1], R), times=(1.0,)))
    while np.abs(arm.dq).max() <= 5 * AT_REST:  # no faster: it has a second to stop in
        arm.tick()
    if not obeys:
        arm._pass = lambda dt, _: setattr(arm, "q", arm.q + dt * arm.dq)  # it goes on
    node.process.signal(number)
    positions = arm.ticks_until(lambda: node.process.exit_code is not None)
    assert node.process.end() == 0
    assert (np.abs(arm.dq).max() < AT_REST) == obeys
    assert len(commands) > 10  # it was given time

    def is_the_last() -> bool:
        return len(commands) > 1 and commands[-1].header.stamp == commands[-2].header.stamp

    graph.until(is_the_last, "the command that repeats the stamp of the last answer")
    q = positions[ns_from_ros(commands[-1].header.stamp)]
    assert_holds(commands[-1], q, within=1e-3 * AT_REST)  # it may go on for a tick of 1 ms
    if arm.sensor is not None:
        graph.until(lambda: arm.frames[-1].header.stamp == commands[-1].header.stamp, "its frame")
        (frame,) = arm.frames_of([ns_from_ros(commands[-1].header.stamp)])
        assert_close(frame.p_d, pose(q)[0], LAW_IN_A_NODE)
        assert not np.any(frame[2:])
    assert "Traceback" not in node.process.log


# --- what a robot description lacks ----------------------------------------------------------
@pytest.mark.parametrize(
    ("executable", "parameters", "words"),
    [
        ("clik", {"base_frame": "basis"}, "unknown frame 'basis'"),
        ("clik", {"joints": ["elbow_join"]}, "(did you mean 'elbow_joint'?)"),
        ("clik", {"posture": [0.0]}, "posture has 1 values; expected one for each of the 6 joints"),
        ("dynamic_control", {"friction_viscous": [1.0] * 2}, "friction_viscous has 2 values; exp"),
        ("dynamic_control", {"tool_com": [0.1, 0.0]}, "tool_com has 2 values; expected 3"),
        (
            "dynamic_control",
            {"tool_mass": 1.0, "tool_inertia": [-1.0, 0.0, 0.0, 1.0, 0.0, 1.0]},
            "tool_inertia has the principal moments [-1.0, 1.0, 1.0]; of a body none is negative",
        ),
        *(("impedance_control", *each) for each in NOT_CONFIGURED),
    ],
)
def test_a_robot_that_does_not_fit_gives_no_command_and_the_reason(
    world, executable, parameters, words
):
    peer, arm = world.peer, Controlled.ARMS[executable](world, UR5)
    process = world.start(executable, {**FRAMES, **parameters})
    status = peer.status(executable, lambda s: "not configured" in s.message)
    assert words in status.message
    assert status.level == b"\x02"
    arm.send_next(5)
    peer.status(executable)
    assert peer.lifecycle_state(executable) == "unconfigured"
    assert arm.commands == []
    assert process.stop() == 0


# --- parameters at the start -----------------------------------------------------------------
@pytest.mark.parametrize(
    ("executable", "parameters", "words"),  # what a declaration says itself: test_parameters
    [
        *(
            (executable, {name: value}, f"{words} is accepted only with use_sim_time: true")
            for executable in CONTROLLERS
            for name, value, words in UNSAFE
        ),
        *(
            (executable, {"cpu_affinity": [0, 1023]}, "names the cpus [1023], which do not exist")
            for executable in (*CONTROLLERS, "pybullet_bridge")
        ),
        ("clik", {"realtime_priority": 100}, "is 100; expected between 0 and 99"),
        ("reference", {"once": True}, "once ends the node with its motion, but"),
        ("reference", {**CIRCLE, "once": True, **ENDLESS}, "once ends the node with its motion, b"),
        ("reference", {"motion": "way_points"}, "0 times"),
        ("reference", {"circle_normal": [1.0], "motion": "circle"}, "circle_normal has 1 numbers"),
        ("reference", {"robot_description": "<robot/>"}, "has no <link>"),
        ("pybullet_bridge", {"robot": "ur55"}, "unknown robot 'ur55' (did you mean 'ur5'?)"),
        ("pybullet_bridge", {"urdf": "/nowhere/a.urdf"}, "the URDF cannot be read"),
        ("pybullet_bridge", {"initial_positions": [1.0]}, "initial_positions has 1 values"),
        ("pybullet_bridge", {"servo_bandwidth": 5000.0}, "must not exceed the rate"),
        ("teleop", {"device": "keyboard"}, "needs a terminal: start it in one, or set"),
        ("teleop", {"axes": [1, 2]}, "axes has 2 values; expected 6"),
        ("fault_injector", {"faults": ["{fault: kill, node: clik, at: 1}"]}, "by the experiment"),
        ("fault_injector", {"faults": ["{fault: drop, topic"]}, "no YAML"),
        ("fault_injector", {"faults": [NO_FIELD]}, "unknown field 'moment'"),
        ("fault_injector", {"topics": ["reference"], "faults": [WRENCH]}, "topic among the param"),
        ("fault_injector", {"topics": ["wrench"], "start_on": "reference"}, "start_on"),
        ("identify_tool", {"wrench_sign": 0}, "'wrench_sign' is 0; expected 1 or -1"),
        ("identify_tool", {"gravity": [0.0] * 3}, "expected 3 numbers, not all 0"),
        ("identify_tool", {"output": "there/is/none.yaml"}, "there is no folder there/is for none"),
        ("identify_tool", {"robot_description": UR5.urdf, "tip_frame": "t"}, "unknown frame 't'"),
    ],
)
def test_an_impossible_parameter_ends_a_node_with_one_line_and_exit_code_1(
    tmp_path, executable, parameters, words
):
    process = run_to_its_end(executable, tmp_path, parameters)
    assert process.exit_code == 1
    (line,) = process.stderr.splitlines()
    assert line.startswith("error: ")
    assert words in line


@pytest.mark.parametrize("executable", CONTROLLERS)
def test_limits_can_be_switched_off_in_simulation_which_then_cannot_be_left(world, executable):
    start = {"enforce_limits": False, "use_sim_time": True}
    process = world.start(executable, start)
    assert world.peer.get_parameters(executable, *start) == [False, True]
    live = {name: value for name, value, _ in UNSAFE[1:]}
    assert world.peer.set_parameters(executable, **live) == []
    assert world.peer.get_parameters(executable, *live) == list(live.values())
    (reason,) = world.peer.set_parameters(executable, use_sim_time=False)
    assert reason == "use_sim_time stays true with enforce_limits: false"
    assert process.stop() == 0


@pytest.mark.parametrize(
    "executable", [*CONTROLLERS, "reference", "pybullet_bridge", "fault_injector"]
)
def test_the_file_of_a_node_in_config_is_accepted_by_it(world, executable):
    process = world.start(executable, files=(CONFIG / f"{executable}.yaml",))
    world.peer.status(executable)
    if executable in CONTROLLERS:
        assert world.peer.get_parameters(executable, *FRAMES) == list(FRAMES.values())
    assert process.stop() == 0
    assert "error" not in process.stderr


# --- types of commands -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("executable", "kind", "message", "found"),
    [
        ("clik", "joint_trajectory", JointTrajectory, lambda msg: msg.points[0].positions),
        ("clik", "forward", Float64MultiArray, lambda msg: msg.data),
        ("dynamic_control", "forward", Float64MultiArray, lambda msg: msg.data),
    ],
)
def test_the_command_can_be_a_joint_trajectory_or_an_array_of_positions_or_efforts(
    world, executable, kind, message, found
):
    arm = Controlled.ARMS[executable](world, UR5, command=message)
    world.start(executable, {**FRAMES, "command_type": kind, "use_sim_time": True})
    world.until(lambda: (arm.send(arm.message()), arm.commands)[1], "a command")
    held = HOME if executable == "clik" else MODEL.dynamic_state(HOME, np.zeros(6)).g
    np.testing.assert_allclose(found(arm.commands[0]), held, rtol=1e-9)


# --- reference -------------------------------------------------------------------------------
def test_reference_sends_its_motion_from_good_states_again_when_asked_and_says_why_it_cannot(world):
    peer, arm = world.peer, Arm(world, UR5)
    process = world.start("reference", {**FRAMES, **CIRCLE, "wait_for_subscribers": 2})
    motions = peer.listen(MultiDOFJointTrajectory, "reference")
    words = "not sent: waiting for 2 subscribers of reference, 1 are there"
    assert peer.trigger("/reference/send").message == words
    arm.send_next()
    peer.status("reference", lambda s: s.message == "ready")
    peer.status("reference")  # a second later, and some twenty looks at the subscribers
    assert motions == []
    nan = arm.message()
    nan.position[0] = math.nan
    arm.send(nan)
    peer.listen(MultiDOFJointTrajectory, "reference")
    assert not peer.trigger("/reference/send").success
    assert "joint_states rejected: joint_states has a non-finite position" in process.log
    assert "no valid joint_states yet" in peer.trigger("/reference/send").message
    assert peer.counter("reference", "joint_states rejected", 1) == 1
    assert motions == []

    arm.send_next()
    world.until(lambda: motions, "the motion of the start")
    arm.q = arm.q + 0.1  # it is elsewhere now
    arm.send_next()
    assert peer.trigger("/reference/send").success
    starts = [motion_from_ros(m, "base_link", "tool0", 0.1)[0].frames[0] for m in motions]
    for start, q in zip(starts, (HOME, HOME + 0.1), strict=True):
        p, R = pose(q)
        np.testing.assert_allclose(start.p_d, p, atol=RELATIVE)
        assert angle_between(start.R_d, R) < THROUGH_A_QUATERNION
    assert process.stop() == 0


@pytest.mark.parametrize("is_restarted", [False, True])
def test_reference_that_is_to_send_once_ends_when_its_motion_is_over(world, is_restarted):
    peer, arm = world.peer, Arm(world, UR5)
    motions = peer.listen(MultiDOFJointTrajectory, "reference")
    process = world.start("reference", {**FRAMES, **CIRCLE, "circle_ramp": 0.0, "once": True})
    peer.status("reference", lambda s: s.message == "ready")
    arm.send_next()
    world.until(lambda: motions, "the motion")
    peer.status("reference")  # a second later, by the clock of the node
    lasting = ns_from_ros(motions[0].points[-1].time_from_start)
    begun = 1 if is_restarted else arm.t  # also the simulation
    for t in (begun, begun + lasting - 1, begun + lasting):
        assert process.exit_code is None
        arm.t = t
        msg = arm.message()
        msg.velocity[0] = math.nan  # the stamp alone counts
        arm.send(msg)
        world.advance(1.0)
    assert process.end() == 0
    assert len(motions) == 1


def test_reference_without_a_motion_says_so_when_asked_for_it(world):
    world.start("reference", FRAMES)
    answer = world.peer.trigger("/reference/send")
    assert (answer.success, answer.message) == (False, "not sent: the parameter motion is none")


# --- the bridge ------------------------------------------------------------------------------
def test_the_robot_publishes_its_state_wrench_clock_and_description(world):
    slow = {"robot": "ur5", "rate": 100.0, "clock_rate": 100.0, "servo_bandwidth": 50.0}
    world.start("pybullet_bridge", slow, namespace="/robot")
    peer = world.peer
    heard: list[Any] = []  # in the order in which it was published
    for kind, topic in ((JointState, "joint_states"), (WrenchStamped, "wrench")):
        peer.node.create_subscription(kind, f"/robot/{topic}", heard.append, 100)
    clocks = peer.listen(Clock, "/clock")
    descriptions = peer.listen(String, "/robot/robot_description", latched=True)
    world.until(lambda: len(heard) > 40 and clocks and descriptions, "20 of each")
    assert descriptions[0].data == UR5.urdf
    wrenches, states = heard[0::2], heard[1::2]
    assert {type(msg) for msg in wrenches} == {WrenchStamped}
    state = states[-1]
    assert set(UR5.joints) <= set(state.name)
    assert len(state.name) == len(state.position) == len(state.velocity) == len(state.effort)
    np.testing.assert_allclose(state.position[:6], HOME, atol=SIMULATED_POSE)
    stamps = [ns_from_ros(msg.header.stamp) for msg in states]
    assert set(np.diff(stamps)) == {10_000_000}
    assert {ns_from_ros(clock.clock) % 10_000_000 for clock in clocks} == {0}
    assert {msg.header.frame_id for msg in wrenches} == {"tool0"}
    assert [ns_from_ros(msg.header.stamp) for msg in wrenches] == stamps  # each before its state


def test_in_lockstep_nothing_moves_before_all_who_are_to_listen_do(world, capsys, monkeypatch):
    """Who records must not miss the beginning because it was discovered late."""
    monkeypatch.setattr(events, "_tells", True)

    def progress() -> list[float]:
        told = events_of(capsys.readouterr().out)
        return [event["t"] for event in told if event["event"] == Event.PROGRESS]

    peer = world.peer
    lockstep = {"mode": "lockstep", "duration": 0.05}
    bridge = world.start("pybullet_bridge", {**lockstep, "wait_for_subscribers": 2})
    clik = world.start("clik", {**FRAMES, "wait_for_subscribers": 2, "use_sim_time": True})
    world.until_said(clik, "waiting for 2 subscribers of /joint_reference, 1 are there")
    assert not progress()
    commands = peer.listen(JointState, "joint_reference")
    world.until(lambda: len(commands) >= 3, "the command, again and again")
    assert {ns_from_ros(command.header.stamp) for command in commands} == {0}
    assert not progress()
    states = peer.listen(JointState, "joint_states")
    assert bridge.end() == 0
    stamps = [round(step * 1e6) for step in range(51)]
    assert sorted({ns_from_ros(state.header.stamp) for state in states}) == stamps
    assert sorted({ns_from_ros(command.header.stamp) for command in commands}) == stamps
    assert progress() == pytest.approx([0.005 * k for k in range(1, 11)])
