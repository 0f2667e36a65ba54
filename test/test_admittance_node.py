"""Admittance: ``impedance_control`` moves ``clik``, for arms that take positions.

``impedance_control`` with ``command_type: none`` publishes the compliant frame alone, which is the
reference of ``clik``.  The arm is moved by the test, or by ``pybullet_bridge``.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from in_process import Running, World
from ros_processes import AT_ONCE, HOME, MODEL, UNSHAPED, UR5, Arm, Array, pose, reference
from samples import rodrigues
from sensor_msgs.msg import JointState
from tolerances import LAW_IN_A_NODE, assert_close
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.robot.robot import RobotState

NAME = "impedance_control"
K_P, K_E, DEPTH = 2000.0, 2000.0, 0.01  # [N/m], [N/m], [m]
FORCE = K_P * K_E / (K_P + K_E) * DEPTH  # [N] of two springs in a row: 10

SIMULATED = {**AT_ONCE, "use_sim_time": True}
COMPLIANT = {
    **{**SIMULATED, "command_type": "none", "tare_samples": 20},
    **{"M_p": [1.0] * 3, "K_p": [K_P] * 3, "damping_ratio_p": 1.0},  # 45 rad/s
    **{"M_o": [0.05] * 3, "K_o": [100.0] * 3, "damping_ratio_o": 1.0},
}
FOLLOWING = ("reference:=compliant_frame",)
# An arm whose joints are slower than this stands [rad/s]; what is left of a motion at 10 ms.
AT_REST = 1e-6
# What CLIK at 100 / s leaves behind a frame that it learns of a tick late, at rest [m, rad].
FOLLOWED = 1e-5


def settle(arm: Arm) -> None:
    """Tick until what moves has come to rest, e^-20 of it."""
    arm.ticks(100, dt=0.01)  # slowed down at first, as after a gap


class CompliantArm(Arm):
    """An arm that takes positions, and goes on only when both nodes have answered.

    Else it would depend on the machine how many ticks the compliant frame is late.
    """

    alive = False  # impedance_control

    def tick(self, q: Array | None = None, dt: float = 0.001) -> Any:
        command = super().tick(q, dt)
        if self.alive:
            self.frame()
        return command


class Admittance:
    """Both nodes with an arm that takes positions, and feels what touches it."""

    def __init__(self, world: World) -> None:
        self.world, self.peer = world, world.peer
        self.arm = CompliantArm(world, UR5)
        self.arm.wear_sensor()
        self.references = self.peer.publisher(MultiDOFJointTrajectory, "reference")
        self.impedance = self.start_impedance()
        parameters = SIMULATED | UNSHAPED | {"reference_timeout": 0.02}  # a blow does not last
        clik = world.start("clik", parameters, remap=FOLLOWING)
        self.arm.connect()
        self.arm.frames.clear()

        def following() -> bool:
            self.arm.tick()
            return bool(self.arm.frames) and "following a reference" in clik.log

        world.until(following, "clik following")
        self.arm.alive = True

    def start_impedance(self) -> Running:
        return self.world.start(NAME, COMPLIANT)


@pytest.fixture(scope="module")
def shared(shared_world: World) -> Admittance:
    return Admittance(shared_world)


@pytest.fixture
def both(shared: Admittance) -> Iterator[Admittance]:
    """Both nodes, active, with the arm at home, untouched."""
    arm = shared.arm
    arm.release()
    arm.sensor.on = True
    arm.start_afresh()
    yield shared
    arm.release()


def spring(anchor: Array) -> Callable[[RobotState], Array]:
    """Return what a spring exerts that is at rest where the tip is at ``anchor`` (3,) [m]."""
    return lambda state: np.concatenate((K_E * (anchor - state.p_e), np.zeros(3)))


# --- the arm that the test moves -------------------------------------------------------------
def test_the_arm_presses_a_spring_as_both_stiffnesses_say_and_yields_to_a_moment(both):
    arm, (p, R) = both.arm, pose(HOME)
    arm.environment = spring(p)
    both.references.publish(reference(DesiredFrame(p + [DEPTH, 0.0, 0.0], R), times=(0.1,)))
    both.world.until(lambda: np.abs((arm.tick(), arm.dq)[1]).max() > 1e-3, "motion")
    arm.ticks(100)
    settle(arm)
    assert_close(arm.contact()[:3], [-FORCE, 0.0, 0.0], 0.01 * FORCE)
    assert np.linalg.norm(pose(arm.q)[0] - arm.frame().p_d) < FOLLOWED
    arm.push(0.0, 0.0, 0.0, 0.0, 0.0, 2.0)
    settle(arm)
    turned = rodrigues(np.arcsin(2.0 / 100.0), np.array([0.0, 0.0, 1.0])) @ R
    assert angle_between(pose(arm.q)[1], turned) < FOLLOWED
    assert_close(pose(arm.q)[0], p + [DEPTH, 0.0, 0.0], FOLLOWED)


def test_a_blow_is_followed_from_its_first_frame(both):
    before = both.peer.counter("clik", "reference rejected")
    both.arm.push(20.0, 0.0, 0.0)  # 20 m/s^2, 0.1 m in 0.1 s if it lasted
    both.arm.ticks(30)
    assert both.peer.counter("clik", "reference rejected") == before


def test_when_impedance_control_is_killed_clik_holds_and_its_successor_begins_where_the_arm_is(
    both,
):
    arm = both.arm
    arm.push(8.0, 0.0, 0.0)
    arm.ticks(20)
    assert np.abs(arm.dq).max() > 0.05
    arm.alive = False
    both.impedance.kill()
    arm.ticks(110)  # a set-point lasts 0.1 s
    settle(arm)
    q, count = arm.q, len(arm.frames)
    arm.ticks(20)
    assert_close(arm.q, q, LAW_IN_A_NODE)
    assert np.abs(arm.dq).max() < AT_REST
    assert len(arm.frames) == count
    arm.release()
    both.impedance = both.start_impedance()
    active = "active with"
    both.world.until(lambda: (arm.send_next(), active in both.impedance.log)[1], active)
    arm.commands.clear()
    arm.alive = True
    settle(arm)
    assert_close(arm.frame().p_d, pose(q)[0], FOLLOWED)
    assert_close(arm.q, q, FOLLOWED)
    arm.push(0.0, 5.0, 0.0)
    both.world.until(lambda: np.abs((arm.tick(), arm.dq)[1]).max() > 1e-3, "clik finding it")
    settle(arm)
    moved = pose(arm.q)[0] - pose(q)[0]
    assert_close(moved, [0.0, 5.0 / K_P, 0.0], FOLLOWED)


# --- an arm that says less -------------------------------------------------------------------
class PositionArm(Arm):
    """An arm that goes where the compliant frame is, and measures no velocities."""

    topic = "compliant_frame"

    def message(self, q: Array | None = None) -> Any:
        msg = super().message(q)
        msg.velocity = []
        return msg

    def _obey(self, command: Any) -> None:
        frame = self._frame(command)
        self.q = inverse_kinematics(MODEL, frame, self.q)


def test_an_arm_without_velocities_and_inertias_is_compliant_too(world):
    urdf = re.sub(r"<inertial>.*?</inertial>", "", UR5.urdf, flags=re.DOTALL)
    assert urdf.count("<inertial>") == 0 < UR5.urdf.count("<inertial>")
    arm = PositionArm(world, replace(UR5, urdf=urdf), command=MultiDOFJointTrajectory)
    arm.wear_sensor()
    process = world.start(NAME, {**COMPLIANT, "wrench_pairing": "stamp"})
    arm.connect()
    arm.start_afresh()
    p, R = pose(HOME)
    arm.environment = spring(p - [DEPTH, 0.0, 0.0])
    arm.ticks(80, dt=0.005)
    moved = arm.frame().p_d - p
    assert_close(moved, [-FORCE / K_P, 0.0, 0.0], 0.01 * FORCE / K_P)
    assert angle_between(arm.frame().R_d, R) < LAW_IN_A_NODE
    topics = {name for name, _ in world.peer.node.get_topic_names_and_types()}
    assert not topics & {"/joint_effort", "/joint_reference"}
    assert process.stop() == 0
    assert "error" not in process.stderr


# --- with the simulated robot ----------------------------------------------------------------


END, STEP = 400_000_000, 2_000_000  # [ns]
KINDS = {
    "joint_reference": JointState,
    "joint_states": JointState,
    "compliant_frame": MultiDOFJointTrajectory,
    "wrench": WrenchStamped,
}


def stamp(msg: Any) -> int:
    return ns_from_ros(msg.header.stamp)


def pressed(world: World, namespace: str) -> dict[str, list[Any]]:
    """Return what is said by topic while the arm is led into a spring, in lock-step."""
    peer, (p, R) = world.peer, pose(HOME)
    bridge = {
        **{"mode": "lockstep", "control": "position", "rate": 1e9 / STEP, "duration": END / 1e9},
        "environment.wall.shape": "spring",
        "environment.wall.position": p.tolist(),
        "environment.wall.stiffness": K_E,
    }
    said = {name: peer.listen(kind, f"{namespace}/{name}") for name, kind in KINDS.items()}
    goals = peer.publisher(MultiDOFJointTrajectory, f"{namespace}/reference")
    robot = world.start("pybullet_bridge", bridge, namespace=namespace)
    waits = {"require_reference": True, "wait_for_subscribers": 2}
    world.start(NAME, {**COMPLIANT, **waits, "wrench_pairing": "stamp"}, namespace=namespace)
    clik = {**SIMULATED, **waits, "reference_pairing": "stamp"}
    world.start("clik", clik, namespace=namespace, remap=FOLLOWING)
    world.until(goals.get_subscription_count, "a subscriber of reference")
    world.until(lambda: said["joint_states"] and said["wrench"], "the first state")  # repeated
    goals.publish(reference(DesiredFrame(p + [DEPTH, 0.0, 0.0], R), times=(0.1,)))
    world.until(lambda: all(m and stamp(m[-1]) == END for m in said.values()), "the end")
    assert robot.end() == 0
    return said


def test_in_lockstep_the_predicted_contact_force_is_reached_and_two_runs_are_equal_to_the_bit(
    world,
):
    found = []
    for namespace in ("/first", "/second"):
        said = pressed(world, namespace)
        found.append(
            {name: {stamp(m): str(m) for m in messages} for name, messages in said.items()}
        )
        contact, q = said["wrench"][-1].wrench.force, said["joint_states"][-1].position[:6]
        w = pose(q)[1] @ [contact.x, contact.y, contact.z]
        assert_close(w, [-FORCE, 0.0, 0.0], 0.01 * FORCE)
    for texts in found[0].values():
        assert list(texts) == list(range(0, END + 1, STEP))
    assert found[0] == found[1]
    commands = found[0]["joint_reference"]
    assert len(set(commands.values())) == len(commands)
