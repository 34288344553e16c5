"""Bytes over the USB port: MicroPython's standard streams."""

import select
import sys

_poll = select.poll()
_poll.register(sys.stdin, select.POLLIN)


def wait(most_ms):
    """Return when bytes have come, or after a time; interrupts are served meanwhile."""
    _poll.poll(most_ms)


def read():
    """What has come."""
    data = bytearray()
    while _poll.poll(0):
        data += sys.stdin.buffer.read(1)
    return data


def write(data):
    """Send; never with a carriage return before a line's end, as print would."""
    sys.stdout.buffer.write(data)
