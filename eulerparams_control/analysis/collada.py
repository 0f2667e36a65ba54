"""Meshes of COLLADA files (.dae), each part with its colour, which other readers leave out.

Units and placements count, the up axis does not: so ROS has it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.laws.rotations import Array, R_angle_axis


class Part(NamedTuple):
    """A surface of one colour.

    Attributes:
        vertices: (N, 3) [m].
        triangles: (M, 3) indices of vertices.
        colour: red, green, blue from 0 to 1; None if none is stated.
    """

    vertices: Array
    triangles: NDArray[np.int64]
    colour: tuple[float, float, float] | None = None


def read_collada(path: Path) -> list[Part]:
    """Return the parts of a file.

    Raises:
        ValueError, LookupError: if it is not what the format says.
        ET.ParseError: if it is not XML.
        OSError: if it cannot be read.
    """
    root = ET.parse(path).getroot()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    unit = root.find("asset/unit")
    scale = 1.0 if unit is None else float(unit.get("meter", 1))
    document = _Document(root)
    placement = np.diag([scale, scale, scale, 1.0])
    nodes = [node for scene in root.iter("visual_scene") for node in scene.findall("node")]
    return [part for node in nodes for part in document.parts(node, placement)]


class _Document:
    """What refers to each other by name."""

    def __init__(self, root: ET.Element) -> None:
        self._known = {f"#{e.get('id')}": e for e in root.iter() if e.get("id") is not None}

    def parts(self, node: ET.Element, above: Array) -> Iterator[Part]:
        """Yield the parts of a node, and of those below it."""
        T = above @ _transform(node)
        for instance in node.findall("instance_geometry"):
            bound = {
                m.get("symbol"): m.get("target", "") for m in instance.iter("instance_material")
            }
            mesh = self._known[instance.get("url", "")].find("mesh")
            for group in [] if mesh is None else mesh:
                if group.tag in ("triangles", "polylist"):
                    vertices, triangles = self._surface(group)
                    colour = self._colour(bound.get(group.get("material"), ""))
                    if len(triangles):
                        yield Part(vertices @ T[:3, :3].T + T[:3, 3], triangles, colour)
        for child in node.findall("node"):
            yield from self.parts(child, T)

    def _surface(self, group: ET.Element) -> tuple[Array, NDArray[np.int64]]:
        """Return the vertices and the triangles of a group of polygons."""
        inputs = {i.get("semantic"): i for i in group.findall("input")}
        stride = 1 + max(int(i.get("offset", 0)) for i in group.findall("input"))
        indices = _array(group.find("p"), np.int64).reshape(-1, stride)
        corners = indices[:, int(inputs["VERTEX"].get("offset", 0))]
        counts = group.find("vcount")
        triangles = (
            corners.reshape(-1, 3) if counts is None else _fans(corners, _array(counts, np.int64))
        )
        points = self._positions(inputs["VERTEX"].get("source", ""))
        used, renumbered = np.unique(triangles, return_inverse=True)
        return points[used], renumbered.reshape(triangles.shape)

    def _positions(self, vertices: str) -> Array:
        source = next(
            i.get("source", "") for i in self._known[vertices] if i.get("semantic") == "POSITION"
        )
        values: Array = _array(self._known[source].find("float_array"), np.float64)
        return values.reshape(-1, 3)

    def _colour(self, material: str) -> tuple[float, float, float] | None:
        element = self._known.get(material)
        instance = None if element is None else element.find("instance_effect")
        effect = None if instance is None else self._known.get(instance.get("url", ""))
        diffuse = None if effect is None else effect.find(".//diffuse/color")
        if diffuse is None:
            return None
        red, green, blue = (_lit(value) for value in _array(diffuse, np.float64)[:3].tolist())
        return red, green, blue


def _lit(value: float) -> float:
    """Return a part of a colour as screens have it: files state how much light is reflected."""
    return float(np.clip(value, 0.0, 1.0) ** (1 / 2.2))


def _fans(corners: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles of convex polygons with these numbers of corners."""
    starts = np.cumsum(counts) - counts
    fans = np.maximum(counts - 2, 0)
    first = np.repeat(starts, fans)
    step = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans)
    triangles: NDArray[np.int64] = corners[
        np.column_stack([first, first + step + 1, first + step + 2])
    ]
    return triangles


def _transform(node: ET.Element) -> Array:
    """Return the placement (4, 4) of a node in the one above."""
    T = np.eye(4)
    for element in node:
        if element.tag == "matrix":
            T = T @ _array(element, np.float64).reshape(4, 4)
        elif element.tag in ("translate", "rotate", "scale"):
            step, values = np.eye(4), _array(element, np.float64)
            if element.tag == "translate":
                step[:3, 3] = values
            elif element.tag == "scale":
                step[:3, :3] = np.diag(values)
            else:
                step[:3, :3] = R_angle_axis(float(np.radians(values[3])), values[:3])
            T = T @ step
    return T


def _array[T: np.generic](element: ET.Element | None, kind: type[T]) -> NDArray[T]:
    text = "" if element is None else element.text or ""
    return np.array(text.split(), dtype=kind)
