"""The arm and its frames in 3D, seen from the base frame."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from eulerparams_control.analysis.drawn_robot import Data, joint_data, shapes_of
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.rotations import Array
from eulerparams_control.live.geometry import R_rpy, joint_motion, wxyz
from eulerparams_control.live.view import View
from eulerparams_control.motion.drawing import ellipsoid
from eulerparams_control.motion.frames import AT_ORIGIN, Placement
from eulerparams_control.robot.robot import Robot
from eulerparams_control.robot.urdf import MOVING, UrdfTree

_TRIANGLES = 25_000  # of the arm at most
FIELD_OF_VIEW = math.radians(50)
"""[rad] from bottom to top."""

GIZMO = 0.22
"""[m] length of the arrows of the target."""

_NARROW = 0.75  # width by height of a window
_GREY = (150, 155, 162)
_GIVES, _WRENCH, _TOOL = (0, 120, 200), (230, 120, 0), (120, 60, 180)
_POLE, _IDLE = (214, 39, 40), (150, 150, 150)
_GLOBE = 0.16  # [m] radius of the sphere about the tip on which the poles are drawn
_PER_NEWTON, _PER_STIFFNESS = 0.005, 1.2e-4  # [m/N], [m^2/N]
_LONGEST = 0.3  # [m] semi-axis of the ellipsoid
_LEAST_FORCE = 1.0  # [N] that is drawn
_UNSEEN = 2e-4  # [m, rad] of a motion
_APART = 0.004, 0.03  # [m, rad] by which the compliant frame must be displaced to be drawn

Drag = Callable[[int, str, Placement], None]


class Scene:
    """What is seen of one arm.

    Args:
        server: of the pages.
        robot: the arm.
        urdf: its text.
        on_drag: called with page, phase and placement while the target is dragged.

    Attributes:
        dragged_by: the page that drags the target; it follows the desired frame where None does.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot, urdf: str, on_drag: Drag) -> None:
        scene = self._scene = server.scene
        scene.configure_default_lights(cast_shadow=False)  # fast without a GPU, too
        scene.configure_environment_map(hdri=None)
        scene.add_light_ambient("/light", intensity=1.5)
        tree = UrdfTree(urdf)
        root = _root(tree, robot.base_frame)
        self._moving: dict[str, tuple[viser.FrameHandle, Data]] = {}
        self._draw_arm(tree, robot, urdf, root)
        floor = (0.0, 0.0, float(root.p[2]) - 0.002)
        scene.add_grid("/floor", 3.0, 3.0, cell_size=0.25, section_size=1.0, position=floor)
        self._reach, self._floor = robot.length, floor[2]
        camera = server.initial_camera
        camera.position, camera.look_at = self._seen_from((1.3, -1.3, 1.0), (0.25, 0.0, 0.35))
        camera.fov = FIELD_OF_VIEW
        self._tip = scene.add_frame("/tip", axes_length=0.1, axes_radius=0.004)
        self._compliant = scene.add_frame(
            "/compliant", axes_length=0.1, axes_radius=0.003, origin_color=_GIVES, visible=False
        )
        scene.add_label("/compliant/name", "compliant frame", anchor="bottom-center")
        self._gives = scene.add_icosphere(
            "/stiffness", 1.0, color=_GIVES, opacity=0.25, cast_shadow=False, visible=False
        )
        self._wrench = scene.add_arrows(
            "/wrench", np.zeros((1, 2, 3)), _WRENCH, shaft_radius=0.006, head_radius=0.016,
            head_length=0.04, visible=False,
        )  # fmt: skip
        self._force = np.zeros(3)
        self._draw_globe()
        self._target = scene.add_transform_controls("/target", scale=GIZMO, depth_test=False)
        self.dragged_by: int | None = None

        @self._target.on_update
        async def _(event: viser.TransformControlsEvent) -> None:  # in order: on the event loop
            R = np.asarray(viser.transforms.SO3(event.target.wxyz).as_matrix(), dtype=float)
            at = Placement(R, np.array(event.target.position))
            if event.client_id is not None:
                on_drag(event.client_id + 1, event.phase, at)

    def _seen_from(self, *points: tuple[float, float, float]) -> Array:
        """Return points (N, 3) [m] given in reaches of the arm above the floor."""
        return self._reach * np.array(points) + [0.0, 0.0, self._floor]

    def show_to(self, camera: viser.CameraHandle) -> None:
        """Show the arm above the controls where these take the lower part of a narrow window."""
        if camera.aspect < _NARROW:
            camera.position, camera.look_at = self._seen_from((1.9, -2.1, 0.7), (0.3, 0.0, -0.3))

    def _draw_arm(self, tree: UrdfTree, robot: Robot, urdf: str, root: Placement) -> None:
        """Draw each link below the joints that carry it, so that a joint moves all it carries."""
        paths = {tree.root: "/arm"}
        self._scene.add_frame(
            "/arm", show_axes=False, wxyz=wxyz(np.asarray(root.R)), position=np.asarray(root.p)
        )
        joints = {name: joint_data(tree, name, robot.joints) for name in tree.joints}
        while ready := [j for j in joints.values() if j["parent"] in paths]:
            for joint in ready:
                path = f"{paths[joint['parent']]}/{joint['name'].replace('/', '_')}"
                paths[joint["child"]] = path
                place = wxyz(R_rpy(*joint["rpy"])), np.array(joint["xyz"])
                node = self._scene.add_frame(
                    path, show_axes=False, wxyz=place[0], position=place[1]
                )
                if joint["kind"] in MOVING:
                    self._moving[joint["name"]] = node, joint
                del joints[joint["name"]]
        shapes = shapes_of(tree, urdf, _TRIANGLES)
        for number, visual in enumerate(shapes.visuals):
            self._draw(f"{paths[visual['link']]}/visual_{number}", visual, shapes.meshes)

    def _draw(self, name: str, visual: Data, meshes: list[Any]) -> None:
        scene, colour = self._scene, _rgb(visual["colour"])
        scene.add_frame(
            name, show_axes=False, wxyz=wxyz(R_rpy(*visual["rpy"])), position=visual["xyz"]
        )
        name = f"{name}/shape"
        if "mesh" in visual:
            mesh = meshes[visual["mesh"]]
            vertices = mesh.vertices * visual["scale"]
            scene.add_mesh_simple(
                name, vertices, mesh.triangles, color=colour, side="double", flat_shading=True
            )
        elif "box" in visual:
            scene.add_box(name, colour, visual["box"])
        elif "sphere" in visual:
            scene.add_icosphere(name, visual["sphere"][0], color=colour)
        else:
            radius, length = visual.get("cylinder") or visual["capsule"]
            scene.add_cylinder(name, radius, length, color=colour)

    def _draw_globe(self) -> None:
        """Draw the sphere about the tip on which the poles are, and where the tool points."""
        scene = self._scene
        self._globe = scene.add_frame("/globe", show_axes=False, visible=False)
        self._caps = [
            scene.add_icosphere(f"/globe/pole_{n}", 0.014, color=_POLE, cast_shadow=False)
            for n in range(2)
        ]
        self._names = [
            scene.add_label(f"/globe/name_{n}", "", anchor="bottom-center", font_screen_scale=0.9)
            for n in range(2)
        ]
        self._needle = scene.add_arrows(
            "/tip/needle", np.zeros((1, 2, 3)), _TOOL, shaft_radius=0.002, head_radius=0.008,
            head_length=0.02,
        )  # fmt: skip
        scene.add_icosphere(
            "/globe/ball", _GLOBE, color=_TOOL, opacity=0.08, side="back", cast_shadow=False
        )  # its front would hide the ellipsoid; lines would take a second to draw without a GPU
        self._drawn_poles: tuple[str, bool] = "", False

    def update(self, view: View) -> None:
        """Show what is known now."""
        for name, value in view.joints.items():
            if name in self._moving:
                self._move(*self._moving[name], value)
        if view.tip is None:
            return
        p = np.asarray(view.tip.p)
        _place(self._tip, view.tip)
        _place(self._globe, Placement(np.eye(3), p))
        if self.dragged_by is None:
            _place(self._target, view.desired or view.tip)
        self._show_compliance(view, p)
        self._show_force(np.zeros(3) if view.force is None else view.force, p)
        self._show_poles(view)

    def _move(self, node: viser.FrameHandle, joint: Data, value: float) -> None:
        motion = joint_motion(joint["kind"], joint["axis"], value)
        origin = R_rpy(*joint["rpy"])
        _place(node, Placement(origin @ motion.R, joint["xyz"] + origin @ motion.p))

    def _show_force(self, force: Array, p: Array) -> None:
        """Draw the arrow, which ends at the tip; again only if the force has changed."""
        if np.linalg.norm(force - self._force) > _LEAST_FORCE / 2:
            self._force = force
            self._wrench.visible = bool(np.linalg.norm(force) > _LEAST_FORCE)
            ends = [-_PER_NEWTON * force, 0.0 * force]
            self._wrench.points = np.array([ends], dtype=np.float32)
        _place(self._wrench, Placement(np.eye(3), p))

    def _show_compliance(self, view: View, p: Array) -> None:
        c, d = view.compliant, view.desired
        apart = c is not None and d is not None and (
            np.linalg.norm(np.subtract(c.p, d.p)) > _APART[0]
            or np.trace(np.asarray(c.R).T @ d.R) < 1.0 + 2.0 * math.cos(_APART[1])
        )  # fmt: skip
        self._compliant.visible = bool(apart)
        if c is not None and apart:
            _place(self._compliant, c)
        self._gives.visible = view.stiffness is not None
        if view.stiffness is not None:
            longest = min(_PER_STIFFNESS * float(np.linalg.norm(view.stiffness, 2)), _LONGEST)
            drawn = ellipsoid(view.stiffness, longest)
            self._gives.scale = tuple(drawn.radii.tolist())
            _place(self._gives, Placement(drawn.R, p if d is None else d.p))

    def _show_poles(self, view: View) -> None:
        sequence = EulerSequence(str(view.parameters.get("euler_sequence", "XYZ")))
        counts = view.parameters.get("orientation") == "euler_angles"
        if self._drawn_poles == (sequence.name, counts):
            return
        self._drawn_poles, self._globe.visible = (sequence.name, counts), True
        i, _, k = sequence.axes
        tool = _GLOBE * np.eye(3)[k]
        self._needle.points = np.array([[0.0 * tool, tool]], dtype=np.float32)
        pole = _GLOBE * np.eye(3)[i]
        for cap, name, at in zip(self._caps, self._names, (pole, -pole), strict=True):
            cap.position, cap.color = at, _POLE if counts else _IDLE
            name.position, name.text = 1.15 * at, f"pole of {sequence.name}"
            name.visible = counts


def _root(tree: UrdfTree, base: str) -> Placement:
    """Return where the root link is, seen from the base, with the joints between them at 0."""
    R, p = np.eye(3), np.zeros(3)
    for name in tree.chain(tree.root, base):
        joint = joint_data(tree, name, ())
        p, R = p + R @ joint["xyz"], R @ R_rpy(*joint["rpy"])
    return Placement(R, p).inverse if base != tree.root else AT_ORIGIN


def _place(node: viser.SceneNodeHandle, at: Placement) -> None:
    """Place a node, if that is seen."""
    turned = wxyz(np.asarray(at.R))
    if abs(float(turned @ node.wxyz)) < 1.0 - _UNSEEN**2:
        node.wxyz = turned
    if np.abs(np.subtract(at.p, node.position)).max() > _UNSEEN:
        node.position = np.asarray(at.p)


def _rgb(colour: str) -> tuple[int, int, int]:
    return tuple(bytes.fromhex(colour[1:])) if colour else _GREY  # type: ignore[return-value]
