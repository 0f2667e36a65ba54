"""Parameters of the node ``identify_tool``."""

from dataclasses import dataclass
from pathlib import Path

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.tool.identification import GRAVITY, LEAST_POSES
from eulerparams_control.tool.poses import PoseOptions


@dataclass(frozen=True)
class IdentifyToolParameters:
    """Parameters of the node ``identify_tool``."""

    robot_description: str = parameter("", "URDF; empty: from the topic robot_description")
    tip_frame: str = parameter("tool0", "link in which tool_com is given, as for a controller")
    joints: tuple[str, ...] = parameter((), "active joints; empty: all from root to sensor")
    gravity: tuple[float, ...] = parameter(GRAVITY, "in the root link", unit="m/s^2")
    wrench_sign: int = parameter(
        1, "-1 for a sensor that reports what the tool exerts on the environment", bounds=(-1, 1)
    )
    poses: int = parameter(6, "how many are taken", bounds=(LEAST_POSES, 1000))
    min_angle: float = parameter(
        0.35, "between the directions of gravity of two poses", unit="rad", bounds=(0.01, 1.5)
    )
    settle_time: float = parameter(
        0.5, "for which the arm is at rest before", unit="s", bounds=(0.01, 60.0)
    )
    averaging_time: float = parameter(
        1.0, "for which the wrench is averaged then", unit="s", bounds=(0.01, 600.0)
    )
    max_speed: float = parameter(
        0.02, "of the joints of an arm at rest", unit="rad/s", bounds=(1e-4, 1.0)
    )
    max_residual_force: float = parameter(
        0.5, "unexplained in a pose; more is warned of", unit="N", bounds=(0.0, 1e4)
    )
    max_residual_torque: float = parameter(0.05, "the same", unit="Nm", bounds=(0.0, 1e4))
    timeout: float = parameter(600.0, "gives up after; 0: never", unit="s", bounds=(0.0, 1e6))
    output: str = parameter("", "file for the result, must not exist; empty: none")

    def check(self) -> None:
        """Refuse what is impossible before the arm is moved; raises ConfigurationError."""
        if self.wrench_sign == 0:
            raise ConfigurationError("parameter 'wrench_sign' is 0; expected 1 or -1")
        if len(self.gravity) != 3 or not any(self.gravity):
            raise ConfigurationError(
                f"parameter 'gravity' is {list(self.gravity)}; expected 3 numbers, not all 0"
            )
        if self.output:
            _refuse_output(Path(self.output))

    def pose_options(self) -> PoseOptions:
        """Return when a pose is taken."""
        return PoseOptions(self.settle_time, self.averaging_time, self.max_speed, self.min_angle)


def _refuse_output(path: Path) -> None:
    if path.exists():
        raise ConfigurationError(f"output: {path} exists; name another file, or remove it")
    if not path.absolute().parent.is_dir():
        raise ConfigurationError(f"output: there is no folder {path.parent} for {path.name}")
