"""Compiled primitives: the same as plain Python, none compiled while an arm moves, their cache."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tolerances import assert_close

from eulerparams_control.laws.jit import cache_folder


def test_schemes_command_the_same_where_nothing_is_compiled_and_compile_nothing(tmp_path):
    def run(name, **environment):
        script, file = Path(__file__).with_name("plain_run.py"), tmp_path / f"{name}.npz"
        subprocess.run([sys.executable, script, file], env=os.environ | environment, check=True)
        return dict(np.load(file))

    plain, compiled = run("plain", NUMBA_DISABLE_JIT="1"), run("compiled")
    assert compiled.pop("compilations") == plain.pop("compilations") == 0
    assert plain.keys() == compiled.keys()
    for name, commands in compiled.items():
        scale = np.abs(commands).max()
        assert_close(plain[name] / scale, commands / scale, 1e-12)


@pytest.mark.slow
def test_without_a_folder_that_can_be_written_primitives_are_compiled_all_the_same(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    code = "import eulerparams_control.laws.rotations"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(file), "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True
    )
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in done.stderr
    assert "once for this version and this machine: 10 s" in done.stderr
    assert list(tmp_path.iterdir()) == [file]  # what was compiled lasts no longer than the process


def test_of_a_folder_for_many_programs_only_what_is_its_own_is_deleted(tmp_path, monkeypatch):
    mine, other = tmp_path / "eulerparams_control" / ("0" * 12), tmp_path / "other"
    for folder in (mine, other):
        (folder / "deep").mkdir(parents=True)
        os.utime(folder, (0, 0))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = Path(cache_folder.__wrapped__())
    assert folder.parent == mine.parent
    assert folder.is_dir()
    assert other.is_dir()
    assert not mine.exists()
