"""From what the force/torque sensor measures to the contact wrench at the tip.

In this order: sign and known bias of the sensor, shift of the axes and of the point that moments
are about from the sensor to the tip, weight and inertia of the tool, tare, dead band, low-pass.

Notation: ``w`` (6,) force and moment [N, Nm] of the environment on the tool, about the tip in base
axes; with the suffix ``_t`` in axes of the tip, with ``_s`` as the sensor measures it.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eulerparams_control.laws.jit import Array, f8, jit, matrix, new_vector, vector
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import cross, norm, turn, turn_back
from eulerparams_control.motion.frames import Placement
from eulerparams_control.robot.robot import Robot, RobotState

if TYPE_CHECKING:
    from eulerparams_control.parameters.impedance_control import ImpedanceParameters

# A sensor is stuck if it repeats its value for the first time [s] while a joint moves by more than
# the second value [rad or m]: a slow sensor may repeat a value for a while.
_REPEATS, _MOVED = 0.1, 0.02

# Largest joint motion [rad] of an arm at rest.
_STILL = 0.005

_ZERO = np.zeros(3)
_NO_MOTION = _ZERO, np.zeros(6)  # omega_e, acceleration


class SensedWrench(NamedTuple):
    """Measurement (6,) of a sensor in its own frame, and where that is, seen from the tip."""

    w: Array
    sensor: Placement


class WrenchChain:
    """The way from the sensor to the contact, with its tare and the state of its low-pass.

    Attributes:
        tool: beyond the sensor; or None.
        tared: (6,) w_t that is felt without contact.
    """

    def __init__(self, robot: Robot, parameters: "ImpedanceParameters") -> None:
        self.robot = robot
        self.change(parameters)
        self.tare(np.zeros(6))

    def change(self, parameters: "ImpedanceParameters") -> None:
        """Go over to other parameters; the tare and the state of the low-pass stay."""
        self._bias, self.tool = parameters.sensor()
        self._gravity = self.robot.gravity * parameters.compensate_tool_weight
        self._parameters = parameters

    def reset(self) -> None:
        """Forget the past of the low-pass; the tare stays."""
        self._filtered: Array | None = None

    def tare(self, felt: Array) -> None:
        """Take ``felt`` (6,), a mean of :meth:`felt`, for no contact from now on."""
        self.tared = felt.copy()
        self.reset()

    def felt(self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None) -> Array:
        """Return w_t (6,) without the tool, but before tare, dead band and low-pass.

        ``acceleration`` (6,) [m/s^2, rad/s^2] is the tip's, base frame; None if unknown.
        """
        p, tool = self._parameters, self.tool
        w_s = p.wrench_sign * sensed.w - self._bias
        w_t = shifted(sensed.sensor.R, sensed.sensor.p, w_s)
        if tool is None:
            return w_t
        omega, a = _NO_MOTION
        if p.compensate_tool_inertia and acceleration is not None:
            omega, a = arm.omega_e, acceleration
        return w_t - tool_wrench(arm.R_e, omega, a, self._gravity, *tool)

    def contact(
        self, sensed: SensedWrench, arm: RobotState, acceleration: Array | None, dt: float
    ) -> Array:
        """Return the contact w (6,), dt [s] after the one before; see :meth:`felt`."""
        p = self._parameters
        w_t = self.felt(sensed, arm, acceleration) - self.tared
        w_t = without_dead_band(w_t, p.force_dead_band, p.torque_dead_band)
        if self._filtered is not None and p.wrench_cutoff > 0.0:
            share = -math.expm1(-2.0 * math.pi * p.wrench_cutoff * dt)
            w_t = self._filtered + share * (w_t - self._filtered)
        self._filtered = w_t
        return shifted(arm.R_e, _ZERO, w_t)


@jit(new_vector(matrix, vector, vector))
def shifted(R: Array, p: Array, w: Array) -> Array:
    """Return (R f, R mu + p x R f): a wrench in a frame, seen from the one that has it at R, p."""
    v = np.empty(6)
    v[:3] = turn(R, w[:3])
    v[3:] = turn(R, w[3:]) + cross(p, v[:3])
    return v


@jit(new_vector(matrix, vector, vector, vector, f8, vector, matrix))
def tool_wrench(
    R_e: Array, omega_e: Array, a_e: Array, g: Array, mass: float, com: Array, inertia: Array
) -> Array:
    """Return w_t (6,) of weight and inertia of a tool at the tip: m (g - a_com) and its moment."""
    omega, domega = turn_back(R_e, omega_e), turn_back(R_e, a_e[3:])
    a_com = turn_back(R_e, a_e[:3]) + cross(domega, com) + cross(omega, cross(omega, com))
    w_t = np.empty(6)
    w_t[:3] = mass * (turn_back(R_e, g) - a_com)
    w_t[3:] = cross(com, w_t[:3]) - turn(inertia, domega) - cross(omega, turn(inertia, omega))
    return w_t


@jit(new_vector(vector, f8, f8))
def without_dead_band(w: Array, force: float, torque: float) -> Array:
    """Return a wrench with f, mu shortened by so much: continuous, and 0 within that."""
    shorter = w.copy()
    for part, width in ((shorter[:3], force), (shorter[3:], torque)):
        length = norm(part)
        if length > 0.0:
            part *= max(0.0, length - width) / length
    return shorter


class StuckSensor:
    """Tells whether a sensor repeats its value to the bit while the arm moves: it measures no more.

    A real one never does so for long; a driver that has lost it may.  Zero is believed: it is what
    an ideal sensor reports that carries nothing, a simulated one for instance.
    """

    _w, _is_stuck = b"", False

    def update(self, w: Array, q: Array, now: float, limits: JointLimits) -> bool:
        """Return whether it is stuck, after it measured w (6,) at q (n,) and the time now [s]."""
        if w.tobytes() != self._w:
            self._w, self._q, self._since, self._is_stuck = w.tobytes(), q, now, False
        elif w.any() and now - self._since > _REPEATS:
            self._is_stuck |= bool((np.abs(limits.difference(q, self._q)) > _MOVED).any())
        return self._is_stuck


type RestingSample = tuple[SensedWrench, Array, Array]  # with q, dq (n,)


def is_still(samples: Sequence[RestingSample]) -> bool:
    """Return whether no joint moved meanwhile."""
    q = np.unwrap([q for _, q, _ in samples], axis=0)  # drivers wrap continuous joints
    return bool((np.ptp(q, axis=0) <= _STILL).all())


def mean_felt(chain: WrenchChain, samples: Sequence[RestingSample]) -> Array:
    """Return the mean (6,) of :meth:`WrenchChain.felt`."""
    felt = [chain.felt(w, chain.robot.state(q, dq), None) for w, q, dq in samples]
    return np.array(np.mean(felt, axis=0))
