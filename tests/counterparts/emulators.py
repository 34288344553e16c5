"""Power supplies that others wrote, each served on a TCP port by the Python that has it.

``python emulators.py NAME`` prints one line, the port of the instrument and that of its back door, and serves until its
standard input ends.  The back door belongs to the test: it tells the emulator what hangs on its output, and answers with
what the emulator itself holds its output for, whatever the instrument's own lines say.  Nothing of this package is
imported here: an emulator may stand in an environment of its own.
"""

from __future__ import annotations

import json
import socketserver
import sys
import threading
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


#: Name → what serves it, and the module that must be importable.
EMULATORS = {
    "instro": (Instro, "instro.psu"),
    "rigol_dp832": (RigolDp832, "labmcp_bench_psu"),
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
