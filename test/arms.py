"""Arms of the catalogue, schemes of theirs, frames near them; one moves by forward dynamics."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pinocchio as pin
from samples import Array, generator, rodrigues, turn_of, unit_vectors
from tolerances import BEYOND_A_STEP, NO_JUMP

from eulerparams_control.laws.inverse import sigma_min
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.parameters.dynamic_control import DynamicParameters
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot


def robot_of(name):
    about = load_robot(name)
    return Robot(about.urdf, about.base_frame, about.tip_frame, about.joints)


@cache
def robot_named(name):
    """Return a robot of the catalogue and its home; not to be changed."""
    return robot_of(name), np.array(load_robot(name).home)


UR5, HOME = robot_named("ur5")
STILL = np.zeros(6)

# Of all limits only the positions, speeds and efforts of the URDF.
JOINT_LIMITS = {
    "shape_motion": False,
    "max_joint_acceleration": (math.inf,),
    "max_error_position": math.inf,
    "max_error_rotation": math.inf,
    "max_effort_rate": (2000.0,),
}


def begun(parameters, q=HOME, robot=UR5):
    """Return the scheme of the parameters, begun at q."""
    scheme = parameters.make_scheme(robot)
    scheme.reset(q)
    return scheme


def clik(orientation="euler_parameters", *, limited=False, q=HOME, robot=UR5, **parameters):
    """Return CLIK, begun at q; without any limits, or with those of the URDF."""
    limits = {name: value for name, value in JOINT_LIMITS.items() if name != "max_effort_rate"}
    values = {"orientation": orientation, "enforce_limits": limited, **limits, **parameters}
    return begun(ClikParameters(**values), q, robot)


def dynamic_control(
    orientation="euler_parameters", *, limited=True, q=HOME, robot=UR5, **parameters
):
    """Return dynamic control, begun at q; with the limits of the URDF, or without any."""
    values = {"orientation": orientation, "enforce_limits": limited, **JOINT_LIMITS, **parameters}
    return begun(DynamicParameters(**values), q, robot)


def pose_of(robot, q):
    """Return the frame of the tip at rest."""
    state = robot.state(q, np.zeros(robot.n))
    return DesiredFrame(state.p_e, state.R_e)


def displaced(distance=0.03, angle=0.4, key=0, robot=UR5, q=HOME):
    """Return home's pose moved and turned in random directions."""
    along, about_axis = unit_vectors(2, key=300 + key)
    home = pose_of(robot, q)
    return DesiredFrame(home.p_d + distance * along, rodrigues(angle, about_axis) @ home.R_d)


def situations(robot=UR5, home=HOME, count=10):
    """Return random q, dq near home, away from singularities, and frames that move near it."""
    random, found = generator(310), []
    while len(found) < count:
        q, dq = home + 0.4 * random.uniform(-1, 1, robot.n), random.normal(size=robot.n)
        if sigma_min(robot.state(q, dq).J, 1.0) > 0.1:
            pose = displaced(key=len(found), robot=robot, q=home)[:2]
            found.append((q, dq, DesiredFrame(*pose, *random.normal(size=(4, 3)))))
    return found


def assert_no_jump(frames, dt):
    """Assert that poses go on by the velocities, and velocities by the accelerations."""
    for before, now in pairwise(frames):
        rates = (before.ddp_d, now.ddp_d, before.domega_d, now.domega_d)
        most = BEYOND_A_STEP * np.abs(rates).max()
        assert np.abs(now.dp_d - before.dp_d).max() <= most * dt + NO_JUMP
        assert np.abs(now.omega_d - before.omega_d).max() <= most * dt + NO_JUMP
        moved = now.p_d - before.p_d - dt * (before.dp_d + now.dp_d) / 2
        turn = turn_of(now.R_d @ before.R_d.T) - dt * (before.omega_d + now.omega_d) / 2
        assert np.abs(moved).max() <= most * dt**2 + NO_JUMP
        assert np.abs(turn).max() <= most * dt**2 + NO_JUMP


def reduced_model(urdf, joints):
    """Return Pinocchio's model of the joints, the others locked at zero."""
    model = pin.buildModelFromXML(urdf)
    others = [model.getJointId(j) for j in model.names[1:] if j not in joints]
    return pin.buildReducedModel(model, others, pin.neutral(model))


class Plant:
    """An arm of the catalogue that moves as eq. (32) says, by forward dynamics: no B, no C dq."""

    def __init__(self, name="ur5"):
        robot, home = robot_named(name)
        self.model = reduced_model(load_robot(name).urdf, robot.joints)
        self.tip = self.model.getFrameId(robot.tip_frame)
        self.frame, self.data = self.model.frames[self.tip], self.model.createData()
        self.q, self.dq = home.copy(), np.zeros(robot.n)

    def acceleration(self, q: Array, dq: Array, tau: Array, w: Array | None = None) -> Array:
        """Return ddq (n,), with the wrench w (6,) of the environment on the tip, base axes."""
        forces = pin.StdVec_Force(self.model.njoints, pin.Force.Zero())
        if w is not None:
            pin.framesForwardKinematics(self.model, self.data, q)
            turn = pin.SE3(self.data.oMf[self.tip].rotation.T, np.zeros(3))
            in_joint = self.frame.placement.act(turn.act(pin.Force(w)))
            forces[self.frame.parentJoint] = in_joint
        return pin.aba(self.model, self.data, q, dq, tau, forces).copy()

    def tip_acceleration(self, q, dq, ddq):
        """Return the acceleration (6,) of the tip; the base is the root."""
        pin.forwardKinematics(self.model, self.data, q, dq, ddq)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return pin.getFrameClassicalAcceleration(self.model, self.data, self.tip, world).vector

    def step(self, tau, dt=1e-3):
        """Move on by dt, semi-implicitly."""
        self.dq = self.dq + dt * self.acceleration(self.q, self.dq, tau)
        self.q = self.q + dt * self.dq
