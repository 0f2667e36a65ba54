"""Each protection of docs/safety.md, provoked through DDS.

What other files test is not tested again; the page names all tests.
"""

import math
import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from in_process import each_once
from ros_processes import (
    FRAMES,
    HOME,
    MODEL,
    UR5,
    Arm,
    Controlled,
    TorqueArm,
    assert_holds,
    assert_may_stay,
    pose,
    reference,
    values,
)
from sensor_msgs.msg import JointState
from tolerances import LAW_IN_A_NODE, SIMULATED_POSE
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.control.admission import AT_REST
from eulerparams_control.control.mode import stuck
from eulerparams_control.control.pace import LEAST, Nearness
from eulerparams_control.messages.from_ros import ns_from_ros, pose_from_ros
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame
from eulerparams_control.ros.managed_node import LONGEST

ALL = ("clik", "dynamic_control", "impedance_control")

MS = 1_000_000  # [ns]
DT = 0.001  # [s] of a tick
# The latency that a node does not mind while its stamps stand still [s].
ANY_LATENCY = 60.0
# A fault that a busy machine may add to those of a test.
SILENT = "no valid joint_states within 0.5 s: no commands; is the robot running?"
# An arm that moves is faster than this [rad/s].
MOVES = 1e-3
# A joint may exceed its speed limit by what the discrete time leaves, of the limit.
SPEED_LIMIT = 1e-3

PAIRED = {"impedance_control": {"wrench_pairing": "stamp"}}
shared = each_once(lambda name: {**FRAMES, **PAIRED.get(name, {}), "state_rate": 1000.0})


@pytest.fixture(params=ALL)
def node(request, shared):
    """A controller that is shared, active and holding the home position."""
    controlled = shared(request.param)
    start_at(controlled, HOME)
    yield controlled
    controlled.restore()


def start_at(node, q):
    """Let the arm stand at q (n,), held there, with no fault."""
    node.arm.start_afresh(q)
    p, R = pose(q)
    node.references.publish(reference(DesiredFrame(p, R)))
    node.status(lambda s: s.message.startswith("active with"))
    node.arm.start_afresh(q)


def upwards(q, dz=0.1):
    """Return a motion of a second that lifts the tip from where it is at q (n,) by dz [m]."""
    p, R = pose(q)
    return reference(DesiredFrame(p + [0.0, 0.0, dz], R), times=(1.0,))


# --- states that cannot be believed ----------------------------------------------------------
@pytest.mark.parametrize(
    ("real", "within", "gap", "cause"),  # told by the stamps, or by the clock of the machine
    [
        (False, 0.5, 0.5, "after a jump of the stamps by 0.5 s"),
        (True, 0.1, DT, "after a silence of joint_states of"),
    ],
)
@pytest.mark.parametrize("executable", ALL)
def test_a_silence_of_joint_states_is_told_and_then_the_arm_held_where_it_is(
    world, executable, real, within, gap, cause
):
    timing = {"use_sim_time": not real, "max_latency": ANY_LATENCY}
    node = Controlled(world, executable, FRAMES | timing)
    arm = node.arm
    node.follow(upwards(arm.q))
    status = node.peer.status(node.name, lambda s: "no valid joint_states" in s.message)
    assert status.level == b"\x02"
    assert f"no valid joint_states within {within} s: no commands; is the" in status.message
    told = "see to the robot and the network; when they are back the arm is held where it is"
    assert values(status)["remedy"] == told
    assert arm.commands == []
    q, arm.dq = arm.q + 0.05, np.zeros(6)
    assert_holds(arm.tick(q, dt=gap), q)
    assert_holds(arm.ticks(10)[-1], q)
    status = node.status(lambda s: f"holding the measured pose, {cause}" in s.message)
    assert status.level == b"\x01"
    assert values(status)["remedy"] == "send the reference again"


# --- references ------------------------------------------------------------------------------
def test_references_that_cannot_be_followed_are_refused_and_the_motion_goes_on(node):
    """Not finite, in another frame, or too far; the others: test_messages."""
    arm = node.arm
    node.follow(upwards(arm.q))
    before = node.peer.counter(node.name, "reference rejected")
    p, R = pose(arm.q)
    bad = [reference(DesiredFrame(p + [0.0, y, 0.0], R)) for y in (0.0, 0.3, math.nan)]
    bad[0].header.frame_id = "world"
    for msg in bad:
        node.references.publish(msg)
    assert node.peer.counter(node.name, "reference rejected", before + 3) == before + 3
    arm.ticks(100)
    assert np.abs(arm.dq).max() > MOVES
    warned = node.status(lambda s: s.message.endswith("following a reference; reference rejected"))
    assert warned.level == b"\x01"  # at once, and for some seconds
    assert "non-finite" in values(warned)["last rejected"]
    later = node.status(lambda s: s.message.endswith("following a reference"))
    assert later.level == b"\x00"  # there was none any more


def test_set_points_that_stop_are_a_warning_with_what_to_do_and_the_arm_comes_to_rest(node):
    arm = node.arm
    p, R = pose(arm.q)
    node.follow(reference(DesiredFrame(p, R, dp_d=np.array([0.0, 0.0, 0.05]))))
    status = node.status(lambda s: "the set-points have stopped" in s.message)
    assert status.level == b"\x01"
    assert "holding the last desired pose: the set-points have stopped" in status.message
    assert values(status)["remedy"] == "see to the node that sends them"
    arm.ticks(300, dt=0.004)
    assert np.abs(arm.dq).max() < AT_REST
    held = p + [0.0, 0.0, 0.05 * 0.1]  # where its twist has led it within reference_timeout
    brakes = 0.006  # from what it took to catch up with it
    within = 0.01 if node.name == "impedance_control" else LAW_IN_A_NODE  # its impedance ends there
    away = pose(arm.q)[0] - held
    assert np.linalg.norm(away[:2]) < within
    assert -within < away[2] < brakes + within
    node.references.publish(reference(DesiredFrame(*pose(arm.q))))
    assert node.status(lambda s: "following a reference" in s.message).level == b"\x00"


# --- what slows a motion down ----------------------------------------------------------------
def watch(node, q, count, seconds=0.5):
    """Go to where the joints are at q (n,); return what /diagnostics said meanwhile, and the paces.

    Assert that no joint is faster, and no effort larger, than the limits allow.
    """
    heard = node.peer.listen(DiagnosticArray, "/diagnostics")
    node.references.publish(reference(DesiredFrame(*pose(q)), times=(seconds,)))
    for command in (node.arm.tick(dt=0.004) for _ in range(count)):
        assert (np.abs(node.arm.dq) <= MODEL.limits.velocity * (1 + SPEED_LIMIT)).all()
        assert (np.abs(command.effort) <= MODEL.limits.effort[: len(command.effort)]).all()
    node.peer.status(node.name)
    own = [s for msg in heard for s in msg.status if s.name == node.name]
    told = [values(s) | {"message": s.message} for s in own]
    return told, [float(each["pace"]) for each in told if "pace" in each]


def says(told, *words):
    return all(any(each in one["message"] for one in told) for each in words)


def test_a_kinematic_singularity_slows_the_motion_down_and_diagnostics_tell_where_it_is(node):
    q_0, q_1 = HOME.copy(), HOME.copy()
    q_0[4], q_1[4] = -0.15, 0.15  # the singularity of the wrist is halfway
    start_at(node, q_0)
    told, paces = watch(node, q_1, count=700)
    codes = {each["kinematic singularity"] for each in told if "kinematic singularity" in each}
    assert codes == {"clear", "approaching", "inside", "leaving"}
    words = "following a reference; slowed down, {} a kinematic singularity"
    assert says(told, *map(words.format, ("approaching", "inside", "leaving")))
    assert "damped" in {each.get("inverse of J") for each in told}
    assert LEAST <= min(paces) < 0.8
    assert np.linalg.norm(pose(node.arm.q)[0] - pose(q_1)[0]) < SIMULATED_POSE
    assert not says(told, "holding still")


def test_a_joint_limit_slows_the_motion_down_and_diagnostics_tell_which_joint(node):
    limit, last = MODEL.limits.upper[5], np.eye(6)[5]
    q = HOME + (limit - 0.3 - HOME[5]) * last
    start_at(node, q)
    told, paces = watch(node, q + 0.295 * last, count=300)
    words = "slowed down, {} the limit of wrist_3_joint"
    assert says(told, *map(words.format, ("approaching", "inside")))
    assert {"approaching", "inside"} <= {each.get("limit of a joint") for each in told}
    assert min(paces) < 1.0
    assert limit - 0.01 < node.arm.q[5] <= limit
    assert says(watch(node, q, count=100)[0], "leaving the limit of wrist_3_joint")


# --- what is said, and what leaves -----------------------------------------------------------
def test_diagnostics_tell_since_when_what_to_do_and_the_last_fault(node):
    arm = node.arm

    def send_one():
        arm.q, arm.dq = arm.q + 1e-5, 0 * arm.q  # under the same stamp
        arm.send(arm.message())

    status = node.peer.status(node.name, lambda s: "stamp stays at" in s.message, send_one)
    told = values(status)
    assert status.message.startswith("holding still: joint_states moves")
    assert told["remedy"] == stuck("").remedy
    assert told["last fault"] == status.message
    faults = int(told["faults"])
    assert faults >= 1
    assert float(told["last fault at [s]"]) == pytest.approx(float(told["since"]), abs=0.1)
    again = node.status(lambda s: int(values(s)["faults"]) >= 1)
    assert (again.message, values(again)["since"]) == (status.message, told["since"])
    start_at(node, HOME)
    now = values(node.status(lambda s: s.message.startswith("active with")))
    assert now["last fault"] in {status.message, SILENT}  # it is not forgotten
    assert int(now["faults"]) >= faults


# --- the end ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("executable", "ready", "code", "number"),
    [
        ("reference", "waiting for a robot description", 0, signal.SIGINT),
        ("fault_injector", "faults to come", 0, signal.SIGTERM),
        ("identify_tool", "waiting for a robot description", 1, signal.SIGTERM),
    ],
)
def test_a_signal_ends_each_other_node_by_its_own_handler(graph, executable, ready, code, number):
    process = graph.start(executable)
    graph.peer.status(executable, lambda s: ready in s.message)
    process.signal(number)
    assert process.end() == code
    assert "Traceback" not in process.log
    errors = [line for line in process.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == code
    assert all("too few poses, 0; expected at least 3" in line for line in errors)


def test_a_defect_in_what_diagnostics_shows_is_said_and_ends_nothing(world):
    node = Controlled(world, "clik", FRAMES)

    def gather():
        raise ZeroDivisionError("planted")

    node.process.node._health.gather = gather
    node.status()
    assert "internal error ZeroDivisionError: planted" in node.process.log
    assert "of /diagnostics" in node.process.log
    assert_holds(node.arm.tick(), HOME)


# --- however control ends -----------------------------------------------------------------
# An arm of 0.25 m/s stops within this [m] at 1 m/s^2, with the jerk limit.
STOPPING_DISTANCE = 0.06
# A frictionless arm with its last effort moves by this [m] within 0.5 s at most: it is slower than
# AT_REST, and falls away from there.  It was 0.155 when the effort was that of a moving arm.
DRIFT = 0.01


class Moving(Controlled):
    """A controller whose arm moves at 0.2 m/s or more, and what it publishes."""

    def __init__(self, world, executable):
        super().__init__(world, executable, FRAMES)
        self.statuses = self.peer.listen(DiagnosticStatus, f"/{executable}/status", latched=True)
        self.sent = self.peer.listen(JointState, f"/{self.arm.topic}")
        p, R = pose(HOME)
        goal = DesiredFrame(p + [0.0, 0.0, 0.12], R)
        self.follow(reference(goal, times=(1.0,)))
        self.arm.ticks(125, dt=0.004)
        self.sent.clear()
        assert np.linalg.norm(self.speed()) > 0.15

    def speed(self):
        a, b = (pose(self.arm.q + dt * self.arm.dq)[0] for dt in (0.0, 1e-6))
        return (b - a) / 1e-6

    @property
    def told(self):
        return values(self.statuses[-1])

    def brakes(self, is_over):
        """Tick until the arm was let alone; return how far [m] the tip went."""
        start = pose(self.arm.q)[0]
        self.sent.clear()
        positions = self.arm.ticks_until(is_over)
        last = self.sent[-1]
        assert np.abs(self.arm.dq).max() < AT_REST
        stamps = [ns_from_ros(command.header.stamp) for command in self.sent]
        assert sorted(set(stamps)) == list(positions)  # each state was answered until then
        assert_may_stay(last, self.arm, within=AT_REST)
        count = len(self.sent)
        self.arm._obey(last)
        self.arm.send_next(20)
        assert len(self.sent) == count  # silence
        return float(np.linalg.norm(pose(self.arm.q)[0] - start))


@pytest.mark.parametrize(
    ("executable", "acts", "state"),
    [
        ("clik", "deactivate", "inactive"),
        ("clik", "deactivate cleanup unconfigured_shutdown", "finalized"),
        ("dynamic_control", "deactivate", "inactive"),
        ("dynamic_control", "active_shutdown", "finalized"),
        ("impedance_control", "deactivate cleanup", "unconfigured"),
        ("clik", "signal", "active"),
        ("clik", "deactivate signal", "inactive"),
        ("dynamic_control", "signal", "active"),
        ("dynamic_control", "deactivate cleanup signal", "unconfigured"),
    ],
)
def test_however_control_ends_the_arm_is_braked_after_it_has_returned(
    world, executable, acts, state
):
    node = Moving(world, executable)
    at_rest, is_signal = node.process.node.at_rest, acts.endswith("signal")
    for transition in acts.removesuffix("signal").split():
        assert node.peer.change_state(executable, transition)

    def is_over():
        is_let_alone = node.told["mode"] in ("inactive", "finalized")
        return world.act(at_rest) if is_signal else is_let_alone

    assert node.peer.lifecycle_state(executable) == state
    assert not is_over()
    assert node.brakes(is_over) < STOPPING_DISTANCE
    told = [values(status) for status in node.statuses]
    assert ("stopped", "deactivated") in [(one["mode"], one["cause"]) for one in told]
    if executable != "clik":  # a driver without a timeout holds the last effort
        rest = pose(node.arm.q)[0]
        for _ in range(500):
            node.arm._pass(0.001, None)
        assert np.linalg.norm(pose(node.arm.q)[0] - rest) < DRIFT
    if is_signal:
        assert node.process.stop() == 0
        return
    if state == "unconfigured":
        assert node.peer.change_state(executable, "configure")
    if state != "finalized":
        node.arm.dq = np.zeros(6)
        node.arm.send_next(20)
        assert node.peer.change_state(executable, "activate")


def test_a_status_is_published_once_however_often_another_joint_is_nearest_to_its_limit(world):
    node = Controlled(world, "clik", FRAMES)
    pace = node.process.node._controller.guidance.pace
    pace.update = lambda *_: None
    statuses = world.peer.listen(DiagnosticStatus, "/clik/status", latched=True)
    node.arm.tick()
    before = len(statuses)
    pace.limit = Nearness.APPROACHING
    for k in range(20):
        pace.joint = k % 2
        node.arm.tick()
    assert len(statuses) == before + 1
    assert "approaching the limit of" in statuses[-1].message


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_an_arm_whose_states_wait_for_their_references_is_braked_too_where_none_comes_any_more(
    world, executable
):
    arm = {"clik": Arm, "dynamic_control": TorqueArm}[executable](world, UR5)
    world.start(executable, FRAMES | {"reference_pairing": "stamp"})
    references = world.peer.publisher(MultiDOFJointTrajectory, "/reference")
    statuses = world.peer.listen(DiagnosticStatus, f"/{executable}/status", latched=True)

    def send(dt):
        arm.t += round(dt * 1e9)
        world.advance(dt)
        arm.commands.clear()
        arm.send(arm.message())

    for _ in range(400):
        if not references.get_subscription_count():  # until it is active
            send(0.005)
    p, R = pose(HOME)
    for k in range(1, 301):
        arm._pass(0.001, None)
        send(0.001)
        t = 0.001 * k
        at = DesiredFrame(p + [0.0, 0.0, t * t / 4], R, np.array([0.0, 0.0, t / 2]))
        msg = reference(at)
        msg.header.stamp = arm.message().header.stamp
        references.publish(msg)
        arm._obey(arm.commands[-1])
    assert np.abs(arm.dq).max() > 10 * AT_REST
    assert world.peer.change_state(executable, "deactivate")
    for _ in range(1000):
        if values(statuses[-1])["mode"] != "inactive":
            arm._pass(0.001, None)
            send(0.001)
            for command in arm.commands[-1:]:
                arm._obey(command)
    assert values(statuses[-1])["mode"] == "inactive"
    assert np.abs(arm.dq).max() < AT_REST
    assert_may_stay(arm.commands[-1], arm, within=AT_REST)


def test_while_it_is_braked_an_arm_is_neither_led_nor_resumed_nor_taken_anew(world):
    node = Moving(world, "clik")
    assert node.peer.change_state("clik", "deactivate")
    assert node.references.get_subscription_count() == 0
    assert not node.peer.change_state("clik", "activate")
    assert "still being brought to rest" in node.process.log
    assert node.peer.change_state("clik", "cleanup")
    assert not node.peer.change_state("clik", "configure")
    assert node.brakes(lambda: node.told["mode"] == "inactive") < STOPPING_DISTANCE
    assert node.peer.change_state("clik", "configure")


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_an_arm_that_does_not_come_to_rest_or_tells_nothing_any_more_is_let_alone(
    world, executable
):
    node = Moving(world, executable)
    assert node.peer.change_state(executable, "deactivate")
    start = world.now
    while node.told["mode"] != "inactive":
        node.arm.t += MS
        node.arm.send(node.arm.message())  # it goes on as it did, whatever it is told
        world.advance(0.01)
        assert world.now < start + LONGEST + 0.6
    assert world.now > start + LONGEST + 0.3  # twice v / a more
    if executable == "dynamic_control":  # its brakes have to act, not an effort of a moment ago
        assert_may_stay(node.sent[-1], node.arm)
    node.process.kill()
    node = Moving(world, executable)
    assert node.peer.change_state(executable, "deactivate")
    world.advance(0.5)  # nothing comes
    assert node.told["mode"] == "inactive"
    assert node.sent == []


# --- a defect, a halt, limits ---------------------------------------------------------------
@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_a_defect_outside_the_law_ends_the_node_with_the_arm_at_rest_and_one_line(
    graph, executable
):
    # a process ages by the real time, whatever else runs
    slow = {"max_linear_speed": 0.03, "state_timeout": 20.0}
    node = Controlled(graph, f"{executable} broken in timer", FRAMES | slow)
    node.follow(upwards(HOME))
    sent = node.peer.listen(JointState, f"/{node.arm.topic}")
    graph.until(lambda: node.arm.tick() and sent, "a command that is heard")
    positions = node.arm.ticks_until(lambda: node.process.exit_code is not None)
    assert node.process.end() == 1
    assert np.abs(node.arm.dq).max() < AT_REST
    (line,) = (each for each in node.process.stderr.splitlines() if "error: internal" in each)
    assert "planted in a timer (broken_node.py:" in line
    assert "Traceback" not in node.process.log
    graph.until(lambda: ns_from_ros(sent[-1].header.stamp) in positions, "the last command")
    node.arm.q = positions[ns_from_ros(sent[-1].header.stamp)]
    assert_may_stay(sent[-1], node.arm, within=AT_REST * DT)


@pytest.mark.parametrize("executable", ["clik", "dynamic_control"])
def test_an_arm_that_is_halted_says_so_and_is_resumed_when_it_is_at_rest(world, executable):
    node = Moving(world, executable)

    def ask(service):
        """Return why a service refuses."""
        response = node.peer.trigger(f"/{executable}/{service}")
        return "" if response.success else response.message

    assert ask("halt") == ""
    assert "ask when it is at rest" in ask("resume")
    status = values(node.status(lambda s: values(s)["mode"] == "stopped"))
    assert (status["cause"], status["remedy"]) == ("halt", "call ~/resume")
    poses = node.peer.listen(PoseStamped, f"{executable}/pose")
    errors = node.peer.listen(TwistStamped, f"{executable}/error")
    node.arm.ticks(1000)
    assert np.abs(node.arm.dq).max() < AT_REST
    assert errors  # while it braked
    errors.clear()
    pushed = node.arm.q + 1e-4
    for _ in range(50):
        node.arm.tick(pushed)
    frame = pose_from_ros(poses[-1], AT_ORIGIN)
    for found, expected in zip((frame.p_d, frame.R_d), pose(pushed), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)
    assert not errors
    assert ask("resume") == ""
    assert values(node.status())["mode"] == "holding"
    assert node.peer.change_state(executable, "deactivate")
    assert all("not active" in ask(service) for service in ("halt", "resume"))


def test_that_limits_change_most_commands_is_said(world):
    slack = {"max_joint_acceleration": [0.05], "max_error_position": 10.0, "max_deviation": 10.0}
    node = Controlled(world, "clik", FRAMES | slack | {"max_error_rotation": 3.0})
    p, R = pose(HOME)
    sides = [0.04, -0.04]

    def hurries():
        sides.reverse()
        node.references.publish(reference(DesiredFrame(p + [0.0, sides[0], 0.0], R), times=(0.5,)))
        node.arm.ticks(60)
        return "limits have changed" in node.process.log

    world.until(hurries, "that most commands are changed")
    assert "commands of the last second: the motion is faster than the arm" in node.process.log
