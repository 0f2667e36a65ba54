"""Campaigns of random faults: the oracles see what they are for, and sequences repeat."""

import json
import math
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from ros_processes import HOME, MODEL, Process, environment
from test_experiments import nodes_of
from worker_ends import dies

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.lab.campaign import plan as draws
from eulerparams_control.lab.campaign import schedule
from eulerparams_control.lab.campaign.main import main
from eulerparams_control.lab.campaign.oracles import Oracle, judge
from eulerparams_control.lab.campaign.plan import CONTROLLERS, SMOOTH, faults_of, make_plan, shaken
from eulerparams_control.lab.campaign.record import (
    ERROR,
    KILLED,
    OK,
    STARTS,
    AskedLimits,
    Command,
    Said,
    SequenceEvent,
    SequenceRecord,
    State,
    Truth,
)
from eulerparams_control.lab.campaign.report import SequenceOutcome, look
from eulerparams_control.lab.campaign.schedule import plans
from eulerparams_control.lab.campaign.user import BEGINNING, Sent, Stream, User
from eulerparams_control.lab.faults.base import Fault
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.trajectories import Trajectory

RATE = 250.0
MAX_EFFORT_RATE = 1e4
STATE_TIMEOUT = 0.1
END = 3.0
# The clock of the robot is ahead of the clock of these records [s].
AHEAD = 100.0

ZERO = (0.0,) * 6
AT_HOME = tuple(HOME.tolist())
STEP = float(MODEL.limits.velocity[0]) / RATE  # [rad] between two commands
WEIGHT = tuple(MODEL.dynamic_state(HOME, np.zeros(6)).g.tolist())
# A sequence whose controller is killed, so that a start, a death and a restart repeat, too.
KILLED_SEED = {
    name: next(seed for seed in range(1000) if "kill" in {f.name for f in faults_of(make_plan(
        seed, name))})
    for name in CONTROLLERS
}  # fmt: skip


def calm(control: str) -> SequenceRecord:
    """Return what is seen of an arm that a controller holds at home, as well as can be."""
    record = SequenceRecord(MODEL, MAX_EFFORT_RATE, STATE_TIMEOUT, 1 / RATE, END)
    record.events.append(SequenceEvent(0.0, STARTS))
    record.said += [Said(0.0, OK, "active"), Said(1.0, OK, "active")]
    holding = {"effort": WEIGHT} if control == "torque" else {"q": AT_HOME, "dq": ZERO}
    for k in range(round(END * RATE) + 1):
        t = k / RATE
        record.truth.append(Truth(t, AT_HOME, ZERO))
        record.states.append(State(t, AHEAD + t, AT_HOME, ZERO))
        record.commands.append(Command(t, 1, AHEAD + t, MODEL.joints, **holding))
    return record


def at(t: float) -> int:
    """Return the number of the message at t [s]."""
    return round(t * RATE)


def changed(values: tuple[float, ...], joint: int, by: float) -> tuple[float, ...]:
    return tuple(v + by * (i == joint) for i, v in enumerate(values))


def found(record: SequenceRecord) -> set[str]:
    """Return the names of the oracles that find something."""
    return {violation.oracle for violation in judge(record)}


@pytest.mark.parametrize("control", ["position", "torque"])
def test_nothing_is_found_where_nothing_is_wrong(control):
    assert judge(calm(control)) == []


type Spoil = Callable[[SequenceRecord], None]


def put(messages: list[Any], number: int, **values: Any) -> None:
    messages[number] = messages[number]._replace(**values)


def silence(record: SequenceRecord, start: float, end: float, *, says: bool = True) -> None:
    """Take states and commands away; the controller says so, unless it does not."""
    for messages in (record.states, record.commands):
        messages[:] = [m for m in messages if not start < m.t < end]
    if says:
        record.said.append(Said(start + STATE_TIMEOUT, ERROR, "no valid joint_states"))
        record.said.append(Said(end, OK, "active"))
        record.said.sort(key=lambda said: said.t)


def hold(record: SequenceRecord) -> None:
    """Let the controller say that it holds the arm, from 1 s to 2 s."""
    record.said[1:] = [Said(1.0, ERROR, "a fault", Mode.STOPPED), Said(2.0, OK, "active")]


ASKED = AskedLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0, (10.0,))


def swing(
    record: SequenceRecord,
    peak: float = 1.0,
    *,
    asked: AskedLimits = ASKED,
    omega: float = 3.0,
    since: float = 0.0,
) -> None:
    """Let the first joint swing from rest at a time: peak [rad/s^2] at omega [rad/s]."""
    record.asked = asked
    for k, command in enumerate(record.commands):
        t = max(0.0, k / RATE - since)
        q = changed(AT_HOME, 0, peak / omega**2 * (1 - math.cos(omega * t)))
        dq = changed(ZERO, 0, peak / omega * math.sin(omega * t))
        record.commands[k] = command._replace(q=q, dq=dq)


def sway(record: SequenceRecord, **asked: float) -> None:
    """Let the arm swing with its first joint: 1 rad/s^2 at 3 rad/s."""
    record.asked = replace(ASKED, **asked)
    for k, truth in enumerate(record.truth):
        q = changed(AT_HOME, 0, (1 - math.cos(3.0 * truth.t)) / 9.0)
        record.truth[k] = truth._replace(q=q)


def commanding(**values: Any) -> Spoil:
    """A command at 1 s is another."""
    return lambda record: put(record.commands, at(1.0), **values)


def beginning(**values: Any) -> Spoil:
    """The first command after a gap is another."""

    def spoil(record: SequenceRecord) -> None:
        silence(record, 1.0, 1.4)
        put(record.commands, at(1.0) + 1, **values)

    return spoil


def ending(**values: Any) -> Spoil:
    return lambda record: vars(record).update(values)


def saying(number: int, *said: Any) -> Spoil:
    return lambda record: record.said.insert(number, Said(*said))


def a_position_beyond_its_limit(record: SequenceRecord) -> None:
    q = changed(AT_HOME, 2, float(MODEL.limits.upper[2]) + 0.001 - AT_HOME[2])
    for k in range(at(1.0), len(record.commands)):
        put(record.commands, k, q=q)
    silence(record, 0.5, 1.0)  # it is no jump then, but no calm start
    put(record.states, at(0.5) + 1, q=q)


def an_effort_beyond_its_limit(record: SequenceRecord) -> None:
    for k in range(len(record.commands)):  # it comes up slowly, and stays
        put(record.commands, k, effort=changed(WEIGHT, 5, min(0.5 * k, 28.001 - WEIGHT[5])))


def an_effort_that_jumps_within_a_burst(record: SequenceRecord) -> None:
    jump = changed(WEIGHT, 0, 1.5 * MAX_EFFORT_RATE / RATE)
    put(record.commands, at(1.0) + 1, t=1.0, effort=jump)


def a_command_without_a_state(record: SequenceRecord) -> None:
    record.states[:] = [s for s in record.states if not 1.0 < s.t < 1.0 + STATE_TIMEOUT + 0.05]


def a_command_to_states_that_cannot_be_read(record: SequenceRecord) -> None:
    for k in range(at(1.0), at(1.2)):
        put(record.states, k, q=(), dq=())


def an_effort_that_does_not_bear_the_arm_after_a_restart(record: SequenceRecord) -> None:
    record.events += [SequenceEvent(1.0, KILLED), SequenceEvent(1.0, STARTS)]
    for k in range(at(1.0), len(record.commands)):
        put(record.commands, k, life=2)
    put(record.commands, at(1.0), effort=changed(WEIGHT, 1, 2.0))


def an_arm_that_moves_while_it_is_held(record: SequenceRecord) -> None:
    hold(record)
    put(record.truth, at(1.7), dq=(0.021, *ZERO[1:]))


def an_arm_that_sinks_while_it_is_held(record: SequenceRecord) -> None:
    hold(record)
    for k in range(at(1.5), at(2.0)):
        put(record.truth, k, q=changed(AT_HOME, 1, 0.03 * (k / RATE - 1.5)))


def an_arm_that_moves_while_its_states_are_away(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.3)
    record.shaken = [(1.0, 1.3)]  # it is a fault that takes them away
    put(record.truth, at(1.27), dq=(0.021, *ZERO[1:]))


def an_arm_that_runs_away(record: SequenceRecord) -> None:
    put(record.truth, at(1.7), dq=changed(ZERO, 4, -2.001 * float(MODEL.limits.velocity[4])))


def an_arm_without_a_speed(record: SequenceRecord) -> None:
    put(record.truth, at(1.7), dq=changed(ZERO, 4, math.nan))


def a_first_command_beside_the_arm(record: SequenceRecord) -> None:
    record.asked = AskedLimits(joint_acceleration=(10.0,))
    silence(record, 1.0, 1.4)
    for k in range(at(1.0) + 1, len(record.states)):
        off = changed(AT_HOME, 0, 0.02)
        record.commands[k] = record.commands[k]._replace(q=off)
        record.states[k] = record.states[k]._replace(q=off)


SLOW = AskedLimits(joint_acceleration=(0.9,))
JERK = AskedLimits(angular_speed=1.0, angular_acceleration=4.0, angular_jerk=80.0)

# What is planted, and which oracle, and only it, finds it.
PLANTS: list[tuple[str, str, Spoil]] = [
    ("position", "survives", saying(1, 0.5, OK, "KeyError: 1", Mode.STOPPED, Cause.DEFECT)),
    ("torque", "survives", ending(crash="ValueError")),
    ("position", "finite", commanding(dq=changed(ZERO, 2, math.nan))),
    ("position", "finite", commanding(q=AT_HOME[:5])),
    ("position", "finite", commanding(names=MODEL.joints[::-1])),
    ("torque", "finite", commanding(effort=changed(WEIGHT, 2, math.inf))),
    ("position", "limits", a_position_beyond_its_limit),
    ("position", "limits", commanding(dq=changed(ZERO, 1, 1.001 * MODEL.limits.velocity[1]))),
    ("torque", "limits", an_effort_beyond_its_limit),
    ("position", "no jump", commanding(q=changed(AT_HOME, 0, 1.001 * STEP))),
    ("torque", "no jump", commanding(effort=changed(WEIGHT, 0, 1.001 * MAX_EFFORT_RATE / RATE))),
    ("torque", "no jump", an_effort_that_jumps_within_a_burst),
    ("torque", "silent", a_command_without_a_state),
    ("position", "silent", a_command_to_states_that_cannot_be_read),
    ("torque", "calm start", an_effort_that_does_not_bear_the_arm_after_a_restart),
    ("position", "calm start", beginning(q=changed(AT_HOME, 3, 1e-5))),
    ("position", "calm start", beginning(dq=(1e-5,) * 6)),
    ("torque", "calm start", beginning(effort=changed(WEIGHT, 1, 2.0))),
    ("torque", "calm start", beginning(stamp=AHEAD + 1.401)),  # of no state
    ("torque", "says so", partial(silence, start=1.0, end=1.32, says=False)),
    ("torque", "held still", an_arm_that_moves_while_it_is_held),
    ("torque", "held still", an_arm_that_sinks_while_it_is_held),
    ("torque", "held still", an_arm_that_moves_while_its_states_are_away),
    ("torque", "no runaway", an_arm_that_runs_away),
    ("torque", "no runaway", an_arm_without_a_speed),
    ("torque", "recovers", saying(2, END - 0.1, ERROR, "a fault", Mode.STOPPED)),
    ("torque", "recovers", ending(tip_error=(0.0051, 0.0))),
    ("torque", "recovers", ending(tip_error=(0.0, 1.01))),
    ("torque", "recovers", ending(tip_error=(math.nan, 0.0))),
    ("position", "smooth joints", partial(swing, asked=SLOW)),
    ("position", "smooth joints", a_first_command_beside_the_arm),
    ("position", "smooth tip", partial(swing, asked=replace(ASKED, angular_speed=0.3))),  # 0.33
    ("position", "smooth tip", partial(swing, asked=replace(ASKED, angular_acceleration=0.9))),
    ("position", "smooth tip", partial(swing, peak=3.0, asked=JERK, omega=6.0, since=1.0)),
    ("torque", "smooth arm", partial(sway, angular_speed=0.29)),  # of 0.33 rad/s
    ("torque", "smooth arm", partial(sway, angular_acceleration=0.7)),
]


@pytest.mark.parametrize(("control", "oracle", "spoil"), PLANTS)
def test_what_is_planted_is_found_by_its_oracle_and_by_no_other(control, oracle, spoil):
    record = calm(control)
    spoil(record)
    assert found(record) == {oracle}


def test_each_oracle_has_something_planted_for_it():
    assert {oracle for _, oracle, _ in PLANTS} == set(Oracle.registry)


def test_an_arm_that_is_shaken_may_be_fast() -> None:
    record = calm("torque")
    sway(record, angular_speed=0.29)
    record.shaken = [(0.0, END)]
    assert judge(record) == []


def test_a_smooth_motion_is_smooth_whatever_is_missed_and_where_it_is_not_judged() -> None:
    record = calm("position")
    swing(record, 1.0)
    missed = {*range(3, len(record.commands), 7), *range(300, 304)}
    record.commands = [c for k, c in enumerate(record.commands) if k not in missed]
    assert judge(record) == []
    swing(record, 5.0)
    record.asked = None
    assert judge(record) == []


def test_what_is_allowed_is_not_found():
    """A repeated command counts from its first; after a gap, and while it is shaken, all is new."""
    record = calm("position")
    for k in (1, 2):  # states that repeat, then a step for all their time
        record.commands[at(1.0) + k] = record.commands[at(1.0)]._replace(t=1.0 + k / RATE)
    for k in range(at(1.0) + 3, len(record.commands)):
        put(record.commands, k, q=changed(AT_HOME, 0, 2.5 * STEP))
    assert judge(record) == []
    hold(record)
    put(record.truth, at(1.7), dq=(0.5, *ZERO[1:]))
    record.shaken = [(1.6, 1.8)]
    assert judge(record) == []


def test_the_hash_of_a_record_knows_each_bit_of_each_command():
    one, other = calm("torque"), calm("torque")
    assert one.digest() == other.digest()
    put(other.commands, at(1.0), effort=(np.nextafter(WEIGHT[0], np.inf), *WEIGHT[1:]))
    assert one.digest() != other.digest()


# --- sequences -------------------------------------------------------------------------
def test_a_seed_makes_the_same_plan_and_another_seed_another():
    one, again, other = (make_plan(seed, "impedance_control") for seed in (3, 3, 4))
    home = MODEL.state(HOME, np.zeros(6))
    pose = home.p_e, home.R_e
    assert one == again
    assert faults_of(one) == faults_of(again) != faults_of(other)
    np.testing.assert_array_equal(one.last_pose(pose)[0], again.last_pose(pose)[0])
    assert not np.allclose(one.last_pose(pose)[0], other.last_pose(pose)[0])


def test_a_campaign_has_all_controllers_motions_and_kinds_of_faults():
    todo = plans(300, 0)
    assert {plan.controller for plan in todo} == set(CONTROLLERS)
    assert {plan.motion for plan in todo} == set(draws.MOTIONS)
    assert {fault.name for plan in todo for fault in faults_of(plan)} == set(Fault.registry)
    assert len({(plan.controller, plan.seed) for plan in todo}) == 300


def test_the_user_waits_for_the_last_fault_before_the_arm_is_sent_again():
    for plan in plans(60, 0):
        faults = faults_of(plan)
        user = User(plan, MODEL, faults, HOME)
        quiet = BEGINNING + max(fault.end for fault in faults)
        times = [k / RATE for k in range(round(user.end * RATE))]
        sent = [t for t in times for each in user.motions(t, HOME) if each.note]
        assert user.quiet >= quiet
        assert sent[-1] > quiet
        assert all(end <= quiet for _, end in shaken(faults, BEGINNING))


def repeated(plan: Any) -> SequenceRecord:
    """Return what is seen of a sequence in lock-step, which is the same to the bit twice."""
    from eulerparams_control.lab.campaign.ros.lockstep import run_lockstep

    one, again = (run_lockstep(plan, schedule._domain().number) for _ in range(2))
    assert one.digest() == again.digest()
    assert one.truth == again.truth
    assert one.said == again.said
    return one


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_sequence_in_lock_step_holds_what_it_must_and_repeats_to_the_bit(controller):
    found = repeated(make_plan(KILLED_SEED[controller], controller))
    assert judge(found) == []
    assert len(found.commands) > 500
    assert {command.life for command in found.commands} == {1, 2}


# --- the executable --------------------------------------------------------------------
def outcome_of(plan: Any, **values: Any) -> SequenceOutcome:
    """Return what comes of a sequence in which all is well, but for some values."""
    record = calm(plan.control)
    for name, value in values.items():
        setattr(record, name, value)
    return look(plan, record, 1.0)


@pytest.fixture
def instead(monkeypatch):
    """Runs something else for each sequence, here."""

    def replace_run(function: Callable[[Any], SequenceOutcome]) -> None:
        monkeypatch.setattr(
            "eulerparams_control.lab.campaign.main.run_all",
            lambda todo, _jobs: map(function, reversed(todo)),
        )

    return replace_run


def test_a_campaign_without_violations_ends_with_0_a_page_and_a_summary(instead, tmp_path, capsys):
    instead(outcome_of)
    assert main(["--sequences", "8", "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["met"]
    assert [(s["controller"], s["seed"]) for s in summary["sequences"]] == [
        (name, seed) for seed in (0, 1) for name in CONTROLLERS
    ]
    page = (tmp_path / "index.html").read_text()
    assert "8 random fault sequences" in page
    assert "prefers-color-scheme: dark" in page
    assert "<script" not in page
    assert "0 violations in 0 sequences" in capsys.readouterr().out


def test_a_violation_ends_with_1_and_says_how_to_repeat_it(instead, tmp_path, capsys):
    instead(lambda plan: outcome_of(plan, tip_error=(1.0, 90.0)))
    assert main(["--seed", "17", "--controller", "clik", "--out", str(tmp_path)]) == 1
    command = "fault_campaign --controller clik --seed 17 --sequences 1"
    out = " ".join(capsys.readouterr().out.split())
    assert command in out
    assert "the tip ends 1000.0 mm, 90.0 deg away" in out
    assert command in (tmp_path / "index.html").read_text()
    (sequence,) = json.loads((tmp_path / "summary.json").read_text())["sequences"]
    assert sequence["violations"][0]["oracle"] == "recovers"


def test_a_sequence_that_fails_or_ends_its_worker_is_an_error_and_the_others_go_on(monkeypatch):
    # what is submitted is pickled by its name, and a worker imports it from there
    monkeypatch.setattr(schedule, "run", dies)
    outcomes = list(schedule.run_all(plans(4, 0, ("clik",)), 1))
    by_seed = {outcome.plan.seed: outcome for outcome in outcomes}
    assert [by_seed[seed].is_good for seed in range(4)] == [True, False, False, True]
    assert "its worker died" in by_seed[1].error
    assert by_seed[2].error == "ValueError('its own words')"


def test_an_error_of_an_oracle_is_that_of_its_sequence(monkeypatch):
    def lockstep(plan: Any, _domain: int) -> SequenceRecord:
        return calm(plan.control)

    def judge_badly(*_: object) -> None:
        raise ZeroDivisionError("in an oracle")

    monkeypatch.setattr("eulerparams_control.lab.campaign.ros.lockstep.run_lockstep", lockstep)
    monkeypatch.setattr(schedule, "look", judge_badly)
    assert schedule.run(*plans(1, 0, ("clik",))).error == "ZeroDivisionError('in an oracle')"


@pytest.mark.slow
def test_a_campaign_that_is_told_to_end_ends_its_workers(tmp_path, graph):
    command = [sys.executable, "-m", "eulerparams_control.lab.campaign.main"]
    env = environment(tmp_path, graph.domain) | {"TMPDIR": str(tmp_path)}
    campaign = Process([*command, "--out", str(tmp_path / "out")], tmp_path, "campaign", env)
    graph.processes.append(campaign)
    workers = partial(nodes_of, tmp_path, "environ")
    graph.until(lambda: len(workers()) > 2, "the workers of a campaign, beside itself and a helper")
    campaign.signal(signal.SIGTERM)
    assert campaign.end() == 130, campaign.log
    graph.until(lambda: not workers(), "the end of the workers")


def test_a_sequence_that_cannot_be_run_ends_with_2(instead, tmp_path):
    instead(lambda plan: replace(outcome_of(plan), error="no simulator"))
    least = ["--seed", "0", "--sequences", "1", "--jobs", "1"]
    assert main([*least, "--out", str(tmp_path)]) == 2


@pytest.mark.parametrize(("option", "least"), [("--sequences", 1), ("--seed", 0), ("--jobs", 1)])
def test_wrong_options_are_refused(option, least, capsys):
    for wrong in (str(least - 1), "1.5", "x", "", "nan"):
        with pytest.raises(SystemExit):
            main([option, wrong])
        expected = f"argument {option}: {wrong}; expected a whole number, {least} or more"
        assert expected in capsys.readouterr().err


# --- smooth motions --------------------------------------------------------------------------
HOME_X = float(MODEL.state(HOME, np.zeros(6)).p_e[0])


def test_smooth_sequences_have_robots_and_users_of_all_kinds_and_seeds_keep_their_old_ones():
    todo = plans(600, 0, kind=SMOOTH)
    robots = [plan.robot for plan in todo]
    assert {plan.motion for plan in todo} == set(draws.SMOOTH_MOTIONS)
    assert {robot.rate for robot in robots} == {20.0, 50.0, 125.0, 250.0, 500.0, 1000.0}
    for name in ("turns", "velocities", "on_silence"):
        assert len({getattr(robot, name) for robot in robots}) == 2, name
    for plan in todo:
        is_clik = plan.controller == "clik"
        assert is_clik or plan.robot.velocities
        assert is_clik or plan.robot.rate >= 250.0
        assert not is_clik or plan.parameters()["k_Pp"] <= 0.4 * plan.robot.rate
        old = make_plan(plan.seed, plan.controller)
        assert (old.robot, old.stream, old.asked) == (draws.RobotDraw(), draws.StreamDraw(), None)
        assert plan.asked is not None
    assert todo == plans(600, 0, kind=SMOOTH)


def sent(motion: str, draw: draws.StreamDraw, rate: float = 1000.0) -> list[tuple[float, Sent]]:
    """Return when [s] and what is sent of a motion along x at 0.1 m/s, in 2 s."""
    home = MODEL.state(HOME, np.zeros(6))
    p, R = home.p_e, home.R_e
    v = np.array([0.1, 0.0, 0.0])
    frames = [DesiredFrame(p + t * v, R, v) for t in (0.0, 1.0, 2.0)]
    line = Trajectory([0.0, 1.0, 2.0], frames)
    stream = Stream(draw, motion, line, 0.0, 1 / rate, np.random.default_rng(1))
    return [(k / rate, each) for k in range(round(2 * rate)) for each in stream.due(k / rate)]


@pytest.mark.parametrize(
    ("draw", "rate", "count", "spread"),
    [
        (draws.StreamDraw(50.0), 1000.0, 100, 1e-9),
        (draws.StreamDraw(200.0), 20.0, 1 + 39 * 10, 1e-9),  # all that came between two looks
        (draws.StreamDraw(20.0, jitter=0.2), 1000.0, 41, 0.2 / 20.0),  # the last one is early
    ],
)
def test_pieces_come_at_their_rate_with_their_jitter(draw, rate, count, spread):
    found = sent(draws.STREAM, draw, rate)
    assert len(found) == count
    early = [t - k / draw.rate for k, (t, _) in enumerate(found)] if rate == 1000.0 else [0.0]
    assert 0.5 * spread <= max(np.abs(early)) + 1e-9 <= 2.2 * spread + 2e-9 + 1e-3 * (spread > 1e-6)


def test_pieces_say_what_they_are_to_say():
    def line(each: Sent, t: float) -> float:
        return float(abs(each.motion.frames[0].p_d[0] - HOME_X - 0.1 * t))

    exact = sent(draws.STREAM, draws.StreamDraw(50.0, skew=0.02))
    assert all(line(each, t) < 1e-12 and each.stamp == t + 0.02 for t, each in exact)
    assert all(each.motion.frames[0].dp_d[0] == pytest.approx(0.1) for _, each in exact)
    blind = sent(draws.POSES, draws.StreamDraw(50.0, twists=False, noise=1e-3))
    off = [line(each, t) for t, each in blind]
    assert 0.3e-3 < np.std(off) < 3e-3
    assert all(not each.motion.frames[0].dp_d.any() for _, each in blind)
    assert {each.topic for _, each in blind} == {"target_pose"}
    chunks = sent(draws.CHUNKS, draws.StreamDraw(5.0, ahead=1.0))
    assert [each.motion.times for _, each in chunks] == [pytest.approx(np.arange(1, 11) / 10)] * 10
    t, each = chunks[3]
    assert each.motion.frames[4].p_d[0] == pytest.approx(HOME_X + 0.1 * (t + 0.5))
    goals = sent(draws.GOALS, draws.StreamDraw(10.0))
    assert {round(float(each.motion.frames[0].p_d[0] - HOME_X), 6) for _, each in goals} == {
        0.1, 0.2}  # fmt: skip
    twists = sent(draws.TWISTS, draws.StreamDraw(10.0, twists=False))
    assert {each.topic for _, each in twists} == {"target_twist"}
    assert all(each.motion.frames[0].dp_d[0] == pytest.approx(0.1) for _, each in twists)


def test_a_smooth_sequence_in_lock_step_repeats_to_the_bit():
    all_plans = (make_plan(seed, "clik", kind=SMOOTH) for seed in range(1000))
    plan = next(p for p in all_plans if p.robot.turns and p.robot.rate == 50.0 and faults_of(p))
    assert len(repeated(plan).commands) > 50
