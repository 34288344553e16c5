"""One ament_python package; with plain pip the extras bring ROS 2, the tests' tools and speed."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "sma_actuator"

setup(
    name=NAME,
    version=re.search(r'__version__ = "(.+)"', Path("sma_actuator/__init__.py").read_text())[1],
    packages=find_packages(include=["sma_actuator", "sma_actuator.*", "sma_msgs_py", "sma_msgs_py.*"]),
    package_data={"sma_actuator": ["**/*.yaml", "**/*.html", "**/*.js", "view/page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (
            f"share/{NAME}/config",
            [str(path) for ending in ("yaml", "npz", "xml") for path in Path("config").glob(f"*.{ending}")],
        ),
        (
            f"share/{NAME}/hook",
            ["resource/hook/path.dsv"],
        ),  # colcon.pkg names it: `sma-actuator` is found after setup.bash
        (f"share/{NAME}/layouts", [str(path) for path in Path("layouts").iterdir()]),
        (f"share/{NAME}/launch", [str(path) for path in Path("launch").glob("*.py")]),
        (f"share/{NAME}/urdf", [str(path) for path in Path("urdf").iterdir()]),
    ],
    python_requires=">=3.11",
    install_requires=[
        "numpy>=1.26",
        "scipy>=1.11",
        "PyYAML>=6.0",
        "PyVISA>=1.13",
        "PyVISA-py>=0.7",
        "pyserial>=3.5",
        "rich>=13",
        "joblib>=1.3",
        "threadpoolctl>=3.0",
    ],
    extras_require={
        # The wheels of ROS 2 Jazzy; leave out where ROS 2 is sourced.
        "ros": ["ros-jazzy-rclpy[fastrtps]==7.1.6", "ros-jazzy-common-interfaces==5.3.6"],
        "speed": ["numba>=0.59"],
        "view": ["aiohttp>=3.9"],
        "foxglove": ["foxglove-sdk>=0.30,<1"],
        "report": ["matplotlib>=3.6", "Jinja2>=3.1"],
        "bags": ["rosbags>=0.10"],
        # Logs in Excel, Parquet, TDMS and HDF5; MATLAB's are read by SciPy.
        "formats": ["openpyxl>=3.1", "pyarrow>=14", "npTDMS>=1.7", "h5py>=3.8"],
        "completion": ["argcomplete>=3.0"],
        "baselines": ["scikit-learn>=1.3"],
        # Many wires at once: a table, logs behind URLs, a cluster; s3fs, gcsfs … bring the kinds of URLs.
        "fleet": ["distributed>=2024.1", "fsspec>=2024.2", "pyarrow>=14"],
        # Instruments over USB and GPIB; serial lines and the network need nothing more.
        "usb": ["pyusb>=1.2"],
        "gpib": ["gpib-ctypes>=0.3"],
        "pymeasure": ["PyMeasure>=0.14"],
        # DAQs by their makers' packages; each wants a library of the maker's beside it.
        "nidaqmx": ["nidaqmx>=1.0,<2"],
        "labjack": ["labjack-ljm>=1.23,<2"],
        "check": ["ruff>=0.17,<0.18", "mypy>=1.11", "import-linter>=2.0"],
        "docs": ["sphinx>=8.2", "myst-parser>=4.0", "sphinx-rtd-theme>=3.0"],
        "fuzz": ["atheris>=3,<4"],
        "mutants": ["cosmic-ray>=8.4", "coverage>=7.4"],
        "test": [
            "pytest>=7.4",
            "hypothesis>=6.82",
            "simple-pid==2.0.1",
            "colcon-common-extensions>=0.3",
            "pytest-timeout>=2.2",
            "pytest-cov>=5.0",
            "pytest-xdist>=3.5",
            "moto[server]>=5.0",
            "s3fs>=2024.2",
            "xacro>=2.0",
            "nidaqmx>=1.0,<2",
            "labjack-ljm>=1.23,<2",
            # Instruments that others wrote; more of them in tests/counterparts/requirements.txt.
            "lewis>=1.4,<2",
            "pyvisa-sim>=0.7,<1",
            "SCPI-Instrument-Control>=7.3,<8",
        ],
    },
    entry_points={
        "console_scripts": [
            "sma-actuator = sma_actuator.__main__:main",
            "sma_actuator_node = sma_actuator.__main__:node",
        ],
    },
    zip_safe=True,
    maintainer="sma_actuator developers",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    description="ROS 2 driver for shape memory alloy wire actuators that sense their own position",
    license="Apache-2.0",
)
