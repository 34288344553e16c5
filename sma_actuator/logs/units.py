"""Units that other people's logs are in, and what one of each is in the unit that is used here."""

from __future__ import annotations

import argparse
import math
import re
from dataclasses import dataclass

import numpy as np

GRAVITY_m_s2 = 9.80665  #: by which a mass is a force


@dataclass(frozen=True, slots=True)
class Unit:
    """SI value = factor × value + offset."""

    factor: float
    offset: float = 0.0

    def to_si(self, values: np.ndarray) -> np.ndarray:
        """Values in the unit that the column's name ends with."""
        return values if self == _SAME else self.factor * values + self.offset


_SAME = Unit(1.0)
_PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "k": 1e3}


def _prefixed(*symbols: str) -> dict[str, Unit]:
    return {prefix + symbol: Unit(factor) for symbol in symbols for prefix, factor in _PREFIXES.items()}


#: Unit of a column's name → the units that can be converted to it.
UNITS: dict[str, dict[str, Unit]] = {
    "s": {**_prefixed("s"), "ns": Unit(1e-9), "sec": Unit(1.0), "min": Unit(60.0), "h": Unit(3600.0)},
    "V": _prefixed("V"),
    "A": _prefixed("A"),
    "Ohm": _prefixed("Ohm", "ohm", "Ω", "Ω"),
    "W": _prefixed("W"),
    "N": {
        **_prefixed("N"),
        "cN": Unit(1e-2),
        "daN": Unit(10.0),
        "g": Unit(1e-3 * GRAVITY_m_s2),
        "gf": Unit(1e-3 * GRAVITY_m_s2),
        "kg": Unit(GRAVITY_m_s2),
        "kgf": Unit(GRAVITY_m_s2),
        **dict.fromkeys(("lb", "lbs", "lbf"), Unit(4.4482216152605)),
        **dict.fromkeys(("oz", "ozf"), Unit(4.4482216152605 / 16.0)),
    },
    "m": {
        **_prefixed("m"),
        "nm": Unit(1e-9),
        "cm": Unit(1e-2),
        "in": Unit(0.0254),
        "inch": Unit(0.0254),
        "mil": Unit(25.4e-6),
    },
    "C": {
        "C": _SAME,
        "°C": _SAME,
        "degC": _SAME,
        "K": Unit(1.0, -273.15),
        "F": Unit(5.0 / 9.0, -160.0 / 9.0),
        "°F": Unit(5.0 / 9.0, -160.0 / 9.0),
    },
    "Pa": {
        "Pa": _SAME,
        "kPa": Unit(1e3),
        "MPa": Unit(1e6),
        "GPa": Unit(1e9),
        "psi": Unit(6894.757293168),
        "bar": Unit(1e5),
    },
    "1": {"1": _SAME, "%": Unit(0.01), "percent": Unit(0.01), "pct": Unit(0.01)},
}
#: How parameters write a unit whose name in a column is another.
_TYPED = {"Ω": "Ohm", "°C": "C"}
#: Words for units, singular, and for prefixes; what stands for them above.
_WORDS = {
    word: symbol
    for symbol, words in {
        "V": "volt",
        "A": "ampere amp",
        "Ohm": "ohm",
        "W": "watt",
        "Pa": "pascal",
        "N": "newton",
        "g": "gram gramm",
        "lb": "pound",
        "oz": "ounce",
        "m": "metre meter",
        "um": "micron",
        "in": "inch inche",
        "mil": "thou",
        "s": "second sec",
        "min": "minute",
        "h": "hour",
        "C": "celsius",
        "K": "kelvin",
    }.items()
    for word in words.split()
}
_PREFIX_WORDS = {"nano": "n", "micro": "u", "milli": "m", "m": "m", "centi": "c", "kilo": "k", "mega": "M", "": ""}
_IN_WORDS = re.compile(rf"({'|'.join(_PREFIX_WORDS)})({'|'.join(_WORDS)})s?")


def quantity(text: str, unit: str) -> float | None:
    """The number that was typed, as ``0.15 mm`` or ``0.15e-3``, in ``unit``; None where it is no number with such a
    unit."""
    written = re.fullmatch(r"\s*([-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    if written is None:
        return None
    number, symbol = float(written[1].replace(",", ".")), written[2]
    if symbol in ("", unit):
        return number
    known = UNITS.get(_TYPED.get(unit, unit), {}).get(symbol)
    return None if known is None else float(f"{known.factor * number + known.offset:.12g}")


def unit_in_words(text: str, own: str) -> Unit | None:
    """What a text says that one of a column is, in ``own``: ``mm``, ``-mm`` (it counts the other way), ``1.5mm``; None
    where it says nothing."""
    sign, said = (-1.0, text[1:]) if text.startswith("-") else (1.0, text)
    number, symbol = 1.0, unit_of(said, own)
    if not symbol and (written := re.fullmatch(r"\s*(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*(\S+)", said)):
        number, symbol = float(written[1]), unit_of(written[2], own)
    if not symbol:
        return None
    unit = UNITS[own][symbol]
    return Unit(sign * number * unit.factor, sign * unit.offset)


def unit_of(text: str, own: str) -> str:
    """The unit that a text names, of those that can be converted to ``own``, whatever its capitals; "" where none or
    several are meant."""
    text = text.strip("()[] ")
    if text in UNITS[own]:
        return text
    alike = [unit for unit in UNITS[own] if unit.lower() == text.lower()]
    if len({UNITS[own][unit] for unit in alike}) == 1:
        return alike[0]
    words = _IN_WORDS.fullmatch(text.lower())
    symbol = _PREFIX_WORDS[words[1]] + _WORDS[words[2]] if words else ""
    return symbol if symbol in UNITS[own] else ""


def metres(text: str) -> float:
    """A length as it is typed at the command line, for argparse."""
    value_m = quantity(text, "m")
    if value_m is None or not 0.0 < value_m < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no length: 0.1 (metres), 100mm or 4in is wanted")
    return value_m


def is_unit(text: str) -> bool:
    """Whether a field is the name of a unit, or empty."""
    text = text.strip("[]() ")
    return not text or text == "-" or any(text in units for units in UNITS.values())
