"""Schema text of a message type: its .msg file and those of all that it contains.

The form is ``ros2msg`` of rosbag2: the text of the type, then each type it depends on,
once, depth first and sorted, after a line of 80 ``=`` and a line ``MSG: package/Type``.
"""

import functools
import os
import re
import sys
from pathlib import Path

from eulerparams_control.errors import BagError

_SEPARATOR = "=" * 80
_TYPE_NAME = re.compile(r"([a-zA-Z]\w*)/(?:msg/)?([a-zA-Z]\w*)", re.ASCII)
_FIELD_TYPE = re.compile(r"^\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s", re.MULTILINE)
_PRIMITIVE = re.compile(r"bool|byte|char|w?string|float(32|64)|u?int(8|16|32|64)")


@functools.cache
def message_definition(message_type: str) -> str:
    """Return the schema text of ``message_type``, e.g. ``sensor_msgs/msg/JointState``.

    Raises:
        BagError: if the .msg file of the type, or of one that it contains, is not found.

    Source: ``local_message_definition_source.cpp`` of rosbag2.
    """
    return _with_dependencies(message_type, set())


def _with_dependencies(message_type: str, seen: set[str]) -> str:
    text = _message_file(message_type).read_text(encoding="utf-8")
    package = message_type.partition("/")[0]
    for dependency in _dependencies(text, package):
        if dependency not in seen:
            seen.add(dependency)
            text += f"\n{_SEPARATOR}\nMSG: {dependency}\n{_with_dependencies(dependency, seen)}"
    return text


def _dependencies(text: str, package: str) -> list[str]:
    """Return the types of the fields that are messages, as ``package/Type``, sorted."""
    types = {name for name in _FIELD_TYPE.findall(text) if not _PRIMITIVE.fullmatch(name)}
    return sorted(name if "/" in name else f"{package}/{name}" for name in types)


def _message_file(message_type: str) -> Path:
    match = _TYPE_NAME.fullmatch(message_type)
    if match is None:
        raise BagError(f"'{message_type}' is no message type; expected package/msg/Type")
    package, name = match.groups()
    for prefix in _prefixes():
        path = Path(prefix) / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path
    raise BagError(
        f"the definition of {message_type} is missing; looked for share/{package}/msg/{name}.msg "
        f"in {', '.join(_prefixes())}; install the package or source its workspace"
    )


def _prefixes() -> list[str]:
    ament = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [prefix for prefix in ament if prefix] + [sys.prefix]
