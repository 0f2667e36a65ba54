"""Parameters of every node that answers in real time."""

from dataclasses import dataclass

from eulerparams_control.parameters.fields import parameter


@dataclass(frozen=True)
class RealTimeParameters:
    """What a node asks of the operating system, see :mod:`eulerparams_control.ros.real_time`."""

    realtime_priority: int = parameter(
        0, "of all threads of the process, by SCHED_FIFO; 0: none", bounds=(0, 99)
    )
    cpu_affinity: tuple[int, ...] = parameter(
        (), "cpus that the process may run on, counted from 0; empty: all", bounds=(0, 1023)
    )
    lock_memory: bool = parameter(False, "keep the memory of the process from being swapped out")
