"""The launch file, as ``ros2 launch`` runs it; where ``launch_ros`` is installed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("launch_ros")
from processes import parameter_file, wait_until
from std_srvs.srv import SetBool
from test_node import _enabled

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


@pytest.fixture
def launch(tmp_path):
    """Starts the launch file on an installation of its own."""
    prefix, started = tmp_path / "prefix", []
    program = prefix / "lib" / "sma_actuator" / "sma_actuator_node"
    for folder in ("share/ament_index/resource_index/packages", "share/sma_actuator/config", "lib/sma_actuator"):
        (prefix / folder).mkdir(parents=True)
    (prefix / "share/ament_index/resource_index/packages/sma_actuator").touch()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m sma_actuator.ros.node "$@"\n')
    program.chmod(0o755)

    def start(*arguments):
        log = (tmp_path / "launch.log").open("wb")
        prefixes = [str(prefix), *filter(None, [os.environ.get("AMENT_PREFIX_PATH")])]
        started.append(
            subprocess.Popen(
                [sys.executable, "-c", _LAUNCH, str(ROOT / "launch" / "sma_actuator.launch.py"), *arguments],
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


@pytest.mark.parametrize(
    ("arguments", "node"),
    [
        ([], "/sma_actuator"),
        (["namespace:=left"], "/left/sma_actuator"),
        (["namespace:=/arm/left", "name:=wire"], "/arm/left/wire"),
    ],
    ids=["as it is", "namespace", "namespace and name"],
)
def test_the_node_comes_up_where_it_is_told(start_bench, make_config, folder, launch, client, arguments, node):
    bench = start_bench("--load", "weight:0.98")
    name = node.rpartition("/")[2]
    path = parameter_file(folder, {name: make_config(instruments=bench.instruments())})
    process = launch(f"params_file:={path}", *arguments)
    _enabled(client, node)
    wait_until(lambda: bench.current_A() > 0.04)
    os.killpg(process.pid, signal.SIGINT)
    wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
    assert process.wait(30.0) == 0


def test_without_autostart_it_waits_for_a_lifecycle_manager(start_bench, make_config, folder, launch, client):
    bench = start_bench("--load", "weight:0.98")
    path = parameter_file(folder, {"sma_actuator": make_config(instruments=bench.instruments())})
    launch(f"params_file:={path}", "namespace:=left", "autostart:=false")
    answer = client.call("/left/sma_actuator/enable", SetBool, SetBool.Request(data=True))
    assert answer.message == "the node is unconfigured; configure and activate it first"
