"""Parameters of the simulation: rate, control, tool, surroundings, friction, noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.parameters.fields import parameter
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
                 "velocity_cutoff", "servo_lag", "rotor_inertia")  # fmt: skip

_ROUNDING = 1e-12  # of a principal moment that is zero, relative to the largest

_ROWS, _COLUMNS = np.triu_indices(3)  # xx, xy, xz, yy, yz, zz


@dataclass(frozen=True)
class SimulatedParameters:
    """What the node and the simulator share; in the sensor frame unless it is said otherwise."""

    control: str = parameter("position", "what a command is", choices=CONTROLS)
    rate: float = parameter(1000.0, "steps per second", unit="Hz", bounds=(10.0, 10000.0))
    gui: bool = parameter(False, "open PyBullet's window")
    servo_bandwidth: float = parameter(
        100.0, "of the joint servo in position control", unit="rad/s", bounds=(0.1, 10000.0)
    )
    servo_lag: float = parameter(
        0.0,
        "of the first order, with which the joint servo follows positions; 0: none, and the "
        "commanded speed is fed forward",
        unit="s",
        bounds=(0.0, 1.0),
    )
    enforce_limits: bool = parameter(True, "clip commands to the limits of the URDF")
    protective_speed: float = parameter(
        SPEED_FACTOR,
        "times its speed limit, a joint makes the robot stop, in torque control with limits",
        bounds=(1.0, 1000.0),
    )
    gravity: tuple[float, ...] = parameter((0.0, 0.0, -9.81), "in the base frame", unit="m/s^2")
    tool_mass: float = parameter(0.0, "beyond the sensor", unit="kg", bounds=(0.0, 1000.0))
    tool_com: tuple[float, ...] = parameter((0.0, 0.0, 0.0), "in the sensor frame", unit="m")
    tool_inertia: tuple[float, ...] = parameter(
        (0.0,) * 6, "xx, xy, xz, yy, yz, zz about the centre of mass", unit="kg m^2"
    )
    tool_shape: str = parameter(
        NO_SHAPE, "of the tool, which touches what is around it", choices=TOOL_SHAPES
    )
    tool_size: tuple[float, ...] = parameter(
        (), "radius of a sphere; x, y, z; radius, length of a cylinder or a capsule", unit="m"
    )
    tool_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "of the shape in the sensor frame", unit="m"
    )
    tool_orientation: tuple[float, ...] = parameter(
        NO_TURN, "of the shape in the sensor frame, x, y, z, w"
    )
    collide_links: bool = parameter(False, "let the links touch what is around them too")
    friction_viscous: tuple[float, ...] = parameter(
        (), "one, or one a joint; empty: of the robot, else damping of the URDF", unit="Nm s/rad"
    )
    friction_coulomb: tuple[float, ...] = parameter(
        (), "one, or one a joint; empty: of the robot, else friction of the URDF", unit="Nm"
    )
    rotor_inertia: tuple[float, ...] = parameter(
        (),
        "of the motors, at the joints; one, or one a joint; empty: of the robot, else none",
        unit="kg m^2",
    )
    wrap_continuous: bool = parameter(
        False,
        "report positions of continuous joints in (-pi, pi], as ros2_kortex, and take those of "
        "commands modulo a turn",
    )
    velocities: bool = parameter(
        True, "report the velocities of the joints; false: NaN, as joint_state_broadcaster"
    )
    noise_position: float = parameter(0.0, "standard deviation", unit="rad", bounds=(0.0, 1.0))
    noise_velocity: float = parameter(0.0, "standard deviation", unit="rad/s", bounds=(0.0, 10.0))
    encoder_resolution: int = parameter(
        0, "counts per turn of the encoders; 0: exact", bounds=(0, 2**31 - 1)
    )
    velocity_cutoff: float = parameter(
        0.0,
        "of the filter that derives velocities from positions; 0: as simulated",
        unit="Hz",
        bounds=(0.0, 5000.0),
    )
    noise_force: float = parameter(0.0, "standard deviation", unit="N", bounds=(0.0, 1000.0))
    noise_torque: float = parameter(0.0, "standard deviation", unit="Nm", bounds=(0.0, 1000.0))
    wrench_bias: tuple[float, ...] = parameter((0.0,) * 6, "of the sensor", unit="N, Nm")
    seed: int = parameter(0, "of the noise", bounds=(0, 2**31 - 1))
    disturbance_effort: tuple[float, ...] = parameter(
        (), "on the joints, which do not report it; one, or one a joint; empty: none", unit="Nm"
    )


@dataclass(frozen=True)
class SimulatorParameters(SimulatedParameters):
    """Parameters of :class:`sim_bridge.simulator.Simulator`, checked together.

    With limits no joint is faster than ten times what makes the robot stop, in any control: it is
    locked.  The shape of the tool has no mass but ``tool_mass``.  ``servo_bandwidth`` is at most
    ``rate``, ``velocity_cutoff`` below half of it and without ``noise_velocity``.

    Attributes:
        environment: what is around the robot: by their names, things of
            :mod:`sim_bridge.environment`, or their keys and values.

    Raises:
        ConfigurationError: if a value is impossible.
    """

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
        """The shape of the tool in the sensor frame; None: no tool."""
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


def each_joint(name: str, value: float | Sequence[float], stated: Array) -> Array:
    """Return the value (n,) of a parameter for each joint; empty is as stated (n,).

    Raises:
        ConfigurationError: if it is neither one number nor n.
    """
    n = len(stated)
    if np.shape(value) not in ((), (0,), (1,), (n,)):
        raise ConfigurationError(f"simulator: {name} must be empty, one number or {n}, got {value}")
    return np.broadcast_to(np.asarray(value, dtype=float), n) if np.size(value) else stated
