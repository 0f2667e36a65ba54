"""Two hosts on one machine, and the link between them.

A host is a process that does nothing but hold namespaces of its own: of the network, so that
nothing but the link leads to the other host; of IPC and mounts, with a /dev/shm of its own, so
that the middleware cannot go round the link through shared memory.  The link is two TAP devices
and a process that carries packets between them, see ``cable``: it needs no netem.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

DEVICE = "link0"
ADDRESSES = {"robot": "10.77.0.1", "controller": "10.77.0.2"}
_NAMESPACES = ("--net", "--ipc", "--mount")
_HOLD = "mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo ready && exec sleep infinity"


class NoHosts(Exception):
    """This machine, or this user, cannot have two hosts; says what is missing."""


class _Child:
    """A process that says when it is ready, and runs until it is killed."""

    def __init__(self, command: Sequence[str], lacking: str) -> None:
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
        assert self.process.stdout is not None
        if self.process.stdout.readline() != "ready\n":
            _, error = self.process.communicate()
            raise NoHosts(lacking.format(error=error.strip()))

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


class Host(_Child):
    """One of the two hosts.

    Args:
        name: of it, in ``ADDRESSES``.

    Raises:
        NoHosts: if there are no namespaces.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        lacking = f"no namespaces of {', '.join(_NAMESPACES)}: {{error}}"
        super().__init__(["unshare", *_NAMESPACES, "sh", "-c", _HOLD], lacking)

    def command(self, words: Sequence[str]) -> list[str]:
        """Return what runs a command on this host."""
        target = ["--target", str(self.process.pid)]
        return ["nsenter", *target, "--net", "--ipc", "--mount", "--", *words]

    def ip(self, *words: str) -> None:
        """Run a command of ``ip`` here; raises NoHosts with what it says."""
        command = ["ip", *words]
        done = subprocess.run(self.command(command), capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise NoHosts(f"'{' '.join(command)}' says: {done.stderr.strip()}")


class Network:
    """Two hosts and their link, as long as the ``with`` lasts.

    Attributes:
        robot, controller: the hosts.

    Raises:
        NoHosts: if there cannot be any.
    """

    kind = "a cable in a process of its own"

    def __enter__(self) -> Self:
        if os.geteuid() != 0:
            raise NoHosts("it takes root to make network namespaces: run it with sudo")
        with ExitStack() as stack:
            try:
                self._make(stack)
            except FileNotFoundError as error:
                what = f"the command {error.filename} is missing: install iproute2"
                raise NoHosts(what) from error
            self._stack = stack.pop_all()
        return self

    def _make(self, stack: ExitStack) -> None:
        hosts = []
        for name in ADDRESSES:
            hosts.append(Host(name))
            stack.callback(hosts[-1].end)
        self.robot, self.controller = hosts
        script = str(Path(__file__).with_name("cable.py"))
        pids = [str(host.process.pid) for host in hosts]
        lacking = "there is no /dev/net/tun: load the module tun"
        self._cable = _Child([sys.executable, script, DEVICE, *pids], lacking)
        stack.callback(self._cable.end)
        for host in hosts:
            host.ip("address", "add", f"{ADDRESSES[host.name]}/24", "dev", DEVICE)
            host.ip("link", "set", DEVICE, "multicast", "on", "up")

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def cut(self) -> None:
        """Cut the link."""
        self.robot.ip("link", "set", DEVICE, "down")

    def restore(self) -> None:
        """Restore the link that was cut."""
        self.robot.ip("link", "set", DEVICE, "up")

    def impair(self, loss: float = 0.0, delay: float = 0.0, jitter: float = 0.0) -> None:
        """Lose a part of the packets, delay the rest by [s], give or take; both ways."""
        assert self._cable.process.stdin is not None
        self._cable.process.stdin.write(f"{loss} {delay} {jitter}\n")
        self._cable.process.stdin.flush()
