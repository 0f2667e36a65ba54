"""Checks of the numbers of a state, in one compiled call; the words for them are elsewhere.

The joints of an arm, and a state of it, are tables of n columns, of which the rows are named below.
What is asked of a state is a bit of the code that :func:`code_of` returns.
"""

import math

import numpy as np

from eulerparams_control.laws.jit import Array, b1, f8, i8, jit, matrix, new_matrix, types, vector
from eulerparams_control.laws.limits import difference

Q, DQ, UNMOVED, TURNS, WRAPS = range(5)
"""Rows of a state: positions and speeds, how far [rad or m] positions that stay should be, whole
turns that were added to what the driver says, and whether it was seen to jump by a turn."""

STATE_ROWS = WRAPS + 1
"""How many rows a state has."""

FASTEST, ENDLESS, TURNING, LIMIT = range(4)
"""Rows of the joints: speeds that none has, which ones have no limit, which of these turn; and the
limits of the speeds of one that may run away, or infinity."""

JOINT_ROWS = LIMIT + 1
"""How many rows the joints have."""

SAME, AGAIN, FAST, FAR, MOVED, FROZEN, RUNS, SWINGS, WOUND = (1 << bit for bit in range(9))
"""Codes: the state is the last one, or has its stamp; a joint, whose number is above all codes, is
too fast, or too far from the last state; the arm is another one; positions stay although it moves;
it runs away, or would while it is held; positions are turns from what came."""
JOINT = 9

LONGEST_STEP = 3.0
"""The longest step that a law integrates over [usual periods]."""

AT_REST = 0.01
"""Slower than this [rad/s or m/s] a joint is at rest."""

# Largest distance [rad or m] of a measured position from where the last one could have led: beyond
# it the measurement is wrong.
_MOST_ASTRAY = 0.1

# Measured positions are stuck if they stay the same to the bit while the measured speeds would have
# led this distance [rad or m] away.
_FROZEN = 0.01

# After a jump of the stamps an arm farther [rad or m] from where it was is another one, or a
# simulation that was started again: no command acts on it yet.
_SAME_ARM = 0.03

# Speeds under efforts, as multiples of their limit, beyond which an arm runs away: one that moves,
# and one that was to stop.  What is measured is late, or the model is wrong, and only the brakes of
# the robot can stop it.  A joint that is slower than this [rad/s or m/s] does not run away.
RUNAWAY, SWINGING, _SLOW = 1.5, 0.5, 0.1


@jit(f8(f8, f8, f8))
def runaway(dq: float, most: float, limit: float) -> float:
    """Return by how much a joint is too fast under efforts, ``most`` times its limit; 0: not."""
    return max(abs(dq) - max(most * limit, _SLOW), 0.0)


@jit(i8(vector, vector, vector, matrix, new_matrix, matrix, f8, types.UniTuple(b1, 3)))
def code_of(
    q: Array,
    dq: Array,
    near: Array,
    before: Array,
    now: Array,
    joints: Array,
    dt: float,
    follows: tuple[bool, bool, bool],
) -> int:
    """Fill the state that was measured, and return what it says, as a code.

    Args:
        q, dq: (n,) as they came.
        near: (n,) where joints that turn are nearest to; none: to the last state.
        before: (STATE_ROWS, n) the last state.
        now: (STATE_ROWS, n) is filled with this one.
        joints: (JOINT_ROWS, n).
        dt: [s] after the last state, by the stamps.
        follows: whether there is a last state, and ``dt`` is short enough to compare with it;
            whether there was no silence, either; and whether the driver may have lost its count of
            turns.  Then a joint that was never seen to jump by a turn is where it says it is: a
            command a turn away would move it.
    """
    code, stays = SAME, True
    is_next, goes_on, is_lost = follows
    for i in range(len(q)):
        way = abs(difference(q[i], before[Q, i], joints[ENDLESS, i] != 0.0))
        if abs(dq[i]) > joints[FASTEST, i] and not code & FAST:
            code = code & ((1 << JOINT) - 1) | FAST | i << JOINT
        if is_next and way > _MOST_ASTRAY + dt * joints[FASTEST, i] and not code & (FAST | FAR):
            code |= FAR | i << JOINT
        turns, wraps = 0.0, before[WRAPS, i]
        if joints[TURNING, i]:
            place = near[i] if len(near) else before[Q, i]
            turns = np.rint((place - q[i]) / (2 * math.pi))
            if is_lost and not wraps:
                turns = 0.0
            elif not is_lost and turns != before[TURNS, i]:
                wraps = 1.0
        now[Q, i], now[DQ, i], now[TURNS, i], now[WRAPS, i] = q[i], dq[i], turns, wraps
        if turns:
            now[Q, i] += 2 * math.pi * turns
            code |= WOUND
        stays = stays and now[Q, i] == before[Q, i]
        if abs(difference(now[Q, i], before[Q, i], joints[ENDLESS, i] != 0.0)) > _SAME_ARM:
            code |= MOVED
        if not (stays and dq[i] == before[DQ, i]):
            code &= ~SAME
        if runaway(dq[i], SWINGING, joints[LIMIT, i]):
            code |= SWINGS | (RUNS if runaway(dq[i], RUNAWAY, joints[LIMIT, i]) else 0)
    for i in range(len(q)):
        now[UNMOVED, i] = before[UNMOVED, i] if stays else 0.0
        if stays and goes_on and abs(dq[i]) > AT_REST:
            now[UNMOVED, i] += dt * dq[i]
        if abs(now[UNMOVED, i]) > _FROZEN:
            code |= FROZEN
    return code
