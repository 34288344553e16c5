"""What a fit may vary of each effect, within what is physically possible, and what a log must show for it.

Bounds are shares of the log's own scales (stroke, resistance, load, power, duration), so they hold
for any wire.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sma_actuator.estimation.effects import EFFECTS

from .evidence import Evidence


@dataclass(frozen=True, slots=True)
class Free:
    """One parameter that a fit may vary."""

    name: str
    low: float
    high: float
    typical: float  #: a size parameter is varied in units of it
    starts: tuple[float, ...] = ()  #: of a shape parameter (time constant …), which alone changes nothing
    logarithmic: bool = True  #: whether a shape parameter is varied as its logarithm

    @property
    def is_size(self) -> bool:
        """Whether the effect is in proportion to it, and absent at zero."""
        return not self.starts

    def to_unit(self, value: float) -> float:
        """The number the optimiser sees."""
        return math.log(value) if self.starts and self.logarithmic else value / self.typical

    def from_unit(self, u: float) -> float:
        """Back from it, inside the bounds."""
        value = math.exp(u) if self.starts and self.logarithmic else u * self.typical
        return min(max(value, self.low), self.high)


@dataclass(frozen=True, slots=True)
class Scales:
    """Sizes of what the logs hold."""

    stroke_m: float
    resistance_Ohm: float
    range_Ohm: float
    current_A: float
    voltage_V: float
    load_N: float
    load_range_N: float
    power_W: float
    rise_K: float
    duration_s: float
    period_s: float
    ambient_change_K: float
    cycle_power_W: float
    cycles: int
    reference_Ohm: float
    thermal_s: float
    zero_m: float
    ambient_logged: bool

    @classmethod
    def of(cls, evidence: Evidence) -> Scales:
        """The scales of some logs."""
        signals = [t.signals for t in evidence.traces]

        def together(name: str) -> np.ndarray:
            return np.concatenate([np.atleast_1d(getattr(s, name)) for s in signals])

        def spread(values: np.ndarray) -> float:
            return float(np.subtract(*np.percentile(values, (99.0, 1.0))))

        power_W, load_N, ambient_C = together("power_W"), together("load_N"), together("ambient_temperature_C")
        current_A, resistance_Ohm = together("current_A"), together("resistance_Ohm")
        known = ambient_C[np.isfinite(ambient_C)]
        calibrated_C = evidence.config.calibration.ambient_temperature
        change_K = 0.0
        if len(known):
            change_K = max(
                spread(known), abs(float(np.median(known)) - calibrated_C) if math.isfinite(calibrated_C) else 0.0
            )
        high_W = float(np.percentile(power_W, 98.0))
        return cls(
            evidence.full_stroke_m,
            float(np.median(resistance_Ohm)),
            spread(resistance_Ohm),
            float(np.percentile(current_A, 98.0)),
            float(np.percentile(current_A * resistance_Ohm, 98.0)),
            float(np.median(np.abs(load_N))),
            spread(load_N),
            high_W,
            high_W / evidence.place.heat_loss_W_K,
            evidence.duration_s,
            float(np.median([np.median(np.diff(s.time_s)) for s in signals])),
            change_K,
            0.5 * (float(np.percentile(power_W, 5.0)) + high_W),
            evidence.units,
            evidence.place.reference_resistance_Ohm,
            evidence.config.thermal.heat_capacity / evidence.config.thermal.heat_loss,
            evidence.config.reference_sensor.offset if evidence.config.reference_sensor.fitted else 0.0,
            bool(len(known)),
        )


def _times(low: float, high: float, *starts: float) -> tuple[float, float, tuple[float, ...]]:
    return low, high, tuple(min(max(s, low), high) for s in starts)


def _time_constant(name: str, low: float, high: float, *starts: float) -> Free:
    low, high, inside = _times(low, high, *starts)
    return Free(name, low, high, 1.0, inside)


def _size(name: str, limit: float, typical: float, low: float | None = None) -> Free:
    return Free(name, -limit if low is None else low, limit, typical)


#: What is free of each effect.  A static lead may hide a fifth of R; slow things take up to five sessions.
_FREE: dict[str, Callable[[Scales], list[Free]]] = {
    "lead_resistance": lambda s: [_size("resistance", 0.3 * s.resistance_Ohm, 0.02 * s.resistance_Ohm)],
    "contact_drift": lambda s: [
        _size("resistance", 0.5 * s.resistance_Ohm, 0.02 * s.resistance_Ohm),
        _time_constant(
            "time_constant",
            0.05 * s.duration_s,
            5.0 * s.duration_s,
            0.15 * s.duration_s,
            0.6 * s.duration_s,
            4.0 * s.duration_s,
        ),
    ],
    "voltage_offset": lambda s: [_size("offset", 0.2 * s.voltage_V, 0.01 * s.voltage_V)],
    "reference_self_heating": lambda s: [
        _size("coefficient", 0.3 / (s.current_A**2 * s.reference_Ohm), 0.02 / (s.current_A**2 * s.reference_Ohm)),
        _time_constant(
            "time_constant", max(3.0, 2.0 * s.thermal_s), 100.0, 5.0, 20.0, 60.0
        ),  # a resistor has more mass than a wire
    ],
    "shunt": lambda s: [_size("conductance", 0.3 / s.resistance_Ohm, 0.02 / s.resistance_Ohm, 0.0)],
    "load_cell_drift": lambda s: [
        _size("offset", 2.0 * s.load_N, 0.1 * s.load_N),
        _size("rate", 2.0 * s.load_N / s.duration_s, 0.1 * s.load_N / s.duration_s),
    ],
    "load_cell_gain": lambda s: [_size("gain", 0.6, 0.1)],
    "self_heating": lambda s: [
        _size("temperature_coefficient", 5e-3, 2e-4),
        Free("onset", 0.02 * s.rise_K, 0.95 * s.rise_K, 1.0, (0.1 * s.rise_K, 0.4 * s.rise_K, 0.7 * s.rise_K)),
        _time_constant("time_constant", 0.3 * s.thermal_s, 4.0 * s.thermal_s, s.thermal_s),
    ],
    "ambient_temperature": lambda s: [
        _size("temperature_coefficient", 2e-2, 5e-4),
        Free("fading", 0.03 * s.rise_K, 30.0 * s.rise_K, 1.0, (0.15 * s.rise_K, 0.8 * s.rise_K, 10.0 * s.rise_K)),
    ],
    "thermal_expansion": lambda s: [
        _size("coefficient", 2e-4, 1e-5),
        _time_constant("time_constant", 0.3, max(0.5 * s.duration_s, 2.0), 1.5, 15.0, 100.0),
    ],
    "elastic_compliance": lambda s: [_size("compliance", 0.6 * s.stroke_m / s.load_N, 0.02 * s.stroke_m / s.load_N)],
    "fatigue": lambda s: [
        _size("displacement_per_ln_cycle", 0.2 * s.stroke_m, 0.01 * s.stroke_m),
        _size("resistance_per_ln_cycle", 0.2 * s.range_Ohm, 0.01 * s.range_Ohm),
    ],
    "creep": lambda s: [
        _size("compliance", 0.6 * s.stroke_m / s.load_N, 0.02 * s.stroke_m / s.load_N),
        _time_constant("time_constant", 3.0, 3.0 * s.duration_s, 10.0, 0.15 * s.duration_s, 0.8 * s.duration_s),
    ],
    "minor_loop_memory": lambda s: [
        _size("after_heating", 0.6 * s.stroke_m, 0.05 * s.stroke_m),
        _size("after_cooling", 0.6 * s.stroke_m, 0.05 * s.stroke_m),
    ],
    "rate": lambda s: [
        _size("displacement_per_rate", 2.0 * s.stroke_m / s.range_Ohm, 0.1 * s.stroke_m / s.range_Ohm),
        Free("relaxation_time", 1e-3, 5.0, 1.0, (1e-2, 0.2)),
    ],
    "slip": lambda s: [_size("length", s.stroke_m, 0.02 * s.stroke_m)],  # and a time, which is searched for
    "backlash": lambda s: [
        Free(
            "width", 1e-4 * s.stroke_m, 0.5 * s.stroke_m, 1.0, (0.02 * s.stroke_m, 0.06 * s.stroke_m, 0.15 * s.stroke_m)
        ),
    ],
    "reference_lag": lambda s: [Free("time_constant", 1e-3, 5.0, 1.0, (0.1, 0.5))],
    # A gain of the electronics turns about the sensor's electrical zero, one of the mechanics about the calibration's.
    "reference_gain": lambda s: [
        _size("gain", 0.5, 0.03),
        Free("pivot", min(s.zero_m, 0.0) - 1e-9, max(s.zero_m, 0.0) + 1e-9, s.stroke_m, (0.0, s.zero_m), False),
    ],
    "reference_drift": lambda s: [
        _size("offset", s.stroke_m, 0.02 * s.stroke_m),
        _size("rate", 1.0 * s.stroke_m / s.duration_s, 0.02 * s.stroke_m / s.duration_s),
    ],
}


#: A wire that wears changes its length; where its resistance alone drifts, it is the contact.
_ESSENTIAL = {"fatigue": "displacement_per_ln_cycle"}


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect as it competes."""

    name: str
    free: tuple[Free, ...]
    fixed: dict[str, float]
    essential: str = ""  #: name of a size parameter without which it is not this effect
    scanned: str = ""  #: name of a parameter in which the loss is not smooth: it is searched over a grid

    @property
    def stage(self) -> str:
        """Where in the chain it acts."""
        return EFFECTS[self.name].STAGE

    @property
    def parameters(self) -> int:
        """How many parameters it has to earn."""
        return len(self.free) + bool(self.scanned)

    def build(self, values: dict[str, float]) -> object:
        """The effect with these parameters."""
        return EFFECTS[self.name](**{**self.fixed, **values})


def candidate(name: str, scales: Scales, evidence: Evidence) -> Candidate:
    """An effect, what is free of it and what the configuration fixes."""
    fixed: dict[str, float] = {}
    config = evidence.config
    if hasattr(EFFECTS[name], "heat_loss"):
        fixed["heat_loss"] = config.thermal.heat_loss
    if name == "ambient_temperature":
        fixed["calibration_temperature"] = _calibration_temperature(config)
        fixed["time_constant"] = config.thermal.heat_capacity / config.thermal.heat_loss
    if name == "fatigue":
        fixed["cycle_power"] = scales.cycle_power_W
    free = _FREE[name](scales)
    if name == "self_heating" and evidence.beyond_floor:  # later, the calibration's rests say what the cold end does
        free += [
            _size("cold_temperature_coefficient", 5e-3, 2e-4),
            Free(
                "cold_onset", 0.02 * scales.rise_K, 0.6 * scales.rise_K, 1.0, (0.2 * scales.rise_K, 0.4 * scales.rise_K)
            ),
        ]
    return Candidate(name, tuple(free), fixed, _ESSENTIAL.get(name, ""), "time" if name == "slip" else "")


def _calibration_temperature(config) -> float:
    known = config.calibration.ambient_temperature
    return known if math.isfinite(known) else config.thermal.ambient_temperature


def untestable(name: str, scales: Scales, evidence: Evidence) -> str:
    """Why these logs could not show an effect; empty where they could."""
    model = evidence.config
    loads_differ = scales.load_range_N > 0.1 * scales.load_N
    rests = [r for rests in evidence.rests for r in rests]
    if name == "ambient_temperature":
        if not scales.ambient_logged:
            return "no ambient temperature in the logs (column ambient_temperature_C)"
        if not math.isfinite(model.calibration.ambient_temperature) and scales.ambient_change_K < 1.0:
            return "the ambient temperature stays within 1 K, and that of the calibration is not known"
        if scales.ambient_change_K < 1.0:
            return f"the ambient temperature is within {scales.ambient_change_K:.1f} K of the calibration's"
    if name == "elastic_compliance" and not loads_differ:
        return "one load only: a stretch in proportion to load shows where the load changes"
    if name in ("load_cell_gain", "load_cell_drift") and not _model_feels_stress(evidence):
        return "the model hardly depends on stress at this load"
    if name == "fatigue" and scales.cycles < 6:
        return f"{scales.cycles} cycles are too few for a drift with the logarithm of their number"
    if name == "minor_loop_memory" and not _partial_cycles(evidence):
        return "no partial cycles: every transformation goes to its end"
    if name == "contact_drift" and not any(not r.hot for r in rests):
        return "no rest in the cold, where a drifting contact shows in the resistance and hardly in the displacement"
    if name == "reference_lag" and scales.period_s > 0.5:
        return f"one reading in {scales.period_s:.2g} s is too slow to show a lag"
    return ""


def _model_feels_stress(evidence: Evidence) -> bool:
    from sma_actuator.estimation.effects import EFFECTS as forms

    base = evidence.predict({})
    more = evidence.predict({"load_cell_gain": forms["load_cell_gain"](gain=0.1)})
    moved = [np.mean(np.abs(a.shown_m - b.shown_m)) for a, b in zip(base, more, strict=True)]
    return max(moved) > 1e-3 * evidence.full_stroke_m


def _partial_cycles(evidence: Evidence) -> bool:
    """Whether at least a twentieth of the cycles turn back before they are through nine tenths of the stroke."""
    spans = []
    for measured_m, unit in zip(evidence.measured_m, evidence.unit, strict=True):
        spans += [np.ptp(measured_m[unit == u]) for u in np.unique(unit)]
    return bool(np.mean(np.array(spans) < 0.85 * np.max(spans)) > 0.05)
