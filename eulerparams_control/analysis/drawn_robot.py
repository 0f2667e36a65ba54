"""A robot as the page draws it: links, joints and shapes of its URDF, as plain data."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.analysis.decimation import packed
from eulerparams_control.analysis.meshes import (
    Mesh,
    find_mesh,
    mesh_folders,
    read_meshes,
    rgb,
    simplified,
)
from eulerparams_control.errors import RobotError
from eulerparams_control.robot.urdf import UrdfTree, attribute

_STEPS = 65535  # of a quantised coordinate

type Data = dict[str, Any]


class DrawnRobot(NamedTuple):
    """A robot for the page.

    Attributes:
        data: what the page reads.
        missing: the files of meshes that were not found, or not readable.
    """

    data: Data
    missing: list[str]


@lru_cache(maxsize=8)
def drawn_robot(urdf: str, base: str, tip: str, joints: tuple[str, ...], most: int) -> DrawnRobot:
    """Return a robot for the page.

    Args:
        urdf: its text.
        base, tip: names of links.
        joints: that move, in the order of q.
        most: triangles, of all meshes together.

    Raises:
        RobotError: if the URDF is broken, or lacks a link or a joint.
    """
    tree = UrdfTree(urdf)
    moving = set(tree.moving(tree.link(base), tree.link(tip)))
    if not set(joints) <= moving:
        raise RobotError(f"not between base and tip: {', '.join(sorted(set(joints) - moving))}")
    shapes = shapes_of(tree, urdf, most)
    data = {
        "base": base,
        "tip": tip,
        "links": tree.links,
        "joints": [joint_data(tree, name, joints) for name in tree.joints],
        "visuals": shapes.visuals,
        "meshes": [_quantised(mesh) for mesh in shapes.meshes],
        "bones": tree.chain(base, tip) if shapes.missing or not shapes.visuals else [],
    }
    return DrawnRobot(data, sorted(set(shapes.missing)))


class Shapes(NamedTuple):
    """What is seen of the links of a robot.

    Attributes:
        visuals: each with its link, its place in it, its colour, and a ``mesh`` by index or a
            ``box``, ``sphere``, ``cylinder`` or ``capsule`` with its sizes [m].
        meshes: that they name.
        missing: the files of meshes that were not found, or not readable.
    """

    visuals: list[Data]
    meshes: list[Mesh]
    missing: list[str]


def shapes_of(tree: UrdfTree, urdf: str, most: int) -> Shapes:
    """Return the shapes of a robot, at most ``most`` triangles in all its meshes together."""
    found = _Shapes(mesh_folders(urdf), _materials(tree))
    visuals = [visual for link in tree.element.findall("link") for visual in found.of(link)]
    return Shapes(visuals, _fewer(found.meshes, most), found.missing)


class _Shapes:
    """The shapes of links; ``meshes`` and ``missing`` grow while they are asked for."""

    def __init__(self, folders: Sequence[Path], materials: dict[str, str]) -> None:
        self.meshes: list[Mesh] = []
        self.missing: list[str] = []
        self._folders = folders
        self._materials = materials
        self._known: dict[Path, int] = {}

    def of(self, link: ET.Element) -> Iterator[Data]:
        """Yield the visuals of a link."""
        for visual in link.findall("visual"):
            place = {"link": attribute(link, "name"), **_origin(visual)}
            colour = self._colour(visual.find("material"))
            for shape in self._shapes(visual.find("geometry")):
                own = shape.pop("colour", "")
                yield {**place, "colour": colour or own, **shape}

    def _shapes(self, geometry: ET.Element | None) -> Iterator[Data]:
        element = None if geometry is None else next(iter(geometry), None)
        if element is None:
            return
        if element.tag == "mesh":
            yield from self._parts(element)
        if element.tag == "box":
            yield {"box": _numbers(attribute(element, "size"), 3)}
        if element.tag == "sphere":
            yield {"sphere": _numbers(attribute(element, "radius"), 1)}
        if element.tag in ("cylinder", "capsule"):
            sizes = (attribute(element, name) for name in ("radius", "length"))
            yield {element.tag: [_numbers(size, 1)[0] for size in sizes]}

    def _parts(self, element: ET.Element) -> Iterator[Data]:
        """Yield the parts of a mesh, each of its own colour."""
        name = attribute(element, "filename")
        path = find_mesh(name, self._folders)
        parts = () if path is None else read_meshes(path)
        if path is None or not parts:
            self.missing.append(name)
            return
        if path not in self._known:
            self._known[path] = len(self.meshes)
            self.meshes += parts
        scale = _numbers(element.get("scale", "1 1 1"), 3)
        for index, part in enumerate(parts, self._known[path]):
            yield {"mesh": index, "scale": scale, "colour": part.colour}

    def _colour(self, material: ET.Element | None) -> str:
        """Return the colour of a material, "" if it states none."""
        if material is None:
            return ""
        return _rgb(material) or self._materials.get(material.get("name", ""), "")


def _materials(tree: UrdfTree) -> dict[str, str]:
    return {m.get("name", ""): _rgb(m) for m in tree.element.iter("material") if _rgb(m)}


def _rgb(material: ET.Element) -> str:
    """Return the colour of a material as #rrggbb; "" if it has none, or is not seen."""
    element = material.find("color")
    if element is None:
        return ""
    red, green, blue, alpha = _numbers(attribute(element, "rgba"), 4)
    if alpha <= 0:
        return ""
    return rgb(red, green, blue)


def joint_data(tree: UrdfTree, name: str, joints: Sequence[str]) -> Data:
    """Return a joint: its links, its place, its axis, and its index among those that move."""
    element = tree.joints[name]
    axis = element.find("axis")
    direction = [1.0, 0.0, 0.0] if axis is None else _numbers(attribute(axis, "xyz"), 3)
    return {
        "name": name,
        "parent": tree.end(name, "parent"),
        "child": tree.end(name, "child"),
        "kind": element.get("type", "fixed"),
        "index": joints.index(name) if name in joints else -1,
        "axis": direction if any(direction) else [1.0, 0.0, 0.0],
        **_origin(element),
    }


def _origin(element: ET.Element) -> Data:
    origin = element.find("origin")
    stated = {} if origin is None else origin.attrib
    return {
        "xyz": _numbers(stated.get("xyz", "0 0 0"), 3),
        "rpy": _numbers(stated.get("rpy", "0 0 0"), 3),
    }


def _numbers(text: str, count: int) -> list[float]:
    try:
        values = [float(number) for number in text.split()]
    except ValueError as error:
        raise RobotError(f"expected {count} numbers, got '{text}'") from error
    if len(values) != count or not all(map(math.isfinite, values)):
        raise RobotError(f"expected {count} finite numbers, got '{text}'")
    return values


def _fewer(meshes: Sequence[Mesh], most: int) -> list[Mesh]:
    """Return meshes with few triangles, each in proportion to what it has."""
    total = sum(len(mesh.triangles) for mesh in meshes)
    share = min(1.0, most / max(1, total))
    return [simplified(m, math.ceil(share * len(m.triangles))) for m in meshes]


def _quantised(mesh: Mesh) -> Data:
    """Return a mesh with coordinates in 65536 steps of the box that it fills."""
    low = mesh.vertices.min(axis=0)
    step = np.maximum(np.ptp(mesh.vertices, axis=0), 1e-9) / _STEPS
    steps = np.rint((mesh.vertices - low) / step).astype(np.uint16)
    kind = np.uint16 if len(mesh.vertices) <= _STEPS else np.uint32
    return {
        "low": low.tolist(),
        "step": step.tolist(),
        "vertices": packed(steps),
        "triangles": packed(mesh.triangles.astype(kind)),
    }
