"""Numbers of a command's options, refused in a sentence where they cannot be meant."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any


def number_within(low: float, high: float = math.inf, kind: type = float) -> Callable[[str], Any]:
    """What argparse is to make of a number of an option: ``kind``, from ``low`` to ``high``.

    What is returned raises argparse.ArgumentTypeError for any other text, ``nan`` too.
    """
    wanted = f"a {'whole ' if kind is int else ''}number from {low:g} {'up' if high == math.inf else f'to {high:g}'}"

    def convert(text: str) -> Any:
        try:
            if low <= (value := kind(text)) <= high:
                return value
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"'{text}' is not {wanted}")

    return convert
