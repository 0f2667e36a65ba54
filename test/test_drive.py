"""The policy of the simulated robot, in simulated time: it obeys, brakes, stops, refuses."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState
from tolerances import assert_close

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.events import ExitCode
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros.senders import UNNUMBERED, Senders
from sim_bridge import drive as driving
from sim_bridge.command_source import StampOrder
from sim_bridge.commands import push_from_ros
from sim_bridge.drive_words import ERROR, OK, WARN, DriveWords
from sim_bridge.pacing import STANDS_STILL, LockStep, Tally, WallClock
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.simulator import Simulator, SimulatorState

UR5 = load_robot("ur5")
HOME = np.array(UR5.home)
NAMES = list(UR5.joints)
REST = {"position": HOME.tolist(), "velocity": [0.0] * 6}
FLOATING = {"control": "torque", "gravity": (0.0, 0.0, 0.0)}
RACING = {"effort": [100.0, *[0.0] * 5]}
MS = 1_000_000  # ns
# A braked joint is slower [rad/s]; brakes leave 1e-7.
STANDS = 1e-3
# A braked arm stays where it is [rad]: what brakes leave, for some seconds.
STAYS = 1e-6
# The servo is this close to a goal that it has reached [rad].
REACHED = 1e-3
# A force that is felt or not [N]: the brakes leave 1e-3.
FELT = 0.1

Cause, Policy, Reply = driving.DriveCause, driving.DrivePolicy, driving.DriveReply
PATIENT = Policy()
MODES = (STANDBY, OBEYING, BRAKED, STOPPING, CONTESTED, ENDED) = tuple(driving.DriveMode)


def message(stamp: int = 0, **fields: Any) -> JointState:
    msg = JointState(**{"name": NAMES, **fields})
    msg.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
    return msg


def at(q: Any) -> dict[str, Any]:
    """Return a command to go to q (n,) [rad]."""
    return {"position": np.array(q).tolist(), "velocity": [0.0] * 6}


class Bench:
    """A drive, its clock, what it said, and the numbers of a controller's messages."""

    def __init__(self, policy: Policy = PATIENT, robot: Any = UR5, **parameters: Any) -> None:
        given = SimulatorParameters(**{"rate": 100.0, "servo_bandwidth": 50.0, **parameters})
        self.dt, self.now = 1.0 / given.rate, 0.0
        self.publishers: list[str] = []
        self.said: list[driving.DriveStatus] = []
        simulator = Simulator(robot, given)
        self.drive = driving.Drive(simulator, policy, self.said.append, lambda: self.publishers)
        self.words = DriveWords("ready", self.drive.topic, policy.command_timeout)
        self.numbers = itertools.count(1)

    @property
    def state(self) -> SimulatorState:
        return self.drive.state

    @property
    def mode(self) -> driving.DriveMode:
        return self.drive.status.mode

    @property
    def message(self) -> str:
        return self.words.describe(self.drive.status)[1]

    @property
    def level(self) -> bytes:
        return self.words.describe(self.drive.status)[0]

    @property
    def remedy(self) -> str:
        return self.words.describe(self.drive.status)[2]

    def send(self, stamp: int = 0, number: int | None = None, **fields: Any) -> Reply:
        number = next(self.numbers) if number is None else number
        return self.drive.command(message(stamp, **fields), number, self.now)

    def step(self, duration: float = 0.0, each: Callable[[], Any] = lambda: None) -> None:
        """Go on for some time [s], one step at least; call ``each`` before each."""
        for _ in range(max(1, round(duration / self.dt))):
            each()
            self.drive.step(self.now)
            self.now += self.dt

    def review(self) -> None:
        self.drive.review(self.now)

    def go(self, q: Any) -> None:
        """Command to go to q (n,) [rad] until the arm is there."""
        self.step(1.0, lambda: self.send(**at(q)))
        assert np.abs(self.state.q - q).max() < REACHED

    def count(self, name: str) -> int:
        return int(self.drive.values[name])

    def close(self) -> None:
        self.drive.close()


@pytest.fixture
def bench(closing: Any) -> Callable[..., Bench]:
    return lambda *args, **parameters: closing(Bench(*args, **parameters))


# --- the table of modes ----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("mode", "after"),
    [  # after command, silence, violation, standstill, contest, settled, end
        (STANDBY, (OBEYING, STANDBY, STOPPING, STANDBY, CONTESTED, STANDBY, ENDED)),
        (OBEYING, (OBEYING, BRAKED, STOPPING, OBEYING, CONTESTED, OBEYING, ENDED)),
        (BRAKED, (OBEYING, BRAKED, STOPPING, BRAKED, CONTESTED, BRAKED, ENDED)),
        (STOPPING, (STOPPING, STOPPING, STOPPING, BRAKED, STOPPING, STOPPING, ENDED)),
        (CONTESTED, (CONTESTED, CONTESTED, STOPPING, CONTESTED, CONTESTED, BRAKED, ENDED)),
        (ENDED, (ENDED,) * 7),
    ],
)
def test_each_event_leads_from_each_mode_to_the_one_of_the_table(mode, after):
    assert (
        tuple(driving.TRANSITIONS[mode].get(event, mode) for event in driving.DriveEvent) == after
    )
    assert driving.TRANSITIONS.keys() == set(driving.DriveMode)


@pytest.mark.parametrize("mode", MODES)
def test_there_are_words_for_each_mode_whatever_the_cause(mode):
    words = DriveWords("ready", "joint_effort", 0.1)
    for cause in Cause:
        level, message, _ = words.describe(driving.DriveStatus(mode, cause, names=("/a", "/b")))
        assert level in (OK, WARN, ERROR)
        assert message


# --- wrong commands --------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("control", "fields", "words"),  # the others: test_messages
    [
        ("position", {"name": NAMES[:5], "position": [0.0] * 5}, "lacks wrist_3_joint"),
        ("position", {"position": [np.inf, *[0.0] * 5]}, "a non-finite position"),
        ("position", {"effort": [1.0] * 6}, "efforts only, but the robot is in position control"),
        ("torque", {"position": [0.0] * 6}, "positions only, but the robot is in torque control"),
        ("torque", {"effort": [1e300, *[0.0] * 5]}, "a too large effort"),
    ],
)
def test_a_command_that_cannot_be_used_is_rejected_and_moves_nothing(bench, control, fields, words):
    robot = bench(control=control)
    q = robot.state.q
    assert robot.send(**fields) is Reply.REJECTED
    assert robot.count(driving.REJECTED) == 1
    assert words in robot.drive.values["last command rejected"]
    assert words in str(robot.drive.rejection)
    robot.step(0.5)
    assert robot.mode is STANDBY
    assert_close(robot.state.q, q, STAYS)


def test_a_robot_that_waits_says_why_it_rejects_commands_and_what_to_do(bench):
    robot = bench()
    robot.step(0.5)
    robot.send(position=[np.nan] * 6)
    robot.review()
    assert "; commands are rejected: joint_reference has a non-finite" in robot.message
    assert robot.message.startswith("ready")
    assert (robot.level, robot.mode, robot.drive.status.cause) == (WARN, STANDBY, "rejected")
    assert robot.remedy
    assert robot.drive.values["braked for [s]"] == pytest.approx(0.5)
    robot.send(**REST)
    robot.step(0.5)
    robot.send(position=[np.nan] * 6)
    robot.review()
    assert robot.drive.status.cause is Cause.SILENCE
    assert "braked; commands are rejected: joint_reference" in robot.message
    assert (robot.level, robot.drive.rejection is None) == (ERROR, False)
    robot.send(**REST)
    robot.review()
    assert (robot.level, robot.message) == (OK, "commanded")
    assert (robot.drive.values["braked for [s]"], robot.drive.rejection) == (0.0, None)


# --- silence, delay --------------------------------------------------------------------------
def test_a_robot_brakes_when_it_has_had_no_command_for_longer_than_its_timeout(bench):
    robot = bench(rate=1000.0)
    away = HOME + 1.0
    robot.step(0.2, lambda: robot.send(**at(away)))
    assert np.abs(robot.state.dq).max() > 0.1
    last = robot.now - robot.dt
    robot.step(0.099)
    assert (robot.mode, robot.message) == (OBEYING, "commanded")
    robot.step(3 * robot.dt)
    assert (robot.mode, robot.drive.status.cause) == (BRAKED, Cause.SILENCE)
    assert robot.drive.status.since == pytest.approx(last + 0.1, abs=1.1 * robot.dt)
    assert (robot.level, robot.message) == (ERROR, "no command for 0.1 s: braked")
    assert "the next command is taken" in robot.remedy
    robot.step(0.5)
    assert np.abs(robot.state.dq).max() < STANDS
    assert np.abs(robot.state.q - away).max() > 0.1
    robot.go(away)
    assert robot.mode is OBEYING


def test_a_command_acts_after_its_delay_and_not_at_all_after_brakes_or_a_reset(bench):
    robot = bench(Policy(command_delay=3))
    away = at(HOME + 0.1)
    for _ in range(3):
        robot.send(**away)
        robot.step()
        assert np.abs(robot.state.dq).max() < STANDS
    robot.step(0.5)
    assert robot.mode is BRAKED
    robot.send(**REST)  # those of before are forgotten
    robot.step(0.5)
    assert np.abs(robot.state.q - HOME).max() < STAYS
    robot.step(0.5, lambda: robot.send(**away))
    assert np.abs(robot.state.q - HOME - 0.1).max() < REACHED
    assert robot.drive.reset(HOME, robot.now).step == 0  # and a reset forgets its controller
    assert (robot.mode, robot.drive.status.since) == (STANDBY, robot.now)
    assert_close(robot.state.q, HOME, STAYS)
    assert robot.send(number=1, **REST) is Reply.TAKEN


# --- clipped commands ------------------------------------------------------------------------
def test_the_warning_of_clipping_lasts_as_long_as_the_clipping_whatever_else_is_commanded(bench):
    robot = bench()

    def clip(case: int) -> None:
        robot.send(**{**REST, "velocity": [0.0] * case + [4.0] + [0.0] * (5 - case)})

    for case in range(3):
        clip(case)
    assert [each.clipped for each in robot.said] == ["", robot.drive.status.clipped]
    assert NAMES[0] in robot.drive.status.clipped
    assert (robot.level, robot.mode, robot.drive.status.cause) == (WARN, OBEYING, "clipped")
    assert robot.remedy
    robot.review()
    assert NAMES[2] in robot.drive.values["last command clipped"]
    clip(3)
    robot.send(**REST)
    robot.review()
    assert len(robot.said) == 2
    robot.review()  # nothing was clipped since the last one
    assert (len(robot.said), robot.message, robot.level) == (3, "commanded", OK)
    clip(4)
    assert (len(robot.said), robot.level, robot.count(driving.CLIPPED)) == (4, WARN, 5)
    assert NAMES[4] in robot.message
    robot.step(0.5)
    assert (robot.mode, robot.count(driving.CLIPPED)) == (BRAKED, 5)
    clip(0)
    assert [each.mode for each in robot.said[-2:]] == [OBEYING, OBEYING]
    assert (robot.drive.status.cause, robot.count(driving.CLIPPED)) == (Cause.CLIPPED, 6)


# --- the order of commands -------------------------------------------------------------------
def test_an_older_command_does_not_take_the_place_of_a_newer_one(bench):
    robot = bench(Policy())
    away, strayed = at(HOME + 0.2), []

    def both() -> None:
        newer = 10**9 + round(robot.now * 1e9)
        assert robot.send(newer, **REST) is Reply.TAKEN
        assert robot.send(newer - 10 * MS, **away) is Reply.REFUSED
        strayed.append(np.abs(robot.state.q - HOME).max())

    robot.step(0.5, both)
    assert max(strayed) < REACHED
    assert robot.count(driving.LATE) == 50


def test_only_stamps_that_stay_older_for_longer_than_the_patience_are_taken():
    order = StampOrder(0.1)
    assert not order.is_late(100, 0.0)
    assert not order.is_late(100, 0.01)  # the last word of a controller
    assert order.is_late(99, 0.02)
    assert not order.is_late(101, 0.03)
    assert order.is_late(99, 0.2)  # a straggler long after is still one
    assert not order.is_late(0, 0.25)
    assert order.is_late(50, 0.3)
    assert not order.is_late(51, 0.31)  # 0.11 s after the first of them
    assert not order.is_late(52, 0.32)
    assert order.is_late(51, 0.33)


def test_a_clock_that_goes_back_does_not_brake_the_robot(bench):
    robot = bench(Policy())
    for start in (9, 1):
        robot.step(0.2, lambda s=start: robot.send(s * 10**9 + round(robot.now * 1e9), **REST))
    assert {said.mode for said in robot.said[1:]} <= {driving.DriveMode.OBEYING}
    assert 0 < robot.count(driving.LATE) < 5


# --- two controllers -------------------------------------------------------------------------
def test_two_controllers_that_send_are_both_refused_and_named_until_one_is_silent(bench):
    robot = bench()
    robot.publishers = ["/first"]
    robot.step(1.0, lambda: robot.send(**REST))
    robot.publishers = ["/first", "/second", "/second"]
    second = itertools.count(1)

    def both() -> None:
        robot.send(**REST)
        robot.send(number=next(second), **at(HOME + 0.5))

    robot.step(0.1, both)
    assert (robot.level, robot.mode, robot.drive.status.cause) == (ERROR, CONTESTED, "contested")
    assert "whose publishers are /first, /second 2 times; " in robot.message
    assert robot.remedy
    robot.step(0.2, both)
    assert np.abs(robot.state.dq).max() < STANDS
    q, refused = robot.state.q, robot.count(driving.OTHER)
    robot.step(1.0, both)
    assert robot.count(driving.OTHER) == refused + 200
    assert_close(robot.state.q, q, STAYS)
    robot.publishers = ["/first", "/second"]
    robot.review()
    assert "publishers are /first, /second; braked" in robot.message
    robot.step(6.0, lambda: robot.send(number=next(second), **at(HOME + 0.5)))
    assert [each.cause for each in robot.said[-2:]] == [Cause.CONTEST_OVER, Cause.NONE]
    assert robot.words.describe(robot.said[-2])[0] == WARN
    assert np.abs(robot.state.q - HOME - 0.5).max() < REACHED


@pytest.mark.parametrize("name", ["/first", "/other"])
def test_the_successor_of_a_dead_controller_is_obeyed_while_the_graph_still_shows_both(bench, name):
    robot = bench()
    robot.publishers = ["/first", name]
    robot.step(0.5, lambda: robot.send(**REST))
    robot.step(0.5)
    assert robot.mode is BRAKED
    robot.review()
    robot.numbers = itertools.count(1)
    robot.go(HOME + 0.2)
    robot.review()
    assert (robot.mode, robot.count(driving.OTHER)) == (OBEYING, 0)
    assert all(each.mode is not CONTESTED for each in robot.said)


def hear(senders: Senders, *numbers: int, since: float = 0.0) -> list[bool]:
    return [senders.hear(number, since + 0.001 * k) for k, number in enumerate(numbers)]


def both(first: int, second: int, count: int = 5) -> list[int]:
    """Return the numbers of two that send in turn after the first has sent alone."""
    alone = list(range(first - 5, first))
    return alone + [n + k for k in range(count) for n in (first, second)]


@pytest.mark.parametrize("second", [1, 450, 490, 499, 500, 501, 503, 590, 5000])
@pytest.mark.parametrize("at_once", [False, True])
def test_two_that_send_in_turn_are_told_from_each_other_whatever_their_numbers(second, at_once):
    senders = Senders(0.1, 5.0, at_once=at_once)
    accepted = hear(senders, *both(500, second))
    assert senders.contested
    assert not any(accepted[5 + 4 :])  # within two commands of the second
    assert not any(hear(senders, 505, second + 5, 506, second + 6, since=0.02))
    assert all(accepted[:5])


@pytest.mark.parametrize(
    ("heard", "contested"),  # since when, which numbers, and whether they are accepted
    [
        ([(0, (10, 11, 12), True), (0.01, (1, 2, 3), False), (0.103, (4, 5, 6), True)], False),
        ([(0, (1, 2, 3, 10, 11, 60, 61, 160), True)], False),
        ([(0, range(1, 31), True), (1, (*range(1, 21), 45, 46, 47), True)], False),
        (  # they take turns: both are there
            [(0, (100, 101), True), (1, (1, 2), True), (2, (102, 103), True), (3, (3, 4), False)],
            True,
        ),
    ],
    ids=[
        *("the second before the first is silent", "lost messages", "what a successor loses"),
        "switched to another and back once",
    ],
)
def test_who_is_heeded_goes_by_the_numbers_of_the_messages(heard, contested):
    senders = Senders(0.1, 5.0, at_once=False)
    for since, numbers, accepted in heard:
        assert set(hear(senders, *numbers, since=since)) == {accepted}
    assert senders.contested == contested


def test_the_contest_ends_with_the_silence_of_one_or_when_the_graph_shows_one():
    senders = Senders(0.1, 5.0, at_once=False)
    hear(senders, *both(500, 1))
    assert not any(hear(senders, 505, 506, since=4.9))
    assert all(hear(senders, 507, 508, since=5.1))
    hear(senders, *both(600, 100), since=6.0)
    senders.see(["/a", "/b"])
    assert senders.contested
    senders.see(["/a"])
    assert not senders.contested
    assert all(hear(senders, 700, 701, since=6.1))
    plain = Senders(0.1, 5.0, at_once=False)  # without numbers two names are two controllers
    assert all(hear(plain, UNNUMBERED, UNNUMBERED))
    for names, accepted in ((["/a", "/a"], True), (["/a", "/b"], False), (["/a"], True)):
        plain.see(names)
        assert hear(plain, UNNUMBERED, UNNUMBERED) == 2 * [accepted]
        plain.review(100.0)
        assert plain.contested is not accepted


# --- the protective stop ---------------------------------------------------------------------
def test_a_joint_that_is_too_fast_makes_the_robot_stop_and_take_commands_again_when_it_stands(
    bench,
):
    robot = bench(rate=1000.0, protective_speed=1.5, **FLOATING)
    fastest = 0.0

    def race() -> None:
        nonlocal fastest
        robot.send(**RACING)
        fastest = max(fastest, abs(robot.state.dq[0]))

    while robot.mode is not STOPPING:
        robot.step(0.0, race)
    assert (robot.level, bool(robot.remedy)) == (ERROR, True)
    assert "'shoulder_pan_joint'" in robot.drive.status.violation
    assert robot.send(**RACING) is Reply.REFUSED
    assert (robot.count(driving.STOPS), robot.count(driving.IN_STOP)) == (1, 1)
    assert 1.5 * 3.15 < abs(robot.state.dq[0]) < 2.0 * 3.15
    assert fastest < 1.5 * 3.15
    while robot.mode is STOPPING:
        robot.step()
    assert np.abs(robot.state.dq).max() < STANDS
    robot.step(0.5)
    robot.review()
    assert (robot.mode, robot.drive.status.cause) == (BRAKED, Cause.PROTECTIVE_STOP)
    assert (robot.level, bool(robot.remedy)) == (ERROR, True)  # until a command
    assert robot.send(effort=[0.0] * 6) is Reply.TAKEN
    assert (robot.level, robot.message) == (OK, "commanded")


@pytest.mark.parametrize("control", ["position", "torque"])
def test_a_push_that_is_stronger_than_the_robot_stops_it_and_the_next_command_is_taken(
    bench, control
):
    robot = bench(Policy(push_timeout=0.2), rate=200.0, control=control)
    command = {"effort": [0.0] * 6} if control == "torque" else REST
    robot.step(0.1, lambda: robot.send(**command))
    robot.drive.push([1e5, 0.0, 0.0, 0.0, 0.0, 0.0], robot.now)
    robot.step()
    assert "which no brakes could stop: locked where it was, and the push released" in robot.message
    assert (robot.level, "a push" in robot.remedy, robot.count(driving.STOPS)) == (ERROR, True, 1)
    robot.step(0.5)
    assert robot.send(**command) is Reply.TAKEN
    assert (robot.level, robot.message) == (OK, "commanded")
    assert driving.PUSHES_OVER not in robot.drive.values


# --- pushes ----------------------------------------------------------------------------------
def push(force: float) -> WrenchStamped:
    msg = WrenchStamped()
    msg.header.frame_id = "tool0"
    msg.wrench.force.x = force
    return msg


def test_a_push_that_is_impossible_is_refused():
    assert push_from_ros(push(1.0), "tool0").tolist() == [1.0, 0, 0, 0, 0, 0]
    for force, words in ((-1e6, "impossible"), (1e300, "too large")):
        with pytest.raises(InvalidMessageError, match=words):
            push_from_ros(push(force), "tool0")


def test_a_push_ends_once_after_its_timeout_and_a_new_one_starts_the_time_anew(bench):
    robot = bench(Policy(push_timeout=0.5))
    wrench, felt = [10.0, 0.0, 0.0, 0.0, 0.0, 0.0], []

    def note() -> None:
        felt.append(abs(robot.state.wrench[0] - 10.0) < FELT)

    robot.drive.push(wrench, 0.0)
    robot.step(0.4, note)
    robot.drive.push(wrench, robot.now)
    robot.step(0.8, note)
    assert felt.index(True) == 1
    assert sum(felt) == 90
    assert robot.count(driving.PUSHES_OVER) == 1
    forever = bench()
    forever.drive.push(wrench, 0.0)
    forever.step(2.0)
    assert abs(forever.state.wrench[0] - 10.0) < FELT


# --- when it steps ---------------------------------------------------------------------------
class Paced:
    """A drive that is stepped by a pacing, whose clock goes on when the test says so."""

    def __init__(self, robot: Bench, kind: Any, duration: float = 0.0, **options: Any) -> None:
        self.robot, self.clock = robot, 100.0
        self.stamps: list[int] = []
        self.forces: dict[int, float] = {}
        rate = 1.0 / robot.dt
        given = robot.drive, self.publish, rate, duration, lambda: self.clock
        self.pacing = kind(*given, **options)

    def publish(self, state: SimulatorState, stamp: int) -> None:
        self.stamps.append(stamp)
        self.forces[stamp] = state.wrench[0]

    def answer(self, stamp: int | None = None, number: int | None = None, **fields: Any) -> Any:
        number = next(self.robot.numbers) if number is None else number
        stamp = self.stamps[-1] if stamp is None else stamp
        return self.pacing.command(message(stamp, **(fields or REST)), number)

    def turn(self, seconds: float) -> int:
        self.clock += seconds
        return int(self.pacing.turn())


@pytest.fixture
def lockstep(bench: Any) -> Callable[..., Paced]:
    """Return what makes a robot in lock-step at 1 kHz."""

    def make(duration: float = 0.0, watched: Any = lambda: True, **parameters: Any) -> Paced:
        policy = Policy(push_timeout=0.02, changes_at_once=True)
        robot = bench(policy, rate=1000.0, **parameters)
        return Paced(robot, LockStep, duration, timeout=1.0, is_watched=watched)

    return make


def test_in_lockstep_the_first_state_is_repeated_until_all_are_there_and_it_is_answered(lockstep):
    there = False
    paced = lockstep(watched=lambda: there)
    for _ in range(3):
        paced.turn(0.05)
    assert paced.stamps == [0, 0, 0]
    assert paced.answer() is Reply.UNASKED  # not all are there
    there = True
    paced.turn(0.05)
    assert paced.answer(5 * MS) is Reply.UNASKED
    assert paced.answer() is Reply.TAKEN
    assert paced.answer(0) is Reply.UNASKED  # it has been answered
    paced.turn(0.05)
    assert paced.stamps == [0, 0, 0, 0, MS]


def test_in_lockstep_the_duration_ends_the_run_when_its_last_state_is_answered(lockstep):
    paced = lockstep(duration=0.01)
    paced.turn(0.05)
    while not paced.pacing.done:
        assert paced.answer() is Reply.TAKEN
    assert paced.stamps == [k * MS for k in range(11)]
    assert (paced.pacing.error, paced.robot.message) == (None, "ended")
    assert (paced.robot.mode, paced.robot.drive.status.cause) == (ENDED, Cause.FINISHED)


def test_a_rejected_command_in_lockstep_stalls_until_the_timeout_which_tells_of_it(lockstep):
    paced = lockstep()
    paced.turn(0.05)
    for _ in range(5):
        paced.answer()
    assert paced.answer(position=[np.nan] * 6) is Reply.REJECTED
    paced.turn(1.0)
    assert not paced.pacing.done
    paced.turn(0.1)
    error = paced.pacing.error
    assert paced.pacing.done
    assert error.exit_code == ExitCode.STALLED
    assert "rejected: joint_reference has a non-finite position" in str(error)
    assert paced.stamps[-1] == 5 * MS
    assert (paced.robot.drive.status.cause, paced.robot.message) == ("stalled", str(error))


def test_in_lockstep_time_goes_on_while_two_controllers_are_refused_and_in_a_stop(lockstep):
    paced = lockstep(protective_speed=1.5, **FLOATING)
    robot = paced.robot
    paced.turn(0.05)
    second = itertools.count(5000)
    while robot.mode is not STOPPING:
        paced.answer(**RACING)
    stamp = paced.stamps[-1]
    while robot.mode is STOPPING:
        assert paced.answer(**RACING) is Reply.REFUSED
    assert paced.stamps[-1] > stamp
    for _ in range(10):
        paced.answer(number=next(second), effort=[0.0] * 6)
        paced.answer(effort=[0.0] * 6)
    assert robot.mode is CONTESTED
    stamp = paced.stamps[-1]
    assert paced.answer(effort=[0.0] * 6) is Reply.REFUSED
    assert paced.stamps[-1] == stamp + MS
    assert np.abs(robot.state.dq).max() < STANDS


def test_in_lockstep_a_push_ends_at_its_stamp_and_the_timeout(lockstep):
    paced = lockstep()
    paced.turn(0.05)
    paced.clock += 1e3  # which does not count

    def pushed(at_step: int, stamp: int) -> set[int]:
        while paced.stamps[-1] < at_step * MS:
            paced.answer()
        paced.pacing.push([10.0, 0.0, 0.0, 0.0, 0.0, 0.0], stamp)
        while paced.stamps[-1] < (at_step + 50) * MS:
            paced.answer()
        felt = (s for s, force in paced.forces.items() if abs(force - 10.0) < FELT)
        return {s // MS for s in felt if s > at_step * MS}

    assert pushed(10, 10 * MS) == set(range(11, 31))
    assert pushed(70, 60 * MS) == set(range(71, 81))  # that of a message from before
    assert pushed(130, 0) == set(range(131, 151))
    assert pushed(190, 10**12) == set(range(191, 211))  # of the future


def test_the_wall_clock_makes_the_steps_that_are_due_and_gives_up_those_beyond_catching_up(bench):
    paced = Paced(bench(), WallClock)
    assert [paced.turn(0.0), paced.turn(0.0301), paced.turn(0.0)] == [0, 0, 0]
    assert paced.stamps == [10 * MS, 20 * MS, 30 * MS]
    assert paced.turn(2.0) == 200
    assert paced.robot.count(driving.GIVEN_UP) == 199
    assert paced.stamps[-1] == 2030 * MS  # no state is older than it says
    assert paced.turn(0.5) == 0
    assert paced.stamps[-50:] == [(2040 + 10 * k) * MS for k in range(50)]


def test_time_stands_still_for_old_commands_which_is_reported_and_not_for_one_without_stamp(bench):
    policy = Policy(command_timeout=60.0)
    paced = Paced(bench(policy), WallClock, max_command_age=0.05)
    paced.turn(0.1)
    paced.answer()
    paced.turn(0.5)  # stops when the command is too old
    still = paced.stamps[-1]
    for k in range(5):  # those that come answer what is long ago
        assert paced.answer(still - (59 - k) * MS) is Reply.TAKEN
        paced.turn(0.4)
    assert paced.stamps[-1] == still
    paced.pacing.review()
    assert paced.robot.drive.values[STANDS_STILL] >= 1.0
    paced.answer(0)
    paced.turn(0.02)
    paced.turn(0.02)
    assert paced.stamps[-1] > still
    paced.pacing.review()
    assert paced.robot.drive.values[STANDS_STILL] == 0.0


def test_a_robot_in_real_time_ends_after_its_duration_and_brakes_when_it_is_told_to_end(bench):
    paced = Paced(bench(), WallClock, 0.5)
    paced.turn(0.3)
    assert not paced.pacing.done
    paced.turn(0.3001)
    assert paced.pacing.done
    assert paced.stamps[-1] == 500 * MS
    assert paced.pacing.brake()
    # slow enough to be on the way for seconds, and nothing else brakes it
    paced = Paced(bench(Policy(command_timeout=60.0), servo_bandwidth=0.5), WallClock)
    paced.answer(0, **at(HOME + 1.0))
    paced.turn(0.2001)
    assert np.abs(paced.robot.state.dq).max() > 0.2
    assert not paced.pacing.brake()
    assert (paced.robot.level, paced.robot.message) == (OK, "ending: braked")
    assert paced.answer(0, **at(HOME + 1.0)) is Reply.REFUSED
    for _ in range(10):
        paced.turn(0.01)
    assert paced.pacing.brake()
    assert (paced.robot.mode, paced.robot.drive.status.cause) == (ENDED, Cause.SHUTDOWN)


def test_the_report_of_a_second_has_its_rate_gap_age_and_real_time_factor():
    tally = Tally(10.0)
    for k in range(1, 11):
        tally.take(10.0 + 0.05 * k, 3 * MS if k == 4 else -MS)
    report = tally.report(12.0, 1.0)
    assert report == pytest.approx(
        {
            "commands per second": 5.0,
            "worst gap between commands [ms]": 1500.0,
            "worst command age [ms]": 3.0,
            "real-time factor": 0.5,
        }
    )
    tally.take(12.02, 0)
    report = tally.report(12.5, 1.5)
    assert report["worst gap between commands [ms]"] == pytest.approx(1520.0)
    assert report["commands per second"] == pytest.approx(2.0)
    assert report["worst command age [ms]"] == 0.0
    assert report["real-time factor"] == pytest.approx(1.0)
