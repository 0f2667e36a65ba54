"""The compliant frame: what the contact makes of the desired frame, section V.

The translational (52) and the rotational impedance (55), (59) are integrated on the state
relative to the desired frame, by Runge-Kutta's method of order 4 with the wrench interpolated
between its samples.

Notation: ``x`` (3,) [m] translational displacement in the frame chosen, ``y`` the rotational
state of the representation, ``f, mu`` [N, Nm] wrench of the environment on the end effector,
about the origin of the frames; base frame if not said otherwise.  ``z`` = (x, dx, y) is driven by
``v`` = (f, u), u that of the representation.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws.compliance_bounds import ComplianceBounds
from eulerparams_control.laws.impedance_change import (
    CHANGE_TIME,
    DONE,
    between,
    dip_of,
    elastic,
    impedance_between,
    kinetic,
)
from eulerparams_control.laws.impedance_matrices import Impedance, Matrices
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array, cross, exp
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame, Placement, jumped
from eulerparams_control.motion.motion_limits import MotionLimits

TRANSLATIONAL_FRAMES = ("base", "desired")

# The faster of both impedances [1/s]: beyond it a step at 1 kHz would have to be split too often.
MAX_RATE = 1000.0

# The same on the way from one impedance to another, (IC3).
_ON_THE_WAY = 2.0 * MAX_RATE

# Product of rate and step that Runge-Kutta's method integrates well.
_STEP = 0.5

# Of the energy that is left a tick of a change takes this part: what it takes is not linear in s.
_CAUTION = 0.9

STOP_TIME = 0.05
"""A frozen compliant frame comes to rest with this time constant [s], a fast one later."""

_LONGEST_STOP = 0.5  # the same, however low the accelerations are

# A tank with no more than this part of its most is empty.
_EMPTY = 0.01


def impedance_rates(
    z: Array, v: Array, orientation: OrientationRepresentation, Z_p: Matrices, Z_o: Matrices
) -> Array:
    """Return dz of the impedance equations (52), (55) or (59).

    Args:
        z: (x, dx, y), the displacement of the compliant from the desired frame.
        v: (f, u), the contact, in the axes of x and as the representation takes it.
        orientation: (55) with Euler angles, (59) with Euler parameters, or another.
        Z_p: M_p^-1, D_p, K_p.
        Z_o: M_o^-1, D_o, K_o in the coordinates of the representation.
    """
    x, dx, y = z[:3], z[3:6], z[6:]
    f, u = v[:3], v[3:]
    ddx = Z_p.M_inverse @ (f - Z_p.D @ dx - Z_p.K @ x)  # (52)
    dy = orientation.state_rate(y, u, Z_o)  # (55), (59)
    return np.concatenate((dx, ddx, dy))


@dataclass(frozen=True)
class ComplianceLaw:
    """The impedance equations (52) and (55), (59) with their parameters.

    Attributes:
        orientation: the representation of the rotational displacement.
        translation: M_p, D_p, K_p.
        rotation: M_o, D_o, K_o.
        frame: whose axes M_p, D_p and K_p refer to, "base" or "desired".
        bounds: of the displacement and its speed.
        max_rate: [1/s] of the faster impedance.
        Z_p, Z_o: the matrices, the rotational ones in the coordinates of the representation.

    Raises:
        ConfigurationError: if the impedance is too fast, or has no form in the representation.
    """

    orientation: OrientationRepresentation
    translation: Impedance
    rotation: Impedance
    frame: str = "base"
    bounds: ComplianceBounds = field(default_factory=ComplianceBounds)
    max_rate: float = field(default=MAX_RATE, repr=False, compare=False)
    Z_p: Matrices = field(init=False, repr=False, compare=False)
    Z_o: Matrices = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.frame not in TRANSLATIONAL_FRAMES:
            raise UnknownNameError("translational_frame", self.frame, TRANSLATIONAL_FRAMES)
        object.__setattr__(self, "Z_p", self.translation.values)
        object.__setattr__(self, "Z_o", self.orientation.impedance(self.rotation).values)
        for name, Z in (("_p", self.translation), ("_o", self.rotation)):
            if Z.rate > self.max_rate:
                raise ConfigurationError(
                    f"M{name} is too small for D{name} or K{name}: the impedance moves at "
                    f"{Z.rate:.4g} 1/s; at most {self.max_rate:g} 1/s is possible: raise M{name}"
                )

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

    def is_like(self, other: "ComplianceLaw") -> bool:
        """Whether both have the same equations, numbers and bounds."""
        matrices = zip((*self.Z_p, *self.Z_o), (*other.Z_p, *other.Z_o), strict=True)
        rest = (self.orientation, self.frame, self.bounds)
        is_same = rest == (other.orientation, other.frame, other.bounds)
        return is_same and all(np.array_equal(one, another) for one, another in matrices)


class _Known(IntEnum):
    """What is known of the last step."""

    NOTHING = 0
    FRAME = 1  # the compliant frame
    FRAMES = 2  # and the desired frame
    STATE = 3  # and z


class CompliantFrame:
    """The compliant frame with its state, relative to the desired frame.

    Args:
        law: its equations.
        tank: the energy [J] that changes of the impedance may add, beside what the damping takes.

    Attributes:
        law: the equations; those that a change leads to while one is under way.
        changed: how far a change of the impedance is, s from 0 to 1.
        energy_left: the energy [J] that is left for changes of the impedance.
        now: the compliant frame of the last step; None before the first.
    """

    energy_left: float

    def __init__(self, law: ComplianceLaw, tank: float = math.inf) -> None:
        self.law = self._before = law
        self._dips, self._most_energy = (np.zeros((3, 3)), np.zeros((3, 3))), tank
        self.reset()

    @property
    def law_now(self) -> ComplianceLaw:
        """The equations of now; on the way of a change they may be twice as fast, (IC3)."""
        s, before, law = self.changed, self._before, self.law
        if s == 1.0:
            return law
        translation = impedance_between(before.translation, law.translation, s)
        rotation = impedance_between(before.rotation, law.rotation, s)
        return replace(law, translation=translation, rotation=rotation, max_rate=_ON_THE_WAY)

    @property
    def waits(self) -> bool:
        """Whether a change of the impedance waits for energy."""
        return self.changed < 1.0 and self.energy_left <= _EMPTY * self._most_energy

    def limit_energy(self, tank: float) -> None:
        """Bound the energy [J] of changes from now on; what is there stays, as far as it fits."""
        if tank < self._most_energy:
            self.energy_left = min(self.energy_left, tank)
        self._most_energy = tank

    def reset(self) -> None:
        """Forget the state; a change is done, and its tank full."""
        self.changed = 1.0
        self.energy_left = self._most_energy
        self.now: DesiredFrame | None = None
        self._desired: DesiredFrame | None = None
        self._known = _Known.NOTHING
        self._wrench: Array | None = None  # of the last step
        self._z, self._v = np.zeros(0), np.zeros(0)

    def replace_law(
        self, law: ComplianceLaw, moved: tuple[Placement, Placement] = (AT_ORIGIN, AT_ORIGIN)
    ) -> None:
        """Go on with other equations from the same frame and velocities.

        Args:
            law: the equations.
            moved: placements by which the centre of compliance moves, one after the other.
        """
        now, wrench, left = self.now, self._wrench, self.energy_left
        self.law = law
        self.reset()
        self._wrench, self.energy_left = wrench, left
        if now is not None:  # the state is recomputed from the frames
            self.now = now.carrying(moved[0]).carrying(moved[1])
            self._known = _Known.FRAME

    def change_impedance(self, law: ComplianceLaw) -> None:
        """Go over to another impedance, smoothly, and as far as there is energy for it.

        Args:
            law: with the same representation and translational frame.
        """
        before = self.law_now
        if self.now is None or before.is_like(law):
            self.replace_law(law)
            return
        dip_o = dip_of(before.rotation.K, law.rotation.K)
        in_coordinates = law.orientation.impedance(replace(before.rotation, K=dip_o)).K
        self._dips = dip_of(before.translation.K, law.translation.K), in_coordinates
        self.law, self._before, self.changed = law, before, 0.0

    def begin(self, desired: DesiredFrame, frame: DesiredFrame) -> None:
        """Set the compliant frame and its velocities."""
        self.now, self._desired, self._known = frame, desired, _Known.FRAMES

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
        p, R, dp, omega, _, _ = actual.at_rest() if self.now is None else self.now
        left = math.exp(-dt / T)
        gone = T * (1.0 - left)  # the way [s] of a velocity that decays
        v, w = left * dp, left * omega
        R_c = exp(gone * omega) @ R
        self.now = DesiredFrame(p + gone * dp, R_c, v, w, (-1.0 / T) * v, (-1.0 / T) * w)
        self._wrench, self._known = None, _Known.FRAME  # the next step begins from here
        return self.now

    def rearrange(self) -> None:
        """Go on from the same frame and velocities: what drives it means something else now."""
        self._wrench = None
        if self.now is not None:
            self._known = _Known.FRAME if self._desired is None else _Known.FRAMES

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
            desired: the desired frame now.
            wrench: (6,) f, mu now, base frame.
            freed: what becomes of M_p^-1, D_p, K_p; None: nothing.
            rate: [1/s] of what they become then.

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        if not math.isfinite(_square(*desired, wrench)):
            raise SingularityError("the motion of the compliant frame is not finite")
        start, before, begins = self._origin(dt, desired)
        Z_p, Z_o, own_rate = self._matrices(dt)
        if freed is not None:
            Z_p, own_rate = freed(Z_p), max(own_rate, rate)
        z, v_0 = self._z, self._v
        if begins:
            z = self._relative(before, start)
            v_0 = self._driven(before, wrench if self._wrench is None else self._wrench, None)
        if math.isnan(z @ z):
            raise SingularityError(self.law.orientation.singularity)
        v_1 = self._driven(desired, wrench, v_0)
        if dt > 0.0:
            z = self._integrated(z, v_0, v_1, dt, Z_p, Z_o, own_rate)
        now = self._absolute(z, v_1, desired, Z_p, Z_o)
        known = _Known.STATE
        if dt > 0.0:
            now, is_less = self.law.bounds.bounded(now, desired, start, before, dt)
            if is_less:
                known = _Known.FRAMES
                if not math.isfinite(_square(*now, wrench)):
                    raise SingularityError("the motion of the compliant frame is not finite")
        self._z, self._v, self._wrench = z, v_1, wrench
        self.now, self._desired, self._known = now, desired, known
        return now

    def _origin(self, dt: float, desired: DesiredFrame) -> tuple[DesiredFrame, DesiredFrame, bool]:
        """Return the compliant and the desired frame dt [s] ago, and whether z is not known."""
        if self.now is None:
            return desired, desired, True
        before, begins = self._desired, self._known is not _Known.STATE
        if before is None or self._known is _Known.FRAME or jumped(before, desired, dt):
            return self.now, desired.moved(-dt), True  # as if it had come from there
        return self.now, before, begins

    def _relative(self, desired: DesiredFrame, frame: DesiredFrame) -> Array:
        """Return z of a compliant frame."""
        x = frame.p_d - desired.p_d
        dx = frame.dp_d - desired.dp_d
        if self.law.frame != "base":
            R = desired.R_d
            x, dx = R.T @ x, R.T @ (dx - cross(desired.omega_d, x))
        y = self.law.orientation.relative_state(
            desired.R_d, desired.omega_d, frame.R_d, frame.omega_d
        )
        return np.concatenate((x, dx, y))

    def _driven(self, desired: DesiredFrame, wrench: Array, before: Array | None) -> Array:
        """Return v of a wrench; ``before`` is that of the last step."""
        f, mu, u = wrench[:3], wrench[3:], None if before is None else before[3:]
        if self.law.frame != "base":
            f = desired.R_d.T @ f
        return np.concatenate((f, self.law.orientation.relative_input(desired.R_d, mu, u)))

    def _integrated(
        self, z: Array, v_0: Array, v_1: Array, dt: float, Z_p: Matrices, Z_o: Matrices, rate: float
    ) -> Array:
        """Return z dt [s] later by steps of order 4 (Runge, Kutta), v going from v_0 to v_1."""
        orientation = self.law.orientation
        n = max(1, math.ceil(rate * dt / _STEP))
        h, dv = dt / n, (v_1 - v_0) / n
        for i in range(n):
            v = v_0 + i * dv
            middle, end = v + 0.5 * dv, v + dv
            k_1 = impedance_rates(z, v, orientation, Z_p, Z_o)
            k_2 = impedance_rates(z + (0.5 * h) * k_1, middle, orientation, Z_p, Z_o)
            k_3 = impedance_rates(z + (0.5 * h) * k_2, middle, orientation, Z_p, Z_o)
            k_4 = impedance_rates(z + h * k_3, end, orientation, Z_p, Z_o)
            z = z + (h / 6.0) * (k_1 + 2.0 * (k_2 + k_3) + k_4)
            z[6:] = orientation.normalised(z[6:])
        if not math.isfinite(z @ z):
            raise SingularityError("the motion of the compliant frame is not finite")
        return z

    def _absolute(
        self, z: Array, v: Array, desired: DesiredFrame, Z_p: Matrices, Z_o: Matrices
    ) -> DesiredFrame:
        """Return the compliant frame of z driven by v: what :meth:`_relative` began with."""
        p_d, R_d, dp_d, omega_d, ddp_d, domega_d = desired
        dz = impedance_rates(z, v, self.law.orientation, Z_p, Z_o)
        rotation = self.law.orientation.compliant_rotation(
            z[6:], dz[6:], v[3:], R_d, omega_d, domega_d
        )
        x, dx, ddx = z[:3], z[3:6], dz[3:6]
        if self.law.frame != "base":  # components in a frame that turns
            x, dx, ddx = R_d @ x, R_d @ dx, R_d @ ddx
            turning = cross(omega_d, x)
            ddx = ddx + cross(domega_d, x) + cross(omega_d, turning + 2.0 * dx)
            dx = dx + turning
        R_c, omega_c, domega_c = rotation
        now = DesiredFrame(p_d + x, R_c, dp_d + dx, omega_c, ddp_d + ddx, domega_c)
        if math.isnan(_square(*now, v)):
            raise SingularityError(self.law.orientation.singularity)
        return now

    # --- changes of the impedance -------------------------------------------------------------

    def _matrices(self, dt: float) -> tuple[Matrices, Matrices, float]:
        """Return Z_p, Z_o and their rate [1/s], dt [s] after the last step."""
        law = self.law
        if self.changed == 1.0 and self.energy_left >= self._most_energy:
            return law.Z_p, law.Z_o, law.rate
        if self._known > _Known.FRAME:  # else the displacement is not known
            self._go_on(dt)
        if self.changed == 1.0:
            return law.Z_p, law.Z_o, law.rate
        Z_p, Z_o = self._changed_to(self.changed)
        return Z_p, Z_o, 2.0 * max(law.rate, self._before.rate)  # (IC3)

    def _changed_to(self, s: float) -> tuple[Matrices, Matrices]:
        """Return the matrices of a change that is at s."""
        before, law = self._before, self.law
        Z_p = between(s, before.Z_p, law.Z_p, self._dips[0])
        return Z_p, between(s, before.Z_o, law.Z_o, self._dips[1])

    def _go_on(self, dt: float) -> None:
        """Let the change go on by dt [s], as far as there is energy for it, (IC1), (IC5)."""
        assert self.now is not None
        assert self._desired is not None
        z, s_0 = self._relative(self._desired, self.now), self.changed
        Z_p, Z_o = self._changed_to(s_0)
        energy = self._energy(z, Z_p, Z_o)
        dx, dy = z[3:6], z[-3:]
        taken = dt * float(dx @ Z_p.D @ dx + dy @ Z_o.D @ dy)
        left = min(self._most_energy, self.energy_left + taken)
        s = 1.0 - (1.0 - s_0) * math.exp(-dt / CHANGE_TIME)  # (IC1)
        s = s if s < 1.0 - DONE else 1.0
        more = self._energy(z, *self._changed_to(s)) - energy
        if more > left:  # as much as there is energy for
            s = s_0 + max(0.0, _CAUTION * left / more) * (s - s_0)
            more = self._energy(z, *self._changed_to(s)) - energy
        if not more <= left:  # or it is not finite
            s, more = s_0, 0.0
        self.changed, self.energy_left = s, min(self._most_energy, left - more)  # (IC5)

    def _energy(self, z: Array, Z_p: Matrices, Z_o: Matrices) -> float:
        """Return the energy [J] of the displacement z of the last step, (IC4)."""
        assert self.now is not None
        assert self._desired is not None
        spring = self.law.orientation.spring(self._desired.R_d, self.now.R_d, Z_o.K)
        moving = kinetic(Z_p, z[3:6]) + kinetic(Z_o, z[-3:])
        return moving + elastic(Z_p, z[:3]) + spring.energy


def _square(*arrays: Array) -> float:
    """Return the sum of all squares: finite if all is, and NaN if anything is."""
    flat = np.concatenate(arrays, axis=None)
    return float(flat @ flat)
