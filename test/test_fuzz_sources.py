"""No source runs what comes from outside: no pickle, no eval, no shell, YAML as plain data only."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted(
    path
    for folder in ("eulerparams_control", "sim_bridge", "benchmarks", "launch", "tools")
    for path in ROOT.glob(f"{folder}/**/*.py")
) + [ROOT / "setup.py"]

FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "marshal", "shelve", "xmlrpc", "telnetlib"}
FORBIDDEN_CALLS = {
    *("eval", "exec", "compile", "__import__"),
    *("os.system", "os.popen", "tempfile.mktemp"),
    *("yaml.load", "yaml.load_all", "yaml.unsafe_load", "yaml.full_load"),
    *("np.load", "numpy.load"),  # unless allow_pickle is False
}
UNSAFE_LOADERS = {"Loader", "UnsafeLoader", "FullLoader", "CLoader", "CUnsafeLoader", "CFullLoader"}


def dotted(node: ast.expr) -> str:
    """Return the name that an expression is, ``a.b.c``; "" if it is none."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}".lstrip(".")
    return ""


def is_constant(call: ast.Call, keyword: str, value: object) -> bool:
    """Return whether a keyword of a call is this constant."""
    found = [word.value for word in call.keywords if word.arg == keyword]
    return bool(found) and isinstance(found[0], ast.Constant) and found[0].value is value


def sins_of_call(call: ast.Call) -> Iterator[str]:
    name = dotted(call.func)
    is_load = name.endswith("np.load") or name == "numpy.load"
    if name in FORBIDDEN_CALLS and not (is_load and is_constant(call, "allow_pickle", False)):
        yield f"{name}()"
    if any(word.arg == "shell" for word in call.keywords) and not is_constant(call, "shell", False):
        yield f"{name}(shell=...)"
    if name.rpartition(".")[2] in ("extractall", "unpack_archive"):
        yield f"{name}()"


def sins(text: str) -> list[str]:
    """Return what a source must not do, each with its line."""
    found = []
    for node in ast.walk(ast.parse(text)):
        line = getattr(node, "lineno", 0)
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [str(node.module)]
            found += [
                f"{line}: {alias.name}"
                for alias in node.names
                if f"{node.module}.{alias.name}" in FORBIDDEN_CALLS
            ]
        elif isinstance(node, ast.Call):
            found += [f"{line}: {sin}" for sin in sins_of_call(node)]
        elif isinstance(node, ast.Attribute) and dotted(node).startswith("yaml."):
            found += [f"{line}: {dotted(node)}"] if node.attr in UNSAFE_LOADERS else []
        forbidden = (n for n in names if n.partition(".")[0] in FORBIDDEN_MODULES)
        found += [f"{line}: import {name}" for name in forbidden]
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_source_runs_what_it_reads(path: Path) -> None:
    assert sins(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "from pickle import loads",
        "import os\nos.system('ls')",
        "eval('1')",
        "import yaml\nyaml.load(text, Loader=yaml.SafeLoader)",
        "import yaml\nclass L(yaml.UnsafeLoader): pass",
        "from yaml import unsafe_load",
        "from os import system",
        "import subprocess\nsubprocess.run(a, shell=True)",
        "import subprocess\nsubprocess.run(a, shell=b)",
        "import tempfile\ntempfile.mktemp()",
        "import numpy as np\nnp.load(f)",
        "import tarfile\ntarfile.open(f).extractall(g)",
        "import shutil\nshutil.unpack_archive(f)",
        "__import__('os')",
    ],
)
def test_what_must_not_be_is_found(text: str) -> None:
    assert len(sins(text)) == 1


@pytest.mark.parametrize(
    "text",
    [
        "import yaml\nyaml.safe_load(text)",
        "import re\nre.compile('a')",
        "import subprocess\nsubprocess.run(a, shell=False)",
        "import numpy as np\nnp.load(f, allow_pickle=False)",
        "def evaluate(x): return x\nevaluate(1)",
        "import tempfile\ntempfile.TemporaryDirectory()",
    ],
)
def test_what_may_be_is_left_alone(text: str) -> None:
    assert sins(text) == []
