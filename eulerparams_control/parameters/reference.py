"""Parameters of the node ``reference``."""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.motion.trajectories import Circle, Trajectory
from eulerparams_control.motion.way_points import FORMATS, parse_way_points
from eulerparams_control.parameters.course import Course, parse_course
from eulerparams_control.parameters.fields import parameter

MOTIONS = ("none", "way_points", "circle")


@dataclass(frozen=True)
class ReferenceParameters:
    """Parameters of the node ``reference``."""

    motion: str = parameter("none", "motion to send at the start", choices=MOTIONS)
    robot_description: str = parameter("", "URDF; empty: from the topic robot_description")
    base_frame: str = parameter("", "link that poses refer to; empty: the root link")
    tip_frame: str = parameter("tool0", "link that is controlled")
    joints: tuple[str, ...] = parameter((), "active joints; empty: all from base to tip")
    times: tuple[float, ...] = parameter((), "of the way-points, from the start", unit="s")
    positions: tuple[float, ...] = parameter((), "x, y, z of each way-point in a row", unit="m")
    orientations: tuple[float, ...] = parameter((), "of each way-point in a row")
    orientation_format: str = parameter(
        "quaternion_xyzw", "of orientations; angles of a sequence in rad", choices=FORMATS
    )
    circle_radius: float = parameter(0.05, "of the circle", unit="m", bounds=(0.0, 10.0))
    circle_normal: tuple[float, ...] = parameter((0.0, 0.0, 1.0), "axis of the circle")
    circle_period: float = parameter(4.0, "of one turn", unit="s", bounds=(0.01, 1e6))
    circle_turns: float = parameter(1.0, "how many", bounds=(0.01, 1e6))
    circle_tilt: float = parameter(
        0.0, "half angle of the cone on which the tool turns", unit="rad", bounds=(0.0, math.pi)
    )
    circle_ramp: float = parameter(
        1.0, "to get up to speed; 0 starts at speed", unit="s", bounds=(0.0, 1e6)
    )
    wrench_times: tuple[float, ...] = parameter(
        (), "of the points of target_wrench, from the first state after the motion was sent; it "
        "goes straight from point to point, and stays at the last; none: it is not sent", unit="s",
    )  # fmt: skip
    wrenches: tuple[float, ...] = parameter(
        (), "force and moment ON the environment, tip frame, 6 numbers a point", unit="N, Nm"
    )
    wrench_swing: tuple[float, ...] = parameter(
        (), "6 amplitudes of a sine that is added, up to the last time", unit="N, Nm"
    )
    wrench_frequency: float = parameter(1.0, "of the sine", unit="Hz", bounds=(0.0, 1e3))
    stiffness_times: tuple[float, ...] = parameter(
        (), "of the points of target_stiffness, as wrench_times", unit="s"
    )
    stiffnesses: tuple[float, ...] = parameter(
        (), "diagonals of K_p and K_o, 6 numbers a point", unit="N/m, Nm/rad"
    )
    stiffness_swing: tuple[float, ...] = parameter(
        (), "6 amplitudes of a sine that is added, up to the last time", unit="N/m, Nm/rad"
    )
    stiffness_frequency: float = parameter(1.0, "of the sine", unit="Hz", bounds=(0.0, 1e3))
    stream_rate: float = parameter(
        100.0, "of target_wrench and target_stiffness at most; 0: for each of joint_states",
        unit="Hz", bounds=(0.0, 1e4),
    )  # fmt: skip
    wait_for_subscribers: int = parameter(
        1, "of each topic, before the motion is sent", bounds=(0, 100)
    )
    once: bool = parameter(False, "end when the motion is over, by its own time")

    def refuse_endless(self) -> None:
        """Raise ConfigurationError if what is to be sent once goes on."""
        if self.once and self.motion == "none":
            raise ConfigurationError("once ends the node with its motion, but motion is none")
        if self.once and (streams := " and ".join(self.courses())):
            raise ConfigurationError(
                f"once ends the node with its motion, but {streams} would be streamed on"
            )

    def way_points(self) -> Trajectory:
        """Return the motion through the way-points; raises ConfigurationError."""
        return parse_way_points(
            self.times, self.positions, self.orientations, self.orientation_format
        )

    def courses(self) -> dict[str, Course]:
        """Return what is sent besides the motion, by topic; raises ConfigurationError."""
        told = {
            "target_stiffness": (
                self.stiffness_times,
                self.stiffnesses,
                self.stiffness_swing,
                self.stiffness_frequency,
            ),
            "target_wrench": (
                self.wrench_times,
                self.wrenches,
                self.wrench_swing,
                self.wrench_frequency,
            ),
        }
        return {
            topic: parse_course(topic, *values) for topic, values in told.items() if any(values[:3])
        }

    def circle(self) -> Circle:
        """Return the circle.

        Raises:
            ConfigurationError: if the normal has not three numbers.
        """
        if len(self.circle_normal) != 3:
            raise ConfigurationError(
                f"circle_normal has {len(self.circle_normal)} numbers; expected 3"
            )
        return Circle(
            self.circle_radius,
            np.array(self.circle_normal),
            self.circle_period,
            self.circle_turns,
            self.circle_tilt,
            self.circle_ramp,
        )
