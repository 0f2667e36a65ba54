"""Poses at rest, taken as an arm is moved by others from one to the next.

Whenever the arm is at rest with gravity in a new direction, as the sensor sees it, the
wrench is averaged for some time.  If the arm moves meanwhile, what was measured is dropped.

Time is that of the stamps of joint_states [ns].
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.rotations import Array

_GAP = 0.5  # [s] without joint_states: what the arm did meanwhile is not known
_LEAST_SAMPLES = 10  # of the wrench, for an average


@dataclass(frozen=True)
class PoseOptions:
    """When a pose is taken.

    Attributes:
        settle_time: [s] for which the arm has to be at rest before.
        averaging_time: [s] for which it stays at rest then, while the wrench is averaged.
        max_speed: [rad/s or m/s] of the joints of an arm at rest.
        min_angle: [rad] between the directions of gravity of any two poses.
    """

    settle_time: float = 0.5
    averaging_time: float = 1.0
    max_speed: float = 0.02
    min_angle: float = math.radians(20.0)


class Pose(NamedTuple):
    """What was measured in one pose.

    Attributes:
        R_s: (3, 3) orientation of the sensor frame, root axes.
        wrench: (6,) [N, Nm] its average.
        wrench_std: (6,) [N, Nm] standard deviation of the average, of white noise.
        samples: how many wrenches were averaged.
    """

    R_s: Array
    wrench: Array
    wrench_std: Array
    samples: int


class Standstill:
    """Tells since when the arm is at rest.

    No joint may go faster than ``max_speed``, as measured where velocities are, and by the
    differences of its positions over ``settle_time`` in any case.
    """

    def __init__(self, max_speed: float, settle_time: float) -> None:
        self._max_speed = max_speed
        self._range = max_speed * settle_time  # [rad or m] around where it came to rest
        self._last: int | None = None
        self.since = 0
        self._q = np.zeros(0)

    def update(self, t: int, q: Array, dq: Array) -> bool:
        """Take the state q, dq (n,) stamped t [ns]; return whether the arm moves."""
        gap = self._last is None or not 0 <= t - self._last <= _GAP * 1e9
        self._last = t
        fast = bool((np.abs(dq) > self._max_speed).any())
        if gap or fast or bool((np.abs(q - self._q) > self._range).any()):
            self.since, self._q = t, q
            return True
        return False


class PoseCollector:
    """Takes the poses.

    Args:
        options: when a pose is taken.
        orientation: of the sensor, R_s (3, 3) in root axes for q (n,).
        gravity: (3,) [m/s^2] in root axes.

    Attributes:
        poses: those taken so far.
        doing: what it waits for, in words.
    """

    def __init__(
        self, options: PoseOptions, orientation: Callable[[Array], Array], gravity: Array
    ) -> None:
        self.poses: list[Pose] = []
        self.doing = "waiting until the arm is at rest"
        self._options, self._orientation = options, orientation
        self._down = gravity / np.linalg.norm(gravity)
        self._standstill = Standstill(options.max_speed, options.settle_time)
        self._opened: int | None = None  # when the averaging began [ns]
        self._finished = False  # nothing more is to be had from this standstill
        self._positions: list[Array] = []
        self._wrenches: list[Array] = []
        self._last_wrench = 0

    @property
    def directions(self) -> Array:
        """Directions (N, 3) of gravity in the sensor frame, in the poses taken."""
        return np.array([pose.R_s.T @ self._down for pose in self.poses]).reshape(-1, 3)

    def move(self, t: int, q: Array, dq: Array) -> Pose | str:
        """Take the state of the arm q, dq (n,) stamped t [ns].

        Returns:
            a pose that has just been taken; or why one that was begun, or might have been
            expected, was not, said once in each standstill; "" if there is nothing to say.
        """
        if self._standstill.update(t, q, dq):
            dropped = "the arm moved too early, the pose was dropped: let it rest"
            said = dropped if self._opened is not None else ""
            self._opened, self._finished = None, False
            self.doing = "waiting until the arm is at rest"
            return said
        if self._finished:
            return ""
        if self._opened is not None:
            return self._average(t, q)
        if t - self._standstill.since >= self._options.settle_time * 1e9:
            return self._begin(t, q)
        return ""

    def feel(self, t: int, wrench: Array) -> None:
        """Take a wrench (6,) [N, Nm] in the sensor frame, stamped t [ns], 0 for no stamp.

        Raises:
            InvalidMessageError: if it was measured before the arm came to rest, or is the last
                one again.
        """
        if self._opened is None:
            return
        if t and t == self._last_wrench:
            raise InvalidMessageError("the wrench comes again under the same stamp; it is stale")
        if t and t < self._standstill.since:
            raise InvalidMessageError(
                f"the wrench is stale: its stamp is {(self._opened - t) / 1e9:.3g} s behind "
                "joint_states, before the arm came to rest; are their clocks the same?"
            )
        self._last_wrench = t
        self._wrenches.append(wrench)

    def _begin(self, t: int, q: Array) -> str:
        """Begin to average, if gravity is in a new direction; return why not."""
        angle, nearest = self._nearest(self._orientation(q).T @ self._down)
        if angle >= self._options.min_angle:
            self._open(t)
            return ""
        self._finished = True
        self.doing = "waiting for another orientation"
        return (
            f"no new pose: the sensor sees gravity {math.degrees(angle):.0f} deg from where it was "
            f"in pose {nearest}; expected {math.degrees(self._options.min_angle):.0f} deg at "
            "least: tilt it further (turns about the vertical do not count)"
        )

    def _nearest(self, direction: Array) -> tuple[float, int]:
        """Return angle [rad] and number of the pose with gravity nearest to a direction (3,)."""
        angles = np.arccos(np.clip(self.directions @ direction, -1.0, 1.0))
        nearest = int(np.argmin([*angles, math.inf]))
        return float([*angles, math.inf][nearest]), nearest + 1

    def _open(self, t: int) -> None:
        self._opened, self._positions, self._wrenches = t, [], []
        self.doing = "averaging, keep the arm still"

    def _average(self, t: int, q: Array) -> Pose | str:
        """Return the pose, when it has been averaged for long enough."""
        assert self._opened is not None
        self._positions.append(q)
        if t - self._opened < self._options.averaging_time * 1e9:
            return ""
        if len(self._wrenches) < _LEAST_SAMPLES:
            found = len(self._wrenches)
            self._open(t)
            return (
                f"{found} wrenches within {self._options.averaging_time:g} s; expected "
                f"{_LEAST_SAMPLES} at least: does the sensor run? Else raise averaging_time"
            )
        self.poses.append(self._pose())
        self._opened, self._finished = None, True
        self.doing = "waiting for another orientation"
        return self.poses[-1]

    def _pose(self) -> Pose:
        """Return what was averaged."""
        R_s = self._orientation(np.mean(self._positions, axis=0))
        h = np.array(self._wrenches)
        return Pose(R_s, h.mean(axis=0), h.std(axis=0, ddof=1) / math.sqrt(len(h)), len(h))
