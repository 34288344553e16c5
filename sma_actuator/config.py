"""The parameters of one actuator: what they are called, what they mean, what they may be.

One YAML file serves the node and every tool (``config/`` has examples).  Every parameter is
declared here or, for the coefficients of a model, beside that model.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

import yaml

from sma_actuator.base.parameters import ConfigError, declaration_of, from_mapping, parameter, section, to_mapping
from sma_actuator.estimation.effects import EFFECTS, Effects, effects_from_mapping
from sma_actuator.estimation.models import COEFFICIENTS

NODE_NAME = "sma_actuator"


@dataclass(frozen=True, slots=True)
class Wire:
    alloy: str = parameter(description="alloy of the wire", choices=("ni-ti", "ni-ti-cu"))
    length: float = parameter(
        description="length between the crimps, slack taken out",
        unit="m",
        lo=0.005,
        hi=20.0,
        hint="metres are wanted: 100 mm is 0.100",
    )
    diameter: float = parameter(
        description="diameter of the wire",
        unit="m",
        lo=10e-6,
        hi=2e-3,
        hint="metres are wanted: 0.1524 mm is 0.1524e-3",
    )
    full_stroke_strain: float = parameter(
        0.04, "strain that counts as 100 % of stroke in every error", "1", 0.001, 0.12
    )
    max_stress: float = parameter(175e6, "stress the wire must never see", "Pa", 1e6, 1e9, live=True)

    @property
    def area_m2(self) -> float:
        """Cross-section of the wire."""
        return math.pi * self.diameter**2 / 4.0

    @property
    def full_stroke_m(self) -> float:
        """Displacement that counts as 100 % in every error."""
        return self.full_stroke_strain * self.length


@dataclass(frozen=True, slots=True)
class Circuit:
    reference_resistance: float = parameter(1.0, "sense resistor in series with the wire", "Ω", 1e-4, 1e3)
    lead_resistance: float = parameter(0.0, "leads between the voltage taps and the wire", "Ω", 0.0, 100.0)


@dataclass(frozen=True, slots=True)
class LoadCell:
    slope: float = parameter(12.7297, "load per volt of the load cell's amplifier (thesis, A.1)", "N/V", -1e6, 1e6)
    offset: float = parameter(-0.0598, "load at zero volts", "N", -1e6, 1e6)


@dataclass(frozen=True, slots=True)
class ReferenceSensor:
    """A displacement sensor beside the wire, for identification only.  Without a slope: none."""

    slope: float = parameter(nan, "displacement per ampere of the LVDT (thesis, B.1)", "m/A", -1e3, 1e3, optional=True)
    offset: float = parameter(nan, "displacement at zero amperes", "m", -10.0, 10.0, optional=True)

    @property
    def fitted(self) -> bool:
        """Whether there is such a sensor."""
        return math.isfinite(self.slope) and math.isfinite(self.offset)


@dataclass(frozen=True, slots=True)
class Supply:
    bias_current: float = parameter(
        0.05,
        "current that always flows while enabled, to measure resistance with",
        "A",
        1e-4,
        5.0,
        hint="amperes are wanted: 50 mA is 0.05",
    )
    max_current: float = parameter(
        description="current that no setpoint, topic or fault can exceed",
        unit="A",
        lo=1e-3,
        hi=20.0,
        hint="amperes are wanted: 400 mA is 0.4",
    )
    max_voltage: float = parameter(
        description="compliance voltage; the supply's over-voltage trip sits just above", unit="V", lo=0.1, hi=60.0
    )
    over_current_trip: float = parameter(
        description="the supply's own over-current trip: what the wire survives for ever", unit="A", lo=1e-3, hi=20.0
    )
    watchdog_timeout: float = parameter(
        1.0, "silence after which the supply cuts its own output; 0: the supply has no watchdog", "s", 0.0, 3600.0
    )
    allow_no_watchdog: bool = parameter(
        False, "drive a supply that has no watchdog: a killed computer then leaves the current on"
    )


@dataclass(frozen=True, slots=True)
class Loop:
    rate: float = parameter(20.0, "readings, estimates and commands per second", "Hz", 1.0, 1000.0)
    sample_rate: float = parameter(1000.0, "raw samples per second and channel, averaged in blocks", "Hz", 1.0, 1e6)
    samples_per_block: int = parameter(50, "raw samples averaged into one reading", "1", 1, 100000)
    overruns_to_fault: int = parameter(
        10, "consecutive missed deadlines that count as a fault", "1", 1, 10000, live=True
    )


@dataclass(frozen=True, slots=True)
class Estimator:
    branch_decision: str = parameter(
        "heat_balance", "how heating is told from cooling", choices=("heat_balance", "power", "resistance_rate")
    )
    heating_power: float = parameter(0.2, "wire power above which it is heating (power)", "W", 1e-6, 1e3, live=True)
    heating_power_hysteresis: float = parameter(
        0.1, "half-width of the band around the power that decides, as a fraction of it", "1", 0.0, 0.9, live=True
    )
    thermal_time_constant: float = parameter(
        5.0,
        "lag of the wire's temperature behind power, latent heat included (heat_balance)",
        "s",
        0.01,
        600.0,
        live=True,
    )
    resistance_deadband: float = parameter(
        2e-3,
        "change of resistance against the branch that turns the branch (resistance_rate)",
        "Ω",
        0.0,
        10.0,
        live=True,
    )
    velocity_time_constant: float = parameter(0.1, "low-pass of the published velocity", "s", 0.0, 10.0, live=True)


@dataclass(frozen=True, slots=True)
class Controller:
    kp: float = parameter(description="proportional gain", unit="A/m", lo=0.0, hi=1e6, live=True)
    ki: float = parameter(0.0, "integral gain", "A/(m·s)", 0.0, 1e6, live=True)
    kd: float = parameter(0.0, "derivative gain, on the estimate", "A·s/m", 0.0, 1e6, live=True)
    derivative_time_constant: float = parameter(0.1, "low-pass of the derivative", "s", 0.0, 10.0, live=True)
    setpoint_rate_limit: float = parameter(
        0.01, "fastest change of the setpoint the controller follows", "m/s", 1e-6, 10.0, live=True
    )
    setpoint_timeout: float = parameter(
        0.0,
        "silence on the setpoint topic that counts as lost; 0: a setpoint stands until the next",
        "s",
        0.0,
        3600.0,
        live=True,
    )
    on_setpoint_loss: str = parameter(
        "hold", "what to do when the setpoint is lost", choices=("hold", "bias", "off"), live=True
    )


@dataclass(frozen=True, slots=True)
class Thermal:
    """Heat balance on measured power, C dT/dt = P − h (T − T_ambient), latent heat left out (so it errs hot)."""

    heat_capacity: float = parameter(description="heat capacity of the wire", unit="J/K", lo=1e-6, hi=1e3)
    heat_loss: float = parameter(description="heat lost per kelvin above ambient", unit="W/K", lo=1e-6, hi=1e2)
    ambient_temperature: float = parameter(
        24.0, "temperature of the surroundings where none is measured", "°C", -60.0, 100.0, live=True
    )
    derate_temperature: float = parameter(
        160.0, "estimated temperature where the current limit starts to fall", "°C", 40.0, 400.0, live=True
    )
    max_temperature: float = parameter(200.0, "estimated temperature that is a fault", "°C", 40.0, 400.0, live=True)


@dataclass(frozen=True, slots=True)
class Safety:
    resistance_min: float = parameter(
        description="resistance below which the wire is shorted", unit="Ω", lo=1e-3, hi=1e4
    )
    resistance_max: float = parameter(
        description="resistance above which the reading is implausible", unit="Ω", lo=1e-3, hi=1e5
    )
    open_wire_current_fraction: float = parameter(
        0.5,
        "share of the commanded current below which, at the compliance voltage, the wire is open",
        "1",
        0.01,
        0.99,
        live=True,
    )
    load_min: float = parameter(-0.5, "load below which the load cell is implausible", "N", -1e4, 1e4, live=True)
    load_spike: float = parameter(
        description="change of load from one reading to the next that is a spike", unit="N", lo=1e-3, hi=1e5, live=True
    )
    channel_max_voltage: float = parameter(10.0, "voltage at which a DAQ channel saturates", "V", 0.01, 1e3)
    stuck_time: float = parameter(
        2.0, "time with not one changed digit after which a channel is stuck", "s", 0.05, 3600.0, live=True
    )
    current_disagreement: float = parameter(
        0.02, "difference of commanded and measured current that is a fault once settled", "A", 1e-4, 5.0, live=True
    )
    disagreement_time: float = parameter(0.5, "time such a difference must last", "s", 0.0, 60.0, live=True)
    reading_timeout: float = parameter(0.3, "age of the last good reading that is a fault", "s", 0.01, 60.0, live=True)
    setpoint_flood_rate: float = parameter(
        1000.0, "setpoints per second above which their source is taken for broken", "Hz", 1.0, 1e6, live=True
    )
    stress_limit_fraction: float = parameter(
        0.9, "share of max_stress above which no further contraction is driven", "1", 0.1, 1.0, live=True
    )
    outside_calibration_time: float = parameter(
        5.0, "time outside the model's calibration that is a fault", "s", 0.0, 3600.0, live=True
    )


@dataclass(frozen=True, slots=True)
class Recorder:
    folder: str = parameter("", "folder for bench logs; empty: none are written", optional=True)
    max_file_size: int = parameter(50_000_000, "size at which a new file is begun", "B", 10_000, 10**12)
    max_files: int = parameter(20, "files kept; the oldest go first", "1", 1, 100000)


@dataclass(frozen=True, slots=True)
class Calibration:
    """What the logs looked like that the model was fitted on; `identify` writes it, `trace` measures against it.

    ``cold_…`` and ``hot_…`` hold a value for each of their stresses; ``residual_…`` one for each position, stress
    after stress of ``residual_stress``.
    """

    error: float = parameter(
        nan, "mean absolute error of the model on its own logs, full range", "% of full stroke", 0.0, 1e3, optional=True
    )
    largest_error: float = parameter(
        nan, "largest such error of a single log", "% of full stroke", 0.0, 1e3, optional=True
    )
    scatter: float = parameter(
        nan,
        "what remains of it beside the residuals below, for a log that they do not come from",
        "% of full stroke",
        0.0,
        1e3,
        optional=True,
    )
    ambient_temperature: float = parameter(nan, "mean ambient temperature", "°C", -60.0, 100.0, optional=True)
    cold_stress: tuple[float, ...] = parameter((), "stresses at cold rest", "Pa", -1e9, 1e9, optional=True)
    cold_resistance: tuple[float, ...] = parameter((), "resistance at cold rest", "Ω", 0.0, 1e6, optional=True)
    cold_displacement: tuple[float, ...] = parameter((), "displacement at cold rest", "m", -10.0, 10.0, optional=True)
    hot_stress: tuple[float, ...] = parameter((), "stresses at the hot end", "Pa", -1e9, 1e9, optional=True)
    hot_resistance: tuple[float, ...] = parameter((), "resistance at the hot end", "Ω", 0.0, 1e6, optional=True)
    hot_displacement: tuple[float, ...] = parameter((), "displacement at the hot end", "m", -10.0, 10.0, optional=True)
    hot_power: float = parameter(nan, "power at the hot end", "W", 0.0, 1e6, optional=True)
    resistance_scatter: float = parameter(nan, "rms scatter of the resistance at rest", "Ω", 0.0, 1e6, optional=True)
    displacement_scatter: float = parameter(
        nan, "rms scatter of the displacement at rest", "m", 0.0, 10.0, optional=True
    )
    resistance_range: float = parameter(nan, "largest less smallest resistance", "Ω", 0.0, 1e6, optional=True)
    residual_stress: tuple[float, ...] = parameter((), "stresses of the residuals", "Pa", -1e9, 1e9, optional=True)
    residual_position: tuple[float, ...] = parameter(
        (), "estimated displacements of the residuals", "m", -10.0, 10.0, optional=True
    )
    residual_heating: tuple[float, ...] = parameter(
        (), "mean measured less estimated displacement, heating", "m", -10.0, 10.0, optional=True
    )
    residual_cooling: tuple[float, ...] = parameter((), "the same, cooling", "m", -10.0, 10.0, optional=True)
    scatter_heating: tuple[float, ...] = parameter(
        (), "rms about them at each position, heating", "m", 0.0, 10.0, optional=True
    )
    scatter_cooling: tuple[float, ...] = parameter((), "the same, cooling", "m", 0.0, 10.0, optional=True)

    @property
    def known(self) -> bool:
        """Whether the model says how good it was."""
        return math.isfinite(self.error)


@dataclass(frozen=True, slots=True)
class SupplyInstrument:
    resource: str = parameter("", "VISA resource, as TCPIP::192.168.0.5::5025::SOCKET", optional=True)
    dialect: str = parameter(
        "virtual_bench_supply", "name of a dialect in sma_actuator/instruments/dialects, or path of a YAML file"
    )
    channel: int = parameter(1, "output channel", "1", 1, 100)
    timeout: float = parameter(0.5, "time to wait for an answer", "s", 0.01, 60.0)
    exclusive_lock: bool = parameter(True, "take the VISA lock where the instrument has one")
    pymeasure_class: str = parameter("", "dotted name of a pymeasure instrument, instead of a dialect", optional=True)


@dataclass(frozen=True, slots=True)
class DaqInstrument:
    resource: str = parameter("", "VISA resource, as TCPIP::192.168.0.6::5025::SOCKET", optional=True)
    dialect: str = parameter(
        "virtual_bench_daq", "name of a dialect in sma_actuator/instruments/dialects, or path of a YAML file"
    )
    timeout: float = parameter(0.5, "time to wait for an answer", "s", 0.01, 60.0)
    supply_voltage_channel: int = parameter(101, "channel of the supply voltage", "1", 0, 10**6)
    reference_voltage_channel: int = parameter(102, "channel of the sense resistor's voltage", "1", 0, 10**6)
    load_cell_channel: int = parameter(103, "channel of the load cell's amplifier", "1", 0, 10**6)
    lvdt_channel: int = parameter(0, "channel of the LVDT's shunt voltage; 0: none", "1", 0, 10**6)
    lvdt_shunt_resistance: float = parameter(10.0, "resistor the LVDT's current is read across", "Ω", 0.1, 1e4)
    ambient_temperature_channel: int = parameter(
        0, "channel of an ambient temperature sensor, 1 °C per unit; 0: none", "1", 0, 10**6
    )


@dataclass(frozen=True, slots=True)
class Instruments:
    supply: SupplyInstrument = section(SupplyInstrument, "power supply")
    daq: DaqInstrument = section(DaqInstrument, "data acquisition")
    reconnect_backoff_max: float = parameter(5.0, "longest wait between attempts to reconnect", "s", 0.1, 600.0)


@dataclass(frozen=True, slots=True)
class _Sections:
    """Everything but the model and its effects, whose parameters depend on their type."""

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
        False, "with autostart: keep trying while the instruments do not answer; else the node ends with a sentence"
    )
    joint_name: str = parameter("sma_joint", "name in the published JointState")
    frame_id: str = parameter("sma_base", "frame of the published load")
    wire: Wire = section(Wire, "the wire")
    circuit: Circuit = section(Circuit, "measuring circuit")
    load_cell: LoadCell = section(LoadCell, "load cell calibration")
    reference_sensor: ReferenceSensor = section(ReferenceSensor, "displacement reference")
    supply: Supply = section(Supply, "limits of the power supply")
    loop: Loop = section(Loop, "timing")
    estimator: Estimator = section(Estimator, "estimator")
    controller: Controller = section(Controller, "position controller")
    thermal: Thermal = section(Thermal, "heat balance")
    safety: Safety = section(Safety, "thresholds of faults and limits")
    recorder: Recorder = section(Recorder, "bench log recorder")
    calibration: Calibration = section(Calibration, "what the model was fitted on")
    instruments: Instruments = section(Instruments, "instruments")


@dataclass(frozen=True, slots=True)
class Config(_Sections):
    """All parameters of one actuator.  Immutable; :meth:`replace` makes a checked copy."""

    model_type: str
    model: Any  #: the coefficients' section of that type (see ``sma_actuator.estimation.models``)
    effects: Effects  #: what tracing has added to the model (see ``sma_actuator.estimation.effects``)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str = "") -> Config:
        """Check a nested mapping (what stands below ``ros__parameters``).

        Raises ConfigError with one sentence for every problem, each naming the parameter.
        """
        mapping = dict(mapping) if isinstance(mapping, Mapping) else {}
        model = mapping.pop("model", None)
        effects, problems_of_effects = effects_from_mapping(mapping.pop("effects", None))
        common, problems = from_mapping(_Sections, mapping)
        problems += problems_of_effects
        coefficients = None
        model_type = ""
        if not isinstance(model, Mapping) or "type" not in model:
            problems.append(f"model.type: missing; one of {', '.join(COEFFICIENTS)} is wanted")
        elif model["type"] not in COEFFICIENTS:
            problems.append(f"model.type: '{model['type']}' is not one of {', '.join(COEFFICIENTS)}")
        else:
            model_type = model["type"]
            rest = {k: v for k, v in model.items() if k != "type"}
            coefficients, found = from_mapping(COEFFICIENTS[model_type], rest, "model.")
            problems += found
        if common is not None:
            problems += _cross_checks(common)
        if common is not None and coefficients is not None:
            problems += coefficients.mismatches(common.wire)
        if problems:
            raise ConfigError([f"{source}: {p}" if source else p for p in problems])
        values = {f.name: getattr(common, f.name) for f in dataclasses.fields(common)}
        return cls(**values, model_type=model_type, model=coefficients, effects=effects)

    @classmethod
    def load(cls, path: str | Path, node: str = NODE_NAME) -> Config:
        """Read a YAML parameter file.  Raises ConfigError; its sentences name the file."""
        return cls.from_mapping(read_parameter_file(path, node), source=str(path))

    def to_mapping(self) -> dict[str, Any]:
        """The nested mapping from which this configuration would be built again."""
        out = to_mapping(_Sections(**{f.name: getattr(self, f.name) for f in dataclasses.fields(_Sections)}))
        out["model"] = {"type": self.model_type, **to_mapping(self.model)}
        if effects := to_mapping(self.effects):
            out["effects"] = effects
        return out

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


def bench_from_mapping(mapping: Mapping[str, Any], source: str = "") -> _Sections:
    """The parameters of a bench whose wire has no model yet: everything in ``mapping`` but ``model`` and ``effects``.

    Raises ConfigError as :meth:`Config.from_mapping` does.
    """
    rest = {k: v for k, v in mapping.items() if k not in ("model", "effects")}
    sections, problems = from_mapping(_Sections, rest)
    if sections is not None:
        problems += _cross_checks(sections)
    if problems:
        raise ConfigError([f"{source}: {p}" if source else p for p in problems])
    return sections


class _Loader(yaml.SafeLoader):
    """Reads 175.0e6 as a number, as the YAML parser of ROS does; PyYAML wants 175.0e+6."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def parse_yaml(text: str) -> Any:
    """The document in ``text``.  Raises yaml.YAMLError."""
    return yaml.load(text, Loader=_Loader)


def read_yaml(path: str | Path) -> Mapping[str, Any]:
    """The sections of a YAML parameter file.  Raises ConfigError; its sentence names the file."""
    path = Path(path)
    try:
        document = parse_yaml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); a YAML parameter file is wanted") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(document, Mapping):
        raise ConfigError(f"{path}: holds no parameters; a section '{NODE_NAME}: ros__parameters:' is wanted")
    return document


def read_parameter_file(path: str | Path, node: str = NODE_NAME) -> dict[str, Any]:
    """The mapping below ``ros__parameters`` of ``node`` (or of ``/**``) in a YAML file."""
    document = read_yaml(path)
    for name in (node, f"/{node}", "/**"):
        if isinstance(document.get(name), Mapping) and "ros__parameters" in document[name]:
            return dict(document[name]["ros__parameters"] or {})
    raise ConfigError(f"{path}: has no section '{node}: ros__parameters:'; found {', '.join(map(str, document))}")


def _cross_checks(common: _Sections) -> list[str]:
    """What no single range can say."""
    problems = []
    supply, safety, loop = common.supply, common.safety, common.loop
    if not supply.bias_current < supply.max_current:
        problems.append(
            f"supply.bias_current: {supply.bias_current:g} A is not below supply.max_current, {supply.max_current:g} A"
        )
    if not supply.max_current <= supply.over_current_trip:
        problems.append(
            f"supply.over_current_trip: {supply.over_current_trip:g} A is below supply.max_current, {supply.max_current:g} A: "
            "the supply would trip in normal use"
        )
    if not safety.resistance_min < safety.resistance_max:
        problems.append("safety.resistance_min: is not below safety.resistance_max")
    if not common.thermal.derate_temperature < common.thermal.max_temperature:
        problems.append("thermal.derate_temperature: is not below thermal.max_temperature")
    if loop.samples_per_block / loop.sample_rate > 1.0 / loop.rate * (1 + 1e-9):
        problems.append(
            f"loop.samples_per_block: {loop.samples_per_block} samples at {loop.sample_rate:g} Hz take longer than one period "
            f"of loop.rate, {loop.rate:g} Hz; at most {int(loop.sample_rate / loop.rate)} fit"
        )
    if supply.watchdog_timeout == 0.0 and not supply.allow_no_watchdog:
        problems.append(
            "supply.watchdog_timeout: 0 means that a killed computer leaves the current on; set supply.allow_no_watchdog: true "
            "if the supply has no watchdog and you accept that"
        )
    if not safety.reading_timeout >= 2.0 / loop.rate:
        problems.append(
            f"safety.reading_timeout: {safety.reading_timeout:g} s is less than two periods of loop.rate, {loop.rate:g} Hz: "
            "readings would count as stale in normal use"
        )
    if 0.0 < supply.watchdog_timeout < 2.0 / loop.rate:
        problems.append(
            f"supply.watchdog_timeout: {supply.watchdog_timeout:g} s is less than two periods of loop.rate, {loop.rate:g} Hz: "
            "the watchdog would trip in normal use"
        )
    return problems


def markdown() -> str:
    """The text of ``docs/parameters.md``, printed by ``python -m sma_actuator.config``."""
    out = [
        "# Parameters",
        "",
        "Printed from the declarations by `python -m sma_actuator.config > docs/parameters.md`.",
        "",
        "One YAML file serves the node and every tool. A wrong or unknown parameter is refused before any current flows, in a",
        "sentence that names it and its range. **Live** ones can be changed while the wire is driven (`ros2 param set`).",
    ]
    sections = [("", _Sections), *((f"model. (type: {name})", cls) for name, cls in COEFFICIENTS.items())]
    sections += [("effects.", Effects)]
    sections += [(f"effects.{name}.", cls) for name, cls in EFFECTS.items() if cls.STAGE != "reference"]
    while sections:
        title, cls = sections.pop(0)
        rows, nested = [], []
        for field in dataclasses.fields(cls):
            if "section" in field.metadata:
                nested.append((f"{title}{field.name}.", field.default_factory))
            elif "parameter" in field.metadata:
                rows.append(_row(field))
        sections[:0] = nested
        if rows:
            out += [
                "",
                f"## `{title}`" if title else "## Top level",
                "",
                "| name | default | unit | range | live | what |",
                "|---|---|---|---|---|---|",
                *rows,
            ]
    return "\n".join(out) + "\n"


def _row(field: dataclasses.Field) -> str:
    declaration = declaration_of(field)
    default = "**required**" if field.default is dataclasses.MISSING else f"`{field.default}`"
    if declaration.optional and (field.default in ("", ()) or field.default != field.default):
        default = "none"
    lo, hi = declaration.lo, declaration.hi
    span = (
        ", ".join(declaration.choices)
        if declaration.choices
        else ""
        if math.isinf(lo) and math.isinf(hi)
        else f"{lo:g} … {hi:g}"
    )
    unit = declaration.unit if declaration.unit != "1" else ""
    return f"| `{field.name}` | {default} | {unit} | {span} | {'yes' if declaration.live else ''} | {declaration.description} |"


if __name__ == "__main__":
    print(markdown(), end="")
