"""An environment of gymnasium, in lock-step without ROS: lead the tip to a pose by twists."""

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.laws.rotations import angle_between, exp
from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.simulator import Simulator, SimulatorParameters

SPEED, STEPS, STEP, WORST = np.repeat([0.2, 0.8], 3), 50, 1_000_000, 1e3  # an action, [ns], fault


class ReachEnv(gymnasium.Env):
    """Action (6,): twist over SPEED, base frame. Observation (6 + 2n,): p_d - p_e, x_de, q, dq."""

    def __init__(self, robot="ur5", orientation="euler_parameters"):
        self.arm = Simulator(load_robot(robot), SimulatorParameters())
        base, tip = self.arm.robot.base_frame, self.arm.robot.tip_frame
        self.parameters = ClikParameters(orientation=orientation, base_frame=base, tip_frame=tip)
        self.robot = self.parameters.robot(self.arm.robot.urdf)
        self.action_space = Box(-1.0, 1.0, (6,))
        self.observation_space = Box(-100.0, 100.0, (6 + 2 * self.robot.n,))

    def reset(self, *, seed=None, options=None):  # noqa: D102
        super().reset(seed=seed)
        self.arm.reset()
        scheme = self.parameters.make_scheme(self.robot)
        how, self.t = ControllerOptions.of(self.parameters), 0
        self.controller = Controller(scheme, how, self.arm.motion[0])
        p, R, *_ = scheme.start_frame()
        p_d, turn = p + self.np_random.uniform(-0.1, 0.1, 3), self.np_random.uniform(-1.0, 1.0, 3)
        self.p_d, self.R_d = p_d, exp(turn) @ R
        return self._observe()

    def _observe(self):
        tip = self.robot.state(*self.arm.motion)
        x_de = self.parameters.representation().displacement(self.R_d, tip.R_e)
        seen = np.concatenate([self.p_d - tip.p_e, x_de.error, *self.arm.motion], dtype="f4")
        distance, angle = np.linalg.norm(self.p_d - tip.p_e), angle_between(self.R_d, tip.R_e)
        return seen, {"distance [m]": float(distance), "angle [rad]": float(angle)}

    def step(self, action):  # noqa: D102
        self.controller.jog(SPEED * np.clip(action, -1.0, 1.0))
        for _ in range(STEPS):
            state, self.t = self.arm.read(), self.t + STEP
            command = self.controller.step(self.t, state.q, state.dq)
            if command is not None:
                self.arm.command_position(command.q, command.dq)
            self.arm.step()
        seen, info = self._observe()
        distance, angle = info.values()
        fault = info["fault"] = self.controller.fault
        ended, cost = bool(fault) or (distance < 0.01 and angle < 0.05), WORST * bool(fault)
        return seen, -distance - 0.2 * angle - cost, ended, self.t >= 10_000 * STEP, info

    def close(self):  # noqa: D102
        self.arm.close()
