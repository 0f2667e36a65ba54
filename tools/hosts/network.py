"""Two hosts on one machine, and the link between them.

A host is a process that does nothing but hold namespaces of its own: of the network, so that
nothing but the link leads to the other host; of IPC and mounts, with a /dev/shm of its own, so
that the middleware cannot go round the link through shared memory.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Self

DEVICE = "link0"
ADDRESSES = ("10.77.0.1", "10.77.0.2")
_NAMESPACES = ("--net", "--ipc", "--mount")
_HOLD = "mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo ready && exec sleep infinity"


class NoHosts(Exception):
    """This machine, or this user, cannot have two hosts; says what is missing."""


class Host:
    """One of the two hosts.

    Args:
        name: of it.
        address: of its end of the link.

    Raises:
        NoHosts: if there are no namespaces.
    """

    def __init__(self, name: str, address: str) -> None:
        self.name, self.address = name, address
        self._holder = subprocess.Popen(
            ["unshare", *_NAMESPACES, "sh", "-c", _HOLD],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != "ready\n":
            _, error = self._holder.communicate()
            raise NoHosts(f"no namespaces of {', '.join(_NAMESPACES)}: {error.strip()}")

    @property
    def pid(self) -> int:
        """Of the process that holds it."""
        return self._holder.pid

    def command(self, words: Sequence[str]) -> list[str]:
        """Return what runs a command on this host."""
        return ["nsenter", "--target", str(self.pid), "--net", "--ipc", "--mount", "--", *words]

    def run(self, *words: str) -> None:
        """Run a command here; raises NoHosts with what it says."""
        _run(*self.command(words))

    def connect(self) -> None:
        """Give the end of the link its address, and let multicast through it."""
        self.run("ip", "address", "add", f"{self.address}/24", "dev", DEVICE)
        self.run("ip", "link", "set", DEVICE, "multicast", "on", "up")

    def end(self) -> None:
        """End it, and what it holds."""
        self._holder.kill()
        self._holder.wait()


class Cable:
    """Two TAP devices and a process that carries packets between them: it takes no netem."""

    kind = "a cable in a process of its own"

    def __init__(self, hosts: Sequence[Host]) -> None:
        script = Path(__file__).with_name("cable.py")
        pids = [str(host.pid) for host in hosts]
        self._process = subprocess.Popen(
            [sys.executable, str(script), DEVICE, *pids],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        if self._process.stdout.readline() != "ready\n":
            raise NoHosts("there is no /dev/net/tun: load the module tun")

    def impair(self, loss: float = 0.0, delay: float = 0.0, jitter: float = 0.0) -> None:
        """Lose a part of the packets, delay the rest by [s], give or take; both ways."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{loss} {delay} {jitter}\n")
        self._process.stdin.flush()

    def end(self) -> None:
        """Take it away."""
        self._process.kill()
        self._process.wait()


class Network:
    """Two hosts and their link, as long as the ``with`` lasts.

    Attributes:
        robot, controller: the hosts.
        link: between them.
    """

    def __init__(self) -> None:
        self._hosts: list[Host] = []
        self.link: Cable | None = None

    def __enter__(self) -> Self:
        if os.geteuid() != 0:
            raise NoHosts("it takes root to make network namespaces: run it with sudo")
        try:
            for name, address in zip(("robot", "controller"), ADDRESSES, strict=True):
                self._hosts.append(Host(name, address))
            self.robot, self.controller = self._hosts
            self.link = Cable(self._hosts)
            for host in self._hosts:
                host.connect()
        except FileNotFoundError as error:
            self.__exit__()
            raise NoHosts(f"the command {error.filename} is missing: install iproute2") from error
        except NoHosts:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        if self.link is not None:
            self.link.end()
        for host in self._hosts:
            host.end()

    def cut(self) -> None:
        """Cut the link."""
        self.robot.run("ip", "link", "set", DEVICE, "down")

    def restore(self) -> None:
        """Mend the link."""
        self.robot.run("ip", "link", "set", DEVICE, "up")


def _run(*words: str) -> None:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise NoHosts(f"'{' '.join(words)}' says: {done.stderr.strip()}")
