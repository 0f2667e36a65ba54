"""The package as pip and colcon install it, and as `ros2 run` looks for it."""

import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import yaml

from eulerparams_control import command_line
from eulerparams_control.analysis.page_assets import SCRIPTS
from eulerparams_control.command_line import EXTRAS, executables, extra_of, package_name

ROOT = Path(__file__).resolve().parents[1]
EXECUTABLES = {
    *("clik", "dynamic_control", "impedance_control", "reference"),
    *("pybullet_bridge", "identify_tool", "fault_injector", "fault_campaign"),
    *("analyze", "bag_recorder", "compile_laws", "experiment", "failure_map", "teleop", "watchdog"),
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


def executables_for_ros2_run(prefix):
    """Return what `ros2 run` finds: executable files of PREFIX/lib/PACKAGE."""
    folder = prefix / "lib" / "eulerparams_control"
    return {file.name for file in folder.iterdir() if os.access(file, os.X_OK)}


def yaml_files(folder):
    return {path.relative_to(folder) for path in folder.rglob("*.yaml")}


def assert_is_installed(prefix):
    share = prefix / "share"
    assert executables_for_ros2_run(prefix) == EXECUTABLES
    assert (share / "ament_index/resource_index/packages/eulerparams_control").is_file()
    assert (share / "eulerparams_control/package.xml").is_file()
    assert yaml_files(share / "eulerparams_control/config") == yaml_files(ROOT / "config")
    installed = {path.name for path in (share / "eulerparams_control/launch").glob("*.py")}
    assert installed == {path.name for path in (ROOT / "launch").glob("*.launch.py")}


@pytest.mark.slow
def test_pip_installs_executables_where_ros2_run_looks(source, tmp_path):
    environment = shutil.copytree(source, tmp_path / "source", symlinks=True)
    # without --ignore-installed pip would take the package out of this environment
    pip = (sys.executable, "-m", "pip", "install", "--ignore-installed", "--no-index")
    options = ("--no-deps", "--no-build-isolation", "--prefix", str(tmp_path / "prefix"))
    run(*pip, *options, ".", cwd=environment)
    prefix = tmp_path / "prefix"
    assert_is_installed(prefix)
    site = next(prefix.glob("lib/python*/site-packages"))
    env = {**os.environ, "PYTHONPATH": str(site), "AMENT_PREFIX_PATH": str(prefix)}
    script = prefix / "lib" / "eulerparams_control" / "experiment"
    assert "demo" in run(str(script), "--list", cwd=tmp_path, env=env)


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
    assert found == {*SCRIPTS, "page.css", "plain.css"}


def python(code, *blocked):
    """Return how a Python ends that runs ``code`` where some packages are not installed."""
    block = "".join(f"sys.modules[{name!r}] = None; " for name in blocked)
    return subprocess.run(
        [sys.executable, "-c", f"import sys; {block}{code}"],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


PACKAGES = {*map(package_name, (*EXTRAS["lab"], *EXTRAS["analysis"])), "distributed", "jinja2"}


def test_the_executables_of_a_robot_need_no_extra():
    modules = [module for name, module in executables().items() if not extra_of(name)]
    result = python(f"import {', '.join(modules)}; print('imported')", *PACKAGES)
    assert "imported" in result.stdout, result.stderr


@pytest.mark.parametrize("name", [name for name in sorted(EXECUTABLES) if extra_of(name)])
def test_an_executable_whose_extra_is_missing_says_so_in_one_line(name):
    with pytest.raises(SystemExit, match="0"):
        getattr(command_line, name)(["--help"])
    code = f"from eulerparams_control.command_line import {name}; sys.exit({name}(['--help']))"
    result = python(code, "rich", "plotly")
    (line,) = result.stderr.splitlines()
    assert f"{name} needs plotly, rich" in line
    assert f"pip install 'eulerparams_control[{extra_of(name)}]'" in line
    assert result.returncode == 2


def test_each_executable_is_an_entry_point_with_a_main():
    points = {
        point.name: point.load()
        for point in entry_points(group="console_scripts")
        if point.dist is not None and point.dist.name.replace("-", "_") == "eulerparams_control"
    }
    assert points.keys() == executables().keys() == EXECUTABLES
    assert all(callable(main) for main in points.values())


def test_no_file_of_the_package_names_a_registry_or_a_path_of_a_machine():
    listed = run("git", "ls-files", cwd=ROOT).split() if (ROOT / ".git").exists() else []
    words = ["py" + "pi.org", "pythonhosted" + ".org", "/ho" + "me/", "/ro" + "ot/"]
    for name in listed:
        text = (ROOT / name).read_text(encoding="utf-8", errors="ignore")
        for word in words:
            assert word not in text, f"{name} names {word}"


def test_what_a_repository_has_agrees_with_the_package():
    version = ET.parse(ROOT / "package.xml").findtext("version")
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert version == cited["version"]
    assert f'version="{version}"' in (ROOT / "setup.py").read_text(encoding="utf-8")
    workflow = yaml.safe_load((ROOT / ".github/workflows/test.yml").read_text(encoding="utf-8"))
    commands = [step["run"] for step in workflow["jobs"]["test"]["steps"] if "run" in step]
    assert commands
    assert all(os.access(ROOT / command, os.X_OK) for command in commands)
    for form in (ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"):
        assert {"name", "description", "body"} == set(yaml.safe_load(form.read_text("utf-8")))
