"""A moving picture of two recorded runs: their page, played in chromium.

    python tools/picture.py out/demo/clik_euler_angles out/demo/clik_euler_parameters docs/pole.webp

Chromium draws without a GPU and without a screen.
"""

import argparse
import io
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from eulerparams_control.analysis.main import main as analyze

SIZE = {"width": 1280, "height": 685}  # [pixels] of the window
WIDE = 960  # [pixels] of the picture
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def pictures(page: Path, times: np.ndarray) -> Iterator[Image.Image]:
    """Yield what a page of runs shows at some times [s]."""
    with sync_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        shown = browser.new_page(viewport=SIZE, color_scheme="light")
        shown.goto(page.as_uri())
        shown.wait_for_selector("html[data-ready]")
        for t in times:
            shown.evaluate("t => { window.page.cursor.keep(t); }", t)
            shown.evaluate("() => new Promise(done => requestAnimationFrame(done))")
            picture = Image.open(io.BytesIO(shown.screenshot())).convert("RGB")
            picture.thumbnail((WIDE, WIDE), Image.Resampling.LANCZOS)
            yield picture
        browser.close()


def main() -> None:
    """Draw the runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bags", nargs=2, metavar="BAG", help="the two runs")
    parser.add_argument("picture", type=Path, help="webp, gif or png, which moves")
    parser.add_argument("--rate", type=float, default=15.0, help="[1/s] of pictures")
    parser.add_argument("--until", type=float, default=4.2, help="[s] of the runs")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        analyze([*given.bags, "--out", str(page)])
        first, *others = pictures(page, np.arange(0.0, given.until, 1.0 / given.rate))
    lasts = [round(1000 / given.rate)] * len(others) + [1200]
    first.save(given.picture, save_all=True, append_images=others, duration=lasts, loop=0,
               quality=70, method=6)  # fmt: skip
    size = given.picture.stat().st_size / 1e6
    print(f"{given.picture}: {1 + len(others)} pictures, {size:.2f} MB")


if __name__ == "__main__":
    main()
