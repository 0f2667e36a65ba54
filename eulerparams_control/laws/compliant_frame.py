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
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError, SingularityError, UnknownNameError
from eulerparams_control.laws.compliance_bounds import ComplianceBounds
from eulerparams_control.laws.impedance_matrices import Impedance
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.rotations import Array, cross, exp
from eulerparams_control.motion.frames import AT_ORIGIN, DesiredFrame, Placement
from eulerparams_control.motion.motion_limits import MotionLimits

TRANSLATIONAL_FRAMES = ("base", "desired")

# The faster of both impedances [1/s]: beyond it a step at 1 kHz would have to be split too often.
MAX_RATE = 1000.0

# Product of rate and step that Runge-Kutta's method integrates well.
_STEP = 0.5

STOP_TIME = 0.05
"""A frozen compliant frame comes to rest with this time constant [s], a fast one later."""

_LONGEST_STOP = 0.5  # the same, however low the accelerations are

# Deviation from its extrapolated motion [m, rad; m/s, rad/s] from which a desired frame has jumped.
_JUMP, _VELOCITY_JUMP = 1e-5, 1e-2

_NONE = np.zeros(3)


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
        if self.frame not in TRANSLATIONAL_FRAMES:
            raise UnknownNameError("translational_frame", self.frame, TRANSLATIONAL_FRAMES)
        object.__setattr__(self, "Z_o", self.orientation.impedance(self.rotation))
        for name, Z in (("_p", self.translation), ("_o", self.rotation)):
            if Z.rate > MAX_RATE:
                raise ConfigurationError(
                    f"M{name} is too small for D{name} or K{name}: the impedance moves at "
                    f"{Z.rate:.4g} 1/s; at most {MAX_RATE:g} 1/s is possible: raise M{name}"
                )

    Z_o: Impedance = None  # type: ignore[assignment]  # in the coordinates of the representation

    @property
    def rate(self) -> float:
        """The largest rate [1/s] of both impedances."""
        return max(self.translation.rate, self.rotation.rate)


class _Input(NamedTuple):
    """Input of the impedances at one sample."""

    f: Array  # in the translational frame
    u: Array  # of the representation


class CompliantFrame:
    """The compliant frame with its state, relative to the desired frame.

    Args:
        law: its equations.

    Attributes:
        now: the compliant frame of the last step; None before the first.
    """

    def __init__(self, law: ComplianceLaw) -> None:
        self._law = law
        self.reset()

    @property
    def law(self) -> ComplianceLaw:
        """The equations."""
        return self._law

    def reset(self) -> None:
        """Forget the state."""
        self.now: DesiredFrame | None = None
        self._desired: DesiredFrame | None = None  # of the last step, as the other two
        self._wrench: Array | None = None
        self._input: _Input | None = None

    def replace_law(
        self, law: ComplianceLaw, moved: tuple[Placement, Placement] = (AT_ORIGIN, AT_ORIGIN)
    ) -> None:
        """Go on with other equations from the same frame and velocities.

        Args:
            law: the equations.
            moved: placements by which the centre of compliance moves, one after the other.
        """
        self._law = law
        if self.now is not None:
            self.now = self.now.carrying(moved[0]).carrying(moved[1])
        self._desired = self._input = None  # the state is recomputed from the frames

    def begin(self, desired: DesiredFrame, frame: DesiredFrame) -> None:
        """Set the compliant frame and its velocities.

        Raises:
            SingularityError: if the representation has no finite state there.
        """
        self._x, self._dx = self._relative(desired, frame)
        self._y = self._law.orientation.compliance_begin(
            desired.R_d, desired.omega_d, frame.R_d, frame.omega_d
        )
        self.now, self._desired, self._input = frame, desired, None

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
        before = self.now or actual.at_rest()
        left = math.exp(-dt / T)
        gone = T * (1 - left)  # the way [s] of a velocity that decays
        dp, omega = left * before.dp_d, left * before.omega_d
        self.now = DesiredFrame(
            before.p_d + gone * before.dp_d,
            exp(gone * before.omega_d) @ before.R_d,
            dp,
            omega,
            -dp / T,
            -omega / T,
        )
        self._desired = self._wrench = self._input = None  # the next step begins from here
        return self.now

    def step(self, dt: float, desired: DesiredFrame, wrench: Array) -> DesiredFrame:
        """Return the compliant frame dt [s] after the last, with velocities and accelerations.

        Args:
            dt: 0 or more.
            desired: the desired frame now.
            wrench: (6,) f, mu now, base frame.

        Raises:
            SingularityError: if the representation has no finite answer.
        """
        if self.now is None:
            self.begin(desired, desired)
        elif self._desired is None or _jumped(self._desired, desired, dt):
            self.begin(desired.moved(-dt), self.now)  # as if it had come from there
        before = self._input
        if before is None:
            last = wrench if self._wrench is None else self._wrench
            before = self._driven_by(self._desired or desired, last, None)
        now = self._driven_by(desired, wrench, before)
        start, v = self.now, self._velocity(self._desired or desired)
        if dt > 0:
            self._integrate(dt, before, now)
        self._desired, self._wrench, self._input = desired, wrench, now
        self.now = frame = self._frame(desired, now)
        if dt > 0 and start is not None:
            self.now = self._law.bounds.keep(frame, desired, start, v, dt)
        if self.now is not frame:
            self.begin(desired, self.now)
        return self.now

    def _velocity(self, desired: DesiredFrame) -> Array:
        """Return the velocity (6,) of the compliant relative to the desired frame."""
        if self.now is None:
            return np.zeros(6)
        linear, angular = self.now.dp_d - desired.dp_d, self.now.omega_d - desired.omega_d
        return np.concatenate((linear, angular))

    # --- integration -------------------------------------------------------------------

    def _integrate(self, dt: float, before: _Input, now: _Input) -> None:
        law = self._law
        p, o = law.translation, law.orientation
        n = max(1, math.ceil(law.rate * dt / _STEP))

        def translation(z: Array, f: Array) -> Array:  # eq. (52)
            x, dx = z[:3], z[3:]
            return np.concatenate((dx, p.M_inverse @ (f - p.D @ dx - p.K @ x)))

        def rotation(y: Array, u: Array) -> Array:  # eqs. (55), (59)
            return o.compliance_rate(y, u, law.Z_o)

        z, y = np.concatenate((self._x, self._dx)), self._y
        for i in range(n):
            a, b = i / n, (i + 1) / n
            z = _runge_kutta(translation, z, before.f, now.f, a, b, dt / n)
            y = o.compliance_normalised(_runge_kutta(rotation, y, before.u, now.u, a, b, dt / n))
        if not (math.isfinite(z @ z) and math.isfinite(y @ y)):
            raise SingularityError("the motion of the compliant frame is not finite")
        self._x, self._dx, self._y = z[:3], z[3:], y

    def _driven_by(self, desired: DesiredFrame, wrench: Array, before: _Input | None) -> _Input:
        """Return what drives the impedances; ``before`` is that of the last step."""
        f = wrench[:3] if self._law.frame == "base" else desired.R_d.T @ wrench[:3]
        u = self._law.orientation.compliance_input(
            desired.R_d, wrench[3:], None if before is None else before.u
        )
        return _Input(f, u)

    # --- frames ------------------------------------------------------------------------

    def _turning(self, desired: DesiredFrame) -> tuple[Array, Array, Array]:
        """Return rotation, angular velocity and acceleration of the translational frame."""
        if self._law.frame == "base":
            return np.eye(3), _NONE, _NONE
        return desired.R_d, desired.omega_d, desired.domega_d

    def _relative(self, desired: DesiredFrame, frame: DesiredFrame) -> tuple[Array, Array]:
        """Return x = R' (p_c - p_d) and its rate."""
        R, omega, _ = self._turning(desired)
        dp = frame.p_d - desired.p_d
        return R.T @ dp, R.T @ (frame.dp_d - desired.dp_d - cross(omega, dp))

    def _frame(self, desired: DesiredFrame, now: _Input) -> DesiredFrame:
        """Return p_c, R_c and their derivatives from the state."""
        law, p = self._law, self._law.translation
        R, omega, domega = self._turning(desired)
        x, dx = R @ self._x, R @ self._dx
        ddx = R @ (p.M_inverse @ (now.f - p.D @ self._dx - p.K @ self._x))  # eq. (52)
        turning = cross(omega, x)
        dy = law.orientation.compliance_rate(self._y, now.u, law.Z_o)
        rotation = law.orientation.compliance_end(
            self._y, dy, now.u, desired.R_d, desired.omega_d, desired.domega_d
        )
        return DesiredFrame(
            desired.p_d + x,
            rotation.R_c,
            desired.dp_d + dx + turning,
            rotation.omega_c,
            desired.ddp_d + ddx + cross(domega, x) + cross(omega, turning + 2 * dx),
            rotation.domega_c,
        )


def _runge_kutta(
    rate: Callable[[Array, Array], Array], y: Array, u_0: Array, u_1: Array, a: float, b: float,
    dt: float,
) -> Array:  # fmt: skip
    """Return y after a step of order 4, the input going linearly from a to b of u_0 ... u_1."""
    begin, end = u_0 + a * (u_1 - u_0), u_0 + b * (u_1 - u_0)
    middle = (begin + end) / 2
    k_1 = rate(y, begin)
    k_2 = rate(y + dt / 2 * k_1, middle)
    k_3 = rate(y + dt / 2 * k_2, middle)
    k_4 = rate(y + dt * k_3, end)
    return y + dt / 6 * (k_1 + 2 * (k_2 + k_3) + k_4)


def _jumped(before: DesiredFrame, now: DesiredFrame, dt: float) -> bool:
    """Return whether the desired frame is not where, or as fast as, its motion led."""
    bend = dt * dt / 12  # the trapezoidal rule with its first correction
    p = before.p_d + dt * (before.dp_d + now.dp_d) / 2 - bend * (now.ddp_d - before.ddp_d)
    turn = dt * (before.omega_d + now.omega_d) / 2 - bend * (now.domega_d - before.domega_d)
    R = exp(turn) @ before.R_d
    dv = now.dp_d - before.dp_d - dt * (before.ddp_d + now.ddp_d) / 2
    domega = now.omega_d - before.omega_d - dt * (before.domega_d + now.domega_d) / 2
    jump = max(float(np.abs(now.p_d - p).max()), float(np.abs(now.R_d - R).max()))
    velocity_jump = max(float(np.abs(dv).max()), float(np.abs(domega).max()))
    return not (jump <= _JUMP and velocity_jump <= _VELOCITY_JUMP)
