"""Random sequences of faults, the same for the same seed."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.lab.faults.base import ROBOT, Fault
from eulerparams_control.lab.faults.contents import ClockJump, Freeze, Nan, Noise, Stuck
from eulerparams_control.lab.faults.delivery import Delay, Drop, Duplicate, Reorder
from eulerparams_control.lab.faults.nodes import Kill, SecondPublisher
from eulerparams_control.parameters.schemes import schemes

FIRST = 0.1
"""Part of the run before the first fault begins: the controller is to be at work."""

LAST = 0.6
"""Part of the run at whose end all faults are over, so that recovery can be judged."""

_MOST = 4  # faults of a sequence
_LONGEST, _SHORTEST = 0.5, 0.01  # [s] of a fault

_NOISE = {"wrench": 5.0, "joint_effort": 2.0}  # largest standard deviation [N, Nm]; else:
_NOISE_OF_OTHERS = 0.01  # [rad, m]

Draw = Callable[[np.random.Generator, dict[str, Any]], Fault]
"""What makes a fault of random values on a topic, at a time, for a time."""


def _any_of(random: np.random.Generator, names: Sequence[str]) -> str:
    return names[int(random.integers(len(names)))]


def _number(random: np.random.Generator, low: float, high: float) -> float:
    """Return a number from low to high, each order of magnitude as likely as the next."""
    return round(float(math.exp(random.uniform(math.log(low), math.log(high)))), 6)


def _sometimes(random: np.random.Generator) -> float:
    """Return a probability: of each message in half of the cases."""
    return 1.0 if random.random() < 0.5 else _number(random, 0.05, 1.0)


def _jump(random: np.random.Generator, where: dict[str, Any]) -> Fault:
    by = _number(random, 0.01, 10.0) * (1 if random.random() < 0.5 else -1)
    if random.random() < 0.5:
        return ClockJump(topic=ROBOT, at=where["at"], by=by)
    return ClockJump(**where, by=by)


def _noise(random: np.random.Generator, where: dict[str, Any]) -> Fault:
    largest = _NOISE.get(where["topic"], _NOISE_OF_OTHERS)
    return Noise(**where, std=_number(random, 0.01 * largest, largest))


_DRAWS: Mapping[str, Draw] = {
    "drop": lambda r, w: Drop(**w, probability=_sometimes(r)),
    "duplicate": lambda r, w: Duplicate(**w, copies=int(r.integers(1, 4))),
    "delay": lambda r, w: Delay(**w, by=_number(r, 0.005, 0.3)),
    "reorder": lambda r, w: Reorder(**w, depth=int(r.integers(2, 6))),
    "nan": lambda r, w: Nan(**w, value="random", probability=_sometimes(r)),
    "freeze": lambda r, w: Freeze(**w),
    "stuck": lambda r, w: Stuck(**w),
    "noise": _noise,
    "clock_jump": _jump,
    "second_publisher": lambda r, w: SecondPublisher(
        **{**w, "topic": "reference"}, offset=round(float(r.uniform(-0.02, 0.02)), 6)
    ),
}


def random_faults(
    seed: int, controller: str, duration: float, nodes: Sequence[str] | None = None
) -> tuple[Fault, ...]:
    """Return a random sequence of faults, by when they begin.

    From one to four of all kinds, each from 0.01 to 0.5 s, all of them over after ``LAST`` of the
    run.

    Args:
        seed: the same gives the same.
        controller: name of its scheme.
        duration: of the run [s].
        nodes: that may be killed, and are started again; None: the controller, () none.

    Raises:
        UnknownNameError: if there is no such controller.
    """
    if controller not in schemes():
        raise UnknownNameError("controller", controller, schemes())
    topics = schemes()[controller].topics
    random = np.random.default_rng([seed, *controller.encode()])
    mortal = (controller,) if nodes is None else tuple(nodes)
    kinds = [*_DRAWS, *(["kill"] if mortal else [])]
    drawn = [
        _draw(random, _any_of(random, kinds), topics, mortal, duration)
        for _ in range(int(random.integers(1, _MOST + 1)))
    ]
    return tuple(sorted(drawn, key=lambda fault: fault.at))


def _draw(
    random: np.random.Generator,
    kind: str,
    topics: Sequence[str],
    mortal: Sequence[str],
    duration: float,
) -> Fault:
    """Return a fault of a kind that is over in time: one that is not is drawn again."""
    first, last = FIRST * duration, LAST * duration
    while True:
        at = round(float(random.uniform(first, last)), 6)
        lasting = _number(random, _SHORTEST, _LONGEST)
        if kind == "kill":
            fault: Fault = Kill(node=_any_of(random, mortal), at=at, restart_after=lasting)
        else:
            where = {"topic": _any_of(random, topics), "at": at, "duration": lasting}
            fault = _DRAWS[kind](random, where)
        if fault.end <= last:
            return fault
