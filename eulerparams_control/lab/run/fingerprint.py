"""Versions of what gave a result: of the code and of files, by their content."""

import ast
import hashlib
import json
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

from eulerparams_control.command_line import executables
from eulerparams_control.parameters.schemes import schemes

_ROOT = Path(__file__).resolve().parents[3]
_PACKAGES = ("eulerparams_control", "sim_bridge")
_PARTS = ("*.py", "analysis/assets/*", "analysis/templates/*")  # of code and pages
_LIBRARIES = ("pin", "pybullet", "numpy")  # what the numbers of a run are calculated with


def digest(content: Any) -> str:
    """Return a hash of content that JSON can hold."""
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def code_of_runs(faulty: bool = False) -> str:
    """Return the version of the code that acts on runs: the nodes, and what they import.

    Args:
        faulty: whether they are runs with faults, in which one more node acts.
    """
    nodes = ["bag_recorder", "pybullet_bridge", "reference", *schemes()]
    nodes += ["fault_injector"] if faulty else []
    return version(imported(executables()[name] for name in nodes))


@cache
def code() -> str:
    """Return the version of all code, and of what it puts into pages."""
    found = {p for name in _PACKAGES for part in _PARTS for p in (_ROOT / name).rglob(part)}
    return version(path for path in found if path.is_file())


def imported(modules: Iterable[str], but: str = "") -> set[Path]:
    """Return the files of these modules and of all our modules that they import, recursively.

    Args:
        modules: their names.
        but: the folder whose files are left out, with what only they import; "" leaves none out.
    """
    found: set[Path] = set()
    pending = list(modules)
    while pending:
        for path in _files(pending.pop()):
            if path not in found and but not in path.relative_to(_ROOT).parts:
                found.add(path)
                pending += _imports(path)
    return found


def _files(module: str) -> Iterator[Path]:
    """Yield the files that importing a module runs: its own, and those of its packages."""
    parts = module.split(".")
    if parts[0] not in _PACKAGES:
        return
    for end in range(1, len(parts) + 1):
        place = _ROOT.joinpath(*parts[:end])
        yield from (p for p in (place / "__init__.py", place.with_suffix(".py")) if p.is_file())


def _imports(path: Path) -> Iterator[str]:
    """Yield the modules that a file imports, wherever in it; names of their content too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


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
