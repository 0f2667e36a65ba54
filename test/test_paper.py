"""The page of the paper reproduced: what it says of what was met, missed, and never ran."""

import json
import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eulerparams_control.analysis.verdict import Verdict
from eulerparams_control.lab.experiments import main as executable
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.experiments.evaluate import (
    FIGURE,
    REPORT,
    Outcome,
    judge,
    look,
    write_summary,
)
from eulerparams_control.lab.experiments.library import Result, e1, library_names, run_library
from eulerparams_control.lab.experiments.model import (
    FORMS,
    Experiment,
    equation,
)
from eulerparams_control.lab.experiments.paper import (
    COMPARISON,
    MAPS,
    STOPS,
    headline,
    number_of,
    paper_experiments,
    paper_table,
    write_paper_page,
    write_paper_summary,
)
from eulerparams_control.lab.experiments.schedule import Schedule
from eulerparams_control.laws.orientation import EulerSequence
from eulerparams_control.resources import config_names

EVIL = "<script>alert('x')</script> & \"more\""


def verdict(
    measured: float = 7.9, met: bool = True, variant: str = "a", text: str = "t"
) -> Verdict:
    return Verdict(text, variant, "7.903 Nm", measured, "Nm", "> 7.8", met)


def outcome(
    folder: Path, name: str = "e17", *verdicts: Verdict, error: str = "", claim: str = "It is so."
) -> Outcome:
    experiment = Experiment(name, claim, ("(38)", "refs. [9], [10]"), {}, (), source=name)
    return Outcome(experiment, folder / name, verdicts, "A sentence.", {}, error, 12.0)


def text_of(folder: Path, *outcomes: Outcome) -> str:
    write_paper_page(folder / "index.html", outcomes)
    return (folder / "index.html").read_text()


# --- what belongs to the paper -----------------------------------------------------------------
def test_the_paper_is_E1_to_E21_in_their_order_and_then_what_goes_beyond_in_lock_step():
    names = [experiment.name for experiment in paper_experiments()]
    assert names[:21] == [f"e{n}" for n in range(1, 22)]
    others = {"demo", "soak", "faults_clik", "faults_dynamic", "faults_impedance"}
    assert set(names) == set(config_names("experiments")) - others - {*COMPARISON, *MAPS, *STOPS}
    assert [number_of(load_experiment(name)) for name in ("e7", "robots")] == ["E7", ""]


def test_every_claim_says_its_equations_and_has_a_criterion_with_a_prediction():
    for experiment in paper_experiments()[:21]:
        assert experiment.equations, experiment.name
        assert experiment.criteria[0].predicted, experiment.name
        assert all(equation(number).text for number in experiment.equations if number[0] == "(")


def test_an_equation_that_is_wrong_in_print_says_so():
    wrong = ("(4)", "(7)", "(24)", "(38)", "(49)", "(50)", "(59)", "(62)")
    assert all(equation(number).printed for number in wrong)
    assert equation("(28)").printed == ""


# --- the sentence, the table, the file ----------------------------------------------------------
@pytest.mark.parametrize(
    ("outcomes", "words"),
    [
        ({"e1": True, "e2": True}, "2 of 2 claims of the paper met."),
        (
            {"e1": True, "e2": False, "e3": "clik died"},
            "1 of 3 claims of the paper met; E3 could not run; not met: E2.",
        ),
        ({"e1": True, "robots": False}, "1 of 1 claims of the paper met."),
        ({"e1": True, "e9": None}, "1 of 2 claims of the paper met; not judged: E9."),
    ],
)
def test_the_sentence_counts_the_claims_of_the_paper(tmp_path, outcomes, words):
    found = []
    for name, came in outcomes.items():
        verdicts = [verdict(met=came)] if isinstance(came, bool) else []
        error = came if isinstance(came, str) else ""
        found.append(outcome(tmp_path, name, *verdicts, error=error))
    assert headline(found) == words
    assert f"<h1>{words}</h1>" in text_of(tmp_path, *found)


@pytest.mark.parametrize(
    ("verdicts", "error", "met"),
    [
        ((), "", None),
        ((), "x", None),
        ((True,), "x", None),
        ((True, False), "", False),
        ((True, True), "", True),
    ],
)
def test_an_experiment_is_met_or_missed_only_if_it_was_judged(tmp_path, verdicts, error, met):
    judged = [verdict(met=one) for one in verdicts]
    found = outcome(tmp_path, "e9", *judged, error=error)
    assert (found.met, found.missed) == (met is True, met is False)
    if not error:
        path = tmp_path / "summary.json"
        write_paper_summary(path, [found])
        assert json.loads(path.read_text())["experiments"][0]["met"] is met
        write_summary(path, load_experiment("e9"), {}, judged)
        assert json.loads(path.read_text())["met"] is met


def test_the_summary_of_the_paper_has_all_that_the_page_has(tmp_path):
    values = [verdict(8.0), verdict(7.9, variant="b"), verdict(7.95, variant="c")]
    found = [
        outcome(tmp_path, "e17", *values, verdict(text="u"), verdict(math.inf, False, "b", "u")),
        outcome(tmp_path, "robots", error="a node died"),
    ]
    write_paper_summary(tmp_path / "summary.json", found)
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["headline"] == "0 of 1 claims of the paper met; not met: E17."
    first, second = content["experiments"]
    assert (first["experiment"], first["met"], first["claim_of_paper"]) == ("e17", False, True)
    assert [c["measured"] for c in first["criteria"]] == ["7.90 to 8.00 Nm", "7.90 to inf Nm"]
    assert [c["met"] for c in first["criteria"]] == [True, False]
    assert (second["error"], second["claim_of_paper"]) == ("a node died", False)
    assert paper_table(found, 120).row_count == 2


# --- the page ---------------------------------------------------------------------------------
def test_a_section_has_equations_numbers_figure_command_and_link(tmp_path):
    found = outcome(tmp_path, "e17", verdict())
    found.folder.mkdir()
    (found.folder / FIGURE).write_text("<svg><path/></svg>")
    (found.folder / REPORT).write_text("")
    page = text_of(tmp_path, found)
    for words in (
        '<section id="e17">',
        "E17. It is so.",
        "the paper prints",
        "7.903 Nm",
        "7.90 Nm",
        "&gt; 7.8",
        "✓ met",
        "<svg><path/></svg>",
        ".venv/bin/experiment e17 --out out",
        'href="e17/report.html"',
        '<a href="#e17">E17</a>',
        "A sentence.",
        "prefers-color-scheme: dark",
        "@media print",
    ):
        assert words in page, words
    assert re.findall(r'(?:src|href)="(?!#|e17/)', page) == []  # it loads nothing


def test_what_comes_from_files_is_escaped(tmp_path):
    evil = Verdict(EVIL, EVIL, EVIL, 1.0, EVIL, EVIL, True)
    experiment = Experiment("e1", EVIL, (EVIL,), {}, (), source=EVIL)
    found = Outcome(experiment, tmp_path / "e1", (evil,), EVIL, {EVIL: 1.0}, EVIL, 1.0)
    page = text_of(tmp_path, found)
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert "default-src 'none'" in page


# --- charts -----------------------------------------------------------------------------------


# --- the executable ----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("verdicts", "error", "code"),
    [((True,), "", 0), ((True, False), "", 1), ((), "a node died", 2), ((), "", 0)],
)
def test_the_exit_code_says_whether_claims_are_met(tmp_path, monkeypatch, verdicts, error, code):
    found = outcome(tmp_path, "e2", *(verdict(met=met) for met in verdicts), error=error)
    monkeypatch.setattr(Schedule, "run", lambda _: [found])
    assert executable.main(["--paper", "e2", "--out", str(tmp_path)]) == code
    assert (tmp_path / "index.html").is_file()
    assert json.loads((tmp_path / "summary.json").read_text())["experiments"]


def test_a_library_experiment_leaves_what_any_experiment_leaves(tmp_path):
    experiment, folder = load_experiment("e2"), tmp_path / "e2"
    found = look(experiment, folder, {})
    assert found.met
    assert "578" in found.sentence
    assert "{" not in found.sentence
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["experiment"], summary["met"]) == ("e2", True)
    assert summary["numbers"]["slope"] == pytest.approx(-1, abs=0.05)
    assert "condition number of J_A is 578" in (folder / REPORT).read_text()
    assert found.figure.startswith("<svg")


def test_what_was_looked_at_is_not_looked_at_again_unless_it_changed(tmp_path):
    experiment, folder = load_experiment("e2"), tmp_path / "e2"
    first = look(experiment, folder, {})
    (folder / FIGURE).write_text("kept")
    second = look(experiment, folder, {})
    assert (second.figure, second.verdicts, second.sentence) == (
        "kept",
        first.verdicts,
        first.sentence,
    )
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(summary | {"stamp": "of other code"}))
    assert look(experiment, folder, {}).figure != "kept"


# --- experiments in the library alone --------------------------------------------------------
# Runge-Kutta's method in steps of 2 ms leaves 1e-9 deg of errors of 180 deg.
INTEGRATED = 1e-6

result_of = cache(run_library)


def names():
    """Return the library experiments; maps take most of a minute each."""
    for name in library_names():
        marks = pytest.mark.slow if name.startswith("map_") else ()
        yield pytest.param(name, marks=marks)


@pytest.fixture(params=names())
def found(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> tuple[str, Result]:
    monkeypatch.setattr(e1, "SAMPLES", e1.FEW)  # the page of the paper has more
    return request.param, result_of(request.param)


def test_every_criterion_on_the_library_is_met(found):
    name, result = found
    experiment = load_experiment(name)
    assert experiment.library == name
    verdicts = judge(experiment, {}, result.numbers)
    assert len(verdicts) == sum(bool(criterion.number) for criterion in experiment.criteria) >= 2
    assert [verdict for verdict in verdicts if not verdict.met] == []
    assert {verdict.variant for verdict in verdicts} == {"library"}


@pytest.mark.parametrize(
    ("name", "wrong", "left"),
    [
        ("dT", lambda dT: 3 * dT, {"(38)", "(50)"}),
        ("T", lambda T: T * [1, 1, 2], {"(24)", "(38)", "(50)"}),
    ],
)
def test_a_wrong_T_or_its_derivative_is_found(monkeypatch, name, wrong, left):
    right = getattr(EulerSequence, name)
    monkeypatch.setattr(EulerSequence, name, lambda *given: wrong(right(*given)))
    monkeypatch.setattr(e1, "FEW", 30)
    found = e1.residuals(e1.errata())
    assert {name for name in ("(24)", "(38)", "(50)") if found[name] > 1.0} == left


# --- predictions over time --------------------------------------------------------------------
def test_a_small_error_by_41_decays_as_the_linear_equation_says():
    k_V = 10.0  # with k_Po = 50 the roots are -5 (1 +- j sqrt(0))
    t, error = FORMS["error_41"](2.0, error=1e-3, k_Po=k_V**2 / 2, k_Vo=k_V)
    expected = 1e-3 * (1 + 5 * t) * np.exp(-5 * t)
    np.testing.assert_allclose(error, expected, atol=1e-3 * INTEGRATED)


def test_an_error_next_to_Q1_grows_at_the_rate_of_the_paper_and_comes_the_long_way():
    t, error = FORMS["error_41"](6.0, error=359.999, k_Po=100.0, k_Vo=14.142)
    rate = (-14.142 + math.sqrt(14.142**2 + 200)) / 2
    early = (t > 0.5) & (t < t[np.argmax(error > 1.0)])
    assert np.polyfit(t[early], np.log(error[early]), 1)[0] == pytest.approx(rate, rel=1e-3)
    assert error.max() == pytest.approx(180, abs=1)
    assert error[-1] < 1
