"""A robot, its controller and its reference as processes in one namespace; one a controller."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from eulerparams_control.events import Event
from eulerparams_control.lab.experiments.processes import Nodes
from eulerparams_control.lab.soak.record import SoakPlan
from eulerparams_control.robot.catalogue import load_robot

_PATIENCE = 60.0  # [s] for a motion to be sent: a guard against hanging
RECORDER = "bag_recorder"


class Station:
    """The nodes of one controller.

    Attributes:
        controller: its name, and that of its namespace.
        nodes: the processes.
    """

    def __init__(self, controller: str, nodes: Nodes) -> None:
        self.controller, self.nodes = controller, nodes

    def start(self, plan: SoakPlan) -> None:
        """Start the robot and its controller."""
        robot, namespace = load_robot("ur5"), f"/{self.controller}"
        clock = {"/clock": "clock"}  # each robot has its own
        bridge = plan.bridge(self.controller)
        self.nodes.start("pybullet_bridge", bridge, namespace, clock)
        self.nodes.start(self.controller, plan.control(self.controller, robot), namespace)

    def move(self, plan: SoakPlan) -> None:
        """Start the reference, and wait until it has sent its motion."""
        self.nodes.start("reference", plan.reference(load_robot("ur5")), f"/{self.controller}")
        self.nodes.wait_for_event("reference", Event.SENT, _PATIENCE)

    def move_again(self) -> None:
        """Restart the reference: its motion begins where the arm is now."""
        self.nodes.stop("reference")
        self.nodes.start_again("reference")

    def pids(self) -> Iterator[tuple[str, int]]:
        """Return name and number of each process."""
        for name, process in self.nodes.processes.items():
            yield (name if name == RECORDER else f"{self.controller}/{name}"), process.pid


class Stations:
    """All of them, in one ROS domain.

    Attributes:
        domain: its number.
    """

    def __init__(self, plan: SoakPlan, folder: Path) -> None:
        self.plan, self.folder = plan, folder
        self._stack = ExitStack()
        self.each: list[Station] = []

    def __enter__(self) -> Self:
        for controller in self.plan.controllers:
            nodes = self._stack.enter_context(Nodes(self.folder / controller))
            self.each.append(Station(controller, nodes))
        self.domain = int(self.each[0].nodes.environment["ROS_DOMAIN_ID"])
        for station in self.each:
            station.nodes.environment["ROS_DOMAIN_ID"] = str(self.domain)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def start(self) -> None:
        """Start the robots and their controllers."""
        for station in self.each:
            station.start(self.plan)

    def move(self) -> None:
        """Start the motions and the recorder."""
        for station in self.each:
            station.move(self.plan)
        options = {"output": str(self.bag), "topics": self.plan.topics()}
        self.each[0].nodes.start(RECORDER, options)

    @property
    def bag(self) -> Path:
        """Where the recorder writes."""
        return self.folder / "bag"

    def pids(self) -> Sequence[tuple[str, int]]:
        """Return name and number of each process."""
        return [pair for station in self.each for pair in station.pids()]

    def check(self) -> None:
        """Raise SimulationError if a node has died."""
        for station in self.each:
            station.nodes.check()
