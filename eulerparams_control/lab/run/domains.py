"""ROS domains of their own for runs, also for those that run at the same time.

Domain d has the UDP ports 7400 + 250 d and up; its first participant takes 7410 + 250 d, the next
ones every second port after it, and all listen to 7400 + 250 d (RTPS 9.6.1.1).  A domain is free
if all of these can be bound.  The nodes of a run take them only when they start, so the run also
holds a name, of the same network namespace as the ports, until it ends.

Fast DDS also has shared memory by the numbers of the ports.  A process that is killed leaves it
behind; where it was killed while it made it, the next participant with that number waits for the
rest for ever.  So what is left in a domain that nobody uses is removed.
"""

import os
import re
import socket
from contextlib import suppress
from pathlib import Path

from eulerparams_control.errors import ConfigurationError

DOMAINS = range(1, 100)
"""Those whose ports stay below what Linux gives to outgoing connections."""

_PORTS = 250  # of a domain
_SHARED_MEMORY = Path("/dev/shm")
_PARTICIPANTS = 12  # of a domain, at most: more nodes than any run has
_NAME = "\0eulerparams_control_domain_{}"  # abstract: it goes with the process that holds it


class Domain:
    """A domain that nobody else has, until it is released.

    Args:
        numbers: those that it may have; None is ``DOMAINS``.

    Raises:
        ConfigurationError: if none is free.
    """

    def __init__(self, numbers: range | None = None) -> None:
        numbers = numbers or DOMAINS
        for offset in range(len(numbers)):
            self.number = numbers[(os.getpid() + offset) % len(numbers)]
            self._held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            if _bind(self._held, _NAME.format(self.number)) and _is_quiet(self.number):
                clear_leftovers(self.number)
                return
            self._held.close()
        raise ConfigurationError(
            f"no ROS domain from {numbers[0]} to {numbers[-1]} is free on this machine; end what "
            "runs in them"
        )

    def release(self) -> None:
        """Release the domain; its participants have ended."""
        self._held.close()


def clear_leftovers(domain: int, folder: Path = _SHARED_MEMORY) -> None:
    """Remove the ports in shared memory of a domain that nobody uses."""
    ports = range(_first_port(domain), _first_port(domain + 1))
    for path in folder.glob("*fastrtps_port*"):
        found = re.fullmatch(r"(?:sem\.)?fastrtps_port(\d+)(?:_el|_sl|_mutex)?", path.name)
        if found and int(found[1]) in ports:
            with suppress(OSError):  # it is somebody else's
                path.unlink()


def _first_port(domain: int) -> int:
    return 7400 + _PORTS * domain


def _is_quiet(domain: int) -> bool:
    """Return whether no participant of a domain runs on this machine."""
    first = _first_port(domain)
    ports = [first, *range(first + 10, first + 10 + 2 * _PARTICIPANTS, 2)]
    for port in ports:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            if not _bind(probe, ("", port)):
                return False
    return True


def _bind(probe: socket.socket, address: str | tuple[str, int]) -> bool:
    try:
        probe.bind(address)
    except OSError:
        return False
    return True
