"""Files and page of `make bench`; nothing here depends on how fast anything is."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from rows import GOALS, Row, append, read, write_page

MOST, LEAST = "tick / bare calls: clik", "states answered / sent"
ABOUT = {"commit": "1a2b3c4", "date": "2026-01-02 03:04", "machine": "2 cores <x>"}


def test_a_ratio_shows_both_times_and_meets_its_goal_or_not():
    assert Row.of_times(MOST, "x", 3e-6, 2e-6) == (MOST, "x", 1.5, "3.0 us / 2.0 us")
    met = [Row(LEAST, "", ratio, "").is_met for ratio in (1.0, 0.99975)]
    assert met == [True, False]
    assert all(Row(what, "", 1.0, "").is_met in (True, False) for what in GOALS)


def test_the_history_keeps_every_run_and_the_page_shows_the_newest_and_all(tmp_path):
    history, page = tmp_path / "history.jsonl", tmp_path / "out" / "bench.html"
    for ratio, loaded in ((9.0, 0), (1.25, 0), (3.5, 2)):
        rows = [Row(MOST, "euler_parameters", ratio, "<b>"), Row("other", "", 4.0, "4 us / 1 us")]
        append(history, rows, **ABOUT, quick=False, loaded=loaded)
    runs = read(history)
    assert [run["rows"][0].ratio for run in runs] == [9.0, 1.25, 3.5]
    assert [run["loaded"] for run in runs] == [0, 0, 2]
    write_page(page, runs)
    text = page.read_text(encoding="utf-8")
    assert "1 of 1 goals of speed are met" in text
    assert "&nbsp;euler parameters</td><td>1.25</td>" in text
    assert "<td>3.50</td><td>&lt;b&gt;</td>" in text
    assert '"y":[9.0,1.25,3.5]' in text
    assert "<x>" not in text
    assert "<b>" not in text.partition("<script")[0]
