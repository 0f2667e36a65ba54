"""Real time: what a node asks of the operating system, what is refused, and what is in force."""

import ctypes
import errno
import os
import resource
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.parameters.real_time import RealTimeParameters
from eulerparams_control.ros.diagnostics import Health

_MCL_CURRENT, _MCL_FUTURE = 1, 2  # of mlockall(2)
_CAP_IPC_LOCK = 14  # of capabilities(7): no limit holds


def claim(parameters: RealTimeParameters, health: Health) -> None:
    """Claim what the parameters ask for; warn of what is not permitted, show what is in force.

    The threads of DDS receive and send, so all threads get it, and those that they start later
    inherit it.

    Raises:
        ConfigurationError: if there is no cpu of a number.
    """
    p = parameters
    limits = "in /etc/security/limits.conf (then log in again; see ulimit"
    if p.cpu_affinity:
        wanted = f"cpu_affinity {list(p.cpu_affinity)}"
        _try(wanted, lambda: _pin(p.cpu_affinity), "allow sched_setaffinity", health)
    if p.realtime_priority:
        wanted = f"realtime_priority {p.realtime_priority}"
        remedy = f"set rtprio {p.realtime_priority} or more for this user {limits} -r)"
        _try(wanted, lambda: _prefer(p.realtime_priority), remedy, health)
    if p.lock_memory:
        remedy = f"set memlock unlimited for this user {limits} -l)"
        _try("lock_memory", _lock_memory, remedy, health)
    health.values.update(_in_force())


def _try(wanted: str, claim_it: Callable[[], None], remedy: str, health: Health) -> None:
    try:
        claim_it()
    except OSError as error:
        health.complain(
            f"{wanted} is not in force: {error.strerror} (errno {error.errno}); the node goes on "
            f"without it. {remedy[0].upper()}{remedy[1:]}"
        )


def _pin(cpus: tuple[int, ...]) -> None:
    try:
        _each_thread(lambda thread: os.sched_setaffinity(thread, cpus))
    except OSError as error:
        if error.errno != errno.EINVAL:  # none of them is there
            raise
    if missing := sorted(set(cpus) - os.sched_getaffinity(0)):
        raise ConfigurationError(
            f"parameter 'cpu_affinity' names the cpus {missing}, which do not exist, or not for "
            f"this process; it has {os.cpu_count()}, counted from 0"
        )


def _prefer(priority: int) -> None:
    parameter = os.sched_param(priority)
    _each_thread(lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, parameter))


def _lock_memory() -> None:
    if not int(_status()["CapEff"], 16) >> _CAP_IPC_LOCK & 1:
        try:  # within a limit the process would end as soon as it needs more
            resource.setrlimit(resource.RLIMIT_MEMLOCK, (resource.RLIM_INFINITY,) * 2)
        except ValueError as error:
            raise PermissionError(errno.EPERM, "memlock is limited") from error
    if ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _each_thread(call: Callable[[int], None]) -> None:
    for thread in os.listdir("/proc/self/task"):
        with suppress(ProcessLookupError):  # it has ended meanwhile
            call(int(thread))


def _status() -> dict[str, str]:
    """Return what Linux tells of the process."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return {key: value.strip() for key, _, value in (line.partition(":") for line in lines)}


def _in_force() -> dict[str, str | int]:
    """Return what /diagnostics shows, by the names of the parameters."""
    cpus = sorted(os.sched_getaffinity(0))
    return {
        "realtime_priority": os.sched_getparam(0).sched_priority,
        "cpu_affinity": "all" if len(cpus) == os.cpu_count() else ", ".join(map(str, cpus)),
        "locked memory [kB]": int(_status()["VmLck"].split()[0]),
    }
