"""The robot: kinematics and dynamics against differences and by hand, and what it refuses."""

import math
import re

import numpy as np
import pinocchio as pin
import pytest
from arms import robot_named
from samples import about, derivative, generator, skew
from tolerances import ALGEBRAIC, DIFFERENCES, DYNAMICS, KINEMATICS, assert_close

from eulerparams_control.errors import RobotError
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot, Tool

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

MOUNT = np.array([0.1, 0.2, 0.3]), about(2, 0.5) @ about(1, -0.4) @ about(0, 0.3)


def arm_pose(turn=0.0, lift=0.0, bend=0.0):
    """Return position and orientation of ARM's hand in ARM's base, by hand."""
    R_column = about(2, turn)
    R_carriage = R_column @ about(0, 0.2)
    R_forearm = R_carriage @ about(0, bend)
    p = np.array([0, 0, 0.2]) + R_column @ [0.1, 0, 0] + R_carriage @ [0, 0.6 * lift, 0.8 * lift]
    p = p + R_carriage @ [0, 0.1, 0.4] + R_forearm @ [0, 0, 0.3 + 0.1]
    return p, R_forearm @ about(1, 0.7)


def configurations(n, key):
    """Return pairs of q and dq (n,)."""
    random = generator(50, key)
    q, dq = random.uniform(-2, 2, size=(SAMPLES, n)), random.normal(size=(SAMPLES, n))
    return list(zip(q, dq, strict=True))


# --- eqs. (18)-(20) -----------------------------------------------------------------------


@pytest.mark.parametrize(
    "robot",
    [
        *(robot_named(name)[0] for name in CATALOGUE),
        *(Robot(ARM, base, "hand") for base in ("", "floor", "base", "column", "carriage")),
    ],
    ids=[*CATALOGUE, "root", "floor", "base", "column", "carriage"],
)
def test_the_twist_is_the_derivative_of_the_pose_for_every_kind_of_joint_and_base(robot):
    """Eq. (20) against differences of (18), (19)."""
    still = np.zeros(robot.n)
    for q, dq in configurations(robot.n, key=0):
        state = robot.state(q, dq)
        dp = derivative(lambda t, q=q, dq=dq: robot.state(q + t * dq, still).p_e)
        dR = derivative(lambda t, q=q, dq=dq: robot.state(q + t * dq, still).R_e)
        assert_close(state.dp_e, dp, DIFFERENCES)
        assert_close(dR, skew(state.omega_e) @ state.R_e, DIFFERENCES)


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_jacobian_times_dq_is_the_twist_column_by_column(name):
    robot, _ = robot_named(name)
    for q, _ in configurations(robot.n, key=2):
        J = robot.state(q, np.zeros(robot.n)).J
        assert J.shape == (6, robot.n)
        for i, dq in enumerate(np.eye(robot.n)):
            state = robot.state(q, dq)
            twist = np.concatenate((state.dp_e, state.omega_e))
            assert_close(J[:, i], twist)
            # the linear part comes first: a revolute joint turns at 1 rad/s
            assert np.linalg.norm(J[3:, i]) == pytest.approx(1, abs=ALGEBRAIC)


def test_the_pose_of_an_arm_with_every_kind_of_joint_is_that_by_hand():
    robot = Robot(ARM, "base", "hand")
    for q, dq in configurations(3, key=3):
        state = robot.state(q, dq)
        p, R = arm_pose(*q)
        assert_close(state.p_e, p, KINEMATICS)
        assert_close(state.R_e, R, KINEMATICS)
        assert_close(state.J[3:, 1], 0, KINEMATICS)  # prismatic


def test_a_continuous_joint_turns_any_number_of_times():
    robot = Robot(ARM, "base", "hand")
    still = np.zeros(3)
    once, more = (robot.state(np.array([a, 0.1, 0.2]), still) for a in (0.3, 0.3 + 20 * math.pi))
    assert_close(once.p_e, more.p_e, KINEMATICS)
    assert_close(once.J, more.J, KINEMATICS)


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


def catalogue_urdf(name):
    """Return the URDF of a robot of the catalogue, its base and its tip."""
    description = load_robot(name)
    return description.urdf, description.base_frame, description.tip_frame, description.joints


ARMS = {
    **{name: catalogue_urdf(name) for name in CATALOGUE},
    "every kind of joint": (with_inertia(ARM), "base", "hand", ()),
    "base is the root": (with_inertia(ARM), "", "hand", ()),
    "a joint held still": (with_inertia(ARM), "base", "hand", ("turn", "bend")),
}
every_arm = pytest.mark.parametrize("arm", ARMS)


class WholeModel:
    """All joints of a URDF in Pinocchio, those that are not active at rest at 0."""

    def __init__(self, urdf, joints, gravity=GRAVITY):
        self.model = pin.buildModelFromXML(urdf)
        self.model.gravity.linear = np.array(gravity)
        self.data = self.model.createData()
        self.joints = [self.model.joints[self.model.getJointId(name)] for name in joints]

    def configuration(self, q):
        """Return Pinocchio's configuration for the active joints at q."""
        whole = pin.neutral(self.model)
        for joint, angle in zip(self.joints, q, strict=True):
            circle = [math.cos(angle), math.sin(angle)]
            whole[joint.idx_q : joint.idx_q + joint.nq] = circle if joint.nq == 2 else angle
        return whole

    def velocities(self, dq):
        """Return Pinocchio's velocities or accelerations for those of the active joints."""
        whole = np.zeros(self.model.nv)
        whole[[joint.idx_v for joint in self.joints]] = dq
        return whole

    def effort(self, q, dq, ddq):
        """Return the efforts of the active joints, by recursive Newton-Euler."""
        states = self.configuration(q), self.velocities(dq), self.velocities(ddq)
        tau = pin.rnea(self.model, self.data, *states)
        return tau[[joint.idx_v for joint in self.joints]]


def assert_same_dynamics(one, other):
    for name in ("B", "C_dq", "g"):
        a, b = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(a, b, rtol=0, atol=DYNAMICS, err_msg=name)


@every_arm
def test_the_terms_of_the_model_add_up_to_the_efforts_of_newton_and_euler(arm):  # eq. (32)
    robot = Robot(*ARMS[arm])
    whole, still = WholeModel(ARMS[arm][0], robot.joints), np.zeros(robot.n)
    accelerations = generator(52).normal(size=(SAMPLES, robot.n))
    for (q, dq), ddq in zip(configurations(robot.n, key=6), accelerations, strict=True):
        state = robot.dynamic_state(q, dq)
        assert_close(state.B @ ddq + state.C_dq + state.g, whole.effort(q, dq, ddq), DYNAMICS)
        assert_close(state.g, whole.effort(q, still, still), DYNAMICS)
        np.testing.assert_array_equal(robot.dynamic_state(q, still).C_dq, still)
        assert state.B.shape == (robot.n, robot.n)
        np.testing.assert_array_equal(state.B, state.B.T)
        assert np.linalg.eigvalsh(state.B)[0] > 1e-4
        for of_dynamics, kinematic in zip(state.arm, robot.state(q, dq), strict=True):
            np.testing.assert_array_equal(of_dynamics, kinematic)


@every_arm
@pytest.mark.parametrize("tool", [None, TOOL], ids=["bare", "tool"])
def test_the_formulas_are_what_pinocchio_makes_of_the_urdf(arm, tool):
    urdf, base, tip, _ = ARMS[arm]
    robot, axes = Robot(*ARMS[arm], tool=tool), pin.LOCAL_WORLD_ALIGNED
    whole = WholeModel(with_a_tool(urdf, tip, tool) if tool else urdf, robot.joints)
    model, data, moving = whole.model, whole.data, [j.idx_v for j in whole.joints]
    tip = model.getFrameId(tip, pin.FrameType.BODY)
    base = model.getFrameId(base, pin.FrameType.BODY) if base else 0  # the universe
    both = list(configurations(robot.n, key=8))
    stacked = robot.states(*map(np.array, zip(*both, strict=True)))
    for k, (q, dq) in enumerate(both):
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
        assert_close(C_dq + g, whole.effort(q, dq, 0 * dq))
        assert_close(g, whole.effort(q, 0 * dq, 0 * dq))
        for one, of_all in zip(arm, stacked, strict=True):
            np.testing.assert_array_equal(one, of_all[k])


def test_an_arm_of_which_the_formulas_make_another_one_is_refused(monkeypatch):
    right = Robot._chain
    monkeypatch.setattr(Robot, "_chain", lambda self: (1 + 1e-8) * right(self))
    with pytest.raises(RobotError, match="Pinocchio, which read the URDF, differ"):
        Robot(ARM, "base", "hand")


@every_arm
def test_dJ_dq_is_the_derivative_of_the_jacobian_times_dq(arm):
    robot = Robot(*ARMS[arm])
    still = np.zeros(robot.n)
    for q, dq in configurations(robot.n, key=10):
        dJ = derivative(lambda t, q=q, dq=dq: robot.state(q + t * dq, still).J)
        dJ_dq = robot.dynamic_state(q, dq).dJ_dq
        assert_close(dJ_dq, dJ @ dq, 10 * DIFFERENCES)
        assert np.linalg.norm(dJ_dq) > 1e-3
        np.testing.assert_array_equal(robot.dynamic_state(q, still).dJ_dq, np.zeros(6))


# A bead of 2 kg slides on a rod of 3 kg that turns about the horizontal y.
BEAD = """
<robot name="bead"> <link name="world"/>
  <link name="rod"><inertial> <origin xyz="0.4 0 0"/> <mass value="3"/>
    <inertia ixx="0.1" iyy="0.16" izz="0.16" ixy="0" ixz="0" iyz="0"/> </inertial></link>
  <link name="bead"><inertial> <mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/> </inertial></link>
  <joint name="turn" type="continuous"> <parent link="world"/> <child link="rod"/>
    <axis xyz="0 1 0"/> <limit velocity="9" effort="99"/> <dynamics damping="0.3" friction="0.7"/>
  </joint>
  <joint name="slide" type="prismatic"> <parent link="rod"/> <child link="bead"/>
    <axis xyz="1 0 0"/> <limit lower="0" upper="1" velocity="9" effort="99"/>
    <dynamics damping="4"/> </joint>
</robot>
"""


@pytest.mark.parametrize("phi", [0.0, 0.7, 2.9, -1.2, 7.5])
@pytest.mark.parametrize("r", [0.2, 0.9])
def test_a_bead_on_a_turning_rod_has_the_dynamics_of_the_textbook(phi, r):
    robot, dphi, dr = Robot(BEAD, "", "bead"), 1.3, -0.8
    state = robot.dynamic_state(np.array([phi, r]), np.array([dphi, dr]))
    along = np.array([math.cos(phi), 0, -math.sin(phi)])
    across = np.array([-math.sin(phi), 0, -math.cos(phi)])
    B = np.diag([0.16 + 3 * 0.4**2 + 0.02 + 2 * r**2, 2.0])
    C_dq = [2 * 2 * r * dr * dphi, -2 * r * dphi**2]
    g = [-9.81 * (3 * 0.4 + 2 * r) * math.cos(phi), -9.81 * 2 * math.sin(phi)]
    dJ_dq = [*(2 * dr * dphi * across - r * dphi**2 * along), 0, 0, 0]
    for found, expected in ((state.B, B), (state.C_dq, C_dq), (state.g, g), (state.dJ_dq, dJ_dq)):
        assert_close(found, expected, DYNAMICS)


def test_the_friction_of_the_urdf_is_that_of_the_active_joints_in_their_order():
    friction = Robot(BEAD, "", "bead", ("slide", "turn")).friction
    assert friction.viscous.tolist() == [0.3, 4.0]
    assert friction.coulomb.tolist() == [0.7, 0.0]
    assert not friction.is_none
    assert Robot(ARM, "base", "hand").friction.is_none


def test_joints_that_could_turn_the_base_are_named():
    assert Robot(ARM, "base", "hand").mount == ()
    assert Robot(ARM, "column", "hand").mount == ("turn",)
    assert Robot(ARM, "carriage", "hand").mount == ("turn",)  # not the lift, which only slides


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (9.81, 0.0, 0.0), (1.0, -3.0, 8.0)])
def test_gravity_is_the_vector_that_is_given_in_the_root(gravity):
    for arm in ("ur5", "panda", "every kind of joint"):
        robot = Robot(*ARMS[arm], gravity)
        upright = Robot(*ARMS[arm])
        whole, still = WholeModel(ARMS[arm][0], robot.joints, gravity), np.zeros(robot.n)
        for q, dq in configurations(robot.n, key=15)[:5]:
            state = robot.dynamic_state(q, dq)
            assert_close(state.g, whole.effort(q, still, still), DYNAMICS)
            before = upright.dynamic_state(q, dq)
            assert_same_dynamics(state, before._replace(g=state.g))
            assert np.abs(state.g - before.g).max() > 1


@every_arm
def test_a_tool_is_the_same_as_a_body_of_the_urdf(arm):
    urdf, base, tip, joints = ARMS[arm]
    held = Robot(urdf, base, tip, joints, tool=TOOL)
    described = Robot(with_a_tool(urdf, tip, TOOL), base, tip, joints)
    bare = Robot(urdf, base, tip, joints)
    for q, dq in configurations(held.n, key=17)[:10]:
        state = held.dynamic_state(q, dq)
        assert_same_dynamics(state, described.dynamic_state(q, dq))
        without = bare.dynamic_state(q, dq)
        np.testing.assert_array_equal(state.dJ_dq, without.dJ_dq)
        # the moment of its weight, by the principle of virtual work
        arm_state = state.arm
        lever = arm_state.R_e @ TOOL.com
        J_com = arm_state.J[:3] - np.cross(lever, arm_state.J[3:], axisb=0, axisc=0)
        weight = TOOL.mass * np.array(GRAVITY)
        if arm in ("every kind of joint", "a joint held still"):
            weight = MOUNT[1].T @ weight  # the base is not the root
        assert_close(without.g - state.g, J_com.T @ weight, DYNAMICS)


def test_a_dynamic_state_does_not_change_when_another_is_computed():
    for arm in ("ur5", "every kind of joint", "base is the root"):
        robot = Robot(*ARMS[arm])
        q = np.linspace(0.1, 0.5, robot.n)
        state = robot.dynamic_state(q, np.ones(robot.n))
        kept = [array.copy() for array in (*state.arm, *state[1:])]
        robot.dynamic_state(q + 1, -2 * np.ones(robot.n))
        for before, after in zip(kept, (*state.arm, *state[1:]), strict=True):
            np.testing.assert_array_equal(before, after)


# --- frames and joints --------------------------------------------------------------------


def test_a_base_that_is_not_the_root_moves_and_turns_kinematics_and_leaves_the_efforts():
    urdf = with_inertia(ARM)
    in_root, in_base = Robot(urdf, "", "hand"), Robot(urdf, "base", "hand")
    assert (in_root.base_frame, in_base.base_frame) == ("floor", "base")
    p_mount, R_mount = MOUNT
    for q, dq in configurations(3, key=4):
        of_root, of_base = in_root.dynamic_state(q, dq), in_base.dynamic_state(q, dq)
        assert_same_dynamics(of_root, of_base)
        a, b = of_root.arm, of_base.arm
        assert_close(a.p_e, p_mount + R_mount @ b.p_e, KINEMATICS)
        assert_close(a.R_e, R_mount @ b.R_e, KINEMATICS)
        assert_close((a.dp_e, a.omega_e), (R_mount @ b.dp_e, R_mount @ b.omega_e), KINEMATICS)
        for part in (slice(3), slice(3, 6)):
            assert_close(a.J[part], R_mount @ b.J[part], KINEMATICS)
            assert_close(of_root.dJ_dq[part], R_mount @ of_base.dJ_dq[part], DYNAMICS)


@pytest.mark.parametrize(
    ("base", "given", "active"),
    [
        ("base", (), {"turn": 0.5, "lift": 0.1, "bend": -0.7}),
        ("base", ("bend", "turn", "lift"), {"turn": 0.5, "lift": 0.1, "bend": -0.7}),
        ("base", ("bend", "turn"), {"turn": 0.5, "bend": -0.7}),
        ("column", (), {"lift": 0.3, "bend": -0.4}),
    ],
    ids=["all", "another order", "one is held still", "one is below the base"],
)
def test_joints_are_those_that_are_named_from_base_to_tip(base, given, active):
    robot = Robot(ARM, base, "hand", given)
    assert robot.joints == tuple(active)
    assert robot.n == len(active)
    p, R = arm_pose(**active)
    state = robot.state(np.array(list(active.values())), np.zeros(robot.n))
    origin = [0, 0, 0.2] if base == "column" else [0, 0, 0]
    assert_close(state.p_e, p - origin, KINEMATICS)
    assert_close(state.R_e, R, KINEMATICS)


def test_the_active_joints_are_those_that_move_the_tip_by_themselves():
    for tip, joints in (("hand", ()), ("left_finger", ("a_finger",)), ("right_finger", ())):
        assert Robot(ARM, "base", tip).joints == ("turn", "lift", "bend", *joints)


def test_the_limits_are_those_of_the_active_joints_in_their_order():
    limits = Robot(ARM, "base", "hand", ("bend", "lift", "turn")).limits
    assert limits.lower.tolist() == [-math.inf, -0.5, -1.0]
    assert limits.upper.tolist() == [math.inf, 0.5, 2.0]
    assert limits.velocity.tolist() == [1.0, 0.2, 3.0]
    assert limits.effort.tolist() == [10.0, 20.0, 30.0]


# --- refusals -----------------------------------------------------------------------------


JOINTS = "known: bend, lift, turn$"


@pytest.mark.parametrize(
    ("base", "tip", "joints", "text"),
    [
        ("base", "hnd", (), "^tip_frame: unknown frame.*did you mean 'hand'"),
        ("colum", "hand", (), "^base_frame: unknown frame.*did you mean 'column'"),
        ("base", "hnd", (), f"known: {', '.join(LINKS[:-1])}, right_finger, wrist$"),
        ("base", "hand", ("turn", "elbow"), f"^joints: unknown joint 'elbow'; {JOINTS}"),
        ("base", "hand", ("a_finger",), f"unknown joint 'a_finger'.*{JOINTS}"),  # elsewhere
        ("base", "hand", ("parallel",), f"unknown joint 'parallel'.*{JOINTS}"),  # mimics
        ("base", "hand", ("mount",), f"unknown joint 'mount'.*{JOINTS}"),  # fixed
        ("hand", "base", (), "'base' is not carried by link 'hand'"),
        ("floor", "base", (), "no joint moves between .*'floor' and .*'base'"),
        ("hand", "hand", (), "no joint moves between .*'hand' and .*'hand'"),
    ],
)
def test_frames_and_joints_that_are_no_chain_are_refused(base, tip, joints, text):
    with pytest.raises(RobotError, match=text):
        Robot(ARM, base, tip, joints)


def test_a_velocity_limit_of_zero_is_refused_for_an_active_joint_only():
    urdf = ARM.replace('velocity="0.2"', 'velocity="0"')
    with pytest.raises(RobotError, match="velocity limit of 0"):
        Robot(urdf, "base", "hand")
    assert Robot(urdf, "base", "hand", ("turn", "bend")).n == 2


def test_joint_values_of_the_wrong_number_are_refused_with_the_right_one():
    robot = Robot(ARM, "base", "hand")
    for q, dq in ((np.zeros(2), np.zeros(3)), (np.zeros(3), np.zeros(4))):
        for state in (robot.state, robot.dynamic_state):
            with pytest.raises(RobotError, match=r"expected \(3,\)"):
                state(q, dq)
