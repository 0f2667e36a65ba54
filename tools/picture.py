"""A moving picture of two recorded runs: the arms above, their orientation errors below.

    python tools/picture.py out/demo/clik_euler_angles out/demo/clik_euler_parameters docs/pole.webp

The arms are drawn by PyBullet's TinyRenderer, which needs no GPU and no screen.
"""

import argparse
import re
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pybullet
from PIL import Image, ImageColor, ImageDraw, ImageFont

from eulerparams_control import analysis
from eulerparams_control.analysis.drawn_robot import find_mesh, mesh_folders
from eulerparams_control.laws.rotations import Array

WIDE, HIGH, HEAD, PLOT = 420, 330, 58, 116  # [pixels] of an arm, of the words above, of a plot
SCALE = 2  # each picture is drawn larger and then made smaller: smooth edges
PAPER, INK, GREY, GRID = "#f6f7f9", "#1d1f24", "#5b6472", "#d9dde3"
BODY = 0.55, 0.64, 0.76, 1.0
LINES = ("#c0392b", "#1f7a4d")
AXES = ("#d62728", "#2ca02c", "#1f77b4")
MOST = 180.0  # [deg] of the plot


class View(NamedTuple):
    """Where the arms are seen from."""

    view: list[float]
    projection: list[float]

    def pixels(self, points: Array) -> list[tuple[float, float]]:
        """Return where points (N, 3) [m] are in the picture."""
        both = np.reshape(self.projection, (4, 4)).T @ np.reshape(self.view, (4, 4)).T
        x, y, _, w = both @ np.c_[points, np.ones(len(points))].T
        size = WIDE * SCALE / 2, HIGH * SCALE / 2
        return list(zip(size[0] * (1 + x / w), size[1] * (1 - y / w), strict=True))


def seen_from(eye: list[float], at: list[float]) -> View:
    """Return the view of a camera [m]."""
    view = pybullet.computeViewMatrix(eye, at, [0.0, 0.0, 1.0])
    return View(view, pybullet.computeProjectionMatrixFOV(40.0, WIDE / HIGH, 0.05, 10.0))


def font(size: int) -> ImageFont.FreeTypeFont:
    """Return the font that comes with matplotlib."""
    from matplotlib import get_data_path

    return ImageFont.truetype(Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), size * SCALE)


class Arm:
    """The arm of a run, posed and drawn."""

    def __init__(self, run: analysis.Recording, title: str) -> None:
        self.run, self.title, series = run, title, run.measured
        self.t, self.q, self.desired = series.t, series.q, series.desired
        self.p, self.R = series.p_e, series.R_e
        self.error = np.degrees(series.orientation_error)
        self._client = pybullet.connect(pybullet.DIRECT)
        folders = mesh_folders(run.urdf)
        urdf = re.sub(r'(?<=filename=")[^"]*', lambda m: str(find_mesh(m[0], folders)), run.urdf)
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(urdf)
            file.flush()
            options = {"useFixedBase": True, "physicsClientId": self._client}
            self._body = pybullet.loadURDF(file.name, **options)
        count = pybullet.getNumJoints(self._body, self._client)
        infos = (pybullet.getJointInfo(self._body, i, self._client) for i in range(count))
        index = {info[1].decode(): info[0] for info in infos}
        for link in range(-1, count):
            pybullet.changeVisualShape(
                self._body, link, rgbaColor=BODY, physicsClientId=self._client
            )
        self._joints = [index[name] for name in run.robot.joints]

    def row(self, t: float) -> int:
        """Return which row of the run is at t [s]."""
        return min(int(np.searchsorted(self.t, t)), len(self.t) - 1)

    def draw(self, view: View, t: float) -> Image.Image:
        """Return the arm at t [s], the frame that it has to follow, and where its tip has been."""
        i = self.row(t)
        for joint, q in zip(self._joints, self.q[i], strict=True):
            pybullet.resetJointState(self._body, joint, q, physicsClientId=self._client)
        wide, high, rgb, _, body = pybullet.getCameraImage(
            WIDE * SCALE, HIGH * SCALE, view.view, view.projection, [1.0, -1.0, 2.0],
            shadow=0, renderer=pybullet.ER_TINY_RENDERER, physicsClientId=self._client,
        )  # fmt: skip
        pixels = np.reshape(rgb, (high, wide, 4))[:, :, :3].astype(np.uint8)
        pixels[np.reshape(body, (high, wide)) < 0] = ImageColor.getrgb(PAPER)
        picture = Image.fromarray(pixels)
        pen = ImageDraw.Draw(picture)
        pen.line(view.pixels(self.p[: i + 1 : 20]), "#f0a500", 2 * SCALE)
        desired, tip = (self.desired.p[i], self.desired.R[i]), (self.p[i], self.R[i])
        for (p, R), length, width in ((desired, 0.16, 5), (tip, 0.11, 2)):
            for axis, colour in zip(R.T, AXES, strict=True):
                pen.line(view.pixels(np.array([p, p + length * axis])), colour, width * SCALE)
        return picture

    def plot(self, pen: ImageDraw.ImageDraw, corner: tuple[int, int], t: float, ink: str) -> None:
        """Draw the error until t [s] at a corner, over time."""
        left, top = corner[0] + 62 * SCALE, corner[1] + 6 * SCALE
        wide, high = (WIDE - 82) * SCALE, (PLOT - 40) * SCALE
        for mark in (0.0, MOST / 2, MOST):
            y = top + high * (1 - mark / MOST)
            pen.line([(left, y), (left + wide, y)], GRID, SCALE)
            pen.text((left - 6 * SCALE, y), f"{mark:.0f} deg", GREY, font(11), anchor="rm")
        rows = np.arange(0, self.row(t) + 1, 5)
        x, y = self.t[rows] / self.t[-1], 1 - self.error[rows] / MOST
        pen.line(list(zip(left + wide * x, top + high * y, strict=True)), ink, 2 * SCALE)
        error = self.error[self.row(t)]
        said = "below 0.001" if error < 1e-3 else f"{error:.0f}"
        pen.text((left, top + high + 8 * SCALE), f"orientation error: {said} deg", ink, font(14))


def frame(arms: list[Arm], view: View, t: float) -> Image.Image:
    """Return the picture at t [s]."""
    size = len(arms) * WIDE * SCALE, (HEAD + HIGH + PLOT) * SCALE
    picture = Image.new("RGB", size, PAPER)
    for column, (arm, colour) in enumerate(zip(arms, LINES, strict=False)):
        x = column * WIDE * SCALE
        picture.paste(arm.draw(view, t), (x, HEAD * SCALE))
        pen = ImageDraw.Draw(picture)
        pen.text((x + 16 * SCALE, 10 * SCALE), arm.title, INK, font(17))
        distance = np.degrees(arm.run.pole_distance[arm.row(t)])
        said = f"{distance:.0f} deg from the pole of {arm.run.sequence.name}; thick axes: desired"
        pen.text((x + 16 * SCALE, 36 * SCALE), said, GREY, font(12))
        arm.plot(pen, (x, (HEAD + HIGH) * SCALE), t, colour)
    return picture.resize((size[0] // SCALE, size[1] // SCALE), Image.Resampling.LANCZOS)


def main() -> None:
    """Draw the runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bags", nargs=2, type=Path, metavar="BAG", help="left and right")
    parser.add_argument("picture", type=Path, help="webp, gif or png, which moves")
    parser.add_argument("--rate", type=float, default=15.0, help="[1/s] of pictures")
    parser.add_argument("--until", type=float, default=4.2, help="[s] of the runs")
    given = parser.parse_args()
    titles = {"euler_angles": "Euler angles", "euler_parameters": "Euler parameters"}
    runs = [analysis.load(bag) for bag in given.bags]
    arms = [Arm(run, titles[run.parameter("orientation")]) for run in runs]
    view = seen_from([1.6, -1.1, 0.9], [0.05, 0.0, 0.36])
    times = np.arange(0.0, given.until, 1.0 / given.rate)
    pictures = [frame(arms, view, t) for t in times]
    each = round(1000 / given.rate)
    lasts = [each] * (len(pictures) - 1) + [1200]
    pictures[0].save(given.picture, save_all=True, append_images=pictures[1:], duration=lasts,
                     loop=0, quality=70, method=6)  # fmt: skip
    print(f"{given.picture}: {len(pictures)} pictures, {given.picture.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
