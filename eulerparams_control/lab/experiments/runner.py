"""Run an experiment: its nodes as processes, one bag a variant.

In lock-step, or in real time, see ``faulty``.
"""

import math
import threading
import time
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from eulerparams_control.analysis.quantities.real_time import stamped
from eulerparams_control.bags.reader import Bag
from eulerparams_control.errors import BagError, ConfigurationError, SimulationError
from eulerparams_control.events import Event, ExitCode, events_of
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.experiments.faulty import (
    BRIDGE,
    INJECTOR,
    RECORDER,
    START_TIMEOUT,
    Progress,
    injector_parameters,
    kill_and_start,
    remaps,
    turn,
    watch,
)
from eulerparams_control.lab.experiments.model import Experiment, Parameters, Variant
from eulerparams_control.lab.faults import FAULTY
from eulerparams_control.lab.run.processes import EVENTS, Nodes
from eulerparams_control.lab.run.run_cache import Making, Run, RunRecord
from eulerparams_control.laws.inverse_kinematics import inverse_kinematics
from eulerparams_control.laws.rotations import Array, exp
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.motion.way_points import parse_way_points
from eulerparams_control.robot.catalogue import RobotDescription, load_robot
from eulerparams_control.robot.robot import Robot

_FROM_ROBOT = ("/joint_states", "/wrench")

_OPERATOR = "eulerparams_control.lab.operator_node"

_STALL_TIMEOUT = 60.0  # [s] without progress of the simulation

_TURN = math.radians(30)  # of the tip in one step of the inverse kinematics: it keeps its branch

_IDEAL = {key: [0.0] for key in ("rotor_inertia", "friction_viscous", "friction_coulomb")}
"""Of the simulated joints, whatever the robot has."""

_RATE = 250.0  # [Hz] in real time unless the experiment says otherwise: all share a machine


class IncompleteBagError(BagError):
    """Messages are missing in a bag: on a busy machine the recorder may get too little time."""


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
    changed = making_of(settings, node_parameters(settings)).differs(making)
    return (None, f"{changed} changed") if changed else (run, "")


def making_of(settings: Variant, parameters: Parameters) -> Making:
    """Return what a run of a variant is made of, whose nodes have these parameters."""
    of = settings
    said = [parameters, of.duration, of.controller, of.may_diverge, *map(str, of.faults)]
    said += ["reports"] * of.reports
    return Making.of(said, of.robot, bool(of.faults))


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
    record, parameters = RunRecord(folder, variant), node_parameters(settings)
    record.clear()
    making = making_of(settings, parameters)
    with turn(stop) if settings.faults else nullcontext():
        started = time.monotonic()
        try:
            diverged = _record(settings, parameters, record, making, progress, stop)
        finally:
            _claim(record, making)  # it is ours however the run ended
    end = settings.duration
    if settings.is_in_real_time:
        _check_moved(record.bag, CONTROLLERS[settings.controller].command)
    else:
        rate = float(parameters[BRIDGE].get("rate", 1000.0))
        end = _check_complete(record.bag, settings, rate, diverged)
    run = Run(record.bag, end, end if diverged else None, time.monotonic() - started)
    record.end(making, run)
    return run


def _record(
    settings: Variant,
    parameters: Parameters,
    record: RunRecord,
    making: Making,
    progress: Progress,
    stop: threading.Event | None,
) -> bool:
    """Start the nodes of a variant, and stop them at its end; return whether it diverged."""
    controller, diverged = CONTROLLERS[settings.controller], False
    # reference is sent when the recorder listens to it: last, so that it listens to the rest too
    topics = [*controller.answers, *streamed(parameters), "robot_description", "wrench"]
    if controller.is_compliant:
        topics.insert(0, f"/{controller.nodes[0].name}/impedance")
    topics += ["joint_states", "reference"]
    names = [RECORDER, *controller.executables, BRIDGE, "reference"]
    others: Mapping[str, Mapping[str, str]]
    others = {node.executable: node.remaps for node in controller.nodes}
    if settings.is_in_real_time or settings.reports:
        topics.insert(0, "/diagnostics")
    if _OPERATOR in parameters:
        names.insert(1, _OPERATOR)
    if settings.faults:
        topics.insert(0, FAULTY + controller.command)
        names.insert(1, INJECTOR)
        others = remaps(controller)
    parameters = {**parameters, RECORDER: {"output": str(record.bag), "topics": topics}}
    with Nodes(record.logs, stop) as nodes:
        for name in names:
            nodes.start(name, parameters[name], remaps=others.get(name, {}))
        nodes.wait_for_event(RECORDER, Event.READY, START_TIMEOUT)
        record.claim(making)  # now: we may be killed
        if settings.faults:
            kill_and_start(settings, nodes, progress)
        elif settings.is_in_real_time:
            watch(settings, nodes, record, progress)
        else:
            diverged = _follow(nodes, settings, progress)
        names.remove(BRIDGE)
        nodes.stop(*(name for name in reversed(names) if name in nodes.processes))
    return diverged


def _claim(record: RunRecord, making: Making) -> None:
    """Mark the bag that the recorder has made as that of the run, unless it refused to."""
    told = record.logs / f"{RECORDER}{EVENTS}"
    if told.exists() and not any(
        event.get("exit_code") == ExitCode.REFUSED
        for event in events_of(told.read_text(encoding="utf-8", errors="replace"))
    ):
        record.claim(making)


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
    """Wait until the simulation ends; raise SimulationError if it makes no progress."""
    before, since = -1.0, time.monotonic()
    while not nodes.ended(BRIDGE):
        now = max((event["t"] for event in nodes.events(BRIDGE, Event.PROGRESS)), default=0.0)
        progress(now)
        if now != before:
            before, since = now, time.monotonic()
        if time.monotonic() - since > _STALL_TIMEOUT:
            raise SimulationError(
                f"the simulation makes no progress at {now:g} s" + nodes.complaints(but="")
            )
        time.sleep(0.1)


def node_parameters(settings: Variant) -> Parameters:
    """Return the parameters of all nodes of a run: those of its file, and those it needs."""
    controller = CONTROLLERS[settings.controller]
    robot, is_lockstep = load_robot(settings.robot), not settings.is_in_real_time
    frames = {"base_frame": robot.base_frame, "tip_frame": robot.tip_frame}
    parameters: Parameters = {
        node.executable: frames | node.parameters(any(settings.start_turn), is_lockstep)
        for node in controller.nodes
    }
    followers = {"wait_for_subscribers": controller.followers + 1}  # and the recorder
    parameters["reference"] = frames | followers
    source = "urdf" if settings.robot.endswith(".urdf") else "robot"
    parameters[BRIDGE] = {"control": controller.control, source: settings.robot}
    if is_lockstep:  # it waits for all that listen to the arm: reference and the recorder, too
        parameters[BRIDGE] |= {"mode": "lockstep", "duration": settings.duration}
        listeners = len(controller.nodes) + 2 + (settings.halt < math.inf)
        parameters[BRIDGE] |= {"wait_for_subscribers": listeners}
    else:  # until it is stopped
        parameters[BRIDGE] |= {"mode": "realtime", "rate": _RATE}
    if settings.ideal_joints:
        parameters[BRIDGE] |= _IDEAL
    if settings.halt < math.inf:
        halt = f"/{controller.nodes[0].name}/halt"
        parameters[_OPERATOR] = {"service": halt, "at": settings.halt}
    if settings.faults:
        parameters[INJECTOR] = injector_parameters(settings)
    parameters = {
        node: values | settings.nodes.get(node, {}) for node, values in parameters.items()
    }
    if rotors := list(parameters[BRIDGE].get("rotor_inertia") or robot.rotor_inertia):
        for node in controller.nodes:  # a data sheet has them
            known = node.known({"rotor_inertia": rotors})
            parameters[node.executable] = known | parameters[node.executable]
    if is_lockstep and (topics := streamed(parameters)):  # each state waits for what belongs to it
        parameters["reference"]["stream_rate"] = 0.0
        parameters[controller.nodes[0].executable]["paired_targets"] = topics
    if settings.start_at_reference:
        q_0 = _start(robot, parameters["reference"], np.array(settings.start_turn))
        parameters[BRIDGE]["initial_positions"] = q_0
    return parameters


def streamed(parameters: Parameters) -> list[str]:
    """Return the topics that the node reference streams besides its motion."""
    names = {"target_wrench": "wrench_times", "target_stiffness": "stiffness_times"}
    return [topic for topic, times in names.items() if parameters["reference"].get(times)]


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
    times = stamped(bag, [*_FROM_ROBOT, *answers])
    found = {topic: set(messages.stamp.tolist()) for topic, messages in times.items()}
    end = max(found["/joint_states"], default=0) / 1e9 if diverged else settings.duration
    expected = round(end * rate) + 1
    for topic, stamps in found.items():
        least = expected - (diverged and topic in answers)
        if not least <= len(stamps) <= expected:
            kind = IncompleteBagError if len(stamps) < least else BagError
            raise kind(f"{bag}: {topic} has {len(stamps)} stamps; expected {expected}")
    return end


def _check_moved(bag: Path, command: str) -> None:
    """Raise BagError unless states and commands are in the bag: in real time none is complete."""
    topics = Bag(bag).topics
    for name in ("/joint_states", f"/{command}", "/reference"):
        if name not in topics or not topics[name].count:
            raise BagError(f"{bag}: nothing was recorded of {name}")


def check_names(names: list[str], experiment: Experiment) -> list[str]:
    """Return the variants to run, each once: those named, or all; raises ConfigurationError.

    An experiment of the library alone has none, whatever is named.
    """
    names = names if experiment.variants else []
    for name in names:
        if name not in experiment.variants:
            raise ConfigurationError(
                f"{experiment.name} has no variant '{name}'; it has "
                f"{', '.join(experiment.variants)}"
            )
    return list(dict.fromkeys(names)) or list(experiment.variants)
