"""The robot: kinematics against finite differences and by hand, and what it refuses."""

import math

import numpy as np
import pytest
from samples import about, derivative, generator, rodrigues
from tolerances import ALGEBRAIC, DIFFERENCES, KINEMATICS

from eulerparams_control.catalogue import load_robot
from eulerparams_control.errors import RobotError
from eulerparams_control.robot import Robot, RobotState

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


def catalogue_robot(name):
    """Return a robot of the catalogue and its home."""
    description = load_robot(name)
    robot = Robot(
        description.urdf, description.base_frame, description.tip_frame, description.joints
    )
    return robot, np.array(description.home)


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
    pairs = zip(
        random.uniform(-2, 2, size=(SAMPLES, n)), random.normal(size=(SAMPLES, n)), strict=True
    )
    return list(pairs)


def assert_twist_is_the_derivative_of_the_pose(robot, q, dq):
    """Assert (20) against differences of (18), (19)."""
    state = robot.state(q, dq)
    still = np.zeros(robot.n)
    dp = derivative(lambda t: robot.state(q + t * dq, still).p_e)
    dR = derivative(lambda t: robot.state(q + t * dq, still).R_e)
    S_omega = dR @ state.R_e.T
    omega = np.array([S_omega[2, 1], S_omega[0, 2], S_omega[1, 0]])
    np.testing.assert_allclose(state.dp_e, dp, rtol=0, atol=DIFFERENCES)
    np.testing.assert_allclose(state.omega_e, omega, rtol=0, atol=DIFFERENCES)
    np.testing.assert_allclose(S_omega, -S_omega.T, rtol=0, atol=DIFFERENCES)


# --- eqs. (18)-(20) -----------------------------------------------------------------------


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_twist_is_the_derivative_of_the_pose(name):
    robot, _ = catalogue_robot(name)
    for q, dq in configurations(robot.n, key=0):
        assert_twist_is_the_derivative_of_the_pose(robot, q, dq)


@pytest.mark.parametrize("base", ["", "floor", "base", "column", "carriage"])
def test_the_twist_is_the_derivative_of_the_pose_for_every_kind_of_joint_and_base(base):
    robot = Robot(ARM, base, "hand")
    for q, dq in configurations(robot.n, key=1):
        assert_twist_is_the_derivative_of_the_pose(robot, q, dq)


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_jacobian_times_dq_is_the_twist_column_by_column(name):
    robot, _ = catalogue_robot(name)
    for q, _ in configurations(robot.n, key=2):
        J = robot.state(q, np.zeros(robot.n)).J
        assert J.shape == (6, robot.n)
        for i, dq in enumerate(np.eye(robot.n)):
            state = robot.state(q, dq)
            twist = np.concatenate((state.dp_e, state.omega_e))
            np.testing.assert_allclose(J[:, i], twist, rtol=0, atol=ALGEBRAIC)
            # the linear part comes first: a revolute joint turns at 1 rad/s
            assert np.linalg.norm(J[3:, i]) == pytest.approx(1, abs=ALGEBRAIC)


def test_the_pose_of_an_arm_with_every_kind_of_joint_is_that_by_hand():
    robot = Robot(ARM, "base", "hand")
    assert robot.joints == ("turn", "lift", "bend")
    for q, dq in configurations(3, key=3):
        state = robot.state(q, dq)
        p, R = arm_pose(*q)
        np.testing.assert_allclose(state.p_e, p, rtol=0, atol=KINEMATICS)
        np.testing.assert_allclose(state.R_e, R, rtol=0, atol=KINEMATICS)
        np.testing.assert_allclose(state.J[3:, 1], 0, rtol=0, atol=KINEMATICS)  # prismatic


def test_a_continuous_joint_turns_any_number_of_times():
    robot = Robot(ARM, "base", "hand")
    still = np.zeros(3)
    once, more = (robot.state(np.array([a, 0.1, 0.2]), still) for a in (0.3, 0.3 + 20 * math.pi))
    np.testing.assert_allclose(once.p_e, more.p_e, rtol=0, atol=KINEMATICS)
    np.testing.assert_allclose(once.J, more.J, rtol=0, atol=KINEMATICS)


# --- frames and joints --------------------------------------------------------------------


def test_a_base_that_is_not_the_root_moves_and_turns_pose_and_jacobian():
    in_root, in_base = Robot(ARM, "", "hand"), Robot(ARM, "base", "hand")
    assert (in_root.base_frame, in_base.base_frame) == ("floor", "base")
    p_mount, R_mount = MOUNT
    for q, dq in configurations(3, key=4):
        a, b = in_root.state(q, dq), in_base.state(q, dq)
        np.testing.assert_allclose(a.p_e, p_mount + R_mount @ b.p_e, rtol=0, atol=KINEMATICS)
        for of_a, of_b in (
            (a.R_e, b.R_e),
            (a.dp_e, b.dp_e),
            (a.omega_e, b.omega_e),
            (a.J[:3], b.J[:3]),
            (a.J[3:], b.J[3:]),
        ):
            np.testing.assert_allclose(of_a, R_mount @ of_b, rtol=0, atol=KINEMATICS)


def test_joints_below_the_base_do_not_count():
    robot = Robot(ARM, "column", "hand")
    assert robot.joints == ("lift", "bend")
    p, R = arm_pose(0.0, 0.3, -0.4)
    state = robot.state(np.array([0.3, -0.4]), np.zeros(2))
    np.testing.assert_allclose(state.p_e, p - [0, 0, 0.2], rtol=0, atol=KINEMATICS)
    np.testing.assert_allclose(state.R_e, R, rtol=0, atol=KINEMATICS)


def test_joints_given_in_another_order_are_taken_from_base_to_tip():
    robot = Robot(ARM, "base", "hand", ("bend", "turn", "lift"))
    assert robot.joints == ("turn", "lift", "bend")
    p, _ = arm_pose(0.5, 0.1, -0.7)
    state = robot.state(np.array([0.5, 0.1, -0.7]), np.zeros(3))
    np.testing.assert_allclose(state.p_e, p, rtol=0, atol=KINEMATICS)


def test_a_joint_that_is_not_named_is_held_still():
    robot = Robot(ARM, "base", "hand", ("bend", "turn"))
    assert robot.joints == ("turn", "bend")
    assert robot.n == 2
    p, R = arm_pose(turn=0.5, bend=-0.7)
    state = robot.state(np.array([0.5, -0.7]), np.zeros(2))
    np.testing.assert_allclose(state.p_e, p, rtol=0, atol=KINEMATICS)
    np.testing.assert_allclose(state.R_e, R, rtol=0, atol=KINEMATICS)


def test_a_gripper_and_a_mimic_joint_are_not_active():
    assert Robot(ARM, "base", "hand").joints == ("turn", "lift", "bend")
    assert Robot(ARM, "base", "left_finger").joints == ("turn", "lift", "bend", "a_finger")
    assert Robot(ARM, "base", "right_finger").joints == ("turn", "lift", "bend")


def test_the_limits_are_those_of_the_active_joints_in_their_order():
    limits = Robot(ARM, "base", "hand", ("bend", "lift", "turn")).limits
    assert limits.lower.tolist() == [-math.inf, -0.5, -1.0]
    assert limits.upper.tolist() == [math.inf, 0.5, 2.0]
    assert limits.velocity.tolist() == [1.0, 0.2, 3.0]
    assert limits.effort.tolist() == [10.0, 20.0, 30.0]


def test_a_state_does_not_change_when_another_is_computed():
    for robot in (Robot(ARM, "base", "hand"), Robot(ARM, "", "hand"), catalogue_robot("ur5")[0]):
        q = np.linspace(0.1, 0.5, robot.n)
        state = robot.state(q, np.ones(robot.n))
        kept = RobotState(*(array.copy() for array in state))
        robot.state(q + 1, np.ones(robot.n))
        for before, after in zip(kept, state, strict=True):
            np.testing.assert_array_equal(before, after)


def test_the_rotation_of_a_tip_is_a_rotation():
    for name in CATALOGUE:
        robot, _ = catalogue_robot(name)
        for q, dq in configurations(robot.n, key=5):
            R_e = robot.state(q, dq).R_e
            np.testing.assert_allclose(R_e @ R_e.T, np.eye(3), rtol=0, atol=ALGEBRAIC)
            assert np.linalg.det(R_e) == pytest.approx(1, abs=ALGEBRAIC)


def test_a_joint_turns_the_tip_about_the_axis_that_the_jacobian_names():
    robot, home = catalogue_robot("ur5")
    before = robot.state(home, np.zeros(6))
    for i in range(6):
        q = home.copy()
        q[i] += 0.7
        after = robot.state(q, np.zeros(6))
        turn = rodrigues(0.7, before.J[3:, i])
        np.testing.assert_allclose(after.R_e, turn @ before.R_e, rtol=0, atol=ALGEBRAIC)


# --- refusals -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("base", "tip", "parameter", "guess"),
    [("base", "hnd", "tip_frame", "hand"), ("colum", "hand", "base_frame", "column")],
)
def test_an_unknown_frame_is_refused_with_those_that_exist(base, tip, parameter, guess):
    with pytest.raises(RobotError) as refusal:
        Robot(ARM, base, tip)
    text = str(refusal.value)
    assert text.startswith(f"{parameter}: unknown frame")
    assert f"did you mean '{guess}'" in text
    assert "known: " + ", ".join(LINKS[:-1]) in text
    assert text.endswith("right_finger, wrist")


def test_an_unknown_joint_is_refused_with_those_that_move_between_base_and_tip():
    with pytest.raises(RobotError) as refusal:
        Robot(ARM, "base", "hand", ("turn", "elbow"))
    assert str(refusal.value) == "joints: unknown joint 'elbow'; known: bend, lift, turn"


@pytest.mark.parametrize("joint", ["a_finger", "parallel", "mount"])
def test_a_joint_that_is_elsewhere_or_mimics_or_is_fixed_cannot_be_active(joint):
    with pytest.raises(RobotError, match=f"unknown joint '{joint}'.*known: bend, lift, turn$"):
        Robot(ARM, "base", "hand", (joint,))


def test_a_base_that_does_not_carry_the_tip_is_refused():
    with pytest.raises(RobotError, match="'base' is not carried by link 'hand'"):
        Robot(ARM, "hand", "base")


@pytest.mark.parametrize(("base", "tip"), [("floor", "base"), ("hand", "hand")])
def test_a_tip_that_no_joint_moves_is_refused(base, tip):
    with pytest.raises(RobotError, match=f"no joint moves between .*'{base}' and .*'{tip}'"):
        Robot(ARM, base, tip)


def test_a_velocity_limit_of_zero_is_refused_for_an_active_joint_only():
    urdf = ARM.replace('velocity="0.2"', 'velocity="0"')
    with pytest.raises(RobotError, match="velocity limit of 0"):
        Robot(urdf, "base", "hand")
    assert Robot(urdf, "base", "hand", ("turn", "bend")).n == 2


@pytest.mark.parametrize("text", ["", "<robot", "<sdf/>", ARM.replace('link="base"', 'link="x"')])
def test_a_broken_urdf_is_refused(text):
    with pytest.raises(RobotError):
        Robot(text, "", "hand")


def test_joint_values_of_the_wrong_number_are_refused_with_the_right_one():
    robot = Robot(ARM, "base", "hand")
    for q, dq in ((np.zeros(2), np.zeros(3)), (np.zeros(3), np.zeros(4))):
        with pytest.raises(RobotError, match=r"expected \(3,\)"):
            robot.state(q, dq)
