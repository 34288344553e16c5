"""The launch file, as ``ros2 launch`` runs it; where ``launch_ros`` is installed."""

import os
import signal

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("launch_ros")
from processes import parameter_file, wait_until
from std_srvs.srv import SetBool
from test_node import _enabled


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
    process = launch("sma_actuator", f"params_file:={path}", *arguments)
    _enabled(client, node)
    wait_until(lambda: bench.current_A() > 0.04)
    os.killpg(process.pid, signal.SIGINT)
    wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
    assert process.wait(30.0) == 0


def test_several_wires_come_up_in_one_process(start_bench, make_config, folder, launch, client):
    bench = start_bench("--count", "2")
    wires = {name: make_config(instruments=bench.instruments(i)) for i, name in enumerate(("left", "right"))}
    path = parameter_file(folder, wires)
    process = launch("wires", f"params_file:={path}", "nodes:=left right")
    for name in wires:
        _enabled(client, f"/{name}")
    os.killpg(process.pid, signal.SIGINT)
    wait_until(lambda: bench.current_A(0) == bench.current_A(1) == 0.0, what="end of the current")


def test_without_autostart_it_waits_for_a_lifecycle_manager(start_bench, make_config, folder, launch, client):
    bench = start_bench("--load", "weight:0.98")
    path = parameter_file(folder, {"sma_actuator": make_config(instruments=bench.instruments())})
    launch("sma_actuator", f"params_file:={path}", "namespace:=left", "autostart:=false")
    answer = client.call("/left/sma_actuator/enable", SetBool, SetBool.Request(data=True))
    assert answer.message == "the node is unconfigured; configure and activate it first"
