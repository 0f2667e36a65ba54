"""The package as pip and colcon install it and `ros2 run` looks for it, and its set-up."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from packaging.markers import default_environment
from packaging.requirements import Requirement

from eulerparams_control import command_line
from eulerparams_control.analysis.html import SCRIPTS
from eulerparams_control.command_line import EXTRAS, executables, extra_of

ROOT = Path(__file__).resolve().parents[1]
EXECUTABLES = {
    *("clik", "compliance_control", "dynamic_control", "impedance_control", "reference"),
    *("pybullet_bridge", "identify_tool", "fault_injector"),
    *("analyze", "bag_recorder", "experiment", "live", "teleop"),
    "watchdog",
}
PARTS = (
    *("eulerparams_control", "sim_bridge", "config", "launch"),
    *("resource", "setup.py", "setup.cfg"),
)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Return a copy of what is installed, so that no build touches the working tree."""
    copy = tmp_path_factory.mktemp("source") / "eulerparams_control"
    copy.mkdir()
    for part in (*PARTS, "package.xml"):
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, copy / part, symlinks=True)
        else:
            shutil.copy(ROOT / part, copy / part)
    return copy


def run(*command, cwd, env=None):
    result = subprocess.run(
        command, cwd=cwd, env=env, capture_output=True, text=True, timeout=300, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def files_of(folder):
    return {path.relative_to(folder) for path in folder.rglob("*.*") if path.is_file()}


def assert_is_installed(prefix):
    share, lib = prefix / "share", prefix / "lib" / "eulerparams_control"  # for `ros2 run`
    assert {file.name for file in lib.iterdir() if os.access(file, os.X_OK)} == EXECUTABLES
    assert (share / "ament_index/resource_index/packages/eulerparams_control").is_file()
    assert (share / "eulerparams_control/package.xml").is_file()
    assert files_of(share / "eulerparams_control/config") == files_of(ROOT / "config")
    installed = {path.name for path in (share / "eulerparams_control/launch").glob("*.py")}
    assert installed == {path.name for path in (ROOT / "launch").glob("*.launch.py")}


@pytest.mark.slow
def test_a_wheel_runs_in_an_empty_environment_from_an_empty_folder(source, tmp_path):
    pip, alone = (sys.executable, "-m", "pip"), ("--no-deps", "--no-index")
    copy = shutil.copytree(source, tmp_path / "source", symlinks=True)
    run(*pip, "wheel", *alone, "--no-build-isolation", "-w", str(tmp_path), ".", cwd=copy)
    (wheel,) = tmp_path.glob("*.whl")
    prefix, empty = tmp_path / "venv", tmp_path / "empty"
    run(sys.executable, "-m", "venv", "--without-pip", str(prefix), cwd=tmp_path)
    python = str(prefix / "bin" / "python")
    run(*pip, "--python", python, "install", *alone, str(wheel), cwd=tmp_path)
    site = next(prefix.glob("lib/python*/site-packages"))
    others = sysconfig.get_path("purelib")  # the packages that it needs: not fetched again
    (site / "others.pth").write_text(f"import site; site.addsitedir({others!r})\n")
    assert_is_installed(prefix)
    empty.mkdir()
    env = os.environ | {"AMENT_PREFIX_PATH": f"{prefix}:{sys.prefix}"}
    script = str(prefix / "lib" / "eulerparams_control" / "experiment")  # of `ros2 run`
    assert "demo" in run(script, "--list", cwd=empty, env=env)

    def first(command, *arguments):
        return run(str(prefix / "bin" / command), *arguments, cwd=empty, env=env)

    code = "import eulerparams_control, sim_bridge; print(eulerparams_control.__path__[0])"
    assert first("python", "-c", code).strip() == str(site / "eulerparams_control")
    variant = "clik_euler_parameters"
    first("experiment", "demo", "--variant", variant, "--out", "out")
    assert (empty / "out" / "demo" / "report.html").is_file()
    assert "orientation" in first("analyze", f"out/demo/{variant}")


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--symlink-install",)])
def test_colcon_installs_executables_where_ros2_run_looks(source, tmp_path, options):
    workspace = tmp_path / "workspace"
    shutil.copytree(source, workspace / "src" / "eulerparams_control", symlinks=True)
    env = {key: value for key, value in os.environ.items() if key != "AMENT_PREFIX_PATH"}
    run(sys.executable, "-m", "colcon", "build", *options, cwd=workspace, env=env)
    prefix = workspace / "install" / "eulerparams_control"
    assert_is_installed(prefix)
    assert "demo" in run(
        "bash", "-c", ". install/setup.bash && $0 --list",
        str(prefix / "lib/eulerparams_control/experiment"), cwd=workspace, env=env,
    )  # fmt: skip


def test_setup_installs_executables_and_definitions_where_they_are_looked_for(source, tmp_path):
    commands = "install_data", "-d", str(tmp_path), "build_py", "--build-lib", str(tmp_path)
    run(sys.executable, "setup.py", "-q", *commands, cwd=source)
    assert_is_installed(tmp_path)
    assets = "eulerparams_control/analysis/assets"  # of the pages
    found = {path.name for path in (tmp_path / assets).iterdir()}
    assert found == {*SCRIPTS, "page.css"}
    templates = "eulerparams_control/analysis/templates"
    installed = {path.name for path in (tmp_path / templates).iterdir()}
    assert installed == {path.name for path in (ROOT / templates).iterdir()}


def arguments_of_setup():
    """Return what setup.py gives to setuptools."""
    code = "import json, setuptools; setuptools.setup = lambda **given: print(json.dumps(given))"
    return json.loads(run(sys.executable, "-c", f"{code}; exec(open('setup.py').read())", cwd=ROOT))


def package_name(requirement):
    """Return the package of a requirement, without versions, extras and markers."""
    return re.split(r"[<>=\[; ]", requirement)[0]


def python(code, *blocked):
    """Return how a Python ends that runs ``code`` where some packages are not installed."""
    block = "".join(f"sys.modules[{name!r}] = None; " for name in blocked)
    return subprocess.run(
        [sys.executable, "-c", f"import sys; {block}{code}"],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


PACKAGES = {each for extra in EXTRAS.values() for each in extra} | {"distributed", "collada"}


def test_the_executables_of_a_robot_need_no_extra():
    modules = [module for name, module in executables().items() if not extra_of(name)]
    result = python(f"import {', '.join(modules)}; print('imported')", *PACKAGES)
    assert "imported" in result.stdout, result.stderr


@pytest.mark.parametrize("name", [name for name in sorted(EXECUTABLES) if extra_of(name)])
def test_an_executable_whose_extra_is_missing_says_so_in_one_line(name):
    with pytest.raises(SystemExit, match="0"):
        getattr(command_line, name)(["--help"])
    code = f"from eulerparams_control.command_line import {name}; sys.exit({name}(['--help']))"
    is_page = extra_of(name) == "live"
    result = python(code, *(("collada", "viser") if is_page else ("rich", "plotly")))
    (line,) = result.stderr.splitlines()
    assert f"{name} needs {'viser, pycollada' if is_page else 'plotly, rich'}" in line
    assert f"make setup, or pip install -e '.[{extra_of(name)}]'" in line
    assert result.returncode == 2


@pytest.mark.parametrize("name", ["pybullet_bridge"])
def test_where_the_simulator_is_missing_one_line_says_so(name):
    code = f"from eulerparams_control.command_line import {name}; sys.exit({name}(['--help']))"
    result = python(code, "pybullet")
    (line,) = result.stderr.splitlines()
    assert f"{name} needs PyBullet, the simulator" in line
    assert "the computer of a robot does without it" in line
    assert result.returncode == 2


def test_a_robot_needs_no_simulator():
    result = python(
        "from eulerparams_control.command_line import clik; sys.exit(clik(['--help']))",
        "pybullet", "pybullet_data",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr


def test_setup_lists_what_the_package_has():
    given = arguments_of_setup()
    scripts = given["entry_points"]["console_scripts"]
    names = [line.partition(" = ") for line in scripts]
    assert executables().keys() == EXECUTABLES
    assert {(name, target) for name, _, target in names} == {
        (name, f"eulerparams_control.command_line:{name}") for name in executables()
    }
    extras = {
        extra: {package_name(each) for each in packages}
        for extra, packages in given["extras_require"].items()
    }
    assert {extra: {*packages} for extra, packages in EXTRAS.items()} == {
        extra: extras[extra] for extra in EXTRAS
    }
    assert extras["all"] == {each for packages in EXTRAS.values() for each in packages}


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_pybullet_comes_as_a_wheel_where_there_is_one(machine):
    environment = default_environment() | {"sys_platform": "linux", "platform_machine": machine}
    asked = [
        requirement.name
        for requirement in map(Requirement, arguments_of_setup()["install_requires"])
        if "pybullet" in requirement.name
        and (requirement.marker is None or requirement.marker.evaluate(environment))
    ]
    assert asked == ["pybullet-arm64" if machine == "x86_64" else "pybullet"]


def test_the_version_is_the_same_wherever_it_stands():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"]
    assert ET.parse(ROOT / "package.xml").findtext("version") == cited
    assert arguments_of_setup()["version"] == cited


# --- set-up, with stand-ins for Python and pip -----------------------------------------------
SETUP = ROOT / "tools" / "setup"
PYTHON = """#!/bin/sh
case "$*" in
  *"-m venv"*) for last; do :; done; mkdir -p "$last/bin"
               cp "$0" "$last/bin/python"; cp "$0" "$last/bin/pip"; touch "$last/pyvenv.cfg";;
  *"show -q pybullet"*) exit 1;;
  *"$FAILS"*) exit 1;;
esac
"""
# All that set-up calls beside Python.
TOOLS = ("bash", "sh", "grep", "mkdir", "cp", "rm", "touch", "sleep", "setsid")


@pytest.fixture
def set_up(tmp_path):
    """Return a function that runs set-up where a command with some words fails.

    There is no compiler on its path.
    """
    path = tmp_path / "path"
    path.mkdir()
    for tool in TOOLS:
        (path / tool).symlink_to(shutil.which(tool))
    for name, script in {"python3.12": PYTHON, "uname": '#!/bin/sh\necho "$MACHINE"\n'}.items():
        (path / name).write_text(script, encoding="utf-8")
        (path / name).chmod(0o755)

    def run(fails, part="first", machine="Linux x86_64"):
        env = {"PATH": str(path), "FAILS": fails, "MACHINE": machine}
        return subprocess.run(
            ["bash", SETUP, str(tmp_path / "venv"), part],
            env=env, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False,
        )  # fmt: skip

    return run


@pytest.mark.parametrize("part", ["first", "rest", "floor"])
def test_each_step_says_what_it_does_and_when_it_began(set_up, tmp_path, part):
    for each in ("first", part):
        result = set_up("nothing fails", each)
        assert result.returncode == 0, result.stdout + result.stderr
    says, *steps = result.stdout.splitlines()
    assert re.search(r"\d min on two idle cores", says)
    assert all(re.fullmatch(r" *\d+ s  [a-z].*", line) for line in steps)
    assert steps[-1].endswith("done")
    assert (tmp_path / "venv" / f".{part}").exists()


@pytest.mark.parametrize(
    ("fails", "words"),
    [("--upgrade pip", "pip could not be set up"), ("schemes()", "laws could not be compiled"),
     ("--editable", "the packages could not be installed")],
)  # fmt: skip
def test_a_step_that_fails_ends_it_in_one_line(set_up, tmp_path, fails, words):
    result = set_up(fails)
    (line,) = result.stderr.splitlines()
    assert line.startswith("set-up failed: ")
    assert words in line
    assert result.returncode == 1
    assert not (tmp_path / "venv" / ".first").exists()


def test_where_neither_a_compiler_nor_a_wheel_of_pybullet_is_there_one_line_says_so(set_up):
    result = set_up("nothing fails", machine="Linux aarch64")
    (line,) = result.stderr.splitlines()
    assert "pybullet has no wheel for Linux aarch64" in line
    assert "there is no C++ compiler" in line
    assert result.returncode == 1
