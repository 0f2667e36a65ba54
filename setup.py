"""Build and install eulerparams_control with pip or colcon."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "eulerparams_control"
EXECUTABLES = {
    "clik": "eulerparams_control.ros.clik_node",
    "dynamic_control": "eulerparams_control.ros.dynamic_control_node",
    "impedance_control": "eulerparams_control.ros.impedance_control_node",
    "reference": "eulerparams_control.ros.reference_node",
    "identify_tool": "eulerparams_control.tool.identify_tool_node",
    "fault_injector": "eulerparams_control.lab.faults.fault_injector_node",
    "pybullet_bridge": "sim_bridge.bridge_node",
    "bag_recorder": "eulerparams_control.bags.recorder",
    "experiment": "eulerparams_control.lab.experiments.main",
    "analyze": "eulerparams_control.analysis.main",
    "fault_campaign": "eulerparams_control.lab.campaign.main",
    "failure_map": "eulerparams_control.lab.maps.main",
}


def config_files():
    """Return the folder config as data files, subfolders kept."""
    folders = sorted({str(Path(file).parent) for file in glob("config/**/*.yaml", recursive=True)})
    return [(f"share/{PACKAGE}/{folder}", sorted(glob(f"{folder}/*.yaml"))) for folder in folders]


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[f"{PACKAGE}*", "sim_bridge*"]),
    package_data={PACKAGE: ["analysis/assets/*.css", "analysis/assets/*.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        # `ros2 run` looks here; pip puts entry points into bin instead
        (f"lib/{PACKAGE}", sorted(glob("resource/executables/*"))),
        *config_files(),
    ],
    python_requires=">=3.12",
    install_requires=[
        "setuptools",
        "ros-jazzy-rclpy[fastrtps]",
        "ros-jazzy-common-interfaces",
        "pin>=4.1",
        "numpy",
        "pybullet>=3.2.7",
        "mcap>=1.6",
        "mcap-ros2-support>=0.5",
        "lz4",
        "zstandard",
        "PyYAML",
        "example-robot-data",
        "plotly>=6",
        "meshcat",
        "matplotlib",
        "pyarrow",
        "dask[distributed]",
        "rich",
    ],
    extras_require={
        "test": ["pytest", "pytest-xdist", "hypothesis", "rosbags", "playwright"]
        + ["colcon-common-extensions"],
        "dev": ["ruff", "mypy", "pin-pink", "quadprog"],
    },
    zip_safe=False,
    maintainer="eulerparams_control maintainers",
    maintainer_email="maintainers@example.com",
    description="Cartesian control of robot arms with Euler parameters",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [f"{name} = {module}:main" for name, module in EXECUTABLES.items()]
    },
)
