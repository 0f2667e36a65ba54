"""The soak: its numbers on a made-up bag, and one short run."""

import json
import math
from pathlib import Path

import pytest
from synthetic_runs import _START, rewritten, write_run

from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.quantities import BY_NAME, measure
from eulerparams_control.analysis.quantities.real_time import NODES, USAGE
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.bags.reader import RawMessage
from eulerparams_control.errors import BagError
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.main import lasting, main

SECONDS, WARM_UP, RATE = 20, 4.0, 100
EXACT = 1e-6  # relative: times of some 1e9 s, and their differences as doubles


def made(folder: Path) -> Recording:
    """Return a run at 100 Hz, answered after 0.4 ms; each second one after 2 ms, one not at all.

    In the warm-up and the last second none is.  The controller grows by 1 MB a minute.
    """

    def change(message: RawMessage, number: int) -> RawMessage | None:
        t = number / RATE
        if not WARM_UP <= t < SECONDS - 1 or number % 100 == 1:
            return None
        late = 1_600_000 if number % 100 == 2 else 0
        return message._replace(log_time=message.log_time + late)

    rest = [0.0] * (SECONDS * RATE + 1)
    first = write_run(folder / "first", rest, efforts=rest)
    path = rewritten(first, folder / "run", change, topic="/joint_effort")
    rows = [
        [_START + t * 10**9, 100e6 + 1e6 * t / 60 + 50e6 * (t < WARM_UP), 100e6, 100e6, 100e6]
        for t in range(SECONDS + 1)
    ]
    (path / USAGE).write_text("".join(",".join(map(str, row)) + "\n" for row in rows))
    return load(path)


def test_latency_states_answered_and_growth_of_memory_are_of_the_time_after_the_warm_up(tmp_path):
    run = made(tmp_path)
    assert measure("states_answered", run) == pytest.approx(99.0)
    for percent, latency in ((50, 0.4), (98, 0.4), (100, 2.0)):
        assert measure("round_trip", run, percent=percent) == pytest.approx(latency, rel=EXACT)
    # from the second command after one that did not come, which is late, to the next
    assert measure("longest_silence", run) == pytest.approx(21.6, rel=EXACT)
    for node, growth in zip(NODES, (60, 0, 0, 0), strict=True):
        assert measure("memory_growth", run, node=node) == pytest.approx(growth, abs=1e-3)
    assert BY_NAME["memory"].of(run)[1][-1] == pytest.approx([100 + 19 / 60, 100, 100, 100])
    with pytest.raises(BagError, match=r"has no usage.csv: it is no experiment with real_time"):
        measure("round_trip", load(tmp_path / "first"))


def test_a_duration_without_unit_too_short_or_of_a_run_in_lock_step_is_refused():
    for name, duration in (("soak", "20"), ("soak", "1s")):
        with pytest.raises(SystemExit, match="2"):
            main([name, "--duration", duration])
    for name in ("demo", "map_failure"):
        assert main([name, "--duration", "20m"]) == 2


def test_the_circle_outlasts_a_soak_of_any_duration():
    for seconds in (20.0, 36000.0):
        for variant in lasting(load_experiment("soak"), seconds).variants.values():
            circle = variant.nodes["reference"]
            assert variant.duration == seconds
            assert circle["circle_turns"] * circle["circle_period"] >= 1.5 * seconds


@pytest.mark.slow
def test_a_short_soak_has_all_its_numbers_from_its_bag(tmp_path):
    code = main(["soak", "--duration", "20s", "--variant", "clik", "--out", str(tmp_path)])
    summary = json.loads((tmp_path / "soak/summary.json").read_text())
    assert code == (0 if summary["met"] else 1)
    measured = [float(verdict["measured"]) for verdict in summary["criteria"]]
    assert len(measured) == 8
    assert all(map(math.isfinite, measured))
    assert 50 < measured[0] <= 100  # of 250 states a second: a busy machine gives up some
    assert 0 < measured[1] <= measured[2] <= measured[3]
