"""Shared by the launch files of real arms."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def arm_launch(file: str, usual: Mapping[str, str], only: Mapping[str, Sequence[str]]) -> Any:
    """Return the LaunchDescription of bringup for an arm.

    Args:
        file: the launch file of the arm, beside which that of bringup is.
        usual: its arguments, where no others are given.
        only: arguments and the only values that it accepts; the first is its default.
    """
    from launch import LaunchDescription  # of ROS 2: who launches has it
    from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription

    path = str(Path(file).with_name("bringup.launch.py"))
    declared = [DeclareLaunchArgument(name, default_value=of) for name, of in usual.items()]
    for name, values in only.items():
        declared.append(DeclareLaunchArgument(name, default_value=values[0], choices=values))
    return LaunchDescription([*declared, IncludeLaunchDescription(path)])
