"""Other people's columns: which of theirs is which of ours, and in what unit.

Said on the command line (``--map resistance_Ohm=R --unit displacement_m=mm``) or once in a small YAML file::

    columns: {time_s: t, resistance_Ohm: R, current_A: I, load_N: 0.49, displacement_m: Pos}
    units: {time_s: ms, displacement_m: -mm}
    offsets: {displacement_m: 0.0041}

A number in place of a column holds for the whole log.  A minus before a unit turns the sign: ``-mm`` is what a sensor
gives that counts contraction.  A number before it is what one of theirs is: ``1mm`` for the percent of a wire of 100
mm, ``2.5mm`` for the volt of a sensor.  Without a word a column is taken only where its name leaves no choice: ours, or
ours with another unit at its end (``displacement_mm``).
"""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.errors import named
from sma_actuator.base.yaml_text import read_yaml, yaml_of

from .bench_log import COLUMNS, ELECTRICAL, LOAD, REFERENCE
from .errors import BenchLogError
from .tables import Table, holds_text
from .units import UNITS, Unit, unit_in_words, unit_of

_MISSPELT = 0.86  #: likeness above which a name is one of ours with a slip in it
_BRACKETS = re.compile(r"[(\[]\s*([^)\]]+?)\s*[)\]]")
_SECTIONS = ("columns", "units", "offsets")
#: Words of a displacement that grows as the wire shortens, where ours grows as it lengthens.
_CONTRACTS = frozenset({"contraction", "shortening", "kontraktion", "verkurzung", "contraccion", "contrazione"})
#: Words in other people's headers, without accents → what the column may be.
_HINTS: dict[str, frozenset[str]] = {
    ours: frozenset(words.split())
    for ours, words in {
        "time_s": "time t x_value elapsed timestamp seconds sec zeit uhrzeit temps heure tiempo hora tempo ora tijd "
        "时间 時間 时刻 時刻 시간",
        "resistance_Ohm": "resistance r res ohm ohms widerstand resistencia resistenza weerstand 电阻 電阻 抵抗 저항",
        "current_A": "current i amps amp ampere strom courant intensite corriente corrente stroom 电流 電流 전류",
        "wire_voltage_V": "voltage v u volts volt spannung tension voltaje tensione tensao 电压 電壓 電圧 전압",
        "power_W": "power p watt watts leistung puissance potencia potenza vermogen 功率 電力 전력",
        "load_N": "load force f weight tension mass kraft last masse gewicht zugkraft effort charge fuerza carga peso "
        "forza carico forca kracht 力 载荷 荷重 拉力 张力 하중",
        "displacement_m": f"{' '.join(_CONTRACTS)} displacement disp position pos x lvdt stroke extension strain "
        "elongation weg dehnung auslenkung verschiebung hub deplacement course allongement deformation desplazamiento "
        "posicion spostamento posizione deslocamento verplaatsing 位移 变形 変位 변위",
    }.items()
}
#: Shares that are taken for what they are shares of: (theirs, our unit) → what to say.
_ONE_OF_IT = {
    ("%", "m"): ": 1 % of a wire of 100 mm is --unit displacement_m=1mm",
    ("MPa", "N"): ": 1 MPa on a wire of 0.15 mm is --unit load_N=0.01767N",
}


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """What somebody said of their columns."""

    columns: Mapping[str, str | float] = field(default_factory=dict)  #: ours → theirs, or a number
    units: Mapping[str, str] = field(
        default_factory=dict
    )  #: ours → unit that theirs is in, "-" before it turns the sign
    offsets: Mapping[str, float] = field(default_factory=dict)  #: ours → what is added, in our unit
    known: tuple[str, ...] = tuple(COLUMNS)  #: the names that mean something

    def apply(self, table: Table) -> Table:
        """The table with our names and units.  Raises BenchLogError where that is not certain."""
        wanted, taken = self._sources(table)
        columns = {name: values for name, values in table.columns.items() if name not in taken}
        notes = list(table.notes)
        for ours, theirs in wanted.items():
            if isinstance(theirs, float):
                columns[ours] = np.full(len(next(iter(table.columns.values()))), theirs)
                continue
            unit, words = self._unit(ours, theirs, table)
            columns[ours] = unit.to_si(table.columns[theirs]) + self.offsets.get(ours, 0.0)
            if theirs != ours and ours not in self.columns:
                notes.append(f"column '{theirs}' is taken for {ours}{words and ', '}{words}")
            elif words and ours not in self.units:
                notes.append(f"{ours}: '{theirs}' is {words}")
        if self.known == tuple(COLUMNS):
            self._must_do(columns, table)
        moments = {
            ours: table.moments[theirs]
            for ours, theirs in wanted.items()
            if isinstance(theirs, str) and theirs in table.moments
        }
        return Table(columns, table.source, {}, table.texts, tuple(notes), table.first_line, moments=moments)

    def of(self, table: Table) -> ColumnMap:
        """What is made of a table's columns, with all that was not said: the same again for any table like it."""
        wanted, _ = self._sources(table)
        units = dict(self.units)
        for ours, theirs in wanted.items():
            if isinstance(theirs, str) and ours not in units:
                units[ours] = _unit_said(theirs, _own_unit(ours), table) or _own_unit(ours)
        units = {ours: unit for ours, unit in units.items() if ours in wanted and unit != _own_unit(ours)}
        return ColumnMap(wanted, units, self.offsets, self.known)

    def as_text(self) -> str:
        """As a file for ``--map-file``."""
        said = {"columns": dict(self.columns), "units": dict(self.units), "offsets": dict(self.offsets)}
        return yaml_of({name: entries for name, entries in said.items() if entries})

    def _sources(self, table: Table) -> tuple[dict[str, str | float], set[str]]:
        """Ours → theirs for every column that is there, and which of theirs are spoken for."""
        wanted: dict[str, str | float] = {}
        for ours, theirs in self.columns.items():
            if isinstance(theirs, str) and theirs not in table.columns:
                if ours in table.columns:
                    continue  # a log that has our name already, among others that have not
                if theirs in table.left_out:
                    what = holds_text({theirs: table.left_out[theirs]})
                    raise BenchLogError(
                        f"{table.source}: line {table.first_line}: --map {ours}={theirs}, but {what}, not numbers"
                    )
                raise BenchLogError(
                    f"{table.source}: line 1: no column '{theirs}' (--map {ours}={theirs}); found "
                    f"{', '.join(table.columns)}"
                )
            wanted[ours] = theirs
        said = {theirs for theirs in wanted.values() if isinstance(theirs, str)}
        for theirs in table.columns:
            guess = _ours(theirs, self.known)
            if guess is None or theirs in said or guess in self.columns:
                continue
            if guess in wanted:
                raise BenchLogError(
                    f"{table.source}: line 1: both '{wanted[guess]}' and '{theirs}' may be {guess}; say which with "
                    f"--map '{guess}={theirs}' or --map '{guess}={wanted[guess]}'"
                )
            wanted[guess] = theirs
        return wanted, said | {theirs for theirs in wanted.values() if isinstance(theirs, str)}

    def _unit(self, ours: str, theirs: str, table: Table) -> tuple[Unit, str]:
        """Unit of a column, and words for it where it is not ours."""
        own = _own_unit(ours)
        found = _unit_said(theirs, own, table)
        said = self.units.get(ours)
        if said is not None and found and unit_in_words(found, own) != unit_in_words(said.lstrip("-"), own):
            raise BenchLogError(
                f"{table.source}: line 1: --unit {ours}={said}, but '{theirs}' says {found}; if the file is wrong, "
                f"rename the column in it"
            )
        text = said if said is not None else found or _in_brackets(theirs) or own
        unit = unit_in_words(text, own)
        if unit is None:
            raise BenchLogError(
                f"{table.source}: line 1: '{theirs}' is in {text}, which is no unit of {ours}; say its own with "
                f"--unit: known are {', '.join(UNITS[own])}, or what one of it "
                f"is{_ONE_OF_IT.get((text, own), f', as --unit {ours}=1{own}')}"
            )
        return unit, "" if text == own else f"in {text}"

    def _must_do(self, columns: Mapping[str, np.ndarray], table: Table) -> None:
        """Raise BenchLogError with a proposal where columns are missing that others may be."""
        missing = [] if "time_s" in columns else ["time_s"]
        if not any(all(name in columns for name in pair) for pair in ELECTRICAL):
            missing += [n for n in ("resistance_Ohm", "current_A", "wire_voltage_V", "power_W") if n not in columns]
        missing += [] if any(name in columns for name in LOAD) else ["load_N"]
        missing += [] if any(name in columns for name in REFERENCE) else ["displacement_m"]
        free = [name for name in columns if name not in COLUMNS]
        proposals = {ours: _likeliest_first(ours, free) for ours in missing}
        for ours, found in proposals.items():  # what is the likeliest of one is none of another that has something else
            firsts = {each[0] for other, each in proposals.items() if other != ours and len(each) == 1}
            proposals[ours] = [n for n in found if n not in firsts] or found
        unnamed = [n for n in free if not any(n in found for found in proposals.values())]
        for ours, found in proposals.items():
            found += [] if found else [n for n in unnamed if unit_in(n, _own_unit(ours))]
        proposals = {ours: found for ours, found in proposals.items() if found}
        misspelt = any(difflib.get_close_matches(name.lower(), COLUMNS, cutoff=_MISSPELT) for name in free)
        if not proposals or set(missing) == {"displacement_m"} or (misspelt and len(proposals) == 1):
            return  # then check_bench_log says what is missing, and which column is nearly that
        words = []
        for ours, found in proposals.items():
            own = _own_unit(ours)
            guess = unit_in(found[0], own) or own
            if ours == "displacement_m" and _says(found[0], _CONTRACTS):
                guess = f"-{guess}"
            unit = f" --unit {ours}={guess}" if guess != own else ""
            others = f" (or {', '.join(repr(n) for n in found[1:])})" if len(found) > 1 else ""
            words.append(f"--map '{ours}={found[0]}'{unit}{others}")
        raise BenchLogError(
            f"{table.source}: line 1: the columns are {named(table.columns)}; say which is which, perhaps: "
            f"{' '.join(words)}"
        )


def _own_unit(ours: str) -> str:
    unit = ours.rsplit("_", 1)[-1]
    return unit if unit in UNITS else "1"


def _ours(theirs: str, known: tuple[str, ...]) -> str | None:
    """Our column of which this is the name, whatever unit it ends with; None where it is none."""
    if theirs in known:
        return theirs
    name = theirs.strip().replace(" ", "_")
    for ours in known:
        quantity = ours if _own_unit(ours) == "1" else ours.rsplit("_", 1)[0]
        base, separator, unit = (
            name[: len(quantity)],
            name[len(quantity) : len(quantity) + 1],
            name[len(quantity) + 1 :],
        )
        if base.lower() != quantity.lower():
            continue
        if (separator == "" and quantity == ours) or (separator == "_" and unit_of(unit, _own_unit(ours))):
            return ours
    return None


def unit_in(name: str, own: str) -> str:
    """Unit that a column's name says, as ``Pos (mm)``, ``Pos [mm]``, ``pos_mm``, ``Pos / mm``; "" where it says
    none."""
    last = re.search(r"[/_ ]\s*([^\s/_]+)$", _BRACKETS.sub("", name).rstrip())
    texts = [*_BRACKETS.findall(name), last[1] if last else ""]
    return next((unit for unit in (unit_of(text, own) for text in texts) if unit), "")


def _unit_said(theirs: str, own: str, table: Table) -> str:
    """Unit of a column that the file says: beside its name, whatever it is, or in it; "" where it says none."""
    beside = table.units.get(theirs, "")
    return unit_of(beside, own) or beside or unit_in(theirs, own)


def _in_brackets(name: str) -> str:
    """What stands in brackets in a column's name, which would be its unit; "" where it has no letters, as an index."""
    texts = reversed(_BRACKETS.findall(name))
    return next((text for text in texts if any(c.isalpha() or c in "%°" for c in text)), "")


def _other_unit_in(name: str, own: str) -> str:
    """Unit in brackets in a column's name that measures something else than ``own``, as percent of a length; "" where
    none does."""
    found = _in_brackets(name)
    return (
        found
        if (own != "1" and any(found in units for kind, units in UNITS.items() if kind not in (own, "1")))
        or found == "%"
        else ""
    )


def _likeliest_first(ours: str, free: Sequence[str]) -> list[str]:
    """Those that may be a column of ours by a word in their name and do not say a unit of something else: first those
    whose unit says so too, then those whose name means nothing else ("tension" is a load and, in French, a voltage)."""
    own = _own_unit(ours)
    may_be = [name for name in free if _means(name, ours) and _other_unit_in(name, own) in ("", "%")]
    return sorted(may_be, key=lambda n: (not unit_in(n, own), sum(_means(n, each) for each in _HINTS)))


def _means(theirs: str, ours: str) -> bool:
    return _says(theirs, _HINTS[ours])


def _says(theirs: str, words: frozenset[str]) -> bool:
    plain = "".join(c for c in unicodedata.normalize("NFKD", theirs.lower()) if not unicodedata.combining(c))
    return not words.isdisjoint([plain, *re.split(r"[\W\d_]+", plain)])


def column_map(
    maps: Sequence[str],
    units: Sequence[str],
    offsets: Sequence[str],
    file: Path | None,
    known: tuple[str, ...] = tuple(COLUMNS),
) -> ColumnMap:
    """The map of the options, each ``COLUMN=…``, over that of the file.  Raises BenchLogError."""
    said: dict[str, dict[str, Any]] = _read_file(file) if file else {section: {} for section in _SECTIONS}
    for section, words, option in zip(_SECTIONS, (maps, units, offsets), ("--map", "--unit", "--offset"), strict=True):
        for word in words:
            ours, separator, value = word.partition("=")
            if not separator:
                raise BenchLogError(f"{option} {word}: COLUMN=… is wanted, as {option} {_EXAMPLES[option]}")
            said[section][ours.strip()] = value.strip()
    for section, entries in said.items():
        for ours in entries:
            if ours not in known:
                raise BenchLogError(f"{section}: '{ours}' is no column here; known are {', '.join(known)}")
    for ours, unit in said["units"].items():
        own = _own_unit(ours)
        if unit_in_words(str(unit), own) is None:
            raise BenchLogError(
                f"unit of {ours}: '{unit}' is not one of {', '.join(UNITS[own])}, with a number before it or without"
                f"{_ONE_OF_IT.get((str(unit).lstrip('-'), own), '')}"
            )
    return ColumnMap(
        {ours: _number_or_name(theirs) for ours, theirs in said["columns"].items()},
        {ours: str(unit) for ours, unit in said["units"].items()},
        {ours: _number(f"offset of {ours}", value) for ours, value in said["offsets"].items()},
        known,
    )


_EXAMPLES = {"--map": "resistance_Ohm=R", "--unit": "displacement_m=mm", "--offset": "displacement_m=0.0041"}


def _read_file(path: Path) -> dict[str, dict[str, Any]]:
    data = read_yaml(path, "a map of columns")
    if not isinstance(data, dict) or not all(isinstance(data.get(s) or {}, dict) for s in _SECTIONS):
        raise BenchLogError(f"{path}: sections {', '.join(_SECTIONS)} are wanted, each of 'our_column: theirs'")
    unknown = [name for name in data if name not in _SECTIONS]
    if unknown:
        raise BenchLogError(f"{path}: '{unknown[0]}' is no section; {', '.join(_SECTIONS)} are")
    return {section: dict(data.get(section) or {}) for section in _SECTIONS}


def _number_or_name(value: Any) -> str | float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value)
    return number if math.isfinite(number) else str(value)


def _number(what: str, value: Any) -> float:
    number = _number_or_name(value)
    if isinstance(number, str):
        raise BenchLogError(f"{what}: '{value}' is not a number")
    return number
