"""Forces and stiffnesses that the node ``reference`` streams: lock-step, and their numbers."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from ros_processes import FRAMES, UR5, Arm, Controlled, FeelingArm, wrench_stamped
from sensor_msgs.msg import JointState
from synthetic_runs import recorded
from test_experiments import started
from test_impedance_node import SIMULATED, target_wrench
from tolerances import ALGEBRAIC, assert_close

from eulerparams_control.analysis.quantities import measure
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.laws.rotations import exp
from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.messages.to_ros import impedance_to_ros
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.course import parse_course
from eulerparams_control.parameters.impedance_control import ImpedanceParameters

NAME = "impedance_control"
RAMP = [0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 14.0, 0.0, 0.0, 0.0]
SWING = [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]


# --- values over time ------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("t", "expected"),
    [(0.0, 10.0), (1.0, 10.0), (1.25, 10.5 + 2.0), (2.0, 12.0), (3.0, 14.0), (9.0, 14.0)],
)
def test_a_course_goes_straight_from_point_to_point_with_a_sine_and_stays(t, expected):
    course = parse_course("target_wrench", [1.0, 3.0], RAMP, SWING, frequency=1.0)
    assert_close(course.at(t), [0.0, 0.0, expected, 0.0, 0.0, 0.0], 10 * ALGEBRAIC)


@pytest.mark.parametrize(
    ("times", "values", "swing"),
    [
        *((times, RAMP, []) for times in ([], [1.0], [1.0, 1.0], [-1.0, 1.0], [1.0, math.inf])),
        ([1.0, 2.0], [math.nan, *RAMP[1:]], []),
        ([1.0, 2.0], RAMP, [1.0]),
    ],
)
def test_a_course_that_means_nothing_is_refused_by_its_name(times, values, swing):
    with pytest.raises(ConfigurationError, match=r"^target_wrench: "):
        parse_course("target_wrench", times, values, swing)


# --- the nodes -------------------------------------------------------------------------------
@pytest.mark.parametrize(("rate", "count"), [(0.0, 21), (200.0, 5)])
def test_reference_streams_a_force_under_the_stamps_of_the_states_at_a_rate(world, rate, count):
    peer, arm = world.peer, Arm(world, UR5)
    told = {"wrench_times": [0.0, 0.01], "wrenches": RAMP, "stream_rate": rate}
    world.start("reference", {**FRAMES, **told})
    found = peer.listen(WrenchStamped, "target_wrench")
    arm.send(arm.message())
    begin = arm.t
    arm.send_next(20)
    since = [(ns_from_ros(msg.header.stamp) - begin) / 1e9 for msg in found]
    np.testing.assert_allclose(since, np.arange(count) * (0.005 if rate else 0.001), atol=1e-9)
    assert {msg.header.frame_id for msg in found} == {UR5.tip_frame}
    f = [msg.wrench.force.z for msg in found]
    np.testing.assert_allclose(f, np.minimum(10.0 + 400.0 * np.array(since), 14.0), rtol=ALGEBRAIC)


def paired_arm(world):
    """Return an arm, its controller that waits for target_wrench, and who publishes that."""
    arm = FeelingArm(world, UR5)
    paired = {"wrench_pairing": "stamp", "paired_targets": ["target_wrench"]}
    process = world.start(NAME, {**SIMULATED, **paired})
    targets = world.peer.publisher(WrenchStamped, "/target_wrench")
    while not targets.get_subscription_count():
        arm.send_next()
        world.advance(0.01)
        assert world.now < 1100.0, process.log
    return arm, process, targets


def test_a_state_waits_for_the_target_of_its_stamp_also_for_one_that_is_refused(world):
    arm, process, targets = paired_arm(world)
    for force in (1e-3, 1e-3, math.nan, 1e-3):
        arm.send_next()
        assert arm.commands == []
        targets.publish(target_wrench(arm, 0.0, 0.0, force))
        assert ns_from_ros(arm.commands.pop().header.stamp) == arm.t
    assert "target_wrench rejected" in process.log
    assert "holding the measured pose, pressing with target_wrench" in process.log


def test_a_target_from_before_an_activation_is_no_pair(world):
    arm, _, targets = paired_arm(world)
    arm.send_next()
    targets.publish(target_wrench(arm, 0.0, 0.0, 0.0))
    assert world.peer.change_state(NAME, "deactivate")
    arm.send(arm.message())  # under the stamp of that target
    assert world.peer.change_state(NAME, "activate")
    arm.commands.clear()
    arm.send(arm.message())
    assert arm.commands == []
    targets.publish(target_wrench(arm, 0.0, 0.0, 0.0))
    assert ns_from_ros(arm.commands.pop().header.stamp) == arm.t


def test_a_target_that_nothing_takes_is_no_pair(world):
    process = world.start("clik", {**FRAMES, "paired_targets": ["target_wrench"]})
    assert process.end() == 1
    assert "unknown topic in paired_targets 'target_wrench'" in process.log


# --- experiments -----------------------------------------------------------------------------
POINT = {"times": [0.0], "positions": [0.487, 0.06, 0.43], "orientations": [1.0, 0.0, 0.0, 0.0]}
PRESSING = {
    "motion": "way_points",
    **POINT,
    "wrench_times": [0.0],
    "wrenches": RAMP[:6],
    "stiffness_times": [0.0, 1.0],
    "stiffnesses": [2550.0, 2550.0, 1000.0, 50.0, 50.0, 50.0] * 2,
    "stiffness_swing": [2450.0, 2450.0, 0.0, 0.0, 0.0, 0.0],
    "stiffness_frequency": 2.0,
}


def test_in_lock_step_each_state_waits_for_what_reference_streams(tmp_path):
    _, parameters = started(tmp_path, controller=NAME, nodes={"reference": PRESSING})
    assert parameters[NAME]["paired_targets"] == ["target_wrench", "target_stiffness"]
    assert parameters["reference"]["stream_rate"] == 0.0


# --- numbers ---------------------------------------------------------------------------------
def along_z(forces):
    """Return wrenches (6,) along z."""
    return [[0.0, 0.0, each, 0.0, 0.0, 0.0] for each in forces]


def run_of(folder: Path, count: int, **given):
    """Return a run of impedance control whose rod, its z along that of the base, is at rest."""
    return recorded(folder, [0.0] * count, **{"node": f"/{NAME}"} | given)


def pressing(folder: Path, f: list[float], f_d: list[float], **given):
    """Return a run whose rod presses along z."""
    told = {"force_axes": ["z"], "target_timeout": 0.1}
    wrenches = along_z(-each for each in f)
    return run_of(folder, len(f), wrenches=wrenches, targets=along_z(f_d), parameters=told, **given)


def acting(translation, rotation):
    """Return what makes ~/impedance of impedances with a stamp."""
    return partial(impedance_to_ros, translation, rotation)


def test_a_force_is_compared_with_its_target_along_the_force_axes(tmp_path):
    found = pressing(tmp_path / "run", [0.0, 0.0, 4.0, 12.0, 10.05, 9.95], [10.0] * 6)
    assert measure("peak_force_error", found) == pytest.approx(10.0)
    assert measure("final_force_error", found) == pytest.approx(0.05)
    assert measure("force_settling_time", found) == pytest.approx(0.02)  # 10 ms a sample
    assert measure("force_overshoot", found) == pytest.approx(20.0)
    left = pressing(tmp_path / "left", [0.0, 10.0, 10.0, 9.0], [10.0] * 4)
    assert measure("force_settling_time", left) == math.inf  # it does not stay


def test_without_a_target_or_after_it_has_ended_there_is_no_force_error(tmp_path):
    found = pressing(tmp_path / "run", [5.0] * 20, [10.0] * 4)
    assert np.isnan(found.pressed.f_d[:, 2]).tolist() == [False] * 14 + [True] * 6
    found = run_of(tmp_path / "without", 3, wrenches=along_z([0.0] * 3))
    with pytest.raises(BagError, match="no target_wrench"):
        measure("peak_force_error", found)


def test_a_force_that_swings_within_a_tenth_of_a_second_ripples(tmp_path):
    f = [10.0] * 50 + [10.0, 20.0] * 25 + [10.0] * 50
    found = pressing(tmp_path / "run", f, [10.0] * len(f))
    assert measure("rippling_time", found) == pytest.approx(0.6, abs=0.03)
    assert measure("rippling_time", found, most=11.0) == 0.0


def test_the_calming_time_is_from_the_first_swing_there_and_back_until_the_damping_rises(tmp_path):
    """A fast ramp is no swing; 6 N up and down from sample 100 on are; 3 x D from 150 on."""
    f = [0.5 * k for k in range(20)] + [10.0] * 80 + [10.0, 16.0] * 100
    p = ImpedanceParameters()
    Z = p.translation(), p.rotation()
    usual, damped = acting(*Z), acting(*(replace(each, D=3.0 * each.D) for each in Z))

    def calming_time(name, impedances, **options):
        found = pressing(tmp_path / name, f, [], impedances=impedances)
        return measure("calming_time", found, **options)

    assert calming_time("calm", {0: usual, 150: damped}) == pytest.approx(0.59)  # 0.5 s and a way
    assert calming_time("before", {0: usual, 20: damped, 200: usual}) == math.inf
    assert calming_time("weak", {0: usual, 150: damped}, most=6.5) == 0.0
    with pytest.raises(BagError, match="no ~/impedance"):
        calming_time("without", {})
    with pytest.raises(BagError, match="no damping on ~/impedance up to the first swing"):
        calming_time("late", {120: damped, 150: usual})


def test_the_energy_of_a_contact_is_that_of_force_and_speed(tmp_path):
    q = np.linspace(0.0, 0.1, 11)  # the tip goes down with 1 m/s at 1 m, and is pushed up
    found = recorded(tmp_path / "run", q, speeds=[1.0] * 11, wrenches=along_z([5.0] * 11))
    assert measure("final_contact_energy", found) == pytest.approx(0.5)


def test_residuals_and_V_are_of_the_impedance_that_acted(tmp_path):
    """1 cm and 0.1 rad along z; the stiffness is three times as large from sample 3 on."""
    told = {"M_p": [2.0] * 3, "K_p": [1000.0] * 3, "M_o": [1.0] * 3, "K_o": [20.0] * 3}
    p = ImpedanceParameters(**{name: tuple(values) for name, values in told.items()})
    stiffer = acting(*(replace(Z, K=3.0 * Z.K) for Z in (p.translation(), p.rotation())))
    moment = 20.0 * math.sin(0.1)  # (60), (66)
    balance = np.array([0.0, 0.0, 10.0, 0.0, 0.0, moment])
    wrenches = [balance.tolist()] * 3 + [(3 * balance).tolist()] * 3
    frames = [DesiredFrame(np.array([1.0, 0.0, 0.01]), exp(np.array([0.0, 0.0, 0.1])))] * 6
    run = {"compliant": frames, "wrenches": wrenches, "parameters": told}
    found = run_of(tmp_path / "run", 6, **run, impedances={3: stiffer})
    for residual in ("force_residual", "moment_residual"):
        assert measure(residual, found) < 1e-9
    V = 40.0 * math.sin(0.05) ** 2  # 2 eps' K_o eps, (68)
    assert_close(found.lyapunov.V, [V] * 3 + [3 * V] * 3, 10 * ALGEBRAIC)
    assert measure("force_residual", run_of(tmp_path / "without", 6, **run)) == pytest.approx(20.0)


def test_while_a_force_is_exerted_no_stiffness_has_to_account_for_it(tmp_path):
    frames = [DesiredFrame(np.array([1.0, 0.0, 0.01]), np.eye(3))] * 20
    told = {"K_p": [1000.0] * 3, "force_axes": ["z"], "target_timeout": 0.1}
    run = {"wrenches": along_z([-7.0] * 15 + [10.0] * 5), "targets": along_z([7.0] * 5)}
    found = run_of(tmp_path / "run", 20, compliant=frames, parameters=told, **run)
    assert measure("force_residual", found) < 1e-9


def test_the_impedance_that_acts_is_published_while_it_changes(world):
    node = Controlled(world, NAME, {**SIMULATED, "wrench_pairing": "stamp"})
    found = node.peer.listen(JointState, f"/{NAME}/impedance")
    stiffness = node.peer.sender(WrenchStamped, "/target_stiffness")
    node.arm.ticks(3)
    found.clear()
    stiffness.publish(wrench_stamped(500.0, 2000.0, 2000.0, 100.0, 100.0, 100.0, frame=""))
    node.arm.ticks(100)
    K = [dict(zip(each.name, each.position, strict=True))["K_p.xx"] for each in found]
    assert len(K) > 90
    assert np.all(np.diff(K) < 0.0)
    assert K[0] < 2000.0
    node.arm.ticks(700)
    last = dict(zip(found[-1].name, found[-1].position, strict=True))
    assert last["K_p.xx"] == pytest.approx(500.0)
    assert last["D_p.xx"] == pytest.approx(2.0 * math.sqrt(500.0))  # M_p is 1 kg, the ratio 1
    assert len(found) < 800
