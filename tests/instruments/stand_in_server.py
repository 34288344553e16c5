"""A SCPI instrument over TCP that remembers settings by their header and notes every line: for dialects of real
families."""

import contextlib
import socket
import threading
import time

#: What a supply of the bench's own family answers while it is opened, and the question of each step.
OPENED = {
    "*IDN?": "SMA Actuator,Virtual Supply,7,stand-in",
    ":SYST:ERR?": '0,"No error"',
    ":OUTP:PROT:WDOG?": "1",
    ":OUTP:PROT:WDOG:SESS?": "1",
    ":OUTP:PROT:WDOG:DEL?": "1.0",
    ":OUTP?": "0",
    ":VOLT?": "6.0",
    ":VOLT:PROT?": "6.6",
    ":CURR:PROT?": "0.45",
    ":VOLT:PROT:STAT?": "1",
    ":CURR:PROT:STAT?": "1",
}
READ_BACK = ":CURR?;:OUTP?;:MEAS:VOLT?;:MEAS:CURR?;:OUTP:PROT:TRIP?"
SUPPLY = {**OPENED, READ_BACK: "0.1;1;0.65;0.1;NONE"}


class ScpiStandIn:
    """Answers ``replies`` (exact text → answer, or what makes it) and, for ``X?``, what ``X`` was last set to."""

    def __init__(self, replies):
        self.replies = dict(replies)
        self.lines = []
        self.silent_on = None  #: a line that gets no answer until ``release``
        self.release = threading.Event()
        self._settings = {}
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._connections = []
        self._acceptor = threading.Thread(target=self._accept, daemon=True)
        self._acceptor.start()

    @property
    def resource(self):
        return f"TCPIP::127.0.0.1::{self.port}::SOCKET"

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._server.accept()
                self._connections.append(connection)
                threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection):
        with contextlib.suppress(OSError), connection.makefile("rw", newline="\n") as stream:
            for line in stream:
                line = line.strip()
                self.lines.append(line)
                answer = self._answer(line)
                if answer is None:
                    continue
                if line == self.silent_on:
                    self.release.wait(10.0)
                stream.write(answer + "\n")
                stream.flush()

    def _answer(self, line):
        if line in self.replies:
            reply = self.replies[line]
            return reply() if callable(reply) else reply
        if "?" in line:
            return self._settings.get(self._place(line.replace("?", "")), "0")
        self._settings[self._place(line)] = self._value(line)
        return None

    @staticmethod
    def _place(line):
        """Header and channel of a command, without its value."""
        header, _, rest = line.partition(" ")
        channels = [part.strip() for part in rest.split(",") if part.strip().startswith(("(@", "CH"))]
        return (header, *channels)

    @staticmethod
    def _value(line):
        values = [part for part in line.partition(" ")[2].split(",") if not part.strip().startswith(("(@", "CH"))]
        return values[0] if values else ""

    def heard(self, line, times=1, within_s=60.0):
        """Whether a line has come so often; waits for it, since a command has no answer."""
        deadline_s = time.monotonic() + within_s
        while self.lines.count(line) < times and time.monotonic() < deadline_s:
            time.sleep(0.001)
        return self.lines.count(line) >= times

    def hang_up(self):
        """Close every connection."""
        for connection in self._connections:
            with contextlib.suppress(OSError):  # the other side is gone already
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def close(self):
        self.release.set()
        self.hang_up()
        # One that is closed under a thread that waits for it may, when a paused process goes on, take the next one's
        # clients.
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._acceptor.join(10.0)
        self._server.close()
