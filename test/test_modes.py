"""The modes of a controller: the table of transitions row by row, and what each mode keeps."""

import itertools

import numpy as np
import pytest

from eulerparams_control.control.mode import (
    DEACTIVATED,
    HALTED,
    TRANSITIONS,
    Cause,
    Latch,
    Mode,
    ModeEvent,
    Why,
    transition,
)
from eulerparams_control.control.modes import Distrusting, Holding, Releasing, Waiting

TABLE = """
event       waiting   holding     following   stopped     releasing   distrusting
REFERENCE   following following   following   following   following   distrusting
RESTART     waiting   holding     holding     stopped     releasing   distrusting
DISTRUST    waiting   distrusting distrusting distrusting distrusting distrusting
TRUST       waiting   holding     following   stopped     releasing   holding
FAULT       waiting   stopped     stopped     stopped     releasing   distrusting
DEFECT      waiting   stopped     stopped     stopped     releasing   distrusting
HALT        waiting   stopped     stopped     stopped     releasing   distrusting
END         waiting   stopped     stopped     stopped     releasing   distrusting
RESUME      waiting   holding     following   holding     releasing   distrusting
RUNS_AWAY   waiting   releasing   releasing   releasing   releasing   distrusting
FROZEN      waiting   releasing   releasing   releasing   releasing   distrusting
RECOVERED   waiting   holding     following   stopped     stopped     distrusting
"""
HEAD, *ROWS = (line.split() for line in TABLE.split("\n") if line)
EXPECTED = {
    (Mode(mode), ModeEvent[event]): Mode(after)
    for event, *row in ROWS
    for mode, after in zip(HEAD[1:], row, strict=True)
}
FAULT = Why(Cause.NOT_FOLLOWING, "the arm is blocked", "free it", at=3.0)
LATER = Why(Cause.STAMP_STUCK, "the stamp stays", "see to it", at=5.0)
DEFECT = Why(Cause.DEFECT, "internal error", "report it", at=4.0)
RUNAWAY = Why(Cause.RUNAWAY, "it runs away", "see to it", at=4.0)
HALT = Why(Cause.HALT, at=6.0)


def test_each_event_leads_from_each_mode_to_the_one_of_the_table():
    found = {(mode, event): transition(mode, event) for mode in Mode for event in ModeEvent}
    assert found == EXPECTED
    assert TRANSITIONS.keys() == set(Mode)


def stopped(why=FAULT):
    """Return the mode after a fault of a holding controller."""
    return Holding(Why()).after(ModeEvent.FAULT, why)


def released():
    """Return the mode of an arm that runs away."""
    return Holding(Why()).after(ModeEvent.RUNS_AWAY, RUNAWAY)


def test_a_stop_tells_its_newest_fault_and_when_the_first_one_came():
    again = stopped().after(ModeEvent.FAULT, LATER)
    assert (again.mode, again.why) == (Mode.STOPPED, LATER._replace(at=FAULT.at))


@pytest.mark.parametrize("event", [ModeEvent.HALT, ModeEvent.RESTART])
def test_neither_a_halt_nor_a_restart_makes_a_fault_forgotten(event):
    assert stopped().after(event, HALT).why == FAULT


def test_a_reference_ends_a_stop_and_its_fault():
    after = stopped().after(ModeEvent.REFERENCE, Why())
    assert (after.mode, after.why) == (Mode.FOLLOWING, Why())
    assert not after.is_halted


STOPS = {
    ModeEvent.FAULT: Latch.PAUSE,
    ModeEvent.RUNS_AWAY: Latch.PAUSE,
    ModeEvent.FROZEN: Latch.PAUSE,
    ModeEvent.HALT: Latch.RESUME,
    ModeEvent.DEFECT: Latch.NEVER,
    ModeEvent.END: Latch.NEVER,
}


@pytest.mark.parametrize("start", [Holding, Waiting, lambda why: Distrusting(7.0, Holding(why))])
def test_of_two_stops_the_one_that_is_harder_to_leave_counts(start):
    for first, second in itertools.product(STOPS, repeat=2):
        mode = start(Why()).after(first, FAULT).after(second, FAULT)
        mode = mode.after(ModeEvent.RESTART, LATER).after(ModeEvent.RECOVERED, Why())
        latch = max(STOPS[first], STOPS[second])
        assert mode.latch is latch, (first, second)
        mode = mode.after(ModeEvent.TRUST, Why()).after(ModeEvent.RECOVERED, Why())
        left = mode.after(ModeEvent.RESUME, Why())
        assert left.latch is (Latch.NEVER if latch is Latch.NEVER else Latch.NONE)


def test_a_defect_at_the_end_is_told_and_a_halt_is_not_a_reason_to_resume_then():
    ends = Holding(Why()).after(ModeEvent.END, DEACTIVATED)
    assert (ends.mode, ends.why.cause) == (Mode.STOPPED, Cause.DEACTIVATED)
    assert ends.after(ModeEvent.DEFECT, DEFECT).why.cause is Cause.DEFECT
    assert ends.after(ModeEvent.HALT, HALTED).latch is Latch.NEVER


def test_what_to_do_about_a_fault_of_a_halted_arm_tells_both():
    halted = Holding(Why()).after(ModeEvent.HALT, HALTED)
    assert halted.remedy == "call ~/resume"
    assert halted.after(ModeEvent.FAULT, FAULT).remedy == "free it; call ~/resume"
    assert stopped().remedy == "free it"
    assert stopped().after(ModeEvent.HALT, HALTED).remedy == "free it; call ~/resume"


def test_a_halt_before_the_first_reference_is_latched_in_silence_until_it_is_resumed():
    halted = Waiting(Why()).after(ModeEvent.HALT, HALTED)
    assert (halted.mode, halted.latch, halted.why.cause) == (Mode.WAITING, Latch.RESUME, Cause.HALT)
    assert halted.after(ModeEvent.RESUME, Why()).why == Why()


@pytest.mark.parametrize("event", [ModeEvent.FAULT, ModeEvent.RUNS_AWAY, ModeEvent.HALT])
def test_a_defect_is_latched_whatever_comes_after_it(event):
    defective = Holding(Why()).after(ModeEvent.DEFECT, DEFECT)
    after = defective.after(event, LATER)
    assert after.is_latched
    assert after.why.cause is Cause.DEFECT


def test_a_defect_before_the_first_reference_is_latched_in_silence():
    after = Waiting(Why()).after(ModeEvent.DEFECT, DEFECT)
    assert (after.mode, after.is_latched) == (Mode.WAITING, True)
    assert after.after(ModeEvent.HALT, HALT).is_latched


def test_an_arm_that_ran_away_has_to_come_to_rest_one_with_frozen_encoders_has_not():
    assert released().is_runaway
    frozen = Holding(Why()).after(ModeEvent.FROZEN, LATER)
    assert not frozen.is_runaway
    assert released().after(ModeEvent.FROZEN, LATER).is_runaway


def test_what_was_let_go_is_stopped_with_its_cause_when_it_has_recovered():
    after = released().after(ModeEvent.RECOVERED, Why())
    assert (after.mode, after.why) == (Mode.STOPPED, RUNAWAY)


def test_an_arm_is_at_rest_after_it_stayed_in_one_place_for_0_2_s():
    mode = Releasing(RUNAWAY, is_runaway=True)
    here, there = np.zeros(2), np.array([0.0, 3e-3])
    assert not any(mode.rests(0.01, here) for _ in range(19))
    assert not any(mode.rests(0.01, there) for _ in range(19))  # it moved meanwhile
    assert mode.rests(0.01, there + 1e-3)


def test_distrust_holds_back_a_mode_that_goes_on_changing_behind_it():
    held_back = stopped().after(ModeEvent.DISTRUST, Why(at=7.0))
    assert isinstance(held_back, Distrusting)
    assert (held_back.until, held_back.is_halted, held_back.why) == (7.0, True, FAULT)
    after = held_back.after(ModeEvent.REFERENCE, Why())
    assert (after.mode, after.is_halted, after.until) == (Mode.DISTRUSTING, False, 7.0)
    assert after.after(ModeEvent.TRUST, Why()).mode is Mode.FOLLOWING


def test_distrust_is_renewed_by_another_jump_and_nothing_is_held_back_twice():
    once = Holding(Why()).after(ModeEvent.DISTRUST, Why(at=7.0))
    twice = once.after(ModeEvent.DISTRUST, Why(at=8.0))
    assert twice.until == 8.0
    assert twice.after(ModeEvent.TRUST, Why()).mode is Mode.HOLDING
    assert once.after(ModeEvent.RUNS_AWAY, RUNAWAY).is_runaway
