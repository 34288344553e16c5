"""All parameters of one actuator, composed from the sections that its parts declare.

One YAML file serves the node and every tool (``config/`` has examples).
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

from sma_actuator.base import sidecar
from sma_actuator.base.calibration import Calibration, in_sections
from sma_actuator.base.commands import NODE_NAME
from sma_actuator.base.packed import unpacked
from sma_actuator.base.parameter_file import files_beside, read_parameter_file, read_sections
from sma_actuator.base.parameters import (
    LONGEST_NAME,
    ConfigError,
    declaration_of,
    from_mapping,
    longest,
    parameter,
    refuse,
    section,
    to_mapping,
    type_of,
    typed_section,
)
from sma_actuator.base.sections import Loop, SupplyParameters, ThermalParameters, Wire
from sma_actuator.base.yaml_text import with_values, yaml_of
from sma_actuator.control import CONTROL_LAWS
from sma_actuator.control.law import ControllerParameters
from sma_actuator.control.pair import PairParameters
from sma_actuator.derived import with_derived
from sma_actuator.estimation.branch import EstimatorParameters
from sma_actuator.estimation.circuit import Circuit, LoadCell, ReferenceSensor
from sma_actuator.estimation.effects import EFFECTS, Effects, effects_from_mapping
from sma_actuator.estimation.models import COEFFICIENTS, Coefficients
from sma_actuator.estimation.models.checks import wrong_sense
from sma_actuator.instruments.parameters import Instruments, least_reading_timeout_s
from sma_actuator.logs.files import write_atomically
from sma_actuator.logs.recorder import RecorderParameters
from sma_actuator.safety.parameters import SafetyParameters

#: Times that are written in decimals may miss their sum by that share, as 0.6 s misses 0.2 + 0.2 + 1/5.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class BenchConfig:
    """The parameters of a bench whose wire has no model yet."""

    file_format: int = parameter(
        1,
        "version of the parameter file's layout",
        "1",
        1,
        1,
        hint="the file was written for a newer version of sma_actuator",
    )
    autostart: bool = parameter(True, "configure and activate the node by itself; no current flows before ~/enable")
    wait_for_instruments: bool = parameter(
        True, "with autostart: look again while the instruments are not there; else the node ends with a sentence"
    )
    joint_name: str = parameter("sma_joint", "name in the published JointState", hi=LONGEST_NAME)
    frame_id: str = parameter("sma_base", "frame of the published load", hi=LONGEST_NAME)
    wire: Wire = section(Wire, "the wire")
    circuit: Circuit = section(Circuit, "measuring circuit")
    load_cell: LoadCell = section(LoadCell, "load cell calibration")
    reference_sensor: ReferenceSensor = section(ReferenceSensor, "displacement reference")
    supply: SupplyParameters = section(SupplyParameters, "limits of the power supply")
    loop: Loop = section(Loop, "timing")
    estimator: EstimatorParameters = section(EstimatorParameters, "estimator")
    controller: ControllerParameters = typed_section(lambda: CONTROL_LAWS, "position controller", default="pid")
    thermal: ThermalParameters = section(ThermalParameters, "heat balance")
    safety: SafetyParameters = section(SafetyParameters, "thresholds of faults and limits")
    recorder: RecorderParameters = section(RecorderParameters, "bench log recorder")
    calibration: Calibration = section(Calibration, "what the model was fitted on")
    instruments: Instruments = section(Instruments, "instruments")


@dataclass(frozen=True, slots=True)
class Config(BenchConfig):
    """All parameters of one actuator.  Immutable; :meth:`replace` makes a checked copy."""

    model: Coefficients = typed_section(lambda: COEFFICIENTS, "strain model")
    #: what tracing has added to the model
    effects: Effects = dataclasses.field(default_factory=Effects, kw_only=True)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str = "") -> Config:
        """Check a nested mapping (what stands below ``ros__parameters``).

        Raises ConfigError with one sentence for every problem, each naming the parameter.
        """
        mapping = _with_tables(mapping, source) if isinstance(mapping, Mapping) else {}
        effects, problems = effects_from_mapping(mapping.pop("effects", None))
        config, found = from_mapping(cls, mapping)
        problems += found
        if config is not None:
            problems += _cross_checks(config) + config.calibration.mismatches()
            with _named(f"strain model '{config.model_type}'", problems):
                problems += config.model.mismatches(config.wire)
                if not problems and hasattr(model := config.model.build(config.wire), "limits_m"):
                    problems += wrong_sense(model, config.wire)
            with _named(f"control law '{CONTROL_LAWS.name_of(type(config.controller))}'", problems):
                problems += config.controller.mismatches(config)
        refuse(problems, source)
        return dataclasses.replace(config, effects=effects)

    @classmethod
    def load(cls, path: str | Path, node: str = NODE_NAME) -> Config:
        """Read a YAML parameter file.  Raises ConfigError; its sentences name the file."""
        return cls.from_mapping(read_parameter_file(path, node), source=str(path))

    @classmethod
    def for_tools(cls, mapping: Mapping[str, Any], source: str = "") -> Config:
        """As :meth:`from_mapping`, for what drives no wire: limits, gains and trips need not be given."""
        return cls.from_mapping(with_derived(mapping), source)

    @property
    def model_type(self) -> str:
        """The name of the strain model, ``model.type``."""
        return type_of(next(f for f in dataclasses.fields(self) if f.name == "model"), self.model)

    def to_mapping(self) -> dict[str, Any]:
        """The nested mapping from which this configuration would be built again."""
        return to_mapping(self)

    def replace(self, changes: Mapping[str, Any]) -> Config:
        """A copy with some dotted parameters changed, checked as a whole."""
        mapping = self.to_mapping()
        for dotted, value in changes.items():
            place = mapping
            *parents, last = dotted.split(".")
            for parent in parents:
                place = place.setdefault(parent, {})
            place[last] = value
        return Config.from_mapping(mapping)


def bench_from_mapping(mapping: Mapping[str, Any], source: str = "") -> BenchConfig:
    """The parameters of a bench: everything in ``mapping`` but ``model`` and ``effects``.

    Raises ConfigError as :meth:`Config.from_mapping` does.
    """
    mapping = _with_tables(mapping, source)
    bench, problems = from_mapping(BenchConfig, {k: v for k, v in mapping.items() if k not in ("model", "effects")})
    if bench is not None:
        problems += _cross_checks(bench)
    refuse(problems, source)
    return bench


def config_from_mapping(mapping: Mapping[str, Any], source: str = "") -> BenchConfig:
    """A Config where ``mapping`` has a model, else the parameters of a bench.  Raises ConfigError."""
    return (Config.from_mapping if "model" in mapping else bench_from_mapping)(mapping, source)


def require_sense_resistor(config: BenchConfig) -> None:
    """Raise ConfigError where the sense resistor is not given: everything else is measured with it."""
    refuse(_sense_resistor(config), "")


def _sense_resistor(config: BenchConfig) -> list[str]:
    if math.isfinite(config.circuit.reference_resistance):
        return []
    missing = (
        "circuit.reference_resistance: missing; the resistance of the sense resistor in ohms is wanted, without it "
        "neither the current nor the wire's resistance is known"
    )
    return [missing]


def require_calibrated(config: BenchConfig) -> None:
    """Raise ConfigError where a raw channel of the bench has no calibration, since nothing may be driven by a guess of
    it, and where the guards cannot tell by the wire's resistance that it has contracted."""
    problems = _sense_resistor(config)
    if getattr(getattr(config, "model", None), "resistance_rises", False):
        problems.append(
            "model.hot_resistance: above model.cold_resistance, so this wire's resistance rises as it contracts; the "
            "guards against too much heat take a contracted wire for one that shows less, so it is not driven: such a "
            "model serves replay, trace and identify"
        )
    if not config.load_cell.calibrated:
        problems.append(
            "load_cell.slope, load_cell.offset: missing; the load cell's calibration in N/V and N is wanted "
            "(`sma-actuator characterise` measures it), without it the wire's stress is not known"
        )
    refuse(problems, "")


def _with_tables(mapping: Mapping[str, Any], source: str) -> dict[str, Any]:
    """A copy in which the calibration's tables are lists, each in its section: files of before had one word of them."""
    out = dict(mapping)
    if sidecar.SECTION in out:
        refuse([f"{sidecar.SECTION}: the file that it names was not read; read_parameter_file reads both"], source)
    if isinstance(out.get("calibration"), Mapping):
        try:
            out["calibration"] = in_sections(unpacked(out["calibration"], "calibration"))
        except ConfigError as error:
            refuse(error.problems, source)
    return out


def text_with(path: Path, section: str, values: Mapping[str, float], comment: str, node: str = NODE_NAME) -> str:
    """The parameter file at ``path`` with other numbers in one section, and a comment there.  Raises ConfigError."""
    sections = read_sections(path)
    found = next((name for name in (node, f"/{node}", "/**") if name in sections), node)
    text = path.read_text(encoding="utf-8-sig")
    return with_values(text, str(path), (found, "ros__parameters", section), values, comment)


def copy_tables(path: Path, out: Path) -> None:
    """Copy what lies beside a parameter file to where its text is written again.  Raises ConfigError, OSError."""
    for name in files_beside(path):
        if out.with_name(name).resolve() != path.with_name(name).resolve():
            content = path.with_name(name).read_bytes()
            write_atomically(out.with_name(name), partial(_put, content))


def _put(content: bytes, stream: Any) -> None:
    stream.write(content)


def write_parameter_file(
    path: str | Path, mapping: Mapping[str, Any], header: str, comments: Mapping[str, str] | None = None
) -> None:
    """Write a parameter file, whole or not at all; ``header``: comment above it, ``comments``: behind parameters.

    The long tables of its model go into a file beside it, which the section ``tables`` names.
    """
    mapping, tables = sidecar.taken_out(mapping)
    if tables:
        beside, content = sidecar.path_beside(Path(path)), sidecar.archive(tables)
        write_atomically(beside, partial(_put, content))
        mapping[sidecar.SECTION] = sidecar.reference(beside.name, content)
        comments = {**(comments or {}), f"{sidecar.SECTION}.file": "numbers that nobody reads: copy it with this file"}
    write_atomically(path, partial(_put, parameter_text(mapping, header, comments).encode()))


def parameter_text(mapping: Mapping[str, Any], header: str, comments: Mapping[str, str] | None = None) -> str:
    """The text of a parameter file that has everything in it, as the table of a fleet keeps it."""
    inside = {f"{NODE_NAME}.ros__parameters.{name}": text for name, text in (comments or {}).items()}
    text = "".join(f"# {line}\n" for line in header.splitlines())
    return text + yaml_of({NODE_NAME: {"ros__parameters": mapping}}, inside)


@contextlib.contextmanager
def _named(part: str, problems: list[str]) -> Iterator[None]:
    """Note what a part that is asked raises: it may be somebody else's."""
    try:
        yield
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever it is
        problems.append(f"{part}: {type(error).__name__}: {error}")


def _cross_checks(common: BenchConfig) -> list[str]:
    """What no single range can say."""
    problems = []
    supply, safety = common.supply, common.safety
    if not supply.bias_current < supply.max_current:
        problems.append(
            f"supply.bias_current: {supply.bias_current:g} A is not below supply.max_current, {supply.max_current:g} A"
        )
    if not supply.max_current <= supply.over_current_trip:
        problems.append(
            f"supply.over_current_trip: {supply.over_current_trip:g} A is below supply.max_current, "
            f"{supply.max_current:g} A: the supply would trip in normal use"
        )
    if not supply.max_voltage < supply.over_voltage_V:
        problems.append(
            f"supply.over_voltage_trip: {supply.over_voltage_trip:g} V is not above supply.max_voltage, "
            f"{supply.max_voltage:g} V: the supply would trip in normal use; 0 puts it a tenth above"
        )
    if common.instruments.daq.read_twice:
        problems.append(common.instruments.daq.read_twice)
    problems += [
        f"{name}: 0 {per} makes the same of every voltage; what one {per[-1]} means is wanted"
        for name, slope, per in (
            ("load_cell.slope", common.load_cell.slope, "N/V"),
            ("reference_sensor.slope", common.reference_sensor.slope, "m/A"),
        )
        if slope == 0.0
    ]
    if not safety.resistance_min < safety.resistance_max:
        problems.append("safety.resistance_min: is not below safety.resistance_max")
    if not common.thermal.derate_temperature < common.thermal.max_temperature:
        problems.append("thermal.derate_temperature: is not below thermal.max_temperature")
    return problems + _out_of_time(common)


def _out_of_time(common: BenchConfig) -> list[str]:
    """What the periods and timeouts of loop, instruments and supply say against each other."""
    problems = []
    supply, safety, loop = common.supply, common.safety, common.loop
    if loop.samples_per_block / loop.sample_rate > 1.0 / loop.rate * (1 + ROUNDING):
        problems.append(
            f"loop.samples_per_block: {loop.samples_per_block} samples at {loop.sample_rate:g} Hz take longer than one "
            f"period of loop.rate, {loop.rate:g} Hz; at most {int(loop.sample_rate / loop.rate)} fit"
        )
    if supply.watchdog_timeout == 0.0 and not supply.allow_no_watchdog:
        problems.append(
            "supply.watchdog_timeout: 0 means that a killed computer leaves the current on; set "
            "supply.allow_no_watchdog: true if the supply has no watchdog and you accept that"
        )
    if not safety.reading_timeout >= 2.0 / loop.rate * (1 - ROUNDING):
        problems.append(
            f"safety.reading_timeout: {safety.reading_timeout:g} s is less than two periods of loop.rate, "
            f"{loop.rate:g} Hz: readings would count as stale in normal use"
        )
    supply_s, daq_s = common.instruments.supply.timeout, common.instruments.daq.timeout
    if not safety.reading_timeout >= (daq_s + supply_s + 1.0 / loop.rate) * (1 - ROUNDING):
        will_do_s = math.ceil(100.0 * least_reading_timeout_s(supply_s, daq_s, loop.rate) * (1 - ROUNDING)) / 100.0
        problems.append(
            f"safety.reading_timeout: {safety.reading_timeout:g} s is less than instruments.daq.timeout, {daq_s:g} s, "
            f"instruments.supply.timeout, {supply_s:g} s, and a period of loop.rate together: a silent instrument "
            f"would be found later than docs/faults.md says; {will_do_s:g} s will do"
        )
    if 0.0 < supply.watchdog_timeout < 2.0 / loop.rate * (1 - ROUNDING):
        problems.append(
            f"supply.watchdog_timeout: {supply.watchdog_timeout:g} s is less than two periods of loop.rate, "
            f"{loop.rate:g} Hz: the watchdog would trip in normal use"
        )
    return problems


def markdown() -> str:
    """The text of ``docs/parameters.md``, printed by ``python -m sma_actuator.config``."""
    out = [
        "# Parameters",
        "",
        "Printed from the declarations by `python -m sma_actuator.config > docs/parameters.md`.",
        "",
        "One YAML file serves the node and every tool. A wrong or unknown parameter is refused before any current",
        "flows, in a sentence that names it and its range. **Live** ones can be changed while the wire is driven",
        "(`ros2 param set`): *either* way, or while current may flow only *lower*, *higher* or to a *later* choice,",
        "which is stricter; what is looser than the node began with stands in the log and, as `loosened`, in",
        "`~/status` and `/diagnostics`. `identify` writes `calibration.` and `model.`; their long lists stand in",
        "`<name>.tables.npz` beside the file, which the section `tables` names with its SHA-256: copy both together. A",
        "list that stands in the YAML counts before it.",
    ]
    for title, before, found in _tables():
        rows = _merged(found)
        shown = [place for place in range(len(COLUMNS)) if any(row[place] for row in rows)]
        head, *table = (f"| {' | '.join(row[place] for place in shown)} |" for row in [COLUMNS, *rows])
        out += ["", f"## {title}", "", *before, head, "|" + "---|" * len(shown), *table]
    return "\n".join(out) + "\n"


COLUMNS = ["name", "default", "unit", "range", "live", "what"]
Table = tuple[str, list[str], list[list[str]]]  #: its title, what stands above it, its rows


def _tables() -> list[Table]:
    """One for each section of a file, and for each type of a section that has several."""
    tables: list[Table] = [("Top level", [], _rows(Config, "", nested=False))]
    for field in dataclasses.fields(Config):
        title = f"`{field.name}.`"
        if "section" in field.metadata and "variants" not in field.metadata:
            tables.append((title, [], _rows(_class_of(field))))
        printed: dict[type, str] = {}
        for name, cls in field.metadata.get("variants", dict)().items():
            base = next((base for base in cls.__mro__ if base in printed), None)
            inherited = _rows(base) if base else []
            before = [f"All of `{field.name}.` of type `{printed[base]}`, and:", ""] if base else []
            tables.append((f"{title} of type `{name}`", before, [row for row in _rows(cls) if row not in inherited]))
            printed[cls] = name
    effects = [(name, cls) for name, cls in EFFECTS.items() if cls.PART != "reference"]
    rows = [*_rows(Effects), *(row for name, cls in effects for row in _rows(cls, f"{name}."))]
    return [*tables, ("`effects.`", [], rows), ("The node of a joint", [], _rows(PairParameters))]


def _merged(rows: list[list[str]]) -> list[list[str]]:
    """One row for what is the same in several parts, as ``supply.backend`` and ``daq.backend``."""
    names: dict[tuple[str, ...], list[str]] = {}
    for name, *rest in rows:
        names.setdefault((name.partition(".")[2] or name, *rest), []).append(name)
    return [[", ".join(same), *rest] for (_, *rest), same in names.items()]


def _class_of(field: dataclasses.Field) -> type:
    return cast(type, field.default_factory)


def _rows(cls: type, prefix: str = "", nested: bool = True) -> list[list[str]]:
    """A row for each parameter of a section, then for those of the sections in it."""
    own = [field for field in dataclasses.fields(cls) if "parameter" in field.metadata]
    inner = [field for field in dataclasses.fields(cls) if "section" in field.metadata] if nested else []
    rows = [_row(f"{prefix}{field.name}", field) for field in own]
    return [*rows, *(row for field in inner for row in _rows(_class_of(field), f"{prefix}{field.name}."))]


def _row(name: str, field: dataclasses.Field) -> list[str]:
    declaration = declaration_of(field)
    default = "**required**" if field.default is dataclasses.MISSING else f"`{field.default}`"
    if declaration.optional and (field.default in ("", ()) or field.default != field.default):
        default = "none"
    lo, hi = declaration.lo, declaration.hi
    span = "" if math.isinf(lo) and math.isinf(hi) else f"{lo:g} … {hi:g}"
    if declaration.choices:
        span = ", ".join(declaration.choices)
    elif "str" in str(field.type):
        span = f"{longest(declaration)} characters"
    if "tuple" in str(field.type):
        span = f"[{span}, …]"
    unit = declaration.unit if declaration.unit != "1" else ""
    live = f"{declaration.live}, 0 least" if declaration.zero_is_never else declaration.live
    return [f"`{name}`", default, unit, span, live, declaration.description]


if __name__ == "__main__":
    print(markdown(), end="")  # noqa: T201
