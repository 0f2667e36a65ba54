"""Where the sensor sits, what the URDF says it carries, and what is reported of the tool."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from ros_processes import UR5, Array
from samples import about, generator
from tolerances import ALGEBRAIC, KINEMATICS, assert_close

from eulerparams_control.errors import RobotError, UnknownNameError
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.urdf import UrdfTree
from eulerparams_control.tool.identification import Identification
from eulerparams_control.tool.mount import Carried, SensorMount, carried
from eulerparams_control.tool.poses import Pose
from eulerparams_control.tool.report import ToolReport
from sim_bridge.urdf import Body, simulation_urdf

LINK = '<link name="{}"/>'
HEAVY = """<link name="{}"><inertial><origin xyz="{}"/><mass value="{}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>
<origin xyz="{}" rpy="{}"/><axis xyz="{}"/><limit velocity="1" effort="1" lower="-2" upper="2"/>
</joint>"""

# An arm of two joints; at its flange a sensor, turned and displaced, with a gripper of 0.5 kg,
# whose finger of 0.1 kg slides, and beyond it the tip.
GRIPPER = f"""<robot name="arm">{"".join(map(LINK.format, ("base", "sensor", "tip")))}
{HEAVY.format("upper", "0 0 0", 2)}{HEAVY.format("flange", "0 0 0", 1)}
{HEAVY.format("gripper", "0 0 0.1", 0.5)}{HEAVY.format("finger", "0 0.02 0", 0.1)}
{JOINT.format("shoulder", "revolute", "base", "upper", "0 0 1", "0 0 0", "0 0 1")}
{JOINT.format("elbow", "revolute", "upper", "flange", "1 0 0", "0 0 0", "0 1 0")}
{JOINT.format("mount", "fixed", "flange", "sensor", "0.1 0 0", "0 0 1.5707963267948966", "1 0 0")}
{JOINT.format("grip", "fixed", "sensor", "gripper", "0 0 0.05", "3.141592653589793 0 0", "1 0 0")}
{JOINT.format("slide", "prismatic", "gripper", "finger", "0 0 -0.2", "0.3 0.5 -0.7", "0 1 0")}
{JOINT.format("end", "fixed", "gripper", "tip", "0 0 -0.3", "0.3 0.5 -0.7", "1 0 0")}
</robot>"""

RPY = about(2, -0.7) @ about(1, 0.5) @ about(0, 0.3)  # of the finger and the tip
GRIP = about(0, math.pi)

# 0.5 kg at z = 0.05 - 0.1, and the finger.
FINGER = np.array([0, 0, 0.05]) + GRIP @ ([0, 0, -0.2] + RPY @ [0, 0.02, 0])
KNOWN = Carried(0.6, (0.5 * np.array([0, 0, -0.05]) + 0.1 * FINGER) / 0.6)


def mount(frame: str = "sensor", tip: str = "tip") -> SensorMount:
    return SensorMount(GRIPPER, frame, tip)


# --- the sensor on the arm -------------------------------------------------------------------


def test_a_point_of_the_sensor_frame_is_given_in_the_tip_frame():
    point = np.array([0.1, 0.2, 0.3])
    expected = RPY.T @ (GRIP.T @ (point - [0, 0, 0.05]) - [0, 0, -0.3])
    assert_close(mount().in_tip(point), expected, KINEMATICS)
    assert_close(mount(tip="sensor").in_tip(point), point, KINEMATICS)


def test_the_orientation_of_the_sensor_is_that_in_the_root_link():
    q = np.array([0.3, -0.4])
    expected = about(2, 0.3) @ about(1, -0.4) @ about(2, math.pi / 2)
    assert_close(mount().orientation(q), expected, KINEMATICS)
    assert mount().joints == ("shoulder", "elbow")


@pytest.mark.parametrize(
    ("frames", "error", "words"),
    [
        (("senser", "tip"), UnknownNameError, "did you mean 'sensor'.*known: base,"),
        (("sensor", "tipp"), UnknownNameError, "did you mean 'tip'.*known: base,"),
        (("upper", "tip"), RobotError, "elbow moves between the sensor at 'upper' and the tip_fra"),
        (("finger", "tip"), RobotError, "slide moves between .* the tip_frame 'tip'; expected"),
    ],
)
def test_a_sensor_that_is_none_or_not_fixed_to_the_tip_is_refused(frames, error, words):
    with pytest.raises(error, match=words):
        mount(*frames)


# --- what the URDF says it carries -----------------------------------------------------------


def test_what_the_sensor_carries_is_what_the_urdf_has_beyond_it():
    assert mount().carried.mass == pytest.approx(KNOWN.mass)
    assert_close(mount().carried.com, KNOWN.com, KINEMATICS)
    assert mount("tip").carried == (0.0, pytest.approx(np.zeros(3)))
    assert mount("gripper").carried.mass == pytest.approx(0.6)  # on a fixed joint: a place
    assert mount("flange").carried.mass == pytest.approx(0.6)  # the last link is not carried


@pytest.mark.parametrize(
    ("robot", "frame"),
    [
        ("ur5", "tool0"), ("kuka_iiwa", "lbr_iiwa_link_7"), ("panda", "panda_hand_tcp"),
        ("panda", "panda_link8"), ("panda", "panda_hand"), ("panda", "panda_link7"),
    ],
)  # fmt: skip
def test_it_is_what_the_simulated_sensor_feels(robot, frame):
    description = replace(load_robot(robot), sensor_frame=frame)
    none = Body(0.0, np.zeros(3), np.zeros((3, 3)))
    felt = simulation_urdf(description, none, stops=True, shapes=()).load
    found = carried(UrdfTree(description.urdf), frame)
    assert found.mass == pytest.approx(felt.mass, rel=ALGEBRAIC)
    assert_close(found.com, felt.com)


def test_a_malformed_inertial_is_refused():
    broken = GRIPPER.replace('<mass value="0.1"/>', '<mass value="light"/>')
    with pytest.raises(RobotError, match=r"link 'finger': could not .* 'light'"):
        carried(UrdfTree(broken), "sensor")


# --- the report ------------------------------------------------------------------------------

FOUND = Identification(
    1.5, np.array([0.01, -0.02, 0.06]), np.array([3.0, -2.0, 3.5, 0.2, -0.1, 1e-7]),
    0.0012, np.full(3, 1e-4), np.full(6, 1e-3), np.array([0.02, 0.3, 0.01]),
    np.array([0.002, 0.001, 0.03]), math.radians(40),
)  # fmt: skip


def report(
    found: Identification = FOUND, where: SensorMount | None = None, noise: float = 1e-3
) -> ToolReport:
    poses = [Pose(np.eye(3), np.zeros(6), np.full(6, noise), 1000)] * 3
    return ToolReport(found, poses, where or SensorMount(UR5.urdf, "tool0", "tool0"))


def parameters(text: str, section: str) -> dict[str, object]:
    return dict(yaml.safe_load(text)[section]["ros__parameters"])


def numbers(value: object) -> Array:
    assert isinstance(value, list)
    assert all(isinstance(number, float) for number in value)  # as ROS wants them
    return np.array(value)


def test_the_parameters_are_yaml_with_the_tool_at_the_tip_and_the_bias_of_the_sensor():
    text = report(where=mount("tip"))._replace(wrench_sign=-1).yaml()
    tool, bias = parameters(text, "/**"), parameters(text, "/**/impedance_control")
    assert tool["tool_mass"] == 1.5
    assert_close(numbers(tool["tool_com"]), FOUND.com, 1e-6)
    assert bias["wrench_sign"] == -1
    assert_close(numbers(bias["wrench_bias"]), FOUND.bias, 1e-6)
    assert tool.keys() | bias.keys() == {"tool_mass", "tool_com", "wrench_sign", "wrench_bias"}


def test_what_the_urdf_has_beyond_the_sensor_is_no_part_of_the_tool():
    added = Carried(0.4, generator(70).normal(size=3))
    mass = KNOWN.mass + added.mass
    com = (KNOWN.mass * KNOWN.com + added.mass * added.com) / mass
    full = report(FOUND._replace(mass=mass, com=com), mount())
    assert full.tool.mass == pytest.approx(added.mass)
    assert_close(full.tool.com, mount().in_tip(added.com))
    tool = parameters(full.yaml(), "/**")
    assert tool["tool_mass"] == pytest.approx(added.mass)
    assert_close(numbers(tool["tool_com"]), full.tool.com, 1e-6)
    sensed = parameters(full.yaml(), "/**/impedance_control")
    assert sensed["sensed_mass"] == pytest.approx(mass)
    assert_close(numbers(sensed["sensed_com"]), mount().in_tip(com), 1e-6)
    (warning,) = full.warnings()
    assert "the URDF has 0.6 kg beyond the sensor; tool_mass and tool_com are what" in warning


@pytest.mark.parametrize(("excess", "wrong"), [(0.002, False), (-0.002, False), (-0.1, True)])
def test_a_tool_that_the_urdf_has_already_is_none(excess, wrong):
    known = report(FOUND._replace(mass=KNOWN.mass + excess, com=KNOWN.com), mount())
    tool = parameters(known.yaml(), "/**")
    assert tool == {"tool_mass": 0.0, "tool_com": [0.0, 0.0, 0.0]}
    assert ("correct its inertials" in " ".join(known.warnings())) == wrong


@pytest.mark.parametrize(
    ("residual", "words"),
    [
        (
            {"residual_force": [0.1, 0.6, 0.2]},
            "pose 2 leaves 0.6 N of force unexplained, more than",
        ),
        ({"residual_torque": [0.01, 0.01, 0.06]}, "pose 3 leaves 0.06 Nm of torque unexplained"),
    ],
)
def test_a_pose_that_does_not_fit_is_warned_of(residual, words):
    found = FOUND._replace(**{name: np.array(values) for name, values in residual.items()})
    (warning,) = report(found).warnings()
    assert words in warning
    assert "does the tool touch something there, or does a cable pull?" in warning
    assert report(found, noise=0.1).warnings() == []  # so far averages are off by noise
    assert report().warnings() == []


def test_the_table_fits_a_terminal_and_has_what_was_found():
    text = report().table()
    assert "from 3 poses" in text
    assert max(map(len, text.splitlines())) < 80
    for row in (
        ("mass [kg]", "1.5000", "0.0012"),
        ("centre of mass in tool0 [mm]", "10.00 -20.00 60.00", "0.10 0.10 0.10"),
        ("bias of the force [N]", "3.000 -2.000 3.500", "0.001 0.001 0.001"),
        ("bias of the torque [Nm]", "0.2000 -0.1000 0.0000", "0.0010 0.0010 0.0010"),
        ("unexplained force [N]", "0.3 in pose 2"),
        ("unexplained torque [Nm]", "0.03 in pose 3"),
        ("difference of the poses [deg]", "40"),
    ):
        (line,) = [line for line in text.splitlines() if row[0] in line]
        assert all(word in line for word in row)
