"""From what the force/torque sensor measures to the contact wrench at the tip.

In this order, in :class:`WrenchChain`: sign and known bias of the sensor, shift of the frame and of
the point that moments are about from the sensor to the tip, weight and inertia of the tool, tare,
dead band, low-pass.

Notation: ``w`` (6,) force and moment [N, Nm] of the environment on the tool; the suffix ``_t``
is for axes of the tip and about its origin, ``_s`` for the sensor's, else base axes, about the
origin of the tip.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.jit import Array, f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import cross, norm, turn, turn_back
from eulerparams_control.motion.frames import Placement
from eulerparams_control.robot.robot import Robot, RobotState, Tool

# A sensor is stuck if it repeats its value for the first time [s] while a joint moves by more than
# the second value [rad or m]: a slow sensor may repeat a value for a while.
_REPEATS, _MOVED = 0.1, 0.02

# Largest joint motion [rad] of an arm at rest.
_STILL = 0.005

_ZERO = np.zeros(3)
_AT_REST = _ZERO, np.zeros(6)  # omega_e, acceleration


class SensedWrench(NamedTuple):
    """Measurement of a sensor.

    Attributes:
        w: (6,) as it came, in the sensor frame and about its origin.
        sensor: where that frame is, seen from the tip.
    """

    w: Array
    sensor: Placement


@dataclass(frozen=True)
class WrenchOptions:
    """How the wrench of the sensor becomes that of the contact.

    Attributes:
        sign: 1, or -1 for a sensor that reports what the tool exerts.
        bias: (6,) [N, Nm] in the sensor frame, after the sign.
        tool: beyond the sensor; None if there is no tool.
        gravity: (3,) [m/s^2] in the base frame.
        weight, inertial: whether weight and inertia of the tool are taken out.
        dead_force, dead_torque: [N], [Nm] by which the vectors are shortened; 0 is not.
        cutoff: [Hz] of the low-pass; 0 disables it.

    Raises:
        ConfigurationError: if a value is impossible.
    """

    sign: int = 1
    bias: tuple[float, ...] = (0.0,) * 6
    tool: Tool | None = None
    gravity: tuple[float, ...] = (0.0, 0.0, -9.81)
    weight: bool = True
    inertial: bool = True
    dead_force: float = 0.0
    dead_torque: float = 0.0
    cutoff: float = 0.0

    def __post_init__(self) -> None:
        if self.sign not in (1, -1):
            raise ConfigurationError(f"wrench_sign is {self.sign}; expected 1 or -1")
        if len(self.bias) != 6:
            raise ConfigurationError(f"wrench_bias has {len(self.bias)} values; expected 6")
        if not np.isfinite(self.bias).all():
            raise ConfigurationError(f"wrench_bias is {self.bias}; expected finite numbers")
        for name in ("dead_force", "dead_torque", "cutoff"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ConfigurationError(f"{name} is {getattr(self, name)}; expected >= 0")


@jit(new_vector(matrix, vector, vector))
def shifted(R: Array, p: Array, w: Array) -> Array:
    """Return a wrench (6,) of a frame at R, p in the one that carries it: (R f, R mu + p x R f)."""
    v = np.empty(6)
    v[:3] = turn(R, w[:3])
    v[3:] = turn(R, w[3:]) + cross(p, v[:3])
    return v


@jit(new_vector(vector, vector))
def at_point(w: Array, r: Array) -> Array:
    """Return a wrench (6,) about a point at r (3,) [m] from the former one: (f, mu - r x f)."""
    w_r = w.copy()
    w_r[3:] -= cross(r, w[:3])
    return w_r


@jit(new_vector(matrix, vector, vector, vector, f8, vector, matrix))
def tool_wrench(
    R_e: Array, omega_e: Array, a_e: Array, g: Array, mass: float, com: Array, inertia: Array
) -> Array:
    """Return w_t (6,) of weight and inertia of the tool: m (g - a_com) and its moment.

    Args:
        R_e, omega_e, a_e: of the tip, base frame; a_e (6,) [m/s^2, rad/s^2].
        g: (3,) gravity, base frame.
        mass, com, inertia: of the tool, see :class:`Tool`.
    """
    omega, domega = turn_back(R_e, omega_e), turn_back(R_e, a_e[3:])
    a_com = turn_back(R_e, a_e[:3]) + cross(domega, com) + cross(omega, cross(omega, com))
    w_t = np.empty(6)
    w_t[:3] = mass * (turn_back(R_e, g) - a_com)
    w_t[3:] = cross(com, w_t[:3]) - turn(inertia, domega) - cross(omega, turn(inertia, omega))
    return w_t


@jit(new_vector(vector, f8, f8))
def without_dead_band(w: Array, force: float, torque: float) -> Array:
    """Return a wrench (6,) with f, mu shortened by so much: continuous, and 0 within that."""
    shorter = w.copy()
    for part, width in ((shorter[:3], force), (shorter[3:], torque)):
        length = norm(part)
        if length > 0.0:
            part *= max(0.0, length - width) / length
    return shorter


class WrenchChain:
    """The way from the sensor to the contact, with its tare and the state of its low-pass.

    Attributes:
        tared: (6,) w_t without contact, as :meth:`tare` took it: the bias.
        force, moment: sizes [N], [Nm] of the last contact.
    """

    def __init__(self, options: WrenchOptions) -> None:
        self.replace_options(options)
        self.tared = np.zeros(6)
        self.force = self.moment = 0.0
        self.reset()

    def replace_options(self, options: WrenchOptions) -> None:
        """Go on with other options; the tare and the state of the low-pass stay."""
        self.options = options
        self._bias = np.array(options.bias, dtype=float)
        self._gravity = np.array(options.gravity, dtype=float) * options.weight

    def reset(self) -> None:
        """Forget the past of the low-pass; the tare stays."""
        self._filtered: Array | None = None

    def tare(self, felt: Array) -> None:
        """Take ``felt`` (6,), a mean of :meth:`felt`, for no contact from now on."""
        self.tared = felt.copy()
        self.reset()

    def felt(self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None) -> Array:
        """Return w_t (6,) without the tool, but before tare, dead band and low-pass.

        Args:
            sensed: what the sensor measured.
            arm: kinematics of the arm at that time.
            acceleration: (6,) [m/s^2, rad/s^2] of the tip, base frame; None if unknown.
        """
        options, tool = self.options, self.options.tool
        w_s = options.sign * sensed.w - self._bias
        w_t = shifted(sensed.sensor.R, sensed.sensor.p, w_s)
        if tool is not None:
            omega, a = _AT_REST
            if options.inertial and acceleration is not None:
                omega, a = arm.omega_e, acceleration
            body = tool.mass, tool.com, tool.inertia
            w_t = w_t - tool_wrench(arm.R_e, omega, a, self._gravity, *body)
        return w_t

    def contact(
        self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None, dt: float
    ) -> Array:
        """Return the contact w (6,), dt [s] after the one before; see :meth:`felt`."""
        options = self.options
        w_t = self.felt(sensed, arm, acceleration) - self.tared
        w_t = without_dead_band(w_t, options.dead_force, options.dead_torque)
        if self._filtered is not None and options.cutoff > 0.0:
            share = -math.expm1(-2.0 * math.pi * options.cutoff * dt)
            w_t = self._filtered + share * (w_t - self._filtered)
        self._filtered = w_t
        self.force, self.moment = norm(w_t[:3]), norm(w_t[3:])
        return shifted(arm.R_e, _ZERO, w_t)


class StuckSensor:
    """Tells whether a sensor repeats its value to the bit while the arm moves: it measures no more.

    A real one never does so for long; a driver that has lost it may.  Zero is believed: it is what
    an ideal sensor reports that carries nothing, a simulated one for instance.
    """

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._is_stuck = False
        self._w = b""  # measured last, since when [s], and where the arm was (n,)
        self._since, self._q = 0.0, np.zeros(len(limits.upper))

    def update(self, w: Array, q: Array, now: float) -> bool:
        """Return whether it is stuck, after it measured w (6,) at q (n,) and the time now [s]."""
        measured = w.tobytes()
        if measured != self._w:
            self._w, self._q, self._since, self._is_stuck = measured, q, now, False
        elif w.any() and now - self._since > _REPEATS:
            self._is_stuck |= bool((self._limits.deviation(q, self._q) > _MOVED).any())
        return self._is_stuck


class RestingWrench:
    """The last measurements, for the mean wrench while the arm is at rest."""

    def __init__(self, size: int) -> None:
        self._samples: deque[tuple[SensedWrench, Array, Array]] = deque(maxlen=size)

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._samples)

    def add(self, sensed: SensedWrench, q: Array, dq: Array) -> None:
        """Keep what the sensor measured at the state q, dq (n,)."""
        self._samples.append((sensed, q, dq))

    def clear(self) -> None:
        """Forget all."""
        self._samples.clear()

    @property
    def is_still(self) -> bool:
        """Whether no joint moved by more than ``_STILL`` meanwhile."""
        q = np.unwrap([q for _, q, _ in self._samples], axis=0)  # drivers wrap continuous joints
        return bool((np.ptp(q, axis=0) <= _STILL).all())

    def mean(self, chain: WrenchChain, robot: Robot, last: int = 0) -> Array:
        """Return the mean (6,) of :meth:`WrenchChain.felt`, of the ``last`` ones; 0 is all."""
        samples = list(self._samples)[-last:]
        felt = [chain.felt(w, robot.state(q, dq), None) for w, q, dq in samples]
        return np.array(np.mean(felt, axis=0))

    def spread(self) -> Array:
        """Return the standard deviations (6,) of what the sensor measured."""
        return np.array(np.std([sensed.w for sensed, _, _ in self._samples], axis=0))
