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


class Cable:
    """What happens to packets on their way.

    Args:
        ends: the two devices.
    """

    def __init__(self, ends: tuple[int, int]) -> None:
        self._other = {ends[0]: ends[1], ends[1]: ends[0]}
        self._under_way: list[tuple[float, int, int, bytes]] = []
        self._order = itertools.count()
        self._chance = random.Random(0)
        self.loss = self.delay = self.jitter = 0.0

    def take(self, end: int) -> None:
        """Take all packets that have come to an end."""
        while True:
            try:
                packet = os.read(end, _LARGEST)
            except OSError:  # there is none, or the device is down
                return
            if self._chance.random() >= self.loss:
                late = self.delay + self.jitter * (2 * self._chance.random() - 1)
                item = time.monotonic() + late, next(self._order), self._other[end], packet
                heapq.heappush(self._under_way, item)

    def give(self) -> float | None:
        """Give on what is due; return in what time [s] something else is, None if nothing is."""
        while self._under_way:
            left = self._under_way[0][0] - time.monotonic()
            if left > 0:
                return left
            _, _, end, packet = heapq.heappop(self._under_way)
            try:
                os.write(end, packet)
            except OSError:  # the device is down: the packet is lost
                continue
        return None

    def run(self) -> None:
        """Carry packets until stdin is closed."""
        ends = list(self._other)
        while True:
            ready, _, _ = select.select([*ends, sys.stdin], [], [], self.give())
            for end in ends:
                if end in ready:
                    self.take(end)
            if sys.stdin in ready:
                line = sys.stdin.readline()
                if not line:
                    return
                self.loss, self.delay, self.jitter = map(float, line.split())


def main() -> int:
    """Make the devices and carry packets between them."""
    device, *pids = sys.argv[1:]
    try:
        first, second = (tap(int(pid), device) for pid in pids)
    except OSError as error:
        print(error, file=sys.stderr)
        return 1
    print("ready", flush=True)
    Cable((first, second)).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
