"""An arm of the catalogue in the simulator, under a controller in the same process, without ROS."""

from eulerparams_control.control.controller import Controller
from eulerparams_control.robot.catalogue import load_robot
from sim_bridge.simulator import Simulator, SimulatorParameters

MS = 1_000_000  # [ns]


class Simulated:
    """A simulated arm that takes efforts, its controller, and what it did at each tick.

    Attributes:
        ticks: of the scheme; efforts: (n,) commanded.
    """

    def __init__(self, robot, scheme, options, motion, q_0, **simulated):
        self.scheme = scheme
        parameters = SimulatorParameters(control="torque", **simulated)
        self.simulator = Simulator(load_robot(robot), parameters)
        self.simulator.reset(q_0)
        self.controller = Controller(scheme, options, q_0)
        self.controller.orders.follow(motion, 0)
        self.ticks, self.efforts = [], []

    def step(self):
        """Go on by a millisecond; return the command."""
        state = self.simulator.read()
        command = self.controller.step(len(self.ticks) * MS, state.q, state.dq)
        self.ticks.append(self.controller.guidance.tick_now)
        self.efforts.append(command.effort)
        self.simulator.command_effort(command.effort)
        self.simulator.step()
        return command

    def end(self):
        """Close the simulator; return the last tick."""
        self.simulator.close()
        assert not self.controller.fault, self.controller.fault
        return self.ticks[-1]
