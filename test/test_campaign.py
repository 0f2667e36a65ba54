"""Campaigns of random faults: the oracles see what they are for, and sequences repeat."""

import json
import math
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_processes import HOME, MODEL, Process, environment

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.lab.campaign import schedule
from eulerparams_control.lab.campaign.main import main
from eulerparams_control.lab.campaign.operator import BEGINNING, User
from eulerparams_control.lab.campaign.oracles import Oracle, judge
from eulerparams_control.lab.campaign.outcome import STARVED, SequenceOutcome, look
from eulerparams_control.lab.campaign.plan import (
    CONTROLLERS,
    LOCKSTEP,
    MOTIONS,
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
    for k in range(round(END * RATE) + 1):
        t = k / RATE
        record.truth.append(Truth(t, AT_HOME, ZERO))
        record.states.append(State(t, AHEAD + t, AT_HOME, ZERO))
        record.commands.append(command(t, control))
    return record


def command(t: float, control: str, **values: Any) -> Command:
    """Return what holds the arm at home."""
    holding: dict[str, Any] = {"q": AT_HOME, "dq": ZERO}
    if control == "torque":
        holding = {"effort": WEIGHT}
    return Command(t, 1, AHEAD + t, MODEL.joints, **(holding | values))


def at(t: float) -> int:
    """Return the number of the message at t [s]."""
    return round(t * RATE)


def changed(values: tuple[float, ...], joint: int, by: float) -> tuple[float, ...]:
    return tuple(v + by * (i == joint) for i, v in enumerate(values))


def found(record: SequenceRecord) -> dict[str, str]:
    """Return what the oracles find: texts by their names."""
    return {violation.oracle: violation.text for violation in judge(record)}


@pytest.mark.parametrize("control", ["position", "torque"])
def test_nothing_is_found_where_nothing_is_wrong(control):
    assert judge(calm(control)) == []


# What is planted, and which oracles, and only they, find it.
PLANTS: dict[str, tuple[str, Callable[[SequenceRecord], None], set[str]]] = {}


def plant(control: str, *oracles: str) -> Callable[[Any], Any]:
    def keep(function: Callable[[SequenceRecord], None]) -> Callable[[SequenceRecord], None]:
        PLANTS[function.__name__] = control, function, set(oracles)
        return function

    return keep


def put(record: SequenceRecord, t: float, **values: Any) -> None:
    """Change the command at t [s]."""
    record.commands[at(t)] = record.commands[at(t)]._replace(**values)


def silence(record: SequenceRecord, start: float, end: float, *, says: bool = True) -> None:
    """Take states and commands away; the controller says so, unless it does not."""
    for messages in (record.states, record.commands):
        messages[:] = [m for m in messages if not start < m.t < end]
    if says:
        record.said.append(Said(start + STATE_TIMEOUT, ERROR, "no valid joint_states"))
        record.said.append(Said(end, OK, "active"))
        record.said.sort(key=lambda said: said.t)


@plant("position", "survives")
def an_internal_error(record: SequenceRecord) -> None:
    record.said.insert(1, Said(0.5, OK, "KeyError: 1", Mode.STOPPED, Cause.DEFECT))


@plant("position", "limits")
def a_position_beyond_its_limit(record: SequenceRecord) -> None:
    q = changed(AT_HOME, 2, float(MODEL.limits.upper[2]) + 0.001 - AT_HOME[2])
    for k in range(at(1.0), len(record.commands)):
        record.commands[k] = record.commands[k]._replace(q=q)
    silence(record, 0.5, 1.0)  # it is no jump then, but no calm start
    record.states[at(0.5) + 1] = record.states[at(0.5) + 1]._replace(q=q)


@plant("torque", "limits")
def an_effort_beyond_its_limit(record: SequenceRecord) -> None:
    for k in range(len(record.commands)):  # it comes up slowly, and stays
        more = min(0.5 * k, 28.001 - WEIGHT[5])
        put(record, k / RATE, effort=changed(WEIGHT, 5, more))


@plant("torque", "no jump")
def an_effort_that_jumps_within_a_burst(record: SequenceRecord) -> None:
    jump = changed(WEIGHT, 0, 1.5 * MAX_EFFORT_RATE / RATE)
    late = record.commands[at(1.0) + 1]._replace(t=1.0, effort=jump)
    record.commands[at(1.0) + 1] = late


@plant("torque", "silent")
def a_command_without_a_state(record: SequenceRecord) -> None:
    record.states[:] = [s for s in record.states if not 1.0 < s.t < 1.0 + STATE_TIMEOUT + 0.05]


@plant("position", "silent")
def a_command_to_states_that_cannot_be_read(record: SequenceRecord) -> None:
    for k in range(at(1.0), at(1.2)):
        record.states[k] = record.states[k]._replace(q=(), dq=())


@plant("position", "calm start")
def a_position_beside_the_arm_after_a_gap(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.4)
    for k in range(at(1.0) + 1, len(record.commands)):
        q = changed(AT_HOME, 3, 1e-5)
        record.commands[k] = record.commands[k]._replace(q=q)


@plant("position", "calm start")
def a_speed_after_a_gap(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.4)
    record.commands[at(1.0) + 1] = record.commands[at(1.0) + 1]._replace(dq=(1e-5,) * 6)


@plant("torque", "calm start")
def an_effort_that_does_not_bear_the_arm_after_a_gap(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.4)
    first = record.commands[at(1.0) + 1]
    record.commands[at(1.0) + 1] = first._replace(effort=changed(WEIGHT, 1, 2.0))


@plant("torque", "calm start")
def an_effort_that_does_not_bear_the_arm_after_a_restart(record: SequenceRecord) -> None:
    record.events += [SequenceEvent(1.0, KILLED), SequenceEvent(1.0, STARTS)]
    for k in range(at(1.0), len(record.commands)):
        record.commands[k] = record.commands[k]._replace(life=2)
    put(record, 1.0, effort=changed(WEIGHT, 1, 2.0))


@plant("torque", "calm start")
def an_answer_to_no_state_after_a_gap(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.4)
    first = record.commands[at(1.0) + 1]
    record.commands[at(1.0) + 1] = first._replace(stamp=first.stamp + 1e-3)


@plant("torque", "says so")
def a_silence_of_which_nothing_is_said(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.32, says=False)


@plant("torque", "held still")
def an_arm_that_moves_while_it_is_held(record: SequenceRecord) -> None:
    record.said[1:] = [Said(1.0, ERROR, "a fault", Mode.STOPPED), Said(2.0, OK, "active")]
    record.truth[at(1.7)] = record.truth[at(1.7)]._replace(dq=(0.021, *ZERO[1:]))


@plant("torque", "held still")
def an_arm_that_sinks_while_it_is_held(record: SequenceRecord) -> None:
    record.said[1:] = [Said(1.0, ERROR, "a fault", Mode.STOPPED), Said(2.0, OK, "active")]
    for k in range(at(1.5), at(2.0)):
        sunk = changed(AT_HOME, 1, 0.03 * (k / RATE - 1.5))
        record.truth[k] = record.truth[k]._replace(q=sunk)


@plant("torque", "held still")
def an_arm_that_moves_while_its_states_are_away(record: SequenceRecord) -> None:
    silence(record, 1.0, 1.3)
    record.shaken = [(1.0, 1.3)]  # it is a fault that takes them away
    record.truth[at(1.27)] = record.truth[at(1.27)]._replace(dq=(0.021, *ZERO[1:]))


@plant("torque", "no runaway")
def an_arm_that_runs_away(record: SequenceRecord) -> None:
    speed = 2.001 * float(MODEL.limits.velocity[4])
    record.truth[at(1.7)] = record.truth[at(1.7)]._replace(dq=changed(ZERO, 4, -speed))


@plant("torque", "recovers")
def a_controller_that_is_not_well_at_the_end(record: SequenceRecord) -> None:
    record.said.append(Said(END - 0.1, ERROR, "a fault", Mode.STOPPED))


# What a command at 1 s may be, and which oracle finds it.
COMMANDS: list[tuple[str, str, dict[str, Any]]] = [
    ("position", "finite", {"dq": changed(ZERO, 2, math.nan)}),
    ("position", "finite", {"q": AT_HOME[:5]}),
    ("position", "finite", {"names": MODEL.joints[::-1]}),
    ("position", "limits", {"dq": changed(ZERO, 1, 1.001 * MODEL.limits.velocity[1])}),
    ("position", "no jump", {"q": changed(AT_HOME, 0, 1.001 * MODEL.limits.velocity[0] / RATE)}),
    ("torque", "no jump", {"effort": changed(WEIGHT, 0, 1.001 * MAX_EFFORT_RATE / RATE)}),
]


@pytest.mark.parametrize(("control", "oracle", "values"), COMMANDS)
def test_a_command_that_must_not_be_is_found_by_its_oracle_and_by_no_other(
    control, oracle, values
):
    record = calm(control)
    put(record, 1.0, **values)
    assert set(found(record)) == {oracle}


def test_an_infinite_effort_is_found():
    record = calm("torque")
    put(record, 1.0, effort=changed(WEIGHT, 2, math.inf))
    del record.commands[at(1.0) + 1 :]  # what comes after would be a jump
    record.end = 1.0
    assert set(found(record)) == {"finite"}


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
    assert set(found(record)) == {oracle}


@pytest.mark.parametrize("name", PLANTS)
def test_what_is_planted_is_found_by_its_oracle_and_by_no_other(name):
    control, spoil, oracles = PLANTS[name]
    record = calm(control)
    spoil(record)
    assert set(found(record)) == oracles


def test_each_oracle_has_something_planted_for_it():
    planted = {name for *_, names in PLANTS.values() for name in names}
    assert planted | {oracle for _, oracle, _ in COMMANDS} == set(Oracle.registry)


def test_what_is_allowed_is_not_found():
    """A repeated command counts from its first; after a gap, and while it is shaken, all is new."""
    record = calm("position")
    step = 2.5 * float(MODEL.limits.velocity[0]) / RATE
    for k in (1, 2):  # states that repeat, then a step for all their time
        record.commands[at(1.0) + k] = record.commands[at(1.0)]._replace(t=1.0 + k / RATE)
    for k in range(at(1.0) + 3, len(record.commands)):
        q = changed(AT_HOME, 0, step)
        record.commands[k] = record.commands[k]._replace(q=q)
    assert judge(record) == []
    record.said[1:] = [Said(1.0, ERROR, "a fault", Mode.STOPPED), Said(2.0, OK, "active")]
    record.truth[at(1.7)] = record.truth[at(1.7)]._replace(dq=(0.5, *ZERO[1:]))
    record.shaken = [(1.6, 1.8)]
    assert judge(record) == []


def test_the_hash_of_a_record_knows_each_bit_of_each_command():
    one, other = calm("torque"), calm("torque")
    assert one.digest() == other.digest()
    put(other, 1.0, effort=(np.nextafter(WEIGHT[0], np.inf), *WEIGHT[1:]))
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
        sent = [t for t in times for _, what in user.motions(t, HOME) if what]
        assert user.quiet >= quiet
        assert sent[-1] > quiet
        assert all(end <= quiet for _, end in shaken(faults, BEGINNING))


@pytest.fixture(scope="module")
def domain():
    """The domain of the sequences that are run here."""
    return schedule._domain().number


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_sequence_in_lock_step_repeats_to_the_bit(controller, domain):
    from eulerparams_control.lab.campaign.ros.lockstep import run_lockstep

    plan = make_plan(KILLED_SEED[controller], controller)
    one, again = (run_lockstep(plan, domain) for _ in range(2))
    assert len(one.commands) > 500
    assert {command.life for command in one.commands} == {1, 2}
    assert one.digest() == again.digest()
    assert one.truth == again.truth
    assert one.said == again.said


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_few_sequences_hold_what_they_must(controller):
    for plan in plans(3, 0, (controller,)):
        outcome = run(plan)
        assert outcome.is_good, (outcome.error, [str(v) for v in outcome.violations])
        assert outcome.commands > 300
        assert outcome.plan.repeat == (
            f"fault_campaign --mode lockstep --controller {controller} --seed {plan.seed} "
            "--sequences 1"
        )


@pytest.mark.slow
def test_a_sequence_in_real_time_has_commands_states_and_a_story():
    outcome = run(make_plan(KILLED_SEED["clik"], "clik", REALTIME))
    assert not outcome.error
    assert not outcome.violations, [str(v) for v in outcome.violations]
    assert outcome.commands > 0
    assert any(KILLED in line for line in outcome.story)
    assert sum(STARTS in line for line in outcome.story) == 2


# --- the executable --------------------------------------------------------------------


def good(plan: Any) -> SequenceOutcome:
    return look(plan, calm(plan.control), 1.0)


def bad(plan: Any) -> SequenceOutcome:
    record = calm(plan.control)
    record.tip_error = 1.0, 90.0
    return look(plan, record, 1.0)


def starved(plan: Any) -> SequenceOutcome:
    record = calm(plan.control)
    record.tip_error, record.starved = (1.0, 90.0), 2 * STARVED
    return look(plan, record, 1.0)


def dies(plan: Any) -> SequenceOutcome:
    if plan.seed == 1:
        os._exit(1)
    return good(plan)


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
    instead(good)
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
    outcome = starved(plan)
    assert not outcome.violations
    assert [violation.oracle for violation in outcome.unjudged] == ["recovers"]
    record = calm("position")
    record.starved, record.crash = 2 * STARVED, "ended"
    assert [v.oracle for v in look(plan, record, 1.0).violations] == ["survives"]


def test_a_sequence_that_starved_is_run_again_by_itself(monkeypatch):
    plan, runs = make_plan(0, "clik", REALTIME), []

    def pool(todo: Any, jobs: int, _lost: Any) -> Any:
        runs.append(jobs)
        return [starved(plan) if len(runs) < 3 else good(plan) for plan in todo]

    monkeypatch.setattr(schedule, "_in_pool", pool)
    (outcome,) = schedule.run_all([plan], 2)
    assert outcome.is_good
    assert not outcome.unjudged
    assert runs == [1, 1, 1]


def test_a_sequence_that_takes_its_worker_with_it_is_an_error_and_the_others_go_on(monkeypatch):
    # what is submitted is pickled by its name, and a worker imports it from here
    monkeypatch.setattr(schedule, "run", dies)
    outcomes = list(schedule.run_all(plans(3, 0, ("clik",)), 2))
    by_seed = {outcome.plan.seed: outcome for outcome in outcomes}
    assert sorted(by_seed) == [0, 1, 2]
    assert by_seed[0].is_good
    assert by_seed[2].is_good
    assert "its worker died" in by_seed[1].error


def processes_with(text: str) -> list[str]:
    """Return the command lines on this machine with a text in them."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            found.append(file.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [line for line in found if text in line]


@pytest.mark.slow
def test_a_campaign_that_is_told_to_end_ends_its_workers_and_their_nodes(tmp_path, graph):
    command = [sys.executable, "-m", "eulerparams_control.lab.campaign.main", "--mode", REALTIME]
    env = environment(tmp_path, graph.domain) | {"TMPDIR": str(tmp_path)}
    campaign = Process([*command, "--out", str(tmp_path / "out")], tmp_path, "campaign", env)
    graph.processes.append(campaign)
    nodes = f"{tmp_path}/faults_"
    graph.until(lambda: processes_with(nodes), "nodes of a sequence")
    campaign.signal(signal.SIGTERM)
    assert campaign.end() == 130, campaign.log
    graph.until(lambda: not processes_with(nodes), "the end of the nodes")
    assert not list(tmp_path.glob("faults_*"))


def test_a_sequence_that_cannot_be_run_ends_with_2(instead, tmp_path):
    instead(lambda plan: replace(good(plan), error="no simulator"))
    assert main(["--seed", "1", "--out", str(tmp_path)]) == 2


@pytest.mark.parametrize("given", [["--sequences", "0"], ["--seed", "-1"], ["--jobs", "x"]])
def test_wrong_options_are_refused(given, capsys):
    with pytest.raises(SystemExit):
        main(given)
    assert "expected" in capsys.readouterr().err
