"""Addresses for benches that come back to where they were, or are told where to be."""

import random
import socket

#: Below the ports that systems give to outgoing connections (Linux from 32768, others from 49152): one of those may be
#: taken by any process between two lives of a bench, or by the very connection that looks for it.
OURS = range(20000, 32768)


def free_port() -> str:
    """A port of this computer where nothing listens, and that no outgoing connection gets."""
    while True:
        port = random.choice(OURS)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        return str(port)
