"""Run an experiment: its nodes as processes, one bag a variant.

In lock-step, or in real time, see ``faulty``.
"""

import math
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from eulerparams_control.analysis.real_time import stamped
from eulerparams_control.errors import BagError, ConfigurationError, SimulationError
from eulerparams_control.events import Event, ExitCode, events_of
from eulerparams_control.lab.experiments import faulty
from eulerparams_control.lab.experiments.controllers import CONTROLLERS, NodeSetup
from eulerparams_control.lab.experiments.faulty import BRIDGE, RECORDER, record_in_real_time, turn
from eulerparams_control.lab.experiments.model import Experiment, Parameters, Variant
from eulerparams_control.lab.experiments.processes import EVENTS, Nodes
from eulerparams_control.lab.experiments.run_cache import Making, Run, RunRecord
from eulerparams_control.lab.faults import FROM_ROBOT
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.way_points import parse_way_points
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from eulerparams_control.robot.robot import Robot

_START_TIMEOUT = 60.0  # [s] for the recorder to find all topics: processes start slowly under load
_STALL_TIMEOUT = 60.0  # [s] without progress of the simulation

_TURN = math.radians(30)  # of the tip in one step of the inverse kinematics: it keeps its branch

Progress = Callable[[float], None]


class IncompleteBagError(BagError):
    """Messages are missing in a bag: on a busy machine the recorder may starve."""


def known_run(experiment: Experiment, variant: str, folder: Path) -> tuple[Run | None, str]:
    """Return the run of a variant that was made before, or None and why it does not count.

    Args:
        experiment: the experiment.
        variant: which of its variants.
        folder: where its bag would be.
    """
    found = RunRecord(folder, variant).finished()
    if found is None:
        return None, ""
    settings = experiment.variants[variant]
    making, run = found
    changed = Making.of(settings, node_parameters(settings)).differs(making)
    return (None, f"{changed} changed") if changed else (run, "")


def run_variant(
    experiment: Experiment,
    variant: str,
    folder: Path,
    progress: Progress,
    stop: threading.Event | None = None,
) -> Run:
    """Run one variant, recorded in the bag ``folder/variant``.

    Args:
        experiment: the experiment.
        variant: which of its variants.
        folder: where the bag goes; ``folder/logs/variant`` gets parameters and logs.
        progress: called with the simulated time [s] again and again.
        stop: set from another thread when it is to end early.

    Raises:
        BagError: if there is a bag that is not ours, or it is not complete (IncompleteBagError).
        SimulationError: if a node dies, with its last words; not if the run may diverge and did.
        RunStopped: if it was told to.
    """
    settings = experiment.variants[variant]
    record, started = RunRecord(folder, variant), time.monotonic()
    record.clear()
    parameters = node_parameters(settings)
    making = Making.of(settings, parameters)
    record.begin(making)
    if settings.is_in_real_time:
        return _run_in_real_time(settings, parameters, record, progress, stop)
    try:
        diverged = _record(settings, parameters, record, progress, stop)
    finally:
        _claim(record)  # it is ours however the run ended
    rate = float(parameters["pybullet_bridge"].get("rate", 1000.0))
    end = _check_complete(record.bag, settings, rate, diverged)
    run = Run(record.bag, end, end if diverged else None, time.monotonic() - started)
    record.end(making, run)
    return run


def _run_in_real_time(
    settings: Variant,
    parameters: Parameters,
    record: RunRecord,
    progress: Progress,
    stop: threading.Event | None,
) -> Run:
    """Run a variant; its bag has what was recorded: in real time none is complete."""
    with turn(stop) if settings.faults else nullcontext():
        started = time.monotonic()
        try:
            record_in_real_time(settings, parameters, record, progress, stop)
        finally:
            _claim(record)
    run = Run(record.bag, settings.duration, None, time.monotonic() - started)
    record.end(Making.of(settings, parameters), run)
    return run


def _record(
    settings: Variant,
    parameters: Parameters,
    record: RunRecord,
    progress: Progress,
    stop: threading.Event | None,
) -> bool:
    """Start the nodes of a variant, and end them when it has; return whether it diverged."""
    controller = CONTROLLERS[settings.controller]
    # reference is sent when the recorder listens to it: last, so that it listens to the rest too
    topics = [*controller.answers, "robot_description", "wrench", "joint_states", "reference"]
    recorder = {RECORDER: {"output": str(record.bag), "topics": topics}}
    remaps = {node.executable: node.remaps for node in controller.nodes}
    with Nodes(record.path.parent, stop) as nodes:
        for name in (RECORDER, *controller.executables, BRIDGE, "reference"):
            nodes.start(name, (parameters | recorder)[name], remaps=remaps.get(name, {}))
        nodes.wait_for_event(RECORDER, Event.READY, _START_TIMEOUT)
        record.claim()  # now: we may be killed
        diverged = _follow(nodes, settings, progress)
        nodes.stop("reference", *controller.executables, RECORDER)
    return diverged


def _claim(record: RunRecord) -> None:
    """Mark the bag that the recorder has made as that of the run; it makes none that exists."""
    told = record.path.parent / f"{RECORDER}{EVENTS}"
    if told.exists() and not any(
        event.get("exit_code") == ExitCode.REFUSED
        for event in events_of(told.read_text(encoding="utf-8", errors="replace"))
    ):
        record.claim()


def _follow(nodes: Nodes, settings: Variant, progress: Progress) -> bool:
    """Wait until the simulation ends; return whether it diverged."""
    try:
        wait_for_end(nodes, progress)
    except SimulationError:
        if not (settings.may_diverge and has_diverged(nodes, settings.controller)):
            raise
        return True
    return False


def has_diverged(nodes: Nodes, controller: str) -> bool:
    """Return whether the arm diverged, or the controller fell silent after a fault."""
    code = nodes.processes[BRIDGE].poll()
    faults = (nodes.events(name, Event.FAULT) for name in CONTROLLERS[controller].executables)
    return code == ExitCode.DIVERGED or (code == ExitCode.STALLED and any(faults))


def wait_for_end(nodes: Nodes, progress: Progress) -> None:
    """Wait until the simulation ends; raise SimulationError if it stands still."""
    before, since = -1.0, time.monotonic()
    while not nodes.ended(BRIDGE):
        now = max((event["t"] for event in nodes.events(BRIDGE, Event.PROGRESS)), default=0.0)
        progress(now)
        if now != before:
            before, since = now, time.monotonic()
        if time.monotonic() - since > _STALL_TIMEOUT:
            raise SimulationError(
                f"the simulation stands still at {now:g} s" + nodes.complaints(but="")
            )
        time.sleep(0.1)


def node_parameters(settings: Variant) -> Parameters:
    """Return the parameters of all nodes for a run: those of its file, and the rest."""
    given, controller = settings.nodes, CONTROLLERS[settings.controller]
    robot = load_robot(settings.robot)
    frames = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame}
    real = settings.is_in_real_time
    of_node = faulty.control_parameters if real else NodeSetup.parameters
    parameters: Parameters = {
        node.executable: frames | of_node(node, any(settings.start_turn))
        for node in controller.nodes
    }
    followers = {"wait_for_subscribers": controller.followers + 1}  # and the recorder
    parameters["reference"] = frames | followers
    parameters["pybullet_bridge"] = _bridge_parameters(settings)
    if settings.faults:
        parameters[faulty.INJECTOR] = faulty.injector_parameters(
            controller, settings.faults, settings.fault_seed
        )
    parameters = {node: values | given.get(node, {}) for node, values in parameters.items()}
    if settings.start_at_reference:
        q_0 = _start(robot, parameters["reference"], np.array(settings.start_turn))
        parameters["pybullet_bridge"]["initial_positions"] = q_0
    return parameters


def _bridge_parameters(settings: Variant) -> dict[str, Any]:
    """Return what the bridge needs; in lock-step it waits for all that listen to the arm."""
    controller = CONTROLLERS[settings.controller]
    source = "urdf" if settings.robot.endswith(".urdf") else "robot"
    if settings.is_in_real_time:
        own = faulty.bridge_parameters()
        return {**own, "control": controller.control, source: settings.robot}
    return {
        "mode": "lockstep",
        "control": controller.control,
        "duration": settings.duration,
        "wait_for_subscribers": len(controller.nodes) + 2,  # reference and the recorder, too
        source: settings.robot,
    }


def _start(robot: RobotDescription, reference: dict[str, Any], turn: Array) -> list[float]:
    """Return the joint positions of the first way-point, turned by ``turn`` (3,) [rad]."""
    if reference.get("motion") != "way_points":
        raise ConfigurationError("start_at_reference needs a reference with motion: way_points")
    names = ("times", "positions", "orientations", "orientation_format")
    given = {name: reference[name] for name in names if name in reference}
    motion = parse_way_points(**{"times": (), "positions": (), "orientations": ()} | given)
    arm = Robot(robot.urdf, robot.base_frame, robot.tip_frame, robot.joints)
    first = motion.frames[0]
    q_0 = inverse_kinematics(arm, first, np.array(robot.home))
    steps = math.ceil(float(np.linalg.norm(turn)) / _TURN)
    for step in range(1, steps + 1):
        turned = DesiredFrame(first.p_d, first.R_d @ exp(turn * step / steps))
        q_0 = inverse_kinematics(arm, turned, q_0)
    return [float(q) for q in q_0]


def _check_complete(bag: Path, settings: Variant, rate: float, diverged: bool) -> float:
    """Return the last stamp [s]; raise BagError unless all of the robot and its answers are there.

    A run that diverged ends where it did, and its last state may have no answer.
    """
    answers = [f"/{name}" for name in CONTROLLERS[settings.controller].answers]
    times = stamped(bag, [*(f"/{name}" for name in FROM_ROBOT), *answers])
    found = {topic: set(messages.stamp.tolist()) for topic, messages in times.items()}
    end = max(found["/joint_states"], default=0) / 1e9 if diverged else settings.duration
    expected = round(end * rate) + 1
    for topic, stamps in found.items():
        least = expected - (diverged and topic in answers)
        if not least <= len(stamps) <= expected:
            kind = IncompleteBagError if len(stamps) < least else BagError
            raise kind(f"{bag}: {topic} has {len(stamps)} stamps; expected {expected}")
    return end


def check_names(names: list[str], experiment: Experiment) -> list[str]:
    """Return the variants to run: those named, or all; raises ConfigurationError."""
    for name in names:
        if name not in experiment.variants:
            raise ConfigurationError(
                f"{experiment.name} has no variant '{name}'; it has "
                f"{', '.join(experiment.variants)}"
            )
    return names or list(experiment.variants)
