"""The only user of PyBullet: one robot, and the solids around it, on a client of its own.

Joint vectors are (n,) in the order of ``robot.joints``: rad, rad/s, Nm (m, m/s, N if
prismatic).  The root link is at the origin of the world.
"""

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pybullet

from eulerparams_control.errors import RobotError, SimulationError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.catalogue import RobotDescription
from eulerparams_control.robot.urdf import NO_LIMIT
from sim_bridge.environment import SensorMotion
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.urdf import SENSOR_LINK, Placed, simulation_urdf, solid_urdf

# The joint motors are coupled and solved by iteration.  At PyBullet's defaults, 50 and 1e-7,
# joint speeds are wrong by up to 0.5 rad/s and a braked arm sinks; these leave 5e-8 rad/s.
_SOLVER_ITERATIONS = 1000
_SOLVER_RESIDUAL = 1e-16

_ORIGIN = (0.0, 0.0, 0.0)

# Without it a cylinder is a prism of 32 sides, a millimetre too large.
_FLAGS = pybullet.URDF_USE_IMPLICIT_CYLINDER

# PyBullet takes the stiffnesses of two bodies in series, their damping in sum, and their
# friction as a product: these leave those of the other body.
_NEUTRAL = {"contactStiffness": NO_LIMIT**2, "contactDamping": 0.0, "lateralFriction": 1.0}


class Sample(NamedTuple):
    """What PyBullet knows after a step.

    Attributes:
        q, dq: positions and velocities; n each.
        motors: efforts of the motors, without those of ``exert``; n.
        reaction: force and moment of the arm on what the sensor carries, in the axes of
            the sensor frame and about its origin, N and Nm; 6.
    """

    q: Sequence[float]
    dq: Sequence[float]
    motors: Sequence[float]
    reaction: Sequence[float]


class Engine:
    """A robot in PyBullet, with the dynamics of its URDF.

    A step is semi-implicit Euler: dq += dt ddq(q, dq, tau), then q += dt dq.

    Args:
        robot: the arm; its other moving joints are locked at zero.
        parameters: what else is simulated.

    Attributes:
        client, body, sensor_link: of PyBullet, for an environment to add to.
        load: the body that the sensor carries, in the sensor frame.

    Raises:
        RobotError: if PyBullet cannot simulate the robot.
        SimulationError: if PyBullet cannot be started.
    """

    def __init__(self, robot: RobotDescription, parameters: SimulatorParameters) -> None:
        shapes = ["collision"] * (parameters.collide_links or parameters.gui)
        shapes += ["visual"] * parameters.gui
        model = simulation_urdf(
            robot,
            parameters.tool,
            stops=parameters.enforce_limits,
            shapes=shapes,
            touching=parameters.tool_contact,
        )
        self.client = _connect(parameters)
        self.body = _load(self.client, model.text)
        self.load = model.load
        joints, links = _indices(self.client, self.body)
        _make_exact(self.client, self.body, links, model.moments)
        self._arm = [joints[name] for name in robot.joints]
        self.sensor_link = links[SENSOR_LINK]
        self._rank = np.argsort(np.argsort(self._arm))
        self._sensed = [*self._arm, self.sensor_link]
        self._links = [-1, *links.values()]
        moved = _moved(self.client, self.body, self._arm)
        self._touching = moved if parameters.collide_links else {self.sensor_link}
        pybullet.enableJointForceTorqueSensor(self.body, self.sensor_link, True, self.client)

    def place(self, q: Array, dq: Array | None = None) -> None:
        """Put the arm at ``q``, moving at ``dq``, default at rest."""
        speeds = [0.0] * len(self._arm) if dq is None else dq.tolist()
        for joint, value, speed in zip(self._arm, q.tolist(), speeds, strict=True):
            pybullet.resetJointState(self.body, joint, value, speed, self.client)

    def drive(self, dq: Array, effort: Array) -> None:
        """Let motors reach ``dq`` within each step from now on, with at most ``effort``."""
        pybullet.setJointMotorControlArray(
            self.body,
            self._arm,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=dq.tolist(),
            forces=effort.tolist(),
            physicsClientId=self.client,
        )

    def exert(self, tau: Array) -> None:
        """Add ``tau`` to the joints during the next step."""
        pybullet.setJointMotorControlArray(
            self.body,
            self._arm,
            pybullet.TORQUE_CONTROL,
            forces=tau.tolist(),
            physicsClientId=self.client,
        )

    def push(self, wrench: Sequence[float]) -> None:
        """Add force and moment, 6, at the sensor frame, in its axes, during the next step.

        The link there is massless, so that PyBullet's frame of it is the sensor frame.
        """
        link, axes = self.sensor_link, pybullet.LINK_FRAME
        self._sensor_state()
        pybullet.applyExternalForce(self.body, link, wrench[:3], _ORIGIN, axes, self.client)
        pybullet.applyExternalTorque(self.body, link, wrench[3:], axes, self.client)

    def step(self) -> None:
        """Advance by one step."""
        pybullet.stepSimulation(self.client)

    def sample(self) -> Sample:
        """Return joints and sensor after the last step."""
        states = pybullet.getJointStates(self.body, self._sensed, self.client)
        q, dq, reactions, motors = zip(*states, strict=True)
        return Sample(q[:-1], dq[:-1], motors[:-1], reactions[-1])  # the sensor is the last

    def inertia(self, q: Array) -> Array:
        """Return the joint-space inertia M at ``q``, (n, n), kg m^2."""
        in_tree = np.empty_like(q)
        in_tree[self._rank] = q
        M = pybullet.calculateMassMatrix(self.body, in_tree.tolist(), physicsClientId=self.client)
        return np.array(M)[np.ix_(self._rank, self._rank)]

    def sensor_motion(self) -> SensorMotion:
        """Return how the sensor frame lies and moves."""
        state = self._sensor_state()
        # Pose of the centre of mass, here the same; that of the link is in float32.
        R = np.array(pybullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
        return SensorMotion(np.array(state[0]), R, np.array(state[6]), np.array(state[7]))

    def _sensor_state(self) -> Sequence[Sequence[float]]:
        """Return PyBullet's state of the sensor link, brought up to date with the joints.

        Without this the frames of the links, and the axes of a push, are those of the
        step before.
        """
        state: Sequence[Sequence[float]] = pybullet.getLinkState(
            self.body,
            self.sensor_link,
            computeLinkVelocity=True,
            computeForwardKinematics=True,
            physicsClientId=self.client,
        )
        return state

    def add_solid(self, solid: Placed) -> int:
        """Put a solid into the world that the robot touches; return PyBullet's body of it."""
        body = _load(self.client, solid_urdf(solid))
        for link in self._links:
            if link in self._touching:
                pybullet.changeDynamics(self.body, link, **_NEUTRAL, physicsClientId=self.client)
            else:
                self._filter(body, link, False)
        return body

    def let_touch(self, body: int, whether: bool) -> None:
        """Let the robot touch a solid from the next step on, or not."""
        for link in self._touching:
            self._filter(body, link, whether)

    def _filter(self, body: int, link: int, whether: bool) -> None:
        pybullet.setCollisionFilterPair(
            self.body, body, link, -1, whether, physicsClientId=self.client
        )

    def set_contact(self, body: int, stiffness: float, damping: float, friction: float) -> None:
        """Set stiffness [N/m], damping [Ns/m] and friction of each point that touches a solid."""
        pybullet.changeDynamics(
            body,
            -1,
            contactStiffness=stiffness,
            contactDamping=damping,
            lateralFriction=friction,
            physicsClientId=self.client,
        )

    def find_contacts(self) -> None:
        """Find the contacts of the present state, as the next step will."""
        pybullet.performCollisionDetection(physicsClientId=self.client)

    def depths(self, body: int) -> list[float]:
        """Return how deep each point of the robot near a solid is in it, m; outside it < 0."""
        points = pybullet.getContactPoints(self.body, body, physicsClientId=self.client)
        return [-point[8] for point in points or ()]

    def close(self) -> None:
        """End the client."""
        if pybullet.isConnected(self.client):
            pybullet.disconnect(self.client)


def _connect(parameters: SimulatorParameters) -> int:
    if parameters.gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise SimulationError("no display for PyBullet's window; set gui to false")  # it would exit
    client = int(pybullet.connect(pybullet.GUI if parameters.gui else pybullet.DIRECT))
    if client < 0:
        raise SimulationError("PyBullet cannot be started")
    pybullet.setPhysicsEngineParameter(
        fixedTimeStep=1.0 / parameters.rate,
        numSolverIterations=_SOLVER_ITERATIONS,
        solverResidualThreshold=_SOLVER_RESIDUAL,
        enableFileCaching=False,
        contactSlop=0.0,
        physicsClientId=client,
    )
    pybullet.setGravity(*parameters.gravity, physicsClientId=client)
    return client


def _load(client: int, text: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(text, encoding="utf-8")
        options = {"useFixedBase": True, "flags": _FLAGS, "physicsClientId": client}
        try:
            return int(pybullet.loadURDF(str(path), **options))
        except pybullet.error as error:
            raise RobotError(f"PyBullet cannot load the robot: {error}") from error


def _indices(client: int, body: int) -> tuple[dict[str, int], dict[str, int]]:
    """Return PyBullet's index of each joint, and of each link but the root."""
    count = pybullet.getNumJoints(body, client)
    infos = [pybullet.getJointInfo(body, index, client) for index in range(count)]
    joints = {info[1].decode(): info[0] for info in infos}
    return joints, {info[12].decode(): info[0] for info in infos}


def _moved(client: int, body: int, arm: Sequence[int]) -> set[int]:
    """Return the links that the joints of the arm move; parents come before their children."""
    moved = set[int]()
    for index in range(pybullet.getNumJoints(body, client)):
        if index in arm or pybullet.getJointInfo(body, index, client)[16] in moved:
            moved.add(index)
    return moved


def _make_exact(client: int, body: int, links: dict[str, int], moments: dict[str, Array]) -> None:
    """Take back the damping and the speed limit that PyBullet adds, and set the inertias.

    In one call with a damping, PyBullet drops what is said of a link.
    """
    pybullet.changeDynamics(
        body,
        -1,
        linearDamping=0.0,
        angularDamping=0.0,
        maxJointVelocity=NO_LIMIT,
        physicsClientId=client,
    )
    for link, index in links.items():
        inertia = moments[link].tolist()
        pybullet.changeDynamics(body, index, localInertiaDiagonal=inertia, physicsClientId=client)
