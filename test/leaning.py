"""An arm under efforts, and what pushes it: a hand, a wall; with the controller, in one process.

The plant is Pinocchio's forward dynamics with what textbook joints lack: friction, and rotors
that the controller does not know.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from arms import Plant as FreeArm
from arms import robot_named

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.control.mode import Mode
from eulerparams_control.laws.wrench import SensedWrench
from eulerparams_control.motion.frames import Placement
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot

INNER = 1e-4  # [s] a step of the plant is no longer
# Coulomb friction is tanh(dq / this) [rad/s].
SMOOTH = 0.01
# A hand follows the tip no faster [m/s]: its force falls to 0 there.
FASTEST_HAND = 1.0
AT_TIP = Placement(np.eye(3), np.zeros(3))


class Plant(FreeArm):
    """An arm by forward dynamics, with rotors and friction.

    Args:
        name: of the catalogue.
        rotors: [kg m^2] of each joint, seen from its output.
        viscous, coulomb: [Nm s/rad], [Nm] of each joint.
    """

    def __init__(self, name, rotors=0.1, viscous=1.0, coulomb=0.5):
        super().__init__(name)
        self.robot, self.viscous, self.coulomb = robot_named(name)[0], viscous, coulomb
        self.model.armature = np.full(self.robot.n, rotors)

    def jacobian(self):
        """Return J (6, n) of the tip, base axes; the base is the root."""
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return pin.computeFrameJacobian(self.model, self.data, self.q, self.tip, world)

    def gravity(self):
        return pin.computeGeneralizedGravity(self.model, self.data, self.q)

    def tip_state(self):
        """Return p_e (3,), R_e (3, 3), dp_e (3,)."""
        pin.framesForwardKinematics(self.model, self.data, self.q)
        pose = self.data.oMf[self.tip]
        return pose.translation.copy(), pose.rotation.copy(), (self.jacobian() @ self.dq)[:3]

    def push(self, tau, force, dt):
        """Move on by dt [s] under tau (n,) and force(p_e, dp_e) (3,) [N] on the tip."""
        count = int(np.ceil(dt / INNER - 1e-9))
        for _ in range(count):
            J = self.jacobian()
            pin.framesForwardKinematics(self.model, self.data, self.q)
            f = force(self.data.oMf[self.tip].translation, J[:3] @ self.dq)
            rubs = self.viscous * self.dq + self.coulomb * np.tanh(self.dq / SMOOTH)
            self.step(tau - rubs + J[:3].T @ f, dt / count)


@dataclass
class Hand:
    """Pushes with up to ``most`` [N] along ``axis`` (3,), as long as it pushes at all."""

    axis: np.ndarray
    most: float = 0.0

    def __call__(self, p, v):
        return max(0.0, 1.0 - float(self.axis @ v) / FASTEST_HAND) * self.most * self.axis

    def grow(self, leaning, most, seconds=0.2, until=None):
        """Push ever more, up to ``most`` [N], then as long again, or until it is true."""
        for k in range((2 if until is None else 5) * round(seconds / leaning.dt)):
            self.most = most * min(1.0, (k + 1) * leaning.dt / seconds)
            leaning.tick()
            if until is not None and until():
                return


@dataclass
class Wall:
    """A plane through ``at`` (3,), that is free on the side of ``normal`` (3,)."""

    at: np.ndarray
    normal: np.ndarray
    stiffness: float
    damping: float = 50.0

    def __call__(self, p, v):
        depth = float(self.normal @ (self.at - p))
        if depth <= 0:
            return np.zeros(3)
        push = self.stiffness * depth - self.damping * float(self.normal @ v)
        return max(0.0, push) * self.normal


def most_that_joints_hold(plant, axis):
    """Return the force [N] along an axis (3,) at which the weakest joint gives way."""
    lever = np.maximum(np.abs(plant.jacobian()[:3].T @ axis), 1e-9)
    return ((plant.robot.limits.effort - np.abs(plant.gravity())) / lever).min()


class Leaning:
    """A controller and its plant, in lock-step; ``force`` acts on the tip.

    Its commands act ``late`` ticks later.

    Attributes:
        is_blind: whether its force/torque sensor is lost.
        path, speeds, joints, efforts: p_e (3,), the speed of the tip [m/s], |dq| (n,) and the
            command (n,) of each tick; None: there was none.
    """

    def __init__(self, law, arm, rate=500, parameters=None, late=0, **plant):
        about = load_robot(arm)
        given = schemes()[law].parameters(
            base_frame=about.base_frame, tip_frame=about.tip_frame, **(parameters or {})
        )
        self.plant, self.dt, self.k = Plant(arm, **plant), 1.0 / rate, 0
        robot = given.robot(about.urdf)
        self.scheme = given.make_scheme(robot)
        g = robot.dynamic_state(self.plant.q, 0 * self.plant.q).g
        self.controller = Controller(self.scheme, ControllerOptions.of(given), self.plant.q, g)
        self._on_the_way, self.is_blind = deque([g] * late), False
        self.tau, self.force = g, lambda p, v: np.zeros(3)
        self.forget()

    @property
    def mode(self):
        return self.controller.mode

    @property
    def now(self):
        return self.k * self.dt

    @property
    def touched(self):
        """The force (3,) [N] on the tip now."""
        p, _, v = self.plant.tip_state()
        return self.force(p, v)

    def tick(self):
        """Measure, command, move on."""
        plant = self.plant
        p, R, v = plant.tip_state()
        self.path.append(p)
        self.speeds.append(float(np.linalg.norm(v)))
        self.joints.append(np.abs(plant.dq))
        self.k += 1
        if hasattr(self.scheme, "sense"):
            f = np.concatenate((R.T @ self.force(p, v), np.zeros(3)))
            self.scheme.sense(None if self.is_blind else SensedWrench(f, AT_TIP))
        t = self.now
        command = self.controller.step(round(1e9 * t), plant.q.copy(), plant.dq.copy(), t)
        self.efforts.append(None if command is None else command.effort)
        self._on_the_way.append(self.efforts[-1])
        # a robot without a command brakes: gravity, and damping that its limits bear
        self.tau = self._on_the_way.popleft()
        brakes = plant.gravity() - 20.0 * plant.dq
        plant.push(brakes if self.tau is None else self.tau, self.force, self.dt)

    def run(self, seconds, until=None):
        """Go on for a time [s], or until it is true."""
        for _ in range(round(seconds / self.dt)):
            self.tick()
            if until is not None and until():
                return True
        return until is None

    def is_stopped(self):
        return self.mode in (Mode.STOPPED, Mode.RELEASING)

    def forget(self):
        """Forget what was recorded."""
        self.path, self.speeds, self.joints, self.efforts = [], [], [], []

    @property
    def gave_way(self):
        """How far [m] the tip went from where the record begins."""
        return float(np.linalg.norm(np.array(self.path) - self.path[0], axis=1).max())
