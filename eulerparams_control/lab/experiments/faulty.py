"""Runs in real time; with faults ``fault_injector`` is between the robot and its controller.

    duration: 6.0
    faults:                       # of the experiment, or of a variant
      - {fault: drop, topic: joint_states, at: 1.0, for: 0.3, probability: 0.5}
      - {fault: kill, node: clik, at: 2.0, restart_after: 0.5}
    fault_seed: 1                 # of what is random

Times count from the first message on ``reference``.  ``eulerparams_control.lab.faults`` lists the
faults and their keys; ``kill`` kills a node of the run: the controller, ``reference`` or
``pybullet_bridge``.  A ``reference`` that is started again sends its motion again, as a user would.
After a restart the run waits until the node works, after that of the robot until it is commanded;
faults of messages go on meanwhile.

The bag has joint_states and references as they were sent, commands both as the controller sent
them and as the robot received them (``faulty/...``), and /diagnostics.

Without faults, with ``real_time: true``, the bag has also the memory of the nodes.
"""

import csv
import math
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from eulerparams_control.analysis.quantities.real_time import USAGE
from eulerparams_control.errors import ConfigurationError, SimulationError
from eulerparams_control.events import Event
from eulerparams_control.lab.experiments.controllers import CONTROLLERS, ControllerSetup
from eulerparams_control.lab.experiments.model import Variant
from eulerparams_control.lab.faults import FAULTY, Fault, Kill, MessageFault, parse_faults
from eulerparams_control.lab.run.processes import Nodes, RunStopped
from eulerparams_control.lab.run.run_cache import RunRecord
from eulerparams_control.lab.run.yaml_checks import known, require

Progress = Callable[[float], None]

INJECTOR, RECORDER, BRIDGE = "fault_injector", "bag_recorder", "pybullet_bridge"
OTHERS = ("reference", BRIDGE)
"""The nodes of a run besides its controller that may be killed."""

_FIND_TIMEOUT = 15.0  # [s] for a controller to find its robot; a fault may keep them apart
START_TIMEOUT = 60.0  # [s] for all nodes to find each other: processes start slowly under load
_EVERY = 1.0  # [s] between two samples of memory

_REAL_TIME = threading.Lock()  # runs in real time take the time of the machine: one at a time


def read_faults(where: str, run: Mapping[str, Any]) -> tuple[Fault, ...]:
    """Return the faults of a run.

    Raises:
        ConfigurationError: if one is impossible in it; says which.
    """
    has_faults = run.get("faults") not in (None, [])
    if not (has_faults or run.get("real_time")):
        return ()
    name = str(run.get("controller", Variant.controller))
    controller, key = CONTROLLERS[name], "faults" if has_faults else "runs in real time"
    require(len(controller.nodes) == 1, f"{where}: {key} need one controller, not {name}")
    require(not run.get("may_diverge"), f"{where}: may_diverge does not go with {key}")
    if not has_faults:
        return ()
    faults = parse_faults(f"{where}: faults", run["faults"])
    for number, fault in enumerate(faults, 1):
        try:
            _check(fault, controller, float(run["duration"]))
        except ConfigurationError as error:
            raise ConfigurationError(f"{where}: faults: entry {number}: {error}") from error
    return faults


def _check(fault: Fault, controller: ControllerSetup, duration: float) -> None:
    """Raise ConfigurationError unless a fault can do something in a run."""
    if isinstance(fault, Kill):
        known("node that can be killed", fault.node, (*controller.executables, *OTHERS))
    if isinstance(fault, MessageFault):
        known(f"topic with {controller.executables[0]}", fault.topic, controller.topics)
    require(fault.at < duration, f"it begins at {fault.at:g} s, the run ends at {duration:g} s")


def remaps(controller: ControllerSetup) -> dict[str, dict[str, str]]:
    """Return the remapped topics of each node: those that the injector relays."""
    *inwards, command = controller.topics
    to_controller = {topic: FAULTY + topic for topic in inwards}
    nodes = {node.executable: {**to_controller, **node.remaps} for node in controller.nodes}
    return {**nodes, BRIDGE: {command: FAULTY + command}}


def injector_parameters(settings: Variant) -> dict[str, Any]:
    """Return the parameters of the injector of a run."""
    told = [str(fault) for fault in settings.faults if isinstance(fault, MessageFault)]
    topics = list(CONTROLLERS[settings.controller].topics)
    values = {"topics": topics, "start_on": "reference", "seed": settings.fault_seed}
    return values | ({"faults": told} if told else {})


@contextmanager
def turn(stop: threading.Event | None) -> Iterator[None]:
    """Wait until no other run in real time goes on; raises RunStopped."""
    while not _REAL_TIME.acquire(timeout=0.2):
        if stop is not None and stop.is_set():
            raise RunStopped
    try:
        yield
    finally:
        _REAL_TIME.release()


def kill_and_start(settings: Variant, nodes: Nodes, progress: Progress) -> None:
    """Kill and restart nodes at their times until the run is over; raises as ``Nodes.play``."""
    nodes.wait_for_event(INJECTOR, Event.READY, START_TIMEOUT)
    todo: list[tuple[float, Callable[[], object]]] = []
    for fault in settings.faults:
        if isinstance(fault, Kill):
            todo.append((fault.at, partial(nodes.kill, fault.node)))
            if fault.end < math.inf:
                todo.append((fault.end, partial(_start_again, fault.node, nodes)))
    nodes.play(settings.duration, progress, todo)


def watch(settings: Variant, nodes: Nodes, record: RunRecord, progress: Progress) -> None:
    """Sample the memory of the nodes until the run is over."""
    nodes.wait_for_event("reference", Event.SENT, START_TIMEOUT)
    names = (*CONTROLLERS[settings.controller].executables, BRIDGE, "reference", RECORDER)
    due = 0.0
    with open(record.bag / USAGE, "w", encoding="utf-8", newline="") as file:

        def look() -> None:
            nonlocal due
            if time.monotonic() >= due:
                due = time.monotonic() + _EVERY
                sizes = [memory_of(nodes.processes[name].pid) for name in names]
                csv.writer(file).writerow([time.time_ns(), *sizes])

        nodes.play(settings.duration, progress, look=look)


def memory_of(pid: int) -> float:
    """Return the resident memory [B] of a process; NaN if it has ended."""
    try:
        pages = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]
    except (OSError, IndexError):
        return float("nan")
    return float(pages) * os.sysconf("SC_PAGE_SIZE")


def _start_again(node: str, nodes: Nodes) -> None:
    """Restart a node that was killed, and wait until it works."""
    event = Event.SENT if node == "reference" else Event.READY
    told, commanded = (len(nodes.events(node, kind)) for kind in (event, Event.COMMANDED))
    nodes.start_again(node)
    nodes.wait_for_event(node, event, START_TIMEOUT, times=told + 1)
    if node == BRIDGE and nodes.processes.keys() - {RECORDER, BRIDGE, "reference", INJECTOR}:
        with suppress(SimulationError):  # they may find each other late, or a fault is between
            nodes.wait_for_event(BRIDGE, Event.COMMANDED, _FIND_TIMEOUT, times=commanded + 1)
