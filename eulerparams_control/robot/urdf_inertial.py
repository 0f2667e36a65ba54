"""The mass that a URDF states for a link, checked.

Pinocchio leaves out an ``<inertial>`` that it cannot read and goes on with a massless link, so
that the arm would be held with too little effort, and PyBullet takes it for another one.
"""

import xml.etree.ElementTree as ET

from eulerparams_control.errors import RobotError
from eulerparams_control.robot.urdf_xml import attribute, is_plausible, number, numbers

_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# Entries of bodies that are points have a rounded zero on their diagonal [kg m^2].
_ROUNDING = 1e-9


def check_inertial(link: ET.Element) -> None:
    """Check the ``<inertial>`` of a link; a link without one has no mass.

    Raises:
        RobotError: if mass or inertia is not stated, is no finite number, or is negative.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return
    try:
        _check_origin(inertial)
        mass = _value(inertial, "mass", "value")
        entries = {name: _value(inertial, "inertia", name) for name in _ENTRIES}
    except (ValueError, RobotError) as error:
        raise RobotError(f"inertial of link '{link.get('name')}': {error}") from error
    negative = {name: entries[name] for name in ("ixx", "iyy", "izz") if entries[name] < -_ROUNDING}
    if mass < 0 or negative:
        raise RobotError(
            f"inertial of link '{link.get('name')}': mass {mass:g} kg, negative moments "
            f"{negative or 'none'}; expected 0 or more"
        )


def _check_origin(inertial: ET.Element) -> None:
    origin = inertial.find("origin")
    if origin is not None:
        numbers(origin, "xyz", "0 0 0")
        numbers(origin, "rpy", "0 0 0")


def _value(inertial: ET.Element, part: str, name: str) -> float:
    element = inertial.find(part)
    if element is None:
        raise RobotError(f"a <{inertial.tag}> has no <{part}>")
    value = number(attribute(element, name))
    if not is_plausible(value):
        raise RobotError(f"{name} of <{part}> is {value:g}; expected a finite number")
    return value
