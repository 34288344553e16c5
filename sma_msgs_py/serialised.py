"""Messages that differ in their stamp and their numbers alone: one is serialised, of the others only these are written.

To make a message of Python objects, and bytes of that, takes rclpy ten times as long, at every step of every wire.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from builtin_interfaces.msg import Time

#: What is looked for in the bytes of the first: no text holds them.
_STAMP = Time(sec=0x7E8EA1B7, nanosec=0x3B9AC9FE)
_NUMBER = -1.2345678901234567e-300


class Form:
    """The bytes of one message, and where in them stamp and numbers stand.

    ``make(stamp, numbers)`` makes it, of ``count`` numbers in the order in which they are sent.
    """

    def __init__(self, make: Callable[[Time, Sequence[float]], Any], count: int):
        # Not above: a process that forks nodes must not have rclpy, or they share what it says who they are by.
        from rclpy.serialization import serialize_message

        numbers = [struct.pack("=d", _NUMBER * (1.0 + index)) for index in range(count)]
        whole = serialize_message(make(_STAMP, [struct.unpack("=d", number)[0] for number in numbers]))
        stamp = struct.pack("=iI", _STAMP.sec, _STAMP.nanosec)
        places = [whole.index(number) for number in numbers]
        #: Which numbers stand one after the other, from one to before another.
        bounds = [0, *(after for after in range(1, count) if places[after] != places[after - 1] + 8), count]
        self._runs = list(pairwise(bounds))
        self._is_stamped = stamp in whole
        varying = [(whole.index(stamp), 8, "iI")] if self._is_stamped else []
        varying += [(places[begin], 8 * (end - begin), f"{end - begin}d") for begin, end in self._runs]
        form, at = "=", 0
        self._between: list[bytes] = []  #: what is the same in all of them, before, between and after
        for place, length, kind in varying:
            self._between.append(whole[at:place])
            form += f"{place - at}s{kind}"
            at = place + length
        self._between.append(whole[at:])
        self._pack = struct.Struct(f"{form}{len(whole) - at}s").pack

    def filled(self, stamp: Time, numbers: Sequence[float]) -> bytes:
        """The message with these."""
        parts: list[Any] = []
        between = iter(self._between)
        if self._is_stamped:
            parts += next(between), stamp.sec, stamp.nanosec
        for begin, end in self._runs:
            parts.append(next(between))
            parts += numbers[begin:end]
        return self._pack(*parts, *between)
