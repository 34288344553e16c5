"""The bench as a process and over TCP: real time, several clients, faults of the connection, a clean end."""

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time

import pytest
from waiting import Stalls

from sma_actuator.base.share import shared_file
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.joint import JointBench
from sma_actuator.bench.server import Pacer, background
from sma_actuator.cli.main import main
from sma_actuator.config import read_parameter_file, write_parameter_file
from sma_actuator.instruments import InstrumentError
from sma_actuator.plant.joint import parse_joint


class Connection:
    """A bare socket: what these tests are about is below pyvisa."""

    def __init__(self, port, timeout_s=60.0):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout_s)
        self.file = self.socket.makefile("rw", newline="\n")

    def ask(self, line):
        self.tell(line)
        return self.file.readline().strip()

    def tell(self, line):
        self.file.write(line + "\n")
        self.file.flush()

    def close(self):
        self.file.close()
        self.socket.close()


@pytest.fixture
def served():
    with background(VirtualBench.from_name("flexinol")) as server:
        connections = []

        def connect(instrument, **kwargs):
            connections.append(Connection(server.ports[0][instrument], **kwargs))
            return connections[-1]

        yield connect
        for connection in connections:
            connection.close()


def poll(condition, within_s=150.0):
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline, "did not happen in time"
        time.sleep(0.002)


def bench_time_s(connection):
    return float(connection.ask("BENC:TRUT?").split(",")[0])


def test_both_instruments_see_the_same_wire(served):
    supply, daq = served("supply"), served("daq")
    supply.tell("VOLT 6;CURR 0.2;:OUTP ON")
    assert supply.ask("OUTP?") == "1"
    daq.tell("ROUT:SCAN (@102);:SAMP:COUN 50")
    time_s, reference_V = map(float, daq.ask("READ:AVER?").split(","))
    assert reference_V == pytest.approx(0.2, abs=0.02) and time_s == pytest.approx(bench_time_s(daq), abs=0.5)


def test_time_is_real_time(served):
    daq = served("daq")
    with contextlib.closing(Stalls()) as stalls:
        asked_s, bench_0_s, answered_s = time.monotonic(), bench_time_s(daq), time.monotonic()
        daq.tell("SAMP:COUN 500")
        daq.ask("READ:AVER?")
        between_s = time.monotonic() - answered_s
    bench_s = bench_time_s(daq) - bench_0_s
    # Between the two answers lies at least what passed between them here, and at most what passed around them.
    assert between_s - 0.1 <= bench_s <= time.monotonic() - asked_s + 0.1
    assert between_s + stalls.lost_s > 0.45


def test_speed_multiplies_time():
    with background(VirtualBench.from_name("flexinol"), speed=50.0) as server:
        daq = Connection(server.ports[0]["daq"])
        daq.tell("SAMP:COUN 5000")
        real_0_s, bench_0_s = time.monotonic(), bench_time_s(daq)
        daq.ask("READ:AVER?")
        assert bench_time_s(daq) - bench_0_s > 5.0 * (time.monotonic() - real_0_s)
        daq.close()


def test_a_second_client_commands_the_same_supply_unless_it_is_locked(served):
    first, second = served("supply"), served("supply")
    first.tell("CURR 0.1")
    second.tell("CURR 0.2")
    assert second.ask("*OPC?") == "1" and float(first.ask("CURR?")) == pytest.approx(0.2)
    assert first.ask("SYST:RWL;LOCK:OWN?") == "SELF"
    assert second.ask("CURR 0.3;:SYST:ERR?").startswith("-203")
    first.close()
    poll(lambda: second.ask("SYST:LOCK:OWN?") == "NONE")


def test_the_watchdog_cuts_when_the_client_dies(served):
    supply, daq = served("supply"), served("daq")
    assert supply.ask("VOLT 6;CURR 0.2;:OUTP:PROT:WDOG:DEL 0.2;:OUTP:PROT:WDOG ON;:OUTP ON;:OUTP?") == "1"
    supply.close()
    poll(lambda: float(daq.ask("BENC:TRUT?").split(",")[9]) < 1e-6, within_s=60.0)


@pytest.mark.parametrize("name", ["supply", "daq"])
def test_fault_silence(served, name):
    instrument, other = served(name, timeout_s=0.3), served("daq" if name == "supply" else "supply")
    assert other.ask(f"BENC:FAUL {name}_silent;:SYST:ERR?").startswith("0")
    with pytest.raises(TimeoutError):
        instrument.ask("*IDN?")
    assert other.ask("*OPC?") == "1"
    assert other.ask("BENC:FAUL:CLE;:SYST:ERR?").startswith("0")
    assert served(name).ask("*OPC?") == "1"


@pytest.mark.parametrize("name", ["supply", "daq"])
def test_fault_hangup(served, name):
    instrument, other = served(name), served("daq" if name == "supply" else "supply")
    assert instrument.ask("*OPC?") == "1"
    other.tell(f"BENC:FAUL {name}_hangup")
    assert instrument.file.readline() == ""  # closed by the other side
    assert served(name).file.readline() == ""
    assert other.ask("BENC:FAUL:CLE;:SYST:ERR?").startswith("0")
    assert served(name).ask("*OPC?") == "1"


def test_fault_slow_answers(served):
    supply = served("supply")
    supply.tell("BENC:FAUL slow_answers,0.3")
    began_s = time.monotonic()
    assert supply.ask("*OPC?") == "1"
    assert time.monotonic() - began_s > 0.29


def test_a_line_without_end_is_an_error_and_not_the_end(served):
    supply = served("supply")
    supply.tell("X" * 200_000)
    poll(lambda: supply.ask("SYST:ERR?").startswith("-363"))
    assert supply.ask("*CLS;*OPC?") == "1"


def test_a_taken_port_is_named():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with (
            pytest.raises(InstrumentError, match=f"127.0.0.1:{port}"),
            background(VirtualBench.from_name("flexinol"), supply_port=port),
        ):
            pass


def test_a_machine_that_sleeps_delays_the_bench_and_does_not_freeze_it():
    now_s = [0.0]
    bench = VirtualBench.from_name("flexinol")
    pacer = Pacer(bench, 1.0, lambda: now_s[0])

    def tick_during_physics(until_s, advance=bench.advance):
        advance(until_s)
        now_s[0] += 0.06  # as on a machine that needs longer than it may

    now_s[0] = 3600.0
    bench.advance = tick_during_physics
    pacer.catch_up()
    lag_from_s = bench.time_s
    assert lag_from_s < 1.0
    now_s[0] += 0.1
    pacer.catch_up()
    assert bench.time_s == pytest.approx(lag_from_s + 0.1, abs=2e-3)


@contextlib.contextmanager
def serving(tmp_path, *words):
    """(process, ports) of a bench with these options; killed in the end."""
    ports_file = tmp_path / "ports.json"
    command = [sys.executable, "-m", "sma_actuator", "bench", *words, "--supply-port", "0", "--daq-port", "0"]
    process = subprocess.Popen(
        [*command, "--ports-file", str(ports_file)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        poll(lambda: ports_file.exists() or process.poll() is not None, within_s=150.0)
        yield process, json.loads(ports_file.read_text())
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)], ids=lambda s: s.name
)
def test_the_command_serves_many_benches_and_ends_clean(tmp_path, number):
    words = ("--wire", "furukawa", "--load", "spring:100,0.5", "--count", "2", "--fault", "load_spike=2@0.01")
    with serving(tmp_path, *words) as (process, ports):
        assert len({p[k] for p in ports for k in ("supply", "daq")}) == 4
        first, second = Connection(ports[0]["supply"]), Connection(ports[1]["supply"])
        assert first.ask("*IDN?").split(",")[2] != second.ask("*IDN?").split(",")[2]
        poll(lambda: first.ask("BENC:FAUL?") == "load_spike=2")
        process.send_signal(number)
        output, errors = process.communicate(timeout=150)
        assert process.returncode == 0
        assert errors.startswith("next: name these as") and errors.count("\n") == 1
        assert output.count("TCPIP::127.0.0.1::") == 4
        first.close()
        second.close()


@pytest.mark.parametrize(
    ("option", "value", "word"),
    [
        ("--load", "rope:1", "rope:1"),
        ("--fault", "earthquake", "open_wire"),
        ("--speed", "0", "is not a number from 0.01"),
        ("--wire", "steel", "flexinol"),
        ("--physics", "caloric", "one of measured, liang_rogers"),
        ("--physics", "drawn-x", "real, drawn-N is wanted"),
    ],
)
def test_a_wrong_option_is_refused_in_a_sentence(option, value, word, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["bench", option, value])
    assert ended.value.code == 2 and word in capsys.readouterr().err


def test_the_process_serves_the_physics_that_was_asked_for(tmp_path):
    """A wire of the measured distribution is not all martensite at room temperature; the cosine's is, and
    the fourth that nobody chose lies between (0.990)."""
    shares = {
        physics: VirtualBench.from_name("flexinol", physics=physics).truth.martensite
        for physics in ("liang_rogers", "measured")
    }
    with serving(tmp_path, "--physics", "drawn-4") as (process, ports):
        connection = Connection(ports[0]["supply"])
        shares["drawn-4"] = float(connection.ask("BENC:TRUT?").split(",")[4])
        connection.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=150) == 0
    assert shares["liang_rogers"] == 1.0 and 0.8 < shares["measured"] < 0.98 < shares["drawn-4"] < 0.995


def test_the_wire_has_the_size_of_the_one_in_a_file(tmp_path, monkeypatch):
    """A tenth of the cross-section and the usual stress: ten times the resistance, a tenth of the load."""
    mapping = read_parameter_file(shared_file("config/flexinol.yaml"))
    home_m = mapping["wire"]["diameter"]
    mapping["wire"]["diameter"] = home_m / 10.0**0.5
    write_parameter_file(tmp_path / "fine.yaml", mapping, "A fine wire.")
    served = []
    monkeypatch.setattr("sma_actuator.bench.server.serve", lambda benches, *rest: served.extend(benches))
    for words in ((), ("--config", str(tmp_path / "fine.yaml"))):
        assert main(["bench", *words]) == 0
    home, fine = (bench.truth for bench in served)
    assert fine.load_N == pytest.approx(home.load_N / 10.0, rel=0.01)
    assert fine.resistance_Ohm == pytest.approx(home.resistance_Ohm * 10.0, rel=0.01)


def test_the_bench_has_the_alloy_sense_resistor_and_current_of_a_file(tmp_path, monkeypatch, capsys):
    """A coil of 0.5 mm Ni-Ti-Cu on 0.1 Ω, which wants 2 A: the bench was one of Ni-Ti on 1 Ω, and took 1.2 A."""
    words = ["wire.alloy=ni-ti-cu", "wire.form=coil", "wire.coil_diameter=3.5mm", "wire.length=132mm"]
    words += ["wire.diameter=0.5mm", "circuit.reference_resistance=0.1"]
    for kind in ("supply", "daq"):
        words += [f"instruments.{kind}.resource=TCPIP::127.0.0.1::5025::SOCKET"]
        words += [f"instruments.{kind}.dialect=virtual_bench_{kind}"]
    words += ["instruments.daq.lvdt_channel=104"]
    file = str(tmp_path / "coil.yaml")
    assert main(["init", *(w for word in words for w in ("--set", word)), "--out", file]) == 0
    served = []
    monkeypatch.setattr("sma_actuator.bench.server.serve", lambda benches, *rest: served.extend(benches))
    assert main(["bench", "--config", file]) == 0
    setup, supply = served[0].setup, served[0].supply
    assert setup.wire.text == "ni-ti-cu, 132 mm of 0.5 mm, a coil of 3.5 mm"
    assert setup.chain.reference_resistance_Ohm == 0.1
    limits = read_parameter_file(file)["supply"]
    supply.set_current(limits["max_current"])
    supply.set_ocp(limits["over_current_trip"])
    assert limits["max_current"] > 1.5
    capsys.readouterr()
    for command in (["bench", "--wire"], ["characterise", "--out", str(tmp_path / "out"), "--virtual"]):
        assert main([*command, "coil", "--config", file]) == 1
        said = capsys.readouterr().err
        assert f"{command[-1]} coil: is a wire of ni-ti" in said and f"{command[-1]} furukawa is one" in said


def test_two_wires_on_a_joint_have_a_size_of_their_own(capsys):
    file = shared_file("config/flexinol.yaml")
    assert main(["bench", "--config", str(file), "--load", "joint:0.004,0.0017"]) == 1
    assert "leave out one of --config and --load joint" in capsys.readouterr().err


def test_two_benches_of_a_joint_have_one_time_and_say_its_angle():
    stand = JointBench.from_name("flexinol", parse_joint("0.004,0.0017"), seed=1)
    with background(stand.benches, speed=20.0) as server:
        first, second = (Connection(ports["supply"]) for ports in server.ports)
        for connection, current_A in ((first, 0.28), (second, 0.1)):
            connection.tell(f"VOLT 6;:CURR {current_A};:OUTP ON")
        poll(lambda: float(second.ask("BENC:JOIN:ANGL?")) > 0.3, within_s=60.0)
        before_s, other_s, after_s = bench_time_s(first), bench_time_s(second), bench_time_s(first)
        assert before_s <= other_s <= after_s
        first.tell("BENC:LOAD:WEIG 1;:BENC:JOIN:TORQ -0.002")
        assert first.ask("SYST:ERR?").startswith("-221") and float(second.ask("BENC:JOIN:TORQ?")) == -0.002
        first.close()
        second.close()


def test_a_wire_without_a_joint_has_no_angle(served):
    supply = served("supply")
    supply.tell("BENC:JOIN:ANGL?")
    assert supply.ask("SYST:ERR?").startswith("-221")
