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
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws._old.compiled import (
    NONE,
    Array,
    Input,
    Inputs,
    Row,
    entry,
    formula,
    layout,
    to_rows,
)
from eulerparams_control.laws._old.linear import (
    MatLike,
    Vec,
    VecLike,
    cross,
    mat,
    norm,
    put_vec,
    read_vec,
    vec,
)
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.motion.frames import Placement
from eulerparams_control.robot.robot import Robot, RobotState, Tool

# A sensor is stuck if it repeats its value for the first time [s] while a joint moves by more than
# the second value [rad or m]: a slow sensor may repeat a value for a while.
_REPEATS, _MOVED = 0.1, 0.02

STATE, _FOUND = 13, 14
"""How many floats the state of :func:`feel` has, and what it finds."""

# Largest joint motion [rad] of an arm at rest.
_STILL = 0.005


class _Numbers(NamedTuple):
    """The options in numbers; without a weight to be taken out there is no gravity."""

    sign: float
    bias_f: VecLike
    bias_m: VecLike
    has_tool: bool
    mass: float
    com: VecLike
    inertia: MatLike
    gravity: VecLike
    inertial: bool
    dead_force: float
    dead_torque: float
    cutoff: float


_read_numbers = layout(_Numbers).read


class SensedWrench(NamedTuple):
    """Measurement of a sensor.

    Attributes:
        w: (6,) as it came, in the sensor frame and about its origin.
        sensor: where that frame is, seen from the tip; the same object does not change.
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

    @cached_property
    def numbers(self) -> Array:
        """The options as a row."""
        body = self.tool or Tool(0.0, np.zeros(3), np.zeros((3, 3)))
        gravity = np.array(self.gravity) if self.weight else np.zeros(3)
        bias_f, bias_m = np.split(np.array(self.bias, dtype=float), 2)
        tool = self.tool is not None, *body, gravity, self.inertial
        dead = self.dead_force, self.dead_torque
        numbers = _Numbers(self.sign, bias_f, bias_m, *tool, *dead, self.cutoff)
        return to_rows(_Numbers, numbers)

    @property
    def takes_inertia(self) -> bool:
        """Whether the acceleration of the tip matters."""
        return self.inertial and self.tool is not None


@formula
def _without_dead_band(v: Vec, width: float) -> Vec:
    """Return v shortened by ``width``: continuous, and 0 within it."""
    length = norm(v)
    return v if width == 0.0 or length == 0.0 else (max(0.0, length - width) / length) * v


@entry
def feel(
    w: Input, R_s: Inputs, p_s: Input, R_e: Inputs, omega_e: Input, acceleration: Input,
    dt: float, numbers: Input, state: Row, found: Row,
) -> None:  # fmt: skip
    """Fill what is found (14,): the contact w, its force and moment in size, and what is felt, w_t.

    Args:
        w: (6,) what the sensor says.
        R_s, p_s: where it is, seen from the tip.
        R_e, omega_e: orientation and angular velocity of the tip.
        acceleration: (6,) of the tip, base frame; empty if unknown.
        dt: [s] since the one before.
        numbers: the options.
        state: (13,) the tare, whether the low-pass has begun, and what it says; it moves on.
    """
    options, R = _read_numbers(numbers, 0), mat(R_e)
    f = mat(R_s) @ (options.sign * read_vec(w, 0) - options.bias_f)
    mu = mat(R_s) @ (options.sign * read_vec(w, 3) - options.bias_m) + cross(vec(p_s), f)
    if options.has_tool:  # m (g - a_com), and its moment
        com, inertia = options.com, options.inertia
        force, turning = options.mass * (R.T @ options.gravity), Vec(0.0, 0.0, 0.0)
        if options.inertial and len(acceleration) > 0:
            omega, a = R.T @ vec(omega_e), R.T @ read_vec(acceleration, 0)
            domega = R.T @ read_vec(acceleration, 3)
            a_com = a + cross(domega, com) + cross(omega, cross(omega, com))
            force = force - options.mass * a_com
            turning = inertia @ domega + cross(omega, inertia @ omega)
        f, mu = f - force, mu - (cross(com, force) - turning)
    put_vec(found, 8, f)
    put_vec(found, 11, mu)
    f = _without_dead_band(f - read_vec(state, 0), options.dead_force)
    mu = _without_dead_band(mu - read_vec(state, 3), options.dead_torque)
    if state[6] != 0.0 and options.cutoff > 0.0:
        f_0, mu_0 = read_vec(state, 7), read_vec(state, 10)
        share = 1.0 - math.exp(-2.0 * math.pi * options.cutoff * dt)
        f, mu = f_0 + share * (f - f_0), mu_0 + share * (mu - mu_0)
    state[6] = 1.0
    put_vec(state, 7, f)
    put_vec(state, 10, mu)
    put_vec(found, 0, R @ f)
    put_vec(found, 3, R @ mu)
    found[6], found[7] = norm(f), norm(mu)


class WrenchChain:
    """The way from the sensor to the contact, with the state of its low-pass and its tare.

    Args:
        options: how each part is done.

    Attributes:
        memory: state and found, rows of :func:`feel`, one behind the other.
    """

    def __init__(self, options: WrenchOptions) -> None:
        self.options, self.memory = options, np.zeros(STATE + _FOUND)

    @property
    def _state(self) -> Array:
        return self.memory[:STATE]

    @property
    def force(self) -> float:
        """Size [N] of the last contact."""
        return self.memory.item(STATE + 6)

    @property
    def moment(self) -> float:
        """Size [Nm] of the last contact."""
        return self.memory.item(STATE + 7)

    def replace_options(self, options: WrenchOptions) -> None:
        """Go on with other options; the tare and the state of the low-pass stay.

        The ticks of a scheme feel by those of its law, which the scheme gives to its chain.
        """
        self.options = options

    def reset(self) -> None:
        """Forget what the low-pass has seen; the tare stays."""
        self._state[6] = False

    def felt(self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None) -> Array:
        """Return w_t (6,) without the tool, but before tare, dead band and low-pass.

        Args:
            sensed: what the sensor said.
            arm: kinematics of the arm at that time.
            acceleration: (6,) [m/s^2, rad/s^2] of the tip, base frame; None if unknown.
        """
        return self._feel(sensed, arm, acceleration, 0.0, self._state.copy())[8:]

    def contact(
        self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None, dt: float
    ) -> Array:
        """Return the contact wrench w (6,) in base axes, dt [s] after the one before."""
        found = self.memory[STATE:] = self._feel(sensed, arm, acceleration, dt, self._state)
        return found[:6]

    def _feel(
        self,
        sensed: SensedWrench,
        arm: RobotState,
        acceleration: Array | None,
        dt: float,
        state: Array,
    ) -> Array:
        found, a = np.empty(_FOUND), NONE if acceleration is None else acceleration
        w, (R_s, p_s), numbers = sensed.w, sensed.sensor, self.options.numbers
        feel(w, R_s, p_s, arm.R_e, arm.omega_e, a, dt, numbers, state, found)
        return found

    @property
    def tared(self) -> Array:
        """Wrench (6,) _t without contact: the bias."""
        return self._state[:6].copy()

    def tare(self, felt: Array) -> None:
        """Take ``felt`` (6,), a mean of :meth:`felt`, for no contact from now on."""
        self._state[:6] = felt
        self.reset()


class StuckSensor:
    """Tells whether a sensor repeats its value to the bit while the arm moves: it measures no more.

    A real one never does so for long; a driver that has lost it may.  Zero is believed: it is what
    an ideal sensor reports that carries nothing, a simulated one for instance.

    Args:
        limits: of the joints.
    """

    def __init__(self, limits: JointLimits) -> None:
        self._limits = limits
        self._is_stuck = False
        self._w = b""  # measured last, since when [s], and where the arm was (n,)
        self._since, self._q = 0.0, np.zeros(len(limits.upper))

    def update(self, w: Array, q: Array, now: float) -> bool:
        """Take a new measurement w (6,) at the positions q (n,) and the time now [s]."""
        said = w.tobytes()
        if said != self._w:
            self._w, self._q, self._since, self._is_stuck = said, q, now, False
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
