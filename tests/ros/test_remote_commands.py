"""``sma-actuator move | status | enable | stop | call | watch`` speak to a running node; no ROS tool is needed."""

import argparse
import contextlib
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")
from processes import Bench, NodeProcess, parameter_file, wait_until
from test_node import _enabled

from sma_actuator.actuator.said import AFTER_A_FAULT
from sma_actuator.base.local_stop import StopListener
from sma_actuator.base.signals import Mode, Status
from sma_actuator.cli.main import main
from sma_actuator.cli.remote.move import Standing, add_arguments
from sma_actuator.cli.remote.status import shown
from sma_actuator.cli.remote.watch import after

NODE = ("--node", "left", "--namespace", "/arm", "--patience", "60")
OPTIONS = " --node left --namespace /arm"


@pytest.fixture(scope="module")
def bench(folder, make_config):
    """A bench with a node /arm/left at it, for all tests here."""
    bench = Bench(folder, "--load", "weight:0.98")
    path = parameter_file(folder, {"left": make_config(instruments=bench.instruments())})
    node = NodeProcess(["--nodes", "left", "--ros-args", "--params-file", str(path), "-r", "__ns:=/arm"], folder)
    yield bench
    node.close()
    bench.close()


def _status(capsys, **wanted):
    assert main(["status", *NODE, "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["node"] == "/arm/left"
    assert {key: said[key] for key in wanted} == wanted, said["message"]
    return said


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("displacement_m", 0.00223046, "displacement             2.23 mm"),
        ("stress_Pa", 5.37155e7, "stress                   53.72 MPa"),
        ("current_limit_A", 0.4, "current_limit            400 mA"),
        ("temperature_at_most_C", 84.41, "temperature_at_most      84.41 °C"),
        ("resistance_Ohm", 4.90373, "resistance               4.904 Ohm"),
        ("period_p99_s", 0.0547, "period_p99               54.7 ms"),
        ("late_answers", 3.0, "late_answers             3"),
        ("uncertainty_m", math.nan, "uncertainty              nan mm"),
        ("branch", "heating", "branch                   heating"),
    ],
)
def test_people_read_the_status_in_millimetres_and_milliamperes(name, value, line):
    assert shown(name, value) == line


def _enable(capsys):
    """Once there is a reading."""
    wait_until(lambda: main(["enable", *NODE]) == 0, what="a wire that can be enabled")
    said = capsys.readouterr()
    assert "the output is on" in said.out
    assert f"next: `sma-actuator move 40%{OPTIONS}`" in said.err


@pytest.mark.parametrize(
    ("fault", "lifecycle", "words"),
    [
        ("", "active", "~/enable"),
        ("", "unconfigured", "once the node is ready, ~/enable"),
        ("open_wire", "active", "mend what it says, then ~/clear_fault and ~/enable"),
        ("supply_lost", "active", "mend what it says, then ~/enable"),
    ],
)
def test_what_comes_next_is_what_the_node_would_do(fault, lifecycle, words):
    """A node that waits for its instruments enables nothing, and one whose instrument is back wants no clearing."""
    assert after(None, Status(Mode.OFF, fault, values={"lifecycle": lifecycle})) == words


@pytest.mark.parametrize("text", ["-8deg", "-0.2rad", "-.2rad"])
def test_a_joint_turns_to_a_negative_angle(text):
    """`-8deg` was taken for an option, and a place was asked for."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    given = parser.parse_args([text, "--node", "joint"]).position
    assert given.value < 0.0 and given.unit == "rad"


def test_what_to_do_about_a_fault_is_said_once(monkeypatch, capsys):
    """It stood twice in one sentence: clear_fault and enable, mend what it says, then clear_fault and enable."""
    client = SimpleNamespace(full_name="/sma_actuator", words=str)
    monkeypatch.setattr("sma_actuator.cli.remote.move.connected", lambda args: contextlib.nullcontext(client))
    for fault, message, ends in (
        ("open_wire", f"off: the wire is open (0 A){AFTER_A_FAULT}", AFTER_A_FAULT),
        ("", "off", "off; switch it on first: ~/enable"),
    ):
        status = Status(Mode.OFF, fault, message=message, values={"lifecycle": "active"})
        monkeypatch.setattr("sma_actuator.cli.remote.move.listen_to_motion", lambda client, status=status: status)
        assert main(["move", "40%"]) == 1
        assert capsys.readouterr().err.strip().endswith(ends)


@pytest.mark.parametrize(("rate_Hz", "there_s"), [(20.0, 0.5), (3.5, 3.0 / 3.5)])
def test_a_wire_that_goes_by_between_two_readings_is_not_there(rate_Hz, there_s):
    """At 3.5 Hz `move 0.5mm` said "there; held there" at 0.43 mm, after two readings within 0.05 mm."""
    standing, looks_s = Standing(), [0.05 * number for number in range(40)]
    there = [standing.seen((int(now_s * rate_Hz + 1e-9), 0), now_s) for now_s in looks_s]
    assert looks_s[there.index(True)] == pytest.approx(there_s, abs=0.051)


def test_a_wire_is_moved_watched_and_stopped(bench, capsys):
    wait_until(lambda: _status(capsys)["values"]["lifecycle"] == "active", what="a node that is ready")
    assert main(["move", "0.0025", *NODE]) == 1, "the output is off"
    assert "switch it on first: `sma-actuator enable --node left --namespace /arm`" in capsys.readouterr().err
    _enable(capsys)
    wait_until(lambda: bench.current_A() > 0.04)
    assert main(["move", "2.5mm", *NODE, "--within", "60"]) == 0
    said = capsys.readouterr()
    assert "held there" in said.out
    assert said.err.splitlines() == [
        f"next: `sma-actuator watch{OPTIONS}`, or `sma-actuator stop{OPTIONS}`",
    ]
    reaches = r"to 2.500 mm; at this load the wire can be held from (.+) \(0%\) to (.+) mm \(100%\)"
    short_mm, long_mm = map(float, re.match(reaches, said.out).groups())
    assert main(["move", "40%", *NODE, "--within", "60"]) == 0
    aim_mm = short_mm + 0.4 * (long_mm - short_mm)
    assert float(re.match("to (.+?) mm;", capsys.readouterr().out)[1]) == pytest.approx(aim_mm, abs=0.05)
    assert bench.truth()[0] * 1e3 == pytest.approx(aim_mm, abs=0.3)
    held = _status(capsys, mode="hold", fault="")["values"]
    held_mm, there_mm = held["limited_setpoint_m"] * 1e3, held["displacement_m"] * 1e3
    assert held_mm == pytest.approx(aim_mm, abs=0.002), "it is held where it was asked, not where it was near it"
    assert there_mm == pytest.approx(aim_mm, abs=0.2)
    assert main(["watch", *NODE, "--every", "0.2", "--duration", "0.3", "-q"]) == 0
    assert "next:" not in capsys.readouterr().err
    assert main(["watch", *NODE, "--every", "0.2", "--duration", "0.5"]) == 0
    said = capsys.readouterr()
    assert f"next: `sma-actuator move 40%{OPTIONS}`" in said.err
    lines = said.out.splitlines()
    known = r"position +[\d.]+ mm .*load +[\d.]+ N +current +[\d.]+ mA +holding"
    assert len(lines) >= 2 and all(re.search(known, line) for line in lines), lines
    shown_mm, load_N = map(float, re.search(r"position +(\S+) .*load +(\S+)", lines[-1]).groups())
    assert shown_mm == pytest.approx(there_mm, abs=0.2) and load_N == pytest.approx(0.98, abs=0.05)
    assert main(["enable", "--off", *NODE]) == 0
    wait_until(lambda: bench.current_A() == 0.0)
    _enable(capsys)
    assert main(["stop", *NODE]) == 0
    said = capsys.readouterr()
    assert "/arm/left: the output is off" in said.out
    assert said.err == f"next: `sma-actuator enable{OPTIONS}`\n"
    wait_until(lambda: bench.current_A() == 0.0)
    assert _status(capsys, mode="off")["values"]["displacement_m"] is None


def test_a_node_of_another_computer_is_stopped_over_ros(bench, capsys, monkeypatch):
    _enable(capsys)
    monkeypatch.setattr("sma_actuator.cli.remote.stop.ask_here", lambda *_: [])
    assert main(["stop", *NODE]) == 0
    assert "/arm/left: the output is off" in capsys.readouterr().out
    wait_until(lambda: bench.current_A() == 0.0)


#: Another user, who may read what this one may.
NOBODY = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", "--inh-caps=+dac_read_search")
NOBODY += ("--ambient-caps=+dac_read_search",)


@pytest.mark.skipif(
    shutil.which("setpriv") is None or subprocess.run([*NOBODY, "true"], capture_output=True).returncode != 0,
    reason="nobody here may become another user",
)
def test_another_user_for_whom_ros_can_write_no_log_is_answered(bench):
    """As of a node with real-time rights or in a container: by Fast DDS's shared memory none of its words arrive."""
    environment = {**os.environ, "HOME": "/proc/none", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    environment.pop("FASTDDS_BUILTIN_TRANSPORTS", None)
    asked = [*NOBODY, sys.executable, "-B", "-m", "sma_actuator", "status", *NODE, "--json", "-"]
    said = subprocess.run(asked, env=environment, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert json.loads(said.stdout)["node"] == "/arm/left"


def test_services_without_an_argument_are_called_by_their_name(bench, capsys):
    # With the output off: no fault to clear, and a self-test may have the wire.
    assert main(["call", "clear_fault", *NODE]) == 0
    said = capsys.readouterr()
    assert "/arm/left: " in said.out and said.err == f"next: `sma-actuator enable{OPTIONS}`\n"
    assert main(["call", "~/self_test", *NODE]) == 0
    assert "resistance" in capsys.readouterr().out
    assert main(["call", "dance", *NODE]) == 1
    assert "/arm/left has no service dance; it has clear_fault, measure_lead_resistance," in capsys.readouterr().err


def test_people_at_the_command_line_are_told_commands(bench, capsys):
    assert main(["call", "measure_lead_resistance", *NODE]) == 1
    assert "`sma-actuator enable --node left --namespace /arm`" in capsys.readouterr().out
    _enable(capsys)
    assert main(["call", "self_test", *NODE]) == 1
    said = capsys.readouterr().out
    assert "`sma-actuator enable --off --node left --namespace /arm`" in said and "~/" not in said
    assert main(["stop", *NODE]) == 0


def test_a_position_that_is_not_reached_is_said_and_the_wire_is_held(bench, capsys):
    _enable(capsys)
    assert main(["move", "-0.05", *NODE, "--within", "1.5", "-q"]) == 1
    said = capsys.readouterr()
    assert "-50.000 mm is beyond where the wire can be held at this load" in said.err
    assert "held at its short end" in said.err
    assert "not there within 1.5 s; position" in said.err and said.out == ""
    _status(capsys, mode="hold", fault="")
    assert main(["stop", *NODE]) == 0


@pytest.mark.long  # of one that is not reached it is seen above
def test_a_position_beyond_an_end_is_given_up_at_that_end(bench, capsys):
    _enable(capsys)
    assert main(["move", "40%", *NODE, "--within", "60", "-q"]) == 0
    assert main(["move", "9mm", *NODE, "--within", "600", "-q"]) == 1
    assert "it is at the end of its way; 9.000 mm is beyond" in capsys.readouterr().err
    _status(capsys, mode="hold", fault="")
    assert main(["stop", *NODE]) == 0


def test_ctrl_c_ends_the_motion_and_leaves_the_wire_held(bench, capsys):
    _enable(capsys)
    words = [sys.executable, "-m", "sma_actuator", "move", "0.0012", *NODE, "--tolerance", "0", "--within", "100"]
    moving = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert "tracking" in moving.stdout.readline() + moving.stdout.readline() + moving.stdout.readline()
        moving.send_signal(signal.SIGINT)
        _, error = moving.communicate(timeout=150)
    finally:
        moving.kill()
    assert moving.returncode == 130
    assert error.endswith("sma-actuator move: interrupted\n")
    _status(capsys, mode="hold", fault="")
    assert main(["stop", *NODE]) == 0


@pytest.mark.parametrize("position", ["2.5", "nan", "inf", "much", "5mmm", "900mm"])
def test_a_position_that_no_wire_has_is_not_sent(capsys, position):
    with pytest.raises(SystemExit):
        main(["move", position])
    assert "0.0025 (metres) or 2.5mm is wanted" in capsys.readouterr().err


@pytest.mark.parametrize("share", ["40mm%", "much%", "101%"])
def test_nor_a_share_that_no_way_has(capsys, share):
    with pytest.raises(SystemExit):
        main(["move", share])
    assert "0% (contracted) to 100% is wanted" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["status"], ["enable"], ["stop"], ["watch"], ["call", "tune"], ["move", "0.002"]], ids=lambda w: w[0]
)
def test_where_no_node_answers_a_sentence_names_who_was_looked_for(bench, capsys, words):
    assert main([*words, "--node", "right", "--namespace", "arm", "--patience", "0.3"]) == 1
    assert capsys.readouterr().err.startswith(
        f"sma-actuator {words[0]}: no node 'right' in the namespace '/arm' has answered within 0.3 s"
    )


def test_and_who_is_there_instead(bench, capsys):
    def error():
        assert main(["status", "--patience", "1"]) == 1
        return capsys.readouterr().err

    there = "there is /arm/left: name it with --node and --namespace"
    wait_until(lambda: there in error(), what=there)


def test_a_node_that_is_there_and_says_nothing_is_not_called_absent(capsys):
    import rclpy
    from diagnostic_msgs.msg import DiagnosticStatus

    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    silent = rclpy.create_node("silent", namespace="/arm", context=context)
    silent.create_publisher(DiagnosticStatus, "/arm/silent/status", 1)
    try:

        def said():
            assert main(["status", "--node", "silent", "--namespace", "/arm", "--patience", "3"]) == 1
            return "/arm/silent is there, but has not answered within 3 s" in capsys.readouterr().err

        wait_until(said, what="the silent node")
    finally:
        silent.destroy_node()
        context.try_shutdown()


class TestStopWithoutRos:
    """For a node that hangs: the supply is switched off by the parameter file."""

    @pytest.fixture
    def driven(self, start_bench, start_node, make_config, folder, client):
        """A bench whose watchdog helps nobody, a node that drives it, and its parameter file."""
        bench = start_bench("--load", "weight:0.98")
        parameters = make_config(instruments=bench.instruments(), **{"supply.watchdog_timeout": 600.0})
        node = start_node(parameters)
        _enabled(client)
        wait_until(lambda: bench.current_A() > 0.04)
        return bench, node, parameter_file(folder, {"sma_actuator": parameters})

    def test_of_a_node_that_stands_still_the_process_is_ended_since_it_has_the_lock(self, driven, capsys):
        bench, node, file = driven
        node.popen.send_signal(signal.SIGSTOP)
        assert main(["stop", "--patience", "0.5"]) == 1
        assert "/sma_actuator is there, but has not answered within 0.5 s; ask the supply" in capsys.readouterr().err
        assert main(["stop", "--config", str(file)]) == 0
        said = capsys.readouterr().out
        assert f"process {node.popen.pid} drives the supply and lets nobody else command it: it is ended" in said
        assert "the output is off, confirmed by the supply at TCPIP" in said
        wait_until(lambda: bench.current_A() == 0.0)
        assert node.ends() == -signal.SIGKILL

    def test_a_supply_that_obeys_a_second_session_is_switched_off_beside_the_node(self, driven, capsys):
        bench, node, file = driven
        node.close()
        assert main(["stop", "--config", str(file)]) == 0
        assert "is ended" not in capsys.readouterr().out
        bench.close()
        assert main(["stop", "--config", str(file)]) == 1
        assert "NOT CONFIRMED: supply at TCPIP" in capsys.readouterr().out


def test_a_stop_on_this_computer_imports_little_and_no_ros():
    name = f"quick_{os.getpid()}"
    listener = StopListener([f"/{name}/stop"], os.environ["ROS_DOMAIN_ID"], lambda reply: reply(True, "~/enable"))
    code = f"import sys; from sma_actuator.cli.main import main\nassert main(['stop', '--node', '{name}']) == 0\n"
    code += "print({'rclpy', 'numba', 'scipy', 'numpy', 'pyvisa', 'rich', 'sma_actuator.config'} & set(sys.modules))"
    try:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=150.0)
    finally:
        listener.close()
    assert done.stdout == f"`sma-actuator enable --node {name}`\nset()\n", done.stderr
