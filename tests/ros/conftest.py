"""Real processes: benches and nodes under test, and a ROS 2 client in this one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import Bench, Client, NodeProcess, parameter_file
from waiting import PATIENT_NODE

from sma_actuator.config import read_parameter_file

ROOT = Path(__file__).resolve().parents[2]
_LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
arguments = [tuple(word.split(":=")) for word in sys.argv[2:]]
service = LaunchService()
source = PythonLaunchDescriptionSource(sys.argv[1])
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(source, launch_arguments=arguments)])
)
sys.exit(service.run())
"""


@pytest.fixture(scope="session")
def make_config(make_config):
    """The shared configuration with the model identified on the bench: these tests wait for positions to be reached.

    The machine may stop a process for a while (``PATIENT_NODE``).
    """
    identified = read_parameter_file(ROOT / "config" / "flexinol.yaml")
    real = {section: identified[section] for section in ("model", "controller", "thermal", "estimator")}
    return lambda **changes: make_config(**{**real, **PATIENT_NODE, **changes})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("node")


@pytest.fixture
def start_bench(folder):
    benches = []

    def start(*arguments):
        benches.append(Bench(folder, *arguments))
        return benches[-1]

    yield start
    for bench in benches:
        bench.close()


@pytest.fixture
def start_node(folder):
    nodes = []

    def start(parameters, *arguments, names=(), **how):
        sections = parameters if names else {"sma_actuator": parameters}
        user = ["--nodes", *names] if names else []
        path = parameter_file(folder, sections)
        nodes.append(NodeProcess([*user, "--ros-args", "--params-file", str(path), *arguments], folder, **how))
        return nodes[-1]

    yield start
    for node in nodes:
        node.close()


@pytest.fixture
def client():
    client = Client()
    yield client
    client.close()


@pytest.fixture(scope="module")
def client_of_running_node(folder, make_config):
    """A client of a node /asked/sma_actuator that runs for all tests that only ask it something."""
    bench = Bench(folder)
    path = parameter_file(folder, {"/asked/sma_actuator": make_config(instruments=bench.instruments())})
    node = NodeProcess(["--ros-args", "--params-file", str(path), "-r", "__ns:=/asked"], folder)
    client = Client()
    yield client
    client.close()
    node.close()
    bench.close()


@pytest.fixture
def launch(tmp_path):
    """Starts a launch file on an installation of its own; the node writes its process id to ``node.pid``."""
    prefix, started = tmp_path / "prefix", []
    program = prefix / "lib" / "sma_actuator" / "sma_actuator_node"
    for folder in ("share/ament_index/resource_index/packages", "share/sma_actuator", "lib/sma_actuator"):
        (prefix / folder).mkdir(parents=True)
    for folder in ("config", "launch", "urdf"):
        (prefix / "share" / "sma_actuator" / folder).symlink_to(ROOT / folder)
    (prefix / "share/ament_index/resource_index/packages/sma_actuator").touch()
    program.write_text(
        f'#!/bin/sh\necho $$ > {tmp_path}/node.pid\nexec {sys.executable} -m sma_actuator.ros.node "$@"\n'
    )
    program.chmod(0o755)

    def start(name, *arguments):
        log = (tmp_path / "launch.log").open("wb")
        prefixes = [str(prefix), *filter(None, [os.environ.get("AMENT_PREFIX_PATH")])]
        started.append(
            subprocess.Popen(
                [sys.executable, "-c", _LAUNCH, str(ROOT / "launch" / f"{name}.launch.py"), *arguments],
                stdout=log,
                stderr=log,
                env={**os.environ, "AMENT_PREFIX_PATH": os.pathsep.join(prefixes)},
                start_new_session=True,
            )
        )
        log.close()
        return started[-1]

    yield start
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(30.0)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    print((tmp_path / "launch.log").read_text())
