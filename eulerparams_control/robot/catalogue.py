"""The robots: a URDF, its frames, its joints and a home, from a name or a file.

``config/robots/NAME.yaml`` adds a robot; such a file elsewhere is named by its path.  A path to a
URDF works without one: the frames then are the root link and the last link of the longest chain.
"""

import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from eulerparams_control.errors import ConfigurationError, RobotError, UnknownNameError
from eulerparams_control.resources import config_file
from eulerparams_control.robot.urdf import UrdfTree, joint_limits, read_urdf, refuse_motionless

_OF_JOINTS = ("rotor_inertia", "friction_viscous", "friction_coulomb")
_KEYS = (
    *("description", "urdf", "base_frame", "tip_frame", "sensor_frame", "joints", "home"),
    *_OF_JOINTS,
)


@dataclass(frozen=True)
class RobotDescription:
    """A serial arm.

    Attributes:
        name: of the catalogue, or of the URDF.
        urdf_path, urdf: the file, and its text.
        base_frame: the link that poses refer to.
        tip_frame: the link that is controlled.
        sensor_frame: the link in which, and about whose origin, the wrench is measured.
        joints, home: the n active joints, base to tip, and their start values [rad or m].
        rotor_inertia: (n,) [kg m^2] of the motors, at the joints; () if none is known.
        friction_viscous, friction_coulomb: (n,) [Nm s/rad], [Nm]; () is that of the URDF.
    """

    name: str
    urdf_path: Path
    urdf: str
    base_frame: str
    tip_frame: str
    sensor_frame: str
    joints: tuple[str, ...]
    home: tuple[float, ...]
    rotor_inertia: tuple[float, ...] = ()
    friction_viscous: tuple[float, ...] = ()
    friction_coulomb: tuple[float, ...] = ()


def load_robot(name_or_path: str) -> RobotDescription:
    """Return the robot of ``config/robots/<name>.yaml``, or of a path to such a file or a URDF.

    Raises UnknownNameError, which lists the robots, ConfigurationError for a broken YAML file, or
    RobotError for a broken URDF, or one that lacks a frame or a joint.
    """
    path = Path(name_or_path)
    if path.suffix in (".urdf", ".xacro", ".xml"):
        return _describe(path.stem, path, {})
    file = path if path.suffix == ".yaml" else config_file("robots", name_or_path)
    entry = _read_entry(file)
    return _describe(file.stem, find_urdf(str(entry["urdf"]), file.parent), entry)


def _read_entry(path: Path) -> dict[str, Any]:
    try:
        entry = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    if not isinstance(entry, dict) or "urdf" not in entry:
        raise ConfigurationError(f"{path}: expected the keys {', '.join(_KEYS)}; urdf is missing")
    for key in entry:
        if key not in _KEYS:
            raise ConfigurationError(f"{path}: {UnknownNameError('key', str(key), _KEYS)}")
    return entry


def find_urdf(urdf: str, folder: Path) -> Path:
    """Return the file of ``PACKAGE:PATH``, or of a path relative to ``folder``."""
    package, separator, path = urdf.partition(":")
    if not separator:
        return folder / Path(urdf).expanduser()
    if package == "pybullet_data":
        import pybullet_data  # type: ignore[import-untyped]

        roots = [Path(pybullet_data.getDataPath())]
    else:
        shares = [share / package for share in share_folders()]
        roots = [root for share in shares for root in (share / "robots", share) if share.is_dir()]
    for root in roots:
        if (root / path).is_file():
            return root / path
    raise RobotError(
        f"'{path}' of the package '{package}' was not found; is it installed? looked in: "
        + ", ".join(map(str, roots))
    )


def share_folders() -> list[Path]:
    """Return the folders of the packages of ROS and of Python that may have URDFs or meshes."""
    prefixes = [Path(entry) / "cmeel.prefix" for entry in sys.path if entry]
    listed = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    prefixes += [Path(entry) for entry in listed if entry]
    shares = [prefix / "share" for prefix in dict.fromkeys([*prefixes, Path(sys.prefix)])]
    return [share for share in shares if share.is_dir()]


def _describe(name: str, path: Path, entry: Mapping[str, Any]) -> RobotDescription:
    try:
        text = read_urdf(path)
        tree = UrdfTree(text)
        base = tree.link(str(entry.get("base_frame", tree.root)), "base_frame")
        longest = max(tree.links, key=lambda link: len(tree.chain(tree.root, link)))
        tip = tree.link(str(entry.get("tip_frame") or longest), "tip_frame")
        joints = _joints(tree, base, tip, entry.get("joints", []))
        return RobotDescription(
            name=name,
            urdf_path=path.resolve(),
            urdf=text,
            base_frame=base,
            tip_frame=tip,
            sensor_frame=tree.link(str(entry.get("sensor_frame", tip)), "sensor_frame"),
            joints=joints,
            home=_home(tree, joints, entry.get("home")),
            **{key: _of_joints(key, entry[key], joints) for key in _OF_JOINTS if key in entry},
        )
    except OSError as error:
        raise RobotError(f"robot '{name}': the URDF cannot be read: {error}") from error
    except RobotError as error:
        raise RobotError(f"robot '{name}' ({path}): {error}") from error


def _joints(tree: UrdfTree, base: str, tip: str, names: Any) -> tuple[str, ...]:
    if not isinstance(names, list):
        raise RobotError(f"joints must be a list of names, got {names!r}")
    joints = tree.moving(base, tip, names)
    if not joints or (names and names != list(joints)):
        moving = ", ".join(tree.moving(base, tip))
        raise RobotError(f"joints must be some of {moving}, from base to tip")
    for joint in joints:
        refuse_motionless(tree.joints[joint])
    return joints


def _home(tree: UrdfTree, joints: tuple[str, ...], home: Any) -> tuple[float, ...]:
    """Return a home, 0 or the limit next to it where there is none."""
    limits = [joint_limits(tree.joints[joint])[:2] for joint in joints]
    if home is None:
        return tuple(min(max(0.0, lower), upper) for lower, upper in limits)
    if not isinstance(home, list) or len(home) != len(joints):
        raise RobotError(f"home is {home}; expected {len(joints)} numbers")
    for joint, value, (lower, upper) in zip(joints, home, limits, strict=True):
        if not isinstance(value, int | float) or not lower <= value <= upper:
            raise RobotError(f"home of joint '{joint}', {value}, is outside {lower} ... {upper}")
    return tuple(map(float, home))


def _of_joints(key: str, given: Any, joints: tuple[str, ...]) -> tuple[float, ...]:
    """Return one number for each joint, where one, or one for all, is given."""
    values = given if isinstance(given, list) else [given] * len(joints)
    numbers = [value for value in values if isinstance(value, int | float) and value >= 0.0]
    if not len(values) == len(numbers) == len(joints) or not all(map(math.isfinite, numbers)):
        raise RobotError(f"{key} is {given}; expected one number, or {len(joints)}, 0 or more")
    return tuple(map(float, numbers))
