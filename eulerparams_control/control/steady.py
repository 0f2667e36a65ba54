"""The next state of a steady stream, along a plain motion, in one compiled call.

What comes as it is expected goes this way; all else, and all that is not sure, goes the plain
way through :class:`Admission` and :class:`Shaper`, which this one leaves as they would.
"""

import math

from eulerparams_control.control.clock import SECONDS, best_at, late, smoothed, take_step
from eulerparams_control.control.judge import SWINGS, WOUND, code_of
from eulerparams_control.laws.compiled import Input, Row, Rows, entry
from eulerparams_control.motion.frames import put_frame
from eulerparams_control.motion.trajectories import sampled

NOT_STEADY = -1

LONGEST_STEP = 3.0
"""The longest step that a law integrates over [usual periods]."""

# A state is early by less than this part of a usual period: the rest is for the plain way.
_EARLY = 0.45


@entry
def admit_steady(
    velocity: Input, patient: bool, times: Row, segments: Rows, longest: float,
    fine_period: float, fine_turn: float,
    arm: Rows, believed: int, period: Row, latency: Row, most: float,
    q: Input, dq: Input, before: Rows, now: Rows, dt: float, silence: float, behind: float,
    receipt: float, is_timed: bool, loop_rate: float, since: float, frame: Row,
) -> int:  # fmt: skip
    """Take the next state, and sample the motion; return WOUND, 0, or NOT_STEADY.

    Nothing is changed where the state is not as expected.

    Args:
        velocity, arm, q, dq, before, now: see :func:`code_of`.
        patient, most, behind, receipt: see :func:`late`, if ``is_timed``.
        times, segments: of the motion; without times it rests at the start of the first.
        longest: [s] of ``dt`` and of the time by when the state came.
        fine_period, fine_turn: see :attr:`RateCheck.fine`.
        believed: the codes that count.
        period, latency: rows of :func:`take_step` and :func:`late`.
        dt, silence: [s] since the last state, by the stamps and by when it came.
        loop_rate: [1/s] of the law.
        since: [s] on the motion.
        frame: (24,) is filled with the desired frame.
    """
    usual, acted = period[SECONDS], silence
    if not is_timed or 0.0 < dt < silence:
        acted = dt
    longest = min(longest, LONGEST_STEP * usual)
    if not (len(q) == before.shape[1] == len(dq) and 0.0 < dt <= longest and acted <= longest):
        return NOT_STEADY
    period_now = smoothed(usual, dt)
    if not (period_now <= fine_period and loop_rate * period_now <= fine_turn):
        return NOT_STEADY
    if is_timed:
        early = best_at(latency, receipt) - behind
        if not (silence >= 0.0 and -most <= early < _EARLY * usual):
            return NOT_STEADY
    code = believed & code_of(
        q, dq, q[:0], velocity, arm, before, now, dt, True, True, False
    )
    if code & ~(WOUND | SWINGS):  # one that swings would be released only if it were held
        return NOT_STEADY
    if len(times) == 0:
        frame[:] = segments[0]
    else:
        put_frame(frame, 0, sampled(times, segments, since))
    if not math.isfinite(frame[3]):
        return NOT_STEADY
    take_step(period, dt)
    if is_timed:
        late(latency, behind, receipt, most, patient)
    return code & WOUND
