"""The compliant frame: what the contact makes of the desired frame, section V.

The translational (52) and the rotational impedance (55), (59) are integrated on the state
relative to the desired frame, by Runge-Kutta's method of order 4 with the wrench interpolated
between its samples.

Notation: ``x`` (3,) [m] translational displacement in the frame chosen, ``y`` the rotational
state of the representation, ``f, mu`` [N, Nm] wrench of the environment on the end effector,
about the origin of the frames; base frame if not said otherwise.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws._old.compiled import (
    Array,
    Input,
    Row,
    entry,
    formula,
    kernel,
    layout,
    slot,
    template,
    to_rows,
)
from eulerparams_control.laws._old.linear import (
    MatLike,
    Vec,
    VecLike,
    cross,
    identity,
    put_vec,
    row,
)
from eulerparams_control.laws._old.matrices import Matrices
from eulerparams_control.laws._old.orientation import OrientationRepresentation, as_formulas
from eulerparams_control.laws._old.orientation.base import Coordinates
from eulerparams_control.laws._old.rotations import exp
from eulerparams_control.laws.compliance_bounds import ComplianceBounds, Most, bounded
from eulerparams_control.laws.impedance_change import (
    CHANGE_TIME,
    DONE,
    between,
    dip_of,
    elastic,
    impedance_between,
    kinetic,
)
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.motion.frames import (
    AT_ORIGIN,
    DesiredFrame,
    Placement,
    moved,
    put_frame,
    read_frame,
)
from eulerparams_control.motion.motion_limits import MotionLimits

TRANSLATIONAL_FRAMES = ("base", "desired")

# The faster of both impedances [1/s]: beyond it a step at 1 kHz would have to be split too often.
MAX_RATE = 1000.0

# Product of rate and step that Runge-Kutta's method integrates well.
_STEP = 0.5

# Of the energy that is left a tick of a change takes this part: what it takes is not linear in s.
_CAUTION = 0.9

STOP_TIME = 0.05
"""A frozen compliant frame comes to rest with this time constant [s], a fast one later."""

_LONGEST_STOP = 0.5  # the same, however low the accelerations are

# A tank with no more than this part of its most is empty.
_EMPTY = 0.01

# Deviation from its extrapolated motion [m, rad; m/s, rad/s] from which a desired frame has jumped.
_JUMP, _VELOCITY_JUMP = 1e-5, 1e-2

# What is known at a step: nothing, the compliant frame, the desired frame too, and the state.
_NOTHING, _FRAME, _FRAMES, _STATE = range(4)

# What a step finds.
_NOT_FINITE, _SINGULAR = 1, 2

begin = drive = rate = normalised = end = spring = slot  # of a representation
read_y = put_y = read_u = put_u = rates = integrate = driven = energy = slot  # that follow
y_width = 0


class LawNumbers(NamedTuple):
    """A law in numbers."""

    options: Coordinates
    translation: Matrices
    rotation: Matrices  # in the coordinates of the representation
    in_base: bool
    rate: float
    most: Most


class _Change(NamedTuple):
    """A change of the law under way: that of before, and the dips of K_p and K_o."""

    translation: Matrices
    rotation: Matrices
    rate: float
    dip_p: MatLike
    dip_o: MatLike


class _Tank(NamedTuple):
    """How far the change is, the energy [J] that is left for it, and the most there can be."""

    s: float
    energy: float
    most: float


class _Memory(NamedTuple):
    """What is known of the last step; its state z = (x, dx, y) and input v = (f, u) lie behind."""

    known: int
    is_felt: bool
    f: VecLike
    mu: VecLike
    now: DesiredFrame
    desired: DesiredFrame


_width, _read_memory, _put_memory = layout(_Memory)[:3]
_NOW, _DESIRED = slice(_width - 48, _width - 24), slice(_width - 24, _width)
_read_law, _put_law = layout(LawNumbers)[1:3]
_read_vec, _read_change = layout(Vec).read, layout(_Change).read
_read_tank, _put_tank = layout(_Tank).read, layout(_Tank).put


@dataclass(frozen=True)
class ComplianceLaw:
    """The impedance equations (52) and (55), (59) with their parameters.

    Attributes:
        orientation: the representation of the rotational displacement.
        translation: M_p, D_p, K_p.
        rotation: M_o, D_o, K_o.
        frame: whose axes M_p, D_p and K_p refer to, "base" or "desired".
        bounds: of the displacement and its speed.

    Raises:
        ConfigurationError: if the impedance is too fast, or has no form in the representation.
    """

    orientation: OrientationRepresentation
    translation: Impedance
    rotation: Impedance
    frame: str = "base"
    bounds: ComplianceBounds = field(default_factory=ComplianceBounds)

    def __post_init__(self) -> None:
        object.__setattr__(self, "orientation", as_formulas(self.orientation))
        if self.frame not in TRANSLATIONAL_FRAMES:
            raise UnknownNameError("translational_frame", self.frame, TRANSLATIONAL_FRAMES)
        Z_o = self.orientation.impedance(self.rotation)
        for name, Z in (("_p", self.translation), ("_o", self.rotation)):
            if Z.rate > MAX_RATE:
                raise ConfigurationError(
                    f"M{name} is too small for D{name} or K{name}: the impedance moves at "
                    f"{Z.rate:.4g} 1/s; at most {MAX_RATE:g} 1/s is possible: raise M{name}"
                )
        options, in_base = self.orientation.options.values, self.frame == "base"
        matrices = self.translation.values, Z_o.values
        numbers = LawNumbers(options, *matrices, in_base, self.rate, self.bounds.values)
        object.__setattr__(self, "numbers", to_rows(LawNumbers, numbers))
        object.__setattr__(self, "step", _step_of(type(self.orientation)))

    numbers: Array = field(init=False, repr=False, compare=False)
    step: Callable[..., int] = field(init=False, repr=False, compare=False)

    def damped(self, times: float) -> "ComplianceLaw":
        """Return the law with so many times its damping; raises ConfigurationError."""
        Z_p, Z_o = (replace(Z, D=times * Z.D) for Z in (self.translation, self.rotation))
        return replace(self, translation=Z_p, rotation=Z_o)

    def stiffness(self, R_d: Array) -> Array:
        """Return K_p (3, 3) [N/m] in the base frame, where the desired orientation is R_d."""
        K = self.translation.K
        return K if self.frame == "base" else R_d @ K @ R_d.T

    @property
    def rate(self) -> float:
        """The largest rate [1/s] of both impedances."""
        return max(self.translation.rate, self.rotation.rate)


# --- the equations -------------------------------------------------------------------------


def _rates(z: Input, v: Input, numbers: Input, dz: Row) -> None:
    """Fill dz, the rates of z driven by v."""
    law = _read_law(numbers, 0)
    Z, x, dx = law.translation, _read_vec(z, 0), _read_vec(z, 3)
    put_vec(dz, 0, dx)
    put_vec(dz, 3, Z.M_inverse @ (_read_vec(v, 0) - Z.D @ dx - Z.K @ x))  # eq. (52)
    put_y(dz, 6, rate(read_y(z, 6), read_u(v, 3), law.rotation, law.options))  # eqs. (55), (59)


def _integrate(z: Row, v_0: Input, v_1: Input, dt: float, numbers: Input) -> None:
    """Move z by dt [s] with steps of order 4 (Runge, Kutta), v going linearly from v_0 to v_1."""
    n = max(1, math.ceil(_read_law(numbers, 0).rate * dt / _STEP))
    h, between, v = dt / n, np.empty(len(z)), np.empty(len(v_0))
    dz, total = np.zeros(len(z)), np.empty(len(z))
    for i in range(n):
        total[:] = 0.0
        for stage in range(4):
            share = 0.5 * ((stage + 1) // 2)  # of the step: 0, 1/2, 1/2, 1
            for j in range(len(v)):
                v[j] = v_0[j] + (i + share) / n * (v_1[j] - v_0[j])
            for j in range(len(z)):
                between[j] = z[j] + share * h * dz[j]
            rates(between, v, numbers, dz)
            for j in range(len(z)):
                total[j] += dz[j] if stage % 3 == 0 else 2.0 * dz[j]
        for j in range(len(z)):
            z[j] += h / 6.0 * total[j]
        put_y(z, 6, normalised(read_y(z, 6)))


def _driven(frame: DesiredFrame, f: Vec, mu: Vec, before: Input, numbers: Input, v: Row) -> None:
    """Fill the input v of a desired frame and a wrench; ``before`` is that of the last step."""
    law = _read_law(numbers, 0)
    put_vec(v, 0, f if law.in_base else frame.R_d.T @ f)
    put_u(v, 3, drive(frame.R_d, mu, read_u(before, 3), law.options))


@kernel
def _square(z: Input) -> float:
    """Return z' z."""
    square = 0.0
    for value in z:
        square += value * value
    return square


@formula
def _jumped(before: DesiredFrame, now: DesiredFrame, dt: float) -> bool:
    """Return whether the desired frame is not where, or as fast as, its motion led."""
    half, bend = dt / 2.0, dt * dt / 12.0  # the trapezoidal rule with its first correction
    p = before.p_d + half * (before.dp_d + now.dp_d) - bend * (now.ddp_d - before.ddp_d)
    turn = half * (before.omega_d + now.omega_d) - bend * (now.domega_d - before.domega_d)
    dv = now.dp_d - before.dp_d - half * (before.ddp_d + now.ddp_d)
    domega = now.omega_d - before.omega_d - half * (before.domega_d + now.domega_d)
    dR = now.R_d - exp(turn) @ before.R_d
    turned = max(_largest(row(dR, 0)), max(_largest(row(dR, 1)), _largest(row(dR, 2))))
    jump, velocity_jump = max(_largest(now.p_d - p), turned), max(_largest(dv), _largest(domega))
    return not (jump <= _JUMP and velocity_jump <= _VELOCITY_JUMP)


@formula
def _largest(v: Vec) -> float:
    """Return the largest magnitude of the elements."""
    return max(abs(v.x), max(abs(v.y), abs(v.z)))


def _step(
    desired_row: Input, dt: float, wrench: Input, memory: Row, numbers: Input, frame: Row
) -> int:
    """Fill the compliant frame (24,) of a step; return what it finds, and then keep the memory."""
    law, known = _read_law(numbers, 0), _read_memory(memory, 0)
    desired = read_frame(desired_row, 0)
    put_frame(frame, 0, desired)
    if not math.isfinite(_square(frame) + 0.0 * _square(wrench)):
        return _NOT_FINITE
    behind = _width + 6 + y_width
    z, v_0, v_1 = memory[_width:behind].copy(), memory[behind:].copy(), memory[behind:].copy()
    start, before, begins = known.now, known.desired, known.known != _STATE
    if known.known == _NOTHING:
        start, before = desired, desired
    elif known.known == _FRAME or _jumped(before, desired, dt):
        before, begins = moved(desired, -dt), True  # as if it had come from there
    R, omega, domega = identity(1.0), Vec(0.0, 0.0, 0.0), Vec(0.0, 0.0, 0.0)
    f, mu = _read_vec(wrench, 0), _read_vec(wrench, 3)
    if begins:
        if not law.in_base:
            R, omega = before.R_d, before.omega_d
        x = start.p_d - before.p_d
        put_vec(z, 0, R.T @ x)
        put_vec(z, 3, R.T @ (start.dp_d - before.dp_d - cross(omega, x)))
        put_y(z, 6, begin(before.R_d, before.omega_d, start.R_d, start.omega_d, law.options))
        v_0[:] = 0.0
        if known.is_felt:
            driven(before, known.f, known.mu, v_0, numbers, v_0)
        else:
            driven(before, f, mu, v_0, numbers, v_0)
    if math.isnan(_square(z)):
        return _SINGULAR
    driven(desired, f, mu, v_0, numbers, v_1)
    if dt > 0.0:
        integrate(z, v_0, v_1, dt, numbers)
        if not math.isfinite(_square(z)):
            return _NOT_FINITE
    dz = np.empty(len(z))
    rates(z, v_1, numbers, dz)
    if not law.in_base:
        R, omega, domega = desired.R_d, desired.omega_d, desired.domega_d
    x, dx, ddx = R @ _read_vec(z, 0), R @ _read_vec(z, 3), R @ _read_vec(dz, 3)
    turning, y, dy = cross(omega, x), read_y(z, 6), read_y(dz, 6)
    rotation = end(
        y, dy, read_u(v_1, 3), desired.R_d, desired.omega_d, desired.domega_d, law.options
    )
    now = DesiredFrame(
        desired.p_d + x,
        rotation.R_c,
        desired.dp_d + dx + turning,
        rotation.omega_c,
        desired.ddp_d + ddx + cross(domega, x) + cross(omega, turning + 2.0 * dx),
        rotation.domega_c,
    )
    put_frame(frame, 0, now)
    if math.isnan(_square(frame)):
        return _SINGULAR
    has_state = _STATE
    if dt > 0.0:
        v_p, v_o = start.dp_d - before.dp_d, start.omega_d - before.omega_d
        now, is_less = bounded(now, desired, start, v_p, v_o, law.most, dt)
        if is_less:
            has_state = _FRAMES
            put_frame(frame, 0, now)
            if not math.isfinite(_square(frame)):
                return _NOT_FINITE
    _put_memory(memory, 0, _Memory(has_state, True, f, mu, now, desired))
    memory[_width:behind], memory[behind:] = z, v_1
    return 0


def _energy(memory: Input, Z_p: Matrices, Z_o: Matrices, law: LawNumbers, y: Row) -> float:
    """Return the energy [J] of the displacement as it is, (IC4); fill y (y_width,)."""
    known = _read_memory(memory, 0)
    now, desired = known.now, known.desired
    x, dx = now.p_d - desired.p_d, now.dp_d - desired.dp_d
    if not law.in_base:
        R = desired.R_d
        x, dx = R.T @ x, R.T @ (dx - cross(desired.omega_d, x))
    put_y(y, 0, begin(desired.R_d, desired.omega_d, now.R_d, now.omega_d, law.options))
    put_vec(y, y_width, dx)
    moving = kinetic(Z_p, dx) + kinetic(Z_o, _read_vec(y, y_width - 3))
    return moving + elastic(Z_p, x) + spring(desired.R_d, now.R_d, Z_o.K, law.options).energy


def _go_on(
    memory: Input, change: Input, numbers: Input, dt: float, tank: Row, changed: Row
) -> None:
    """Fill the numbers of a law on the way to those that are given, dt [s] after the last."""
    law, way, of = _read_law(numbers, 0), _read_change(change, 0), _read_tank(tank, 0)
    s, left, y = of.s, of.energy, np.zeros(y_width + 3)
    if _read_memory(memory, 0).known > _FRAME:  # else the displacement is not known
        Z_p = between(s, way.translation, law.translation, way.dip_p)
        Z_o = between(s, way.rotation, law.rotation, way.dip_o)
        before = energy(memory, Z_p, Z_o, law, y)
        dx, dy = _read_vec(y, y_width), _read_vec(y, y_width - 3)
        left = min(of.most, left + dt * (dx @ (Z_p.D @ dx) + dy @ (Z_o.D @ dy)))
        s = 1.0 - (1.0 - s) * math.exp(-dt / CHANGE_TIME)  # (IC1)
        s = s if s < 1.0 - DONE else 1.0
        for _ in range(2):  # all of it, or as much as there is energy for
            Z_p = between(s, way.translation, law.translation, way.dip_p)
            Z_o = between(s, way.rotation, law.rotation, way.dip_o)
            more = energy(memory, Z_p, Z_o, law, y) - before
            if more > left:
                s = of.s + max(0.0, _CAUTION * left / more) * (s - of.s)
        if not more <= left:  # or it is not finite
            s, more = of.s, 0.0
        left = min(of.most, left - more)  # (IC5)
    _put_tank(tank, 0, _Tank(s, left, of.most))
    Z_p = between(s, way.translation, law.translation, way.dip_p)
    Z_o = between(s, way.rotation, law.rotation, way.dip_o)
    rate = max(law.rate, way.rate)
    now = LawNumbers(law.options, Z_p, Z_o, law.in_base, rate, law.most)
    _put_law(changed, 0, now)


@cache
def _go_on_of(kind: type[OrientationRepresentation]) -> Callable[..., None]:
    """Return how the law of a representation goes over to another."""
    y, name = layout(kind.compliance.begin.result), kind.identifier()
    slots = {"begin": kind.compliance.begin, "spring": kind.spring, "y_width": y.width}
    slots["put_y"] = y.put
    slots["energy"] = kernel(template(_energy, f"{name}_energy", **slots))
    return entry(template(_go_on, f"{name}_go_on", **slots))


@cache
def _step_of(kind: type[OrientationRepresentation]) -> Callable[..., int]:
    """Return the step of a representation."""
    slots, name = kind.compliance._asdict(), kind.identifier()
    y, u = layout(kind.compliance.begin.result), layout(kind.compliance.drive.result)
    slots |= {"read_y": y.read, "put_y": y.put, "read_u": u.read, "put_u": u.put}
    slots |= {"y_width": y.width}
    for made, function in (("rates", _rates), ("integrate", _integrate), ("driven", _driven)):
        slots[made] = kernel(template(function, f"{name}_{made}", **slots))
    return entry(template(_step, f"{name}_step", **slots))


@entry
def _freeze(before: Input, dt: float, T: float, frame: Row) -> None:
    """Fill the frame (24,) that comes to rest with the time constant T [s], dt [s] later."""
    p, R, dp, omega, _, _ = read_frame(before, 0)
    left = math.exp(-dt / T)
    gone = T * (1.0 - left)  # the way [s] of a velocity that decays
    rates = left * dp, left * omega
    a, alpha = (-1.0 / T) * rates[0], (-1.0 / T) * rates[1]
    put_frame(frame, 0, DesiredFrame(p + gone * dp, exp(gone * omega) @ R, *rates, a, alpha))


class CompliantFrame:
    """The compliant frame with its state, relative to the desired frame.

    Args:
        law: its equations.
        tank: the energy [J] that changes of the impedance may add, beside what the damping takes.

    Attributes:
        row: (24,) the compliant frame of the last step; None before the first.
    """

    def __init__(self, law: ComplianceLaw, tank: float = math.inf) -> None:
        self._law = self._before = law
        self._tank = to_rows(_Tank, _Tank(1.0, tank, tank))
        self._change, self._changed = np.zeros(layout(_Change).width), law.numbers.copy()
        self.reset()

    @property
    def now(self) -> DesiredFrame | None:
        """The compliant frame of the last step; None before the first."""
        return None if self.row is None else DesiredFrame.of(self.row)

    @property
    def law(self) -> ComplianceLaw:
        """The equations; those that a change leads to while one is under way."""
        return self._law

    @property
    def law_now(self) -> ComplianceLaw:
        """The equations of now."""
        s, before, law = self.changed, self._before, self._law
        if s == 1.0:
            return law
        translation = impedance_between(before.translation, law.translation, s)
        return replace(law, translation=translation, rotation=impedance_between(
            before.rotation, law.rotation, s))  # fmt: skip

    @property
    def changed(self) -> float:
        """How far a change of the impedance is, s from 0 to 1."""
        return self._tank.item(0)

    @property
    def energy_left(self) -> float:
        """The energy [J] that is left for changes of the impedance."""
        return self._tank.item(1)

    @property
    def waits(self) -> bool:
        """Whether a change of the impedance waits for energy."""
        s, left, most = self._tank.tolist()
        return s < 1.0 and left <= _EMPTY * most

    def limit_energy(self, tank: float) -> None:
        """Bound the energy [J] of changes from now on; what is there stays, as far as it fits."""
        self._tank[1:] = min(self._tank[1], tank) if tank < self._tank[2] else self._tank[1], tank

    def reset(self) -> None:
        """Forget the state; a change is done, and its tank full."""
        self._tank[:2] = 1.0, self._tank[2]
        self.row: Array | None = None
        kinds = self._law.orientation.compliance
        widths = (layout(of.result).width for of in (kinds.begin, kinds.drive))
        self._memory = np.zeros(_width + 6 + 3 + sum(widths))

    def replace_law(
        self, law: ComplianceLaw, moved: tuple[Placement, Placement] = (AT_ORIGIN, AT_ORIGIN)
    ) -> None:
        """Go on with other equations from the same frame and velocities.

        Args:
            law: the equations.
            moved: placements by which the centre of compliance moves, one after the other.
        """
        now, felt, left = self.now, self._memory[1 : _NOW.start], self._tank[1]
        self._law = law
        self.reset()
        self._memory[1 : _NOW.start], self._tank[1] = felt, left
        if now is not None:  # the state is recomputed from the frames
            self._set(_FRAME, now.carrying(moved[0]).carrying(moved[1]).row)

    def change_impedance(self, law: ComplianceLaw) -> None:
        """Go over to another impedance, smoothly, and as far as there is energy for it.

        Args:
            law: with the same representation and translational frame.
        """
        before = self.law_now
        Z_p, Z_o, to = before.translation, before.rotation, before.orientation
        if self.row is None or np.array_equal(before.numbers, law.numbers):
            self.replace_law(law)
            return
        dip_o = replace(Z_o, K=dip_of(Z_o.K, law.rotation.K))
        matrices = Z_p.values, to.impedance(Z_o).values
        dips = dip_of(Z_p.K, law.translation.K), to.impedance(dip_o).K
        self._change = to_rows(_Change, _Change(*matrices, before.rate, *dips))
        self._law, self._before, self._tank[0] = law, before, 0.0

    def begin(self, desired: DesiredFrame, frame: DesiredFrame) -> None:
        """Set the compliant frame and its velocities."""
        self._memory[_DESIRED] = desired.row
        self._set(_FRAMES, frame.row)

    def _set(self, known: int, row: Array) -> None:
        self.row, self._memory[0] = row, known
        self._memory[_NOW] = row

    def stop_time(self, motion: MotionLimits | None) -> float:
        """Return the time constant [s] with which it comes to rest now.

        So it brakes by the accelerations of the tip, at last by STOP_TIME; but not for long: what
        is in its way is not felt.
        """
        if self.now is None or motion is None:
            return STOP_TIME
        by_limits = motion.stop_time(self.now.dp_d, self.now.omega_d)
        return max(STOP_TIME, min(by_limits, _LONGEST_STOP))

    def freeze(self, dt: float, actual: DesiredFrame, T: float = STOP_TIME) -> DesiredFrame:
        """Return the compliant frame, which comes to rest until the next step.

        Args:
            dt: [s] after the last.
            actual: its first pose, if it has none yet.
            T: time constant [s].
        """
        if self.row is None:
            self._set(_FRAME, actual.at_rest().row)
        row = np.empty(24)
        _freeze(self._memory[_NOW], dt, T, row)
        now = DesiredFrame.of(row)
        self._memory[1] = False
        self._set(_FRAME, row)  # the next step begins from here
        return now

    def rearrange(self) -> None:
        """Go on from the same frame and velocities: what drives it means something else now."""
        if self.row is not None:
            self._memory[1] = False
            self._set(_FRAMES, self.row)

    def step(
        self,
        dt: float,
        desired: DesiredFrame,
        wrench: Array,
        along: Callable[[Array], Array] | None = None,
    ) -> DesiredFrame:
        """Return the compliant frame dt [s] after the last, with velocities and accelerations.

        Args:
            dt: 0 or more.
            desired: the desired frame now.
            wrench: (6,) f, mu now, base frame.
            along: what becomes of the :class:`LawNumbers` in a row; None: nothing.

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        return DesiredFrame.of(self.step_row(dt, desired.row, wrench, along))

    def step_row(
        self,
        dt: float,
        desired: Array,
        wrench: Array,
        along: Callable[[Array], Array] | None = None,
    ) -> Array:
        """Return the same as a row (24,), for a desired frame in one; see :meth:`step`."""
        row = np.empty(24)
        numbers = self._law.numbers
        s, left, most = self._tank.tolist()
        if s < 1.0 or left < most:
            go_on = _go_on_of(type(self._law.orientation))
            go_on(self._memory, self._change, numbers, dt, self._tank, self._changed)
            numbers = self._changed
        numbers = along(numbers) if along else numbers
        found = self._law.step(desired, dt, wrench, self._memory, numbers, row)
        if found == _SINGULAR:
            raise SingularityError(self._law.orientation.singularity)
        if found:
            raise SingularityError("the motion of the compliant frame is not finite")
        self.row = row
        return row
