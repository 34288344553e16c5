"""Standard input, output and error, which a program may be started without."""

from __future__ import annotations

import os
import sys


def keep_standard_streams() -> None:
    """Give a process that was started with one of them closed (``2>&-``, some service managers) an empty one instead.

    Else the next connection that is opened takes its number, and whatever is written to standard error, also by the
    libraries below Python, goes to the power supply.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # the lowest free number
            assert opened == number
            setattr(sys, name, os.fdopen(number, mode))
