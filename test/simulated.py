"""An arm of the catalogue in the simulator, under a controller in the same process, without ROS."""

import numpy as np
from arms import pose_of

from eulerparams_control.control.controller import Controller, ControllerOptions
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.simulator import Simulator, SimulatorParameters

MS = 1_000_000  # [ns]
# Parameters of the simulator for joints as the equations have them.
IDEAL = dict.fromkeys(("rotor_inertia", "friction_viscous", "friction_coulomb"), (0.0,))


def frames_of(name):
    """Return the frames of a robot of the catalogue as parameters."""
    about = load_robot(name)
    return {"base_frame": about.base_frame, "tip_frame": about.tip_frame}


class Simulated:
    """A simulated arm that takes efforts, and its controller.

    Attributes:
        rate: [1/s] of the controller, which is a multiple ``each`` lower than the simulation's.
        ticks: how many there were; start: where the tip began.
    """

    def __init__(self, name, parameters, q=None, rate=1000, each=1, **simulated):
        about = load_robot(name)
        q = np.array(about.home) if q is None else q
        self.robot = parameters.robot(about.urdf)
        self.scheme = parameters.make_scheme(self.robot)
        self.controller = Controller(self.scheme, ControllerOptions.of(parameters), q)
        self.start = pose_of(self.robot, q)
        self.rate, self.each, self.ticks = rate, each, 0
        options = SimulatorParameters(control="torque", rate=rate * each, **simulated)
        self.simulator = Simulator(about, options)
        self.simulator.reset(q)

    def step(self, state):
        """Go on by a tick from a state of the simulator."""
        stamp = round(1e9 * self.ticks / self.rate)
        self.simulator.command_effort(self.controller.step(stamp, state.q, state.dq).effort)
        for _ in range(self.each):
            self.simulator.step()
        self.ticks += 1
