"""Requests to the operating system: granted for all threads, or a warning and no more."""

import ctypes
import errno
import os
import resource
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from ros_processes import FRAMES, values

NODES = ("impedance_control", "pybullet_bridge")
UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)


def threads() -> list[int]:
    return [int(thread) for thread in os.listdir("/proc/self/task")]


def tell(monkeypatch: pytest.MonkeyPatch, status: str) -> None:
    """Let Linux tell this of the process."""
    file = SimpleNamespace(read_text=lambda **_: status)
    monkeypatch.setattr("eulerparams_control.ros.real_time.Path", lambda _: file)


@pytest.fixture
def cpus() -> Iterator[set[int]]:
    """The cpus that the tests may run on, afterwards as before."""
    before = os.sched_getaffinity(0)
    yield before
    for thread in threads():
        os.sched_setaffinity(thread, before)


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> Any:
    """An operating system that grants all, and notes it."""
    granted = SimpleNamespace(limit=None, locked=None, priorities={}, number=0)

    def set_scheduler(thread: int, policy: int, param: Any) -> None:
        assert policy == os.SCHED_FIFO
        granted.priorities[thread] = param.sched_priority

    def lock(flags: int) -> int:
        granted.locked = flags
        return -1 if granted.number else 0

    monkeypatch.setattr(os, "sched_setscheduler", set_scheduler)
    tell(monkeypatch, "CapEff:\t0000000000000000\nVmLck:\t  123 kB\n")
    monkeypatch.setattr(resource, "setrlimit", lambda *limit: vars(granted).update(limit=limit))
    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: SimpleNamespace(mlockall=lock))
    monkeypatch.setattr(ctypes, "get_errno", lambda: granted.number)
    return granted


def warnings(running: Any) -> list[str]:
    return [line for line in running.lines if "is not in force" in line]


@pytest.mark.parametrize("name", NODES)
def test_all_threads_run_on_the_cpus_of_the_parameter_and_diagnostics_shows_them(world, cpus, name):
    cpu = max(cpus)
    running = world.start(name, {"cpu_affinity": [cpu]})
    shown = values(world.peer.status(name))
    assert {frozenset(os.sched_getaffinity(thread)) for thread in threads()} == {frozenset({cpu})}
    assert shown["cpu_affinity"] == ("all" if os.cpu_count() == 1 else str(cpu))
    assert (shown["realtime_priority"], shown["locked memory [kB]"]) == ("0", "0")
    assert warnings(running) == []


@pytest.mark.parametrize("name", NODES)
def test_a_priority_is_that_of_all_threads_and_memory_is_locked_without_a_limit(
    world, system, monkeypatch, name
):
    monkeypatch.setattr(os, "sched_getparam", lambda _: os.sched_param(47))
    running = world.start(name, {"realtime_priority": 47, "lock_memory": True})
    assert system.priorities.keys() >= set(threads())
    assert set(system.priorities.values()) == {47}
    assert system.limit == (resource.RLIMIT_MEMLOCK, UNLIMITED)
    assert system.locked == 3  # what there is, and what comes
    assert warnings(running) == []
    shown = values(world.peer.status(name))
    assert (shown["realtime_priority"], shown["locked memory [kB]"]) == ("47", "123")


@pytest.mark.parametrize("name", NODES)
def test_what_is_not_permitted_is_a_warning_and_the_node_goes_on(world, system, monkeypatch, name):
    refuse = Mock(side_effect=PermissionError(errno.EPERM, "Operation not permitted"))
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    monkeypatch.setattr(resource, "setrlimit", Mock(side_effect=ValueError("not allowed")))
    asked = {"realtime_priority": 50, "lock_memory": True, "cpu_affinity": [0]}
    running = world.start(name, asked)
    affinity, priority, memory = warnings(running)
    reason = "is not in force: Operation not permitted (errno 1); the node goes on without it."
    assert f"cpu_affinity (0,) {reason}" in affinity
    assert f"realtime_priority 50 {reason} Set rtprio 99 for this user" in priority
    assert "lock_memory True is not in force: memlock is limited" in memory
    assert system.locked is None  # within a limit the process could end by it
    assert running.exit_code is None
    assert values(world.peer.status(name))["realtime_priority"] == "0"


def test_a_process_that_may_lock_all_memory_needs_no_other_limit(world, system, monkeypatch):
    tell(monkeypatch, "CapEff:\t00000000a80465fb\nVmLck:\t  123 kB\n")
    running = world.start("clik", {"lock_memory": True})
    assert (system.limit, system.locked, warnings(running)) == (None, 3, [])
    system.number = errno.ENOMEM
    (warning,) = warnings(world.start("clik", {**FRAMES, "lock_memory": True}, namespace="/other"))
    assert "lock_memory True is not in force: Cannot allocate memory (errno 12)" in warning
