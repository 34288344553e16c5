"""An instrument at the other end of TCP connections: a thread that answers lines by a function."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable


class TcpInstrument:
    """Answers every line, on every connection, by ``answer(line)``: a text, or None for nothing; ``slow_s`` later."""

    def __init__(self, answer: Callable[[str], str | None], hears: str = "\n", says: str = "\n", slow_s: float = 0.0):
        self.lines: list[str] = []
        self.slow_s = slow_s
        self._answer, self._hears, self._says = answer, hears.encode(), says.encode()
        self._turn = threading.Lock()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.resource = f"TCPIP::127.0.0.1::{self._server.getsockname()[1]}::SOCKET"
        self._connections: list[socket.socket] = []
        self._acceptor = threading.Thread(target=self._accept, daemon=True)
        self._acceptor.start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._server.accept()
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._connections.append(connection)
                threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        got = b""
        with contextlib.suppress(OSError):
            while came := connection.recv(4096):
                got += came
                while self._hears in got:
                    line, _, got = got.partition(self._hears)
                    with self._turn:
                        self.lines.append(line.decode())
                        if self.slow_s:
                            time.sleep(self.slow_s)
                        reply = self._answer(line.decode())
                    if reply is not None:
                        connection.sendall(reply.encode() + self._says)

    def close(self) -> None:
        for connection in self._connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._acceptor.join(10.0)
        self._server.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
