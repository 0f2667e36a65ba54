"""The text of a robot description: from what anyone may send to the ``<robot>`` of a URDF.

It is read as the parser of ROS reads it: name spaces do not matter, extensions of other programs
are elements like others, and an XML declaration may come after a blank line.  But no entity is
expanded, no file is read, and nesting has an end.  What is no URDF is called by its name.
"""

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from eulerparams_control.errors import RobotError

_LONGEST_TEXT = 64_000_000  # characters
_DEEPEST = 50  # elements within elements; robots have seven
_SHOWN = 80  # characters of a text that is no URDF

EXPECTED = "expected the text of a URDF, <robot name=...> ... </robot>"
_CONTENT = (
    f"{EXPECTED}: set what is in the file, in a launch file by Command(['xacro ', FILE]), "
    "elsewhere in a parameter file, as the block after 'robot_description: |2'"
)
_OTHER_FORMATS = {
    "sdf": "SDF, the format of Gazebo",
    "mujoco": "MJCF, the format of MuJoCo",
    "COLLADA": "COLLADA, the format of a mesh",
    "launch": "a launch file",
    "html": "a web page",
}

# A declaration counts at the very start only, where a blank line may have come before it.
_DECLARATION = re.compile(r"<\?xml\s[^>]*\?>")
# One that begins no reference, as in "R & D".
_AMPERSAND = re.compile(r"&(?!#?\w+;)")
_PATH = re.compile(r"(\w+://|~?\.{0,2}/)[^\n]*$|[^<>\n]*\.(urdf|xacro|xml|sdf|usda?)$")
_YAML = re.compile(r"---|%YAML|[\w/*.~-]+:\s")

_ENCODING = re.compile(rb"\s*<\?xml\s[^>]*encoding=[\"']([\w.-]+)")

# Definitions of xacro that nothing uses do no harm.
_DEFINITIONS = ("xacro:property", "xacro:arg", "xacro:macro")


class _Builder(ET.TreeBuilder):
    """Builds the tree; refuses what a URDF does not need and a hostile one has."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def doctype(self, _name: str, system: object, public: object, has_subset: int) -> None:
        """Refuse a DOCTYPE that names a file, or defines entities, which grow without bound."""
        if system or public or has_subset:
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


def read_urdf(path: Path) -> str:
    """Return the text of a file, in UTF-8 or else in the encoding that it declares.

    Raises:
        OSError, UnicodeDecodeError: if it cannot be read.
    """
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise OSError(f"{path} is no file")
    data = path.read_bytes()
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        declared = _ENCODING.match(data)
        try:
            if declared is not None:
                return data.decode(declared[1].decode())
        except LookupError:  # an encoding that Python does not know
            pass
        raise error


def parse(text: str) -> ET.Element:
    """Return the ``<robot>`` of a text; prefixes stay in the names of elements, as ROS has them.

    Raises:
        RobotError: if it is not XML, not a URDF, xacro that was not expanded, longer or deeper
            than a URDF is, or if it has a DOCTYPE that may define entities.
    """
    if len(text) > _LONGEST_TEXT:
        raise RobotError(f"the URDF has {len(text)} characters; expected at most {_LONGEST_TEXT}")
    text = text.replace("\ufeff", "")
    if not text.lstrip().startswith("<"):
        raise RobotError(_what_it_is(text.strip()))
    text = _AMPERSAND.sub("&amp;", _DECLARATION.sub("", text, count=1))
    builder, parser = _Builder(), expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.StartDoctypeDeclHandler = builder.doctype
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, ValueError) as error:  # the latter for text that no file can have
        raise RobotError(f"not valid XML: {error}; {_CONTENT}") from error
    root = builder.close()
    if root.tag != "robot":
        format = _OTHER_FORMATS.get(root.tag, f"no URDF: the root element is <{root.tag}>")
        raise RobotError(f"the robot description is {format}; {EXPECTED}")
    _refuse_xacro(root)
    return root


def _what_it_is(text: str) -> str:
    """Return what to say of a text that is no XML."""
    shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ..."
    what = f"not XML: it begins with '{shown}'"
    if not text:
        what = "empty"
    elif _PATH.match(text):
        what = f"a path, '{shown}'"
    elif text.startswith(("$(", "xacro ")):
        what = f"a command that was not run, '{shown}'"
    elif text.startswith(("#usda", "PXR-USDC")):
        what = "USD, the format of Isaac Sim"
    elif _YAML.match(text):
        what = f"YAML, '{shown}'"
    return f"the robot description is {what}; {_CONTENT}"


def _refuse_xacro(root: ET.Element) -> None:
    """Raise RobotError if a part of the robot has still to be made by xacro."""
    for part in root:
        if part.tag in _DEFINITIONS or not part.tag.startswith(("link", "joint", "xacro:")):
            continue
        for element in part.iter():
            values = () if element.tag == "mesh" else element.attrib.values()
            found = [repr(value[:_SHOWN]) for value in values if "${" in value or "$(" in value]
            if element.tag.startswith("xacro:"):
                found = [f"<{element.tag}>"]
            if found:
                raise RobotError(
                    f"the robot description is xacro that was not expanded: it has {found[0]}; "
                    "expand it: xacro FILE.urdf.xacro > FILE.urdf, in a launch file "
                    "Command(['xacro ', FILE])"
                )
