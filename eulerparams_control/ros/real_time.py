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

_LIMITS = "for this user in /etc/security/limits.conf (then log in again; see ulimit"


def claim(parameters: RealTimeParameters, health: Health) -> None:
    """Claim what the parameters ask for; warn of what is not permitted, show what is in force.

    The threads of DDS receive and send, so all threads get it, and those that they start later
    inherit it.

    Raises:
        ConfigurationError: if there is no cpu of a number.
    """
    for name, obtain, remedy in (
        ("cpu_affinity", _pin, "Allow sched_setaffinity"),
        ("realtime_priority", _prefer, f"Set rtprio 99 {_LIMITS} -r)"),
        ("lock_memory", _lock_memory, f"Set memlock unlimited {_LIMITS} -l)"),
    ):
        wanted = getattr(parameters, name)
        try:
            if wanted:
                obtain(wanted)
        except OSError as error:
            health.complain(
                f"{name} {wanted} is not in force: {error.strerror} (errno {error.errno}); the "
                f"node goes on without it. {remedy}"
            )
    cpus = sorted(os.sched_getaffinity(0))
    health.values |= {
        "realtime_priority": os.sched_getparam(0).sched_priority,
        "cpu_affinity": "all" if len(cpus) == os.cpu_count() else ", ".join(map(str, cpus)),
        "locked memory [kB]": int(_status().get("VmLck", "0 kB").split()[0]),
    }


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
    wanted = os.SCHED_FIFO, os.sched_param(priority)
    _each_thread(lambda thread: os.sched_setscheduler(thread, *wanted))


def _lock_memory(_wanted: bool) -> None:
    if not int(_status().get("CapEff", "0"), 16) >> _CAP_IPC_LOCK & 1:
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
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return {key: value.strip() for key, _, value in (line.partition(":") for line in lines)}
