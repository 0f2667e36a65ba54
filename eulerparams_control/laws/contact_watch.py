"""What a controller gives to its contact: energy, and whether it feeds an oscillation there.

A loop that lags, by its servo, its network or its sensor, chatters on what is stiff.  The tool
bounces: it is pressed, let go, and pressed again from the same side.  Or it swings without being
let go, and is given energy, which the impedance takes from a hand that shakes the tool.

Notation: ``w`` (6,) [N, Nm] contact on the tool, ``v`` (3,) [m/s] and ``omega`` (3,) [rad/s] of the
tip; P = -w'[v; omega] [W] what the tool gives.  Its integral is the energy of the passivity
observer (Hannaford and Ryu, Time-domain passivity control of haptic interfaces, 2002, eq. 3).
"""

import math

import numpy as np

from eulerparams_control.laws.compiled import Array, Input, Row, Rows, entry, kernel

# Time constants [s] of the low-pass against noise, of the means, and of the power that swings.
_NOISE, _MEAN, _MEMORY = 0.005, 0.3, 0.7

# It oscillates when turns of the force, or presses, have followed each other within these times
# [s], 2.3 Hz and more, for longer than the last.
_NEXT_TURN, _NEXT_PRESS, _LONG = 0.22, 0.45, 0.6

# A press is a force above so many ripples, after one below so many.
_PRESSED, _FREE = 2.0, 0.5

# Of the power that swings, in size, the tool gives more than this part: a hand is given less.
_GIVES = -0.25

# Speeds [m/s, rad/s] that make, with the ripple, the least power that counts.
_LEAST_SPEED = (0.005, 0.05)

# Rows of the state, 6 numbers each: w and v without noise; their means; sign and time of the last
# turn, and when turns began; the same of presses, and whether it is pressed; then the books:
# energy, swinging power given and in size, of forces and of moments; time.
_W, _V, _MEAN_W, _MEAN_V, _TURN, _PRESS, _IS_PRESSED, _BOOKS = 0, 1, 2, 3, 4, 7, 10, 11
_ENERGY, _GIVEN, _SIZE, _TIME = 0, 1, 3, 5


class ContactWatch:
    """Observes the energy and the oscillation of a contact.

    Args:
        force, moment: [N], [Nm] ripple that a contact may have; infinite: none is too much.
    """

    def __init__(self, force: float, moment: float) -> None:
        self.ripple = np.array([force, moment])
        self._state = np.zeros((_BOOKS + 1, 6))
        self.reset()

    def reset(self) -> None:
        """Start again: nothing was given."""
        self._state[:] = 0.0
        self._look_again()

    def _look_again(self) -> None:
        self._state[_TURN:_BOOKS] = 0.0
        self._state[[_TURN + 1, _PRESS + 1]] = -math.inf
        self._state[_BOOKS, _GIVEN:_TIME] = 0.0

    def take(self, w: Array, v: Array, omega: Array, dt: float) -> bool:
        """Return whether the contact oscillates, fed by the controller.

        Where it does, that is looked for from the start again; the energy goes on.

        Args:
            w: (6,) contact, about the tip, base frame.
            v, omega: (3,) of the tip.
            dt: [s] since the last one.
        """
        found = bool(_observe(w, v, omega, dt, self.ripple, self._state))
        if found:
            self._look_again()
        return found

    @property
    def energy(self) -> float:
        """What the tool has given to the contact [J], less what it took, since the restart."""
        return self._state.item(_BOOKS, _ENERGY)


@kernel
def _goes_on(run: Rows, i: int, sign: float, now: float, gap: float, same: float) -> float:
    """Take an event of axis i with a sign; return for how long [s] such have followed each other.

    Args:
        run: (3, 6) sign and time of the last one, and when they began.
        i, sign, now, gap: the event, its time, and the longest time until it [s].
        same: 1 where the signs have to be the same, -1 where they have to differ.
    """
    if now - run[1, i] > gap or same * sign * run[0, i] < 0.0:
        run[2, i] = now
    run[0, i], run[1, i] = sign, now
    lasted: float = now - run[2, i]
    return lasted


@kernel
def _is_told(i: int, swing: float, ripple: float, books: Row, state: Rows) -> bool:
    """Return whether the force of axis i, whose part that swings is given, oscillates."""
    now, part, lasted = books[_TIME], i // 3, 0.0
    gives = books[_GIVEN + part] > _GIVES * books[_SIZE + part]
    counts = books[_SIZE + part] > ripple * _LEAST_SPEED[part] * _MEMORY
    if abs(swing) > ripple and swing * state[_TURN, i] <= 0.0:
        sign = math.copysign(1.0, swing)
        lasted = _goes_on(state[_TURN : _TURN + 3], i, sign, now, _NEXT_TURN, -1.0)
    is_found = lasted > _LONG and gives and counts
    force = state[_W, i]
    if abs(force) < _FREE * ripple:
        state[_IS_PRESSED, i] = 0.0
    elif abs(force) > _PRESSED * ripple and state[_IS_PRESSED, i] == 0.0:
        state[_IS_PRESSED, i], sign = 1.0, math.copysign(1.0, force)
        lasted = _goes_on(state[_PRESS : _PRESS + 3], i, sign, now, _NEXT_PRESS, 1.0)
        is_found = is_found or lasted > _LONG
    return is_found


@entry
def _observe(w: Input, v: Input, omega: Input, dt: float, ripple: Input, state: Rows) -> bool:
    """Take one sample, see :class:`ContactWatch`; return whether the contact oscillates."""
    books, left, found = state[_BOOKS], math.exp(-dt / _MEMORY), False
    quick, slow = 1.0 - math.exp(-dt / _NOISE), 1.0 - math.exp(-dt / _MEAN)
    if books[_TIME] == 0.0:
        quick = slow = 1.0
    books[_TIME] += max(dt, 1e-9)
    for i in range(6):
        part, speed = i // 3, v[i] if i < 3 else omega[i - 3]
        books[_ENERGY] -= w[i] * speed * dt
        state[_W, i] += quick * (w[i] - state[_W, i])
        state[_V, i] += quick * (speed - state[_V, i])
        state[_MEAN_W, i] += slow * (w[i] - state[_MEAN_W, i])
        state[_MEAN_V, i] += slow * (speed - state[_MEAN_V, i])
        swing = state[_W, i] - state[_MEAN_W, i]
        given = -swing * (state[_V, i] - state[_MEAN_V, i]) * dt
        if i % 3 == 0:
            books[_GIVEN + part] *= left
            books[_SIZE + part] *= left
        books[_GIVEN + part] += given
        books[_SIZE + part] += abs(given)
        found = _is_told(i, swing, ripple[part], books, state) or found
    return found
