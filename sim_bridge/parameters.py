"""What is simulated besides the robot: rate, control, tool, surroundings, friction, noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.rotations import Array
from sim_bridge.environment import Solid, Thing, read_environment
from sim_bridge.environment.keys import NO_TURN, rotation, unit_quaternion
from sim_bridge.protection import SPEED_FACTOR
from sim_bridge.shapes import SIZES, check_size, geometry
from sim_bridge.urdf import Body, Placed

CONTROLS = ("position", "torque")
"""A joint servo, or motors that compensate nothing."""

NO_SHAPE = "none"
TOOL_SHAPES = (NO_SHAPE, *SIZES)
"""Nothing that can touch, or a shape."""

_SIZES = {"gravity": 3, "tool_com": 3, "tool_inertia": 6, "tool_position": 3, "wrench_bias": 6}
_NOT_NEGATIVE = ("tool_mass", "friction_viscous", "friction_coulomb", "noise_position",
                 "noise_velocity", "noise_force", "noise_torque", "encoder_resolution",
                 "velocity_cutoff")  # fmt: skip

_ROUNDING = 1e-12  # of a principal moment that is zero, relative to the largest

_ROWS, _COLUMNS = np.triu_indices(3)  # xx, xy, xz, yy, yz, zz


@dataclass(frozen=True)
class SimulatorParameters:
    """Parameters of :class:`sim_bridge.simulator.Simulator`.

    Attributes:
        rate: steps per second, Hz.
        control: one of ``CONTROLS``.
        gui: open PyBullet's window.
        collide_links: whether not only the tool but the links of the robot touch what is
            around it.
        gravity: in the world frame, m/s^2; 3.
        servo_bandwidth: of the joint servo, rad/s; at most ``rate``.
        enforce_limits: clip commands to the limits of the URDF, and stop joints there.
        protective_speed: with limits, and in torque control, a joint that is so many times as
            fast as its speed limit is a reason to stop; at least 1.  Ten times that, and in any
            control, it is locked.
        tool_mass: of the tool beyond the sensor, kg.
        tool_com: its centre of mass in the sensor frame, m; 3.
        tool_inertia: xx, xy, xz, yy, yz, zz about that, sensor axes, kg m^2; 6.
        tool_shape: that of the tool which touches what is around it, one of ``TOOL_SHAPES``;
            it has no mass but ``tool_mass``.
        tool_size: its numbers, see :data:`sim_bridge.shapes.SIZES`, m.
        tool_position: of its middle in the sensor frame, m; 3.
        tool_orientation: in the sensor frame, x, y, z, w.
        friction_viscous: Nm s/rad; one for all joints or one for each; empty: ``damping``
            of the URDF.
        friction_coulomb: Nm; the same; empty: ``friction`` of the URDF.
        noise_position, noise_velocity: standard deviations, rad and rad/s.
            ``velocity_cutoff`` excludes the latter.
        encoder_resolution: counts per turn, to which the noisy position is rounded;
            0: exact.
        velocity_cutoff: the velocity is derived from the measured position, with a low
            pass of this cut-off, Hz; below half the rate; 0: the velocity as simulated.
        noise_force, noise_torque: standard deviations, N and Nm.
        wrench_bias: added to the wrench, N and Nm; 6.
        seed: of the noise.
        disturbance_effort: added to the efforts of the joints, which do not tell of it, Nm;
            one for all joints or one for each; empty: none.
        environment: what is around the robot: by their names, things of
            :mod:`sim_bridge.environment`, or their keys and values.

    Raises:
        ConfigurationError: if a value is impossible.
    """

    rate: float = 1000.0
    control: str = "position"
    gui: bool = False
    collide_links: bool = False
    gravity: Sequence[float] = (0.0, 0.0, -9.81)
    servo_bandwidth: float = 100.0
    enforce_limits: bool = True
    protective_speed: float = SPEED_FACTOR
    tool_mass: float = 0.0
    tool_com: Sequence[float] = (0.0,) * 3
    tool_inertia: Sequence[float] = (0.0,) * 6
    tool_shape: str = NO_SHAPE
    tool_size: Sequence[float] = ()
    tool_position: Sequence[float] = (0.0,) * 3
    tool_orientation: Sequence[float] = NO_TURN
    friction_viscous: float | Sequence[float] = ()
    friction_coulomb: float | Sequence[float] = ()
    noise_position: float = 0.0
    noise_velocity: float = 0.0
    encoder_resolution: int = 0
    velocity_cutoff: float = 0.0
    noise_force: float = 0.0
    noise_torque: float = 0.0
    wrench_bias: Sequence[float] = (0.0,) * 6
    seed: int = 0
    disturbance_effort: float | Sequence[float] = ()
    environment: Mapping[str, Thing | Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        control, bandwidth = self.control, self.servo_bandwidth
        _require(control in CONTROLS, f"control must be one of {CONTROLS}, got {control!r}")
        for name, size in _SIZES.items():
            _require(np.shape(getattr(self, name)) == (size,), f"{name} must be {size} numbers")
            _require(np.isfinite(getattr(self, name)).all(), f"{name} must be finite")
        for name in ("rate", "servo_bandwidth"):
            _require(0.0 < getattr(self, name) < np.inf, f"{name} must be positive")
        _require(
            bandwidth <= self.rate,
            f"servo_bandwidth {bandwidth} rad/s must not exceed the rate {self.rate} Hz",
        )
        _require(
            1.0 <= self.protective_speed < np.inf,
            f"protective_speed must be at least 1, got {self.protective_speed}",
        )
        for name in _NOT_NEGATIVE:
            value = np.asarray(getattr(self, name))
            _require(bool(np.all((value >= 0.0) & (value < np.inf))), f"{name} must be 0 or more")
        is_finite = bool(np.isfinite(self.disturbance_effort).all())
        _require(is_finite, f"disturbance_effort must be finite, got {self.disturbance_effort}")
        object.__setattr__(self, "environment", read_environment(self.environment))
        self._check_velocity()
        moments = np.linalg.eigvalsh(self.tool.inertia)
        possible = moments[0] >= -_ROUNDING * moments[-1]
        _require(possible, f"tool_inertia has a negative principal moment: {moments}")
        self._check_tool_shape()
        stray = self.tool_mass == 0.0 and np.any(self.tool_inertia)
        _require(not stray, "tool_inertia is given without tool_mass")

    def _check_velocity(self) -> None:
        cutoff, noise = self.velocity_cutoff, self.noise_velocity
        _require(
            cutoff < self.rate / 2.0,
            f"velocity_cutoff {cutoff} Hz must be below half the rate {self.rate} Hz",
        )
        _require(
            cutoff == 0.0 or noise == 0.0,
            f"noise_velocity {noise} rad/s is given with velocity_cutoff {cutoff} Hz, which "
            "derives the velocity from the position; set one of them to 0",
        )

    def _check_tool_shape(self) -> None:
        turn = unit_quaternion("simulator: tool_orientation", self.tool_orientation)
        object.__setattr__(self, "tool_orientation", turn)
        shape, size = self.tool_shape, np.ravel(self.tool_size).tolist()
        if shape not in TOOL_SHAPES:
            raise UnknownNameError("value of tool_shape:", shape, TOOL_SHAPES)
        if shape != NO_SHAPE:
            check_size("simulator: tool_size", shape, size)
        _require(shape != NO_SHAPE or not size, "tool_size is given without tool_shape")
        if shape == NO_SHAPE and not self.collide_links:
            for name, thing in self.environment.items():
                _require(
                    not isinstance(thing, Solid),
                    f"environment.{name} is solid, but nothing of the robot can touch it; set "
                    "tool_shape and tool_size, or collide_links",
                )

    @property
    def tool_contact(self) -> Placed | None:
        """The shape of the tool in the sensor frame; None is none."""
        if self.tool_shape == NO_SHAPE:
            return None
        shape = geometry(self.tool_shape, np.ravel(self.tool_size).tolist())
        return Placed(shape, self.tool_position, rotation(self.tool_orientation))

    @property
    def tool(self) -> Body:
        """The tool in the sensor frame."""
        inertia = np.zeros((3, 3))
        inertia[_ROWS, _COLUMNS] = inertia[_COLUMNS, _ROWS] = self.tool_inertia
        return Body(self.tool_mass, np.array(self.tool_com, dtype=float), inertia)

    def noise(self, n: int) -> Array:
        """Return the standard deviations of (q, dq, wrench) of n joints, (2 n + 6,)."""
        deviations = (self.noise_position, self.noise_velocity, self.noise_force, self.noise_torque)
        return np.repeat(deviations, (n, n, 3, 3))


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ConfigurationError(f"simulator: {message}")
