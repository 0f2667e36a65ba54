"""Stops under efforts: what pushed the arm is held, what it drove into is let go.

The plants have joints of 1 Nm s/rad and 0.5 Nm friction, and rotors that no model knows.
"""

from dataclasses import replace

import numpy as np
import pytest
from arms import robot_named
from leaning import Hand, Leaning, Wall, most_that_joints_hold

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.hold import JointHold
from eulerparams_control.motion.frames import DesiredFrame

ARMS = ("ur5", "panda", "kuka_iiwa")
# The sides from which a hand comes, and those to which an arm drives.
AXES = np.vstack((np.eye(3), -np.eye(3)))
# A person leans on an arm with no more [N].
LEANS = 100.0
# What pushes an arm until it stops [N]: no more than its joints can hold.
PUSHES = {"ur5": 150.0, "panda": 45.0, "kuka_iiwa": 150.0}
# A stop gives way by no more [m], where the contact is not measured by twice that; the tip is no
# faster [m/s], the joints no faster [rad/s].
GIVES_WAY, SLOW_TIP, SLOW_JOINTS = 0.010, 0.25, 0.5
# What is left [N], and how fast joints are [rad/s], a second after an arm drove into a contact.
CLAMPED, RESTS = 50.0, 0.02


def leaned_on(arm, axis, law="dynamic_control", **parameters):
    """Return an arm that holds, a hand on it that may push along an axis, and how hard [N]."""
    leaning = Leaning(law, arm, parameters=parameters)
    leaning.run(0.1)
    leaning.force = Hand(axis)
    return leaning, leaning.force, min(LEANS, 0.2 * most_that_joints_hold(leaning.plant, axis))


def lead(leaning, *way):
    """Order a motion by some way [m]."""
    here = leaning.scheme.start_frame()
    leaning.controller.aim(DesiredFrame(here.p_d + way, here.R_d), leaning.now)


def halted_before(leaning, hand, most):
    """Its hold has got as stiff as it may."""
    leaning.controller.halt()
    leaning.run(0.5)
    leaning.forget()
    hand.grow(leaning, most)


def halted_while_it_is_pushed(leaning, hand, most):
    hand.grow(leaning, most)
    leaning.controller.halt()
    leaning.forget()


def stopped_by_what_it_measures(leaning, hand, most):
    hand.grow(leaning, most, until=leaning.is_stopped)
    assert leaning.controller.why.cause is Cause.CONTACT_TOO_LARGE
    leaning.forget()


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize(
    ("stop", "law", "gives", "joints"),
    [
        (halted_before, "dynamic_control", GIVES_WAY, SLOW_JOINTS),
        (halted_while_it_is_pushed, "dynamic_control", 2 * GIVES_WAY, np.inf),
        (stopped_by_what_it_measures, "impedance_control", GIVES_WAY, np.inf),
    ],
)
def test_a_stopped_arm_hardly_moves_where_a_person_pushes_it(arm, stop, law, gives, joints):
    given = {"max_contact_force": PUSHES[arm] - 10.0} if law == "impedance_control" else {}
    for axis in AXES[:3]:
        leaning, hand, most = leaned_on(arm, axis, law, **given)
        most = PUSHES[arm] if given else most
        stop(leaning, hand, most)
        hand.most = most
        leaning.run(0.5)
        assert leaning.gave_way < gives
        assert np.max(leaning.joints) < joints
        hand.most = 0.0
        leaning.run(0.3)
        assert max(leaning.speeds) < SLOW_TIP
        assert np.linalg.norm(leaning.path[-1] - leaning.path[0]) < gives
        assert leaning.mode is Mode.STOPPED


@pytest.mark.parametrize(
    ("law", "given"),
    [("dynamic_control", {}), ("impedance_control", {"max_contact_force": 100.0})],
)
@pytest.mark.parametrize("arm", ARMS)
def test_what_an_arm_drove_into_is_let_go_and_no_joint_is_flung_by_the_stop(arm, law, given):
    for axis in AXES[::2]:
        leaning, *_ = leaned_on(arm, axis, law, **given)
        here = leaning.scheme.start_frame()
        leaning.force = Wall(here.p_d + 0.08 * axis, -axis, 2e4)
        lead(leaning, *(0.3 * axis))
        assert leaning.run(4.0, until=leaning.is_stopped)
        before = np.max(leaning.joints)
        leaning.forget()
        leaning.run(1.0)
        assert np.max(leaning.joints) < 1.1 * before
        assert np.max(leaning.joints[-1]) < RESTS
        assert np.linalg.norm(leaning.touched) < CLAMPED
        assert leaning.mode is Mode.STOPPED
        hand = leaning.force = Hand(-axis)  # of a person who takes the place of the wall
        leaning.run(0.5)
        leaning.forget()
        hand.grow(leaning, min(LEANS, PUSHES[arm]))
        assert leaning.gave_way < GIVES_WAY


def test_a_load_that_was_lifted_and_that_nobody_declared_is_held_and_not_let_go():
    leaning = Leaning("dynamic_control", "ur5")
    leaning.force = lambda p, v: np.array([0.0, 0.0, -60.0])
    leaning.run(1.0)
    lead(leaning, 0.0, 0.0, 0.15)
    leaning.run(2.0)
    leaning.controller.halt()
    leaning.run(0.2)
    leaning.forget()
    leaning.run(1.0)
    assert leaning.mode is Mode.STOPPED
    assert leaning.gave_way < GIVES_WAY


def test_friction_of_the_joints_is_no_contact_where_an_arm_is_stopped_in_motion():
    leaning = Leaning("dynamic_control", "ur5", viscous=10.0, coulomb=5.0, rotors=0.0)
    leaning.run(0.1)
    lead(leaning, 0.0, 0.3, 0.0)
    leaning.run(1.0)
    assert leaning.speeds[-1] > 0.15
    scheme = leaning.scheme  # which does not follow well enough now
    scheme.change(replace(scheme.parameters, max_error_position=1e-6))
    dq = [leaning.plant.dq]
    for _ in range(250):
        leaning.tick()
        dq.append(leaning.plant.dq)
    assert leaning.controller.why.cause is Cause.NOT_FOLLOWING
    hardest = np.abs(np.diff(dq, axis=0)).max() / leaning.dt
    assert hardest < 1.2 * scheme.limits.acceleration.max()
    assert max(leaning.speeds[-5:]) < 0.02


@pytest.mark.parametrize(
    ("arm", "late", "given"),
    [
        *(("ur5", ticks, {}) for ticks in (1, 3, 6, 8)),  # of 2 ms
        ("kuka_iiwa", 0, {"max_effort_rate": (1000.0,)}),
    ],
)
def test_where_commands_act_late_or_slowly_the_hold_is_softer_and_does_not_swing(arm, late, given):
    plant = {"viscous": 0.0, "coulomb": 0.0, "rotors": 0.0}
    leaning = Leaning("dynamic_control", arm, parameters=given, late=late, **plant)
    leaning.run(0.1)
    leaning.controller.jog(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5]), leaning.now)
    leaning.run(0.1)
    leaning.controller.halt()
    leaning.run(2.0)
    leaning.forget()
    leaning.run(1.0)
    assert leaning.mode is Mode.STOPPED
    assert np.max(leaning.joints) < RESTS
    assert leaning.gave_way < 1e-3


def test_an_arm_that_is_leaned_on_again_and_again_stays_as_stiff_as_it_was():
    leaning = Leaning("dynamic_control", "kuka_iiwa", rate=250)
    leaning.run(0.1)
    gave_way = np.array([halted_and_let_go(leaning, AXES[:3]) for _ in range(2)])
    assert (gave_way[1] < 1.1 * gave_way[0]).all()


def halted_and_let_go(leaning, axes):
    """Return how far [m] a halted arm gives way along each axis."""
    leaning.controller.halt()
    leaning.run(0.5)
    gave_way = []
    for axis in axes:
        hand = leaning.force = Hand(axis)
        leaning.forget()
        hand.grow(leaning, min(LEANS, 0.2 * most_that_joints_hold(leaning.plant, axis)))
        gave_way.append(leaning.gave_way)
        hand.most = 0.0
        leaning.run(0.5)
    return gave_way


@pytest.mark.parametrize("arm", ARMS)
def test_an_arm_that_is_let_go_hardly_moves_where_its_sensor_is_lost_in_the_stop(arm):
    for axis in AXES[:3]:
        most = {"max_contact_force": PUSHES[arm] - 10.0}
        leaning, hand, _ = leaned_on(arm, axis, "impedance_control", **most)
        stopped_by_what_it_measures(leaning, hand, PUSHES[arm])
        leaning.is_blind, hand.most = True, PUSHES[arm]
        leaning.run(0.5)
        assert leaning.gave_way < GIVES_WAY
        hand.most = 0.0
        leaning.run(0.3)
        assert max(leaning.speeds) < SLOW_TIP


@pytest.mark.parametrize("lost", [2, 5])
def test_a_joint_without_an_effort_limit_is_held_as_the_others_are(lost):
    robot, home = robot_named("ur5")
    effort, nothing = robot.limits.effort.copy(), np.zeros(6)
    effort[lost] = np.inf
    limits, begun = replace(robot.limits, effort=effort), robot.dynamic_state(home, nothing)
    for joint in range(6):
        hold = JointHold(limits, limits.effort_rate, robot.length, begun, nothing, None, False)
        state = robot.dynamic_state(home + 0.01 * np.eye(6)[joint], nothing)
        tau = hold.effort(0.001, state, nothing, nothing, None)
        assert (tau - state.g)[joint] < -0.05  # drawn back


def test_a_halted_arm_that_may_only_creep_does_not_run_away_where_it_is_pushed():
    leaning, hand, most = leaned_on("kuka_iiwa", AXES[0], velocity_scale=0.1)
    leaning.controller.halt()
    leaning.run(0.6)
    leaning.forget()
    hand.most = most  # at once
    leaning.run(0.5)
    assert leaning.controller.why.cause is Cause.HALT
    assert leaning.gave_way < GIVES_WAY


@pytest.mark.parametrize("law", ["dynamic_control", "impedance_control", "compliance_control"])
def test_an_arm_that_ran_away_gets_no_efforts_until_it_is_resumed(law):
    leaning = Leaning(law, "ur5")
    leaning.run(0.1)
    leaning.plant.dq = 2.0 * leaning.plant.robot.limits.velocity
    leaning.plant.push(leaning.tau, leaning.force, leaning.dt)
    leaning.tick()
    assert leaning.controller.why.cause is Cause.RUNAWAY
    assert leaning.run(2.0, until=lambda: leaning.mode is Mode.STOPPED)
    leaning.forget()
    leaning.run(1.0)
    assert leaning.efforts == [None] * len(leaning.efforts)
    with pytest.raises(InvalidMessageError, match="~/resume"):
        lead(leaning, 0.0, 0.0, 0.0)
    leaning.controller.resume()
    leaning.run(0.2)
    assert leaning.mode is Mode.HOLDING
    assert leaning.efforts[-1] is not None
    assert leaning.gave_way < GIVES_WAY
