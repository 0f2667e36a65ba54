"""Campaigns of random faults: the oracles see what they are for, and sequences repeat."""

import json
import math
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from ros_processes import HOME, MODEL, Process, environment
from test_experiments import nodes_of

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.lab.campaign import schedule
from eulerparams_control.lab.campaign.draws import (
    MOTIONS,
)
from eulerparams_control.lab.campaign.main import main
from eulerparams_control.lab.campaign.operator import BEGINNING, User
from eulerparams_control.lab.campaign.oracles import Oracle, judge
from eulerparams_control.lab.campaign.outcome import STARVED, SequenceOutcome, look
from eulerparams_control.lab.campaign.plan import (
    CONTROLLERS,
    LOCKSTEP,
    REALTIME,
    faults_of,
    make_plan,
    shaken,
)
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
from eulerparams_control.lab.campaign.schedule import plans, plans_of_both, run
from eulerparams_control.lab.faults import Fault

RATE = 250.0
MAX_EFFORT_RATE = 1e4
STATE_TIMEOUT = 0.1
END = 3.0

# The clock of the robot of these records is so far [s] ahead of their own.
AHEAD = 100.0

ZERO = (0.0,) * 6
AT_HOME = tuple(HOME.tolist())
WEIGHT = tuple(MODEL.dynamic_state(HOME, np.zeros(6)).g.tolist())

# A sequence whose controller is killed, so that a start, a death and a restart repeat, too.
KILLED_SEED = {
    name: next(seed for seed in range(1000) if "kill" in {f.name for f in faults_of(make_plan(
        seed, name))})
    for name in CONTROLLERS
}  # fmt: skip


def calm(control: str) -> SequenceRecord:
    """Return what is seen of an arm that a controller holds at home, as well as can be."""
    record = SequenceRecord(MODEL, MAX_EFFORT_RATE, STATE_TIMEOUT, 1 / RATE, quiet=1.0, end=END)
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


# What is planted, and which oracle, and only it, finds it.
PLANTS: dict[str, tuple[str, Callable[[SequenceRecord], None], str]] = {}


def plant(control: str, oracle: str) -> Callable[[Any], Any]:
    def keep(function: Callable[[SequenceRecord], None]) -> Callable[[SequenceRecord], None]:
        PLANTS[function.__name__] = control, function, oracle
        return function

    return keep


def put(messages: list[Any], number: int, **values: Any) -> None:
    """Change a message of a list."""
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


@plant("position", "survives")
def an_internal_error(record: SequenceRecord) -> None:
    record.said.insert(1, Said(0.5, OK, "KeyError: 1", Mode.STOPPED, Cause.DEFECT))


@plant("position", "limits")
def a_position_beyond_its_limit(record: SequenceRecord) -> None:
    q = changed(AT_HOME, 2, float(MODEL.limits.upper[2]) + 0.001 - AT_HOME[2])
    for k in range(at(1.0), len(record.commands)):
        put(record.commands, k, q=q)
    silence(record, 0.5, 1.0)  # it is no jump then, but no calm start
    put(record.states, at(0.5) + 1, q=q)


@plant("torque", "limits")
def an_effort_beyond_its_limit(record: SequenceRecord) -> None:
    for k in range(len(record.commands)):  # it comes up slowly, and stays
        put(record.commands, k, effort=changed(WEIGHT, 5, min(0.5 * k, 28.001 - WEIGHT[5])))


@plant("torque", "no jump")
def an_effort_that_jumps_within_a_burst(record: SequenceRecord) -> None:
    jump = changed(WEIGHT, 0, 1.5 * MAX_EFFORT_RATE / RATE)
    put(record.commands, at(1.0) + 1, t=1.0, effort=jump)


@plant("torque", "silent")
def a_command_without_a_state(record: SequenceRecord) -> None:
    record.states[:] = [s for s in record.states if not 1.0 < s.t < 1.0 + STATE_TIMEOUT + 0.05]


@plant("position", "silent")
def a_command_to_states_that_cannot_be_read(record: SequenceRecord) -> None:
    for k in range(at(1.0), at(1.2)):
        put(record.states, k, q=(), dq=())


@plant("torque", "calm start")
def an_effort_that_does_not_bear_the_arm_after_a_restart(record: SequenceRecord) -> None:
    record.events += [SequenceEvent(1.0, KILLED), SequenceEvent(1.0, STARTS)]
    for k in range(at(1.0), len(record.commands)):
        put(record.commands, k, life=2)
    put(record.commands, at(1.0), effort=changed(WEIGHT, 1, 2.0))


@plant("torque", "says so")
def a_silence_of_which_nothing_is_said(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.32, says=False)


@plant("torque", "held still")
def an_arm_that_moves_while_it_is_held(record: SequenceRecord) -> None:
    hold(record)
    put(record.truth, at(1.7), dq=(0.021, *ZERO[1:]))


@plant("torque", "held still")
def an_arm_that_sinks_while_it_is_held(record: SequenceRecord) -> None:
    hold(record)
    for k in range(at(1.5), at(2.0)):
        put(record.truth, k, q=changed(AT_HOME, 1, 0.03 * (k / RATE - 1.5)))


@plant("torque", "held still")
def an_arm_that_moves_while_its_states_are_away(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.3)
    record.shaken = [(1.0, 1.3)]  # it is a fault that takes them away
    put(record.truth, at(1.27), dq=(0.021, *ZERO[1:]))


@plant("torque", "no runaway")
def an_arm_that_runs_away(record: SequenceRecord) -> None:
    put(record.truth, at(1.7), dq=changed(ZERO, 4, -2.001 * float(MODEL.limits.velocity[4])))


@plant("torque", "recovers")
def a_controller_that_is_not_well_at_the_end(record: SequenceRecord) -> None:
    record.said.append(Said(END - 0.1, ERROR, "a fault", Mode.STOPPED))


@pytest.mark.parametrize("name", PLANTS)
def test_what_is_planted_is_found_by_its_oracle_and_by_no_other(name):
    control, spoil, oracle = PLANTS[name]
    record = calm(control)
    spoil(record)
    assert found(record) == {oracle}


ASKED = AskedLimits(0.25, 1.0, 1.0, 4.0, 20.0, 80.0, (10.0,))


def swing(
    record: SequenceRecord,
    peak: float,
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


@plant("position", "smooth joints")
def a_joint_that_is_asked_for_too_much_acceleration(record: SequenceRecord) -> None:
    swing(record, 1.0, asked=AskedLimits(joint_acceleration=(0.9,)))


@plant("position", "smooth joints")
def a_first_command_beside_the_arm(record: SequenceRecord) -> None:
    record.asked = AskedLimits(joint_acceleration=(10.0,))
    silence(record, 1.0, 1.4)
    for k in range(at(1.0) + 1, len(record.states)):
        off = changed(AT_HOME, 0, 0.02)
        record.commands[k] = record.commands[k]._replace(q=off)
        record.states[k] = record.states[k]._replace(q=off)


@plant("position", "smooth tip")
def a_tip_that_is_asked_for_too_much_speed(record: SequenceRecord) -> None:
    swing(record, 1.0, asked=replace(ASKED, angular_speed=0.3))  # 0.33 rad/s


@plant("position", "smooth tip")
def a_tip_that_is_asked_for_too_much_acceleration(record: SequenceRecord) -> None:
    swing(record, 1.0, asked=replace(ASKED, angular_acceleration=0.9))


@plant("position", "smooth tip")
def a_tip_that_is_asked_for_too_much_jerk(record: SequenceRecord) -> None:
    asked = AskedLimits(angular_speed=1.0, angular_acceleration=4.0, angular_jerk=80.0)
    swing(record, 3.0, asked=asked, omega=6.0, since=1.0)  # from 0 to 3 rad/s^2 in a period


def sway(record: SequenceRecord, asked: AskedLimits) -> None:
    """Let the arm swing with its first joint: 1 rad/s^2 at 3 rad/s."""
    record.asked = asked
    for k, truth in enumerate(record.truth):
        q = changed(AT_HOME, 0, (1 - math.cos(3.0 * truth.t)) / 9.0)
        record.truth[k] = truth._replace(q=q)


@plant("torque", "smooth arm")
def an_arm_that_is_too_fast(record: SequenceRecord) -> None:
    sway(record, replace(ASKED, angular_speed=0.29))  # 0.33 rad/s


@plant("torque", "smooth arm")
def an_arm_that_accelerates_too_much(record: SequenceRecord) -> None:
    sway(record, replace(ASKED, angular_acceleration=0.7))


def test_an_arm_that_is_shaken_may_be_fast() -> None:
    record = calm("torque")
    sway(record, replace(ASKED, angular_speed=0.29))
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


# What a command at 1 s may be, and which oracle finds it.
COMMANDS: list[tuple[str, str, dict[str, Any]]] = [
    ("position", "finite", {"dq": changed(ZERO, 2, math.nan)}),
    ("position", "finite", {"q": AT_HOME[:5]}),
    ("position", "finite", {"names": MODEL.joints[::-1]}),
    ("torque", "finite", {"effort": changed(WEIGHT, 2, math.inf)}),
    ("position", "limits", {"dq": changed(ZERO, 1, 1.001 * MODEL.limits.velocity[1])}),
    ("position", "no jump", {"q": changed(AT_HOME, 0, 1.001 * MODEL.limits.velocity[0] / RATE)}),
    ("torque", "no jump", {"effort": changed(WEIGHT, 0, 1.001 * MAX_EFFORT_RATE / RATE)}),
]


@pytest.mark.parametrize(("control", "oracle", "values"), COMMANDS)
def test_a_command_that_must_not_be_is_found_by_its_oracle_and_by_no_other(control, oracle, values):
    record = calm(control)
    put(record.commands, at(1.0), **values)
    assert found(record) == {oracle}


@pytest.mark.parametrize(
    ("control", "values"),
    [
        ("position", {"q": changed(AT_HOME, 3, 1e-5)}),
        ("position", {"dq": (1e-5,) * 6}),
        ("torque", {"effort": changed(WEIGHT, 1, 2.0)}),
        ("torque", {"stamp": AHEAD + 1.401}),  # of no state
    ],
)
def test_a_first_command_after_a_gap_that_is_not_calm_is_found(control, values):
    record = calm(control)
    silence(record, 1.0, 1.4)
    put(record.commands, at(1.0) + 1, **values)
    assert found(record) == {"calm start"}


@pytest.mark.parametrize(
    ("field", "value", "oracle"),
    [
        ("crash", "ValueError", "survives"),
        ("tip_error", (0.0051, 0.0), "recovers"),
        ("tip_error", (0.0, 1.01), "recovers"),
        ("tip_error", (math.nan, 0.0), "recovers"),
    ],
)
def test_an_end_that_must_not_be_is_found_by_its_oracle_and_by_no_other(field, value, oracle):
    record = calm("torque")
    setattr(record, field, value)
    assert found(record) == {oracle}


def test_each_oracle_has_something_planted_for_it():
    planted = {oracle for _, _, oracle in PLANTS.values()}
    assert planted | {oracle for _, oracle, _ in COMMANDS} == set(Oracle.registry)


def test_what_is_allowed_is_not_found():
    """A repeated command counts from its first; after a gap, and while it is shaken, all is new."""
    record = calm("position")
    step = 2.5 * float(MODEL.limits.velocity[0]) / RATE
    for k in (1, 2):  # states that repeat, then a step for all their time
        record.commands[at(1.0) + k] = record.commands[at(1.0)]._replace(t=1.0 + k / RATE)
    for k in range(at(1.0) + 3, len(record.commands)):
        put(record.commands, k, q=changed(AT_HOME, 0, step))
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
    todo = plans_of_both(300, 0)
    assert {plan.controller for plan in todo} == set(CONTROLLERS)
    assert {plan.motion for plan in todo} == set(MOTIONS)
    assert {fault.name for plan in todo for fault in faults_of(plan)} == set(Fault.registry)
    assert sum(plan.mode == REALTIME for plan in todo) == 45
    assert len({(plan.mode, plan.controller, plan.seed) for plan in todo}) == 300


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


@pytest.mark.slow
def test_a_sequence_in_real_time_has_commands_states_and_a_story():
    outcome = run(make_plan(KILLED_SEED["clik"], "clik", REALTIME))
    assert not outcome.error
    assert not outcome.violations, [str(v) for v in outcome.violations]
    assert outcome.commands > 0
    assert any(KILLED in line for line in outcome.story)
    assert sum(STARTS in line for line in outcome.story) == 2


# --- the executable --------------------------------------------------------------------


def outcome_of(plan: Any, **values: Any) -> SequenceOutcome:
    """Return what comes of a sequence in which all is well, but for some values."""
    record = calm(plan.control)
    for name, value in values.items():
        setattr(record, name, value)
    return look(plan, record, 1.0)


def bad(plan: Any, starved: float = 0.0) -> SequenceOutcome:
    return outcome_of(plan, tip_error=(1.0, 90.0), starved=starved)


def dies(plan: Any) -> SequenceOutcome:
    if plan.seed == 1:
        os._exit(1)
    return outcome_of(plan)


@pytest.fixture
def instead(monkeypatch):
    """Runs something else for each sequence, here."""

    def replace_run(function: Callable[[Any], SequenceOutcome]) -> None:
        monkeypatch.setattr(
            "eulerparams_control.lab.campaign.main.run_all",
            lambda todo, _jobs: map(function, reversed(todo)),
        )

    return replace_run


def test_a_campaign_without_violations_ends_with_0_and_writes_page_and_summary(
    instead, tmp_path, capsys
):
    instead(outcome_of)
    assert main(["--sequences", "6", "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["met"]
    assert [(s["controller"], s["seed"], s["mode"]) for s in summary["sequences"]] == [
        *((name, 0, LOCKSTEP) for name in CONTROLLERS),
        *((name, 1, LOCKSTEP) for name in CONTROLLERS[:2]),
        (CONTROLLERS[0], 0, REALTIME),
    ]
    page = (tmp_path / "index.html").read_text()
    assert "6 random fault sequences" in page
    assert "prefers-color-scheme: dark" in page
    assert "<script" not in page
    assert "0 violations in 0 sequences" in capsys.readouterr().out


def test_a_violation_ends_with_1_and_says_how_to_repeat_it(instead, tmp_path, capsys):
    instead(bad)
    assert main(["--seed", "17", "--controller", "clik", "--out", str(tmp_path)]) == 1
    command = "fault_campaign --mode lockstep --controller clik --seed 17 --sequences 1"
    out = " ".join(capsys.readouterr().out.split())
    assert command in out
    assert "the tip ends 1000.0 mm, 90.0 deg away" in out
    assert command in (tmp_path / "index.html").read_text()
    (sequence,) = json.loads((tmp_path / "summary.json").read_text())["sequences"]
    assert sequence["violations"][0]["oracle"] == "recovers"


def test_what_needs_real_time_is_not_judged_where_the_machine_starved():
    plan = make_plan(0, "clik", REALTIME)
    outcome = bad(plan, starved=2 * STARVED)
    assert not outcome.violations
    assert [violation.oracle for violation in outcome.unjudged] == ["recovers"]
    outcome = outcome_of(plan, starved=2 * STARVED, crash="ended")
    assert [violation.oracle for violation in outcome.violations] == ["survives"]


def test_a_sequence_that_starved_is_run_again_by_itself(monkeypatch):
    plan, runs = make_plan(0, "clik", REALTIME), []

    def pool(todo: Any, jobs: int, _lost: Any) -> Any:
        runs.append(jobs)
        return [bad(plan, 2 * STARVED) if len(runs) < 3 else outcome_of(plan) for plan in todo]

    monkeypatch.setattr(schedule, "_in_pool", pool)
    (outcome,) = schedule.run_all([plan], 2)
    assert outcome.is_good
    assert not outcome.unjudged
    assert runs == [1, 1, 1]


def test_a_sequence_that_takes_its_worker_with_it_is_an_error_and_the_others_go_on(monkeypatch):
    # what is submitted is pickled by its name, and a worker imports it from here
    monkeypatch.setattr(schedule, "run", dies)
    outcomes = list(schedule.run_all(plans(3, 0, ("clik",)), 1))
    by_seed = {outcome.plan.seed: outcome for outcome in outcomes}
    assert sorted(by_seed) == [0, 1, 2]
    assert by_seed[0].is_good
    assert by_seed[2].is_good
    assert "its worker died" in by_seed[1].error


@pytest.mark.slow
def test_a_campaign_that_is_told_to_end_ends_its_workers_and_their_nodes(tmp_path, graph):
    command = [sys.executable, "-m", "eulerparams_control.lab.campaign.main", "--mode", REALTIME]
    env = environment(tmp_path, graph.domain) | {"TMPDIR": str(tmp_path)}
    campaign = Process([*command, "--out", str(tmp_path / "out")], tmp_path, "campaign", env)
    graph.processes.append(campaign)
    nodes = tmp_path / "faults_"
    graph.until(lambda: nodes_of(nodes), "nodes of a sequence")
    campaign.signal(signal.SIGTERM)
    assert campaign.end() == 130, campaign.log
    graph.until(lambda: not nodes_of(nodes), "the end of the nodes")
    assert not list(tmp_path.glob("faults_*"))


def test_a_worker_that_is_told_to_end_twice_at_once_is_told_once(monkeypatch):
    told = []

    class Twice:
        def set(self):  # of an event: a signal within it that sets it again waits for ever
            told.append(len(told))
            if len(told) < 3:
                signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(schedule, "_stop", Twice())
    monkeypatch.setattr(schedule, "_has_nodes", True)
    before = signal.signal(signal.SIGTERM, schedule._end)
    try:
        signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert told == [0]


def test_a_sequence_that_cannot_be_run_ends_with_2(instead, tmp_path):
    instead(lambda plan: replace(outcome_of(plan), error="no simulator"))
    assert main(["--seed", "1", "--out", str(tmp_path)]) == 2


@pytest.mark.parametrize("given", [["--sequences", "0"], ["--seed", "-1"], ["--jobs", "x"]])
def test_wrong_options_are_refused(given, capsys):
    with pytest.raises(SystemExit):
        main(given)
    assert "expected" in capsys.readouterr().err
