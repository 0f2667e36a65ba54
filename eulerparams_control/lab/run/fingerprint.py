"""Versions of what gave a result: of the code and of files, by their content."""

import hashlib
import json
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[3]
_PACKAGES = ("eulerparams_control", "sim_bridge")
_PARTS = ("*.py", "analysis/assets/*", "analysis/templates/*")  # of code and pages
_BESIDE = {"analysis", "live", "lab"}  # the rooms that no node of a run needs
_IN_RUNS = ("lab/as_shipped", "lab/operator_node.py")  # but these that are in them
_LIBRARIES = ("pin", "pybullet", "pybullet-arm64", "numpy")  # what calculates the numbers of a run


def digest(content: Any) -> str:
    """Return a hash of content that JSON can hold."""
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def code_of_runs(faulty: bool = False) -> str:
    """Return the version of the code that acts on runs: that of the nodes.

    Args:
        faulty: whether they are runs with faults, in which one more node acts.
    """
    of_faults = ["lab/faults.py", "lab/fault_injector_node.py"] if faulty else []
    beside = {_ROOT / _PACKAGES[0] / path for path in (*_IN_RUNS, *of_faults)}
    return version(
        path
        for path in _files("*.py")
        if not _BESIDE & {*path.relative_to(_ROOT).parts} or beside & {path, path.parent}
    )


@cache
def code() -> str:
    """Return the version of all code, and of what it puts into pages."""
    return version(path for part in _PARTS for path in _files(part))


def _files(pattern: str) -> Iterator[Path]:
    for name in _PACKAGES:
        yield from (path for path in sorted((_ROOT / name).rglob(pattern)) if path.is_file())


def version(files: Iterable[Path]) -> str:
    """Return a hash of the content of our files, and of the versions of the libraries in use."""
    contents = {
        str(path.relative_to(_ROOT)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }
    return digest([contents, {name: _installed(name) for name in _LIBRARIES}])


def _installed(library: str) -> str:
    try:
        return version_of(library)
    except PackageNotFoundError:
        return ""
