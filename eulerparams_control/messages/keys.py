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


MODE = "mode"  # what the node does: a value of the enumeration of its modes
CAUSE = "cause"  # why, if it is not what it was asked for: a value of an enumeration, or ""
SINCE = "since"  # [s] of the clock of the node
REMEDY = "remedy"  # what is to be done about it; "" if nothing
BEGAN = "reference began at [ns]"  # the stamp at which a controller began to follow a trajectory
PACE = "pace"  # how fast the time of the desired motion runs: 1 is as asked
SLOWED = "slowed trajectory"  # least pace of a trajectory, which limits of the tip slow; else 1
SATURATED = "saturated ticks"  # how many commands limits have changed since activation
WRENCH_FRAME = "wrench frame"  # in whose axes and about whose origin the wrench is, and why
UNHEARD = "publishers not heard"  # whose QoS does not match, and what mends it; no key if none
FROZEN = "frozen"  # 1 while the desired motion waits for an input that it needs; else 0

# Names on ``~/impedance``: M, D, K of (52), then of (59); all; those without a compliant frame.
IMPEDANCE = tuple(
    f"{matrix}_{part}.{element}"
    for part in "po"
    for matrix in "MDK"
    for element in ("xx", "xy", "xz", "yy", "yz", "zz")
)
ACTING = (*IMPEDANCE, "error_clip_position", "error_clip_rotation")
SPRINGS = tuple(name for name in ACTING if name.startswith(("K", "error")))
