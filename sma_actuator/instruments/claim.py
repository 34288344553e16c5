"""Who may speak to an instrument, among the programs of this computer."""

from __future__ import annotations

import contextlib
import hashlib
import socket
from pathlib import Path


def _claimed_name(resource: str) -> bytes:
    return b"\0sma_actuator " + hashlib.sha256(resource.encode()).hexdigest().encode()


class Claim:
    """The right to speak to an instrument, among the programs of this computer: held until released or until
    the process ends.  A name in Linux's abstract namespace of sockets, so there is nothing to be left behind."""

    def __init__(self, resource: str):
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.bind(_claimed_name(resource))
        except OSError:
            self._socket.close()
            raise

    def release(self) -> None:
        """Let others speak."""
        self._socket.close()

    @staticmethod
    def holder(resource: str) -> int | None:
        """The process that has claimed it, where there is one that we may look into."""
        name = _claimed_name(resource)[1:].decode()
        sockets = {
            line.split()[6] for line in Path("/proc/net/unix").read_text().splitlines() if line.endswith(f"@{name}")
        }
        wanted = {f"socket:[{inode}]" for inode in sockets}
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # it is another user's, or has just ended
                for handle in (process / "fd").iterdir():
                    with contextlib.suppress(OSError):  # it was closed meanwhile
                        if str(handle.readlink()) in wanted:
                            return int(process.name)
        return None
