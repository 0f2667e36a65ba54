"""Build and install eulerparams_control with pip or colcon."""

import os
from glob import glob
from pathlib import Path
from runpy import run_path

from setuptools import find_packages, setup
from setuptools.command.develop import develop

PACKAGE = "eulerparams_control"
SCRIPTS = f"$base/lib/{PACKAGE}"
SCRIPT = """#!/bin/sh
# pip puts the entry points into bin, where `ros2 run` does not look; it finds this file.
exec "$(dirname "$0")/../../bin/$(basename "$0")" "$@"
"""

command_line = run_path(f"{PACKAGE}/command_line.py")
extras = {name: list(packages) for name, packages in command_line["EXTRAS"].items()}


def config_files():
    """Return the folders config, subfolders kept, and launch as data files."""
    every = filter(os.path.isfile, glob("config/**/*.*", recursive=True))
    folders = sorted({str(Path(file).parent) for file in every})
    files = {folder: sorted(filter(os.path.isfile, glob(f"{folder}/*.*"))) for folder in folders}
    files["launch"] = sorted(glob("launch/*.launch.py"))
    return [(f"share/{PACKAGE}/{folder}", names) for folder, names in files.items()]


def scripts():
    """Write the scripts that `ros2 run` finds; return their paths."""
    files = [Path("build", "executables", name) for name in command_line["executables"]()]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(SCRIPT, encoding="utf-8")
        file.chmod(0o755)
    return [str(file) for file in files]


def options():
    """Return where scripts go under colcon; `develop` of newer setuptools has no such option."""
    found = {"install": {"install_scripts": SCRIPTS}}
    if any(option.startswith("script-dir") for option, *_ in develop.user_options):
        found["develop"] = {"script_dir": SCRIPTS}
    return found


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[f"{PACKAGE}*", "sim_bridge*"]),
    package_data={f"{PACKAGE}.analysis": ["assets/*.css", "assets/*.js", "templates/*.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"lib/{PACKAGE}", scripts()),
        *config_files(),
    ],
    python_requires=">=3.12",
    install_requires=[
        "ros-jazzy-rclpy[fastrtps]",
        "ros-jazzy-common-interfaces",
        "pin>=4.1",
        "numpy>=2.2",
        "numba>=0.61",
        "pybullet>=3.2.7",
        "example-robot-data",
        "mcap>=1.6",
        "mcap-ros2-support>=0.5",
        "lz4",
        "ruckig>=0.12",
        "zstandard",
        "PyYAML",
    ],
    extras_require={
        **extras,
        "all": sorted({package for packages in extras.values() for package in packages}),
        "test": [
            *("pytest", "pytest-xdist", "hypothesis", "rosbags", "playwright", "gymnasium"),
            "colcon-common-extensions",
        ],
        "dev": [
            *("ruff", "mypy", "pin-pink", "quadprog", "mkdocs-material", "mkdocstrings[python]"),
            "sdu_controllers",  # (59), (60) by others
        ],
    },
    zip_safe=False,
    maintainer="eulerparams_control maintainers",
    maintainer_email="maintainers@example.com",
    description="Cartesian control of robot arms with Euler parameters",
    license="Apache-2.0",
    entry_points={"console_scripts": command_line["entry_points"]()},
    options=options(),
)
