"""The simulated robot: PyBullet behind a seam of few methods, free of ROS.

A second backend that has the methods of :class:`Simulator` can take its place.

Notation: ``q`` (n,) joint positions [rad], ``dq`` (n,) velocities [rad/s], ``tau`` (n,)
efforts [Nm], in the order of ``robot.joints`` (m, m/s, N if prismatic).  ``wrench`` (6,)
force [N] and moment [Nm] that the environment exerts on the tool, in the axes of the
sensor frame and about its origin.  The root link is at the origin of the world.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from eulerparams_control.errors import SimulationError
from eulerparams_control.events import ExitCode
from eulerparams_control.laws.friction import JointFriction
from eulerparams_control.laws.limits import JointLimits
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.catalogue import RobotDescription
from eulerparams_control.robot.urdf import MOVING, NO_LIMIT, UrdfTree, joint_friction, joint_limits
from sim_bridge.contacts import Contacts
from sim_bridge.engine import Engine, Sample
from sim_bridge.environment import Force, Solid, read_environment, total_wrench
from sim_bridge.friction import is_stiff, soften
from sim_bridge.parameters import NO_SHAPE, SimulatorParameters, each_joint
from sim_bridge.protection import STANDSTILL, Protection
from sim_bridge.rotors import with_rotors
from sim_bridge.saturation import Clipped, are_same, clip, find_clipped
from sim_bridge.sensors import Sensors, SimulatorState
from sim_bridge.servo import PositionServo
from sim_bridge.tool_load import Load

__all__ = ["Simulator", "SimulatorParameters", "SimulatorState"]

# Number of configurations within the limits in which the inertia is looked at.
_CONFIGURATIONS = 100


class Simulator:
    """A robot with its drivers, its brakes and its force/torque sensor.

    It is braked until the first command, and holds a command until the next one.
    Its dynamics are those of the URDF.  Rotors and friction are those of the parameters, else of
    the robot, else none and that of the URDF.
    What it touches has no friction while it is braked.

    Args:
        robot: the arm; its other moving joints are locked at zero.
        parameters: what else is simulated.

    Attributes:
        robot, parameters: as given.
        joint_names: all moving joints, those of the arm first.
        prismatic: whether each joint of the arm slides.
        turning: (n,) whether its position counts modulo a turn.
        engine: what moves the robot; where there are solids, another one after each reset.
        contacts: the solids.
        clipped: what of the last command had to be cut to a limit; None if nothing.
        violation: which joint went beyond what its limits allow in the last step, with limits:
            in torque control, and in any beyond what brakes could stop; "" if none.  The caller
            is to brake.

    Raises:
        ConfigurationError: if a friction or the disturbance is neither one number nor n.
        RobotError: if the robot cannot be simulated.
        SimulationError: if PyBullet cannot be started.
    """

    def __init__(self, robot: RobotDescription, parameters: SimulatorParameters) -> None:
        self.robot, self.parameters = robot, parameters
        joints, n = UrdfTree(robot.urdf).joints, len(robot.joints)
        moving = (name for name, joint in joints.items() if joint.get("type") in MOVING)
        self.joint_names = tuple(dict.fromkeys([*robot.joints, *moving]))
        arm = [joints[name] for name in robot.joints]
        self._limits = _limits(arm, parameters.enforce_limits)
        self.prismatic = [joint.get("type") == "prismatic" for joint in arm]
        self.turning = np.array(
            [parameters.wrap_continuous and joint.get("type") == "continuous" for joint in arm]
        )
        self._protection = Protection(robot.joints, self._limits, parameters.protective_speed)
        self._is_protected = parameters.enforce_limits and parameters.control == "torque"
        self._friction = _friction(robot, arm, parameters)
        self._has_friction = not self._friction.is_none
        zero = self._zero = np.zeros(n)
        self._disturbance = each_joint("disturbance_effort", parameters.disturbance_effort, zero)
        self._is_disturbed = bool(self._disturbance.any())
        self._rotors = _each_joint("rotor_inertia", robot, parameters, zero)
        self._has_rotors = bool(self._rotors.any())
        things = read_environment(parameters.environment)
        self._forces = [thing for thing in things.values() if isinstance(thing, Force)]
        self._solids = {name: thing for name, thing in things.items() if isinstance(thing, Solid)}
        self._dt = 1.0 / parameters.rate
        self._slowest, self._fastest = -self._limits.velocity, self._limits.velocity
        self._least, self._most = -self._limits.effort, self._limits.effort
        self._bias = np.array(parameters.wrench_bias, dtype=float)
        self._sensors = Sensors(parameters, self.turning)
        self._servo = PositionServo(
            parameters.servo_bandwidth, parameters.servo_lag, self.turning, self._dt
        )
        self._effort: Array | None = None  # torque control is on
        self._external: list[float] | None = None
        self._start_engine()
        gravity = np.array(parameters.gravity, dtype=float)
        self._load = Load(self.engine.load, gravity, self._dt)
        self._needs_motion = self.engine.load.mass > 0.0 or bool(self._forces)
        self._is_stiff = self._has_friction and is_stiff(
            self._friction, map(self._inertia, self._configurations()), self._dt
        )
        self.reset()

    def reset(self, q0: ArrayLike | None = None) -> None:
        """Brake at ``q0`` (n,), default the home, at time 0; the noise restarts.

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
        # What is not a number once stays in PyBullet's motors, and contacts in its memory.
        if self._is_broken or (self._solids and self._is_used):
            self.engine.close()
            self._start_engine()
        self._external = None
        self.clipped: Clipped | None = None
        self.violation = ""
        self._wild = -2  # the last step after which no brakes could stop the joints
        self._protection.reset()
        self._count = 0
        self.engine.place(q)
        self._q: Array = q
        self._dq: Array = self._zero
        if self._needs_motion:
            self._motion = self.engine.sensor_motion()
        self.brake()
        self._advance()  # the brakes take the weight
        self.engine.place(q)
        self._load.reset()
        self._sensors.reset()
        self._sense()

    def read(self) -> SimulatorState:
        """Return what is measured at the present step."""
        return self._state

    def command_position(self, q_ref: ArrayLike, dq_ref: ArrayLike) -> None:
        """Let the servo follow ``q_ref`` (n,) moving at ``dq_ref`` (n,), clipped to the limits.

        The servo sets dq = dq_ref + servo_bandwidth (q_ref - q), with at most the effort
        limit: an error decays as (1 - servo_bandwidth dt)^steps.  With a ``servo_lag`` see
        :class:`sim_bridge.servo.PositionServo`.  What is ``clipped`` is the command; that the
        joints cannot follow it at once is not.

        Raises:
            SimulationError: if one is not n finite numbers; then nothing changes.
        """
        self._require("position")
        q, dq = self._vector("q_ref", q_ref), self._vector("dq_ref", dq_ref)
        self.contacts.rub(True)
        self.clipped = None
        within = self._cut("position", q, self._limits.lower, self._limits.upper)
        self._servo.follow(within, dq, self._q)
        self._cut("speed", dq, self._slowest, self._fastest)

    def command_effort(self, tau: ArrayLike) -> None:
        """Let the motors exert ``tau`` (n,), clipped to the limits, and release the brakes.

        Raises:
            SimulationError: if it is not n finite numbers; then nothing changes.
        """
        self._require("torque")
        effort = self._vector("tau", tau)
        self.contacts.rub(True)
        if self._effort is None:
            self.engine.drive(self._zero, self._zero)
            self._protection.let_stand(self._q.tolist())
        self.clipped = None
        self._effort = self._cut("effort", effort, self._least, self._most)

    def _cut(self, quantity: str, asked: Array, lower: Array, upper: Array) -> Array:
        """Return what was asked for, clipped to limits; note what was ``clipped`` first."""
        given = clip(asked, lower, upper)
        if self.clipped is None and not are_same(asked, given):
            joints = self.robot.joints, self.prismatic
            self.clipped = find_clipped(*joints, quantity, asked, given)
        return given

    @property
    def motion(self) -> tuple[Array, Array]:
        """The true q and dq (n,), whatever the drivers report."""
        return self._q, self._dq

    @property
    def is_pushed(self) -> bool:
        """Whether an external wrench acts on the tool."""
        return self._external is not None

    @property
    def is_standing(self) -> bool:
        """Whether all joints are at rest."""
        return float(np.abs(self._dq).max()) < STANDSTILL

    def brake(self) -> None:
        """Stop the joints with their full effort, until the next command."""
        self.clipped, self.violation = None, ""
        self._servo.release()
        self._effort = None
        self.contacts.rub(False)
        self.engine.drive(self._zero, self._limits.effort)

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
        self.violation = ""
        if self._servo.is_on:
            speed = clip(self._servo.speed(self._q), self._slowest, self._fastest)
            self.engine.drive(speed, self._most)
        self._advance()
        self._count += 1
        if (self._is_stiff or self._has_rotors) and self._effort is not None:
            self._correct()
        self._sense()

    def close(self) -> None:
        """End the simulation."""
        self.engine.close()

    def _start_engine(self) -> None:
        self._is_broken = self._is_used = False
        self.engine = Engine(self.robot, self.parameters)
        p = self.parameters
        single = p.tool_shape in (NO_SHAPE, "sphere") and not p.collide_links
        self.contacts = Contacts(self.engine, self._solids, single=single)

    def _advance(self) -> None:
        """Let PyBullet step under what acts on the joints and on the tool."""
        self._is_used = True
        effort = self._effort
        if self._has_friction:
            lost = self._friction.effort(self._dq)
            effort = (self._zero if effort is None else effort) - lost
        if self._is_disturbed:
            effort = self._disturbance + (self._zero if effort is None else effort)
        if effort is not None:
            self.engine.exert(effort)
        t = self._count / self.parameters.rate
        if self._forces:
            acting = total_wrench(self._forces, t, self._motion)
            if self._external is not None:
                acting += self._external
            self.engine.push(acting.tolist())
        elif self._external is not None:
            self.engine.push(self._external)
        if self._solids:
            self.contacts.prepare(t)
        self.engine.step()

    def _configurations(self) -> Array:
        """Return configurations all over the limits, (_CONFIGURATIONS, n); the same always."""
        lower, upper = np.clip((self._limits.lower, self._limits.upper), -np.pi, np.pi)
        shape = _CONFIGURATIONS, len(lower)
        return np.random.default_rng(0).uniform(lower, upper, shape)

    def _inertia(self, q: Array) -> Array:
        """Return the inertia M (n, n) at q (n,) that the motors feel."""
        return self.engine.inertia(q) + np.diag(self._rotors)

    def _correct(self) -> None:
        """Correct the last step for rotors, and for a friction that is too stiff for it."""
        sample = self.engine.sample()
        q, dq = np.array(sample.q), np.array(sample.dq)
        dq_after, M = dq, self.engine.inertia(self._q)
        if self._has_rotors:
            dq_after = with_rotors(M, self._rotors, self._dq, dq)
            M = M + np.diag(self._rotors)
        if self._is_stiff:
            dq_after = soften(self._friction, M, self._dt, self._dq, dq_after)
        self.engine.place(q + self._dt * (dq_after - dq), dq_after)

    def _lock(self, dq: Sequence[float]) -> str:
        """Lock the joints where they were before a step after which no brakes could stop them.

        A push on the tool is released.  Where there is none to release they are locked once only:
        what still drives them after that leads where it leads.  Returns why; "" if they are free.
        """
        if not self.parameters.enforce_limits or not (wild := self._protection.unstoppable(dq)):
            return ""
        goes_on, self._wild = self._wild == self._count - 1, self._count
        if self._external is None and goes_on:
            return ""
        self.engine.place(self._q)
        pushed, self._external = self._external is not None, None
        return f"{wild}: locked where it was" + pushed * ", and the push released"

    def _sense(self) -> None:
        """Let the sensors measure.

        What the arm exerts on the massless links beyond the sensor is minus what touches
        them; the weight and the inertia of the load come on top.
        """
        sample, locked = self.engine.sample(), ""
        is_slow = self._protection.is_slow(sample.dq)
        if not is_slow and (locked := self._lock(sample.dq)):
            sample = self.engine.sample()
        self._check(sample, is_slow or max(map(abs, sample.dq)) < NO_LIMIT)
        dq_before, self._q, self._dq = self._dq, np.array(sample.q), np.array(sample.dq)
        is_free = not self._is_protected or self._effort is None
        if not is_free and not (is_slow and self._protection.is_within(sample.q)):
            self.violation = self._protection.violation(sample.q, sample.dq)
        self.violation = locked or self.violation
        tau = self._effort
        if tau is None:
            tau = np.array(sample.motors)
            if self._has_rotors:
                tau += self._rotors * (self._dq - dq_before) / self._dt
        wrench = self._bias - np.array(sample.reaction)
        if self._needs_motion:
            self._motion = self.engine.sensor_motion()
        if self.engine.load.mass > 0.0:
            wrench += self._load.wrench(self._motion)
            self._check(sample._replace(reaction=wrench.tolist()))
        q, dq, wrench = self._sensors.measure(self._q, self._dq, wrench)
        t = self._count / self.parameters.rate
        self._state = SimulatorState(self._count, t, q, dq, tau, wrench)

    def _check(self, sample: Sample, is_limited: bool = True) -> None:
        """Refuse what is not finite; a speed of ``NO_LIMIT`` stands for an infinite one."""
        if is_limited and math.isfinite(sum(map(sum, sample))):
            return
        self._is_broken = True
        q, dq, motors, sensor = map(_text, sample)
        effort = motors if self._effort is None else _text(self._effort)
        raise SimulationError(
            f"the state of the robot is not finite after step {self._count}: "
            f"q {q}, dq {dq} ({NO_LIMIT:g} is infinite), effort {effort}, sensor {sensor}",
            ExitCode.DIVERGED,
        )

    def _require(self, control: str) -> None:
        if self.parameters.control != control:
            raise SimulationError(
                f"a {control} command, but control is '{self.parameters.control}'"
            )

    def _vector(self, name: str, values: ArrayLike, size: int | None = None) -> Array:
        """Return a copy of ``size`` (default: n) finite numbers."""
        size = len(self.robot.joints) if size is None else size
        vector = np.array(values, dtype=float)
        if vector.shape != (size,) or not all(map(math.isfinite, vector.tolist())):
            raise SimulationError(f"{name} must be {size} finite numbers, got {values!r}")
        return vector


def _friction(
    robot: RobotDescription, joints: list[ET.Element], parameters: SimulatorParameters
) -> JointFriction:
    """Return the friction of the joints."""
    viscous, coulomb = np.array([joint_friction(joint) for joint in joints]).T
    return JointFriction(
        _each_joint("friction_viscous", robot, parameters, viscous),
        _each_joint("friction_coulomb", robot, parameters, coulomb),
    )


def _each_joint(
    name: str, robot: RobotDescription, parameters: SimulatorParameters, stated: Array
) -> Array:
    """Return a value (n,) of the parameters, else of the robot's YAML, else as the URDF states."""
    known = each_joint(name, getattr(robot, name), stated)
    return each_joint(name, getattr(parameters, name), known)


def _limits(joints: list[ET.Element], enforced: bool) -> JointLimits:
    """Return the limits of the joints, boundless unless enforced."""
    stated = np.array([joint_limits(joint) for joint in joints]).T  # (4, n)
    if not enforced:
        stated = np.array([[-np.inf], [np.inf], [np.inf], [np.inf]]) + np.zeros_like(stated)
    return JointLimits(*np.clip(stated, -NO_LIMIT, NO_LIMIT))


def _text(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{value:.3g}" for value in values) + "]"
