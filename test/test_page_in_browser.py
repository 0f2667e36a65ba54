"""The page in a browser: plots, cursor and replay do what they should, and nothing is loaded."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page
from synthetic_runs import write_run
from tolerances import assert_close

from eulerparams_control.analysis.digest import Digest, Track
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.page import write_page
from eulerparams_control.laws.rotations import EulerParameters
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

pytestmark = pytest.mark.slow

EVIL = "<img src=x onerror=window.hacked=1>"
ARM = load_robot("ur5")
URDF = ARM.urdf.replace(
    '<origin rpy="-1.57079632679 0 0" xyz="0 0.0823 0"/>',  # of the tip: now about all axes
    '<origin rpy="-1.2 0.3 0.7" xyz="0.02 0.0823 0"/>',
).replace(
    '<origin rpy="0.0 0.0 0.0" xyz="0.0 0.0 0.0"/>',  # of the base: now not where the root is
    '<origin rpy="0.4 0.5 0.6" xyz="0.1 0.2 0.3"/>',
)
END = 1.0  # [s] of the runs
STEPS = 101
LAST_FINITE = 60  # step of the run that diverges
PIXEL = 1e-5  # [m] of the replay, which has single precision
SIZE: Any = {"width": 1280, "height": 800}


@cache
def robot() -> Robot:
    return Robot(URDF, ARM.base_frame, ARM.tip_frame, ARM.joints)


def positions(t: np.ndarray) -> np.ndarray:
    return np.array(ARM.home) + np.outer(np.sin(t), [1.0, 0.3, -0.4, 0.5, 0.6, 0.7])


def track(q: np.ndarray) -> Track:
    """Return where everything was: the desired frame ahead of the tip, the compliant between."""
    states = [robot().state(row, np.zeros(6)) for row in np.where(np.isfinite(q), q, 0.0)]
    p, R = np.array([s.p_e for s in states]), np.array([s.R_e for s in states])
    f = np.tile([0.0, 0.0, 20.0], (len(q), 1))
    t = np.linspace(0, END, len(q))
    return Track(t, q, p, R, p + [0.1, 0, 0], R, p + [0.05, 0, 0], R, f, 0.1 * f)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a calm run and of one that leaves all numbers, with a name that is a script."""
    folder = tmp_path_factory.mktemp("page")
    error = np.linspace(0.05, 0.0, STEPS)
    q = positions(np.linspace(0, END, STEPS))
    wild = 0.8 * q
    wild[LAST_FINITE + 1 :] = 1e25
    wild[-1] = np.nan
    runs = []
    for name, values in (("calm", q), (EVIL, wild)):
        path = write_run(folder / name, error, error, speeds=error, parameters={"k_Po": name})
        digest = Digest.of(load(path))
        runs.append(replace(digest, robot=robot(), urdf=URDF, track=track(values)))
    write_page(folder / "page.html", runs, EVIL, EVIL)
    return folder / "page.html"


class Seen:
    """What a page asked for and complained about."""

    def __init__(self, page: Page) -> None:
        self.requests: list[str] = []
        self.errors: list[str] = []
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._hear)

    def _hear(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.errors.append(message.text)


def opened(browser: Browser, file: Path, script: str = "") -> tuple[Page, Seen]:
    page = browser.new_page(viewport=SIZE, color_scheme="light")
    page.set_default_timeout(20_000)
    if script:
        page.add_init_script(script)
    seen = Seen(page)
    page.goto(file.as_uri())
    wait_for(page, "document.documentElement.dataset.ready")
    return page, seen


@pytest.fixture(scope="module")
def one_page(browser: Browser, file: Path) -> tuple[Page, Seen]:
    return opened(browser, file)


@pytest.fixture
def page(one_page: tuple[Page, Seen]) -> Iterator[Page]:
    """Return the page as it was when it was opened."""
    page, seen = one_page
    page.evaluate(
        """() => {
          const {cursor, player} = window.page;
          player.pause();
          cursor.zoom(...cursor.whole);
          cursor.keep(cursor.whole[0]);
          document.querySelectorAll('[data-run][aria-pressed="false"]').forEach(b => b.click());
          scrollTo(0, 0);
        }"""
    )
    page.set_viewport_size(SIZE)
    page.mouse.move(1, 1)
    wait_for_plots(page)
    yield page
    assert seen.errors == []


def wait_for(page: Page, condition: str) -> None:
    """Wait until a condition holds; Playwright's own way is not what the page's policy allows."""
    for _ in range(1000):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(20)
    pytest.fail(f"this never came to be: {condition}")


def wait_for_plots(page: Page) -> None:
    shown = "window.page.plots.filter(p => p.inSight)"
    wait_for(page, f"{shown}.length > 2 && {shown}.every(p => p.line && !p.stale)")


def in_sight(page: Page, expression: str) -> list[Any]:
    """Return something of each plot ``p`` in sight."""
    wait_for_plots(page)
    found = page.evaluate(f"window.page.plots.filter(p => p.inSight).map(p => {expression})")
    assert len(found) >= 3
    return list(found)


def line_times(page: Page) -> list[float]:
    """Return the instants at which the lines of the cursor stand, from where they are drawn."""
    return in_sight(
        page,
        """(() => {
          const axis = p.graph._fullLayout.xaxis;
          const left = p.line.getBoundingClientRect().left + 0.5;
          return axis.p2d(left - p.graph.getBoundingClientRect().left - axis._offset);
        })()""",
    )


def tip(page: Page, run: int = 0) -> list[float]:
    """Return position and quaternion of the tip of the drawn robot, x y z, x y z w."""
    return page.evaluate(
        f"(({{position, quaternion}}) => [...position.toArray(), ...quaternion.toArray()])"
        f"(window.page.replay.runs[{run}].parts.e)"
    )


def coloured(page: Page, condition: str = "a > 0") -> int:
    """Return the number of pixels of the replay on which something is drawn."""
    return page.evaluate(
        """() => new Promise(resolve => {
          const image = new Image();
          image.onload = () => {
            const canvas = document.createElement("canvas");
            [canvas.width, canvas.height] = [image.width, image.height];
            const pen = canvas.getContext("2d");
            pen.drawImage(image, 0, 0);
            const {data} = pen.getImageData(0, 0, image.width, image.height);
            let count = 0;
            for (let i = 0; i < data.length; i += 4) {
              const [r, g, b, a] = data.subarray(i, i + 4);
              if (CONDITION) count++;
            }
            resolve(count);
          };
          image.src = window.page.replay.stage.picture();
        })""".replace("CONDITION", condition)
    )


def tick(page: Page, boxes: str) -> None:
    page.evaluate("boxes => document.querySelectorAll(boxes).forEach(b => b.click())", boxes)


def place_in(page: Page, plot: int, fraction: float) -> Any:
    """Return where a fraction of the time axis of a plot is in the window."""
    return page.evaluate(
        f"""(() => {{
          const {{graph}} = window.page.plots[{plot}];
          const {{xaxis, yaxis}} = graph._fullLayout;
          const box = graph.getBoundingClientRect();
          return [box.left + xaxis._offset + {fraction} * xaxis._length,
                  box.top + yaxis._offset + yaxis._length / 2];
        }})()"""
    )


def point_at(page: Page, plot: int, fraction: float) -> float:
    """Move the pointer into a plot, and return the instant there."""
    page.mouse.move(*place_in(page, plot, fraction), steps=2)
    low, high = page.evaluate(f"window.page.plots[{plot}].graph.layout.xaxis.range")
    return float(low + fraction * (high - low))


def now(page: Page) -> float:
    return float(page.evaluate("window.page.cursor.time"))


def keep(page: Page, time: float) -> None:
    page.evaluate("time => window.page.cursor.keep(time)", time)


# --- it opens offline ------------------------------------------------------------------------
def test_the_page_opens_without_errors_and_asks_for_nothing(one_page, file, page):
    _, seen = one_page
    asked = [url for url in seen.requests if not url.startswith(("data:", "blob:"))]
    assert asked == [file.as_uri()]
    assert all(in_sight(page, "p.graph.querySelectorAll('.scatterlayer path').length > 0"))


def test_text_of_a_bag_is_no_script(page):
    assert page.locator("h1").inner_text() == EVIL
    assert page.locator("[data-run='1']").inner_text() == "<img src…error=window.hacked=1>"
    assert page.locator(".boxes [data-shown='1'] + svg + .name").inner_text() == EVIL
    point_at(page, 0, 0.5)
    hover = page.wait_for_selector(".hoverlayer .legendtext >> nth=1")
    assert hover is not None
    assert EVIL[:12] in (hover.text_content() or "")
    assert page.evaluate("window.hacked") is None
    assert page.locator("img:not(.printed)").count() == 0


# --- one time axis ---------------------------------------------------------------------------
def assert_zoomed(page: Page, start: float, end: float, tolerance: float = 0.01) -> None:
    for shown in in_sight(page, "p.graph.layout.xaxis.range"):
        assert shown == pytest.approx([start, end], abs=tolerance)


def test_zooming_one_plot_moves_all(page):
    start = point_at(page, 0, 0.25)
    page.mouse.down()
    end = point_at(page, 0, 0.5)
    page.mouse.up()
    wait_for(page, "window.page.cursor.range[0] > 0.1")
    assert_zoomed(page, start, end)
    later = page.locator("[data-quantity='singular_value'] .plot")
    later.scroll_into_view_if_needed()  # also those drawn later
    late = "window.page.plots.find(p => p.element.closest('[data-quantity=singular_value]'))"
    wait_for(page, f"!!{late}.line")
    assert_zoomed(page, start, end)
    page.evaluate("scrollTo(0, 0)")
    wait_for_plots(page)
    page.mouse.dblclick(*place_in(page, 0, 0.5))
    wait_for(page, "window.page.cursor.range[0] === 0")
    assert_zoomed(page, 0, END, 1e-6)


def test_pointing_at_a_plot_shows_the_instant_everywhere_and_a_click_keeps_it(page):
    before = tip(page)
    time = point_at(page, 0, 0.6)
    assert line_times(page) == pytest.approx([time] * len(line_times(page)), abs=0.01)
    assert page.locator("#now").inner_text() == f"{now(page):.3f} s"
    assert tip(page) != before
    page.mouse.move(1, 1)  # away: back to the instant that is kept
    wait_for(page, "window.page.cursor.time === 0")
    assert tip(page) == before
    time = point_at(page, 0, 0.4)
    page.mouse.down()
    page.mouse.up()
    page.mouse.move(1, 1)
    assert now(page) == pytest.approx(time, abs=0.01)
    assert line_times(page)[0] == pytest.approx(time, abs=0.01)


# --- the replay ------------------------------------------------------------------------------
@pytest.mark.parametrize("step", [0, 33, 33.5, 100])
def test_the_drawn_robot_is_where_the_arm_was(page, step):
    q = positions(np.linspace(0, END, STEPS))
    state = robot().state((q[math.floor(step)] + q[math.ceil(step)]) / 2, np.zeros(6))
    keep(page, step * END / (STEPS - 1))
    found = np.array(tip(page))
    assert_close(found[:3], state.p_e, PIXEL)
    assert_close(EulerParameters(found[6], found[3:6]).R, state.R_e, PIXEL)


def test_a_run_that_left_all_numbers_rests_at_its_last_finite_pose(page):
    keep(page, LAST_FINITE * END / (STEPS - 1))
    last = tip(page, 1)
    assert np.isfinite(last).all()
    keep(page, END)
    assert tip(page, 1) == pytest.approx(last, abs=PIXEL)


def test_the_replay_shows_meshes_frames_and_the_wrench(page):
    everything = coloured(page)
    assert everything > 20_000
    tick(page, "[data-layer='mu']")  # along the force, in front of it
    magenta = "a > 200 && r > 200 && g < 40 && b > 90 && b < 160"
    assert coloured(page, magenta) > 100
    tick(page, "[data-layer='f']")
    assert coloured(page, magenta) == 0
    tick(page, "[data-layer]:checked")
    bare = coloured(page)
    tick(page, "[data-shown]")
    floor = coloured(page)
    tick(page, "[data-layer], [data-shown]")
    assert bare < everything == coloured(page)
    assert floor < bare - 5_000
    part = "window.page.replay.runs[0].parts"
    for frame, ahead in (("d", 0.1), ("c", 0.05)):
        offset = f"{part}.{frame}.position.clone().sub({part}.e.position).toArray()"
        assert page.evaluate(offset) == pytest.approx([ahead, 0, 0], abs=PIXEL)
    up = page.evaluate(
        f"new {part}.f.position.constructor(0, 1, 0).applyQuaternion({part}.f.quaternion).toArray()"
    )
    assert up == pytest.approx([0, 0, 1], abs=PIXEL)
    length = page.evaluate(f"{part}.f.shaft.scale.y + 0.03")  # with its head
    assert length == pytest.approx(20 * 0.1 / 5)  # 5 N are 10 cm
    assert "5 N = 10 cm" in page.locator("#replay").inner_text()


def test_play_moves_the_robot_until_the_end_and_space_and_arrows_do_as_they_say(page):
    page.select_option("#speed", "4")
    before = tip(page)
    page.click("#play")
    wait_for(page, "window.page.cursor.time > 0.1")
    assert tip(page) != before
    wait_for(page, "!window.page.cursor.playing")
    assert now(page) == END
    assert page.locator("#play").get_attribute("aria-label") == "Play"
    page.select_option("#speed", "0.1")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    wait_for(page, "window.page.cursor.playing")
    assert page.locator("#play").get_attribute("aria-label") == "Pause"
    page.keyboard.press("Space")
    wait_for(page, "!window.page.cursor.playing")
    keep(page, 0.5)
    page.keyboard.press("ArrowRight")
    assert now(page) == pytest.approx(0.505)
    page.keyboard.press("Shift+ArrowLeft")
    assert now(page) == pytest.approx(0.455)
    page.select_option("#speed", "1")


# --- the look --------------------------------------------------------------------------------
def test_a_run_that_is_hidden_is_hidden_everywhere(page):
    page.click("[data-run='0']")
    wait_for(page, "window.page.plots[0].graph.data[0].visible === false")
    visible = in_sight(page, "p.graph.data.map(t => [t.legendgroup, t.visible])")
    assert all(shown == (run != "0") for plot in visible for run, shown in plot)
    drawn = "window.page.replay.runs.map(run => run.group.parent !== null)"
    assert page.evaluate(drawn) == [False, True]
    page.click("[data-run='0']")
    assert page.evaluate(drawn) == [True, True]


def test_on_paper_the_plots_fit_and_are_light_and_the_replay_is_a_picture(page):
    font = "window.page.plots.map(p => p.graph.layout?.font.color)"
    light = page.evaluate(font)[0]
    page.click("#theme")
    wait_for(page, f"{font}[0] !== '{light}'")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    widths = in_sight(page, "p.graph._fullLayout.width")
    colours = page.evaluate(font)
    drawn = page.evaluate("window.page.plots.every(p => p.drawn)")
    picture = page.locator(".printed").get_attribute("src") or ""
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.click("#theme")
    assert drawn
    assert set(colours) == {light}
    assert widths[0] == 680
    assert max(widths[1:]) == 334
    assert picture.startswith("data:image/png;base64,")
    wait_for(page, "window.page.plots[0].graph._fullLayout.width !== 680")


def test_without_webgl_there_is_a_message_and_all_the_rest(browser, file):
    nothing = "HTMLCanvasElement.prototype.getContext = () => null;"
    page, seen = opened(browser, file, nothing)
    assert "does not offer WebGL" in page.locator("#replay .message").inner_text()
    wait_for_plots(page)
    page.keyboard.press("ArrowRight")
    assert now(page) == pytest.approx(0.005)
    assert line_times(page)[0] == pytest.approx(0.005, abs=0.01)
    assert seen.errors == []
    page.close()
