"""Instruments that come late, go and come back: the node stays alive, becomes ready, and arms nothing by itself."""

import socket
import threading
import time

import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.srv import GetState
from ports import free_port
from processes import wait_until
from std_msgs.msg import Float64
from std_srvs.srv import SetBool
from test_node import NAME, _enabled, _status

#: Somebody keeps asking for a position so long, and nothing may move.
TEMPTED_s = 3.0


@pytest.fixture
def stand(start_bench, make_config, start_node):
    """Node and bench, the bench to be switched off and on again at its address."""

    class Stand:
        def __init__(self):
            self._at = ("--supply-port", free_port(), "--daq-port", free_port())
            self.switch_on()
            self._instruments = self.bench.instruments()

        def switch_off(self):
            self.bench.close()

        def switch_on(self):
            self.bench = start_bench("--load", "weight:0.98", *self._at)

        def start(self, **changes):
            self.node = start_node(make_config(instruments=self._instruments, **changes))
            return self.node

    return Stand()


def _tempt(client, stand):
    """Go on asking for a position; no current may come of it."""
    until_s = time.monotonic() + TEMPTED_s
    while time.monotonic() < until_s:
        client.publish(f"{NAME}/setpoint", Float64(data=0.002))
        client.executor.spin_once(timeout_sec=0.05)
        assert stand.bench.current_A() == 0.0


def test_a_node_that_starts_before_its_instruments_waits_for_them_and_is_ready_with_the_output_off(stand, client):
    stand.switch_off()
    node = stand.start()
    address = stand._instruments["supply"]["resource"]
    node.says(f"waiting for the instruments: supply at {address}: nothing listens there")
    assert client.call(f"{NAME}/get_state", GetState).current_state.label == "unconfigured"
    refused = client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=True))
    assert not refused.success
    assert refused.message.startswith(f"waiting for the instruments: supply at {address}: nothing listens there")
    time.sleep(TEMPTED_s)  # it has looked again by then
    assert node.words.count("looking again until they are there") == 1
    stand.switch_on()
    node.says("answer; the output is off until ~/enable")
    _tempt(client, stand)
    _enabled(client)
    wait_until(lambda: stand.bench.current_A() > 0.04)


def test_a_gateway_that_hangs_up_in_one_way_and_another_is_said_once_for_each(start_node, make_config, client):
    looks = []

    def hang_up(listener):
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            looks.append(connection)
            if len(looks) > 6:  # it is looked at for as long as an answer may take
                continue
            if len(looks) % 2:  # what it has not read resets the connection
                connection.recv(4096)
            connection.close()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=hang_up, args=(listener,), daemon=True).start()
        resource = f"TCPIP::127.0.0.1::{listener.getsockname()[1]}::SOCKET"
        instruments = {name: {"resource": resource} for name in ("supply", "daq")}
        often = {"supply.watchdog_timeout": 0.1, "instruments.reconnect_backoff_max": 0.1}
        node = start_node(make_config(instruments=instruments, **often))
        wait_until(lambda: len(looks) >= 7, what="a look that goes on")
        said = [line.partition("]: ")[2] for line in node.words.splitlines() if "looking again" in line]
        assert said and len(said) == len(set(said))
        answer = client.call(f"{NAME}/enable", SetBool, SetBool.Request(data=True))
        assert not answer.success and answer.message.startswith("waiting for the instruments: supply at"), answer
        listener.shutdown(socket.SHUT_RDWR)
    for connection in looks:
        connection.close()


def test_instruments_pulled_in_mid_motion_come_back_to_a_node_that_drives_nothing_by_itself(stand, client):
    node = stand.start()
    _enabled(client)
    client.publish(f"{NAME}/setpoint", Float64(data=0.002))
    wait_until(lambda: stand.bench.current_A() > 0.1)
    stand.switch_off()
    status = client.next(f"{NAME}/status", DiagnosticStatus, lambda s: bytes(s.level) == b"\x02" and "off" in s.message)
    assert "does not answer" in status.message
    time.sleep(TEMPTED_s)
    stand.switch_on()
    node.says("the supply answers again")
    node.says("the daq answers again")
    _tempt(client, stand)
    _enabled(client)
    client.publish(f"{NAME}/setpoint", Float64(data=0.002))
    wait_until(lambda: stand.bench.current_A() > 0.1)
    assert node.popen.poll() is None


def test_answers_that_come_late_for_a_while_are_a_limit_that_is_counted_and_passes(stand, client):
    times = {f"instruments.{name}.timeout": 0.5 for name in ("supply", "daq")}
    node = stand.start(**times, **{"safety.reading_timeout": 10.0, "supply.watchdog_timeout": 10.0})
    _enabled(client)
    client.publish(f"{NAME}/setpoint", Float64(data=0.0025))
    wait_until(lambda: stand.bench.current_A() > 0.1)
    stand.bench.tell("BENC:FAUL slow_answers,0.7")
    _status(client, lambda status: "answer_late" in status.limits)
    wait_until(lambda: stand.bench.current_A() == pytest.approx(0.05, abs=1e-3), what="the bias current")
    stand.bench.tell("BENC:FAUL:CLE")
    status = _status(client, lambda status: "answer_late" not in status.limits)
    assert (status.fault, status.mode.value) == ("", "tracking")
    assert float(status.values["late_answers"]) >= 1
    assert float(status.values["slowest_answer_s"]) >= 0.7
    wait_until(lambda: stand.bench.current_A() > 0.1)
    assert "answers late: the bias current until it does" in node.words
