"""The monitor of a soak: listens to all robots, looks at all processes, writes the record.

The times of messages are those at which the middleware sent and received them, so that a busy
monitor changes nothing.  They are of the clock of the machine, which is watched: a step of it is
no latency.
"""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from eulerparams_control.control.mode import Cause
from eulerparams_control.errors import SimulationError
from eulerparams_control.lab.soak.ledger import PATIENCE
from eulerparams_control.lab.soak.record import (
    Life,
    Page,
    SoakEvent,
    SoakPlan,
    SoakRecord,
    Unanswered,
    usage_of,
    waited_of,
)
from eulerparams_control.lab.soak.ros.listener import Listener
from eulerparams_control.lab.soak.ros.stations import Station, Stations
from eulerparams_control.messages.keys import CAUSE, MODE
from eulerparams_control.ros.qos import QOS_STREAM

_LOOK = 0.004  # [s] between two looks at what has come
_WAITS, _USAGE = 0.2, 1.0  # [s] between two looks at the processes
_START = 60.0  # [s] for the first commands: a guard against hanging
_STEP = 1e-3  # [s] by which the clock of the machine may go apart from the steady one in a look
_AGAIN = 10.0  # [s] between two new starts of a motion
_EVENTS = 500  # are kept
_ERROR = b"\x02"
_RESTARTS = (Cause.SILENCE, Cause.STAMP_JUMP, Cause.COMMAND_SILENCE)

Progress = Callable[[SoakRecord, float], None]


def run_soak(
    plan: SoakPlan, folder: Path, progress: Progress = lambda _record, _t: None
) -> SoakRecord:
    """Run a soak; return what was seen.

    Args:
        plan: what runs.
        folder: for logs and the bag.
        progress: called once a second with the record so far and the time [s].

    Raises:
        SimulationError: if the nodes do not start.
    """
    with Stations(plan, folder) as stations:
        monitor = Monitor(plan, stations)
        try:
            monitor.start()
            monitor.watch(progress)
        finally:
            monitor.close()
        monitor.record.bag_megabytes = _megabytes(stations.bag)
        return monitor.record


class Monitor:
    """Listens and looks."""

    def __init__(self, plan: SoakPlan, stations: Stations) -> None:
        self.record = SoakRecord(plan, pages={c: [] for c in plan.controllers})
        self._plan, self._stations = plan, stations
        self._context = Context()
        rclpy.init(
            context=self._context,
            domain_id=stations.domain,
            signal_handler_options=SignalHandlerOptions.NO,  # they are those of who runs us
        )
        self._node = rclpy.create_node(
            "soak_monitor",
            context=self._context,
            start_parameter_services=False,
            use_global_arguments=False,
        )
        self._listeners = [Listener(self._node, c, plan.rate) for c in plan.controllers]
        self._diagnostics = self._node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda _: None, QOS_STREAM
        )
        self._lives: dict[tuple[str, int], Life] = {}
        self._said: dict[str, tuple[bytes, str]] = {}
        self._moved: dict[str, float] = {}
        self._origin = time.time() + _START
        self._offset = time.time() - time.monotonic()
        self._looked = time.monotonic()
        self._turned = 0.0
        self._watching = False

    @property
    def _t(self) -> float:
        """The time [s] since the end of the warm-up."""
        return time.time() - self._origin

    def start(self) -> None:
        """Start all nodes; return when all robots are commanded and move."""
        self._stations.start()
        deadline = time.monotonic() + _START
        while not all(listener.ledger.commands for listener in self._listeners):
            self._listen()
            self._stations.check()
            if time.monotonic() > deadline:
                raise SimulationError(f"no commands within {_START:g} s; see the logs")
        self._stations.move()
        self._listen()
        for listener in self._listeners:
            listener.ledger.forget()
            listener.ledger.turn()
        self._origin = time.time() + self._plan.warm_up
        self._turned, self._watching = -self._plan.warm_up, True
        self._looked, self.record.monitor_gap = time.monotonic(), 0.0
        self._offset = time.time() - time.monotonic()

    def watch(self, progress: Progress) -> None:
        """Watch until the end, or until a node dies."""
        waits = usage = 0.0
        while self._t < self._plan.seconds + PATIENCE + 2 * _USAGE and not self.record.death:
            self._listen()
            now = time.monotonic()
            if now - waits >= _WAITS:
                waits = now
                self._look_at_waits()
            if now - usage >= _USAGE:
                usage = now
                self._look_at_processes()
                self._find_missed()
                progress(self.record, self._t)
            self._turn_pages()
        self.record.lives = list(self._lives.values())
        self.record.strays = {one.controller: one.ledger.strays for one in self._listeners}

    # --- messages ----------------------------------------------------------------------

    def _listen(self) -> None:
        """Take what has come; wait a little if nothing has."""
        now = time.monotonic()
        self.record.monitor_gap = max(self.record.monitor_gap, now - self._looked)
        self._looked = now
        self._watch_clock(now)
        taken_by = [listener.take_all() for listener in self._listeners]
        subscription = self._diagnostics.handle
        with subscription:
            while taken := subscription.take_message(DiagnosticArray, False):
                self._on_diagnostics(*taken)
        if not any(taken_by):
            time.sleep(_LOOK)

    def _watch_clock(self, now: float) -> None:
        """Forget what waits for an answer when the clock of the machine was set."""
        offset = time.time() - now
        if abs(offset - self._offset) > _STEP and time.monotonic() - now < _STEP:
            self.record.clock_steps += 1
            for listener in self._listeners:
                listener.ledger.forget()
        self._offset = offset

    def _on_diagnostics(self, message: Any, info: dict[str, Any]) -> None:
        t = info["source_timestamp"] / 1e9
        for status in message.status:
            self._note(t, status)
            for listener in self._listeners:
                if status.name == f"{listener.controller}/{listener.controller}":
                    values, causes = _values(status), listener.causes
                    causes.refused.report(t, int(values.get("joint_states rejected", 0)))
                    causes.overrun.report(t, int(values.get("joint_states missed", 0)))
                    causes.said(t, values.get(MODE, ""), values.get(CAUSE, ""))

    def _note(self, t: float, status: Any) -> None:
        """Note what a node says that it did not say before; let a motion that ended go on."""
        said = status.level, status.message
        if self._said.get(status.name) == said:
            return
        self._said[status.name] = said
        self._tell(status.name, status.message, t - self._origin)
        for station in self._stations.each:
            its_own = status.name == f"{station.controller}/{station.controller}"
            if its_own and (status.level == _ERROR or _values(status).get(CAUSE) in _RESTARTS):
                self._move_again(station)

    def _move_again(self, station: Station) -> None:
        """Restart the motion, now and then, that a fault or a silence has ended."""
        now = time.monotonic()
        if not self._watching or now - self._moved.get(station.controller, -_AGAIN) < _AGAIN:
            return
        self._moved[station.controller] = now
        self._tell("monitor", f"starts the reference of {station.controller} anew", self._t)
        station.move_again()

    def _tell(self, who: str, what: str, t: float) -> None:
        if len(self.record.events) < _EVENTS:
            self.record.events.append(SoakEvent(t, who, what))

    # --- processes ---------------------------------------------------------------------

    def _look_at_waits(self) -> None:
        now = time.time()
        for station, listener in zip(self._stations.each, self._listeners, strict=True):
            waited: dict[int, float] = {}
            for process in (station.controller, "pybullet_bridge"):
                with suppress(OSError):  # it has ended, which the next look will find
                    waited |= waited_of(station.nodes.processes[process].pid)
            listener.causes.waits.sample(now, waited)

    def _look_at_processes(self) -> None:
        try:
            self._stations.check()
        except SimulationError as error:
            self.record.death = str(error)
            return
        for name, pid in [*self._stations.pids(), ("monitor", os.getpid())]:
            life = self._lives.setdefault((name, pid), Life(name, pid))
            life.samples.append((self._t, usage_of(pid)))

    def _find_missed(self) -> None:
        """Find the states that were not answered, and why; those of the warm-up do not count."""
        now = time.time()
        for listener in self._listeners:
            for missed in listener.ledger.missed(now):
                cause = listener.causes.of(missed.sent)
                if 0 <= missed.sent - self._origin < self._plan.seconds:
                    self.record.unanswered.append(Unanswered(listener.controller, missed, cause))

    def _turn_pages(self) -> None:
        """Begin new pages when their time is over."""
        end = self._turned + self._plan.page if self._turned >= 0 else 0.0
        if self._t < end or self._turned >= self._plan.seconds:
            return
        for listener in self._listeners:
            ledger = listener.ledger
            page = Page(self._turned, end, ledger.states, ledger.commands, ledger.latencies)
            self.record.pages[listener.controller].append(page)
            ledger.turn()
        self._turned = end

    def close(self) -> None:
        """End the node."""
        self._node.destroy_node()
        self._context.try_shutdown()


def _values(status: Any) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


def _megabytes(folder: Path) -> float:
    """Return the size [MB] of the files of a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6
