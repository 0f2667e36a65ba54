"""Admission of references: none that leaps, none that leads out of reach."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import InvalidMessageError, SingularityError
from eulerparams_control.motion.frames import DesiredFrame, distance
from eulerparams_control.motion.references import Goal, Jog, SetPoint
from eulerparams_control.motion.trajectories import Trajectory
from eulerparams_control.robot.robot import Reach

# How far ahead [s] a reference may start: further, the two clocks are not the same.
_MAX_AHEAD = 3600.0

# A stretched arm is measured, and sent, this much [m] beyond its reach.
_ROOM = 0.01


@dataclass(frozen=True)
class References:
    """Refuses references that must not be followed.

    Attributes:
        max_jump_position: [m] by which a reference may be away from the desired frame.
        max_jump_rotation: [rad] the same for the rotation.
        reach: of the arm.
    """

    max_jump_position: float
    max_jump_rotation: float
    reach: Reach

    def refuse_target(self, target: Goal | Jog, here: DesiredFrame) -> None:
        """Raise InvalidMessageError for a target that is not finite, or out of reach.

        Args:
            target: that comes.
            here: the present desired frame.
        """
        if isinstance(target, Jog):
            values = target.twist
        else:
            values = np.append(target.frames[0].p_d, target.frames[0].R_d)
        if not np.isfinite(values).all():
            raise InvalidMessageError(f"the target is {values.tolist()}; expected finite values")
        if isinstance(target, Goal):
            self._refuse_unreachable(target.frames, here)

    def _refuse_unreachable(self, frames: Iterable[DesiredFrame], here: DesiredFrame) -> None:
        """Raise InvalidMessageError if one of these frames is where the arm never gets.

        What is no farther out than the present desired frame leads back.
        """
        reach = self.reach
        most = max(reach.radius, reach.distance(here.p_d)) + _ROOM
        for frame in frames:
            if not (way := reach.distance(frame.p_d)) <= most:
                raise InvalidMessageError(
                    f"the position {frame.p_d.round(3).tolist()} is out of reach: it is {way:.3f} "
                    "m from the first joint of the arm, whose links are "
                    f"{reach.radius:.3f} m long; expected metres, in the base frame"
                )

    def jumps(self, here: DesiredFrame, there: DesiredFrame) -> bool:
        """Return whether a frame is farther from another than a reference may jump."""
        way, angle = distance(here, there)
        return not (way <= self.max_jump_position and angle <= self.max_jump_rotation)

    def refuse_jump(self, motion: Trajectory | SetPoint, late: float, here: DesiredFrame) -> None:
        """Raise InvalidMessageError if a motion leads too far away, at once or at all.

        Args:
            motion: that comes.
            late: for how long [s] it has been going on.
            here: the present desired frame.
        """
        if late < -_MAX_AHEAD:
            raise InvalidMessageError(
                f"the reference starts {-late:.0f} s after joint_states; are their clocks the same?"
            )
        points = motion.to_come(late) if isinstance(motion, Trajectory) else motion.frames
        self._refuse_unreachable(points, here)
        try:
            there = _farthest(motion, here, max(0.0, late))
        except SingularityError as error:
            raise InvalidMessageError(f"the reference is no motion: {error}") from error
        if isinstance(motion, SetPoint):
            self._refuse_leap(motion)
        if self.jumps(here, there):
            way, angle = distance(here, there)
            raise InvalidMessageError(
                f"the reference begins {way:.3f} m and {math.degrees(angle):.1f} deg away "
                f"from the present desired frame; at most {self.max_jump_position} m and "
                f"{math.degrees(self.max_jump_rotation):.1f} deg are followed at once: give its "
                "first point a time_from_start > 0, or raise max_jump_position and "
                "max_jump_rotation"
            )

    def _refuse_leap(self, motion: SetPoint) -> None:
        """Raise InvalidMessageError if the twist of a set-point leads farther than it may jump."""
        frame, T = motion.frames[0], motion.lasting
        leads = [
            float(np.linalg.norm(v)) * T + float(np.linalg.norm(a)) * T**2 / 2
            for v, a in ((frame.dp_d, frame.ddp_d), (frame.omega_d, frame.domega_d))
        ]
        most = self.max_jump_position, self.max_jump_rotation
        if not (leads[0] <= most[0] and leads[1] <= most[1]):
            raise InvalidMessageError(
                f"the twist of the set-point leads {leads[0]:.3g} m and {leads[1]:.3g} rad away "
                f"within {T:g} s; at most {most[0]:g} m and {most[1]:g} rad (max_jump_position, "
                "max_jump_rotation) are followed without the next one"
            )


def _farthest(motion: Trajectory | SetPoint, here: DesiredFrame, late: float) -> DesiredFrame:
    """Return the frame of a motion that it may jump to: of a set-point, where its twist ends."""
    if isinstance(motion, Trajectory):
        return motion.beginning(here, late)
    return motion.sample(math.inf)
