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

import numpy as np

from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.jit import Array, f8, i8, jit, matrix, new_matrix, new_vector, vector

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

# Rows of turns and of presses, 6 numbers each: sign and time of the last one, when they began to
# follow each other, and how many have; of presses also whether the tool is pressed.
_SIGN, _LAST, _BEGAN, _COUNT, _IS_PRESSED = range(5)

# The books: time, energy; then the power that swings, given and in size, of forces and of moments.
_TIME, _ENERGY, _POWER, _SIZE, _BOOKS = 0, 1, 2, 4, 6


class Oscillation(IntEnum):
    """What a contact does."""

    NONE = 0
    BOUNCES = 1  # who feeds it is not known
    IS_FED = 2  # by the controller


class ContactWatch:
    """Observes the energy and the oscillation of a contact.

    Args:
        force, moment: [N], [Nm] ripple that a contact may have; infinite: none is too much.
        translation, rotation: the impedances, which say how far apart bounces may be.

    """

    def __init__(
        self, force: float, moment: float, translation: Impedance, rotation: Impedance
    ) -> None:
        self.expect(force, moment, translation, rotation)
        self.reset()

    def expect(
        self, force: float, moment: float, translation: Impedance, rotation: Impedance
    ) -> None:
        """Go on with another law."""
        self._expected = np.array([[force, _gap(translation)], [moment, _gap(rotation)]])

    def expect_changes(self) -> None:
        """Let only quick bounces count: a program swings the stiffness, and so the contact."""
        self._expected[:, 1] = _NEXT_PRESS

    def reset(self) -> None:
        """Start again: nothing was given."""
        self._books = np.zeros(_BOOKS)
        self._smooth = np.zeros((4, 6))  # w and v without noise, and their means
        self.look_again()

    def look_again(self) -> None:
        """Look for an oscillation from the start again; the energy goes on."""
        self._turns, self._presses = np.zeros((4, 6)), np.zeros((5, 6))
        self._turns[_LAST] = self._presses[_LAST] = -math.inf
        self._books[_POWER:] = 0.0

    def take(self, w: Array, v: Array, omega: Array, dt: float) -> Oscillation:
        """Return whether the contact oscillates.

        Where it does, that is looked for from the start again; the energy goes on.

        Args:
            w: (6,) contact, about the tip, base frame.
            v, omega: (3,) of the tip.
            dt: [s] since the last one.
        """
        sample, events = np.array([w, [*v, *omega]]), (self._turns, self._presses)
        found = Oscillation(observe(sample, dt, self._smooth, self._books, *events, self._expected))
        if found:
            self.look_again()
        return found

    @property
    def energy(self) -> float:
        """What the tool has given to the contact [J], less what it took, since the restart."""
        return self._books.item(_ENERGY)


def _gap(Z: Impedance) -> float:
    """Return how far apart [s] bounces may be: a swing of the impedance."""
    slowest = float(np.linalg.eigvals(np.linalg.solve(Z.M, Z.K)).real.min())
    longest = (math.tau / _LONGEST_GAP) ** 2
    return max(_NEXT_PRESS, math.tau / math.sqrt(max(slowest, longest)))


@jit(f8(new_matrix, i8, f8, f8, f8, f8))
def _lasted(events: Array, i: int, sign: float, now: float, gap: float, same: float) -> float:
    """Take an event of axis i with a sign; return for how long [s] such have followed each other.

    Args:
        events: turns or presses.
        i, sign, now, gap: the event, its time, and the longest time until it [s].
        same: 1 where the signs have to be the same, -1 where they have to differ.
    """
    if now - events[_LAST, i] > gap or same * sign * events[_SIGN, i] < 0.0:
        events[_BEGAN, i], events[_COUNT, i] = now, 0.0
    events[_SIGN, i], events[_LAST, i] = sign, now
    events[_COUNT, i] += 1.0
    return now - events[_BEGAN, i]


@jit(i8(i8, f8, f8, vector, new_vector, new_matrix, new_matrix))
def _of_axis(
    i: int, force: float, swing: float, most: Array, books: Array, turns: Array, presses: Array
) -> int:
    """Return what the force of axis i does, whose part that swings is given."""
    now, part, lasted = books[_TIME], i // 3, 0.0
    ripple, gap = most[0], most[1]
    gives = books[_POWER + part] > _GIVES * books[_SIZE + part]
    counts = books[_SIZE + part] > ripple * _LEAST_SPEED[part] * _MEMORY
    if abs(swing) > ripple and swing * turns[_SIGN, i] <= 0.0:
        lasted = _lasted(turns, i, math.copysign(1.0, swing), now, _NEXT_TURN, -1.0)
    found = 2 if lasted > _LONG and gives and counts else 0
    if abs(force) < _FREE * ripple:
        presses[_IS_PRESSED, i] = 0.0
    elif abs(force) > _PRESSED * ripple and presses[_IS_PRESSED, i] == 0.0:
        presses[_IS_PRESSED, i] = 1.0
        is_quick = now - presses[_LAST, i] <= _NEXT_PRESS
        lasted = _lasted(presses, i, math.copysign(1.0, force), now, gap, 1.0)
        if lasted > _LONG and presses[_COUNT, i] >= _PRESSES:
            if gives and counts:
                found = 2
            elif is_quick:
                found = max(found, 1)
    return found


@jit(i8(matrix, f8, new_matrix, new_vector, new_matrix, new_matrix, matrix))
def observe(
    sample: Array, dt: float, smooth: Array, books: Array, turns: Array, presses: Array, most: Array
) -> int:
    """Take one sample (2, 6), w and v; see :class:`ContactWatch`; return the Oscillation."""
    left, found = math.exp(-dt / _MEMORY), 0
    quick, slow = 1.0 - math.exp(-dt / _NOISE), 1.0 - math.exp(-dt / _MEAN)
    if books[_TIME] == 0.0:
        quick = slow = 1.0
    books[_TIME] += max(dt, 1e-9)
    smooth[:2] += quick * (sample - smooth[:2])
    smooth[2:] += slow * (sample - smooth[2:])
    swing = smooth[:2] - smooth[2:]
    for i in range(6):
        part = i // 3
        books[_ENERGY] -= sample[0, i] * sample[1, i] * dt
        given = -swing[0, i] * swing[1, i] * dt
        if i % 3 == 0:
            books[_POWER + part] *= left
            books[_SIZE + part] *= left
        books[_POWER + part] += given
        books[_SIZE + part] += abs(given)
        does = _of_axis(i, smooth[0, i], swing[0, i], most[part], books, turns, presses)
        found = max(found, does)
    return found
