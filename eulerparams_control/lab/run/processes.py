"""The nodes of an experiment as processes in a ROS domain of their own."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from eulerparams_control.command_line import executables
from eulerparams_control.errors import SimulationError
from eulerparams_control.events import Event, events_of
from eulerparams_control.lab.run.domains import Domain

LOG, EVENTS = ".log", ".events"
"""Suffixes of the files that nodes write, for people and for programs."""

# Time [s] that a node gets to end after a signal, before it is killed.
_PATIENCE = 10.0

_POLL = 0.01  # [s] between two looks at what is due

# None: no Linux.  Loaded here: between fork and exec nothing may be.
_PRCTL = getattr(ctypes.CDLL(None), "prctl", None)


def end_with_parent(number: signal.Signals) -> None:
    """Have this process get a signal when the thread that started it ends, also by a kill."""
    if _PRCTL:
        _PRCTL(1, number)


def _end_with(parent: int) -> None:
    end_with_parent(signal.SIGINT)
    if _PRCTL and os.getppid() != parent:  # it has ended before
        os._exit(1)


class RunStopped(Exception):
    """A run was told to stop before its end."""


class Nodes:
    """Processes of nodes that end together, by default in a ROS domain of their own.

    Args:
        folder: for their parameter files, logs (stderr) and events (stdout).
        stop: set from another thread when they are to end.
        own_domain: false: they are in the domain of this process.

    Attributes:
        environment: of the processes; names the domain.
        processes: by executable.
    """

    def __init__(
        self,
        folder: Path,
        stop: threading.Event | None = None,
        *,
        own_domain: bool = True,
    ) -> None:
        self._folder = folder
        self._stop = stop or threading.Event()
        self._domain = Domain() if own_domain else None
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._commands: dict[str, list[str]] = {}
        self.environment = {
            **os.environ,
            "RCUTILS_COLORIZED_OUTPUT": "0",
            "RCUTILS_LOGGING_USE_STDOUT": "0",  # there the events are
        }
        if self._domain is not None:
            self.environment["ROS_DOMAIN_ID"] = str(self._domain.number)
            self.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> "Nodes":
        return self

    def __exit__(self, *_error: object) -> None:
        self.stop(*reversed(list(self.processes)))
        if self._domain is not None:
            self._domain.release()

    def start(
        self,
        executable: str,
        parameters: dict[str, Any],
        namespace: str = "/",
        remaps: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Start a node with its parameters, and with other names for some of its topics.

        ``executable`` is one of ours, or the name of a module.
        """
        file = self._write(executable, parameters)
        runner = ["eulerparams_control.command_line"] if executable in executables() else []
        command = [sys.executable, "-m", *runner, executable, "--ros-args"]
        command += ["--params-file", str(file), "-r", f"__ns:={namespace}"]
        for topic, other in remaps.items():
            command += ["-r", f"{topic}:={other}"]
        self._commands[executable] = command
        for kind in (LOG, EVENTS):
            self._file(executable, kind).write_bytes(b"")
        self._launch(executable)

    def start_again(self, executable: str) -> None:
        """Start a node that was killed, as before; its log goes on."""
        self._launch(executable)

    def kill(self, executable: str) -> None:
        """Kill a node; it is then no longer among the processes.

        Raises:
            SimulationError: if it has died before; with its last words.
        """
        self.check()
        process = self.processes.pop(executable, None)
        if process is not None:
            process.kill()
            process.wait()

    def _write(self, executable: str, parameters: dict[str, Any]) -> Path:
        """Write the parameter file of a node; return it."""
        file = self._folder / f"{executable}.yaml"
        content = {"/**": {"ros__parameters": _uniform(parameters)}}
        file.write_text(yaml.safe_dump(content), encoding="utf-8")
        return file

    def _launch(self, executable: str) -> None:
        with (
            open(self._file(executable, LOG), "ab") as log,
            open(self._file(executable, EVENTS), "ab") as events,
        ):
            self.processes[executable] = subprocess.Popen(
                self._commands[executable],
                stdin=subprocess.DEVNULL,
                stdout=events,
                stderr=log,
                env=self.environment,
                start_new_session=True,  # a Ctrl-C in the terminal is ours to pass on
                preexec_fn=None if self._domain else partial(_end_with, os.getpid()),
            )

    def _file(self, executable: str, kind: str) -> Path:
        return self._folder / f"{executable}{kind}"

    def events(self, executable: str, kind: Event) -> list[dict[str, Any]]:
        """Return the events of a kind that a node has reported so far."""
        text = self._file(executable, EVENTS).read_text(encoding="utf-8", errors="replace")
        return [event for event in events_of(text) if event["event"] == kind]

    def ended(self, executable: str) -> bool:
        """Return whether a node has ended by itself, and well.

        Raises:
            SimulationError: if any node has died; with its last words.
            RunStopped: if they are to end.
        """
        self.check(executable)
        return self.processes[executable].poll() is not None

    def check(self, may_end: str = "") -> None:
        """Raise unless all nodes are running.

        Args:
            may_end: a node that may end by itself, and well.

        Raises:
            SimulationError: if any node has died; with its last words.
            RunStopped: if they are to end.
        """
        if self._stop.is_set():
            raise RunStopped
        for name, process in self.processes.items():
            if process.poll() is not None and (process.returncode != 0 or name != may_end):
                raise SimulationError(
                    f"the node {name} died with exit code {process.returncode}:\n"
                    + self.last_words(name)
                    + self.complaints(but=name)
                )

    def stop(self, *executables: str) -> None:
        """End nodes one after the other, those that have not ended yet."""
        for name in executables:
            process = self.processes[name]
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def wait_for_event(self, executable: str, event: Event, timeout: float, times: int = 1) -> None:
        """Wait until a node has reported an event ``times`` times.

        Raises:
            SimulationError: if it does not within ``timeout`` [s].
        """
        deadline = time.monotonic() + timeout
        while len(self.events(executable, event)) < times:
            self.ended(executable)
            if time.monotonic() > deadline:
                raise SimulationError(
                    f"{executable} was not {event} within {timeout:g} s:\n"
                    + self.last_words(executable)
                    + self.complaints(but=executable)
                )
            time.sleep(0.02)

    def play(
        self,
        duration: float,
        progress: Callable[[float], None],
        deeds: Iterable[tuple[float, Callable[[], object]]] = (),
        look: Callable[[], object] = lambda: None,
    ) -> None:
        """Run the nodes in real time, and do each deed when it is due.

        The time that a deed takes does not count: later ones and the end wait for it.

        Args:
            duration: [s] of the run.
            progress: called with the time [s] again and again.
            deeds: when [s], and what is done then.
            look: called again and again.

        Raises:
            SimulationError: if a node dies that was not killed; with its last words.
            RunStopped: if they are to end.
        """
        due = deque(sorted(deeds, key=itemgetter(0)))
        began = time.monotonic()
        while (t := time.monotonic() - began) < duration:
            self.check()
            progress(t)
            look()
            while due and t >= due[0][0]:
                before = time.monotonic()
                due.popleft()[1]()
                began += time.monotonic() - before
            time.sleep(_POLL)
        progress(duration)

    def last_words(self, executable: str, count: int = 8) -> str:
        """Return the last lines of the log of a node."""
        text = self._file(executable, LOG).read_text(encoding="utf-8", errors="replace")
        lines = [line for line in text.splitlines() if line.strip()]
        return "\n".join(f"  {line}" for line in lines[-count:]) or "  (it said nothing)"

    def complaints(self, but: str) -> str:
        """Return the last fault of each other node: the cause is often with a neighbour."""
        text = ""
        for name in self.processes:
            if name != but and (faults := self.events(name, Event.FAULT)):
                text += f"\n{name} said:\n  {faults[-1]['text']}"
        return text


def _uniform(value: Any) -> Any:
    """Return parameters in which no list mixes integers with floats: ROS reads none that does."""
    if isinstance(value, Mapping):
        return {key: _uniform(entry) for key, entry in value.items()}
    if isinstance(value, list) and any(isinstance(entry, float) for entry in value):
        return [float(entry) if type(entry) is int else entry for entry in value]
    return value
