"""Admittance: the compliant frame of ``impedance_control`` is the reference of ``clik``.

The arm, which takes positions, is moved by the test; the experiment ``admittance`` has the forces
with the simulated robot.
"""

from typing import Any

import numpy as np
import pytest
from in_process import World
from ros_processes import AT_ONCE, HOME, UNSHAPED, UR5, Arm, pose, reference
from samples import rodrigues
from tolerances import LAW_IN_A_NODE, assert_close
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.motion.frames import DesiredFrame

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


class Admittance:
    """Both nodes with an arm that takes positions, and feels what touches it."""

    def __init__(self, world: World, **of_clik: Any) -> None:
        self.world, self.peer = world, world.peer
        self.arm = Arm(world, UR5)
        self.arm.wear_sensor()
        self.references = self.peer.publisher(MultiDOFJointTrajectory, "reference")
        self.impedance = world.start(NAME, COMPLIANT)
        parameters = SIMULATED | UNSHAPED | {"reference_timeout": 0.02}  # a blow does not last
        clik = world.start("clik", parameters | of_clik, remap=FOLLOWING)
        self.arm.connect()
        self.arm.frames.clear()

        def following() -> bool:
            self.arm.tick()
            return bool(self.arm.frames) and "following a reference" in clik.log

        world.until(following, "clik following")
        self.arm.start_afresh()

    def until_it_moves(self, ticks: int = 0) -> None:
        """Tick until the arm moves, for some ticks, and until it has come to rest."""
        self.world.until(lambda: np.abs((self.arm.tick(), self.arm.dq)[1]).max() > 1e-3, "motion")
        self.arm.ticks(ticks)
        settle(self.arm)


@pytest.mark.parametrize("pairing", ["latest", "stamp"])
def test_the_arm_presses_a_spring_as_both_stiffnesses_say_and_yields_to_a_moment(world, pairing):
    both = Admittance(world, reference_pairing=pairing)
    arm, (p, R) = both.arm, pose(HOME)
    arm.environment = lambda state: np.concatenate((K_E * (p - state.p_e), np.zeros(3)))
    both.references.publish(reference(DesiredFrame(p + [DEPTH, 0.0, 0.0], R), times=(0.1,)))
    both.until_it_moves(100)
    assert_close(arm.contact()[:3], [-FORCE, 0.0, 0.0], 0.01 * FORCE)
    assert np.linalg.norm(pose(arm.q)[0] - arm.frame().p_d) < FOLLOWED
    arm.push(0.0, 0.0, 0.0, 0.0, 0.0, 2.0)
    settle(arm)
    turned = rodrigues(np.arcsin(2.0 / 100.0), np.array([0.0, 0.0, 1.0])) @ R
    assert angle_between(pose(arm.q)[1], turned) < FOLLOWED
    assert_close(pose(arm.q)[0], p + [DEPTH, 0.0, 0.0], FOLLOWED)
    both.impedance.kill()
    arm.send_next()
    assert len(arm.commands) == (pairing == "latest")  # else a state waits for its frame


def test_when_impedance_control_is_killed_clik_holds_and_its_successor_begins_where_the_arm_is(
    world,
):
    both = Admittance(world)
    arm = both.arm
    before = both.peer.counter("clik", "reference rejected")
    arm.push(20.0, 0.0, 0.0)  # 20 m/s^2, 0.1 m in 0.1 s if it lasted
    arm.ticks(30)
    assert both.peer.counter("clik", "reference rejected") == before  # from the first frame on
    assert np.abs(arm.dq).max() > 0.05
    both.impedance.kill()
    arm.ticks(110)  # a set-point lasts 0.1 s
    settle(arm)
    q, count = arm.q, len(arm.frames)
    arm.ticks(20)
    assert_close(arm.q, q, LAW_IN_A_NODE)
    assert np.abs(arm.dq).max() < AT_REST
    assert len(arm.frames) == count
    arm.push()
    both.impedance = world.start(NAME, COMPLIANT)
    world.until(lambda: (arm.send_next(), "active with" in both.impedance.log)[1], "active")
    arm.commands.clear()
    settle(arm)
    assert_close(arm.frame().p_d, pose(q)[0], FOLLOWED)
    assert_close(arm.q, q, FOLLOWED)
    arm.push(0.0, 5.0, 0.0)
    both.until_it_moves()
    assert_close(pose(arm.q)[0] - pose(q)[0], [0.0, 5.0 / K_P, 0.0], FOLLOWED)
