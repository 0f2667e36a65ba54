"""A robot as the page draws it: links, joints and shapes of its URDF, as plain data."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.decimation import packed
from eulerparams_control.errors import EulerParamsError, RobotError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot, share_folders
from eulerparams_control.robot.urdf import UrdfTree, attribute, numbers

try:
    import coal  # type: ignore[import-not-found,import-untyped,unused-ignore]
except ImportError:  # an older Pinocchio: no meshes
    coal = None

_SUFFIXES = (".dae", ".stl", ".obj", ".ply")
_LARGEST = 200_000_000  # [bytes] of a file
_GROWTH = 1.25  # of the cells, until there are few enough triangles
_SMALLEST_CELL = 1e-3  # of the size of a mesh
_LARGEST_CELL = 0.2
_START = 0.55  # of the edge of a cell as large as a triangle will be

type Triangles = NDArray[np.int64]


class Mesh(NamedTuple):
    """A surface.

    Attributes:
        vertices: (N, 3) [m].
        triangles: (M, 3) indices of vertices.
        colour: #rrggbb; "" if none is stated.
    """

    vertices: Array
    triangles: Triangles
    colour: str = ""


def mesh_folders(urdf: str) -> list[Path]:
    """Return the folders in which the meshes of a URDF may be, the most likely first.

    They are the folder of the robot of config/robots with this text, and those that hold packages.
    """
    return [*_own_folder(urdf), *share_folders()]


def _own_folder(urdf: str) -> Iterator[Path]:
    for name in config_names("robots"):
        try:
            robot = load_robot(name)
        except EulerParamsError:  # not installed
            continue
        if robot.urdf.strip() == urdf.strip():
            yield robot.urdf_path.parent


def find_mesh(name: str, folders: Sequence[Path]) -> Path | None:
    """Return the file of a mesh that a URDF names; None if it is not there.

    The URDF is not trusted: no name leaves the folders, and only files of meshes are read.

    Args:
        name: ``package://PACKAGE/PATH``, ``file://PATH``, or a path.
        folders: in which packages, and relative paths, are looked for; others must be in them.
    """
    if Path(name).suffix.lower() not in _SUFFIXES:
        return None
    path = Path(name.removeprefix("package://").removeprefix("file://"))
    for folder in folders:
        found = (folder / path).resolve()
        if found.is_relative_to(folder.resolve()) and found.is_file():
            return found
    return None


@lru_cache(maxsize=64)
def read_meshes(path: Path) -> tuple[Mesh, ...]:
    """Return what is in a file of a mesh, part by part; nothing if it cannot be read."""
    try:
        if path.stat().st_size > _LARGEST:
            return ()
        parts = _coloured(path) if path.suffix.lower() == ".dae" else [_loaded(path)]
    except (OSError, RuntimeError, ValueError, LookupError, AttributeError, TypeError):
        return ()
    return tuple(mesh for mesh in parts if len(mesh.triangles) and _is_finite(mesh))


def rgb(red: float, green: float, blue: float) -> str:
    """Return a colour of three parts from 0 to 1 as #rrggbb."""
    return "#" + "".join(f"{round(255 * min(max(v, 0.0), 1.0)):02x}" for v in (red, green, blue))


def _coloured(path: Path) -> list[Mesh]:
    """Return the surfaces of a COLLADA file, each of one colour; ValueError if it is broken.

    Units and placements count, the up axis does not: so ROS has it.
    """
    import collada  # takes a while, and not every robot needs it

    meshes = []
    try:
        document = collada.Collada(str(path), ignore=[collada.common.DaeUnsupportedError])
        scale = document.assetInfo.unitmeter or 1.0
        found = (one for scene in document.scenes for one in scene.objects("geometry"))
        for primitive in (part for one in found for part in one.primitives()):
            if isinstance(primitive, collada.polylist.BoundPolylist):
                primitive = primitive.triangleset()
            if isinstance(primitive, collada.triangleset.BoundTriangleSet) and len(primitive):
                used, renumbered = np.unique(primitive.vertex_index, return_inverse=True)
                colour = getattr(getattr(primitive.material, "effect", None), "diffuse", None)
                stated = rgb(*map(_lit, colour[:3])) if isinstance(colour, tuple) else ""
                vertices = scale * primitive.vertex[used].astype(float)
                meshes.append(Mesh(vertices, renumbered.reshape(-1, 3), stated))
    except (collada.common.DaeError, SyntaxError) as error:  # SyntaxError: it is no XML
        raise ValueError(f"{path} is broken: {error}") from error
    return meshes


def _lit(value: float) -> float:
    """Return a part of a colour as screens have it: files state how much light is reflected."""
    return float(np.clip(value, 0.0, 1.0) ** (1 / 2.2))


def _loaded(path: Path) -> Mesh:
    """Return what coal reads from a file; AttributeError where there is no coal."""
    model = coal.MeshLoader(coal.BV_AABB).load(str(path), np.ones(3))
    vertices = np.array(model.vertices(), dtype=float).reshape(-1, 3)
    rows = (model.tri_indices(index) for index in range(model.num_tris))
    triangles = np.array([(row[0], row[1], row[2]) for row in rows], dtype=np.int64)
    return Mesh(vertices, triangles.reshape(-1, 3))


def _is_finite(mesh: Mesh) -> bool:
    return bool(np.isfinite(mesh.vertices).all())


def simplified(mesh: Mesh, most: int) -> Mesh:
    """Return a mesh of at most about ``most`` triangles, its vertices merged in cubic cells."""
    if len(mesh.triangles) <= most:
        return mesh
    size = float(np.ptp(mesh.vertices, axis=0).max())
    cell = max(_SMALLEST_CELL * size, _START * math.sqrt(_area(mesh) / max(1, most)))
    found = clustered(mesh, cell)
    while len(found.triangles) > most and cell < _LARGEST_CELL * size:
        cell *= _GROWTH
        found = clustered(mesh, cell)
    return found


def _area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[corner] for corner in mesh.triangles.T)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def clustered(mesh: Mesh, cell: float) -> Mesh:
    """Return a mesh with one vertex in each cell: the mean of those that were there.

    Args:
        mesh: the surface.
        cell: [m] edge of the cells.
    """
    if cell <= 0:
        return mesh
    cells = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / cell).astype(np.int64)
    _, merged = np.unique(_keys(cells), return_inverse=True)
    count = np.bincount(merged)
    sums = [np.bincount(merged, weights=column) for column in mesh.vertices.T]
    vertices = np.column_stack(sums) / count[:, None]
    return _without_slivers(mesh._replace(vertices=vertices, triangles=merged[mesh.triangles]))


def _keys(rows: Triangles) -> Triangles:
    """Return a number for each row (a, b, c) of numbers >= 0: the same for the same rows only."""
    sizes = rows.max(axis=0, initial=0) + 1
    keys: Triangles = (rows[:, 0] * sizes[1] + rows[:, 1]) * sizes[2] + rows[:, 2]
    return keys


def _without_slivers(mesh: Mesh) -> Mesh:
    """Return a mesh without triangles of fewer than three vertices, and without doubles."""
    a, b, c = mesh.triangles.T
    kept = mesh.triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(_keys(np.sort(kept, axis=1)), return_index=True)
    kept = kept[np.sort(first)]
    used, renumbered = np.unique(kept, return_inverse=True)
    return mesh._replace(vertices=mesh.vertices[used], triangles=renumbered.reshape(kept.shape))


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
    moving = set(tree.moving(tree.link(base, "base"), tree.link(tip, "tip")))
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
    """Visual shapes of the links of a robot.

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
            yield {"box": numbers(element, "size")}
        if element.tag == "sphere":
            yield {"sphere": numbers(element, "radius", count=1)}
        if element.tag in ("cylinder", "capsule"):
            sizes = (numbers(element, name, count=1) for name in ("radius", "length"))
            yield {element.tag: [size for (size,) in sizes]}

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
        scale = numbers(element, "scale", "1 1 1")
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
    red, green, blue, alpha = numbers(element, "rgba", count=4)
    if alpha <= 0:
        return ""
    return rgb(red, green, blue)


def joint_data(tree: UrdfTree, name: str, joints: Sequence[str]) -> Data:
    """Return a joint: its links, its place, its axis, and its index among those that move."""
    element = tree.joints[name]
    axis = element.find("axis")
    return {
        "name": name,
        "parent": tree.end(name, "parent"),
        "child": tree.end(name, "child"),
        "kind": element.get("type", "fixed"),
        "index": joints.index(name) if name in joints else -1,
        "axis": [1.0, 0.0, 0.0] if axis is None else numbers(axis, "xyz"),
        **_origin(element),
    }


def _origin(element: ET.Element) -> Data:
    origin = element.find("origin")
    origin = ET.Element("origin") if origin is None else origin
    return {name: numbers(origin, name, "0 0 0") for name in ("xyz", "rpy")}


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
