"""From what the force/torque sensor measures to the contact wrench at the tip.

In this order, each part by itself: sign, known bias of the sensor, shift of the frame and of the
point that moments are about from the sensor to the tip, weight and inertia of the tool, what the
tare found, dead band, low-pass.

Notation: ``w`` (6,) force and moment [N, Nm] of the environment on the tool; the suffix ``_t``
is for axes of the tip and about its origin, else base axes, about the origin of the tip.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array, cross
from eulerparams_control.motion.frames import Placement
from eulerparams_control.robot.robot import Robot, RobotState, Tool

# A sensor that repeats its value for so long [s], while a joint has moved so far [rad or m], is
# stuck: a slow one may repeat it for a while.
_REPEATS, _MOVED = 0.1, 0.02

# Largest joint motion [rad] of an arm at rest.
_STILL = 0.005


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


class WrenchChain:
    """The way from the sensor to the contact, with the state of its low-pass and its tare.

    Args:
        options: how each part is done.
    """

    def __init__(self, options: WrenchOptions) -> None:
        self.options = options
        self._tare = np.zeros(6)  # _t
        self._low: Array | None = None  # _t

    def replace_options(self, options: WrenchOptions) -> None:
        """Go on with other options; the tare and the state of the low-pass stay."""
        self.options = options

    def reset(self) -> None:
        """Forget what the low-pass has seen; the tare stays."""
        self._low = None

    def felt(self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None) -> Array:
        """Return w_t (6,) without the tool, but before tare, dead band and low-pass.

        Args:
            sensed: what the sensor said.
            arm: kinematics of the arm at that time.
            acceleration: (6,) [m/s^2, rad/s^2] of the tip, base frame; None if unknown.
        """
        options = self.options
        w = options.sign * sensed.w - np.array(options.bias)
        return _shifted(w, sensed.sensor) - self._tool(arm, acceleration)

    def contact(
        self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None, dt: float
    ) -> Array:
        """Return the contact wrench w (6,) in base axes, dt [s] after the one before."""
        w_t = self.felt(sensed, arm, acceleration) - self._tare
        w_t = np.concatenate(
            (
                _without_dead_band(w_t[:3], self.options.dead_force),
                _without_dead_band(w_t[3:], self.options.dead_torque),
            )
        )
        w_t = self._filtered(w_t, dt)
        return np.concatenate((arm.R_e @ w_t[:3], arm.R_e @ w_t[3:]))

    @property
    def tared(self) -> Array:
        """Wrench (6,) _t without contact: the bias."""
        return self._tare

    def tare(self, felt: Array) -> None:
        """Take ``felt`` (6,), a mean of :meth:`felt`, for no contact from now on."""
        self._tare = felt.copy()
        self._low = None

    def _tool(self, arm: RobotState, acceleration: Array | None) -> Array:
        """Return what the sensor feels of the tool, (6,) _t: m (g - a_com), and its moment."""
        tool = self.options.tool
        if tool is None:
            return np.zeros(6)
        g_t = arm.R_e.T @ np.array(self.options.gravity) if self.options.weight else np.zeros(3)
        if acceleration is None or not self.options.inertial:
            force = tool.mass * g_t
            return np.concatenate((force, cross(tool.com, force)))
        omega, a = arm.R_e.T @ arm.omega_e, arm.R_e.T @ acceleration[:3]
        domega = arm.R_e.T @ acceleration[3:]
        a_com = a + cross(domega, tool.com) + cross(omega, cross(omega, tool.com))
        force = tool.mass * (g_t - a_com)
        turning = tool.inertia @ domega + cross(omega, tool.inertia @ omega)
        return np.concatenate((force, cross(tool.com, force) - turning))

    def _filtered(self, w_t: Array, dt: float) -> Array:
        cutoff = self.options.cutoff
        if self._low is None or cutoff == 0:
            self._low = w_t
        else:
            self._low = self._low + (1 - math.exp(-2 * math.pi * cutoff * dt)) * (w_t - self._low)
        return self._low


class StuckSensor:
    """Tells whether a sensor repeats its value to the bit while the arm moves: it measures no more.

    A real one never does so for long; a driver that has lost it may.  Zero is believed: it is what
    an ideal sensor says that bears nothing, a simulated one for instance.

    Args:
        limits: of the joints.
    """

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._is_stuck = False
        self._w: Array | None = None  # measured last, since when [s], and where the arm was (n,)
        self._since, self._q = 0.0, np.zeros(len(limits.upper))

    def update(self, w: Array, q: Array, now: float) -> bool:
        """Take a new measurement w (6,) at the positions q (n,) and the time now [s]."""
        if self._w is None or not np.array_equal(w, self._w):
            self._w, self._q, self._since, self._is_stuck = w, q, now, False
        elif w.any() and now - self._since > _REPEATS:
            self._is_stuck |= bool((self._limits.deviation(q, self._q) > _MOVED).any())
        return self._is_stuck


class RestingWrench:
    """The last measurements, for the mean wrench while the arm is at rest.

    Args:
        size: how many are kept.
    """

    def __init__(self, size: int) -> None:
        self._samples: deque[tuple[SensedWrench, Array, Array]] = deque(maxlen=size)

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._samples)

    def add(self, sensed: SensedWrench, q: Array, dq: Array) -> None:
        """Take what the sensor said at the state q, dq (n,)."""
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
        """Return the mean (6,) of what ``chain`` feels, see :meth:`WrenchChain.felt`.

        Of the ``last`` ones, which is soon done; 0 is all.
        """
        samples = list(self._samples)[-last:]
        felt = [chain.felt(w, robot.state(q, dq), None) for w, q, dq in samples]
        return np.array(np.mean(felt, axis=0))

    def spread(self) -> Array:
        """Return the standard deviations (6,) of what the sensor said."""
        return np.array(np.std([sensed.w for sensed, _, _ in self._samples], axis=0))


def at_point(w: Array, r: Array) -> Array:
    """Return a wrench (6,) about a point at r (3,) [m] from where it was about, same axes."""
    return np.concatenate((w[:3], w[3:] - cross(r, w[:3])))


def _shifted(w: Array, sensor: Placement) -> Array:
    """Return a wrench (6,) of the sensor frame in the axes of the tip and about its origin."""
    force, moment = sensor.R @ w[:3], sensor.R @ w[3:]
    return np.concatenate((force, moment + cross(sensor.p, force)))


def _without_dead_band(v: Array, width: float) -> Array:
    """Return v (3,) shortened by ``width``: continuous, and 0 within it."""
    if width == 0:
        return v
    length = math.sqrt(v @ v)
    return v * (max(0.0, length - width) / length) if length > 0 else v
