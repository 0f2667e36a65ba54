"""The node ``impedance_control`` as its users run it: what it has of its own.

Its arm is moved by the test, as its dynamics and what touches it say.
What a wrench, a contact and a lost sensor do, is seen in the messages.  With ``use_sim_time``
the age of a wrench goes by the stamps, so that nothing depends on how fast the machine is.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from arms import assert_no_jump
from geometry_msgs.msg import WrenchStamped
from in_process import World
from ros_processes import (
    AT_ONCE,
    HOME,
    MODEL,
    UR5,
    Array,
    Controlled,
    FeelingArm,
    assert_holds,
    pose,
    reference,
    values,
    wrench_stamped,
)
from sensor_msgs.msg import JointState
from tolerances import LAW_IN_A_NODE, assert_close
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.laws.rotations import S, angle_between, quaternion
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.motion.frames import DesiredFrame

NAME = "impedance_control"
MS = 1_000_000  # [ns] of a tick
DT = 0.001  # [s]
# The impedance of the shared nodes: critically damped at 45 rad/s, so that it settles soon.
M_P, K_P, M_O, K_O = 1.0, 2000.0, 0.05, 100.0
D_P, D_O = 2 * math.sqrt(M_P * K_P), 2 * math.sqrt(M_O * K_O)
IMPEDANCE = {
    **{"M_p": [M_P] * 3, "K_p": [K_P] * 3, "damping_ratio_p": 1.0},
    **{"M_o": [M_O] * 3, "K_o": [K_O] * 3, "damping_ratio_o": 1.0},
}
SIMULATED = {
    **{**AT_ONCE, **IMPEDANCE, "use_sim_time": True, "tare_samples": 20},
    "max_effort_rate": [1e4],
}
# Sums of forces of 20 N, from numbers that are rounded to 1e-16 of their size, times 2000 / s^2.
EQUATION = 1e-10
# That of the nodes here [Nm/s], and the rounding of the difference of two efforts of up to 150 Nm.
EFFORT_RATE, EFFORT_ROUNDING = 1e4, 1e-12
# A frozen frame stops with this time constant [s]: e^-9 of 0.2 m/s or 1 rad/s is left 0.45 s later.
STOP_TIME, STOPPED = 0.05, 2e-4
# What the motion loop leaves of the compliant frame while nothing else acts [m, rad].
AT_FRAME = 1e-4


@pytest.fixture(scope="module")
def shared(shared_world: World) -> Callable[[str], Controlled]:
    """Starts the nodes that the tests of this module share, one for each pairing."""

    @cache
    def start(pairing: str) -> Controlled:
        parameters = {**SIMULATED, "wrench_pairing": pairing}
        return Controlled(shared_world, NAME, parameters, namespace=f"/{pairing}")

    return start


def use(controlled: Controlled) -> Iterator[Controlled]:
    """Let nothing touch the arm, and its sensor be as it should."""
    arm, sensor = controlled.arm, controlled.arm.sensor
    arm.push()
    sensor.on, sensor.late, sensor.bias = True, False, np.zeros(6)
    arm.start_afresh()
    arm.frames.clear()
    yield controlled
    controlled.restore()


@pytest.fixture
def node(shared: Callable[[str], Controlled]) -> Iterator[Controlled]:
    """A node that takes the newest wrench, as it does by default."""
    yield from use(shared("latest"))


@pytest.fixture
def paired(shared: Callable[[str], Controlled]) -> Iterator[Controlled]:
    """A node that waits for the wrench of each state, so that nothing is left to chance."""
    yield from use(shared("stamp"))


def stamps_since(arm: FeelingArm, count: int) -> list[int]:
    """Return the stamps [ns] of the last ``count`` ticks of 1 ms."""
    return [arm.t - i * MS for i in reversed(range(count))]


def felt(arm: FeelingArm, count: int) -> list[DesiredFrame]:
    arm.ticks(count)
    return arm.frames_of(stamps_since(arm, count))


def settled(arm: FeelingArm) -> DesiredFrame:
    arm.ticks(45, dt=0.01)  # e^-20 of what moved is left
    return arm.frame()


def assert_impedance(frame: DesiredFrame, p_d: Array, R_d: Array, wrench: Array) -> None:
    """Assert eqs. (52) and (59) with (60) of a message, for a desired frame at rest."""
    force = M_P * frame.ddp_d + D_P * frame.dp_d + K_P * (frame.p_d - p_d)
    assert_close(force, wrench[:3], EQUATION)
    eta, eps = quaternion(R_d.T @ frame.R_d)
    E = eta * np.eye(3) - S(eps)  # eq. (10)
    x, dx = R_d.T @ frame.omega_d, R_d.T @ frame.domega_d
    moment = M_O * dx + D_O * x + 2 * K_O * E.T @ eps
    assert_close(moment, R_d.T @ wrench[3:], EQUATION)


def assert_at_rest(frames: Sequence[DesiredFrame]) -> None:
    """Assert that all frames are the same, and at rest, but for what is left of a stop."""
    for frame in frames:
        assert_close(frame.p_d, frames[0].p_d, LAW_IN_A_NODE)
        assert angle_between(frame.R_d, frames[0].R_d) < LAW_IN_A_NODE
        np.testing.assert_allclose(frame[2:4], 0.0, atol=STOPPED)


# --- one state, one wrench, one command ------------------------------------------------------
def test_with_pairing_by_stamps_each_state_is_answered_once_with_its_own_wrench(paired):
    arm, (p, R) = paired.arm, pose(HOME)
    commands = paired.peer.listen(JointState, f"/stamp/{arm.topic}")
    for i in range(20):
        arm.sensor.late = i % 2 == 0
        push = np.array([0.5 * i, -i, 0.0, 0.0, 0.02 * i, 0.0])
        arm.push(*push)
        arm.tick()
        assert_impedance(arm.frame(), p, R, push)

    stamps = stamps_since(arm, 20)
    assert [ns_from_ros(msg.header.stamp) for msg in commands] == stamps
    assert [ns_from_ros(msg.header.stamp) for msg in arm.frames] == stamps

    end = settled(arm)
    assert_close(end.p_d - p, push[:3] / K_P, LAW_IN_A_NODE)
    assert np.linalg.norm(pose(arm.q)[0] - end.p_d) < LAW_IN_A_NODE
    arm.push()
    assert angle_between(settled(arm).R_d, R) < LAW_IN_A_NODE


def test_with_pairing_by_stamps_a_state_waits_for_its_wrench_and_is_dropped_for_the_next(paired):
    arm, (p, R) = paired.arm, pose(HOME)
    arm.ticks(3)
    dropped = "states dropped, waiting for what belongs to them"
    before = paired.peer.counter(paired.name, dropped)
    arm.sensor.on = False
    arm.send_next()
    assert arm.commands == []
    arm.push(10.0, 0.0, 0.0)
    wrench = arm.sensor.message(arm, arm.message().header.stamp)
    arm.sensor.wrenches.publish(wrench)
    assert arm.answer().header.stamp == wrench.header.stamp
    assert_impedance(arm.frame(), p, R, np.array([10.0, 0, 0, 0, 0, 0]))
    arm.send_next(2)  # the first of them is dropped
    arm.sensor.on = True
    arm.tick()
    assert paired.peer.counter(paired.name, dropped, before + 2) == before + 2


# --- wrenches that cannot be used ------------------------------------------------------------
def broken_wrenches(arm: FeelingArm) -> list[WrenchStamped]:
    """Return wrenches that cannot be used, enormous where they are finite."""
    stamp = arm.message().header.stamp
    nan, inf, unknown, moving, unnamed = (arm.sensor.message(arm, stamp) for _ in range(5))
    unknown.header.frame_id = "tool1"
    moving.header.frame_id = "forearm_link"
    unnamed.header.frame_id = ""
    for msg in (unknown, moving, unnamed):
        msg.wrench.force.y += 1e4
    nan.wrench.force.x = math.nan
    inf.wrench.torque.z = -math.inf
    return [nan, inf, unknown, moving, unnamed]


# --- the stiffness -------------------------------------------------------------------------
def until_displaced_by(node: Controlled, x: float, within: float = 1e-5) -> None:
    """Tick until the compliant frame has come to rest x [m] from home, along x."""
    start = pose(HOME)[0][0]

    def is_there() -> bool:
        node.arm.tick(dt=0.01)
        return abs(node.arm.frame().p_d[0] - start - x) < within

    node.graph.until(is_there, f"a displacement of {x} m")


def test_the_stiffness_follows_its_topic_until_it_is_set(paired):
    arm = paired.arm
    stiffness = paired.peer.sender(WrenchStamped, "/stamp/target_stiffness")

    def ask(K_x: float, frame: str = "") -> None:
        stiffness.publish(wrench_stamped(K_x, K_P, K_P, K_O, K_O, K_O, frame=frame))

    arm.push(8.0, 0.0, 0.0)
    until_displaced_by(paired, 8.0 / K_P)
    bad = ((math.nan, ""), (-1.0, ""), (1e9, ""), (500.0, "tool1"))
    for each in bad:
        ask(*each)
    assert paired.peer.counter(paired.name, "target_stiffness rejected", len(bad)) == len(bad)
    settled(arm)
    until_displaced_by(paired, 8.0 / K_P)
    ask(500.0, UR5.base_frame)
    frames = felt(arm, 300)
    until_displaced_by(paired, 8.0 / 500.0)
    steps, accelerations = np.diff([f.dp_d for f in frames], axis=0), [f.ddp_d for f in frames]
    assert np.abs(steps).max() <= 1.1 * DT * np.abs(accelerations).max()
    assert np.abs(accelerations).max() < 0.2 * 8.0 / M_P  # of a stiffness that were gone at once
    for name, value in {"wrench_cutoff": 50.0, "orientation": "angle_axis"}.items():
        paired.change(**{name: value})  # the stiffness stays
        settled(arm)
        until_displaced_by(paired, 8.0 / 500.0)
    chain = paired.process.node._controller.scheme.chain
    before = vars(chain).copy()
    assert not paired.peer.set_at_once(  # nothing of what is refused is taken
        paired.name, orientation="euler_angles", wrench_bias=[8.0] + [0.0] * 5, M_p=[-1.0] * 3
    )
    assert vars(chain) == before
    paired.change(orientation="euler_parameters")
    until_displaced_by(paired, 8.0 / 500.0)
    paired.change(K_p=[K_P / 2] * 3)
    until_displaced_by(paired, 8.0 / (K_P / 2))


# --- the wrench stops ------------------------------------------------------------------------
@pytest.mark.parametrize("is_broken", [False, True], ids=["none comes", "none can be used"])
def test_while_no_wrench_comes_the_compliant_frame_is_frozen_and_held_and_then_goes_on(
    node, is_broken
):
    arm, (p, _) = node.arm, pose(HOME)
    arm.push(20.0, 0.0, 0.0, 0.0, 0.0, 0.5)
    commands = arm.ticks(20)
    last, bad = arm.frame(), broken_wrenches(arm)
    arm.sensor.on = False
    for i in range(100):  # as old as wrench_timeout is not too old
        if is_broken:
            arm.sensor.wrenches.publish(bad[i % len(bad)])
        commands.append(arm.tick())
    moving = arm.frames_of(stamps_since(arm, 100))
    assert_no_jump([last, *moving], DT)
    assert np.linalg.norm(moving[-1].dp_d) > 0.01
    for frame in moving:  # the last good one counts
        w = M_P * frame.ddp_d + D_P * frame.dp_d + K_P * (frame.p_d - p)
        assert_close(w, [20.0, 0.0, 0.0], 0.2)  # the tip turns a bit
    arm.push()
    still = [settled(arm), settled(arm)]
    assert_at_rest(still)
    way = STOP_TIME * moving[-1].dp_d  # of a velocity that decays
    assert_close(still[1].p_d, moving[-1].p_d + way, AT_FRAME)
    assert np.linalg.norm(pose(arm.q)[0] - still[-1].p_d) < AT_FRAME
    status = node.status(lambda s: "no valid wrench" in s.message)
    assert status.level == b"\x01"
    assert ("non-finite" in node.process.log) >= is_broken
    commands.append(arm.tick())
    last = arm.frame()
    arm.sensor.on = True
    commands += arm.ticks(40)
    assert_no_jump([last, *arm.frames_of(stamps_since(arm, 40))], DT)
    efforts = np.array([command.effort for command in commands])
    assert (np.abs(efforts) <= MODEL.limits.effort).all()
    for part in (efforts[:120], efforts[120:]):
        assert np.abs(np.diff(part, axis=0)).max() <= EFFORT_RATE * DT + EFFORT_ROUNDING
    assert_close(settled(arm).p_d, p, LAW_IN_A_NODE)
    status = node.status()
    assert status.level < b"\x02"
    assert "no valid wrench" not in status.message


def test_with_pairing_by_stamps_a_wrench_that_stops_does_not_end_the_motion(paired):
    arm, (p, R) = paired.arm, pose(HOME)
    goal = DesiredFrame(p + [0.0, 0.0, 0.05], R)
    paired.follow(reference(goal, times=(1.0,)))
    arm.ticks(50)
    arm.sensor.on = False

    paired.graph.until(lambda: (arm.send_next(), arm.commands)[1], "an answer without a wrench")
    arm.commands.clear()
    arm.sensor.on = True
    assert "following a reference" in paired.status(lambda s: "active with" in s.message).message


# --- activation and tare ---------------------------------------------------------------------
REFUSED = "a wrench above max_activation_force 5 N or max_activation_torque 0.5 Nm is felt: "


def test_a_felt_wrench_refuses_activation_until_it_is_tared_or_gone(world):
    arm, peer = FeelingArm(world, UR5), world.peer
    arm.sensor.bias = np.array([6.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    process = world.start(NAME, {**SIMULATED, "wrench_pairing": "stamp"})
    arm.sensor.on = False
    moves = "is not fixed to the tip 'tool0': wrist_1_joint, wrist_2_joint, wrist_3_joint can move"

    arm.sensor.wrenches.publish(broken_wrenches(arm)[3])
    arm.send_next()
    assert moves in process.log
    words = "no valid wrench yet; is the force/torque sensor running? (topic /wrench)"
    world.until_said(process, words)
    arm.sensor.on = True
    status = peer.status(NAME, lambda s: "a wrench above" in s.message, arm.send_next)
    assert status.level == b"\x01"
    assert f"not activated yet: {REFUSED}" in status.message
    peer.status(NAME, lambda s: values(s).get("contact force [N]") == "6", arm.send_next)
    assert not peer.change_state(NAME, "activate")
    assert f"not activated: {REFUSED}" in process.log
    assert peer.lifecycle_state(NAME) == "inactive"

    def answer() -> str:
        return str(peer.trigger(f"/{NAME}/tare").message)

    for _ in range(6):
        arm.q = arm.q + [0.0, 0.002, 0.0, 0.0, 0.0, 0.0]
        arm.send_next(4)
    assert "not tared: the arm moves; hold it still" in answer()
    arm.q = HOME
    arm.send_next(24)
    tared = "tared: force [6, 0, 0] N, moment [0, 0, 0] Nm about the tip in its axes, standard "
    assert answer().startswith(tared)
    assert arm.commands == []
    arm.connect()  # it activates itself
    assert_at_rest(felt(arm, 20))
    assert_close(arm.frame().p_d, pose(HOME)[0], LAW_IN_A_NODE)

    assert peer.change_state(NAME, "deactivate")
    arm.sensor.bias = np.array([31.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    arm.send_next(24)
    assert "at most max_tare_force 30 N" in answer()
    arm.sensor.bias = np.array([6.0, 0.0, 0.0, 0.0, 0.6, 0.0])

    def activated() -> bool:
        arm.send_next(20)
        return peer.change_state(NAME, "activate")

    assert not activated()
    arm.sensor.bias[4] = 0.4
    assert activated()  # as the moment is gone
    assert peer.change_state(NAME, "deactivate")
    assert peer.change_state(NAME, "cleanup")
    assert peer.change_state(NAME, "configure")
    assert not activated()  # the tare is forgotten
    arm.sensor.bias[:] = 0.0
    assert activated()  # as nothing is felt
    arm.commands.clear()
    assert_holds(arm.tick(), HOME)
    assert process.stop() == 0


@pytest.mark.parametrize(
    ("pairing", "simulated"), [("latest", True), ("stamp", True), ("stamp", False)]
)
@pytest.mark.parametrize("interval", [0.001, 1.0])
def test_a_simulator_that_repeats_its_first_state_is_answered(world, pairing, interval, simulated):
    arm = FeelingArm(world, UR5)
    process = world.start(NAME, {**SIMULATED, "use_sim_time": simulated, "wrench_pairing": pairing})

    def until_it_is_answered() -> None:
        while not arm.commands:
            world.advance(interval)
            arm.send(arm.message())
            assert world.now < 1100.0, process.log
        assert {ns_from_ros(command.header.stamp) for command in arm.commands} == {arm.t}
        assert_close(arm.frame().p_d, pose(HOME)[0], LAW_IN_A_NODE)
        assert "rejected" not in process.log

    until_it_is_answered()
    assert world.peer.change_state(NAME, "deactivate")
    world.peer.status(NAME, lambda s: values(s)["mode"] == "inactive")
    arm.commands.clear()
    arm.t += 10_000 * MS
    for _ in range(12):
        world.advance(0.001)
        arm.send(arm.message())
    assert world.peer.change_state(NAME, "activate"), process.log
    until_it_is_answered()


@pytest.mark.parametrize("simulated", [False, True])
def test_a_driver_that_repeats_itself_or_a_sensor_while_states_go_on_activates_nothing(
    world, simulated
):
    arm = FeelingArm(world, UR5)
    given = {"use_sim_time": simulated, "wrench_timeout": 60.0}
    process = world.start(NAME, SIMULATED | given)
    stuck = arm.sensor.message(arm, arm.message().header.stamp)
    arm.sensor.on = False

    def repeat() -> None:
        world.advance(0.001)
        arm.t += MS * simulated
        arm.sensor.wrenches.publish(stuck)
        arm.send(arm.message())

    for _ in range(40):
        repeat()
    status = world.peer.status(NAME, lambda s: "waiting for 10 wrenches" in s.message, repeat)
    assert values(status)["mode"] == "inactive"
    assert simulated or "wrench rejected: the stamp" in process.log
    assert arm.commands == []


def test_an_unstamped_sensor_that_measures_the_same_again_is_believed(world):
    arm = FeelingArm(world, UR5)
    world.start(NAME, SIMULATED | {"use_sim_time": False})
    same = arm.sensor.message(arm, arm.message().header.stamp)
    same.header.stamp.sec = same.header.stamp.nanosec = 0
    arm.sensor.on = False

    def answered() -> bool:
        world.advance(0.001)
        arm.sensor.wrenches.publish(same)
        arm.send_next()
        return bool(arm.commands)

    world.until(answered, "an answer")
    assert_close(arm.frame().p_d, pose(HOME)[0], LAW_IN_A_NODE)


def test_a_tare_is_refused_for_too_few_wrenches_and_for_a_contact_that_is_pressed(paired):
    paired.arm.push(8.0, 0.0, 0.0)
    paired.change(force_dead_band=0.0)  # what was felt with other parameters does not count
    paired.arm.ticks(15)
    words = "not tared: 5 more valid wrenches are needed, 20 in all (tare_samples)"
    assert paired.peer.trigger(f"/{paired.name}/tare").message == words
    settled(paired.arm)
    response = paired.peer.trigger(f"/{paired.name}/tare")
    assert not response.success
    assert "not tared: 8 N and" in response.message
    assert "are felt while the arm is controlled, more than max_activation_for" in response.message


# --- the tool and the bias of the sensor -----------------------------------------------------
def test_in_a_namespace_with_other_topics_a_sensor_of_the_other_sign_and_a_known_tool(world):
    """The arm is the left one; its URDF knows the tool, whose weight the sensor feels."""
    mass, com = 0.3, np.array([0.0, 0.03, 0.05])
    arm, peer = FeelingArm(world, UR5, "/left"), world.peer
    arm.sensor.wrenches = peer.publisher(WrenchStamped, "/left/ft/raw")
    arm.frames = peer.listen(MultiDOFJointTrajectory, "/left/soft")
    arm.sensor.mass, arm.sensor.com, arm.sensor.sign = mass, com, -1.0
    own = {"wrench_sign": -1, "sensed_mass": mass, "sensed_com": com.tolist()}
    own["compensate_tool_inertia"] = False  # with the wrong sign the arm does not do as commanded
    process = world.start(
        NAME,
        {**SIMULATED, **own, "wrench_pairing": "stamp"},
        namespace="/left",
        remap=("wrench:=ft/raw", "compliant_frame:=soft"),
    )
    arm.connect()
    assert_holds(arm.start_afresh(), HOME)  # the efforts know nothing of the tool
    p, _ = pose(HOME)
    for sign, direction in ((-1.0, 1.0), (1.0, -1.0)):  # what it says that the tool exerts
        arm.sensor.sign, arm.sensor.mass = sign, -sign * mass
        arm.start_afresh()
        arm.push(5.0, 0.0, 0.0)
        found = settled(arm).p_d - p
        expected = [direction * 5.0 / K_P, 0.0, 0.0]
        assert_close(found, expected, LAW_IN_A_NODE)
        arm.push()
    topics = {name for name, _ in peer.node.get_topic_names_and_types()}
    assert not topics & {"/joint_effort", "/compliant_frame", "/wrench", "/joint_states"}
    assert peer.node.count_subscribers("/left/wrench") == 0
    assert peer.node.count_publishers("/left/compliant_frame") == 0
    assert process.stop() == 0


# --- a force on the environment --------------------------------------------------------------
def target_wrench(arm: FeelingArm, *wrench: float, frame: str = UR5.tip_frame) -> WrenchStamped:
    """Return a target_wrench for the next state of an arm."""
    return wrench_stamped(*wrench, frame=frame, stamp=arm.message().header.stamp)


def broken_targets(arm: FeelingArm) -> list[tuple[WrenchStamped, str]]:
    """Return what is no target_wrench, and what is said of it."""
    return [
        (target_wrench(arm, 0.0, 0.0, math.nan), "non-finite"),
        (target_wrench(arm, 0.0, 0.0, 10.0, frame="forearm_link"), "expected 'tool0' or 'base"),
        (target_wrench(arm, 10.0, 0.0, 1.0), "a force along force_axes ['z']"),
        (target_wrench(arm, 0.0, 0.0, 10.0, 1.0), "expected no moment"),
        (target_wrench(arm, 0.0, 0.0, 200.0), "at most max_contact_force 140 N"),
    ]


def test_a_target_wrench_is_exerted_until_it_ends_and_not_again_after_a_halt(node):
    """On a wall of 2e4 N/m, 1 mm from the tool, which gives way along its z."""
    arm, peer, (p, R) = node.arm, node.peer, pose(HOME)
    targets = peer.sender(WrenchStamped, f"/{node.name.split('/')[0]}/target_wrench")
    n = R[:, 2]

    def wall(state: Any) -> Array:
        depth, speed = n @ (state.p_e - p) - 1e-3, n @ state.dp_e
        f = max(0.0, 2e4 * depth + 20.0 * speed) if depth > 0 else 0.0
        return np.append(-f * n, np.zeros(3))

    def exert(count: int, force: Array, frame: str = UR5.tip_frame) -> float:
        """Press for so many ticks; return the force [N]."""
        for _ in range(count):
            targets.publish(target_wrench(arm, *force, frame=frame))
            arm.tick()
        return float(-n @ arm.contact()[:3])

    arm.environment = wall
    for msg, words in broken_targets(arm):
        targets.publish(msg)
        arm.tick()
        assert words in node.process.log
    assert_close(pose(arm.q)[0], p, AT_FRAME)

    force = np.array([0.0, 0.0, 10.0])
    assert exert(800, force) == pytest.approx(10.0, rel=0.01)
    shown = values(node.status())
    assert shown["force exerted [N]"] == "[0, 0, 10]"
    assert exert(200, 1.2 * R @ force, frame=UR5.base_frame) == pytest.approx(12.0, rel=0.02)
    words = "force_axes cannot change while target_wrench is followed"
    assert words in peer.set_parameters(node.name, force_axes=["x"])[0]

    here = pose(arm.q)[0]
    arm.ticks(200)  # the stream has ended
    status = node.status(
        lambda s: "holding the measured pose, after the end of target_wrench" in s.message
    )
    assert values(status)["cause"] == "stream_ended"
    assert np.linalg.norm(pose(arm.q)[0] - here) < 1e-3

    assert exert(300, force) == pytest.approx(10.0, rel=0.02)
    here = pose(arm.q)[0]
    assert peer.trigger(f"/{node.name}/halt").success
    exert(200, force)
    assert "the arm is stopped: a force is exerted while it holds or follows" in node.process.log
    assert peer.trigger(f"/{node.name}/resume").success
    exert(200, 3.0 * force)
    assert "the arm was stopped meanwhile; send nothing for 0.5 s" in node.process.log
    assert np.linalg.norm(pose(arm.q)[0] - here) < 1e-3
