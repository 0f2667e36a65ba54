"""A cable between two hosts: carries packets between two TAP devices, some of them late or never.

    cable.py DEVICE PID PID

The devices are made in the network namespaces of the two processes.  A line on stdin says what
becomes of packets from then on: the part that is lost, their delay [s], its half width [s].
"""

import fcntl
import heapq
import itertools
import os
import random
import select
import struct
import sys
import time
from contextlib import suppress

_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
_LARGEST = 65536  # [bytes] of a packet


def tap(pid: int, device: str) -> int:
    """Return a TAP device made in the network namespace of a process."""
    namespace = os.open(f"/proc/{pid}/ns/net", os.O_RDONLY)
    os.setns(namespace, os.CLONE_NEWNET)
    os.close(namespace)
    end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    request = struct.pack("16sH22x", device.encode(), _IFF_TAP | _IFF_NO_PI)
    fcntl.ioctl(end, _TUNSETIFF, request)
    return end


def carry(ends: tuple[int, int]) -> None:
    """Carry packets between two devices until stdin is closed."""
    other, order, chance = (
        dict(zip(ends, reversed(ends), strict=True)),
        itertools.count(),
        random.Random(0),
    )
    under_way: list[tuple[float, int, int, bytes]] = []
    loss = delay = jitter = 0.0
    while True:
        wait = max(0.0, under_way[0][0] - time.monotonic()) if under_way else None
        ready, _, _ = select.select([*ends, sys.stdin], [], [], wait)
        for end in set(ready) & set(ends):
            with suppress(OSError):  # there is no more, or the device is down
                while True:
                    packet = os.read(end, _LARGEST)
                    if chance.random() >= loss:
                        due = time.monotonic() + delay + jitter * (2 * chance.random() - 1)
                        heapq.heappush(under_way, (due, next(order), other[end], packet))
        if sys.stdin in ready:
            if not (line := sys.stdin.readline()):
                return
            loss, delay, jitter = map(float, line.split())
        while under_way and under_way[0][0] <= time.monotonic():
            _, _, end, packet = heapq.heappop(under_way)
            with suppress(OSError):  # the device is down: the packet is lost
                os.write(end, packet)


def main() -> int:
    """Make the devices and carry packets between them."""
    device, *pids = sys.argv[1:]
    try:
        first, second = (tap(int(pid), device) for pid in pids)
    except OSError as error:
        print(error, file=sys.stderr)
        return 1
    print("ready", flush=True)
    carry((first, second))
    return 0


if __name__ == "__main__":
    sys.exit(main())
