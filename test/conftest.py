"""Shared by all tests: the environment of ROS, set before anything imports it."""

import contextlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

# The type checks of messages are off in Jazzy: with them a wrong type is an error, not garbage.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

if TYPE_CHECKING:
    from in_process import World
    from playwright.sync_api import Browser
    from ros_processes import Graph

# The same examples in every run, however slow the machine is; `make test` takes the first few.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("quick", settings.get_profile("repeatable"), max_examples=20)
settings.load_profile("repeatable")


@pytest.fixture
def closing() -> Iterator[Callable[[Any], Any]]:
    """Returns what it is given, and closes it after the test."""
    with contextlib.ExitStack() as stack:
        yield lambda made: stack.enter_context(contextlib.closing(made))


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    """Chromium; where it is missing tests are skipped, unless REQUIRE_CHROMIUM is set."""
    from playwright.sync_api import sync_playwright  # only where it is used

    names = ("chromium", "chromium-browser", "google-chrome")
    path = next(filter(None, map(shutil.which, names)), None)
    if path is None:
        (pytest.fail if os.environ.get("REQUIRE_CHROMIUM") else pytest.skip)(
            "no browser was found: apt install chromium"
        )
    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=flags)
        yield chromium
        chromium.close()


@pytest.fixture
def graph(tmp_path: Path) -> "Iterator[Graph]":
    """A ROS domain of its own, with processes, for one test."""
    from ros_processes import Graph  # only where it is used: it needs ROS

    with Graph(tmp_path / "nodes") as own:
        yield own


@pytest.fixture
def world(tmp_path: Path) -> "Iterator[World]":
    """A ROS domain with nodes in this process, for one test."""
    from in_process import World  # only where it is used: it needs ROS

    with World(tmp_path / "nodes") as own:
        yield own


@pytest.fixture(scope="module")
def shared_world(tmp_path_factory: pytest.TempPathFactory) -> "Iterator[World]":
    """A ROS domain with nodes in this process, for all tests of a module."""
    from in_process import World

    with World(tmp_path_factory.mktemp("nodes")) as own:
        yield own
