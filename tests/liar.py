"""A TCP proxy that lets an instrument hear everything, and lies about, holds back or stretches what it answers."""

from __future__ import annotations

import collections
import contextlib
import select
import socket
import threading
import time

#: Between two bytes of an answer that trickles: far less than any time-out.
TRICKLE_s = 0.03


class Liar:
    """Stands between a client and ``127.0.0.1:port``.

    ``manner`` says what becomes of the answers: ``honest``; ``mute`` (none), ``empty`` (a line with
    nothing), ``garbage``, ``endless`` (a byte now and then, never the end of the line), ``flood`` (as
    many bytes as go), ``twice`` (each line twice).  ``deaf`` reads nothing more from its clients; ``stubborn`` answers
    what it is asked and does nothing of what it is told.  Honest answers come ``late_s`` after they were given.
    """

    def __init__(self, port: int):
        self.manner = "honest"
        self.late_s = 0.0
        self.heard: list[tuple[float, str]] = []  #: when, what
        self.opened = 0  #: connections so far
        self._target = port
        self._server: socket.socket | None = None
        self._connections: list[socket.socket] = []
        self._ended = threading.Event()
        self.port = 0
        self.listen()

    @property
    def resource(self) -> str:
        """Its VISA resource."""
        return f"TCPIP::127.0.0.1::{self.port}::SOCKET"

    def listen(self) -> None:
        """Let clients in (again)."""
        self._server = socket.create_server(("127.0.0.1", self.port))
        self.port = self._server.getsockname()[1]
        threading.Thread(target=self._accept, args=(self._server,), daemon=True).start()

    def refuse(self) -> None:
        """Let nobody in any more."""
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()

    def hang_up(self) -> None:
        """End every connection."""
        for connection in self._connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        self._connections.clear()

    def close(self) -> None:
        """End everything."""
        self._ended.set()
        self.refuse()
        self.hang_up()

    def times_heard(self, line: str) -> int:
        """How often a line has come."""
        return [text for _, text in self.heard].count(line)

    def _accept(self, server: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = server.accept()
                self.opened += 1
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError), client, socket.create_connection(("127.0.0.1", self._target), 5.0) as target:
            self._connections += [client, target]
            late: collections.deque[tuple[float, bytes]] = collections.deque()
            for end in (client, target):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while not self._ended.is_set():
                if self.manner in ("endless", "flood") and not select.select([client, target], [], [], TRICKLE_s)[0]:
                    self._push(client)
                    continue
                while late and time.monotonic() >= late[0][0]:
                    client.sendall(late.popleft()[1])
                wait_s = max(0.0, min(TRICKLE_s, late[0][0] - time.monotonic())) if late else TRICKLE_s
                ready = select.select([target] if self.manner == "deaf" else [client, target], [], [], wait_s)[0]
                if client in ready:
                    data = client.recv(65536)
                    if not data:
                        return
                    self.heard += [(time.monotonic(), line) for line in data.decode().splitlines()]
                    target.sendall(self._obeyed(data))
                if target in ready:
                    data = target.recv(65536)
                    if not data:
                        return
                    if self.late_s and self.manner == "honest":
                        late.append((time.monotonic() + self.late_s, data))
                    else:
                        self._answer(client, data)

    def _obeyed(self, data: bytes) -> bytes:
        lines = data.splitlines(keepends=True)
        return data if self.manner != "stubborn" else b"".join(line for line in lines if b"?" in line)

    def _push(self, client: socket.socket) -> None:
        if self.manner == "endless":
            client.sendall(b"1")
            return
        client.settimeout(TRICKLE_s)
        with contextlib.suppress(TimeoutError):
            client.sendall(b"1" * 65536)
        client.settimeout(None)

    def _answer(self, client: socket.socket, data: bytes) -> None:
        said = {
            "honest": data,
            "stubborn": data,
            "empty": b"\n" * data.count(b"\n"),
            "garbage": b"\xff\x00what?\n" * data.count(b"\n"),
            "twice": b"".join(2 * line for line in data.splitlines(keepends=True)),
        }.get(self.manner, b"")
        if said:
            client.sendall(said)
