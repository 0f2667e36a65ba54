"""Runs side by side: domains of their own, what is not run again, what a failure leaves."""

import json
import multiprocessing
import os
import select
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.lab.experiments import main as executable
from eulerparams_control.lab.experiments import runner, schedule
from eulerparams_control.lab.experiments.evaluate import Outcome
from eulerparams_control.lab.experiments.model import Experiment, Task, Variant
from eulerparams_control.lab.experiments.runner import IncompleteBagError
from eulerparams_control.lab.experiments.schedule import Schedule
from eulerparams_control.lab.run import domains, jobs, run_cache
from eulerparams_control.lab.run.domains import Domain
from eulerparams_control.lab.run.processes import RunStopped
from eulerparams_control.lab.run.run_cache import Making, Run, RunRecord
from eulerparams_control.robot.catalogue import load_robot

PATIENCE = 30.0  # [s] a guard against hanging, not a measure

# --- domains ---------------------------------------------------------------------------------
# As with those of ros_processes.py, Linux gives none of their ports to outgoing connections.
OWN = range(215, 219)
Take = Callable[[int], list[Domain]]


@pytest.fixture
def take(monkeypatch: pytest.MonkeyPatch) -> Iterator[Take]:
    """Takes domains, of four that nothing else here uses, and gives them back at the end."""
    monkeypatch.setattr(domains, "DOMAINS", OWN)
    held: list[Domain] = []

    def take(count: int) -> list[Domain]:
        with ThreadPoolExecutor(count) as threads:
            held.extend(f.result() for f in [threads.submit(Domain) for _ in range(count)])
        return held[-count:]

    yield take
    for domain in held:
        domain.release()


def numbers(held: list[Domain]) -> list[int]:
    return sorted(domain.number for domain in held)


def test_each_of_several_runs_has_a_domain_of_its_own_and_gives_it_back(take):
    held = take(4)
    assert numbers(held) == list(OWN)
    with pytest.raises(ConfigurationError, match="no ROS domain from 215 to 218 is free"):
        Domain()
    held[2].release()
    assert numbers(take(1)) == [held[2].number]


@contextmanager
def another_process(code: str, *args: object) -> Iterator[None]:
    """Run Python code in a process that goes on as it is, and is killed at the end."""
    code = f"import sys; {code}; print('ready', flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", code, *map(str, args)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        yield
        process.kill()


def test_a_domain_that_another_process_has_is_left_alone(take):
    code = (
        "from eulerparams_control.lab.run import domains; domains.DOMAINS = range(215, 218); "
        "held = [domains.Domain() for _ in range(3)]"
    )
    with another_process(code):
        assert numbers(take(1)) == [218]
    assert numbers(take(3)) == [215, 216, 217]  # what a process had is free when it has ended


@pytest.mark.parametrize("participant", [0, 1, 4])
def test_a_domain_in_which_any_participant_is_left_is_not_free(take, participant):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("", 7400 + 250 * 216 + 10 + 2 * participant))
        assert numbers(take(3)) == [215, 217, 218]


def test_what_killed_processes_left_of_a_domain_is_removed_and_no_more(tmp_path):
    names = ("fastrtps_port{}", "fastrtps_port{}_el", "sem.fastrtps_port{}_mutex")
    ends = {port: {name.format(port) for name in names} for port in (32899, 32900, 33149, 33150)}
    for name in set().union(*ends.values()):
        (tmp_path / name).touch()
    domains.clear_leftovers(102, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == ends[32899] | ends[33150]


# --- run cache ---------------------------------------------------------------------------------
MAKING = Making("definition", "code")


def bag_of(folder: Path) -> Path:
    bag = folder / "first"
    bag.mkdir(parents=True)
    (bag / "metadata.yaml").write_text("meta")
    (bag / "first_0.mcap").write_text("messages")
    return bag


def ended(folder: Path, making: Making = MAKING) -> RunRecord:
    """Return the record of a run that ended with a whole bag."""
    record = RunRecord(folder, "first")
    bag = bag_of(folder)
    record.claim(making)
    record.end(making, Run(bag, 5.0, None, 7.5))
    return record


def begun(folder: Path) -> RunRecord:
    """Return the record of a run that is made again, over the bag of the one before."""
    record = ended(folder)
    record.claim(MAKING)
    return record


def test_a_run_is_known_by_its_whole_bag_also_if_its_folder_was_copied(tmp_path):
    record = ended(tmp_path / "before")
    assert json.loads(record.path.read_text())["bytes"] == len("meta") + len("messages")
    names = {path.name for path in record.bag.iterdir()}
    assert names == {"metadata.yaml", "first_0.mcap", "run.json"}  # it is whole
    shutil.copytree(tmp_path / "before", tmp_path / "now")
    record = RunRecord(tmp_path / "now", "first")
    assert record.finished() == (MAKING, Run(tmp_path / "now/first", 5.0, None, 7.5))
    record.clear()
    assert not (tmp_path / "now/first").exists()
    (tmp_path / "before/first/first_0.mcap").write_text("mess")
    assert RunRecord(tmp_path / "before", "first").finished() is None


def test_a_run_is_known_unless_its_definition_changed(tmp_path):
    same, longer = (
        Experiment("e", "claim", (), {"first": Variant({}, seconds)}, ()) for seconds in (5.0, 6.0)
    )
    settings = same.variants["first"]
    record = ended(tmp_path, runner.making_of(settings, runner.node_parameters(settings)))
    assert runner.known_run(same, "first", tmp_path) == (Run(record.bag, 5.0, None, 7.5), "")
    assert runner.known_run(longer, "first", tmp_path) == (None, "its definition changed")


def refused(record: RunRecord, words: str) -> None:
    """Check that what is there is neither taken for the run nor removed."""
    before = {path: path.read_bytes() for path in record.bag.iterdir()}
    assert record.finished() is None
    with pytest.raises(BagError, match=words):
        record.clear()
    assert {path: path.read_bytes() for path in record.bag.iterdir()} == before


NOT_OURS = r"first exists, and is not the bag of a run; remove it yourself, or choose another --out"
NOT_RECORDED = "holds what no recorder wrote: {}; move it away"


def replaced(bag: Path) -> None:
    shutil.rmtree(bag)
    bag_of(bag.parent)  # of the same size


def linked(bag: Path) -> None:
    bag.rename(bag.parent / "elsewhere")
    bag.symlink_to(bag.parent / "elsewhere")


def write(name: str) -> Callable[[Path], object]:
    return lambda bag: (bag / name).write_text("mine, and longer")


@pytest.mark.parametrize(
    ("made", "change", "words"),
    [
        (lambda folder: RunRecord(folder, "first"), lambda bag: bag_of(bag.parent), NOT_OURS),
        (begun, replaced, NOT_OURS),
        (ended, write("first_0.mcap"), "it had 12 bytes, and has 20; remove it yourself"),
        (ended, linked, "first is a symbolic link, which no run has made; remove it yourself"),
        (begun, lambda bag: (bag / "first_1.mcap").symlink_to("first_0.mcap"), "first_1.mcap; mov"),
        (begun, write("notes.txt"), NOT_RECORDED.format("notes.txt")),
        (begun, write("second_0.mcap"), NOT_RECORDED.format("second_0.mcap")),
    ],
)
def test_a_bag_that_is_not_of_the_run_is_neither_taken_nor_removed(tmp_path, made, change, words):
    record = made(tmp_path)
    change(record.bag)
    refused(record, words)


def test_a_run_that_finds_a_bag_of_another_does_not_claim_it(tmp_path):
    record = RunRecord(tmp_path, "first")
    bag_of(tmp_path)  # after the run had looked
    record.logs.mkdir(parents=True)
    events = record.logs / "bag_recorder.events"
    events.write_text('{"event": "ended", "exit_code": 3}')
    runner._claim(record, MAKING)
    refused(record, NOT_OURS)
    events.write_text('{"event": "ready"}')
    runner._claim(record, MAKING)
    record.clear()


# --- the lock --------------------------------------------------------------------------------
def test_of_two_calls_on_one_folder_the_second_is_refused_until_the_first_ended(tmp_path, capsys):
    code = (
        "from pathlib import Path; from eulerparams_control.lab.run.run_cache import locked; "
        "lock = locked(Path(sys.argv[1])); lock.__enter__()"
    )
    with another_process(code, tmp_path / "e2"):
        assert executable.main(["e2", "--out", str(tmp_path)]) == 2
        words = f"error: another call of experiment writes to {tmp_path / 'e2'}; wait for its end"
        assert capsys.readouterr().out.startswith(words)
        assert not (tmp_path / "e2/summary.json").exists()
    assert executable.main(["e2", "--out", str(tmp_path)]) == 0


# --- what a run is made of -------------------------------------------------------------------
@pytest.mark.parametrize(
    ("settings", "parameters", "robot"),
    [
        (Variant({}, 5.0), {"clik": {"k_Po": 2.0}}, {}),
        (Variant({}, 6.0), {}, {}),
        (Variant({}, 5.0, may_diverge=True), {}, {}),
        (Variant({}, 5.0), {}, {"home": (0.1,) * 6}),
        (Variant({}, 5.0), {}, {"urdf": ""}),
    ],
)
def test_a_making_depends_on_the_parameters_the_whole_robot_and_the_duration(
    monkeypatch, settings, parameters, robot
):
    before = runner.making_of(Variant({}, 5.0), {})
    assert runner.making_of(Variant({}, 5.0), {}) == before
    monkeypatch.setattr(run_cache, "load_robot", lambda name: replace(load_robot(name), **robot))
    assert runner.making_of(settings, parameters).differs(before) == "its definition"


# --- the schedule ----------------------------------------------------------------------------
class Watch:
    """Keeps what it is told of experiments whose runs are calls of a function, without a bag."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.said: list[str] = []
        self.outcomes: list[Outcome] = []
        self.tasks: list[Task] = []
        self._folder, self._monkeypatch = folder, monkeypatch

    def add(self, name: str, *variants: str) -> None:
        made = {variant: Variant({}, 1.0) for variant in variants}
        experiment = Experiment(name, "claim", (), made, ())
        self.tasks.append(Task(experiment, self._folder / name, list(variants)))

    def run(
        self, function: Callable[[str, threading.Event], object], jobs: int = 1, again: bool = False
    ) -> list[Outcome]:
        def run(experiment, variant, folder, progress, stop):  # type: ignore[no-untyped-def]
            function(variant, stop)
            return Run(folder / variant, 1.0, None, 2.0)

        self._monkeypatch.setattr(schedule, "run_variant", run)
        return Schedule(self.tasks, jobs, self, again).run()

    def started(self, experiment: str, variant: str, duration: float) -> None:
        self.said.append(f"{experiment} {variant} started")

    def simulated(self, experiment: str, variant: str, t: float) -> None: ...

    def ended(self, experiment: str, variant: str, how: str, duration: float) -> None:
        self.said.append(f"{experiment} {variant} {how}")

    def repeated(self, experiment: str, variant: str, why: str) -> None:
        self.said.append(f"{experiment} {variant} repeated: {why}")

    def finished(self, outcome: Outcome) -> None:
        self.outcomes.append(outcome)


@pytest.fixture
def watch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Watch:
    monkeypatch.setattr(schedule, "processes", ThreadPoolExecutor)
    monkeypatch.setattr(
        schedule, "look", lambda e, folder, runs: Outcome(e, folder, sentence="-".join(runs))
    )
    monkeypatch.setattr(schedule, "known_run", lambda *_: (None, ""))
    return Watch(tmp_path, monkeypatch)


def test_as_many_runs_go_on_side_by_side_as_there_are_jobs(watch):
    together = threading.Barrier(3)  # each waits for two others, of either experiment
    watch.add("e1", "a", "b")
    watch.add("e2", "c", "d", "e", "f")
    outcomes = watch.run(lambda *_: together.wait(PATIENCE), jobs=3)
    assert [outcome.sentence for outcome in outcomes] == ["a-b", "c-d-e-f"]
    assert watch.said.count("e2 f 2.0 s") == 1


def test_one_failure_ends_its_experiment_but_not_the_others(watch):
    def run(variant: str, _stop: threading.Event) -> None:
        if variant == "bad":
            raise OSError(28, "No space left")

    watch.add("e1", "bad", "never")
    watch.add("e2", "good")
    first, second = watch.run(run)
    assert first.error == "bad: OSError(28, 'No space left')"
    assert (second.error, second.sentence) == ("", "good")
    assert "e1 never started" not in watch.said
    assert [outcome.experiment.name for outcome in watch.outcomes] == ["e1", "e2"]


def look_in_vain(experiment, folder, runs):  # type: ignore[no-untyped-def]
    """Look at the runs of an experiment; at those of e1 the process ends, those of e2 lack data."""
    if experiment.name == "e1":
        os._exit(1)
    if experiment.name == "e2":
        raise BagError("no wrench")
    return Outcome(experiment, folder, sentence="-".join(runs))


def test_what_cannot_be_looked_at_is_an_error_of_its_experiment_alone(watch, monkeypatch):
    monkeypatch.setattr(schedule, "processes", jobs.processes)
    monkeypatch.setattr(schedule, "look", look_in_vain)
    for name in ("e1", "e2", "e3"):
        watch.add(name, "a")
    first, second, third = watch.run(lambda *_: None)
    assert "terminated abruptly" in first.error
    assert second.error == "no wrench"
    assert (third.error, third.sentence) == ("", "a")


def test_a_run_whose_recorder_starved_is_run_once_more_when_no_other_goes_on(watch):
    going: list[str] = []
    beside: list[list[str]] = []
    starts, repeats = threading.Barrier(3), threading.Event()

    def run(variant: str, _stop: threading.Event) -> None:
        again = f"e1 {variant} repeated: 460 stamps" in watch.said
        going.append(variant)
        if again:
            repeats.set()
            beside.append(list(going))
        elif variant == "d":
            repeats.wait(0.5)  # what should not come while this goes on has its chance
        elif variant in "abc":
            starts.wait(PATIENCE)
        if variant in "ab" and not again:
            going.remove(variant)
            raise IncompleteBagError("460 stamps")
        going.remove(variant)

    watch.add("e1", "a", "b")
    watch.add("e2", "c", "d", "e", "f")
    first, second = watch.run(run, jobs=3)
    assert (first.error, first.sentence) == ("", "a-b")
    assert (second.error, second.sentence) == ("", "c-d-e-f")
    assert sorted(beside) == [["a"], ["b"]]
    assert [o.experiment.name for o in watch.outcomes] == ["e2", "e1"]


def test_a_run_that_is_incomplete_by_itself_too_ends_its_experiment(watch):
    ran: list[str] = []

    def run(variant: str, _stop: threading.Event) -> None:
        ran.append(variant)
        if variant == "bad":
            raise IncompleteBagError("460 stamps")

    watch.add("e1", "bad", "good")
    watch.add("e2", "fine")
    first, second = watch.run(run)
    assert first.error == "bad: 460 stamps, run by itself, too"
    assert (second.error, second.sentence) == ("", "fine")
    assert ran == ["bad", "good", "fine", "bad"]
    assert [o.experiment.name for o in watch.outcomes] == ["e2", "e1"]


def test_what_was_run_before_is_run_again_only_if_asked_for_or_changed(watch, monkeypatch):
    def known(_experiment, variant, folder):  # type: ignore[no-untyped-def]
        run = Run(folder / variant, 1.0, None, 3.0)
        return (None, "the code changed") if variant == "old" else (run, "")

    monkeypatch.setattr(schedule, "known_run", known)
    ran: list[str] = []
    watch.add("e1", "same", "old")
    (outcome,) = watch.run(lambda variant, _: ran.append(variant))
    assert (ran, outcome.sentence) == (["old"], "same-old")
    assert watch.said[0] == "e1 same was run before"
    assert watch.said[-1] == "e1 old 2.0 s, again: the code changed"
    watch.run(lambda variant, _: ran.append(variant), again=True)
    assert ran == ["old", "same", "old"]


def test_a_signal_ends_the_runs_that_go_on_and_begins_no_other(watch, monkeypatch):
    ends: list[str] = []

    def run(variant: str, stop: threading.Event) -> None:
        assert stop.wait(PATIENCE)
        ends.append(variant)
        raise RunStopped

    def interrupted(*_: object, **__: object) -> None:
        while len(watch.said) < 2:
            pass  # both have started
        raise KeyboardInterrupt

    monkeypatch.setattr(schedule, "as_completed", interrupted)
    watch.add("e1", "a", "b", "c", "d")
    with pytest.raises(KeyboardInterrupt):
        watch.run(run, jobs=2)
    assert sorted(ends) == ["a", "b"]


# --- processes ---------------------------------------------------------------------------------
def test_at_the_end_processes_are_ended_whatever_they_do():
    with jobs.processes(1) as pool:
        waiting = pool.submit(time.sleep, PATIENCE)
        pool.submit(len, "never")
        while not waiting.running():
            pass
    assert isinstance(waiting.exception(PATIENCE / 2), BrokenExecutor)
    assert not multiprocessing.active_children()


def test_processes_end_with_a_parent_that_is_killed():
    code = (
        "import os; from eulerparams_control.lab.run.jobs import processes; "
        "pool = processes(1); worker = pool.__enter__().submit(os.getpid).result(); "
        "print(worker, flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", f"import sys; {code}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as parent:
        assert parent.stdout is not None
        worker = os.pidfd_open(int(parent.stdout.readline()))
        parent.kill()
    ended, _, _ = select.select([worker], [], [], PATIENCE)
    os.close(worker)
    assert ended
