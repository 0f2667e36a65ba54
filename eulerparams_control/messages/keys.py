"""Keys of what nodes say of themselves, on /diagnostics and latched on ``~/status``."""

from enum import StrEnum


class Lifecycle(StrEnum):
    """The mode of a node that does not control yet, or no more."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    FINALIZED = "finalized"


class WorkMode(StrEnum):
    """The mode of a node that does a piece of work."""

    WAITING = "waiting"  # for what it needs
    READY = "ready"
    WORKING = "working"
    DONE = "done"


class LifecycleCause(StrEnum):
    """Why a node stays in such a mode."""

    NO_DESCRIPTION = "no_description"  # of the robot
    NO_STATES = "no_states"  # no valid joint_states
    REFUSED = "refused"  # a parameter, a state or a wrench is in the way
    TRANSITION_ERROR = "transition_error"
    DEFECT = "defect"


MODE = "mode"
"""What the node does: a value of the enumeration of its modes."""

CAUSE = "cause"
"""Why it does that, if it is not what it was asked for; a value of an enumeration, or ""."""

SINCE = "since"
"""Since when it does: [s] of the clock of the node."""

REMEDY = "remedy"
"""What is to be done about it; "" if nothing."""

BEGAN = "reference began at [ns]"
"""The stamp at which a controller began to follow a trajectory."""

PACE = "pace"
"""How fast the time of the desired motion runs: 1 is as asked."""

SLOWED = "slowed trajectory"
"""The slowest rate of the time of a trajectory that is slowed for the limits of the tip; else 1."""

SATURATED = "saturated ticks"
"""How many commands limits have changed since activation."""

WRENCH_FRAME = "wrench frame"
"""In whose axes and about whose origin the wrench is taken to be, and why."""

UNHEARD = "publishers not heard"
"""Who publishes an input with a QoS that does not match, and what mends it; no key if none."""

FROZEN = "frozen"
"""1 while the desired motion waits, because what it needs is not known; else 0."""

IMPEDANCE = tuple(
    f"{matrix}_{part}.{element}"
    for part in "po"
    for matrix in "MDK"
    for element in ("xx", "xy", "xz", "yy", "yz", "zz")
)
"""Names of the numbers on ``~/impedance``: M, D, K of (52), then of (59)."""

ACTING = (*IMPEDANCE, "error_clip_position", "error_clip_rotation")
"""All that ``~/impedance`` may have."""

SPRINGS = tuple(name for name in ACTING if name.startswith(("K", "error")))
"""Names of the numbers on ``~/impedance`` of springs without a compliant frame."""
