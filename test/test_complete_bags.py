"""A run of which messages of the robot, or of its controller, are missing does not count."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import synthetic_runs
from synthetic_runs import rewritten, write_run

from eulerparams_control.errors import BagError
from eulerparams_control.lab.experiments.runner import IncompleteBagError, _check_complete

RATE, COUNT = 100.0, 30
END = (COUNT - 1) / RATE


def checked(
    folder: Path, topic: str = "", lost: int = 0, diverged: bool = False, end: float = END
) -> float:
    """Check a run, planned until ``end`` [s], whose last messages of a topic are lost."""
    q = [0.0] * COUNT
    whole = write_run(folder / "whole", q, q, wrenches=[[0.0] * 6] * COUNT)
    left = COUNT - lost
    run = rewritten(
        whole, folder / "run", lambda m, k: None if m.topic == topic and k >= left else m
    )
    settings: Any = SimpleNamespace(controller="clik", duration=end)
    return _check_complete(run, settings, RATE, diverged)


def test_a_whole_run_counts_up_to_its_end(tmp_path):
    assert checked(tmp_path) == END


@pytest.mark.parametrize("topic", ["/joint_states", "/wrench", "/joint_reference"])
@pytest.mark.parametrize("lost", [1, 20])
def test_a_run_of_which_messages_are_lost_is_incomplete(tmp_path, topic, lost):
    with pytest.raises(IncompleteBagError, match=f"{topic} has {COUNT - lost} stamps; expected"):
        checked(tmp_path, topic, lost)


def test_a_run_with_more_messages_than_it_can_have_is_not_incomplete_but_wrong(tmp_path):
    with pytest.raises(BagError, match="has 30 stamps; expected 29") as error:
        checked(tmp_path, end=END - 1 / RATE)
    assert error.type is BagError


def test_a_run_that_diverged_may_lack_the_last_answer_only(tmp_path, monkeypatch):
    monkeypatch.setattr(synthetic_runs, "_START", 0)  # as in simulated time
    assert checked(tmp_path / "1", "/joint_reference", 1, diverged=True) == END
    with pytest.raises(IncompleteBagError, match="/wrench has 29 stamps; expected 30"):
        checked(tmp_path / "2", "/wrench", 1, diverged=True)
