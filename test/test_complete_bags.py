"""A run of which messages of the robot, or of its controller, are missing does not count."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import synthetic_runs
from synthetic_runs import rewritten, write_run

from eulerparams_control.lab.experiments.runner import IncompleteBagError, _check_complete

RATE, COUNT = 100.0, 30
END = (COUNT - 1) / RATE
SETTINGS: Any = SimpleNamespace(controller="clik", duration=END)
TOPICS = ("/joint_states", "/wrench", "/joint_reference")


def write_without(folder: Path, topic: str, lost: int) -> Path:
    """Write a run whose last messages of a topic are lost; return its folder."""
    q = [0.0] * COUNT
    whole = write_run(folder / "whole", q, q, wrenches=[[0.0] * 6] * COUNT)
    left = COUNT - lost
    return rewritten(
        whole, folder / "run", lambda m, k: None if m.topic == topic and k >= left else m
    )


def test_a_whole_run_counts_up_to_its_end(tmp_path: Path) -> None:
    assert _check_complete(write_without(tmp_path, "", 0), SETTINGS, RATE, diverged=False) == END


@pytest.mark.parametrize("topic", TOPICS)
@pytest.mark.parametrize("lost", [1, 20])
def test_a_run_of_which_messages_are_lost_is_incomplete(
    tmp_path: Path, topic: str, lost: int
) -> None:
    run = write_without(tmp_path, topic, lost)
    with pytest.raises(IncompleteBagError, match=f"{topic} has {COUNT - lost} stamps; expected"):
        _check_complete(run, SETTINGS, RATE, diverged=False)


def test_a_run_that_diverged_may_lack_the_last_answer_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(synthetic_runs, "_START", 0)  # as in simulated time
    run = write_without(tmp_path / "1", "/joint_reference", 1)
    assert _check_complete(run, SETTINGS, RATE, diverged=True) == END
    with pytest.raises(IncompleteBagError, match="/wrench has 29 stamps; expected 30"):
        _check_complete(write_without(tmp_path / "2", "/wrench", 1), SETTINGS, RATE, diverged=True)
