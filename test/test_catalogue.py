"""The catalogue of robots: what it holds, and what it refuses."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml

from eulerparams_control.errors import ConfigurationError, RobotError, UnknownNameError
from eulerparams_control.resources import config_names
from eulerparams_control.robot import catalogue
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from eulerparams_control.robot.urdf import UrdfTree, joint_limits

TWO_LINKS = """
<robot name="two">
  <link name="base"/> <link name="arm"/> <link name="finger"/>
  <joint name="swing" type="revolute">
    <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/>
    <limit lower="0.5" upper="1" velocity="2" effort="3"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="arm"/> <child link="finger"/> <mimic joint="swing"/>
    <limit lower="0" upper="1" velocity="2" effort="3"/>
  </joint>
</robot>
"""


def reduced_model(robot: RobotDescription) -> Any:
    model = pin.buildModelFromXML(robot.urdf)
    others = [model.getJointId(n) for n in list(model.names)[1:] if n not in robot.joints]
    return pin.buildReducedModel(model, others, pin.neutral(model)) if others else model


@pytest.fixture
def entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A valid entry for TWO_LINKS, without its mimic joint."""
    urdf = re.sub("<mimic[^>]*>", "", TWO_LINKS)
    (tmp_path / "two.urdf").write_text(urdf)
    monkeypatch.setattr(catalogue, "config_file", lambda _, name: tmp_path / f"{name}.yaml")
    return {
        "description": "two links",
        "urdf": "two.urdf",
        "base_frame": "base",
        "tip_frame": "finger",
        "sensor_frame": "finger",
        "joints": ["swing", "slide"],
        "home": [0.75, 0.5],
    }


def load_entry(entry: dict[str, Any], folder: Path) -> RobotDescription:
    (folder / "two.yaml").write_text(yaml.safe_dump(entry))
    return load_robot("two")


def load_urdf(text: str, folder: Path) -> RobotDescription:
    (folder / "my.urdf").write_text(text)
    return load_robot(str(folder / "my.urdf"))


@pytest.mark.parametrize("name", config_names("robots"))
def test_a_robot_of_the_catalogue_has_its_frames_and_joints_in_its_urdf(name):
    robot = load_robot(name)
    model = reduced_model(robot)
    assert robot.name == name
    assert robot.urdf == robot.urdf_path.read_text()
    assert tuple(model.names)[1:] == robot.joints
    for frame in (robot.base_frame, robot.tip_frame, robot.sensor_frame):
        assert model.existFrame(frame), frame


def test_the_arms_end_where_the_experiments_take_them_to_end():
    ur5, panda = load_robot("ur5"), load_robot("panda")
    assert (ur5.base_frame, ur5.tip_frame) == ("base_link", "tool0")
    assert ur5.home == (-0.21662, -1.1967, 1.83698, 1.78954, -1.39217, -2.98951)
    assert panda.joints == tuple(f"panda_joint{i}" for i in range(1, 8))  # no fingers
    assert load_robot(str(panda.urdf_path)).joints == panda.joints  # the longest chain
    assert panda.tip_frame == "panda_hand_tcp"


def test_an_unknown_robot_is_refused_with_the_names_that_exist():
    with pytest.raises(UnknownNameError) as caught:
        load_robot("ur55")
    known = ", ".join(config_names("robots"))
    assert str(caught.value) == f"unknown robot 'ur55' (did you mean 'ur5'?); known: {known}"


def test_a_path_takes_the_root_the_longest_chain_and_a_home_within_limits(tmp_path):
    robot = load_urdf(TWO_LINKS, tmp_path)
    assert robot == RobotDescription(
        name="my",
        urdf_path=tmp_path / "my.urdf",
        urdf=TWO_LINKS,
        base_frame="base",
        tip_frame="finger",
        sensor_frame="finger",
        joints=("swing",),
        home=(0.5,),
    )


def test_an_entry_is_read_with_its_urdf_beside_it(entry, tmp_path):
    robot = load_entry(entry, tmp_path)
    assert robot.urdf_path == tmp_path / "two.urdf"
    assert robot.joints == ("swing", "slide")
    assert robot.home == (0.75, 0.5)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("robot", "sdf", "the root element is <sdf>, expected <robot>"),
        ('<link name="finger"/>', "", "no link 'finger' as child"),
        ('<child link="finger"/>', "", "joint 'slide' has no <child>"),
        ('<link name="base"/>', "<link/>", "a <link> has no attribute 'name'"),
        ('lower="0.5"', 'lower="2"', "impossible limits of joint 'swing'"),
        ('lower="0.5"', 'lower="half"', "limits of joint 'swing': could not convert"),
        ('velocity="2"', 'velocity="-2"', "impossible limits of joint 'swing'"),
        ('"revolute"', '"fixed"', "joints must be some of"),
    ],
)
def test_a_broken_urdf_is_refused(old, new, reason, tmp_path):
    assert old in TWO_LINKS
    with pytest.raises(RobotError, match=re.escape(reason)) as caught:
        load_urdf(TWO_LINKS.replace(old, new), tmp_path)
    assert "robot 'my'" in str(caught.value)


def test_a_limit_that_is_not_stated_is_infinite():
    stated = UrdfTree(TWO_LINKS).joints["swing"]
    assert joint_limits(stated) == (0.5, 1.0, 2.0, 3.0)
    stated.set("type", "continuous")
    assert joint_limits(stated) == (-np.inf, np.inf, 2.0, 3.0)
    bare = UrdfTree(re.sub("<limit[^>]*>", "", TWO_LINKS)).joints["swing"]
    assert joint_limits(bare) == (-np.inf, np.inf, np.inf, np.inf)


def test_a_urdf_that_cannot_be_read_is_refused_with_its_path(tmp_path):
    with pytest.raises(RobotError, match=r"cannot be read.*missing\.urdf"):
        load_robot(str(tmp_path / "missing.urdf"))
    (tmp_path / "binary.urdf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RobotError, match="cannot be read"):
        load_robot(str(tmp_path / "binary.urdf"))


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("base_frame", "bse", "unknown frame 'bse' (did you mean 'base'?)"),
        ("base_frame", "finger", "unknown joint 'swing'; known: none"),
        ("base_frame", ["base"], "unknown frame '['base']'"),
        ("tip_frame", "base", "unknown joint 'swing'; known: none"),
        ("tip_frame", "hand", "unknown frame 'hand'; known: arm, base, finger"),
        ("sensor_frame", "hand", "unknown frame 'hand'"),
        ("joints", ["swing", "slyde"], "unknown joint 'slyde' (did you mean 'slide'?)"),
        ("joints", ["slide", "swing"], "from base to tip"),
        ("joints", ["swing", "swing"], "from base to tip"),
        ("joints", "swing", "joints must be a list of names, got 'swing'"),
        ("home", [0.75], "home has 1 numbers, there are 2 joints"),
        ("home", [0.75, "x"], "home must be 2 numbers"),
        ("home", [0.75, float("nan")], "home of joint 'slide', nan, is outside 0.0 ... 1.0"),
        ("home", [0.2, 0.5], "home of joint 'swing', 0.2, is outside 0.5 ... 1.0"),
        ("urdf", "pybullet_data:none.urdf", "'none.urdf' of the package 'pybullet_data'"),
        ("urdf", "no-such-package:none.urdf", "is it installed?"),
        ("urdf", "none.urdf", "cannot be read"),
    ],
)
def test_an_impossible_entry_is_refused_with_the_reason(key, value, reason, entry, tmp_path):
    with pytest.raises((RobotError, UnknownNameError), match=re.escape(reason)):
        load_entry({**entry, key: value}, tmp_path)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("hom: [0, 0]\nurdf: two.urdf", "unknown key 'hom' (did you mean 'home'?)"),
        ("description: nothing", "the key 'urdf' is missing"),
        ("- a list", "expected the keys description, urdf"),
        ("urdf: [", "two.yaml"),
    ],
)
@pytest.mark.usefixtures("entry")
def test_a_broken_file_is_refused_with_its_path(text, reason, tmp_path):
    (tmp_path / "two.yaml").write_text(text)
    with pytest.raises(ConfigurationError, match=re.escape(reason)) as caught:
        load_robot("two")
    assert "two.yaml" in str(caught.value)


def test_loading_a_robot_needs_neither_pybullet_nor_its_data():
    code = (
        "import sys; from eulerparams_control.robot.catalogue import load_robot; load_robot('ur5');"
        "sys.exit(bool({'pybullet', 'pybullet_data', 'rclpy'} & set(sys.modules)))"
    )
    root = Path(__file__).parents[1]
    assert subprocess.run([sys.executable, "-c", code], cwd=root, check=False).returncode == 0
