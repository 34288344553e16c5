"""Off for who is on the same computer: ``~/stop`` without DDS, which takes up to 3 s to find a node.

A process that drives wires listens on a socket for each of them; to connect is to ask, and the answer is JSON.  The
names are in Linux's abstract namespace, so there is nothing to be left behind.  Only the same user, and root, is heard
and believed: any program may listen on any name.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

Reply = Callable[[bool, str], None]  #: whether it was done, and a sentence

#: Processes that wait for an answer at once, and how many letters it may have.
_MOST_WAITING, _LONGEST_B = 64, 65_536
#: The kernel connects at once, whatever the process does, unless too many wait already.
_CONNECTED_s = 0.1
#: Where a connection could not be taken (no file is free, say), the next is, after so long.
_PAUSE_s = 0.1


def _name(service: str, domain: str) -> str:
    """How the names of those begin that serve ``service`` (``/left/stop``) in a ROS domain."""
    which = f"{int(domain or 0)}{service}"  # raises ValueError: ROS says of such a domain what is wrong
    return f"sma_actuator_{hashlib.sha256(which.encode()).hexdigest()}_"


def _is_trusted(connection: socket.socket) -> bool:
    _, user, _ = struct.unpack(
        "3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    )
    return user in (0, os.geteuid())


class StopListener:
    """Hears who asks for any of ``services``; ``stop(reply)``, which must not wait, is called for each.  Raises
    OSError."""

    def __init__(self, services: Sequence[str], domain: str, stop: Callable[[Reply], None]):
        self._stop, self._closing = stop, False
        self._sockets = []
        self._selector = selectors.DefaultSelector()
        for service in services:
            self._sockets.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            self._sockets[-1].bind(f"\0{_name(service, domain)}{secrets.token_hex(4)}".encode())
            self._sockets[-1].listen(_MOST_WAITING)
            self._selector.register(self._sockets[-1], selectors.EVENT_READ, self._sockets[-1])
        self._thread = threading.Thread(target=self._listen, daemon=True, name="local stop")
        self._thread.start()

    def _listen(self) -> None:
        while not self._closing:
            for key, _ in self._selector.select():
                try:
                    connection, _ = key.data.accept()
                except OSError:
                    if not self._closing:
                        time.sleep(_PAUSE_s)
                    continue
                if _is_trusted(connection):
                    connection.setblocking(False)
                    self._stop(partial(_answer, connection))
                else:
                    connection.close()
        for each in self._sockets:
            each.close()
        self._selector.close()

    def close(self) -> None:
        """Listen no more."""
        self._closing = True
        for each in self._sockets:
            with contextlib.suppress(OSError):  # closed already
                each.shutdown(socket.SHUT_RDWR)  # wakes the thread
        self._thread.join(1.0)


def _answer(connection: socket.socket, done: bool, words: str) -> None:
    with connection, contextlib.suppress(OSError):  # who has asked may be gone
        connection.send(json.dumps([done, words]).encode())


def ask_here(service: str, domain: str, patience_s: float) -> list[tuple[bool, str]]:
    """What the processes of this computer answer that serve ``service``: at most one, where names are given once.

    Raises TimeoutError where one has not answered within ``patience_s``.
    """
    asked, answers = [], list[tuple[bool, str]]()
    until_s = time.monotonic() + patience_s
    with contextlib.ExitStack() as stack:
        for name in _listening(service, domain):
            connection = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            connection.settimeout(_CONNECTED_s)
            with contextlib.suppress(OSError):  # it has ended meanwhile
                connection.connect(f"\0{name}".encode())
                if _is_trusted(connection):
                    asked.append(connection)
        for connection in asked:
            connection.settimeout(max(until_s - time.monotonic(), 1e-3))
            try:
                answer = connection.recv(_LONGEST_B)
            except TimeoutError:
                raise
            except OSError:
                continue
            if answer:
                done, words = json.loads(answer)
                answers.append((done, words))
    return answers


def _listening(service: str, domain: str) -> set[str]:
    try:
        beginning, names = f"@{_name(service, domain)}", Path("/proc/net/unix").read_text(encoding="utf-8")
    except (ValueError, OSError):
        return set()
    return {line.split()[-1][1:] for line in names.splitlines() if beginning in line}
