"""The node ``identify_tool`` over DDS.

The arm is ``pybullet_bridge``, or is played by the test, whose stamps go as fast as the node
follows.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from in_process import Ended, Running, World
from ros_processes import HOME, ROOT, UR5, Arm, Array, values
from sensor_msgs.msg import JointState

from eulerparams_control.messages.to_ros import stamp_to_ros
from eulerparams_control.robot.robot import Robot

CONFIG = ROOT / "config"
# The tool and the bias, 5 N and 0.3 Nm, of these tests, in the sensor frame.
MASS, COM = 1.2, np.array([0.01, -0.02, 0.06])
BIAS = np.array([3.0, -2.0, 12.0**0.5, 0.2, -0.1, 0.2])
SIMULATED = {
    "tool_mass": MASS,
    "tool_com": COM.tolist(),
    "tool_inertia": [2e-3, 0.0, 0.0, 2e-3, 0.0, 1e-3],
    "wrench_bias": BIAS.tolist(),
    "noise_force": 0.1,
    "noise_torque": 0.005,
    "seed": 7,
}

# Joint positions [rad] in which gravity differs by 40 deg or more in the sensor.
OFFSETS = ((0.0, 0.0), (0.9, 0.0), (0.0, 1.2), (-0.9, 0.0), (0.0, -1.2), (0.9, 1.2))
POSES = [HOME + [0, 0, 0, first, 0, third] for first, third in OFFSETS]
# A pose of the test takes 30 of its stamps.
QUICK = {"settle_time": 0.1, "averaging_time": 0.2, "timeout": 0.0}
# Without noise; the result is printed with six decimals.
PRINTED = 2e-6


class Found:
    """What a process has printed, or written."""

    def __init__(self, text: str) -> None:
        sections = yaml.safe_load(text[text.index("# found by") :].partition("\n\n")[0])
        tool, bias = (
            sections[name]["ros__parameters"] for name in ("/**", "/**/impedance_control")
        )
        self.mass = float(tool["tool_mass"])
        self.com, self.bias = np.array(tool["tool_com"]), np.array(bias["wrench_bias"])
        self.sign = bias["wrench_sign"]

    def assert_within_the_bars(self) -> None:
        """Assert mass and bias to 1 %, the centre of mass to 2 mm."""
        assert self.mass == pytest.approx(MASS, rel=0.01)
        assert np.linalg.norm(self.com - COM) < 0.002
        for part in (slice(3), slice(3, 6)):
            error = np.linalg.norm(self.bias[part] - BIAS[part])
            assert error < 0.01 * np.linalg.norm(BIAS[part])

    def assert_exact(self, com: Array = COM) -> None:
        assert self.mass == pytest.approx(MASS, abs=PRINTED)
        np.testing.assert_allclose(self.com, com, rtol=0, atol=PRINTED)
        np.testing.assert_allclose(self.bias, BIAS, rtol=0, atol=PRINTED)


class Rig(Arm):
    """An arm with its sensor: a state and a wrench every 10 ms of stamps.

    Its tool and bias are given in the frame of the sensor.
    """

    has_velocities = True

    def __init__(self, world: World, frame: str = "tool0", **parameters: Any) -> None:
        super().__init__(world, UR5)
        self.wear_sensor()
        self.world, self.wrenches = world, self.sensor.wrenches
        sensor, tip = (Robot(UR5.urdf, "", name).state(HOME, 0 * HOME) for name in (frame, "tool0"))
        self.com = tip.R_e.T @ (sensor.p_e + sensor.R_e @ COM - tip.p_e)
        self.sensor.frame, self.sensor.mass, self.sensor.com = frame, MASS, self.com
        self.sensor.bias, self.sensor.gravity = BIAS, parameters.get("gravity", [0.0, 0.0, -9.81])
        self.process = world.start("identify_tool", {**QUICK, **parameters})
        world.until_said(self.process, "waiting for the first wrench")

    def wrench(self, q: Array) -> WrenchStamped:
        """Return what the sensor measures at q (n,), at the present stamp."""
        self.q = q
        return self.sensor.message(self, stamp_to_ros(self.t))

    def message(self, q: Array | None = None) -> JointState:
        msg = super().message(q)
        msg.velocity = list(msg.velocity) if self.has_velocities else []
        return msg

    def rest(self, q: Array) -> None:
        """Send the wrench and the state of the next stamp, at q (n,)."""
        self.t, self.q = self.t + 10_000_000, q
        self.send(self.message())

    def until(self, condition: Callable[[], Any], q: Array, what: str) -> None:
        """Let the arm rest at q (n,) until something has happened."""

        self.world.until(lambda: (self.rest(q), condition())[1], what)

    def until_said(self, words: str, q: Array = HOME) -> None:
        self.until(lambda: words in self.process.log, q, f"'{words}' in the log")

    def take(self, poses: Sequence[Array], first: int = 1) -> None:
        """Let the arm rest in poses until they are taken."""
        for number, q in enumerate(poses, first):
            self.until_said(f"pose {number} of ", q)


def assert_failed(process: Running | Ended, *words: str) -> None:
    """Assert that a process ends with exit code 1 and one line that has some words."""
    assert process.end() == 1
    assert "Traceback" not in process.stderr
    (error,) = [line for line in process.stderr.splitlines() if line.startswith("error: ")]
    for word in words:
        assert word in error


# --- with the simulated robot ----------------------------------------------------------------
def test_the_shipped_motion_takes_clik_through_six_poses(world):
    """The files of the README; in lock-step, so that it takes less time."""
    lockstep = {"mode": "lockstep", "rate": 100.0, "wait_for_subscribers": 2}
    clik = {"use_sim_time": True, "require_reference": True}
    process = world.start("identify_tool", files=(CONFIG / "identify_tool.yaml",))
    world.start("clik", clik, files=(CONFIG / "clik.yaml",))
    world.start("reference", files=(CONFIG / "identify_tool_motion.yaml",))
    bridge = (CONFIG / "pybullet_bridge.yaml",)
    world.start("pybullet_bridge", {**SIMULATED, **lockstep}, files=bridge)
    assert process.end() == 0
    assert "pose 6 of 6 taken" in process.log
    assert "warning" not in process.log.lower()
    Found(process.stdout).assert_within_the_bars()


# --- what is found ---------------------------------------------------------------------------
def test_the_result_is_printed_and_written_as_parameters_that_controllers_take(world, tmp_path):
    output = tmp_path / "tool.yaml"
    rig = Rig(world, output=str(output))
    rig.take(POSES)
    assert rig.process.end() == 0
    Found(rig.process.stdout).assert_exact()
    Found(output.read_text()).assert_exact()
    assert "The tool and the sensor, from 6 poses" in rig.process.stdout
    for node in ("dynamic_control", "impedance_control"):
        world.start(node, files=(CONFIG / f"{node}.yaml", output))
        mass, com = world.peer.get_parameters(f"/{node}", "tool_mass", "tool_com")
        assert mass == pytest.approx(MASS, abs=PRINTED)
        np.testing.assert_allclose(com, COM, rtol=0, atol=PRINTED)
    (bias,) = world.peer.get_parameters("/impedance_control", "wrench_bias")
    np.testing.assert_allclose(bias, BIAS, rtol=0, atol=PRINTED)


def test_a_sensor_elsewhere_of_another_sign_on_a_wall_and_without_velocities_finds_the_tool(world):
    wall = {"gravity": [5.0, 0.0, -8.4], "wrench_sign": -1}
    rig = Rig(world, frame="wrist_3_link", poses=3, **wall)
    rig.sensor.sign, rig.has_velocities = -1.0, False
    rig.take(POSES[:3])
    assert rig.process.end() == 0
    assert np.linalg.norm(rig.com - COM) > 0.05
    found = Found(rig.process.stdout)
    found.assert_exact(rig.com)
    assert found.sign == -1


def test_messages_that_cannot_be_used_are_counted_and_not_averaged(world):
    rig = Rig(world, poses=3)
    rig.until_said("the sensor is at tool0")
    for number, q in enumerate(POSES[:3], 1):
        while f"pose {number} of " not in rig.process.log:
            rig.rest(q)
            state, broken, moved = rig.message(q), rig.wrench(q), rig.wrench(q)
            state.position[2] = broken.wrench.force.x = math.nan
            moved.header.frame_id, moved.wrench.force.x = "base_link", 1000.0
            rig.states.publish(state)
            rig.wrenches.publish(broken)
            rig.wrenches.publish(moved)
            assert rig.t < 20e9, rig.process.log
        if number == 2:
            status = values(world.peer.status("identify_tool"))
            assert int(status["wrench rejected"]) > 0
            assert int(status["joint_states rejected"]) > 0
    assert rig.process.end() == 0
    Found(rig.process.stdout).assert_exact()
    for words in ("a non-finite value: [nan, ", "the frame 'base_link'", "a non-finite position"):
        assert words in rig.process.log


# --- the end ---------------------------------------------------------------------------------
@pytest.mark.parametrize("count", [0, 2, 3])
def test_sigint_computes_from_the_poses_there_are_or_says_that_they_are_too_few(world, count):
    rig = Rig(world)
    rig.take(POSES[:count])
    rig.process.stop()
    if count < 3:
        assert_failed(rig.process, f"too few poses, {count}; expected at least 3")
        assert rig.process.stdout == ""
        return
    assert rig.process.end() == 0
    Found(rig.process.stdout).assert_exact()
    assert "from 3 poses" in rig.process.stdout


def test_without_a_robot_it_says_what_is_missing(world):
    process = world.start("identify_tool", {"timeout": 4.0})
    world.until_said(process, "no joint_states within 2 s")
    world.until_said(process, "no wrench within 2 s")
    assert_failed(process, "with 0 of 6 poses, waiting for the topic robot_description")


def test_a_file_is_never_overwritten(world, tmp_path):
    output = tmp_path / "tool.yaml"
    rig = Rig(world, poses=3, output=str(output))
    output.write_text("mine")
    assert_failed(
        world.start("identify_tool", {"output": str(output)}),
        f"output: {output} exists; name another file, or remove it",
    )
    rig.take(POSES[:3])
    assert_failed(rig.process, f"output: cannot write {output}: File exists; the result is printed")
    assert output.read_text() == "mine"
    Found(rig.process.stdout).assert_exact()  # what was measured is not lost
