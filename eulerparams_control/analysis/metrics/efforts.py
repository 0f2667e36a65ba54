"""Commanded efforts, from joint_effort."""

import math

import numpy as np

from eulerparams_control.analysis.metrics.base import metric, within
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.series import Efforts
from eulerparams_control.errors import BagError

_ROUNDING = 1e-9  # relative: an effort that was cut to a limit may be this far below it


def _effort(recording: Recording) -> Efforts:
    if recording.effort is None:
        raise BagError(f"{recording.path} has no joint_effort")
    return recording.effort


@metric("Nm")
def peak_effort(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Largest commanded effort of a joint."""
    effort = _effort(recording)
    return float(effort.largest[within(effort.t, after, before)].max())


@metric("s")
def saturated_time(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Time with a commanded effort at its limit.

    The limits are those of the URDF.  A command counts until the next one.
    """
    effort = _effort(recording)
    at_limit = np.abs(effort.tau) >= (1 - _ROUNDING) * recording.robot.limits.effort
    lasting = np.diff(effort.t, append=effort.t[-1])
    return float(lasting[at_limit.any(axis=1) & within(effort.t, after, before)].sum())
