"""The XML of a URDF, from whoever sent it: parsed without entities, files or endless nesting."""

import math
import xml.etree.ElementTree as ET
from typing import NoReturn

from eulerparams_control.errors import RobotError

LARGEST = 1e9
"""No length, mass or inertia of an arm is larger; what is would overflow sooner or later."""

_LONGEST = 64_000_000  # characters
_DEEPEST = 50  # elements within elements; robots have seven


class _Builder(ET.TreeBuilder):
    """Builds the tree; refuses what a URDF does not need and a hostile one has."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def doctype(self, *_: object) -> NoReturn:
        """Refuse a DOCTYPE: only by it come entities, which grow without bound or name files."""
        raise RobotError("not a URDF: it has a DOCTYPE; remove it")

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """Begin an element."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise RobotError(f"not a URDF: more than {_DEEPEST} elements within each other")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)


def parse(text: str) -> ET.Element:
    """Return the ``<robot>`` of an XML text.

    Raises:
        RobotError: if it is not XML, not a URDF, longer or deeper than a URDF is, or has a DOCTYPE.
    """
    if len(text) > _LONGEST:
        raise RobotError(f"the URDF has {len(text)} characters; expected at most {_LONGEST}")
    try:
        root = ET.fromstring(text, parser=ET.XMLParser(target=_Builder()))
    except (ET.ParseError, ValueError) as error:  # the latter for text that no file can have
        raise RobotError(f"not valid XML: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"not a URDF: the root element is <{root.tag}>, expected <robot>")
    return root


def attribute(element: ET.Element, name: str) -> str:
    """Return an attribute.

    Raises:
        RobotError: if there is none of this name.
    """
    value = element.get(name)
    if value is None:
        raise RobotError(f"a <{element.tag}> has no attribute '{name}'")
    return value


def number(text: str) -> float:
    """Return a number as URDF has it; Python's ``1_0`` or digits of other scripts are none.

    Raises:
        ValueError: if it is none.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def numbers(element: ET.Element, name: str, default: str) -> list[float]:
    """Return the three numbers of an attribute, each finite and at most ``LARGEST``.

    Raises:
        RobotError: if they are not.
    """
    text = element.get(name, default)
    try:
        values = [number(word) for word in text.split()]
    except ValueError as error:
        raise RobotError(f"{name} of a <{element.tag}>: {error}") from error
    if len(values) != 3 or not all(map(is_plausible, values)):
        raise RobotError(
            f"{name} of a <{element.tag}> is '{text}'; expected three numbers up to {LARGEST:g}"
        )
    return values


def is_plausible(value: float) -> bool:
    """Return whether a value is finite and not larger than ``LARGEST``."""
    return math.isfinite(value) and abs(value) <= LARGEST
