"""What all tests share: the environment of ROS, set before anything imports it."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

# The type checks of messages are off in Jazzy: with them a wrong type is an error, not garbage.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

if TYPE_CHECKING:
    from in_process import World
    from ros_processes import Graph

# The same examples in every run, however slow the machine is; `make test` takes the first few.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("quick", settings.get_profile("repeatable"), max_examples=20)
settings.load_profile("repeatable")


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
