"""The page ``live`` in a browser: what a person does there moves the simulated arm.

It needs chromium (``apt install chromium``); without it the tests are skipped, unless the
environment variable REQUIRE_CHROMIUM is set.
"""

import math
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from playwright.sync_api import Browser, Page
from ros_processes import PATIENCE, Graph, Process, environment, values
from trajectory_msgs.msg import MultiDOFJointTrajectory

from eulerparams_control.events import Event, events_of
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.live.geometry import MARGIN
from eulerparams_control.live.panel import PLOTS_WIDTH
from eulerparams_control.live.scene import FIELD_OF_VIEW, GIZMO
from eulerparams_control.messages.from_ros import ns_from_ros, quaternion_from_ros, vector_from_ros
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

pytestmark = pytest.mark.slow

CONTROLLER = "impedance_control"
SIZE: Any = {"width": 1000, "height": 640}
NARROW: Any = {"width": 400, "height": 640}
FAR = 0.01  # [m] that is no noise
PASSED, LOST = map(math.radians, (0.5, 2.0))  # [rad] at the pole
NOISE = 4e-3  # [m, rad] within which the pose of an arm at rest is measured
ARM = load_robot("ur5")


class Live:
    """The executable, and where the arm is that it started."""

    def __init__(self, graph: Graph, *options: str) -> None:
        self.graph = graph
        self.poses = graph.peer.listen(PoseStamped, f"{CONTROLLER}/pose")
        command = [sys.executable, "-m", "eulerparams_control.live.main", "--port", "0", *options]
        env = environment(graph.folder, graph.domain)
        self.process = Process(command, graph.folder / "live", f"live{len(options)}", env)
        graph.processes.append(self.process)
        graph.until(lambda: self.url or self.process.exit_code is not None, "the URL")
        assert self.url, self.process.log

    @property
    def url(self) -> str:
        ready = [e for e in events_of(self.process.stdout) if e["event"] == Event.READY]
        return str(ready[0]["url"]) if ready else ""

    @property
    def tip(self) -> np.ndarray:
        """Where the tip is now."""
        self.graph.peer.catch_up()
        self.poses.clear()
        self.graph.until(lambda: self.poses, "a pose")
        return vector_from_ros(self.poses[-1].pose.position)

    @property
    def R(self) -> np.ndarray:
        """The orientation of the tip now."""
        assert self.tip is not None
        return np.asarray(quaternion_from_ros(self.poses[-1].pose.orientation).R)

    def turned_by(self, before: np.ndarray) -> float:
        return float(angle_between(before, self.R))

    def until(self, mode: str) -> Any:
        return self.graph.peer.status(CONTROLLER, lambda s: values(s).get("mode") == mode)

    def until_at_rest(self) -> np.ndarray:
        """Return where the tip is, once it has stayed there and does not turn."""
        seen: list[np.ndarray] = []

        def stays() -> bool:
            seen.append(
                np.vstack((self.tip, quaternion_from_ros(self.poses[-1].pose.orientation).R))
            )
            return len(seen) > 20 and float(np.ptp(seen[-20:], axis=0).max()) < NOISE

        self.graph.until(stays, "the arm at rest")
        return seen[-1][0]

    def until_moved(self, before: np.ndarray, by: float = FAR) -> None:
        self.graph.until(lambda: math.dist(self.tip, before) > by, "a motion of the tip")


@pytest.fixture(scope="module")
def open_page(browser: Browser) -> Callable[..., Page]:
    def opened(url: str, **size: Any) -> Page:
        page = browser.new_page(viewport=size or SIZE)
        page.set_default_timeout(1e3 * PATIENCE)
        page.goto(url)
        page.wait_for_selector("canvas[data-engine]")
        return page

    return opened


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    with Graph(tmp_path_factory.mktemp("live")) as graph:
        live = Live(graph)
        live.until("holding")
        yield live
        live.process.stop()


@pytest.fixture(scope="module")
def page(live: Live, open_page: Callable[..., Page]) -> Page:
    page = open_page(live.url)
    page.get_by_text("the arm holds its pose").wait_for()
    return page


def hold(page: Page, live: Live, label: str, until: Callable[[], Any]) -> None:
    """Hold a button until something is so."""
    page.get_by_role("button", name=label).hover()
    page.mouse.down()
    live.graph.until(until, f"what '{label}' does")
    page.mouse.up()


def click(page: Page, label: str) -> None:
    page.get_by_role("button", name=label, exact=True).click()


def choose(page: Page, before: str, name: str) -> None:
    """Choose from the list on a page that shows ``before``."""
    page.locator(f"input[role=combobox][value={before}]:visible").first.click()
    page.get_by_role("option", name=name, exact=True).locator("visible=true").click()


def pixel(page: Page, point: np.ndarray) -> np.ndarray:
    """Return where a point [m] of the base is in the window, seen by the camera of the start."""
    reach = Robot(ARM.urdf, ARM.base_frame, ARM.tip_frame).length
    eye, at = reach * np.array([[1.3, -1.3, 1.0], [0.25, 0.0, 0.35]]) + [0, 0, -0.002]
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(ahead, [0, 0, 1]) / np.linalg.norm(np.cross(ahead, [0, 0, 1]))
    seen = np.array([right, -np.cross(right, ahead), ahead]) @ (point - eye)
    scale = SIZE["height"] / 2 / math.tan(FIELD_OF_VIEW / 2)
    controls = page.get_by_role("button", name="Halt", exact=True).bounding_box()
    assert controls is not None
    middle = np.array([(PLOTS_WIDTH + controls["x"]) / 2, SIZE["height"] / 2])
    return middle + scale * seen[:2] / seen[2]


def test_dragging_the_target_with_the_mouse_moves_the_arm_along_its_arrow(live, page):
    before = live.until_at_rest()
    z = live.R[:, 2]  # of the target: seen from the side
    grip, to = (pixel(page, before + share * GIZMO * z) for share in (0.7, 1.2))

    def dragged() -> bool:
        for share in np.linspace(-0.05, 1.0, 10):
            page.mouse.move(*(grip + max(0.0, share) * (to - grip)))
            page.mouse.down()
        page.mouse.up()
        return math.dist(live.tip, before) > FAR

    live.graph.until(dragged, "a motion of the tip")  # again where the page is too slow to see it
    moved = live.until_at_rest() - before
    assert moved @ z > 0.9 * np.linalg.norm(moved)


def test_jogging_moves_the_arm_while_the_button_is_held_and_no_longer(live, page):
    before = live.until_at_rest()
    hold(page, live, "Hold to jog forwards", lambda: live.tip[0] > before[0] + FAR)
    moved = live.until_at_rest() - before
    assert np.abs(moved[1:]).max() < 0.1 * moved[0]


def test_a_push_displaces_the_tool_and_ends_with_the_button(live, page):
    page.get_by_role("tab", name="Push").click()
    before = live.until_at_rest()
    hold(page, live, "Hold to push", lambda: live.tip[0] > before[0] + FAR)
    after = live.until_at_rest()
    assert math.dist(after, before) < FAR / 2


def test_a_push_that_is_kept_ends_when_its_page_is_closed(live, open_page):
    other = open_page(live.url)
    other.get_by_role("tab", name="Push").click()
    before = live.until_at_rest()
    click(other, "Keep pushing for 30 s")
    live.until_moved(before)
    other.close()
    live.graph.until(lambda: math.dist(live.tip, before) < FAR / 2, "the end of the push")


def test_the_representation_and_the_stiffness_are_those_of_the_node(live, page):
    page.get_by_role("tab", name="Law").click()
    page.locator("input[role=combobox][value=euler_parameters]").click()
    page.get_by_role("option", name="angle_axis").click()
    get = live.graph.peer.get_parameters
    live.graph.until(lambda: get(CONTROLLER, "orientation") == ["angle_axis"], "its change")
    live.graph.peer.set_parameters(CONTROLLER, orientation="euler_angles", K_p=[500.0] * 3)
    page.wait_for_function("[...document.querySelectorAll('input')].some(i => i.value === '500')")
    page.wait_for_function(
        "[...document.querySelectorAll('input')].some(i => i.value === 'euler_angles')"
    )


def test_euler_parameters_pass_the_pole_where_euler_angles_lose_the_tool(live, page):
    peer = live.graph.peer
    aims = peer.listen(MultiDOFJointTrajectory, f"{CONTROLLER}/desired")
    tools = peer.listen(PoseStamped, f"{CONTROLLER}/pose")

    def turn(label: str) -> float:
        """Return the largest error [rad] of the tool on the way."""
        live.until_at_rest()
        before = live.R
        aims.clear()
        tools.clear()
        click(page, label)
        live.graph.until(lambda: live.turned_by(before) > MARGIN / 10, f"what '{label}' does")
        live.until_at_rest()
        at = {ns_from_ros(msg.header.stamp): msg.pose.orientation for msg in tools}
        wanted = {ns_from_ros(msg.header.stamp): msg.points[0].transforms[0] for msg in aims}
        errors = [
            angle_between(quaternion_from_ros(wanted[t].rotation).R, quaternion_from_ros(at[t]).R)
            for t in at.keys() & wanted
        ]
        return float(max(errors))

    page.get_by_role("tab", name="Move").click()
    assert peer.set_parameters(CONTROLLER, orientation="euler_parameters") == []
    turn("Go next to the pole")
    before = live.R
    assert turn("Through the pole") < PASSED
    assert live.turned_by(before) == pytest.approx(2 * MARGIN, abs=NOISE)
    assert peer.set_parameters(CONTROLLER, orientation="euler_angles") == []
    assert any(turn("Through the pole") > LOST for _ in range(8))  # some pass by luck
    assert peer.set_parameters(CONTROLLER, orientation="euler_parameters") == []
    click(page, "Halt")
    live.until("stopped")
    live.until_at_rest()
    click(page, "Resume")
    live.until("holding")


def test_a_page_names_its_button_after_a_halt_and_its_legends_have_no_values(live, page):
    click(page, "Halt")
    page.get_by_text("What to do: press Resume").wait_for()
    assert "--" not in page.locator(".u-legend", has_text="desired to tool").first.inner_text()
    live.until_at_rest()  # an arm that still moves is not resumed
    click(page, "Resume")
    live.until("holding")


def test_a_halt_stops_the_arm_until_it_is_resumed(live, page):
    before = live.until_at_rest()
    click(page, "Back to the start")
    live.until_moved(before, FAR / 10)
    click(page, "Halt")
    live.until("stopped")
    page.get_by_text("Cause: halt").wait_for()
    halted = live.until_at_rest()
    click(page, "Back to the start")
    page.get_by_text("Not taken").first.wait_for()
    assert math.dist(live.until_at_rest(), halted) < NOISE
    click(page, "Resume")
    live.until("holding")  # it may have come to the start before it was halted
    hold(page, live, "Hold to jog backwards", lambda: math.dist(live.tip, halted) > FAR / 10)


def test_two_pages_do_not_fight_and_a_narrow_one_has_all_controls(live, page, open_page):
    other = open_page(live.url, **NARROW)
    page.get_by_text("2 pages are open").wait_for()
    before = live.until_at_rest()
    page.get_by_role("button", name="Hold to jog backwards").hover()
    page.mouse.down()
    live.until_moved(before)
    click(other, "Back to the start")
    other.get_by_text("moves the arm.").last.wait_for()
    box = other.locator(".mantine-NumberInput-root:visible").first.bounding_box()
    assert box["width"] > 55  # pixels: six digits
    choose(other, "x", "y")
    page.get_by_text("was changed on a page").first.wait_for()
    moved = live.until_at_rest() - before
    assert np.abs(moved[1:]).max() < 0.1 * abs(moved[0])
    page.mouse.up()
    choose(other, "y", "x")
    other.close()


def test_a_node_that_is_gone_is_said_and_ctrl_c_ends_all(live, page):  # the last: it ends all
    children = Path(f"/proc/{live.process._child.pid}/task/{live.process._child.pid}/children")
    robot, law = map(int, children.read_text().split())
    os.kill(robot, signal.SIGKILL)
    page.get_by_text(re.compile("pybullet_bridge died")).wait_for()
    assert live.process.stop() == 0
    live.graph.until(lambda: not Path(f"/proc/{law}").exists(), "the end of the law")
