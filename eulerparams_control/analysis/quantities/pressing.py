"""Pressing: the force that the tool exerts along force_axes, against its target_wrench.

Components are along the axes of the compliance.  Options as in ``contact``.
"""

import math

import numpy as np

from eulerparams_control.analysis.compliant import PressedForce
from eulerparams_control.analysis.quantities.base import (
    Samples,
    drawn,
    known,
    metric,
    reduced,
    row,
)
from eulerparams_control.analysis.quantities.contact import lengths
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import BagError
from eulerparams_control.laws.rotations import Array

_TOUCH = 1e-6  # [N] of a contact


def _pressed(recording: Recording) -> PressedForce:
    if recording.pressed is None:
        raise BagError(f"{recording.path} has no target_wrench, or no wrench")
    return recording.pressed


@reduced("force_error", "N", "difference of the force from its target", "peak", "rms", "final",
         vectors=True)  # fmt: skip
def force_error(recording: Recording) -> Samples:
    """Return f_d - f (N, 3) [N] along force_axes."""
    pressed = _pressed(recording)
    return pressed.t, pressed.f_d - pressed.f


@metric("s")
def force_settling_time(
    recording: Recording, within: float = 0.01, after: float = 0.0, before: float = math.inf
) -> float:
    """Time from the first contact until the force stays within a part of its target.

    Infinite if there is no contact, or the force does not stay there.
    """
    t, f, f_d = _known(recording, after, before)
    touches = np.linalg.norm(f, axis=1) > _TOUCH
    off = np.linalg.norm(f_d - f, axis=1) > within * np.linalg.norm(f_d, axis=1)
    if not touches.any() or off[-1]:
        return math.inf
    first = int(np.argmax(touches))
    away = np.flatnonzero(off)
    return float(t[max(away[-1] + 1, first) if len(away) else first] - t[first])


@metric("%")
def force_overshoot(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Largest force along its target beyond that, as a part of it."""
    _, f, f_d = _known(recording, after, before)
    size = np.linalg.norm(f_d, axis=1)
    if not size.all():
        raise BagError(f"{recording.path}: the target_wrench is 0")
    return 100.0 * float(((f * f_d).sum(axis=1) / size**2).max() - 1.0)


def _known(recording: Recording, after: float, before: float) -> tuple[Array, Array, Array]:
    pressed = _pressed(recording)
    t, both = known(pressed.t, np.hstack([pressed.f, pressed.f_d]), after, before)
    return t, both[:, :3], both[:, 3:]


drawn(
    3.5,
    "Force error",
    "|f_d - f| [N]",
    "Difference between target_wrench and the force of the tool on the environment along "
    "force_axes: what the parallel force control (FC1) makes 0.",
    "N",
    1e-6,
    name="force_error",
)(lengths(force_error))
row(14, "force error, peak", "peak_force_error", "pressed")
row(15, "force error, end", "final_force_error", "pressed")
