"""What every law commands is what it was: see yardstick.py, which says how it is made again."""

import numpy as np
import pytest
import yardstick
from yardstick import ARMS, GAINS, LAWS, REPRESENTATIONS, SCENARIOS, TO_LIMIT, arm_named, read, run


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("orientation", REPRESENTATIONS)
@pytest.mark.parametrize("law", LAWS)
def test_a_law_commands_what_it_did(law, orientation, arm):
    found = []
    for name, scenario in SCENARIOS.items():
        if law in scenario.laws:
            cell = law, orientation, arm, name
            found.append(yardstick.difference(cell, run(*cell), read()[cell]))
    worst = max(found)
    assert worst.ratio <= 1, worst.text


@pytest.mark.parametrize(
    ("law", "gain"), [(law, gain) for law, gains in GAINS.items() for gain in gains]
)
def test_a_gain_that_differs_by_a_millionth_is_seen(law, gain):
    cell = law, "euler_parameters", "ur5", "push" if gain.startswith(("M", "D")) else "circle"
    now = run(*cell, **yardstick.changed(law, gain, cell[-1]))
    assert yardstick.difference(cell, now, read()[cell]).ratio > 1


def test_all_runs_are_kept_and_no_others():
    assert set(read()) == set(yardstick.cells())


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("law", LAWS)
def test_the_scenarios_lead_to_what_they_are_for(law, arm):
    """A run that no longer meets its event would hold nothing."""

    def log(scenario):
        return " | ".join(read()[law, "euler_parameters", arm, scenario].log)

    assert "following" in log("circle")
    assert all(words in log("gap") for words in ("stamp_jump", "silence", "following"))
    assert "stopped halt | 130 resume refused | 220 follow refused | 260 holding" in log("halt")
    assert "stopped deactivated" in log("halt")
    assert all(words in log("fault") for words in ("stopped not_following", "follow refused"))
    if law == "impedance_control":
        assert "stopped contact_too_large" in log("fault")
        assert "stopped not_following" in log("no_wrench")  # back, and far away
    n, model = arm_named(arm).n, arm_named(arm).model
    commands = read()[law, "euler_parameters", arm, "limit"].commands[:, :n]
    if law == "clik":  # it stops before it, more and more slowly
        joint = TO_LIMIT[arm]
        assert 0 <= model.upperPositionLimit[joint] - commands[:, joint].max() < 1e-3
    else:
        assert np.isclose(np.abs(commands), model.effortLimit, rtol=1e-12, atol=0).any()
