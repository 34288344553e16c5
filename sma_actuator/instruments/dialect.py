"""How a family of instruments wants to be spoken to: data, not code.

A dialect is a YAML file (``docs/dialects.md`` describes it; those that come with the package are in
``dialects/``).  Everything in it is checked when it is loaded, so a mistake is found before any
current flows.
"""

from __future__ import annotations

import difflib
import importlib.resources
import re
import string
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from math import copysign, inf, isfinite, nan
from pathlib import Path
from typing import Any

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.registry import MEND, PlugInError, described, load_plug_in
from sma_actuator.base.yaml_text import read_yaml

from .parameters import TERMINATIONS

FOLDER = Path(__file__).parent / "dialects"
#: Entry points of other packages that bring a dialect: its name, and the package whose folder holds <name>.yaml.
GROUP = "sma_actuator.dialects"
#: Placeholders each entry may use.
_SUPPLY_COMMANDS = {
    "prepare": {"channel"},
    "lock": {"channel"},
    "unlock": {"channel"},
    "output_on": {"channel"},
    "output_off": {"channel"},
    "set_current": {"channel", "value"},
    "set_voltage": {"channel", "value"},
    "set_over_voltage": {"channel", "value"},
    "set_over_current": {"channel", "value"},
    "clear_trips": {"channel"},
    "arm_watchdog": {"channel", "value"},
    "disarm_watchdog": {"channel"},
}
_SUPPLY_QUERIES = {
    name: {"channel"}
    for name in (
        "current_setting",
        "voltage_setting",
        "over_voltage_setting",
        "over_current_setting",
        "output",
        "voltage",
        "current",
        "watchdog_armed",
        "watchdog_tied",
        "watchdog_delay",
        "error",
    )
}
_DAQ_COMMANDS = {"prepare": {"channels", "samples", "readings"}, "before_read": {"channels", "samples", "readings"}}
_DAQ_QUERIES: dict[str, set[str]] = {
    "ready": {"channels", "samples", "readings"},
    "read": {"channels", "samples", "readings"},
    "error": set(),
}
#: Placeholders without which an entry would say the same whatever is wanted.
_NEEDED_PLACEHOLDERS = {
    **dict.fromkeys(("set_current", "set_voltage", "set_over_voltage", "set_over_current", "arm_watchdog"), "value"),
    "prepare": "channels",
}
#: What stands in for the placeholders when a file is checked.
_TRIAL = {"channel": 1, "value": 0.5, "channels": "101,102", "samples": 50, "readings": 100}
_KNOWN: dict[str, dict[str, dict[str, set[str]]]] = {
    "supply": {"commands": _SUPPLY_COMMANDS, "queries": _SUPPLY_QUERIES},
    "daq": {"commands": _DAQ_COMMANDS, "queries": _DAQ_QUERIES},
}
_NEEDED: dict[str, dict[str, tuple[str, ...]]] = {
    "supply": {
        "commands": ("output_on", "output_off", "set_current", "set_voltage", "clear_trips"),
        "queries": ("current_setting", "voltage_setting", "output", "voltage", "current"),
    },
    "daq": {"commands": ("prepare",), "queries": ("read",)},
}
_KEYS = {
    "supply": {
        "kind",
        "family",
        "source",
        "notes",
        "identity",
        "termination",
        "answer_termination",
        "chained_queries",
        "watchdog_range_s",
        "watchdog_step_s",
        "watchdog_fed_by",
        "second_session",
        "commands",
        "queries",
        "trips",
    },
    "daq": {
        "kind",
        "family",
        "source",
        "notes",
        "identity",
        "termination",
        "answer_termination",
        "measures_celsius",
        "commands",
        "queries",
    },
}
_YES = {"on", "yes", "true"}
_NO = {"off", "no", "false"}  #: not the empty answer: it proves nothing


def _named(name: str, kind: str) -> Path:
    """The file of a dialect by its name: this package's own, or one that another package brings.

    Raises ConfigError, or PlugInError where that package is broken.
    """
    path = FOLDER / f"{name}.yaml"
    if path.exists():
        return path
    brought = {point.name: point for point in entry_points(group=GROUP)}
    if name in brought:
        return _brought(brought[name])
    known = sorted([*(p.stem for p in FOLDER.glob("*.yaml")), *brought])
    near = difflib.get_close_matches(name, known, n=1)
    help_ = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}, or give the path of a YAML file"
    raise ConfigError(f"instruments.{kind}.dialect: there is no dialect '{name}'; {help_}")


def _brought(point: EntryPoint) -> Path:
    """The file ``<name>.yaml`` in the package that an entry point names.  Raises PlugInError where it is not there."""
    folder = Path(str(importlib.resources.files(load_plug_in(point))))
    path = folder / f"{point.name}.yaml"
    if not path.is_file():
        raise PlugInError(f"{described(point)} wants the file {path}, which is not there; {MEND}")
    return path


@dataclass(frozen=True, slots=True)
class Dialect:
    """One family of instruments; see ``docs/dialects.md`` for every entry."""

    path: Path
    kind: str  #: supply or daq
    family: str
    identity: re.Pattern
    terminations: tuple[str, str]  #: of a line sent, of a line of an answer
    commands: Mapping[str, tuple[str, ...]]
    queries: Mapping[str, str]
    trips: Mapping[str, str]  #: word (OVP, OCP, OTP, WDOG) or ``*`` → query
    chained_queries: bool
    measures_celsius: bool  #: whether the channel of a temperature sensor answers in °C
    watchdog_range_s: tuple[float, float] | None
    watchdog_step_s: float
    watchdog_fed_by: str  #: session or anyone; "" where there is none
    second_session: bool  #: whether it is known to listen to a second session beside one that hangs

    @classmethod
    def load(cls, name_or_path: str, kind: str) -> Dialect:
        """Read and check a dialect, by the name of one that comes with the package or by a path.

        Raises ConfigError; its sentences name the file and the entry.
        """
        path = Path(name_or_path)
        if path.suffix not in (".yaml", ".yml"):
            path = _named(name_or_path, kind)
        return cls._checked(path, read_yaml(path, f"a dialect for instruments.{kind}.dialect"), kind)

    @classmethod
    def _checked(cls, path: Path, document: Any, kind: str) -> Dialect:
        if not isinstance(document, Mapping) or document.get("kind") != kind:
            raise ConfigError(f"{path}: is not a dialect of kind '{kind}'; 'kind: {kind}' is wanted")
        problems = [
            f"{key}: no such entry; known are {', '.join(sorted(_KEYS[kind]))}"
            for key in document
            if key not in _KEYS[kind]
        ]
        commands, queries = (_texts(document, kind, group, problems) for group in ("commands", "queries"))
        problems += _wrong_trips(document.get("trips", {}))
        if {"arm_watchdog", "disarm_watchdog"} & set(commands):
            problems += _wrong_watchdog(document, queries)
        span, step_s = document.get("watchdog_range_s"), document.get("watchdog_step_s", 0.0)
        if span is not None and not (
            isinstance(span, list) and len(span) == 2 and all(map(_is_number, span)) and 0.0 <= span[0] <= span[1]
        ):
            problems.append(f"watchdog_range_s: {span!r} is not shortest and longest delay in seconds, as [1, 3600]")
        if not (_is_number(step_s) and step_s >= 0.0):
            problems.append(f"watchdog_step_s: {step_s!r} is not a number of seconds")
        termination = document.get("termination", "\n")
        terminations = {
            "termination": termination,
            "answer_termination": document.get("answer_termination", termination),
        }
        problems += [
            f'{key}: {value!r} ends no line; "\\n", "\\r\\n" or "\\r" is wanted, in double quotes'
            for key, value in terminations.items()
            if value not in TERMINATIONS.values()
        ]
        flags = {key: document.get(key, False) for key in ("chained_queries", "measures_celsius", "second_session")}
        problems += [
            f"{key}: {value!r} is neither true nor false" for key, value in flags.items() if not isinstance(value, bool)
        ]
        identity = re.compile("")
        try:
            identity = re.compile(document["identity"])
            if identity.search(""):
                problems.append(
                    "identity: a regular expression for the answer to *IDN? is wanted (this one lets any instrument pass)"
                )
        except (KeyError, TypeError, re.error) as error:
            problems.append(f"identity: a regular expression for the answer to *IDN? is wanted ({error})")
        if problems:
            raise ConfigError([f"{path}: {problem}" for problem in problems])
        return cls(
            path=path,
            kind=kind,
            family=document.get("family", path.stem),
            identity=identity,
            terminations=(terminations["termination"], terminations["answer_termination"]),
            commands=commands,
            queries={name: lines[0] for name, lines in queries.items()},
            trips=document.get("trips", {}),
            watchdog_range_s=(float(span[0]), float(span[1])) if span else None,
            watchdog_step_s=float(step_s),
            watchdog_fed_by=document.get("watchdog_fed_by", ""),
            **flags,
        )

    def lines(self, name: str, **values: Any) -> list[str]:
        """The texts of a command, filled in; none where the family has no such command."""
        return [line.format(**values) for line in self.commands.get(name, ())]

    def query(self, name: str, **values: Any) -> str:
        """The text of a query, filled in."""
        return self.queries[name].format(**values)


def _texts(document: Mapping[str, Any], kind: str, group: str, problems: list[str]) -> dict[str, tuple[str, ...]]:
    """The SCPI texts of a group by name; what is wrong with them goes to ``problems``."""
    known = _KNOWN[kind][group]
    entries = document.get(group)
    if not isinstance(entries, Mapping):
        problems.append(f"{group}: missing; a section of SCPI texts is wanted")
        entries = {}
    texts = {}
    for name, text in entries.items():
        lines = (text,) if isinstance(text, str) else tuple(text) if isinstance(text, list) else ()
        if name not in known:
            problems.append(f"{group}.{name}: no such entry; known are {', '.join(known)}")
            continue
        if not lines or not all(isinstance(line, str) and line for line in lines):
            problems.append(f"{group}.{name}: {text!r} is neither a SCPI text nor a list of them")
            continue
        if group == "queries" and len(lines) != 1:
            problems.append(f"queries.{name}: {text!r} has {len(lines)} texts; a query has one")
        problems += _wrong_placeholders(f"{group}.{name}", lines, known[name])
        texts[name] = lines
    problems += [
        f"{group}.{name}: missing; the driver cannot do without it"
        for name in _NEEDED[kind][group]
        if name not in entries
    ]
    return texts


def _wrong_trips(trips: Any) -> list[str]:
    if not isinstance(trips, Mapping) or not all(isinstance(query, str) and query for query in trips.values()):
        return [f"trips: {trips!r} is no section of SCPI texts"]
    problems = []
    for word, query in trips.items():
        if word not in ("OVP", "OCP", "OTP", "WDOG", "*"):
            problems.append(f"trips.{word}: no such trip; OVP, OCP, OTP, WDOG or * is wanted")
        problems += _wrong_placeholders(f"trips.{word}", (query,), {"channel"})
    return problems


def _wrong_watchdog(document: Mapping[str, Any], queries: Collection[str]) -> list[str]:
    problems = []
    if not {"watchdog_armed", "watchdog_delay"} <= set(queries):
        problems.append("queries.watchdog_armed, watchdog_delay: missing; a watchdog that cannot be read back is none")
    if document.get("watchdog_fed_by") not in ("session", "anyone"):
        problems.append(
            "watchdog_fed_by: session, where only the connection that armed the watchdog feeds it, or anyone is wanted"
        )
    if "watchdog_range_s" not in document:
        problems.append("watchdog_range_s: missing; shortest and longest delay in seconds are wanted")
    return problems


def yes(reply: str) -> bool:
    """A boolean reply: a word, or a number as SCPI may write it (``1``, ``+1``, ``1.000000E+00``).

    Raises ValueError for one that is none.
    """
    word = reply.strip().strip('"').lower()
    if word in _YES or word in _NO:
        return word in _YES
    if re.fullmatch(r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?", word) and float(word) in (0.0, 1.0):
        return float(word) == 1.0
    raise ValueError(f"'{reply}' is neither on nor off")


def number(reply: str) -> float:
    """A numeric reply; 9.91e37 is SCPI's NaN, ±9.9e37 its infinity (SCPI-99, 7.2.1.4, 7.2.1.5).

    Raises ValueError for one that is none.
    """
    if "_" in reply:  # Python's own way to write numbers
        raise ValueError(f"'{reply}' is not a number")
    value = float(reply)
    if isfinite(value) and abs(value) >= 9.9e37:
        return nan if abs(value) > 9.905e37 else copysign(inf, value)
    return value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _wrong_placeholders(name: str, lines: tuple[str, ...], allowed: set[str]) -> list[str]:
    problems = []
    seen: set[str] = set()
    for line in lines:
        try:
            used = {field for _, field, _, _ in string.Formatter().parse(line) if field is not None}
        except ValueError as error:
            problems.append(f"{name}: '{line}' cannot be filled in ({error})")
            continue
        for field in sorted(used - allowed):
            choice = ", ".join("{" + a + "}" for a in sorted(allowed)) or "none"
            problems.append(f"{name}: '{line}' has the placeholder {{{field}}}; allowed are {choice}")
        seen |= used
        if used <= allowed:
            try:
                line.format(**_TRIAL)
            except (ValueError, TypeError) as error:
                problems.append(f"{name}: '{line}' cannot be filled in ({error})")
    needed = _NEEDED_PLACEHOLDERS.get(name.partition(".")[2])
    if name.startswith("commands.") and needed in allowed and needed not in seen:
        problems.append(f"{name}: {' | '.join(lines)!r} has no placeholder {{{needed}}}")
    return problems
