"""How a family of instruments wants to be spoken to: data, not code.

A dialect is a YAML file (``docs/dialects.md`` describes how to write it; those that come with the package are in
``dialects/``).  Everything in it is checked when it is loaded, so a mistake is found before any
current flows.
"""

from __future__ import annotations

import difflib
import importlib.resources
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.plug_ins import MEND, PlugInError, described, load_plug_in
from sma_actuator.base.yaml_text import read_yaml

from .parameters import TERMINATIONS
from .patterns import Pattern
from .phrases import Command, Query, is_number, pattern_or_none, why_no_pattern

FOLDER = Path(__file__).parent / "dialects"
#: Entry points of other packages that bring a dialect: its name, and the package whose folder holds <name>.yaml.
GROUP = "sma_actuator.dialects"
#: What every instrument is asked and told unless its dialect says otherwise; ``null`` there: nothing.
STANDARD: dict[str, dict[str, Any]] = {"queries": {"identity": "*IDN?"}, "commands": {"clear_status": "*CLS"}}
_CHANNEL, _VALUE, _CHANNELS = (
    frozenset({"channel"}),
    frozenset({"channel", "value"}),
    frozenset({"channels", "samples", "readings"}),
)
_NOTHING: frozenset[str] = frozenset()
#: Placeholders each command may use, and each query with what its answer is (a key of ``phrases.READINGS``).
_COMMANDS: dict[str, dict[str, frozenset[str]]] = {
    "supply": {
        **dict.fromkeys(("remote", "local", "select", "clear_status", "prepare", "lock", "unlock"), _CHANNEL),
        **dict.fromkeys(("output_on", "output_off", "clear_trips", "disarm_watchdog"), _CHANNEL),
        **dict.fromkeys(("set_current", "set_voltage", "set_over_voltage", "set_over_current"), _VALUE),
        "arm_watchdog": _VALUE,
    },
    "daq": {
        **dict.fromkeys(("remote", "local", "clear_status"), _NOTHING),
        **dict.fromkeys(("prepare", "before_read"), _CHANNELS | _CHANNEL),
    },
}
_QUERIES: dict[str, dict[str, tuple[frozenset[str], str]]] = {
    "supply": {
        "identity": (_CHANNEL, "text"),
        **dict.fromkeys(("current_setting", "voltage_setting", "voltage", "current"), (_CHANNEL, "number")),
        **dict.fromkeys(("over_voltage_setting", "over_current_setting"), (_CHANNEL, "number")),
        **dict.fromkeys(("output", "over_voltage_on", "over_current_on"), (_CHANNEL, "truth")),
        **dict.fromkeys(("watchdog_armed", "watchdog_tied"), (_CHANNEL, "truth")),
        "watchdog_delay": (_CHANNEL, "number"),
        "error": (_CHANNEL, "code"),
    },
    "daq": {
        "identity": (_NOTHING, "text"),
        "ready": (_CHANNELS, "text"),
        "read": (_CHANNELS | _CHANNEL, "numbers"),
        "error": (_NOTHING, "code"),
    },
}
#: Placeholders without which a command would say the same whatever is wanted.
_NEEDED_PLACEHOLDERS = {
    "supply": dict.fromkeys(
        ("set_current", "set_voltage", "set_over_voltage", "set_over_current", "arm_watchdog"), "value"
    ),
    "daq": {},
}
#: Where a DAQ may be told which channels are read: as it takes them, once or with every reading.
_SAYS_CHANNELS = ("commands.prepare", "commands.before_read", "queries.read")
_CHANNELS_OR_COLUMNS = (
    f"{', '.join(_SAYS_CHANNELS)}: one with the placeholder {{channels}} is wanted; or with {{channel}}, said or asked "
    "of each; or, where every answer has all channels, queries.read.columns, how many"
)
_NEEDED: dict[str, dict[str, tuple[str, ...]]] = {
    "supply": {
        "commands": ("output_on", "output_off", "set_current", "set_voltage"),
        "queries": ("output", "voltage", "current"),
    },
    "daq": {"commands": (), "queries": ("read",)},
}
_KEYS_OF_ALL = {
    *("kind", "family", "source", "notes", "identity", "termination", "answer_termination", "acknowledgement"),
    *("acknowledges_answers", "command_pause", "commands", "queries"),
}
_KEYS = {
    "supply": _KEYS_OF_ALL
    | {"chained_queries", "watchdog_range_s", "watchdog_step_s", "watchdog_fed_by", "second_session", "trips"}
    | {"zero_current", "measures_while_off", "off_resets"},
    "daq": _KEYS_OF_ALL | {"measures_celsius"},
}
#: What ends a line sent to instruments that wait for no other end, nothing to those that wait until no more comes;
#: what ends lines, in words.
_SENT_ALONE = (";", "")
_ENDS = {"termination": r'"\n", "\r\n", "\r", ";" or "", nothing,', "answer_termination": r'"\n", "\r\n" or "\r"'}
#: True or false; what it is where a dialect says nothing.
_FLAGS = {
    "acknowledges_answers": False,
    "chained_queries": False,
    "measures_celsius": False,
    "second_session": False,
    "measures_while_off": True,
    "off_resets": False,
}


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
    """One family of instruments; see ``docs/dialect_entries.md`` for every entry."""

    path: Path
    kind: str  #: supply or daq
    family: str
    identity: Pattern
    terminations: tuple[str, str]  #: of a line sent, of a line of an answer
    acknowledgement: Pattern | None  #: the whole line that answers a command; None: a command has no answer
    acknowledges_answers: bool  #: whether that line follows every answer too
    command_pause_s: float  #: least time between its lines
    commands: Mapping[str, Command]
    queries: Mapping[str, Query]
    trips: Mapping[str, Query]  #: by word (OVP, OCP, OTP, WDOG) or ``*``
    zero_current_A: float  #: the least that it takes for 0 A
    chained_queries: bool
    measures_celsius: bool  #: whether the channel of a temperature sensor answers in °C
    measures_while_off: bool  #: whether voltage and current can be asked for while the output is off
    off_resets: bool  #: whether switching off changes settings
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
        place = "" if path.is_absolute() else f", looked for from {Path.cwd()},"
        return cls._checked(path, read_yaml(path, f"a dialect for instruments.{kind}.dialect{place}"), kind)

    @classmethod
    def _checked(cls, path: Path, document: Any, kind: str) -> Dialect:
        if not isinstance(document, Mapping) or document.get("kind") != kind:
            raise ConfigError(f"{path}: is not a dialect of kind '{kind}'; 'kind: {kind}' is wanted")
        problems = [
            f"{key}: no such entry; known are {', '.join(sorted(_KEYS[kind]))}"
            for key in document
            if key not in _KEYS[kind]
        ]
        commands = _commands(document, kind, problems)
        queries = _queries(document, kind, problems)
        trips = _trips(document.get("trips", {}), problems)
        if kind == "daq" and not problems and _says_channels(commands, queries) == bool(queries["read"].columns):
            problems.append(_CHANNELS_OR_COLUMNS)
        if {"arm_watchdog", "disarm_watchdog"} & set(commands):
            problems += _wrong_watchdog(document, queries)
        problems += _wrong_numbers(document)
        termination = document.get("termination", "\n")
        terminations = (termination, document.get("answer_termination", termination or "\n"))
        problems += [
            f"{key}: {value!r} ends no line; {_ENDS[key]} is wanted, in double quotes"
            for key, value in zip(_ENDS, terminations, strict=True)
            if value not in TERMINATIONS.values() and (key == "answer_termination" or value not in _SENT_ALONE)
        ]
        problems += _endless(document, termination, [*queries.items(), *trips.items()])
        flags = {key: document.get(key, default) for key, default in _FLAGS.items()}
        problems += [
            f"{key}: {value!r} is neither true nor false" for key, value in flags.items() if not isinstance(value, bool)
        ]
        acknowledgement = _acknowledgement(document, flags["acknowledges_answers"], problems)
        identity = _identity(document, queries, problems)
        if problems:
            raise ConfigError([f"{path}: {problem}" for problem in problems])
        return cls(
            path=path,
            kind=kind,
            family=document.get("family", path.stem),
            identity=identity,
            terminations=terminations,
            acknowledgement=acknowledgement,
            commands=commands,
            queries=queries,
            trips=trips,
            command_pause_s=float(document.get("command_pause", 0.0)),
            zero_current_A=float(document.get("zero_current", 0.0)),
            watchdog_range_s=(float(span[0]), float(span[1])) if (span := document.get("watchdog_range_s")) else None,
            watchdog_step_s=float(document.get("watchdog_step_s", 0.0)),
            watchdog_fed_by=document.get("watchdog_fed_by", ""),
            **flags,
        )

    @property
    def manner(self) -> tuple[tuple[str, str], Pattern | None, bool, float]:
        """How lines end, are acknowledged and follow each other, as :meth:`~.byte_streams.Manner.of` wants it."""
        return self.terminations, self.acknowledgement, self.acknowledges_answers, self.command_pause_s

    def lines(self, name: str, **values: Any) -> list[str]:
        """The texts of a command, filled in; none where the family has no such command."""
        return self.commands[name].lines(values) if name in self.commands else []

    def lines_of_each(self, name: str, numbers: Sequence[int], **values: Any) -> list[str]:
        """The texts of a DAQ's command, filled in; one with ``{channel}`` once for each channel."""
        return self.commands[name].lines_of_each(numbers, values) if name in self.commands else []

    def asked(self, **values: Any) -> tuple[dict[str, Query], dict[str, Query]]:
        """Queries and trips with their placeholders filled in.  Raises ConfigError for a channel without bits."""
        try:
            filled = (
                {name: query.filled(values) for name, query in each.items()} for each in (self.queries, self.trips)
            )
            return next(filled), next(filled)
        except KeyError as channel:
            raise ConfigError(
                f"instruments.{self.kind}.channel: {channel} is no channel of {self.family}: {self.path} has no mask "
                f"for it"
            ) from None

    def off_lines(self, channel: int, serial: bool = False) -> list[str]:
        """What is said blind, first and last on every connection; ``serial``: of a serial line."""
        return [
            *(self.lines("remote", channel=channel) if serial else ()),
            *self.lines("select", channel=channel),
            *self.lines("output_off", channel=channel),
            *self.lines("set_current", channel=channel, value=self.zero_current_A),
        ]

    def unlock_lines(self, channel: int, serial: bool = False) -> list[str]:
        """What gives its front panel back to people."""
        return [
            *self.lines("unlock", channel=channel),
            *(self.lines("local", channel=channel) if serial else ()),
        ]


def _section(document: Mapping[str, Any], group: str, kind: str, known: Collection[str], problems: list[str]) -> dict:
    """The entries of a group that there may be, with the standard ones; what is wrong goes to ``problems``."""
    entries = document.get(group, None if _NEEDED[kind][group] else {})
    if not isinstance(entries, Mapping):
        problems.append(f"{group}: missing; a section of texts is wanted")
        entries = {}
    problems += [
        f"{group}.{name}: no such entry; known are {', '.join(known)}" for name in entries if name not in known
    ]
    problems += [
        f"{group}.{name}: missing; the driver cannot do without it"
        for name in _NEEDED[kind][group]
        if entries.get(name) is None
    ]
    return {
        name: entry for name, entry in {**STANDARD[group], **entries}.items() if name in known and entry is not None
    }


def _commands(document: Mapping[str, Any], kind: str, problems: list[str]) -> dict[str, Command]:
    known, needed = _COMMANDS[kind], _NEEDED_PLACEHOLDERS[kind]
    read = {
        name: Command.read(f"commands.{name}", entry, known[name], needed.get(name), problems)
        for name, entry in _section(document, "commands", kind, known, problems).items()
    }
    return {name: command for name, command in read.items() if command is not None}


def _queries(document: Mapping[str, Any], kind: str, problems: list[str]) -> dict[str, Query]:
    known = _QUERIES[kind]
    read = {
        name: Query.read(f"queries.{name}", entry, *known[name], problems)
        for name, entry in _section(document, "queries", kind, known, problems).items()
    }
    return {name: query for name, query in read.items() if query is not None}


def _says_channels(commands: Mapping[str, Command], queries: Mapping[str, Query]) -> bool:
    texts = [*(text for name in commands for text in commands[name].texts), queries["read"].text]
    return any("{channel" in text for text in texts)


def _trips(entries: Any, problems: list[str]) -> dict[str, Query]:
    if not isinstance(entries, Mapping):
        problems.append(f"trips: {entries!r} is no section of queries")
        return {}
    problems += [
        f"trips.{word}: no such trip; OVP, OCP, OTP, WDOG or * is wanted"
        for word in entries
        if word not in ("OVP", "OCP", "OTP", "WDOG", "*")
    ]
    read = {
        word: Query.read(f"trips.{word}", entry, _CHANNEL, "words" if word == "*" else "truth", problems)
        for word, entry in entries.items()
    }
    return {word: query for word, query in read.items() if query is not None}


def _wrong_numbers(document: Mapping[str, Any]) -> list[str]:
    """What is wrong with its numbers."""
    problems = []
    span, step_s = document.get("watchdog_range_s"), document.get("watchdog_step_s", 0.0)
    if span is not None and not (
        isinstance(span, list) and len(span) == 2 and all(map(is_number, span)) and 0.0 <= span[0] <= span[1]
    ):
        problems.append(f"watchdog_range_s: {span!r} is not shortest and longest delay in seconds, as [1, 3600]")
    if not (is_number(step_s) and step_s >= 0.0):
        problems.append(f"watchdog_step_s: {step_s!r} is not a number of seconds")
    pause_s = document.get("command_pause", 0.0)
    if not (is_number(pause_s) and 0.0 <= pause_s <= 1.0):
        problems.append(f"command_pause: {pause_s!r} is not the least time between its lines, in seconds")
    zero_A = document.get("zero_current", 0.0)
    if not (is_number(zero_A) and 0.0 <= zero_A <= 1.0):
        problems.append(f"zero_current: {zero_A!r} is not the least current that it takes, in amperes")
    return problems


def _endless(document: Mapping[str, Any], termination: Any, queries: Sequence[tuple[str, Query]]) -> list[str]:
    """What is wrong where lines or answers have no end."""
    problems = []
    if termination == "" and not document.get("command_pause"):
        problems.append("command_pause: missing; where nothing ends a line (termination), a pause does, as 0.05 s")
    endless = {name for name, query in queries if query.length or query.bytes}
    lines = [name for name, _ in queries if name not in endless]
    if endless and "identity" in lines:
        problems.append("queries.identity: null is wanted where answers have no end: that of a name is not known")
    elif endless and lines:
        problems.append(f"queries {', '.join(lines)}: length is wanted of each where {', '.join(endless)} has it")
    return problems


def _acknowledgement(document: Mapping[str, Any], of_answers: Any, problems: list[str]) -> Pattern | None:
    """The whole line that answers a command, and ``of_answers`` an answer too; None where there is none."""
    if of_answers and "acknowledgement" not in document:
        problems.append("acknowledges_answers: acknowledgement is missing, the line that follows an answer")
    if "acknowledgement" not in document:
        return None
    found = pattern_or_none(document["acknowledgement"])
    if found is None:
        problems.append(
            f"acknowledgement: {document['acknowledgement']!r}; a regular expression for the whole line that "
            f"answers a command is wanted, in quotes{why_no_pattern(document['acknowledgement'])}"
        )
    return found


def _identity(document: Mapping[str, Any], queries: Mapping[str, Query], problems: list[str]) -> Pattern:
    """What it must say of itself; anything where it cannot be asked."""
    if "identity" not in queries:
        if "identity" in document:
            problems.append("identity: nothing is asked that could be held against it (queries.identity: null)")
        return Pattern("")
    asked = queries["identity"].text
    said = document.get("identity")
    identity = pattern_or_none(said, whole=False)
    if identity is None or identity.search(""):
        why = why_no_pattern(said, whole=False) or " (this one lets any instrument pass)"
        problems.append(f"identity: a regular expression for the answer to {asked} is wanted{why}")
    return identity or Pattern("")


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
