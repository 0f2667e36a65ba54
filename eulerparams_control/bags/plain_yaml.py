"""YAML of a bag, which may come from anyone: plain data of bounded size, and nothing else.

A few lines of YAML can stand for more data than there is memory, by aliases of aliases, also
in merge keys; a tag can make an object of any class; a collection can contain itself.
"""

from typing import Any

import yaml

_LONGEST = 4_000_000  # characters: PyYAML takes a second for 100,000
_MOST = 400_000  # values, those of aliases counted at each of their places

_PLAIN = ("null", "bool", "int", "float", "str", "seq", "map", "merge")
_TAG = "tag:yaml.org,2002:"


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Makes of scalars what JSON has; others, as dates, stay text."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag.removeprefix(_TAG) in _PLAIN]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.yaml_constructors = {
    tag: constructor
    for tag, constructor in yaml.SafeLoader.yaml_constructors.items()
    if tag is None or tag.removeprefix(_TAG) in _PLAIN
}


def load_plain(text: str) -> Any:
    """Return the only document of a YAML text: mappings, lists, text, numbers, true, false, null.

    Raises:
        ValueError: if it is too long, or stands for too much or for itself.
        Exception: of any type, if it is no YAML, or has other tags.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"{len(text)} characters; expected at most {_LONGEST}")
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        if _size(node, {}) > _MOST:
            raise ValueError(f"its aliases stand for more than {_MOST} values")
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Return the number of values that a node stands for; by the nodes whose number is known."""
    if id(node) not in known:
        known[id(node)] = -1  # until it is known: who meets it again is within it
        known[id(node)] = 1 + sum(_size(child, known) for child in _children(node))
    if known[id(node)] < 0:
        raise ValueError("a collection contains itself")
    return known[id(node)]


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [child for pair in node.value for child in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []
