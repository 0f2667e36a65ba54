"""Run an experiment: its nodes as processes, in lock-step, one bag a variant."""

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from eulerparams_control.bags.reader import Bag
from eulerparams_control.catalogue import RobotDescription, load_robot
from eulerparams_control.errors import BagError, ConfigurationError, SimulationError
from eulerparams_control.experiments.definition import CONTROLLERS, Experiment, Parameters
from eulerparams_control.experiments.processes import Nodes
from eulerparams_control.messages import ns_from_ros
from eulerparams_control.robot import Robot
from eulerparams_control.schemes.inverse_kinematics import inverse_kinematics
from eulerparams_control.way_points import parse_way_points

_START_TIMEOUT = 60.0  # [s] for the recorder to find all topics: processes start slowly under load
_STALL_TIMEOUT = 60.0  # [s] without progress of the simulation

Progress = Callable[[float], None]


def run_variant(experiment: Experiment, variant: str, folder: Path, progress: Progress) -> Path:
    """Run one variant and return its bag, ``folder/variant``.

    Args:
        experiment: the experiment.
        variant: which of its variants.
        folder: where the bag goes; ``folder/logs/variant`` gets parameters and logs.
        progress: called with the simulated time [s] again and again.

    Raises:
        BagError: if the bag exists, or is not complete.
        SimulationError: if a node dies; with its last words.
    """
    bag = folder / variant
    if bag.exists():
        raise BagError(f"{bag} exists; remove it, or choose another --out")
    topics = ["robot_description", "wrench", "joint_states", "reference"]
    topics.append(CONTROLLERS[experiment.controller])
    parameters = node_parameters(experiment, variant)
    parameters["bag_recorder"] = {"output": str(bag), "topics": topics}
    with Nodes(folder / "logs" / variant) as nodes:
        for name in ("bag_recorder", experiment.controller, "pybullet_bridge", "reference"):
            nodes.start(name, parameters[name])
        nodes.wait_for("bag_recorder", "recording ", _START_TIMEOUT)
        _follow(nodes, progress)
        nodes.stop("reference", experiment.controller, "bag_recorder")
    _check_complete(bag, experiment, parameters)
    return bag


def _follow(nodes: Nodes, progress: Progress) -> None:
    """Wait until the simulation ends; raise SimulationError if it stands still."""
    before, since = -1.0, time.monotonic()
    while not nodes.ended("pybullet_bridge"):
        now = _simulated(nodes.log("pybullet_bridge"))
        progress(now)
        if now != before:
            before, since = now, time.monotonic()
        if time.monotonic() - since > _STALL_TIMEOUT:
            raise SimulationError(
                f"the simulation stands still at {now:g} s" + nodes.complaints(but="")
            )
        time.sleep(0.1)


def node_parameters(experiment: Experiment, variant: str) -> Parameters:
    """Return the parameters of all nodes for a variant: those of its file, and the rest."""
    given = experiment.variants[variant]
    robot = load_robot(experiment.robot)
    frames = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame}
    lockstep: dict[str, Any] = {"mode": "lockstep", "robot": experiment.robot}
    lockstep["duration"] = experiment.duration
    simulated = {"use_sim_time": True, "require_reference": True}
    parameters: Parameters = {
        experiment.controller: frames | simulated | given.get(experiment.controller, {}),
        "reference": frames | {"wait_for_subscribers": 2} | given.get("reference", {}),
        "pybullet_bridge": lockstep | given.get("pybullet_bridge", {}),
    }
    if experiment.robot.endswith(".urdf"):
        parameters["pybullet_bridge"]["urdf"] = parameters["pybullet_bridge"].pop("robot")
    if experiment.start_at_reference:
        q_0 = _start(robot, parameters["reference"])
        parameters["pybullet_bridge"]["initial_positions"] = q_0
    return parameters


def _start(robot: RobotDescription, reference: dict[str, Any]) -> list[float]:
    """Return the joint positions of the first way-point."""
    if reference.get("motion") != "way_points":
        raise ConfigurationError("start_at_reference needs a reference with motion: way_points")
    names = ("times", "positions", "orientations", "orientation_format")
    given = {name: reference[name] for name in names if name in reference}
    motion = parse_way_points(**{"times": (), "positions": (), "orientations": ()} | given)
    arm = Robot(robot.urdf, robot.base_frame, robot.tip_frame, robot.joints)
    q_0 = inverse_kinematics(arm, motion.frames[0], np.array(robot.home))
    return [float(q) for q in q_0]


def _simulated(log: str) -> float:
    """Return the simulated time [s] that the bridge reported last."""
    times = re.findall(r"simulated ([\d.]+) s", log)
    return float(times[-1]) if times else 0.0


def _check_complete(bag: Path, experiment: Experiment, parameters: Parameters) -> None:
    """Raise BagError unless each state and its command are in the bag."""
    rate = parameters["pybullet_bridge"].get("rate", 1000.0)
    expected = round(experiment.duration * rate) + 1
    for topic in ("/joint_states", f"/{CONTROLLERS[experiment.controller]}"):
        stamps = {ns_from_ros(m.message.header.stamp) for m in Bag(bag).messages([topic])}
        if len(stamps) != expected:
            raise BagError(f"{bag}: {topic} has {len(stamps)} stamps; expected {expected}")


def check_names(names: list[str], experiment: Experiment) -> list[str]:
    """Return the variants to run: those named, or all; raises ConfigurationError."""
    for name in names:
        if name not in experiment.variants:
            raise ConfigurationError(
                f"{experiment.name} has no variant '{name}'; it has "
                f"{', '.join(experiment.variants)}"
            )
    return names or list(experiment.variants)
