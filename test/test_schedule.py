"""Runs side by side: domains of their own, what is not run again, what a failure leaves."""

import io
import json
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from eulerparams_control.errors import BagError, ConfigurationError, SimulationError
from eulerparams_control.lab.experiments import domains, fingerprint, run_cache, runner, schedule
from eulerparams_control.lab.experiments import main as executable
from eulerparams_control.lab.experiments.display import Display
from eulerparams_control.lab.experiments.domains import Domain
from eulerparams_control.lab.experiments.model import Experiment, Variant
from eulerparams_control.lab.experiments.processes import RunStopped
from eulerparams_control.lab.experiments.result import Outcome
from eulerparams_control.lab.experiments.run_cache import Making, Run, RunRecord
from eulerparams_control.lab.experiments.runner import IncompleteBagError
from eulerparams_control.lab.experiments.schedule import Schedule, Task
from eulerparams_control.robot.catalogue import load_robot

PATIENCE = 30.0  # [s] a guard against hanging, not a measure

# --- domains ---------------------------------------------------------------------------------


@pytest.fixture
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let there be four domains, which nothing else here uses."""
    monkeypatch.setattr(domains, "DOMAINS", range(101, 105))


@pytest.mark.usefixtures("_few")
def test_each_of_several_runs_has_a_domain_of_its_own_and_gives_it_back() -> None:
    with ThreadPoolExecutor(4) as threads:
        held = [f.result() for f in [threads.submit(Domain) for _ in range(4)]]
    assert sorted(domain.number for domain in held) == [101, 102, 103, 104]
    with pytest.raises(ConfigurationError, match="no ROS domain from 101 to 104 is free"):
        Domain()
    held[2].release()
    again = Domain()
    assert again.number == held[2].number
    for domain in (held[0], held[1], held[3], again):
        domain.release()


@pytest.mark.usefixtures("_few")
def test_a_domain_that_another_process_has_is_left_alone() -> None:
    code = (
        "import sys; from eulerparams_control.lab.experiments import domains; "
        "domains.DOMAINS = range(101, 104); held = [domains.Domain() for _ in range(3)]; "
        "print('held', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        mine = Domain()
        assert mine.number == 104
        mine.release()
        other.communicate()
    held = [Domain() for _ in range(4)]  # what a process had is free when it has ended
    for domain in held:
        domain.release()


@pytest.mark.parametrize("participant", [0, 1, 4])
@pytest.mark.usefixtures("_few")
def test_a_domain_in_which_any_participant_is_left_is_not_free(participant: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("", 7400 + 250 * 102 + 10 + 2 * participant))
        held = [Domain() for _ in range(3)]
        assert sorted(domain.number for domain in held) == [101, 103, 104]
        for domain in held:
            domain.release()


@pytest.mark.usefixtures("_few")
def test_what_killed_processes_left_of_a_domain_is_removed_and_that_of_others_is_not(
    tmp_path: Path,
) -> None:
    names = ("fastrtps_port{}", "fastrtps_port{}_el", "sem.fastrtps_port{}_mutex")
    ends = {port: {name.format(port) for name in names} for port in (32899, 32900, 33149, 33150)}
    for name in set().union(*ends.values()):
        (tmp_path / name).touch()
    domains.clear_leftovers(102, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == ends[32899] | ends[33150]


@pytest.mark.usefixtures("_few")
def test_a_domain_that_is_taken_has_nothing_left_in_shared_memory() -> None:
    left = [domains._SHARED_MEMORY / f"fastrtps_port{7649 + 250 * d}" for d in range(101, 105)]
    for path in left:
        path.touch()
    held = [Domain() for _ in range(4)]
    assert not any(path.exists() for path in left)
    for domain in held:
        domain.release()


# --- run cache ---------------------------------------------------------------------------------

MAKING = Making("definition", "code")


def bag_of(folder: Path, name: str = "first") -> Path:
    """Write what a recorder leaves."""
    bag = folder / name
    bag.mkdir(parents=True)
    (bag / "metadata.yaml").write_text("meta")
    (bag / f"{name}_0.mcap").write_text("messages")
    return bag


def ended(folder: Path) -> RunRecord:
    """Return the record of a run that ended with a whole bag."""
    record = RunRecord(folder, "first")
    record.begin(MAKING)
    bag = bag_of(folder)
    record.claim()
    record.end(MAKING, Run(bag, 5.0, None, 7.5))
    return record


def test_a_run_is_known_by_its_whole_bag(tmp_path: Path) -> None:
    record = ended(tmp_path)
    assert record.finished() == (MAKING, Run(tmp_path / "first", 5.0, None, 7.5))
    (tmp_path / "first/first_0.mcap").write_text("mess")
    assert record.finished() is None


def test_a_run_that_was_begun_only_is_not_known_and_its_bag_is_removed(tmp_path: Path) -> None:
    record = RunRecord(tmp_path, "first")
    record.begin(MAKING)
    record.claim()  # the recorder has made none yet
    bag_of(tmp_path)
    record.claim()
    assert record.finished() is None
    record.clear()
    assert not (tmp_path / "first").exists()
    record.clear()  # nothing is there


def test_a_bag_that_ended_whole_is_removed_also_if_its_folder_was_copied(tmp_path: Path) -> None:
    ended(tmp_path / "before")
    shutil.copytree(tmp_path / "before", tmp_path / "now")
    record = RunRecord(tmp_path / "now", "first")
    assert record.finished() is not None
    record.clear()
    assert not (tmp_path / "now/first").exists()


def refused(record: RunRecord, words: str) -> None:
    """Check that what is there is neither taken for the run nor removed."""
    before = {path: path.read_bytes() for path in record.bag.iterdir()}
    assert record.finished() is None
    with pytest.raises(BagError, match=words):
        record.clear()
    assert {path: path.read_bytes() for path in record.bag.iterdir()} == before


NOT_OURS = r"first exists, and is not the bag .*; remove it yourself, or choose another --out"


def test_a_bag_that_is_not_known_to_be_ours_is_never_removed(tmp_path: Path) -> None:
    bag_of(tmp_path)
    refused(RunRecord(tmp_path, "first"), NOT_OURS)


@pytest.mark.parametrize("has_ended", [True, False])
def test_a_bag_that_a_user_put_in_the_place_of_ours_is_never_removed(
    tmp_path: Path, has_ended: bool
) -> None:
    record = ended(tmp_path)
    if not has_ended:
        record.begin(MAKING)
        record.claim()
    shutil.rmtree(record.bag)
    bag_of(tmp_path)  # of the same size
    refused(record, NOT_OURS)


def test_a_bag_that_was_changed_after_its_run_is_never_removed(tmp_path: Path) -> None:
    record = ended(tmp_path)
    (record.bag / "first_0.mcap").write_text("mine, and longer")
    refused(record, "first was changed since its run: it had 12 bytes, and has 20; remove it your")


def test_a_link_in_the_place_of_a_bag_is_never_followed(tmp_path: Path) -> None:
    record = ended(tmp_path)
    record.bag.rename(tmp_path / "elsewhere")
    record.bag.symlink_to(tmp_path / "elsewhere")
    refused(record, "first is a symbolic link, which no run has made; remove it yourself")
    record.bag.unlink()
    record.bag.symlink_to(tmp_path / "nowhere")
    with pytest.raises(BagError, match="symbolic link"):
        record.clear()


def test_a_link_in_a_bag_is_what_no_recorder_wrote(tmp_path: Path) -> None:
    record = ended(tmp_path)
    record.begin(MAKING)
    record.claim()
    (record.bag / "first_1.mcap").symlink_to(record.bag / "first_0.mcap")
    refused(record, r"holds what no recorder wrote: first_1\.mcap; move it away")


def test_a_run_that_finds_a_bag_of_another_does_not_claim_it(tmp_path: Path) -> None:
    record = RunRecord(tmp_path, "first")
    record.begin(MAKING)
    bag_of(tmp_path)  # after the run had looked
    events = record.path.parent / "bag_recorder.events"
    events.write_text('{"event": "ended", "exit_code": 3}')
    runner._claim(record)
    refused(record, NOT_OURS)
    events.write_text('{"event": "ready"}')
    runner._claim(record)
    record.clear()


# --- the lock --------------------------------------------------------------------------------


def test_of_two_calls_on_one_folder_the_second_is_refused_until_the_first_has_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = (
        "import sys; from pathlib import Path; "
        "from eulerparams_control.lab.experiments.run_cache import locked\n"
        "with locked(Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, tmp_path / "e2"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        assert executable.main(["e2", "--out", str(tmp_path)]) == 2
        said = capsys.readouterr().out
        assert said == (
            f"error: another call of experiment writes to {tmp_path / 'e2'}; wait for its end, "
            "or choose another --out\n"
        )
        assert not (tmp_path / "e2/summary.json").exists()
        other.kill()
        other.communicate()
    assert executable.main(["e2", "--out", str(tmp_path)]) == 0


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    words = r"cannot write to .*/file/e2: Not a directory"
    with pytest.raises(ConfigurationError, match=words), run_cache.locked(tmp_path / "file/e2"):
        pass


# --- what a run is made of -------------------------------------------------------------------


@pytest.mark.parametrize("name", ["notes.txt", "mine.mcap", "second_0.mcap"])
def test_what_no_recorder_wrote_is_never_removed(tmp_path: Path, name: str) -> None:
    record = ended(tmp_path)
    record.begin(MAKING)
    record.claim()
    (tmp_path / "first" / name).write_text("mine")
    refused(record, f"holds what no recorder wrote: {name}; move it away")


@pytest.mark.parametrize("content", ["", "[]", "{", '{"making": 3, "ended": {}}'])
def test_a_broken_record_is_no_run(tmp_path: Path, content: str) -> None:
    record = ended(tmp_path)
    record.path.write_text(content)
    assert record.finished() is None


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (MAKING, ""),
        (Making("other", "code"), "its definition"),
        (Making("definition", "other"), "the code"),
        (Making("other", "other"), "its definition and the code"),
    ],
)
def test_a_making_says_what_has_changed(now: Making, words: str) -> None:
    assert now.differs(MAKING) == words


def test_a_making_depends_on_the_parameters_the_robot_and_the_duration() -> None:
    parameters = {"clik": {"k_Po": 1.0}}
    before = Making.of(Variant({}, 5.0), parameters)
    assert Making.of(Variant({}, 5.0), {"clik": {"k_Po": 1.0}}) == before
    for settings, given in (
        (Variant({}, 5.0), {"clik": {"k_Po": 2.0}}),
        (Variant({}, 6.0), parameters),
        (Variant({}, 5.0, robot="ur10"), parameters),
        (Variant({}, 5.0, may_diverge=True), parameters),
    ):
        now = Making.of(settings, given)
        assert (now.definition != before.definition, now.code == before.code) == (True, True)


@pytest.mark.parametrize(
    "changes", [{"home": (0.1,) * 6}, {"tip_frame": "wrist_3_link"}, {"joints": ()}, {"urdf": ""}]
)
def test_a_making_depends_on_the_whole_description_of_the_robot(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any]
) -> None:
    before = Making.of(Variant({}, 5.0), {})
    robot = replace(load_robot("ur5"), **changes)
    monkeypatch.setattr(run_cache, "load_robot", lambda _: robot)
    assert Making.of(Variant({}, 5.0), {}).differs(before) == "its definition"


@pytest.mark.parametrize("library", ["pin", "pybullet", "numpy"])
def test_a_making_depends_on_the_versions_of_the_libraries(
    monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    before = fingerprint.version([])
    of = fingerprint.version_of
    monkeypatch.setattr(fingerprint, "version_of", lambda n: "0" if n == library else of(n))
    assert fingerprint.version([]) != before


def test_what_was_looked_at_depends_on_the_assets_of_its_page(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assets = tmp_path / "eulerparams_control/analysis/assets"
    assets.mkdir(parents=True)
    monkeypatch.setattr(fingerprint, "_ROOT", tmp_path)
    versions = {fingerprint.code.__wrapped__()}
    for name in ("page.css", "run.js"):
        (assets / name).write_text(name)
        versions.add(fingerprint.code.__wrapped__())
    assert len(versions) == 3


# --- the schedule ----------------------------------------------------------------------------


class Watch:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.outcomes: list[Outcome] = []

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
def watch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    """Let a thread look at the runs, which have no bags here."""
    monkeypatch.setattr(schedule, "_looker", lambda: ThreadPoolExecutor(1))
    monkeypatch.setattr(
        schedule, "look", lambda e, folder, runs: Outcome(e, folder, sentence="-".join(runs))
    )
    monkeypatch.setattr(schedule, "known_run", lambda *_: (None, ""))
    return Watch()


def task(folder: Path, name: str, *variants: str) -> Task:
    made = {variant: Variant({}, 1.0) for variant in variants}
    return Task(Experiment(name, "claim", (), made, ()), folder / name, list(variants))


def runs_by(
    monkeypatch: pytest.MonkeyPatch, function: Callable[[str, threading.Event], None]
) -> None:
    """Let a run be a call of ``function``."""

    def run(experiment, variant, folder, progress, stop):  # type: ignore[no-untyped-def]
        function(variant, stop)
        return Run(folder / variant, 1.0, None, 2.0)

    monkeypatch.setattr(schedule, "run_variant", run)


def test_as_many_runs_go_on_side_by_side_as_there_are_jobs(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    together = threading.Barrier(3)  # each waits for two others, of either experiment
    runs_by(monkeypatch, lambda *_: together.wait(PATIENCE) and None)
    tasks = [task(tmp_path, "e1", "a", "b"), task(tmp_path, "e2", "c", "d", "e", "f")]
    outcomes = Schedule(tasks, 3, watch).run()
    assert [outcome.sentence for outcome in outcomes] == ["a-b", "c-d-e-f"]
    assert watch.said.count("e2 f 2.0 s") == 1


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (SimulationError("clik died:\n  its last words"), "bad: clik died:\n  its last words"),
        (OSError(28, "No space left"), "bad: OSError(28, 'No space left')"),
        (ZeroDivisionError("x / 0"), "bad: ZeroDivisionError('x / 0')"),
    ],
)
def test_one_failure_ends_its_experiment_but_not_the_others(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def run(variant: str, _stop: threading.Event) -> None:
        if variant == "bad":
            raise error

    runs_by(monkeypatch, run)
    tasks = [task(tmp_path, "e1", "bad", "never"), task(tmp_path, "e2", "good")]
    first, second = Schedule(tasks, 1, watch).run()
    assert first.error == words
    assert (second.error, second.sentence) == ("", "good")
    assert "e1 never started" not in watch.said
    assert [outcome.experiment.name for outcome in watch.outcomes] == ["e1", "e2"]


def test_a_run_whose_recorder_starved_is_run_once_more_when_no_other_goes_on(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
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

    runs_by(monkeypatch, run)
    tasks = [task(tmp_path, "e1", "a", "b"), task(tmp_path, "e2", "c", "d", "e", "f")]
    first, second = Schedule(tasks, 3, watch).run()
    assert (first.error, first.sentence) == ("", "a-b")
    assert (second.error, second.sentence) == ("", "c-d-e-f")
    assert sorted(beside) == [["a"], ["b"]]
    assert [o.experiment.name for o in watch.outcomes] == ["e2", "e1"]


def test_a_run_that_is_repeated_still_says_why_it_was_made_again(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    whys = ["its definition changed", ""]  # what is known of a run that has begun is no more

    def run(_variant: str, _stop: threading.Event) -> None:
        if whys:
            raise IncompleteBagError("460 stamps")

    runs_by(monkeypatch, run)
    monkeypatch.setattr(schedule, "known_run", lambda *_: (None, whys.pop(0)))
    Schedule([task(tmp_path, "e1", "a")], 1, watch).run()
    assert watch.said[-1] == "e1 a 2.0 s, again: its definition changed"


def test_a_run_that_is_incomplete_by_itself_too_ends_its_experiment(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[str] = []

    def run(variant: str, _stop: threading.Event) -> None:
        ran.append(variant)
        if variant == "bad":
            raise IncompleteBagError("460 stamps")

    runs_by(monkeypatch, run)
    tasks = [task(tmp_path, "e1", "bad", "good"), task(tmp_path, "e2", "fine")]
    first, second = Schedule(tasks, 1, watch).run()
    assert first.error == "bad: 460 stamps, run by itself, too"
    assert (second.error, second.sentence) == ("", "fine")
    assert ran == ["bad", "good", "fine", "bad"]
    assert [o.experiment.name for o in watch.outcomes] == ["e2", "e1"]


def test_an_experiment_that_failed_otherwise_repeats_nothing(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(variant: str, _stop: threading.Event) -> None:
        raise {"a": IncompleteBagError("460 stamps"), "b": SimulationError("died")}[variant]

    runs_by(monkeypatch, run)
    (outcome,) = Schedule([task(tmp_path, "e1", "a", "b")], 1, watch).run()
    assert outcome.error == "b: died"
    assert watch.said.count("e1 a started") == 1


@pytest.mark.parametrize(("missing", "kind"), [(1, IncompleteBagError), (-1, BagError)])
def test_only_a_bag_that_misses_messages_is_incomplete(
    monkeypatch: pytest.MonkeyPatch, missing: int, kind: type[BagError]
) -> None:
    found = {"/joint_states": set(range(801)), "/joint_reference": set(range(801 - missing))}
    monkeypatch.setattr(runner, "_stamps", lambda *_: found)
    with pytest.raises(BagError, match=r"joint_reference has .* stamps; expected 801") as error:
        runner._check_complete(Path("bag"), Variant({}, 0.8), 1000.0, False)
    assert error.type is kind


def test_the_terminal_says_that_a_run_is_repeated(tmp_path: Path) -> None:
    console = Console(file=io.StringIO(), width=200)
    with Display(console, [task(tmp_path, "e1", "a")], details=True) as display:
        display.started("e1", "a", 1.0)
        display.simulated("e1", "a", 0.7)
        display.repeated("e1", "a", "460 stamps")
        assert display._simulated == 0
        display.started("e1", "a", 1.0)
        display.ended("e1", "a", "2.0 s", 1.0)
        assert display._simulated == 1
    assert console.file.getvalue().splitlines() == [
        "  e1 a: incomplete, to be run once more by itself: 460 stamps",
        "  e1 a: 2.0 s",
    ]


def test_what_cannot_be_looked_at_is_an_error_of_its_experiment_alone(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look(experiment, folder, runs):  # type: ignore[no-untyped-def]
        if experiment.name == "e1":
            raise BagError("no wrench")
        return Outcome(experiment, folder, sentence="seen")

    monkeypatch.setattr(schedule, "look", look)
    runs_by(monkeypatch, lambda *_: None)
    first, second = Schedule([task(tmp_path, n, "a") for n in ("e1", "e2")], 2, watch).run()
    assert (first.error, second.sentence) == ("no wrench", "seen")


def test_what_was_run_before_is_run_again_only_if_asked_for_or_changed(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    def known(_experiment, variant, folder):  # type: ignore[no-untyped-def]
        run = Run(folder / variant, 1.0, None, 3.0)
        return (None, "the code changed") if variant == "old" else (run, "")

    monkeypatch.setattr(schedule, "known_run", known)
    ran: list[str] = []
    runs_by(monkeypatch, lambda variant, _: ran.append(variant))
    (outcome,) = Schedule([task(tmp_path, "e1", "same", "old")], 1, watch).run()
    assert (ran, outcome.sentence) == (["old"], "same-old")
    assert watch.said[0] == "e1 same was run before"
    assert watch.said[-1] == "e1 old 2.0 s, again: the code changed"
    Schedule([task(tmp_path, "e1", "same")], 1, watch, again=True).run()
    assert ran == ["old", "same"]


def test_a_signal_ends_the_runs_that_go_on_and_begins_no_other(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends: list[str] = []

    def run(variant: str, stop: threading.Event) -> None:
        assert stop.wait(PATIENCE)
        ends.append(variant)
        raise RunStopped

    def interrupted(*_: object, **__: object) -> None:
        while len(watch.said) < 2:
            pass  # both have started
        raise KeyboardInterrupt

    runs_by(monkeypatch, run)
    monkeypatch.setattr(schedule, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Schedule([task(tmp_path, "e1", "a", "b", "c", "d")], 2, watch).run()
    assert sorted(ends) == ["a", "b"]


def test_the_looker_dies_and_the_next_experiment_gets_another(
    tmp_path: Path, watch: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Dead(ThreadPoolExecutor):
        def submit(self, *_: object, **__: object):  # type: ignore[no-untyped-def,override]
            raise schedule.BrokenProcessPool("killed")

    lookers: list[ThreadPoolExecutor] = [Dead(1), ThreadPoolExecutor(1)]
    monkeypatch.setattr(schedule, "_looker", lambda: lookers.pop(0))
    runs_by(monkeypatch, lambda *_: None)
    (outcome,) = Schedule([task(tmp_path, "e1", "a")], 1, watch).run()
    assert outcome.sentence == "a"


def test_a_record_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    record = ended(tmp_path)
    assert json.loads(record.path.read_text())["bytes"] == len("meta") + len("messages")
    assert [path.name for path in record.path.parent.iterdir()] == ["run.json"]
