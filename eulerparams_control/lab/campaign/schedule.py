"""Sequences side by side: each worker is a process with a ROS domain of its own."""

import functools
import itertools
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, as_completed

from eulerparams_control.errors import text_of
from eulerparams_control.lab.campaign.plan import CONTROLLERS, FAULTY, SequencePlan, make_plan
from eulerparams_control.lab.campaign.report import SequenceOutcome, look
from eulerparams_control.lab.run.domains import Domain
from eulerparams_control.lab.run.jobs import processes

_LIFE = 30  # sequences of a worker, on average: what they leave behind goes with it


def plans(
    count: int, seed: int, controllers: Sequence[str] = CONTROLLERS, kind: str = FAULTY
) -> list[SequencePlan]:
    """Return ``count`` sequences, controller after controller, seed after seed."""
    n = len(controllers)
    return [make_plan(seed + k // n, controllers[k % n], kind) for k in range(count)]


@functools.cache
def _domain() -> Domain:
    """Return the domain of this worker."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    return Domain()


def run(plan: SequencePlan) -> SequenceOutcome:
    """Run a sequence in this process; one that fails has an outcome, too."""
    from eulerparams_control.lab.campaign.ros.lockstep import run_lockstep

    started = time.monotonic()
    try:
        record = run_lockstep(plan, _domain().number)
        return look(plan, record, time.monotonic() - started)
    except Exception as error:  # of any kind: the others go on
        return SequenceOutcome(plan, error=text_of(error), seconds=time.monotonic() - started)


def run_all(todo: Sequence[SequencePlan], jobs: int) -> Iterator[SequenceOutcome]:
    """Yield the outcome of each sequence, as they end."""
    for few in itertools.batched(todo, jobs * _LIFE):
        with processes(min(jobs, len(few))) as pool:
            plan_of = {pool.submit(run, plan): plan for plan in few}
            for future in as_completed(plan_of):
                plan = plan_of[future]
                try:
                    yield future.result()
                except BrokenExecutor:
                    yield SequenceOutcome(plan, error="a worker died")
                except Exception as error:  # say, an outcome that cannot be pickled
                    yield SequenceOutcome(plan, error=text_of(error))
