"""``~/self_test`` on real instruments over TCP: what is found comes as the standard service says, and the node goes
on."""

import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.srv import SelfTest
from geometry_msgs.msg import WrenchStamped
from processes import wait_until
from std_srvs.srv import Trigger
from test_node import NAME, _enable, _enabled, _status


def test_the_wiring_is_tested_refused_while_driven_ended_by_stop_and_a_loss_outlived(
    start_bench, make_config, start_node, client
):
    bench = start_bench("--load", "weight:0.98")
    node = start_node(make_config(instruments=bench.instruments(), **{"supply.watchdog_timeout": 1.0}))
    client.next(f"{NAME}/load", WrenchStamped)
    answer = client.call(f"{NAME}/self_test", SelfTest)
    said = {status.name: status for status in answer.status}
    assert answer.passed == b"\1", [status.message for status in answer.status]
    assert "Virtual Supply" in answer.id
    assert "read back as WDOG" in said["watchdog"].message
    assert said["output"].message == "the output is off, and the supply has read that back"
    wait_until(lambda: bench.current_A() == 0.0, what="end of the current")

    # The node goes on as before; while it drives there is no test.
    _enabled(client)
    answer = client.call(f"{NAME}/self_test", SelfTest)
    assert answer.passed == b"\0"
    assert "switch it off first: ~/enable false" in answer.status[0].message
    assert _enable(client, on=False).success

    # A mistake has its sentence; a stop ends the test at once, with the output off.
    bench.tell("BENC:FAUL channel_reversed,103")
    node_client = client.node.create_client(SelfTest, f"{NAME}/self_test")
    client.spin_until(node_client.service_is_ready, what="the service")
    future = node_client.call_async(SelfTest.Request())
    wait_until(lambda: bench.current_A() > 0.04 or future.done(), what="current of the self-test")
    stopped = client.call(f"{NAME}/stop", Trigger)
    assert stopped.success, stopped.message
    assert "the self-test was ended" in stopped.message
    wait_until(lambda: bench.current_A() == 0.0, what="end of the current")
    client.spin_until(future.done, what="the answer of the self-test")
    words = [status.message for status in future.result().status]
    assert any("a wire cannot push" in word for word in words)
    assert "ended before its time: asked to" in words
    node.says("self-test: load cell: the load is -")
    _status(client, lambda s: s.mode.value == "off")

    # A supply that is gone when the test ends is looked for until it is back; nobody says "off" meanwhile.
    bench.tell("BENC:FAUL:CLE")
    future = node_client.call_async(SelfTest.Request())
    wait_until(lambda: bench.current_A() > 0.04 or future.done(), what="current of the self-test")
    bench.tell("BENC:FAUL supply_hangup")
    client.spin_until(future.done, what="the answer of the self-test")
    assert future.result().passed == b"\0"
    _status(client, lambda s: s.values.get("output") == "not known: look at the supply")
    refused = _enable(client)
    assert not refused.success
    assert "trying to open the instruments again: supply at" in refused.message
    bench.tell("BENC:FAUL:CLE")
    client.spin_until(lambda: _enable(client).success, what="the supply found again")
    assert _enable(client, on=False).success
