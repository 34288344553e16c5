"""How each kind of part is measured: what the person does, what is driven, what comes of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import Config, require_calibrated
from sma_actuator.estimation.circuit import resistance_and_current
from sma_actuator.estimation.models import ThermalStrainModel
from sma_actuator.logs.bench_log import BenchLog, signals_from_log
from sma_actuator.logs.kinds import FOLLOWED, FULL, LEVELS, MANY, PARTIAL
from sma_actuator.logs.sense import EXPANDS

from . import programs
from .calibration import Line, fit_line
from .following import ModelFollower
from .operators import Operator
from .plan import OUTERMOST, Part
from .programs import HELD_BACK, Program, held_currents, hold, partial_cycles, square_pulses
from .rig import Rig
from .training import Ends

Progress = Callable[[float], None]
#: What a load cell that is not calibrated yet may seem to show; no more than the bias flows meanwhile.
UNCALIBRATED = ("reading_implausible", "stress_above_limit")
PATIENCE = 4.0  #: a pulse and the pause after it are at most so many times as long, while the wire still moves


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a part gave: logs by name, results for the manifest, parameters it determined (dotted), and what to say."""

    logs: dict[str, BenchLog]
    results: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, float] = field(default_factory=dict)
    words: str = ""


def lead_resistance(
    part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress
) -> Outcome:
    """R_lead with the wire shorted (3.4), at the bias current."""
    operator.short_wire()
    try:
        program = hold(rig.config.supply.bias_current, part.parameters["average_s"])
        log = _record(rig, part, program, progress, but=("short", *UNCALIBRATED))
    finally:
        operator.fit_wire()
    resistance_Ohm, _ = resistance_and_current(
        log["supply_voltage_V"], log["reference_voltage_V"], rig.config.circuit.reference_resistance, 0.0
    )
    mean_Ohm, spread_Ohm = float(np.nanmean(resistance_Ohm)), float(np.nanstd(resistance_Ohm))
    if not 0.0 <= mean_Ohm <= 0.5 * rig.config.safety.resistance_min + 1.0:
        raise ConfigError(f"lead resistance: {mean_Ohm:.3f} Ω reads like a wire, not like leads; is the wire shorted?")
    return Outcome(
        {f"calibration/{part.name}": log},
        {"lead_resistance_Ohm": mean_Ohm, "standard_deviation_Ohm": spread_Ohm},
        {"circuit.lead_resistance": mean_Ohm},
    )


def _channel(rig: Rig, sensor: str) -> str:
    """Where a sensor is read, as the bench file says it."""
    name = f"{sensor}_channel"
    return f"instruments.daq.{name}, {getattr(rig.config.instruments.daq, name)}"


def load_cell(part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress) -> Outcome:
    """Load against voltage for a series of masses (appendix A)."""
    recorded, voltage_V = {}, []
    for i, force_N in enumerate(part.parameters["forces_N"]):
        operator.hang_mass(force_N)
        log = _point(rig, part, i, progress, {"force_N": force_N})
        recorded[f"calibration/load_cell_{i:02d}"] = log
        voltage_V.append(float(np.mean(log["load_cell_voltage_V"])))
    line = fit_line(voltage_V, part.parameters["forces_N"], f"load cell at {_channel(rig, 'load_cell')}")
    return Outcome(
        recorded,
        _line_results(line, voltage_V, part.parameters["forces_N"]),
        {"load_cell.slope": line.slope, "load_cell.offset": line.offset},
    )


def lvdt(part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress) -> Outcome:
    """Displacement against LVDT current at a series of places (appendix B)."""
    recorded, amperes, places_m = {}, [], []
    for i in range(part.parameters["places"]):
        place_m = operator.place_probe(i, part.parameters["places"])
        log = _point(rig, part, i, progress, {"place_m": place_m})
        recorded[f"calibration/lvdt_{i:02d}"] = log
        amperes.append(float(np.mean(log["lvdt_current_A"])))
        places_m.append(place_m)
    line = fit_line(amperes, places_m, f"LVDT at {_channel(rig, 'lvdt')}")
    return Outcome(
        recorded,
        _line_results(line, amperes, places_m),
        {"reference_sensor.slope": line.slope, "reference_sensor.offset": line.offset},
    )


def training(part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress) -> Outcome:
    """Pulses at the heaviest load until the ends of the wire stand (4.1.4), or as many as were asked for.

    One that was interrupted begins anew, on a wire that is as much nearer to its end.
    """
    _apply_load(part, operator)
    p, ends = part.parameters, Ends(rig.config.wire.full_stroke_m)
    program = programs.trained(
        ends.stand,
        p["cycles"],
        p["heat_current_A"],
        rig.config.supply.bias_current,
        p["heat_s"],
        p["cool_s"],
        p["most_current_A"],
        EXPANDS * rig.config.wire.strain_length_m,
    )
    log = _record(rig, part, program, progress)
    results: dict[str, Any] = {"hot_m": ends.hot_m, "cold_m": ends.cold_m}
    if isfinite(ends.furthest_m):
        results["left_m"] = ends.furthest_m
    return Outcome({part.name: log}, results, words=ends.words)


def pulses(part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress) -> Outcome:
    """Open-loop square pulses at one load (4.1.1); also the fatigue cycles (4.1.4).

    The few that a model is fitted on wait until the wire is at rest, in the heat and in the cold: near room temperature
    many cool with a long tail.  They are heated further than planned where the wire still contracts; ``heat_current_A``
    of the log's metadata says how far.
    """
    _apply_load(part, operator)
    p = part.parameters
    patience = PATIENCE if part.kind == FULL else 1.0
    program = square_pulses(
        p["cycles"],
        p["heat_current_A"],
        rig.config.supply.bias_current,
        p["heat_s"],
        p["cool_s"],
        patience * p["cool_s"],
        p.get("most_current_A", 0.0),
        patience * p["heat_s"],
        p.get("ramp_s", 0.0),
        EXPANDS * rig.config.wire.strain_length_m,
    )
    log = _record(rig, part, program, progress)
    log = dataclasses.replace(
        log, metadata={**log.metadata, "heat_current_A": _heat_current_A(log, p["heat_current_A"])}
    )
    return Outcome({part.name: log}, {"stroke_m": _stroke_m(log, rig.config)}, words=_held_back(part.name, log))


def _held_back(name: str, log: BenchLog) -> str:
    """That the heat limit let less current flow to the end of the last pulse than was asked for, in words, or ""."""
    current_A, asked_A = log["current_command_A"], log.metadata["heat_current_A"]
    flowed_A = float(current_A[np.flatnonzero(current_A > 0.5 * np.max(current_A))[-1]])
    if flowed_A >= HELD_BACK * asked_A:
        return ""
    return (
        f"{name}: the heat limit let {flowed_A:.3g} of {asked_A:.3g} A flow at the end of the last pulse; where the "
        "wire contracted less than under lighter loads it was not hot enough, and what is identified ends there. It "
        "is kept below thermal.max_temperature with half of thermal.heat_loss: a larger one, where that is known, lets "
        "it be hotter"
    )


def _heat_current_A(log: BenchLog, planned_A: float) -> float:
    """What flowed in its last pulse; no less than was planned, which a guard may have lowered."""
    current_A = log["current_command_A"]
    pulse = np.flatnonzero(current_A > 0.5 * (np.min(current_A) + np.max(current_A)))
    since = pulse[np.flatnonzero(np.diff(pulse) > 1)[-1] + 1] if (np.diff(pulse) > 1).any() else 0
    return max(planned_A, float(np.max(current_A[since:]))) if since else planned_A


def partial(part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress) -> Outcome:
    """Minor loops between every pair of set points, spread over the stroke the pulses showed (4.1.3)."""
    p = part.parameters
    shortest_m, longest_m = _stroke_m(logs[p["after"]], rig.config)
    set_points_m = np.linspace(longest_m, shortest_m, p["set_points"] + 2)[1:-1]
    _apply_load(part, operator)
    program = partial_cycles(
        list(set_points_m), _after(part, logs), rig.config.supply.bias_current, p["heat_s"] + p["cool_s"], p["cool_s"]
    )
    return Outcome(
        {part.name: _record(rig, part, program, progress)}, {"set_points_m": [float(s) for s in set_points_m]}
    )


def _after(part: Part, logs: Mapping[str, BenchLog]) -> float:
    """The current that contracted the wire in the pulses at the same load [A]."""
    pulses_before = logs.get(part.parameters["after"])
    planned_A = part.parameters["heat_current_A"]
    return planned_A if pulses_before is None else float(pulses_before.metadata.get("heat_current_A", planned_A))


def levels(part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress) -> Outcome:
    """Currents held one after the other, every step between two of them, at equal distances in power."""
    p = part.parameters
    bias_A = rig.config.supply.bias_current
    currents_A = [float(a) for a in np.sqrt(np.linspace(bias_A**2, _after(part, logs) ** 2, p["levels"]))]
    _apply_load(part, operator)
    log = _record(rig, part, held_currents(currents_A, p["heat_s"], p["cool_s"]), progress)
    return Outcome({part.name: log}, {"currents_A": currents_A})


def followed(part: Part, rig: Rig, operator: Operator, logs: Mapping[str, BenchLog], progress: Progress) -> Outcome:
    """What a controller does with the wire: positions held, a sine and a triangle, by the model that was identified."""
    p = part.parameters
    config = Config.load(p["model"])
    require_calibrated(config)
    if not config.calibration.ends_known:
        raise ConfigError(
            f"--follow: {p['model']} does not say where the wire ends; identify it from logs of full pulses"
        )
    low_m, high_m = _ends_m(config, p.get("load_N", p.get("preload_N")), p.get("stiffness_N_m", 0.0))
    held_m = positions_m(config, p["shares"], low_m, high_m)
    _apply_load(part, operator)
    program = programs.followed(ModelFollower(config), held_m, low_m, p["dwell_s"], p["period_s"])
    with rig.knowing(config.calibration):
        log = _record(rig, part, program, progress)
    return Outcome({part.name: log}, {"positions_m": held_m})


def positions_m(config: Config, shares: Sequence[float], low_m: float, high_m: float) -> list[float]:
    """The positions of the second round between where the wire is contracted and cold.

    Shares of the way; where the model says how unsure it is at a place, shares of its doubt along the way.
    """
    model = config.model.build(config.wire)
    first, last = OUTERMOST
    way = np.linspace(first, last, 181)
    doubt = np.ones(len(way))
    if isinstance(model, ThermalStrainModel):
        doubt = model.doubt(low_m + way * (high_m - low_m))
    grown = np.concatenate(([0.0], np.cumsum(doubt[1:] + doubt[:-1])))
    along = (np.array(shares) - first) / (last - first)
    return [float(low_m + share * (high_m - low_m)) for share in np.interp(along, grown / grown[-1], way)]


def _ends_m(config: Config, load_N: float, stiffness_N_m: float) -> tuple[float, float]:
    """Where the wire is contracted and cold at a load, by the calibration; against a spring it contracts to more
    load."""
    rest, hot_end, area_m2 = config.calibration.rest, config.calibration.hot_end, config.wire.area_m2
    high_m = float(np.interp(load_N / area_m2, rest.cold_stress, rest.cold_displacement))
    low_m = float(np.interp(load_N / area_m2, hot_end.contracted_stress, hot_end.contracted_displacement))
    if stiffness_N_m:
        hot_Pa = (load_N + stiffness_N_m * (high_m - low_m)) / area_m2
        low_m = float(np.interp(hot_Pa, hot_end.contracted_stress, hot_end.contracted_displacement))
    return low_m, high_m


RUN: dict[str, Callable[[Part, Rig, Operator, Mapping[str, BenchLog], Progress], Outcome]] = {
    "lead_resistance": lead_resistance,
    "load_cell": load_cell,
    "lvdt": lvdt,
    "training": training,
    FULL: pulses,
    PARTIAL: partial,
    LEVELS: levels,
    FOLLOWED: followed,
    MANY: pulses,
}


def _apply_load(part: Part, operator: Operator) -> None:
    p = part.parameters
    if "stiffness_N_m" in p:
        operator.fit_spring(p["stiffness_N_m"], p["preload_N"])
    else:
        operator.hang_load(p["load_N"])


def _record(
    rig: Rig, part: Part, program: Program, progress: Progress, but: Collection[str] = (), **more: Any
) -> BenchLog:
    wire = rig.config.wire
    metadata = {
        "kind": part.kind,
        "wire": wire.size,
        **part.parameters,
        **more,
    }
    return dataclasses.replace(rig.record(program, progress, but), metadata=metadata)


def _point(rig: Rig, part: Part, number: int, progress: Progress, more: Mapping[str, float]) -> BenchLog:
    """One calibration point: some seconds at the bias current."""
    average_s = part.parameters["average_s"]
    program = hold(rig.config.supply.bias_current, average_s)
    but = UNCALIBRATED if part.kind == "load_cell" else ()
    return _record(rig, part, program, lambda elapsed_s: progress(number * average_s + elapsed_s), but, **more)


def _stroke_m(log: BenchLog, config) -> tuple[float, float]:
    """Shortest and longest displacement in a log, spikes left out."""
    displacement_m = signals_from_log(log, config).reference_displacement_m
    shortest_m, longest_m = np.percentile(displacement_m, (0.5, 99.5))
    return float(shortest_m), float(longest_m)


def _line_results(line: Line, x: list[float], y: list[float]) -> dict[str, Any]:
    return {**dataclasses.asdict(line), "x": x, "y": y}
