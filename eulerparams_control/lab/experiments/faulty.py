"""Runs in real time; with faults ``fault_injector`` is between the robot and its controller.

    duration: 6.0
    faults:                       # of the experiment, or of a variant
      - {fault: drop, topic: joint_states, at: 1.0, for: 0.3, probability: 0.5}
      - {fault: kill, node: clik, at: 2.0, restart_after: 0.5}
    fault_seed: 1                 # of what is random

Times count from the first message on ``reference``.  What faults there are, and what they take,
says ``eulerparams_control.lab.faults``; ``kill`` ends a node of the run, without a word: the
controller, ``reference``, ``pybullet_bridge`` or ``bag_recorder``.  A ``reference`` that is
started again sends its motion again, as a user would.  The run waits until a node that is started
again is at work, a robot until it is commanded; faults of messages go on meanwhile.

The bag has joint_states as the robot sent them, the commands as the controller sent them and as
the robot got them (``faulty/...``), references as they were sent, and /diagnostics.

Without faults, with ``real_time: true``, the bag has also what the nodes took, see ``usage``.  A
motion that a fault, or a silence of the robot, has ended is sent again.
"""

import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from eulerparams_control.analysis.real_time import USAGE
from eulerparams_control.bags.reader import Bag
from eulerparams_control.bags.recovery import recover
from eulerparams_control.control.mode import Mode
from eulerparams_control.errors import BagError, ConfigurationError, SimulationError
from eulerparams_control.events import Event
from eulerparams_control.lab.experiments.controllers import CONTROLLERS, ControllerSetup, NodeSetup
from eulerparams_control.lab.experiments.model import Parameters, Variant
from eulerparams_control.lab.experiments.processes import Nodes, RunStopped
from eulerparams_control.lab.experiments.run_cache import RunRecord
from eulerparams_control.lab.experiments.usage import UsageLog
from eulerparams_control.lab.experiments.yaml_checks import known, require
from eulerparams_control.lab.faults import ROBOT, Fault, Kill, parse_faults

INJECTOR = "fault_injector"
FAULTY = "faulty/"
OTHERS = ("reference", "pybullet_bridge", "bag_recorder")
"""The nodes of a run besides its controller, that may be killed, too."""

RATE = 250.0
"""[Hz] of the robot unless the experiment says otherwise: all nodes share a machine."""

RECORDER, BRIDGE = "bag_recorder", "pybullet_bridge"

_FIND_TIMEOUT = 15.0  # [s] for a controller to find its robot; a fault may keep them apart
_START_TIMEOUT = 60.0  # [s] for all nodes to have found each other
_POLL = 0.01  # [s] between two looks at what is due
_AGAIN = 10.0  # [s] between two motions, where faults end them

_ENDED = (Mode.HOLDING, Mode.STOPPED)  # modes in which no motion is followed any more

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
    else:
        known(f"topic with {controller.executables[0]}", fault.topic, (*controller.topics, ROBOT))
    require(fault.at < duration, f"it begins at {fault.at:g} s, the run ends at {duration:g} s")


def remaps(controller: ControllerSetup) -> dict[str, dict[str, str]]:
    """Return the topics that have another name for each node: those that the injector gives on."""
    *inwards, command = controller.topics
    to_controller = {topic: FAULTY + topic for topic in inwards}
    nodes = {node.executable: {**to_controller, **node.remaps} for node in controller.nodes}
    return {**nodes, "pybullet_bridge": {command: FAULTY + command}}


def control_parameters(node: NodeSetup, is_turned: bool) -> dict[str, Any]:
    """Return what a control node needs in real time: what it has by default."""
    return node.turned(is_turned)


def bridge_parameters() -> dict[str, Any]:
    """Return what the bridge needs in real time; it goes on until it is stopped."""
    return {"mode": "realtime", "rate": RATE}


def injector_parameters(
    controller: ControllerSetup, faults: tuple[Fault, ...], seed: int
) -> dict[str, Any]:
    """Return what the injector is told."""
    told = [str(fault) for fault in faults if not isinstance(fault, Kill)]
    topics = list(controller.topics)
    values: dict[str, Any] = {"topics": topics, "start_on": "reference", "seed": seed}
    return values | {"faults": told} if told else values


def recorded(controller: ControllerSetup, has_faults: bool) -> list[str]:
    """Return the topics that are recorded."""
    own = ["robot_description", "wrench", "joint_states", "reference", "/diagnostics"]
    return [*controller.answers, *([FAULTY + controller.command] if has_faults else []), *own]


def record_in_real_time(
    settings: Variant,
    parameters: Parameters,
    record: RunRecord,
    progress: Callable[[float], None],
    stop: threading.Event | None,
) -> None:
    """Start the nodes of a variant, and end them when its time is over.

    Raises:
        SimulationError: if a node dies that was not killed; with its last words.
        BagError: if its bag holds no motion.
        RunStopped: if it was told to.
    """
    controller, has_faults = CONTROLLERS[settings.controller], bool(settings.faults)
    with Nodes(record.path.parent, stop) as nodes:
        others = remaps(controller) if has_faults else {}
        topics = recorded(controller, has_faults)
        output: dict[str, Any] = {"output": str(record.bag), "topics": topics}
        injector = (INJECTOR,) if has_faults else ()
        start = (RECORDER, *injector, *controller.executables, BRIDGE, "reference")
        for name in start:
            nodes.start(name, {**parameters, RECORDER: output}[name], remaps=others.get(name, {}))
        nodes.wait_for_event(RECORDER, Event.READY, _START_TIMEOUT)
        record.claim()  # now: we may be killed
        parts = _Parts(record, nodes, output)
        if has_faults:
            nodes.wait_for_event(INJECTOR, Event.READY, _START_TIMEOUT)
            _follow(settings, nodes, parts, progress)
        else:
            nodes.wait_for_event("reference", Event.SENT, _START_TIMEOUT)
            _watch(settings, nodes, UsageLog(nodes, record.bag / USAGE), progress)
        alive = [name for name in start if name in nodes.processes and name != BRIDGE]
        nodes.stop(*sorted(alive, key=lambda name: name == RECORDER))
    parts.join()
    _check_moved(record.bag, controller.command)


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


def _follow(
    settings: Variant, nodes: Nodes, parts: "_Parts", progress: Callable[[float], None]
) -> None:
    """Kill and start nodes when it is time to, until the run is over.

    The time that a node takes to come up again does not count: later deeds and the end wait for it.
    """
    due = deeds(settings.faults)
    began = time.monotonic()
    while (t := time.monotonic() - began) < settings.duration:
        nodes.check()
        progress(t)
        while due and t >= due[0][0]:
            _, kills, node = due.pop(0)
            if kills:
                nodes.kill(node)
                continue
            before = time.monotonic()
            _start_again(node, nodes, parts)
            began += time.monotonic() - before
        time.sleep(_POLL)
    progress(settings.duration)


def _watch(
    settings: Variant, nodes: Nodes, log: UsageLog, progress: Callable[[float], None]
) -> None:
    """Look at what the nodes take until the run is over; send a motion that has ended again."""
    (controller,) = CONTROLLERS[settings.controller].executables
    began = moved = time.monotonic()
    motions = 1  # that the reference was started to send
    while (t := time.monotonic() - began) < settings.duration:
        nodes.check()
        progress(t)
        if log.look() and time.monotonic() - moved >= _AGAIN:
            sent = len(nodes.events("reference", Event.SENT))
            modes = nodes.events(controller, Event.MODE)
            if sent == motions and modes and modes[-1]["mode"] in _ENDED:
                moved, motions = time.monotonic(), motions + 1
                nodes.stop("reference")
                nodes.start_again("reference")
        time.sleep(_POLL)


def _start_again(node: str, nodes: Nodes, parts: "_Parts") -> None:
    """Start a node that was killed, and wait until it is at work."""
    event = Event.SENT if node == "reference" else Event.READY
    told, commanded = (len(nodes.events(node, kind)) for kind in (event, Event.COMMANDED))
    if node == RECORDER:
        parts.add()
    else:
        nodes.start_again(node)
    nodes.wait_for_event(node, event, _START_TIMEOUT, times=told + 1)
    if node == BRIDGE and nodes.processes.keys() - {RECORDER, BRIDGE, "reference", INJECTOR}:
        with suppress(SimulationError):  # they may find each other late, or a fault is between
            nodes.wait_for_event(BRIDGE, Event.COMMANDED, _FIND_TIMEOUT, times=commanded + 1)


def deeds(faults: tuple[Fault, ...]) -> list[tuple[float, bool, str]]:
    """Return when [s] which node is killed (true) or started again, one after the other."""
    kills = [fault for fault in faults if isinstance(fault, Kill)]
    found = [(fault.at, True, fault.node) for fault in kills]
    found += [(fault.end, False, fault.node) for fault in kills if fault.end < float("inf")]
    return sorted(found, key=lambda deed: deed[0])


class _Parts:
    """The bag of a run whose recorder may be killed: what each recorder has left, in one bag."""

    def __init__(self, record: RunRecord, nodes: Nodes, output: dict[str, Any]) -> None:
        self._bag, self._nodes, self._output = record.bag, nodes, output
        self._folder = record.path.parent
        self._added: list[Path] = []

    def add(self) -> None:
        """Start the recorder again; it writes over nothing, so to a folder of its own."""
        part = self._folder / f"part_{len(self._added) + 1}"
        shutil.rmtree(part, ignore_errors=True)  # of a run before
        self._added.append(part)
        self._nodes.start_again(RECORDER, self._output | {"output": str(part)})

    def join(self) -> None:
        """Make the bag whole, with all parts as further files of it."""
        for number, part in enumerate(self._added, 1):
            if part.is_dir():
                recover(part)
                file = part / f"{part.name}_0.mcap"
                file.rename(self._bag / f"{self._bag.name}_{number}.mcap")
                shutil.rmtree(part)
        recover(self._bag)


def _check_moved(bag: Path, command: str) -> None:
    """Raise BagError unless states and commands are in the bag."""
    topics = Bag(bag).topics
    for name in ("/joint_states", f"/{command}", "/reference"):
        if name not in topics or not topics[name].count:
            raise BagError(f"{bag}: nothing was recorded of {name}")
