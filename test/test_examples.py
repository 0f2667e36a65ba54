"""The examples, as their users run them: real processes, in real time."""

import subprocess
import sys
from pathlib import Path

import pytest

from eulerparams_control.lab.experiments.processes import Nodes

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
FRAMES = {"base_frame": "base_link", "tip_frame": "tool0"}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_does_what_it_says(example, tmp_path):
    assert len(example.read_text(encoding="utf-8").splitlines()) <= 60
    with Nodes(tmp_path) as nodes:
        nodes.start("pybullet_bridge", {"robot": "ur5", "control": "position"})
        nodes.start("clik", FRAMES)
        command = [sys.executable, example]
        run = subprocess.run(
            command, env=nodes.environment, capture_output=True, text=True, timeout=120, check=False
        )
        assert run.returncode == 0, run.stdout + run.stderr
        assert "the tip" in run.stdout
