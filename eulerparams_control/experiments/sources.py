"""Versions of what gave a result: of the code and of files, by their content."""

import ast
import hashlib
import json
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from eulerparams_control.experiments.controllers import CONTROLLERS
from eulerparams_control.experiments.processes import module_of

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("eulerparams_control", "sim_bridge")


def digest(content: Any) -> str:
    """Return a number for content that JSON can hold, the same for the same content."""
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def code_of_runs() -> str:
    """Return the version of the code that acts on runs: the nodes, and what they import."""
    names = {name for controller in CONTROLLERS.values() for name in controller.executables}
    nodes = ("bag_recorder", "pybullet_bridge", "reference", *sorted(names))
    return _version(imported(map(module_of, nodes)))


@cache
def code() -> str:
    """Return the version of all code."""
    return _version(path for name in _PACKAGES for path in (_ROOT / name).rglob("*.py"))


def imported(modules: Iterable[str]) -> set[Path]:
    """Return the files of these modules and of all of ours that they import, one by the other."""
    found: set[Path] = set()
    pending = list(modules)
    while pending:
        for path in _files(pending.pop()):
            if path not in found:
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


def _version(files: Iterable[Path]) -> str:
    return digest({
        str(path.relative_to(_ROOT)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    })
