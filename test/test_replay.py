"""The replay: meshes, robots and motion as plain data, whatever a bag contains."""

import base64
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_runs import URDF, recorded

from eulerparams_control.analysis.digest import Digest, Track
from eulerparams_control.analysis.drawn_robot import (
    Mesh,
    drawn_robot,
    find_mesh,
    read_meshes,
)
from eulerparams_control.analysis.html import as_json
from eulerparams_control.analysis.replay import ARROW, replay
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot

MOST = 100_000  # triangles
ROBOT_BYTES = 2_000_000
JOINTS = ("hinge", "roll")


def unpacked(array: dict[str, str], *shape: int) -> np.ndarray:
    values = np.frombuffer(base64.b64decode(array["bdata"]), "<" + array["dtype"])
    return values.reshape(shape) if shape else values


def sphere(count: int) -> Mesh:
    """Return a unit sphere of 2 count (count - 1) triangles, its corners not shared."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, count), np.linspace(0, 2 * np.pi, count + 1))
    sin, cos = np.sin, np.cos
    points = np.stack([sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    corners = np.concatenate([np.stack(t, axis=2).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))


def write_stl(path: Path, mesh: Mesh) -> Path:
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in mesh.vertices[triangle].tolist())
        + "endloop\nendfacet\n"
        for triangle in mesh.triangles
    )
    path.write_text(f"solid s\n{facets}endsolid s\n")
    return path


def with_visual(geometry: str, link: str = "rod", material: str = "") -> str:
    """Return the URDF of the rod with a shape on one of its links."""
    visual = f"<visual><origin xyz='0.5 0 0'/><geometry>{geometry}</geometry>{material}</visual>"
    return URDF.replace(f'<link name="{link}">', f'<link name="{link}">{visual}')


def drawn(urdf: str) -> tuple[dict[str, Any], list[str]]:
    return drawn_robot(urdf, "base", "tip", JOINTS, MOST)


# --- meshes ----------------------------------------------------------------------------------


def test_a_mesh_is_read_from_its_file_and_a_broken_one_is_not(tmp_path):
    (found,) = read_meshes(write_stl(tmp_path / "ball.stl", sphere(10)))
    assert len(found.triangles) == pytest.approx(170, abs=15)  # those at the poles are lines
    assert np.ptp(found.vertices, axis=0) == pytest.approx(2, abs=0.15)
    (tmp_path / "broken.stl").write_text("solid nothing")
    (tmp_path / "broken.dae").write_text("<COLLADA><visual_scene><node><instance_geometry/>")
    assert read_meshes(tmp_path / "broken.stl") == ()
    assert read_meshes(tmp_path / "broken.dae") == ()
    assert read_meshes(tmp_path / "missing.stl") == ()


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset><unit meter="0.01"/>
</asset><library_effects><effect id="e"><profile_COMMON><technique><phong>
<diffuse><color>1 0.5 0 1</color></diffuse></phong></technique></profile_COMMON></effect>
</library_effects><library_materials><material id="m"><instance_effect url="#e"/></material>
</library_materials><library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">0 0 0 100 0 0 100 200 0 0 200 0</float_array>
<technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist material="orange"><input semantic="VERTEX" source="#v" offset="1"/>
<input semantic="NORMAL" source="#s" offset="0"/>
<vcount>4 3</vcount><p>3 0 3 1 3 2 3 3 3 0 3 1 3 2</p></polylist>
<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>3 2 1</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene><node>
<translate>0 0 300</translate><node><rotate>0 0 1 90</rotate><scale>1 1 2</scale>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="orange" target="#m"/></technique_common></bind_material>
</instance_geometry></node></node></visual_scene></library_visual_scenes></COLLADA>"""


@pytest.fixture
def share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    (tmp_path / "share").mkdir()
    return tmp_path / "share"


def test_a_collada_file_is_read_with_its_units_placements_and_colours(share):
    (share / "part.dae").write_text(DAE)
    orange, plain = read_meshes(share / "part.dae")
    assert (orange.colour, plain.colour) == ("#ffba00", "")
    corners = [[0, 0, 3], [0, 1, 3], [-2, 1, 3], [-2, 0, 3]]
    assert orange.vertices == pytest.approx(np.array(corners), abs=1e-6)
    assert orange.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    corner = pytest.approx(np.array(corners)[[3, 2, 1]], abs=1e-6)
    assert plain.vertices[plain.triangles[0]] == corner
    urdf = with_visual(f"<mesh filename='file://{share}/part.dae'/>")
    assert [visual["colour"] for visual in drawn(urdf)[0]["visuals"]] == ["#ffba00", ""]


def test_a_mesh_is_found_in_its_package_and_nowhere_else(tmp_path):
    (tmp_path / "share" / "arm").mkdir(parents=True)
    inside = tmp_path / "share" / "arm" / "link.STL"
    outside = tmp_path / "secret.stl"
    for file in (inside, outside, tmp_path / "share" / "arm" / "passwords.txt"):
        file.write_text("")
    folders = [tmp_path / "elsewhere", tmp_path / "share"]
    assert find_mesh("package://arm/link.STL", folders) == inside
    assert find_mesh(f"file://{inside}", folders) == inside
    assert find_mesh(f"file://{outside}", folders) is None
    assert find_mesh("package://arm/../../secret.stl", folders) is None
    assert find_mesh("package://arm/passwords.txt", folders) is None
    assert find_mesh("package://other/link.STL", folders) is None


@pytest.mark.parametrize("name", config_names("robots"))
def test_each_robot_is_drawn_with_all_its_meshes_and_is_small(name):
    robot = load_robot(name)
    data, missing = drawn_robot(robot.urdf, robot.base_frame, robot.tip_frame, robot.joints, MOST)
    assert missing == []
    assert data["bones"] == []
    moving = [joint["index"] for joint in data["joints"] if joint["index"] >= 0]
    assert sorted(moving) == list(range(len(robot.joints)))
    assert len({visual["link"] for visual in data["visuals"]}) > len(robot.joints)
    assert sum(len(unpacked(mesh["triangles"], -1, 3)) for mesh in data["meshes"]) > 10_000
    assert len(as_json(data)) < ROBOT_BYTES


# --- robots ----------------------------------------------------------------------------------


def visual_of(geometry: str) -> str:
    return f"<visual><geometry>{geometry}</geometry></visual>"


def test_where_meshes_are_missing_bones_are_drawn_and_the_page_says_which(tmp_path):
    mesh, box = "package://no_such/rod.dae", visual_of("<box size='1 2 3'/>")
    urdf = with_visual(f"<mesh filename='{mesh}'/>")
    urdf = urdf.replace('<link name="arm">', f'<link name="arm">{box}')
    for shown, count, lacking in ((URDF, 0, []), (urdf, 1, [mesh])):
        data, missing = drawn(shown)
        assert len(data["visuals"]) == count
        assert missing == lacking
        assert data["bones"] == ["hinge", "roll", "end"]
    (note,) = replay([Digest.of(recorded(tmp_path / "run", [0.1, 0.2], urdf=urdf))]).notes
    assert note == f"Meshes not found, bones are drawn: {mesh}."


def test_a_robot_that_cannot_be_drawn_is_left_out_with_a_note(tmp_path):
    run = Digest.of(recorded(tmp_path / "run", [0.1, 0.2]))
    found = replay([replace(run, urdf="<robot/>"), run])
    assert found.data["robots"][0] is None
    assert found.data["robots"][1] is not None
    assert [note.partition(":")[0] for note in found.notes] == ["The robot cannot be drawn"]


# --- motion ----------------------------------------------------------------------------------
def track(count: int = 3, **values: Any) -> Track:
    nothing = np.full((count, 3), np.nan)
    frames = np.full((count, 3, 3), np.nan)
    found: dict[str, Any] = {
        "t": np.arange(float(count)),
        "q": np.zeros((count, 2)),
        "p_e": np.zeros((count, 3)),
        "R_e": np.tile(np.eye(3), (count, 1, 1)),
        **dict.fromkeys(("p_d", "p_c", "f", "mu"), nothing),
        **dict.fromkeys(("R_d", "R_c"), frames),
    }
    return Track(**(found | values))


@pytest.fixture
def digest(tmp_path: Path) -> Digest:
    return Digest.of(recorded(tmp_path / "run", [0.1, 0.2]))


def test_frames_come_as_positions_and_quaternions_with_the_scalar_last(digest):
    R = np.array([np.eye(3), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.full((3, 3), np.nan)])
    p = np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9]])
    (run,) = replay([replace(digest, track=track(p_d=p, R_d=R))]).data["runs"]
    half = np.sqrt(0.5)
    quaternions = unpacked(run["d"]["o"], 3, 4)
    assert quaternions[:2] == pytest.approx(np.array([[0, 0, 0, 1], [0, 0, half, half]]))
    assert np.isnan(quaternions[2]).all()
    assert np.isnan(unpacked(run["d"]["p"], 3, 3)[2]).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("wild", [np.nan, np.inf, 1e25, 1e300])
def test_an_arm_beyond_all_numbers_is_held_where_it_was_last(digest, wild):
    q = np.array([[wild, 0.2], [0.3, 0.4], [0.3, wild], [wild, wild]])
    p = np.array([[1.0, 0, 0], [2, 0, 0], [wild, 0, 0], [wild] * 3])
    f = np.array([[1.0, 0, 0], [2, 0, 0], [wild, 0, 0], [wild] * 3])
    found = replay([replace(digest, track=track(4, q=q, p_e=p, f=f, p_d=p, mu=f))])
    (run,) = found.data["runs"]
    expected = np.array([[0.0, 0.0], [0.3, 0.4], [0.3, 0.4], [0.3, 0.4]])  # it begins at zero
    assert unpacked(run["q"], 4, 2) == pytest.approx(expected)
    assert unpacked(run["p"], 4, 3)[:, 0] == pytest.approx(np.array([1, 2, 2, 2]))
    assert found.per_arrow["f"] == 0.5  # of 2 N: the wild ones do not count
    json.loads(as_json(found.data))


@pytest.mark.parametrize(
    ("largest", "per_arrow"), [(20.0, 5.0), (21.0, 10.0), (7.0, 2.0), (0.5, 0.2), (380.0, 100.0)]
)
def test_the_scale_of_an_arrow_is_round(digest, largest, per_arrow):
    f = np.array([[0.0, 0, 0], [0, largest, 0], [0, 0, 0]])
    found = replay([replace(digest, track=track(f=f, mu=0 * f))])
    assert found.per_arrow["f"] == pytest.approx(per_arrow)
    assert found.data["arrow"]["f"] == pytest.approx(ARROW / per_arrow)
    assert found.layers == {"f"}  # a moment of nothing has no arrow


def test_many_runs_have_fewer_steps_each_with_first_and_last(digest):
    long = replace(digest, track=track(3001))
    (alone,) = replay([long]).data["runs"]
    assert len(unpacked(alone["t"])) == 3001
    runs = replay([long] * 16).data["runs"]
    for run in runs:
        t = unpacked(run["t"])
        assert len(t) <= 751
        assert t[[0, -1]].tolist() == [0, 3000]
