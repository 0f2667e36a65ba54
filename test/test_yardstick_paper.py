"""The yardstick of the experiments finds what differs; those of the library are held to it."""

import copy

import pytest
import yardstick_paper
from yardstick_paper import compare, differences, read

from eulerparams_control.lab.experiments import main as executable
from eulerparams_control.lab.experiments.definition import load_experiment

SUMMARY = {
    "met": True,
    "criteria": [
        {"text": "peak", "variant": "a", "measured": 7.9, "unit": "Nm", "met": True},
        {"text": "least", "variant": "b", "measured": 3e-14, "unit": "", "met": True},
    ],
    "numbers": {"time": 1.5},
    "diverged": {},
}


def edited(path, value):
    summary = copy.deepcopy(SUMMARY)
    *keys, last = path
    at = summary
    for key in keys:
        at = at[key]
    at[last] = value
    return summary


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["met"], False),
        (["criteria", 0, "measured"], 7.9 * (1 + 2e-6)),
        (["criteria", 0, "measured"], "nan"),
        (["criteria", 1, "variant"], "c"),
        (["criteria", 1, "met"], False),
        (["numbers", "time"], 1.50001),
        (["numbers", "more"], 1.0),
        (["diverged", "a"], 2.0),
    ],
)
def test_what_differs_is_found(path, value):
    assert len(differences(edited(path, value), SUMMARY)) == 1


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["criteria", 0, "measured"], 7.9 * (1 + 5e-7)),
        (["criteria", 1, "measured"], 5e-13),  # rounding
        (["criteria", 0, "text"], "the peak"),
    ],
)
def test_rounding_and_other_words_are_no_difference(path, value):
    assert differences(edited(path, value), SUMMARY) == []


def test_experiments_that_are_missing_or_new_are_named():
    assert compare({"e1": SUMMARY}, {"e1": SUMMARY}) == {}
    assert compare({"e1": SUMMARY}, {"e2": SUMMARY}) == {
        "e1": ["it is new"],
        "e2": ["it did not run"],
    }


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["paper", "compare"])
def test_the_experiments_without_simulation_are_what_they_were(folder, tmp_path):
    held = {
        name: content
        for name, content in read()[folder].items()
        if not load_experiment(name).variants
    }
    assert executable.main([*held, f"--{folder}", "--out", str(tmp_path)]) == 0
    assert compare(yardstick_paper.read_folder(tmp_path), held) == {}
