"""Sequences side by side: each worker is a process with a ROS domain of its own."""

import functools
import itertools
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from eulerparams_control.errors import EulerParamsError
from eulerparams_control.lab.campaign.outcome import SequenceOutcome, look
from eulerparams_control.lab.campaign.plan import (
    CONTROLLERS,
    FAULTY,
    LOCKSTEP,
    REALTIME,
    SequencePlan,
    make_plan,
)
from eulerparams_control.lab.campaign.record import SequenceRecord
from eulerparams_control.lab.experiments.domains import Domain

REALTIME_JOBS = 2
"""Sequences in real time at most at once: each takes more than half a core."""

_LIFE = 30  # sequences of a worker, on average: what they leave behind goes with it

_AGAIN = 2  # times more, by itself, if the machine starved and something was found

_REALTIME_PART = 0.15  # of a campaign with both modes


def plans(
    count: int,
    seed: int,
    controllers: Sequence[str] = CONTROLLERS,
    mode: str = LOCKSTEP,
    kind: str = FAULTY,
) -> list[SequencePlan]:
    """Return as many sequences, controller after controller, seed after seed."""
    n = len(controllers)
    return [make_plan(seed + k // n, controllers[k % n], mode, kind) for k in range(count)]


def plans_of_both(
    count: int, seed: int, controllers: Sequence[str] = CONTROLLERS, kind: str = FAULTY
) -> list[SequencePlan]:
    """Return as many sequences, most in lock-step, the rest in real time."""
    in_real_time = round(_REALTIME_PART * count)
    return plans(count - in_real_time, seed, controllers, kind=kind) + plans(
        in_real_time, seed, controllers, REALTIME, kind
    )


@functools.cache
def _domain() -> Domain:
    """Return the domain of this worker."""
    return Domain()


def run(plan: SequencePlan) -> SequenceOutcome:
    """Run a sequence here; what cannot be run is an outcome, too."""
    started = time.monotonic()
    try:
        if plan.mode == LOCKSTEP:
            from eulerparams_control.lab.campaign.ros.lockstep import run_lockstep

            record = run_lockstep(plan, _domain().number)
        else:
            record = _run_nodes(plan)
    except EulerParamsError as error:
        return SequenceOutcome(plan, error=str(error), seconds=time.monotonic() - started)
    except Exception as error:  # of any kind: the others go on
        return SequenceOutcome(plan, error=repr(error), seconds=time.monotonic() - started)
    return look(plan, record, time.monotonic() - started)


_has_nodes = False  # of this worker: there are processes that it has started

# Set when this worker is to end.
_stop = threading.Event()


def _end(*_: object) -> None:
    """End this worker: at once, or when the nodes of its sequence have ended."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one within set() waits for ever
    _stop.set()
    if not _has_nodes:
        os._exit(1)


def _run_nodes(plan: SequencePlan) -> SequenceRecord:
    """Run a sequence whose nodes are processes: they end before this worker does."""
    global _has_nodes
    from eulerparams_control.lab.campaign.ros.realtime import run_realtime

    _has_nodes = True
    try:
        return run_realtime(plan, _stop)
    finally:
        _has_nodes = False
        if _stop.is_set():
            os._exit(1)


def _prepare() -> None:
    """Prepare a worker: a Ctrl-C in the terminal is ours to pass on, and libraries say nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    silence = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silence, stream)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def run_all(todo: Sequence[SequencePlan], jobs: int) -> Iterator[SequenceOutcome]:
    """Yield what came of each sequence, as they end: those in real time last, and few at once."""
    for mode in (LOCKSTEP, REALTIME):
        some = [plan for plan in todo if plan.mode == mode]
        most = jobs if mode == LOCKSTEP else min(jobs, REALTIME_JOBS)
        for few in itertools.batched(some, most * _LIFE):
            yield from _run_some(few, min(most, len(few)))


def _run_some(todo: Sequence[SequencePlan], jobs: int) -> Iterator[SequenceOutcome]:
    """Yield what came of each.

    One that takes its worker with it is run once more, by itself; one of which nothing can be
    said, since the machine starved, twice.
    """
    lost: list[SequencePlan] = []
    starved: list[SequencePlan] = []
    for outcome in _in_pool(todo, jobs, lost):
        if outcome.unjudged and not outcome.violations:
            starved.append(outcome.plan)
        else:
            yield outcome
    for plan in lost:
        yield _by_itself(plan)
    for plan in starved:
        for _ in range(_AGAIN):
            outcome = _by_itself(plan)
            if not outcome.unjudged or outcome.violations:
                break
        yield outcome


def _by_itself(plan: SequencePlan) -> SequenceOutcome:
    """Return what came of a sequence that is run while no other is."""
    dead: list[SequencePlan] = []
    outcomes = list(_in_pool([plan], 1, dead))
    return (
        outcomes[0]
        if outcomes
        else SequenceOutcome(plan, error="its worker died, also when it was run by itself")
    )


def _in_pool(
    todo: Sequence[SequencePlan], jobs: int, lost: list[SequencePlan]
) -> Iterator[SequenceOutcome]:
    """Yield what came of sequences; put those into ``lost`` whose worker died."""
    pool = ProcessPoolExecutor(
        jobs,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_prepare,
    )
    try:
        running: dict[Future[SequenceOutcome], SequencePlan] = {
            pool.submit(run, plan): plan for plan in todo
        }
        while running:
            done, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in done:
                plan = running.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    lost.append(plan)
    finally:
        workers = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.terminate()
