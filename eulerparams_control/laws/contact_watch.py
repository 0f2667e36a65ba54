"""What a controller gives to its contact: energy, and whether it feeds an oscillation there.

A loop that lags, by its servo, its network or its sensor, chatters on what is stiff.  The tool
bounces: it is pressed, let go, and pressed again from the same side.  Or it swings in what holds it
from both sides, and gives energy.  A hand that shakes or pats the tool gives energy to it instead;
what bounces slowly, or is to be stopped, has to give some, too.  Of a sensor that is late the power
is not to be trusted: quick bounces count without it.

Notation: ``w`` (6,) [N, Nm] contact on the tool, ``v`` (3,) [m/s] and ``omega`` (3,) [rad/s] of the
tip; P = -w'[v; omega] [W] what the tool gives.  Its integral is the energy of the passivity
observer (Hannaford and Ryu, Time-domain passivity control of haptic interfaces, 2002, eq. 3).
"""

import math
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.jit import Array, f8, i8, jit, matrix, new_matrix, new_vector, vector

if TYPE_CHECKING:
    from eulerparams_control.parameters.impedance_control import ImpedanceParameters

# Time constants [s] of the low-pass against noise, of the means, and of the power that swings.
_NOISE, _MEAN, _MEMORY = 0.005, 0.3, 0.7

# It oscillates when turns of the force, or so many presses, have followed each other within these
# times [s] for longer than the last; presses that are fed may be as far apart as the impedance
# swings, up to the longest.
_NEXT_TURN, _NEXT_PRESS, _LONGEST_GAP, _PRESSES, _LONG = 0.22, 0.45, 1.5, 3, 0.6

# A press is a force above so many ripples, after one below so many.
_PRESSED, _FREE = 2.0, 0.5

# Of the power that swings, in size, the tool gives more than this part: a hand is given less.
_GIVES = -0.25

# Speeds [m/s, rad/s] that make, with the ripple, the least power that counts.
_LEAST_SPEED = (0.005, 0.05)

# Rows of the events, 6 numbers each, of turns and then of presses: sign and time of the last one,
# when they began to follow each other, how many have, and whether the tool is pressed.
_SIGN, _LAST, _BEGAN, _COUNT, _IS_PRESSED, _ROWS = range(6)

# The books: time, energy; then the power that swings, given and in size, of forces and of moments.
_TIME, _ENERGY, _POWER, _SIZE, _BOOKS = 0, 1, 2, 4, 6


class Oscillation(IntEnum):
    """What a contact does."""

    NONE = 0
    BOUNCES = 1  # who feeds it is not known
    IS_FED = 2  # by the controller


class ContactWatch:
    """Observes the energy and the oscillation of a contact, beyond the ripple that it may have."""

    def __init__(self, parameters: "ImpedanceParameters") -> None:
        self.expect(parameters)
        self.reset()

    def expect(self, parameters: "ImpedanceParameters") -> None:
        """Go on with other parameters."""
        force = parameters.max_ripple_force, _gap(parameters.translation())
        moment = parameters.max_ripple_torque, _gap(parameters.rotation())
        self._expected = np.array((force, moment))

    def expect_changes(self) -> None:
        """Let only quick bounces count: a program swings the stiffness, and so the contact."""
        self._expected[:, 1] = _NEXT_PRESS

    def reset(self) -> None:
        """Start again: nothing was given."""
        self._books = np.zeros(_BOOKS)
        self._smooth = np.zeros((4, 6))  # w and v without noise, and their means
        self._look_again()

    def _look_again(self) -> None:
        self._events = np.zeros((2 * _ROWS, 6))
        self._events[[_LAST, _ROWS + _LAST]] = -math.inf
        self._books[_POWER:] = 0.0

    def take(self, w: Array, v: Array, omega: Array, dt: float) -> Oscillation:
        """Return whether the contact, dt [s] later, oscillates; if so, look for it anew."""
        sample = np.concatenate((w, v, omega)).reshape(2, 6)
        found = observe(sample, dt, self._smooth, self._books, self._events, self._expected)
        if found:
            self._look_again()
        return Oscillation(found)

    @property
    def energy(self) -> float:
        """What the tool has given to the contact [J], less what it took, since the restart."""
        return self._books.item(_ENERGY)


def _gap(Z: Impedance) -> float:
    """Return how far apart [s] bounces may be: a swing of the impedance."""
    slowest = float(np.linalg.eigvals(np.linalg.solve(Z.M, Z.K)).real.min())
    longest = (math.tau / _LONGEST_GAP) ** 2
    return max(_NEXT_PRESS, math.tau / math.sqrt(max(slowest, longest)))


@jit(f8(new_matrix, i8, f8, f8, f8))
def _lasted(events: Array, i: int, sign: float, now: float, gap: float) -> float:
    """Count an event of axis i, of a sign, now; return for how long [s] the row has lasted.

    A pause longer than the gap [s] ends a row.
    """
    if now - events[_LAST, i] > gap:
        events[_BEGAN, i], events[_COUNT, i] = now, 0.0
    events[_SIGN, i], events[_LAST, i] = sign, now
    events[_COUNT, i] += 1.0
    return now - events[_BEGAN, i]


@jit(i8(i8, f8, f8, vector, new_vector, new_matrix))
def _of_axis(i: int, f: float, swing: float, expected: Array, books: Array, events: Array) -> int:
    """Return the Oscillation of axis i, whose force f has a part that swings."""
    turns, presses = events[:_ROWS], events[_ROWS:]
    now, part, found = books[_TIME], i // 3, 0
    ripple, gap = expected[0], expected[1]
    gives = books[_POWER + part] > _GIVES * books[_SIZE + part]
    is_fed = gives and books[_SIZE + part] > ripple * _LEAST_SPEED[part] * _MEMORY
    if abs(swing) > ripple and swing * turns[_SIGN, i] <= 0.0:
        lasted = _lasted(turns, i, math.copysign(1.0, swing), now, _NEXT_TURN)
        if lasted > _LONG and is_fed:
            found = 2
    if abs(f) < _FREE * ripple:
        presses[_IS_PRESSED, i] = 0.0
    elif abs(f) > _PRESSED * ripple and presses[_IS_PRESSED, i] == 0.0:
        presses[_IS_PRESSED, i] = 1.0
        if f * presses[_SIGN, i] < 0.0:  # it is pressed from the other side
            gap = 0.0
        is_quick = now - presses[_LAST, i] <= _NEXT_PRESS
        lasted = _lasted(presses, i, math.copysign(1.0, f), now, gap)
        if lasted > _LONG and presses[_COUNT, i] >= _PRESSES and (is_fed or is_quick):
            found = max(found, 2 if is_fed else 1)
    return found


@jit(i8(matrix, f8, new_matrix, new_vector, new_matrix, matrix))
def observe(
    sample: Array, dt: float, smooth: Array, books: Array, events: Array, expected: Array
) -> int:
    """Return the Oscillation of a contact after one more sample (2, 6), w and v."""
    left, found = math.exp(-dt / _MEMORY), 0
    quick, slow = 1.0 - math.exp(-dt / _NOISE), 1.0 - math.exp(-dt / _MEAN)
    if books[_TIME] == 0.0:
        quick = slow = 1.0
    books[_TIME] += max(dt, 1e-9)
    smooth[:2] += quick * (sample - smooth[:2])
    smooth[2:] += slow * (sample - smooth[2:])
    swing = smooth[:2] - smooth[2:]
    books[_POWER:] *= left
    for i in range(6):
        part = i // 3
        books[_ENERGY] -= sample[0, i] * sample[1, i] * dt
        given = -swing[0, i] * swing[1, i] * dt
        books[_POWER + part] += given
        books[_SIZE + part] += abs(given)
        found = max(found, _of_axis(i, smooth[0, i], swing[0, i], expected[part], books, events))
    return found
