"""The compliant frame: what the contact makes of the desired frame, section V.

The translational (52) and the rotational impedance (55), (59) are integrated on the state
relative to the desired frame, by Runge-Kutta's method of order 4 with the wrench interpolated
between its samples.

Notation: ``x`` (3,) [m] translational displacement in the frame chosen, ``s`` = (x, dx), ``y`` the
rotational state of the representation, driven by ``u``; ``f, mu`` [N, Nm] wrench of the environment
on the end effector, about the origin of the frames; base frame if not said otherwise.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws.impedance_change import between, later
from eulerparams_control.laws.impedance_matrices import Impedance, Matrices
from eulerparams_control.laws.jit import b1, f8, i8, jit, matrix, new_vector, vector
from eulerparams_control.laws.limits import POSITION_RATE
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array, cross, dot, exp, inverse, log, norm, turn
from eulerparams_control.motion.frames import DesiredFrame, jumped

TRANSLATIONAL_FRAMES = ("base", "desired")

# The faster of both impedances [1/s]: beyond it a step at 1 kHz would have to be split too often.
MAX_RATE = 1000.0

# Product of rate and step that Runge-Kutta's method integrates well.
_STEP = 0.5

# Of the energy that is left a tick of a change takes this part: what it takes is not linear in s.
_CAUTION = 0.9

STOP_TIME = 0.05
"""A frozen compliant frame comes to rest with this time constant [s], a fast one later."""

# A tank with no more than this part of its most is empty.
_EMPTY = 0.01

type State = tuple[Array, Array, Array, Array]
"""s, y and what drives them: f in the axes of x, u as the representation takes it."""


def impedance_rates(
    state: State, orientation: OrientationRepresentation, Z_p: Matrices, Z_o: Matrices
) -> tuple[Array, Array]:
    """Return ds and dy of the impedance equations (52), and (55) or (59).

    Z_p and Z_o are M^-1, D, K, the latter in the coordinates of the representation.
    """
    s, y, f, u = state
    ds = translational_rate(s, f, *Z_p)  # (52)
    dy = orientation.state_rate(y, u, Z_o)  # (55), (59)
    return ds, dy


@jit(new_vector(vector, vector, matrix, matrix, matrix))
def translational_rate(s: Array, f: Array, M_inverse: Array, D: Array, K: Array) -> Array:
    """Return ds of M_p ddx + D_p dx + K_p x = f, eq. (52)."""
    x, dx, ds = s[:3], s[3:], np.empty(6)
    ds[:3] = dx
    ds[3:] = turn(M_inverse, f - turn(D, dx) - turn(K, x))  # (52)
    return ds


@jit(new_vector(vector, vector, vector, vector, vector, f8))
def _stepped(y: Array, k_1: Array, k_2: Array, k_3: Array, k_4: Array, h: float) -> Array:
    """Return y after a step of order 4 (Runge, Kutta)."""
    return y + (h / 6.0) * (k_1 + 2.0 * (k_2 + k_3) + k_4)


@jit(new_vector(vector, vector, vector, f8, i8, matrix, matrix, matrix))
def translated(
    s: Array, f_0: Array, f_1: Array, dt: float, n: int, M_inverse: Array, D: Array, K: Array
) -> Array:
    """Return s dt [s] later by n steps, f going from f_0 to f_1."""
    h, df, s, f = dt / n, (f_1 - f_0) / n, s.copy(), f_0.copy()
    for _ in range(n):
        middle, end = f + 0.5 * df, f + df
        k_1 = translational_rate(s, f, M_inverse, D, K)
        k_2 = translational_rate(s + (0.5 * h) * k_1, middle, M_inverse, D, K)
        k_3 = translational_rate(s + (0.5 * h) * k_2, middle, M_inverse, D, K)
        k_4 = translational_rate(s + h * k_3, end, M_inverse, D, K)
        s, f = _stepped(s, k_1, k_2, k_3, k_4, h), end
    return s


@jit(b1(vector, matrix, vector, vector, vector, vector, vector))
def _are_finite(
    p: Array, R: Array, dp: Array, omega: Array, ddp: Array, domega: Array, w: Array
) -> bool:
    """Return whether the squares of all numbers are finite."""
    squares = (R * R).sum() + (w * w).sum()
    for v in (p, dp, omega, ddp, domega):
        squares += dot(v, v)
    return math.isfinite(squares)


@dataclass(frozen=True)
class ComplianceLaw:
    """The impedance equations (52) and (55), (59) with their parameters.

    Attributes:
        frame: whose axes M_p, D_p and K_p refer to, "base" or "desired".
        bounds: [m], [rad], [m/s, rad/s] of the displacement and its speed; pi or more is no bound.
        max_rate: [1/s] of the faster impedance.

    Raises:
        ConfigurationError: if the impedance is too fast, or has no form in the representation.
    """

    orientation: OrientationRepresentation
    translation: Impedance
    rotation: Impedance
    frame: str = "base"
    bounds: tuple[float, float, float] = (math.inf,) * 3
    max_rate: float = field(default=MAX_RATE, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.frame not in TRANSLATIONAL_FRAMES:
            raise UnknownNameError("translational_frame", self.frame, TRANSLATIONAL_FRAMES)
        self.orientation.impedance(self.rotation)  # raises where there is none
        for name, Z in (("_p", self.translation), ("_o", self.rotation)):
            if Z.rate > self.max_rate:
                raise ConfigurationError(
                    f"M{name} is too small for D{name} or K{name}: the impedance moves at "
                    f"{Z.rate:.4g} 1/s; at most {self.max_rate:g} 1/s is possible: raise M{name}"
                )

    @cached_property
    def impedances(self) -> tuple[Impedance, Impedance]:
        """That of the translation, and that of the rotation in the coordinates of its state."""
        return self.translation, self.orientation.impedance(self.rotation)

    @cached_property
    def rate(self) -> float:
        """The largest rate [1/s] of both impedances."""
        return max(self.translation.rate, self.rotation.rate)

    def damped(self, times: float) -> "ComplianceLaw":
        """Return the law with so many times its damping; raises ConfigurationError."""
        Z_p, Z_o = (replace(Z, D=times * Z.D) for Z in (self.translation, self.rotation))
        return replace(self, translation=Z_p, rotation=Z_o)

    def stiffness(self, R_d: Array) -> Array:
        """Return K_p (3, 3) [N/m] in the base frame, where the desired orientation is R_d."""
        K = self.translation.K
        return K if self.frame == "base" else R_d @ K @ R_d.T


class CompliantFrame:
    """The compliant frame with its state, relative to the desired frame.

    Attributes:
        law: the equations; those that a change leads to while one is under way.
        changed: how far a change of the impedance is, s from 0 to 1.
        energy_left: [J] that changes of the impedance may add, beside what the damping takes, up
            to ``tank``.
        now: the compliant frame of the last step; None before the first.
    """

    def __init__(self, law: ComplianceLaw, tank: float = math.inf) -> None:
        self.law = self._before = law
        self.tank = tank
        self.reset()

    @property
    def law_now(self) -> ComplianceLaw:
        """The equations of now; on the way of a change they may be twice as fast, (IC3)."""
        s, before, law = self.changed, self._before, self.law
        if s == 1.0:
            return law
        Z_p = Impedance(*between(s, before.translation, law.translation))
        Z_o = Impedance(*between(s, before.rotation, law.rotation))
        return replace(law, translation=Z_p, rotation=Z_o, max_rate=2.0 * MAX_RATE)

    @property
    def waits(self) -> bool:
        """Whether a change of the impedance waits for energy."""
        return self.changed < 1.0 and self.energy_left <= _EMPTY * self.tank

    def reset(self) -> None:
        """Forget the state; a change is done, and its tank full."""
        self.changed, self.energy_left = 1.0, self.tank
        self.now: DesiredFrame | None = None
        # of the last step, as far as the next one begins from more than the compliant frame:
        self._desired: DesiredFrame | None = None
        self._wrench: Array | None = None
        self._state: State | None = None

    def change(self, law: ComplianceLaw) -> None:
        """Go on by another law from the same frame and velocities.

        The impedance changes smoothly, and as far as there is energy for it.
        """
        before = replace(
            self.law_now, orientation=law.orientation, frame=law.frame, bounds=law.bounds
        )
        old, new = ([Z.values for Z in one.impedances] for one in (before, law))
        is_done = self.now is None or np.array_equal(old, new)
        self.law, self._before, self.changed = law, before, 1.0 if is_done else 0.0
        self._state = None

    def begin(self, desired: DesiredFrame | None, frame: DesiredFrame) -> None:
        """Set the compliant frame and its velocities, and the desired one, if that is known."""
        self.now, self._desired, self._state = frame, desired, None

    def rearrange(self) -> None:
        """Go on from the same frame and velocities: what drives it means something else now."""
        self._state = self._wrench = None

    def freeze(self, dt: float, actual: DesiredFrame, T: float = STOP_TIME) -> DesiredFrame:
        """Return the frame dt [s] later, coming to rest from the last, or at that of ``actual``."""
        p, R, dp, omega, _, _ = actual.at_rest() if self.now is None else self.now
        left = math.exp(-dt / T)
        gone = T * (1.0 - left)  # the way [s] of a velocity that decays
        v, w = left * dp, left * omega
        R_c = exp(gone * omega) @ R
        self.now = DesiredFrame(p + gone * dp, R_c, v, w, (-1.0 / T) * v, (-1.0 / T) * w)
        self._desired = self._wrench = self._state = None
        return self.now

    def step(
        self,
        dt: float,
        desired: DesiredFrame,
        wrench: Array,
        freed: Callable[[Matrices], Matrices] | None = None,
        rate: float = 0.0,
    ) -> DesiredFrame:
        """Return the compliant frame dt [s] after the last, with velocities and accelerations.

        Args:
            dt: 0 or more.
            desired, wrench: now; the latter (6,) f, mu in the base frame.
            freed: what changes M_p^-1, D_p, K_p, to the rate [1/s].

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        law, (start, before) = self.law, self._origin(dt, desired)
        Z_p, Z_o, own_rate = self._matrices(dt)
        if freed is not None:
            Z_p, own_rate = freed(Z_p), max(own_rate, rate)
        if self._state is None:
            s, y = self._relative(before, start)
            if not math.isfinite(y @ y):
                raise SingularityError(law.orientation.singularity)
            f_0, u_0 = self._driven(before, wrench if self._wrench is None else self._wrench, None)
        else:
            s, y, f_0, u_0 = self._state
        f, u = self._driven(desired, wrench, u_0)
        if dt > 0.0:
            n = max(1, math.ceil(own_rate * dt / _STEP))
            s = translated(s, f_0, f, dt, n, *Z_p)
            y = self._turned(y, u_0, u, dt, n, Z_o)
            if not math.isfinite(s @ s + y @ y):
                raise SingularityError("the motion of the compliant frame is not finite")
        state = s, y, f, u
        now = driven = self._absolute(state, desired, Z_p, Z_o)
        if dt > 0.0:
            now = _bounded(driven, desired, start, before, dt, law.bounds)
        if not _are_finite(*now, u):
            raise SingularityError(law.orientation.singularity)
        self._state = state if now is driven else None
        self.now, self._desired, self._wrench = now, desired, wrench
        return now

    def _origin(self, dt: float, desired: DesiredFrame) -> tuple[DesiredFrame, DesiredFrame]:
        """Return the compliant and the desired frame dt [s] ago."""
        if self.now is None:
            return desired, desired
        if self._desired is None or jumped(self._desired, desired, dt):
            self._state = None
            return self.now, desired.moved(-dt)  # as if it had come from there
        return self.now, self._desired

    def _turned(self, y: Array, u_0: Array, u_1: Array, dt: float, n: int, Z_o: Matrices) -> Array:
        """Return y dt [s] later as :func:`translated`, u going from u_0 to u_1."""
        rate, normalised = self.law.orientation.state_rate, self.law.orientation.normalised
        h, du, u = dt / n, (u_1 - u_0) / n, u_0
        for _ in range(n):
            middle, end = u + 0.5 * du, u + du
            k_1 = rate(y, u, Z_o)
            k_2 = rate(y + (0.5 * h) * k_1, middle, Z_o)
            k_3 = rate(y + (0.5 * h) * k_2, middle, Z_o)
            k_4 = rate(y + h * k_3, end, Z_o)
            y, u = normalised(_stepped(y, k_1, k_2, k_3, k_4, h)), end
        return y

    def _relative(self, desired: DesiredFrame, frame: DesiredFrame) -> tuple[Array, Array]:
        """Return s, y of a compliant frame."""
        x = frame.p_d - desired.p_d
        dx = frame.dp_d - desired.dp_d
        if self.law.frame != "base":
            R = desired.R_d
            x, dx = R.T @ x, R.T @ (dx - cross(desired.omega_d, x))
        y = self.law.orientation.relative_state(
            desired.R_d, desired.omega_d, frame.R_d, frame.omega_d
        )
        return np.concatenate((x, dx)), y

    def _driven(
        self, desired: DesiredFrame, wrench: Array, u_0: Array | None
    ) -> tuple[Array, Array]:
        """Return f, u of a wrench, after ``u_0`` of the last step."""
        f, mu, R_d = wrench[:3], wrench[3:], desired.R_d
        if self.law.frame != "base":
            f = R_d.T @ f
        return f, self.law.orientation.relative_input(R_d, mu, u_0)

    def _absolute(
        self, state: State, desired: DesiredFrame, Z_p: Matrices, Z_o: Matrices
    ) -> DesiredFrame:
        """Return the compliant frame of a state: the inverse of :meth:`_relative`."""
        p_d, R_d, dp_d, omega_d, ddp_d, domega_d = desired
        (s, y, _, u), orientation = state, self.law.orientation
        ds, dy = impedance_rates(state, orientation, Z_p, Z_o)
        x, dx, ddx = s[:3], s[3:], ds[3:]
        if self.law.frame != "base":  # components in a frame that turns
            x, dx, ddx = R_d @ x, R_d @ dx, R_d @ ddx
            turning = cross(omega_d, x)
            ddx = ddx + cross(domega_d, x) + cross(omega_d, turning + 2.0 * dx)
            dx = dx + turning
        R_c, omega_c, domega_c = orientation.compliant_rotation(y, dy, u, R_d, omega_d, domega_d)
        return DesiredFrame(p_d + x, R_c, dp_d + dx, omega_c, ddp_d + ddx, domega_c)

    # --- changes of the impedance -------------------------------------------------------------

    def _matrices(self, dt: float) -> tuple[Matrices, Matrices, float]:
        """Return Z_p, Z_o and their rate [1/s], dt [s] after the last step."""
        is_over = self.changed == 1.0 and self.energy_left == self.tank
        if not is_over and self.now is not None and self._desired is not None:
            self._go_on(dt, self.now, self._desired)
        law, before = self.law, self._before
        if self.changed == 1.0:
            Z_p, Z_o = law.impedances
            return Z_p.values, Z_o.values, law.rate
        (M_p, D_p, K_p), (M_o, D_o, K_o) = self._changed_to(self.changed)
        rate = 2.0 * max(law.rate, before.rate)  # (IC3)
        return Matrices(inverse(M_p), D_p, K_p), Matrices(inverse(M_o), D_o, K_o), rate

    def _changed_to(self, s: float) -> Iterable[tuple[Array, Array, Array]]:
        """Return M, D, K of both impedances where a change is at s."""
        return map(between, (s, s), self._before.impedances, self.law.impedances)

    def _go_on(self, dt: float, now: DesiredFrame, desired: DesiredFrame) -> None:
        """Let the change go on by dt [s], as far as there is energy for it, (IC1), (IC5)."""
        s, y = self._relative(desired, now)
        x, dx, dy = s[:3], s[3:], y[-3:]

        def energy_and_power(at: float) -> tuple[float, float]:
            """Return the energy [J] (IC4), and the power [W] of the damping."""
            (M_p, D_p, K_p), (M_o, D_o, K_o) = self._changed_to(at)
            moving = float(dx @ M_p @ dx + dy @ M_o @ dy + x @ K_p @ x) / 2.0
            turned = self.law.orientation.spring(desired.R_d, now.R_d, K_o)
            return moving + turned.energy, float(dx @ D_p @ dx + dy @ D_o @ dy)

        before, after = self.changed, later(self.changed, dt)  # (IC1)
        had, power = energy_and_power(before)
        left = min(self.tank, self.energy_left + dt * power)
        more = energy_and_power(after)[0] - had
        if more > left:  # as much as there is energy for
            after = before + max(0.0, _CAUTION * left / more) * (after - before)
            more = energy_and_power(after)[0] - had
        if not more <= left:  # or it is not finite
            after, more = before, 0.0
        self.changed, self.energy_left = after, min(self.tank, left - more)  # (IC5)


# --- bounds -----------------------------------------------------------------------------------


def _bounded(
    frame: DesiredFrame,
    desired: DesiredFrame,
    before: DesiredFrame,
    desired_before: DesiredFrame,
    dt: float,
    bounds: tuple[float, float, float],
) -> DesiredFrame:
    """Return the compliant frame within the bounds; itself where it is.

    Towards the bound X of the displacement x (3,) [m] or [rad] the velocity v relative to the
    desired frame is at most r (X - |x|): X is reached without overshoot, and v is continuous.
    """
    p_c, R_c, dp_c, omega_c, ddp_c, domega_c = frame
    position, rotation, speed = bounds
    rotation = rotation if rotation < math.pi else math.inf
    x, v, v_0 = p_c - desired.p_d, dp_c - desired.dp_d, before.dp_d - desired_before.dp_d
    is_slower = _bound(x, v, v_0, position, speed, dt)
    if is_slower:
        dp_c = desired.dp_d + v
        p_c = before.p_d + (dt / 2.0) * (before.dp_d + dp_c)
        ddp_c = (dp_c - before.dp_d) / dt
    x, v = log(R_c @ desired.R_d.T), omega_c - desired.omega_d
    v_0 = before.omega_d - desired_before.omega_d
    turns_slower = _bound(x, v, v_0, rotation, speed, dt)
    if turns_slower:
        omega_c = desired.omega_d + v
        R_c = exp((dt / 2.0) * (before.omega_d + omega_c)) @ before.R_d
        domega_c = (omega_c - before.omega_d) / dt
    if not (is_slower or turns_slower):
        return frame
    return DesiredFrame(p_c, R_c, dp_c, omega_c, ddp_c, domega_c)


@jit(b1(vector, new_vector, vector, f8, f8, f8))
def _bound(x: Array, v: Array, v_before: Array, most: float, speed: float, dt: float) -> bool:
    """Bound the velocity v at the displacement x, in place; return whether it was beyond."""
    rate = min(POSITION_RATE, 1.0 / dt)
    slower = rate * speed * dt  # by no more, where a bound was lowered
    size, distance = norm(v), norm(x)
    fastest = max(speed, norm(v_before) - slower)
    is_beyond = size > fastest
    if is_beyond:
        v *= fastest / size
    if distance > 0.0:
        away = x / distance
        allowed = max(rate * (most - distance), max(-speed, dot(v_before, away) - slower))
        excess = dot(v, away) - allowed
        if excess > 0.0:
            v -= excess * away
            is_beyond = True
    return is_beyond
