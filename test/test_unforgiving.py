"""The simulated robot is as unforgiving as a real one, where it is told to be."""

from dataclasses import replace

import numpy as np
import pytest
import test_drive
from builtin_interfaces.msg import Time
from ros_processes import values
from sensor_msgs.msg import JointState
from test_drive import HOME, MS, UR5, at
from test_simulator import ROTORS

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.messages.keys import MODE
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.acceleration import BRIDGED, CommandAcceleration
from sim_bridge.drive import IN_STOP, STOPS
from sim_bridge.drive_modes import DriveCause, DriveMode, DrivePolicy, DriveReply, OnSilence
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.servo import wrapped
from sim_bridge.simulator import Simulator

# Its last joint turns for ever.
TURNING = replace(
    UR5,
    urdf=UR5.urdf.replace('name="wrist_3_joint" type="revolute"',
                          'name="wrist_3_joint" type="continuous"'),
)  # fmt: skip
LIMIT = 10.0  # [rad/s^2]
DT = 1e-3  # [s] of a step
# Of the motors of PyBullet, which leave 5e-8 rad/s in a step.
MOTORS = 1e-3


# --- the acceleration that commands ask for --------------------------------------------------
# Commands are their stamp [ns], when they came [s], position [rad] and speed [rad/s] of a joint.
def swing(stamps, *, late=0.0, speeds=True, turn=False):
    """Return commands that swing a joint with 0.95 of the limit, stamped so [ms], ``late`` [s].

    Its speeds may be missing, its positions wrapped.
    """
    t, w = np.asarray(stamps) / 1e3, 2.0
    q = 0.95 * LIMIT / w**2 * (1.0 - np.cos(w * t))
    dq = 0.95 * LIMIT / w * np.sin(w * t) * speeds
    q = wrapped(q, np.array(turn))
    found = zip(1_000_000_000 + np.round(t * 1e9).astype(int), t + late, q, dq, strict=True)
    return [(int(s), *map(float, rest)) for s, *rest in found]


def spoilt(k, *, since=0, **by):
    """Return a swing whose commands from ``k`` on are off by so much."""
    changes = [by.get(name, 0.0) for name in ("stamp", "now", "q", "dq")]
    asked = swing(range(400))
    return asked[since:k] + [tuple(map(sum, zip(c, changes, strict=True))) for c in asked[k:]]


RANDOM = np.random.default_rng(1)
MISSED = [0, *np.cumsum(RANDOM.choice([1, 2, 3, 5, 12], size=300))]
EVERY = range(3000)
UNSTAMPED = [(0, now, q, dq) for _, now, q, dq in swing(EVERY)]
REPEATED = [asked for asked in swing(range(0, 3000, 4)) for _ in range(3)]
A_GAP = [k for k in range(900) if not 700 <= k < 750]
# Positions go on as if there had been no gap.
LEFT_OUT = [(s + 19 * MS * (k > 100), t, q, dq) for k, (s, t, q, dq) in enumerate(swing(EVERY))]

SMOOTH = {
    "at each state": swing(EVERY),
    "at 20 Hz": swing(range(0, 3000, 50)),
    "positions only": swing(EVERY, speeds=False),
    "states are missed": swing(MISSED),
    "late by chance": swing(EVERY, late=RANDOM.uniform(0.0, 0.05, 3000)),
    "without stamps": UNSTAMPED,
    "repeated under the same stamp": REPEATED,
    "a clock that goes back": [(s - 5 * 10**8 * (k > 400), *rest) for k, (s, *rest) in
                               enumerate(swing(range(0, 3000, 4)))],
    "a clock that goes back, then on": [(s - 57 * 10**7 * (k % 12 < 3), *rest) for k, (s, *rest) in
                                        enumerate(swing(range(0, 3000, 8)))],
    "a stamp just after the last": swing([*range(0, 400, 4), *np.arange(396.2, 900.0, 4)]),
    "past half a turn, wrapped": swing(EVERY, turn=True),
    "from where it is measured to be": spoilt(0, q=1e-4),
    "a gap that a robot bridges": swing([k for k in range(900) if not 700 <= k < 719]),
    "what was missed is left out": LEFT_OUT,
}  # fmt: skip

SUDDEN = {
    "a step of 1 mrad": spoilt(200, q=1e-3),
    "a step of speed alone": spoilt(200, dq=0.05),
    "it begins with a speed": spoilt(200, since=200, q=-swing([200])[0][2]),
    "it begins elsewhere": spoilt(0, q=0.02),
    "it halts at once": [*swing(range(300)), *[(s, t, swing([299])[0][2], 0.0) for s, t, _, _ in
                                                swing(range(300, 310))]],
    "a step without stamps": [(0, now, q, dq) for _, now, q, dq in spoilt(200, q=1e-3)],
    "a step under a stamp of the past": spoilt(200, stamp=-(10**8), q=0.05),
    "a step instead of the last command": [*swing(range(200)), (*swing([199])[0][:2],
                                           swing([199])[0][2] + 1e-3, swing([199])[0][3])],
    "a step over a long gap": swing(A_GAP),
}  # fmt: skip


def judged(asked, *, turning=True):
    """Return what is found of commands to a joint of an arm that stands at 0."""
    one = np.array([LIMIT])
    watch = CommandAcceleration(["a"], one, np.array([turning]), [False], DT)
    zero = np.zeros(1)
    found = (watch.judge(np.array([q]), np.array([dq]), s, t, zero) for s, t, q, dq in asked)
    return next(filter(None, found), "")


@pytest.mark.parametrize("name", [*SMOOTH, *SUDDEN])
def test_smooth_commands_are_taken_however_they_come_and_a_sudden_one_is_found(name):
    if name in SMOOTH:
        assert judged(SMOOTH[name]) == ""
    else:
        assert "joint 'a' was asked for" in judged(SUDDEN[name])


def test_a_step_is_found_from_the_limit_on_and_each_joint_has_its_own():
    watch = CommandAcceleration("ab", np.array([LIMIT, np.inf]), np.zeros(2, bool), [True] * 2, DT)
    zero = np.zeros(2)
    for k, (jump, words) in enumerate([(0.999, ""), (1.001, "10.01 m/s^2; the most is 10 m/s^2")]):
        watch.rest()
        watch.judge(zero, zero, MS, 0.0, zero)
        watch.judge(zero, zero, 2 * MS, DT, zero)
        text = watch.judge(zero, np.array([jump * LIMIT * DT, 1e3]), 3 * MS, 2 * DT, zero)
        assert words in text, k
        assert bool(text) is bool(words)
    # and so is a turn of a joint that does not turn for ever
    assert "joint 'a' was asked for" in judged(swing(EVERY, turn=True), turning=False)


# --- what it does then -----------------------------------------------------------------------
class Bench(test_drive.Bench):
    """A drive and a controller at each step of 1 ms."""

    def __init__(self, robot=UR5, policy=None, **parameters):
        usual = {"rate": 1000.0, "servo_bandwidth": SimulatorParameters.servo_bandwidth}
        super().__init__(DrivePolicy(**policy or {}), robot, **(usual | parameters))

    @property
    def status(self):
        return self.drive.status.mode, self.drive.status.cause

    @property
    def q(self):
        return self.state.q

    def send(self, **fields):
        given = {name: list(map(float, values)) for name, values in fields.items()}
        return super().send(round(self.now * 1e9) + MS, **given)

    def steps(self, count, command=None):
        self.step(count * DT, (lambda: self.send(**command())) if command else (lambda: None))


@pytest.fixture
def bench(closing):
    return lambda *args, **keywords: closing(Bench(*args, **keywords))


def beside(by, joint=0):
    """Return home, one joint off by so much [rad]."""
    return HOME + by * (np.arange(6) == joint)


SUDDENLY = {"max_joint_acceleration": (LIMIT,)}


@pytest.mark.parametrize("delay", [0, 5])
def test_a_sudden_command_stops_the_robot_until_it_is_unlocked(bench, delay):
    it = bench(policy={**SUDDENLY, "command_delay": delay})
    it.steps(20, lambda: at(HOME))
    it.steps(1 + delay, lambda: at(beside(0.05)))
    assert it.status == (DriveMode.STOPPING, DriveCause.ACCELERATION)
    assert "shoulder_pan_joint" in it.drive.status.violation
    it.steps(300, lambda: at(HOME))  # it is at rest for long
    assert it.status == (DriveMode.STOPPING, DriveCause.ACCELERATION)
    np.testing.assert_allclose(it.q, HOME, atol=1e-6)
    assert (it.drive.values[STOPS], it.drive.values[IN_STOP]) == (1, 300)
    assert it.drive.unlock(it.now)
    assert it.status == (DriveMode.BRAKED, DriveCause.ACCELERATION)
    assert it.send(**at(it.q)) is DriveReply.TAKEN
    assert it.status == (DriveMode.OBEYING, DriveCause.NONE)


def test_a_moving_robot_is_not_unlocked(bench):
    it = bench(policy=SUDDENLY)
    speeds = iter(0.9 * LIMIT * DT * np.arange(1, 101))

    def faster():
        speed = next(speeds)
        return {"position": it.q + DT * speed, "velocity": [speed] * 6}

    it.steps(100, faster)
    it.steps(1, lambda: at(it.q))
    assert it.status == (DriveMode.STOPPING, DriveCause.ACCELERATION)
    assert not it.drive.unlock(it.now)
    it.steps(100)
    assert it.drive.unlock(it.now)


def test_without_a_limit_for_efforts_or_replaced_in_its_step_no_command_is_sudden(bench):
    none, some = {"effort": [0.0] * 6}, {"effort": [20.0] * 6}
    torque = {"policy": SUDDENLY, "control": "torque"}
    for it, before, sudden, after in (
        (bench(), at(HOME), at(beside(0.05)), at(beside(0.05))),
        (bench(**torque), none, some, some),
        (bench(policy=SUDDENLY), at(HOME), at(beside(0.05)), at(HOME)),  # replaced
    ):
        it.steps(20, lambda now=before: now)
        it.send(**sudden)
        it.steps(1, lambda now=after: now)
        assert it.status == (DriveMode.OBEYING, DriveCause.NONE)


def test_after_silence_the_first_command_is_judged_from_where_the_arm_is(bench):
    it = bench(policy=SUDDENLY)
    it.steps(20, lambda: at(HOME))
    it.steps(200)
    assert it.status == (DriveMode.BRAKED, DriveCause.SILENCE)
    it.steps(1, lambda: at(beside(2 * LIMIT * BRIDGED**2)))
    assert it.status == (DriveMode.STOPPING, DriveCause.ACCELERATION)


@pytest.mark.parametrize("values", [(1.0, 2.0), (1.0,) * 7])
def test_a_limit_for_the_wrong_number_of_joints_is_refused(bench, values):
    with pytest.raises(ConfigurationError, match="max_joint_acceleration must be empty, one"):
        bench(policy={"max_joint_acceleration": values})


@pytest.mark.parametrize("control", ["position", "torque"])
def test_in_silence_it_can_hold_the_last_command_for_ever(bench, control):
    it = bench(policy={"on_silence": OnSilence.HOLD_LAST, "command_timeout": 0.01},
               control=control, gravity=(0.0, 0.0, 0.0), servo_bandwidth=5.0)  # fmt: skip
    it.send(**(at(beside(0.2)) if control == "position" else {"effort": [10.0, *[0.0] * 5]}))
    it.steps(60)
    before = it.q
    it.steps(300)
    assert it.status == (DriveMode.OBEYING, DriveCause.NONE)
    assert abs(it.q[0] - before[0]) > 0.05


# --- its servo, its sensors, its motors ------------------------------------------------------
@pytest.mark.parametrize("lag", [0.02, 0.05])
def test_the_servo_lags_behind_positions_by_a_first_order(bench, lag):
    it = bench(servo_lag=lag, servo_bandwidth=1000.0, gravity=(0.0, 0.0, 0.0))
    it.steps(round(lag / DT), lambda: at(beside(0.01)))
    assert it.q[0] - HOME[0] == pytest.approx(0.01 * (1 - np.exp(-1)), rel=MOTORS)
    it.steps(600, lambda: at(beside(0.01)))
    start, speed = it.now, 0.1

    def ramp():
        return {"position": beside(0.01 + speed * (it.now + DT - start)), "velocity": [speed] * 6}

    it.steps(400, ramp)
    behind = ramp()["position"][0] - speed * DT - it.q[0]
    assert behind == pytest.approx(speed * (lag - 0.5 * DT), rel=MOTORS)


@pytest.mark.parametrize(("is_on", "expected"), [(True, -2.9), (False, 2 * np.pi - 2.9)])
def test_a_joint_that_turns_is_wrapped_and_goes_the_short_way(bench, is_on, expected):
    it = bench(TURNING, wrap_continuous=is_on, gravity=(0.0, 0.0, 0.0))
    it.steps(1500, lambda: at([*HOME[:5], min(3.0, 2.0 * it.now)]))
    it.steps(1000, lambda: at([*HOME[:5], expected]))
    assert it.q[5] == pytest.approx(expected, abs=1e-3)
    assert it.drive._simulator.motion[0][5] == pytest.approx(2 * np.pi - 2.9, abs=1e-3)


def test_what_is_wrapped_is_in_the_half_open_interval_and_a_limited_joint_is_not():
    q = np.array([-np.pi, np.pi, 3.2, -9.0, 3.2])
    expected = [np.pi, np.pi, 3.2 - 2 * np.pi, -9.0 + 2 * np.pi, 3.2]
    turning = np.array([True, True, True, True, False])
    np.testing.assert_allclose(wrapped(q, turning), expected, atol=1e-15)
    sim = Simulator(TURNING, SimulatorParameters(wrap_continuous=True))
    assert sim.turning.tolist() == [False] * 5 + [True]
    sim.close()


def test_a_driver_without_velocities_reports_none_and_the_robot_knows_them(bench):
    it = bench(velocities=False)
    it.steps(50, lambda: at(beside(0.1)))
    assert np.isnan(it.drive.state.dq).all()
    assert not it.drive.is_standing


def test_a_servo_reports_the_effort_that_its_rotors_take():
    found = []
    for rotors in ((0.0,), ROTORS):
        sim = Simulator(UR5, SimulatorParameters(rotor_inertia=rotors))
        for t in DT * np.arange(1, 50):
            sim.command_position(HOME + t**2, np.full(6, 2.0 * t))
            sim.step()
        found.append(sim.read().tau)
        sim.close()
    np.testing.assert_allclose(found[1] - found[0], 2.0 * np.array(ROTORS), rtol=0.01)


# --- in the node -----------------------------------------------------------------------------
def test_the_node_has_each_option_and_is_unlocked_by_its_service(world):
    options = {"velocities": False, "max_joint_acceleration": [LIMIT], "robot": "panda"}
    robot = load_robot("panda")
    states = world.peer.listen(JointState, "joint_states")
    commands = world.peer.publisher(JointState, "joint_reference")
    world.start("pybullet_bridge", {"mode": "lockstep", **options})
    world.until(lambda: states, "the robot")
    assert len(states[-1].velocity) == len(states[-1].name) > len(robot.joints)
    assert np.isnan(states[-1].velocity).all()
    q = np.array(robot.home)
    for step, goal in enumerate((q, q, q + 0.05, q, q)):
        if step == 4:
            answer = world.peer.trigger("/pybullet_bridge/unlock")
            assert answer.success, answer.message
        msg = JointState(name=list(robot.joints), position=goal.tolist())
        msg.header.stamp = Time(sec=0, nanosec=step * MS)
        commands.publish(msg)
        mode = values(world.peer.status("pybullet_bridge"))[MODE]
        assert mode == ("stopping" if step in (2, 3) else "obeying"), step
