"""The shaped motion: ``~/desired`` against the references."""

from dataclasses import dataclass, field

import numpy as np

from eulerparams_control.analysis.frames import Frames
from eulerparams_control.laws.rotations import Array, angle_between

# A motion that is nowhere farther [m], [rad] from what was asked, nor slower, is as it was asked.
_NEAR, _ALIGNED, _AS_ASKED = 1e-3, float(np.radians(0.1)), 0.995


@dataclass(frozen=True)
class ShapedMotion:
    """What was asked, and what was made of it.

    Attributes:
        t: (N,) [s] from the beginning of the recording.
        asked: the N desired frames by the references; NaN where there is none.
        made: the N frames of ``~/desired``.
        rates: (K, 4) what the controller said: time [s], rate of time, slowest rate of the
            trajectory, saturated ticks.
    """

    t: Array
    asked: Frames = field(repr=False)
    made: Frames = field(repr=False)
    rates: Array = field(repr=False)


@dataclass
class Departure:
    """How far what was made of the references is from what was asked, so far.

    Attributes:
        distance, angle: largest ones [m], [rad].
        slowest: rate of time.
    """

    distance: float = 0.0
    angle: float = 0.0
    slowest: float = 1.0

    def take(self, motion: ShapedMotion) -> None:
        """Take a part of a run."""
        with np.errstate(over="ignore", invalid="ignore"):  # what was asked may be non-finite
            away = np.linalg.norm(motion.asked.p - motion.made.p, axis=1)
            angles = angle_between(motion.asked.R, motion.made.R)
        self.distance = float(np.nanmax(away, initial=self.distance))
        self.angle = float(np.nanmax(angles, initial=self.angle))
        self.slowest = float(motion.rates[:, 1:3].min(initial=self.slowest))

    @property
    def words(self) -> str:
        """What it is, for people; "" if the motion is as it was asked."""
        found = {
            f"by {1e3 * self.distance:.3g} mm at most": self.distance > _NEAR,
            f"by {np.degrees(self.angle):.3g} deg at most": self.angle > _ALIGNED,
            f"with time at {100 * self.slowest:.3g} % at the slowest": self.slowest < _AS_ASKED,
        }
        words = ", ".join(text for text, differs in found.items() if differs)
        if self.distance or self.angle:  # else nothing is known of what was asked
            words += ": errors here are those against what was asked" * bool(words)
        return f"the motion was made to differ from what was asked, {words}" * bool(words)
