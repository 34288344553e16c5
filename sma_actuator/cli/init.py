"""``sma-actuator init``: a few questions, and a bench file that is complete.

What follows from the answers (limits, trips, gains, thresholds) is derived, and the file says from what.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parameters import ConfigError, check, from_mapping, look_up, refuse
from sma_actuator.base.sections import Loop, Wire
from sma_actuator.base.yaml_text import parse_yaml
from sma_actuator.config import (
    BenchConfig,
    Config,
    config_from_mapping,
    require_calibrated,
    write_parameter_file,
)
from sma_actuator.console import (
    add_output_arguments,
    notes,
    questions,
    refuse_to_overwrite,
    results,
    say_next,
    typed,
    write_json,
)
from sma_actuator.console.asking import Asking, read_answers
from sma_actuator.derived import LARGEST_RESISTIVITY_Ohm_m, derived, without_derived
from sma_actuator.estimation.circuit import Circuit
from sma_actuator.instruments.dialect import FOLDER, Dialect
from sma_actuator.instruments.scpi import abilities_of
from sma_actuator.instruments.session import no_resource
from sma_actuator.logs.units import quantity


@dataclass(frozen=True, slots=True)
class Question:
    """One parameter that nothing else tells."""

    name: str  #: dotted
    words: str
    explained: str  #: what a person is told who answers with a question mark
    default: str | None = None  #: what an empty answer means; None: there must be one
    when: Callable[[Mapping[str, Any]], bool] = lambda mapping: True
    of: str = ""  #: asked only where this was asked: a file that has the instrument has its usual channels too


def _dialects(kind: str) -> str:
    return ", ".join(sorted(p.stem for p in FOLDER.glob("*.yaml") if f"kind: {kind}" in p.read_text(encoding="utf-8")))


def _wants(acknowledgement: str) -> Callable[[Mapping[str, Any]], bool]:
    """Whether the supply of a mapping is opened only where this parameter is true."""

    def when(mapping: Mapping[str, Any]) -> bool:
        dialect = _supply_dialect(mapping)
        return dialect is not None and acknowledgement in abilities_of(dialect, watched=True).unsafe_states()

    return when


QUESTIONS = (
    Question(
        "wire.alloy",
        "Alloy of the wire: ni-ti or ni-ti-cu?",
        "Flexinol and most wires that are sold for actuators are ni-ti. Ni-Ti-Cu (as Furukawa NT-H7) has some 10 % "
        "copper; the packet says so.",
    ),
    Question(
        "wire.form",
        "One straight wire, a coil of one, or a bundle of several on one load: wire, coil or bundle (Enter: wire)?",
        "A coil is a spring that is wound of the wire; a bundle is several straight wires that pull side by side: "
        "docs/coils.md.",
        "wire",
        when=lambda mapping: _get(mapping, "wire.length") is None,
    ),
    Question(
        "wire.coil_diameter",
        "Mean diameter of the coil, as 1.5mm?",
        "From the middle of the wire to the middle of the wire across: the outer diameter less that of the wire. Load "
        "over stress goes with 1/D, the stroke with D. A bare number is metres.",
        when=lambda mapping: _get(mapping, "wire.form") == "coil",
    ),
    Question(
        "wire.length",
        "Length of the coil's wire, 3.14 × mean diameter × active turns, as 115mm?",
        "Resistance, stroke and the current it bears follow from it. Straight ends that carry current but do not "
        "twist belong to circuit.lead_resistance. A bare number is metres.",
        when=lambda mapping: _get(mapping, "wire.form") == "coil",
    ),
    Question(
        "wire.wires",
        "How many wires are in the bundle, as 4?",
        "They share the load: stress is the load over all of their cross-sections.",
        when=lambda mapping: _get(mapping, "wire.form") == "bundle",
    ),
    Question(
        "wire.connection",
        "Does the current go through them one after the other or through all at once: series or parallel?",
        "In series each has all of the current, and one that breaks stops it. In parallel they share it, and when one "
        "breaks the others have its share too.",
        when=lambda mapping: _get(mapping, "wire.form") == "bundle",
    ),
    Question(
        "wire.length",
        "Length of the wire between its crimps, as 100mm?",
        "From crimp to crimp, pulled straight and cold. Resistance, stroke and the current it bears follow from it. A "
        "bare number is metres.",
    ),
    Question(
        "wire.diameter",
        "Diameter of the wire, as 0.15mm or 0.006in?",
        "As on the packet. An error of 5 % here is 10 % in stress. A bare number is metres.",
    ),
    Question(
        "circuit.reference_resistance",
        "Sense resistor in series with the wire, as 1ohm?",
        "The current is measured as the voltage across it, so it must be known well: a four-wire resistor of 0.1 to 1 "
        "Ω, 0.1 % or better, that bears the power (1 Ω at 400 mA: 0.16 W, so take 1 W) and hardly warms.",
    ),
    Question(
        "instruments.supply.resource",
        "Power supply, as TCPIP::192.168.0.5::5025::SOCKET?",
        "Its VISA address. Over the network: the address that its menu shows, with port 5025 for most makes, 5555 for "
        "Rigol's (see its manual). USB: USB0::…::INSTR, a serial line: ASRL/dev/ttyUSB0::INSTR; `pyvisa-shell`, then "
        "`list`, shows what is found.",
    ),
    Question(
        "instruments.supply.dialect",
        f"Language of the power supply: {_dialects('supply')}, or the path of a file?",
        "The commands of its family. Another family is a short file of your own, no code: docs/dialects.md.",
        when=lambda mapping: not _get(mapping, "instruments.supply.pymeasure_class"),
    ),
    Question(
        "instruments.supply.channel",
        "Output of the power supply (Enter: 1)?",
        "The number of the output that the wire hangs on; a supply with one output has 1.",
        "1",
        of="instruments.supply.resource",
    ),
    Question(
        "supply.allow_no_watchdog",
        "This supply has no watchdog, so a killed computer leaves the current on; true accepts that, wired against "
        "(docs/safety.md); true or false?",
        "A watchdog is the supply's own timer: it cuts the output when the computer falls silent. Without one "
        "max_current must be what the wire survives for ever (it is, as derived here), and something else has to cut "
        "when nobody is there.",
        when=_wants("allow_no_watchdog"),
    ),
    Question(
        "supply.allow_shared_watchdog",
        "The watchdog of this supply is fed by anybody's words; true accepts that, on a network of its own "
        "(docs/safety.md); true or false?",
        "Whoever else speaks to it, as a web page of the supply left open, keeps the current of a dead computer on.",
        when=_wants("allow_shared_watchdog"),
    ),
    Question(
        "supply.allow_single_session",
        "This supply is not known to take a second session, so where the first hangs nobody can switch it off; true "
        "accepts that, with a switch in reach (docs/safety.md); true or false?",
        "Where the connection hangs, off is said over another one. This supply may not hear it: wire a switch into its "
        "output.",
        when=_wants("allow_single_session"),
    ),
    Question(
        "supply.allow_no_trips",
        "Not every trip of this supply can be read back, so nothing in it stands against a wrong setting; true "
        "accepts that, with a fuse in series (docs/safety.md); true or false?",
        "Over-voltage and over-current trip, and the compliance voltage, are programmed on opening and read back "
        "where the supply tells them. Take a fuse that the wire survives for ever.",
        when=_wants("allow_no_trips"),
    ),
    Question(
        "instruments.daq.resource",
        "Data acquisition, as TCPIP::192.168.0.6::5025::SOCKET?",
        "The VISA address of the instrument that reads the voltages, as that of the supply.",
    ),
    Question(
        "instruments.daq.dialect",
        f"Language of the data acquisition: {_dialects('daq')}, or the path of a file?",
        "The commands of its family. Another family is a short file of your own, no code: docs/dialects.md.",
        when=lambda mapping: not _get(mapping, "instruments.daq.package"),
    ),
    Question(
        "instruments.daq.supply_voltage_channel",
        "Channel across wire, leads and sense resistor together (Enter: 101)?",
        "Its taps sit at the supply's end of the wire's lead and at the far end of the sense resistor, so that it "
        "sees the whole circuit: U1 in the drawing of docs/first_wire.md. 101 is slot 1, channel 01 of a Keysight or "
        "Keithley mainframe.",
        "101",
        of="instruments.daq.resource",
    ),
    Question(
        "instruments.daq.reference_voltage_channel",
        "Channel across the sense resistor alone (Enter: 102)?",
        "Its taps sit right at the resistor, beside the current's terminals: U2 in the drawing of docs/first_wire.md.",
        "102",
        of="instruments.daq.resource",
    ),
    Question(
        "instruments.daq.load_cell_channel",
        "Channel of the load cell's amplifier (Enter: 103)?",
        "The amplifier's output voltage, U3 in the drawing of docs/first_wire.md.",
        "103",
        of="instruments.daq.resource",
    ),
    Question(
        "load_cell.slope",
        "Load cell, newtons per volt (Enter: `characterise` will measure it)?",
        "From its data sheet and the amplifier's gain: 78.6 mV per N are 1 / 0.0786 = 12.7 N/V. Negative where the "
        "voltage falls when the wire pulls. With a few known masses `characterise` measures it better than any data "
        "sheet.",
        "",
    ),
    Question(
        "load_cell.offset",
        "Load at zero volts of the load cell, as 0N?",
        "Usually near zero; `sma-actuator call tare_load` corrects it later.",
        "0.0",
        lambda mapping: _get(mapping, "load_cell.slope") is not None,
    ),
    Question(
        "instruments.daq.lvdt_channel",
        "Channel of a displacement sensor beside the wire (Enter: none)?",
        "An LVDT or laser that measures the end of the wire, for `characterise` and `identify` only; afterwards it "
        "may go. Without one bring logs with a displacement from elsewhere.",
        "0",
    ),
    Question(
        "thermal.ambient_temperature",
        "The warmest that the surroundings become, in °C (Enter: 24)?",
        "The current that the wire survives for ever is reckoned from here. In an enclosure it is warmer than in the "
        "room.",
        "24.0",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator init``."""
    parser.add_argument(
        "--start", type=Path, metavar="FILE.yaml", help="parameters that stand already, as a model that identify wrote"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an answer, or any other parameter, as wire.length=0.1; may be repeated",
    )
    parser.add_argument(
        "--answers", type=Path, metavar="ANSWERS.yaml", help="answers and parameters in a file, as 'wire.length: 0.1'"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("bench.yaml"), metavar="BENCH.yaml", help="file to write (default %(default)s)"
    )
    add_output_arguments(parser, "the parameters")


def run(args: argparse.Namespace) -> int:
    """Ask, derive, check and write; 0 when the file was written."""
    refuse_to_overwrite(args, args.out)
    console = notes(args)
    mapping = read_parameter_file(args.start) if args.start else {}
    answers = _answers(args)
    with contextlib.suppress(ConfigError):  # of a wire that is not known yet nothing follows
        # So that limits, gains and blocks are of what is answered now.
        mapping, _ = without_derived(mapping, other_rate="loop.rate" in answers)
    if "wire.length" in answers and _get(mapping, "wire.form") is None:  # who says the size says the form too
        answers.setdefault(
            "wire.form", "coil" if "wire.coil_diameter" in answers else "bundle" if "wire.wires" in answers else "wire"
        )
    _of_other_instruments(mapping, answers)
    asked = {question.name for question in QUESTIONS}
    for name in [name for name in answers if name not in asked]:
        _put(mapping, name, _value(name, answers.pop(name)))
    for name, text in answers.items():  # before anything is asked
        if text not in ("", None) and not isinstance(text, list):
            _value(name, text)
    given = _asked(mapping, answers, args.start, console)
    _without_watchdog(mapping)
    comments = dict.fromkeys(given, "given")
    found = derived(mapping)
    _refuse_voltage(mapping, found["supply.max_voltage"].value)
    for name, each in found.items():
        if _get(mapping, name) is None:
            _put(mapping, name, each.value)
        if name not in comments and _get(mapping, name) == each.value:
            comments[name] = each.why
    mapping = _in_order(mapping)
    bench = config_from_mapping(mapping)
    write_parameter_file(
        args.out, mapping, "Written by `sma-actuator init`: what was asked, and what follows from it.", comments
    )
    out = results(args)
    table = Table(title="Derived", show_header=True)
    for header in ("parameter", "value", "from"):
        table.add_column(header)
    for name in (name for name in found if name in comments):
        table.add_row(name, _with_unit(name, _get(mapping, name)), comments[name])
    out.print(table)
    write_json(args, mapping)
    console.print(f"wrote {args.out}")
    say_next(args, _next(bench, args.out))
    return 0


def _asked(mapping: dict[str, Any], answers: Mapping[str, Any], start: Path | None, console: Console) -> set[str]:
    """Put what was answered into ``mapping``: what it lacks, and what somebody says although it stands there; their
    names."""
    asking = Asking(questions(), answers)
    asked: set[str] = set()
    changed: set[str] = set()
    told = False
    for question in QUESTIONS:
        is_new = question.of in asked or question.of.replace(".resource", ".dialect") in changed
        if question.name in asked or (question.of and not is_new and question.name not in answers):
            continue
        stands = _get(mapping, question.name)
        if stands is not None and answers.get(question.name) not in (None, "", []):
            _put(mapping, question.name, value := _answer(question, asking, mapping))
            if value != stands:
                changed.add(question.name)
                console.print(f"{question.name}: {value}, instead of the {stands} of {start}")
        elif stands is None and question.when(mapping):
            if not told and not asking.answered(question.name):
                asking.say("numbers may have a unit: 100mm, 0.15 mm, 400mA; a lone ? explains the question")
                told = True
            answer = _answer(question, asking, mapping)
            if answer is not None:
                _put(mapping, question.name, answer)
                asked.add(question.name)
    return asked | changed


def _answers(args: argparse.Namespace) -> dict[str, Any]:
    """What was answered before anything is asked, in a file and in words."""
    answers = read_answers(args.answers)
    for word in args.set:
        name, equals, text = word.partition("=")
        if not equals or "." not in name:
            raise ConfigError(f"--set {word}: SECTION.PARAMETER=VALUE is wanted, as wire.length=0.1")
        answers[name] = text
    return answers


def _answer(question: Question, asking: Asking, mapping: Mapping[str, Any]) -> Any:
    """A value that will do; asked again where a person's will not.  None: left open."""
    while True:
        from_file = asking.answered(question.name)
        text = asking.ask(question.name, question.words, may_be_empty=question.default is not None)
        if text == "?" and not from_file:
            asking.say(f"  {question.explained}")
            continue
        if not text:
            if question.default is None:
                asking.say("an answer is wanted")
                continue
            if not question.default:
                return None
            text = question.default
        try:
            value = _value(question.name, text)
            _refuse_no_resource(question.name, value, mapping)
            if isinstance(value, float) and not from_file:
                asking.say(f"  {_with_unit(question.name, value)}")
            return value
        except ConfigError as error:
            if from_file:
                raise
            asking.say(str(error))


def _refuse_no_resource(name: str, value: Any, mapping: Mapping[str, Any]) -> None:
    """Raise ConfigError for an address that no instrument has, unless it is one of a maker's package, which has names
    of its own."""
    if name == "instruments.supply.resource" or (
        name == "instruments.daq.resource" and not _get(mapping, "instruments.daq.package")
    ):
        problem = no_resource(name, value)
        refuse([problem] if problem else [], "")


def _refuse_voltage(mapping: Mapping[str, Any], wanted_V: float) -> None:
    """Raise ConfigError where nobody gave a voltage and no supply has what the circuit wants: it names the larger
    resistance."""
    declaration, _ = look_up(BenchConfig, "supply.max_voltage")
    if _get(mapping, "supply.max_voltage") is not None or wanted_V <= declaration.hi:
        return
    wire, _ = from_mapping(Wire, mapping["wire"], "wire.")
    circuit, _ = from_mapping(Circuit, mapping.get("circuit") or {}, "circuit.")
    wire_Ohm = wire.resistance_Ohm(LARGEST_RESISTIVITY_Ohm_m)
    sense_Ohm = circuit.reference_resistance if circuit is not None else 0.0
    wants = f"want {wanted_V:g} V, and supply.max_voltage is {declaration.hi:g} V at the most"
    if sense_Ohm > wire_Ohm:
        raise ConfigError(
            f"circuit.reference_resistance: {sense_Ohm:g} Ω and a wire of {wire_Ohm:.3g} Ω {wants}; a sense resistor "
            "of a fifth of the wire's resistance or less is usual"
        )
    raise ConfigError(f"wire.length, wire.diameter: a wire of {wire_Ohm:.3g} Ω and its sense resistor {wants}")


def _value(name: str, text: Any) -> Any:
    """The value of a parameter from text or YAML.  Raises ConfigError."""
    declaration, kind = look_up(BenchConfig, name)
    value = quantity(text, declaration.unit) if isinstance(text, str) and kind == "float" else None
    if value is None:
        value = parse_yaml(text, name) if isinstance(text, str) and kind != "str" else text
    if kind == "float" and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    value, problem = check(name, value, declaration, kind)
    if problem:
        raise ConfigError(problem)
    if name.endswith(".dialect"):
        Dialect.load(value, name.split(".")[1])
        if Path(value).suffix in (".yaml", ".yml"):  # one's own: the node may be started in another folder
            return str(Path(value).absolute())
    return list(value) if isinstance(value, tuple) else value


def _with_unit(name: str, value: float) -> str:
    unit = look_up(BenchConfig, name)[0].unit
    return f"{value:g}{'' if unit == '1' else f' {unit}'}"


def _get(mapping: Mapping[str, Any], name: str) -> Any:
    place: Any = mapping
    for part in name.split("."):
        place = place.get(part) if isinstance(place, Mapping) else None
    return place


def _supply_dialect(mapping: Mapping[str, Any]) -> Dialect | None:
    """That of the supply, where one is named.  Raises ConfigError where there is none of that name."""
    name = _get(mapping, "instruments.supply.dialect")
    return None if name is None else Dialect.load(str(name), "supply")


def _put(mapping: dict[str, Any], name: str, value: Any) -> None:
    *sections, last = name.split(".")
    for section in sections:
        if mapping.get(section) is None:  # an empty one is there, with nothing in it
            mapping[section] = {}
        mapping = mapping[section]
        if not isinstance(mapping, dict):
            raise ConfigError(f"{name}: {section} holds {mapping!r}, where a section of parameters is wanted")
    mapping[last] = value


def _of_other_instruments(mapping: dict[str, Any], answers: Mapping[str, Any]) -> None:
    """Where another language is answered than stands in the file: leave out the channels of that instrument, and what
    was accepted of that supply and its watchdog, so that they are asked anew."""
    for role, section, belongs in (
        ("supply", "supply", lambda name: name == "watchdog_timeout" or name.startswith("allow_")),
        ("supply", "instruments.supply", lambda name: name == "channel"),
        ("daq", "instruments.daq", lambda name: name.endswith("_channel")),
    ):
        stands, said = (where(f"instruments.{role}.dialect") for where in (partial(_get, mapping), answers.get))
        entries = _get(mapping, section)
        if stands is not None and said not in (None, "", stands) and isinstance(entries, dict):
            for name in [name for name in entries if belongs(name)]:
                del entries[name]


def _without_watchdog(mapping: dict[str, Any]) -> None:
    """Say in the parameters what a supply without a watchdog, or with a slow one, can hold."""
    if _get(mapping, "supply.watchdog_timeout") is not None:
        return
    dialect = _supply_dialect(mapping)
    if dialect is None:
        return  # to be told with the others
    if "arm_watchdog" not in dialect.commands:
        _put(mapping, "supply.watchdog_timeout", 0.0)
    elif dialect.watchdog_range_s is not None:
        shortest_s, longest_s = dialect.watchdog_range_s
        loop, _ = from_mapping(Loop, mapping.get("loop") or {}, "loop.")  # what is wrong there is told with the rest
        rate_Hz = (loop or Loop()).rate
        _put(mapping, "supply.watchdog_timeout", min(max(1.0, 2.0 / rate_Hz, shortest_s), longest_s))


def _in_order(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """The sections as the documentation has them; the model last."""
    names = [f.name for f in dataclasses.fields(BenchConfig)]
    known = {name: mapping[name] for name in names if name in mapping}
    return {**known, **{name: value for name, value in mapping.items() if name not in known}}


def _next(bench: BenchConfig, path: Path) -> str:
    """What to do with the file."""
    if isinstance(bench, Config):
        try:
            require_calibrated(bench)
        except ConfigError as error:
            return f"before a node drives the wire: {error}"
    check = f"sma-actuator check --config {typed(path)}"
    return f"with the wire between its crimps and its load on it, check the wiring: {check}"
