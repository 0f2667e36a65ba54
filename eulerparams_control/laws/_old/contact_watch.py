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

import numpy as np

from eulerparams_control.laws._old.compiled import Array, Input, Row, Rows, entry, kernel
from eulerparams_control.laws.contact_watch import Oscillation
from eulerparams_control.laws.impedance_matrices import Impedance

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

# Rows of the state, 6 numbers each: w and v without noise; their means; sign and time of the last
# turn, when turns began, and how many there were; the same of presses, and whether it is pressed;
# the books: energy, swinging power given and in size, of forces and of moments; time; at last what
# is expected: ripples of force and moment, and how far apart bounces may be.
_W, _V, _MEAN_W, _MEAN_V, _TURN, _PRESS, _IS_PRESSED, _BOOKS, _MOST = 0, 1, 2, 3, 4, 8, 12, 13, 14
_ENERGY, _GIVEN, _SIZE, _TIME = 0, 1, 3, 5
_APART = 2


class ContactWatch:
    """Observes the energy and the oscillation of a contact.

    Args:
        force, moment: [N], [Nm] ripple that a contact may have; infinite: none is too much.
        translation, rotation: the impedances, which say how far apart bounces may be.

    Attributes:
        state: rows of :func:`observe`, which moves them on.
    """

    def __init__(
        self, force: float, moment: float, translation: Impedance, rotation: Impedance
    ) -> None:
        self.state = np.zeros((_MOST + 1, 6))
        self.expect(force, moment, translation, rotation)
        self.reset()

    def expect(
        self, force: float, moment: float, translation: Impedance, rotation: Impedance
    ) -> None:
        """Go on with another law."""
        self.state[_MOST, :4] = force, moment, _gap(translation), _gap(rotation)

    def expect_changes(self) -> None:
        """Let only quick bounces count: a program swings the stiffness, and so the contact."""
        self.state[_MOST, _APART:] = _NEXT_PRESS

    def reset(self) -> None:
        """Start again: nothing was given."""
        self.state[:_MOST] = 0.0
        self.look_again()

    def look_again(self) -> None:
        """Look for an oscillation from the start again; the energy goes on."""
        self.state[_TURN:_BOOKS] = 0.0
        self.state[[_TURN + 1, _PRESS + 1]] = -math.inf
        self.state[_BOOKS, _GIVEN:_TIME] = 0.0

    def take(self, w: Array, v: Array, omega: Array, dt: float) -> Oscillation:
        """Return whether the contact oscillates.

        Where it does, that is looked for from the start again; the energy goes on.

        Args:
            w: (6,) contact, about the tip, base frame.
            v, omega: (3,) of the tip.
            dt: [s] since the last one.
        """
        found = Oscillation(observe(w, v, omega, dt, self.state))
        if found:
            self.look_again()
        return found

    @property
    def energy(self) -> float:
        """What the tool has given to the contact [J], less what it took, since the restart."""
        return self.state.item(_BOOKS, _ENERGY)


def _gap(Z: Impedance) -> float:
    """Return how far apart [s] bounces may be: a swing of the impedance."""
    slowest = float(np.linalg.eigvals(np.linalg.solve(Z.M, Z.K)).real.min())
    longest = (math.tau / _LONGEST_GAP) ** 2
    return max(_NEXT_PRESS, math.tau / math.sqrt(max(slowest, longest)))


@kernel
def _goes_on(run: Rows, i: int, sign: float, now: float, gap: float, same: float) -> float:
    """Take an event of axis i with a sign; return for how long [s] such have followed each other.

    Args:
        run: (4, 6) sign and time of the last one, when they began, and how many there were.
        i, sign, now, gap: the event, its time, and the longest time until it [s].
        same: 1 where the signs have to be the same, -1 where they have to differ.
    """
    if now - run[1, i] > gap or same * sign * run[0, i] < 0.0:
        run[2, i], run[3, i] = now, 0.0
    run[0, i], run[1, i], run[3, i] = sign, now, run[3, i] + 1.0
    lasted: float = now - run[2, i]
    return lasted


@kernel
def _found(i: int, swing: float, ripple: float, gap: float, books: Row, state: Rows) -> int:
    """Return what the force of axis i does, whose part that swings is given."""
    now, part, lasted = books[_TIME], i // 3, 0.0
    gives = books[_GIVEN + part] > _GIVES * books[_SIZE + part]
    counts = books[_SIZE + part] > ripple * _LEAST_SPEED[part] * _MEMORY
    if abs(swing) > ripple and swing * state[_TURN, i] <= 0.0:
        sign = math.copysign(1.0, swing)
        lasted = _goes_on(state[_TURN:_PRESS], i, sign, now, _NEXT_TURN, -1.0)
    found = 2 if lasted > _LONG and gives and counts else 0
    force = state[_W, i]
    if abs(force) < _FREE * ripple:
        state[_IS_PRESSED, i] = 0.0
    elif abs(force) > _PRESSED * ripple and state[_IS_PRESSED, i] == 0.0:
        state[_IS_PRESSED, i], sign = 1.0, math.copysign(1.0, force)
        is_quick = now - state[_PRESS + 1, i] <= _NEXT_PRESS
        lasted = _goes_on(state[_PRESS:_IS_PRESSED], i, sign, now, gap, 1.0)
        if lasted > _LONG and state[_PRESS + 3, i] >= _PRESSES:
            if gives and counts:
                found = 2
            elif is_quick:
                found = max(found, 1)
    return found


@entry
def observe(w: Input, v: Input, omega: Input, dt: float, state: Rows) -> int:
    """Take one sample, see :class:`ContactWatch`; return the :class:`Oscillation`."""
    books, most, left, found = state[_BOOKS], state[_MOST], math.exp(-dt / _MEMORY), 0
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
        found = max(found, _found(i, swing, most[part], most[_APART + part], books, state))
    return found
