"""Simple shapes that can touch each other, as a URDF states them."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from eulerparams_control.errors import ConfigurationError

SIZES = {
    "sphere": ("radius",),
    "box": ("x", "y", "z"),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
"""What the numbers of each shape are, m; lengths along z, of a capsule without its caps."""


def check_size(name: str, shape: str, size: Sequence[float]) -> None:
    """Raise ConfigurationError unless ``size`` has the numbers of ``shape``, all positive."""
    wanted = SIZES[shape]
    if len(size) != len(wanted) or not all(0.0 < number < math.inf for number in size):
        raise ConfigurationError(
            f"{name} is {list(size)}; expected {', '.join(wanted)} of a {shape}, above 0 [m]"
        )


def geometry(shape: str, size: Sequence[float]) -> ET.Element:
    """Return the ``<geometry>`` of a shape."""
    element = ET.Element("geometry")
    if shape == "box":
        ET.SubElement(element, "box", size=" ".join(map(repr, map(float, size))))
    else:
        values = (repr(float(value)) for value in size)
        ET.SubElement(element, shape, dict(zip(SIZES[shape], values, strict=True)))
    return element
