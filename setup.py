"""Build and install eulerparams_control with pip or colcon."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.develop import develop

PACKAGE = "eulerparams_control"
SHARE = f"share/{PACKAGE}"
SCRIPTS = f"$base/lib/{PACKAGE}"
EXECUTABLES = [
    "analyze",
    "bag_recorder",
    "clik",
    "compliance_control",
    "dynamic_control",
    "experiment",
    "fault_injector",
    "identify_tool",
    "impedance_control",
    "live",
    "pybullet_bridge",
    "reference",
    "teleop",
    "watchdog",
]
ANALYSIS = [
    "plotly>=6",
    "matplotlib>=3.6",
    "pyarrow<26",  # 26 needs numpy 2
    "meshcat",
    "rich>=13.7",
    "jinja2>=3.1",
    "pycollada",
]
LIVE = ["viser>=1.1"]
SCRIPT = """#!/bin/sh
# pip puts the entry points into bin, where `ros2 run` does not look; it finds this file.
exec "$(dirname "$0")/../../bin/$(basename "$0")" "$@"
"""


def scripts():
    """Write the scripts that `ros2 run` finds; return their paths."""
    files = [Path("build", "executables", name) for name in EXECUTABLES]
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
        (SHARE, ["package.xml"]),
        (f"{SHARE}/launch", glob("launch/*.launch.py")),
        (f"{SHARE}/config", glob("config/*.yaml")),
        (f"{SHARE}/config/experiments", glob("config/experiments/*.yaml")),
        (f"{SHARE}/config/paper", glob("config/paper/*.yaml")),
        (f"{SHARE}/config/robots", glob("config/robots/*.yaml")),
        (f"{SHARE}/config/robots/real", glob("config/robots/real/*.yaml")),
        (f"{SHARE}/config/views", glob("config/views/*.*")),
        (f"lib/{PACKAGE}", scripts()),
    ],
    python_requires=">=3.12",
    # No more than ROS 2 Jazzy has on Ubuntu 24.04; tools/floor.txt has the oldest that is tested.
    install_requires=[
        "ros-jazzy-rclpy[fastrtps]",
        "ros-jazzy-common-interfaces",
        "pin>=3",
        "numpy>=1.26",
        "numba>=0.59",
        # The module is the same; the name has a wheel, so that nothing is compiled.
        "pybullet-arm64>=3.2.7; sys_platform == 'linux' and platform_machine == 'x86_64' "
        "and python_version < '3.14'",
        "pybullet>=3.2.7; sys_platform != 'linux' or platform_machine != 'x86_64' "
        "or python_version >= '3.14'",
        "example-robot-data",
        "mcap>=1.6",
        "mcap-ros2-support>=0.5",
        "lz4",
        "ruckig>=0.12",
        "zstandard",
        "PyYAML>=6.0.1",
    ],
    extras_require={
        "analysis": ANALYSIS,
        "live": [*LIVE, "pycollada"],
        "cluster": ["distributed"],  # experiment --scheduler
        "all": ANALYSIS + LIVE,
        "test": [
            "distributed",
            "pytest",
            "pytest-xdist",
            "hypothesis",
            "rosbags",
            "playwright",
            "gymnasium",
            "colcon-common-extensions",
        ],
        "dev": [
            "ruff",
            "mypy",
            "pin-pink",
            "quadprog",
            "mkdocs-material",
            "mkdocstrings[python]",
            "sdu_controllers",  # (59), (60) by others
        ],
    },
    zip_safe=False,
    maintainer="eulerparams_control maintainers",
    maintainer_email="maintainers@example.com",
    url="https://example.com/eulerparams_control",
    description="Cartesian control of robot arms with Euler parameters",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [f"{name} = {PACKAGE}.command_line:{name}" for name in EXECUTABLES]
    },
    options=options(),
)
