"""The simulated robot: PyBullet behind a seam of few methods, free of ROS.

A second backend that has the methods of :class:`Simulator` can take its place.

Notation: ``q`` (n,) joint positions [rad], ``dq`` (n,) velocities [rad/s], ``tau`` (n,)
efforts [Nm], in the order of ``robot.joints`` (m, m/s, N if prismatic).  ``wrench`` (6,)
force [N] and moment [Nm] that the environment exerts on the tool, in the axes of the
sensor frame and about its origin.  The root link stands at the origin of the world.
"""

import math
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet  # type: ignore[import-not-found]
from numpy.typing import ArrayLike

from eulerparams_control.catalogue import RobotDescription
from eulerparams_control.errors import ConfigurationError, RobotError, SimulationError
from eulerparams_control.limits import JointLimits
from eulerparams_control.rotations import Array
from eulerparams_control.urdf import MOVING, UrdfTree, joint_limits
from sim_bridge.load import Load
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.urdf import NO_LIMIT, SENSOR_LINK, simulation_urdf

__all__ = ["Simulator", "SimulatorParameters", "SimulatorState"]

# The joint motors are coupled.  At its default, 1e-7, PyBullet's solver stops with joint
# speeds wrong by 6e-4 rad/s and a braked arm sinks; this leaves less than 1e-7 rad/s.
_SOLVER_RESIDUAL = 1e-16

# Coulomb friction fades below this speed [rad/s]; an abrupt one would chatter.
_COULOMB_SPEED = 0.05


@dataclass(frozen=True, slots=True)
class SimulatorState:
    """What the robot's drivers report.

    Attributes:
        step: number of steps since the reset.
        t: ``step / rate``, s.
        q, dq: (n,) measured.
        tau: (n,) effort of the motors during the last step.
        wrench: (6,) measured.
    """

    step: int
    t: float
    q: Array
    dq: Array
    tau: Array
    wrench: Array


class Simulator:
    """A robot on its own PyBullet client.

    It stands braked until the first command, and holds a command until the next one.
    A step is semi-implicit Euler: dq += dt ddq(q, dq, tau), then q += dt dq; the
    dynamics are those of the URDF, without its damping.

    Args:
        robot: the arm; its other moving joints are locked at zero.
        parameters: what else is simulated.

    Attributes:
        robot, parameters: as given.
        joint_names: all moving joints, those of the arm first.
        client, body, sensor_link: of PyBullet, for an environment to add to.

    Raises:
        RobotError: if PyBullet cannot simulate the robot.
        SimulationError: if PyBullet cannot be started.
    """

    def __init__(self, robot: RobotDescription, parameters: SimulatorParameters) -> None:
        self.robot, self.parameters = robot, parameters
        joints = UrdfTree(robot.urdf).joints
        moving = (name for name, joint in joints.items() if joint.get("type") in MOVING)
        self.joint_names = tuple(dict.fromkeys([*robot.joints, *moving]))
        self._limits = _limits([joints[name] for name in robot.joints], parameters.enforce_limits)
        self._viscous = self._each("friction_viscous", parameters.friction_viscous)
        self._coulomb = self._each("friction_coulomb", parameters.friction_coulomb)
        self._has_friction = bool(np.any(self._viscous) or np.any(self._coulomb))
        self._bias = np.array(parameters.wrench_bias, dtype=float)
        self._dt = 1.0 / parameters.rate
        self._reference: tuple[Array, Array] | None = None  # position mode: q_ref, dq_ref
        self._effort: Array | None = None  # torque mode
        self._no_effort = np.zeros(len(robot.joints))
        self._external: list[float] | None = None
        self.client = _connect(parameters, self._dt)
        self._load_robot()
        self.reset()

    def reset(self, q0: ArrayLike | None = None) -> None:
        """Stand braked at ``q0`` (n,), default the home, at time 0; the noise starts anew.

        Raises:
            SimulationError: if ``q0`` is not n finite numbers within the limits.
        """
        q = self._vector("q0", self.robot.home if q0 is None else q0)
        for name, value, lower, upper in zip(
            self.robot.joints, q, self._limits.lower, self._limits.upper, strict=True
        ):
            if not lower <= value <= upper:
                raise SimulationError(
                    f"q0 of joint '{name}', {value}, is outside {lower} ... {upper}"
                )
        self._random = np.random.default_rng(self.parameters.seed)
        self._external = None
        self._count = 0
        self._place(q)
        self.brake()
        pybullet.stepSimulation(physicsClientId=self.client)  # the brakes take the weight
        self._place(q)
        self._load.reset()
        self._sense()

    def read(self) -> SimulatorState:
        """Return what is measured at the present step."""
        return self._state

    def joint_states(self) -> tuple[Array, Array, Array]:
        """Return the measured q, dq and tau of all ``joint_names``."""
        n = len(self.joint_names) - len(self.robot.joints)
        state = self._state
        q, dq, tau = (np.append(values, np.zeros(n)) for values in (state.q, state.dq, state.tau))
        return q, dq, tau

    def command_position(self, q_ref: ArrayLike, dq_ref: ArrayLike) -> None:
        """Let the servo follow ``q_ref`` (n,) moving at ``dq_ref`` (n,), clipped to the limits.

        The servo sets dq = dq_ref + servo_bandwidth (q_ref - q), with at most the effort
        limit: an error decays as (1 - servo_bandwidth dt)^steps.

        Raises:
            SimulationError: if one is not n finite numbers; then nothing changes.
        """
        self._require("position")
        q, dq = self._vector("q_ref", q_ref), self._vector("dq_ref", dq_ref)
        self._reference = _clip(q, self._limits.lower, self._limits.upper), dq

    def command_effort(self, tau: ArrayLike) -> None:
        """Let the motors exert ``tau`` (n,), clipped to the limits, and release the brakes.

        Raises:
            SimulationError: if it is not n finite numbers; then nothing changes.
        """
        self._require("torque")
        effort = self._vector("tau", tau)
        if self._effort is None:
            self._drive_motors(self._no_effort, self._no_effort)
        self._effort = _clip(effort, -self._limits.effort, self._limits.effort)

    def brake(self) -> None:
        """Stop the joints with their full effort, until the next command."""
        self._reference = self._effort = None
        self._drive_motors(self._no_effort, self._limits.effort)

    def set_external_wrench(self, wrench: ArrayLike | None) -> None:
        """Push the tool with ``wrench`` (6,) from now on; None stops it.

        Raises:
            SimulationError: if it is not 6 finite numbers; then nothing changes.
        """
        self._external = None if wrench is None else self._vector("wrench", wrench, 6).tolist()

    def step(self) -> None:
        """Advance by one step.

        Raises:
            SimulationError: if the state is not finite any more; ``reset`` mends it.
        """
        if self._reference is not None:
            self._servo(*self._reference)
        if self._effort is not None or self._has_friction:
            self._exert()
        if self._external is not None:
            self._push(self._external)
        pybullet.stepSimulation(physicsClientId=self.client)
        self._count += 1
        self._sense()

    def close(self) -> None:
        """End the PyBullet client."""
        if pybullet.isConnected(self.client):
            pybullet.disconnect(self.client)

    def _load_robot(self) -> None:
        parameters = self.parameters
        shapes = ["collision"] * (parameters.collisions or parameters.gui)
        shapes += ["visual"] * parameters.gui
        model = simulation_urdf(
            self.robot, parameters.tool, stops=parameters.enforce_limits, shapes=shapes
        )
        self.body = _load_urdf(self.client, model.text)
        joints, links = _indices(self.client, self.body)
        for link, index in links.items():
            pybullet.changeDynamics(
                self.body, index, linearDamping=0.0, angularDamping=0.0, maxJointVelocity=NO_LIMIT,
                localInertiaDiagonal=model.moments[link].tolist(), physicsClientId=self.client,
            )  # fmt: skip
        self._arm = [joints[name] for name in self.robot.joints]
        self.sensor_link = links[SENSOR_LINK]
        self._sensed = [*self._arm, self.sensor_link]
        pybullet.enableJointForceTorqueSensor(self.body, self.sensor_link, 1, self.client)
        self._load = Load(model.load, np.array(parameters.gravity, dtype=float), self._dt)
        self._is_loaded = model.load.mass > 0.0

    def _place(self, q: Array) -> None:
        for joint, value in zip(self._arm, q.tolist(), strict=True):
            pybullet.resetJointState(self.body, joint, value, 0.0, physicsClientId=self.client)

    def _drive_motors(self, dq: Array, effort: Array) -> None:
        """Let the joint motors reach dq (n,) within a step, with at most the effort (n,)."""
        pybullet.setJointMotorControlArray(
            self.body, self._arm, pybullet.VELOCITY_CONTROL, targetVelocities=dq.tolist(),
            forces=effort.tolist(), physicsClientId=self.client,
        )  # fmt: skip

    def _servo(self, q_ref: Array, dq_ref: Array) -> None:
        dq = dq_ref + self.parameters.servo_bandwidth * (q_ref - self._q)
        limit = self._limits.velocity
        self._drive_motors(_clip(dq, -limit, limit), self._limits.effort)

    def _exert(self) -> None:
        """Give the joints the commanded effort less the friction."""
        tau = self._no_effort if self._effort is None else self._effort
        if self._has_friction:
            tau = tau - self._viscous * self._dq
            tau -= self._coulomb * np.tanh(self._dq / _COULOMB_SPEED)
        pybullet.setJointMotorControlArray(
            self.body, self._arm, pybullet.TORQUE_CONTROL, forces=tau.tolist(),
            physicsClientId=self.client,
        )  # fmt: skip

    def _push(self, wrench: list[float]) -> None:
        """Apply a wrench at the massless sensor link, whose frame is the sensor frame."""
        pybullet.applyExternalForce(
            self.body,
            self.sensor_link,
            wrench[:3],
            (0.0, 0.0, 0.0),
            pybullet.LINK_FRAME,
            self.client,
        )
        pybullet.applyExternalTorque(
            self.body, self.sensor_link, wrench[3:], pybullet.LINK_FRAME, self.client
        )

    def _sense(self) -> None:
        """Read the joints and the sensor, which shows the reaction of what touches the tool."""
        *joints, sensor = pybullet.getJointStates(
            self.body, self._sensed, physicsClientId=self.client
        )
        q, dq, _, tau = zip(*joints, strict=True)
        if not math.isfinite(sum(q) + sum(dq)):
            raise SimulationError(f"the robot's state is not finite after step {self._count}")
        self._q, self._dq = np.array(q), np.array(dq)
        wrench = self._bias - np.array(sensor[2])
        if self._is_loaded:
            wrench += self._weigh()
        self._state = SimulatorState(
            step=self._count,
            t=self._count / self.parameters.rate,
            q=self._q,
            dq=self._dq,
            tau=np.array(tau) if self._effort is None else self._effort,
            wrench=wrench,
        )

    def _weigh(self) -> Array:
        """Return what the sensor feels of its own load."""
        state = pybullet.getLinkState(self.body, self.sensor_link, 1, physicsClientId=self.client)
        R = np.array(pybullet.getMatrixFromQuaternion(state[5])).reshape(3, 3)
        return self._load.wrench(R, np.array(state[6:8]))

    def _require(self, control: str) -> None:
        if self.parameters.control != control:
            raise SimulationError(
                f"a {control} command, but control is '{self.parameters.control}'"
            )

    def _vector(self, name: str, values: ArrayLike, size: int | None = None) -> Array:
        """Return a copy of ``size`` (default: n) finite numbers."""
        size = len(self._arm) if size is None else size
        vector = np.array(values, dtype=float)
        if vector.shape != (size,) or not math.isfinite(sum(vector.tolist())):
            raise SimulationError(f"{name} must be {size} finite numbers, got {values!r}")
        return vector

    def _each(self, name: str, value: float | Sequence[float]) -> Array:
        """Return the value (n,) of each joint."""
        n = len(self.robot.joints)
        if np.shape(value) not in ((), (n,)):
            raise ConfigurationError(f"simulator: {name} must be one number or {n}, got {value}")
        return np.broadcast_to(np.asarray(value, dtype=float), n)


def _connect(parameters: SimulatorParameters, dt: float) -> int:
    client = int(pybullet.connect(pybullet.GUI if parameters.gui else pybullet.DIRECT))
    if client < 0:
        raise SimulationError("PyBullet cannot open its window; set gui to false")
    pybullet.setPhysicsEngineParameter(
        fixedTimeStep=dt, solverResidualThreshold=_SOLVER_RESIDUAL, enableFileCaching=0,
        physicsClientId=client,
    )  # fmt: skip
    pybullet.setGravity(*parameters.gravity, physicsClientId=client)
    return client


def _load_urdf(client: int, text: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(text, encoding="utf-8")
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        try:
            return int(
                pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
            )
        except pybullet.error as error:
            raise RobotError(f"PyBullet cannot load the robot: {error}") from error


def _indices(client: int, body: int) -> tuple[dict[str, int], dict[str, int]]:
    """Return PyBullet's index of each joint and of each link but the root."""
    count = pybullet.getNumJoints(body, physicsClientId=client)
    infos = [pybullet.getJointInfo(body, index, physicsClientId=client) for index in range(count)]
    joints = {info[1].decode(): info[0] for info in infos}
    return joints, {info[12].decode(): info[0] for info in infos}


def _limits(joints: list[ET.Element], enforced: bool) -> JointLimits:
    """Return the limits of the joints, boundless unless enforced."""
    stated = np.array([joint_limits(joint) for joint in joints]).T  # (4, n)
    if not enforced:
        stated = np.array([[-np.inf], [np.inf], [np.inf], [np.inf]]) + np.zeros_like(stated)
    return JointLimits(*np.clip(stated, -NO_LIMIT, NO_LIMIT))


def _clip(values: Array, lower: Array, upper: Array) -> Array:
    """Return np.clip(values, lower, upper), in less than half the time."""
    return np.minimum(np.maximum(values, lower), upper)
