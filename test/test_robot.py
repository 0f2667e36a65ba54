"""The robot: against the whole URDF, a textbook arm, and by hand; the catalogue."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from samples import about, generator
from test_simulator import ODD_ROBOT
from tolerances import assert_close

from eulerparams_control.errors import ConfigurationError, RobotError, UnknownNameError
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.resources import config_names
from eulerparams_control.robot import catalogue
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from eulerparams_control.robot.robot import Robot, Tool
from eulerparams_control.robot.urdf import UrdfTree

CATALOGUE = ("kuka_iiwa", "panda", "ur10", "ur5")
SAMPLES = 25

# A column on a mount, with a joint of every kind.  The joints are not in the order of the
# chain, and the gripper's come first in the alphabet.
ARM = """
<robot name="arm">
  <link name="floor"/> <link name="base"/> <link name="column"/> <link name="carriage"/>
  <link name="forearm"/> <link name="wrist"/> <link name="hand"/>
  <link name="left_finger"/> <link name="right_finger"/>
  <joint name="bend" type="revolute">
    <parent link="carriage"/> <child link="forearm"/> <origin xyz="0 0.1 0.4"/>
    <axis xyz="1 0 0"/> <limit lower="-1" upper="2" velocity="3" effort="30"/>
  </joint>
  <joint name="a_finger" type="prismatic">
    <parent link="hand"/> <child link="left_finger"/> <axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" velocity="0.1" effort="5"/>
  </joint>
  <joint name="b_finger" type="prismatic">
    <parent link="hand"/> <child link="right_finger"/> <axis xyz="0 -1 0"/>
    <mimic joint="a_finger"/> <limit lower="0" upper="0.04" velocity="0.1" effort="5"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="column"/> <child link="carriage"/> <origin xyz="0.1 0 0" rpy="0.2 0 0"/>
    <axis xyz="0 0.6 0.8"/> <limit lower="-0.5" upper="0.5" velocity="0.2" effort="20"/>
  </joint>
  <joint name="parallel" type="revolute">
    <parent link="forearm"/> <child link="wrist"/> <origin xyz="0 0 0.3"/> <axis xyz="1 0 0"/>
    <mimic joint="bend"/> <limit lower="-1" upper="2" velocity="3" effort="30"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="floor"/> <child link="base"/> <origin xyz="0.1 0.2 0.3" rpy="0.3 -0.4 0.5"/>
  </joint>
  <joint name="turn" type="continuous">
    <parent link="base"/> <child link="column"/> <origin xyz="0 0 0.2"/>
    <axis xyz="0 0 1"/> <limit velocity="1" effort="10"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="wrist"/> <child link="hand"/> <origin xyz="0 0 0.1" rpy="0 0.7 0"/>
  </joint>
</robot>
"""
LINKS = ("base", "carriage", "column", "floor", "forearm", "hand", "left_finger", "wrist")


def configurations(n, key):
    """Return pairs of q and dq (n,)."""
    random = generator(50, key)
    q, dq = random.uniform(-2, 2, size=(SAMPLES, n)), random.normal(size=(SAMPLES, n))
    return list(zip(q, dq, strict=True))


# --- dynamics, eq. (32) -------------------------------------------------------------------
GRAVITY = (0.0, 0.0, -9.81)
TOOL = Tool(
    1.7,
    np.array([0.03, -0.05, 0.12]),
    np.array([[0.02, 0.003, -0.002], [0.003, 0.03, 0.004], [-0.002, 0.004, 0.025]]),
)


def with_inertia(urdf):
    """Return a URDF of bare links in which each has a mass and a skew inertia of its own."""
    random = generator(51)

    def body(link):
        mass, a, b, c = random.uniform(0.5, 2.0, size=4)
        x, y, z = random.uniform(-0.1, 0.1, size=3)
        return f'''<link name="{link[1]}"><inertial>
            <origin xyz="{x} {y} {z}" rpy="{x} {y} {z}"/> <mass value="{mass}"/>
            <inertia ixx="{a}" iyy="{b}" izz="{c}" ixy="{x}" ixz="{y}" iyz="{z}"/>
            </inertial></link>'''

    return re.sub(r'<link name="(\w+)"/>', body, urdf)


def with_a_tool(urdf, tip, tool):
    """Return the URDF with the tool as a link that is fixed to the tip."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tool.inertia.tolist()
    x, y, z = tool.com.tolist()
    return urdf.replace(
        "</robot>",
        f'''<link name="the_tool"><inertial>
        <origin xyz="{x} {y} {z}"/> <mass value="{tool.mass}"/>
        <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"/>
        </inertial></link>
        <joint name="holds_the_tool" type="fixed"> <parent link="{tip}"/> <child link="the_tool"/>
        </joint></robot>''',
    )


ARMS = {
    **{a.name: (a.urdf, a.base_frame, a.tip_frame, a.joints) for a in map(load_robot, CATALOGUE)},
    "every kind of joint": (with_inertia(ARM), "base", "hand", ()),
    "base is the root": (with_inertia(ARM), "", "hand", ()),
    "base that turns": (with_inertia(ARM), "column", "hand", ()),
    "base that slides": (with_inertia(ARM), "carriage", "hand", ()),
    "a joint held still": (with_inertia(ARM), "base", "hand", ("turn", "bend")),
    "another order": (with_inertia(ARM), "base", "hand", ("bend", "turn", "lift")),
}
JOINTS = {
    **dict.fromkeys(("every kind of joint", "another order"), ("turn", "lift", "bend")),
    "a joint held still": ("turn", "bend"),
    "base that turns": ("lift", "bend"),
}
# Whose places are asked for, too.
LINKS_OF = {
    "every kind of joint": ("floor", "base", "column", "carriage", "forearm"),
    "base that turns": ("column", "carriage", "forearm"),
}


class WholeModel:
    """All joints of a URDF in Pinocchio, those that are not active at rest at 0."""

    def __init__(self, urdf, joints, gravity=GRAVITY):
        self.model = pin.buildModelFromXML(urdf)
        self.model.gravity.linear = np.array(gravity)
        self.data = self.model.createData()
        joints = [self.model.joints[self.model.getJointId(name)] for name in joints]
        self.moving = [joint.idx_v for joint in joints]
        self.neutral = pin.neutral(self.model)

    def velocities(self, dq):
        """Return Pinocchio's velocities for those of the active joints."""
        whole = np.zeros(self.model.nv)
        whole[self.moving] = dq
        return whole

    def configuration(self, q):
        """Return Pinocchio's configuration, cosine and sine for continuous joints."""
        return pin.integrate(self.model, self.neutral, self.velocities(q))

    def effort(self, q, dq):
        """Return the efforts of the active joints at ddq = 0, by recursive Newton-Euler."""
        v = self.velocities(dq)
        return pin.rnea(self.model, self.data, self.configuration(q), v, 0 * v)[self.moving]


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize(
    ("tool", "gravity"), [(None, GRAVITY), (TOOL, (1.0, -3.0, 8.0))], ids=["bare", "tool on a wall"]
)
def test_an_arm_is_that_of_the_whole_urdf_seen_from_its_base(name, tool, gravity):
    urdf, base, tip, _ = ARMS[name]
    robot, axes = Robot(*ARMS[name], gravity, tool), pin.LOCAL_WORLD_ALIGNED
    assert robot.joints == JOINTS.get(name, robot.joints)
    whole = WholeModel(with_a_tool(urdf, tip, tool) if tool else urdf, robot.joints, gravity)
    model, data, moving = whole.model, whole.data, whole.moving
    tip = model.getFrameId(tip, pin.FrameType.BODY)
    base = model.getFrameId(base, pin.FrameType.BODY) if base else 0  # the universe
    both = list(configurations(robot.n, key=8))
    turns = np.where(np.isinf(robot.limits.upper), 20 * math.pi, 0.0)  # as often as it likes
    both += [(q + turns, dq) for q, dq in both[:5]]
    for q, dq in both:
        at, v = whole.configuration(q), whole.velocities(dq)
        pin.forwardKinematics(model, data, at, v, 0 * v)
        pin.updateFramePlacements(model, data)
        from_root = data.oMf[base].inverse()
        R, pose = np.kron(np.eye(2), from_root.rotation), from_root * data.oMf[tip]
        arm, dJ_dq, B, C_dq, g = robot.dynamic_state(q, dq)
        assert_close(arm.p_e, pose.translation)
        assert_close(arm.R_e, pose.rotation)
        assert_close([*arm.dp_e, *arm.omega_e], R @ pin.getFrameVelocity(model, data, tip, axes))
        a = pin.getFrameClassicalAcceleration(model, data, tip, axes)
        assert_close(dJ_dq, R @ a.vector)
        J = pin.computeFrameJacobian(model, data, at, tip, axes)[:, moving]
        assert_close(arm.J, R @ J)
        assert_close(B, pin.crba(model, data, at)[np.ix_(moving, moving)])
        assert_close(C_dq + g, whole.effort(q, dq))
        assert_close(g, whole.effort(q, 0 * dq))
        places = [(link, from_root, robot.link_at(link, q)) for link in LINKS_OF.get(name, ())]
        if LINKS_OF.get(name):
            places.append(("wrist", data.oMf[tip].inverse(), robot.placement("wrist")))
        for link, origin, found in places:
            expected = origin * data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
            assert_close(found.p, expected.translation)
            assert_close(found.R, expected.rotation)


def flat(state):
    return [*state.arm, *state[1:]]


@pytest.mark.parametrize("arm", ARMS)
def test_a_state_stays_what_it_is_and_is_the_same_alone_in_a_row_and_with_dynamics(arm):
    robot = Robot(*ARMS[arm])
    both = configurations(robot.n, key=9)[:4]
    states = [robot.dynamic_state(q, dq) for q, dq in both]
    kept = [[array.copy() for array in flat(state)] for state in states]
    at_rest = robot.dynamic_state(both[0][0], 0.0 * both[0][1])
    assert not at_rest.C_dq.any()
    assert not at_rest.dJ_dq.any()
    stacked = robot.states(*map(np.array, zip(*both, strict=True)))
    for k, ((q, dq), state) in enumerate(zip(both, states, strict=True)):
        for one, alone, of_all in zip(state.arm, robot.state(q, dq), stacked, strict=True):
            np.testing.assert_array_equal(one, alone)
            np.testing.assert_array_equal(one, of_all[k])
        q[:] = dq[:] = 0.0  # not those of the state
        np.testing.assert_array_equal(state.B, state.B.T)
        assert np.linalg.eigvalsh(state.B)[0] > 1e-4
        for array, same in zip(flat(state), kept[k], strict=True):
            np.testing.assert_array_equal(array, same)
    assert robot.states(np.empty((0, robot.n)), np.empty((0, robot.n))).J.shape == (0, 6, robot.n)


def test_the_friction_of_the_urdf_is_that_of_the_active_joints_in_their_order():
    friction = Robot(ODD_ROBOT, "", "tip", ("slide", "turn")).friction
    assert friction.viscous.tolist() == [3.0, 5.0]
    assert friction.coulomb.tolist() == [0.0, 2.0]
    assert not friction.is_none
    assert Robot(ARM, "base", "hand").friction.is_none
    assert not JointFriction(np.zeros(2), np.ones(2)).is_none


# --- frames and joints --------------------------------------------------------------------
def test_the_joints_before_the_base_and_the_active_ones_with_their_limits_are_in_their_order():
    for base, mount in (("base", ()), ("column", ("turn",)), ("carriage", ("turn",))):
        assert Robot(ARM, base, "hand").mount == mount  # that may turn it: not the lift
    assert Robot(ARM, "", "hand").base_frame == "floor"
    R = about(2, 0.5) @ about(1, -0.4) @ about(0, 0.3)  # rpy: about fixed axes
    assert_close(Robot(ARM, "base", "hand").gravity, R.T @ GRAVITY)
    for tip, joints in (("left_finger", ("a_finger",)), ("right_finger", ())):  # one mimics
        assert Robot(ARM, "base", tip).joints == ("turn", "lift", "bend", *joints)
    limits = Robot(ARM, "base", "hand", ("bend", "lift", "turn")).limits
    assert limits.lower.tolist() == [-math.inf, -0.5, -1.0]
    assert limits.upper.tolist() == [math.inf, 0.5, 2.0]
    assert limits.velocity.tolist() == [1.0, 0.2, 3.0]
    assert limits.effort.tolist() == [10.0, 20.0, 30.0]


# --- refusals -----------------------------------------------------------------------------
KNOWN = "known: bend, lift, turn$"


@pytest.mark.parametrize(
    ("base", "tip", "joints", "text"),
    [
        ("base", "hnd", (), "^tip_frame: unknown frame.*did you mean 'hand'"),
        ("colum", "hand", (), "^base_frame: unknown frame.*did you mean 'column'"),
        ("base", "hnd", (), f"known: {', '.join(LINKS[:-1])}, right_finger, wrist$"),
        ("base", "hand", ("turn", "elbow"), f"^joints: unknown joint 'elbow'; {KNOWN}"),
        ("base", "hand", ("parallel",), f"unknown joint 'parallel'.*{KNOWN}"),  # mimics
        ("hand", "base", (), "'base' is not carried by link 'hand'"),
        ("floor", "base", (), "no joint moves between .*'floor' and .*'base'"),
    ],
)
def test_frames_and_joints_that_are_no_chain_are_refused(base, tip, joints, text):
    with pytest.raises(RobotError, match=text):
        Robot(ARM, base, tip, joints)


BEND = '<limit lower="-1" upper="2" velocity="3" effort="30"/>'


def with_bend(limit):
    """Return the arm with another <limit>, or what else, of its last joint."""
    return ARM.replace(BEND, limit, 1)


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ('<limit velocity="3" effort="30"/>', "its limits are 0 ... 0, its velocity limit 3 (what"),
        ('<limit lower="0.5" upper="0.5" velocity="3" effort="30"/>', "limits are 0.5 ... 0.5"),
        ('<limit lower="-1" upper="2" velocity="0" effort="30"/>', "its velocity limit 0 (what"),
        (f'{BEND}<safety_controller soft_lower_limit="2"/>', "limits are 2 ... 2"),
    ],
)
def test_a_joint_whose_limits_do_not_let_it_move_is_named_and_not_controlled(
    limit, words, tmp_path
):
    urdf = with_bend(limit)
    assert urdf != ARM
    robot = Robot(urdf, "base", "hand")  # a bag of it can be read
    with pytest.raises(RobotError, match=f"^joint 'bend' cannot move: .*{re.escape(words)}"):
        robot.refuse_joints()
    with pytest.raises(RobotError, match="joint 'bend' cannot move: "):
        load_urdf(urdf, tmp_path)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ('soft_lower_limit="-0.5" soft_upper_limit=" 1 "', (-0.5, 1.0)),
        ('soft_lower_limit="-0.5"', (-0.5, 2.0)),
        ('soft_lower_limit="-9" soft_upper_limit="9"', (-1.0, 2.0)),
        ('soft_lower_limit="0" soft_upper_limit="0"', (-1.0, 2.0)),  # an exporter knew none
        ('k_position="15" k_velocity="10"', (-1.0, 2.0)),
    ],
)
def test_soft_limits_are_the_limits_where_they_are_within_the_hard_ones(stated, expected, tmp_path):
    urdf = with_bend(f"{BEND}<safety_controller {stated}/>")
    limits = Robot(urdf, "base", "hand").limits
    assert (limits.lower[2], limits.upper[2]) == expected
    assert (limits.velocity[2], limits.effort[2]) == (3.0, 30.0)
    turn = urdf.replace("</joint>", '<safety_controller soft_upper_limit="1"/></joint>')
    assert Robot(turn, "base", "hand").limits.upper[0] == math.inf  # one without end has none


def test_no_other_number_of_joint_values_is_taken():
    robot = Robot(ARM, "base", "hand")
    for q, dq in ((np.zeros(2), np.zeros(3)), (np.zeros(3), np.zeros(4))):
        for state in (robot.state, robot.dynamic_state):
            with pytest.raises(RobotError, match=r"expected \(3,\)"):
                state(q, dq)


@pytest.mark.parametrize(
    ("base", "frame", "words"),
    [
        ("floor", "left_finger", "where the frame 'left_finger' is depends on a_finger, parallel"),
        ("column", "floor", "where the frame 'floor' is depends on turn, which is not among"),
        ("floor", "hnd", r"unknown frame 'hnd' \(did you mean 'hand'\?\); known: base, carriage"),
        ("floor", "x" * 10**6, "unknown frame 'xxx"),
    ],
)
def test_a_frame_that_is_not_there_or_not_measured_is_refused(base, frame, words):
    robot = Robot(ARM, base, "hand")
    with pytest.raises(RobotError, match=words) as refusal:
        robot.link_at(frame, np.zeros(robot.n))
    assert len(str(refusal.value)) < 2100
    with pytest.raises(RobotError, match=r"'carriage' is not fixed to the tip.*bend"):
        robot.placement("carriage")
    with pytest.raises((RobotError, UnknownNameError), match="did you mean 'hand'"):
        robot.placement("hnd")


# --- the catalogue ------------------------------------------------------------------------
MIMIC = '<mimic joint="swing"/>'
TWO_LINKS = f"""
<robot name="two">
  <link name="base"/> <link name="arm"/> <link name="finger"/>
  <joint name="swing" type="revolute">
    <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/>
    <limit lower="0.5" upper="1" velocity="2" effort="3"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="arm"/> <child link="finger"/> {MIMIC}
    <limit lower="0" upper="1" velocity="2" effort="3"/>
  </joint>
</robot>
"""


def test_the_tip_is_within_reach_where_the_joints_are_within_their_limits():
    for urdf, *frames in ARMS.values():
        robot = Robot(urdf, *frames)
        for q, dq in configurations(robot.n, 52):
            q = np.clip(q, robot.limits.lower, robot.limits.upper)
            assert robot.reach.distance(robot.state(q, dq).p_e) <= robot.reach.radius + 1e-12


def test_links_that_are_stretched_reach_just_so_far():
    urdf = TWO_LINKS.replace(MIMIC, "")
    robot = Robot(urdf, "base", "finger")
    for slide in (1.0, 0.25):
        p_e = robot.state(np.array([0.7, slide]), np.zeros(2)).p_e
        assert robot.reach.distance(p_e) == pytest.approx(slide, abs=1e-15)
    assert robot.reach.radius == 1.0
    rail = urdf.replace('lower="0" upper="1"', 'lower="-1e4" upper="1"')
    assert Robot(rail, "base", "finger").reach.radius == 100.0


@pytest.fixture
def entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A valid entry for TWO_LINKS, without its mimic joint."""
    (tmp_path / "two.urdf").write_text(TWO_LINKS.replace(MIMIC, ""))
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


def load_urdf(text: str, folder: Path) -> RobotDescription:
    (folder / "my.urdf").write_text(text)
    return load_robot(str(folder / "my.urdf"))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "iso-8859-1", "utf-8"])
def test_a_urdf_is_read_in_the_encoding_that_it_declares(encoding, tmp_path):
    declared = encoding.removesuffix("-sig")
    text = f'<?xml version="1.0" encoding="{declared}"?><!-- f\u00fcr -->{TWO_LINKS}'
    (tmp_path / "my.urdf").write_bytes(text.replace("arm", "b\u00e4r").encode(encoding))
    assert UrdfTree(load_robot(str(tmp_path / "my.urdf")).urdf).links[1] == "b\u00e4r"


def test_the_arms_end_where_the_experiments_take_them_to_end():
    ur5, panda = load_robot("ur5"), load_robot("panda")
    assert (ur5.base_frame, ur5.tip_frame) == ("base_link", "tool0")
    assert panda.joints == tuple(f"panda_joint{i}" for i in range(1, 8))  # no fingers
    assert load_robot(str(panda.urdf_path)).joints == panda.joints  # the longest chain
    assert panda.tip_frame == "panda_hand_tcp"
    with pytest.raises(UnknownNameError) as caught:
        load_robot("ur55")
    known = ", ".join(config_names("robots"))
    assert str(caught.value) == f"unknown robot 'ur55' (did you mean 'ur5'?); known: {known}"


def test_a_path_takes_root_longest_chain_and_a_home_within_limits_or_an_entry(entry, tmp_path):
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(entry))
    listed = load_robot("two")
    assert load_robot(str(tmp_path / "two.yaml")) == listed  # by its path, wherever it is
    assert listed.urdf_path == tmp_path / "two.urdf"  # beside it
    assert (listed.joints, listed.home) == (("swing", "slide"), (0.75, 0.5))
    joints = {"rotor_inertia": 0.1, "friction_viscous": [1, 2.0], "friction_coulomb": [0.0, 0.3]}
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(entry | joints))
    known = replace(listed, rotor_inertia=(0.1, 0.1), friction_viscous=(1.0, 2.0))
    assert load_robot("two") == replace(known, friction_coulomb=(0.0, 0.3))
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


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "my.urdf",
            TWO_LINKS.replace('"revolute"', '"fixed"').encode(),
            "'my'.*joints must be some",
        ),
        ("missing.urdf", None, r"cannot be read.*missing\.urdf"),
    ],
)
def test_a_urdf_that_cannot_be_read_is_refused_with_its_path(name, content, words, tmp_path):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RobotError, match=words):
        load_robot(str(tmp_path / name))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"rotor_inertia": [0.1]}, "rotor_inertia is [0.1]; expected one number, or 2, 0 or more"),
        ({"rotor_inertia": [0.1, "2"]}, "rotor_inertia is [0.1, '2']; expected one number, or 2"),
        ({"friction_viscous": -1.0}, "friction_viscous is -1.0; expected one number, or 2, 0 or"),
        ({"friction_coulomb": float("inf")}, "friction_coulomb is inf; expected one number, or 2"),
        ({"base_frame": "bse"}, "unknown frame 'bse' (did you mean 'base'?)"),
        ({"tip_frame": "base"}, "unknown joint 'swing'; known: none"),
        ({"sensor_frame": "hand"}, "unknown frame 'hand'"),
        ({"joints": ["swing", "slyde"]}, "unknown joint 'slyde' (did you mean 'slide'?)"),
        ({"joints": ["slide", "swing"]}, "from base to tip"),
        ({"joints": "swing"}, "joints must be a list of names, got 'swing'"),
        ({"home": [0.75]}, "home is [0.75]; expected 2 numbers"),
        ({"home": [0.75, "x"]}, "home of joint 'slide', x, is outside 0.0 ... 1.0"),
        ({"home": [0.2, 0.5]}, "home of joint 'swing', 0.2, is outside 0.5 ... 1.0"),
        ({"urdf": "pybullet_data:none.urdf"}, "'none.urdf' of the package 'pybullet_data'"),
        ({"urdf": "no-such-package:none.urdf"}, "is it installed?"),
        ("hom: [0, 0]\nurdf: two.urdf", "unknown key 'hom' (did you mean 'home'?)"),
        ("description: nothing", "urdf is missing"),
        ("- a list", "expected the keys description, urdf"),
        ("urdf: [", "two.yaml"),
    ],
)
def test_an_impossible_entry_is_refused_with_the_reason(change, reason, entry, tmp_path):
    is_whole = isinstance(change, str)
    (tmp_path / "two.yaml").write_text(change if is_whole else yaml.safe_dump(entry | change))
    errors = ConfigurationError if is_whole else (RobotError, UnknownNameError)
    with pytest.raises(errors, match=re.escape(reason)) as caught:
        load_robot("two")
    assert "two.yaml" in str(caught.value) or not is_whole
