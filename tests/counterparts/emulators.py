"""Power supplies that others wrote, each served on a TCP port by the Python that has it.

``python emulators.py NAME`` prints one line, the port of the instrument and that of its back door, and serves until its
standard input ends.  The back door belongs to the test: it tells the emulator what hangs on its output, and answers
with what the emulator itself holds its output for, whatever the instrument's own lines say.  Nothing of this package is
imported here: an emulator may stand in an environment of its own.
"""

from __future__ import annotations

import json
import socketserver
import sys
import threading
import time
from dataclasses import dataclass


@dataclass
class State:
    """What an emulator holds its output for."""

    on: bool
    setting_A: float
    setting_V: float


def serve(answer, terminator=b"\n", separator=b"\n"):
    """Serve ``answer(line) -> line or None`` on a free port, to any number of clients; the port."""
    lock = threading.Lock()

    class Handler(socketserver.BaseRequestHandler):
        def handle(self):
            buffer = b""
            while True:
                try:
                    data = self.request.recv(4096)
                    if not data:
                        return
                    buffer += data
                    *lines, buffer = buffer.split(separator)
                    for line in lines:
                        with lock:
                            reply = answer(line.decode())
                        if reply is not None:
                            self.request.sendall(reply.encode() + terminator)
                except OSError:
                    return

    class Server(socketserver.ThreadingTCPServer):
        daemon_threads = True

    server = Server(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server.server_address[1]


class Instro:
    """The power supply of Nominal's ``instro``: trips, an error queue, load, leads and noise; one client at a time."""

    def __init__(self):
        from instro.psu.scpi_sim_server import SimulatedLoad, SimulatedPSU, SimulatedPSUChannel, SimulatedPSUServer

        self._output = SimulatedPSUChannel(1, SimulatedLoad(8.0, probe_resistance=0.0))
        server = SimulatedPSUServer(SimulatedPSU(channels=[self._output]), port=0)
        server.start()
        self.port = server.port

    def load(self, load_Ohm):
        self._output.load.resistance = load_Ohm

    @property
    def state(self):
        output = self._output
        return State(output.output_enabled, output.current_limit, output.voltage_setpoint)


class _LabMcp:
    """The bench supplies of ``labmcp-bench-psu``, written by its author from the makers' programming guides."""

    family = model = ""

    def __init__(self):
        from labmcp_bench_psu.simulator import make_simulator

        self._simulator = make_simulator(self.family, self.model)
        self.port = serve(self._simulator.handle)

    def load(self, load_Ohm):
        self._simulator.outputs[1].load_ohm = load_Ohm

    @property
    def state(self):
        output = self._simulator.outputs[1]
        return State(output.on, output.set_i, output.set_v)


class RigolDp832(_LabMcp):
    family, model = "rigol", "DP832"


class SiglentSpd3303x(_LabMcp):
    family, model = "siglent", "SPD3303X"


class SiglentSpd1168x(_LabMcp):
    family, model = "siglent", "SPD1168X"


class TtiPl303(_LabMcp):
    family, model = "tti", "PL303-P"


class Keithley2400:
    """The SourceMeter of ``labmcp-keithley-smu``, sourcing into a resistor."""

    simulator = "Keithley2400Simulator"

    def __init__(self):
        from labmcp_keithley_smu import simulator

        self._core = simulator.SMUCore(simulator.make_dut("resistor", 8.0), 21.0, 1.05)
        self.port = serve(getattr(simulator, self.simulator)(self._core).handle)

    def load(self, load_Ohm):
        self._core.dut.r = load_Ohm

    @property
    def state(self):
        core = self._core
        if core.func == "CURR":
            return State(core.output, core.level["CURR"], core.limit["VOLT"])
        return State(core.output, core.limit["CURR"], core.level["VOLT"])


class Keithley2450(Keithley2400):
    simulator = "Keithley2450Simulator"


class Labwire:
    """The power supply of ``labwire-sim``: it answers every command, takes no 0 A, slews, and needs some
    milliseconds."""

    def __init__(self):
        import asyncio

        from labwire.sim import SimPowerSupply

        self._simulator = SimPowerSupply()
        loop = asyncio.new_event_loop()
        loop.run_until_complete(self._simulator.start())
        threading.Thread(target=loop.run_forever, daemon=True).start()
        self.port = self._simulator.port

    def load(self, load_Ohm):
        self._simulator.load_ohms = load_Ohm

    @property
    def state(self):
        return State(self._simulator.output, self._simulator.limit_a, self._simulator.setpoint_v)


class ScpiControl:
    """The power supply with which ``SCPI-Instrument-Control`` tests itself.  It has no load of its own: what it
    measures is given to it, as it provides for."""

    def __init__(self):
        from scpi_control.connection.mock import MockConnection

        self._mock = MockConnection(psu_mode=True)
        self._mock.connect()
        self._load_Ohm = 8.0
        self.port = serve(self._answer)

    def _answer(self, line):
        if "?" not in line:
            return self._mock.write(line)
        state = self.state
        current_A = min(state.setting_A, state.setting_V / self._load_Ohm) if state.on else 0.0
        self._mock.custom_responses.update(
            {"MEAS:CURR? CH1": f"{current_A:.3f}", "MEAS:VOLT? CH1": f"{current_A * self._load_Ohm:.3f}"}
        )
        return self._mock.query(line)

    def load(self, load_Ohm):
        self._load_Ohm = load_Ohm

    @property
    def state(self):
        output = self._mock.psu_outputs[1]
        return State(output["enabled"], output["current"], output["voltage"])


class LewisGenesys:
    """A TDK-Lambda Genesys in the framework of ``lewis``; the device is ours, since lewis has no power supply."""

    def __init__(self):
        import socket
        from pathlib import Path

        from lewis.core.simulation import SimulationFactory

        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        sys.path.insert(0, str(Path(__file__).parent))
        options = {"bind_address": "127.0.0.1", "port": self.port}
        simulation = SimulationFactory("lewis_devices").create("genesys", protocols={"stream": options})
        self._device = simulation._device
        threading.Thread(target=simulation.start, daemon=True).start()
        while not simulation.is_started:
            time.sleep(0.01)

    def load(self, load_Ohm):
        self._device.load_Ohm = load_Ohm

    @property
    def state(self):
        return State(self._device.output_on, self._device.setting_A, self._device.setting_V)


#: Name → what serves it, and the module that must be importable.
EMULATORS = {
    "instro": (Instro, "instro.psu"),
    "rigol_dp832": (RigolDp832, "labmcp_bench_psu"),
    "siglent_spd3303x": (SiglentSpd3303x, "labmcp_bench_psu"),
    "siglent_spd1168x": (SiglentSpd1168x, "labmcp_bench_psu"),
    "tti_pl303": (TtiPl303, "labmcp_bench_psu"),
    "keithley_2400": (Keithley2400, "labmcp_keithley_smu"),
    "keithley_2450": (Keithley2450, "labmcp_keithley_smu"),
    "labwire": (Labwire, "labwire.sim"),
    "scpi_control": (ScpiControl, "scpi_control"),
    "lewis_genesys": (LewisGenesys, "lewis"),
}


def main(name: str) -> None:
    """Serve one until the standard input ends."""
    emulator = EMULATORS[name][0]()

    def back_door(line):
        request = json.loads(line)
        if "load_Ohm" in request:
            emulator.load(request["load_Ohm"])
        return json.dumps(vars(emulator.state))

    print(json.dumps({"port": emulator.port, "back_door": serve(back_door)}), flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main(sys.argv[1])
